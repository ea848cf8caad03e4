"""A boat that does not keep its course: off it, against its rudder, from stop to stop, or round and round.

A boat off the course that it is to hold, and one that turns against its rudder.

A boat that swings from stop to stop, goes round in circles or spins while it is to hold a heading.

No model tells why: the file may have the wrong boat, speed, rudder or delay, and what the loop does is what counts. A
loop that is unstable by its own rudder ends in a limit cycle: the order goes from one side far to the other, again and
again, and the heading with it. A heavy sea can look like that. So the pilot is made soft first (SOFTER): it supposes a
boat that answers so many times as much, which has a quarter of the gain and half the bandwidth and with which a boat of
up to so many times its model's liveliness is stable again; if need be, softer still (SOFTEST). In a sea the rudder then
rests more than before, and nothing else comes of it. Swings that the rudder does not account for are a sea's, or
gusts', however slow the rudder is against them: they are none of steering's. Where the swings by the rudder go on all
the same, steering makes them, and ends.

By the model no steady turn is quicker than that with the rudder hard over. One that is SPIN times as quick for a while,
as if twice the rudder pushed beside it, and to the rudder's side, is another boat's; RUSH times, and the law is made
soft. A boat that is known to be pushed harder than its rudder is not taken to go round by itself. Pure.
"""

from __future__ import annotations

import math
from itertools import combinations_with_replacement

from autopilot.angles import shortest_turn
from autopilot.estimation.waves import FREQUENCY_LEAST
from autopilot.models.norrbin import Norrbin, at_speed_ratio, damping, steady_rudder
from autopilot.signals import AlarmEvent
from autopilot.supervision.alarms import AT_STOP
from autopilot.supervision.monitors.rudder import is_hard_over
from autopilot.supervision.monitors.watched import NEWS, AlarmLimits, Watched

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


SOFTER, SOFTEST = 4.0, 16.0
"""The law orders as for a boat that answers so many times as much, and so many times where that is not enough."""
SUSPECT_SWINGS, HALF_SWINGS = 4, 6
ALIKE, GROWS = 1.6, 3.0
LEAST_TIME = 0.25
"""So many sweeps of the rudder from side to side in a row, each with a swing of the heading, may be a limit cycle, or
are one: a turn and its counter-rudder are two, and the third is an overshoot. They last as long as each other, and the
swings are as far, within this factor, or farther while the cycle grows (GROWS); a sea's are not. Sweeps that last less
than this many time constants are not the boat's, nor those of one that is sixteen times as quick."""
BY_RUDDER = 0.98
"""So much of the rate's variance is the rudder's where steering makes the swings. Of boats that differ from their file
0.995 and more (5 to 40 times as lively); 0.89 to 0.96 in a sea of 6 deg of rudder, which shows them some sweeps later.
Of boats that are theirs, in gusts and seas that their rudder is too slow for, 0.978 at most."""
BEYOND = 3.0
"""A swing so many times as far as the rudder from stop to stop makes by the model counts for two, where it lasts longer
than a sea's: seas turn small boats as far beside their rudder."""
LONGEST_WAVE_S = math.pi / FREQUENCY_LEAST
"""Half the period of the longest wave that is estimated [s]."""
SWEEP, THROW = 0.5, 1.0
"""Each of them, from turning point to turning point, in units of the rudder's limit to one side: to be steered softly,
and to be let go of."""
SWING = math.radians(10.0)
"""And each of the heading's [rad], as far: less is a quick boat in a sea."""
PAUSE = (10.0, 15.0)
"""A sweep that comes later than this [s] and so many time constants after the one before begins the count anew."""
NEW_COURSE = math.radians(5.0)
"""An order that differs by this [rad] begins a turn: what came before is forgotten."""
CIRCLES, CIRCLES_DOUBTED, BEHIND = math.radians(390.0), math.radians(300.0), math.radians(150.0)
"""Turned this far [rad] away from the heading ordered, on balance; less where the speed has been doubted, but for a
heading that is ordered further behind than the third [rad]: it may be reached the other way round."""
ON_COURSE = math.radians(10.0)
SETTLED_TIME = 4.0
"""A boat within this [rad] of its course for this time [s], or for so many time constants if that is longer, has not
gone round: the turns that brought it there are over."""
SPEED_DOUBT = 1.25
"""A speed further than this from the trial's may be what is wrong where the boat does not answer as it should."""
OUTRUNS, OUTRUNS_UNSTABLE, RUSH, SPIN = 1.5, 1.25, 2.0, 3.0
RATE_MOST = 10.0
"""No boat turns as fast [rad/s]: such a step is the compass's, or the estimate's that begins anew."""
NO_MORE = 1.0e-9
"""A column of which less is left [share of its square] is a sum of the others."""
DAY_S = 86400.0
SEA_SIGMAS = math.sqrt(2.0 * math.log(DAY_S / (2.0 * LONGEST_WAVE_S)))
"""Of a rate of turn so many standard deviations of the sea's may be the sea's, the largest of a day's waves (Rayleigh):
of the sea that was there when the heading was ordered, for a boat that steering swings since then looks like one."""
SPIN_TIME = (1.0, 0.3)
"""The rate of turn is taken over this time [s], or over so many time constants if that is longer."""


class ByRudder:
    """How much of the rate of turn the rudder accounts for, whatever the boat: R^2 of r' = a delta + b r + c.

    By least squares of its integral r = a D + b psi + c t + d, D' = delta, which does not differentiate noise. At the
    one frequency of a limit cycle a delay is a part of a and b; what gusts and waves do beside the rudder is none.
    """

    def __init__(self) -> None:
        self._last: tuple[float, float] | None = None
        self._ordered = self._turned = self._time = 0.0
        self._sums = [0.0] * 15
        """Of the products of two columns, each pair once: the matrix is symmetric."""

    def add(self, watched: Watched) -> None:
        """Take a tick."""
        now, heading = watched.now, watched.state.heading
        if self._last is not None:
            step = now - self._last[0]
            self._time += step
            self._ordered += watched.rudder * step
            self._turned += shortest_turn(self._last[1], heading)
        self._last = now, heading
        row = 1.0, self._time, self._turned, self._ordered, watched.state.rate
        self._sums = [
            total + one * other
            for total, (one, other) in zip(self._sums, combinations_with_replacement(row, 2), strict=True)
        ]

    def share(self) -> float:
        """Return R^2, 0 where nothing has turned."""
        left = [[0.0] * 5 for _ in range(5)]
        for (row, column), total in zip(combinations_with_replacement(range(5), 2), self._sums, strict=True):
            left[row][column] = left[column][row] = total
        before = [left[index][index] for index in range(5)]
        total = 0.0
        for pivot in range(4):
            if left[pivot][pivot] > NO_MORE * before[pivot]:
                for row in range(pivot + 1, 5):
                    part = left[row][pivot] / left[pivot][pivot]
                    left[row] = [one - part * other for one, other in zip(left[row], left[pivot], strict=True)]
            total = total or left[4][4]
        return 1.0 - left[4][4] / total if total > 0.0 else 0.0


class Swings:
    """Counts sweeps of the order, of `sweep` [rudder's limits] at least, with swings of the heading; the memory is the
    last turning points of both."""

    def __init__(self, sweep: float) -> None:
        self._sweep = sweep
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._wanted = math.nan
        self._begin(-math.inf)

    def _begin(self, now: float) -> None:
        self._swept = now
        self._side = 0
        self._extreme = math.nan
        self._last = math.nan
        self._turned = 0.0
        self._span = self._before = (0.0, 0.0)
        self._swung = self._lasted = 0.0
        self._least_time = 0.0
        self._count = 0
        self._by_rudder = ByRudder()

    def look(self, model: Norrbin, watched: Watched) -> int:
        """Return how many sweeps there have been in a row that each swung the heading."""
        if not watched.follows:
            self.reset()
            return 0
        is_paused = watched.now - self._swept > PAUSE[0] + PAUSE[1] * model.time_constant
        # a rudder that stood while the loop stalled swings the boat, too: late ticks are an alarm of their own
        if watched.is_late or is_paused or not abs(shortest_turn(self._wanted, watched.wanted)) < NEW_COURSE:
            self._begin(watched.now)
        self._wanted = watched.wanted
        quickest = at_trial_speed(model, watched)
        self._least_time = LEAST_TIME * quickest.time_constant
        self._by_rudder.add(watched)
        self._follow(quickest, watched)
        return self._count

    def _follow(self, model: Norrbin, watched: Watched) -> None:
        """Carry the heading's span since the last turning point of the order on, and look for the next one."""
        order, heading = watched.rudder, watched.state.heading
        if math.isnan(self._last):
            self._extreme, self._last = order, heading
        self._turned += shortest_turn(self._last, heading)
        self._last = heading
        self._span = min(self._span[0], self._turned), max(self._span[1], self._turned)
        if self._side == 0:
            self._side = 1 if order > self._extreme else -1 if order < self._extreme else 0
        elif self._side * (order - self._extreme) >= 0.0:
            self._extreme = order
        elif abs(order - self._extreme) >= self._sweep * watched.angle_max:
            # swept from there to the other side: that was a turning point. The heading may trail by half a sweep
            swung = max(self._span[1], self._before[1]) - min(self._span[0], self._before[0])
            lasted = watched.now - self._swept
            counts = swung >= SWING and lasted >= self._least_time
            goes_on = self._swung < ALIKE * swung and swung < GROWS * self._swung
            is_alike = goes_on and _are_alike(lasted, self._lasted)
            is_beyond_rudder = swung > BEYOND * widest_swing(model, watched.angle_max, lasted)
            worth = 2 if is_beyond_rudder and lasted > LONGEST_WAVE_S else 1
            self._count = 0 if not counts else self._count + worth if is_alike else 1
            if self._count >= SUSPECT_SWINGS and self._by_rudder.share() < BY_RUDDER:
                self._count = 0
            if self._count <= 1:
                self._by_rudder = ByRudder()
            # a limit cycle does not die away: as far as the farthest
            self._swung = max(swung, self._swung) if self._count > 1 else swung
            self._lasted = lasted
            self._side, self._extreme, self._swept = -self._side, order, watched.now
            self._span, self._before = (self._turned, self._turned), self._span


def _are_alike(one: float, other: float) -> bool:
    return one < ALIKE * other and other < ALIKE * one


def speed_ratio(model: Norrbin, watched: Watched) -> float:
    """Return the speed that the model is for over the trial's."""
    return model.reference_speed / watched.trial_speed if watched.trial_speed > 0.0 else 1.0


def at_trial_speed(model: Norrbin, watched: Watched) -> Norrbin:
    """Return the model at the trial's speed where that is the quicker one: a speed that reads too low makes any boat
    slow."""
    return at_speed_ratio(model, max(1.0 / speed_ratio(model, watched), 1.0))


def widest_swing(model: Norrbin, angle_max: float, lasted: float) -> float:
    """Return how far [rad] the boat swings whose rudder stands at one stop and the other for `lasted` [s] each.

    By the first harmonic of that rudder, 4/pi angle_max at w = pi/lasted: 2 K 4/pi angle_max/(w |n1 + i w T|). n3 would
    make it less.
    """
    pace = math.pi / max(lasted, 1.0e-3)
    return 8.0 / math.pi * model.gain * angle_max / (pace * math.hypot(model.n1, pace * model.time_constant))


def reads_low(model: Norrbin, watched: Watched) -> bool:
    """Return whether the speed is so far below the trial's that it may be what is wrong."""
    return speed_ratio(model, watched) < 1.0 / SPEED_DOUBT


class Circles:
    """Adds up how far the boat has turned away from the heading that is ordered, whole turns with it."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._last: tuple[float, float] | None = None
        self._off, self._begun = 0.0, 0.0
        self._since = math.nan

    def goes_round(self, model: Norrbin, watched: Watched, *, is_doubted: bool = False) -> bool:
        """Return whether it has gone round and round; is_doubted: whether its speed is."""
        heading, wanted = watched.state.heading, watched.wanted
        if not watched.follows:
            self.reset()
            return False
        if self._last is None or abs(shortest_turn(self._last[1], wanted)) > NEW_COURSE:
            self._off = shortest_turn(wanted, heading)
            self._begun = abs(self._off)
        elif abs(watched.push) <= watched.angle_max or reads_low(model, watched):
            # what is pushed round by more than its rudder is not steered round
            self._off += shortest_turn(self._last[0], heading) - shortest_turn(self._last[1], wanted)
        self._last = heading, wanted
        self._settle(model, watched)
        return abs(self._off) > (CIRCLES_DOUBTED if is_doubted and self._begun < BEHIND else CIRCLES)

    def _settle(self, model: Norrbin, watched: Watched) -> None:
        near = shortest_turn(watched.wanted, watched.state.heading)
        if abs(near) > ON_COURSE:
            self._since = math.nan
        elif math.isnan(self._since):
            self._since = watched.now
        elif watched.now - self._since >= max(SETTLED_TIME, SETTLED_TIME * model.time_constant):
            self._off = near


class Spinning:
    """A rate of turn, by the heading alone, that is quicker than a rudder hard over makes it by the model."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._last: tuple[float, float] | None = None
        self._wanted = math.nan
        self._by_sea = 0.0
        self.rate = 0.0
        self.rushes = self.outruns_speed = False

    def too_fast(self, model: Norrbin, watched: Watched) -> float:
        """Return the rate of turn [rad/s] where it is SPIN times too fast for the boat of the `model`, else 0; `rushes`
        is whether it is RUSH times too fast, and `outruns_speed` whether it is OUTRUNS times what goes with the speed.

        A speed that reads too low would make any turn too fast: the model counts at the trial's speed at least.
        """
        last, self._last = self._last, (watched.now, watched.state.heading)
        self.rushes = self.outruns_speed = False
        if not watched.steers or last is None or not watched.now > last[0]:
            self.rate = self.rate if watched.steers else 0.0
            return 0.0
        if not abs(shortest_turn(self._wanted, watched.wanted)) < NEW_COURSE:
            # what is there before the first order is not known to be the sea's
            known = watched.state.wave_deviation * watched.state.wave_frequency
            self._by_sea = 0.0 if math.isnan(self._wanted) else SEA_SIGMAS * known
            self._wanted = watched.wanted
        step = watched.now - last[0]
        turned = shortest_turn(last[1], watched.state.heading) / step
        if abs(turned) > RATE_MOST:
            turned = 0.0
        quickest = at_trial_speed(model, watched)
        lasts = max(SPIN_TIME[0], SPIN_TIME[1] * quickest.time_constant)
        self.rate -= math.expm1(-step / lasts) * (turned - self.rate)
        is_steered = self.rate * watched.rudder > 0.0
        # a wrong speed does what a sea does, and is doubted rather than borne
        by_sea = 0.0 if reads_low(model, watched) else self._by_sea
        by_rudder = math.copysign(max(abs(self.rate) - by_sea, 0.0), self.rate)
        # a course-unstable boat outruns its rudder, against it too, where it is steered by a wrong speed
        if is_steered or model.n1 <= 0.0:
            most = OUTRUNS if model.n1 > 0.0 else OUTRUNS_UNSTABLE
            self.outruns_speed = is_beyond(model, by_rudder / most, watched.angle_max)
        if not is_steered:
            return 0.0
        self.rushes = is_beyond(quickest, by_rudder / RUSH, watched.angle_max)
        return self.rate if is_beyond(quickest, by_rudder / SPIN, watched.angle_max) else 0.0


def is_beyond(model: Norrbin, rate: float, angle_max: float) -> bool:
    """Return whether no steady turn is as quick as `rate` [rad/s]: its damping is more than all the rudder."""
    return math.copysign(1.0, rate) * damping(model, rate) > model.gain * angle_max
