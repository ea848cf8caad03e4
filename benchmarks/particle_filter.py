"""What a step of the feedback particle filter costs, in numpy and compiled by numba, in one run.

    python benchmarks/particle_filter.py [--particles 500] [--json]        # needs the extra `fast`

Constant gain; predict and update of every step timed, the median and the quickest given. Steps of the two ways
alternate in blocks, so that both see the same machine.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import numpy as np
from compiled_particles import CompiledParticleFilter
from zheng2019_ship import DREDGER
from zheng2019_trials import SCENARIOS, simulate_scenario, trial_steps

from autopilot.filters.feedback_particle import fpf_predict, fpf_start, fpf_update
from autopilot.identification.augmented_state import Case, Steps

BLOCK = 50
"""Steps of one way before the other has its turn."""


def in_numpy(case: Case, steps: Steps, count: int) -> Callable[[int], None]:
    """Return a function that does step k on particles of its own."""
    random = np.random.default_rng(1)
    particles = fpf_start(case.prior, count, random)

    def step(k: int) -> None:
        nonlocal particles
        particles = fpf_predict(particles, case.motion, steps.inputs[k], float(steps.dt[k]), random)
        particles = fpf_update(particles, case.observe, steps.measured[k], case.R)

    return step


def compiled(case: Case, steps: Steps, count: int) -> Callable[[int], None]:
    """Return the same, compiled."""
    random = np.random.default_rng(1)
    filter_ = CompiledParticleFilter(case.drift, case.observe, case.noise, case.R, case.states)
    particles = filter_.start(case.prior, count, random)

    def step(k: int) -> None:
        filter_.predict(particles, steps.inputs[k], float(steps.dt[k]), random)
        filter_.update(particles, steps.measured[k])

    return step


def timed(name: str, count: int) -> dict[str, object]:
    """Return microseconds a step for one scenario, both ways, and what compiling took."""
    case, trial, _ = simulate_scenario(SCENARIOS[name], np.random.default_rng(0))
    steps = trial_steps(DREDGER, trial)
    ways = {"numpy": in_numpy(case, steps, count), "numba": compiled(case, steps, count)}
    began = time.perf_counter()
    compiled(case, steps, count)(0)
    compiling = time.perf_counter() - began
    costs: dict[str, list[float]] = {way: [] for way in ways}
    for first in range(0, len(steps.dt), BLOCK):
        for way, step in ways.items():
            for k in range(first, min(first + BLOCK, len(steps.dt))):
                began = time.perf_counter()
                step(k)
                costs[way].append(1.0e6 * (time.perf_counter() - began))
    row: dict[str, object] = {"scenario": name, "components": case.prior.mean.size, "compiling_s": compiling}
    for way, values in costs.items():
        row[f"{way}_median_us"], row[f"{way}_least_us"] = float(np.median(values)), float(np.min(values))
    row["ratio"] = float(np.median(costs["numpy"]) / np.median(costs["numba"]))
    return row


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--particles", type=int, default=500, metavar="N")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    rows = [timed(name, arguments.particles) for name in ("S2", "S4")]
    if arguments.json:
        print(json.dumps(rows, indent=2))
        return
    print(
        f"| N = {arguments.particles}, us a step | numpy median, least | numba median, least | ratio | compiling [s] |"
    )
    print("|---|---|---|---|---|")
    for row in rows:
        cells = [f"{row[f'{way}_median_us']:.0f}, {row[f'{way}_least_us']:.0f}" for way in ("numpy", "numba")]
        name = f"{row['scenario']}, {row['components']} components"
        print(f"| {name} | {cells[0]} | {cells[1]} | {row['ratio']:.1f} | {row['compiling_s']:.0f} |")


if __name__ == "__main__":
    main()
