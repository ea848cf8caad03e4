"""What ground stations may have changed of the law and the model: a response level, what was learnt, and back. Pure."""

from __future__ import annotations

from typing import Protocol

from autopilot.links.boat.long_commands import Run

ADOPT, REVERT = 1, 2
"""Parameter 1 of the learning command."""


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
