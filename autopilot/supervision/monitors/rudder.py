"""A rudder that does not move, does not follow, moves the wrong way, stands at its stop, or is not enough.

Whether the flight controller shows the order that it was given: where it does not, somebody else steers, too.
"""

from __future__ import annotations

import math
from collections import deque

from autopilot.signals import RudderSample
from autopilot.supervision.monitors.watched import AlarmLimits, Watched

PATIENCE_S = 1.2
PROGRESS_SHARE = 0.3
ASSUMED_RATE = math.radians(5.0)
"""A steering gear of unknown rate is asked for a share of this [rad/s]."""
LONGEST_GAP_S = 1.0
SLOW_SHARE = 1.0 / 3.0
SLOW_TIME_S = 2.0
"""A rudder that is off its order goes there at its filed rate: less than this share of it for so long is a slow one."""
STANDS = math.radians(0.5)
"""A rudder that has moved by less while it should have does not move at all."""
AT_THE_STOP = 0.9
AT_THE_STOP_TIME = 15.0
PUSH_LASTS = 2.0
STOP_LASTS = 0.5
"""A push heavier than the rudder is an alarm when it lasts so long [s], and the rudder has been told for so long [s] to
stand at its stop against it: until then it is on its way there."""


class RudderFollows:
    """Compares the angle that a sensor shows with what the rudder was told.

    Time in which the rudder is off its order by more than the tolerance and not on its way to it fills a bucket, other
    time empties it: a stuck rudder is right for an instant whenever a swinging order crosses it. A rudder that has gone
    away from its order further than the gear's delay explains is reversed.

    An order may leave at any time until the next tick begins: an angle that was measured between two ticks is judged by
    that one of the two orders, the one before and the one of that tick, which explains it better.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._orders: deque[tuple[float, float]] = deque()
        self._ticked: float | None = None
        self._heard: list[RudderSample] = []
        self._seen: RudderSample | None = None
        self._bucket = 0.0
        self._away = 0.0
        self._low, self._high = math.inf, -math.inf
        self._way, self._way_time = 0.0, 0.0
        self.is_slow = False
        """Whether it goes to its orders, and much slower than filed."""
        self.found: tuple[str, str] = ("", "")

    def hear(self, sample: RudderSample) -> None:
        """Take a measured angle."""
        if math.isfinite(sample.angle) and math.isfinite(sample.time):
            self._heard.append(sample)

    def look(self, watched: Watched, limits: AlarmLimits) -> None:
        """Judge what was heard; what was found is forgotten when the rudder is ours no more."""
        heard, self._heard = self._heard, []
        if not watched.steers:
            self.reset()
            return
        # the rudder was told this in the tick before
        if self._ticked is not None:
            self._orders.append((self._ticked, watched.rudder))
        self._ticked = watched.now
        while len(self._orders) > 2 and self._orders[2][0] < watched.now - LONGEST_GAP_S:
            self._orders.popleft()
        # of a burst that was read at once, and has one time, the last is the newest
        for sample in sorted({(each.time, each.source): each for each in heard}.values(), key=lambda each: each.time):
            self._compare(sample, limits)

    def _compare(self, sample: RudderSample, limits: AlarmLimits) -> None:
        before = self._seen
        if before is not None and before.source == sample.source and sample.time <= before.time:
            return
        self._seen = sample
        orders = self._orders_at(sample.time)
        if not orders or before is None or before.source != sample.source:
            return
        elapsed = sample.time - before.time
        if elapsed > LONGEST_GAP_S:
            return
        order = min(orders, key=lambda each: abs(each - sample.angle))
        moved = max(math.copysign(1.0, each - before.angle) * (sample.angle - before.angle) for each in orders)
        rate = min(limits.rudder_rate, ASSUMED_RATE)
        is_off = abs(order - sample.angle) > limits.rudder_tolerance
        if is_off and moved < PROGRESS_SHARE * rate * elapsed:
            self._bucket += elapsed
            self._low, self._high = min(self._low, sample.angle), max(self._high, sample.angle)
        else:
            self._bucket = max(self._bucket - elapsed, 0.0)
        if self._bucket == 0.0:
            self._low, self._high = math.inf, -math.inf
        self._away = max(self._away - moved, 0.0) if is_off else 0.0
        self._judge(sample, order, limits)
        self._time(moved if is_off else math.nan, elapsed, limits)

    def _time(self, moved: float, elapsed: float, limits: AlarmLimits) -> None:
        """Add up how far the rudder has come in how long while it was off its order; nan: it is not."""
        if math.isnan(moved) or not math.isfinite(limits.rudder_rate):
            self._way, self._way_time = 0.0, 0.0
            return
        self._way, self._way_time = self._way + moved, self._way_time + elapsed
        timed = self._way_time - limits.rudder_delay
        if timed >= SLOW_TIME_S and STANDS < self._way < SLOW_SHARE * limits.rudder_rate * timed:
            self.is_slow = True

    def _orders_at(self, time: float) -> list[float]:
        """Return the orders [rad] of which one was in force at `time` [s]: the last two that were given by then."""
        return [angle for given, angle in self._orders if given <= time][-2:]

    def _judge(self, sample: RudderSample, order: float, limits: AlarmLimits) -> None:
        if self.found[0]:
            return
        shown = f"{math.degrees(sample.angle):.1f} deg where {math.degrees(order):.1f} deg is ordered"
        lag = limits.rudder_delay * min(limits.rudder_rate, 4.0 * ASSUMED_RATE)
        if self._away > limits.rudder_tolerance + lag:
            self.found = ("rudder_reversed", shown)
        elif self._bucket > PATIENCE_S + limits.rudder_delay:
            stands = self._high - self._low < STANDS
            self.found = ("rudder_stuck" if stands else "rudder_not_following", shown)


class AtTheStop:
    """A course held with the rudder at its stop for long: there is none left."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._since: float | None = None

    def is_there(self, watched: Watched) -> bool:
        """Return whether the rudder has stood there for long."""
        if not (watched.steers and watched.holds_course and is_hard_over(watched)):
            self._since = None
            return False
        if self._since is None:
            self._since = watched.now
        return watched.now - self._since >= AT_THE_STOP_TIME


class Overpowered:
    """Wind, current and trim that are worth more than the rudder's limit, as the estimator learns them beside waves.

    A law that holds a course against them has put the rudder to its stop: as long as it has some left, what the
    estimator believes is a sea that it does not know.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._since: float | None = None
        self._hard_since = math.nan
        self.found = ""

    def look(self, watched: Watched) -> None:
        """Judge a tick; `found` is how hard the boat is pushed as it is at first, '' where the rudder can hold it."""
        is_against = is_hard_over(watched) and watched.rudder * watched.push < 0.0
        if not is_against:
            self._hard_since = math.nan
        elif math.isnan(self._hard_since):
            self._hard_since = watched.now
        # a trial's rudder rests where the trial wants it
        has_none_left = not watched.follows or watched.now - self._hard_since >= STOP_LASTS
        if not (watched.steers and watched.has_way and abs(watched.push) > watched.angle_max):
            self.reset()
        elif self._since is None:
            self._since = watched.now
        elif watched.now - self._since >= PUSH_LASTS and not self.found and has_none_left:
            side = "starboard" if watched.push > 0.0 else "port"
            self.found = f"to {side}, as by {math.degrees(abs(watched.push)):.0f} deg of rudder"


def is_hard_over(watched: Watched) -> bool:
    """Return whether the rudder is told to be at its stop, nearly."""
    return abs(watched.rudder) >= AT_THE_STOP * watched.angle_max


REMEMBERED_S = 1.5
"""A report is of one of the orders of this time [s]: it comes at 5 to 10 Hz and is as old as the link."""
TOLERANCE = math.radians(3.0)
"""Dead zone and whole microseconds move an order by less [rad]."""
BELIEVED_S = 1.0
"""A report that is older [s] proves nothing."""


class ShownOrder:
    """Compares what the steering gear was told, as reported, with what we told it of late."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._told: deque[tuple[float, float]] = deque()
        self._shown: RudderSample | None = None

    def hear(self, sample: RudderSample) -> None:
        """Take a report of an order."""
        self._shown = sample

    def is_anothers(self, now: float, told: float) -> bool:
        """Return whether the report in force at `now` [s] is of no order of ours; `told` [rad]: the latest of these."""
        orders = self._told
        orders.append((now, told))
        while orders[0][0] < now - REMEMBERED_S:
            orders.popleft()
        if self._shown is None or now - self._shown.time > BELIEVED_S:
            return False
        angles = [angle for _, angle in orders]
        return not min(angles) - TOLERANCE <= self._shown.angle <= max(angles) + TOLERANCE
