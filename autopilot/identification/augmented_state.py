"""Parameters appended to the state of the model, as states that stay as they are, and found from a record.

One description of the problem, `Case`, serves the extended Kalman filter and the feedback particle filter, so that they
can be held against each other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from autopilot.filters.feedback_particle import Gain, fpf_belief, fpf_predict, fpf_start, fpf_update
from autopilot.filters.kalman import (
    Drift,
    FloatArray,
    Gaussian,
    Motion,
    Observe,
    ekf_predict,
    ekf_update,
)


class Case(NamedTuple):
    """What is to be identified: p parameters `names`, the last p of the d components of the state.

    drift, observe, noise (d, q), R (m, m) as in the filters; substeps of the midpoint rule between samples; prior: the
    belief about state and parameters before the record.
    """

    names: tuple[str, ...]
    drift: Drift
    observe: Observe
    noise: FloatArray
    R: FloatArray
    prior: Gaussian
    substeps: int = 1

    @property
    def motion(self) -> Motion:
        """How state and parameters move."""
        return Motion(self.drift, self.noise, self.substeps)

    @property
    def states(self) -> int:
        """How many components of the state are not parameters."""
        return self.prior.mean.size - len(self.names)

    @property
    def prior_deviation(self) -> FloatArray:
        """Standard deviations of the parameters before the record, shape (p,)."""
        return np.asarray(np.sqrt(np.diag(self.prior.covariance)[self.states :]))


class Steps(NamedTuple):
    """A record: for each of n steps its length dt, shape (n,), the inputs held over it, and what was measured at its
    end, shape (n, m), nan where nothing was."""

    dt: FloatArray
    inputs: Sequence[Any]
    measured: FloatArray


class Found(NamedTuple):
    """Parameters after each step with their standard deviations, shape (n, p), and the parameters' covariance at the
    end, shape (p, p)."""

    names: tuple[str, ...]
    estimate: FloatArray
    deviation: FloatArray
    covariance: FloatArray


class _History:
    """Keeps what a filter says of the parameters after each step."""

    def __init__(self, case: Case) -> None:
        self._case, self._means, self._variances = case, list[FloatArray](), list[FloatArray]()

    def add(self, mean: FloatArray, variance: FloatArray) -> None:
        """Keep the parameters' part of mean and variances of the state, shape (d,)."""
        self._means.append(mean[self._case.states :])
        self._variances.append(variance[self._case.states :])

    def found(self, covariance: FloatArray) -> Found:
        """Return everything, with the state's covariance at the end."""
        first = self._case.states
        deviation = np.sqrt(np.array(self._variances))
        return Found(self._case.names, np.array(self._means), deviation, covariance[first:, first:])


def by_kalman_filter(case: Case, steps: Steps) -> Found:
    """Return the extended Kalman filter's estimates."""
    belief, history = case.prior, _History(case)
    for dt, inputs, z in zip(steps.dt, steps.inputs, steps.measured, strict=True):
        belief = ekf_predict(belief, case.motion, inputs, float(dt))
        belief = ekf_update(belief, case.observe, z, case.R).belief
        history.add(belief.mean, np.diagonal(belief.covariance))
    return history.found(belief.covariance)


def by_particle_filter(
    case: Case, steps: Steps, count: int, random: np.random.Generator, gain: Gain | None = None
) -> Found:
    """Return the feedback particle filter's estimates with `count` particles; gain: constant by default."""
    particles, history = fpf_start(case.prior, count, random), _History(case)
    for dt, inputs, z in zip(steps.dt, steps.inputs, steps.measured, strict=True):
        particles = fpf_predict(particles, case.motion, inputs, float(dt), random)
        particles = fpf_update(particles, case.observe, z, case.R, gain)
        history.add(particles.mean(axis=0), particles.var(axis=0, ddof=1))
    return history.found(fpf_belief(particles).covariance)
