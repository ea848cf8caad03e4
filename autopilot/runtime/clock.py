"""Clocks the loop runs on: the machine's monotonic one, a faster one, and a manual one for tests and lockstep."""

from __future__ import annotations

import select
import time
from collections.abc import Sequence
from typing import Protocol


def running_time() -> float:
    """Return seconds of a clock that never goes backwards, and goes on while the machine is suspended."""
    return time.clock_gettime(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


class Clock(Protocol):
    """Tells the time and waits."""

    def now(self) -> float:
        """Return seconds of a clock that never goes backwards."""

    def wait(self, descriptors: Sequence[int], until: float) -> None:
        """Return when a descriptor can be read or `until` [s] has come, whichever is first."""


class MonotonicClock:
    """The machine's `running_time`, from 0 at creation, `speedup` times as fast (for a sped-up simulator)."""

    def __init__(self, speedup: float = 1.0) -> None:
        self._speedup = speedup
        self._start = running_time()

    def now(self) -> float:
        """Return seconds since creation, times the speed-up."""
        return (running_time() - self._start) * self._speedup

    def wait(self, descriptors: Sequence[int], until: float) -> None:
        """Wait for bytes or for `until` [s]."""
        left = (until - self.now()) / self._speedup
        if left > 0.0:
            select.select(descriptors, (), (), left)


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
