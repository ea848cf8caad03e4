"""Parameters found by filters: the state of the model, with its parameters appended as states that stay as they are.

One description of the problem serves four answers, so that they can be held against each other: the extended Kalman
filter, the feedback particle filter, the batch fit that minimises whitened prediction errors over the whole record, and
the Cramer-Rao bound that none of them can beat.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from autopilot.filters.compiled_particles import CompiledParticleFilter
from autopilot.filters.feedback_particle import Gain, fpf_belief, fpf_predict, fpf_start, fpf_update
from autopilot.filters.kalman import Drift, FloatArray, Gaussian, Observe, ekf_predict, ekf_update

UNIDENTIFIED = 0.8
"""A parameter of which more than this share of the prior standard deviation is left has not been identified."""


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

    def at_end(self) -> dict[str, float]:
        """Return the last estimate by name."""
        return {name: float(value) for name, value in zip(self.names, self.estimate[-1], strict=True)}


class _Told:
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
    belief, told = case.prior, _Told(case)
    for dt, inputs, z in zip(steps.dt, steps.inputs, steps.measured, strict=True):
        belief = ekf_predict(belief, case.drift, inputs, case.noise, float(dt), case.substeps)
        belief = ekf_update(belief, case.observe, z, case.R).belief
        told.add(belief.mean, np.diagonal(belief.covariance))
    return told.found(belief.covariance)


def by_particle_filter(
    case: Case, steps: Steps, count: int, random: np.random.Generator, gain: Gain | None = None, compiled: bool = False
) -> Found:
    """Return the feedback particle filter's estimates with `count` particles; gain: constant by default.

    compiled: by numba, with the constant gain; raises InputError where numba is not installed.
    """
    if compiled:
        return _by_compiled_particles(case, steps, count, random)
    particles, told = fpf_start(case.prior, count, random), _Told(case)
    for dt, inputs, z in zip(steps.dt, steps.inputs, steps.measured, strict=True):
        particles = fpf_predict(particles, case.drift, inputs, case.noise, float(dt), random, case.substeps)
        particles = fpf_update(particles, case.observe, z, case.R, gain)
        told.add(particles.mean(axis=0), particles.var(axis=0, ddof=1))
    return told.found(fpf_belief(particles).covariance)


def _by_compiled_particles(case: Case, steps: Steps, count: int, random: np.random.Generator) -> Found:
    filter_ = CompiledParticleFilter(case.drift, case.observe, case.noise, case.R, case.states)
    particles, told = filter_.start(case.prior, count, random), _Told(case)
    for dt, inputs, z in zip(steps.dt, steps.inputs, steps.measured, strict=True):
        filter_.predict(particles, inputs, float(dt), random, case.substeps)
        filter_.update(particles, z)
        told.add(particles.mean(axis=0), particles.var(axis=0, ddof=1))
    return told.found(fpf_belief(particles).covariance)


def information_bound(case: Case, steps: Steps, truth: FloatArray) -> FloatArray:
    """Return the Cramer-Rao bound of the parameters' covariance, prior included, shape (p, p).

    truth: state and parameters at the begin of every step and at the end of the last, shape (n + 1, d). The covariance
    recursion of the Kalman filter, linearised where the ship really was (Taylor 1979; Tichavsky et al. 1998).
    """
    P = case.prior.covariance
    for k, (dt, inputs) in enumerate(zip(steps.dt, steps.inputs, strict=True)):
        moved = ekf_predict(Gaussian(truth[k], P), case.drift, inputs, case.noise, float(dt), case.substeps)
        P = ekf_update(Gaussian(truth[k + 1], moved.covariance), case.observe, steps.measured[k], case.R)[0].covariance
    return np.asarray(P[case.states :, case.states :])


def unidentified(case: Case, deviation: FloatArray) -> tuple[str, ...]:
    """Return the parameters of which the record tells next to nothing: more than `UNIDENTIFIED` of the prior standard
    deviation is left in `deviation`, shape (p,)."""
    left = deviation / case.prior_deviation
    return tuple(name for name, share in zip(case.names, left, strict=True) if share > UNIDENTIFIED)


def normalised_error(found: Found, truth: FloatArray) -> float:
    """Return e' P^-1 e / p at the end: 1 on average where a filter knows how wrong it is, more where it is too sure."""
    error = found.estimate[-1] - truth
    return float(error @ np.linalg.solve(found.covariance, error) / error.size)
