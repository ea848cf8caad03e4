"""The feedback particle filter: particles that are steered by each measurement, never weighted or drawn anew.

Between measurements every particle follows the model with noise of its own. A sampled measurement z of covariance R
then moves the particles while lambda goes from 0 to 1 (in units where R = I):

    dx/dlambda = K(x) [z - (h(x) + h^)/2],   h^ the particles' mean of h

where the gain K_j = grad phi_j solves  div(p grad phi_j) = -(h_j - h^_j) p. Where K is constant and h linear the flow
has a closed form: each step of lambda damps the innovation by it, so that a step is exact for Gaussians and stable for
any size. Three gains (`autopilot.filters.particle_gains`): constant, the covariance of x and h, which makes the filter
an ensemble Kalman filter; Galerkin, in polynomials; kernel, from a diffusion map. The flow follows Bayes' rule exactly
where a measurement tells little at a time, as in continuous observation; a single strong measurement of a density far
from Gaussian is where its feedback form is approximate.

Source: Yang, Blom and Mehta 2014 (continuous-discrete FPF); Zheng et al. 2019, eqs (6)-(11), whose (7) prints Q for
its root and whose (8) and (11) need the continuous intensity R dt; Bergemann and Reich 2010 for the closed form.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from autopilot.filters.kalman import Gaussian
from autopilot.filters.midpoint import Drift, FloatArray, Observe, midpoint_step, observed
from autopilot.filters.particle_gains import ConstantGain, Gain

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
    particles: FloatArray,
    drift: Drift,
    inputs: Any,
    noise: FloatArray,
    dt: float,
    random: np.random.Generator,
    substeps: int = 1,
) -> FloatArray:
    """Return the particles, shape (N, d), `dt` [s] later, inputs held; noise as in `ekf_predict`, shape (d, q)."""
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
