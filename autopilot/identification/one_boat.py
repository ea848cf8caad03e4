"""Whether all of a recording tells of one boat: its runs, and the halves of each, by what each makes likely alone.

Two loadings in two logs, a rudder's sensor that slipped, a clock that changed its delay: one model of both lies between
them, with an interval that knows of neither. Gusts take up what the model misses, and the residuals look like weather.

Near the fit to all, a part's likelihood is that of a normal distribution about one step of Newton's from there. Two
parts differ by chance as the sum of both covariances says (Wald 1943): the statistic is chi-square with as many degrees
of freedom as the boat has numbers. Where chance would seldom make them so different, each part is fitted by itself, in
weather of its own, and compared once more. What they then differ by is doubt about the boat of the next day.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from autopilot.identification.likelihood_fit import LikelihoodFit, likelihood_fit, space_at
from autopilot.identification.likelihood_search import RATE_NAMES, inverse
from autopilot.identification.runs import FloatArray, Run, Segment

LOOKED_AT, BY_CHANCE = 0.02, 0.002
"""Of healthy recordings this share is looked at more closely, and at most this share is said to differ."""
LEAST_APART, DOUBTFUL, MOST_APART = 0.1, 0.15, 0.3
"""Shares by which K or T of two parts differ before anything is said, before the model between them is no longer good,
and before it is not enough. One between parts that differ by 15 % is off by half of it to either side, which is half of
what designed gains bear; beyond 30 % it may be off by all of that."""
SHORTEST_PART = 32
"""A part of fewer samples tells of no boat."""


class Differing(NamedTuple):
    """Two parts that are not of one boat, in words; K/T, n1/T, n3/T and n0/T by each alone, shape (4,), and by all;
    delay and lag [s] together by each; and the probability that one boat's parts differ as much."""

    one: str
    other: str
    rates: tuple[FloatArray, FloatArray]
    whole: FloatArray
    late: tuple[float, float]
    chance: float

    @property
    def doubt(self) -> FloatArray:
        """What this adds to the covariance of K/T, n1/T, n3/T and n0/T, shape (4, 4): were the parts two boats, their
        variance about the model of all."""
        return np.asarray(sum(np.outer(each - self.whole, each - self.whole) for each in self.rates))

    @property
    def share(self) -> float:
        """By how much K or T, or K/T of a boat that is not surely course-stable, differ, between the parts or from the
        model of all, or what comes late from part to part as a share of T."""
        values = [self._values(rates) for rates in (*self.rates, self.whole)]
        apart = max(float(np.ptp(np.log(each))) for each in zip(*values, strict=True))
        return max(apart, abs(self.late[1] - self.late[0]) * abs(float(self.whole[1])))

    def _values(self, rates: FloatArray) -> tuple[float, ...]:
        a, b = max(float(rates[0]), LEAST), float(rates[1])
        return (a / b, 1.0 / b) if min(float(each[1]) for each in (*self.rates, self.whole)) > 0.0 else (a,)

    @property
    def is_doubtful(self) -> bool:
        """Whether the parts differ by more than those of a good model may: at best it is one to start with."""
        return self.share > DOUBTFUL

    @property
    def are_two(self) -> bool:
        """Whether the parts differ by so much that no model between them is one to start with."""
        return self.share > MOST_APART

    def sentence(self) -> str:
        """Return what differs, and what to look for."""
        first, second, both = (self._values(rates) for rates in (*self.rates, self.whole))
        named = (("K", "1/s"), ("T", "s")) if len(first) > 1 else (("K/T", "1/s^2"),)
        said = [
            f"{symbol} {x:.3g} and {y:.3g} {unit}" for (symbol, unit), x, y in zip(named, first, second, strict=True)
        ]
        if any(self.late):
            said.append(f"a rudder late by {self.late[0]:.2g} and {self.late[1]:.2g} s")
        apart = f"{', '.join(said)} by each alone"
        if max(abs(math.log(x / y)) for x, y in zip(first, second, strict=True)) < LEAST_APART:
            # alike, and unlike what was found for both
            together = ", ".join(f"{symbol} {x:.3g} {unit}" for (symbol, unit), x in zip(named, both, strict=True))
            apart += f", but {together} by both together"
        if not self.is_doubtful:
            return f"{self.one} and {self.other} differ by more than gusts explain: {apart}; the intervals hold both"
        return (
            f"{self.one} and {self.other} do not tell of one boat: {apart}; look for what changed between them "
            "(loading, throttle, the rudder's or the log's scale, a sensor's delay) and identify each by itself"
        )


LEAST = 1.0e-9
"""K/T [1/s^2] of a boat that turns against its rudder is compared as this."""


class _Part(NamedTuple):
    """Half a run: its number, the half, and slope and curvature of the likelihood by the boat's numbers at the fit."""

    run: int
    half: int
    segments: tuple[Segment, ...]
    pull: FloatArray
    known: FloatArray


def differing(
    found: LikelihoodFit, runs: Sequence[Run], speed: float, progress: Callable[[], None] = lambda: None
) -> Differing | None:
    """Return the two parts of the runs that surely differ most, None where all agree; speed [m/s]: the reference."""
    parts = [part for number, run in enumerate(runs) for part in _parts_of(found, run, number, speed)]
    compared = _compared(parts, [run.source for run in runs])
    if not compared:
        return None
    chances = [_chance(*(_step(side) for side in (one, other))) for one, other, _ in compared]
    one, other, names = compared[int(np.argmin(chances))]
    if not min(chances) < LOOKED_AT / len(compared):
        return None
    parts_alone = (tuple(segment for part in side for segment in part.segments) for side in (one, other))
    train = tuple(found.train_errors)
    fits = [likelihood_fit(alone, speed, found.rates, train, progress, found.form) for alone in parts_alone]
    first, second = fits
    if first is None or second is None:
        return None
    chance = _chance(_alone(first), _alone(second)) * len(compared)
    if not chance < BY_CHANCE:
        return None
    rates, late = zip(*((np.array(fit.rates), fit.train.delay + fit.train.lag) for fit in (first, second)), strict=True)
    differ = Differing(*names, rates, np.array(found.rates), late, chance)
    return differ if differ.share > LEAST_APART else None


def _alone(fit: LikelihoodFit) -> tuple[FloatArray, FloatArray]:
    """Return the boat's numbers of a fit, those of its rudder's train among them, and their covariance."""
    way = [float(getattr(fit.train, name)) for name in fit.train_errors]
    size = np.array([1.0, 1.0, 1.0, 1.0, *way])
    known = fit.covariance if fit.joint is None else fit.joint * np.outer(size, size)
    return np.array([*fit.rates, *way]), known


def _parts_of(found: LikelihoodFit, run: Run, number: int, speed: float) -> list[_Part]:
    """Return the halves of a run by its recorded time, with slope and curvature of each one's likelihood at the fit."""
    lasts = sum(float(s.time[-1] - s.time[0]) for s in run.segments)
    halves: tuple[list[Segment], list[Segment]] = ([], [])
    before = 0.0
    for segment in run.segments:
        since = before + segment.time - segment.time[0]
        at = int(np.searchsorted(since, 0.5 * lasts))
        for half, inside in enumerate((slice(0, at), slice(at, None))):
            cut = Segment(*(values[inside] if values.size else values for values in segment))
            if cut.time.size >= SHORTEST_PART:
                halves[half].append(cut)
        before = float(since[-1])
    parts = []
    for half, segments in enumerate(halves):
        if segments:
            part = _part(found, number, half, tuple(segments), speed)
            if part is not None:
                parts.append(part)
    return parts


def _part(found: LikelihoodFit, number: int, half: int, segments: tuple[Segment, ...], speed: float) -> _Part | None:
    space = space_at(found, segments, speed)
    if space is None:
        return None
    loss, slope, known = space.slope(space.start, boat_only=True)
    if not (math.isfinite(loss) and np.isfinite(known).all()):
        return None
    # in the boat's own units, which the parts share
    own = [float(getattr(found.train, name)) for name in space.parts]
    size = 1.0 / np.array([*(getattr(space.scale, name) for name in RATE_NAMES), *own])
    return _Part(number, half, segments, size * slope[space.boat], known * np.outer(size, size))


Side = list[_Part]


def _compared(parts: Side, sources: Sequence[str]) -> list[tuple[Side, Side, tuple[str, str]]]:
    """Return what is compared: each run with the others, the halves of each run, and those of all runs."""

    def where(run: int | None, half: int | None) -> Side:
        return [part for part in parts if run in (None, part.run) and half in (None, part.half)]

    numbers, found = sorted({part.run for part in parts}), []
    for number in numbers[: 1 if len(numbers) == 2 else None]:
        rest = sources[numbers[-1]] if len(numbers) == 2 else "the other runs"
        others = [part for part in parts if part.run != number]
        found.append((where(number, None), others, (sources[number], rest)))
    halves = ("the first half", "the second half")
    found += [(where(n, 0), where(n, 1), (f"{halves[0]} of {sources[n]}", halves[1])) for n in numbers]
    if len(numbers) > 1:
        found.append((where(None, 0), where(None, 1), (f"{halves[0]} of each run", halves[1])))
    return [(one, other, names) for one, other, names in found if one and other]


def _step(side: Side) -> tuple[FloatArray, FloatArray]:
    """Return where the side's own boat lies from the fit, and its covariance."""
    spread = inverse(np.sum([part.known for part in side], axis=0))
    return -(spread @ np.sum([part.pull for part in side], axis=0)), spread


def _chance(one: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray]) -> float:
    """Return the probability that one boat gives two parts, each by its numbers and their covariance, so different."""
    apart, spread = one[0] - other[0], one[1] + other[1]
    return float(chdtrc(apart.size, float(apart @ inverse(spread) @ apart)))
