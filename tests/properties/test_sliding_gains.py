"""Sliding mode laws: s' = -eta tanh(s/W) on the plant itself, surfaces, and gains that are refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from naval_vessel import linear_motion
from steersman import asked

from autopilot.angles import wrap
from autopilot.control import rudder_roll, sliding_heading
from autopilot.control.backstepping import BacksteppingGains, BoundedGains, backstepping_rudder
from autopilot.control.law import LawBoat
from autopilot.control.limits import RudderLimits
from autopilot.control.rudder_roll import Motion
from autopilot.control.sliding_heading import PAPER_SWAY_YAW, Sliding, SlidingGains
from autopilot.models.norrbin import Norrbin, yaw_acceleration
from autopilot.models.steering_gear import SteeringGear
from autopilot.signals import Reference
from sitl.roll_ship import NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED

MODELS = [
    Norrbin(0.701, 0.332, 3.2828),
    Norrbin(0.1, 20.0),
    Norrbin(0.2, 5.0, 20.0, n1=-1.0),
    Norrbin(0.3, 2.0, 5.0, 0.4, 1.0, 0.05),
]
GAINS = [SlidingGains(2.0, 1.1, 0.55), SlidingGains(0.13, 0.0026, 0.02)]
SHIP = linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
SWAY_YAW = SHIP.A[np.ix_([0, 2, 4], [0, 2, 4])], SHIP.b[[0, 2, 4]]
BOAT = LawBoat(MODELS[0], SteeringGear(0.6, 0.3), RudderLimits(0.6, 0.3), 0.1)
angle = st.floats(-math.pi, math.pi)
rates = st.floats(-0.5, 0.5)


def sliding_rudder(
    model: Norrbin, gains: SlidingGains, reference: Reference, heading: float, rate: float, bias: float = 0.0
) -> float:
    return sliding_heading.sliding_rudder(gains, asked(model, reference, heading, rate, bias=bias))


@given(angle, rates, angle, st.floats(-0.3, 0.3), st.floats(-1.0, 1.0), st.sampled_from(MODELS), st.sampled_from(GAINS))
def test_s_falls_as_promised_on_the_norrbin_plant(
    heading: float, rate: float, goal: float, goal_rate: float, acceleration: float, model: Norrbin, gains: SlidingGains
) -> None:
    """s' by the chain rule from the plant and not from the law; with |s| the Lyapunov function, |s|' <= 0 follows."""
    reference = Reference(goal, goal_rate, acceleration)
    rudder = sliding_rudder(model, gains, reference, heading, rate)
    surface = rate - goal_rate + gains.slope * wrap(heading - goal)
    change = yaw_acceleration(model, rate, rudder) - acceleration + gains.slope * (rate - goal_rate)
    assert change == pytest.approx(-gains.reach * math.tanh(surface / gains.boundary), rel=1e-7, abs=1e-8)
    assert surface * change <= 1e-9


@given(heading=st.floats(-1e-3, 1e-3), rate=st.floats(-1e-3, 1e-3), model=st.sampled_from(MODELS))
def test_in_its_layer_it_is_backstepping_without_gamma(heading: float, rate: float, model: Norrbin) -> None:
    gains, reference = GAINS[0], Reference(0.0)
    peer = BacksteppingGains(gains.slope, gains.reach / gains.boundary, 0.0)
    expected = backstepping_rudder(BoundedGains(peer), asked(model, reference, heading, rate), rate)
    assert sliding_rudder(model, gains, reference, heading, rate) == pytest.approx(expected, rel=1e-4, abs=1e-6)


def test_a_large_error_asks_for_no_more_rudder_than_the_reach() -> None:
    model, gains = MODELS[1], GAINS[1]
    most = model.time_constant / model.gain * gains.reach
    for error in (0.5, 1.5, 3.1):
        assert abs(sliding_rudder(model, gains, Reference(0.0), error, 0.0)) <= most + 1e-12


def test_the_bias_is_taken_off() -> None:
    with_bias = sliding_rudder(MODELS[0], GAINS[0], Reference(0.1), 0.0, 0.0, bias=0.04)
    assert with_bias == pytest.approx(sliding_rudder(MODELS[0], GAINS[0], Reference(0.1), 0.0, 0.0) - 0.04)


@pytest.mark.parametrize("bad", [(0.0, 1.0, 1.0), (1.0, -1.0, 1.0), (1.0, 1.0, math.nan), (math.inf, 1.0, 1.0)])
def test_gains_are_positive_and_finite(bad: tuple[float, float, float]) -> None:
    with pytest.raises(ValueError, match="positive and finite"):
        sliding_heading.sliding_gains(Sliding(*bad), BOAT)


@given(v=st.floats(-2.0, 2.0), r=st.floats(-0.1, 0.1), error=st.floats(-1.0, 1.0))
def test_s_falls_as_promised_on_sway_and_yaw(v: float, r: float, error: float) -> None:
    A, b = SWAY_YAW
    law = sliding_heading.sway_yaw_law(A, b, PAPER_SWAY_YAW)
    x, h = np.array([v, r, error]), np.array([law.h_v, law.h_r, law.h_psi])
    rudder = sliding_heading.sway_yaw_rudder(law, v, r, error)
    expected = -PAPER_SWAY_YAW.reach * math.tanh(float(h @ x) / PAPER_SWAY_YAW.boundary)
    assert float(h @ (A @ x + b * rudder)) == pytest.approx(expected, rel=1e-9, abs=1e-9)


@given(x=st.tuples(*(st.floats(-0.5, 0.5) for _ in range(5))))
def test_s_falls_as_promised_with_roll(x: tuple[float, ...]) -> None:
    gains = rudder_roll.PAPER_ROLL
    law = rudder_roll.roll_law(SHIP, gains)
    h = np.array([law.h_v, law.h_p, law.h_r, law.h_phi, law.h_psi])
    rudder = rudder_roll.roll_rudder(law, Motion(*x), 0.0)
    expected = -gains.reach * math.tanh(float(h @ np.array(x)) / gains.boundary)
    assert float(h @ (SHIP.A @ np.array(x) + SHIP.b * rudder)) == pytest.approx(expected, rel=1e-9, abs=1e-9)


def test_the_surface_is_the_eigenvector_of_the_zero_eigenvalue() -> None:
    gains = rudder_roll.PAPER_ROLL
    k = np.array([gains.k_v, gains.k_p, gains.k_r, gains.k_phi, 0.0])
    h = sliding_heading.sliding_surface(SHIP.A, SHIP.b, k)
    np.testing.assert_allclose((SHIP.A - np.outer(SHIP.b, k)).T @ h, 0.0, atol=1e-12)
    assert np.linalg.norm(h) == pytest.approx(1.0)
    assert h[-1] > 0.0


def test_the_papers_k_in_radians_is_unstable_and_refused() -> None:
    """(-5, -200, -100, -10) taken as radians of rudder per SI unit, in either sense of the rudder."""
    for side in (1.0, -1.0):
        as_radians = rudder_roll.RollGains(5.0 * side, 200.0 * side, 100.0 * side, 10.0 * side, 0.0751, 0.5)
        with pytest.raises(ValueError, match="in radians of rudder per SI unit"):
            rudder_roll.roll_law(SHIP, as_radians)


def test_the_heading_is_no_part_of_k() -> None:
    with pytest.raises(ValueError, match="pure integral"):
        sliding_heading.sliding_surface(SHIP.A, SHIP.b, np.array([0.0, 0.0, 0.0, 0.0, 0.1]))


def test_a_rudder_without_effect_is_refused() -> None:
    A, b = SWAY_YAW
    with pytest.raises(ValueError, match="does not move s"):
        sliding_heading.sway_yaw_law(A - 0.3 * np.diag([1.0, 1.0, 0.0]), 0.0 * b, PAPER_SWAY_YAW)


def test_the_papers_gains_are_those_it_prints() -> None:
    """Liu and Jin 2017, section 4: k in degrees of rudder per SI unit, eta 1.0512 for radians."""
    A, b = SWAY_YAW
    law = sliding_heading.sway_yaw_law(A, b, PAPER_SWAY_YAW)
    assert (math.degrees(law.k_v), math.degrees(law.k_r)) == pytest.approx((-10.0, -100.0))
    through = float(np.array([law.h_v, law.h_r, law.h_psi]) @ b)
    assert (law.switching * through, law.boundary) == pytest.approx((1.0512, 1.0))
