"""Fronts of heading rms [deg] against rudder travel [deg/s], what two of them come to beside each other, and a search.

A point is (rms, travel). Between the points of a front both are taken to run straight in their logarithms; to the right
of its last point its best rms holds, since nobody has to use more rudder.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]

GRID = 21
LEAST = np.array([0.1, 0.01])
"""Less counts as this: an rms of 0.1 deg, half the quieter compass's noise, a travel of a degree in 100 s."""


def front(points: Floats) -> Floats:
    """Return the points (n, 2) that none beats in both, by rising travel."""
    kept: list[Floats] = []
    for point in points[np.lexsort((points[:, 0], points[:, 1]))]:
        if not kept or point[0] < kept[-1][0]:
            kept.append(point)
    return np.array(kept)


class Beside(NamedTuple):
    """Ours over theirs, medians over what both fronts reach: rms at equal travel, travel at equal rms; and the worst
    rms at equal travel. nan where the fronts have no travel, or no rms, in common."""

    rms: float
    travel: float
    worst_rms: float


def beside(ours: Floats, theirs: Floats) -> Beside:
    """Return our front beside theirs, both (n, 2)."""
    mine, peers = (np.log(front(np.maximum(points, LEAST))) for points in (ours, theirs))
    rms = _ratios(mine, peers, 1)
    travel = _ratios(mine[::-1], peers[::-1], 0)
    return Beside(
        math.exp(float(np.median(rms))) if rms.size else math.nan,
        math.exp(float(np.median(travel))) if travel.size else math.nan,
        math.exp(float(np.max(rms))) if rms.size else math.nan,
    )


def _ratios(mine: Floats, peers: Floats, along: int) -> Floats:
    """Return the logarithms of our other coordinate over theirs, at values of the coordinate `along` that both have."""
    low = max(mine[:, along].min(), peers[:, along].min())
    high = min(mine[:, along].max(), peers[:, along].max())
    if high < low:
        # one front ends before the other begins: at its own beginning the left one holds its best
        high = low
    at = np.linspace(low, high, GRID)
    other = 1 - along
    mine_at, peers_at = (np.interp(at, points[:, along], points[:, other]) for points in (mine, peers))
    return np.asarray(mine_at - peers_at)


class Explored(NamedTuple):
    """Settings tried (n, numbers) and what each came to in each run (n, runs, 2)."""

    settings: Floats
    points: Floats


def explore(
    sailed: Callable[[Floats], Floats],
    starts: Floats,
    low: Floats,
    high: Floats,
    costs: Callable[[Floats], Floats],
    count: int,
    seed: int,
    tried: Callable[[], None] = lambda: None,
) -> Explored:
    """Return `count` settings within bounds, sought for all of several costs at once.

    costs: from what a setting came to in each run (runs, 2) to its costs, one for each weight and group of runs. The
    `starts` (n, numbers) come first, up to a third is drawn at random; then to the best setting for a cost picked by
    lot the difference of two others that are best for some cost is added (Storn and Price 1997), and all is moved a
    little at random.
    """
    random = np.random.default_rng(seed)
    settings: list[Floats] = []
    points: list[Floats] = []
    values: list[Floats] = []
    while len(settings) < count:
        if len(settings) < len(starts):
            new = starts[len(settings)]
        elif len(settings) < count // 3:
            new = random.uniform(low, high)
        else:
            best = np.argmin(np.array(values), axis=0)
            parent, one, other = (settings[int(random.choice(best))] for _ in range(3))
            moved = parent + random.uniform(0.2, 0.9) * (one - other)
            new = np.clip(moved + random.normal(0.0, 0.06, len(low)) * (high - low), low, high)
        settings.append(new)
        points.append(sailed(new))
        values.append(costs(points[-1]))
        tried()
    return Explored(np.array(settings), np.array(points))


def chosen(explored: Explored, costs: Callable[[Floats], Floats], which: Sequence[int]) -> Floats:
    """Return the settings that are best for the costs at the places `which`, each once."""
    values = np.array([costs(points) for points in explored.points])
    places = sorted({int(np.argmin(values[:, place])) for place in which})
    return np.asarray(explored.settings[places])
