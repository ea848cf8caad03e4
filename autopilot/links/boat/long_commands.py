"""Commands that take a while: IN_PROGRESS with the percentage while they last, the result at their end. Pure.

Source: https://mavlink.io/en/services/command.html, long running commands.
"""

from __future__ import annotations

import math
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink_codec import Message

CANCELLED = 6
"""MAV_RESULT_CANCELLED, which the dialect does not have."""
PROGRESS_S = 1.0


class Run(Protocol):
    """Something that takes a while; progress from 0 to 1."""

    is_over: bool
    is_complete: bool

    @property
    def progress(self) -> float:
        """Share that is done."""


class LongCommand:
    """A command that is being carried out."""

    def __init__(self, command: int, parameters: tuple[float, ...], run: Run) -> None:
        self.command, self.parameters, self.run = command, parameters, run
        self.is_cancelled = False

    @property
    def percent(self) -> int:
        """How much of it is done."""
        return round(100.0 * self.run.progress)

    @property
    def result(self) -> int:
        """MAV_RESULT as of now."""
        if not self.run.is_over:
            return int(dialect.MAV_RESULT_IN_PROGRESS)
        if self.is_cancelled:
            return CANCELLED
        return int(dialect.MAV_RESULT_ACCEPTED if self.run.is_complete else dialect.MAV_RESULT_FAILED)


class ProgressReports:
    """What one link tells of the command that came over it."""

    def __init__(self) -> None:
        self._reported: tuple[LongCommand, tuple[int, int]] | None = None
        self._next = math.inf

    def begin(self, now: float, command: LongCommand, sender: tuple[int, int]) -> None:
        """Report to `sender` (system, component) from now [s] on."""
        self._reported, self._next = (command, sender), now + PROGRESS_S

    def is_for(self, sender: tuple[int, int]) -> bool:
        """Return whether `sender` is reported to."""
        return self._reported is not None and sender == self._reported[1]

    def due(self, now: float) -> list[Message]:
        """Return the acknowledgement that falls due, and the last one at once."""
        if self._reported is None:
            return []
        command, sender = self._reported
        if now < self._next and not command.run.is_over:
            return []
        self._next = now + PROGRESS_S
        if command.run.is_over:
            self._reported = None
        return [acknowledgement(command.command, command.result, sender, command.percent)]


def acknowledgement(command: int, result: int, sender: tuple[int, int], percent: int = 0) -> Message:
    """Return COMMAND_ACK."""
    return dialect.MAVLink_command_ack_message(command, result, percent, 0, *sender)
