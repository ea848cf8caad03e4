"""The heading filter against a Kalman filter written with matrices, and against what a stiff model does to it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm, solve_continuous_lyapunov

from autopilot.estimation import disturbance as wave_motion
from autopilot.estimation import heading_ekf as ekf
from autopilot.estimation.disturbance import NO_SEA, FilterNoise, Sea, frequency
from autopilot.estimation.heading_ekf import FilterState, fuse_heading, fuse_rate, innovations, is_sound
from autopilot.models.norrbin import Norrbin, yaw_acceleration

NOMOTO = Norrbin(0.2, 5.0)
LANXIN = Norrbin(0.701, 0.332, 3.2828)
NOISE = FilterNoise(heading=1.0e-4, rate=4.0e-5, acceleration=2.0e-5, bias=3.0e-6)

Matrix = npt.NDArray[np.float64]


SEA = Sea(math.radians(1.0) ** 2, (0.9 * math.radians(1.0)) ** 2)


def matrices_of(state: FilterState) -> tuple[Matrix, Matrix]:
    order = ("00", "01", "02", "03", "04", "05", "11", "12", "13", "14", "15", "22", "23", "24", "25")
    order += ("33", "34", "35", "44", "45", "55")
    p = np.zeros((6, 6))
    for name in order:
        i, j = int(name[0]), int(name[1])
        p[i, j] = p[j, i] = getattr(state, f"p{name}")
    return np.array([state.psi, state.rate, state.bias, state.wave, state.wave_rate, state.wave_lag]), p


def wave_matrix(sea: Sea) -> Matrix:
    """The oscillator of wave_motion's docstring as it stands there: (h, s, e)' = A (h, s, e) + noise."""
    w0, xi, kappa = frequency(sea), wave_motion.WAVE_DAMPING, wave_motion.WAVE_CORNER
    c = kappa * w0
    return np.array([[0.0, 1.0, 0.0], [-w0 * w0 - 2 * xi * w0 * c, -2 * xi * w0 - c, -w0 * w0], [c, 0.0, 0.0]])


def balance_of(sea: Sea) -> Matrix:
    shape = solve_continuous_lyapunov(wave_matrix(sea), -np.diag([0.0, 1.0, 0.0]))
    return np.asarray(sea.heading * shape / shape[0, 0])


def kalman_predict(model: Norrbin, x: Matrix, p: Matrix, rudder: float, dt: float, sea: Sea) -> tuple[Matrix, Matrix]:
    """Linear case only: the transition from the matrix exponential of (psi, r, b, h, s, e, delta)."""
    a = np.zeros((7, 7))
    a[0, 1] = 1.0
    a[1, 1] = -model.n1 / model.time_constant
    a[1, 2] = a[1, 6] = model.gain / model.time_constant
    q = np.zeros((6, 6))
    q[:2, :2] = NOISE.acceleration * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    q[2, 2] = NOISE.bias * dt
    if sea.heading > 0.0:
        a[3:6, 3:6] = wave_matrix(sea)
        step, balance = expm(a[3:6, 3:6] * dt), balance_of(sea)
        q[3:, 3:] = balance - step @ balance @ step.T
    f = expm(a * dt)
    return f[:6, :6] @ x + f[:6, 6] * rudder, f[:6, :6] @ p @ f[:6, :6].T + q


def kalman_fuse(x: Matrix, p: Matrix, index: int, value: float, variance: float) -> tuple[Matrix, Matrix]:
    h = np.zeros((1, 6))
    h[0, index] = h[0, index + 3] = 1.0
    gain = p @ h.T / (h @ p @ h.T + variance)
    keep = np.eye(6) - gain @ h
    # Joseph's form, so that the algebra is not the same as the one under test
    return x + (gain * (value - h @ x)).ravel(), keep @ p @ keep.T + variance * gain @ gain.T


@pytest.mark.parametrize("sea", [NO_SEA, SEA])
@pytest.mark.parametrize("model", [NOMOTO, NOMOTO._replace(n1=-1.0)])
def test_on_a_linear_boat_it_is_the_kalman_filter(model: Norrbin, sea: Sea) -> None:
    random = np.random.default_rng(7)
    state = ekf.initial(0.0, 0.2, None, NOISE)
    if sea.heading > 0.0:
        p33, p44, p45, p55 = wave_motion.in_balance(sea, frequency(sea))
        state = state._replace(sea=sea, p33=p33, p44=p44, p45=p45, p55=p55)
    x, p = matrices_of(state)
    for step in range(60):
        dt, rudder = float(random.uniform(0.02, 0.8)), float(random.uniform(-0.05, 0.05))
        state = ekf.predict(model, NOISE, state, rudder, state.time + dt)
        x, p = kalman_predict(model, x, p, rudder, dt, sea)
        heading = float(x[0] + x[3] + 0.01 * random.standard_normal())
        rate = float(x[1] + x[4] + 0.005 * random.standard_normal())
        state = fuse_heading(state, heading, NOISE.heading)
        x, p = kalman_fuse(x, p, 0, heading, NOISE.heading)
        if step % 3 == 0:
            state = fuse_rate(state, rate, NOISE.rate)
            x, p = kalman_fuse(x, p, 1, rate, NOISE.rate)
        mean, covariance = matrices_of(state)
        turns = 2.0 * math.pi * round((mean[0] - x[0]) / (2.0 * math.pi))
        assert np.abs(mean - x - [turns, 0.0, 0.0, 0.0, 0.0, 0.0]).max() < 1e-9
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
    state = ekf.initial(3.0, heading, rate, NOISE._replace(waves=True))._replace(wave=0.03, wave_rate=-0.1)
    moved = ekf.predict(LANXIN, NOISE, state, rudder, 3.0 + dt)
    assert ekf.predict_mean(LANXIN, state, rudder, 3.0 + dt) == (moved.psi, moved.rate, moved.wave, moved.wave_rate)


@given(st.floats(-10.0, 10.0), st.floats(-1.6, 1.6), st.floats(0.0, 1.0))
def test_a_wild_rate_never_blows_the_filter_up(rate: float, rudder: float, dt: float) -> None:
    state = ekf.initial(0.0, 0.0, rate, NOISE)
    for _ in range(20):
        state = ekf.predict(LANXIN, NOISE, state, rudder, state.time + dt)
        assert is_sound(state)
        assert abs(state.rate) <= max(abs(rate), 2.0) + 1e-9


def test_the_innovation_goes_the_short_way_round() -> None:
    state = ekf.initial(0.0, math.radians(179.0), 0.0, NOISE)
    state = fuse_heading(state, math.radians(-179.0), NOISE.heading)
    assert abs(abs(math.degrees(state.psi)) - 180.0) < 0.01


def test_forgetting_the_bias_in_a_sea_leaves_a_covariance() -> None:
    """What is left of it in the waves' columns would make the matrix impossible, and the filter fail a minute later."""
    noise = NOISE._replace(waves=True)
    state = ekf.initial(0.0, 0.2, 0.0, noise)
    for step in range(200):
        state = ekf.predict(LANXIN, noise, state, 0.1 * math.sin(0.1 * step), state.time + 0.1)
        state = fuse_heading(state, 0.2 + 0.05 * math.sin(0.12 * step), noise.heading)
        if step == 100:
            state = ekf.without_bias(state)
            assert state.bias == 0.0 and state.p22 == ekf.BIAS_UNKNOWN
        assert np.linalg.eigvalsh(matrices_of(state)[1]).min() > -1e-15
    again = ekf.initial(99.0, 1.0, None, noise, state)
    assert (again.bias, again.sea) == (state.bias, state.sea)


def test_what_is_not_finite_or_negative_is_not_sound() -> None:
    state = ekf.initial(0.0, 0.0, 0.0, NOISE)
    assert is_sound(state)
    assert not is_sound(state._replace(psi=math.nan))
    assert not is_sound(state._replace(p11=-1.0e-9))
    assert not is_sound(state._replace(p44=-1.0e-9))
    assert not is_sound(state._replace(sea=Sea(math.nan, 1.0)))


def test_a_sea_that_is_forgotten_leaves_all_motion_to_the_boat() -> None:
    p33, p44, p45, p55 = wave_motion.in_balance(SEA, frequency(SEA))
    state = ekf.initial(3.0, 3.1, 0.02, NOISE)._replace(sea=SEA, p33=p33, p44=p44, p45=p45, p55=p55)
    state = fuse_rate(fuse_heading(ekf.predict(LANXIN, NOISE, state, 0.1, 3.4), 3.0, 1.0e-4), 0.1, 1.0e-4)
    state = state._replace(wave=0.1, wave_rate=-0.03, wave_lag=0.2, bias=0.05)
    _, before = matrices_of(state)
    x, p = matrices_of(ekf.without_sea(state))
    boat = [math.remainder(state.psi + 0.1, math.tau), state.rate - 0.03, 0.05, 0.0, 0.0, 0.0]
    assert x == pytest.approx(boat, abs=1e-12)
    first = balance_of(wave_motion.FIRST_SEA)
    assert np.allclose(p[3:, 3:], first, rtol=1e-9, atol=1e-15)
    assert not p[:3, 3:].any()
    shown = np.diag([before[3, 3], before[4, 4], 0.0])
    assert np.allclose(p[:3, :3], before[:3, :3] + shown)
    assert ekf.without_sea(state).sea == wave_motion.FIRST_SEA
    calm = ekf.initial(3.0, 3.1, 0.02, NOISE)
    assert ekf.without_sea(calm) is calm


@pytest.mark.parametrize("x", [-3.0, -2.0e-3, -5.0e-4, 0.0, 5.0e-4, 2.0e-3, 3.0])
def test_the_step_of_a_boat_by_itself_is_exact_for_short_times_too(x: float) -> None:
    """r = r0 exp(-x), psi = r0 dt (1 - exp(-x))/x; a bias turns by K b dt (x - 1 + exp(-x))/x^2 dt/T on top."""
    boat, dt = Norrbin(0.2, 5.0, n1=1.0 if x >= 0.0 else -1.0), 5.0 * abs(x)
    state = ekf.initial(0.0, 0.0, 0.1, NOISE)._replace(bias=0.02)
    psi, rate, _, _ = ekf.predict_mean(boat, state, 0.0, dt)
    free = solve_ivp(
        lambda _, y: [y[1], yaw_acceleration(boat, y[1], 0.02)], (0.0, dt), [0.0, 0.1], rtol=1e-12, atol=1e-15
    ).y[:, -1]
    assert math.remainder(psi - free[0], math.tau) == pytest.approx(0.0, abs=1e-6 * abs(free[0]))
    assert rate == pytest.approx(free[1], rel=1e-6)
    moved = ekf.predict(boat, NOISE._replace(acceleration=0.0), state, 0.0, dt)
    assert moved.p11 == pytest.approx(
        state.p11 * math.exp(-2.0 * x) + state.p22 * (0.2 * math.expm1(-x) * (-1.0 if x >= 0.0 else 1.0)) ** 2, rel=1e-6
    )


def test_the_innovation_in_standard_deviations() -> None:
    state = ekf.initial(0.0, 0.5, 0.1, NOISE)._replace(wave=0.2, wave_rate=0.03, p00=0.01, p11=0.04)
    by_heading = (0.5 + 0.2 + 0.3) - 0.5 - 0.2
    heading_sigma = math.sqrt(state.p00 + 2.0 * state.p03 + state.p33 + NOISE.heading)
    by_itself = innovations(state, (NOISE.heading, NOISE.rate), 1.0, math.nan)
    assert by_itself == pytest.approx((by_heading / heading_sigma, by_heading, heading_sigma))
    rate_sigma = math.sqrt(state.p11 + 2.0 * state.p14 + state.p44 + NOISE.rate)
    assert innovations(state, (NOISE.heading, NOISE.rate), 9.0, 0.33)[0] == pytest.approx(0.2 / rate_sigma)


def test_at_first_the_rate_may_be_anything_up_to_a_fifth_of_a_radian_a_second() -> None:
    assert FilterNoise._field_defaults["rate_unknown"] == pytest.approx(0.04)


@pytest.mark.parametrize("waves", [True, False])
@pytest.mark.parametrize("wave", [0.1, -0.1, 0.001])
def test_a_wave_beyond_all_waves_is_a_gust_where_waves_are_estimated(waves: bool, wave: float) -> None:
    noise = NOISE._replace(waves=waves, gust=0.02, gust_bias=5.0e-4)
    state = ekf.initial(0.0, 0.0, 0.0, noise)._replace(wave=wave, sea=SEA)
    ahead = ekf.predict(NOMOTO, noise, state, 0.0, 0.1)
    is_gust = waves and abs(wave) > 0.05
    assert ahead.p22 - state.p22 == pytest.approx(0.1 * (5.0e-4 if is_gust else noise.bias))
