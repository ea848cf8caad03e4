"""The oscillator that stands for the waves: exact, in balance, learnt from what it shows, and left alone where wise."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from autopilot.estimation import disturbance as waves
from autopilot.estimation.disturbance import Sea, frequency, in_balance, is_extreme, learn
from autopilot.estimation.fusion import known
from autopilot.estimation.heading_ekf import wave_step
from autopilot.steering import filtered_share, plausible_share

frequencies = st.floats(waves.WAVE_FREQUENCY_LEAST, waves.WAVE_FREQUENCY_MOST)


def sea_of(w0: float, deviation: float) -> Sea:
    return Sea(deviation**2, (w0 * deviation) ** 2 * waves.WAVE_STIFFENING)


@given(frequencies, st.floats(1.0e-4, 0.2), st.floats(0.0, 5.0))
def test_the_step_is_exact_and_keeps_the_balance(w0: float, deviation: float, dt: float) -> None:
    sea = sea_of(w0, deviation)
    xi, c = waves.WAVE_DAMPING, waves.WAVE_CORNER * w0
    a = np.array([[0.0, 1.0, 0.0], [-w0 * w0 - 2 * xi * w0 * c, -2 * xi * w0 - c, -w0 * w0], [c, 0.0, 0.0]])
    step = np.reshape(wave_step(frequency(sea), dt), (3, 3))
    assert np.abs(step - expm(a * dt)).max() < 1e-9
    v33, v44, v45, v55 = in_balance(sea, frequency(sea))
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
    assert frequency(waves.NO_SEA) == 0.0


@pytest.mark.parametrize("w0", [0.4, 1.2, 3.0])
def test_a_sea_seen_clearly_is_learnt(w0: float) -> None:
    truth, dt = sea_of(w0, 0.05), 0.1
    v33, v44, v45, v55 = in_balance(truth, frequency(truth))
    balance = np.array([[v33, 0.0, 0.0], [0.0, v44, v45], [0.0, v45, v55]])
    step = np.reshape(wave_step(frequency(truth), dt), (3, 3))
    root = np.linalg.cholesky(balance - step @ balance @ step.T + 1e-12 * np.eye(3))
    random = np.random.default_rng(3)
    state, sea, found = np.zeros(3), waves.FIRST_SEA, []
    for _ in range(6000):
        state = step @ state + root @ random.standard_normal(3)
        sea = learn(sea, float(state[0] ** 2), float(state[1] ** 2), dt)
        found.append((math.sqrt(sea.heading), frequency(sea)))
    deviation, middle = np.mean(found[2000:], axis=0)
    assert deviation == pytest.approx(0.05, rel=0.2)
    assert middle == pytest.approx(w0, rel=0.1)


@given(st.floats(0.0, 10.0), st.floats(0.0, 100.0), st.floats(0.0, 10.0))
def test_what_is_learnt_stays_inside_its_bounds(heading: float, rate: float, dt: float) -> None:
    sea = waves.FIRST_SEA
    for _ in range(5):
        sea = learn(sea, heading, rate, dt)
        assert sea.heading >= waves.WAVE_VARIANCE_LEAST
        assert waves.WAVE_FREQUENCY_LEAST - 1e-9 <= frequency(sea) <= waves.WAVE_FREQUENCY_MOST + 1e-9


def test_the_initial_sea_is_half_a_degree_at_one_radian_a_second() -> None:
    assert frequency(waves.FIRST_SEA) == pytest.approx(1.0)
    assert in_balance(waves.FIRST_SEA, frequency(waves.FIRST_SEA))[0] == pytest.approx(math.radians(0.5) ** 2)
    assert waves.FIRST_SEA.watched == 0.0
    assert frequency(Sea(0.0, 1.0)) == 0.0


def test_more_than_three_deviations_is_no_wave() -> None:
    sea = sea_of(1.0, math.radians(1.0))
    assert not is_extreme(sea, math.radians(2.9))
    assert is_extreme(sea, math.radians(-3.2))


@given(st.floats(0.0, 10.0), st.floats(0.01, 10.0))
def test_quick_waves_are_left_alone_and_slow_ones_steered_against(w0: float, corner: float) -> None:
    share = filtered_share(w0, corner)
    assert 0.0 <= share <= 1.0
    assert filtered_share(corner, corner) == 0.5
    if w0 > 1.5 * corner:
        assert share > 0.95
    if w0 < 0.67 * corner:
        assert share < 0.05
    assert filtered_share(w0, math.inf) == 0.0, "a trial goes by the heading as it is"
    assert filtered_share(w0, 0.0) == 1.0


@pytest.mark.parametrize("ratio", [0.5, 0.9, 1.1, 1.5, 3.0])
def test_waves_are_parted_by_a_filter_of_the_eighth_order(ratio: float) -> None:
    assert filtered_share(0.7 * ratio, 0.7) == pytest.approx(1.0 / (1.0 + ratio**-8))


@pytest.mark.parametrize("w0", [0.5, 1.0, 3.0])
def test_the_encounter_spectrum_has_its_width_and_its_lower_corner(
    w0: float,
) -> None:
    """Density of s/((s + c)(s^2 + 2 xi w0 s + w0^2)) from what is in balance: E[s^2]/E[h^2] and E[e^2]/E[h^2]."""
    sea = sea_of(w0, 0.05)
    heading, rate, across, lag = in_balance(sea, frequency(sea))
    xi, kappa = 0.15, 0.4
    assert rate / heading == pytest.approx((1.0 + 2.0 * xi * kappa) * w0**2)
    assert (across / heading, lag / heading) == pytest.approx((-kappa * w0, kappa * (2.0 * xi + kappa)))


def test_the_waves_are_believed_from_the_fourth_second_on_and_wholly_from_the_eighth() -> None:
    for seconds, share in ((0.0, 0.0), (4.0, 0.0), (5.0, 0.25), (6.0, 0.5), (7.0, 0.75), (8.0, 1.0), (900.0, 1.0)):
        assert known(Sea(0.01, 0.01, seconds)) == pytest.approx(share)
    assert known(waves.FIRST_SEA) == 0.0


def test_the_sea_is_averaged_over_four_seconds_at_first_and_forty_in_the_end() -> None:
    """A step of what is expected is followed as 1 - exp(-t/memory), the memory being the time watched in between."""
    truth = sea_of(1.0, 0.1)
    for watched, memory in ((0.0, 4.0), (3.0, 4.0), (19.9, 20.0), (39.9, 40.0), (500.0, 40.0)):
        before = sea_of(1.0, 0.05)._replace(watched=watched)
        after = learn(before, truth.heading, truth.rate, 0.1)
        share = 1.0 - math.exp(-0.1 / memory)
        assert after.watched == pytest.approx(watched + 0.1)
        assert after.heading == pytest.approx(before.heading + share * (truth.heading - before.heading))
        assert after.rate == pytest.approx(before.rate + share * (truth.rate - before.rate))


def test_swells_slower_than_waves_count_by_their_rate_and_noise_faster_by_its_heading() -> None:
    slow, fast = sea_of(0.1, 0.1)._replace(watched=99.0), sea_of(50.0, 0.1)._replace(watched=99.0)
    assert frequency(learn(slow, slow.heading, slow.rate, 0.1)) == pytest.approx(0.4)
    assert learn(slow, slow.heading, slow.rate, 0.1).rate == pytest.approx(slow.rate)
    assert frequency(learn(fast, fast.heading, fast.rate, 0.1)) == pytest.approx(4.0)
    assert learn(fast, fast.heading, fast.rate, 0.1).heading == pytest.approx(fast.heading)
    calm = Sea(0.0, 0.0, 99.0)
    for _ in range(9):
        calm = learn(calm, 0.0, 0.0, 10.0)
    assert math.degrees(math.sqrt(calm.heading)) == pytest.approx(0.02), "it never falls quite asleep"


@given(st.floats(0.0, 0.2), st.floats(-1.0, 1.0))
def test_of_a_swing_too_far_for_the_waves_the_rest_is_a_push(deviation: float, wave: float) -> None:
    """Three deviations and 0.3 degrees, as the root of their squares."""
    most = math.hypot(3.0 * deviation, math.radians(0.3))
    share = plausible_share(deviation, wave)
    assert 0.0 < share <= 1.0
    assert abs(share * wave) == pytest.approx(min(abs(wave), most))
    if abs(abs(wave) - most) > 1e-9:
        assert is_extreme(Sea(deviation**2, 0.0), wave) is (abs(wave) > most)
