"""Recursive least squares with forgetting.

    g = P phi / (lambda + phi' P phi),   theta += g (y - phi' theta),   P = (P - g phi' P) / lambda

Source: Jiang et al. 2016, eq. (4), where lambda = 1.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray


class RlsState(NamedTuple):
    """theta: estimate, shape (n,). P: its covariance in units of the noise variance, shape (n, n)."""

    theta: NDArray[np.float64]
    P: NDArray[np.float64]


def rls_start(theta: ArrayLike, variance: float = 1.0e6) -> RlsState:
    """Return the state before the first measurement: a guess `theta`, shape (n,), with P = `variance` I.

    Raises ValueError where the variance is not positive and finite.
    """
    if not 0.0 < variance < np.inf:
        raise ValueError(f"rls_start: the variance must be positive and finite, got {variance}")
    guess = np.array(theta, dtype=np.float64).reshape(-1)
    return RlsState(guess, np.eye(guess.size) * variance)


def rls_step(state: RlsState, phi: ArrayLike, y: float, forgetting: float = 1.0) -> RlsState:
    """Return the state after the measurement y = phi' theta + noise; Jiang 2016 eq. (4).

    phi: regressor, shape (n,). forgetting: lambda in (0, 1]; 1 never forgets, otherwise the memory is about
    1/(1 - lambda) measurements. Raises ValueError where lambda lies outside (0, 1]. A regressor or
    measurement that is not finite leaves the state as it is.
    """
    if not 0.0 < forgetting <= 1.0:
        raise ValueError(f"rls_step: the forgetting factor must lie in (0, 1], got {forgetting}")
    regressor = np.asarray(phi, dtype=np.float64)
    if not (np.isfinite(y) and np.isfinite(regressor).all()):
        return state
    P_phi = state.P @ regressor
    gain = P_phi / (forgetting + regressor @ P_phi)
    theta = state.theta + gain * (y - regressor @ state.theta)
    P = (state.P - np.outer(gain, P_phi)) / forgetting
    # rounding would slowly break the symmetry on which the gain's sign rests
    return RlsState(theta, 0.5 * (P + P.T))
