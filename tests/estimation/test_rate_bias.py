"""A rate sensor's standing error is found by compass and gyro alone, and what is no such error is taken for none."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from boats import BOATS, vessel_of
from plant import Plant

from autopilot.angles import wrap
from autopilot.estimation.rate_bias import NO_RATE_BIAS, RateBias, rate_bias_step
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.signals import HeadingSample, Order, OrderKind, RateSample, Sample

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
