"""What a law is shown of the waves, and the regulator's rudder for them beside a Riccati equation that knows them."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov, solve_sylvester

from autopilot.control.backstepping import (
    LAGGED,
    BoundedGains,
    ClosedLoop,
    in_proportion,
    lqr_gains,
    wave_rudder,
)
from autopilot.control.law import NO_ROLL, LawInput
from autopilot.control.limits import RudderLimits
from autopilot.estimation.path_delay import swung
from autopilot.estimation.tuning import (
    WAVE_CORNER,
    WAVE_DAMPING,
    WAVE_EXTREME,
    WAVE_EXTREME_LEAST,
    WAVE_STIFFENING,
)
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.signals import NavState, Reference
from autopilot.steering import REACHED, CornerFrequencies, filtered_share, followed_share, wave_shares

LANXIN = Norrbin(0.701, 0.332, 3.2828, reference_speed=4.63)
UNSTABLE = Norrbin(0.04, 60.0, 4.0e4, n1=-1.0, reference_speed=7.0)
GEAR = SteeringGear(math.radians(30.0), math.radians(15.0), lag=0.1, delay=0.05)
SLOW = RudderLimits(math.inf, math.radians(10.0))

frequencies = st.floats(0.4, 4.0)
headings = st.floats(-0.05, 0.05)
rates = st.floats(-0.1, 0.1)


def oscillator(w0: float) -> np.ndarray:
    c = WAVE_CORNER * w0
    slope = -2.0 * WAVE_DAMPING * w0
    return np.array([[0.0, 1.0, 0.0], [-w0 * w0 + slope * c, slope - c, -w0 * w0], [c, 0.0, 0.0]])


def loop_of(model: Norrbin, bandwidth: float) -> ClosedLoop:
    gains = lqr_gains(model, bandwidth)
    k3 = 1.0 / gains.smoothing
    return ClosedLoop(k3, k3 * (gains.k1 + gains.k2), k3 * (gains.gamma + gains.k1 * gains.k2))


@pytest.mark.parametrize("model", [LANXIN, UNSTABLE])
@pytest.mark.parametrize("bandwidth", [0.1, 0.5, 2.0])
@pytest.mark.parametrize("w0", [0.4, 1.0, 3.0])
def test_the_wave_rudder_is_the_best_that_a_riccati_equation_finds(model: Norrbin, bandwidth: float, w0: float) -> None:
    n, drive = model.n1 / model.time_constant, model.gain / model.time_constant
    a = np.array([[0.0, 1.0, 0.0], [0.0, -n, drive], [0.0, 0.0, 0.0]])
    b, cost = np.array([[0.0], [0.0], [1.0]]), np.diag([1.0, 0.0, 0.0])
    weight = np.array([[(drive / bandwidth**3) ** 2]])
    riccati = solve_continuous_are(a, b, cost, weight)
    feedback = np.linalg.solve(weight, b.T @ riccati)
    waves = oscillator(w0)
    pushed = np.zeros((3, 3))
    pushed[1] = waves[1] + n * np.array([0.0, 1.0, 0.0])
    # (A - B F)' P + P M = -riccati pushed
    coupled = solve_sylvester((a - b @ feedback).T, waves, -riccati @ pushed)
    on_waves = np.linalg.solve(weight, b.T @ coupled)[0]
    loop = loop_of(model, bandwidth)
    for heading, rate in ((0.02, 0.0), (0.0, 0.01), (-0.01, 0.03)):
        state = np.array([heading, rate, LAGGED * rate / w0])
        wanted = -float(on_waves @ state) / loop.k3
        assert wave_rudder(model, loop, heading, rate, w0) == pytest.approx(wanted, rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("model", [LANXIN, UNSTABLE])
@pytest.mark.parametrize("bandwidth", [0.1, 0.5, 2.0])
def test_a_wind_that_wanders_is_met_as_quickly_as_a_riccati_equation_meets_it(model: Norrbin, bandwidth: float) -> None:
    """The rudder u is a state, u' = -K x - K_u u - K_d d, and a push d that wanders has K_d = K_u: d goes through the
    low-pass of the third step, and through no other."""
    n, drive = model.n1 / model.time_constant, model.gain / model.time_constant
    a = np.array([[0.0, 1.0, 0.0], [0.0, -n, drive], [0.0, 0.0, 0.0]])
    b, weight = np.array([[0.0], [0.0], [1.0]]), np.array([[(drive / bandwidth**3) ** 2]])
    riccati = solve_continuous_are(a, b, np.diag([1.0, 0.0, 0.0]), weight)
    feedback = np.linalg.solve(weight, b.T @ riccati)
    coupled = np.linalg.solve((a - b @ feedback).T, -riccati @ a[:, 2])
    on_push = float(np.linalg.solve(weight, b.T @ coupled)[0])
    assert on_push == pytest.approx(float(feedback[0, 2]), rel=1e-6)
    bounded, dt, push = BoundedGains(lqr_gains(model, bandwidth)), 1.0e-6, 0.01
    at = NavState(0.0, 0.0, 0.0, model.reference_speed, 0.0, push, 0.0, True)
    given = LawInput(model, 1.0, Reference(0.0), at, NO_ROLL, 0.0, 0.5, dt)
    still = in_proportion(bounded, given._replace(state=at._replace(bias=0.0)))
    assert (in_proportion(bounded, given) - still) / dt == pytest.approx(-on_push * push, rel=1e-4)


def test_the_lag_is_the_regression_on_heading_and_rate() -> None:
    """From the oscillator's covariance, w0 = 1: E[e | h, h'] = lagged h'."""
    spread = solve_continuous_lyapunov(oscillator(1.0), -np.diag([0.0, 1.0, 0.0]))
    on_both = spread[2, :2] @ np.linalg.inv(spread[:2, :2])
    assert on_both == pytest.approx([0.0, LAGGED], abs=1e-12)


@given(frequencies, headings, rates, st.floats(0.05, 20.0))
def test_slow_waves_are_cancelled_and_the_rudder_is_odd(w0: float, heading: float, rate: float, corner: float) -> None:
    loop = loop_of(LANXIN, corner)
    found = wave_rudder(LANXIN, loop, heading, rate, w0)
    assert math.isfinite(found)
    assert wave_rudder(LANXIN, loop, -heading, -rate, w0) == -found
    quick, n = loop_of(LANXIN, 1.0e3), LANXIN.n1 / LANXIN.time_constant
    accelerated = float(oscillator(w0)[1] @ [heading, rate, LAGGED * rate / w0])
    push = (accelerated + n * rate) * LANXIN.time_constant / LANXIN.gain
    scale = (w0 * w0 * abs(heading) + w0 * abs(rate)) * LANXIN.time_constant / LANXIN.gain
    assert wave_rudder(LANXIN, quick, heading, rate, w0) == pytest.approx(-push, abs=0.05 * scale + 1e-12)


def test_no_waves_take_no_rudder() -> None:
    assert wave_rudder(LANXIN, loop_of(LANXIN, 1.0), 0.0, 0.0, 0.0) == 0.0


@given(frequencies, st.floats(0.02, 1.0), st.floats(0.05, 0.8), st.floats(0.05, 0.5))
def test_gear_and_limits_are_shown_what_they_can_follow(
    w0: float, deviation: float, angle_max: float, rate_max: float
) -> None:
    limits, corner = RudderLimits(angle_max, rate_max), 2.0
    followed = followed_share(LANXIN, GEAR, limits, corner, (deviation, w0))
    n, swing = LANXIN.n1 / LANXIN.time_constant, w0 * math.sqrt(WAVE_STIFFENING)
    share = followed / (1.0 + swing**4 * (swing**2 + n * n) / corner**6)
    angle = share * REACHED * deviation * LANXIN.time_constant / LANXIN.gain * swing * math.hypot(swing, n)
    assert 0.0 < followed <= 1.0
    assert angle <= min(GEAR.angle_max, angle_max) * (1.0 + 1e-9)
    assert angle * swing <= min(GEAR.rate_max, rate_max) * (1.0 + 1e-9)


def test_waves_swing_on_by_themselves() -> None:
    w0, deviation = 0.8, 0.01
    swing = w0 * math.sqrt(WAVE_STIFFENING)
    ahead = swung(deviation, 0.0, w0, 0.3)
    assert ahead == pytest.approx((deviation * math.cos(0.3 * swing), -swing * deviation * math.sin(0.3 * swing)))


def test_what_laws_without_and_with_a_weight_are_shown() -> None:
    waves, none = (0.0002, 0.0002, 0.9), (0.0, 0.0)
    still = 0.0, 0.0, 0.0
    assert wave_shares(LANXIN, GEAR, SLOW, CornerFrequencies(1.0, 2.0), 1.0, still) == none
    assert wave_shares(LANXIN, GEAR, SLOW, CornerFrequencies(1.0), 1.0, waves) == (filtered_share(0.9, 1.0), 0.0)
    assert wave_shares(LANXIN, GEAR, SLOW, CornerFrequencies(math.inf), 1.0, waves) == none, (
        "a trial goes by the heading as it is"
    )
    assert wave_shares(LANXIN, GEAR, SLOW, CornerFrequencies(1.0, 2.0), 1.0, waves) == (0.0, 1.0)


@given(st.floats(-1.0, 1.0), st.floats(1e-4, 0.1), st.sampled_from([0.0, 2.0]))
def test_what_is_too_much_for_waves_is_the_boats_own(heading: float, deviation: float, weighted: float) -> None:
    def taken(angle: float) -> float:
        found = wave_shares(LANXIN, GEAR, SLOW, CornerFrequencies(0.5, weighted), 1.0, (angle, deviation, 0.9))
        return sum(found)

    most = math.hypot(WAVE_EXTREME * deviation, WAVE_EXTREME_LEAST)
    assert abs(taken(heading) * heading) <= most * (1.0 + 1e-9)
    assert taken(-heading) == taken(heading)
    if abs(heading) <= most:
        assert taken(heading) == taken(0.0), "a wave is a wave"
