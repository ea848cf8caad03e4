"""Recursive estimators: the extended Kalman filter for continuous motion and sampled measurements, and least squares.

    x' = f(x, u) + w,  w white of intensity Q        z_k = h(x(t_k)) + v,  v of covariance R

Predict with the slope Phi of the step in x and its slope G in the noise; update in Joseph's form:

    x <- step(x),  P <- Phi P Phi' + G Q dt G'
    K = P H' S^-1,  S = H P H' + R,  x <- x + K (z - h(x)),  P <- (I - K H) P (I - K H)' + K R K'

Slopes are central differences over a small part of the belief's own spread, all in one call of the model: the model
is written once and never differentiated by hand. Source: Jazwinski 1970, sections 7.3 and 8.3; Joseph's form after
Bucy and Joseph 1968.

One step of a stochastic differential equation x' = f(x, u) + w for many states at once, by the midpoint rule.

The filters of this room share it, so that they solve the same discrete system and can be held against each other.

Recursive least squares with forgetting, in plain Python numbers: a step of two or three parameters takes a few
microseconds, where numpy's calls would cost more than the arithmetic.

    g = P phi / (lambda + phi' P phi),   theta += g (y - phi' theta),   P = (P - g phi' P) / lambda

Source: Jiang et al. 2016, eq. (4), where lambda = 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from operator import mul
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


SLOPE_SHARE = 1.0e-3
"""Part of a standard deviation over which slopes are taken."""

SMALLEST_STEP = 1.0e-9
"""Slopes are never taken over less than this share of one or of the value: rounding would falsify them."""


class Gaussian(NamedTuple):
    """A belief: mean, shape (d,), and covariance, shape (d, d)."""

    mean: FloatArray
    covariance: FloatArray


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
