"""A `Link` to nobody: brings what a guide has to say into the pilot, as an alarm that log and links carry on."""

from __future__ import annotations

from typing import Protocol

from autopilot.signals import AlarmEvent, AlarmSample, Mode, RudderCommand, Sample


class Guide(Protocol):
    """Who has something to say."""

    @property
    def alarm(self) -> AlarmEvent | None:
        """What the skipper should know, None while all is well."""


class GuideAlarms:
    """Word of `guide`, under `name`, whenever it changes."""

    def __init__(self, guide: Guide, name: str) -> None:
        self.name = name
        self._guide = guide
        self._said: AlarmEvent | None = None

    def fileno(self) -> int:
        """Return -1: there is nothing to wait for."""
        return -1

    def receive(self, now: float) -> list[Sample]:
        """Return what is new."""
        if self._guide.alarm == self._said:
            return []
        self._said = self._guide.alarm
        return [AlarmSample(now, self._said, self.name)]

    def send(self, now: float, command: RudderCommand) -> None:
        """Do nothing."""

    def tell(self, now: float, mode: Mode, alarms: tuple[AlarmEvent, ...]) -> None:
        """Do nothing."""

    def keep(self, now: float) -> None:
        """Do nothing."""

    def release(self, now: float) -> None:
        """Do nothing."""

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Return nothing."""
        return []

    def close(self) -> None:
        """Do nothing."""
