"""A rudder by its sensor, or by the order that the steering gear reports: stuck, off its orders, slow, or going the
wrong way.

A line that stalls holds orders, or angles, and delivers them late: what it may hold excuses a rudder. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.estimation.rudder_observer import Ring
from autopilot.signals import RudderSample
from autopilot.supervision.monitor_input import AlarmLimits
from autopilot.supervision.tuning import (
    ASSUMED_RATE,
    CATCHES_UP,
    HELD_PERIODS,
    HELD_S,
    LONGEST_GAP_S,
    PATIENCE_S,
    PROGRESS_SHARE,
    REMEMBERED_S,
    REPORT_FRESH_S,
    SLOW_SHARE,
    SLOW_TIME_S,
    STANDS,
    STILL,
    TOLERANCE,
    UNSEEN_S,
    USUAL_SHARE,
)

History = tuple[Ring, Ring, Ring, int]
"""The rudder of late, in rings as `rudder_observer.RudderPast` has them: times [s], where it was then, and what we had
commanded until then [rad], nan where somebody else steered; how many ticks there were."""


class Line(NamedTuple):
    """What a line may have held, as the rudder shows it at time [s]. usual [s]: how far apart its angles usually are;
    stood [rad] and stood_since [s]: where it stands, and since when; off_at [s]: when it was off its order last; held
    and unseen [s]: how late our orders, and its angles, may be; held_since [s]: since when, nan: it has followed
    since."""

    time: float = math.nan
    usual: float = math.inf
    stood: float = math.nan
    stood_since: float = math.nan
    off_at: float = -math.inf
    held: float = 0.0
    unseen: float = 0.0
    held_since: float = math.nan


def line_step(before: Line, now: float, angle: float, elapsed: float, history: History, limits: AlarmLimits) -> Line:
    """Judge whether a line has held orders or angles, by an angle [rad] that comes at `now` [s], so long after the one
    before, or is the first.

    Where the rudder stood while its orders moved they may be late by as long. Where it was not seen for much longer
    than usual both may be: both ways may stall. A line catches up; and a rudder that has not followed since is excused
    by nothing that comes later: one that is reversed stands at each turn of its order. Where we let go meanwhile what
    is still held may be as old as anything.
    """
    time, usual, stood, stood_since, off_at, held, unseen, held_since = before
    if not abs(angle - stood) <= STILL:
        stood, stood_since = angle, now
    caught_up = CATCHES_UP * (now - time if now > time else 0.0)
    held, unseen = max(held - caught_up, 0.0), max(unseen - caught_up, 0.0)
    if now - off_at > held + unseen:
        held = unseen = 0.0
    if now - off_at > HELD_S:
        held_since = math.nan
    if elapsed == math.inf:
        return Line(now, usual, stood, stood_since, now, HELD_S if held > 0.0 else 0.0, unseen, held_since)
    unusual, stands = max(HELD_PERIODS * usual, UNSEEN_S), min(now - stood_since, HELD_S)
    is_gap = elapsed > unusual
    usual = elapsed if usual == math.inf else usual + USUAL_SHARE * (min(elapsed, HELD_PERIODS * usual) - usual)
    least, most = orders_within(history, now - max(stands, elapsed) - limits.rudder_delay, now - limits.rudder_delay)
    if max(stands, elapsed) > unusual and most - least > limits.rudder_tolerance:
        off_at, held_since = now, now if math.isnan(held_since) else held_since
        if now - held_since <= HELD_S:
            held = max(held, min(elapsed, HELD_S) if is_gap else stands)
            unseen = max(unseen, min(elapsed, HELD_S) if is_gap else 0.0)
    return Line(now, usual, stood, stood_since, off_at, held, unseen, held_since)


class Following(NamedTuple):
    """seen: the newest angle; bucket [s]: time off its order and not on the way, within low and high [rad]; away [rad]:
    how far it has gone from its order; way [rad] and way_time [s]: how far it has come in how long while it was off;
    is_slow: it goes to its orders, and much slower than filed; name and shown: what is found, '' for nothing;
    late_until [s]: until then it is not our order that says where it goes; line: what its line may have held; began:
    when [s] it began to go away, and angle and order [rad] then."""

    seen: RudderSample | None = None
    bucket: float = 0.0
    away: float = 0.0
    low: float = math.inf
    high: float = -math.inf
    way: float = 0.0
    way_time: float = 0.0
    is_slow: bool = False
    name: str = ""
    shown: str = ""
    late_until: float = -math.inf
    line: Line = Line()
    began: tuple[float, float, float] = (math.nan, math.nan, math.nan)


def following_step(
    before: Following, sample: RudderSample, history: History, since: float, limits: AlarmLimits
) -> Following:
    """Compare a measured angle with the orders that we have given `since` [s], of which one was in force.

    Time in which the rudder is off its order by more than the tolerance and not on its way to it fills a bucket, other
    time empties it: a stuck rudder is right for an instant whenever a swinging order crosses it. A rudder that goes
    away from all orders that its gear's delay may have left it with, by more than the tolerance, is reversed; but where
    its orders went the same way it goes with them, and is off by its sensor, or its linkage. An order
    may leave at any time until the next tick begins: an angle that was measured between two ticks is judged by that one
    of the two orders, the one before and the one of that tick, which explains it better. After a tick that came late it
    may go on past its order: a motor whose speed is ordered runs until the next one.

    A line that stalls holds our orders, or the angles, and delivers them late: as long as it may do so (`line_step`)
    those orders are among them.
    """
    last, bucket, away, low, high, way, way_time, is_slow, name, shown, late_until, line, began = before
    angle, now, delay, filed = sample.angle, sample.time, limits.rudder_delay, limits.rudder_rate
    if last is not None and last.source == sample.source and now <= last.time:
        return before
    elapsed = math.inf if last is None or last.source != sample.source else now - last.time
    orders = orders_at(history, since, now)
    line = line_step(line, now, angle, elapsed, history, limits)
    if not orders or elapsed > LONGEST_GAP_S or last is None:
        return before._replace(seen=sample, line=line._replace(off_at=now))
    turned = angle - last.angle
    order = orders[0] if abs(orders[0] - angle) <= abs(orders[-1] - angle) else orders[-1]
    moved = max(
        math.copysign(1.0, orders[0] - last.angle) * turned, math.copysign(1.0, orders[-1] - last.angle) * turned
    )
    is_off, progress = abs(order - angle) > limits.rudder_tolerance, PROGRESS_SHARE * min(filed, ASSUMED_RATE) * elapsed
    if is_off and moved < progress:
        bucket, low, high = bucket + elapsed, min(low, angle), max(high, angle)
    else:
        bucket = max(bucket - elapsed, 0.0)
    if bucket == 0.0:
        low, high = math.inf, -math.inf
    if is_off:
        line = line._replace(off_at=now)
    if is_off and moved < 0.0:
        least, most = orders_within(history, last.time - line.held - line.unseen - delay, now)
        beyond = angle - max(most, last.angle) if turned > 0.0 else min(least, last.angle) - angle
        away += max(beyond, 0.0) if now > late_until else 0.0
    else:
        away = max(away - moved, 0.0) if is_off else 0.0
    if away == 0.0:
        began = now, angle, order
    if not name:
        if away > limits.rudder_tolerance:
            name = "rudder_not_following" if _is_led(began, (now, angle, order), history) else "rudder_reversed"
        elif bucket > PATIENCE_S + delay:
            name = "rudder_stuck" if high - low < STANDS else "rudder_not_following"
        if name:
            shown = f"{math.degrees(angle):.1f} deg where {math.degrees(order):.1f} deg is ordered"
    way, way_time = (way + moved, way_time + elapsed) if is_off and math.isfinite(filed) else (0.0, 0.0)
    timed = way_time - delay
    is_slow = is_slow or (timed >= SLOW_TIME_S and STANDS < way < SLOW_SHARE * filed * timed)
    return Following(sample, bucket, away, low, high, way, way_time, is_slow, name, shown, late_until, line, began)


def _is_led(began: tuple[float, float, float], at: tuple[float, float, float], history: History) -> bool:
    """Return whether a rudder has gone away from its order because that did, by no detour: what it made for itself is
    no progress. began and at: time [s], angle and order [rad]."""
    went, led = at[1] - began[1], at[2] - began[2]
    least, most = orders_within(history, began[0], at[0])
    return abs(went - led) < PROGRESS_SHARE * abs(went) and (1.0 - PROGRESS_SHARE) * (most - least) < abs(led)


def orders_at(history: History, since: float, time: float) -> tuple[float, ...]:
    """Return the orders [rad] of which one was in force at `time` [s]: the last two that were given by then, since we
    steer. The command that a tick holds left in the tick before it."""
    times, _, commands, ticks = history
    ring, tick = len(times) - 1, ticks - 1
    oldest = max(tick - ring, 0)
    while tick > oldest and times[(tick - 1) & ring] > time:
        tick -= 1
    return tuple(commands[at & ring] for at in (tick - 1, tick) if at > oldest and times[(at - 1) & ring] >= since)


def orders_within(history: History, begin: float, end: float) -> tuple[float, float]:
    """Return the least and the most [rad] of the orders that were in force from `begin` to `end` [s]; the second below
    the first where there were none of ours."""
    times, _, commands, ticks = history
    ring, least, most = len(times) - 1, math.inf, -math.inf
    for tick in range(ticks - 1, max(ticks - 2 - ring, 0), -1):
        given = times[(tick - 1) & ring]
        if given <= end:
            # what is not a number is smaller and larger than nothing
            order = commands[tick & ring]
            least, most = order if order < least else least, order if order > most else most
        if given < begin:
            break
    return least, most


def is_anothers(history: History, now: float, report: RudderSample | None) -> bool:
    """Return whether the report in force at `now` [s] of the command to the steering gear is of no order of ours: then
    somebody else steers, too."""
    if report is None or now - report.time > REPORT_FRESH_S:
        return False
    times, _, commands, ticks = history
    ring, angle = len(times) - 1, report.angle
    low = high = commands[(ticks - 1) & ring]
    if low - TOLERANCE <= angle <= high + TOLERANCE:
        return False
    for tick in range(ticks - 2, max(ticks - 2 - ring, -1), -1):
        if times[tick & ring] < now - REMEMBERED_S:
            break
        # what is not a number is smaller and larger than nothing
        order = commands[tick & ring]
        low, high = order if order < low else low, order if order > high else high
    return not low - TOLERANCE <= angle <= high + TOLERANCE


def followed(
    before: Following, limits: AlarmLimits, angles: tuple[RudderSample, ...], history: History, since: float
) -> Following:
    """Compare a tick's measured angles with the orders that we have given `since` [s], one after the other."""
    known = [each for each in angles if math.isfinite(each.angle) and math.isfinite(each.time)]
    # of a burst that was read at once, and has one time, the last is the newest
    for sample in sorted({(each.time, each.source): each for each in known}.values(), key=lambda each: each.time):
        before = following_step(before, sample, history, since, limits)
    return before
