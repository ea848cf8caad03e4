"""The oscillator that stands for the waves: exact, in balance, learnt from what it shows, and left alone where wise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from autopilot.estimation import wave_motion
from autopilot.estimation.wave_motion import Sea, frequency, in_balance, is_extreme, learn, left_alone, wave_step

frequencies = st.floats(wave_motion.FREQUENCY_LEAST, wave_motion.FREQUENCY_MOST)


def sea_of(w0: float, deviation: float) -> Sea:
    return Sea(deviation**2, (w0 * deviation) ** 2 * wave_motion.STIFFENING)


@given(frequencies, st.floats(1.0e-4, 0.2), st.floats(0.0, 5.0))
def test_the_step_is_exact_and_keeps_the_balance(w0: float, deviation: float, dt: float) -> None:
    sea = sea_of(w0, deviation)
    xi, c = wave_motion.DAMPING, wave_motion.CORNER * w0
    a = np.array([[0.0, 1.0, 0.0], [-w0 * w0 - 2 * xi * w0 * c, -2 * xi * w0 - c, -w0 * w0], [c, 0.0, 0.0]])
    step = np.reshape(wave_step(sea, dt), (3, 3))
    assert np.abs(step - expm(a * dt)).max() < 1e-9
    v33, v44, v45, v55 = in_balance(sea)
    balance = np.array([[v33, 0.0, 0.0], [0.0, v44, v45], [0.0, v45, v55]])
    gained = balance - step @ balance @ step.T
    assert np.linalg.eigvalsh(gained).min() > -1e-12 * balance.max(), "noise cannot have a negative variance"
    # d/dt of the covariance is zero but for the one that the white noise feeds
    drift = a @ balance + balance @ a.T
    drift[1, 1] = 0.0
    assert np.abs(drift).max() < 1e-9 * max(1.0, balance.max())


@given(frequencies, st.floats(1.0e-3, 0.2))
def test_frequency_is_what_the_balance_was_made_with(w0: float, deviation: float) -> None:
    assert frequency(sea_of(w0, deviation)) == pytest.approx(w0)
    assert frequency(wave_motion.NO_SEA) == 0.0


@pytest.mark.parametrize("w0", [0.4, 1.2, 3.0])
def test_a_sea_seen_clearly_is_learnt(w0: float) -> None:
    truth, dt = sea_of(w0, 0.05), 0.1
    v33, v44, v45, v55 = in_balance(truth)
    balance = np.array([[v33, 0.0, 0.0], [0.0, v44, v45], [0.0, v45, v55]])
    step = np.reshape(wave_step(truth, dt), (3, 3))
    root = np.linalg.cholesky(balance - step @ balance @ step.T + 1e-12 * np.eye(3))
    random = np.random.default_rng(3)
    state, sea, found = np.zeros(3), wave_motion.FIRST_SEA, []
    for _ in range(6000):
        state = step @ state + root @ random.standard_normal(3)
        sea = learn(sea, float(state[0] ** 2), float(state[1] ** 2), dt)
        found.append((math.sqrt(sea.heading), frequency(sea)))
    deviation, middle = np.mean(found[2000:], axis=0)
    assert deviation == pytest.approx(0.05, rel=0.2)
    assert middle == pytest.approx(w0, rel=0.1)


@given(st.floats(0.0, 10.0), st.floats(0.0, 100.0), st.floats(0.0, 10.0))
def test_what_is_learnt_stays_inside_its_bounds(heading: float, rate: float, dt: float) -> None:
    sea = wave_motion.FIRST_SEA
    for _ in range(5):
        sea = learn(sea, heading, rate, dt)
        assert sea.heading >= wave_motion.LEAST_VARIANCE
        assert wave_motion.FREQUENCY_LEAST - 1e-9 <= frequency(sea) <= wave_motion.FREQUENCY_MOST + 1e-9


def test_more_than_three_deviations_is_no_wave() -> None:
    sea = sea_of(1.0, math.radians(1.0))
    assert not is_extreme(sea, math.radians(2.9))
    assert is_extreme(sea, math.radians(-3.2))


@given(st.floats(0.0, 10.0), st.floats(0.01, 10.0))
def test_quick_waves_are_left_alone_and_slow_ones_steered_against(w0: float, corner: float) -> None:
    share = left_alone(w0, corner)
    assert 0.0 <= share <= 1.0
    assert left_alone(corner, corner) == 0.5
    if w0 > 1.5 * corner:
        assert share > 0.95
    if w0 < 0.67 * corner:
        assert share < 0.05
    assert left_alone(w0, math.inf) == 0.0, "a trial goes by the heading as it is"
    assert left_alone(w0, 0.0) == 1.0
