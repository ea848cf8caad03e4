"""The heading filter against a Kalman filter written with matrices, and against what a stiff model does to it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from autopilot.estimation import heading_filter as ekf
from autopilot.estimation.heading_filter import FilterNoise, FilterState
from autopilot.models.norrbin import Norrbin, yaw_acceleration

NOMOTO = Norrbin(0.2, 5.0)
LANXIN = Norrbin(0.701, 0.332, 3.2828)
NOISE = FilterNoise(heading=1.0e-4, rate=4.0e-5, acceleration=2.0e-5, bias=3.0e-6)

Matrix = npt.NDArray[np.float64]


def matrices_of(state: FilterState) -> tuple[Matrix, Matrix]:
    _, psi, rate, bias, p00, p01, p02, p11, p12, p22 = state
    return np.array([psi, rate, bias]), np.array([[p00, p01, p02], [p01, p11, p12], [p02, p12, p22]])


def kalman_predict(model: Norrbin, x: Matrix, p: Matrix, rudder: float, dt: float) -> tuple[Matrix, Matrix]:
    """Linear case only: the transition from the matrix exponential of (psi, r, b, delta)."""
    a = np.zeros((4, 4))
    a[0, 1] = 1.0
    a[1] = [0.0, -model.n1 / model.time_constant, model.gain / model.time_constant, model.gain / model.time_constant]
    f = expm(a * dt)
    q = NOISE.acceleration * np.array([[dt**3 / 3, dt**2 / 2, 0], [dt**2 / 2, dt, 0], [0, 0, 0]])
    q[2, 2] = NOISE.bias * dt
    return f[:3, :3] @ x + f[:3, 3] * rudder, f[:3, :3] @ p @ f[:3, :3].T + q


def kalman_fuse(x: Matrix, p: Matrix, index: int, value: float, variance: float) -> tuple[Matrix, Matrix]:
    h = np.eye(3)[index : index + 1]
    gain = p @ h.T / (p[index, index] + variance)
    keep = np.eye(3) - gain @ h
    # Joseph's form, so that the algebra is not the same as the one under test
    return x + (gain * (value - x[index])).ravel(), keep @ p @ keep.T + variance * gain @ gain.T


@pytest.mark.parametrize("model", [NOMOTO, NOMOTO._replace(n1=-1.0)])
def test_on_a_linear_boat_it_is_the_kalman_filter(model: Norrbin) -> None:
    random = np.random.default_rng(7)
    state = ekf.initial(0.0, 0.2, None, NOISE)
    x, p = matrices_of(state)
    for step in range(60):
        dt, rudder = float(random.uniform(0.02, 0.8)), float(random.uniform(-0.05, 0.05))
        state = ekf.predict(model, NOISE, state, rudder, state.time + dt)
        x, p = kalman_predict(model, x, p, rudder, dt)
        heading, rate = float(x[0] + 0.01 * random.standard_normal()), float(x[1] + 0.005 * random.standard_normal())
        state = ekf.fuse_heading(state, heading, NOISE.heading)
        x, p = kalman_fuse(x, p, 0, heading, NOISE.heading)
        if step % 3 == 0:
            state = ekf.fuse_rate(state, rate, NOISE.rate)
            x, p = kalman_fuse(x, p, 1, rate, NOISE.rate)
        mean, covariance = matrices_of(state)
        assert np.abs(mean - x - [2.0 * math.pi * round((mean[0] - x[0]) / (2.0 * math.pi)), 0.0, 0.0]).max() < 1e-9
        assert np.abs(covariance - p).max() < 1e-12


def test_the_mean_follows_the_nonlinear_boat() -> None:
    state = ekf.initial(0.0, 0.0, 0.3, NOISE)
    for _ in range(200):
        state = ekf.predict(LANXIN, NOISE, state, -0.2, state.time + 0.01)
    exact = solve_ivp(
        lambda _, y: [y[1], yaw_acceleration(LANXIN, y[1], -0.2)], (0.0, 2.0), [0.0, 0.3], rtol=1e-10, atol=1e-12
    ).y[:, -1]
    assert state.psi == pytest.approx(exact[0], abs=1e-4)
    assert state.rate == pytest.approx(exact[1], abs=1e-4)


@given(st.floats(-3.1, 3.1), st.floats(-1.0, 1.0), st.floats(-1.6, 1.6), st.floats(0.0, 1.0))
def test_the_mean_alone_is_the_mean_of_the_whole(heading: float, rate: float, rudder: float, dt: float) -> None:
    state = ekf.initial(3.0, heading, rate, NOISE)
    moved = ekf.predict(LANXIN, NOISE, state, rudder, 3.0 + dt)
    assert ekf.predict_mean(LANXIN, state, rudder, 3.0 + dt) == (moved.psi, moved.rate)


@given(st.floats(-10.0, 10.0), st.floats(-1.6, 1.6), st.floats(0.0, 1.0))
def test_a_wild_rate_never_blows_the_filter_up(rate: float, rudder: float, dt: float) -> None:
    state = ekf.initial(0.0, 0.0, rate, NOISE)
    for _ in range(20):
        state = ekf.predict(LANXIN, NOISE, state, rudder, state.time + dt)
        assert ekf.is_sound(state)
        assert abs(state.rate) <= max(abs(rate), 2.0) + 1e-9


def test_the_innovation_goes_the_short_way_round() -> None:
    state = ekf.initial(0.0, math.radians(179.0), 0.0, NOISE)
    state = ekf.fuse_heading(state, math.radians(-179.0), NOISE.heading)
    assert abs(abs(math.degrees(state.psi)) - 180.0) < 0.01


def test_what_is_not_finite_or_negative_is_not_sound() -> None:
    state = ekf.initial(0.0, 0.0, 0.0, NOISE)
    assert ekf.is_sound(state)
    assert not ekf.is_sound(state._replace(psi=math.nan))
    assert not ekf.is_sound(state._replace(p11=-1.0e-9))
