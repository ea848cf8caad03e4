"""The monitors of course, stop, push and gyro at both sides of their limits, with the numbers of their pages."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from alarm_texts import words
from watches import Frozen, Jumping, Monitors, consistency, off_course, overpowered, runaway

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin, steady_rate
from autopilot.signals import HeadingSample, NavState, RateSample, RollSample
from autopilot.supervision.compass_watch import is_stale
from autopilot.supervision.course_watch import ON_HEADING, course_step
from autopilot.supervision.heading_and_rate import Consistency, consistency_step
from autopilot.supervision.monitor_input import AlarmLimits, MonitorInput
from autopilot.supervision.response_filter import (
    NOTHING,
    Noise,
)
from autopilot.supervision.rudder_response import (
    first_response,
)

BOAT = Norrbin(0.2, 2.0, reference_speed=4.0)
STOP = math.radians(30.0)
SIDES = pytest.mark.parametrize("side", [-1.0, 1.0])


def watched(
    now: float, heading: float = 0.0, rudder: float = 0.0, rate: float = 0.0, waves: float = 0.0
) -> MonitorInput:
    state = NavState(now, heading, rate, 4.0, rudder, 0.0, 0.0, True, wave_deviation=waves)
    return MonitorInput(now, BOAT, state, True, True, 0.0, rudder, STOP, True)


@SIDES
@pytest.mark.parametrize(
    ("share", "seconds", "is_said"),
    [(2.0, 1.55, True), (2.0, 1.45, False), (1.1, 15.2, True), (1.1, 14.8, False), (1.0, 30.0, False)],
)
def test_the_nearer_a_push_is_to_what_the_rudder_holds_the_longer_it_must_last(
    side: float, share: float, seconds: float, is_said: bool
) -> None:
    monitor = overpowered()
    for tick in range(round(seconds / 0.05) + 1):
        monitor.update(watched(0.05 * tick, rudder=-side * STOP)._replace(push=side * share * STOP))
    degrees = math.degrees(share * STOP)
    name = "starboard" if side > 0.0 else "port"
    assert monitor.found == (f"to {name}, as by {degrees:.0f} deg of rudder" if is_said else "")
    for change in ({"steers": False}, {"has_way": False}, {"push": 0.0}):
        monitor.update(watched(40.0)._replace(push=side * share * STOP)._replace(**change))  # type: ignore[arg-type]
        assert monitor.found == ""


@SIDES
@pytest.mark.parametrize(
    ("rudder", "follows", "is_said"),
    [(-0.91, True, True), (-0.89, True, False), (0.91, True, False), (0.1, False, True)],
)
def test_a_law_that_has_rudder_left_is_not_overpowered(
    side: float, rudder: float, follows: bool, is_said: bool
) -> None:
    """A sea that is not the one estimated was taken for a push of 59 deg of rudder, the rudder at 11 deg."""
    monitor = overpowered()
    for tick in range(100):
        at = watched(0.1 * tick, rudder=side * rudder * STOP)._replace(follows=follows)
        monitor.update(at._replace(push=side * 2.0 * STOP))
    assert bool(monitor.found) is is_said


@pytest.mark.parametrize("gap", [5.0, -5.0])
def test_a_tick_that_comes_late_or_behind_another_is_no_push_that_lasts(gap: float) -> None:
    """5 s in which nobody looked made an alarm of one tick's push."""
    monitor = overpowered()
    for now in (0.0, 0.1, 0.1 + gap, 0.2 + gap):
        monitor.update(watched(now, rudder=-STOP)._replace(push=2.0 * STOP))
    assert monitor.found == ""
    for tick in range(round(1.5 / 0.1)):
        monitor.update(watched(0.3 + gap + 0.1 * tick, rudder=-STOP)._replace(push=2.0 * STOP))
    assert monitor.found


@SIDES
@pytest.mark.parametrize(("seconds", "is_said"), [(1.65, True), (1.45, False)])
def test_a_rudder_on_its_way_to_its_stop_is_not_overpowered_yet(side: float, seconds: float, is_said: bool) -> None:
    """The gear comes after the order: at 33 deg off heading the alarm was said with the rudder 4 deg from its stop."""
    monitor, arrives = overpowered(), 5.0
    for tick in range(round((arrives + seconds) / 0.1) + 1):
        now = 0.1 * tick
        at = watched(now, rudder=-side * STOP * (0.95 if now >= arrives - 1e-9 else 0.5))._replace(follows=True)
        monitor.update(at._replace(push=side * 2.0 * STOP))
    assert bool(monitor.found) is is_said
    monitor.update(watched(30.0, rudder=-0.5 * side * STOP)._replace(follows=True, push=side * 1.2 * STOP))
    assert bool(monitor.found) is is_said, "what has been said stays while the push does"


@SIDES
@pytest.mark.parametrize(
    ("share", "seconds", "is_said"), [(0.91, 15.05, True), (0.91, 14.85, False), (0.89, 60.0, False)]
)
def test_a_rudder_at_nine_tenths_for_fifteen_seconds_is_at_its_stop(
    side: float, share: float, seconds: float, is_said: bool
) -> None:
    monitors = Monitors(AlarmLimits())

    def is_there(now: float, rudder: float, holds: bool = True) -> bool:
        monitors.update(watched(now, rudder=side * rudder)._replace(holds_course=holds))
        return "rudder_at_stop" in monitors.findings

    said = [is_there(0.1 * tick, share * STOP) for tick in range(round(seconds / 0.1) + 1)]
    assert said[-1] is is_said
    assert not is_there(61.0, STOP, holds=False)
    assert not is_there(61.1, STOP), "it begins anew"


@SIDES
def test_off_course_by_side_with_the_rudder_at_its_stop_and_back_within_seven_tenths(side: float) -> None:
    monitor = off_course(AlarmLimits(off_course=math.radians(20.0), off_course_time=10.0))

    def look(now: float, error_deg: float, rudder: float = 0.0) -> str:
        monitor.update(watched(now, side * math.radians(error_deg), rudder))
        return words(monitor.found)

    name = "starboard" if side > 0.0 else "port"
    assert [look(now, 20.4) for now in (0.0, 5.0, 9.9)] == ["", "", ""]
    first = look(10.0, 20.4)
    assert first == f"off heading by 20 deg to {name}: check rudder, speed and wind, or order another course"
    assert look(11.0, 30.0) == first, "less than 10 degrees more is no news"
    assert look(12.0, 30.6, -side * STOP).startswith(f"off heading by 31 deg to {name}, the rudder at its stop")
    assert all(look(now, error) != "" for now, error in ((13.0, 14.1), (14.0, 13.9), (21.9, 13.9)))
    assert look(22.0, 13.9) == "", "it has stayed there for the four time constants in which it settles"
    assert [look(now, 20.4) for now in (23.0, 32.9)] == ["", ""]
    assert look(33.0, 20.4) != ""


@SIDES
def test_a_boat_that_comes_near_its_course_and_leaves_again_has_been_off_it_all_the_time(side: float) -> None:
    limits = AlarmLimits(off_course=math.radians(20.0), off_course_time=10.0)
    for gap, is_said in ((7.9, True), (8.1, False)):
        monitor = off_course(limits)
        for tick in range(101):
            now = 0.1 * tick
            error = 3.0 if 1.0 < now <= 1.0 + gap else 21.0
            monitor.update(watched(now, side * math.radians(error)))
            assert now > 9.95 or monitor.found is None
        assert (monitor.found is not None) is is_said
    slow, monitor = BOAT._replace(time_constant=3.0), off_course(limits)
    for now, error in ((0.0, 21.0), (1.0, 3.0), (9.9, 3.0), (10.0, 21.0)):
        monitor.update(watched(now, side * math.radians(error))._replace(model=slow))
    assert monitor.found is not None, "a slow boat takes 10 s to settle, as long as makes it off"


@SIDES
def test_a_boat_that_swings_through_its_course_to_the_other_side_is_off_it_at_once(side: float) -> None:
    for seconds, is_said in ((4.0, True), (12.5, False)):
        monitor = off_course(AlarmLimits(off_course=math.radians(20.0), off_course_time=5.0))
        for tick in range(round(seconds / 0.1) + 1):
            monitor.update(watched(0.1 * tick, side * math.radians(21.0 - 42.0 * 0.1 * tick / seconds)))
        assert (monitor.found is not None) is is_said, "a slow swing has been on its course for 5 s between"
        assert not is_said or f"by 21 deg to {'port' if side > 0.0 else 'starboard'}" in words(monitor.found)


def ran(side: float, share: float, seconds: float, turned_deg: float, waves: float = 0.0) -> tuple[bool, str]:
    """A rudder hard over to `side` while the boat turns so far the other way in so long; share: of its steady turn, at
    which it turns in the last 2.1 s. The rate sensor stands still."""
    monitor, steady = runaway(), math.degrees(steady_rate(BOAT, STOP))
    last = 2.1 if seconds > 6.0 else 0.0
    times, turns = (0.0, seconds - last, seconds), (0.0, turned_deg - last * share * steady, turned_deg)
    for tick in range(round(seconds / 0.05) + 1):
        heading = -side * math.radians(float(np.interp(0.05 * tick, times, turns)))
        monitor.update(watched(0.05 * tick, heading, side * STOP, 0.0, waves))
    return monitor.has_run, monitor.overpowered


@SIDES
def test_a_boat_that_turns_twenty_degrees_against_its_rudder(side: float) -> None:
    """The rudder takes hold in a time constant, 2 s, and stops what it can in three."""
    to = "to port" if side > 0.0 else "to starboard"
    assert ran(side, 1.0, 2.05, 20.2) == (False, to)
    assert ran(side, 1.0, 2.05, 19.8) == (False, "")
    assert ran(side, 1.0, 1.90, 40.0) == (False, "")
    assert ran(side, 1.0, 6.05, 40.0) == (True, to)
    assert ran(side, 0.81, 6.05, 40.0) == (True, to)
    assert ran(side, 0.79, 6.05, 40.0) == (False, to)
    assert ran(side, 1.0, 5.90, 40.0) == (False, to)
    assert ran(side, 1.0, 6.05, 29.8, math.radians(5.0)) == (False, "")
    assert ran(side, 1.0, 6.05, 30.2, math.radians(5.0)) == (False, to), "in waves the mean rate tells it later"
    assert ran(side, 1.0, 30.0, 400.0, math.radians(5.0)) == (True, to)
    assert ran(side, 1.0, 6.05, 21.0) == (False, to), "the mean remembers a slower turn"
    assert ran(-side, -1.0, 6.05, -40.0) == (False, ""), "with the rudder"


@SIDES
def test_a_zigzag_45_degrees_off_has_run_away(side: float) -> None:
    for off_deg, rate, has_run in ((45.5, -0.1, True), (44.5, -0.1, False), (45.5, 0.1, False)):
        monitor = runaway()
        at = watched(0.0, 0.0, side * 0.1, side * rate)._replace(zigzag_divergence=math.radians(off_deg))
        monitor.update(at)
        assert monitor.has_run is has_run


def apart(side: float, off: float, seconds: float, alone: bool = False) -> str:
    """Headings that stand against a rate `off` [rad/s] beside them; the two may differ by 0.2 rad over some 5 s."""
    monitor = consistency(0.2)
    for tick in range(round(seconds / 0.1) + 1):
        now = 0.1 * tick
        if alone:
            monitor.update(RateSample(now, side * off))
        monitor.update(HeadingSample(now, 0.0, None if alone else side * off))
    return monitor.found


@SIDES
@pytest.mark.parametrize("alone", [True, False])
def test_heading_and_rate_must_differ_for_a_second(side: float, alone: bool) -> None:
    """x' = off - x/5 s passes 0.2 rad: with 0.1 rad/s after 5 ln(1/(1 - 0.4)) = 2.55 s."""
    assert apart(side, 0.1, 3.2, alone) == ""
    assert apart(side, 0.1, 4.0, alone).endswith("deg apart")
    assert apart(side, 0.038, 60.0, alone) == "", "the sum ends at 5 s of it, 0.19 rad"
    assert apart(side, 0.042, 60.0, alone).endswith("deg apart")


def test_after_the_first_heading_the_usual_response_is_three_quarters() -> None:
    noise = Noise(1e-4, 1e-5, 1e-6, 1e-3, 0.5, 0.0)
    memory = first_response(noise, 3.0, 0.7)
    assert memory.time == 3.0
    assert memory.means == ((0.7, 0.0, 0.0, 0.0), NOTHING, NOTHING, NOTHING, NOTHING)
    assert memory.usual / memory.shown == 0.75
    assert memory.shown == 60.0
    assert (memory.stuck, memory.stuck_late, memory.reversed, memory.reversed_late) == (0.0, 0.0, 0.0, 0.0)
    assert (memory.unexplained, memory.outliers) == (1.0, 0)
    others = memory.others
    assert others.lively == others.quick == (0.0, 0.0)
    assert (others.weak, others.right, others.strong, others.late) == (0.0, 0.0, 0.0, 0.0)


def stood(sea_deg: float, digit_deg: float, felt: float, stands: float, holds: bool = True) -> bool:
    """Whether a heading in a sea that is felt so long on a course is frozen after it has stood for so long."""
    monitor, is_frozen, last = Frozen(), False, round(felt / 0.1)
    for tick in range(last + round(stands / 0.1) + 1):
        now = 0.1 * tick
        heading = math.radians(digit_deg) * (min(tick, last) % 2)
        monitor.on_sample(HeadingSample(now, heading))
        at = watched(now, heading, waves=math.radians(sea_deg))._replace(holds_course=holds)
        is_frozen = monitor.is_frozen(at)
    return is_frozen


def test_in_a_sea_no_heading_stands_for_three_seconds() -> None:
    assert stood(0.72, 0.1, 20.2, 3.1)
    assert not stood(0.72, 0.1, 20.2, 2.8)
    assert not stood(0.68, 0.1, 40.0, 20.0), "less than 0.7 degrees is no sea"
    assert stood(1.02, 0.2, 20.2, 3.1), "five digits"
    assert not stood(0.98, 0.2, 40.0, 20.0)
    assert not stood(0.72, 0.1, 19.8, 20.0), "felt for 20 s"
    assert not stood(0.72, 0.1, 40.0, 20.0, holds=False), "on a course that is held"


def forgotten(felt_deg: float, learnt_deg: float, felt: float, then: float, watched_from: float = 0.0) -> bool:
    """Whether a heading is frozen that has stood for 3.1 s, in a sea that was felt for so long, and is learnt anew from
    then on: a rate that was believed is found wrong. then [s]: the heading moves on until then."""
    monitor, is_frozen, last = Frozen(), False, round((felt + then) / 0.1)
    for tick in range(last + 32):
        now = 0.1 * tick
        since, heading = now - felt, math.radians(0.1) * (min(tick, last) % 2)
        monitor.on_sample(HeadingSample(now, heading))
        at = watched(now, heading, waves=math.radians(felt_deg if since < 0.0 else learnt_deg))
        is_frozen = monitor.is_frozen(at._replace(sea_watched=math.inf if since < 0.0 else since + watched_from))
    return is_frozen


def test_a_sea_that_is_learnt_anew_is_not_flat_water() -> None:
    assert forgotten(1.5, 0.5, 20.2, 9.0), "it moved the heading until the rate was found wrong"
    assert forgotten(1.5, 0.5, 20.2, 0.0), "the heading stands from then on"
    assert not forgotten(1.5, 0.5, 19.8, 9.0), "it had not been felt for 20 s: a gyro that fails looks like a wave"
    assert not forgotten(0.5, 0.5, 40.0, 9.0), "there was none"
    assert not forgotten(1.5, 0.5, 20.2, 9.0, watched_from=40.0), "it has been watched for its memory, and is over"
    assert not forgotten(1.5, 0.5, 20.2, 41.0), "it has been watched for its memory by then"
    assert forgotten(1.5, 0.8, 20.2, 41.0), "it is felt again: it never was flat"


def trembled(
    noise_deg: float,
    digit_deg: float,
    stands: float,
    *,
    hz: float = 10.0,
    trembles: float = 60.0,
    has_way: bool = True,
    swings_deg: float = 0.0,
    lag: float = 0.0,
    creeps: bool = False,
    ends_deg: float = math.nan,
    rudder: float = 0.0,
    unknown_deg: float = 0.0,
) -> bool:
    """Whether a heading in flat water is frozen after it has stood for so long [s], behind a compass of so much white
    noise, a digit, 0: none, and a damping of `lag` [s]. swings_deg: by so much a sea swung it in 4 s until it stood;
    creeps: each 10 s a variation that is found by the place adds a trifle; ends_deg: there it stands, nan: where noise
    had it, of the boat on course 0, which is known to a deviation `unknown_deg`; rudder [rad]: while it stands."""
    random, monitor, is_frozen, shown, seen = np.random.default_rng(1), Frozen(), False, 0.0, 0.0
    for tick in range(round((trembles + stands) * hz) + 1):
        now = tick / hz
        if now <= trembles:
            sea = swings_deg * math.sin(1.6 * now)
            seen += (sea + noise_deg * float(random.standard_normal()) - seen) / max(lag * hz, 1.0)
            shown = round(seen / digit_deg) * digit_deg if digit_deg else seen
        elif not math.isnan(ends_deg):
            shown = ends_deg
        monitor.on_sample(HeadingSample(now, math.radians(shown) + (1e-9 * math.floor(0.1 * now) if creeps else 0.0)))
        at = watched(now, 0.0, rudder if now > trembles else 0.0)
        at = at._replace(has_way=has_way, unknown=math.radians(unknown_deg) ** 2)
        is_frozen = is_frozen or monitor.is_frozen(at)
    return is_frozen


@SIDES
def test_noise_that_ends_leaves_a_heading_that_the_boat_has(side: float) -> None:
    """To a digit and two standard deviations, until the rudder must have turned it by that: with K 0.2 and T 2 s, 1 deg
    of rudder from rest by 0.1 deg in 1.7 s, and 0.05 deg by it in 11.8 s."""
    assert not trembled(0.3, 0.1, 60.0, hz=20.0, ends_deg=0.0), "it ended with 'frozen' after 3 s"
    assert not trembled(0.3, 0.1, 60.0, hz=20.0, ends_deg=side * 0.1, unknown_deg=0.01)
    assert trembled(0.3, 0.1, 3.3, hz=20.0, ends_deg=side * 0.2)
    assert not trembled(0.3, 0.1, 60.0, hz=20.0, ends_deg=side * 0.2, unknown_deg=0.06)
    assert trembled(0.3, 0.1, 3.3, hz=20.0, ends_deg=side * 0.2, unknown_deg=0.04)
    assert trembled(0.3, 0.1, 3.3, hz=20.0, ends_deg=0.0, rudder=side * math.radians(1.0))
    assert trembled(0.3, 0.1, 12.5, hz=20.0, ends_deg=0.0, rudder=side * math.radians(0.05))
    assert not trembled(0.3, 0.1, 11.0, hz=20.0, ends_deg=0.0, rudder=side * math.radians(0.05))


@pytest.mark.parametrize("hz", [5.0, 10.0, 20.0])
def test_in_flat_water_no_compass_stands_whose_noise_moves_its_digits(hz: float) -> None:
    """It was found out by what rudder and bias add up to: after 18 s without a rate, 23 s with one that stood too."""
    assert trembled(0.3, 0.1, 3.3, hz=hz)
    assert not trembled(0.3, 0.1, 2.6, hz=hz)
    assert trembled(0.3, 0.0, 3.3, hz=hz)
    assert not trembled(0.1, 0.1, 60.0, hz=hz), "it stands by itself at times"
    assert not trembled(0.3, 1.0, 60.0, hz=hz)
    assert not trembled(0.3, 0.1, 60.0, hz=hz, has_way=False), "alongside"
    assert not trembled(0.3, 0.1, 60.0, hz=hz, trembles=1.0), "its noise is not known yet"
    assert not trembled(0.0, 0.1, 60.0, hz=hz, swings_deg=5.0), "a sea that ends is no noise"
    assert not trembled(0.03, 0.1, 60.0, hz=hz, creeps=True), "digits and a variation that creeps"


@pytest.mark.parametrize(
    ("digit_deg", "rate", "ripple", "headings", "is_so"),
    [
        (0.0, 0.005, 0.0, 10, True),
        (0.1, -0.005, 0.0, 10, True),
        (0.1, 0.005, 0.0, 9, False),
        (1.0, 0.005, 0.0, 100, False),  # whole degrees repeat
        (0.1, 0.0, 0.0, 100, False),  # made of that very heading
        (0.1, None, 0.0, 100, False),
        (0.1, 0.005, 1e-6, 100, False),  # the rate works
    ],
)
def test_ten_headings_and_rates_alike_are_stale(
    digit_deg: float, rate: float | None, ripple: float, headings: int, is_so: bool
) -> None:
    """Of a compass of 0.3 deg of noise, 10 Hz, that moved for a minute."""
    random, monitor, shown = np.random.default_rng(1), Frozen(), 0.0
    for tick in range(600 + headings):
        if tick <= 600:
            shown = 0.3 * float(random.standard_normal())
            shown = round(shown / digit_deg) * digit_deg if digit_deg else shown
        beside = None if rate is None else rate + ripple * math.sin(float(tick))
        monitor.on_sample(HeadingSample(0.1 * tick, math.radians(shown), beside))
        monitor.is_frozen(watched(0.1 * tick))
    assert is_stale(*monitor.value) is is_so


def test_headings_further_apart_than_a_sea_swings_tell_nothing_of_noise() -> None:
    assert not trembled(0.5, 0.1, 60.0, hz=2.0)
    assert not trembled(0.0, 0.1, 60.0, hz=1.0, swings_deg=5.0)


@pytest.mark.parametrize("hz", [10.0, 50.0])
def test_a_heading_of_many_digits_does_not_stop_dead(hz: float) -> None:
    """That of a flight controller, whose own filter has left no noise in it: one that swings out comes to rest."""
    assert trembled(0.1, 0.0, 3.2, hz=hz, lag=2.0, trembles=90.0)
    assert trembled(0.0, 1e-5, 3.2, hz=hz, trembles=89.3, swings_deg=0.5)
    assert not trembled(0.0, 0.01, 60.0, hz=hz, trembles=89.3, swings_deg=0.5), "a sentence's digits"
    monitor = Frozen()
    for tick in range(6000):
        heading = 0.5 * math.exp(-tick / 50.0)
        monitor.on_sample(HeadingSample(tick / hz, 1.0 + heading))
        assert not monitor.is_frozen(watched(tick / hz)), "without noise it comes to rest by ever smaller steps"


def test_a_compass_of_another_name_has_noise_and_digits_of_its_own() -> None:
    """One in whole degrees that took over in flat water from one in tenths ended steering after 3 s."""
    random, monitor = np.random.default_rng(1), Frozen()

    def frozen_after(source: str, noise_deg: float, digit_deg: float, stands: float) -> bool:
        nonlocal now
        is_frozen, begun = False, now
        while now - begun < 60.0 + stands:
            noise = noise_deg * float(random.standard_normal()) if now - begun < 60.0 else 0.0
            shown = math.radians(round((17.1 + noise) / digit_deg) * digit_deg)
            monitor.on_sample(HeadingSample(now, shown, source=source))
            is_frozen = is_frozen or monitor.is_frozen(watched(now))
            now += 0.1
        return is_frozen

    now = 0.0
    assert not frozen_after("HEHDT", 0.3, 0.1, 0.0)
    assert not frozen_after("HCHDG", 0.05, 1.0, 0.0)
    assert frozen_after("WIHDT", 0.3, 0.1, 3.3)


def turned(rate_deg_s: float, seconds: float, rudder: float = 0.0, moves: bool = True) -> bool:
    """Whether a heading is frozen that stands from 1 s on while a rate beside it, or the rudder, turns the boat."""
    monitor, is_frozen = Frozen(), False
    for tick in range(round(seconds / 0.1) + 11):
        now = 0.1 * tick
        rate = math.radians(rate_deg_s) * (1.0 + (0.01 * (tick % 2) if moves else 0.0))
        monitor.on_sample(HeadingSample(now, 0.001 * min(tick, 10), rate))
        is_frozen = monitor.is_frozen(watched(now, 0.0, rudder))
    return is_frozen


@SIDES
def test_a_heading_that_stands_while_the_rate_adds_up_to_five_degrees_is_frozen(side: float) -> None:
    """x' = rate - x/10 s: at 2 deg/s it passes 5 deg after 10 ln(1/0.75) = 2.88 s."""
    assert turned(side * 2.0, 3.1)
    assert not turned(side * 2.0, 2.6)
    assert turned(side * 0.52, 60.0)
    assert not turned(side * 0.48, 60.0), "a bias of the rate sensor adds up no further"
    assert not turned(side * 50.0, 1.2), "it may be repeated"
    assert turned(side * 50.0, 1.5)


@SIDES
def test_a_heading_that_stands_while_the_rudder_must_have_turned_it_by_fifteen_degrees_is_frozen(side: float) -> None:
    """Heading and rate both stand; by Nomoto psi = K delta (t - T (1 - exp(-t/T))): 15 deg under 30 deg after 4.0 s."""
    reached = next(
        t for t in (0.01 * n for n in range(1000)) if 0.2 * 30.0 * (t - 2.0 * (1.0 - math.exp(-t / 2.0))) > 15.0
    )
    assert turned(side * 0.01, reached + 0.12, side * math.radians(30.0), moves=False)
    assert not turned(side * 0.01, reached - 0.12, side * math.radians(30.0), moves=False)
    assert not turned(side * 0.01, 20.0, side * math.radians(30.0), moves=True), "a rate that moves speaks for itself"


@pytest.mark.parametrize("gap", [0.2, 0.5])
def test_nine_headings_alike_prove_nothing_and_the_tenth_does(gap: float) -> None:
    """However fast the rate beside them turns: a compass repeats itself for a moment."""
    for headings, is_found in ((9, False), (10, True)):
        monitor = Frozen()
        for tick in range(headings):
            monitor.on_sample(HeadingSample(gap * tick, 0.3, 20.0 + 0.1 * (tick % 2)))
            found = monitor.is_frozen(watched(gap * tick, 0.3))
        assert found is is_found
        monitor.on_sample(HeadingSample(5.0, 0.31, 20.0))
        assert not monitor.is_frozen(watched(5.0, 0.31)), "it moves again"


@pytest.mark.parametrize("repeated", [0.5, 1.0, 1.2])
@pytest.mark.parametrize("begins", [0.0, 10.5])
@SIDES
def test_a_turn_that_a_repeated_heading_shows_late_is_no_frozen_one(
    repeated: float, begins: float, side: float
) -> None:
    """A gateway that sends on what it read last, at 20 Hz, as a boat turns by 60 deg/s, from the first heading on or
    behind a straight course on which the heading stood: it ended with 'frozen' after 0.5 s."""
    monitor, rate = Frozen(), side * math.radians(60.0)
    for tick in range(400):
        now = 0.05 * tick
        read = repeated * math.floor(now / repeated + 1e-9)
        shown, turning = rate * max(read - begins, 0.0), rate * (1.0 + 1e-3 * (tick % 2)) * (now > begins)
        monitor.on_sample(HeadingSample(now, wrap(shown), turning))
        assert not monitor.is_frozen(watched(now))


@pytest.mark.parametrize(
    ("swings_deg", "omega", "spike_deg_s"), [(3.0, 2.0, 0.0), (5.0, 2.5, 0.0), (8.0, 3.0, 0.0), (0.0, 1.0, 60.0)]
)
@SIDES
def test_short_waves_and_outliers_of_the_rate_hide_no_heading_that_stands(
    swings_deg: float, omega: float, spike_deg_s: float, side: float
) -> None:
    """Beside a gyro that is alive: it swings, or the boat turns by 1 deg/s and every 3 s one rate is far too large. In
    1.2 s at the quickest they turn by as much as they ever span; a repeated heading would still have come by then."""
    monitor = Frozen()
    for tick in range(round(8.0 / 0.05)):
        now = 0.05 * tick
        rate = swings_deg * omega * math.cos(omega * now) if swings_deg else 1.0
        rate = spike_deg_s if spike_deg_s and tick % 60 == 20 else rate
        monitor.on_sample(HeadingSample(now, 0.3, side * math.radians(rate * (1.0 + 0.01 * (tick % 2)))))
        if monitor.is_frozen(watched(now)):
            return
    raise AssertionError("not found")


def jumped(*headings: tuple[float, float], most: float = 0.3, rate: float = 0.0, looked_at: float = 0.0) -> str:
    """What is said at the end, or at `looked_at` [s], of headings (time, degrees)."""
    monitor = Jumping(most)
    for time, heading in headings:
        monitor.found(watched(time, rate=rate))
        monitor.on_sample(HeadingSample(time, math.radians(heading)))
        monitor.found(watched(time, rate=rate))
    return monitor.found(watched(looked_at or headings[-1][0], rate=rate))


def steps(start: float, end: float, heading: float) -> list[tuple[float, float]]:
    return [(0.1 * n, heading) for n in range(round(start * 10), round(end * 10))]


@SIDES
def test_a_lasting_heading_jump_alarms_after_half_a_second_for_five(side: float) -> None:
    before, after = steps(0.0, 2.0, 350.0), [(time, 350.0 + side * 40.0) for time, _ in steps(2.0, 2.5, 0.0)]
    settled = (2.5, 350.0 + side * 40.0)
    said = f"by {'+' if side > 0.0 else '-'}40 deg"
    assert jumped(*before, *after) == "", "it may be a spike"
    assert jumped(*before, *after, settled) == said
    assert jumped(*before, *after, settled, looked_at=7.45) == said
    assert jumped(*before, *after, settled, looked_at=7.55) == ""
    assert jumped(*before, *after, *steps(2.5, 3.0, 350.0)) == "", "it came back in time"
    assert jumped(*before, *[(time, 350.0 + side * 16.0) for time, _ in steps(2.0, 4.0, 0.0)]) == "", "within 17 deg"
    slow = [(0.4 * n, 350.0 + (side * 40.0 if n > 5 else 0.0)) for n in range(8)]
    assert jumped(*slow) == "", "two samples"
    assert jumped(*slow, (3.2, 350.0 + side * 40.0)) == said, "three"


def test_a_turn_at_the_measured_rate_is_no_heading_jump() -> None:
    turning = [(1.9 * n, 1.9 * 20.0 * n) for n in range(6)]
    assert jumped(*turning, rate=math.radians(20.0)) == ""
    assert jumped((0.0, 0.0), (2.0, 60.0), (2.3, 60.0), (2.6, 60.0)) == "by +60 deg"
    assert jumped((0.0, 0.0), (2.1, 60.0), (2.4, 60.0), (2.7, 60.0)) == ""


@pytest.mark.parametrize(("apart", "is_said"), [(4.9, True), (5.2, False)])
def test_three_jumps_there_and_back_within_ten_seconds_are_a_compass_that_jumps(apart: float, is_said: bool) -> None:
    headings = [(0.1 * n, 60.0 if n % round(apart * 10) == 5 else 0.0) for n in range(round(20.0 * apart) + 7)]
    assert bool(jumped(*headings)) is is_said
    assert jumped(*headings[: round(10.0 * apart)]) == "", "one is a spike"


@SIDES
def test_ten_degrees_more_between_heading_and_rate_are_news(side: float) -> None:
    monitor, said = consistency(math.radians(10.0)), []
    for tick in range(300):
        monitor.update(HeadingSample(0.1 * tick, 0.0, side * math.radians(8.0)))
        said.append(monitor.found)
    reported = [int(words.split(" ")[0]) for words in dict.fromkeys(said) if words]
    assert len(reported) >= 3 and all(10 <= b - a <= 12 for a, b in pairwise(reported))


@SIDES
def test_how_long_it_is_said_that_heading_and_rate_differ(side: float) -> None:
    """A fixed rate of 3 deg/s beside a heading that stands: 10 deg are passed, then for a second."""
    monitor, said = consistency(math.radians(10.0)), []
    for tick in range(400):
        now = 0.1 * tick
        rate = side * math.radians(3.0) if tick < 200 else 0.0
        monitor.update(HeadingSample(now, 0.0, rate))
        if monitor.found:
            said.append(now)
    assert monitor.found and "deg apart" in monitor.found
    monitor.update(HeadingSample(39.9, 0.0, math.nan))
    monitor.update(HeadingSample(math.nan, 0.0, 0.0))
    assert said == [0.1 * tick for tick in range(round(10.0 * said[0]), 400)]


def test_the_rudder_counts_from_the_second_frozen_heading_on() -> None:
    """A compass that is read every other second, at ticks between, in a steady turn: until the tenth, 18 s after the
    first, 16 s are worth 14.1 deg at 0.88 deg/s and 15.2 deg at 0.95 deg/s."""
    for rate_deg_s, is_found in ((0.88, False), (0.95, True)):
        monitor, rate = Frozen(), math.radians(rate_deg_s)
        for tick in range(289):
            now = 0.0625 * tick
            if tick % 32 == 0:
                monitor.on_sample(HeadingSample(now, 0.3))
            found = monitor.is_frozen(watched(now, 0.3, rate / 0.2, rate))
        assert found is is_found


HOP = 0.25
"""Radians, to the bit, that no boat turns further between two headings."""


@SIDES
@pytest.mark.parametrize(
    ("headings", "is_said"),
    [
        ([(0.0, 0.0), (0.5, HOP), (1.0, HOP), (1.5, HOP)], False),
        ([(0.0, 0.0), (0.5, 0.251), (1.0, 0.251), (1.5, 0.251)], True),
        ([(0.0, 0.0), (1.0, 0.5), (1.25, 0.5), (1.5, 0.5)], True),
        ([(0.0, 0.0), (1.0, 0.5), (1.25, 0.5), (1.4375, 0.5)], False),
        ([(0.0, 0.0), (1.0, 0.5), (2.0, 0.5)], False),
        ([(0.0, 0.0), (2.0, 0.5), (2.25, 0.5), (2.5, 0.5)], True),
        ([(0.0, 0.0), (2.0625, 0.5), (2.25, 0.5), (2.625, 0.5)], False),
        ([(0.0, 0.0), (0.0, 0.5), (0.25, 0.5), (0.5, 0.5)], True),
        ([(1.0, 0.0), (0.9375, 0.5), (1.25, 0.5), (1.5, 0.5)], False),
        ([(0.0, 0.0), (1.0, 0.5), (1.25, 0.75), (1.5, 1.0)], True),
        ([(0.0, 0.0), (1.0, 0.5), (1.25, 0.76), (1.5, 0.76)], False),
        ([*((float(n), 0.5 * (n in (1, 5))) for n in range(11)), (10.9375, 0.5)], True),
        ([*((float(n), 0.5 * (n in (1, 5))) for n in range(11)), (11.0, 0.5)], False),
    ],
)
def test_what_is_a_jump_to_the_bit(side: float, headings: list[tuple[float, float]], is_said: bool) -> None:
    monitor = Jumping(HOP)
    for time, heading in headings:
        monitor.on_sample(HeadingSample(time, side * heading))
    last = headings[-1][0]
    for later, is_yet in ((0.0, True), (4.9375, True), (5.0, False), (-0.0625, False)):
        assert (monitor.found(watched(last + later)) != "") is (is_said and is_yet)


@SIDES
@pytest.mark.parametrize(
    ("step", "rate_age", "is_said"),
    [(2.0, None, True), (2.0625, None, False), (2.0, 2.0, True), (2.0, 2.0625, False), (1.0, -0.0625, False)],
)
def test_a_rate_goes_with_a_heading_for_two_seconds(side: float, step: float, rate_age: float, is_said: bool) -> None:
    monitor = consistency(0.01)
    for number in range(4):
        now, rate = step * number, side * 0.5
        if rate_age is not None:
            monitor.update(RateSample(now - rate_age, rate))
        monitor.update(HeadingSample(now, 0.0, rate if rate_age is None else None))
    assert (monitor.found != "") is is_said


def test_rate_and_heading_that_disagree_alarm_after_a_second_for_twenty() -> None:
    monitor, said = Consistency(), []
    for tick in range(100):
        now = 0.25 * tick
        # the difference begins at 0.25 s, and nobody asks for it after 1.25 s
        monitor = consistency_step(monitor, HeadingSample(now, 0.0, 0.5), 0.01 if now <= 1.25 else 99.0)
        if monitor.found:
            said.append(now)
    assert (said[0], said[-1]) == (1.25, 21.0)


@SIDES
@pytest.mark.parametrize(
    ("error", "limit", "is_off", "wanted"),
    [
        (0.25, 0.25, False, (False, False)),
        (0.2500001, 0.25, False, (True, False)),
        (0.175, 0.25, True, (False, False)),
        (0.1750001, 0.25, True, (True, True)),
        (math.nan, 0.25, False, (True, False)),
    ],
)
def test_what_is_off_course_to_the_bit(
    side: float, error: float, limit: float, is_off: bool, wanted: tuple[bool, bool]
) -> None:
    limits = AlarmLimits(off_course=limit, off_course_time=8.0)
    before = (4.0, math.nan, side, True) if is_off else ON_HEADING
    away = course_step(limits, 1.0, before, 11.0, side * error)
    since, back, _, found = away
    assert (not math.isnan(since) and math.isnan(back), found) == (wanted[0], is_off or wanted[1])
    if not math.isnan(since) and not is_off:
        assert since == 11.0
        assert [course_step(limits, 1.0, away, now, side * error)[3] for now in (18.9375, 19.0)] == [False, True]
    if not math.isnan(back):
        assert back == 11.0
        assert [course_step(limits, 1.0, away, now, 0.0)[3] for now in (14.9375, 15.0)] == [True, False]


@SIDES
def test_ten_degrees_more_to_the_bit_are_no_news_yet(side: float) -> None:
    monitor, ten = off_course(AlarmLimits(off_course=0.1, off_course_time=0.0)), math.radians(10.0)
    for now, error in ((0.0, ten), (1.0, ten), (2.0, 2.0 * ten)):
        monitor.update(watched(now, side * error))
    assert words(monitor.found).startswith("off heading by 10 deg")
    monitor.update(watched(3.0, side * (2.0 * ten + 1e-9)))
    assert words(monitor.found).startswith("off heading by 20 deg")
    heel = Monitors(AlarmLimits(roll=0.1))
    for now, roll in ((0.0, ten), (2.0, ten), (3.0, 2.0 * ten)):
        heel.on_samples((RollSample(now, side * roll),))
    heel.update(watched(3.0))
    assert words(heel.findings["roll"]).startswith("heeling 10 deg")


def test_a_heading_that_is_no_number_turns_nothing() -> None:
    """Of a boat that turns against its rudder: what is between two headings is not known, and counts as nothing."""
    monitor = runaway()
    for tick, heading in enumerate((0.0, -0.1, math.nan, -0.2, -0.3)):
        monitor.update(watched(1.0 * tick, heading, STOP, -0.1))
        assert monitor.overpowered == ""
    monitor.update(watched(5.0, -0.46, STOP, -0.1))
    assert monitor.overpowered == "to port", "0.36 rad are more than 20 deg"


@SIDES
@pytest.mark.parametrize(
    ("seconds", "turned", "far"), [(2.0, 0.375, True), (1.9375, 0.375, False), (2.0, math.radians(20.0) - 1e-9, False)]
)
def test_a_rudder_takes_hold_in_a_time_constant_to_the_bit(
    side: float, seconds: float, turned: float, far: bool
) -> None:
    monitor = runaway()
    for now, heading in ((0.0, 0.0), (1.0, 0.5 * turned), (seconds, turned)):
        monitor.update(watched(now, -side * heading, side * STOP, -side * 0.1))
    assert (monitor.overpowered != "") is far


@SIDES
@pytest.mark.parametrize(
    ("zigzag_divergence", "rate", "has_run"), [(45.0, -0.1, False), (45.001, -0.1, True), (60.0, 0.0, False)]
)
def test_a_zigzag_has_diverged_beyond_45_degrees(
    side: float, zigzag_divergence: float, rate: float, has_run: bool
) -> None:
    monitor = runaway()
    monitor.update(
        watched(0.0, 0.0, side * 0.1, side * rate)._replace(zigzag_divergence=math.radians(zigzag_divergence))
    )
    assert monitor.has_run is has_run


@SIDES
def test_in_waves_the_mean_rate_is_one_over_longer(side: float) -> None:
    """2 deviations of 5 deg over a fifth of K delta_max, 6 deg/s, are 8.33 s: four fifths are reached after ln 5 of it,
    13.4 s, where the boat turns as for the rudder at its other stop."""
    for seconds, has_run in ((13.2, False), (13.6, True)):
        assert ran(side, 1.0, seconds, 6.0 * seconds, math.radians(5.0))[0] is has_run


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_turn_that_leads_far_past_its_course_is_off_it_before_its_time_is_over(side: float) -> None:
    """On its way to the course nothing is said, past it by the limit for two seconds is."""
    limits = AlarmLimits(off_course=math.radians(20.0), off_course_time=10.0)
    for past_deg, is_said in ((-80.0, False), (19.0, False), (21.0, True), (120.0, False)):
        monitor = off_course(limits, side)
        for tick in range(31):
            seen = watched(0.1 * tick, heading=side * math.radians(past_deg))
            found = monitor.update(seen._replace(holds_course=False, follows=True)).found
            if tick < 20:
                assert found is None
        assert (found is not None) is is_said


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("ordered_deg", "is_said"), [(0.0, True), (1.0, False)])
def test_a_turn_that_swings_to_both_sides_is_off_its_course(side: float, ordered_deg: float, is_said: bool) -> None:
    """Past its course for 1.9 s and then as far short of it; where it is short of another course it turns to that."""
    monitor = off_course(AlarmLimits(off_course=math.radians(20.0), off_course_time=10.0), side)
    found = []
    for tick in range(31):
        past = -80.0 if tick < 1 else 21.0 if tick < 20 else 5.0 if tick < 25 else -21.0
        seen = watched(0.1 * tick, heading=side * math.radians(past))
        seen = seen._replace(holds_course=False, follows=True)
        if tick >= 25:
            seen = seen._replace(wanted=side * math.radians(ordered_deg))
        found.append(monitor.update(seen).found)
    assert [each is not None for each in found] == [False] * 25 + [is_said] * 6
