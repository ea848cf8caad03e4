"""The monitors in their sequence: compass, rudder, course, and what is only a limit.

A monitor never moves the rudder: it names an alarm, and `autopilot.supervision.alarms` has what follows from it. All
that is remembered is one value, `State`. Pure.

The smallest one is here: whether one of two thrusters gives less than it is asked for, for weed, a rope or a motor that
stands still.

The push that the model does not explain, as an angle of rudder, through a first-order filter of the time TAU,

    p = T/K [(r - r_f)/TAU - (K delta/T)_f + (d(r)/T)_f],   d(r) = n3 r^3 + n2 r^2 + n1 r + n0,

where _f is filtered, is compared with its own average of late. A thruster that fails pushes the boat to its side by
half its thrust, and takes the boat's speed although the throttle stays: both must show, for a gust does the one and a
stream the other. With the throttle t and the steering's moment m, shares of full, the thrusters are asked for t^2 + m
to port and t^2 - m to starboard. In a turn, and for some seconds behind it, speed and push are compared with those
before it, and more of the thrust must be missing for longer: a hull that slides is pushed by that, and slowed. The
alarm stays while the push does.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

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
from autopilot.supervision import compass_watch, course_watch, rudder_watch
from autopilot.supervision.alarms import CATALOGUE
from autopilot.supervision.failsafe import WIND_FRESH
from autopilot.supervision.monitor_input import AlarmLimits, Measured, MonitorInput
from autopilot.supervision.tuning import NEWS, ROLL_SECONDS

TAU = 0.7
"""[s]: shorter than the time in which a boat is lost, longer than waves of small boats and a gyro's noise."""
LATE = 20.0
"""[s]: what pushes for longer is wind or trim."""
LASTS = 0.6
"""[s] for which both must show."""
SHARE = 0.3
"""Of the moment that one thruster is asked for."""
LASTS_TURNING, SHARE_TURNING = 1.0, 0.6
"""The same in a turn and behind it."""
LEAST = math.radians(1.5)
SLOWED, SLOWED_TURNING = 0.9, 0.75
"""Of the speed of late: a third of one thruster's thrust is so much of a boat's speed. In a turn and behind it a stream
may take as much, and nearly all of one thruster's is wanted."""
STEADY = 0.93
"""Of the throttle of late: with less of it no boat keeps its speed."""
LEAST_THROTTLE = 0.15
QUIET = 6.0
"""[s] behind a turn: the boat gathers way again, and its drift dies out. Where others steered nothing is judged for as
long."""


class ThrusterMemory(NamedTuple):
    """Filtered rate [rad/s], rudder's and damping's acceleration [rad/s^2]; of late: push [rad], speed [m/s] and
    throttle, nan before the first look, and the speed until it is judged; for how long [s] both show, and the push
    [rad] that there was before; for how long [s] it is as in a turn yet, and whether it
    was at the last look."""

    rate: float = math.nan
    driven: float = 0.0
    damped: float = 0.0
    push: float = math.nan
    speed: float = math.nan
    throttle: float = math.nan
    lasted: float = 0.0
    before: float = math.nan
    quiet: float = 0.0
    was_turn: bool = False


NO_THRUST_SEEN = ThrusterMemory()


class ThrusterLook(NamedTuple):
    """What is looked at: the model, rate [rad/s], rudder [rad] as ordered, speed [m/s], throttle [share of full], the
    angle [rad] that full steering stands for, whether we steer by headings and whether a course is held rather than a
    turn made, and the time [s] since the last look."""

    model: Norrbin
    rate: float
    rudder: float
    speed: float
    throttle: float
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
        return ThrusterMemory(look.rate, driven, damped, math.nan, look.speed, look.throttle), None
    is_turn = look.steers and (not look.holds_course or memory.quiet > 0.0)
    share, slow = -math.expm1(-dt / TAU), 0.0 if is_turn else -math.expm1(-dt / LATE)
    # which way the boat goes now, a stream may carry it more or less
    is_new = not is_turn and (math.isnan(memory.speed) or memory.was_turn)
    usual = look.speed if is_new else memory.speed
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
        speed=usual + slow * (look.speed - usual),
        throttle=memory.throttle + slow * (look.throttle - memory.throttle),
        quiet=max(memory.quiet - dt, 0.0) if look.holds_course else QUIET,
        was_turn=is_turn,
    )
    if not look.steers:
        return found._replace(speed=math.nan, throttle=look.throttle, before=math.nan, lasted=0.0), None
    more = push - (late if math.isnan(memory.before) else memory.before)
    # one that is hardly asked for thrust does not push by less of it
    steered = max(math.copysign(driven / unit, -more * driven), 0.0)
    asked = 0.5 * (look.throttle * abs(look.throttle) * look.full + steered)
    limit = max((SHARE_TURNING if is_turn else SHARE) * asked, LEAST)
    if not math.isnan(memory.before):
        if abs(more) < 0.5 * limit:
            return found._replace(before=math.nan, lasted=0.0), None
        return found, _alarm(more)
    is_pushed = look.throttle > LEAST_THROTTLE and abs(more) > limit
    slowed = SLOWED_TURNING if is_turn else SLOWED
    is_slowed = look.speed < slowed * found.speed and look.throttle > STEADY * found.throttle
    if not (is_pushed and is_slowed):
        return found._replace(lasted=0.0), None
    if memory.lasted + dt < (LASTS_TURNING if is_turn else LASTS):
        return found._replace(lasted=memory.lasted + dt), None
    return found._replace(before=memory.push), _alarm(more)


def _alarm(push: float) -> AlarmEvent:
    return AlarmEvent("thruster_weak", "port" if push < 0.0 else "starboard")


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
    consistency: compass_watch.Consistency = compass_watch.Consistency()
    compass: compass_watch.State = compass_watch.State()
    rudder: rudder_watch.State = rudder_watch.State()
    course: course_watch.State = course_watch.State()
    conditions: tuple[tuple[str, AlarmEvent], ...] = ()
    roll: Roll = UPRIGHT
    wind_time: float = -math.inf


NOTHING_SEEN = State()


def without_past(state: State) -> State:
    """Return the state without what was compared so far: nothing that came before a standstill says anything about now.
    What has been concluded of boat, speed and rudder stays."""
    rudder, course = state.rudder, state.course
    return state._replace(
        measured=Measured(),
        consistency=compass_watch.Consistency(),
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
            consistency = compass_watch.consistency_step(consistency, sample, limits.rate_disagrees, rate_most)
        elif type(sample) is RollSample:
            if roll is not UPRIGHT or not -limits.roll <= sample.roll <= limits.roll:
                roll = rolled(roll, sample, limits.roll)
        elif type(sample) is RudderSample:
            if sample.ordered:
                report = sample
            else:
                angles += (sample,)
        elif type(sample) is RateSample:
            consistency = compass_watch.consistency_step(consistency, sample, limits.rate_disagrees, rate_most)
        elif type(sample) is WindSample:
            wind_time = sample.time
        elif type(sample) is ConditionSample:
            conditions = with_condition(conditions, sample)
    measured = Measured(headings, angles, report, consistency.found)
    return State(measured, consistency, compass, rudder, course, conditions, roll, wind_time)


def judged(
    limits: AlarmLimits, before: State, seen: MonitorInput, rudder_history: rudder_watch.History
) -> tuple[State, Mapping[str, AlarmEvent]]:
    """Return the state after a tick whose samples were taken by `on_samples`, and what is the case, by its names in the
    catalogue."""
    measured, consistency, compass, rudder, course, conditions, roll, wind_time = before
    compass, found = compass_watch.update(limits, compass, seen, measured)
    rudder, of_rudder = rudder_watch.update(limits, rudder, seen, measured, rudder_history)
    course, of_course, contradicts_speed = course_watch.update(limits, course, seen, rudder)
    if contradicts_speed:
        rudder = rudder.with_doubted_speed()
    found += of_rudder + of_course
    if conditions:
        found = (*(event for _, event in conditions), *found)
    if seen.waits:
        found += (AlarmEvent("low_speed"),)
    if roll.text:
        found += (AlarmEvent("roll", roll.text),)
    if limits.wind_wanted and seen.now - wind_time > WIND_FRESH:
        found += (AlarmEvent("no_wind"),)
    after = State(measured, consistency, compass, rudder, course, conditions, roll, wind_time)
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
