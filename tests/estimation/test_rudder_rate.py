"""Steering gears, by the turns that they make, against a boat and a gear of the test's own."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from autopilot.estimation.rudder_observer import (
    AS_FILED,
    RudderRate,
    angle_of,
    begun_at,
    gone_by,
    measured_at,
    rudder_rate_step,
)
from autopilot.models.norrbin import Norrbin, yaw_acceleration
from autopilot.models.steering_gear import SteeringGear, gear_step

BOAT = Norrbin(0.2, 5.0, 5.0)
MOST, RATE = math.radians(30.0), math.radians(5.0)
DT = 0.1
UNKNOWN = begun_at(0.0)
FILED = SteeringGear(MOST, RATE)
CALM = 0.0, 0.0, 1.0


def found(
    slower: float,
    seconds: float = 30.0,
    boat: Norrbin = BOAT,
    push: Callable[[float], float] = lambda _: 0.0,
    noise: float = math.radians(0.05),
    size: float = math.radians(20.0),
    gear: SteeringGear = FILED,
    before: RudderRate = UNKNOWN,
) -> tuple[RudderRate, float]:
    """What is known after a square wave of commands, and where the rudder is."""
    random, state, rudder, rate = np.random.default_rng(1), before, 0.0, 0.0
    for tick in range(round(seconds / DT)):
        now = tick * DT
        command = 0.0 if now < 2.0 else size if now % 30.0 < 15.0 else -size
        rudder = gear_step(gear._replace(rate_max=gear.rate_max / slower), rudder, command, DT)
        rate += DT * yaw_acceleration(boat, rate, rudder + push(now))
        shown = rate + noise * random.standard_normal()
        state = rudder_rate_step(BOAT, state, (shown, command, False), CALM, gear, DT)
    return state, rudder


@pytest.mark.parametrize("slower", [1.0, 2.0, 4.0, 8.0])
def test_the_gear_that_turns_the_boat_is_gone_by(slower: float) -> None:
    state, rudder = found(slower, 50.0)
    assert state.slower == slower
    assert state.is_sure is (slower > 1.0)
    assert angle_of(state) == pytest.approx(rudder, abs=math.radians(0.1))
    assert gone_by(FILED, state).rate_max == pytest.approx(RATE / slower)


@pytest.mark.parametrize(("slower", "gone"), [(1.0, 1.0), (4.0, 4.0), (8.0, 8.0), (2.8, 2.8)])
def test_a_rate_that_a_sensor_showed_is_left_where_the_boat_answers_otherwise(slower: float, gone: float) -> None:
    """The sensor is silent since."""
    state, _ = found(slower, 120.0, before=measured_at(0.0, RATE, RATE / 2.8))
    assert state.slower == pytest.approx(gone)


@pytest.mark.parametrize("slower", [1.0, 8.0])
def test_the_lag_that_the_file_knows_is_no_slow_rudder(slower: float) -> None:
    """A quick gear that comes to its orders by a lag, as thrusters do."""
    state, rudder = found(slower, 50.0, gear=SteeringGear(MOST, 4.0 * RATE, lag=2.0))
    assert state.slower == slower
    assert angle_of(state) == pytest.approx(rudder, abs=math.radians(0.1))


@pytest.mark.parametrize("gain", [0.7, 1.4])
@pytest.mark.parametrize("lasts", [0.7, 1.4])
def test_a_boat_of_another_size_has_no_other_gear(gain: float, lasts: float) -> None:
    boat = BOAT._replace(gain=gain * BOAT.gain, time_constant=lasts * BOAT.time_constant)
    assert not found(1.0, 60.0, boat)[0].is_sure


def test_gusts_are_no_other_gear() -> None:
    assert found(1.0, 90.0, push=lambda now: math.radians(8.0) * math.sin(0.5 * now))[0].slower == 1.0


def test_a_rudder_that_hardly_moves_tells_nothing() -> None:
    state, _ = found(4.0, size=math.radians(1.0))
    assert (state.slower, state.sum_time) == (1.0, 0.0)


def test_a_course_unstable_boat_and_a_rudder_without_a_rate_are_left_alone() -> None:
    steered = 0.1, MOST, False
    assert rudder_rate_step(BOAT._replace(n1=-1.0), AS_FILED, steered, CALM, FILED, DT) is AS_FILED
    assert rudder_rate_step(BOAT, AS_FILED, steered, CALM, SteeringGear(MOST, math.inf), DT) is AS_FILED


@pytest.mark.parametrize(
    ("filed", "rate", "slower"),
    [(0.2, 0.05, 4.0), (0.2, 0.2, 1.0), (0.2, 0.3, 1.0), (0.2, math.inf, 1.0), (math.inf, math.inf, 1.0)],
)
def test_a_measured_rate_is_gone_by_where_it_is_less_than_filed(filed: float, rate: float, slower: float) -> None:
    known = measured_at(0.1, filed, rate)
    assert known.slower == pytest.approx(slower)
    assert known.is_sure is (slower > 1.0)
    assert gone_by(SteeringGear(0.6, filed), known).rate_max == pytest.approx(min(filed, rate))
