"""A trim of each run's own: what wind and current are worth differs between recordings.

An n0 of its own is, at all speeds, a rudder angle that the run's rudder stands off by: K delta - n0 = K (delta + t) -
n0', for K and n0 both go with the speed. The angles t of R runs are fitted as R - 1 orthogonal contrasts that add up to
nothing, beside the n0 that the runs have on average; they are nuisance parameters, of no use for another day.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.linalg import helmert

from autopilot.identification.runs import FloatArray, Run

Trim = Literal["common", "per-run"]
"""One n0 for all runs, or one for each."""

PREFIX = "trim_"
TYPICAL_TRIM_RAD = 0.02


class RunTrims(NamedTuple):
    """owners: per segment the number of its run. values [rad]: of the contrasts, one less than there are runs."""

    owners: tuple[int, ...] = ()
    values: tuple[float, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """What the contrasts are called among the parameters that are free."""
        return tuple(f"{PREFIX}{number}" for number in range(len(self.values)))

    @property
    def angles(self) -> FloatArray:
        """The rudder angle [rad] that each run has beside the others, shape (R,)."""
        return np.asarray(_contrasts(len(self.values)) @ np.array(self.values))

    def shares(self) -> FloatArray:
        """Return how much of each contrast each segment has, shape (S, R - 1)."""
        return _contrasts(len(self.values))[list(self.owners)]

    def of_segments(self) -> FloatArray:
        """Return the angle [rad] of each segment, shape (S,)."""
        return self.angles[list(self.owners)]


NO_TRIMS = RunTrims()
"""All runs share one n0."""


def own_trims(runs: Sequence[Run], trim: Trim) -> RunTrims:
    """Return trims of 0 for each run, or none at all where all share one or there is one run alone."""
    if trim == "common" or len(runs) < 2:
        return NO_TRIMS
    owners = tuple(number for number, run in enumerate(runs) for _ in run.segments)
    return RunTrims(owners, (0.0,) * (len(runs) - 1))


def _contrasts(count: int) -> FloatArray:
    """Return orthonormal columns that add up to 0, shape (R, R - 1), R = `count` + 1."""
    return np.asarray(helmert(count + 1).T, dtype=np.float64)
