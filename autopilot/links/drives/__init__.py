"""Rudder drives on serial lines of their own: what they speak, without the line itself. One line each in DRIVES."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple, cast

if TYPE_CHECKING:
    from autopilot.links.drives.base import Drive, DriveSettings


class DriveKind(NamedTuple):
    """A kind of drive: its module in this room and its class, and an example of its URLs."""

    place: str
    example: str


DRIVES = {
    "pypilot": DriveKind("pypilot_motor.PypilotMotor", "pypilot:/dev/ttyUSB2:38400"),
    "jrk": DriveKind("jrk.JrkG2", "jrk:/dev/ttyACM0:115200"),
    "maestro": DriveKind("maestro.Maestro", "maestro:/dev/ttyACM0:115200"),
    "valve": DriveKind("valve.ValveDrive", "valve:/dev/ttyACM0:115200"),
}
"""Kinds of drives by the beginning of their URLs; only the one that is used is loaded."""


def drive_of(kind: str, settings: DriveSettings) -> Drive:
    """Return the protocol of a kind of drive."""
    module, _, name = DRIVES[kind].place.partition(".")
    return cast("Drive", getattr(import_module(f"{__name__}.{module}"), name)(settings))
