"""The rudder watch: a rudder that does not move, does not follow, moves the wrong way, or is not enough.

By its sensor, or by the order that the steering gear reports: stuck, off its orders, slow, or going the wrong way. By
a boat that does not go where its rudder is laid: pushed harder than that can hold, or run away. And by the answer of
the boat (`rudder_answer`). What is found of boat, rudder and speed counts until we let go.

A line that stalls holds orders, or angles, and delivers them late: what it may hold excuses a rudder. What the boat
does goes by the push that the estimator learns beside the waves, and by the turns themselves. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.models.norrbin import Norrbin, steady_rudder
from autopilot.models.steering_gear import clip
from autopilot.signals import AlarmEvent, RudderSample
from autopilot.supervision.monitor_input import (
    AlarmLimits,
    History,
    Measured,
    MonitorInput,
    is_hard_over,
    reads_low,
    speed_ratio,
)
from autopilot.supervision.rudder_answer import (
    FILED,
    LIVELIER,
    QUICKER,
    SLOW_RUDDER,
    UNJUDGED,
    Response,
    judge_response,
    listened,
    verdict,
)
from autopilot.supervision.tuning import (
    AGAINST_SHARE,
    ASSUMED_RATE,
    AT_THE_STOP,
    AT_THE_STOP_TIME,
    CATCHES_UP,
    FAR,
    HELD_PERIODS,
    HELD_S,
    HOLDS,
    LATE_LASTS,
    LONGEST_GAP_S,
    PATIENCE_S,
    PROGRESS_SHARE,
    PUSH_BEYOND,
    REMEMBERED_S,
    REPORT_FRESH_S,
    SETTLED,
    SLOW_SHARE,
    SLOW_TIME_S,
    SPEED_DOUBT,
    STANDS,
    STILL,
    SURE_TURNING,
    TAKES_HOLD,
    TOLERANCE,
    TRIAL_SAID,
    UNSEEN_S,
    USUAL_SHARE,
    WAVES_REACH,
)


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
    how far it has gone from its order; way [rad] and way_time [s]: how far it has come in how long while it was off to
    the same side, negative to port; slow [rad/s]: the newest rate to port and to starboard that was much slower than
    filed, progress at least, inf: none was;
    name and shown: what is found, '' for nothing;
    late_until [s]: until then it is not our order that says where it goes; line: what its line may have held; began:
    when [s] it began to go away, and angle and order [rad] then."""

    seen: RudderSample | None = None
    bucket: float = 0.0
    away: float = 0.0
    low: float = math.inf
    high: float = -math.inf
    way: float = 0.0
    way_time: float = 0.0
    slow: tuple[float, float] = (math.inf, math.inf)
    name: str = ""
    shown: str = ""
    late_until: float = -math.inf
    line: Line = Line()
    began: tuple[float, float, float] = (math.nan, math.nan, math.nan)

    @property
    def is_slow(self) -> bool:
        """Whether it goes to its orders, and to a side much slower than filed."""
        return min(self.slow) < math.inf


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
    last, bucket, away, low, high, way, way_time, slow, name, shown, late_until, line, began = before
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
    is_off, progress = abs(order - angle) > limits.rudder_tolerance, progress_at(filed) * elapsed
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
    side = math.copysign(1.0, order - angle) if is_off and math.isfinite(filed) else 0.0
    way, way_time, slow = slow_step((way, way_time, slow), limits, side, (moved, elapsed))
    return Following(sample, bucket, away, low, high, way, way_time, slow, name, shown, late_until, line, began)


def progress_at(filed: float) -> float:
    """Return the rate [rad/s] that is progress where so much is `filed`."""
    return PROGRESS_SHARE * min(filed, ASSUMED_RATE)


def slow_step(
    before: tuple[float, float, tuple[float, float]], limits: AlarmLimits, side: float, moved: tuple[float, float]
) -> tuple[float, float, tuple[float, float]]:
    """Return `Following`'s way, way_time and slow after a rudder that is off its order to a `side`, 0.0: it is not, has
    `moved` there [rad] in a time [s]."""
    way, way_time, slow = before
    way, way_time = (way, way_time) if side * way_time > 0.0 else (0.0, 0.0)
    way, way_time = way + abs(side) * moved[0], way_time + side * moved[1]
    timed, filed = abs(way_time) - limits.rudder_delay, limits.rudder_rate * limits.rudder_sides[side > 0.0]
    if timed >= SLOW_TIME_S and STANDS < way < SLOW_SHARE * filed * timed:
        # what comes and goes with its order behind a sensor that is off has no rate to plan with
        rate = max(way / timed, progress_at(limits.rudder_rate))
        slow = (slow[0], rate) if side > 0.0 else (rate, slow[1])
    return way, way_time, slow


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


ZIGZAG_DIVERGED = math.radians(45.0)
"""A boat that handles well overshoots by less: IMO MSC.137(76) allows 40 deg for the second of 10/10, 25 deg for 20/20.
One that does not slows down all the same."""


class Overpowered(NamedTuple):
    """Wind, current and trim that are worth more than the rudder's limit, as the estimator learns them beside waves:
    the `time` [s] of the tick before, nan: they are not; beyond [s]: how far they were beyond it, in units of the
    limit, summed over the time in which the rudder was hard over against them; and how hard, '' where the rudder can
    hold it."""

    time: float = math.nan
    beyond: float = 0.0
    found: str = ""


def overpowered_step(before: Overpowered, seen: MonitorInput) -> Overpowered:
    """Judge a tick. A law that holds a course has put the rudder to its stop: as long as it has some left, what the
    estimator believes is a sea that it does not know.

    A push that sets in is overrated at first, by half for a few seconds, until the rudder has shown what it does
    against it. So the nearer it is to what the rudder holds, the longer it must last:
    beyond = int (|push|/limit - 1) dt.
    """
    push, most = seen.push, seen.angle_max
    if not (seen.steers and seen.has_way and (push > most or push < -most)):
        return NOT_OVERPOWERED
    time, beyond, found = before
    if seen.follows and not (is_hard_over(seen) and seen.rudder * push < 0.0):
        # a trial's rudder rests where the trial wants it
        return Overpowered(found=found)
    if time == time:  # what is not a number is not itself
        # what happened between two ticks far apart nobody saw
        beyond += (abs(push) / most - 1.0) * clip(seen.now - time, 0.0, LONGEST_GAP_S)
    if beyond >= PUSH_BEYOND and not found:
        side = "starboard" if push > 0.0 else "port"
        found = f"to {side}, as by {math.degrees(abs(push)):.0f} deg of rudder"
    return Overpowered(seen.now, beyond, found)


NOT_OVERPOWERED = Overpowered()


class Runaway(NamedTuple):
    """heading [rad] and time [s] of the tick before; mean_rate [rad/s]; the rudder's side, and how far [rad] the boat
    has turned against it since it came over; way [rad]: turned in all; hard_since [s]: the rudder is hard over;
    held_way and held_since: when it had taken hold; has_run; overpowered: to where, '' where neither."""

    heading: float = math.nan
    time: float = math.nan
    mean_rate: float = 0.0
    side: float = math.nan
    turned: float = math.nan
    way: float = 0.0
    hard_since: float = math.nan
    held_way: float = 0.0
    held_since: float = 0.0
    has_run: bool = False
    overpowered: str = ""


NO_RUNAWAY = Runaway()


def runaway_step(before: Runaway, seen: MonitorInput) -> Runaway:
    """Judge a tick: the rudder hard over, and the boat goes on to turn to the other side.

    It has run away where it turns nearly as for a rudder hard over there: one that is at its other stop, or a push of
    nearly twice what the rudder can do. Sea and gust turn it so for less than the time in which the rudder takes hold,
    or not so far; a wave turns it back again, so that the mean rate must be as quick as the present one. A zigzag
    orders its rudder without looking back: there it is enough that it goes on turning against it, far on the wrong
    side, and does not slow down.
    """
    if not seen.steers:
        return NO_RUNAWAY
    state, now, model, rudder = seen.state, seen.now, seen.model, seen.rudder
    last, time, mean_rate, side, turned, way, hard_since, held_way, held_since, _, overpowered = before
    heading = state.heading
    # by the heading: a rate may come from a gyro that is wrong, and is late where there is none
    step = heading - last
    step = step if -PI < step <= PI else wrap(step)
    step = step if step == step else 0.0
    elapsed = now - time
    if elapsed > 0.0:
        # a low pass leaves at most 2 deviations of heading / time constant of what waves add to the rate; that is to
        # be no more than what lies between K rudder_max and AGAINST_SHARE of it
        waves = WAVES_REACH * state.wave_deviation
        lasts = waves / ((1.0 - AGAINST_SHARE) * abs(model.gain) * seen.angle_max)
        lasts = lasts if lasts > model.time_constant else model.time_constant
        mean_rate -= math.expm1(-elapsed / lasts) * (step / elapsed - mean_rate)
    way += step
    to = math.copysign(1.0, rudder)
    # one that slows down is coming round yet: a course-unstable boat overshoots by as much
    has_run = seen.zigzag_divergence > ZIGZAG_DIVERGED and to * state.rate < min(AGAINST_SHARE * to * mean_rate, 0.0)
    turned = turned - to * step if to == side and turned > to * step else 0.0
    overpowered = overpowered if turned != 0.0 else ""
    stop = AT_THE_STOP * seen.angle_max
    if -stop < rudder < stop:
        return Runaway(heading, now, mean_rate, to, turned, way, math.nan, held_way, held_since, has_run, overpowered)
    hard_since = now if math.isnan(hard_since) else hard_since
    lasted = now - hard_since
    if lasted < HOLDS * model.time_constant:
        held_since, held_way = now, way
    if lasted >= TAKES_HOLD * model.time_constant and not turned < FAR + WAVES_REACH * state.wave_deviation:
        if lasted >= SETTLED * model.time_constant:
            # both: the mean remembers how the boat turned before the rudder came over, the other holds a wave's
            held = (way - held_way) / (now - held_since)
            has_run |= _turns_against(model, seen.rudder, held) and _turns_against(model, seen.rudder, mean_rate)
        overpowered = overpowered or f"to {'port' if seen.rudder > 0.0 else 'starboard'}"
    return Runaway(heading, now, mean_rate, to, turned, way, hard_since, held_way, held_since, has_run, overpowered)


def _turns_against(model: Norrbin, rudder: float, rate: float) -> bool:
    return -math.copysign(1.0, rudder) * steady_rudder(model, rate) >= AGAINST_SHARE * abs(rudder)


class State(NamedTuple):
    """What the rudder watch remembers. since [s]: since when we steer; stop_since
    [s]: the rudder stands at its stop; trial_doubted [s]: when that was.

    What was found counts until we let go: other: what the answer tells of boat and rudder, see `other_verdict`;
    asks_less: the law is to order less for it; rests_roll: the rudder is too slow to work against roll too, and the
    quick orders are those: a course alone may well be held with it as it is;
    doubts_speed: the boat's own turns contradict its speed.
    """

    since: float = math.nan
    following: Following = Following()
    response: Response = UNJUDGED
    overpowered: Overpowered = NOT_OVERPOWERED
    runaway: Runaway = NO_RUNAWAY
    stop_since: float = math.nan
    trial_doubted: float = math.nan
    other: int = FILED
    asks_less: bool = False
    rests_roll: bool = False
    doubts_speed: bool = False

    def with_doubted_speed(self) -> State:
        """Return the state where the speed is doubted: the model is the trial's from the next tick on, and what was
        seen is weighed anew by that."""
        return self._replace(doubts_speed=True, response=UNJUDGED)


def update(
    limits: AlarmLimits, before: State, seen: MonitorInput, measured: Measured, history: History
) -> tuple[State, tuple[AlarmEvent, ...]]:
    """Judge a tick, with the rudder's `history` until now; return what is remembered, and what is found."""
    if not seen.steers:
        # what is done by others proves nothing; what a line holds it still does
        following = Following(line=before.following.line)
        response = listened(before.response, limits, seen, measured, history)
        return State(following=following, response=response, trial_doubted=before.trial_doubted), ()
    since, following, response, overpowered, runaway, stop_since, doubted, other, _, rests, doubts = before
    now = seen.now
    since = since if since == since else now
    if seen.is_late:
        following = following._replace(late_until=now + LATE_LASTS)
    if measured.angles:
        following = followed(following, limits, measured.angles, history, since)
    if following.name or seen.waits or not limits.rudder_response or is_anothers(history, now, measured.report):
        # a rudder that waits for way proves nothing, nor does a boat that follows somebody else; the link finds out who
        # has the helm
        response, overpowered = response.but_the_sea(seen), NOT_OVERPOWERED
    else:
        response = judge_response(response, limits, seen, measured.headings, history)
        if since <= doubted and now - doubted < TRIAL_SAID and not response.verdict:
            # the trial's end moves the rudder as an order does, and against a push that is no sea
            response = response._replace(verdict=verdict(response.evidence.response, SURE_TURNING))
        if (response.other or response.verdict) and _is_for_the_speed(response, seen):
            response, doubts = response.but_the_sea(seen), True
        is_held = -seen.angle_max <= seen.push <= seen.angle_max
        overpowered = NOT_OVERPOWERED if is_held else overpowered_step(overpowered, seen)
        doubted = now if response.doubts_trial else doubted
    runaway = runaway_step(runaway, seen)
    stop = AT_THE_STOP * seen.angle_max
    if not seen.holds_course or -stop < seen.rudder < stop:
        stop_since = math.nan
    elif math.isnan(stop_since):
        stop_since = now
    asks_less = False
    if other or response.other or following.is_slow:
        news = (other, response.other, SLOW_RUDDER if following.is_slow else FILED)
        other = min(each for each in news if each != FILED)
        rests = rests or (other == SLOW_RUDDER and seen.damps_roll and seen.model.n1 > 0.0)
        # where the rate is known turns are planned with it, and no law need be softer
        slow = other == SLOW_RUDDER and not (seen.rudder_is_slow or following.is_slow)
        asks_less = other == LIVELIER or (slow and not rests and seen.model.n1 > 0.0)
    after = State(
        since, following, response, overpowered, runaway, stop_since, doubted, other, asks_less, rests, doubts
    )
    return after, _findings(after, seen)


VERDICTS = {
    1: AlarmEvent("rudder_stuck", "the boat does not answer to it"),
    -1: AlarmEvent("rudder_reversed", "the boat answers to the opposite rudder"),
}
OTHERS = {
    QUICKER: AlarmEvent("too_quick"),
    SLOW_RUDDER: AlarmEvent("rudder_slow"),
    LIVELIER: AlarmEvent("lively"),
}


def _findings(state: State, seen: MonitorInput) -> tuple[AlarmEvent, ...]:
    found: tuple[AlarmEvent, ...] = ()
    if state.following.name:
        found = (AlarmEvent(state.following.name, state.following.shown),)
    if state.response.verdict:
        found = (VERDICTS[state.response.verdict],)
    if state.overpowered.found:
        found += (AlarmEvent("overpowered", state.overpowered.found),)
    if seen.now - state.trial_doubted < TRIAL_SAID:
        found += (AlarmEvent("trial_doubtful"),)
    if state.runaway.has_run:
        found += (AlarmEvent("runaway"),)
    if state.runaway.overpowered:
        found += (AlarmEvent("overpowered", state.runaway.overpowered),)
    if seen.now - state.stop_since >= AT_THE_STOP_TIME:
        found += (AlarmEvent("rudder_at_stop"),)
    if state.other == SLOW_RUDDER and seen.model.n1 <= 0.0 and not seen.rudder_is_slow:
        # no gain is soft enough for a boat that turns away quicker than its rudder comes
        found += (AlarmEvent("rudder_not_following", "much slower than its file says"),)
    elif state.other != FILED:
        found += (OTHERS[state.other],)
    elif seen.rudder_is_slow:
        found += (OTHERS[SLOW_RUDDER],)
    if state.doubts_speed:
        found += (AlarmEvent("speed_doubtful"),)
    return found


def _is_for_the_speed(response: Response, seen: MonitorInput) -> bool:
    """Return whether the answer to the rudder is one that a wrong speed explains: it is doubted then."""
    if response.other in (QUICKER, LIVELIER) and reads_low(seen):
        return True
    return response.verdict > 0 and speed_ratio(seen) > SPEED_DOUBT
