"""Zheng et al. 2019 over again: three methods on simulated trials of the dredger, beside the bound none can beat.

    python benchmarks/zheng2019_dynamic_positioning.py [--seeds 20] [--first-seed 0] [--scenarios S2]

Each seed draws another prior, another sea and another measurement noise. Printed: the median error, root mean square
errors over the Cramer-Rao bound, how sure each filter was of itself, and how soon it was near. Some minutes.
"""

from __future__ import annotations

import argparse
import json
from typing import NamedTuple

import numpy as np
from extended_kalman import by_kalman_filter, ekf_predict, ekf_update, prior_deviation
from zheng2019_ship import (
    DREDGER,
    SCENARIOS,
    UNIDENTIFIED,
    Scenario,
    by_prediction_errors,
    simulate_scenario,
    trial_steps,
)

from autopilot.identification.feedback_particle import (
    Case,
    FloatArray,
    Found,
    Gaussian,
    Steps,
    by_particle_filter,
)

PARTICLES = 500
NEAR = 0.05
EARLY_STEP = 140


class Seed(NamedTuple):
    """One trial's outcome. Errors and bound are shares of the truth, shape (p,); track: of every step, (n, p); holds:
    whether each 95 % interval has the truth in it."""

    errors: dict[str, FloatArray]
    holds: dict[str, FloatArray]
    tracks: dict[str, FloatArray]
    bound: FloatArray
    normalised_error: dict[str, float]
    unidentified: dict[str, tuple[str, ...]]


def information_bound(case: Case, steps: Steps, truth: FloatArray) -> FloatArray:
    """Return the Cramer-Rao bound of the parameters' covariance, prior included, shape (p, p).

    truth: state and parameters at the begin of every step and at the end of the last, shape (n + 1, d). The covariance
    recursion of the Kalman filter, linearised where the ship really was (Taylor 1979; Tichavsky et al. 1998).
    """
    P = case.prior.covariance
    for k, (dt, inputs) in enumerate(zip(steps.dt, steps.inputs, strict=True)):
        moved = ekf_predict(Gaussian(truth[k], P), case.motion, inputs, float(dt))
        P = ekf_update(Gaussian(truth[k + 1], moved.covariance), case.observe, steps.measured[k], case.R)[0].covariance
    return np.asarray(P[case.states :, case.states :])


def unidentified(case: Case, deviation: FloatArray) -> tuple[str, ...]:
    """Return the parameters of which the record tells next to nothing: more than `UNIDENTIFIED` of the prior standard
    deviation is left in `deviation`, shape (p,)."""
    left = deviation / prior_deviation(case)
    return tuple(name for name, share in zip(case.names, left, strict=True) if share > UNIDENTIFIED)


def normalised_error(found: Found, truth: FloatArray) -> float:
    """Return e' P^-1 e / p at the end: 1 on average where a filter knows how wrong it is, more where it is too sure."""
    error = found.estimate[-1] - truth
    return float(error @ np.linalg.solve(found.covariance, error) / error.size)


def run_seed(scenario: Scenario, seed: int) -> Seed:
    """Simulate one trial and identify it every way."""
    random = np.random.default_rng(seed)
    case, trial, states = simulate_scenario(scenario, random)
    truth, steps = np.array(scenario.truth), trial_steps(DREDGER, trial)
    filters = {
        "EKF": by_kalman_filter(case, steps),
        "FPF": by_particle_filter(case, steps, PARTICLES, random),
    }
    batch = by_prediction_errors(case, steps, filters["EKF"].estimate[-1])
    bound = np.sqrt(np.diag(information_bound(case, steps, states)))
    size = np.abs(truth)
    errors = {name: (found.estimate[-1] - truth) / size for name, found in filters.items()}
    left = {name: unidentified(case, found.deviation[-1]) for name, found in filters.items()}
    deviations = {name: found.deviation[-1] for name, found in filters.items()}
    deviations["batch"] = np.sqrt(np.diag(batch.covariance))
    errors["batch"] = (batch.estimate - truth) / size
    return Seed(
        errors=errors,
        holds={name: np.abs(error) * size < 1.96 * deviations[name] for name, error in errors.items()},
        tracks={name: np.abs(found.estimate - truth) / size for name, found in filters.items()},
        bound=bound / size,
        normalised_error={name: normalised_error(found, truth) for name, found in filters.items()},
        unidentified={**left, "batch": unidentified(case, deviations["batch"])},
    )


def summary(scenario: Scenario, seeds: list[Seed]) -> dict[str, object]:
    """Return the table of one scenario, in per cent of the truth."""
    names = scenario.truth._fields
    bound = np.sqrt(np.mean([seed.bound**2 for seed in seeds], axis=0))
    rows: dict[str, object] = {"bound": dict(zip(names, 67.45 * bound, strict=True))}
    for method in ("EKF", "FPF", "batch"):
        errors = np.array([seed.errors[method] for seed in seeds])
        rms = np.sqrt(np.mean(errors**2, axis=0))
        row: dict[str, object] = {
            "median": dict(zip(names, 100.0 * np.median(np.abs(errors), axis=0), strict=True)),
            "rms over bound": dict(zip(names, rms / bound, strict=True)),
            "95 % interval holds": {
                name: int(sum(seed.holds[method][i] for seed in seeds)) for i, name in enumerate(names)
            },
            "cannot be identified": {name: sum(name in seed.unidentified[method] for seed in seeds) for name in names},
        }
        if method in seeds[0].normalised_error:
            tracks = np.median([seed.tracks[method] for seed in seeds], axis=0)
            row["normalised error"] = float(np.mean([seed.normalised_error[method] for seed in seeds]))
            row["median at step 140"] = dict(zip(names, 100.0 * tracks[EARLY_STEP - 1], strict=True))
            far = [np.flatnonzero(tracks[:, i] > NEAR) for i in range(len(names))]
            row["within 5 % from step"] = {
                name: None if steps.size and steps[-1] == len(tracks) - 1 else int(steps[-1]) + 2 if steps.size else 1
                for name, steps in zip(names, far, strict=True)
            }
        rows[method] = row
    return rows


def as_text(scenario: Scenario, rows: dict[str, object], count: int) -> str:
    """Return the table as it stands in benchmarks/results/zheng2019.md."""
    names = scenario.truth._fields
    lines = [f"{scenario.name}: {scenario.summary}; {count} seeds", f"{'':34}" + "".join(f"{n:>9}" for n in names)]

    def line(label: str, values: dict[str, float | None], form: str) -> None:
        cells = ["never" if values[n] is None else format(values[n], form) for n in names]
        lines.append(f"{label:34}" + "".join(f"{cell:>9}" for cell in cells))

    line("bound, median error of it [%]", rows["bound"], ".3f")  # type: ignore[arg-type]
    forms = {"median": ".3f", "rms over bound": ".2f", "median at step 140": ".2f"}
    units = {"median": "median error [%]", "median at step 140": "median error at step 140 [%]"}
    for method in ("EKF", "FPF", "batch"):
        row = rows[method]
        assert isinstance(row, dict)
        for key, values in row.items():
            if isinstance(values, dict):
                line(f"{method}: {units.get(key, key)}", values, forms.get(key, "d"))
            else:
                lines.append(f"{method + ': normalised error':34}{values:9.2f}")
    return "\n".join(lines)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, metavar="N")
    parser.add_argument("--first-seed", type=int, default=0, metavar="S")
    parser.add_argument("--scenarios", nargs="+", choices=list(SCENARIOS), default=list(SCENARIOS))
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    results = {}
    for name in arguments.scenarios:
        scenario = SCENARIOS[name]
        seeds = [run_seed(scenario, arguments.first_seed + k) for k in range(arguments.seeds)]
        results[name] = summary(scenario, seeds)
        if not arguments.json:
            print(as_text(scenario, results[name], arguments.seeds), end="\n\n", flush=True)
    if arguments.json:
        print(json.dumps(results, indent=2))


if __name__ == "__main__":
    main()
