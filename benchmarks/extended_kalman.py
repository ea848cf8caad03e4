"""The extended Kalman filter for continuous motion and sampled measurements, which other filters are held against.

    x' = f(x, u) + w,  w white of intensity Q        z_k = h(x(t_k)) + v,  v of covariance R

Predict with the slope Phi of the step in x and its slope G in the noise; update in Joseph's form:

    x <- step(x),  P <- Phi P Phi' + G Q dt G'
    K = P H' S^-1,  S = H P H' + R,  x <- x + K (z - h(x)),  P <- (I - K H) P (I - K H)' + K R K'

Slopes are central differences over a small part of the belief's own spread, all in one call of the model: the model
is written once and never differentiated by hand. Source: Jazwinski 1970, sections 7.3 and 8.3; Joseph's form after
Bucy and Joseph 1968.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from autopilot.identification.feedback_particle import (
    Case,
    FloatArray,
    Found,
    Gaussian,
    Motion,
    Observe,
    Steps,
    midpoint_step,
    observed,
)

SLOPE_SHARE = 1.0e-3
"""Part of a standard deviation over which slopes are taken."""

SMALLEST_STEP = 1.0e-9
"""Slopes are never taken over less than this share of one or of the value: rounding would falsify them."""


class Update(NamedTuple):
    """The belief after a measurement, the innovation z - h(x), shape (k,), and its covariance S, shape (k, k), for
    the k values of the measurement that were there."""

    belief: Gaussian
    innovation: FloatArray
    innovation_covariance: FloatArray


def ekf_predict(belief: Gaussian, motion: Motion, inputs: Any, dt: float) -> Gaussian:
    """Return the belief `dt` [s] later, inputs held."""
    mean, P = belief
    drift, noise, substeps = motion
    d, q = noise.shape
    spread = _steps(belief)
    kick = noise * np.sqrt(dt)
    states = np.tile(mean, (1 + 2 * d + 2 * q, 1))
    states[1 : 1 + d] += np.diag(spread)
    states[1 + d : 1 + 2 * d] -= np.diag(spread)
    kicks = np.zeros_like(states)
    kicks[1 + 2 * d : 1 + 2 * d + q] = kick.T
    kicks[1 + 2 * d + q :] = -kick.T
    moved = midpoint_step(drift, inputs, states, dt, kicks, substeps)
    slope = (moved[1 : 1 + d] - moved[1 + d : 1 + 2 * d]).T / (2.0 * spread)
    # the noise of one step is small, so the difference over one standard deviation of it is its slope
    root = 0.5 * (moved[1 + 2 * d : 1 + 2 * d + q] - moved[1 + 2 * d + q :]).T
    return Gaussian(moved[0], _symmetric(slope @ P @ slope.T + root @ root.T))


def ekf_update(belief: Gaussian, observe: Observe, measured: FloatArray, R: FloatArray) -> Update:
    """Return the belief after the measurement z, shape (m,), of covariance R, shape (m, m).

    Values of z that are not finite do not count; where none is, the belief stays as it is.
    """
    mean, P = belief
    d = mean.size
    there = np.isfinite(measured)
    spread = _steps(belief)
    points = np.vstack([mean, mean + np.diag(spread), mean - np.diag(spread)])
    shown = observed(observe, points)[:, there]
    H = (shown[1 : 1 + d] - shown[1 + d :]).T / (2.0 * spread)
    S = H @ P @ H.T + R[np.ix_(there, there)]
    innovation = measured[there] - shown[0]
    if not there.any():
        return Update(belief, innovation, S)
    gain = np.linalg.solve(S, H @ P).T
    rest = np.eye(d) - gain @ H
    joseph = rest @ P @ rest.T + gain @ R[np.ix_(there, there)] @ gain.T
    return Update(Gaussian(mean + gain @ innovation, _symmetric(joseph)), innovation, S)


def _steps(belief: Gaussian) -> FloatArray:
    deviation = np.sqrt(np.maximum(np.diag(belief.covariance), 0.0))
    return np.maximum(SLOPE_SHARE * deviation, SMALLEST_STEP * np.maximum(1.0, np.abs(belief.mean)))


def _symmetric(P: FloatArray) -> FloatArray:
    return np.asarray(0.5 * (P + P.T))


def prior_deviation(case: Case) -> FloatArray:
    """Return the standard deviations of the parameters before the record, shape (p,)."""
    return np.asarray(np.sqrt(np.diag(case.prior.covariance)[case.states :]))


def by_kalman_filter(case: Case, steps: Steps) -> Found:
    """Return the extended Kalman filter's estimates."""
    belief, first = case.prior, case.states
    means: list[FloatArray] = []
    variances: list[FloatArray] = []
    for dt, inputs, z in zip(steps.dt, steps.inputs, steps.measured, strict=True):
        belief = ekf_predict(belief, case.motion, inputs, float(dt))
        belief = ekf_update(belief, case.observe, z, case.R).belief
        means.append(belief.mean[first:])
        variances.append(np.diagonal(belief.covariance)[first:])
    deviation = np.sqrt(np.array(variances))
    return Found(case.names, np.array(means), deviation, belief.covariance[first:, first:])
