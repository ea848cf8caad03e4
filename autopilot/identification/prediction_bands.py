"""What a boat will do in manoeuvres that nobody sailed yet, with the bands in which it will, in weather like the runs'.

Boats are drawn from what the fit knows (`likelihood_fit`), each at a speed that the runs had, and pushed by gusts and
white noise of the size that the fit found. What the model's form leaves out pushed the boat in the runs as gusts do,
and was found with them. It lasts longer than gusts where it is the model's fault: so the fit predicts stretches of its
own runs first, and where it errs by more than it says, its doubt and what pushes the boat are widened by as much.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.identification.likelihood_fit import LikelihoodFit
from autopilot.identification.likelihood_record import without_noise
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.models.wind import RaceAndWind

DRAWS, SEED = 400, 1
BAND = (0.025, 0.5, 0.975)
LEAST_RATIO, LEAST_PULL = 0.2, 0.05
"""No boat is drawn slower than this share of the reference speed, nor turned by less of what its rudder is found to
do."""
STEPS_PER_MEMORY, SHORTEST_STEP_S, LONGEST_STEP_S = 15.0, 0.02, 0.5
AHEAD_S, TURNING_RAD = 30.0, math.radians(10.0)
"""The turn that is forecast: so long after the rudder was put so far over, from a straight course."""
ZIGZAGS_DEG = (10.0, 20.0)
MOST_STRETCHES, FEWEST_STRETCHES, LONGEST_SHARE = 24, 6, 0.5
"""So many stretches of the runs are forecast, at most and at least; none longer than this share of the longest."""
LONGEST_ZIGZAG, MOST_STEPS = 20.0, 4000
"""A zigzag is given up after so many times the time in which the rudder turns the boat by its angle, or steps."""


class Band(NamedTuple):
    """A forecast angle [rad]: where 95 of 100 lie and their middle; infinite where the boat may not come back."""

    low: float
    middle: float
    high: float


class Forecast(NamedTuple):
    """After the rudder went to TURNING_RAD: times [s], shape (M,), and the heading's bands there [rad], shape (M, 3).
    By angle of the zigzag [deg]: bands of its first and second overshoot."""

    time: FloatArray
    turn: FloatArray
    overshoots: dict[float, tuple[Band, Band]]

    @property
    def heading(self) -> Band:
        """The heading at the end of the turn."""
        return Band(*self.turn[-1].tolist())


class Boats(NamedTuple):
    """Drawn boats, shape (N,) each: rates a, b, d, e and a speed ratio; `fit`, which says how late their rudders and
    how strong their gusts are; step [s] of the integration."""

    a: FloatArray
    b: FloatArray
    d: FloatArray
    e: FloatArray
    ratio: FloatArray
    fit: LikelihoodFit
    step: float


Helm = Callable[[float], tuple[FloatArray, FloatArray]]
"""Time [s] -> where the rudders are [rad], and the speeds as shares of the reference, shape (N,) each."""


def boats_of(fit: LikelihoodFit, ratios: FloatArray, random: np.random.Generator, draws: int = DRAWS) -> Boats:
    """Return boats that the fit allows, at speeds drawn from `ratios` to the reference speed."""
    rates = fit.rates
    size = np.sqrt(np.maximum(np.diag(fit.covariance), 1.0e-300))
    values, vectors = np.linalg.eigh(fit.covariance / np.outer(size, size))
    normal = random.normal(size=(draws, 4)) * np.sqrt(np.maximum(values, 0.0))
    a, b, d, e = np.array([rates.a, rates.b, rates.d, rates.e])[:, None] + size[:, None] * (vectors @ normal.T)
    # at the fastest turn that a large rudder makes the cubic damping forgets quickest
    forgets = abs(rates.b) + 3.0 * max(rates.d, 0.0) ** (1.0 / 3.0) * (0.35 * rates.a) ** (2.0 / 3.0)
    step = min(max(1.0 / (STEPS_PER_MEMORY * forgets), SHORTEST_STEP_S), LONGEST_STEP_S)
    ratio = np.maximum(random.choice(ratios, size=draws), LEAST_RATIO)
    return Boats(np.maximum(a, LEAST_PULL * rates.a), b, np.maximum(d, 0.0), e, ratio, fit, step)


class _Motion:
    """Boats under way: rate [rad/s] and heading [rad], shape (N,), pushed as the fit says."""

    def __init__(
        self,
        boats: Boats,
        random: np.random.Generator,
        rate: FloatArray | float = 0.0,
        rudder: FloatArray | float = 0.0,
    ) -> None:
        count = boats.a.size
        self.boats, self.random = boats, random
        self.rate, self.heading = np.zeros(count) + rate, np.zeros(count)
        self.gust = boats.fit.weather.gust * random.normal(size=count)
        self._played = self._lagged = np.zeros(count) + rudder
        self._late = [self._played] * round(boats.fit.train.delay / boats.step)

    def move(self, rudder: FloatArray, ratio: FloatArray) -> None:
        """Go on by a step, the rudders standing at `rudder` [rad], at these speeds."""
        boats, weather, h = self.boats, self.boats.fit.weather, self.boats.step
        play, _, lag, lead = boats.fit.train
        self._played = np.clip(self._played, rudder - play, rudder + play)
        self._late.append(self._played)
        rudder = self._late.pop(0)
        self._lagged = rudder if lag <= 0.0 else rudder + math.exp(-h / lag) * (self._lagged - rudder)
        effective = self._lagged + (lead / lag * (rudder - self._lagged) if lag > 0.0 else 0.0)
        drive = ratio * ratio * (boats.a * effective - boats.e) + self.gust
        linear, cubic = boats.b * ratio, boats.d / ratio
        middle = self.rate + 0.5 * h * (drive - self.rate * (linear + cubic * self.rate * self.rate))
        turned = h * (drive - middle * (linear + cubic * middle * middle))
        after = self.rate + turned + weather.white * math.sqrt(h) * self.random.normal(size=middle.size)
        self.heading = self.heading + 0.5 * h * (self.rate + after)
        self.rate = after
        keep = math.exp(-h / weather.gust_time)
        self.gust = keep * self.gust + weather.gust * math.sqrt(1.0 - keep * keep) * self.random.normal(size=after.size)


def turned(boats: Boats, helm: Helm, seconds: float, rate: FloatArray | float = 0.0) -> FloatArray:
    """Return headings [rad] of all boats after each step of `seconds` [s], shape (steps, N), from a `rate` [rad/s]."""
    motion = _Motion(boats, np.random.default_rng(SEED), rate, helm(0.5 * boats.step)[0])
    rows = []
    for k in range(max(1, round(seconds / boats.step))):
        motion.move(*helm((k + 0.5) * boats.step))
        rows.append(motion.heading)
    return np.array(rows)


class Stretch(NamedTuple):
    """From a moment of a recording on: rudder [rad] and speed [m/s] by time [s], the rate [rad/s] at first, and the
    angle [rad] turned in the end."""

    time: FloatArray
    rudder: FloatArray
    speed: FloatArray
    rate: float
    turned: float


def motions_of(segments: Sequence[Segment]) -> tuple[FloatArray, ...]:
    """Return time [s], heading [rad] and rate [rad/s] of each segment that has headings, from those alone, shape
    (3, N)."""
    found = []
    for segment in segments:
        known = np.isfinite(segment.heading)
        time, heading = segment.time[known], without_noise(segment.heading[known])
        found.append(np.stack([time, heading, np.gradient(heading, time)]) if time.size > 1 else np.empty((3, 0)))
    return tuple(found)


def stretches_of(segments: Sequence[Segment], motions: Sequence[FloatArray], seconds: float) -> list[Stretch]:
    """Return at most MOST_STRETCHES of so many seconds, which may overlap, of segments and their motions."""
    lengths = [float(time[-1] - time[0]) - seconds if time.size else 0.0 for time, _, _ in motions]
    apart = max(sum(length for length in lengths if length > 0.0) / MOST_STRETCHES, 0.25 * seconds)
    found = []
    for segment, (time, heading, rate), length in zip(segments, motions, lengths, strict=True):
        for begin in np.arange(time[0], time[0] + length, apart) if length > 0.0 else ():
            first, last = np.searchsorted(segment.time, (begin, begin + seconds))
            inside = slice(max(first - 1, 0), last + 1)
            turned = np.interp(begin + seconds, time, heading) - np.interp(begin, time, heading)
            found.append(
                Stretch(
                    segment.time[inside] - begin,
                    segment.rudder[inside],
                    np.abs(segment.speed[inside]),
                    float(np.interp(begin, time, rate)),
                    float(turned),
                )
            )
    return found


def headings_after(fit: LikelihoodFit, stretches: Sequence[Stretch], seconds: float, speed: float) -> FloatArray:
    """Return the angles [rad] that drawn boats turn in each stretch, shape (stretches, DRAWS), from its rudder and
    speed alone; speed [m/s]: the reference."""
    count = len(stretches)
    one = boats_of(fit, np.ones(1), np.random.default_rng(SEED), DRAWS)
    a, b, d, e, ratios = (np.tile(values, count) for values in (one.a, one.b, one.d, one.e, one.ratio))
    boats = Boats(a, b, d, e, ratios, fit, one.step)
    moments = (np.arange(round(seconds / boats.step)) + 0.5) * boats.step
    rudder = np.array([np.interp(moments, each.time, each.rudder) for each in stretches])
    ratio = np.maximum(np.array([np.interp(moments, each.time, each.speed) for each in stretches]) / speed, LEAST_RATIO)

    def helm(time: float) -> tuple[FloatArray, FloatArray]:
        k = int(time / boats.step)
        return np.repeat(rudder[:, k], DRAWS), np.repeat(ratio[:, k], DRAWS)

    rate = np.repeat([each.rate for each in stretches], DRAWS)
    return np.asarray(turned(boats, helm, moments.size * boats.step, rate)[-1].reshape(count, DRAWS))


def in_the_race(around: RaceAndWind | None, runs: Sequence[Run], speed: float) -> tuple[list[Run], float]:
    """Return the runs and the reference speed [m/s] with the flow past the rudder in place of the boat's speed, where a
    race of revolutions that nobody recorded was found: the model goes with that flow (`models.wind`)."""
    race = 0.0 if around is None else around.steady_race
    flows = [
        run._replace(segments=tuple(s._replace(speed=np.sqrt(s.speed**2 + race)) for s in run.segments)) for run in runs
    ]
    return (flows, math.sqrt(speed**2 + race)) if race > 0.0 else (list(runs), speed)


def widened(fit: LikelihoodFit, runs: Sequence[Run], speed: float) -> LikelihoodFit:
    """Return the fit with its doubt and what pushes the boat as large as its errors in stretches of its own runs."""
    segments = [segment for run in runs for segment in run.segments]
    longest = max(float(segment.time[-1] - segment.time[0]) for segment in segments)
    seconds = min(AHEAD_S, LONGEST_SHARE * longest)
    stretches = stretches_of(segments, fit.motions or motions_of(segments), seconds)
    if len(stretches) < FEWEST_STRETCHES:
        return fit
    drawn = headings_after(fit, stretches, seconds, speed)
    low, middle, high = np.quantile(drawn, BAND, axis=1)
    off = np.array([each.turned for each in stretches]) - middle
    ratio = 1.96 * off / np.maximum(0.5 * (high - low), 1.0e-9)
    factor = max(float(np.sqrt(np.mean(ratio**2))), 1.0)
    weather = fit.weather
    return fit._replace(
        covariance=factor**2 * fit.covariance,
        weather=weather._replace(gust=factor * weather.gust, white=factor * weather.white),
    )


def overshoots(boats: Boats, angle: float, rudder_rate: float) -> FloatArray:
    """Return the first and second overshoot [rad] of a zigzag with so much rudder and heading [rad], the rudder moving
    at `rudder_rate` [rad/s], shape (2, N); infinite for boats that do not come back."""
    motion = _Motion(boats, np.random.default_rng(SEED))
    count, rates = boats.a.size, boats.fit.rates
    side, reversals = np.ones(count), np.zeros(count, dtype=np.intp)
    rudder, furthest = np.zeros(count), np.zeros((2, count))
    lasts = LONGEST_ZIGZAG * (math.sqrt(2.0 / rates.a) + max(rates.b, 0.0) / rates.a + 2.0 * angle / rudder_rate)
    for _ in range(min(round(lasts / boats.step), MOST_STEPS)):
        across = side * motion.heading >= angle
        side = np.where(across, -side, side)
        reversals = reversals + across
        if (reversals > 2).all():
            break
        travel = rudder_rate * boats.step
        rudder = rudder + np.clip(side * angle - rudder, -travel, travel)
        motion.move(rudder, boats.ratio)
        for number in (0, 1):
            beyond = -side * motion.heading - angle
            furthest[number] = np.where(reversals == number + 1, np.maximum(furthest[number], beyond), furthest[number])
    return np.where(reversals > np.array([[1], [2]]), furthest, np.inf)


def forecast(fit: LikelihoodFit, runs: Sequence[Run], speed: float, rudder_rate: float) -> Forecast:
    """Return what the boat will do at the reference `speed` [m/s] and in weather like the runs', its rudder moving at
    `rudder_rate` [rad/s]."""
    random = np.random.default_rng(SEED)
    ratios = np.abs(np.concatenate([segment.speed for run in runs for segment in run.segments])) / speed
    boats = boats_of(widened(fit, runs, speed), ratios, random)

    def put_over(time: float) -> tuple[FloatArray, FloatArray]:
        return np.full(DRAWS, min(rudder_rate * time, TURNING_RAD)), boats.ratio

    headings = turned(boats, put_over, AHEAD_S)
    time = boats.step * np.arange(1, headings.shape[0] + 1)
    zigzags = {}
    for angle in ZIGZAGS_DEG:
        first, second = overshoots(boats, math.radians(angle), rudder_rate)
        zigzags[angle] = (band_of(first), band_of(second))
    return Forecast(time, np.quantile(headings, BAND, axis=1).T, zigzags)


def band_of(values: FloatArray) -> Band:
    """Return the band of drawn values."""
    return Band(*np.quantile(values, BAND, method="inverted_cdf").tolist())


def fastest_rudder(runs: Sequence[Run]) -> float:
    """Return the fastest [rad/s] at which the recorded rudder moved, but for one movement in a hundred."""
    moved = [np.abs(np.diff(segment.rudder)) / np.diff(segment.time) for run in runs for segment in run.segments]
    joined = np.concatenate(moved)
    return float(np.quantile(joined[joined > 0.0], 0.99)) if (joined > 0.0).any() else math.inf
