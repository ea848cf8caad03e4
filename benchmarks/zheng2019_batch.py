"""The batch fit of Zheng's trials.

For fixed parameters a Kalman filter follows the state alone; its innovations e_k with covariances S_k are white where
the parameters are right. Minimised is

    sum e_k' S_k^-1 e_k + (theta - theta_0)' P_0^-1 (theta - theta_0)

by Gauss and Newton with the damping of Levenberg and Marquardt. Where there is no process noise this is the
output-error fit. Source: Ljung 1999, chapter 7. The logarithm of det S_k, which hardly moves with the parameters, is
left out.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from autopilot.filters.kalman import FloatArray, midpoint_step, observed
from autopilot.identification.augmented_state import Case, Steps

UNIDENTIFIED = 0.8
"""A parameter of which more than this share of the prior standard deviation is left has not been identified."""


SLOPE_SHARE = 1.0e-4
"""Part of a parameter's prior deviation over which the innovations' slope is taken."""

STATE_STEP = 1.0e-6
"""The same for the state, of the deviation that the filter's own covariance gives."""


class BatchFit(NamedTuple):
    """Parameters by the fit, shape (p,), and their covariance from the slopes of the innovations, shape (p, p).

    misfit: mean square of the whitened innovations; 1 where the noise is what the case says it is.
    """

    names: tuple[str, ...]
    estimate: FloatArray
    covariance: FloatArray
    misfit: float


def by_prediction_errors(case: Case, steps: Steps, start: FloatArray | None = None) -> BatchFit:
    """Return the parameters that minimise the whitened prediction errors of the whole record, prior included.

    start: where the search begins, shape (p,); by default at the prior's mean.
    """
    first = case.states
    theta = case.prior.mean[first:]
    scale = case.prior_deviation
    root = np.linalg.inv(np.linalg.cholesky(case.prior.covariance[first:, first:]))

    nudge = SLOPE_SHARE * np.vstack([np.zeros(theta.size), np.eye(theta.size), -np.eye(theta.size)])
    known: dict[bytes, FloatArray] = {}

    def errors(z: FloatArray) -> FloatArray:
        """Innovations at z and beside it, all in one pass over the record."""
        if z.tobytes() not in known:
            known.clear()
            known[z.tobytes()] = _innovations(case, steps, theta + scale * (z + nudge))
        return known[z.tobytes()]

    def residual(z: FloatArray) -> FloatArray:
        return np.concatenate([errors(z)[0], root @ (scale * z)])

    def slope(z: FloatArray) -> FloatArray:
        up, down = errors(z)[1 : 1 + z.size], errors(z)[1 + z.size :]
        return np.vstack([(up - down).T / (2.0 * SLOPE_SHARE), root * scale])

    begin = np.zeros(theta.size) if start is None else (start - theta) / scale
    found = least_squares(residual, begin, jac=slope, method="lm", xtol=1.0e-5, ftol=1.0e-7)
    J = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.inv(J.T @ J) * np.outer(scale, scale)
    innovations = np.asarray(found.fun)[: -theta.size]
    misfit = float(innovations @ innovations) / max(int(np.isfinite(steps.measured).sum()), 1)
    return BatchFit(case.names, theta + scale * np.asarray(found.x), np.asarray(covariance), misfit)


def _innovations(case: Case, steps: Steps, thetas: FloatArray) -> FloatArray:
    """Return the whitened innovations of B Kalman filters, each with parameters of its own, shape (B, p): (B, n m)."""
    B, first = thetas.shape[0], case.states
    mean = np.hstack([np.tile(case.prior.mean[:first], (B, 1)), thetas])
    P = np.tile(case.prior.covariance[:first, :first], (B, 1, 1))
    errors = np.zeros((B, *steps.measured.shape))
    for k, (dt, inputs, z) in enumerate(zip(steps.dt, steps.inputs, steps.measured, strict=True)):
        mean, P = _predicted(case, mean, P, inputs, float(dt))
        there = np.isfinite(z)
        if there.any():
            mean, P, errors[:, k, there] = _corrected(case, mean, P, z, there)
    return errors.reshape(B, -1)


def _predicted(case: Case, mean: FloatArray, P: FloatArray, inputs: object, dt: float) -> tuple[FloatArray, FloatArray]:
    B, first, q = mean.shape[0], case.states, case.noise.shape[1]
    points, nudge = _around(mean, P)
    states = np.concatenate([points, np.repeat(mean[:, None], 2 * q, axis=1)], axis=1)
    kicks = np.zeros_like(states)
    kicks[:, 1 + 2 * first :] = np.concatenate([case.noise.T, -case.noise.T]) * np.sqrt(dt)
    d = mean.shape[1]
    moved = midpoint_step(case.drift, inputs, states.reshape(-1, d), dt, kicks.reshape(-1, d), case.substeps).reshape(
        B, -1, d
    )[:, :, :first]
    slope = (moved[:, 1 : 1 + first] - moved[:, 1 + first : 1 + 2 * first]) / (2.0 * nudge[:, :, None])
    root = 0.5 * (moved[:, 1 + 2 * first : 1 + 2 * first + q] - moved[:, 1 + 2 * first + q :])
    # slope and root hold their columns as rows here
    P = slope.transpose(0, 2, 1) @ P @ slope + root.transpose(0, 2, 1) @ root
    return np.hstack([moved[:, 0], mean[:, first:]]), P


def _corrected(
    case: Case, mean: FloatArray, P: FloatArray, z: FloatArray, there: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean and covariance after a measurement, and its whitened innovations."""
    B, first = mean.shape[0], case.states
    points, nudge = _around(mean, P)
    shown = observed(case.observe, points.reshape(-1, mean.shape[1])).reshape(B, -1, z.size)[:, :, there]
    H = ((shown[:, 1 : 1 + first] - shown[:, 1 + first :]) / (2.0 * nudge[:, :, None])).transpose(0, 2, 1)
    PH = P @ H.transpose(0, 2, 1)
    S = H @ PH + case.R[np.ix_(there, there)]
    innovation = z[there] - shown[:, 0]
    gain = np.linalg.solve(S, PH.transpose(0, 2, 1)).transpose(0, 2, 1)
    moved = mean.copy()
    moved[:, :first] += (gain @ innovation[:, :, None])[:, :, 0]
    P = P - gain @ S @ gain.transpose(0, 2, 1)
    whitened = np.linalg.solve(np.linalg.cholesky(S), innovation[:, :, None])[:, :, 0]
    return moved, 0.5 * (P + P.transpose(0, 2, 1)), whitened


def _around(mean: FloatArray, P: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the means and, beside them, each component of the state nudged up and down: (B, 1 + 2 s, d), (B, s)."""
    first = P.shape[1]
    nudge = STATE_STEP + 1.0e-3 * np.sqrt(np.maximum(np.diagonal(P, axis1=1, axis2=2), 0.0))
    points = np.repeat(mean[:, None], 1 + 2 * first, axis=1)
    for i in range(first):
        points[:, 1 + i, i] += nudge[:, i]
        points[:, 1 + first + i, i] -= nudge[:, i]
    return points, nudge
