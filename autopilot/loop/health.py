"""What the loop sees of itself: ticks that come late, and a wall clock that somebody has set."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

from autopilot.links.alarm_outputs import SilentLink
from autopilot.loop.clock import running_time
from autopilot.monitors.watched import LATE_PERIODS
from autopilot.signals import ConditionSample, Sample, Tick

LATE_COUNT = 3
LATE_WITHIN_S = 10.0
"""So many late ticks within this time are an alarm, until so long passes without one."""
STANDSTILL_S = 1.0
"""One tick later than this is an alarm at once: a stopped process or machine, while the boat went on. As long a vehicle
has to follow an order before it counts as disobedient."""
STEP_S = 1.0
SAID_S = 60.0
CHECK_S = 1.0


class LoopHealth(SilentLink):
    """A `Link` to nobody: is shown every tick, and brings what is wrong with their times into the next one.

    `wall` and `monotonic` return seconds; `period` [s] is the control period, in the loop's own time.
    """

    name = "loop"

    def __init__(
        self,
        period: float,
        wall: Callable[[], float] = time.time,
        monotonic: Callable[[], float] = running_time,
    ) -> None:
        self._longest = LATE_PERIODS * period
        self._wall, self._monotonic = wall, monotonic
        self._last: float | None = None
        self._late: deque[float] = deque()
        self._longest_gap = 0.0
        self._is_late = False
        self._offset = wall() - monotonic()
        self._checked = monotonic()
        self._stepped_at: float | None = None

    def show(self, tick: Tick) -> None:
        """Take the time of a tick."""
        if self._last is not None and tick.now - self._last > self._longest:
            self._late.append(tick.now)
            self._longest_gap = max(self._longest_gap, tick.now - self._last)
        self._last = tick.now

    def receive(self, now: float) -> list[Sample]:
        """Return what has begun or ended."""
        return [*self._lateness(now), *self._clock(now)]

    def _lateness(self, now: float) -> list[Sample]:
        while self._late and now - self._late[0] > LATE_WITHIN_S:
            self._late.popleft()
        stood_still = self._longest_gap > max(STANDSTILL_S, self._longest)
        if not self._is_late and (len(self._late) >= LATE_COUNT or (self._late and stood_still)):
            self._is_late = True
            ticks = "tick" if len(self._late) == 1 else "ticks"
            detail = f"{len(self._late)} {ticks} late by up to {self._longest_gap:.2f} s"
            return [ConditionSample(now, "deadline_missed", True, detail, self.name)]
        if self._is_late and not self._late:
            self._is_late, self._longest_gap = False, 0.0
            return [ConditionSample(now, "deadline_missed", False, "", self.name)]
        return []

    def _clock(self, now: float) -> list[Sample]:
        running = self._monotonic()
        if running - self._checked < CHECK_S:
            return []
        self._checked = running
        offset = self._wall() - running
        step, self._offset = offset - self._offset, offset
        if abs(step) > STEP_S:
            self._stepped_at = running
            return [ConditionSample(now, "clock_stepped", True, f"by {step:+.0f} s", self.name)]
        if self._stepped_at is not None and running - self._stepped_at > SAID_S:
            self._stepped_at = None
            return [ConditionSample(now, "clock_stepped", False, "", self.name)]
        return []
