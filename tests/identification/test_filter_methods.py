"""The filters on Norrbin's model: as sure as they may be, and the same as the filter with parameters as states."""

from __future__ import annotations

import numpy as np
import pytest
from extended_kalman import by_kalman_filter
from zigzag_trials import zigzag

from autopilot.identification.feedback_particle import Gaussian
from autopilot.identification.filter_methods import kalman_filter
from autopilot.identification.identified import Identified, Question
from autopilot.identification.norrbin_filter import (
    Innovations,
    RunNoise,
    Separated,
    beliefs,
    covariance_of,
    disturbance_intensity,
    entered,
    passage,
    prior_about,
    segment_steps,
    stacked,
    yaw_case,
)
from autopilot.identification.runs import FloatArray, Run, run_from_columns
from autopilot.models.norrbin import Norrbin

SLOW_BOAT = {"K": 0.2, "T": 5.0, "n3": 20.0}
TRUTH = Norrbin(0.2, 5.0, 20.0, reference_speed=5.0)
RATE_NOISE, HEADING_NOISE = np.radians(0.1), np.radians(0.2)


@pytest.fixture(scope="module")
def clean() -> dict[str, FloatArray]:
    return zigzag(np.radians(15.0), 180.0, 0.1, **SLOW_BOAT)


def noisy(clean: dict[str, FloatArray], seed: int) -> Run:
    random = np.random.default_rng(seed)
    size = clean["time_s"].size
    heading = clean["heading_rad"] + HEADING_NOISE * random.normal(size=size)
    rate = clean["yaw_rate_rad_s"] + RATE_NOISE * random.normal(size=size)
    return run_from_columns("zigzag", {**clean, "heading_rad": heading, "yaw_rate_rad_s": rate})


def off_by(found: Identified, name: str) -> float:
    error = found.standard_errors[name]
    assert error is not None
    return float(getattr(found.model, name) - getattr(TRUTH, name)) / error


def test_on_a_slow_boat_its_errors_are_as_large_as_it_says(clean: dict[str, FloatArray]) -> None:
    """Two seeds on which a filter that linearises at each moment's belief was off by many standard errors."""
    share = []
    for seed in (2, 5):
        found = kalman_filter([noisy(clean, seed)], Question(reference_speed=5.0))
        share += [off_by(found, name) for name in ("gain", "n3")]
        assert found.covariance is not None
        np.testing.assert_allclose(np.diag(found.covariance), [found.standard_errors[n] ** 2 for n in found.free])
        # Cramer and Rao's bound of this trial is 0.0011 1/s
        assert 0.0008 < (found.standard_errors["gain"] or 0.0) < 0.0016
    assert np.max(np.abs(share)) < 3.0
    assert 0.1 < np.sqrt(np.mean(np.square(share))) < 2.0


def test_separated_it_is_the_filter_with_parameters_as_states(clean: dict[str, FloatArray]) -> None:
    """With a prior so near that both are linear."""
    segment, unit = noisy(clean, 1).segments[0], 0.04
    noise = RunNoise(1.0e-4, RATE_NOISE, HEADING_NOISE)
    start = TRUTH._replace(gain=0.2002, time_constant=5.005, n3=20.2)
    wide = prior_about(start, unit, True)
    near = Gaussian(wide.mean, 1.0e-4 * wide.covariance)
    here = passage(segment, start, (RATE_NOISE, HEADING_NOISE), unit, 24.0)
    innovations = Separated(start, unit, True, noise.process).innovations(here)
    estimates, covariance = beliefs(stacked([innovations]), near.mean, near)
    case = entered(yaw_case(near, True), segment, start, noise, unit)
    joint = by_kalman_filter(case, segment_steps(segment, start, unit, 24.0)[0])
    deviation = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(estimates[-1] - joint.estimate[-1]) < 0.05 * deviation)
    assert np.max(np.abs(estimates - joint.estimate) / joint.deviation) < 0.1
    np.testing.assert_allclose(covariance, joint.covariance, rtol=0.05, atol=0.002 * np.min(deviation) ** 2)
    # what it contributed has the size it says
    assert np.mean(np.square(innovations.value[innovations.value != 0.0])) == pytest.approx(1.0, abs=0.15)


@pytest.mark.parametrize("process", [0.0, 3.0e-3])
def test_the_strength_of_gusts_is_distinguished_from_the_instruments_noise(process: float) -> None:
    random, dt = np.random.default_rng(4), 0.1
    table = np.empty((1500, 4))
    rate = heading = 0.0
    for k in range(table.shape[0]):
        rudder = 0.25 * np.sin(0.2 * k * dt)
        table[k] = k * dt, heading + HEADING_NOISE * random.normal(), rate + RATE_NOISE * random.normal(), rudder
        before = rate
        rate += dt * (0.2 * 0.25 * np.sin(0.2 * (k + 0.5) * dt) - rate) / 5.0 + process * np.sqrt(dt) * random.normal()
        heading += 0.5 * dt * (before + rate)
    names = ("time_s", "heading_rad", "yaw_rate_rad_s", "rudder_rad")
    columns = {**{name: table[:, i] for i, name in enumerate(names)}, "speed_m_s": np.full(1500, 5.0)}
    model, unit = Norrbin(0.2, 5.0 - 0.5 * dt, reference_speed=5.0), 0.05
    segment = run_from_columns("gusts", columns).segments[0]
    found = disturbance_intensity(model, unit, [passage(segment, model, (RATE_NOISE, HEADING_NOISE), unit)])
    if process:
        assert found == pytest.approx(process, rel=0.8)
    else:
        assert found < 1.0e-4


def test_what_a_record_does_not_tell_stays_as_unsure_as_it_was() -> None:
    slope = np.zeros((400, 2, 2))
    slope[:, 0, 0] = np.random.default_rng(1).choice([-10.0, 10.0], 400)
    slope[:, 0, 1] = 1.0e-6
    value = np.random.default_rng(2).normal(size=(400, 2))
    covariance = covariance_of([Innovations(value, slope)], np.zeros(2), np.diag([0.5, 0.25]))
    assert covariance[0, 0] == pytest.approx(1.0 / 40_000.0, rel=0.3)
    assert covariance[1, 1] == pytest.approx(0.25, rel=0.01)
