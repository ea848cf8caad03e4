"""The estimator: order of arrival does not matter, spikes and silence are survived, the bias is learnt."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
import pytest
from estimating import Estimating
from plant import Plant

from autopilot.angles import wrap
from autopilot.estimation import heading_ekf as ekf
from autopilot.estimation.disturbance import FilterNoise
from autopilot.estimation.heading_ekf import fuse_heading, fuse_rate
from autopilot.models.drives import DriveLaw, quickness
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.runtime.build import gear_of, model_of, noise_of
from autopilot.signals import HeadingSample, NavState, RateSample, RudderSample, Sample, SpeedSample, ThrustSample
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Estimator as EstimatorSection

GATE_PATIENCE = 5
KEPT_SAMPLES = 24
RATE_UNKNOWN = 0.2**2

BOATS_FOLDER = Path(__file__).resolve().parents[2] / "benchmarks" / "boats"
MODEL = Norrbin(0.701, 0.332, 3.2828, reference_speed=4.63)
GEAR = SteeringGear(math.radians(30.0), math.radians(20.0), 0.1)
NOISE = FilterNoise(math.radians(0.3) ** 2, math.radians(0.2) ** 2, 2.7e-3, 1.2e-4)


def estimator() -> Estimating:
    return Estimating(MODEL, GEAR, NOISE)


Timed = TypeVar("Timed")


def swing(count: int = 40, dt: float = 0.1) -> list[HeadingSample]:
    return [HeadingSample(i * dt, 0.3 * math.sin(0.5 * i * dt), 0.15 * math.cos(0.5 * i * dt)) for i in range(count)]


def test_it_knows_nothing_before_the_first_heading() -> None:
    state = estimator().update(1.0, (RateSample(0.9, 0.1), RudderSample(0.9, 0.05)))
    assert state == NavState(1.0, 0.0, 0.0, 4.63, 0.05, 0.0, math.inf, False)


def test_with_the_first_heading_nothing_lies_to_one_side_and_it_is_one() -> None:
    first = estimator()
    first.update(1.0, (HeadingSample(1.0, 0.5),))
    assert (first.state.fusion.innovation_mean, first.state.has_begun, first.state.taken) == (0.0, True, ())


def shuffled_by_fives(samples: list[Timed]) -> list[Timed]:
    """The first sample first, and after it each five in any order."""
    late = samples[:1]
    for start in range(1, len(samples), 5):
        part = samples[start : start + 5]
        random.Random(start).shuffle(part)
        late += part
    return late


def overtaken(samples: list[Timed]) -> int:
    """How many samples come behind a newer one."""
    return sum(
        sample.time < max(before.time for before in samples[:place]) for place, sample in enumerate(samples) if place
    )


def test_shuffled_arrival_gives_the_state_of_ordered_arrival() -> None:
    samples = swing()
    ordered, shuffled = estimator(), estimator()
    for sample in samples:
        ordered.update(4.0, (sample,))
    for sample in shuffled_by_fives(samples):
        shuffled.update(4.0, (sample,))
    assert overtaken(shuffled_by_fives(samples)) > 5
    assert shuffled.update(4.0, ()) == pytest.approx(ordered.update(4.0, ()), abs=1e-12)


WAVES = NOISE._replace(acceleration=2.7e-5, bias=2.7e-6, model_error=0.1, waves=True, gust=2.7e-3)
"""The noise that a vessel file with a wave filter gives this boat."""


def in_waves(time: float) -> tuple[float, float]:
    """A slow swing of the boat's own and waves of 1 deg, as heading and rate."""
    own, wave = math.radians(5.0), math.radians(1.4)
    heading = own * math.sin(0.05 * time) + wave * math.sin(1.1 * time)
    return heading, 0.05 * own * math.cos(0.05 * time) + 1.1 * wave * math.cos(1.1 * time)


@pytest.mark.parametrize("with_rate", [True, False])
def test_in_waves_too_the_order_of_arrival_does_not_matter(with_rate: bool) -> None:
    samples: list[Sample] = []
    for i in range(400):
        heading, rate = in_waves(0.1 * i)
        samples.append(HeadingSample(0.1 * i, heading, rate if with_rate else None))
        if not with_rate and i % 2:
            samples.append(RateSample(0.1 * i - 0.03, in_waves(0.1 * i - 0.03)[1]))
    samples.sort(key=lambda sample: sample.time)
    ordered, shuffled = (Estimating(MODEL, GEAR, WAVES) for _ in range(2))
    for sample in samples:
        ordered.update(40.0, (sample,))
    for sample in shuffled_by_fives(samples):
        shuffled.update(40.0, (sample,))
    assert overtaken(shuffled_by_fives(samples)) > 50
    assert shuffled.update(40.0, ()) == pytest.approx(ordered.update(40.0, ()), abs=1e-9)


@pytest.mark.parametrize("with_rate", [True, False])
def test_irregular_samples_with_spikes_still_part_boat_and_waves(with_rate: bool) -> None:
    """Intervals from 20 ms to 0.8 s, 0.3 deg of noise, every twentieth heading anywhere: the boat's swing is found."""
    tested, deviates = Estimating(MODEL, GEAR, WAVES._replace(acceleration=2.7e-4)), np.random.default_rng(5)
    now, errors, totals, spikes, found = 0.0, [], [], 0, 0
    while now < 300.0:
        now += float(deviates.choice([0.02, 0.1, 0.1, 0.2, 0.8]))
        heading, rate = in_waves(now)
        measured = heading + math.radians(0.3) * float(deviates.standard_normal())
        if deviates.random() < 0.05:
            measured, spikes = wrap(heading + float(deviates.uniform(0.5, 5.5))), spikes + 1
        noisy = rate + math.radians(0.2) * float(deviates.standard_normal()) if with_rate else None
        state = tested.update(now, (HeadingSample(now, measured, noisy),))
        found += tested.state.fusion.spikes > 0
        if now > 120.0:
            own = math.radians(5.0) * math.sin(0.05 * now)
            errors.append(state.heading - state.wave_heading - own)
            totals.append(state.heading - heading)
    assert found >= 0.95 * spikes
    assert math.degrees(float(np.std(totals))) < 0.35
    assert math.degrees(float(np.std(errors))) < 0.6, "waves of 1 deg rms are all but gone"
    assert state.wave_deviation == pytest.approx(math.radians(1.0), rel=0.35)
    assert state.wave_frequency == pytest.approx(1.1, rel=0.25)


@pytest.mark.parametrize("quickest_deg_s", [0.5, 2.0])
def test_two_headings_a_moment_apart_do_not_turn_a_ship(quickest_deg_s: float) -> None:
    ship, quickest = Norrbin(0.04, 60.0, 4.0e4, n1=-1.0, reference_speed=7.0), math.radians(quickest_deg_s)
    noise = FilterNoise(math.radians(1.5) ** 2, math.radians(0.2) ** 2, 2.7e-12, 2.0e-7, rate_unknown=quickest**2)
    found = {}
    for name, known in (("known", noise), ("unknown", noise._replace(rate_unknown=RATE_UNKNOWN))):
        tested, deviates = Estimating(ship, GEAR, known), np.random.default_rng(7)
        measured = [math.radians(2.0), *np.radians(0.2) * deviates.standard_normal(150)]
        states = [tested.update(0.1 * i, (HeadingSample(0.1 * i, float(one)),)) for i, one in enumerate(measured)]
        found[name] = max(abs(state.rate) for state in states)
    assert found["known"] < 0.6 * quickest
    assert found["unknown"] > 2.0 * quickest, "a first heading that is 2 deg off looks like a turn"


def test_no_rate_is_thought_possible_that_the_rudder_does_not_reach() -> None:
    lanxin, tanker = load_vessel("lanxin"), load_vessel(str(BOATS_FOLDER / "unstable.yaml"))
    assert noise_of(lanxin).rate_unknown == RATE_UNKNOWN, "a boat that turns by 16 deg/s is taken as before"
    assert math.degrees(math.sqrt(noise_of(tanker).rate_unknown)) == pytest.approx(0.5208, abs=1.0e-3)
    unbounded = replace(tanker, model=replace(tanker.model, n3_s2_rad2=0.0))
    assert noise_of(unbounded).rate_unknown == RATE_UNKNOWN


def test_repeated_samples_change_nothing() -> None:
    once, twice = estimator(), estimator()
    for sample in swing():
        once.update(sample.time, (sample,))
        twice.update(sample.time, (sample, sample))
    assert twice.update(4.0, ()) == once.update(4.0, ())
    assert twice.known == once.known


def test_a_sample_older_than_the_memory_is_dropped() -> None:
    tested = estimator()
    for sample in swing(KEPT_SAMPLES + 20):
        tested.update(sample.time, (sample,))
    before, known = tested.update(10.0, ()), tested.known
    assert tested.update(10.0, (HeadingSample(0.05, 2.0),)) == before
    assert tested.known == known


@pytest.mark.parametrize(("time", "is_taken"), [(1.55, True), (1.45, False)])
def test_the_memory_reaches_twenty_four_samples_back(time: float, is_taken: bool) -> None:
    """Of forty the newest twenty-four are the seventeenth, of 1.6 s, and those after it."""
    tested = estimator()
    for sample in swing(40):
        tested.update(sample.time, (sample,))
    before = tested.state.fusion
    tested.update(4.0, (HeadingSample(time, 0.1),))
    assert (tested.state.fusion != before) is is_taken


def test_spikes_are_dropped_and_a_true_jump_is_accepted() -> None:
    tested = estimator()
    for i in range(50):
        tested.update(i * 0.1, (HeadingSample(i * 0.1, 0.0, 0.0),))
    spiked = tested.update(5.0, (HeadingSample(5.0, 2.0, 0.0),))
    assert abs(spiked.heading) < 0.01
    for i in range(GATE_PATIENCE + 1):
        tested.update(5.1 + i * 0.1, (HeadingSample(5.1 + i * 0.1, 2.0, 0.0),))
    assert tested.update(5.8, ()).heading == pytest.approx(2.0, abs=0.02)
    # the spike that is one too many is where it begins anew, and one heading comes after it
    began, (after,) = tested.state.begun, tested.state.taken
    assert began is not None
    assert (began.time, after.sample.time) == (5.1 + (GATE_PATIENCE - 1) * 0.1, 5.1 + GATE_PATIENCE * 0.1)
    assert tested.state.fusion.spikes == 0


@pytest.mark.parametrize(("hz", "left_out"), [(20.0, 6), (10.0, 6), (5.0, 3), (2.0, 2), (1.0, 2)])
def test_a_slow_compass_is_believed_again_before_it_counts_as_lost(hz: float, left_out: int) -> None:
    """Six headings in a row took 3 s at 2 Hz, and the fail-safe came first."""
    tested = estimator()
    for i in range(50):
        tested.update(i / hz, (HeadingSample(i / hz, 0.0, 0.0),))
    last = 49 / hz
    for i in range(1, left_out + 1):
        assert tested.state.heading_time == last
        tested.update(last + i / hz, (HeadingSample(last + i / hz, 2.0, 0.0),))
    assert tested.state.heading_time == last + left_out / hz


@pytest.mark.parametrize(
    "bad",
    [
        HeadingSample(1.0, math.nan),
        HeadingSample(1.0, math.inf),
        HeadingSample(1.0, 0.1, math.nan),
        HeadingSample(math.nan, 0.1),
        HeadingSample(1.0, 0.1, 1.0e9),
        RateSample(1.0, math.nan),
        RudderSample(1.0, math.nan),
        RudderSample(1.0, 1.0e6),
        SpeedSample(1.0, math.inf),
    ],
)
def test_implausible_samples_are_dropped(bad: Sample) -> None:
    tested = estimator()
    for i in range(10):
        tested.update(i * 0.1, (HeadingSample(i * 0.1, 0.2, 0.0),))
    before, known = tested.update(1.0, ()), tested.known
    assert tested.update(1.0, (bad,)) == before
    assert tested.known == known


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(
    ("limit", "made"),
    [
        (100.0, lambda value: SpeedSample(0.1, value)),
        (10.0, lambda value: RateSample(0.1, value)),
        (10.0, lambda value: HeadingSample(0.1, 0.2, value)),
        (0.5 * math.pi, lambda value: RudderSample(0.1, value)),
    ],
)
def test_a_hundred_metres_and_ten_radians_a_second_and_a_rudder_athwart_are_the_limits(
    limit: float, made: Callable[[float], Sample], side: float
) -> None:
    for value, is_dropped in ((limit, False), (math.nextafter(limit, math.inf), True)):
        tested, idle = estimator(), estimator()
        for each in (tested, idle):
            each.update(0.0, (HeadingSample(0.0, 0.2, 0.0),))
        tested.update(0.1, (made(side * value),))
        idle.update(0.1, ())
        assert (tested.known == idle.known) is is_dropped


def test_a_boat_without_headings_for_more_than_two_seconds_begins_anew() -> None:
    for silence in (2.0, 2.0001):
        tested = estimator()
        tested.update(0.0, (HeadingSample(0.0, 0.0, 0.0),))
        found = tested.update(silence, (HeadingSample(silence, 0.15),)).heading
        assert (found == pytest.approx(0.15, abs=1e-12)) is (silence > 2.0)


@pytest.mark.parametrize(("watched", "push"), [(39.999, 0.0), (40.0, 0.1)])
def test_wind_is_known_once_the_sea_has_been_watched_for_forty_seconds(watched: float, push: float) -> None:
    tested = Estimating(MODEL, GEAR, NOISE._replace(waves=True))
    assert tested.state.push == 0.0
    tested.update(0.0, (HeadingSample(0.0, 0.0, 0.0),))
    fusion = tested.state.fusion
    fusion = fusion._replace(state=fusion.state._replace(time=watched, bias=0.1))
    tested.state = tested.state._replace(fusion=fusion)
    assert tested.state.push == push


def test_a_heading_from_the_future_is_taken_as_of_now() -> None:
    tested = estimator()
    tested.update(1.0, (HeadingSample(1.0, 0.0, 0.0),))
    state = tested.update(1.1, (HeadingSample(900.0, 0.0, 0.0),))
    assert state.heading_age == 0.0
    assert tested.update(1.6, ()).heading_age == pytest.approx(0.5)


def test_rates_that_are_not_to_be_taken_leave_no_trace() -> None:
    """A gyro of the wrong sign, found out after 4 s: soon it is as if there had never been one."""
    plant = Plant(MODEL, GEAR, disturbance=lambda t: 0.2 * math.sin(t))
    tested, without, apart = estimator(), estimator(), []
    for _ in range(400):
        headings = [sample for sample in plant.sense() if isinstance(sample, HeadingSample)]
        tested.take_rates(plant.time < 4.0)
        wrong = tuple(sample._replace(rate=-(sample.rate or 0.0)) for sample in headings)
        rates = [
            one.update(plant.time, seen).rate
            for one, seen in ((tested, wrong), (without, tuple(sample._replace(rate=None) for sample in headings)))
        ]
        apart.append(abs(rates[0] - rates[1]))
        plant.step(0.0, 0.05)
    assert max(apart[:80]) > math.radians(5.0)
    assert max(apart[200:]) < math.radians(0.2)


def test_heading_alone_gives_the_rate() -> None:
    plant = Plant(MODEL, GEAR, heading_noise=math.radians(0.2), rate_noise=None)
    tested = estimator()
    errors = []
    for i in range(400):
        order = 0.2 * math.sin(0.8 * plant.time)
        state = tested.update(plant.time, tuple(plant.sense()))
        tested.order(plant.time, order)
        if i > 50:
            errors.append((wrap(state.heading - plant.heading), state.rate - plant.rate))
        plant.step(order, 0.1)
    heading_rms, rate_rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert math.degrees(heading_rms) < 0.2
    assert math.degrees(rate_rms) < 1.0


def test_latency_does_not_reach_the_state() -> None:
    plant = Plant(MODEL, GEAR, latency=0.3)
    tested = estimator()
    worst = 0.0
    for i in range(300):
        order = 0.2 * math.sin(0.8 * plant.time)
        state = tested.update(plant.time, tuple(plant.sense()))
        tested.order(plant.time, order)
        if i > 40:
            worst = max(worst, abs(wrap(state.heading - plant.heading)))
        plant.step(order, 0.05)
    assert math.degrees(worst) < 0.3, "0.3 s at 10 deg/s would be 3 deg"


def test_the_bias_is_learnt() -> None:
    plant = Plant(MODEL, GEAR, disturbance=lambda _: math.radians(4.0))
    tested = estimator()
    for _ in range(1200):
        state = tested.update(plant.time, tuple(plant.sense()))
        tested.order(plant.time, -math.radians(3.0))
        plant.step(-math.radians(3.0), 0.05)
    assert math.degrees(state.bias) == pytest.approx(4.0, abs=0.3)


def test_at_the_rudders_stop_the_end_of_a_push_is_learnt_at_once() -> None:
    """A slow boat held off with all its rudder: 10 s after the push most of it is unlearnt; not so elsewhere."""
    vessel = load_vessel(str(BOATS_FOLDER / "coaster.yaml"))
    model, gear, noise = model_of(vessel), gear_of(vessel), noise_of(vessel)

    def left_after(rudder: float) -> float:
        plant = Plant(model, gear, disturbance=lambda t: -rudder if t < 60.0 else 0.0)
        tested = Estimating(model, gear, noise)
        for _ in range(1400):
            state = tested.update(plant.time, tuple(plant.sense()))
            tested.order(plant.time, rudder)
            plant.step(rudder, 0.05)
        return state.bias / -rudder

    assert abs(left_after(-gear.angle_max)) < 0.3
    assert left_after(-0.9 * gear.angle_max) > 0.7


@pytest.mark.parametrize("wave_filter", ["off", "auto"])
def test_the_file_may_say_how_quickly_wind_and_trim_change(wave_filter: Literal["off", "auto"]) -> None:
    vessel = load_vessel("lanxin")
    usual, slow = (
        noise_of(replace(vessel, estimator=EstimatorSection(wave_filter=wave_filter, bias_time_s=time)))
        for time in (None, 40.0)
    )
    assert usual == noise_of(replace(vessel, estimator=EstimatorSection(wave_filter=wave_filter, bias_time_s=10.0)))
    assert (slow.bias, slow.gust_bias) == pytest.approx((usual.bias / 4.0, usual.gust_bias / 4.0))
    assert slow.stop_bias == usual.stop_bias


def test_one_linear_step_is_the_kalman_filter_of_the_textbook() -> None:
    """Against numpy's matrices, for a linear model and a small step."""
    model = MODEL._replace(n3=0.0)
    state = ekf.FilterState(0.0, 0.1, 0.05, 0.02, 0.004, 0.001, 0.0002, 0.003, 0.0004, 0.001)
    dt, a = 1.0e-3, 1.0 / model.time_constant
    b = model.gain / model.time_constant
    f = np.eye(3) + dt * np.array([[0.0, 1.0, 0.0], [0.0, -a, b], [0.0, 0.0, 0.0]])
    p = np.array(
        [[state.p00, state.p01, state.p02], [state.p01, state.p11, state.p12], [state.p02, state.p12, state.p22]]
    )
    p = f @ p @ f.T + np.diag([0.0, NOISE.acceleration * dt, NOISE.bias * dt])
    x = f @ np.array([state.psi, state.rate, state.bias]) + dt * np.array([0.0, b * 0.1, 0.0])
    moved = ekf.predict(model, NOISE, state, 0.1, state.time + dt)
    assert moved[1:4] == pytest.approx(x, abs=1e-5)
    assert moved[4:10] == pytest.approx(p[np.triu_indices(3)], rel=2e-3)
    for index, fuse, variance in ((0, fuse_heading, NOISE.heading), (1, fuse_rate, NOISE.rate)):
        h = np.eye(3)[index]
        gain = p @ h / (p[index, index] + variance)
        fused = fuse(moved, 0.12, variance)
        assert fused[1:4] == pytest.approx(x + gain * (0.12 - x[index]), abs=1e-5)
        assert fused[4:10] == pytest.approx((p - np.outer(gain, h @ p))[np.triu_indices(3)], rel=2e-3, abs=1e-9)


def test_late_rudder_feedback_sets_the_level_and_the_model_adds_the_motion() -> None:
    tested = estimator()
    truth = 0.0
    for i in range(100):
        now = 0.05 * i
        order = 0.2 if now > 2.0 else 0.0
        samples = (RudderSample(now - 0.3, 0.03 + tested.modelled_at(now - 0.3)),) if i % 5 == 0 else ()
        state = tested.update(now, (HeadingSample(now, 0.0), *samples))
        tested.order(now, order)
        truth = 0.03 + tested.state.rudder.modelled
    assert state.rudder == pytest.approx(truth, abs=1e-9)
    assert state.rudder == pytest.approx(0.23, abs=1e-3)


@pytest.mark.parametrize("late", [1, 2, 5])
def test_a_late_sample_leaves_what_it_would_have_left_in_its_turn(late: int) -> None:
    """Innovation mean and count of spikes too: what is fused again does not count again."""
    in_turn, shuffled = estimator(), estimator()
    samples = [
        sample._replace(heading=sample.heading + (1.0 if index in (20, 34, 35) else 0.1 * math.sin(index)))
        for index, sample in enumerate(swing(36))
    ]
    for index, sample in enumerate(samples):
        in_turn.update(sample.time, (sample,))
        if index not in (22, 25):
            shuffled.update(sample.time, (sample,))
        if index in (22 + late, 25 + late):
            shuffled.update(sample.time, (samples[index - late],))
    assert shuffled.state.fusion.innovation_mean == pytest.approx(in_turn.state.fusion.innovation_mean, rel=1.0e-12)
    assert shuffled.state.fusion == in_turn.state.fusion


def test_how_quick_the_loop_is_follows_speed_and_throttle() -> None:
    by_speed, by_thrust = estimator(), estimator()
    by_thrust.config = by_thrust.config._replace(law=DriveLaw(0.0, 2.0, -0.5, throttle=0.5))
    assert by_speed.state.quickness == by_thrust.state.quickness == 1.0
    by_speed.update(0.0, (SpeedSample(0.0, 2.315),))
    by_thrust.update(0.0, (ThrustSample(0.0, 0.25), SpeedSample(0.0, 4.63)))
    for tested, expected in ((by_speed, 0.5), (by_thrust, 0.5)):
        assert tested.state.quickness == pytest.approx(expected)
        assert tested.state.quickness == quickness(tested.config.law, MODEL, tested.state.model)
