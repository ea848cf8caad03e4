"""What steers the boat, by name: a kind of drive is one module here and one line in MODULES.

A kind says what the boat needs to be steered, how K and T usually go with speed and throttle
(`autopilot.models.drive_law`), and which outputs of a flight controller carry the steering
(`docs/howto/add_a_drive.md`). Nobody else asks its name.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Literal

from autopilot.models.drives.kind import DriveKind as DriveKind
from autopilot.models.drives.kind import Needs as Needs

MODULES = ("rudder", "turned_thrust", "two_thrusters")
"""Modules of this room with a tuple DRIVES, the usual kind first."""
DRIVES: dict[str, DriveKind] = {
    kind.name: kind for name in MODULES for kind in import_module(f"autopilot.models.drives.{name}").DRIVES
}
if TYPE_CHECKING:
    DriveName = str
else:
    DriveName = Literal[tuple(DRIVES)]
