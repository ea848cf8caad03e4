"""What a step of recursive least squares costs, beside padasip in the same run; prints one table.

    pip install '.[bench]' && python benchmarks/rls_speed.py

Both get the same random regressors one at a time, as a loop that sails would give them, with the same forgetting, start
and initial covariance; the table also says how far their estimates end apart. Shortest processor time of several
repetitions.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from autopilot.filters.rls import rls_start, rls_step

SAMPLES, REPETITIONS = 200, 300
FORGETTING, VARIANCE = 0.999, 1.0e3


def ours(rows: list[list[float]], measured: list[float]) -> list[float]:
    """Return the estimate of `autopilot.filters.rls`."""
    state = rls_start([0.0] * len(rows[0]), VARIANCE)
    for row, value in zip(rows, measured, strict=True):
        state = rls_step(state, row, value, FORGETTING)
    return list(state.theta)


def padasip(rows: list[np.ndarray], measured: list[float]) -> list[float]:
    """Return the estimate of padasip's filter."""
    from padasip.filters import FilterRLS

    one = FilterRLS(len(rows[0]), mu=FORGETTING, eps=1.0 / VARIANCE, w="zeros")
    for row, value in zip(rows, measured, strict=True):
        one.adapt(value, row)
    return [float(weight) for weight in one.w]


def shortest(run: Callable[[], object]) -> float:
    """Return the shortest time [s] of the repetitions."""
    times = []
    for _ in range(REPETITIONS):
        begun = time.process_time()
        run()
        times.append(time.process_time() - begun)
    return min(times)


def main() -> int:
    """Print the table; 2 where padasip is not installed."""
    try:
        import padasip as _  # noqa: F401 - is it there?
    except ImportError:
        print("padasip is not installed: pip install '.[bench]'", file=sys.stderr)
        return 2
    random = np.random.default_rng(1)
    print("| parameters | ours, us a sample | padasip, us a sample | ratio | estimates apart |")
    print("|---|---|---|---|---|")
    for n in (2, 3, 4):
        phi = random.normal(size=(SAMPLES, n))
        measured = (phi @ random.normal(size=n) + 0.1 * random.normal(size=SAMPLES)).tolist()
        rows, arrays = phi.tolist(), list(phi)
        apart = max(abs(a - b) for a, b in zip(ours(rows, measured), padasip(arrays, measured), strict=True))
        own = shortest(lambda rows=rows, measured=measured: ours(rows, measured)) / SAMPLES * 1.0e6
        other = shortest(lambda rows=arrays, measured=measured: padasip(rows, measured)) / SAMPLES * 1.0e6
        print(f"| {n} | {own:.1f} | {other:.1f} | {other / own:.1f} | {apart:.0e} |")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
