"""What a kind of drive says of itself."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from autopilot.models.drive_law import DriveLaw


class Needs(Enum):
    """What must be there before the boat can be steered."""

    WAY = "way through the water"
    THRUST = "thrust"
    NOTHING = "nothing: it turns where it lies"


class DriveKind(NamedTuple):
    """A kind of drive.

    name: the value of `drive.kind` in the vessel file. needs: what it steers by. usual: how K and T go with speed and
    throttle where no trial has shown it. outputs: the servo functions (SERVOn_FUNCTION) of an ArduRover that carry the
    steering, in the order in which they are read. advice: what to set where they are not there.
    """

    name: str
    needs: Needs
    usual: DriveLaw
    outputs: tuple[int, ...]
    advice: str

    @property
    def is_mixed(self) -> bool:
        """Whether the flight controller mixes steering and throttle into the same outputs."""
        return len(self.outputs) > 1
