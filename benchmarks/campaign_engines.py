"""Wall time of the same study by the local pool, dask and ray, two workers each, one after the other in turns.

    python benchmarks/campaign_engines.py [--runs 40] [--turns 3] [--workers 2]

Starting an engine is not counted: the clock runs from the first batch that is done to the last. Efficiency is the
local pool's time over the engine's, the best of the turns of each; results are compared as well.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace

from autopilot.errors import InputError
from sitl.campaign.cases import Job, number_of_runs
from sitl.campaign.engines import engine_of, in_order
from sitl.campaign.study import load_study
from sitl.campaign.work import Row, batches_of

ENGINES = ("local", "dask", "ray")


def timed(name: str, job: Job, workers: int) -> tuple[float, list[Row]]:
    """Return the wall time [s] from the first batch to the last, for as many runs as lie between, and the rows."""
    begun, rows = math.nan, []
    for batch in in_order(engine_of(name)(job, batches_of(job, number_of_runs(job)), workers, True)):
        begun = time.perf_counter() if math.isnan(begun) else begun
        rows += batch
    return time.perf_counter() - begun, rows


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=40)
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    study, folder = load_study("front")
    job = Job(replace(study, runs=asked.runs, laws=("backstepping",), gain_factors=(1.0,)), folder)
    best: dict[str, float] = {}
    expected: list[Row] = []
    for _ in range(asked.turns):
        for name in ENGINES:
            try:
                seconds, rows = timed(name, job, asked.workers)
            except InputError as error:
                print(error)
                continue
            best[name] = min(best.get(name, math.inf), seconds)
            expected = expected or rows
            if rows != expected:
                raise SystemExit(f"{name}: other results than the local pool's")
    print(f"{len(expected)} runs of {study.seconds:g} s, {asked.workers} workers: the same results from all")
    for name, seconds in best.items():
        print(f"{name:8s}{seconds:8.1f} s   efficiency beside local {best['local'] / seconds:5.2f}")


if __name__ == "__main__":
    main()
