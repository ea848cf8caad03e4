"""Swings from stop to stop, circles and a spin, each at both sides of its limits, to port and to starboard."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest
from watches import circles, spin, swings

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin, steady_rate
from autopilot.signals import NavState
from autopilot.supervision.course_watch import (
    LATER,
    NO_SWINGS,
    STOP_TO_STOP,
    ByRudder,
    Spin,
    goes_round,
    is_quicker,
    widest_swing,
)
from autopilot.supervision.monitor_input import MonitorInput, speed_ratio
from autopilot.supervision.tuning import BY_RUDDER, CIRCLES, HALF_SWINGS, SUSPECT_SWINGS, SWEEP

BOAT = Norrbin(0.2, 2.0, n3=1.0, reference_speed=4.0)
STOP = 0.5
DT = 0.1
SIDES = pytest.mark.parametrize("side", [-1.0, 1.0])


def watched(
    now: float, heading: float, rudder: float = 0.0, wanted: float = 0.0, model: Norrbin = BOAT
) -> MonitorInput:
    # a rate that goes with the heading is one that some boat's rudder accounts for
    state = NavState(now, wrap(heading), heading, 4.0, rudder, 0.0, 0.0, True)
    return MonitorInput(now, model, state, True, True, wrap(wanted), rudder, STOP, True, follows=True)


def spun(rate: float, rudder: float, seconds: float = 20.0, model: Norrbin = BOAT, trial: float = 0.0) -> float:
    """What is said in the end of a boat that turns at `rate`."""
    spinning = spin()
    for tick in range(round(seconds / DT)):
        at = watched(tick * DT, rate * tick * DT, rudder, model=model)
        spinning.update(at._replace(trial_speed=trial))
    return spinning.rate if spinning.is_fast else 0.0


@SIDES
@pytest.mark.parametrize("model", [BOAT, BOAT._replace(n3=0.0), BOAT._replace(n2=0.3)])
def test_a_spin_is_a_rate_beyond_three_times_the_quickest_turn(side: float, model: Norrbin) -> None:
    quickest = steady_rate(model, side * STOP)
    assert spun(3.03 * quickest, side * STOP, model=model) == pytest.approx(3.03 * quickest, rel=1e-3)
    assert spun(2.97 * quickest, side * STOP, model=model) == 0.0
    assert spun(3.03 * quickest, side * 0.01, model=model) != 0.0, "to the rudder's side, however far that is over"
    assert spun(3.03 * quickest, -side * 0.01, model=model) == 0.0
    assert spun(3.03 * quickest, 0.0, model=model) == 0.0


@pytest.mark.parametrize(("time_constant", "tau"), [(2.0, 1.0), (3.0, 1.0), (5.0, 1.5), (10.0, 3.0)])
def test_the_rate_is_a_mean_over_a_second_or_part_of_the_time_constant(time_constant: float, tau: float) -> None:
    model = BOAT._replace(time_constant=time_constant)
    for seconds in (2.0, 5.0):
        steps = round(seconds / DT) - 1
        assert spun(2.0, 0.3, seconds, model) == pytest.approx(2.0 * (1.0 - math.exp(-steps * DT / tau)), rel=1e-9)


@pytest.mark.parametrize(("trial", "allowed"), [(0.0, 1.0), (4.0, 1.0), (6.0, 1.5), (2.0, 1.0)])
def test_a_speed_below_the_trial_s_makes_no_turn_too_fast(trial: float, allowed: float) -> None:
    """By Norrbin's scaling the steady turn of a linear boat goes with the speed: K V/L."""
    model = BOAT._replace(n3=0.0)
    quickest = 3.0 * allowed * steady_rate(model, STOP)
    assert spun(1.02 * quickest, STOP, 20.0, model, trial) > 0.0
    assert spun(0.98 * quickest, STOP, 20.0, model, trial) == 0.0
    assert speed_ratio(watched(0.0, 0.0, model=model)._replace(trial_speed=trial)) == (4.0 / trial if trial else 1.0)


def test_the_turn_count_is_reset_when_another_steers() -> None:
    spinning = spin()
    for tick in range(100):
        assert spinning.update(watched(tick * DT, 2.0 * tick * DT, 0.3)).is_fast is (tick > 1)
    assert not spinning.update(watched(9.9, 2.0 * 9.9, 0.3)).is_fast, "no time has passed"
    assert spinning.update(watched(10.0, 2.0 * 10.0, 0.3)).rate == pytest.approx(2.0, rel=1e-3)
    assert spinning.is_fast
    assert spinning.update(watched(10.1, 2.0 * 10.1, 0.3)._replace(steers=False)) == Spin(True, 0.0, speed_ratio=1.0)
    assert not spinning.update(watched(10.2, 2.0 * 10.2, 0.3)).is_fast, "it begins anew"


def circled(turned: float, side: float, **change: float) -> bool:
    """Whether it is said once the boat has turned so far [rad] at 0.2 rad/s, from the heading ordered on."""
    circling, found, steps = circles(), False, round(turned / 0.02)
    for tick in range(steps + 1):
        at = watched(tick * DT, side * turned * tick / steps)._replace(**change)  # type: ignore[arg-type]
        found = goes_round(circling.update(at), is_doubted=False)
    return found


@SIDES
def test_a_whole_turn_and_30_degrees_are_going_round(side: float) -> None:
    assert math.degrees(CIRCLES) == pytest.approx(390.0)
    assert circled(1.01 * CIRCLES, side)
    assert not circled(0.99 * CIRCLES, side)
    assert circled(1.01 * CIRCLES, side, push=STOP)
    assert not circled(1.01 * CIRCLES, side, push=1.01 * STOP), "more than its rudder pushes the boat round"
    assert not circled(1.01 * CIRCLES, side, push=-1.01 * STOP)
    assert circled(1.01 * CIRCLES, side, push=2.0 * STOP, trial_speed=6.0), "a push learnt with a wrong speed is none"
    assert not circled(1.01 * CIRCLES, side, push=2.0 * STOP, trial_speed=4.9)
    assert not circled(2.0 * CIRCLES, side, follows=False)


@SIDES
def test_circles_count_only_turns_that_no_order_leads(side: float) -> None:
    led, against = circles(), circles()
    for tick in range(1000):
        turned = side * 0.02 * tick
        assert not goes_round(led.update(watched(tick * DT, turned, wanted=turned - side * 0.3)), is_doubted=False)
        found = goes_round(against.update(watched(tick * DT, turned, wanted=-turned)), is_doubted=False)
        assert found is (2.0 * abs(turned) > CIRCLES)


@pytest.mark.parametrize(("time_constant", "needed"), [(0.5, 4.0), (2.0, 8.0)])
@pytest.mark.parametrize("off_deg", [-9.9, 9.9])
def test_a_boat_that_was_on_its_course_for_long_has_not_gone_round(
    time_constant: float, needed: float, off_deg: float
) -> None:
    """A whole turn, then near the course for so long, then another whole turn: 720 degrees only if it counts on."""
    model, off = BOAT._replace(time_constant=time_constant), math.radians(off_deg)
    for stays, is_round in ((needed - 1.4, True), (needed + 0.3, False)):
        circling, now, found = circles(), 0.0, False
        legs = [
            (0.3, math.tau + off, 8.0),
            (math.tau + off, math.tau + off, stays),
            (math.tau + off, 3.4 * math.pi, 8.0),
        ]
        for start, end, seconds in legs:
            for tick in range(round(seconds / DT)):
                heading = start + (end - start) * tick * DT / seconds
                now += DT
                found = goes_round(circling.update(watched(now, heading, model=model)), is_doubted=False)
        assert found is is_round


@dataclass
class Swinging:
    """A rudder that goes from side to side as a triangle, and a heading that swings as far, a quarter behind."""

    sweep: float = 2.0 * STOP
    swing: float = math.radians(20.0)
    lasts: float = 4.0
    side: float = 1.0

    def at(self, now: float, model: Norrbin = BOAT) -> MonitorInput:
        order = self._triangle(now / self.lasts) * 0.5 * self.sweep
        heading = self._triangle(now / self.lasts - 0.5) * 0.5 * self.swing
        return watched(now, self.side * heading, self.side * order, model=model)

    @staticmethod
    def _triangle(phase: float) -> float:
        return 4.0 * abs(0.5 * (phase + 1.5) - math.floor(0.5 * (phase + 1.5) + 0.5)) - 1.0


@SIDES
def test_the_first_rudder_of_a_turn_is_no_sweep(side: float) -> None:
    count = swings(SWEEP)
    for tick in range(100):
        order, heading = side * min(0.01 * tick, 0.8) * STOP, side * math.radians(0.3) * tick
        assert count.update(watched(tick * DT, heading, order)).sweeps == 0


def counted(boat: Swinging, seconds: float = 60.0, sweep: float = SWEEP, model: Norrbin = BOAT) -> int:
    count, most = swings(sweep), 0
    for tick in range(round(seconds / DT)):
        most = max(most, count.update(boat.at(tick * DT, model)).sweeps)
    return most


@SIDES
def test_a_swing_from_stop_to_stop_is_counted_sweep_by_sweep(side: float) -> None:
    assert counted(Swinging(side=side), 60.0) >= 12
    assert HALF_SWINGS <= counted(Swinging(side=side), 34.0) <= 8, "4 s each, and the first is no swing yet"
    for sweep in (SWEEP, STOP_TO_STOP):
        assert counted(Swinging(side=side, sweep=1.1 * sweep * STOP), sweep=sweep) >= HALF_SWINGS
        assert counted(Swinging(side=side, sweep=0.98 * sweep * STOP), sweep=sweep) == 0


@pytest.mark.parametrize(("sweep", "is_counted"), [(SWEEP, False), (STOP_TO_STOP, True)])
def test_from_stop_to_stop_neither_the_swing_nor_its_time_matters(sweep: float, is_counted: bool) -> None:
    """A course-unstable boat in gusts: 4.5 and 1.9 s to the two sides, and 5 to 35 deg."""
    count, now, heading, most = swings(sweep), 0.0, 0.0, 0
    for number, (lasts, far) in enumerate([(4.5, 35.0), (1.9, 5.0), (4.0, 15.0), (2.0, 20.0), (4.9, 8.0), (1.9, 30.0)]):
        side = 1.0 if number % 2 == 0 else -1.0
        for _ in range(round(lasts / DT)):
            now, heading = now + DT, heading + side * math.radians(far) * DT / lasts
            most = max(most, count.update(watched(now, heading, side * STOP)).sweeps)
    assert (most >= SUSPECT_SWINGS) is is_counted


@pytest.mark.parametrize(("change", "goes_on"), [({"waits": True}, True), ({"waits": True, "steers": False}, False)])
def test_a_rudder_that_waits_for_way_is_a_part_of_the_swing(change: dict[str, bool], goes_on: bool) -> None:
    """A log that reads too low shows no way at all where hard rudder has taken some of it."""
    count, boat = swings(STOP_TO_STOP), Swinging()
    before = [count.update(boat.at(tick * DT)).sweeps for tick in range(300)][-1]
    assert before >= SUSPECT_SWINGS
    after = count.update(boat.at(30.0)._replace(follows=False, **change)).sweeps  # type: ignore[arg-type]
    assert after == (before if goes_on else 0)


@pytest.mark.parametrize(("read", "answers", "is_found"), [(0.5, 4.0, True), (0.5, 1.9, False), (0.8, 1.1, False)])
def test_a_boat_that_answers_as_at_the_trial_s_speed_contradicts_the_log(
    read: float, answers: float, is_found: bool
) -> None:
    """At half the speed K/T is a quarter; the mean that parts the two is twice what the log lets expect."""
    count, rate, heading, found = swings(STOP_TO_STOP), 0.0, 0.0, set()
    for tick in range(300):
        order = STOP * (1.0 if tick // 40 % 2 == 0 else -1.0)
        rate += DT * (answers * BOAT.gain * order - rate) / BOAT.time_constant
        heading += DT * rate
        at = watched(tick * DT, heading, order)._replace(trial_speed=BOAT.reference_speed / read)
        throws = count.update(at._replace(state=at.state._replace(rate=rate)))
        if is_quicker(throws, at):
            found.add(throws.sweeps)
    assert (min(found, default=0) == 3) is is_found


@pytest.mark.parametrize(("pushes", "makes"), [(0.0, True), (0.1, True), (0.6, False)])
@pytest.mark.parametrize("delay", [0.0, 0.8])
def test_swings_that_the_rudder_does_not_account_for_are_none_of_steering_s(
    pushes: float, makes: bool, delay: float
) -> None:
    """A boat of five times the gain under a rudder that goes to and fro, and a sea beside it."""
    count, rate, heading, most, shares = swings(SWEEP), 0.0, 0.0, 0, ByRudder()
    for tick in range(900):
        now = tick * DT
        order, late = (0.4 * STOP * math.sin(math.pi * then / 6.0) for then in (now, now - delay))
        sea = pushes * math.sin(2.3 * now) * math.sin(0.13 * now)
        rate += DT * ((late + sea) - rate) / 2.0
        heading += DT * rate
        at = watched(now, heading, order)
        at = at._replace(state=at.state._replace(rate=rate))
        shares = shares.with_tick(DT, DT * rate, (order,) * len(LATER), rate)
        most = max(most, count.update(at).sweeps)
    assert (shares.fit()[0] >= BY_RUDDER) is makes
    assert (most >= SUSPECT_SWINGS) is makes


@pytest.mark.parametrize(("pushes", "makes"), [(0.0, True), (0.1, False)])
@SIDES
def test_thrust_that_comes_late_makes_quick_swings_from_stop_to_stop(side: float, pushes: float, makes: bool) -> None:
    """A boat of T = 0.8 s behind 0.45 s and a lag of 0.15 s: what it does is its rudder's of then, not its rudder's of
    now, and a sea beside it is neither."""
    count, rate, heading, rudder, most, shares = swings(STOP_TO_STOP), 0.0, 0.0, 0.0, 0, ByRudder()
    model, h, orders = BOAT._replace(gain=2.4, time_constant=0.95), 0.05, [0.0] * 25
    for tick in range(400):
        now = tick * h
        orders.append(side * STOP * (1.0 if now % 4.0 < 2.0 else -1.0))
        rudder += h / 0.15 * (orders[-1 - 9] - rudder)
        rate += h * (2.9 * (rudder + pushes * math.sin(2.3 * now)) - rate) / 0.8
        heading += h * rate
        at = watched(now, heading, orders[-1], model=model)
        at = at._replace(state=at.state._replace(rate=rate))
        shares = shares.with_tick(h, h * rate, tuple(orders[-1 - round(later / h)] for later in LATER), rate)
        most = max(most, count.update(at).sweeps)
    assert shares.fit()[0] < BY_RUDDER, "it is not the order of now"
    assert (most >= SUSPECT_SWINGS) is makes


def test_a_boat_that_does_not_turn_has_nothing_to_account_for() -> None:
    shares = ByRudder()
    assert not shares.accounts()
    for tick in range(10):
        shares = shares.with_tick(DT, 0.0, (0.1 * tick,) * len(LATER), 0.0)
    assert not shares.accounts()


@SIDES
def test_a_heading_that_swings_less_than_ten_degrees_is_a_quick_boat_in_a_sea(side: float) -> None:
    assert counted(Swinging(side=side, swing=math.radians(10.3))) >= HALF_SWINGS
    assert counted(Swinging(side=side, swing=math.radians(9.7))) == 0


@pytest.mark.parametrize(("time_constant", "is_own"), [(2.0, True), (15.2, True), (16.8, False)])
def test_sweeps_quicker_than_a_quarter_of_a_time_constant_are_not_the_boat_s(
    time_constant: float, is_own: bool
) -> None:
    model = BOAT._replace(time_constant=time_constant)
    assert (counted(Swinging(), model=model) >= HALF_SWINGS) is is_own


@pytest.mark.parametrize(("lasts", "worth"), [(7.7, 1), (8.0, 2)])
def test_a_swing_beyond_three_times_what_the_rudder_can_make_counts_for_two(lasts: float, worth: int) -> None:
    """8/pi K 0.5 rad/(w |1 + i w T|), w = pi/lasts; half the longest wave's period is 7.85 s, and quicker swings may be
    a sea's."""
    widest = widest_swing(BOAT, STOP, lasts)
    pace = math.pi / lasts
    assert widest == pytest.approx(8.0 / math.pi * 0.2 * STOP / (pace * math.hypot(1.0, 2.0 * pace)))
    far, near = (counted(Swinging(swing=share * 3.0 * widest, lasts=lasts), 60.0) for share in (1.1, 0.9))
    assert far == worth * near - (worth - 1), "the first of them is not like the one before"


@pytest.mark.parametrize(("grows", "goes_on"), [(1.0, True), (1.7, True), (2.9, True), (3.2, False), (0.5, False)])
def test_swings_that_grow_are_one_cycle_and_others_are_not(grows: float, goes_on: bool) -> None:
    count, turned, most = swings(SWEEP), 0.0, 0
    boat = BOAT._replace(gain=20.0)
    for sweep in range(7):
        swing = math.radians(12.0) * grows**sweep if grows >= 1.0 else math.radians(600.0) * grows**sweep
        for tick in range(40):
            now, side = 4.0 * sweep + tick * DT, (-1.0) ** sweep
            turned += side * min(swing, math.radians(4000.0)) / 40.0
            most = max(most, count.update(watched(now, turned, side * STOP, model=boat)).sweeps)
    assert (most >= 4) is goes_on


@SIDES
def test_a_boat_that_rushes_turns_twice_and_one_that_outruns_its_speed_half_again_as_fast(side: float) -> None:
    """At a third of the trial's speed K and the steady turn of a linear boat are a third."""
    slow = BOAT._replace(n3=0.0)
    for rate, trial, rushes, outruns in (
        (2.05 * 0.1, 4.0, True, True),
        (1.95 * 0.1, 4.0, False, True),
        (1.55 * 0.1, 12.0, False, True),
        (1.45 * 0.1, 12.0, False, False),
        (6.05 * 0.1, 12.0, True, True),
    ):
        spinning = spin()
        for tick in range(200):
            at = watched(tick * DT, side * rate * tick * DT, side * STOP, model=slow)._replace(trial_speed=trial)
            spinning.update(at)
        assert (spinning.rushes, spinning.outruns_speed) == (rushes, outruns), (rate, trial)


@SIDES
@pytest.mark.parametrize(
    ("rate", "turns", "trial", "rushes"),
    [
        # the largest of a day's waves: sqrt(2 ln(86400/15.7)) = 4.150 standard deviations, here of 0.05 * 0.8 rad/s
        (0.2 + 4.1 * 0.04, True, 0.0, False),
        (0.2 + 4.2 * 0.04, True, 0.0, True),
        (0.2 + 4.1 * 0.04, False, 0.0, True),
        (0.275 + 0.5 * 0.04, True, 5.5, True),
    ],
)
def test_what_the_sea_before_a_turn_may_do_is_no_rush(
    side: float, rate: float, turns: bool, trial: float, rushes: bool
) -> None:
    """A launch in sea state 5 was turned at 12 deg/s by a wave, twice what its rudder does: it was said to hunt."""
    spinning, boat = spin(), BOAT._replace(n3=0.0)
    for tick in range(400):
        # the sea is what it was when the heading was ordered, not what a boat that rushes makes of it afterwards
        wanted, swing = (0.3, 0.05) if turns and tick == 200 else (0.3 if turns and tick > 200 else 0.0, 0.0)
        at = watched(tick * DT, side * rate * max(tick - 200, 0) * DT, side * STOP, side * wanted, boat)
        state = at.state._replace(wave_deviation=swing, wave_frequency=0.8)
        spinning.update(at._replace(state=state, trial_speed=trial))
    assert spinning.rushes is rushes


@pytest.mark.parametrize(("n1", "found"), [(1.0, False), (-1.0, True)])
def test_only_a_course_unstable_boat_outruns_its_rudder_against_it(n1: float, found: bool) -> None:
    spinning, model = spin(), BOAT._replace(n1=n1, n3=20.0)
    for tick in range(200):
        spinning.update(watched(tick * DT, 0.6 * tick * DT, -STOP, model=model))
    assert spinning.outruns_speed is found
    assert not spinning.rushes


@pytest.mark.parametrize(("lasts", "counts"), [(39.7, True), (40.4, False)])
def test_a_sweep_that_comes_late_begins_anew(lasts: float, counts: bool) -> None:
    """10 s and 15 time constants of 2 s are 40 s."""
    assert (counted(Swinging(lasts=lasts), 12.0 * lasts) >= HALF_SWINGS) is counts


def test_a_new_order_and_another_s_hand_begin_anew() -> None:
    for angle_deg, goes_on in ((4.9, True), (-4.9, True), (5.1, False), (-5.1, False)):
        count, boat = swings(SWEEP), Swinging()
        before = [count.update(boat.at(tick * DT)).sweeps for tick in range(300)][-1]
        turned = boat.at(30.0)._replace(wanted=math.radians(angle_deg))
        assert before >= HALF_SWINGS
        assert count.update(turned).sweeps == (before if goes_on else 0)
        assert count.update(boat.at(30.1)._replace(follows=False)) == NO_SWINGS
        assert count.update(boat.at(30.2)).sweeps == 0


def swept(ratio: float, *, grows: str) -> int:
    """Sweeps in a row of which each lasts, or swings the heading, so many times as much as the one before; the boat is
    one that can swing so far."""
    model = BOAT._replace(gain=20.0)
    count, now, order, heading, most = swings(SWEEP), 0.0, -STOP, 0.0, 0
    for number in range(8):
        power = ratio**number if ratio >= 1.0 else ratio ** (number - 7)
        lasts = 1.5 * power if grows == "time" else 4.0
        far = math.radians(12.0) * power if grows == "swing" else math.radians(30.0)
        side = 1.0 if number % 2 == 0 else -1.0
        start_order, start_heading = order, heading
        for tick in range(1, 201):
            share = tick / 200
            order = start_order + share * (side * STOP - start_order)
            heading = start_heading + share * (side * far - start_heading)
            most = max(most, count.update(watched(now + share * lasts, heading, order, model=model)).sweeps)
        now += lasts
    return most


@pytest.mark.parametrize("ratio", [1.0, 1.3, 1.55, 1.0 / 1.3, 1.0 / 1.55])
def test_sweeps_within_a_factor_of_1_6_are_one_swing(ratio: float) -> None:
    assert swept(ratio, grows="time") >= 5
    assert swept(min(max(ratio, 1.0 / 1.1), 1.3), grows="swing") >= 5


@pytest.mark.parametrize("ratio", [1.0 / 1.3, 1.0 / 1.55])
def test_swings_that_die_away_are_no_limit_cycle(ratio: float) -> None:
    """Of a turn in sea state 5: 35, 21, 18 and 15 deg."""
    assert swept(ratio, grows="swing") < SUSPECT_SWINGS


@pytest.mark.parametrize("ratio", [1.66, 2.0, 1.0 / 1.66, 0.5])
def test_sweeps_that_last_longer_or_less_long_by_more_are_a_sea_s(ratio: float) -> None:
    """The first swing, from the course to one side, may be half the second."""
    assert swept(ratio, grows="time") <= 2 < SUSPECT_SWINGS
