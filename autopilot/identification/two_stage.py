"""The two stages of Jiang et al. 2016: K and T from a zigzag by recursive least squares, then n3 from steady turns.

A reproduction and a starting point. Where the rudder moves between samples, stage one is biased, and leaving
n3 out of it lowers K: the estimate that ships comes from `output_error`.

Recursive least squares with forgetting, in plain Python numbers: a step of two or three parameters takes a few
microseconds, where numpy's calls would cost more than the arithmetic.

    g = P phi / (lambda + phi' P phi),   theta += g (y - phi' theta),   P = (P - g phi' P) / lambda

Source: Jiang et al. 2016, eq. (4), where lambda = 1.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from operator import mul
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.models.norrbin import SPEED_FLOOR_RATIO

START_VARIANCE = 1.0e6
"""Of a guess that nobody believes, in units of the noise's variance."""


class RlsState(NamedTuple):
    """theta: estimate, n numbers. P: its covariance in units of the noise variance, n rows of n numbers."""

    theta: tuple[float, ...]
    P: tuple[tuple[float, ...], ...]


def rls_start(theta: Sequence[float], variance: float | Sequence[float] = START_VARIANCE) -> RlsState:
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


class Nomoto(NamedTuple):
    """Stage one: gain K [1/s] and time_constant T [s] at the reference speed, from `samples` equations."""

    gain: float
    time_constant: float
    samples: int


class CubicDamping(NamedTuple):
    """Stage two: n3 [s^2/rad^2] with its standard error, None where there is a single turn."""

    n3: float
    standard_error: float | None


def nomoto_stage(runs: Sequence[Run], reference_speed: float, forgetting: float = 1.0) -> Nomoto | None:
    """Return K and T of T r' + r = K delta by recursive least squares (Jiang 2016 eq. 4).

    Each pair of neighbouring samples gives one equation, integrated over their interval h by the trapezoidal
    rule and scaled to `reference_speed` [m/s] with the speed ratio s:

        mean(r) = K mean(s delta) - T (change of r)/(s h)

    Without a measured yaw rate it is differenced from the heading. None where the result is no boat that
    settles on a turn (K and T not both positive).
    """
    if forgetting < 1.0:
        return nomoto_at_end(nomoto_path(runs, reference_speed, forgetting)[1])
    # where nothing is forgotten the recursion ends at the least squares of all equations and the guess it began with
    information, pull, count = np.diag([1.0 / START_VARIANCE] * 2), np.zeros(2), 0
    for segment in (segment for run in runs for segment in run.segments):
        _, phi, y = _equations(segment, reference_speed)
        information, pull, count = information + phi.T @ phi, pull + phi.T @ y, count + y.size
    gain, time_constant = np.linalg.solve(information, pull).tolist()
    return Nomoto(gain, time_constant, count) if gain > 0.0 and time_constant > 0.0 else None


def nomoto_at_end(values: FloatArray) -> Nomoto | None:
    """Return what the K and T of `nomoto_path` end with, as `nomoto_stage` does."""
    gain, time_constant = values[-1].tolist() if len(values) else (0.0, 0.0)
    return Nomoto(gain, time_constant, len(values)) if gain > 0.0 and time_constant > 0.0 else None


def nomoto_path(runs: Sequence[Run], reference_speed: float, forgetting: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return how the recursion of `nomoto_stage` comes to its end: time [s] since the beginning of the first run, one
    run right after the other, shape (n,), and K [1/s] and T [s] after each equation, shape (n, 2)."""
    state: RlsState = rls_start([0.0, 0.0])
    times, path, begun = [], array("d"), 0.0
    for run in runs:
        for segment in run.segments:
            time, phi, y = _equations(segment, reference_speed)
            for row, value in zip(map(np.ndarray.tolist, phi), map(float, y), strict=True):
                state = rls_step(state, row, value, forgetting)
                path.extend(state.theta)
            times.append(begun + time)
            begun += float(segment.time[-1] - segment.time[0])
    return np.concatenate(times), np.asarray(path).reshape(-1, 2)


def _equations(segment: Segment, reference_speed: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return when each equation ends, shape (n,), [s] since the segment's beginning, its regressors, shape (n, 2), and
    its right-hand side, shape (n,)."""
    rate = segment.rate
    if not np.isfinite(rate).any():
        rate = np.gradient(segment.heading, segment.time)
    ratio = np.maximum(np.abs(segment.speed) / reference_speed, SPEED_FLOOR_RATIO)
    drive = _means(ratio * segment.rudder)
    slope = np.diff(rate) / (_means(ratio) * np.diff(segment.time))
    y = _means(rate)
    known = np.isfinite(y) & np.isfinite(slope)
    ends = (segment.time[1:] - segment.time[0])[known]
    return ends, np.stack([drive[known], -slope[known]], axis=1), y[known]


def _means(values: FloatArray) -> FloatArray:
    return 0.5 * (values[1:] + values[:-1])


def cubic_damping_stage(rudder: FloatArray, rate: FloatArray, gain: float) -> CubicDamping:
    """Return n3 of n3 r^3 = K delta - r by least squares over steady turns (Jiang 2016 eq. 5), K held.

    rudder [rad] and rate [rad/s] have one length; gain K [1/s]. Raises InputError where no turn has a rate.
    """
    known = np.isfinite(rudder) & np.isfinite(rate) & (rate != 0.0)
    cubes, left = rate[known] ** 3, gain * rudder[known] - rate[known]
    if cubes.size == 0:
        raise InputError("steady turns: no row has both a rudder angle and a yaw rate other than zero.")
    power = float(cubes @ cubes)
    n3 = float(cubes @ left) / power
    if cubes.size < 2:
        return CubicDamping(n3, None)
    variance = float(np.sum((left - n3 * cubes) ** 2)) / (cubes.size - 1)
    return CubicDamping(n3, float(np.sqrt(variance / power)))
