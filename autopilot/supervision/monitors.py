"""The monitors in their sequence: compass, rudder, course, and what is only a limit.

A monitor never moves the rudder: it names an alarm, and `autopilot.supervision.alarms` has what follows from it. All
that is remembered is one value, `State`. Pure.

The smallest one is here: whether one of two thrusters gives less than it is asked for, for weed, a rope or a motor that
stands still.

The push that the model does not explain, as an angle of rudder, through a first-order filter of the time TAU,

    p = T/K [(r - r_f)/TAU - (K delta/T)_f + (d(r)/T)_f],   d(r) = n3 r^3 + n2 r^2 + n1 r + n0,

where _f is filtered, is compared with its own average of late. A thruster that fails pushes the boat to its side by
half its thrust, and takes the boat's speed although the throttle stays: both must show, for a gust does the one. With
the throttle t and the steering's moment m, shares of full, the thrusters are asked for t^2 + m to port and t^2 - m to
starboard. In a turn, and for some seconds behind it, the push is compared with that before it, and more of it must be
missing: a hull that slides is pushed by that. The alarm stays while the average of the push does.

Speed over the ground is not the thrust's alone. A stream (n, e) adds n cos psi + e sin psi to the way u ahead, so that
it changes as the boat turns; and revolutions t + s and t - s push by t^2 + s^2 ahead, the more the harder they steer,
by 1 + (m/t^2)^2/4, up to where one of them stands still. u wanders, the stream hardly does, and a Kalman filter learns
them from the speed V over the ground,

    V = u (1 + a) + n (cos psi)_f + e (sin psi)_f,   1 + a = [(1 + (m/t^2)^2/4)^(y/2)]_f,

with y the power of the throttle that the speed goes with, and _f filtered as V is. A boat is slowed where V is less
than u, the stream and the least that steering added of late make, by more than SLOWED and what is not known of u and
stream: so a turn in a stream that is not known accuses nobody, and in one that is known hides nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from operator import mul
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.estimation.tuning import SPEED_SMOOTHING
from autopilot.models.norrbin import Norrbin, damping
from autopilot.signals import (
    AlarmEvent,
    ConditionSample,
    HeadingSample,
    RateSample,
    RollSample,
    RudderSample,
    Sample,
    WindSample,
)
from autopilot.supervision import compass_watch, course_watch, heading_and_rate, rudder_watch
from autopilot.supervision.alarms import CATALOGUE
from autopilot.supervision.failsafe import WIND_FRESH
from autopilot.supervision.monitor_input import AlarmLimits, History, Measured, MonitorInput
from autopilot.supervision.tuning import NEWS, ROLL_SECONDS

TAU = 0.7
"""[s]: shorter than the time in which a boat is lost, longer than waves of small boats and a gyro's noise."""
LATE = 20.0
"""[s]: what pushes for longer is wind or trim."""
LASTS = 0.6
"""[s] for which both must show."""
SHARE, SHARE_TURNING = 0.3, 0.6
"""Of the moment that one thruster is asked for; in a turn and behind it."""
LEAST = math.radians(1.5)
SLOWED = 0.1  # 30 %: 5 false alarms with less
"""Of the way: a third of one thruster's thrust is so much of a boat's speed."""
UNSTEADY, UNSTEADY_TURNING = 0.03, 0.1  # 30 %: 2 false alarms with more
"""Of the way: by so much wave and drift change it, for as long as the speed is smoothed."""
STREAM_UNKNOWN = 0.2  # 30 %: 2 false alarms with less
"""Of the way: the stream, each way, and the way before anything is known of them. Both change by SLOWED, the way in the
time LATE, the stream in STREAM_LASTS."""
STREAM_LASTS = 100.0
GATHERS = 3.0  # 30 %: 2 false alarms with less, 1 with more
"""[s] in which a boat, and its smoothed speed, follow the thrust."""
LEAST_WAY = 0.2
"""[m/s]: what is a share of the way is one of this at least, for a speed over the ground is not known better."""
STEADY = 0.93
"""Of the throttle of late: with less of it no boat keeps its speed."""
LEAST_THROTTLE = 0.15
QUIET = 6.0
"""[s] behind a turn: the boat gathers way again, and its drift dies out. Where others steered nothing is judged for as
long."""


class Way(NamedTuple):
    """known: the way through the water and the stream's north and east [m/s]; covariance: of these [(m/s)^2]; cosine
    and sine: of the heading, filtered as the speed is; more: what steering adds to the way, a share of it, and least:
    the least of late."""

    known: tuple[float, float, float]
    covariance: tuple[tuple[float, float, float], ...]
    cosine: float
    sine: float
    more: float = 0.0
    least: float = 0.0


class ThrusterMemory(NamedTuple):
    """Filtered rate [rad/s], rudder's and damping's acceleration [rad/s^2]; of late: push [rad] and throttle, nan
    before the first look; way: None where others steer, and where no speed is measured; for how long [s] both show, and
    the push [rad] that there was before; for how long [s] it is as in a turn yet."""

    rate: float = math.nan
    driven: float = 0.0
    damped: float = 0.0
    push: float = math.nan
    throttle: float = math.nan
    way: Way | None = None
    lasted: float = 0.0
    before: float = math.nan
    quiet: float = 0.0


NO_THRUST_SEEN = ThrusterMemory()


class ThrusterLook(NamedTuple):
    """What is looked at: the model, heading [rad], rate [rad/s], rudder [rad] as ordered, speed ahead [m/s], nan where
    none is measured, whether that is over the ground, throttle [share of full], way_exponent: the power of it that the
    speed goes with; the angle [rad] that full steering stands for, whether we steer by headings and whether a course is
    held rather than a turn made, and the time [s] since the last look."""

    model: Norrbin
    heading: float
    rate: float
    rudder: float
    speed: float
    is_over_ground: bool
    throttle: float
    way_exponent: float
    full: float
    steers: bool
    holds_course: bool
    dt: float


def thruster_step(memory: ThrusterMemory, look: ThrusterLook) -> tuple[ThrusterMemory, AlarmEvent | None]:
    """Return the memory after a look, and the alarm where a thruster fails."""
    model, dt = look.model, look.dt
    if math.isnan(look.throttle) or not math.isfinite(look.rate):
        return NO_THRUST_SEEN, None
    unit = model.gain / model.time_constant
    driven, damped = unit * look.rudder, damping(model, look.rate) / model.time_constant
    if math.isnan(memory.rate):
        return ThrusterMemory(look.rate, driven, damped, math.nan, look.throttle), None
    is_turn = look.steers and (not look.holds_course or memory.quiet > 0.0)
    share, slow = -math.expm1(-dt / TAU), 0.0 if is_turn else -math.expm1(-dt / LATE)
    rate = memory.rate + share * (look.rate - memory.rate)
    driven = memory.driven + share * (driven - memory.driven)
    damped = memory.damped + share * (damped - memory.damped)
    push = ((look.rate - rate) / TAU - driven + damped) / unit
    late = push if math.isnan(memory.push) else memory.push + slow * (push - memory.push)
    found = memory._replace(
        rate=rate,
        driven=driven,
        damped=damped,
        push=late,
        throttle=memory.throttle + slow * (look.throttle - memory.throttle),
        quiet=max(memory.quiet - dt, 0.0) if look.holds_course else QUIET,
    )
    if not look.steers:
        return found._replace(throttle=look.throttle, way=None, before=math.nan, lasted=0.0), None
    way, learnt, is_slowed = None, None, False
    if look.speed == look.speed:  # what is no number is not itself
        way, learnt, is_slowed = way_step(memory.way or _first_way(look), look, is_turn)
    is_failing = not math.isnan(memory.before)
    # once it is said, waves do not end it: what pushes on the average of late does
    more = late - memory.before if is_failing else push - late
    # one that is hardly asked for thrust does not push by less of it
    steered = max(math.copysign(driven / unit, -more * driven), 0.0)
    asked = 0.5 * (look.throttle * abs(look.throttle) * look.full + steered)
    limit = max((SHARE_TURNING if is_turn else SHARE) * asked, LEAST)
    if is_failing:
        if abs(more) < 0.5 * limit:
            return found._replace(way=learnt, before=math.nan, lasted=0.0), None
        return found._replace(way=learnt), _alarm(more)
    is_pushed = look.throttle > LEAST_THROTTLE and abs(more) > limit
    if not (is_pushed and is_slowed and look.throttle > STEADY * found.throttle):
        return found._replace(way=learnt, lasted=0.0), None
    # what may be a fault is none of the boat's ways
    if memory.lasted + dt < LASTS:
        return found._replace(way=way, lasted=memory.lasted + dt), None
    return found._replace(way=way, push=push, before=memory.push), _alarm(more)


def _first_way(look: ThrusterLook) -> Way:
    speed = look.speed
    unknown = (STREAM_UNKNOWN * max(speed, LEAST_WAY)) ** 2
    covariance = (unknown, 0.0, 0.0), (0.0, unknown, 0.0), (0.0, 0.0, unknown)
    return Way((speed, 0.0, 0.0), covariance, math.cos(look.heading), math.sin(look.heading))


def way_step(before: Way, look: ThrusterLook, is_turn: bool) -> tuple[Way, Way, bool]:
    """Return what is known of way and stream before and after the speed of a look, and whether the boat is slowed."""
    dt, (usual, north, east) = look.dt, before.known
    size = max(usual, LEAST_WAY)
    passed = -math.expm1(-dt / SPEED_SMOOTHING)
    cosine = before.cosine + passed * (math.cos(look.heading) - before.cosine)
    sine = before.sine + passed * (math.sin(look.heading) - before.sine)
    moment = min(abs(look.rudder) / (look.full * max(look.throttle, LEAST_THROTTLE) ** 2), 2.0)
    gathered = -math.expm1(-dt / GATHERS)
    more = (1.0 + 0.25 * moment * moment) ** (0.5 * look.way_exponent) - 1.0
    more = before.more + gathered * (more - before.more)
    least = min(more, before.least + gathered * (more - before.least))
    row = (1.0, cosine, sine) if look.is_over_ground else (1.0, 0.0, 0.0)
    changes = [(SLOWED * size) ** 2 * dt / lasts for lasts in (LATE, STREAM_LASTS, STREAM_LASTS)]
    covariance = [list(each) for each in before.covariance]
    for place, change in enumerate(changes):
        covariance[place][place] += change
    of_speed = [sum(map(mul, each, row)) for each in covariance]
    unknown = sum(map(mul, of_speed, row))
    unsteady = (UNSTEADY_TURNING if is_turn else UNSTEADY) * size
    # it lasts, so that the speeds of that time tell no more than one
    share = dt / (unknown * dt + unsteady * unsteady * 2.0 * SPEED_SMOOTHING)
    off = look.speed - usual - row[1] * north - row[2] * east
    way = Way(before.known, before.covariance, cosine, sine, more, least)
    after = way._replace(
        known=tuple(one + of * share * (off - size * more) for one, of in zip(before.known, of_speed, strict=True)),
        covariance=tuple(
            tuple(one - of * share * other for one, other in zip(each, of_speed, strict=True))
            for each, of in zip(covariance, of_speed, strict=True)
        ),
    )
    return way, after, off - size * least < -math.hypot(SLOWED * size, math.sqrt(unknown))


def _alarm(push: float) -> AlarmEvent:
    return AlarmEvent("thruster_weak", "port" if push < 0.0 else "starboard")


def with_weak_thruster(found: Mapping[str, AlarmEvent], alarm: AlarmEvent | None) -> Mapping[str, AlarmEvent]:
    """Return what is found, with a thruster that is weak. A boat that answers by half for it is steered on: nobody else
    would keep it on its course, and what its outputs are at is watched apart. One that is off its course, too, is not
    kept there: neither thruster moves it."""
    if alarm is None:
        return found
    is_kept = "off_course" not in found
    kept = {name: event for name, event in found.items() if not (is_kept and event == rudder_watch.VERDICTS[1])}
    return {**kept, alarm.name: alarm}


class Roll(NamedTuple):
    """since [s]: the boat heels beyond its limit, nan: it does not; reported [rad] and text: what was said of it."""

    since: float = math.nan
    reported: float = math.nan
    text: str = ""


UPRIGHT = Roll()


class State(NamedTuple):
    """What the monitors remember. measured: the newest tick's samples; consistency: of rate and heading; conditions:
    what others see, with who says so; wind_time [s]: of the newest wind."""

    measured: Measured = Measured()
    consistency: heading_and_rate.Consistency = heading_and_rate.Consistency()
    compass: compass_watch.State = compass_watch.State()
    rudder: rudder_watch.State = rudder_watch.State()
    course: course_watch.State = course_watch.State()
    conditions: tuple[tuple[str, AlarmEvent], ...] = ()
    roll: Roll = UPRIGHT
    wind_time: float = -math.inf


NOTHING_SEEN = State()


def without_past(state: State) -> State:
    """Return the state without what was compared so far: nothing that came before a standstill says anything about now.
    What has been concluded of boat, rate, speed and rudder stays."""
    rudder, course = state.rudder, state.course
    return state._replace(
        measured=Measured(),
        consistency=heading_and_rate.concluded(state.consistency),
        compass=compass_watch.State(),
        rudder=rudder_watch.State(other=rudder.other, rests_roll=rudder.rests_roll, doubts_speed=rudder.doubts_speed),
        course=course_watch.State(softer=course.softer, hunts=course.hunts),
    )


def by_other_path(state: State) -> State:
    """Return the state without what was made of the rudder's answers and of the course, as orders turn out to come to
    the rudder later or sooner than was known: it was where nobody supposed it."""
    before = state.rudder
    rudder = rudder_watch.State(following=before.following, rests_roll=before.rests_roll)
    return state._replace(rudder=rudder, course=course_watch.State())


def on_samples(limits: AlarmLimits, before: State, samples: tuple[Sample, ...], rate_most: float = math.inf) -> State:
    """Return the state with the instruments' samples of this tick; rate_most [rad/s]: see `consistency_step`."""
    measured, consistency, compass, rudder, course, conditions, roll, wind_time = before
    headings: tuple[HeadingSample, ...] = ()
    angles: tuple[RudderSample, ...] = ()
    report = measured.report
    for sample in samples:
        if type(sample) is HeadingSample:
            headings += (sample,)
            consistency = heading_and_rate.consistency_step(
                consistency, sample, limits.rate_disagrees, rate_most, limits.heading_jump
            )
        elif type(sample) is RollSample:
            if roll is not UPRIGHT or not -limits.roll <= sample.roll <= limits.roll:
                roll = rolled(roll, sample, limits.roll)
        elif type(sample) is RudderSample:
            if sample.ordered:
                report = sample
            else:
                angles += (sample,)
        elif type(sample) is RateSample:
            consistency = heading_and_rate.consistency_step(consistency, sample, limits.rate_disagrees, rate_most)
        elif type(sample) is WindSample:
            wind_time = sample.time
        elif type(sample) is ConditionSample:
            conditions = with_condition(conditions, sample)
    measured = Measured(headings, angles, report, consistency.found, consistency.rate)
    return State(measured, consistency, compass, rudder, course, conditions, roll, wind_time)


def judged(
    limits: AlarmLimits, before: State, seen: MonitorInput, rudder_history: History
) -> tuple[State, Mapping[str, AlarmEvent]]:
    """Return the state after a tick whose samples were taken by `on_samples`, and what is the case, by its names in the
    catalogue."""
    measured, consistency, compass, rudder, course, conditions, roll, wind_time = before
    compass, found = compass_watch.update(limits, compass, seen, measured)
    offset = consistency.held.offset
    if offset:
        # the boat has not turned by a jump, which is no answer to the rudder
        held = tuple(each._replace(heading=wrap(each.heading - offset)) for each in measured.headings)
        measured = measured._replace(headings=held)
    rudder, of_rudder = rudder_watch.update(limits, rudder, seen, measured, rudder_history)
    course, of_course, contradicts_speed = course_watch.update(limits, course, seen, rudder, rudder_history)
    if contradicts_speed:
        rudder = rudder.with_doubted_speed()
    found += of_rudder + of_course
    if conditions:
        found = (*(event for _, event in conditions), *found)
    if consistency.held.is_said:
        found += heading_and_rate.held_events(consistency.held, seen.now)
    if seen.waits:
        found += (AlarmEvent("low_speed"),)
    if roll.text:
        found += (AlarmEvent("roll", roll.text),)
    if limits.wind_wanted and seen.now - wind_time > WIND_FRESH:
        found += (AlarmEvent("no_wind"),)
    after = State(before.measured, consistency, compass, rudder, course, conditions, roll, wind_time)
    return after, {event.name: event for event in found} if found else {}


def rolled(before: Roll, sample: RollSample, most: float) -> Roll:
    """Return what is known of the heel after a sample of it; `most` [rad] is no alarm."""
    heel = abs(sample.roll)
    if heel <= most:
        return UPRIGHT
    if math.isnan(before.since):
        return Roll(sample.time)
    is_news = not before.text or heel - before.reported > NEWS
    if sample.time - before.since < ROLL_SECONDS or not is_news:
        return before
    return Roll(before.since, heel, f"{math.degrees(heel):.0f} deg")


def with_condition(
    conditions: tuple[tuple[str, AlarmEvent], ...], sample: ConditionSample
) -> tuple[tuple[str, AlarmEvent], ...]:
    """Return what others see after one has said whether something is the case."""
    if not (sample.present and sample.name in CATALOGUE):
        return tuple(each for each in conditions if (each[0], each[1].name) != (sample.source, sample.name))
    said = sample.source, AlarmEvent(sample.name, sample.detail)
    if any((source, event.name) == (sample.source, sample.name) for source, event in conditions):
        return tuple(said if (each[0], each[1].name) == (sample.source, sample.name) else each for each in conditions)
    return (*conditions, said)
