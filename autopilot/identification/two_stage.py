"""The two stages of Jiang et al. 2016: K and T from a zigzag by recursive least squares, then n3 from steady turns.

A reproduction and a starting point. Where the rudder moves between samples, stage one is biased, and leaving
n3 out of it lowers K: the estimate that ships comes from `output_error`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.filters.kalman import RlsState, rls_start, rls_step
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.models.norrbin import SPEED_FLOOR_RATIO


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
    return nomoto_at_end(nomoto_path(runs, reference_speed, forgetting)[1])


def nomoto_at_end(values: FloatArray) -> Nomoto | None:
    """Return what the K and T of `nomoto_path` end with, as `nomoto_stage` does."""
    gain, time_constant = values[-1].tolist() if len(values) else (0.0, 0.0)
    return Nomoto(gain, time_constant, len(values)) if gain > 0.0 and time_constant > 0.0 else None


def nomoto_path(runs: Sequence[Run], reference_speed: float, forgetting: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Return how the recursion of `nomoto_stage` comes to its end: time [s] since the beginning of the first run, one
    run right after the other, shape (n,), and K [1/s] and T [s] after each equation, shape (n, 2)."""
    state: RlsState = rls_start([0.0, 0.0])
    times, path, begun = [], [], 0.0
    for run in runs:
        for segment in run.segments:
            time, phi, y = _equations(segment, reference_speed)
            for row, value in zip(phi.tolist(), y.tolist(), strict=True):
                state = rls_step(state, row, value, forgetting)
                path.append(state.theta)
            times.append(begun + time)
            begun += float(segment.time[-1] - segment.time[0])
    return np.concatenate(times), np.array(path).reshape(-1, 2)


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
