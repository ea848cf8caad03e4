"""The law's third step: Lyapunov decrease on the nonlinear boat, its linear motion, and the regulator it stands for."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import solve_continuous_are
from steersman import Steersman, asked

from autopilot.control import sliding_heading
from autopilot.control.backstepping import (
    BacksteppingGains,
    BoundedGains,
    backstepping_rudder,
    gains_at,
    gains_of_loop,
    linear_gains_backstepping,
    lqr_gains,
    smoothed_rudder,
    smoothing_in,
)
from autopilot.control.law import LawBoat
from autopilot.control.limits import RudderLimits
from autopilot.models.norrbin import Norrbin, damping, yaw_acceleration
from autopilot.models.steering_gear import SteeringGear
from autopilot.runtime.build import law_of, model_of
from autopilot.runtime.tuning import GainRequest, designed
from autopilot.signals import NavState, Reference
from autopilot.vessel.file import load_vessel

LANXIN = Norrbin(0.701, 0.332, 3.2828)
BOAT = LawBoat(Norrbin(0.2, 5.0), SteeringGear(0.6, 0.3), RudderLimits(0.6, 0.3), 0.1)
MODELS = [LANXIN, Norrbin(0.1, 20.0, 50.0), Norrbin(0.2, 5.0, 20.0, n1=-1.0), Norrbin(0.3, 2.0, 5.0, 0.4, 1.0, 0.05)]
MOMENT = 1.0e-7


def lyapunov(model: Norrbin, gains: BacksteppingGains, goal_rate: float, e: float, e1: float, e2: float) -> float:
    """V3 of the module's docstring, its integral by quadrature."""
    total, square, k3 = gains.k1 + gains.k2, gains.gamma + gains.k1 * gains.k2, 1.0 / gains.smoothing
    ratio = square / total

    def inner(y: float) -> float:
        step = 1.0e-4
        slope = (damping(model, goal_rate + y + step) - damping(model, goal_rate + y - step)) / (2.0 * step)
        return (k3 + slope / model.time_constant - ratio) * y

    kept = quad(inner, 0.0, e1, epsabs=1.0e-13)[0]
    passive = quad(lambda y: k3 * beyond(model, goal_rate, y) / model.time_constant, 0.0, e1, epsabs=1.0e-13)[0]
    return 0.5 * (e2 + ratio * e1) ** 2 + 0.5 * k3 * total * (e1 + ratio * e) ** 2 + ratio * kept + passive


def beyond(model: Norrbin, goal_rate: float, y: float) -> float:
    """p(y) of the module's docstring: the damping that is not cancelled."""
    nonlinear = model._replace(n1=0.0, n0=0.0)
    return damping(nonlinear, goal_rate + y) - damping(nonlinear, goal_rate)


@settings(max_examples=50)
@given(
    st.floats(-1.5, 1.5),
    st.floats(-0.4, 0.4),
    st.floats(-0.5, 0.5),
    st.floats(-0.2, 0.2),
    st.floats(0.3, 3.0),
    st.sampled_from(MODELS),
)
def test_v3_decreases_anywhere(
    error: float, rate_error: float, rudder: float, goal_rate: float, quickness: float, model: Norrbin
) -> None:
    """dV3/dt from the boat's and the law's own functions: -(a(r) - W/S) e''^2 - k3 W/S e' p(e')/T."""
    gains = lqr_gains(model, quickness / model.time_constant)
    total, square, k3 = gains.k1 + gains.k2, gains.gamma + gains.k1 * gains.k2, 1.0 / gains.smoothing
    reference, rate = Reference(0.4, goal_rate), goal_rate + rate_error

    def acceleration(rate: float, rudder: float) -> float:
        return yaw_acceleration(model, rate, rudder)

    wanted = backstepping_rudder(BoundedGains(gains), asked(model, reference, 0.4 + error, rate), goal_rate)
    moved = (smoothed_rudder(gains.smoothing, wanted, rudder, MOMENT) - rudder) / MOMENT
    e2 = acceleration(rate, rudder)
    slope = (acceleration(rate + MOMENT, rudder) - acceleration(rate - MOMENT, rudder)) / (2.0 * MOMENT)
    e3 = slope * e2 + model.gain / model.time_constant * moved

    def value(t: float) -> float:
        return lyapunov(model, gains, goal_rate, error + rate_error * t, rate_error + e2 * t, e2 + e3 * t)

    a, ratio, step = k3 - slope, square / total, 1.0e-4 / (1.0 + abs(e2) + abs(e3))
    promised = -(a - ratio) * e2 * e2
    promised -= k3 * ratio * rate_error * beyond(model, goal_rate, rate_error) / model.time_constant
    assert a > ratio
    scale = max(1.0, abs(promised), abs(e3) * (abs(e2) + ratio * abs(rate_error)))
    assert (value(step) - value(-step)) / (2.0 * step) == pytest.approx(promised, abs=2.0e-4 * scale)
    assert value(0.0) >= 0.0


def test_the_error_moves_as_promised() -> None:
    """e''' + a e'' + k3 S e' + k3 W e = 0 for a linear boat, rudder and boat integrated in small steps."""
    model = Norrbin(0.2, 5.0)
    gains = lqr_gains(model, 0.4)
    k3, n = 1.0 / gains.smoothing, model.n1 / model.time_constant
    total, square = gains.k1 + gains.k2, gains.gamma + gains.k1 * gains.k2
    heading, rate, rudder, dt, steps = 0.3, 0.0, 0.0, 1.0e-3, 9000
    for _ in range(steps):
        wanted = backstepping_rudder(BoundedGains(gains), asked(model, Reference(0.0), heading, rate), 0.0)
        moved = smoothed_rudder(gains.smoothing, wanted, rudder, dt)
        acceleration = yaw_acceleration(model, rate, 0.5 * (rudder + moved))
        heading += dt * rate + 0.5 * dt * dt * acceleration
        rate, rudder = rate + dt * acceleration, moved
    roots = np.roots([1.0, n + k3, k3 * total, k3 * square])
    shares = np.linalg.solve(np.vander(roots, 3, increasing=True).T, [0.3, 0.0, 0.0])
    exact = float((shares * np.exp(roots * dt * steps)).sum().real)
    assert 0.005 < abs(exact) < 0.2
    assert heading == pytest.approx(exact, abs=2.0e-3)


@given(st.floats(0.05, 5.0), st.sampled_from(MODELS))
def test_spared_gains_are_the_linear_quadratic_regulators(quickness: float, model: Norrbin) -> None:
    time = model.time_constant
    bandwidth = quickness / time
    found = lqr_gains(model, bandwidth)
    weight = model.gain / (time * bandwidth**3)
    # in units of the time constant, which keeps the matrices near 1
    a = np.array([[0.0, 1.0, 0.0], [0.0, -model.n1, model.gain * time], [0.0, 0.0, 0.0]])
    b, scaled = np.array([[0.0], [0.0], [1.0]]), (weight / time) ** 2
    riccati = solve_continuous_are(a, b, np.diag([1.0, 0.0, 0.0]), np.array([[scaled]]))
    on_error, on_rate, on_rudder = (b.T @ riccati / scaled)[0] / np.array([time, 1.0, time])
    linear = linear_gains_backstepping(model, found)
    assert 1.0 / found.smoothing == pytest.approx(on_rudder, rel=1.0e-5)
    assert linear.proportional / found.smoothing == pytest.approx(on_error, rel=1.0e-5)
    assert linear.derivative / found.smoothing == pytest.approx(on_rate, rel=1.0e-4, abs=1.0e-6 * on_error)
    assert min(found) > 0.0


@given(st.floats(0.1, 5.0), st.floats(0.01, 4.0))
def test_the_loop_wanted_is_the_loop_given(total: float, square: float) -> None:
    k1, k2, gamma, _ = gains = gains_of_loop(total, square)
    assert min(gains[:3]) > 0.0
    assert (k1 + k2, gamma + k1 * k2) == pytest.approx((total, square))


@given(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4), st.floats(0.1, 20.0), st.floats(0.0, 0.5))
def test_no_step_overshoots_and_two_halves_are_a_whole(wanted: float, last: float, smoothing: float, dt: float) -> None:
    plain = smoothed_rudder(smoothing, wanted, last, dt)
    assert min(last, wanted) - 1.0e-12 <= plain <= max(last, wanted) + 1.0e-12
    half = smoothed_rudder(smoothing, wanted, last, 0.5 * dt)
    assert smoothed_rudder(smoothing, wanted, half, 0.5 * dt) == pytest.approx(plain, abs=1.0e-12)
    assert smoothed_rudder(smoothing, wanted, last, 0.0) == last
    assert smoothed_rudder(0.0, wanted, last, dt) == wanted


@pytest.mark.parametrize("model", MODELS)
def test_a_planned_turn_with_rudder_is_not_slowed(model: Norrbin) -> None:
    assert smoothing_in(model, 0.8, Reference(1.0)) == 0.8
    for side in (1.0, -1.0):
        drive = side * model.gain / model.time_constant
        assert smoothing_in(model, 0.8, Reference(1.0, 0.0, math.radians(0.9) * drive)) == 0.8
        assert smoothing_in(model, 0.8, Reference(1.0, 0.0, math.radians(1.1) * drive)) == 0.0


def test_smoothing_goes_with_the_speed_like_the_gains() -> None:
    gains = BacksteppingGains(1.0, 1.0, 0.5, 0.8)
    assert gains_at(gains, 0.5) == (0.5, 0.5, 0.125, 1.6)


@pytest.mark.parametrize("planned_deg", [-1.02, -0.98, 0.98, 1.02])
def test_a_planned_turn_of_more_than_a_degree_of_rudder_is_not_smoothed(planned_deg: float) -> None:
    model = Norrbin(0.2, 5.0, n0=0.01)
    reference = Reference(0.0, 0.2 * math.radians(planned_deg))
    assert smoothing_in(model, 0.7, reference) == (0.0 if abs(planned_deg) > 1.0 else 0.7)
    assert smoothing_in(model, 0.0, Reference(0.0)) == 0.0


@pytest.mark.parametrize(
    ("ratio", "followed"), [(0.0, 0.2), (0.19, 0.2), (0.5, 0.5), (1.4, 1.4), (1.6, 1.5), (9.0, 1.5)]
)
def test_gains_follow_the_speed_from_a_fifth_to_one_and_a_half(ratio: float, followed: float) -> None:
    found = gains_at(BacksteppingGains(0.3, 0.5, 0.2, 0.6), ratio)
    assert found == pytest.approx((0.3 * followed, 0.5 * followed, 0.2 * followed**2, 0.6 / followed))
    sliding = sliding_heading.gains_at(sliding_heading.SlidingGains(0.3, 0.4, 0.5), ratio)
    assert sliding == pytest.approx((0.3 * followed, 0.4 * followed**2, 0.5 * followed))


@pytest.mark.parametrize("place", range(3))
@pytest.mark.parametrize("bad", [0.0, -0.1, math.inf, math.nan])
def test_the_sliding_law_takes_positive_and_finite_gains(place: int, bad: float) -> None:
    gains = [0.3, 0.4, 0.5]
    gains[place] = bad
    with pytest.raises(ValueError, match="positive and finite"):
        sliding_heading.sliding_gains(sliding_heading.Sliding(*gains), BOAT)


@pytest.mark.parametrize(("kind", "rests"), [("two_thrusters", False), ("outboard", True)])
def test_a_gear_rests_between_small_errors_and_thrusters_do_not(kind: str, rests: bool) -> None:
    """The difference of two thrusts wears nothing; a band about it lets a quick boat swing by degrees."""
    shipped = load_vessel("twin_thruster")
    vessel = designed(dataclasses.replace(shipped, drive=dataclasses.replace(shipped.drive, kind=kind)), GainRequest(5))
    model = model_of(vessel)
    law = Steersman(law_of(vessel, "backstepping"), model.reference_speed)
    rudder, stood = 0.0, 0
    for tick in range(1200):
        off = math.radians(0.3) * math.sin(0.05 * tick)
        now = law.update(
            model, Reference(0.0), NavState(0.0, off, 0.0, model.reference_speed, 0.0, 0.0, 0.0, True), rudder, 0.05
        )
        stood += tick >= 600 and now == rudder
        rudder = now
    assert (stood > 100) is rests
    assert rests or stood < 6
