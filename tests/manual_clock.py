"""A clock for runs whose time passes only as they wait."""

from __future__ import annotations

from collections.abc import Sequence


class ManualClock:
    """A clock that moves when it is ordered to: waiting is arriving."""

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Return the time last set."""
        return self._now

    def advance(self, seconds: float) -> None:
        """Move on by `seconds` >= 0."""
        if seconds < 0.0:
            raise ValueError(f"a clock does not go backwards: {seconds}")
        self._now += seconds

    def wait(self, descriptors: Sequence[int], until: float) -> None:
        """Arrive at `until` at once."""
        self._now = max(self._now, until)
