"""A rate sensor's standing error is found by compass and gyro alone, the noise of both by what they differ by from one
measurement to the next; what is neither is taken for none."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from boats import BOATS, vessel_of
from plant import Plant

from autopilot.angles import wrap
from autopilot.estimation.fusion import NO_NOISE, NO_RATE_BIAS, RateBias, bias_unknown, noise_step, rate_bias_step
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.signals import HeadingSample, Order, OrderKind, RateSample, Sample, SpeedSample
from autopilot.supervision.tuning import RATE_OFF, RATE_OFF_KNOWN
from autopilot.vessel.file import load_vessel

NOISE = math.radians(0.3) ** 2, math.radians(0.05) ** 2
DT = 0.1


def learnt(
    seconds: float,
    rate: Callable[[float], float],
    *,
    bias: float = 0.0,
    shows: Callable[[float], float] = lambda _: 0.0,
    seed: int = 1,
) -> list[RateBias]:
    """Return what is known after each pair of heading and rate of a boat that turns at rate(t) [rad/s]; the compass
    shows more by shows(t) [rad], the gyro by the bias [rad/s]."""
    random, heading, known = np.random.default_rng(seed), 3.0, [NO_RATE_BIAS]
    for index in range(round(seconds / DT)):
        now = index * DT
        shown = heading + shows(now) + math.sqrt(NOISE[0]) * float(random.standard_normal())
        measured = rate(now) + bias + math.sqrt(NOISE[1]) * float(random.standard_normal())
        known.append(rate_bias_step(known[-1], (now, wrap(shown), measured), NOISE))
        heading += DT * rate(now + 0.5 * DT)
    return known[1:]


def yawing(now: float) -> float:
    """Return the rate [rad/s] of a boat in a seaway."""
    return math.radians(4.0) * math.sin(0.9 * now)


@pytest.mark.parametrize("bias_deg_s", [-2.0, -0.3, 0.0, 0.3, 1.0])
def test_a_standing_error_is_learnt_in_a_seaway_within_half_a_minute(bias_deg_s: float) -> None:
    known = learnt(120.0, yawing, bias=math.radians(bias_deg_s))
    late = [math.degrees(each.bias) for each in known[300:]]
    assert max(abs(each - bias_deg_s) for each in late) < 0.1
    # its doubt is what it is off by
    assert 0.0 < math.degrees(math.sqrt(known[-1].p11)) < 0.1


@pytest.mark.parametrize("dt", [0.1, 0.2, 1.0])
@pytest.mark.parametrize("times", [1.0, 6.0, 10.0])
def test_an_error_is_known_no_sooner_than_the_compass_s_own_noise_allows(dt: float, times: float) -> None:
    """The file says 0.3 deg, and the compass has so many times that: within two seconds a right gyro was accused."""
    random = np.random.default_rng(20261129)
    wrong = 0
    for _ in range(40):
        known, sure = NO_RATE_BIAS, math.inf
        for index in range(round(120.0 / dt)):
            shown = math.sqrt(NOISE[0]) * times * float(random.standard_normal())
            rate = math.sqrt(NOISE[1]) * float(random.standard_normal())
            known = rate_bias_step(known, (index * dt, shown, rate), NOISE)
            if bias_unknown(known, NOISE[0]) < RATE_OFF_KNOWN:
                sure = min(index * dt, sure)
                wrong += abs(known.bias) > RATE_OFF
        # one heading a second that is so noisy is often taken for a gyro whose error has just changed
        assert sure < 60.0 or dt * times > 5.0
    assert wrong == 0


def test_an_error_that_appears_at_once_is_learnt_again() -> None:
    known: list[RateBias] = [NO_RATE_BIAS]
    for index in range(2000):
        now, bias = index * DT, math.radians(1.0 if index >= 1000 else 0.0)
        known.append(rate_bias_step(known[-1], (now, 0.0, bias), NOISE))
    assert math.degrees(known[1000].bias) == pytest.approx(0.0, abs=1.0e-9)
    assert math.degrees(known[1150].bias) == pytest.approx(1.0, abs=0.1)


def test_a_compass_that_lags_in_a_turn_shows_no_error_of_the_gyro() -> None:
    """Half a minute at 6 deg/s, the compass a second behind: 6 deg apart all the while."""

    def turning(now: float) -> float:
        return math.radians(6.0) if 60.0 <= now < 90.0 else 0.0

    def lag(now: float) -> float:
        since, passed = now - 60.0, now - 90.0
        behind = -(1.0 - math.exp(-since)) if since >= 0.0 else 0.0
        return math.radians(6.0) * (behind + (1.0 - math.exp(-passed) if passed >= 0.0 else 0.0))

    assert max(abs(math.degrees(each.bias)) for each in learnt(150.0, turning, shows=lag)[300:]) < 0.15


def test_an_angle_that_stays_is_no_error_of_the_gyro() -> None:
    """A deviation that changes by 5 deg, as iron beside a compass makes it."""
    known = learnt(150.0, yawing, shows=lambda now: math.radians(5.0) if now >= 60.0 else 0.0)
    assert max(abs(math.degrees(each.bias)) for each in known[800:]) < 0.1


def test_either_side_is_the_same() -> None:
    one, other = NO_RATE_BIAS, NO_RATE_BIAS
    for index in range(400):
        heading, rate = 0.3 * math.sin(0.1 * index), math.cos(0.1 * index) * 0.3 + 0.02
        one = rate_bias_step(one, (index * DT, heading, rate), NOISE)
        other = rate_bias_step(other, (index * DT, -heading, -rate), NOISE)
    assert other.bias == -one.bias
    assert other.p11 == one.p11


def test_without_a_rate_sensor_nothing_is_known() -> None:
    known = NO_RATE_BIAS
    for index in range(50):
        known = rate_bias_step(known, (index * DT, 0.1, math.nan), NOISE)
    assert known == NO_RATE_BIAS


def test_what_is_known_outlasts_a_gap_of_the_instruments() -> None:
    known = learnt(60.0, yawing, bias=math.radians(1.0))[-1]
    after = rate_bias_step(known, (known.time + 100.0, 2.0, math.radians(1.0)), NOISE)
    assert (after.bias, after.p11) == (known.bias, known.p11)
    assert after.heading == 2.0


@pytest.mark.parametrize("is_apart", [False, True], ids=["one instrument", "gyro apart"])
@pytest.mark.parametrize("name", BOATS)
def test_a_gyro_that_is_off_by_a_degree_a_second_turns_no_boat(name: str, *, is_apart: bool) -> None:
    """A slow boat lay 34 deg beside its course for as long as one watched, an unstable one 110 deg at 2 deg/s."""
    vessel, random = vessel_of(BOATS[name]), np.random.default_rng(20261127)
    pilot, plant = build_pilot(vessel), Plant(model_of(vessel), gear_of(vessel), step_max=0.05)
    farthest, late = 0.0, 0.0
    while plant.time < 400.0:
        now = plant.time
        heading = wrap(plant.heading + math.radians(0.1) * float(random.standard_normal()))
        rate = plant.rate + math.radians(0.05) * float(random.standard_normal())
        rate += math.radians(1.0) if now >= 200.0 else 0.0
        samples: tuple[Sample, ...] = (HeadingSample(now, heading, rate, "c"),)
        if is_apart:
            samples = (RateSample(now, rate, "g"), HeadingSample(now, heading, None, "c"))
        tick = pilot.step(now, samples, Order(OrderKind.HEADING, 0.0, serial=1))
        off = abs(math.degrees(wrap(plant.heading)))
        farthest, late = max(farthest, off), max(late, off if now >= 260.0 else 0.0)
        plant.step(tick.command.angle, DT)
    assert farthest < 10.0
    assert late < 1.0


@pytest.mark.parametrize("silent_s", [3.0, 8.0, 25.0])
@pytest.mark.parametrize("bias_deg_s", [0.0, 1.0])
def test_a_gyro_that_falls_silent_in_a_turn_is_no_worse_when_it_is_back(silent_s: float, bias_deg_s: float) -> None:
    """The boat ends its turn of 10 deg/s meanwhile; what the gyro said last holds no longer."""
    heading, known, bias = 0.0, [NO_RATE_BIAS], math.radians(bias_deg_s)
    for index in range(800):
        now = index * DT
        rate = math.radians(10.0) if 40.0 <= now < 46.0 else 0.0
        is_silent = 45.0 <= now < 45.0 + silent_s
        measured = math.nan if is_silent else rate + bias
        known.append(rate_bias_step(known[-1], (now, wrap(heading), measured), NOISE))
        heading += DT * rate
    since = [math.degrees(each.bias) - bias_deg_s for each in known[440:]]
    assert max(map(abs, since)) < 0.3, "as much as is supposed of a gyro of which nothing is known"


@pytest.mark.parametrize("name", ["lanxin", "middle"])
def test_a_gyro_apart_that_is_silent_from_a_turn_on_turns_no_boat_when_it_is_back(name: str) -> None:
    """It was taken to say on what it had said last: a boat that held its course was turned off it by 22 deg."""
    vessel = vessel_of(BOATS[name])
    pilot, plant = build_pilot(vessel), Plant(model_of(vessel), gear_of(vessel), step_max=0.05)
    turning, back, off = math.nan, math.inf, 0.0
    while plant.time < 160.0:
        now = plant.time
        half_way = 0.5 * abs(pilot.last_command.angle) * vessel.model.K_1_s
        if math.isnan(turning) and now > 60.0 and abs(plant.rate) > half_way:
            turning, back = now, now + 25.0
        samples: tuple[Sample, ...] = (HeadingSample(now, wrap(plant.heading), None, "c"),)
        if not turning <= now < back:
            samples = (RateSample(now, plant.rate, "g"), *samples)
        tick = pilot.step(now, samples, Order(OrderKind.HEADING, 0.5 if now > 60.0 else 0.0, serial=1))
        if now > back:
            off = max(off, abs(math.degrees(wrap(plant.heading - tick.reference.heading))))
        plant.step(tick.command.angle, DT)
    assert off < 3.0


@pytest.mark.parametrize("jump_deg", [20.0, -24.0])
def test_rates_refused_for_a_jump_of_the_compass_turn_no_boat_when_they_are_taken_again(jump_deg: float) -> None:
    """20 s long the rate at the refusal was taken for the gyro's error: 3.4 deg/s, and the boat went 8 deg off. With
    jumps watched nothing is refused for one."""
    vessel, random = load_vessel("lanxin"), np.random.default_rng(7)
    vessel = replace(vessel, alarms=replace(vessel.alarms, heading_jump_deg=None))
    pilot, plant = build_pilot(vessel), Plant(model_of(vessel), gear_of(vessel), step_max=0.05)
    off = 0.0
    while plant.time < 70.0:
        now = plant.time
        shown = math.radians(jump_deg if now >= 20.0 else 0.0) + math.radians(0.2) * float(random.standard_normal())
        rate = plant.rate + math.radians(0.1) * float(random.standard_normal())
        samples: tuple[Sample, ...] = (HeadingSample(now, wrap(plant.heading + shown), rate, "c"),)
        tick = pilot.step(now, samples, Order(OrderKind.HEADING, 0.0, serial=1))
        if now >= 38.0:
            off = max(off, abs(math.degrees(wrap(plant.heading)) + jump_deg))
        plant.step(tick.command.angle, 0.05)
    assert off < 1.0


@pytest.mark.parametrize("begins", [0.0, 30.0])
@pytest.mark.parametrize("name", ["lanxin", "middle"])
def test_a_dead_gyro_that_says_nought_for_good_does_not_let_the_boat_swing(name: str, begins: float) -> None:
    """It was refused for 20 s, believed again, and the boat swung by up to 38 deg each time, in gusts of 1 deg."""
    vessel, random = vessel_of(BOATS[name]), np.random.default_rng(5)
    push = math.radians(1.0)
    pilot = build_pilot(vessel)
    plant = Plant(
        model_of(vessel),
        gear_of(vessel),
        step_max=0.05,
        disturbance=lambda now: push * (math.sin(0.8 * now) + math.sin(0.31 * now + 1.0)),
    )
    farthest, late = 0.0, 0.0
    while plant.time < 240.0:
        now = plant.time
        heading = wrap(plant.heading + math.radians(0.2) * float(random.standard_normal()))
        rate = plant.rate + math.radians(0.05) * float(random.standard_normal()) if now < begins else 0.0
        samples = (RateSample(now, rate, "g"), HeadingSample(now, heading, None, "c"))
        course = 0.6 if now % 120.0 >= 60.0 else 0.0
        tick = pilot.step(now, samples, Order(OrderKind.HEADING, course, serial=1 + int(now // 60.0)))
        off = abs(math.degrees(wrap(plant.heading - tick.reference.heading)))
        farthest, late = max(farthest, off), max(late, off if now >= 120.0 else 0.0)
        plant.step(tick.command.angle, DT)
    assert farthest < 15.0
    assert late < 3.0


def noisy(real: float, shows: Callable[[float], float] = lambda _: 0.0, dt: float = DT) -> list[float]:
    """Return the deviations that are learnt in 300 s where the file says 1 and white noise is `real` times that; the
    filter leaves `shows` of the time unexplained."""
    random, known, found = np.random.default_rng(20261130), NO_NOISE, []
    for index in range(round(300.0 / dt)):
        innovation = real * float(random.standard_normal()) + shows(index * dt)
        known = noise_step(known, 1.0, innovation, 0.0, index * dt, 1.0)
        found.append(math.sqrt(known[0]))
    return found


@pytest.mark.parametrize(("real", "learnt_as"), [(1.0, 1.0), (3.0, 3.0), (20.0, 5.0), (0.2, 1.0)])
def test_noise_is_learnt_between_the_files_and_five_times_that(real: float, learnt_as: float) -> None:
    assert noisy(real)[-1500:] == pytest.approx([learnt_as] * 1500, rel=0.15)


@pytest.mark.parametrize(
    "shows",
    [lambda _: 8.0, lambda now: 0.05 * now, lambda now: 3.0 * math.sin(0.8 * now)],
    ids=["a constant", "a wind that grows", "waves"],
)
def test_what_stays_from_one_measurement_to_the_next_is_no_noise(shows: Callable[[float], float]) -> None:
    assert max(noisy(1.0, shows)) < 1.15


def test_measurements_too_far_apart_say_nothing_of_noise() -> None:
    assert noisy(3.0, dt=1.5)[-1] == 1.0


def test_one_wild_measurement_is_no_noise_for_long() -> None:
    found = noisy(1.0, lambda now: 30.0 if 100.0 <= now < 100.05 else 0.0)
    assert max(found) < 2.0
    assert found[-1] < 1.15


@pytest.mark.parametrize(
    ("real", "of_rate"), [((1.2, 0.2), True), ((0.3, 0.8), True), ((1.2, 0.2), False)], ids=["compass", "gyro", "alone"]
)
def test_an_instrument_noisier_than_filed_wears_no_rudder(real: tuple[float, float], of_rate: bool) -> None:
    """At most twice the travel in calm of a file that says so; it was 2.7 to 5.9 times."""

    def travel(filed: tuple[float, float]) -> float:
        usual, random = vessel_of(BOATS["lanxin"]), np.random.default_rng(20261130)
        sensors = replace(usual.sensors, heading_noise_deg=filed[0], rate_noise_deg_s=filed[1])
        pilot, moved, before = build_pilot(replace(usual, sensors=sensors)), 0.0, 0.0
        plant = Plant(model_of(usual), gear_of(usual), step_max=0.05)
        while plant.time < 180.0:
            noise = random.standard_normal(2) * np.radians(real)
            heading, rate = wrap(plant.heading + float(noise[0])), plant.rate + float(noise[1])
            sample = HeadingSample(plant.time, heading, rate if of_rate else None)
            command = pilot.step(plant.time, (sample,), Order(OrderKind.HEADING, 0.0, serial=1)).command.angle
            moved += abs(command - before) if plant.time > 60.0 else 0.0
            before = command
            plant.step(command, DT)
        return moved

    assert travel((0.3, 0.2)) < 2.0 * travel(real)


def test_what_wild_rates_made_of_the_sea_is_forgotten_when_they_are_found_apart_from_the_heading() -> None:
    pilot, swing, pace, ticks = build_pilot(load_vessel("lanxin")), math.radians(1.0), 2.0, []
    for k in range(220):
        now = 0.1 * k
        angle = pace * now + 1.4
        samples: list[Sample] = [HeadingSample(now, swing * math.sin(angle)), SpeedSample(now, 2.0)]
        if k % 5 == 0:
            scale = 57.3 if now >= 20.0 else 1.0
            samples.append(RateSample(now, scale * swing * pace * math.cos(angle)))
        ticks.append(pilot.step(now, tuple(samples), Order()))
    known = [[event.detail for event in tick.alarms if event.name == "rate_disagrees"] for tick in ticks]
    found = next(k for k, details in enumerate(known) if details)
    assert known[found] == ["22 deg apart"], "too few yet to say that it is in other units"
    assert abs(ticks[found - 1].state.bias) > math.radians(20.0)
    assert abs(ticks[found].state.bias) < math.radians(0.1)


@pytest.mark.parametrize("period", [0.9, 1.3, 1.7, 2.3, 3.1])
def test_waves_between_two_rates_are_no_standing_error(period: float) -> None:
    """5 deg/s by waves, a heading and a rate a second: what the rate does in between is in neither."""
    pace, most = 2.0 * math.pi / period, math.radians(5.0)
    for phase in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0):
        gyro = NO_RATE_BIAS
        for second in range(120):
            now = float(second)
            at = pace * now + phase
            measured = now, -most / pace * math.cos(at), most * math.sin(at)
            gyro = rate_bias_step(gyro, measured, (math.radians(0.3) ** 2, math.radians(0.2) ** 2))
            assert abs(gyro.bias) < RATE_OFF or gyro.p11 >= RATE_OFF_KNOWN
