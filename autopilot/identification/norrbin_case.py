"""Norrbin's model as a case for the recursive filters: heading, rate, and the parameters as states.

The state is (psi, r, ln K, ln T, n0/w, ln n3 w^2) with w a typical rate, so that every parameter is of order one and K,
T and n3 stay positive. Gusts and what the model leaves out enter as white
noise on r'. Its size comes from how a simulated boat strays: with a residual rate e of variance s^2 and correlation c
from sample to sample (as a covariance), c is the part that lasts, a process of memory T driven by white noise
q^2 = 2 c/T, and s^2 - c, or the second differences of the record, whichever is less, is the instrument's.

Samples closer together than an eighth of T are taken together, their means standing for the middle of their time: where
gusts count that costs next to no information, and a filter's errors of chance grow with the number of its updates.
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
SUBSTEPS = 2
"""Of the midpoint rule within each step: together exact to 0.2 % of T."""

UPDATES_PER_TIME_CONSTANT = 8.0
FEWEST_UPDATES = 100
"""A short segment is taken sample by sample rather than in fewer groups than this."""

LOG_DEVIATION = 0.7
"""Prior standard deviation of ln K and ln T: a factor of two either way."""

N0_DEVIATION = 0.5
"""The same of n0/w."""

START_N3 = 0.1
LOG_N3_DEVIATION = 1.5
"""Prior of n3 w^2, the share of the cubic damping at the typical rate: 0.1, a factor of four or five either way."""

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
    """Return the rates of (psi, r, ln K, ln T, n0/w, ln n3 w^2): psi' = r, r' by Norrbin's equation."""
    n3 = np.exp(state[5]) / (drive.unit * drive.unit)
    model = Norrbin(np.exp(state[2]), np.exp(state[3]), n3, 0.0, drive.n1, state[4] * drive.unit, 1.0)
    return state[1], yaw_acceleration(at_speed_ratio(model, drive.ratio), state[1], drive.rudder), 0.0, 0.0, 0.0, 0.0


def linear_rates(state: Any, drive: YawDrive) -> tuple[Any, ...]:
    """Return the rates of (psi, r, ln K, ln T, n0/w): the same with n3 = 0."""
    model = Norrbin(np.exp(state[2]), np.exp(state[3]), 0.0, 0.0, drive.n1, state[4] * drive.unit, 1.0)
    return state[1], yaw_acceleration(at_speed_ratio(model, drive.ratio), state[1], drive.rudder), 0.0, 0.0, 0.0


def heading_and_rate(state: Any) -> tuple[Any, ...]:
    """Return what is measured."""
    return state[0], state[1]


def yaw_case(start: Norrbin, unit: float, noise: RunNoise, cubic: bool, narrow: FloatArray | None = None) -> Case:
    """Return the case of a boat believed to be near `start`, at its reference speed; unit: the typical rate w. The
    state and the instruments' noise are those of a segment: `entered`. narrow: standard deviations, shape (p,), where
    the prior need not be wider."""
    d = 6 if cubic else 5
    mean = np.zeros(d)
    mean[2:5] = np.log(start.gain), np.log(start.time_constant), start.n0 / unit
    deviation = [0.0, 0.0, LOG_DEVIATION, LOG_DEVIATION, N0_DEVIATION]
    if cubic:
        mean[5] = np.log(start.n3 * unit**2 if start.n3 > 0.0 else START_N3)
        deviation.append(LOG_N3_DEVIATION)
    root = np.zeros((d, 1))
    root[1, 0] = noise.process
    spread = np.array(deviation)
    if narrow is not None:
        spread[2:] = np.minimum(spread[2:], narrow)
    prior = Gaussian(mean, np.diag(np.square(spread)))
    return Case(
        NAMES[: d - 2], cubic_rates if cubic else linear_rates, heading_and_rate, root, np.eye(2), prior, SUBSTEPS
    )


def together(segment: Segment, start: Norrbin) -> int:
    """Return how many samples of a segment are taken together, at least one."""
    spacing = float(np.median(np.diff(segment.time)))
    fewest = max(segment.time.size // FEWEST_UPDATES, 1)
    return min(max(int(start.time_constant / UPDATES_PER_TIME_CONSTANT / spacing), 1), fewest)


def entered(case: Case, segment: Segment, start: Norrbin, noise: RunNoise, unit: float) -> Case:
    """Return the case at the begin of a segment: heading and rate as first measured, parameters as believed."""
    rate, heading = initial_state(segment)
    share = together(segment, start) ** -0.5
    R = np.square(
        [max(share * noise.heading, LEAST_HEADING_NOISE_RAD), max(share * noise.rate, LEAST_RATE_NOISE * unit)]
    )
    mean, covariance = case.prior.mean.copy(), case.prior.covariance.copy()
    mean[:2] = heading, rate
    covariance[:2] = covariance[:, :2] = 0.0
    has_rate = bool(np.isfinite(segment.rate).any())
    covariance[0, 0] = noise.heading**2 + LEAST_HEADING_NOISE_RAD**2
    covariance[1, 1] = noise.rate**2 + ((0.1 if has_rate else 0.5) * unit) ** 2
    return case._replace(prior=Gaussian(mean, covariance), R=np.diag(R))


def segment_steps(segment: Segment, start: Norrbin, unit: float) -> tuple[Steps, FloatArray, FloatArray]:
    """Return the steps of a segment; which of them end with a measurement, shape (n,); and when those are.

    Rudder and speed are their means over each step, which is no longer than a sixth of T.
    """
    group = together(segment, start)
    count = segment.time.size // group
    ends, heading, rate = (_means(values, group, count) for values in (segment.time, segment.heading, segment.rate))
    begin = segment.time[0]
    known = ends > begin
    spacing = np.diff(np.concatenate([[begin], ends[known]]))
    pieces = np.maximum(np.ceil(spacing * STEPS_PER_TIME_CONSTANT / start.time_constant - 1.0e-9), 1.0).astype(int)
    dt = np.repeat(spacing / pieces, pieces)
    last = np.cumsum(pieces) - 1
    edges = begin + np.concatenate([[0.0], np.cumsum(dt)])
    rudder = _mean_between(edges, segment.time, segment.rudder)
    speed = _mean_between(edges, segment.time, np.abs(segment.speed))
    ratio = np.maximum(speed / start.reference_speed, SPEED_FLOOR_RATIO)
    measured = np.full((dt.size, 2), np.nan)
    measured[last, 0], measured[last, 1] = heading[known], rate[known]
    drives = [YawDrive(float(d), float(u), start.n1, unit) for d, u in zip(rudder, ratio, strict=True)]
    return Steps(dt, drives, measured), last, ends[known] - begin


def _means(values: FloatArray, group: int, count: int) -> FloatArray:
    """Return the means of `count` groups, nan where any of a group is missing: the others would stand for another
    time."""
    return np.asarray(values[: group * count].reshape(count, group).mean(axis=1))


def _mean_between(edges: FloatArray, time: FloatArray, values: FloatArray) -> FloatArray:
    """Return the means over each step of what moves linearly between samples."""
    inside = np.union1d(edges, time)
    moved = np.interp(inside, time, values)
    areas = 0.5 * (moved[1:] + moved[:-1]) * np.diff(inside)
    area = np.concatenate([np.zeros(1), np.cumsum(areas)])
    return np.asarray(np.diff(np.interp(edges, inside, area)) / np.diff(edges))


def run_noise(model: Norrbin, runs: Sequence[Run]) -> RunNoise:
    """Return the noise with which `model` explains the runs."""
    segments = [segment for run in runs for segment in run.segments]
    unit = typical_rate(segments)
    rates = [instrument_noise(segment.rate) for segment in segments]
    headings = [instrument_noise(segment.heading) for segment in segments]
    memory = float(np.sqrt(2.0 / model.time_constant))
    if model.n1 < 0.0:
        # left alone, a simulated boat that is course-unstable strays however good the model is
        process = max(_step_noise(model, segments), LEAST_PROCESS * unit * memory)
        return RunNoise(process, _typical(rates), _typical(headings))
    pairs = [
        _rate_errors(segment, simulated)
        for run in runs
        for segment, simulated in zip(run.segments, simulate_run(model, run), strict=True)
    ]
    now, later = (np.concatenate([pair[i] for pair in pairs]) for i in (0, 1))
    variance, last = (float(np.mean(now**2)), max(float(np.mean(now * later)), 0.0)) if now.size else (unit**2, unit**2)
    rate = min(_typical(rates), max(variance - last, 0.0) ** 0.5)
    return RunNoise(max(last**0.5, LEAST_PROCESS * unit) * memory, rate, _typical(headings))


def _step_noise(model: Norrbin, segments: Sequence[Segment]) -> float:
    """Return the process noise [rad/s/sqrt(s)] from how much the rate changes otherwise than the model says, a step at
    a time: e = dr - r' dt has the variance q^2 dt + 2 R and the covariance -R with its neighbour."""
    total, time = 0.0, 0.0
    for segment in segments:
        group = together(segment, model)
        columns = (segment.time, segment.rate, segment.heading, segment.rudder, segment.speed)
        t, r, heading, rudder, speed = (_means(values, group, segment.time.size // group) for values in columns)
        r = r if np.isfinite(r).any() else np.gradient(heading, t)
        ratio = np.maximum(np.abs(speed) / model.reference_speed, SPEED_FLOOR_RATIO)
        slope = yaw_acceleration(at_speed_ratio(model, _middle(ratio)), _middle(r), _middle(rudder))
        e = np.diff(r) - slope * np.diff(t)
        product = e[1:] * e[:-1]
        if np.isfinite(product).any():
            total += float(np.nanmean(e**2) + 2.0 * np.nanmean(product)) * e.size
            time += float(t[-1] - t[0])
    return float(np.sqrt(max(total, 0.0) / time)) if time else 0.0


def _middle(values: FloatArray) -> Any:
    """Return the means of neighbours."""
    return 0.5 * (values[1:] + values[:-1])


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
    """Return the model that the parameters (ln K, ln T, n0/w[, ln n3 w^2]) stand for."""
    n3 = float(np.exp(values[3])) / unit**2 if values.size > 3 else 0.0
    return start._replace(
        gain=float(np.exp(values[0])), time_constant=float(np.exp(values[1])), n0=float(values[2]) * unit, n3=n3
    )
