"""A boat off the course that it is to hold, and one that turns against its rudder."""

from __future__ import annotations

import math

from autopilot.alarms import AT_STOP
from autopilot.angles import shortest_turn
from autopilot.models.norrbin import Norrbin, steady_rudder
from autopilot.monitors.rudder import is_hard_over
from autopilot.monitors.watched import NEWS, AlarmLimits, Watched
from autopilot.signals import AlarmEvent

BACK_ON_COURSE = 0.7
"""An off-course alarm ends when the error is back within this share of its limit."""
AGAINST_SHARE = 0.8
"""A boat that turns against a rudder hard over, as a rudder of this share to the other side would turn it."""
ASTRAY = math.radians(45.0)
"""No zigzag overshoots by as much: IMO MSC.137(76) allows 40 deg at most for the second of 10/10, 25 deg for 20/20."""
TAKES_HOLD, HOLDS, SETTLED = 1.0, 2.0, 3.0
"""Time constants after which a rudder hard over has begun to stop what it can stop, has stopped most of it, and what
was before it is forgotten."""
FAR = math.radians(20.0)
WAVES_REACH = 2.0
"""So far [rad], and so many standard deviations of what the waves turn it, has a boat turned against its rudder that is
pushed harder than it can hold."""


def course_step(limits: AlarmLimits, since: float, is_off: bool, now: float, error: float) -> tuple[float, bool]:
    """Return since when [s] the boat has been off course (nan: it is on course), and whether that is an alarm.

    `since` and `is_off` are what this returned before; `error` [rad] is the heading's, off the course ordered.
    """
    limit = limits.off_course * (BACK_ON_COURSE if is_off else 1.0)
    # written so that an error that is no number is no reason to be quiet
    if abs(error) <= limit:
        return math.nan, False
    if math.isnan(since):
        return now, False
    return since, is_off or now - since >= limits.off_course_time


class OffCourse:
    """The off-course alarm: how far, which way, and whether the rudder is at its stop."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._since, self._is_off = math.nan, False
        self._told = math.nan
        self.found: AlarmEvent | None = None

    def look(self, limits: AlarmLimits, watched: Watched) -> None:
        """Judge a tick; not while a turn may last."""
        if not watched.holds_course or math.isinf(limits.off_course):
            self.reset()
            return
        error = shortest_turn(watched.wanted, watched.state.heading)
        self._since, self._is_off = course_step(limits, self._since, self._is_off, watched.now, error)
        if not self._is_off:
            self.found = None
        elif self.found is None or abs(error - self._told) > NEWS:
            self.found, self._told = _event(error, watched), error


def _event(error: float, watched: Watched) -> AlarmEvent:
    off = f"by {math.degrees(abs(error)):.0f} deg to {'starboard' if error > 0.0 else 'port'}"
    return AlarmEvent("off_course", off, AT_STOP if is_hard_over(watched) else "")


class Runaway:
    """Rudder hard over, and the boat goes on to turn to the other side: pushed harder than it can hold, or run away.

    It has run away where it turns nearly as for a rudder hard over there: one that is at its other stop, or a push of
    nearly twice what the rudder can do. Sea and gust turn it so for less than the time in which the rudder takes hold,
    or not so far; a wave turns it back again, so that the mean rate must be as quick as the present one. A zigzag
    orders its rudder without looking back: there it is enough that it goes on turning against it, far on the wrong
    side.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._hard_since: float | None = None
        self._heading = math.nan
        self._time, self._mean_rate = math.nan, 0.0
        self._side = self._turned = math.nan
        self._way = self._held_way = self._held_since = 0.0
        self.has_run = False
        self.overpowered = ""

    def look(self, model: Norrbin, watched: Watched) -> None:
        """Judge a tick: `has_run`, or `overpowered`, which says to where, '' where neither."""
        if not watched.steers:
            self.reset()
            return
        state, last, elapsed = watched.state, self._heading, watched.now - self._time
        self._heading, self._time = state.heading, watched.now
        if watched.astray > ASTRAY and state.rate * watched.rudder < 0.0:
            self.has_run = True
            return
        self.has_run = False
        step = shortest_turn(last, state.heading) if math.isfinite(last) and math.isfinite(state.heading) else 0.0
        if elapsed > 0.0:
            share = -math.expm1(-elapsed / _averaging_time(model, watched))
            self._mean_rate += share * (step / elapsed - self._mean_rate)
        # by the heading: a rate may come from a gyro that is wrong, and is late where there is none
        self._way += step
        side = math.copysign(1.0, watched.rudder)
        self._turned = max(self._turned - side * step, 0.0) if side == self._side else 0.0
        self._side = side
        if self._turned == 0.0:
            self.overpowered = ""
        if not is_hard_over(watched):
            self._hard_since = None
            return
        if self._hard_since is None:
            self._hard_since = watched.now
        far = FAR + WAVES_REACH * state.wave_deviation
        lasted = watched.now - self._hard_since
        if lasted < HOLDS * model.time_constant:
            self._held_since, self._held_way = watched.now, self._way
        if lasted < TAKES_HOLD * model.time_constant or self._turned < far:
            return
        if lasted >= SETTLED * model.time_constant:
            # both: the mean remembers how the boat turned before the rudder came over, this one holds a wave's
            held = (self._way - self._held_way) / (watched.now - self._held_since)
            self.has_run = _turns_against(model, watched, (held, self._mean_rate))
        self.overpowered = self.overpowered or f"to {'port' if watched.rudder > 0.0 else 'starboard'}"


def _turns_against(model: Norrbin, watched: Watched, rates: tuple[float, ...]) -> bool:
    side = -math.copysign(1.0, watched.rudder)
    return all(side * steady_rudder(model, rate) >= AGAINST_SHARE * abs(watched.rudder) for rate in rates)


def _averaging_time(model: Norrbin, watched: Watched) -> float:
    """Return the time constant [s] of the mean rate of turn: the boat's, or longer where waves turn a boat far that its
    rudder turns slowly.

    A low pass leaves at most 2 deviations of heading / time constant of what waves add to the rate; that is to be no
    more than what lies between K rudder_max and `AGAINST_SHARE` of it.
    """
    waves = WAVES_REACH * watched.state.wave_deviation
    return max(model.time_constant, waves / ((1.0 - AGAINST_SHARE) * abs(model.gain) * watched.angle_max))
