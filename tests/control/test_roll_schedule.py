"""The schedule of the roll law: what it foresees is what happens, and it stays off where roll would grow."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from naval_vessel import linear_motion
from scipy.linalg import expm

from autopilot.control.rudder_roll import (
    AT_REST,
    PAPER_ROLL,
    PROOF,
    RATE_SMOOTH,
    SETTLE,
    UNPROVEN,
    WEAKEST,
    WORKED,
    Measured,
    Motion,
    Proof,
    RateGain,
    RollSchedule,
    ScheduleParts,
    ScheduleSettings,
    Shadow,
    begin_schedule,
    blended_rudder,
    damping_rudder,
    linear_response,
    linear_step_of,
    measured_with,
    proof_step,
    rate_gain_step,
    rate_share,
    roll_law,
    roll_reduction,
    roll_rudder,
    schedule_step,
    short_beyond,
    strength_step,
)
from autopilot.control.sliding_heading import SwayYawGains, sway_yaw_rudder
from autopilot.control.sliding_roll import quiet_at
from autopilot.models.steering_gear import SteeringGear, gear_step
from sitl.roll_ship import NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED

SHIP = linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
DT = 0.1
STEP = linear_step_of(SHIP, DT)
GEAR = SteeringGear(math.radians(40.0), math.radians(20.0), 0.1)
LAW = roll_law(SHIP, PAPER_ROLL)
REST = Motion(0.0, 0.0, 0.0, 0.0, 0.0)
SETTINGS = ScheduleSettings()
QUIET = quiet_at(SHIP, SwayYawGains(0.05, 5.5, 0.11, 1.62))
PARTS = ScheduleParts(SETTINGS, QUIET, LAW, GEAR, STEP)


def sailed(frequency: float, seconds: float, steers: bool, moment: float = 0.01) -> tuple[RollSchedule, list[float]]:
    """A linear ship in a swell of one frequency [rad/s] that heels it; the schedule's weight decides who steers."""
    state, schedule, rudder, roll = REST, begin_schedule(), 0.0, []
    for index in range(round(seconds / DT)):
        schedule = schedule_step(PARTS, schedule, state, 0.0, rudder, DT)
        weight = schedule.weight if steers else 0.0
        rudder = gear_step(GEAR, rudder, blended_rudder(weight, 0.0, roll_rudder(LAW, state, 0.0)), DT)
        state = linear_response(STEP, state, rudder)
        state = state._replace(p=state.p + DT * moment * math.sin(frequency * index * DT))
        roll.append(state.phi)
    return schedule, roll


def test_near_the_natural_frequency_it_switches_on_and_foresaw_how_much_it_helps() -> None:
    free, without = sailed(1.1, 450.0, steers=False)
    used, with_law = sailed(1.1, 450.0, steers=True)
    assert used.weight == 1.0
    last = slice(-2000, None)
    reduction = 1.0 - np.std(with_law[last]) / np.std(without[last])
    assert reduction > 0.3
    # both knew it, the one that never turned it on and the one that did
    assert roll_reduction(free) == pytest.approx(reduction, abs=0.02)
    assert roll_reduction(used) == pytest.approx(reduction, abs=0.02)


@pytest.mark.parametrize("frequency", [0.25, 0.45])
def test_at_the_frequencies_of_stern_quartering_seas_it_stays_off(frequency: float) -> None:
    used, _ = sailed(frequency, 450.0, steers=True)
    assert used.weight == 0.0
    assert roll_reduction(used) < SETTINGS.none


def test_it_switches_off_when_the_sea_comes_round() -> None:
    """Six minutes of roll near its natural frequency, then of a swell near the zero: the weight goes to 1 and back."""
    state, schedule, rudder, weights = REST, begin_schedule(), 0.0, []
    for index in range(8000):
        schedule = schedule_step(PARTS, schedule, state, 0.0, rudder, DT)
        demand = blended_rudder(schedule.weight, 0.0, roll_rudder(LAW, state, 0.0))
        rudder = gear_step(GEAR, rudder, demand, DT)
        frequency = 1.1 if index < 3500 else 0.42
        state = linear_response(STEP, state, rudder)
        state = state._replace(p=state.p + DT * 0.01 * math.sin(frequency * index * DT))
        weights.append(schedule.weight)
    assert weights[3499] == 1.0
    assert weights[-1] == 0.0
    assert np.max(np.abs(np.diff(weights))) <= SETTINGS.slew * DT + 1e-12


def test_nothing_is_decided_before_there_is_evidence() -> None:
    schedule, _ = sailed(1.1, SETTINGS.wait - 1.0, steers=True)
    assert schedule.weight == 0.0


def test_flat_water_asks_for_no_roll_law() -> None:
    schedule, _ = sailed(1.1, 200.0, steers=True, moment=0.0)
    assert schedule.weight == 0.0
    assert roll_reduction(schedule) == 0.0


def test_the_weight_blends() -> None:
    assert blended_rudder(0.0, 0.1, 0.5) == 0.1
    assert blended_rudder(1.0, 0.1, 0.5) == 0.5
    assert blended_rudder(0.25, 0.1, 0.5) == pytest.approx(0.2)


ROLL_TIME = 10.0


def looked_on(proof: Proof, weight: float, seconds: float, roll: float, promise: float = 0.0) -> Proof:
    """The proof after so long under one weight, the boat lying over by `roll` [rad] to either side in turn."""
    for index in range(round(seconds)):
        proof = proof_step(proof, weight, roll if index % 2 else -roll, promise, 1.0, ROLL_TIME)
    return proof


def judged(share: float, promise: float, proof: Proof = UNPROVEN, seconds: float = PROOF) -> Proof:
    """The proof after so long without the law and the time it takes to judge it, at `share` of the roll."""
    without = looked_on(proof, 0.0, SETTLE + seconds, 0.1)
    return with_law(without, SETTLE + without.span, 0.1 * share, promise)


def with_law(proof: Proof, seconds: float, roll: float, promise: float) -> Proof:
    """The proof after the weight went up over half a minute, and so long under its full weight."""
    return looked_on(looked_on(proof, 0.5, 30.0, roll), 1.0, seconds, roll, promise)


@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=60))
def test_what_is_measured_is_mean_and_variance_of_the_roll(rolls: list[float]) -> None:
    found = Measured()
    for place, roll in enumerate(rolls):
        found = measured_with(found, roll, 0.01 * place, 300.0, 0.5)
    assert found.time == pytest.approx(0.5 * len(rolls))
    assert found.mean == pytest.approx(np.mean(rolls), abs=1e-9)
    assert found.variance == pytest.approx(np.var(rolls), abs=1e-9)
    assert found.promise == pytest.approx(0.005 * (len(rolls) - 1))


def test_what_is_measured_forgets_with_its_memory() -> None:
    found = Measured(1000.0, 0.0, 0.04, 0.5)
    for _ in range(300):
        found = measured_with(found, 0.0, 0.0, 300.0, 1.0)
    assert found.variance / 0.04 == pytest.approx(math.exp(-1.0), rel=0.01)
    assert found.promise / 0.5 == pytest.approx(math.exp(-1.0), rel=0.01)


def test_the_roll_is_measured_when_what_was_before_a_switch_has_died_away() -> None:
    without = looked_on(UNPROVEN, 0.0, SETTLE, 0.1)
    assert without.without == Measured()
    without = looked_on(without, 0.0, 40.0, 0.1)
    assert without.without.time == 40.0 and without.without.variance == pytest.approx(0.01)
    started = looked_on(without, 0.5, 30.0, 9.0)
    assert started == without._replace(so_far=0.0), "while it goes over from the one to the other nothing is measured"
    under = looked_on(started, 1.0, SETTLE, 9.0)
    assert (under.so_far, under.under) == (SETTLE, Measured())
    under = looked_on(under, 1.0, 50.0, 0.2, 0.4)
    assert under.under.time == 50.0 and under.under.variance == pytest.approx(0.04)
    assert under.under.promise == pytest.approx(0.4) and under.without == without.without


@pytest.mark.parametrize("share", [0.5, 0.74])
def test_a_law_that_keeps_half_its_promise_stands_for_ten_minutes(share: float) -> None:
    found = judged(share, 0.5)
    assert (found.failures, found.barred, found.span, found.so_far) == (0, 0.0, 600.0, SETTLE)
    again = looked_on(found, 1.0, 599.0, 0.2, 0.5)
    assert again.failures == 0
    assert looked_on(again, 1.0, 1.0, 0.2, 0.5).failures == 1, "and then is judged by what it did meanwhile"


def test_a_shortfall_that_the_chance_of_the_sea_explains_is_no_shortfall() -> None:
    """Forty seconds without the law are four times the 10 s in which a roll is forgotten: a law that halves the roll
    shows 0.5 exp(2.33/2 sqrt(10/40 + 10/120)) = 0.98 of it once in a hundred times. After two minutes 0.81 are."""
    assert judged(0.96, 0.5, seconds=40.0)[3:] == (0, 0.0, 300.0)
    assert judged(1.0, 0.5, seconds=40.0)[3:] == (1, 120.0, PROOF)
    assert judged(0.8, 0.5)[3:] == (0, 0.0, 300.0)
    assert judged(0.82, 0.5)[3:] == (1, 120.0, PROOF)
    doubtful = judged(0.9, 0.5, seconds=40.0)
    assert looked_on(doubtful, 1.0, 300.0, 0.09, 0.5)[3:] == (0, 0.0, 300.0), "what was short stays short"
    kept = looked_on(doubtful, 1.0, 300.0, 0.02, 0.5)
    assert (kept.failures, kept.span) == (0, 600.0)
    assert judged(1.09, 0.1, seconds=40.0).failures == 0 and judged(1.11, 0.1, seconds=40.0).failures == 1
    small = proof_of(without=4000.0, under=4000.0)
    assert short_beyond(small, ROLL_TIME) == pytest.approx(0.75), "half of what was promised, where chance has no say"


def proof_of(without: float, under: float) -> Proof:
    return Proof(Measured(without, 0.0, 0.01, 0.0), Measured(under, 0.0, 0.0025, 0.5))


def test_a_law_that_makes_the_roll_grow_is_barred_for_two_minutes_and_then_for_ten() -> None:
    first = judged(1.1, 0.5)
    assert (first.failures, first.barred, first.span, first.so_far) == (1, 120.0, PROOF, 0.0)
    assert looked_on(first, 1.0, 30.0, 0.3) == first, "while its weight is taken back nothing is measured"
    halfway = looked_on(first, 0.0, 60.0, 0.1)
    assert halfway.barred == 60.0
    rested = looked_on(halfway, 0.0, 90.0, 0.1)
    assert rested.barred == 0.0
    second = with_law(rested, SETTLE + PROOF, 0.2, 0.5)
    assert (second.failures, second.barred) == (2, 600.0)
    better = judged(0.1, 0.5, looked_on(judged(1.01, 0.5), 0.0, 150.0, 0.1))
    assert (better.failures, better.span) == (0, 600.0), "over both times it kept its promise"


def test_on_flat_water_nothing_is_proven_and_nothing_is_held_against_it() -> None:
    found = with_law(looked_on(UNPROVEN, 0.0, 60.0, 0.0), SETTLE + PROOF, 0.0, 0.0)
    assert (found.failures, found.barred) == (0, 0.0)


def test_a_new_schedule_knows_nothing_and_steers_nothing() -> None:
    new = begin_schedule()
    assert (new.time, new.weight, new.own, new.proof) == (0.0, 0.0, REST, UNPROVEN)
    assert new.free == new.quiet == new.roll == Shadow(REST, 0.0, 0.0, 0.0)
    assert Proof(Measured(), Measured(), 0.0, 0, 0.0, PROOF) == UNPROVEN
    assert roll_reduction(new) == 0.0


def test_what_the_law_promises_is_against_the_better_of_the_two_others() -> None:
    new = begin_schedule()
    for free, quiet, roll, promise in ((4.0, 9.0, 1.0, 0.5), (9.0, 4.0, 1.0, 0.5), (1.0, 4.0, 4.0, -1.0)):
        shadows = [Shadow(REST, 0.0, 0.0, variance) for variance in (free, quiet, roll)]
        found = roll_reduction(new._replace(free=shadows[0], quiet=shadows[1], roll=shadows[2]))
        assert found == pytest.approx(promise)


def test_the_published_gains_are_those_of_the_paper() -> None:
    """Liu and Jin 2017, section 4: k = (-5, -200, -100, -10, 0) degrees per SI unit, the rudder positive to port."""
    law = roll_law(SHIP, PAPER_ROLL)
    k = [law.k_v, law.k_p, law.k_r, law.k_phi]
    assert [math.degrees(value) for value in k] == pytest.approx([5.0, 200.0, 100.0, 10.0])
    h = np.array([law.h_v, law.h_p, law.h_r, law.h_phi, law.h_psi])
    assert (law.switching * float(h @ SHIP.b), law.boundary) == pytest.approx((0.0751, 0.5))


def test_a_step_is_the_matrix_exponential_with_a_heading_that_leaks_in_five_minutes() -> None:
    block = np.zeros((6, 6))
    block[:5, :5], block[:5, 5] = SHIP.A, SHIP.b
    block[4, 4] -= 1.0 / 300.0
    for dt in (0.02, 0.1, 1.0):
        step = np.array(linear_step_of(SHIP, dt))
        assert step == pytest.approx(expm(block * dt)[:5], rel=1e-12, abs=1e-15)
    x = Motion(0.3, -0.02, 0.01, 0.2, 0.4)
    assert linear_response(STEP, x, 0.1) == pytest.approx(np.array(STEP) @ (*x, 0.1))


def test_each_shadow_steers_the_sea_that_is_left_without_the_ship_s_own_rudder() -> None:
    """One step in numbers: free = x - own; the shadows add what their own rudders did; variances with a share of
    dt/120 s, or of the time so far."""
    x, own = Motion(0.2, 0.03, 0.004, 0.1, 0.05), Motion(0.1, 0.01, 0.001, 0.02, 0.03)
    quiet, roll = Motion(0.01, 0.02, 0.003, 0.04, 0.005), Motion(-0.02, 0.01, 0.002, -0.03, 0.004)
    for time, share in ((39.9, 0.1 / 40.0), (500.0, 0.1 / 120.0)):
        before = begin_schedule()._replace(
            time=time,
            own=own,
            free=Shadow(REST, 0.0, 0.01, 0.004),
            quiet=Shadow(quiet, 0.02, 0.02, 0.005),
            roll=Shadow(roll, -0.03, 0.03, 0.003),
        )
        after = schedule_step(PARTS, before, x, 0.01, 0.07, DT)
        assert after.time == pytest.approx(time + 0.1)
        assert after.own == pytest.approx(np.array(STEP) @ (*own, 0.07))
        free = np.array(x) - np.array(own)
        for name, response, order in (
            ("free", np.zeros(5), lambda _: 0.0),
            ("quiet", np.array(quiet), lambda at: sway_yaw_rudder(QUIET, at[0], at[2], at[4] - 0.01)),
            ("roll", np.array(roll), lambda at: roll_rudder(LAW, Motion(*at), 0.01)),
        ):
            was, now = getattr(before, name), getattr(after, name)
            at = free + response
            assert now.rudder == pytest.approx(gear_step(GEAR, was.rudder, order(at), DT))
            assert now.response == pytest.approx(np.array(STEP) @ (*response, now.rudder))
            off = at[3] - was.mean
            assert now.mean == pytest.approx(was.mean + share * off)
            assert now.variance == pytest.approx(was.variance + share * (off * off - was.variance))


@pytest.mark.parametrize(
    ("promise", "weight", "time", "barred", "wanted"),
    [
        (0.04, 0.5, 99.0, 0.0, 0.5 - 0.125 / 30.0),
        (0.05, 0.002, 99.0, 0.0, 0.0),
        (0.10, 0.5, 99.0, 0.0, 0.5),
        (0.10, 0.499, 99.0, 0.0, 0.5),
        (0.14, 0.899, 99.0, 0.0, 0.9),
        (0.16, 0.5, 99.0, 0.0, 0.5 + 0.125 / 30.0),
        (0.16, 0.999, 99.0, 0.0, 1.0),
        (0.90, 1.0, 99.0, 0.0, 1.0),
        (0.90, 0.0, 59.875, 0.0, 0.0),
        (0.90, 0.0, 60.0, 0.0, 0.125 / 30.0),
        (0.90, 0.5, 99.0, 5.0, 0.5 - 0.125 / 30.0),
        (0.90, 0.0, 99.0, 0.2, 0.0),
        (0.90, 0.0, 99.0, 0.1, 0.125 / 30.0),
    ],
)
def test_the_weight_goes_with_the_promise_from_5_to_15_percent_in_half_a_minute(
    promise: float, weight: float, time: float, barred: float, wanted: float
) -> None:
    """Not in the first minute, and not while the law is barred."""
    shadow, proof = Shadow(REST, 0.0, 0.0, 0.01), UNPROVEN._replace(barred=barred)
    roll = shadow._replace(variance=0.01 * (1.0 - promise) ** 2)
    parts = PARTS._replace(step=linear_step_of(SHIP, 0.125))
    before = begin_schedule(proof)._replace(time=time, free=shadow, quiet=shadow, roll=roll, weight=weight)
    assert schedule_step(parts, before, REST, 0.0, 0.0, 0.125).weight == pytest.approx(wanted, abs=1e-12)


def test_the_times_of_a_proof_are_those_of_its_page() -> None:
    """20 s after a switch nothing is measured, then for two minutes; at 5 minutes of memory."""
    without = looked_on(UNPROVEN, 0.0, 20.0, 0.1)
    assert without.without.time == 0.0
    assert proof_step(without, 0.0, 0.1, 0.4, 1.0, ROLL_TIME).without == Measured(1.0, 0.1, 0.0, 0.0), (
        "no law, no promise"
    )
    assert looked_on(without, 0.0, 120.0, 0.1).without.time == 120.0
    started = looked_on(looked_on(without, 0.0, 120.0, 0.1), 0.5, 1.0, 0.1)
    assert looked_on(started, 1.0, 20.0, 0.05).under.time == 0.0
    assert looked_on(started, 1.0, 139.0, 0.05, 0.4).span == 120.0
    assert looked_on(started, 1.0, 140.0, 0.05, 0.4).span == 600.0
    old = UNPROVEN._replace(so_far=99.0, without=Measured(1000.0, 0.0, 0.04, 0.0))
    assert proof_step(old, 0.0, 0.0, 0.0, 1.0, ROLL_TIME).without.variance == pytest.approx(0.04 * (1.0 - 1.0 / 300.0))
    kept, short = (judged(share, 0.5) for share in (0.749, 0.751))
    assert (kept.span, short.span) == (600.0, 300.0), "half of what was promised"


def test_an_order_too_quick_for_the_gear_is_made_smaller_and_keeps_its_time() -> None:
    """A sine of 20 deg at 1.1 rad/s asks for 22 deg/s: of a gear with half of that it gets half, one that is quick
    enough gets all of it."""
    gain, rate, asked = AT_REST, math.radians(11.0), math.radians(20.0)
    for step in range(600):
        gain = rate_gain_step(gain, asked * math.sin(1.1 * 0.05 * step), 0.05)
    smoothed = 1.0 / math.hypot(1.0, 1.1 * RATE_SMOOTH)
    assert rate_share(gain, rate) == pytest.approx(0.5 / smoothed, rel=0.12)
    assert rate_share(gain, math.radians(25.0)) == 1.0
    assert rate_share(gain, math.inf) == 1.0
    for _ in range(1200):
        gain = rate_gain_step(gain, 0.0, 0.05)
    assert rate_share(gain, rate) == 1.0


def test_the_strength_falls_to_the_budget_and_comes_back() -> None:
    def settled(wanted: float, strength: float) -> float:
        square = 0.0
        for _ in range(12000):
            square += DT / WORKED * ((wanted * strength) ** 2 - square)
            strength = strength_step(strength, square / 0.1**2, DT)
        return strength

    assert settled(0.2, 1.0) == pytest.approx(0.5, rel=0.01)
    assert settled(0.2, WEAKEST) == pytest.approx(0.5, rel=0.01)
    assert settled(0.05, WEAKEST) == 1.0
    assert settled(1000.0, 1.0) == WEAKEST


def test_the_demand_is_the_quiet_law_s_but_for_the_share_of_weight_strength_and_rate() -> None:
    shares = 0.5, 0.4
    rudder, gain = damping_rudder(shares, AT_REST, 0.1, 0.3, (math.inf, DT))
    assert rudder == pytest.approx(0.1 + 0.5 * 0.4 * 0.2)
    assert gain == pytest.approx(rate_gain_step(AT_REST, 0.1 + 0.4 * 0.2, DT))
    held, _ = damping_rudder(shares, RateGain(0.18, 1.0), 0.1, 0.3, (0.25, DT))
    share = rate_share(rate_gain_step(RateGain(0.18, 1.0), 0.18, DT), 0.25)
    assert held == pytest.approx(0.1 + share * 0.5 * 0.4 * 0.2)
    assert damping_rudder(shares, AT_REST, 0.1, 0.3, (0.25, 0.0))[1] == AT_REST
