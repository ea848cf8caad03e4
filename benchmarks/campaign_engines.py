"""Wall time of the same study by the local pool and dask, two workers each, one after the other in turns.

    python benchmarks/campaign_engines.py [--runs 400] [--turns 3] [--workers 2]

Two times are reported: starting the engine until every worker has loaded the compiled loop, and from there to the last
batch. Efficiency is of the work: the local pool's time over the engine's, each the best of the turns; the results are
compared as well. A first turn of the local pool, not counted, compiles what is not yet on disk.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace

from autopilot.errors import InputError
from sitl.campaign.study import Job, load_study, number_of_runs, steps_of
from sitl.campaign.work import Row, batches_of, engine_of, in_order
from sitl.world import STEP

ENGINES = ("local", "dask")


def timed(name: str, job: Job, workers: int) -> tuple[float, float, list[Row]]:
    """Return the wall times [s] to the start of the work and of the work, and the rows."""
    marks = [time.perf_counter()]
    engine = engine_of(name)(job, batches_of(job, number_of_runs(job)), workers, True, lambda: marks.append(_now()))
    rows = [row for batch in in_order(engine) for row in batch]
    return marks[1] - marks[0], _now() - marks[1], rows


def _now() -> float:
    return time.perf_counter()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=400, help="runs of each of the 18 cases (default 400)")
    parser.add_argument("--turns", type=int, default=3)
    parser.add_argument("--workers", type=int, default=2)
    asked = parser.parse_args()
    study, folder = load_study("front")
    job = Job(replace(study, runs=asked.runs, laws=("backstepping",), gain_factors=(1.0,)), folder)
    timed("local", Job(replace(job.study, runs=1), folder), asked.workers)
    best: dict[str, tuple[float, float]] = {}
    expected: list[Row] = []
    for _ in range(asked.turns):
        for name in ENGINES:
            try:
                start, work, rows = timed(name, job, asked.workers)
            except InputError as error:
                print(error)
                continue
            before = best.get(name, (math.inf, math.inf))
            best[name] = (min(before[0], start), min(before[1], work))
            expected = expected or rows
            if rows != expected:
                other = next(pair for pair in zip(rows, expected, strict=True) if pair[0] != pair[1])
                raise SystemExit(f"{name}: other results than the local pool's, the first of them {other}")
    steps = len(expected) * steps_of(job.study, STEP)
    print(f"{len(expected)} runs of {study.seconds:g} s, {asked.workers} workers: the same results from all")
    for name, (start, work) in best.items():
        local = best["local"][1]
        print(
            f"{name:6s} start {start:6.1f} s   work {work:6.1f} s, {steps / work:.3g} steps a second   "
            f"efficiency beside local {local / work:5.2f}"
        )


if __name__ == "__main__":
    main()
