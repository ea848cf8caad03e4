"""Wave and wind models against their closed forms, their spectra and an independent integrator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from naval_vessel import encounter_frequency
from scipy import integrate, linalg, signal

from autopilot.models import weather


def test_paper_filter_is_equation_31() -> None:
    model = weather.JIANG_DEG
    assert model.frequency**2 == pytest.approx(0.37)
    assert 2.0 * model.damping * model.frequency == pytest.approx(0.36)
    assert model.gain / (2.0 * model.damping * model.frequency) == pytest.approx(1.1667, abs=1e-4)


@given(frequency=st.floats(0.1, 5.0), damping=st.floats(0.05, 0.95), dt=st.floats(1e-3, 3.0), gain=st.floats(0.01, 5.0))
def test_discretisation_is_exact(frequency: float, damping: float, dt: float, gain: float) -> None:
    """Against the matrix exponential and the block-matrix (Van Loan) noise covariance, another way to both.

    The block holds exp(-A dt) as well, which grows by as much as the filter decays: it loses twice those digits.
    """
    assume(damping * frequency * dt < 8.0)
    model = weather.SecondOrderWaves(frequency, damping, gain, 0.1)
    step = weather.discretise(model, dt)
    a = np.array([[0.0, 1.0], [-(frequency**2), -2.0 * damping * frequency]])
    np.testing.assert_allclose([[step.a11, step.a12], [step.a21, step.a22]], linalg.expm(a * dt), rtol=1e-9, atol=1e-12)
    noise = np.array([[0.0, 0.0], [0.0, gain**2 * 0.1]])
    block = linalg.expm(np.block([[-a, noise], [np.zeros((2, 2)), a.T]]) * dt)
    covariance = block[2:, 2:].T @ block[:2, 2:]
    factor = np.array([[step.l11, 0.0], [step.l21, step.l22]])
    scale = float(np.max(np.abs(covariance)))
    np.testing.assert_allclose(factor @ factor.T, covariance, atol=1e-6 * scale)


def test_realisation_has_the_spectrum_of_the_filter() -> None:
    model, dt = weather.JIANG_DEG, 0.1
    step = weather.discretise(model, dt)
    generator = np.random.default_rng(5)
    state = weather.stationary_state(model, *generator.standard_normal(2))
    values = []
    for first, second in generator.standard_normal((40000, 2)):
        state = weather.wave_step(step, state, first, second)
        values.append(state.value)
    assert np.std(values) == pytest.approx(weather.standard_deviation(model), rel=0.05)
    frequency, density = signal.welch(np.array(values), 1.0 / dt, nperseg=4096)
    assert 2.0 * math.pi * frequency[np.argmax(density)] == pytest.approx(model.frequency, rel=0.1)
    # one-sided density per hertz: 2 q |L(j w)|^2
    band = (frequency > 0.05) & (frequency < 0.25)
    _, response = signal.freqs([model.gain, 0.0], [1.0, 0.36, 0.37], 2.0 * math.pi * frequency[band])
    ratio = density[band] / (2.0 * model.intensity * np.abs(response) ** 2)
    assert np.mean(ratio) == pytest.approx(1.0, abs=0.1)


@pytest.mark.parametrize("damping", [0.0, 1.0, -0.1])
def test_damping_outside_its_range_is_refused(damping: float) -> None:
    with pytest.raises(ValueError, match="damping must lie in"):
        weather.discretise(weather.SecondOrderWaves(1.0, damping, 1.0, 0.1), 0.1)


@pytest.mark.parametrize(("height", "peak"), [(3.25, 9.7), (1.0, 4.0)])
def test_ittc_spectrum_has_its_height_period_and_peak(height: float, peak: float) -> None:
    period = weather.mean_period_of(peak)

    def moment(order: int) -> float:
        def integrand(frequency: float) -> float:
            return float(frequency**order * weather.ittc_spectrum(np.array([frequency]), height, period)[0])

        return float(integrate.quad(integrand, 0.05, 60.0, limit=400, points=[2.0 * math.pi / peak])[0])

    assert 4.0 * math.sqrt(moment(0)) == pytest.approx(height, rel=0.01)
    assert 2.0 * math.pi * moment(0) / moment(1) == pytest.approx(period, rel=0.01)
    grid = np.linspace(0.3, 3.0, 20000) * 2.0 * math.pi / peak
    assert grid[np.argmax(weather.ittc_spectrum(grid, height, period))] == pytest.approx(2.0 * math.pi / peak, rel=1e-3)


def test_component_amplitudes_carry_the_variance_of_the_spectrum() -> None:
    frequency = np.linspace(0.3, 3.0, 300)
    amplitude = weather.component_amplitudes(frequency, 3.25, 7.5)
    assert 4.0 * math.sqrt(float(np.sum(amplitude**2)) / 2.0) == pytest.approx(3.25, rel=0.03)
    with pytest.raises(ValueError, match="two frequencies"):
        weather.component_amplitudes(np.array([1.0]), 1.0, 5.0)


def test_encounter_frequency_rises_in_head_seas_and_falls_in_following_seas() -> None:
    frequency = np.array([0.8])
    head = encounter_frequency(frequency, 7.7, math.pi)[0]
    assert head == pytest.approx(0.8 + 0.8**2 * 7.7 / 9.80665)
    assert encounter_frequency(frequency, 7.7, 0.0)[0] < 0.8
    assert encounter_frequency(frequency, 7.7, math.pi / 2.0)[0] == pytest.approx(0.8)
    # overtaking: faster than the wave's phase speed g/w
    assert encounter_frequency(frequency, 20.0, 0.0)[0] < 0.0


def test_apparent_wind_of_a_boat_under_way() -> None:
    calm = weather.apparent_wind(0.0, 0.0, math.radians(90.0), 0.0, 5.0)
    assert calm.speed == pytest.approx(5.0)
    assert calm.angle == pytest.approx(0.0, abs=1e-12)
    # heading north at rest, wind from the east: on the starboard beam
    beam = weather.apparent_wind(8.0, math.radians(90.0), 0.0, 0.0, 0.0)
    assert (beam.speed, beam.angle) == (pytest.approx(8.0), pytest.approx(math.pi / 2.0))


def felt_from(speed: float, angle: float) -> weather.ApparentWind:
    return weather.ApparentWind(speed * math.cos(angle), speed * math.sin(angle))


def test_wind_on_the_starboard_bow_pushes_to_port() -> None:
    load = weather.WindLoad(rudder_per_speed_squared=1e-3, leeway=0.02)
    felt = felt_from(10.0, math.radians(45.0))
    assert weather.rudder_equivalent(load, felt) == pytest.approx(-0.1)
    assert weather.leeway_speed(load, felt) == pytest.approx(-0.2 * math.sin(math.radians(45.0)))
    assert weather.rudder_equivalent(load, felt_from(10.0, math.pi / 2.0)) == pytest.approx(0.0, abs=1e-12)


@given(angle=st.floats(-math.pi, math.pi), speed=st.floats(0.0, 40.0))
def test_wind_load_is_odd_in_its_side(angle: float, speed: float) -> None:
    load = weather.WindLoad(1e-3, 0.02)
    starboard, port = felt_from(speed, angle), felt_from(speed, -angle)
    assert weather.rudder_equivalent(load, starboard) == pytest.approx(
        -1e-3 * speed**2 * math.sin(2.0 * angle), abs=1e-12
    )
    assert weather.rudder_equivalent(load, starboard) == -weather.rudder_equivalent(load, port)
    assert weather.leeway_speed(load, starboard) == -weather.leeway_speed(load, port)


def test_gusts_keep_their_deviation_and_memory() -> None:
    gust = weather.Gust(2.0, 5.0)
    generator = np.random.default_rng(3)
    value, values = 0.0, []
    for deviate in generator.standard_normal(60000):
        value = weather.gust_step(gust, value, 0.5, deviate)
        values.append(value)
    series = np.array(values[100:])
    assert np.std(series) == pytest.approx(2.0, rel=0.05)
    assert np.mean(series[10:] * series[:-10]) / np.var(series) == pytest.approx(math.exp(-1.0), abs=0.05)
