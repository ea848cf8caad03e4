"""Recursive least squares with forgetting, in plain Python numbers: a step of two or three parameters takes a few
microseconds, where numpy's calls would cost more than the arithmetic.

    g = P phi / (lambda + phi' P phi),   theta += g (y - phi' theta),   P = (P - g phi' P) / lambda

Source: Jiang et al. 2016, eq. (4), where lambda = 1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from operator import mul
from typing import NamedTuple


class RlsState(NamedTuple):
    """theta: estimate, n numbers. P: its covariance in units of the noise variance, n rows of n numbers."""

    theta: tuple[float, ...]
    P: tuple[tuple[float, ...], ...]


def rls_start(theta: Sequence[float], variance: float | Sequence[float] = 1.0e6) -> RlsState:
    """Return the state before the first measurement: a guess `theta` with P = diag(`variance`), one for all or each.

    Raises ValueError where a variance is not positive and finite.
    """
    guess = tuple(float(value) for value in theta)
    spread = (variance,) * len(guess) if isinstance(variance, int | float) else tuple(variance)
    if len(spread) != len(guess) or not all(0.0 < value < math.inf for value in spread):
        raise ValueError(f"rls_start: each variance must be positive and finite, got {variance}")
    rows = range(len(guess))
    return RlsState(guess, tuple(tuple(float(spread[i]) if i == j else 0.0 for j in rows) for i in rows))


def rls_step(
    state: RlsState, phi: Sequence[float], y: float, forgetting: float = 1.0, trace_max: float = math.inf
) -> RlsState:
    """Return the state after the measurement y = phi' theta + noise; Jiang 2016 eq. (4).

    phi: regressor, n numbers. forgetting: lambda in (0, 1]; 1 never forgets, otherwise the memory is about
    1/(1 - lambda) measurements. Where P would grow beyond a trace of `trace_max`, for nothing new is learnt, nothing
    is forgotten either. Raises ValueError where lambda lies outside (0, 1]. A regressor or measurement that is not
    finite leaves the state as it is.
    """
    if not 0.0 < forgetting <= 1.0:
        raise ValueError(f"rls_step: the forgetting factor must lie in (0, 1], got {forgetting}")
    theta, P = state
    # P is symmetric, so its rows serve as its columns
    P_phi = _products(P, phi)
    power = forgetting + sum(map(mul, phi, P_phi))
    error = y - sum(map(mul, phi, theta))
    if not (math.isfinite(error) and math.isfinite(power)):
        return state
    pull, share = error / power, 1.0 / power
    estimate = tuple([value + p * pull for value, p in zip(theta, P_phi)])  # noqa: B905 - strict costs a microsecond
    grown = 1.0
    if forgetting < 1.0 and (trace_max == math.inf or sum([row[i] for i, row in enumerate(P)]) < trace_max):
        grown = 1.0 / forgetting
    # p * q is q * p to the last digit, so rounding cannot break the symmetry on which the gain's sign rests
    rows = [
        tuple([(value - p * q * share) * grown for value, q in zip(row, P_phi)])  # noqa: B905
        for row, p in zip(P, P_phi)  # noqa: B905
    ]
    return RlsState(estimate, tuple(rows))


def _products(rows: Sequence[Sequence[float]], phi: Sequence[float]) -> list[float]:
    """Return each row times `phi`. Written out for a few numbers: what is general costs twice as much."""
    if len(phi) == 2:
        p, q = phi
        return [a * p + b * q for a, b in rows]
    if len(phi) == 3:
        p, q, r = phi
        return [a * p + b * q + c * r for a, b, c in rows]
    if len(phi) == 4:
        p, q, r, s = phi
        return [a * p + b * q + c * r + d * s for a, b, c, d in rows]
    return [sum(map(mul, row, phi)) for row in rows]
