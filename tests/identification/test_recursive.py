"""Filters as identification, on the dynamic-positioning trials: errors, honesty, and what 60 s cannot tell."""

from __future__ import annotations

import numpy as np
import pytest
from extended_kalman import by_kalman_filter, prior_deviation
from zheng2019_dynamic_positioning import information_bound, normalised_error, unidentified
from zheng2019_ship import (
    DREDGER,
    SCENARIOS,
    by_prediction_errors,
    pseudo_random_binary,
    simulate_scenario,
    trial_steps,
)

from autopilot.identification.feedback_particle import (
    Found,
    Steps,
    by_particle_filter,
)

FRESH = 4000
"""Seeds that no table was made with."""


def relative_errors(found: Found, name: str) -> np.ndarray:
    return (found.estimate[-1] - np.array(SCENARIOS[name].truth)) / np.abs(SCENARIOS[name].truth)


def first(steps: Steps, count: int) -> Steps:
    return Steps(steps.dt[:count], steps.inputs[:count], steps.measured[:count])


@pytest.mark.parametrize(
    ("name", "reach"),
    [("S2", (0.01, 0.0035, 0.0035)), ("S4", (0.0009, 0.018, 0.045, 0.055, 0.0025))],
)
def test_both_filters_reach_the_parameters(name: str, reach: tuple[float, ...]) -> None:
    """Two seeds within four times the figures that the median of twenty keeps: benchmarks/results/zheng2019.md."""
    scenario = SCENARIOS[name]
    errors: dict[str, list[np.ndarray]] = {"ekf": [], "fpf": []}
    normalised = []
    for seed in range(FRESH, FRESH + 2):
        random = np.random.default_rng(seed)
        case, trial, _ = simulate_scenario(scenario, random)
        steps = trial_steps(DREDGER, trial)
        kalman = by_kalman_filter(case, steps)
        particles = by_particle_filter(case, steps, 200, random)
        errors["ekf"].append(relative_errors(kalman, name))
        errors["fpf"].append(relative_errors(particles, name))
        normalised.append(normalised_error(kalman, np.array(scenario.truth)))
        # both say the same of the same record: they differ by far less than they are unsure
        difference = np.abs(kalman.estimate[-1] - particles.estimate[-1])
        assert np.all(difference < 1.5 * kalman.deviation[-1])
    for method, values in errors.items():
        assert np.all(np.mean(np.abs(values), axis=0) < 4.0 * np.array(reach)), method
    assert 0.05 < np.mean(normalised) < 3.0


def test_the_batch_fit_and_the_filter_agree_and_neither_is_surer_than_the_bound() -> None:
    scenario = SCENARIOS["S2"]
    case, trial, states = simulate_scenario(scenario, np.random.default_rng(FRESH))
    steps = first(trial_steps(DREDGER, trial), 300)
    kalman, batch = by_kalman_filter(case, steps), by_prediction_errors(case, steps)
    assert np.all(np.abs(batch.estimate - kalman.estimate[-1]) < 0.3 * kalman.deviation[-1])
    bound = np.sqrt(np.diag(information_bound(case, steps, states)))
    np.testing.assert_allclose(kalman.deviation[-1], bound, rtol=0.1)
    np.testing.assert_allclose(np.sqrt(np.diag(batch.covariance)), bound, rtol=0.15)


def test_sixty_seconds_cannot_tell_the_yaw_damping_and_that_is_said() -> None:
    case, trial, _ = simulate_scenario(SCENARIOS["S3"], np.random.default_rng(FRESH))
    found = by_kalman_filter(case, trial_steps(DREDGER, trial))
    assert unidentified(case, found.deviation[-1]) == ("Yr", "Nv", "Nr")


def test_six_hundred_seconds_of_a_ship_with_realistic_damping_tell_it() -> None:
    case, trial, _ = simulate_scenario(SCENARIOS["S4"], np.random.default_rng(FRESH))
    found = by_kalman_filter(case, trial_steps(DREDGER, trial))
    assert unidentified(case, found.deviation[-1]) == ()


def test_two_thrusters_that_always_push_alike_are_not_distinguished() -> None:
    random = np.random.default_rng(FRESH)
    scenario = SCENARIOS["S2"]
    together = np.repeat(scenario.thrust[:, :1], 2, axis=1)
    case, trial, _ = simulate_scenario(scenario._replace(thrust=together), random)
    found = by_kalman_filter(case, trial_steps(DREDGER, trial))
    correlation = found.covariance[1, 2] / np.sqrt(found.covariance[1, 1] * found.covariance[2, 2])
    assert correlation < -0.99
    # of the difference of the two, as much is unknown as before
    difference = np.array([0.0, 1.0, -1.0]) / np.sqrt(2.0)
    prior = np.diag(prior_deviation(case) ** 2)
    assert difference @ found.covariance @ difference > 0.95 * difference @ prior @ difference


def test_a_blank_heading_costs_information_and_nothing_else() -> None:
    case, trial, _ = simulate_scenario(SCENARIOS["S4"], np.random.default_rng(FRESH))
    blank = trial.measured.copy()
    blank[::2, 1] = np.nan
    blank[100:130] = np.nan
    everything, gapped = (
        first(trial_steps(DREDGER, trial), 200),
        first(trial_steps(DREDGER, trial._replace(measured=blank)), 200),
    )
    full, partial = by_kalman_filter(case, everything), by_kalman_filter(case, gapped)
    batch = by_prediction_errors(case, gapped, partial.estimate[-1])
    assert np.all(partial.deviation[-1] > full.deviation[-1])
    assert np.all(np.abs(partial.estimate[-1] - full.estimate[-1]) < 3.0 * partial.deviation[-1])
    assert np.all(np.abs(partial.estimate[-1] - batch.estimate) < partial.deviation[-1])


def test_a_record_cut_short_gives_the_estimates_of_its_steps() -> None:
    case, trial, _ = simulate_scenario(SCENARIOS["S2"], np.random.default_rng(FRESH))
    steps = trial_steps(DREDGER, trial)
    short, long = by_kalman_filter(case, first(steps, 50)), by_kalman_filter(case, first(steps, 80))
    np.testing.assert_array_equal(short.estimate, long.estimate[:50])


def test_the_binary_sequence_has_maximum_length() -> None:
    period = pseudo_random_binary(15)
    assert period.sum() == 1.0
    products = [float(period @ pseudo_random_binary(15, shift)) for shift in range(1, 15)]
    assert products == [-1.0] * 14
