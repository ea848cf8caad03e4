"""The feedback particle filter: particles that are steered by each measurement, never weighted or drawn anew.

Between measurements every particle follows the model with noise of its own. A sampled measurement z of covariance R
then moves the particles while lambda goes from 0 to 1 (in units where R = I):

    dx/dlambda = K(x) [z - (h(x) + h^)/2],   h^ the particles' mean of h

where the gain K_j = grad phi_j solves  div(p grad phi_j) = -(h_j - h^_j) p. Where K is constant and h linear the flow
has a closed form: each step of lambda damps the innovation by it, so that a step is exact for Gaussians and stable for
any size. Here it is constant, the covariance of x and h, which makes the filter an ensemble Kalman filter; gains that
follow the density are in benchmarks/particle_gains.py, for where the record has narrowed the belief it is a Gaussian,
whose gain is constant. The flow follows Bayes' rule exactly where a measurement tells little at a time, as in
continuous observation; a single strong measurement of a density far from Gaussian is where it is approximate.

Source: Yang, Blom and Mehta 2014 (continuous-discrete FPF); Zheng et al. 2019, eqs (6)-(11), whose (7) prints Q for
its root and whose (8) and (11) need the continuous intensity R dt; Bergemann and Reich 2010 for the closed form.

Parameters are appended to the state of the model, as states that stay as they are, and found from a record (`Case`).

One step of a stochastic differential equation x' = f(x, u) + w goes for many states at once, by the midpoint rule.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

Drift = Callable[[Any, Any], Sequence[Any]]
"""f(state, inputs): the d rates of a state with d components. state[i] is component i, a float or an array of one
value for each of many states; so is each rate. Inputs are whatever the model needs, held over the step."""

Observe = Callable[[Any], Sequence[Any]]
"""h(state): the m values that a measurement of the state would show without noise; state as in Drift."""


class Motion(NamedTuple):
    """How a state moves: x' = f(x, u) + w with f the `drift`; noise: square root of the intensity Q of w, shape (d, q),
    Q = noise noise', in units of the state per sqrt(s); substeps of the midpoint rule in a step."""

    drift: Drift
    noise: FloatArray
    substeps: int = 1


def midpoint_step(
    drift: Drift, inputs: Any, states: FloatArray, dt: float, kick: FloatArray | float = 0.0, substeps: int = 1
) -> FloatArray:
    """Return `states`, shape (n, d), after `dt` [s]: x' = f(x, u) + kick/dt, with u and the kick held.

    kick: what the process noise adds over the step, shape (n, d); a Gaussian of covariance Q dt makes the step a
    second-order one of dx = f dt + Q^(1/2) dW. Second order in dt/substeps.
    """
    h = dt / substeps
    push = kick / substeps
    for _ in range(substeps):
        middle = states + 0.5 * (h * rates(drift, inputs, states) + push)
        states = states + h * rates(drift, inputs, middle) + push
    return states


def rates(drift: Drift, inputs: Any, states: FloatArray) -> FloatArray:
    """Return f(x, u) for `states`, shape (n, d)."""
    return _columns(drift(states.T, inputs), states.shape[0])


def observed(observe: Observe, states: FloatArray) -> FloatArray:
    """Return h(x) for `states`, shape (n, d), as shape (n, m)."""
    return _columns(observe(states.T), states.shape[0])


def _columns(components: Sequence[Any], count: int) -> FloatArray:
    table = np.empty((count, len(components)))
    for index, values in enumerate(components):
        table[:, index] = values
    return table


class Gaussian(NamedTuple):
    """A belief: mean, shape (d,), and covariance, shape (d, d)."""

    mean: FloatArray
    covariance: FloatArray


LARGEST_STEP = 0.4
"""A step of lambda is at most this over trace(P_zz R^-1), and the gain is found anew for each."""

MOST_STEPS = 200
"""So many steps are never needed by a sensible prior; the last one then goes to the end."""


Moved = Callable[[FloatArray, FloatArray, FloatArray, float], tuple[float, FloatArray]]
"""Of particles, shape (N, d), what each shows, whitened, shape (N, m), what was measured, and a step of lambda: the
step that is taken, and dx/dlambda, shape (N, d)."""


def by_constant_gain(particles: FloatArray, h: FloatArray, z: FloatArray, step: float) -> tuple[float, FloatArray]:
    """Return the step and dx/dlambda by K = cov(x, h), the best gain that is the same for all particles, so that a step
    is exact for a linear h; Zheng et al. 2019, eq. (8)."""
    spread, innovation = damped(h, z, step)
    around = particles - particles.mean(axis=0)
    return step, np.asarray(innovation @ (around.T @ spread / (particles.shape[0] - 1)).T)


def damped(h: FloatArray, z: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Return how far each particle shows something else than their mean, and the innovation of each, damped so that a
    step of size `step` is exact for a linear h and constant gain; shape (N, m) each."""
    spread = h - h.mean(axis=0)
    pull, shrink = damping_matrices(spread.T @ spread / (h.shape[0] - 1), step)
    return spread, (z - h.mean(axis=0)) @ pull.T - spread @ shrink.T


def fpf_start(belief: Gaussian, count: int, random: np.random.Generator) -> FloatArray:
    """Return `count` particles drawn from the belief, shape (count, d). Raises ValueError where count < 2."""
    if count < 2:
        raise ValueError(f"fpf_start: at least 2 particles are needed, got {count}")
    values, vectors = np.linalg.eigh(belief.covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    return np.asarray(belief.mean + random.standard_normal((count, belief.mean.size)) @ root.T)


def fpf_belief(particles: FloatArray) -> Gaussian:
    """Return mean and covariance of the particles, shape (N, d)."""
    return Gaussian(particles.mean(axis=0), np.atleast_2d(np.cov(particles.T)))


def fpf_predict(
    particles: FloatArray, motion: Motion, inputs: Any, dt: float, random: np.random.Generator
) -> FloatArray:
    """Return the particles, shape (N, d), `dt` [s] later, inputs held."""
    drift, noise, substeps = motion
    drawn = random.standard_normal((particles.shape[0], noise.shape[1]))
    return midpoint_step(drift, inputs, particles, dt, drawn @ (noise * np.sqrt(dt)).T, substeps)


def fpf_update(
    particles: FloatArray, observe: Observe, measured: FloatArray, R: FloatArray, moved: Moved = by_constant_gain
) -> FloatArray:
    """Return the particles, shape (N, d), after the measurement z, shape (m,), of covariance R, shape (m, m).

    moved: how a gain moves them. Values of z that are not finite do not count.
    """
    there = np.isfinite(measured)
    if not there.any():
        return particles
    whiten = np.linalg.inv(np.linalg.cholesky(R[np.ix_(there, there)])).T

    def shown(states: FloatArray) -> FloatArray:
        return np.asarray(observed(observe, states)[:, there] @ whiten)

    z = measured[there] @ whiten
    done, taken, lost = 0.0, 0, 0.0
    while done < 1.0:
        h = shown(particles)
        trace = float(np.sum(np.var(h, axis=0, ddof=1)))
        step = min(LARGEST_STEP / max(trace, 1.0e-300), 1.0 - done)
        step, move = moved(particles, h, z, step)
        if not taken:
            lost = _chance_shrinkage(h)
        taken += 1
        step = 1.0 - done if taken == MOST_STEPS else step
        particles = particles + step * move
        done = 1.0 if step >= 1.0 - done else done + step
    return np.asarray(particles + lost * (particles - particles.mean(axis=0)))


def _chance_shrinkage(h: FloatArray) -> float:
    """Return by which share the spread must grow again after an update: the gain of N particles holds correlations of
    chance, of square 1/(N - 1), which take sum_j s_j/(1 + s_j)/(N - 1) off the variance even of what was not measured
    at all; s are the eigenvalues of P_zz R^-1. Over thousands of updates the particles would collapse."""
    s = np.linalg.eigvalsh(np.atleast_2d(np.cov(h.T)))
    return float(0.5 * np.sum(s / (1.0 + s)) / (h.shape[0] - 1))


def damping_matrices(S: FloatArray, step: float) -> tuple[FloatArray, FloatArray]:
    """Return (I + step S)^-1 and (I + step S + (I + step S)^(1/2))^-1, shape (m, m): as step goes to 0, I and I/2."""
    values, vectors = np.linalg.eigh(S)
    grown = 1.0 + step * np.maximum(values, 0.0)
    pull = (vectors / grown) @ vectors.T
    return pull, np.asarray((vectors / (grown + np.sqrt(grown))) @ vectors.T)


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


def by_particle_filter(
    case: Case, steps: Steps, count: int, random: np.random.Generator, moved: Moved = by_constant_gain
) -> Found:
    """Return the feedback particle filter's estimates with `count` particles; moved: how a gain moves them."""
    particles, history = fpf_start(case.prior, count, random), _History(case)
    for dt, inputs, z in zip(steps.dt, steps.inputs, steps.measured, strict=True):
        particles = fpf_predict(particles, case.motion, inputs, float(dt), random)
        particles = fpf_update(particles, case.observe, z, case.R, moved)
        history.add(particles.mean(axis=0), particles.var(axis=0, ddof=1))
    return history.found(fpf_belief(particles).covariance)
