"""A link that passes on only the samples of the instruments to be believed; all else is the link's inside."""

from __future__ import annotations

from autopilot.estimation.source_priority import SourcePriority
from autopilot.links.base import ConfirmsRelease, Link, Shows
from autopilot.links.release import Release, not_held
from autopilot.signals import AlarmEvent, Mode, RudderCommand, Sample, Tick


class BelievedLink:
    """A `Link` round another. All links of a run share one `priority`, which sees the samples of all of them."""

    def __init__(self, link: Link, priority: SourcePriority) -> None:
        self.name = link.name
        self.inside = link
        self._priority = priority

    def fileno(self) -> int:
        """Return the descriptor of the link inside."""
        return self.inside.fileno()

    def receive(self, now: float) -> list[Sample]:
        """Return the samples to be believed. Raises LinkError."""
        return self._priority.admit(now, self.inside.receive(now), self.name)

    def send(self, now: float, command: RudderCommand) -> None:
        """Pass on."""
        self.inside.send(now, command)

    def tell(self, now: float, mode: Mode, alarms: tuple[AlarmEvent, ...]) -> None:
        """Pass on."""
        self.inside.tell(now, mode, alarms)

    def keep(self, now: float) -> None:
        """Pass on."""
        self.inside.keep(now)

    def show(self, tick: Tick) -> None:
        """Pass on where the link inside shows anything."""
        if isinstance(self.inside, Shows):
            self.inside.show(tick)

    def release(self, now: float) -> None:
        """Pass on."""
        self.inside.release(now)

    def release_result(self, now: float) -> Release | None:
        """Pass on where the link inside moves a rudder."""
        inside = self.inside
        return inside.release_result(now) if isinstance(inside, ConfirmsRelease) else not_held(self.name)

    def take_packets(self) -> list[tuple[float, bytes]]:
        """Pass on."""
        return self.inside.take_packets()

    def close(self) -> None:
        """Pass on."""
        self.inside.close()
