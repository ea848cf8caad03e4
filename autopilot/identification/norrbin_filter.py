"""Norrbin's model in a Kalman filter over heading, rate and parameters: its case, the disturbance intensity, its
estimate.

The state is (psi, r, ln K, ln T, n0/w, n3 w^2) with w a typical rate, so that every parameter is of order one, and K
and T stay positive; n3 enters the equation as it is, for its logarithm would make a straight problem crooked.
Samples closer together than a sixteenth of T are taken together, their means standing for the middle of their time:
that costs next to no information, and a filter's errors of chance grow with the number of its updates.

How strong the gusts are, a filter must know before it can weigh samples. Gusts and what the model leaves out enter as
white noise on r'. Of each of a row of strengths a Kalman filter over heading and rate alone, the parameters held, tells
how likely the record is:

    -2 log L = sum log det S_k + e_k' S_k^-1 e_k

and the strength that makes it most likely is taken (Ljung 1999, section 7.4). A heading that drifts away betrays gusts
long before the rates' own scatter does, and where a boat is course-unstable, and its simulation strays however good the
model is, the filter stays with the record.

The instruments' noise comes from second differences of the record, or of what a simulation leaves of it where that is
less: there the motion itself is gone.

The estimate is the extended Kalman filter's in Friedland's separated form, linear in the parameters. Parameters that
stay as they are need no filter of their own: one filter follows heading and rate with the parameters held at a point
theta_0, and beside it runs how its prediction moves with them, M = dx/dtheta:

    x- = f(x, theta_0),  M- = f_x M + f_theta;   x = x- + k e,  M = (I - k H) M-,  Psi = H M-
    e(theta) = e - Psi (theta - theta_0)

so that the belief about theta follows by least squares of innovations, at every step and for all of the record. That is
the filter with the parameters as states (Friedland 1969), but its slopes belong to one point instead of to what it
happens to believe at each moment. Early beliefs are rough, and what was counted as information on a rough belief is
never taken back: on a slow boat, where K, T and n3 move the motion alike, such a filter ends too sure and in the wrong
place. Passes over the record move theta_0 to where the one before ended, prior and all else as before: Gauss and
Newton's method. The standard errors are those of scores Psi' e that may remember, as in the output-error fit, not those
of noise that does exactly what the filter supposes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from autopilot.identification.feedback_particle import Case, Gaussian, Steps
from autopilot.identification.residual_tests import simulate_run
from autopilot.identification.residuals import initial_state, instrument_noise, robust_covariance
from autopilot.identification.rudder_path import with_corners
from autopilot.identification.runs import FloatArray, Run, Segment
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

LEAST_PROCESS, LARGEST_PROCESS, STRENGTHS = 1.0e-5, 3.0, 23
"""Gusts make the rate stray by between these shares of the typical rate; the strengths tried lie a factor of 1.8 apart,
which is closer than a record tells them."""

ROUGHLY = 4
"""Where nothing is known, every fourth strength is tried before the search goes uphill."""

LONGEST_STRETCH = 20000
"""Steps of a long record that the strength is taken from; the others would cost more than they tell."""


class RunNoise(NamedTuple):
    """process [rad/s/sqrt(s)]: root of the intensity on the rate. rate [rad/s], heading [rad]: the instruments'."""

    process: float
    rate: float
    heading: float


class Passage(NamedTuple):
    """A segment's n steps with the rudder [rad] at the beginning, middle and end of each, shape (n, 3), the state that
    it begins with, heading [rad] and rate [rad/s], their variances, and the measurements' variances, shapes (2,)."""

    steps: Steps
    rudder: FloatArray
    start: FloatArray
    variance: FloatArray
    R: FloatArray


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


def instruments(model: Norrbin, runs: Sequence[Run]) -> tuple[float, float]:
    """Return the noise of rate [rad/s] and heading [rad], 1 where nothing is measured."""
    rates, headings = [], []
    for run in runs:
        simulated = simulate_run(model, run) if model.n1 > 0.0 else [np.zeros((s.time.size, 2)) for s in run.segments]
        for segment, motion in zip(run.segments, simulated, strict=True):
            rates.append(min(instrument_noise(segment.rate), instrument_noise(segment.rate - motion[:, 0])))
            headings.append(min(instrument_noise(segment.heading), instrument_noise(segment.heading - motion[:, 1])))
    return _typical(rates), _typical(headings)


def disturbance_intensity(model: Norrbin, unit: float, passages: Sequence[Passage], near: float | None = None) -> float:
    """Return the process noise [rad/s/sqrt(s)] with which `model` explains the passages best; unit: a typical rate;
    near: where to look first."""
    memory = math.sqrt(2.0 / model.time_constant)
    strengths = (unit * memory * np.geomspace(LEAST_PROCESS, LARGEST_PROCESS, STRENGTHS)).tolist()
    tried: dict[int, float] = {}

    def unlikeliness(place: int) -> float:
        if place not in tried:
            total = _of_all(model, strengths[place], passages)
            tried[place] = total if math.isfinite(total) else math.inf
        return tried[place]

    begin = range(0, STRENGTHS, ROUGHLY)
    if near is not None:
        begin = range(int(np.argmin(np.abs(np.log(strengths) - math.log(near)))), STRENGTHS, STRENGTHS)
    best = min(begin, key=unlikeliness)
    while True:
        beside = range(max(best - 1, 0), min(best + 2, STRENGTHS))
        better = min(beside, key=unlikeliness)
        if unlikeliness(better) >= unlikeliness(best):
            return float(strengths[best])
        best = better


def _of_all(model: Norrbin, process: float, passages: Sequence[Passage]) -> float:
    total, left = 0.0, LONGEST_STRETCH
    for passage in passages:
        total += _unlikeliness(model, process * process, passage, left)
        left -= min(left, passage.steps.dt.size)
    return total


def _unlikeliness(model: Norrbin, intensity: float, passage: Passage, most: int) -> float:
    """Return -2 log L of a passage, but for a constant: heading and rate with their covariance a, b, c, in plain
    numbers, by two steps of the midpoint rule each."""
    steps, (psi, r), (a, c), (R_heading, R_rate) = passage.steps, *(v.tolist() for v in passage[2:])
    b, total, ratio, log = 0.0, 0.0, 0.0, math.log
    for dt, drive, (heading, rate) in zip(
        steps.dt[:most].tolist(), steps.inputs, steps.measured.tolist(), strict=False
    ):
        if drive.ratio != ratio:
            boat = at_speed_ratio(model, drive.ratio)
            ratio, T, n1, n3 = drive.ratio, boat.time_constant, boat.n1, boat.n3
        push = boat.gain * drive.rudder - boat.n0
        keep, turn, h = 1.0, 0.0, 0.5 * dt
        for _ in range(2):
            middle = r + 0.5 * h * (push - (n3 * r * r + n1) * r) / T
            psi, r = psi + h * middle, r + h * (push - (n3 * middle * middle + n1) * middle) / T
            decay = -(3.0 * n3 * middle * middle + n1) / T
            half = keep * (1.0 + 0.5 * h * decay)
            turn, keep = turn + h * half, keep + h * decay * half
        a, b, c = a + turn * (2.0 * b + turn * c), keep * (b + turn * c), keep * keep * c
        a, b, c = a + intensity * dt**3 / 3.0, b + intensity * dt**2 / 2.0, c + intensity * dt
        if heading == heading:
            S, e = a + R_heading, heading - psi
            total += log(S) + e * e / S
            psi, r, a, b, c = psi + a / S * e, r + b / S * e, a - a * a / S, b - a * b / S, c - b * b / S
        if rate == rate:
            S, e = c + R_rate, rate - r
            total += log(S) + e * e / S
            psi, r, a, b, c = psi + b / S * e, r + c / S * e, a - b * b / S, b - b * c / S, c - c * c / S
    return total


def _typical(noises: Sequence[float]) -> float:
    known = [noise for noise in noises if np.isfinite(noise)]
    return float(np.sqrt(np.mean(np.square(known)))) if known else 1.0


class Innovations(NamedTuple):
    """What each of n steps contributed, in units of its standard deviation: the innovations of heading and rate, shape
    (n, 2), and how they fall with the parameters, shape (n, 2, p); 0 where nothing was measured."""

    value: FloatArray
    slope: FloatArray


class Separated:
    """The filter of one segment with the parameters (ln K, ln T, n0/w[, n3 w^2]) held at those of a model.

    unit: the typical rate w [rad/s]; cubic: whether n3 is among the parameters; process: the process noise
    [rad/s/sqrt(s)].
    """

    def __init__(self, model: Norrbin, unit: float, cubic: bool, process: float) -> None:
        self._model, self._unit, self._count, self._process = model, unit, 4 if cubic else 3, process

    def innovations(self, passage: Passage) -> Innovations:
        """Return what the passage tells."""
        steps, p = passage.steps, self._count
        n = steps.dt.size
        value, slope = np.zeros((n, 2)), np.zeros((n, 2, p))
        self._psi, self._r = passage.start.tolist()
        self._a, self._b, self._c = float(passage.variance[0]), 0.0, float(passage.variance[1])
        self._by_psi, self._by_r = [0.0] * p, [0.0] * p
        R = passage.R.tolist()
        rows = zip(steps.dt.tolist(), passage.rudder.tolist(), steps.inputs, steps.measured.tolist(), strict=True)
        for k, (dt, rudder, drive, (heading, rate)) in enumerate(rows):
            self._predict(dt, rudder, drive.ratio)
            if heading == heading:
                value[k, 0], slope[k, 0] = self._take_heading(heading, R[0])
            if rate == rate:
                value[k, 1], slope[k, 1] = self._take_rate(rate, R[1])
        return Innovations(value, slope)

    def _predict(self, dt: float, rudder: list[float], ratio: float) -> None:
        """A step of Runge and Kutta's with the rudder at its beginning, middle and end, and of what moves beside it; in
        the last place how the step moves with the rate that it begins with."""
        boat, third = at_speed_ratio(self._model, ratio), dt / 6.0
        begun, beside = self._r, [*self._by_r, 1.0]
        k1, d1 = self._slope(boat, ratio, begun, beside, rudder[0])
        k2, d2 = self._slope(boat, ratio, begun + 0.5 * dt * k1, _ahead(beside, 0.5 * dt, d1), rudder[1])
        k3, d3 = self._slope(boat, ratio, begun + 0.5 * dt * k2, _ahead(beside, 0.5 * dt, d2), rudder[1])
        k4, d4 = self._slope(boat, ratio, begun + dt * k3, _ahead(beside, dt, d3), rudder[2])
        self._r = begun + third * (k1 + 2.0 * (k2 + k3) + k4)
        self._psi += dt * (begun + third * (k1 + k2 + k3))
        *self._by_r, keep = [
            m + third * (e + 2.0 * (f + g) + i) for m, e, f, g, i in zip(beside, d1, d2, d3, d4, strict=True)
        ]
        turned = [dt * (m + third * (e + f + g)) for m, e, f, g in zip(beside, d1, d2, d3, strict=True)]
        self._by_psi = [m + x for m, x in zip(self._by_psi, turned, strict=False)]
        turn, a, b, c, Q = turned[-1], self._a, self._b, self._c, self._process**2 * dt
        self._a = a + turn * (2.0 * b + turn * c) + Q * dt * dt / 3.0
        self._b, self._c = keep * (b + turn * c) + 0.5 * Q * dt, keep * keep * c + Q

    def _slope(
        self, boat: Norrbin, ratio: float, r: float, beside: list[float], rudder: float
    ) -> tuple[float, list[float]]:
        """Return r' and how it moves with the parameters and with the rate."""
        T, w, square = boat.time_constant, self._unit * ratio, r * r
        drive = boat.gain * rudder / T
        rate = drive - (boat.n0 + (boat.n3 * square + boat.n1) * r) / T
        decay = -(3.0 * boat.n3 * square + boat.n1) / T
        push = drive, -rate, -w / T, -square * r / (T * w * w)
        return rate, [*(decay * m + f for m, f in zip(beside[:-1], push, strict=False)), decay * beside[-1]]

    def _take_heading(self, measured: float, variance: float) -> tuple[float, list[float]]:
        size, e, slopes = self._a + variance, measured - self._psi, self._by_psi
        self._correct(self._a / size, self._b / size, e, slopes)
        self._a, self._b, self._c = (
            self._a * variance / size,
            self._b * variance / size,
            self._c - self._b * self._b / size,
        )
        root = math.sqrt(size)
        return e / root, [m / root for m in slopes]

    def _take_rate(self, measured: float, variance: float) -> tuple[float, list[float]]:
        size, e, slopes = self._c + variance, measured - self._r, self._by_r
        self._correct(self._b / size, self._c / size, e, slopes)
        self._a, self._b, self._c = (
            self._a - self._b * self._b / size,
            self._b * variance / size,
            self._c * variance / size,
        )
        root = math.sqrt(size)
        return e / root, [m / root for m in slopes]

    def _correct(self, of_psi: float, of_r: float, e: float, slopes: list[float]) -> None:
        self._psi += of_psi * e
        self._r += of_r * e
        self._by_psi = [m - of_psi * x for m, x in zip(self._by_psi, slopes, strict=True)]
        self._by_r = [m - of_r * x for m, x in zip(self._by_r, slopes, strict=True)]


def _ahead(values: list[float], step: float, slopes: list[float]) -> list[float]:
    return [m + step * f for m, f in zip(values, slopes, strict=True)]


def beliefs(innovations: Innovations, about: FloatArray, prior: Gaussian) -> tuple[FloatArray, FloatArray]:
    """Return the parameters after each step, shape (n, p), and their covariance at the end, shape (p, p), by what was
    contributed about the point `about`, shape (p,), after a prior."""
    root = np.linalg.inv(prior.covariance)
    information = root + np.cumsum(np.einsum("nci,ncj->nij", innovations.slope, innovations.slope), axis=0)
    score = root @ (prior.mean - about) + np.cumsum(
        np.einsum("nci,nc->ni", innovations.slope, innovations.value), axis=0
    )
    return about + np.linalg.solve(information, score[:, :, None])[:, :, 0], np.linalg.inv(information[-1])


def stacked(innovations: Sequence[Innovations]) -> Innovations:
    """Return one segment's innovations after the other's."""
    return Innovations(
        np.concatenate([each.value for each in innovations]), np.concatenate([each.slope for each in innovations])
    )


def covariance_of(innovations: Sequence[Innovations], off: FloatArray, prior: FloatArray) -> FloatArray:
    """Return the covariance, shape (p, p), of an estimate that lies `off` the point of what each segment contributed,
    beside a prior's: of scores that may remember (`robust_covariance`). What the record does not tell stays as it was.
    """
    flat = np.concatenate([each.slope.reshape(-1, off.size) for each in innovations])
    information, certain = flat.T @ flat, np.linalg.inv(prior)
    scores = robust_covariance(
        [each.slope for each in innovations], [each.value - each.slope @ off for each in innovations]
    )
    outer = np.linalg.inv(information + certain)
    return np.asarray(outer @ (information @ scores @ information + certain) @ outer)
