"""Wave feedforward: the push cancelled at the angle it is worth, the share that is the least of rms and rudder rate."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_lyapunov
from scipy.optimize import minimize

from autopilot.control.limits import RudderLimits
from autopilot.control.wave_feedforward import (
    LEAST_SHARE,
    NO_FEEDFORWARD,
    REACHED,
    SLOWING,
    CornerFrequencies,
    WaveFeedforward,
    Waves,
    feedforward,
    wave_feedforward,
)
from autopilot.estimation import disturbance as wave_motion
from autopilot.estimation.disturbance import filtered_share
from autopilot.estimation.tuning import WAVE_EXTREME, WAVE_EXTREME_LEAST, WAVE_STIFFENING
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear

LANXIN = Norrbin(0.701, 0.332, 3.2828, reference_speed=4.63)
GEAR = SteeringGear(math.radians(30.0), math.radians(15.0), lag=0.1, delay=0.05)
IDEAL = SteeringGear(math.radians(30.0), math.inf)
FREE, SLOW = RudderLimits(math.inf, math.inf), RudderLimits(math.inf, math.radians(10.0))
CORNER = 2.0

frequencies = st.floats(0.4, 4.0)
headings = st.floats(-0.05, 0.05)
rates = st.floats(-0.1, 0.1)


def push_of(model: Norrbin, heading: float, acceleration: float, rate: float) -> float:
    return acceleration + model.n1 / model.time_constant * rate


@pytest.mark.parametrize("w", [0.4, 0.8, 1.5, 3.0])
def test_the_share_is_what_an_optimiser_finds(w: float) -> None:
    n, k = LANXIN.n1 / LANXIN.time_constant, LANXIN.gain / LANXIN.time_constant
    weight = k / CORNER**3

    def cost(rudder: np.ndarray) -> float:
        # answers to a push of 1 at e^(j w t), the rudder a complex number
        angle = complex(rudder[0], rudder[1])
        error = (k * angle + 1.0) / (-w * w + 1j * w * n)
        return float(abs(error) ** 2 + (weight * w * abs(angle)) ** 2)

    best = minimize(cost, [0.0, 0.0], method="BFGS", options={"gtol": 1e-12}).x
    # the sea's frequency is that of the bare oscillator
    share = (
        1.0 - feedforward(LANXIN, IDEAL, FREE, CORNER, Waves(0.0, 0.0, 1e-6, w / math.sqrt(WAVE_STIFFENING))).filtered
    )
    assert -best[0] * k == pytest.approx(
        share if share > 0.0 else 0.0, abs=max(1e-5, LEAST_SHARE if share == 0.0 else 0.0)
    )
    assert abs(best[1] * k) < 1e-5


@given(frequencies, headings, rates)
def test_what_is_undone_is_the_push_behind_the_motion(w0: float, heading: float, rate: float) -> None:
    found = feedforward(LANXIN, IDEAL, FREE, 1.0e3, Waves(heading, rate, 1.0e-6, w0))
    # all of it, at this corner: the rudder's acceleration is the waves' own, turned round
    assert found.filtered == pytest.approx(0.0, abs=1e-6)
    swing = w0 * w0 * WAVE_STIFFENING
    push = push_of(LANXIN, heading, -swing * heading, rate)
    assert LANXIN.gain / LANXIN.time_constant * found.rudder == pytest.approx(-push, abs=0.45 * w0 * abs(rate) + 1e-9)


@given(frequencies, headings, rates, st.floats(1e-4, 0.2), st.floats(0.05, 20.0))
def test_odd_symmetry_and_bounds(w0: float, heading: float, rate: float, deviation: float, corner: float) -> None:
    found = feedforward(LANXIN, GEAR, SLOW, corner, Waves(heading, rate, deviation, w0))
    other = feedforward(LANXIN, GEAR, SLOW, corner, Waves(-heading, -rate, deviation, w0))
    assert other == WaveFeedforward(found.filtered, -found.rudder)
    assert 0.0 <= found.filtered <= 1.0
    assert math.isfinite(found.rudder)


@given(frequencies, st.floats(0.02, 1.0), st.floats(0.05, 0.8), st.floats(0.05, 0.5))
def test_gear_and_limits_undo_what_they_can(w0: float, deviation: float, angle_max: float, rate_max: float) -> None:
    limits = RudderLimits(angle_max, rate_max)
    share = 1.0 - feedforward(LANXIN, GEAR, limits, 1.0e3, Waves(0.0, 0.0, deviation, w0)).filtered
    n, swing = LANXIN.n1 / LANXIN.time_constant, w0 * math.sqrt(WAVE_STIFFENING)
    angle = share * REACHED * deviation * LANXIN.time_constant / LANXIN.gain * swing * math.hypot(swing, n)
    assert angle <= min(GEAR.angle_max, angle_max) * (1.0 + 1e-9)
    assert angle * swing <= min(GEAR.rate_max, rate_max) * (1.0 + 1e-9)


def test_the_rudder_leads_by_lag_and_delay() -> None:
    w0, deviation = 0.8, 0.01
    swing = w0 * math.sqrt(WAVE_STIFFENING)
    late = GEAR.lag + GEAR.delay

    def rudder(gear: SteeringGear, time: float) -> float:
        waves = Waves(deviation * math.cos(swing * time), -swing * deviation * math.sin(swing * time), deviation, w0)
        return feedforward(LANXIN, gear, FREE, 3.0, waves).rudder

    early = GEAR._replace(angle_max=math.inf, rate_max=math.inf)
    for time in (0.0, 1.0, 2.5):
        assert rudder(early, time) == pytest.approx(rudder(IDEAL._replace(angle_max=math.inf), time + late))


def test_without_a_sea_nothing_is_done_and_without_the_wish_waves_are_left_alone() -> None:
    assert (
        wave_feedforward(LANXIN, GEAR, SLOW, CornerFrequencies(1.0, 2.0), 1.0, Waves(0.0, 0.0, 0.0, 0.0))
        == NO_FEEDFORWARD
    )
    waves = Waves(0.02, 0.01, 0.02, 0.9)
    assert wave_feedforward(LANXIN, GEAR, SLOW, CornerFrequencies(1.0), 1.0, waves) == WaveFeedforward(
        filtered_share(0.9, 1.0), 0.0
    )
    assert wave_feedforward(LANXIN, GEAR, SLOW, CornerFrequencies(math.inf), 1.0, waves) == NO_FEEDFORWARD, (
        "a trial goes by the heading as it is"
    )
    assert wave_feedforward(LANXIN, GEAR, SLOW, CornerFrequencies(1.0, 2.0), 0.5, waves) == feedforward(
        LANXIN, GEAR, SLOW, 1.0, waves
    )


@given(st.floats(-1.0, 1.0), st.floats(1e-4, 0.1), st.sampled_from([0.0, 2.0]))
def test_what_is_too_much_for_waves_is_shown_to_the_law(
    heading: float, deviation: float, feedforward_below: float
) -> None:
    def hidden(angle: float) -> float:
        return wave_feedforward(
            LANXIN, GEAR, SLOW, CornerFrequencies(0.5, feedforward_below), 1.0, Waves(angle, 0.0, deviation, 0.9)
        ).filtered

    most = math.hypot(WAVE_EXTREME * deviation, WAVE_EXTREME_LEAST)
    assert abs(hidden(heading) * heading) <= most * (1.0 + 1e-9)
    assert hidden(-heading) == hidden(heading)
    if abs(heading) <= most:
        assert hidden(heading) == hidden(0.0), "a wave is a wave"


def test_the_slowing_is_the_regression_of_the_acceleration_on_the_rate() -> None:
    """From the covariance of the oscillator of `waves`, w0 = 1: E[h'' | h, h'] = -stiffness h - slowing h'."""
    xi, c = wave_motion.WAVE_DAMPING, wave_motion.WAVE_CORNER
    row = np.array([-1.0 - 2.0 * xi * c, -2.0 * xi - c, -1.0])
    a = np.array([[0.0, 1.0, 0.0], row, [c, 0.0, 0.0]])
    spread = solve_continuous_lyapunov(a, -np.diag([0.0, 1.0, 0.0]))
    on_both = (row @ spread[:, :2]) @ np.linalg.inv(spread[:2, :2])
    assert on_both == pytest.approx([-WAVE_STIFFENING, -SLOWING])
    free = IDEAL._replace(angle_max=math.inf)
    for heading, rate in ((1.0, 0.0), (0.0, 1.0)):
        found = feedforward(LANXIN, free, FREE, 3.0, Waves(heading, rate, 1.0e-9, 1.0))
        push = float(on_both @ (heading, rate)) + LANXIN.n1 / LANXIN.time_constant * rate
        assert found.rudder == pytest.approx(-(1.0 - found.filtered) * push * LANXIN.time_constant / LANXIN.gain)


def test_less_than_a_fiftieth_is_not_worth_a_movement() -> None:
    """Where the rudder's angle binds, the share goes with it."""
    waves, free = Waves(0.01, 0.02, 0.02, 0.8), IDEAL._replace(angle_max=math.inf)

    def at(angle: float) -> WaveFeedforward:
        return feedforward(LANXIN, free, FREE._replace(angle_max=angle), 3.0, waves)

    share = 1.0 - at(2.0e-3).filtered
    assert 1.0 - at(1.0e-3).filtered == pytest.approx(0.5 * share)
    least = 2.0e-3 * 0.02 / share
    assert 1.0 - at(1.001 * least).filtered == pytest.approx(0.02002)
    assert at(1.001 * least).rudder != 0.0
    assert at(0.999 * least) == WaveFeedforward(1.0, 0.0)
