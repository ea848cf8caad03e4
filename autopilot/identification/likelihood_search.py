"""The search for the boat and the weather that make a recording most likely (`marginal_likelihood`).

What is searched for is one vector: the boat's rates in units of what takes the rudder's whole moment, delay and lag of
the rudder's way, and logarithms of sizes and times of gusts, waves and noise. What is known beforehand is weak: cubic
damping that would at the largest rate seen take some twice the rudder's whole moment is unlikely.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from autopilot.identification.likelihood_record import WIDE, Beside, IntArray, Record, moved_on, rudder_on
from autopilot.identification.marginal_likelihood import (
    Path,
    Rates,
    StepNoise,
    Weather,
    begin_path,
    best_path,
    first_states,
    gust_noise,
    noise_of,
    still_waves,
    wave_noise,
)
from autopilot.identification.marginal_slope import (
    Held,
    Moments,
    Offset,
    Rudder,
    adjoint_of,
    end_worth,
    gust_worth,
    held_at,
    information,
    moments_of,
    waves_worth,
    weather_information,
    worth_by_boat,
    worth_of,
)
from autopilot.identification.rudder_path import RudderTrain
from autopilot.identification.runs import FloatArray

RATE_NAMES = ("a", "b", "d", "e")
LARGEST_CUBIC = 2.0
"""Cubic damping at the largest rate, in units of the rudder's largest moment: the deviation of what is expected."""
BESIDE, NEXT = 0.1, 1.0e-5
"""Steps of the differences of slopes, in standard errors, and of those that give slopes."""
STAGES, ITERATIONS = 4, 40
"""Curvatures at most, and steps of each search."""
NEAR, STAYS, ARRIVED = 1.0, 1.0e-3, 5.0e-7
"""What a step may still gain of the likelihood's logarithm where the quasi-Newton search begins, where the curvature is
worked out, and at the end: the last two are 0.05 and 0.001 standard errors."""
FLATTEST, LEAST_CURVED = 1.0e-5, 0.16
"""The least curvature of the search's axes, as a share, and of a number: that of what was known of a gust's size."""
GUST_TIME_S, GUST_TIME_WIDTH = 6.0, 0.6
"""How long a gust lasts, and the deviation of its logarithm: turbulence some metres above the water is 20 to 60 m long
and passes at 5 to 10 m/s (Counihan 1975), 2 to 12 s. Shorter pushes are waves, or white."""
LATE_S, PLAY_RAD = 0.15, math.radians(0.5)
"""How late a rudder usually is, and how much play it has to either side."""
SWAY = {"lag": 0.15, "lead": 0.45}
"""Where the search for a boat that slides begins, and what is usual of one, as shares of the time in which it forgets
its rate: T2 and T3 of the second order of Nomoto et al. 1957. Tankers and container ships have T3 of 1.2 to 3 T2."""


ROUGHER = 0.35
"""By how much gusts are stronger in one run than in another, the flow past the rudder alike: the deviation of its
logarithm."""


class _Prior(NamedTuple):
    middle: float
    width: float

    def loss(self, value: float) -> float:
        """Return the negative logarithm of the density of a `value`, but for a constant."""
        return 0.5 * ((value - self.middle) / self.width) ** 2

    def slope(self, value: float) -> float:
        """Return its derivative."""
        return (value - self.middle) / self.width**2


GUST_POWER = _Prior(0.5, 0.5)
"""Of the rudder's force, with which gusts go from run to run and in turns: wind's moment on a hull does not (0), what
eddies and waves do to rudder and keel does (1)."""
STILL = 0.1
"""Of the mean flow: gusts are no weaker than in so much of it."""


def _usual(part: str, train: RudderTrain, parts: tuple[str, ...]) -> float:
    """Return what is usual of a part of the rudder's way: a steering gear's, or what the boat is supposed to slide
    by, where that is what the search begins with."""
    if "lead" in parts and part in SWAY:
        return float(getattr(train, part))
    return PLAY_RAD if part == "dead_band" else LATE_S


def _lasting(name: str, weather: Weather, record: Record, moments: Moments) -> float:
    """Return what of the loss time and strengths of gusts, or the shape of waves, have to do with."""
    if not name.startswith("wave"):
        keep, gust = gust_noise(weather, record)
        known = (weather.gust * record.rough[record.first]) ** -2.0
        begun = float((known * moments.first[:, 2] - np.log(known)).sum())
        return 0.5 * (float((gust_worth(moments, keep, gust) - np.log(gust)).sum()) + begun)
    wave, log = wave_noise(weather, record.step)
    still = still_waves(weather)
    first = float((moments.first[:, 3:] / still).sum()) + record.first.size * float(np.log(still).sum())
    return 0.5 * (waves_worth(moments, wave) + log + first)


Moved = tuple[RudderTrain, tuple[FloatArray, FloatArray, FloatArray]]
"""A train, and `moved_on` a record behind it."""
Slope = tuple[float, FloatArray, FloatArray]
"""Loss, its derivatives, and the information about the boat."""


class Space:
    """The vector of what is searched for, in units that make it of order one."""

    def __init__(
        self,
        record: Record,
        start: Rates,
        weather: Weather,
        train: RudderTrain,
        parts: tuple[str, ...],
        scale: Rates,
        beside: Beside | None = None,
        groups: IntArray | None = None,
        moved: Moved | None = None,
    ) -> None:
        """moved: what another space on the same times knows of the same rudder."""
        self.record, self.scale, self.train, self.parts = record, scale, train, parts
        self.beside, self.around = beside, () if beside is None else beside.names
        self.has_gyro = bool(record.rate_count.any())
        self.has_compass = bool(record.heading_count.any())
        self.base = weather
        self.names = [*RATE_NAMES, "gust", "gust_time", "white"]
        self.names += ["gyro"] if self.has_gyro else []
        self.names += ["compass"] if self.has_compass else []
        self.names += ["wave", "wave_frequency", "wave_damping"] if weather.wave > 0.0 else []
        self.logs = (*self.names[len(RATE_NAMES) :], *parts)
        self.groups = groups
        self.strengths: tuple[str, ...] = ()
        if groups is not None:
            # the flow past the rudder at the nodes, and which strength of gusts each is of
            steering = (record.scales if beside is None else beside.turning(beside.start)[0]).steering.mean(axis=0)
            self.flow = np.ones(record.nodes)
            steering = np.maximum(steering, STILL * np.mean(steering))
            self.flow[record.begin + 1] = steering
            self.flow[record.begin] = steering
            self.group = groups[record.segment_of(np.arange(record.nodes))]
            self.strengths = ("gust_power", *(f"gust_in_{k}" for k in range(int(groups.max()) + 1)))
        self.names += (*parts, *self.around, *self.strengths)
        self.boat = [i for i, name in enumerate(self.names) if name in (*RATE_NAMES, *parts, *self.around)]
        self.sky = [i for i in range(len(self.names)) if i not in self.boat]
        gust = scale.a * math.radians(0.3)
        self.priors = {
            "gust": _Prior(math.log(0.1 * gust), 2.5),
            "gust_time": _Prior(math.log(GUST_TIME_S), GUST_TIME_WIDTH),
            "white": _Prior(math.log(0.03 * gust), 2.5),
            "gyro": _Prior(math.log(weather.gyro), 0.7),
            "compass": _Prior(math.log(weather.compass), 0.7),
            "wave": _Prior(math.log(weather.wave) if weather.wave > 0.0 else 0.0, 1.5),
            "wave_frequency": _Prior(math.log(weather.wave_frequency), 0.7),
            "wave_damping": _Prior(math.log(0.1), 0.7),
            **{part: _Prior(math.log(_usual(part, train, parts)), 1.2) for part in parts},
            **dict.fromkeys(self.strengths, _Prior(0.0, ROUGHER)),
        }
        if self.strengths:
            self.priors["gust_power"] = GUST_POWER
        if beside is not None:
            self.priors |= {name: _Prior(*known) for name, known in zip(beside.names, beside.before, strict=True)}
        self.path = begin_path(record)
        if weather.wave > 0.0:
            self.path = np.concatenate([self.path, np.zeros((record.nodes, 2))], axis=1)
        self.moved = (train, moved_on(record, train)) if moved is None else moved
        first = [getattr(start, name) / getattr(scale, name) for name in RATE_NAMES]
        rest = [math.log(max(float(getattr(train if name in parts else weather, name)), 1.0e-9)) for name in self.logs]
        own = [self.priors[name].middle for name in self.strengths]
        self.start = np.array([*first, *rest, *([] if beside is None else beside.closed()), *own])

    def opened(self, z: FloatArray) -> tuple[Rates, Weather, RudderTrain]:
        """Return what the vector stands for."""
        known = dict(zip(self.names, z.tolist(), strict=True))
        rates = Rates(**{name: known[name] * getattr(self.scale, name) for name in RATE_NAMES})
        others = {name: math.exp(min(max(known[name], -WIDE), WIDE)) for name in self.logs}
        train = self.train._replace(**{name: others[name] for name in self.parts})
        sizes = {name: value for name, value in others.items() if name not in self.parts}
        weather = Weather(**{**self.base._asdict(), **sizes})
        if "wave_damping" in others:
            weather = weather._replace(wave_damping=min(others["wave_damping"], 0.9))
        return rates, weather, train

    def beside_at(self, z: FloatArray) -> Beside | None:
        """Return the surroundings with those of the vector to begin with."""
        if self.beside is None:
            return None
        return self.beside._replace(start=self.beside.opened(dict(zip(self.names, z.tolist(), strict=True))))

    def record_at(self, z: FloatArray) -> Record:
        """Return the record with what the vector says of the surroundings, and of the gusts of each run, in it."""
        record, beside = self._gusty(z), self.beside_at(z)
        if beside is None:
            return record
        scales, push = beside.turning(beside.start)
        return record._replace(scales=scales, push=push)

    def _gusty(self, z: FloatArray) -> Record:
        """Return the record with gusts as strong at each node as the vector says."""
        if not self.strengths:
            return self.record
        power, *own = z[-len(self.strengths) :]
        logs = power * np.log(self.flow) + np.array(own)[self.group]
        return self.record._replace(rough=np.exp(np.clip(logs, -WIDE, WIDE)))

    def before(self, z: FloatArray) -> float:
        """Return the negative logarithm of what is known beforehand."""
        total = 0.5 * (z[2] / LARGEST_CUBIC) ** 2
        for name, value in zip(self.names[4:], z[4:].tolist(), strict=True):
            total += self.priors[name].loss(value)
        return float(total)

    def _behind(self, train: RudderTrain) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return `moved_on` the record; behind the latest train it is remembered."""
        if train != self.moved[0]:
            self.moved = train, moved_on(self.record, train)
        return self.moved[1]

    def found(self, z: FloatArray, rounds: int = 12) -> Path:
        """Return path and loss at the vector, the search beginning at the latest best path."""
        rates, weather, train = self.opened(z)
        path = best_path(rates, weather, self.record_at(z), self._behind(train)[:2], self.path, rounds)
        return path._replace(loss=path.loss + self.before(z))

    def slope(self, z: FloatArray, boat_only: bool = False, informed: bool = True, whole: bool = False) -> Slope:
        """Return the loss at the vector, its derivatives, and the information about what moves the boat, rates and
        train, had the path to be found anew for each; a loss of inf where no path is found. Later searches begin at
        this path. boat_only: the weather's derivatives are left at 0; informed: False leaves the information out;
        whole: the information is that about all numbers, boat and weather apart."""
        path = self.found(z)
        slope = np.zeros_like(z)
        if path.factor is None:
            return math.inf, slope, np.eye(z.size if whole else len(self.boat))
        self.path = path.states
        rates, weather, train = self.opened(z)
        rudder = self._behind(train)[:2]
        record = self.record_at(z)
        noise = noise_of(weather, record)
        try:
            held = held_at(path, rates, record, noise)
        except np.linalg.LinAlgError:
            return math.inf, slope, np.eye(z.size if whole else len(self.boat))
        rudders = self._rudders_beside(z)
        numbers = dict(zip(self.names, z.tolist(), strict=True))
        besides = [] if self.beside is None else self.beside.changes(numbers, NEXT)
        size = np.array([*(getattr(self.scale, name) for name in RATE_NAMES), *(1.0 for _ in (*rudders, *besides))])
        adjoint = adjoint_of(held, rates, end_worth(held, noise))
        before = self.slope_before(z)
        worth = worth_by_boat(held, rates, rudder, rudders, adjoint, besides)
        slope[self.boat] = size * worth.sum(axis=1) + before[self.boat]
        if not boat_only:
            slope[self.sky] = self._by_weather(z, held, noise) + before[self.sky]
        if not informed:
            return path.loss, slope, np.eye(len(self.boat))
        known = np.outer(size, size) * information(path.factor, held, rates, rudder, rudders, noise, besides)
        known += np.diag([self.curvature_before(i) for i in self.boat])
        if whole:
            own, known = known, np.zeros((z.size, z.size))
            known[np.ix_(self.boat, self.boat)] = own
            offsets = self._offsets(z, held, noise)
            known[np.ix_(self.sky, self.sky)] = weather_information(path.factor, held, noise, offsets)
            known[self.sky, self.sky] += [self.curvature_before(i) for i in self.sky]
        return path.loss, slope, known

    def worths_behind(self, z: FloatArray, rudders: Sequence[Rudder]) -> list[float]:
        """Return by how much each of these rudders would raise the logarithm of the likelihood in the place of the one
        at the vector, the boat being one step of Newton's off to suit it; -inf where no path is found.

        A change D of the rudder beside changes of a, b, d and e stands in the turning as (a0 + da) D: the score and
        the information of Gauss and Newton, with a column for each change, hold all trials at once.
        """
        path = self.found(z)
        if path.factor is None:
            return [-math.inf] * len(rudders)
        rates, weather, train = self.opened(z)
        now, record = self._behind(train)[:2], self.record_at(z)
        noise = noise_of(weather, record)
        held = held_at(path, rates, record, noise)
        changes = [(mean - now[0], rise - now[1]) for mean, rise in rudders]
        adjoint = adjoint_of(held, rates, end_worth(held, noise))
        slope = worth_by_boat(held, rates, now, changes, adjoint).sum(axis=1)
        known = information(path.factor, held, rates, now, changes, noise)
        rate_count, worths = len(RATE_NAMES), []
        slope[:rate_count] += self.slope_before(z)[:rate_count] / self._rate_units()
        before = np.array([self.curvature_before(i) for i in range(rate_count)]) / self._rate_units() ** 2
        for k in range(rate_count, slope.size):
            taken = [*range(rate_count), k]
            here, bend = slope[taken], known[np.ix_(taken, taken)]
            step_by = np.vstack([np.eye(rate_count), np.eye(1, rate_count) / rates.a])
            pull = step_by.T @ (here + bend[:, -1])
            rest = step_by.T @ bend @ step_by + np.diag(before)
            worths.append(0.5 * float(pull @ inverse(rest) @ pull) - float(here[-1] + 0.5 * bend[-1, -1]))
        return worths

    def _rate_units(self) -> FloatArray:
        return np.array([getattr(self.scale, name) for name in RATE_NAMES])

    def _rudders_beside(self, z: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Return how mean and rise of the rudder change with each part of its way that is searched for."""
        changes = []
        for name in self.parts:
            if name == "delay":
                # a rudder later by a moment stands where it was, and moves as it did, that moment before
                train = self.opened(z)[2]
                _, rise, bend = self._behind(train)
                step = self.record.step / self.record.substeps
                changes.append((-train.delay * rise / step, -train.delay * bend))
                continue
            beside = []
            for by in (NEXT, -NEXT):
                at = z.copy()
                at[self.names.index(name)] += by
                beside.append(rudder_on(self.record, self.opened(at)[2]))
            mean, rise = ((more - less) / (2.0 * NEXT) for more, less in zip(*beside, strict=True))
            changes.append((mean, rise))
        return changes

    def _by_weather(self, z: FloatArray, held: Held, noise: StepNoise) -> list[float]:
        """Return the derivatives by the weather's numbers, what was known of them before left out.

        Inverse covariances go with the sizes' squares, and their determinants too; times and the waves' shape are
        differenced.
        """
        record, moments = held.record, moments_of(held)
        worth = worth_of(moments, noise)
        M, segments = record.step.size, record.first.size
        driven = 2.0 - worth.driven
        by_seen = noise.by_instrument * (1.0 if record.headings_known else noise.by_gyro)
        slopes = {
            "gust": M + segments - worth.gust - float(worth.first[2]),
            "white": float(driven @ noise.by_white),
            "gyro": noise.by_gyro * (record.rates_known - worth.gyro),
            "compass": record.headings_known - worth.compass,
        }
        slopes["compass" if record.headings_known else "gyro"] += float(driven @ by_seen)
        if noise.wave is not None:
            slopes["wave"] = 2.0 * (M + segments) - waves_worth(moments, noise.wave) - float(worth.first[3:].sum())
        shapes = [name for name in ("wave_frequency", "wave_damping") if name in self.names]
        for name in ("gust_time", *self.strengths, *shapes):
            i, beside = self.names.index(name), []
            for by in (NEXT, -NEXT):
                at = z.copy()
                at[i] += by
                beside.append(_lasting(name, self.opened(at)[1], self._gusty(at), moments))
            slopes[name] = (beside[0] - beside[1]) / (2.0 * NEXT)
        return [slopes[self.names[i]] for i in self.sky]

    def _offsets(self, z: FloatArray, held: Held, noise: StepNoise) -> list[Offset]:
        """Return how each of the weather's numbers changes what is unexplained."""
        record, states, D = held.record, held.states, held.states.shape[1]
        begin, end, first = record.begin, record.begin + 1, states[record.first]
        gust = states[end, 2] - noise.keep * states[begin, 2]
        still, no_gust, no_waves = np.zeros_like(first), np.zeros(begin.size), np.zeros((2, begin.size))
        sees = "compass" if record.headings_known else "gyro"
        found = []
        for i in self.sky:
            name = self.names[i]
            gyro, compass = noise.by_gyro * float(name == "gyro"), float(name == "compass")
            if name in ("white", "gyro", "compass"):
                by_seen = noise.by_instrument * (gyro if name == "gyro" else 1.0)
                driven: FloatArray | float = noise.by_white if name == "white" else by_seen if name == sees else 0.0
                found.append(Offset(driven, gyro, compass, no_gust, no_waves, still))
                continue
            (less, gone), (more, there) = (self._weather_beside(z, i, by) for by in (-NEXT, NEXT))
            began = first * (np.log(there) - np.log(gone)) / (-4.0 * NEXT)
            keep, inverse = ((b - a) / (2.0 * NEXT) for a, b in zip(less[:2], more[:2], strict=True))
            own = gust * (-0.5 * inverse / noise.gust) + math.sqrt(0.5) * keep * states[begin, 2]
            waves = no_waves
            if noise.wave is not None and name.startswith("wave"):
                moved = noise.wave[0]
                changed, log = (more[2][0] - less[2][0]) / (2.0 * NEXT), (more[3] - less[3]) / (2.0 * NEXT)
                x, v = states[begin, 3], states[begin, 4]
                waves = np.stack(
                    [
                        0.25 * log / begin.size * (states[end, 3 + k] - moved[2 * k] * x - moved[2 * k + 1] * v)
                        + math.sqrt(0.5) * (changed[2 * k] * x + changed[2 * k + 1] * v)
                        for k in (0, 1)
                    ]
                )
            found.append(Offset(0.0, 0.0, 0.0, own, waves, began[:, :D]))
        return found

    def _weather_beside(self, z: FloatArray, i: int, by: float) -> tuple[tuple[Any, ...], FloatArray]:
        """Return what drives gusts and waves where number i of the vector is moved, and the states' own variances'
        inverses where segments begin."""
        at = z.copy()
        at[i] += by
        weather, record = self.opened(at)[1], self._gusty(at)
        moved = self.names[i].startswith("wave")
        wave, log = wave_noise(weather, record.step) if moved else (None, 0.0)
        return (*gust_noise(weather, record), wave, log), np.maximum(first_states(weather, record), 1.0e-300)

    def slope_before(self, z: FloatArray) -> FloatArray:
        """Return the derivatives of `before` by the vector's numbers."""
        rest = [self.priors[name].slope(value) for name, value in zip(self.names[4:], z[4:].tolist(), strict=True)]
        return np.array([0.0, 0.0, z[2] / LARGEST_CUBIC**2, 0.0, *rest])

    def curvature_before(self, i: int) -> float:
        """Return the second derivative of `before` by the vector's number i."""
        name = self.names[i]
        if name in self.priors:
            return float(self.priors[name].width ** -2.0)
        return float(LARGEST_CUBIC**-2.0) if name == "d" else 0.0

    def keep(self, z: FloatArray) -> float:
        """Move the beginning of later searches to the vector's path; return the loss there."""
        path = self.found(z)
        if math.isfinite(path.loss):
            self.path = path.states
        return path.loss


def settled(space: Space, z: FloatArray, loss: float) -> tuple[FloatArray, float, FloatArray]:
    """Return the vector of the least loss near `z`, where `approached` ended, the loss, and the curvature there.

    With the curvature the search goes on until what is left to gain is nothing beside the doubt, so that the end is the
    same from wherever it came.
    """
    for _ in range(STAGES):
        curvature, slope = _curvature(space, z)
        axes = _axes(curvature)
        z, loss, left = _descended(space, z, loss, slope, axes @ axes.T, ARRIVED)
        if left < ARRIVED:
            break
    return z, loss, curvature


def approached(space: Space, start: FloatArray) -> tuple[FloatArray, float]:
    """Return a vector near the one of the least loss, and the loss there.

    Newton's steps with the average information (`weather_information`), of boat and weather apart, for what a record
    tells of either goes little with the other; near the end a quasi-Newton search that begins with it.
    """

    def newton(slope: FloatArray, known: FloatArray) -> FloatArray:
        return np.asarray(-inverse(known) @ slope)

    z, loss, slope, known = _stepped_on(space, start, newton, NEAR)
    z, loss, _ = _descended(space, z, loss, slope, inverse(known), STAYS)
    return z, loss


def in_weather(space: Space, z: FloatArray) -> tuple[FloatArray, float]:
    """Return a vector of the likeliest boat in the weather of `z`, and the loss there."""
    boat = np.array(space.boat)

    def of_boat(slope: FloatArray, known: FloatArray) -> FloatArray:
        step = np.zeros_like(slope)
        step[boat] = -inverse(known[np.ix_(boat, boat)]) @ slope[boat]
        return step

    z, loss, _, _ = _stepped_on(space, z, of_boat, STAYS)
    return z, loss


def _stepped_on(
    space: Space, z: FloatArray, step_of: Callable[[FloatArray, FloatArray], FloatArray], until: float
) -> tuple[FloatArray, float, FloatArray, FloatArray]:
    """Return a vector, its loss, slope and information after steps, each by the last two, until one promises no more
    than that."""
    loss, slope, known = space.slope(z, whole=True)
    for _ in range(ITERATIONS):
        step = step_of(slope, known)
        if not (math.isfinite(loss) and -0.5 * float(step @ slope) > until):
            break
        found = _stepped(space, z, loss, step, whole=True)
        if found is None:
            break
        z, (loss, slope, known) = found
    return z, loss, slope, known


def _descended(
    space: Space, z: FloatArray, loss: float, slope: FloatArray, inverted: FloatArray, until: float
) -> tuple[FloatArray, float, float]:
    """Return where the quasi-Newton search of Broyden, Fletcher, Goldfarb and Shanno ends that begins with the inverse
    `inverted` of the curvature, the loss there, and what one step more might gain: less than `until`, if it arrived."""
    one = np.eye(z.size)
    for _ in range(ITERATIONS):
        left = 0.5 * float(slope @ inverted @ slope)
        if not (math.isfinite(loss) and left > until):
            break
        found = _stepped(space, z, loss, -inverted @ slope)
        if found is None:
            break
        at, (loss, there, _) = found
        step, change = at - z, there - slope
        bent = float(step @ change)
        if bent > 0.0:
            turn = one - np.outer(step, change) / bent
            inverted = turn @ inverted @ turn.T + np.outer(step, step) / bent
        z, slope = at, there
    return z, loss, left


def _stepped(
    space: Space, z: FloatArray, loss: float, step: FloatArray, whole: bool = False
) -> tuple[FloatArray, Slope] | None:
    """Return a vector of less loss along the `step`, and the slope there; None where there is none."""
    step, path = _shortened(space, step), space.path
    for _ in range(HALVINGS):
        at = z + step
        found = space.slope(at, informed=whole, whole=whole)
        # where both are alike to rounding the slope decides when to end
        if found[0] < loss + ALIKE * abs(loss):
            return at, found
        space.path, step = path, 0.25 * step
    return None


def _shortened(space: Space, step: FloatArray) -> FloatArray:
    """Return a step of Newton's that goes no further than the curvature is good for: delay and lag and the weather are
    no straight lines, and a boat that turns against its rudder is another one."""
    step, boat = step.copy(), np.array(space.boat)
    logs = [i for i in space.boat if i >= len(RATE_NAMES)]
    step[boat] /= max(1.0, float(np.max(np.abs(step[[0, *logs]]))) / LARGEST_CHANGE)
    step[space.sky] /= max(1.0, float(np.max(np.abs(step[space.sky]))) / LARGEST_OF_WEATHER)
    return step


LARGEST_CHANGE, LARGEST_OF_WEATHER = 0.5, 1.5
"""Of the logarithms of the rudder's way in a step of Newton's, and of K/T as a share of what is guessed; and of those
of the weather's sizes and times."""
HALVINGS = 6
"""Steps tried at most, each a quarter of the one before."""


def _axes(curvature: FloatArray) -> FloatArray:
    """Return axes along which the curvature is one; where it is less than that of what was known before nothing is
    known but that."""
    size = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(curvature)), LEAST_CURVED))
    values, vectors = np.linalg.eigh(curvature * np.outer(size, size))
    return np.asarray(size[:, None] * vectors / np.sqrt(np.maximum(np.abs(values), FLATTEST)))


def inverse(known: FloatArray) -> FloatArray:
    """Return the inverse of what is known of the boat, which may be much more of a sum than of each."""
    size = 1.0 / np.sqrt(np.maximum(np.diag(known), 1.0e-300))
    values, vectors = np.linalg.eigh(known * np.outer(size, size))
    root = size[:, None] * vectors / np.sqrt(np.maximum(values, ROUNDING))
    return np.asarray(np.einsum("ik,jk->ij", root, root))


ROUNDING, ALIKE = 1.0e-10, 1.0e-12
"""Least share of the largest eigenvalue that is not taken for rounding; losses that differ by less are alike."""


def _curvature(space: Space, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the second derivatives of the loss, and the slope: among the boat's numbers what is known of them, all
    others by differences of slopes."""
    H = np.zeros((z.size, z.size))
    space.keep(z)
    _, here, known = space.slope(z, whole=True)
    before, sky, boat = space.path, space.sky, space.boat
    for i in sky:
        at, step = z.copy(), BESIDE / math.sqrt(max(float(known[i, i]), 1.0))
        at[i] += step
        space.path = before
        H[:, i] = (space.slope(at, informed=False)[1] - here) / step
    space.path = before
    H[np.ix_(sky, sky)] = 0.5 * (H[np.ix_(sky, sky)] + H[np.ix_(sky, sky)].T)
    H[np.ix_(sky, boat)] = H[np.ix_(boat, sky)].T
    H[np.ix_(boat, boat)] = known[np.ix_(boat, boat)]
    return np.asarray(np.nan_to_num(H, nan=1.0e6, posinf=1.0e6, neginf=-1.0e6)), here
