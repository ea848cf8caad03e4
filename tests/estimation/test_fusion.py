"""One measurement taken in: the lasting innovation, the gate and the row of spikes, in numbers worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autopilot.estimation import heading_ekf as ekf
from autopilot.estimation.disturbance import Filtered, FilterNoise, filter_noise, noises_of, sliding
from autopilot.estimation.fusion import NO_RATE_BIAS, Fusion, Measured, Moment, carried, fuse_measured, seen_at
from autopilot.estimation.heading_ekf import FilterState, fuse_heading
from autopilot.estimation.tuning import GUST_BIAS_UNKNOWN, SLIDE_LASTS
from autopilot.models.norrbin import Norrbin
from autopilot.signals import NavState

BOAT = Norrbin(0.2, 5.0)
NOISE = FilterNoise(heading=1.0e-4, rate=4.0e-5, acceleration=2.0e-5, bias=3.0e-6, gust_bias=5.0e-4)
NOISES = noises_of(NOISE)
PAST = ([0.0] * 16, [0.0] * 16, 1)
NO = math.nan


def fusion(heading: float = 0.0, innovation_mean: float = 0.0) -> Fusion:
    gyro = NO_RATE_BIAS._replace(p11=0.0)
    return Fusion(ekf.initial(0.0, heading, 0.0, NOISE), innovation_mean, gyro=gyro)


def deviation(state: FilterState, variance: float, *, of_rate: bool) -> float:
    return math.sqrt((state.p11 if of_rate else state.p00) + variance)


@pytest.mark.parametrize("before", [-1.0, 0.0, 0.8])
@pytest.mark.parametrize("deviations", [-2.0, 0.0, 3.0, 5.0])
@pytest.mark.parametrize("of_rate", [True, False])
def test_the_lasting_innovation_is_a_mean_over_three_seconds(before: float, deviations: float, of_rate: bool) -> None:
    now = fusion(innovation_mean=before)
    ahead = carried(BOAT, NOISES, now, PAST, 0.5)
    off = deviations * deviation(ahead, NOISE.rate if of_rate else NOISE.heading, of_rate=of_rate)
    heading, rate = (NO, off) if of_rate else (off, NO)
    after, is_fused = fuse_measured(BOAT, NOISES, now, PAST, Measured(0.5, heading, rate))
    assert is_fused
    assert after.innovation_mean == pytest.approx(before + (1.0 - math.exp(-0.5 / 3.0)) * (deviations - before))


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_one_wild_rate_counts_as_five_deviations(side: float) -> None:
    after, _ = fuse_measured(BOAT, NOISES, fusion(), PAST, Measured(0.5, NO, side * 100.0))
    assert after.innovation_mean == pytest.approx(side * 5.0 * (1.0 - math.exp(-0.5 / 3.0)))


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("start", [0.0, 3.1, -3.1])
def test_the_gate_is_ten_degrees_or_six_deviations(side: float, start: float) -> None:
    for off_deg, is_taken in ((9.9, True), (10.1, False)):
        heading = math.remainder(start + side * math.radians(off_deg), math.tau)
        assert fuse_measured(BOAT, NOISES, fusion(start), PAST, Measured(0.1, heading, NO))[1] is is_taken
    vague = NOISES._replace(usual=NOISE._replace(heading=math.radians(5.0) ** 2))
    ahead = carried(BOAT, vague, fusion(start), PAST, 0.1)
    gate = 6.0 * deviation(ahead, vague.usual.heading, of_rate=False)
    assert gate > math.radians(30.0)
    for share, is_taken in ((0.99, True), (1.01, False)):
        heading = math.remainder(start + side * share * gate, math.tau)
        assert fuse_measured(BOAT, vague, fusion(start), PAST, Measured(0.1, heading, NO))[1] is is_taken


def test_spikes_are_counted_while_they_agree_and_a_heading_that_is_taken_ends_the_row() -> None:
    now, counts = fusion(), []
    for heading in (1.0, 1.05, 1.1, -1.0, -0.9, 0.001, 1.0):
        before = now
        now, is_fused = fuse_measured(BOAT, NOISES, now, PAST, Measured(now.state.time + 0.1, heading, NO))
        counts.append(now.spikes)
        assert is_fused is (abs(heading) < 0.1)
        if not is_fused:
            assert now.state is before.state, "a spike leaves no trace"
            assert now.spike == heading
    assert counts == [1, 2, 3, 1, 2, 0, 1]


def test_a_rate_beside_a_spike_is_left_out_too_and_one_alone_is_taken() -> None:
    assert fuse_measured(BOAT, NOISES, fusion(), PAST, Measured(0.1, 1.0, 0.01))[0].state == fusion().state
    taken, is_fused = fuse_measured(BOAT, NOISES, fusion(), PAST, Measured(0.1, NO, 0.01))
    assert is_fused and 0.0 < taken.state.rate < 0.01
    ahead = carried(BOAT, NOISES, fusion(), PAST, 0.1)
    plain, _ = fuse_measured(BOAT, NOISES, fusion(), PAST, Measured(0.1, 0.02, NO))
    assert plain.state == fuse_heading(ahead, 0.02, NOISE.heading)


@pytest.mark.parametrize(
    ("innovation_mean", "density"), [(1.49, 3.0e-6), (-1.49, 3.0e-6), (1.51, 5.0e-4), (-1.51, 5.0e-4)]
)
def test_something_lasting_makes_the_bias_quick_where_waves_are_learnt(innovation_mean: float, density: float) -> None:
    wavy = noises_of(NOISE._replace(waves=True))
    ahead = carried(BOAT, wavy, fusion(innovation_mean=innovation_mean), PAST, 0.4)
    assert ahead.p22 - fusion().state.p22 == pytest.approx(0.4 * density)
    calm = carried(BOAT, NOISES, fusion(innovation_mean=innovation_mean), PAST, 0.4)
    assert calm.p22 - fusion().state.p22 == pytest.approx(0.4 * 3.0e-6)


def test_the_rudder_at_its_stop_makes_the_bias_as_quick_as_the_file_says() -> None:
    noises = noises_of(NOISE._replace(stop=0.4, stop_bias=2.0e-3))
    for angle, density in ((0.39, 3.0e-6), (-0.39, 3.0e-6), (0.41, 2.0e-3), (-0.41, 2.0e-3)):
        past = ([0.0] * 16, [angle] * 16, 1)
        ahead = carried(BOAT, noises, fusion(), past, 0.4)
        assert ahead.p22 - fusion().state.p22 == pytest.approx(0.4 * density)


@pytest.mark.parametrize(("to", "moved"), [(1.0, 1.0), (1.9, 1.9), (2.0, 2.0), (3.0, 2.0), (50.0, 2.0)])
def test_the_boat_is_carried_no_further_than_two_seconds(to: float, moved: float) -> None:
    turning = Fusion(ekf.initial(0.0, 0.0, 0.1, NOISE))
    ahead = carried(BOAT, NOISES, turning, PAST, to)
    assert ahead.time == to
    assert ahead.rate == pytest.approx(0.1 * math.exp(-moved / 5.0))
    assert ahead.psi == pytest.approx(0.5 * (1.0 - math.exp(-moved / 5.0)))


def test_a_bias_known_to_less_than_1_8_degrees_tells_of_no_gusts() -> None:
    assert math.degrees(math.sqrt(GUST_BIAS_UNKNOWN)) == pytest.approx(1.8)


def test_limits_to_the_bit_are_on_the_side_of_the_usual() -> None:
    """Ten degrees off is taken, and so far from a spike agrees with it; 1.5 deviations are lasting."""
    start = fusion()
    assert fuse_measured(BOAT, NOISES, start, PAST, Measured(0.0, math.radians(10.0), NO))[1]
    spiked, _ = fuse_measured(BOAT, NOISES, start, PAST, Measured(0.0, math.radians(20.0), NO))
    again, _ = fuse_measured(BOAT, NOISES, spiked, PAST, Measured(0.0, math.radians(30.0), NO))
    assert (spiked.spikes, again.spikes) == (1, 1 + (math.radians(30.0) - math.radians(20.0) <= math.radians(10.0)))
    wavy = noises_of(NOISE._replace(waves=True, stop=0.4, stop_bias=2.0e-3))
    known = start.state.p22
    assert carried(BOAT, wavy, fusion(innovation_mean=1.5), PAST, 0.4).p22 - known == pytest.approx(0.4 * 5.0e-4)
    at_stop = ([0.0] * 16, [0.4] * 16, 1)
    assert carried(BOAT, wavy, fusion(), at_stop, 0.4).p22 - known == pytest.approx(0.4 * 2.0e-3)


def test_the_sea_is_learnt_while_nothing_lasting_pushes() -> None:
    wavy = noises_of(NOISE._replace(waves=True))
    start = ekf.initial(0.0, 0.0, 0.0, wavy.usual)
    for innovation_mean, is_learnt in ((0.0, True), (1.0, True), (-1.0, True), (3.0, False), (-3.0, False)):
        after, _ = fuse_measured(BOAT, wavy, Fusion(start, innovation_mean), PAST, Measured(0.0, 0.0, 0.0))
        assert (after.state.sea != start.sea) is False, "no time has passed"
        after, _ = fuse_measured(BOAT, wavy, Fusion(start, innovation_mean), PAST, Measured(0.1, 0.0, 0.0))
        assert after.state.sea.watched == pytest.approx(0.1 if is_learnt else 0.0)


@pytest.mark.parametrize(("now", "is_one_step"), [(2.0, False), (1.0, True)])
def test_the_mean_is_carried_in_steps_of_half_the_time_constant_at_most(now: float, is_one_step: bool) -> None:
    """Of a boat whose damping grows with its rate steps of another length come to another rate."""
    boat, turning = Norrbin(0.2, 2.0, n3=30.0), Fusion(ekf.initial(0.0, 0.0, 0.3, NOISE))
    one = ekf.predict_mean(boat, turning.state, 0.0, now)[1]
    half = ekf.predict(boat, NOISE, turning.state, 0.0, 0.5 * now)
    two = ekf.predict_mean(boat, half, 0.0, now)[1]
    assert abs(one - two) > 1.0e-3
    assert seen_at(boat, NOISES, turning, PAST, Moment(now, 1.0, 0.0)).rate == pytest.approx(
        one if is_one_step else two, rel=1.0e-12
    )
    assert carried(boat, NOISES, turning, PAST, now).rate == pytest.approx(one if is_one_step else two, rel=1.0e-12)


def test_noisier_instruments_count_for_less_and_as_much_as_filed_where_they_are_not() -> None:
    """Compass and gyro each three times as noisy as filed, in turn: the one is found, the other left."""
    random = np.random.default_rng(20261130)
    for times in ((3.0, 1.0), (1.0, 3.0)):
        now = fusion()
        for index in range(1, 1500):
            read = random.standard_normal(2) * times * np.sqrt([NOISE.heading, NOISE.rate])
            now, is_fused = fuse_measured(BOAT, NOISES, now, PAST, Measured(0.1 * index, *map(float, read)))
            assert is_fused
        found = math.sqrt(now.headings[0] / NOISE.heading), math.sqrt(now.rates[0] / NOISE.rate)
        assert found == pytest.approx(times, rel=0.15)
        noisy = fusion()._replace(headings=now.headings, rates=now.rates)
        shown = Measured(0.1, 0.01, 0.05)
        answers = [fuse_measured(BOAT, NOISES, each, PAST, shown)[0].state for each in (noisy, fusion())]
        learnt, filed = (state.psi if times[0] > 1.0 else state.rate for state in answers)
        assert abs(learnt) < 0.9 * abs(filed)


def test_at_the_measurement_time_the_mean_is_the_state() -> None:
    moved = ([0.0, 1.0, 2.0, 3.0], [0.0, 0.1, 0.2, 0.3], 4)
    turning = Fusion(ekf.initial(1.0, 0.5, 0.1, NOISE))
    seen = seen_at(BOAT, NOISES, turning, moved, Moment(1.0, 2.0, 0.5))
    assert seen == NavState(1.0, 0.5, 0.1, 2.0, 0.3, 0.0, 0.5, True)


def test_headings_that_lie_to_one_side_for_the_time_of_gusts_make_the_bias_quick() -> None:
    """By less than the seconds' mean notices: noise averages out over that time, wind does not."""
    wavy = noises_of(NOISE._replace(waves=True, gust_bias=5.0e-4, gust_time=10.0))
    side, after = 0.8 * math.sqrt(NOISE.heading), fusion()
    for step in range(1, 200):
        expected = after.state.psi + after.state.rate * 0.1
        sway = side if step > 100 else 0.0
        after, _ = fuse_measured(BOAT, wavy, after, PAST, Measured(0.1 * step, expected + sway, math.nan))
        if step == 100:
            assert after.leans == 0.0
    assert 0.0 < after.leans < 10.0 and abs(after.innovation_mean) < 1.5
    known = after.state.p22
    assert carried(BOAT, wavy, after, PAST, 20.3).p22 - known == pytest.approx(0.4 * 5.0e-4, rel=0.01)


def after_a_turn(reckons: bool, side: float) -> list[FilterState]:
    """Return what is known every 0.1 s of a boat that a slide pushes by 0.1 rad of rudder at first, and a wind by 0.01:
    with what a turn leaves unknown, or without."""
    noises = noises_of(filter_noise(BOAT, Filtered(2.7e-5, 1.2e-5, 10.0, 0.5, math.inf, waves=True)))
    noise, random, found = noises.usual, np.random.default_rng(7), []
    now = Fusion(ekf.initial(0.0, 0.0, 0.0, noise)._replace(bias=side * 0.01, p22=1e-5))
    if reckons:
        turned = ekf.with_bias_of(BOAT, sliding(noises, 0.1).usual, now.state, now.state._replace(time=0.1))
        now = Fusion(turned._replace(time=0.0))
    heading = rate = 0.0
    for tick in range(1, 1000):
        time = 0.1 * tick
        push = side * (0.01 + 0.1 * math.exp(-time / (SLIDE_LASTS * BOAT.time_constant)))
        rate += 0.1 * (BOAT.gain * push - rate) / BOAT.time_constant
        heading += 0.1 * rate
        seen = Measured(time, heading + 0.005 * random.standard_normal(), rate + 0.0035 * random.standard_normal())
        now, _ = fuse_measured(BOAT, noises, now, PAST, seen)
        found.append(now.state)
    return found


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_what_a_turn_has_left_is_learnt_as_a_push_that_goes_by_itself(side: float) -> None:
    """Half of it in little more than the time constant, and when it is gone the wind is what it was before."""
    with_slide, without = after_a_turn(True, side), after_a_turn(False, side)
    true = [side * (0.01 + 0.1 * math.exp(-0.1 * tick / (SLIDE_LASTS * BOAT.time_constant))) for tick in range(1, 1000)]
    off, off_without = (
        [abs(state.bias - push) for state, push in zip(states, true, strict=True)] for states in (with_slide, without)
    )
    assert max(off[60:]) < 0.05 < max(off_without[60:])
    assert sum(off) < 0.5 * sum(off_without)
    last = with_slide[-1]
    assert abs(last.slide) < 0.005 and last.bias - last.slide == pytest.approx(side * 0.01, abs=0.01)


def test_a_slide_goes_with_time_as_a_state_of_its_own_would() -> None:
    """One more state g' = -g/(4 T), independent of wind: what is known of b = wind + g and of everything together."""
    known = np.array([[4e-3, 1e-3, 2e-4], [1e-3, 3e-3, 4e-4], [2e-4, 4e-4, 1e-3]])
    start = FilterState(0.0, 0.1, 0.02, 0.05, *known[np.triu_indices(3)], slide=0.03, slide_variance=8e-4)
    dt, model = 0.5, BOAT._replace(n3=0.0)
    noise = NOISE._replace(acceleration=0.0, bias=0.0, slide=1e-5)
    after = ekf.predict(model, noise, start, 0.0, dt)
    fade = math.exp(-dt / (SLIDE_LASTS * model.time_constant))
    assert after.slide == pytest.approx(0.03 * fade) and after.bias == pytest.approx(0.02 + 0.03 * fade)
    assert after.slide_variance == pytest.approx(8e-4 * fade**2 + 1e-5 * dt)
    assert after.p22 == pytest.approx(2e-4 + 8e-4 * fade**2 + 1e-5 * dt)
    kept = 1.0 - 0.8 * (1.0 - fade)
    still = ekf.predict(model, noise._replace(slide=0.0), start._replace(slide=0.0, slide_variance=0.0), 0.0, dt)
    assert (after.p02, after.p12) == (pytest.approx(kept * still.p02), pytest.approx(kept * still.p12))
    held = ekf.with_bias_of(model, noise, start, after._replace(bias=9.0))
    assert held.bias == pytest.approx(after.bias) and held.p22 == pytest.approx(after.p22)


def test_a_push_that_the_bias_is_too_slow_for_is_known_beside_it() -> None:
    """A boat that lies still under a rudder of -2 deg, as something pushes it, with a bias that must not move."""
    boat, push = Norrbin(0.5, 2.0), math.radians(2.0)
    held = NOISES.usual._replace(bias=0.0, gust_bias=0.0, waves=False)
    noises, past = noises_of(held), ([0.0, 0.0], [-push, -push], 2)
    now = Fusion(ekf.initial(0.0, 0.0, 0.0, held)._replace(p02=0.0, p12=0.0, p22=1e-12))
    assert now.unlearnt == 0.0
    for step in range(1, 400):
        now, _ = fuse_measured(boat, noises, now, past, Measured(0.05 * step, 0.0, 0.0))
    assert abs(now.state.bias) < 0.1 * push
    assert now.unlearnt == pytest.approx(push, rel=0.05)


def test_a_rate_that_no_rudder_makes_is_left_out_but_where_the_boat_is_turned_so() -> None:
    bounded = noises_of(NOISE, rate_most=math.radians(4.0))
    now = fusion()
    for k in range(1, 11):
        heading = Measured(0.1 * k, 0.0, NO)
        alone, _ = fuse_measured(BOAT, bounded, now, PAST, heading)
        now, is_fused = fuse_measured(BOAT, bounded, now, PAST, heading._replace(rate=math.radians(57.3)))
        assert is_fused
        assert now == alone, "as if none had come"

    turned, most = 0.0, math.radians(30.0)
    for k in range(11, 61):
        rate = min(0.05 * (k - 10), 1.0) * most
        turned += 0.1 * rate
        measured = Measured(0.1 * k, math.remainder(turned, math.tau), rate)
        now, is_fused = fuse_measured(BOAT, bounded, now, PAST, measured)
        assert is_fused
    assert now.state.rate == pytest.approx(most, abs=math.radians(1.0)), "a boat that is turned so, turns so"


def test_a_boat_thrown_further_than_the_gate_between_two_headings_a_second_apart_has_no_spike() -> None:
    """It turns by 12 deg/s at most: further than the gate in a second, not in a tenth of one."""
    noises = NOISES._replace(rate_most=math.radians(12.0))
    for dt, off_deg, is_taken in ((1.0, 11.9, True), (0.1, 10.1, False), (2.0, 23.9, True), (3.0, 41.0, False)):
        measured = Measured(dt, math.radians(off_deg), NO)
        assert fuse_measured(BOAT, noises, fusion(), PAST, measured)[1] is is_taken


def test_a_turn_that_compass_and_gyro_show_alike_is_no_spike() -> None:
    for rate_deg_s, is_taken in ((15.0, True), (-15.0, False), (0.0, False)):
        rate = math.radians(rate_deg_s)
        known = NO_RATE_BIAS._replace(time=0.0, heading=0.0, rate=rate, seen=0.0, rated=0.0)
        measured = Measured(1.0, math.radians(15.0), rate)
        assert fuse_measured(BOAT, NOISES, fusion()._replace(gyro=known), PAST, measured)[1] is is_taken
    old = known._replace(rate=math.radians(15.0), rated=-1.5)
    assert not fuse_measured(BOAT, NOISES, fusion()._replace(gyro=old), PAST, Measured(1.0, math.radians(15.0), NO))[1]
