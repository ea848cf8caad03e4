"""How quickly the bias wanders is learnt: from the bias as it is found, within limits, and not from waves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import solve_continuous_lyapunov

from autopilot.estimation.disturbance import (
    NO_INTENSITY,
    Intensity,
    adapt_intensity,
    reset_intensity,
)
from autopilot.estimation.tuning import GUST_LONGER, GUST_SPREAD

STRENGTH_ERROR = 0.4
UNKNOWN = math.radians(1.8) ** 2

LEAST, MOST, TIME, DT = 1.0e-6, 3.0e-4, 4.0, 0.1
CHANGES = (LEAST, MOST, TIME)
WELL_KNOWN = 1.0e-8


def followed(biases: list[float], variance: float = WELL_KNOWN, rudder: float = 0.0) -> Intensity:
    """rudder: the rudder's angle as a multiple of the bias."""
    intensity = NO_INTENSITY
    for bias in biases:
        intensity = adapt_intensity(intensity, CHANGES, bias, variance, rudder * bias, DT)
    return intensity


@pytest.mark.parametrize("time", [0.1, 4.0, 100.0])
def test_the_spread_is_that_of_a_wandering_bias(time: float) -> None:
    """d/dt of (b - x, x - y, y - z) under white noise of density 1 on b."""
    a = np.array([[-1.0, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, -1.0 / GUST_LONGER]]) / time
    spread = solve_continuous_lyapunov(a, -np.diag([1.0, 0.0, 0.0]))
    assert spread[2, 2] == pytest.approx(GUST_SPREAD * time, rel=1e-6)


@pytest.mark.parametrize("density", [1.0e-5, 1.0e-4])
def test_a_bias_that_wanders_is_learnt(density: float) -> None:
    random = np.random.default_rng(2)
    biases = np.cumsum(math.sqrt(density * DT) * random.standard_normal(20000))
    found, intensity = [], NO_INTENSITY
    for bias in biases.tolist():
        intensity = adapt_intensity(intensity, CHANGES, bias, WELL_KNOWN, 0.0, DT)
        found.append(intensity.density)
    assert np.mean(found[2000:]) == pytest.approx(density, rel=0.3)


def test_a_steady_bias_and_waves_upon_it_are_no_gusts() -> None:
    swing = [math.radians(3.0) + math.radians(1.0) * math.sin(0.8 * DT * n) for n in range(3000)]
    assert followed(swing).density == LEAST
    blown = [math.radians(3.0) + math.radians(1.0) * math.sin(0.1 * DT * n) for n in range(3000)]
    assert followed(blown).density > 10.0 * LEAST


def test_a_bias_that_is_being_found_is_no_gust() -> None:
    intensity, variance = NO_INTENSITY, UNKNOWN
    for n in range(300):
        variance *= math.exp(-DT / TIME)
        intensity = adapt_intensity(
            intensity, CHANGES, math.radians(5.0) * (1.0 - math.exp(-n * DT / 3.0)), variance, 0.0, DT
        )
    assert intensity.density == LEAST
    at_the_stop = followed([math.radians(5.0), math.radians(30.0)] * 300, 1.01 * UNKNOWN)
    assert at_the_stop.density == LEAST


def test_a_bias_to_be_found_anew_keeps_what_is_known_of_the_gusts() -> None:
    known = Intensity(1.0e-4, (0.1, 0.1, 0.1), (-0.1, -0.1, -0.1), WELL_KNOWN)
    anew = adapt_intensity(reset_intensity(known), CHANGES, 0.0, WELL_KNOWN, -0.1, DT)
    assert anew == Intensity(1.0e-4, (0.0, 0.0, 0.0), (-0.1, -0.1, -0.1), WELL_KNOWN)
    calmer = adapt_intensity(reset_intensity(known), (LEAST, 5.0e-5, TIME), 0.0, WELL_KNOWN, -0.1, DT)
    assert calmer.density == 5.0e-5, "what the file allows has changed"


def test_a_bias_that_goes_with_the_rudder_is_its_strength_and_no_gust() -> None:
    blown = [math.radians(5.0) * math.sin(0.1 * DT * n) for n in range(3000)]
    held = followed(blown, rudder=-1.0).density
    assert followed(blown, rudder=1.01 / STRENGTH_ERROR).density == LEAST
    assert held > 0.5 * followed(blown).density, "a rudder that holds a gust goes as the bias does"


@pytest.mark.parametrize("time", [1.0, 4.0, 10.0])
@pytest.mark.parametrize(
    ("bias", "rudder", "variance", "seen"),
    [
        (0.02, 0.0, 0.0, 0.02**2),
        (0.02, 0.03, 0.0, 0.02**2 - (0.4 * 0.03) ** 2),
        (0.02, 0.06, 0.0, 0.0),
        (0.0, 0.0, 1.0e-4, 0.3e-4),
        (1.0, 0.0, 0.0, math.inf),
        (0.0, 0.0, 9.0e-4, math.inf),
    ],
)
def test_the_density_is_averaged_over_forty_seconds_or_ten_times_that_of_the_means(
    time: float, bias: float, rudder: float, variance: float, seen: float
) -> None:
    """(y - z) and (v - w) of the module's equations are given; in so short a step they stay what they are."""
    before, dt = 1.0e-5, 1.0e-6
    apart = Intensity(before, (bias, bias, 0.0), (rudder, rudder, 0.0), max(variance, 1.0e-12))
    after = adapt_intensity(apart, (0.0, 1.0, time), bias, variance or 1.0e-12, rudder, dt)
    found = seen / (GUST_SPREAD * time)
    # what is measured counts for ten times what is expected at most, and doubt for what is expected
    found = min(found, before if variance else 10.0 * before)
    learnt = (after.density - before) / (dt / max(40.0, 10.0 * time))
    assert learnt == pytest.approx(found - before, rel=1.0e-3, abs=1.0e-8)


def test_the_bias_is_settling_while_its_variance_still_falls() -> None:
    """Exact limits are on the side of learning."""
    apart = Intensity(LEAST, (0.1, 0.1, 0.0), (0.0, 0.0, 0.0), UNKNOWN)
    falling = UNKNOWN * math.exp(-DT / (2.0 * TIME))
    for variance, is_learnt in ((UNKNOWN, True), (falling, True), (0.999 * falling, False), (1.001 * UNKNOWN, False)):
        after = adapt_intensity(apart, CHANGES, 0.1, variance, 0.0, DT)
        assert (after.density > LEAST) is is_learnt
        assert (after.bias == (0.1, 0.1, 0.1)) is not is_learnt
        assert after.variance == variance


@given(
    st.lists(
        st.tuples(st.floats(-1.6, 1.6), st.floats(0.0, 10.0), st.floats(-1.6, 1.6), st.floats(0.0, 60.0)), max_size=40
    )
)
def test_whatever_is_seen_the_density_stays_within_its_limits(seen: list[tuple[float, float, float, float]]) -> None:
    intensity = NO_INTENSITY
    for bias, variance, rudder, dt in seen:
        intensity = adapt_intensity(intensity, CHANGES, bias, variance, rudder, dt)
        assert LEAST <= intensity.density <= MOST
        assert all(map(math.isfinite, (*intensity.bias, *intensity.rudder, intensity.variance)))
