"""The boat that makes the recording most likely, and how far from it the truth may be.

Maximises the marginal likelihood (`marginal_likelihood`) over the boat's rates a, b, d, e, over gusts, waves and noise,
and over delay and lag of a rudder that was ordered. The covariance is the inverse of the curvature there, so that the
doubt about gusts and noise is in it. What is known beforehand is weak: cubic damping that would at the largest rate
seen take some twice the rudder's whole moment is unlikely, and none is below 0. No term is dropped: what the recording
cannot tell keeps its doubt.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize
from scipy.special import log_ndtr

from autopilot.identification.marginal_likelihood import (
    Path,
    Rates,
    Record,
    Weather,
    begin_path,
    best_path,
    instruments,
    record_of,
    rudder_on,
)
from autopilot.identification.rudder_path import DIRECT, RudderTrain
from autopilot.identification.runs import FloatArray, Segment

RATE_NAMES = ("a", "b", "d", "e")
LARGEST_CUBIC = 2.0
"""Cubic damping at the largest rate, in units of the rudder's largest moment: the deviation of what is expected."""
BESIDE = 0.05
"""Step of the differences along the search's axes, in standard errors."""
ROUGHER, MOST_WIDENING = 0.4, 1.5
"""The logarithm by which the disturbance is made larger to see what the doubt owes to it; the largest logarithm of a
variance's widening."""
STAGES, STAYS, FLATTEST = 4, 0.5, 0.02
"""How often the search begins anew at most; the distance, in standard errors, that is no move; the least curvature."""
WAVES_WORTH = 6.0
"""By so much the logarithm of the likelihood must rise for the three numbers of the waves."""
MAYBE_WAVES = 1.0
"""Waves as they are guessed must raise the logarithm of the likelihood so much before better ones are searched for."""
WIDE = 40.0
"""Logarithms beyond this are held."""


class LikelihoodFit(NamedTuple):
    """rates: the estimate, with covariance of a, b, d, e, shape (4, 4); train: of an ordered rudder, its errors by
    name; weather: gusts, waves and noise; loss: the negative logarithm of the likelihood with what was known before."""

    rates: Rates
    covariance: FloatArray
    train: RudderTrain
    train_errors: dict[str, float]
    weather: Weather
    loss: float


class _Prior(NamedTuple):
    middle: float
    width: float


class _Space:
    """The vector of what is searched for, in units that make it of order one."""

    def __init__(
        self, record: Record, start: Rates, weather: Weather, train: RudderTrain, parts: tuple[str, ...], scale: Rates
    ) -> None:
        self.record, self.scale, self.train, self.parts = record, scale, train, parts
        self.has_gyro = bool(record.rate_count.any())
        self.has_compass = bool(record.heading_count.any())
        self.base = weather
        self.names = [*RATE_NAMES, "gust", "gust_time", "white"]
        self.names += ["gyro"] if self.has_gyro else []
        self.names += ["compass"] if self.has_compass else []
        self.names += ["wave", "wave_frequency", "wave_damping"] if weather.wave > 0.0 else []
        self.names += parts
        gust = scale.a * math.radians(0.3)
        self.priors = {
            "gust": _Prior(math.log(0.1 * gust), 2.5),
            "gust_time": _Prior(math.log(6.0), 1.0),
            "white": _Prior(math.log(0.03 * gust), 2.5),
            "gyro": _Prior(math.log(weather.gyro), 0.7),
            "compass": _Prior(math.log(weather.compass), 0.7),
            "wave": _Prior(math.log(weather.wave) if weather.wave > 0.0 else 0.0, 1.5),
            "wave_frequency": _Prior(math.log(weather.wave_frequency), 0.7),
            "wave_damping": _Prior(math.log(0.1), 0.7),
            **{part: _Prior(math.log(0.15), 1.2) for part in parts},
        }
        self.path = begin_path(record)
        if weather.wave > 0.0:
            self.path = np.concatenate([self.path, np.zeros((record.nodes, 2))], axis=1)
        self.rudder = rudder_on(record, train)
        first = [getattr(start, name) / getattr(scale, name) for name in RATE_NAMES]
        rest = [
            math.log(max(float(getattr(train if name in parts else weather, name)), 1.0e-9)) for name in self.names[4:]
        ]
        self.start = np.array([*first, *rest])

    def opened(self, z: FloatArray) -> tuple[Rates, Weather, RudderTrain]:
        """Return what the vector stands for."""
        known = dict(zip(self.names, z.tolist(), strict=True))
        rates = Rates(**{name: known[name] * getattr(self.scale, name) for name in RATE_NAMES})
        others = {name: math.exp(min(max(known[name], -WIDE), WIDE)) for name in self.names[4:]}
        train = self.train._replace(**{name: others[name] for name in self.parts})
        weather = self.base._replace(**{name: value for name, value in others.items() if name not in self.parts})
        if "wave_damping" in others:
            weather = weather._replace(wave_damping=min(others["wave_damping"], 0.9))
        return rates, weather, train

    def before(self, z: FloatArray) -> float:
        """Return the negative logarithm of what is known beforehand."""
        total = 0.5 * (z[2] / LARGEST_CUBIC) ** 2
        for name, value in zip(self.names[4:], z[4:].tolist(), strict=True):
            prior = self.priors[name]
            total += 0.5 * ((value - prior.middle) / prior.width) ** 2
        return float(total)

    def found(self, z: FloatArray, rounds: int = 12) -> Path:
        """Return path and loss at the vector, the search beginning at the latest best path."""
        rates, weather, train = self.opened(z)
        rudder = rudder_on(self.record, train) if self.parts else self.rudder
        path = best_path(rates, weather, self.record, rudder, self.path, rounds)
        return path._replace(loss=path.loss + self.before(z))

    def keep(self, z: FloatArray) -> float:
        """Move the beginning of later searches to the vector's path; return the loss there."""
        path = self.found(z)
        if math.isfinite(path.loss):
            self.path = path.states
        return path.loss


def likelihood_fit(
    segments: Sequence[Segment],
    reference_speed: float,
    guess: Rates,
    parts: tuple[str, ...] = (),
    progress: Callable[[], None] = lambda: None,
) -> LikelihoodFit | None:
    """Return the most likely boat near `guess`, and its covariance; None where the search cannot begin there.

    parts: of the rudder's train, to be fitted too.
    """
    record = record_of(segments, reference_speed, memory_of(guess, segments))
    scale = scales(segments, guess)
    gyro, compass = instruments(segments)
    gust = scale.a * math.radians(0.3)
    calm = Weather(gust, 6.0, 0.3 * gust, gyro, compass)
    train = DIRECT._replace(**dict.fromkeys(parts, 0.15))
    space = _Space(record, guess, calm, train, parts, scale)
    if not math.isfinite(space.found(space.start).loss):
        return None
    z, loss, covariance = _maximised(space, space.start)
    progress()
    rates, weather, train = space.opened(z)
    wavy = _wave_start(record, space, z, weather)
    others = [
        _Space(record, rates, wavy._replace(wave=size * wavy.wave), train, parts, scale) for size in (0.5, 1.0, 2.0)
    ]
    other = min(others, key=lambda each: each.found(each.start).loss)
    if other.found(other.start).loss < loss - MAYBE_WAVES:
        other_z, other_loss, other_covariance = _maximised(other, other.start)
        if other_loss < loss - WAVES_WORTH:
            space, z, loss, covariance = other, other_z, other_loss, other_covariance
    progress()
    rates, weather, train = space.opened(z)
    progress()
    units = np.array([getattr(scale, name) for name in RATE_NAMES])
    values, spread = truncated(z[:4] * units, covariance[:4, :4] * np.outer(units, units), 2)
    errors = {
        name: float(getattr(train, name) * math.sqrt(max(covariance[i, i], 0.0)))
        for i, name in enumerate(space.names)
        if name in parts
    }
    found = Rates(**dict(zip(RATE_NAMES, values.tolist(), strict=True)))
    return LikelihoodFit(found, spread, train, errors, weather, loss)


class Start(NamedTuple):
    """Rates to begin with, and the share of the turning's changes that they explain."""

    rates: Rates
    explained: float


def start_rates(segments: Sequence[Segment], reference_speed: float) -> Start:
    """Return the rates that explain best what turns the boat, as a smoother that knows no boat sees it.

    g of a path with a = b = d = e = 0 is the boat's whole acceleration; least squares on rudder, rate, its cube and
    one gives the four. Noise draws b towards 0; a boat of either stability is found.
    """
    rate = largest_rate(segments)
    record = record_of(segments, reference_speed, 5.0)
    rudder = rudder_on(record)
    gyro, compass = instruments(segments)
    push = max(rate / TURNS_WITHIN_S, 1.0e-6)
    path = best_path(
        Rates(0.0, 0.0), Weather(push, 2.0, 0.05 * push, gyro, compass), record, rudder, begin_path(record)
    )
    now = record.begin
    r, turning = path.states[now, 1], path.states[now, 2]
    ratio = record.ratio.mean(axis=0)
    columns = np.stack([ratio**2 * rudder[0].mean(axis=0), -ratio * r, -(r**3) / ratio, -(ratio**2)], axis=1)
    inside = np.abs(r) < 2.0 * rate
    if np.count_nonzero(inside) < 8 or not math.isfinite(path.loss):
        return Start(Rates(0.0, 1.0), 0.0)
    best = _regressed(columns[inside], turning[inside])
    if best.rates.d < 0.0:
        best = _regressed(columns[inside][:, [0, 1, 3]], turning[inside])
    return best


TURNS_WITHIN_S = 2.0
"""A boat comes to its largest rate in no less; of quicker ones the smoother smooths more than it should."""


def better_start(segments: Sequence[Segment], reference_speed: float, starts: Sequence[Rates]) -> Rates:
    """Return the one of `starts` that a record in rough weather makes the likeliest."""
    if len(starts) == 1:
        return starts[0]
    memory = min(memory_of(start, segments) for start in starts)
    record = record_of(segments, reference_speed, memory)
    rudder, path, (gyro, compass) = rudder_on(record), begin_path(record), instruments(segments)

    def loss(start: Rates) -> float:
        push = scales(segments, start).e * ROUGH
        return best_path(start, Weather(push, 3.0, 0.1 * push, gyro, compass), record, rudder, path).loss

    return min(starts, key=loss)


ROUGH = 0.1
"""Rough weather, as a share of the rudder's moment."""


def _regressed(columns: FloatArray, turning: FloatArray) -> Start:
    values, *_ = np.linalg.lstsq(columns, turning, rcond=None)
    rest, whole = turning - columns @ values, turning - np.mean(turning)
    explained = 1.0 - float(rest @ rest) / max(float(whole @ whole), 1.0e-300)
    a, b, *cubic, e = values.tolist()
    return Start(Rates(a, b, 0.0, cubic[0] if cubic else 0.0, e), explained)


def memory_of(rates: Rates, segments: Sequence[Segment]) -> float:
    """Return the shortest time [s] within which the boat forgets its rate: that of a turn at the largest one."""
    return 1.0 / max(abs(rates.b) + 3.0 * max(rates.d, 0.0) * largest_rate(segments) ** 2, SLOWEST)


SLOWEST = 1.0e-4
"""Slower boats [1/s] are integrated as if they were as quick."""


def scales(segments: Sequence[Segment], guess: Rates) -> Rates:
    """Return of which size a, b, d and e are where each of them takes the rudder's whole moment at the largest rate."""
    rudder = np.concatenate([np.abs(segment.rudder - np.median(segment.rudder)) for segment in segments])
    largest = float(np.quantile(rudder, 0.98))
    rate = largest_rate(segments)
    a = abs(guess.a)
    return Rates(a, a * largest / rate, 0.0, a * largest / rate**3, a * largest)


def largest_rate(segments: Sequence[Segment]) -> float:
    """Return the largest rate [rad/s] in the record that is not noise."""
    found = []
    for segment in segments:
        known = np.isfinite(segment.heading)
        if known.sum() > 8:
            time, heading = segment.time[known], segment.heading[known]
            grid = np.arange(time[0], time[-1], max(1.0, 3.0 * float(np.median(np.diff(time)))))
            if grid.size > 3:
                found.append(float(np.quantile(np.abs(np.diff(np.interp(grid, time, heading)) / np.diff(grid)), 0.95)))
        elif np.isfinite(segment.rate).any():
            found.append(float(np.nanquantile(np.abs(segment.rate), 0.95)))
    return max([1.0e-5, *found])


def _maximised(space: _Space, start: FloatArray) -> tuple[FloatArray, float, FloatArray]:
    """Return the vector of the least loss near `start`, the loss, and the covariance there.

    A quasi-Newton search in coordinates in which the curvature where it begins is one; begun anew until it stays.
    """
    z, loss = start, space.keep(start)
    for _ in range(STAGES):
        curvature = _curvature(space, z)
        values, vectors = np.linalg.eigh(curvature)
        axes = vectors / np.sqrt(np.maximum(np.abs(values), FLATTEST))
        moved, lower = _searched(space, z, axes, loss)
        far = float(np.linalg.norm(np.linalg.solve(axes, moved - z)))
        z, loss = moved, lower
        if far < STAYS:
            break
    return z, loss, _inverse(curvature) * _widening(space, z, curvature)


def _inverse(curvature: FloatArray) -> FloatArray:
    """Return the inverse; a curvature that rounding made negative says that nothing is known there."""
    values, vectors = np.linalg.eigh(curvature)
    return np.asarray((vectors / np.maximum(values, FLATTEST)) @ vectors.T)


def _widening(space: _Space, z: FloatArray, curvature: FloatArray) -> float:
    """Return by how much variances are larger because the disturbance's size was itself found from this record.

    The four rates take as many degrees of freedom from the n that tell the size of what pushed the boat, and the rest
    makes Student's distribution of the normal one: 4/n + 2/n of the variance, for the share of the doubt that comes of
    the disturbance and not of the instruments. n is half the curvature along the logarithm of that size.
    """
    pushes = [space.names.index(name) for name in ("gust", "white")]
    prior = sum(space.priors[name].width ** -2.0 for name in ("gust", "white"))
    count = 0.5 * (float(curvature[np.ix_(pushes, pushes)].sum()) - prior)
    if count <= 0.0:
        return 1.0
    rougher = z.copy()
    rougher[pushes] += ROUGHER
    size = len(RATE_NAMES)
    before = np.linalg.slogdet(_inverse(curvature[:size, :size]))[1]
    after = np.linalg.slogdet(_inverse(_curvature(space, rougher, size)))[1]
    space.keep(z)
    share = min(max(float(after - before) / (2.0 * size * ROUGHER), 0.0), 1.0)
    return math.exp(min((size + 2.0) * share**2 / count, MOST_WIDENING))


def _searched(space: _Space, z: FloatArray, axes: FloatArray, loss: float) -> tuple[FloatArray, float]:
    """Return the vector of the least loss found along `axes` from `z`, and the loss."""
    best, least = z, loss

    def both(u: FloatArray) -> tuple[float, FloatArray]:
        nonlocal best, least
        at = z + axes @ u
        path = space.found(at)
        if not math.isfinite(path.loss):
            return 1.0e10, np.zeros_like(u)
        keep, space.path = space.path, path.states
        slope = np.empty_like(u)
        for i in range(u.size):
            plus, minus = (space.found(at + sign * BESIDE * axes[:, i], 4).loss for sign in (1.0, -1.0))
            slope[i] = (plus - minus) / (2.0 * BESIDE)
        if path.loss < least:
            best, least = at, path.loss
        else:
            space.path = keep
        return path.loss, np.nan_to_num(slope, nan=0.0, posinf=1.0e6, neginf=-1.0e6)

    minimize(both, np.zeros(z.size), jac=True, method="L-BFGS-B", options={"maxiter": 12, "maxls": 8, "gtol": 0.03})
    return best, least


def _curvature(space: _Space, z: FloatArray, size: int | None = None) -> FloatArray:
    """Return the second derivatives of the loss by the first `size` numbers (all), by differences over about half a
    standard error."""
    space.keep(z)
    here, P = space.found(z).loss, size or z.size
    steps = np.full(P, 1.0e-3)
    for _ in range(2):
        curved = np.array([_second(space, z, i, steps[i], here) for i in range(P)])
        steps = np.clip(0.5 / np.sqrt(np.maximum(np.abs(curved), 0.5)), 1.0e-5, 0.5)
    H = np.zeros((P, P))
    plus, minus = np.empty(P), np.empty(P)
    for i in range(P):
        plus[i], minus[i] = (_at(space, z, {i: sign * steps[i]}) for sign in (1.0, -1.0))
        H[i, i] = (plus[i] + minus[i] - 2.0 * here) / steps[i] ** 2
    for i in range(P):
        for j in range(i):
            both = sum(_at(space, z, {i: sign * steps[i], j: sign * steps[j]}) for sign in (1.0, -1.0))
            H[i, j] = H[j, i] = (both - plus[i] - minus[i] - plus[j] - minus[j] + 2.0 * here) / (
                2.0 * steps[i] * steps[j]
            )
    return H


def _second(space: _Space, z: FloatArray, i: int, step: float, here: float) -> float:
    return (_at(space, z, {i: step}) + _at(space, z, {i: -step}) - 2.0 * here) / step**2


def _at(space: _Space, z: FloatArray, moves: dict[int, float]) -> float:
    moved = z.copy()
    for i, by in moves.items():
        moved[i] += by
    loss = space.found(moved).loss
    return loss if math.isfinite(loss) else 1.0e6


def _wave_start(record: Record, space: _Space, z: FloatArray, weather: Weather) -> Weather:
    """Return the weather with waves at the strongest frequency of what pushes the boat and is no lasting gust."""
    push = space.found(z).states[:, 2]
    spacing = float(np.median(record.step))
    bare = push - np.convolve(np.pad(push, 10, mode="edge"), np.full(21, 1.0 / 21.0), mode="valid")[: push.size]
    spectrum = np.abs(np.fft.rfft(bare * np.hanning(bare.size))) ** 2
    frequency = 2.0 * math.pi * np.fft.rfftfreq(bare.size, spacing)
    band = (frequency > 0.3) & (frequency < 0.7 * math.pi / spacing)
    if not band.any():
        return weather._replace(wave=weather.compass, wave_frequency=1.0)
    at = float(frequency[band][int(np.argmax(spectrum[band]))])
    size = float(np.std(bare)) / at**2
    return weather._replace(wave=max(size, 0.1 * weather.compass), wave_frequency=at, wave_damping=0.1)


def truncated(mean: FloatArray, covariance: FloatArray, index: int) -> tuple[FloatArray, FloatArray]:
    """Return mean and covariance of a normal distribution of which one component cannot be below 0."""
    sigma = math.sqrt(max(float(covariance[index, index]), 1.0e-300))
    alpha = float(mean[index]) / sigma
    # phi(alpha)/Phi(alpha), without dividing nothing by nothing
    ratio = math.exp(-0.5 * alpha * alpha - 0.5 * math.log(2.0 * math.pi) - float(log_ndtr(alpha)))
    column = covariance[:, index] / sigma
    narrower = ratio * (ratio + alpha)
    return mean + column * ratio, covariance - np.outer(column, column) * narrower
