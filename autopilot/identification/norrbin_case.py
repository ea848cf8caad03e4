"""Norrbin's model as a case for the recursive filters: heading, rate, and the parameters as states.

The state is (psi, r, ln K, ln T, n0/w, n3 w^2) with w a typical rate, so that every parameter is of order one and K and
T stay positive; n3 counts as 0 where a filter takes it below. Gusts and what the model leaves out enter as white
noise on r'. Its size comes from how a simulated boat strays: with a residual rate e of variance s^2 and correlation c
from sample to sample (as a covariance), c is the part that lasts, a process of memory T driven by white noise
q^2 = 2 c/T, and s^2 - c, or the second differences of the record, whichever is less, is the instrument's.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from autopilot.filters.kalman import Gaussian
from autopilot.identification.noise import instrument_noise
from autopilot.identification.prediction import simulate_run
from autopilot.identification.recursive import Case, Steps
from autopilot.identification.residuals import initial_state, typical_rate
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin, at_speed_ratio, yaw_acceleration

NAMES = ("gain", "time_constant", "n0", "n3")
"""The parameters in the order of the state; without n3 for the linear model."""

STEPS_PER_TIME_CONSTANT = 6.0
LOG_DEVIATION = 0.7
"""Prior standard deviation of ln K and ln T: a factor of two either way."""

N0_DEVIATION = 0.5
N3_DEVIATION = 1.0
START_N3 = 0.3
"""Prior of n0 and n3 in units of the typical rate w: n0/w and n3 w^2."""

LEAST_PROCESS = 1.0e-3
LEAST_RATE_NOISE = 1.0e-2
"""Process and instrument noise are never below these shares of the typical rate: sampling alone costs as much."""

LEAST_HEADING_NOISE_RAD = 1.7e-3
"""Heading and rate of no two instruments agree better than this: a lag of 10 ms is more. A filter that trusts both to
the last digit explains their difference by the parameters."""


class YawDrive(NamedTuple):
    """What drives the yaw over a step: rudder [rad], speed over the reference speed, n1, and the typical rate w
    [rad/s]."""

    rudder: float
    ratio: float
    n1: float
    unit: float


class RunNoise(NamedTuple):
    """process [rad/s/sqrt(s)]: root of the intensity on the rate. rate [rad/s], heading [rad]: the instruments'."""

    process: float
    rate: float
    heading: float


def cubic_rates(state: Any, drive: YawDrive) -> tuple[Any, ...]:
    """Return the rates of (psi, r, ln K, ln T, n0/w, n3 w^2): psi' = r, r' by Norrbin's equation."""
    n3 = np.maximum(state[5], 0.0) / (drive.unit * drive.unit)
    model = Norrbin(np.exp(state[2]), np.exp(state[3]), n3, 0.0, drive.n1, state[4] * drive.unit, 1.0)
    return state[1], yaw_acceleration(at_speed_ratio(model, drive.ratio), state[1], drive.rudder), 0.0, 0.0, 0.0, 0.0


def linear_rates(state: Any, drive: YawDrive) -> tuple[Any, ...]:
    """Return the rates of (psi, r, ln K, ln T, n0/w): the same with n3 = 0."""
    model = Norrbin(np.exp(state[2]), np.exp(state[3]), 0.0, 0.0, drive.n1, state[4] * drive.unit, 1.0)
    return state[1], yaw_acceleration(at_speed_ratio(model, drive.ratio), state[1], drive.rudder), 0.0, 0.0, 0.0


def heading_and_rate(state: Any) -> tuple[Any, ...]:
    """Return what is measured."""
    return state[0], state[1]


def yaw_case(start: Norrbin, unit: float, noise: RunNoise, cubic: bool) -> Case:
    """Return the case of a boat believed to be near `start`, at its reference speed; unit: the typical rate w."""
    d = 6 if cubic else 5
    mean = np.zeros(d)
    mean[2:5] = np.log(start.gain), np.log(start.time_constant), start.n0 / unit
    deviation = [0.0, 0.0, LOG_DEVIATION, LOG_DEVIATION, N0_DEVIATION]
    if cubic:
        mean[5] = start.n3 * unit**2 if start.n3 > 0.0 else START_N3
        deviation.append(max(N3_DEVIATION, mean[5]))
    root = np.zeros((d, 1))
    root[1, 0] = noise.process
    R = np.diag([noise.heading**2, noise.rate**2])
    prior = Gaussian(mean, np.diag(np.square(deviation)))
    return Case(NAMES[: d - 2], cubic_rates if cubic else linear_rates, heading_and_rate, root, R, prior)


def entered(case: Case, segment: Segment, noise: RunNoise) -> Case:
    """Return the case at the begin of a segment: heading and rate as first measured, parameters as believed."""
    rate, heading = initial_state(segment)
    mean, covariance = case.prior.mean.copy(), case.prior.covariance.copy()
    mean[:2] = heading, rate
    covariance[:2] = covariance[:, :2] = 0.0
    spread = np.nanstd(segment.rate) if np.isfinite(segment.rate).any() else abs(rate)
    covariance[0, 0], covariance[1, 1] = noise.heading**2, noise.rate**2 + (0.1 * spread) ** 2
    return case._replace(prior=Gaussian(mean, covariance))


def segment_steps(segment: Segment, start: Norrbin, unit: float) -> tuple[Steps, FloatArray]:
    """Return the steps of a segment and, of each, whether it ends at a sample, shape (n,).

    Sample spacings longer than a sixth of T are divided; rudder and speed move linearly between samples.
    """
    spacing = np.diff(segment.time)
    pieces = np.maximum(np.ceil(spacing * STEPS_PER_TIME_CONSTANT / start.time_constant - 1.0e-9), 1.0).astype(int)
    dt = np.repeat(spacing / pieces, pieces)
    ends = np.cumsum(pieces)
    middle = segment.time[0] + np.cumsum(dt) - 0.5 * dt
    rudder = np.interp(middle, segment.time, segment.rudder)
    ratio = np.maximum(
        np.abs(np.interp(middle, segment.time, segment.speed)) / start.reference_speed, SPEED_FLOOR_RATIO
    )
    measured = np.full((dt.size, 2), np.nan)
    measured[ends - 1, 0], measured[ends - 1, 1] = segment.heading[1:], segment.rate[1:]
    drives = [YawDrive(float(d), float(u), start.n1, unit) for d, u in zip(rudder, ratio, strict=True)]
    is_sample = np.zeros(dt.size, dtype=bool)
    is_sample[ends - 1] = True
    return Steps(dt, drives, measured), is_sample


def run_noise(model: Norrbin, runs: Sequence[Run]) -> RunNoise:
    """Return the noise with which `model` explains the runs."""
    segments = [segment for run in runs for segment in run.segments]
    unit = typical_rate(segments)
    pairs = [
        _rate_errors(segment, simulated)
        for run in runs
        for segment, simulated in zip(run.segments, simulate_run(model, run), strict=True)
    ]
    now, later = (np.concatenate([pair[i] for pair in pairs]) for i in (0, 1))
    variance, last = (float(np.mean(now**2)), max(float(np.mean(now * later)), 0.0)) if now.size else (unit**2, unit**2)
    rates = [instrument_noise(segment.rate) for segment in segments]
    headings = [instrument_noise(segment.heading) for segment in segments]
    rate = min(_typical(rates), max(variance - last, 0.0) ** 0.5)
    memory = float(np.sqrt(2.0 / model.time_constant))
    return RunNoise(
        process=max(last**0.5, LEAST_PROCESS * unit) * memory,
        rate=max(rate, LEAST_RATE_NOISE * unit),
        heading=max(_typical(headings), LEAST_HEADING_NOISE_RAD),
    )


def _typical(noises: Sequence[float]) -> float:
    known = [noise for noise in noises if np.isfinite(noise)]
    return float(np.sqrt(np.mean(np.square(known)))) if known else 1.0


def _rate_errors(segment: Segment, simulated: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return residuals of the rate and those a little later, from headings where no rate is measured."""
    error, lag = segment.rate - simulated[:, 0], 1
    if not np.isfinite(error).any():
        # differences of headings share a heading with their neighbours, so only the next but one tells
        error, lag = np.diff(segment.heading - simulated[:, 1]) / np.diff(segment.time), 2
    now, later = error[:-lag], error[lag:]
    known = np.isfinite(now) & np.isfinite(later)
    return now[known], later[known]


def model_of(values: FloatArray, start: Norrbin, unit: float) -> Norrbin:
    """Return the model that the parameters (ln K, ln T, n0/w[, n3 w^2]) stand for."""
    n3 = max(float(values[3]), 0.0) / unit**2 if values.size > 3 else 0.0
    return start._replace(
        gain=float(np.exp(values[0])), time_constant=float(np.exp(values[1])), n0=float(values[2]) * unit, n3=n3
    )
