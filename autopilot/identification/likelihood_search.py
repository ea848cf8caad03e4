"""The search for the boat and the weather that make a recording most likely (`marginal_likelihood`).

What is searched for is one vector: the boat's rates in units of what takes the rudder's whole moment, delay and lag of
the rudder's way, and logarithms of sizes and times of gusts, waves and noise. What is known beforehand is weak: cubic
damping that would at the largest rate seen take some twice the rudder's whole moment is unlikely.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize

from autopilot.identification.likelihood_record import WIDE, Beside, IntArray, Record, rudder_on
from autopilot.identification.marginal_likelihood import (
    Path,
    Rates,
    StepNoise,
    Weather,
    begin_path,
    best_path,
    gust_noise,
    noise_of,
    still_waves,
    wave_noise,
)
from autopilot.identification.marginal_slope import (
    Held,
    Moments,
    Rudder,
    adjoint_of,
    end_worth,
    gust_worth,
    held_at,
    information,
    moments_of,
    waves_worth,
    worth_by_boat,
    worth_of,
)
from autopilot.identification.rudder_path import RudderTrain
from autopilot.identification.runs import FloatArray

RATE_NAMES = ("a", "b", "d", "e")
LARGEST_CUBIC = 2.0
"""Cubic damping at the largest rate, in units of the rudder's largest moment: the deviation of what is expected."""
BESIDE, FIRST_STEP, NEXT = 0.1, 1.0e-4, 1.0e-5
"""Steps of the differences of slopes, in standard errors, and where those are not known; and of those that give slopes.
"""
STAGES, STAYS, ITERATIONS = 4, 0.05, 40
"""How often the search begins anew at most, what a step of Newton's may still gain where it ends, and its iterations.
"""
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
    ) -> None:
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
        self.rudder = rudder_on(record, train)
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

    def found(self, z: FloatArray, rounds: int = 12) -> Path:
        """Return path and loss at the vector, the search beginning at the latest best path."""
        rates, weather, train = self.opened(z)
        rudder = rudder_on(self.record, train) if self.parts else self.rudder
        path = best_path(rates, weather, self.record_at(z), rudder, self.path, rounds)
        return path._replace(loss=path.loss + self.before(z))

    def slope(self, z: FloatArray, boat_only: bool = False, informed: bool = True) -> Slope:
        """Return the loss at the vector, its derivatives, and the information about what moves the boat, rates and
        train, had the path to be found anew for each; a loss of inf where no path is found. Later searches begin at
        this path. boat_only: the weather's derivatives are left at 0; informed: False leaves the information out."""
        path = self.found(z)
        slope = np.zeros_like(z)
        if path.factor is None:
            return math.inf, slope, np.eye(len(self.boat))
        self.path = path.states
        rates, weather, train = self.opened(z)
        rudder = rudder_on(self.record, train) if self.parts else self.rudder
        record = self.record_at(z)
        noise = noise_of(weather, record)
        try:
            held = held_at(path, rates, record, noise)
        except np.linalg.LinAlgError:
            return math.inf, slope, np.eye(len(self.boat))
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
        return path.loss, slope, known + np.diag([self.curvature_before(i) for i in self.boat])

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
        now, record = rudder_on(self.record, train) if self.parts else self.rudder, self.record_at(z)
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
        driven = 2.0 * M - worth.driven
        slopes = {
            "gust": M + segments - worth.gust - float(worth.first[2]),
            "white": driven * noise.by_white,
            "gyro": record.rates_known - worth.gyro,
            "compass": record.headings_known - worth.compass,
        }
        slopes["compass" if record.headings_known else "gyro"] += driven * noise.by_instrument
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


def maximised(space: Space, start: FloatArray) -> tuple[FloatArray, float, FloatArray]:
    """Return the vector of the least loss near `start`, the loss, and the curvature there.

    A quasi-Newton search in coordinates in which the curvature is about one; begun anew, with the curvature where it
    ended, until it stays.
    """
    z, loss = approached(space, start)
    steps = np.full(z.size, FIRST_STEP)
    for _ in range(STAGES):
        curvature, slope = _curvature(space, z, steps)
        axes = _axes(curvature)
        if 0.5 * float(np.sum((axes.T @ slope) ** 2)) < STAYS:
            break
        steps = np.clip(BESIDE / np.sqrt(np.maximum(np.diag(curvature), 1.0)), FIRST_STEP, BESIDE)
        z, loss = searched(space, z, axes, loss)
    return z, loss, curvature


def approached(space: Space, start: FloatArray) -> tuple[FloatArray, float]:
    """Return a vector near the one of the least loss, and the loss there.

    What the record tells of the boat goes with the weather, by orders of magnitude in a calm: by turns a step of
    Newton's to the boat in the weather so far, and some of a quasi-Newton search with axes that suit that boat.
    """
    z, loss = start, space.keep(start)
    for _ in range(TURNS):
        before = loss
        _, slope, known = space.slope(z, boat_only=True)
        at, path = z.copy(), space.path
        step = inverse(known) @ slope[space.boat]
        # delay and lag are no straight lines, and a boat that turns against its rudder is another one
        at[space.boat] -= step / max(1.0, float(np.max(np.abs(np.append(step[0], step[4:])))) / LARGEST_CHANGE)
        there = space.keep(at)
        if there < loss:
            z, loss = at, there
            known = space.slope(z, boat_only=True)[2]
        else:
            space.path = path
        z, loss = searched(space, z, _first_axes(space, known), loss, A_TURN)
        if before - loss < A_TURN_GAINS:
            break
    return z, loss


LARGEST_CHANGE = 0.5
"""Of the logarithms of the rudder's way in a step of Newton's, and of K/T as a share of what is guessed."""
TURNS, A_TURN, A_TURN_GAINS = 10, 6, 1.0
"""Turns at most, iterations in each, and what one must gain of the likelihood's logarithm for another to follow."""


def _first_axes(space: Space, known: FloatArray) -> FloatArray:
    """Return axes along which the curvature is about one, before it is known: of the boat by what the record tells of
    it in that weather, of instruments by the number of their samples."""
    scale = np.full(space.start.size, USUAL_DOUBT)
    samples = {"gyro": space.record.rates_known, "compass": space.record.headings_known}
    for name, count in samples.items():
        if name in space.names:
            scale[space.names.index(name)] = (2.0 * count) ** -0.5
    axes = np.diag(scale)
    axes[np.ix_(space.boat, space.boat)] = _axes(known)
    return axes


USUAL_DOUBT = 0.3
"""Of the logarithm of a gust's size, before it is known."""


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


ROUNDING = 1.0e-10
"""Least share of the largest eigenvalue that is not taken for rounding."""


def searched(
    space: Space, z: FloatArray, axes: FloatArray, loss: float, most: int = ITERATIONS
) -> tuple[FloatArray, float]:
    """Return the vector of the least loss found along `axes` from `z` in so many iterations at `most`, and the loss."""
    best, least = z, loss

    def both(u: FloatArray) -> tuple[float, FloatArray]:
        nonlocal best, least
        at, before = z + axes @ u, space.path
        found, slope, _ = space.slope(at, informed=False)
        if found < least:
            best, least = at, found
        else:
            space.path = before
        if not math.isfinite(found):
            return 1.0e10, np.zeros_like(u)
        return found, axes.T @ slope

    minimize(both, np.zeros(z.size), jac=True, method="L-BFGS-B", options={"maxiter": most, "maxls": 8, "gtol": 0.1})
    return best, least


def _curvature(space: Space, z: FloatArray, steps: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the second derivatives of the loss, and the slope: among the boat's numbers what is known of them, all
    others by differences of slopes."""
    H = np.zeros((z.size, z.size))
    space.keep(z)
    _, here, known = space.slope(z)
    before, sky = space.path, space.sky
    for i in sky:
        at = z.copy()
        at[i] += steps[i]
        space.path = before
        H[:, i] = (space.slope(at, informed=False)[1] - here) / steps[i]
    space.path = before
    H[np.ix_(sky, sky)] = 0.5 * (H[np.ix_(sky, sky)] + H[np.ix_(sky, sky)].T)
    H[np.ix_(sky, space.boat)] = H[np.ix_(space.boat, sky)].T
    H[np.ix_(space.boat, space.boat)] = known
    return np.asarray(np.nan_to_num(H, nan=1.0e6, posinf=1.0e6, neginf=-1.0e6)), here
