"""What ground stations may have changed of the law and the model: a response level, what was learnt, and back. Pure."""

from __future__ import annotations

import math
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.links.boat.long_commands import Run

LEARNING, LEVEL = int(dialect.MAV_CMD_USER_4), int(dialect.MAV_CMD_USER_5)
"""USER_4: learning; 1 adopts the proved model, 2 goes back to the one before.
USER_5: response level, 1 calm to 9 quick."""
ADOPT, REVERT = 1.0, 2.0


class Tuning(Run, Protocol):
    """A change that is being worked out, and how it ended, in words for people."""

    @property
    def said(self) -> str:
        """What people should know at its end."""


class Tuner(Protocol):
    """Who works changes out beside the loop and puts them in force between two ticks."""

    level: float
    """The response level put in force last, not a number before."""

    def set_level(self, level: int) -> Tuning:
        """Begin to put a response level (1 calm to 9 quick) in force. Raises InputError."""

    def adopt(self) -> Tuning:
        """Begin to put the proved model in force. Raises InputError."""

    def revert(self) -> Tuning:
        """Put back in force what was before the latest adoption. Raises InputError."""

    def learnt(self) -> dict[str, float]:
        """Return what was learnt by names of at most ten characters; empty where nothing is learnt."""


class TuningCommands:
    """The commands that tune, on the way to `tuner`; without one they are not known."""

    def __init__(self, tuner: Tuner | None) -> None:
        self._tuner = tuner
        self._begun: Tuning | None = None

    def begin(self, command: int, value: float) -> Tuning | None:
        """Begin what a command with its first parameter asks for; None where that is not known. Raises InputError."""
        tuner = self._tuner
        if tuner is None or (command == LEARNING and value not in (ADOPT, REVERT)):
            return None
        if command == LEARNING:
            self._begun = tuner.adopt() if value == ADOPT else tuner.revert()
        elif math.isfinite(value) and value == int(value):
            self._begun = tuner.set_level(int(value))
        else:
            raise InputError(f"response level {value:g}: allowed is a whole number from 1 (calm) to 9 (quick)")
        return self._begun

    def told(self) -> str:
        """Return what a change that has ended came to, once."""
        begun = self._begun
        if begun is None or not begun.is_over:
            return ""
        self._begun = None
        return begun.said
