"""What ends a trial before its time: an alarm, or speed, heading, distance and time outside what was set. Pure."""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.alarms import kind_of
from autopilot.angles import wrap
from autopilot.guidance.rhumb import Place, offset
from autopilot.signals import AlarmEvent, PositionSample, Tick


class TrialLimits(NamedTuple):
    """speed_low and speed_high [m/s], corridor [rad] either side of the course at the beginning, radius [m] around the
    place of the beginning, time [s] from the beginning; each infinite where there is none.
    """

    speed_low: float = -math.inf
    speed_high: float = math.inf
    corridor: float = math.inf
    radius: float = math.inf
    time: float = math.inf


class TrialWatch:
    """Watches one trial from its first tick on. Memory: where it began, and how far off it is."""

    def __init__(self, limits: TrialLimits) -> None:
        self._limits = limits
        self._begun: Tick | None = None
        self._now = 0.0
        self._origin: Place | None = None
        self._start = (0.0, 0.0)
        self._known: frozenset[str] = frozenset()
        self.north = 0.0
        self.east = 0.0

    @property
    def distance(self) -> float:
        """How far [m] the boat is from where the trial began."""
        return math.hypot(self.north, self.east)

    def reason(self, tick: Tick) -> AlarmEvent | str:
        """Return why the trial must end: a new alarm, or one sentence about a limit; '' while it need not."""
        if self._begun is None:
            self._begun, self._now = tick, tick.now
            self._known = frozenset(event.name for event in _ending(tick))
        self._carry(tick)
        for event in _ending(tick):
            if event.name not in self._known:
                return event._replace(is_escalated=False)
        limits, state = self._limits, tick.state
        swing = wrap(state.heading - self._begun.state.heading)
        if tick.now - self._begun.now > limits.time:
            return f"the time limit of {limits.time:g} s is over"
        if not limits.speed_low <= state.speed <= limits.speed_high:
            return (
                f"the speed of {state.speed:.2f} m/s is outside {limits.speed_low:g} to {limits.speed_high:g} m/s; "
                "set the throttle"
            )
        if abs(swing) > limits.corridor:
            return (
                f"the heading is {math.degrees(swing):+.0f} deg off the course at the beginning, beyond "
                f"{math.degrees(limits.corridor):.0f} deg"
            )
        if self.distance > limits.radius:
            return f"the boat is {self.distance:.0f} m from where the trial began, beyond {limits.radius:g} m"
        return ""

    def _carry(self, tick: Tick) -> None:
        dt, self._now = tick.now - self._now, tick.now
        self.north += dt * tick.state.speed * math.cos(tick.state.heading)
        self.east += dt * tick.state.speed * math.sin(tick.state.heading)
        for sample in tick.samples:
            if isinstance(sample, PositionSample) and math.isfinite(sample.latitude + sample.longitude):
                place = Place(sample.latitude, sample.longitude)
                if self._origin is None:
                    self._origin, self._start = place, (self.north, self.east)
                north, east = offset(self._origin, place)
                self.north, self.east = self._start[0] + north, self._start[1] + east


def _ending(tick: Tick) -> list[AlarmEvent]:
    """Return the alarms that end a trial where they were not there when it began."""
    return [event for event in tick.alarms if kind_of(event).ends_trials]
