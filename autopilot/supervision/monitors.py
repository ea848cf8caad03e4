"""The monitors in their sequence: compass, rudder, course, and what is only a limit.

A monitor never moves the rudder: it names an alarm, and `autopilot.supervision.alarms` has what follows from it. All
that is remembered is one value, `State`. Pure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

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


def on_samples(limits: AlarmLimits, before: State, samples: tuple[Sample, ...]) -> State:
    """Return the state with the instruments' samples of this tick."""
    measured, consistency, compass, rudder, course, conditions, roll, wind_time = before
    headings: tuple[HeadingSample, ...] = ()
    angles: tuple[RudderSample, ...] = ()
    report = measured.report
    for sample in samples:
        if type(sample) is HeadingSample:
            headings += (sample,)
            consistency = compass_watch.consistency_step(consistency, sample, limits.rate_disagrees)
        elif type(sample) is RollSample:
            if roll is not UPRIGHT or not -limits.roll <= sample.roll <= limits.roll:
                roll = rolled(roll, sample, limits.roll)
        elif type(sample) is RudderSample:
            if sample.ordered:
                report = sample
            else:
                angles += (sample,)
        elif type(sample) is RateSample:
            consistency = compass_watch.consistency_step(consistency, sample, limits.rate_disagrees)
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
