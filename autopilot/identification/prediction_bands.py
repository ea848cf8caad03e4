"""What a boat will do in manoeuvres that nobody sailed yet, with the bands in which it will, in weather like the runs'.

Boats are drawn from what the fit knows (`likelihood_fit`), each at a speed that the runs had, and pushed by gusts,
white noise, and waves where these push, of the size that the fit found. What the model's form leaves out pushed the
boat in the runs as gusts do, and was found with them. It lasts longer than gusts where it is the model's fault: so the
fit predicts stretches of its own runs first, and where it errs by more than it says, its doubt and what pushes the boat
are widened by as much.

With which power of the speed a rudder steers is not known either: in a turn the speed goes with the rate, and what a
recording of one kind of turn lays to damping may be that. Boats are drawn with the powers that the runs allow, each as
they ask for with that power (`LikelihoodFit.power`): in turns like the runs' they go alike, in others apart.

Of thrust the power is drawn about its law's, and it does not steer with its angle alone: hull and speed answer a
smaller one in another way. Such boats are drawn with (delta/angle)^p in what their steering does, 1 at the angle of the
runs: bands of zigzags with another angle know that nobody sailed them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import ndtri, stdtrit

from autopilot.identification.likelihood_fit import LikelihoodFit
from autopilot.identification.likelihood_record import scales_of, without_noise
from autopilot.identification.marginal_likelihood import Weather, still_waves, wave_noise
from autopilot.identification.rudder_path import RudderRate, rudder_rate_of
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.identification.simulation import RATE_BOUND_RAD_S
from autopilot.models.steering_gear import SteeringGear, gear_step, lag_share
from autopilot.models.weather import RaceAndWind

DRAWS, SEED = 400, 1
BAND = (0.025, 0.5, 0.975)
LEAST_RATIO, LEAST_PULL = 0.2, 0.05
"""No boat is drawn slower than this share of the reference speed, nor turned by less of what its rudder is found to
do."""
REMEMBERED = 5.0
"""Lags after which what the rudder did is forgotten."""
FURTHEST = 2.0
"""No lag nor lead is drawn by a larger factor's logarithm off the found one."""
STEPS_PER_MEMORY, SHORTEST_STEP_S, LONGEST_STEP_S = 15.0, 0.02, 0.5
ANGLE_DOUBT, ANGLES = 0.1, (0.1, 10.0)
"""Of the power of the angle beyond the first with which thrust steers, one standard deviation: in a calm the
simulator's outboard asks for 0.07 to 0.16 between zigzags of 16 to 20 deg and one of 10. And the angles over that of
the runs between which the power is believed."""
AHEAD_S, TURNING_RAD = 30.0, math.radians(10.0)
"""The turn that is forecast: so long after the rudder was put so far over, from a straight course."""
ZIGZAGS_DEG = (10.0, 20.0)
MOST_STRETCHES, FEWEST_STRETCHES, LONGEST_SHARE = 24, 6, 0.5
"""So many stretches of the runs are forecast, at most and at least; none longer than this share of the longest."""
MOST_TAKEN_UP = 0.4
"""Of the variance of errors in stretches that were fitted, what the fit's numbers take up, at most."""
ROUNDING = 1.0e-9
"""Of a step: moments that are no further apart are alike."""
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
    """Drawn boats, shape (N,) each: rates a, b, d, e, a speed ratio, lag and lead [s] of the train, and with how many
    powers of the speed beyond the law's the rudder steers; with how many of its angle beyond the first; `fit`, which
    says the rest of the train and how strong their gusts are; step [s] of the integration."""

    a: FloatArray
    b: FloatArray
    d: FloatArray
    e: FloatArray
    ratio: FloatArray
    lag: FloatArray
    lead: FloatArray
    beyond: FloatArray
    by_angle: FloatArray
    fit: LikelihoodFit
    step: float


Helm = Callable[[float], tuple[FloatArray, FloatArray]]
"""Time [s] -> where the rudders are [rad], and the speeds as shares of the reference, shape (N,) or (M, 1)."""


def boats_of(fit: LikelihoodFit, ratios: FloatArray, random: np.random.Generator, draws: int = DRAWS) -> Boats:
    """Return boats that the fit allows, at speeds drawn from `ratios` to the reference speed."""
    rates = fit.rates
    size = np.sqrt(np.maximum(np.diag(fit.covariance), 1.0e-300))
    values, vectors = np.linalg.eigh(fit.covariance / np.outer(size, size))
    normal = random.normal(size=(draws, 4)) * np.sqrt(np.maximum(values, 0.0))
    a, b, d, e = np.array([rates.a, rates.b, rates.d, rates.e])[:, None] + size[:, None] * (vectors @ normal.T)
    # at the fastest turn that a large rudder makes, d r^p = a delta, the damping forgets quickest
    power = fit.form.power
    forgets = abs(rates.b) + power * max(rates.d, 0.0) ** (1.0 / power) * (0.35 * rates.a) ** (1.0 - 1.0 / power)
    step = min(max(1.0 / (STEPS_PER_MEMORY * forgets), SHORTEST_STEP_S), LONGEST_STEP_S)
    ratio = np.maximum(random.choice(ratios, size=draws), LEAST_RATIO)
    lag, lead = _ways_of(fit, np.array([a - rates.a, b - rates.b, d - rates.d, e - rates.e]), random)
    beyond = np.zeros(draws)
    if (steers := fit.power) is not None:
        off = steers.deviation * random.normal(size=draws)
        beyond = steers.mean + off
        changes = steers.boat[:, None] + np.outer(steers.by_power, off)
        a, b, d, e = (one + change for one, change in zip((a, b, d, e), changes[:4], strict=True))
        logs = dict(zip(fit.train_errors, np.clip(changes[4:], -FURTHEST, FURTHEST), strict=True))
        lag, lead = (way * np.exp(logs.get(name, 0.0)) for name, way in (("lag", lag), ("lead", lead)))
    # of a rudder the power of the speed holds this too
    by_angle = np.zeros(draws) if fit.form.law.is_rudder else ANGLE_DOUBT * random.normal(size=draws)
    a, d = np.maximum(a, LEAST_PULL * rates.a), np.maximum(d, 0.0)
    return Boats(a, b, d, e, ratio, lag, lead, beyond, by_angle, fit, step)


def _ways_of(fit: LikelihoodFit, off: FloatArray, random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return lag and lead [s], shape (N,) each, of boats whose rates are `off` the estimate by so much, shape (4, N): a
    boat that turns harder slides less, so that they go together."""
    train, count = fit.train, off.shape[1]
    ways = {name: np.full(count, getattr(train, name)) for name in ("lag", "lead")}
    if fit.joint is not None and fit.train_errors:
        size = np.sqrt(np.maximum(np.diag(fit.joint), 1.0e-300))
        alike = fit.joint / np.outer(size, size)
        follows = alike[4:, :4] @ np.linalg.pinv(alike[:4, :4], hermitian=True)
        values, vectors = np.linalg.eigh(alike[4:, 4:] - follows @ alike[:4, 4:])
        own = vectors @ (np.sqrt(np.maximum(values, 0.0))[:, None] * random.normal(size=(values.size, count)))
        logs = size[4:, None] * (follows @ (off / size[:4, None]) + own)
        for name, log in zip(fit.train_errors, logs, strict=True):
            if name in ways:
                ways[name] = ways[name] * np.exp(np.clip(log, -FURTHEST, FURTHEST))
    return ways["lag"], ways["lead"]


class _Motion:
    """Boats under way: rate [rad/s] and heading [rad], shape (N,), or (M, N) where each goes M ways, as `rate` says
    in a shape that goes with it; pushed as the fit says."""

    def __init__(
        self,
        boats: Boats,
        random: np.random.Generator,
        rate: FloatArray | float = 0.0,
        rudder: FloatArray | float = 0.0,
    ) -> None:
        shape = np.broadcast_shapes(boats.a.shape, np.shape(rate))
        self.boats, self.random = boats, random
        self.rate, self.heading = np.zeros(shape) + rate, np.zeros(shape)
        weather, h = boats.fit.pushes, boats.step
        self.gust = weather.gust * random.standard_normal(shape)
        self._keep = math.exp(-h / weather.gust_time)
        self._by_gust, self._by_white = weather.gust * math.sqrt(1.0 - self._keep**2), weather.white * math.sqrt(h)
        self.wave: FloatArray | None = None
        if weather.wave > 0.0 and weather.wave_pushes:
            still = np.sqrt(still_waves(weather)).reshape(2, *(1 for _ in shape))
            self.wave = still * random.standard_normal((2, *shape))
            moved, drives, *_ = wave_noise(weather, np.array([h]))[0]
            self._on, self._new = moved.reshape(2, 2), np.linalg.cholesky(np.linalg.inv(drives.reshape(2, 2)))
        self._played = self._lagged = np.zeros(shape) + rudder
        self._late = [self._played] * round(boats.fit.train.delay / h)
        self._shares: tuple[FloatArray, FloatArray, FloatArray] | None = None
        if boats.fit.train.lag > 0.0:
            # of what the lag is off at a step's beginning, what is left at its end, and in its mean
            left = np.exp(-h / boats.lag)
            self._shares = left, (1.0 - left) * boats.lag / h, boats.lead / boats.lag
        self._ratio, self._terms = np.empty(0), (np.empty(0), np.empty(0), np.empty(0))

    def behind_train(self, rudder: FloatArray) -> FloatArray:
        """Go on by a step with the train alone, the rudders standing at `rudder` [rad]; return what turns the boats, in
        the step's mean."""
        play = self.boats.fit.train.dead_band
        self._played = np.clip(self._played, rudder - play, rudder + play) if play > 0.0 else rudder
        self._late.append(self._played)
        rudder = self._late.pop(0)
        if self._shares is not None:
            left, mean, ahead = self._shares
            off = self._lagged - rudder
            self._lagged = rudder + left * off
            rudder = rudder + (1.0 - ahead) * mean * off
        return rudder

    def move(self, rudder: FloatArray, ratio: FloatArray) -> None:
        """Go on by a step, the rudders standing at `rudder` [rad], at these speeds."""
        boats, h = self.boats, self.boats.step
        rudder = self.behind_train(rudder)
        if math.isfinite(boats.fit.angle) and boats.by_angle.any():
            size = np.clip(np.abs(rudder) / boats.fit.angle, *ANGLES)
            rudder = rudder * size**boats.by_angle
        if ratio is not self._ratio:
            self._ratio, scales = ratio, scales_of(boats.fit.form, ratio)
            beyond_law = np.exp(np.log(ratio) * boats.beyond) if boats.beyond.any() else 1.0
            self._terms = scales.steering * beyond_law, boats.b * scales.linear, boats.d * scales.higher
        steering, linear, higher = self._terms
        drive = steering * (boats.a * rudder - boats.e) + self.gust
        if self.wave is not None:
            drive = drive + self.wave[0]
            new = self.random.standard_normal(self.wave.shape)
            self.wave = np.tensordot(self._on, self.wave, 1) + np.tensordot(self._new, new, 1)
        beyond = boats.fit.form.power - 1
        middle = self.rate + 0.5 * h * (drive - self.rate * (linear + higher * np.abs(self.rate) ** beyond))
        turned = h * (drive - middle * (linear + higher * np.abs(middle) ** beyond))
        white, gust = self.random.standard_normal((2, *middle.shape))
        after = self.rate + turned + self._by_white * white
        # a boat that runs away, into what is no number, is bounded, as where runs are simulated
        after = np.fmax(np.fmin(after, RATE_BOUND_RAD_S), -RATE_BOUND_RAD_S)
        self.heading = self.heading + 0.5 * h * (self.rate + after)
        self.rate = after
        self.gust = self._keep * self.gust + self._by_gust * gust


@np.errstate(over="ignore", invalid="ignore")
def turned(
    boats: Boats, helm: Helm, seconds: float, rate: FloatArray | float = 0.0, before: FloatArray | None = None
) -> FloatArray:
    """Return headings [rad] of all boats after each step of `seconds` [s], shape (steps, N), or (steps, M, N) from a
    `rate` [rad/s] of shape (M, 1), with rudders and speeds of that shape. before: where the rudders [rad] were in the
    steps before: a train remembers."""
    standing = helm(0.5 * boats.step)[0] if before is None else before[0]
    motion = _Motion(boats, np.random.default_rng(SEED), rate, standing)
    for rudder in () if before is None else before:
        motion.behind_train(rudder)
    steps, headings = max(1, round(seconds / boats.step)), np.empty(0)
    for k in range(steps):
        motion.move(*helm((k + 0.5) * boats.step))
        if k == 0:
            headings = np.empty((steps, *motion.heading.shape))
        headings[k] = motion.heading
    return headings


class Stretch(NamedTuple):
    """From a moment of a recording on: rudder [rad] and speed [m/s] by time [s], of which some is before that moment,
    the rate [rad/s] at first, and the angle [rad] turned in the end, so long [s] after that moment."""

    time: FloatArray
    rudder: FloatArray
    speed: FloatArray
    rate: float
    turned: float
    lasts: float


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
    """Return at most MOST_STRETCHES of so many seconds, which may overlap, of segments and their motions.

    They begin and end where the motions are known, the end up to a spacing early: between nodes a second apart the rate
    of a quick boat is no straight line.
    """
    lengths = [float(time[-1] - time[0]) - seconds if time.size else 0.0 for time, _, _ in motions]
    apart = max(sum(length for length in lengths if length > 0.0) / MOST_STRETCHES, 0.25 * seconds)
    found = []
    for segment, (time, heading, rate), length in zip(segments, motions, lengths, strict=True):
        for wanted in np.arange(time[0], time[0] + length, apart) if length > 0.0 else ():
            at = np.searchsorted(time, wanted)
            end = np.searchsorted(time, time[at] + seconds, side="right") - 1
            if end == at:
                continue
            begin = time[at]
            last = np.searchsorted(segment.time, begin + seconds)
            # what the train remembers of the rudder
            first = np.searchsorted(segment.time, begin - seconds)
            inside = slice(max(first - 1, 0), last + 1)
            found.append(
                Stretch(
                    segment.time[inside] - begin,
                    segment.rudder[inside],
                    np.abs(segment.speed[inside]),
                    float(rate[at]),
                    float(heading[end] - heading[at]),
                    float(time[end] - begin),
                )
            )
    return found


def headings_after(
    fit: LikelihoodFit, stretches: Sequence[Stretch], seconds: float, speed: float, draws: int = DRAWS
) -> FloatArray:
    """Return the angles [rad] that drawn boats turn in each stretch, of `seconds` at most, shape (stretches, draws),
    from its rudder and speed alone; speed [m/s]: the reference."""
    boats = boats_of(fit, np.ones(1), np.random.default_rng(SEED), draws)
    moments = (np.arange(math.ceil(seconds / boats.step)) + 0.5) * boats.step
    rudder = np.array([np.interp(moments, each.time, each.rudder) for each in stretches])
    ratio = np.maximum(np.array([np.interp(moments, each.time, each.speed) for each in stretches]) / speed, LEAST_RATIO)

    def helm(time: float) -> tuple[FloatArray, FloatArray]:
        k = int(time / boats.step)
        return rudder[:, k : k + 1], ratio[:, k : k + 1]

    rate = np.array([[each.rate] for each in stretches])
    train = fit.train
    memory = boats.step * np.arange(-math.ceil((train.delay + REMEMBERED * train.lag) / boats.step), 0)
    before = np.array([[[np.interp(at, s.time, s.rudder)] for s in stretches] for at in memory])
    after = turned(boats, helm, moments.size * boats.step, rate, before if memory.size else None)
    ends = np.minimum(np.array([each.lasts for each in stretches]) / boats.step, moments.size - ROUNDING)
    left, rows = ends.astype(int), np.arange(len(stretches))
    share = (ends - left)[:, None]
    before_it = np.where((left > 0)[:, None], after[np.maximum(left - 1, 0), rows], 0.0)
    return np.asarray((1.0 - share) * before_it + share * after[left, rows])


def in_the_race(around: RaceAndWind | None, runs: Sequence[Run], speed: float) -> tuple[list[Run], float]:
    """Return the runs and the reference speed [m/s] with the flow past the rudder in place of the boat's speed, where a
    race of revolutions that nobody recorded was found: the model goes with that flow (`models.weather`)."""
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
    drawn = headings_after(fit, stretches, seconds, speed, DRAWS // 2)
    low, middle, high = np.quantile(drawn, BAND, axis=1)
    off = np.array([each.turned for each in stretches]) - middle
    ratio = 1.96 * off / np.maximum(0.5 * (high - low), 1.0e-9)
    apart = sum(float(segment.time[-1] - segment.time[0]) for segment in segments) / seconds
    # of so few that do not overlap the size of an error is itself in doubt (Student's t), and the fit, which saw
    # them, is nearer to them than to others by what its numbers take up
    share = min((fit.covariance.shape[0] + len(fit.train_errors) + (fit.power is not None)) / apart, MOST_TAKEN_UP)
    few = stdtrit(apart, BAND[-1]) / ndtri(BAND[-1]) * math.sqrt((1.0 + share) / (1.0 - share))
    factor = max(few * float(np.sqrt(np.mean(ratio**2))), 1.0)

    def stronger(weather: Weather) -> Weather:
        return weather._replace(gust=factor * weather.gust, white=factor * weather.white, wave=factor * weather.wave)

    return fit._replace(
        covariance=factor**2 * fit.covariance,
        joint=None if fit.joint is None else factor**2 * fit.joint,
        weather=stronger(fit.weather),
        power=fit.power and fit.power._replace(weather=stronger(fit.power.weather)),
    )


@np.errstate(over="ignore", invalid="ignore")
def overshoots(boats: Boats, angle: FloatArray | float, gear: SteeringGear) -> FloatArray:
    """Return the first and second overshoot [rad] of a zigzag with so much rudder and heading [rad], moved by `gear`,
    shape (2, N), or (2, M, N) of angles of shape (M, 1); infinite for boats that do not come back."""
    shape, rates = np.broadcast_shapes(boats.a.shape, np.shape(angle)), boats.fit.rates
    motion = _Motion(boats, np.random.default_rng(SEED), np.zeros(shape))
    side, reversals = np.ones(shape), np.zeros(shape, dtype=np.intp)
    rudder, called, past, furthest = np.zeros(shape), np.zeros(shape), np.zeros(shape), np.full((2, *shape), np.inf)
    share, travel = lag_share(gear, boats.step), gear.rate_max * boats.step
    moves = 2.0 * float(np.max(angle)) / gear.rate_max + gear.lag
    lasts = LONGEST_ZIGZAG * (math.sqrt(2.0 / rates.a) + max(rates.b, 0.0) / rates.a + moves)
    for _ in range(min(round(lasts / boats.step), MOST_STEPS)):
        across = side * motion.heading >= angle
        if across.any():
            for number in (0, 1):
                furthest[number] = np.where(across & (reversals == number + 1), past, furthest[number])
            # from where the rudder is called back, which is up to a step beyond the angle
            called, past = np.where(across, side * motion.heading, called), np.where(across, 0.0, past)
            side = np.where(across, -side, side)
            reversals = reversals + across
            if (reversals > 2).all():
                break
        before = rudder
        rudder = rudder + np.clip(share * (side * angle - rudder), -travel, travel)
        # what turns the boat in a step is where the rudder is on the way, not at its end
        motion.move(0.5 * (before + rudder), boats.ratio)
        past = np.maximum(past, -side * motion.heading - called)
    return furthest


def forecast(fit: LikelihoodFit, runs: Sequence[Run], speed: float, gear: SteeringGear) -> Forecast:
    """Return what the boat will do at the reference `speed` [m/s] and in weather like the runs', its rudder moved by
    `gear`."""
    random = np.random.default_rng(SEED)
    ratios = np.abs(np.concatenate([segment.speed for run in runs for segment in run.segments])) / speed
    boats = boats_of(widened(fit, runs, speed), ratios, random)
    going = [gear_step(gear, 0.0, TURNING_RAD, 0.5 * boats.step)]
    for _ in range(round(AHEAD_S / boats.step)):
        going.append(gear_step(gear, going[-1], TURNING_RAD, boats.step))

    def put_over(time: float) -> tuple[FloatArray, FloatArray]:
        return np.full(DRAWS, going[int(time / boats.step)]), boats.ratio

    headings = turned(boats, put_over, AHEAD_S)
    time = boats.step * np.arange(1, headings.shape[0] + 1)
    found = overshoots(boats, np.radians(ZIGZAGS_DEG)[:, None], gear)
    bands = [(band_of(first), band_of(second)) for first, second in zip(*found, strict=True)]
    return Forecast(time, np.quantile(headings, BAND, axis=1).T, dict(zip(ZIGZAGS_DEG, bands, strict=True)))


def band_of(values: FloatArray) -> Band:
    """Return the band of drawn values."""
    return Band(*np.quantile(values, BAND, method="inverted_cdf").tolist())


def gear_of(runs: Sequence[Run]) -> SteeringGear:
    """Return the gear that moved the runs' rudder at the rate that they show. What comes between an ordered rudder and
    the water is the train's."""
    return gear_at(rudder_rate_of(runs), runs)


def gear_at(measured: RudderRate | None, runs: Sequence[Run]) -> SteeringGear:
    """Return `gear_of` runs whose measured rate is known, or known to be none."""
    return SteeringGear(math.inf, measured.rate if measured else fastest_rudder(runs))


def fastest_rudder(runs: Sequence[Run]) -> float:
    """Return the fastest [rad/s] at which the recorded rudder moved, but for one movement in a hundred."""
    moved = [np.abs(np.diff(segment.rudder)) / np.diff(segment.time) for run in runs for segment in run.segments]
    joined = np.concatenate(moved)
    return float(np.quantile(joined[joined > 0.0], 0.99)) if (joined > 0.0).any() else math.inf
