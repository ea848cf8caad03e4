"""The feedback particle filter: particles that are steered by each measurement, never weighted or drawn anew.

Between measurements every particle follows the model with noise of its own. A sampled measurement z of covariance R
then moves the particles while lambda goes from 0 to 1 (in units where R = I):

    dx/dlambda = K(x) [z - (h(x) + h^)/2],   h^ the particles' mean of h

where the gain K_j = grad phi_j solves  div(p grad phi_j) = -(h_j - h^_j) p. Where K is constant and h linear the flow
has a closed form: each step of lambda damps the innovation by it, so that a step is exact for Gaussians and stable for
any size. Three gains (`autopilot.filters.feedback_particle`): constant, the covariance of x and h, which makes the
filter an ensemble Kalman filter; Galerkin, in polynomials; kernel, from a diffusion map. The flow follows Bayes' rule
exactly where a measurement tells little at a time, as in continuous observation; a single strong measurement of a
density far from Gaussian is where its feedback form is approximate.

Source: Yang, Blom and Mehta 2014 (continuous-discrete FPF); Zheng et al. 2019, eqs (6)-(11), whose (7) prints Q for
its root and whose (8) and (11) need the continuous intensity R dt; Bergemann and Reich 2010 for the closed form.

Gains of the feedback particle filter: div(p grad phi) = -g p solved for p known only by its particles.

Each gain works in the particles' own coordinates y = L^-1 (x - mean), covariance L L', so that units do not matter;
carried back, K = L grad_y phi solves the same equation.

Parameters are appended to the state of the model, as states that stay as they are, and found from a record (`Case`).

One step of a stochastic differential equation x' = f(x, u) + w goes for many states at once, by the midpoint rule.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache
from itertools import combinations_with_replacement
from typing import Any, NamedTuple, Protocol

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


ISOLATED = 1.0e-6
"""Share of phi that a particle forgets: far below any error of the gain."""


class Gain(Protocol):
    """A way to solve the gain's equation. varies: whether the gain differs from particle to particle."""

    @property
    def varies(self) -> bool:
        """Whether the gain differs from particle to particle."""

    def steer(self, particles: FloatArray, g: FloatArray, innovation: FloatArray) -> FloatArray:
        """Return sum_j K_j innovation_j, shape (N, d): K_j solves the equation for g_j, zero mean, shape (N, m)."""


class ConstantGain(NamedTuple):
    """K = cov(x, g): the best gain that is the same for all particles; Zheng et al. 2019, eq. (8)."""

    @property
    def varies(self) -> bool:
        """One gain for all."""
        return False

    def steer(self, particles: FloatArray, g: FloatArray, innovation: FloatArray) -> FloatArray:
        """Return sum_j K_j innovation_j, shape (N, d)."""
        around = particles - particles.mean(axis=0)
        return np.asarray(innovation @ (around.T @ g / (particles.shape[0] - 1)).T)


class GalerkinGain(NamedTuple):
    """phi as a polynomial in the particles' own coordinates, of total degree `degree` and with at most `mixed`
    coordinates in a term: mean(grad psi_k . grad psi_l) c_l = mean(psi_k g). Degree 1 is the constant gain.

    Source: Yang, Mehta and Meyn 2013, section on the Galerkin approximation.
    """

    degree: int = 2
    mixed: int = 2

    @property
    def varies(self) -> bool:
        """A linear phi has a constant gradient."""
        return self.degree > 1

    def steer(self, particles: FloatArray, g: FloatArray, innovation: FloatArray) -> FloatArray:
        """Return sum_j K_j innovation_j, shape (N, d)."""
        y, L = own_coordinates(particles)
        N, d = y.shape
        values, slopes = _polynomials(y, _growths(d, self.degree, self.mixed))
        A = np.sum(slopes @ slopes.transpose(0, 2, 1), axis=0) / N
        A[np.diag_indices_from(A)] *= 1.0 + 1.0e-9
        coefficients = np.linalg.solve(A, values @ g / (N - 1))
        along = np.einsum("ekn,kn->en", slopes, coefficients @ innovation.T)
        return np.asarray((L @ along).T)


class KernelGain(NamedTuple):
    """phi by the diffusion map of a Gaussian kernel exp(-|y - y'|^2/(4 eps)): phi = T phi + eps g, T the kernel's
    Markov matrix, and grad phi from T's own differences. A wide kernel gives the constant gain.

    bandwidth: eps, in the square of the particles' own standard deviation. Source: Taghvaei, Mehta and Meyn 2020,
    "Diffusion map-based algorithm for gain function approximation in the feedback particle filter".
    """

    bandwidth: float = 0.3

    @property
    def varies(self) -> bool:
        """It follows the density."""
        return True

    def steer(self, particles: FloatArray, g: FloatArray, innovation: FloatArray) -> FloatArray:
        """Return sum_j K_j innovation_j, shape (N, d)."""
        y, L = own_coordinates(particles)
        T, stationary = _markov(y, self.bandwidth)
        source = self.bandwidth * (g - stationary @ g)
        # a particle that none is near has no neighbours to tell its phi from: the small share keeps it solvable
        system = (1.0 + ISOLATED) * np.eye(y.shape[0]) - T + stationary[None, :]
        r = np.linalg.solve(system, source) + source
        around, pulled = T @ y, T @ r
        velocity = np.zeros_like(y)
        for j in range(g.shape[1]):
            slope = T @ (r[:, [j]] * y) - around * pulled[:, [j]]
            velocity += slope * innovation[:, [j]] / (2.0 * self.bandwidth)
        return np.asarray(velocity @ L.T)


GAINS: dict[str, Gain] = {"constant": ConstantGain(), "galerkin": GalerkinGain(), "kernel": KernelGain()}
"""Every gain by the name that the command line has for it."""


def _markov(y: FloatArray, bandwidth: float) -> tuple[FloatArray, FloatArray]:
    """Return the diffusion map's Markov matrix T, shape (N, N), and its stationary distribution, shape (N,)."""
    squares = np.sum(y * y, axis=1)
    distance = np.maximum(squares[:, None] + squares[None, :] - 2.0 * (y @ y.T), 0.0)
    kernel = np.exp(-distance / (4.0 * bandwidth))
    weight = 1.0 / np.sqrt(kernel.sum(axis=1))
    kernel *= weight[:, None] * weight[None, :]
    mass = kernel.sum(axis=1)
    return kernel / mass[:, None], np.asarray(mass / mass.sum())


def own_coordinates(particles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the particles with zero mean and unit covariance, shape (N, d), and L with x = mean + L y."""
    around = particles - particles.mean(axis=0)
    covariance = np.atleast_2d(around.T @ around) / (particles.shape[0] - 1)
    size = np.sqrt(np.diag(covariance)) + 1.0e-300
    # scaled first: standard deviations may be orders of magnitude apart, and some particles may lie on a plane
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    root = np.sqrt(np.maximum(values, 1.0e-12 * values[-1]))
    return (around / size) @ (vectors / root), np.asarray(size[:, None] * vectors * root)


class _Growth(NamedTuple):
    """How the monomials of one total degree come from those of the degree below: by which of them, shape (k,), is
    multiplied with which coordinate, shape (k,)."""

    parent: NDArray[np.intp]
    by: NDArray[np.intp]


@lru_cache
def _growths(d: int, degree: int, mixed: int) -> tuple[_Growth, ...]:
    """Return the growths up to `degree` from 1, of monomials with at most `mixed` different coordinates."""
    below: list[tuple[int, ...]] = [()]
    growths = []
    for total in range(1, degree + 1):
        terms = [t for t in combinations_with_replacement(range(d), total) if len(set(t)) <= mixed]
        places = {term: place for place, term in enumerate(below)}
        parents = np.array([places[term[:-1]] for term in terms], dtype=np.intp)
        growths.append(_Growth(parents, np.array([term[-1] for term in terms], dtype=np.intp)))
        below = terms
    return tuple(growths)


def _polynomials(y: FloatArray, growths: tuple[_Growth, ...]) -> tuple[FloatArray, FloatArray]:
    """Return the monomials at the particles, shape (k, N), and their gradients, shape (d, k, N)."""
    across = np.ascontiguousarray(y.T)
    d, N = across.shape
    value, slope = np.ones((1, N)), np.zeros((d, 1, N))
    values, slopes = [], []
    for parent, by in growths:
        factor, before = across[by], value[parent]
        slope = slope[:, parent] * factor
        slope[by, np.arange(by.size)] += before
        value = before * factor
        values.append(value)
        slopes.append(slope)
    return np.concatenate(values), np.concatenate(slopes, axis=1)


LARGEST_STEP = 0.4
"""A step of lambda is at most this over trace(P_zz R^-1), and the gain is found anew for each."""

MOST_STEPS = 200
"""So many steps are never needed by a sensible prior; the last one then goes to the end."""

LARGEST_MOVE = 0.25
"""Where the gain varies, it is found anew after moves of this many standard deviations, root mean square."""


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
    particles: FloatArray, observe: Observe, measured: FloatArray, R: FloatArray, gain: Gain | None = None
) -> FloatArray:
    """Return the particles, shape (N, d), after the measurement z, shape (m,), of covariance R, shape (m, m).

    gain: ConstantGain() by default. Values of z that are not finite do not count.
    """
    gain = gain or ConstantGain()
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
        move = _velocity(particles, h, z, gain, step)
        if gain.varies:
            step, move = _held_back(particles, move, step)
        if not taken:
            lost = _chance_shrinkage(h)
        taken += 1
        step = 1.0 - done if taken == MOST_STEPS else step
        particles = particles + step * move
        done = 1.0 if step >= 1.0 - done else done + step
    return np.asarray(particles + lost * (particles - particles.mean(axis=0)))


def _held_back(particles: FloatArray, velocity: FloatArray, step: float) -> tuple[float, FloatArray]:
    """Return a step in which the particles move `LARGEST_MOVE` standard deviations rms at most, and velocities of
    which none goes beyond twice that: where there are few particles their gain is mostly chance."""
    speed = np.sqrt(np.mean((velocity / (particles.std(axis=0) + 1.0e-300)) ** 2, axis=1))
    step = min(step, LARGEST_MOVE / max(float(np.sqrt(np.mean(speed**2))), 1.0e-300))
    allowed = 2.0 * LARGEST_MOVE / step
    return step, velocity * np.minimum(1.0, allowed / np.maximum(speed, 1.0e-300))[:, None]


def _velocity(particles: FloatArray, h: FloatArray, z: FloatArray, gain: Gain, step: float) -> FloatArray:
    """Return dx/dlambda, shape (N, d), so that a step of size `step` is exact for a linear h and constant gain."""
    spread = h - h.mean(axis=0)
    pull, shrink = damping_matrices(spread.T @ spread / (h.shape[0] - 1), step)
    innovation = (z - h.mean(axis=0)) @ pull.T - spread @ shrink.T
    return gain.steer(particles, spread, innovation)


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
    case: Case, steps: Steps, count: int, random: np.random.Generator, gain: Gain | None = None
) -> Found:
    """Return the feedback particle filter's estimates with `count` particles; gain: constant by default."""
    particles, history = fpf_start(case.prior, count, random), _History(case)
    for dt, inputs, z in zip(steps.dt, steps.inputs, steps.measured, strict=True):
        particles = fpf_predict(particles, case.motion, inputs, float(dt), random)
        particles = fpf_update(particles, case.observe, z, case.R, gain)
        history.add(particles.mean(axis=0), particles.var(axis=0, ddof=1))
    return history.found(fpf_belief(particles).covariance)
