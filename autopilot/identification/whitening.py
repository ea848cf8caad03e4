"""Prediction-error weighting: residuals of a simulation through the Kalman filter that makes them white.

Gusts push the boat, and what they push it off course it keeps for a while. The errors of a simulated boat are then a
process of their own, x' = -x/T + w in the rate and its integral in the heading, seen through the instruments' noise. A
steady Kalman filter of that process turns residuals e_k into innovations, what of e_k could not be foretold from those
before it:

    n_k = S^(-1/2) (e_k - H x_k),    x_k+1 = A x_k + A K (e_k - H x_k)

The filter is linear, so derivatives go through it likewise, and least squares of innovations is the prediction-error
method of Ljung 1999 (chapter 7) for Nomoto's model; for Norrbin's the noise is that of the straight course. Where there
are no gusts the gain K is next to nothing, and the fit that of the output error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import expm, solve_discrete_are
from scipy.signal import lfilter, ss2tf

from autopilot.identification.noise import instrument_noise
from autopilot.identification.runs import FloatArray, Segment

LEAST_SHARE = 1.0e-3
"""Gusts and noise are never taken to be below this share of the residuals."""


class Gusts(NamedTuple):
    """What makes residuals of rate and heading: process [rad/s/sqrt(s)], the root of the intensity that drives the
    rate; memory [s], how long the boat keeps it; rate [rad/s] and heading [rad], the instruments' noise, inf where
    nothing is measured."""

    process: float
    memory: float
    rate: float
    heading: float


def gusts_in(residuals: Sequence[FloatArray], segments: Sequence[Segment], memory: float) -> Gusts:
    """Return what explains `residuals`, per segment of shape (N, 2), rate and heading, of a boat of that memory [s].

    The part of the rate's residuals that is still there a sample later is the gusts', of variance q^2 memory/2; the
    rest, or the second differences of the record where they are less, is the instrument's.
    """
    pairs = [_neighbours(values, segment) for values, segment in zip(residuals, segments, strict=True)]
    now, later = (np.concatenate([pair[i] for pair in pairs]) for i in (0, 1))
    variance = max(float(np.mean(now**2)), 1.0e-18)
    lasting = min(max(float(np.mean(now * later)), LEAST_SHARE**2 * variance), variance)
    rate = _together([instrument_noise(segment.rate) for segment in segments])
    if np.isfinite(rate):
        rate = max(min(rate, (variance - lasting) ** 0.5), LEAST_SHARE * variance**0.5)
    heading = _together([instrument_noise(segment.heading) for segment in segments])
    return Gusts((2.0 * lasting / memory) ** 0.5, memory, rate, heading)


def innovations(table: FloatArray, spacing: float, gusts: Gusts) -> FloatArray:
    """Return the columns of `table`, shape (N, 2, C), rate and heading every `spacing` [s], through the filter: what is
    new in each sample, in units of its standard deviation. A channel that is not measured gives 0."""
    measured = [i for i, size in enumerate((gusts.rate, gusts.heading)) if np.isfinite(size)]
    states = 2 if np.isfinite(gusts.heading) else 1  # an angle that nobody sees counts for nothing
    H = np.eye(2)[measured, :states]
    A, Q = (matrix[:states, :states] for matrix in _process(gusts, spacing))
    R = np.diag(np.square([(gusts.rate, gusts.heading)[i] for i in measured]))
    P = solve_discrete_are(A.T, H.T, Q, R)
    S = H @ P @ H.T + R
    gain = A @ np.linalg.solve(S, H @ P).T
    whiten = np.linalg.inv(np.linalg.cholesky(S))
    result = np.zeros_like(table)
    for column, source in enumerate(measured):
        numerators, denominator = ss2tf(A - gain @ H, gain, -whiten @ H, whiten, input=column)
        for row, target in enumerate(measured):
            result[:, target] += lfilter(numerators[row], denominator, table[:, source], axis=0)
    return result


def bridged(table: FloatArray) -> FloatArray:
    """Return `table`, shape (N, 2, C), the residual in its last column, with rows in which that is missing taken from
    their neighbours: residuals and derivatives alike, so that they remain each other's."""
    result = table.copy()
    for channel in range(2):
        there = np.flatnonzero(np.isfinite(table[:, channel, -1]))
        if not there.size:
            result[:, channel] = 0.0
        elif there.size < table.shape[0]:
            rows = np.arange(table.shape[0])
            for column in range(table.shape[2]):
                result[:, channel, column] = np.interp(rows, there, table[there, channel, column])
    return result


def _process(gusts: Gusts, spacing: float) -> tuple[FloatArray, FloatArray]:
    """Return transition and noise of (rate error, heading error) over a sample, after Van Loan 1978."""
    F = np.array([[-1.0 / gusts.memory, 0.0], [1.0, 0.0]])
    block = np.zeros((4, 4))
    block[:2, :2], block[:2, 2:], block[2:, 2:] = -F, np.diag([gusts.process**2, 0.0]), F.T
    exponential = expm(block * spacing)
    A = exponential[2:, 2:].T
    return A, A @ exponential[:2, 2:]


def _neighbours(residuals: FloatArray, segment: Segment) -> tuple[FloatArray, FloatArray]:
    """Return residuals of the rate and those a sample later; from headings, which share one, two samples later."""
    error, lag = residuals[:, 0], 1
    if not np.isfinite(error).any():
        error, lag = np.diff(residuals[:, 1]) / np.diff(segment.time), 2
    now, later = error[:-lag], error[lag:]
    known = np.isfinite(now) & np.isfinite(later)
    return now[known], later[known]


def _together(noises: Sequence[float]) -> float:
    known = [noise for noise in noises if np.isfinite(noise)]
    return float(np.sqrt(np.mean(np.square(known)))) if known else float("inf")
