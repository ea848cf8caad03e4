"""How large residuals are, how long they remember, and what that makes of the standard errors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.identification.runs import FloatArray

LONGEST_MEMORY = 0.9999
"""Lag-one correlations are held below this: at one, the weight would vanish altogether."""

SMALLEST_NOISE = 1.0e-9
"""Residuals [rad/s, rad] of an exact record are taken to be this large, so that no weight is infinite."""


class Noise(NamedTuple):
    """Residuals of one instrument: root mean square [rad/s or rad] and lag-one correlation; nan where absent."""

    size: float
    correlation: float

    @property
    def weight(self) -> float:
        """1/s with s^2 = size^2 (1 + correlation)/(1 - correlation); 0 where the instrument is absent."""
        if not self.size > 0.0:
            return 0.0
        return float(np.sqrt((1.0 - self.correlation) / (1.0 + self.correlation)) / self.size)


def residual_noise(residuals: Sequence[FloatArray]) -> Noise:
    """Return the Noise of one instrument from its residuals, one array per segment, nan where not measured."""
    known = np.concatenate([values[np.isfinite(values)] for values in residuals])
    if known.size == 0:
        return Noise(float("nan"), float("nan"))
    size = max(float(np.sqrt(np.mean(known**2))), SMALLEST_NOISE)
    pairs = [values[:-1] * values[1:] for values in residuals]
    neighbours = np.concatenate([products[np.isfinite(products)] for products in pairs])
    correlation = float(np.mean(neighbours)) / size**2 if neighbours.size else 0.0
    return Noise(size, min(max(correlation, 0.0), LONGEST_MEMORY))


def instrument_noise(values: FloatArray) -> float:
    """Return the white noise [unit of `values`] of a smooth signal, from its second differences.

    Second differences of white noise of standard deviation s have standard deviation sqrt(6) s, and those of a
    well-sampled motion are small; a motion sampled too coarsely makes the answer too large, never too small.
    """
    known = values[np.isfinite(values)]
    if known.size < 3:
        return float("inf")
    return max(float(np.sqrt(np.mean(np.diff(known, 2) ** 2) / 6.0)), SMALLEST_NOISE)


def robust_covariance(jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray]) -> FloatArray:
    """Return the covariance, shape (F, F), of a least-squares estimate whose residuals are correlated.

    jacobians: per segment, weighted, shape (N, 2, F); residuals: the same, shape (N, 2). The sandwich
    A^-1 B A^-1 with A = J'J and B the long-run covariance of the scores J' e, by Newey and West (1987) with
    Bartlett weights and the bandwidth of Andrews (1991) for a first-order process, one segment after another.
    """
    F = jacobians[0].shape[2]
    A = np.zeros((F, F))
    B = np.zeros((F, F))
    scores = [np.einsum("ncf,nc->nf", J, e) for J, e in zip(jacobians, residuals, strict=True)]
    bandwidth = _bandwidth(scores)
    for J, score in zip(jacobians, scores, strict=True):
        flat = J.reshape(-1, F)
        A += flat.T @ flat
        B += _long_run(score, bandwidth)
    inverse = np.linalg.pinv(A, rcond=1.0e-14)
    return np.asarray(inverse @ B @ inverse)


def _bandwidth(scores: Sequence[FloatArray]) -> float:
    """Return Andrews' bandwidth [samples] for Bartlett weights: 1.1447 (alpha N)^(1/3), alpha from AR(1) fits."""
    now = np.concatenate([score[1:] for score in scores])
    before = np.concatenate([score[:-1] for score in scores])
    power = np.sum(before**2, axis=0)
    rho = np.sum(now * before, axis=0)[power > 0.0] / power[power > 0.0]
    rho = np.clip(rho, 0.0, 0.99)
    alpha = float(np.mean(4.0 * rho**2 / ((1.0 - rho) ** 2 * (1.0 + rho) ** 2))) if rho.size else 0.0
    return float(1.1447 * (alpha * now.shape[0]) ** (1.0 / 3.0))


def _long_run(score: FloatArray, bandwidth: float) -> FloatArray:
    """Return the Bartlett-weighted sum of a segment's score autocovariances, times its length: shape (F, F)."""
    N = score.shape[0]
    total = score.T @ score
    for lag in range(1, min(int(bandwidth), N - 1) + 1):
        lagged = score[lag:].T @ score[:-lag]
        total += (1.0 - lag / (bandwidth + 1.0)) * (lagged + lagged.T)
    return np.asarray(total)
