"""Norrbin's model as a case for the recursive filters: heading, rate, and the parameters as states.

The state is (psi, r, ln K, ln T, n0/w, n3 w^2) with w a typical rate, so that every parameter is of order one, and K
and T stay positive; n3 enters the equation as it is, for its logarithm would make a straight problem crooked. Gusts and
what the model leaves out enter as white noise on r' (`gust_strength`).

Samples closer together than a sixteenth of T are taken together, their means standing for the middle of their time:
that costs next to no information, and a filter's errors of chance grow with the number of its updates.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from autopilot.filters.kalman import Gaussian
from autopilot.identification.augmented_state import Case, Steps
from autopilot.identification.gust_strength import Passage, RunNoise
from autopilot.identification.residuals import initial_state
from autopilot.identification.rudder_path import with_corners
from autopilot.identification.runs import FloatArray, Segment
from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin, at_speed_ratio, yaw_acceleration

NAMES = ("gain", "time_constant", "n0", "n3")
"""The parameters in the order of the state; without n3 for the linear model."""

STEPS_PER_TIME_CONSTANT = 6.0
"""Of Runge and Kutta's method: exact to 1e-5."""
HELD_STEPS_PER_TIME_CONSTANT = 12.0
SUBSTEPS = 2
"""The same of particles, whose rudder is held over a step of two by the midpoint rule: exact to 0.1 % of T."""

UPDATES_PER_TIME_CONSTANT = 16.0
FEWEST_UPDATES = 100
"""A short segment is taken sample by sample rather than in fewer groups than this."""

LOG_DEVIATION = 0.7
"""Prior standard deviation of ln K and ln T: a factor of two either way."""

N0_DEVIATION = 0.5
"""The same of n0/w."""

N3_DEVIATION = 0.5
"""Of n3 w^2, the share of the cubic damping at the typical rate, beside half its own size."""

LEAST_RATE_NOISE = 1.0e-2
"""The instrument's noise is never below this share of the typical rate: sampling alone costs as much."""

LEAST_LAG_S = 0.01
"""Heading and rate of no two instruments agree better than what such a lag makes at the typical rate. A filter that
trusts both to the last digit explains their difference by the parameters."""


class YawDrive(NamedTuple):
    """What drives the yaw over a step: rudder [rad], speed over the reference speed, n1, and the typical rate w
    [rad/s]."""

    rudder: float
    ratio: float
    n1: float
    unit: float


def cubic_rates(state: Any, drive: YawDrive) -> tuple[Any, ...]:
    """Return the rates of (psi, r, ln K, ln T, n0/w, n3 w^2): psi' = r, r' by Norrbin's equation."""
    n3 = state[5] / (drive.unit * drive.unit)
    model = Norrbin(np.exp(state[2]), np.exp(state[3]), n3, 0.0, drive.n1, state[4] * drive.unit, 1.0)
    return state[1], yaw_acceleration(at_speed_ratio(model, drive.ratio), state[1], drive.rudder), 0.0, 0.0, 0.0, 0.0


def linear_rates(state: Any, drive: YawDrive) -> tuple[Any, ...]:
    """Return the rates of (psi, r, ln K, ln T, n0/w): the same with n3 = 0."""
    model = Norrbin(np.exp(state[2]), np.exp(state[3]), 0.0, 0.0, drive.n1, state[4] * drive.unit, 1.0)
    return state[1], yaw_acceleration(at_speed_ratio(model, drive.ratio), state[1], drive.rudder), 0.0, 0.0, 0.0


def heading_and_rate(state: Any) -> tuple[Any, ...]:
    """Return what is measured."""
    return state[0], state[1]


def prior_about(start: Norrbin, unit: float, cubic: bool) -> Gaussian:
    """Return the belief about the parameters of a boat that is near `start`, at its reference speed; unit: the typical
    rate w."""
    mean = np.array([np.log(start.gain), np.log(start.time_constant), start.n0 / unit, start.n3 * unit**2])
    deviation = np.array([LOG_DEVIATION, LOG_DEVIATION, N0_DEVIATION, N3_DEVIATION + 0.5 * abs(float(mean[3]))])
    count = 4 if cubic else 3
    return Gaussian(mean[:count], np.diag(np.square(deviation[:count])))


def yaw_case(belief: Gaussian, cubic: bool) -> Case:
    """Return the case of a boat whose parameters are believed so; state and noise are those of a segment: `entered`."""
    d = 2 + belief.mean.size
    covariance = np.zeros((d, d))
    covariance[2:, 2:] = belief.covariance
    prior = Gaussian(np.concatenate([np.zeros(2), belief.mean]), covariance)
    rates = cubic_rates if cubic else linear_rates
    return Case(NAMES[: d - 2], rates, heading_and_rate, np.zeros((d, 1)), np.eye(2), prior, SUBSTEPS)


def together(segment: Segment, start: Norrbin) -> int:
    """Return how many samples of a segment are taken together, at least one."""
    spacing = float(np.median(np.diff(segment.time)))
    fewest = max(segment.time.size // FEWEST_UPDATES, 1)
    return min(max(int(start.time_constant / UPDATES_PER_TIME_CONSTANT / spacing), 1), fewest)


def entered(case: Case, segment: Segment, start: Norrbin, noise: RunNoise, unit: float) -> Case:
    """Return the case at the begin of a segment: heading and rate as first measured, parameters as believed."""
    begun = passage(segment, start, (noise.rate, noise.heading), unit)
    mean, covariance = case.prior.mean.copy(), case.prior.covariance.copy()
    mean[:2] = begun.start
    covariance[[0, 1], [0, 1]] = begun.variance
    root = case.noise.copy()
    root[1, 0] = noise.process
    return case._replace(prior=Gaussian(mean, covariance), R=np.diag(begun.R), noise=root)


def passage(
    segment: Segment,
    start: Norrbin,
    noise: tuple[float, float],
    unit: float,
    per_memory: float = STEPS_PER_TIME_CONSTANT,
) -> Passage:
    """Return a segment's steps, what it begins with, and how noisy its measurements are; noise: of rate and heading;
    per_memory as in `segment_steps`."""
    rate, heading = initial_state(segment)
    share, least = together(segment, start) ** -0.5, LEAST_LAG_S * unit
    R = np.square([max(share * noise[1], least), max(share * noise[0], LEAST_RATE_NOISE * unit)])
    has_rate = bool(np.isfinite(segment.rate).any())
    variance = np.array([noise[1] ** 2 + least**2, noise[0] ** 2 + ((0.1 if has_rate else 0.5) * unit) ** 2])
    steps = segment_steps(segment, start, unit, per_memory)[0]
    at_edges = np.interp(_edges(segment, steps.dt), *with_corners(segment.time, segment.rudder))
    mean = np.array([drive.rudder for drive in steps.inputs])
    # Simpson's rule over the three gives the mean
    middle = 0.25 * (6.0 * mean - at_edges[:-1] - at_edges[1:])
    rudder = np.stack([at_edges[:-1], middle, at_edges[1:]], axis=1)
    return Passage(steps, rudder, np.array([heading, rate]), variance, R)


def segment_steps(
    segment: Segment, start: Norrbin, unit: float, per_memory: float = STEPS_PER_TIME_CONSTANT
) -> tuple[Steps, FloatArray, FloatArray]:
    """Return the steps of a segment; which of them end with a measurement, shape (n,); and when those are.

    Rudder and speed are their means over each step. per_memory: how many steps there are at least to the time constant
    at the typical rate.
    """
    group = together(segment, start)
    count = segment.time.size // group
    ends, heading, rate = (_means(values, group, count) for values in (segment.time, segment.heading, segment.rate))
    begin = segment.time[0]
    known = ends > begin
    spacing = np.diff(np.concatenate([[begin], ends[known]]))
    memory = start.time_constant / (1.0 + 3.0 * max(start.n3, 0.0) * unit**2)
    pieces = np.maximum(np.ceil(spacing * per_memory / memory - 1.0e-9), 1.0).astype(int)
    dt = np.repeat(spacing / pieces, pieces)
    last = np.cumsum(pieces) - 1
    edges = _edges(segment, dt)
    rudder = _mean_between(edges, *with_corners(segment.time, segment.rudder))
    speed = _mean_between(edges, segment.time, np.abs(segment.speed))
    ratio = np.maximum(speed / start.reference_speed, SPEED_FLOOR_RATIO)
    measured = np.full((dt.size, 2), np.nan)
    measured[last, 0], measured[last, 1] = heading[known], rate[known]
    drives = [YawDrive(float(d), float(u), start.n1, unit) for d, u in zip(rudder, ratio, strict=True)]
    return Steps(dt, drives, measured), last, ends[known] - begin


def _edges(segment: Segment, dt: FloatArray) -> FloatArray:
    return np.asarray(segment.time[0] + np.concatenate([[0.0], np.cumsum(dt)]))


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


def model_of(values: FloatArray, start: Norrbin, unit: float) -> Norrbin:
    """Return the model that the parameters (ln K, ln T, n0/w[, n3 w^2]) stand for."""
    n3 = float(values[3]) / unit**2 if values.size > 3 else 0.0
    return start._replace(
        gain=float(np.exp(values[0])), time_constant=float(np.exp(values[1])), n0=float(values[2]) * unit, n3=n3
    )
