"""The residuals of an output-error fit and their derivatives, in a scaled vector of order one.

The vector z holds the free parameters (log of gain and time constants; the others in units that make them of
order one), then per segment the initial rate in that unit, then per segment the initial heading.

How large residuals are, how long they remember, and what that makes of the standard errors.

A trim of each run's own: what wind and current are worth differs between recordings.

An n0 of its own is, at all speeds, a rudder angle that the run's rudder stands off by: K delta - n0 = K (delta + t) -
n0', for K and n0 both go with the speed. The angles t of R runs are fitted as R - 1 orthogonal contrasts that add up to
nothing, beside the n0 that the runs have on average; they are nuisance parameters, of no use for another day.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, cast

import numpy as np
from scipy.linalg import helmert

from autopilot.identification.rudder_path import DIRECT, RudderTrain
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.identification.simulation import Forcing, Trajectory, at_samples, rudder_behind, simulate, slopes
from autopilot.models.norrbin import Norrbin
from autopilot.models.weather import RaceAndWind

LONGEST_MEMORY = 0.9999
"""Lag-one correlations are held below this: at one, the weight would vanish altogether."""

SMALLEST_NOISE = 1.0e-9
"""Residuals [rad/s, rad] of an exact record are taken to be this large, so that no weight is infinite."""


class Noise(NamedTuple):
    """Residuals of one instrument: root mean square [rad/s or rad] and lag-one correlation; nan where absent."""

    size: float
    correlation: float

    @property
    def weight(self) -> float:
        """1/s with s^2 = size^2 (1 + correlation)/(1 - correlation); 0 where the instrument is absent."""
        if not self.size > 0.0:
            return 0.0
        return float(np.sqrt((1.0 - self.correlation) / (1.0 + self.correlation)) / self.size)


def residual_noise(residuals: Sequence[FloatArray]) -> Noise:
    """Return the Noise of one instrument from its residuals, one array per segment, nan where not measured."""
    known = np.concatenate([values[np.isfinite(values)] for values in residuals])
    if known.size == 0:
        return Noise(float("nan"), float("nan"))
    size = max(float(np.sqrt(np.mean(known**2))), SMALLEST_NOISE)
    pairs = [values[:-1] * values[1:] for values in residuals]
    neighbours = np.concatenate([products[np.isfinite(products)] for products in pairs])
    correlation = float(np.mean(neighbours)) / size**2 if neighbours.size else 0.0
    return Noise(size, min(max(correlation, 0.0), LONGEST_MEMORY))


def instrument_noise(values: FloatArray) -> float:
    """Return the white noise [unit of `values`] of a smooth signal, from its second differences.

    Second differences of white noise of standard deviation s have standard deviation sqrt(6) s, and those of a
    well-sampled motion are small; a motion sampled too coarsely makes the answer too large, never too small.
    """
    known = values[np.isfinite(values)]
    if known.size < 3:
        return float("inf")
    return max(float(np.sqrt(np.mean(np.diff(known, 2) ** 2) / 6.0)), SMALLEST_NOISE)


def robust_covariance(jacobians: Sequence[FloatArray], residuals: Sequence[FloatArray]) -> FloatArray:
    """Return the covariance, shape (F, F), of a least-squares estimate whose residuals are correlated.

    jacobians: per segment, weighted, shape (N, 2, F); residuals: the same, shape (N, 2). The sandwich
    A^-1 B A^-1 with A = J'J and B the long-run covariance of the scores J' e, by Newey and West (1987) with
    Bartlett weights and the bandwidth of Andrews (1991) for a first-order process, one segment after another.
    """
    F = jacobians[0].shape[2]
    A = np.zeros((F, F))
    B = np.zeros((F, F))
    scores = [np.einsum("ncf,nc->nf", J, e) for J, e in zip(jacobians, residuals, strict=True)]
    bandwidth = _bandwidth(scores)
    for J, score in zip(jacobians, scores, strict=True):
        flat = J.reshape(-1, F)
        A += flat.T @ flat
        B += _long_run(score, bandwidth)
    inverse = np.linalg.pinv(A, rcond=1.0e-14)
    return np.asarray(inverse @ B @ inverse)


def _bandwidth(scores: Sequence[FloatArray]) -> float:
    """Return Andrews' bandwidth [samples] for Bartlett weights: 1.1447 (alpha N)^(1/3), alpha from AR(1) fits."""
    now = np.concatenate([score[1:] for score in scores])
    before = np.concatenate([score[:-1] for score in scores])
    power = np.sum(before**2, axis=0)
    rho = np.sum(now * before, axis=0)[power > 0.0] / power[power > 0.0]
    rho = np.clip(rho, 0.0, 0.99)
    alpha = float(np.mean(4.0 * rho**2 / ((1.0 - rho) ** 2 * (1.0 + rho) ** 2))) if rho.size else 0.0
    return float(1.1447 * (alpha * now.shape[0]) ** (1.0 / 3.0))


def _long_run(score: FloatArray, bandwidth: float) -> FloatArray:
    """Return the Bartlett-weighted sum of a segment's score autocovariances, times its length: shape (F, F)."""
    N = score.shape[0]
    total = score.T @ score
    for lag in range(1, min(int(bandwidth), N - 1) + 1):
        lagged = score[lag:].T @ score[:-lag]
        total += (1.0 - lag / (bandwidth + 1.0)) * (lagged + lagged.T)
    return np.asarray(total)


Trim = Literal["common", "per-run"]
"""One n0 for all runs, or one for each."""

PREFIX = "trim_"
TYPICAL_TRIM_RAD = 0.02


class RunTrims(NamedTuple):
    """owners: per segment the number of its run. values [rad]: of the contrasts, one less than there are runs."""

    owners: tuple[int, ...] = ()
    values: tuple[float, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """What the contrasts are called among the parameters that are free."""
        return tuple(f"{PREFIX}{number}" for number in range(len(self.values)))

    @property
    def angles(self) -> FloatArray:
        """The rudder angle [rad] that each run has beside the others, shape (R,)."""
        return np.asarray(_contrasts(len(self.values)) @ np.array(self.values))

    def shares(self) -> FloatArray:
        """Return how much of each contrast each segment has, shape (S, R - 1)."""
        return _contrasts(len(self.values))[list(self.owners)]

    def of_segments(self) -> FloatArray:
        """Return the angle [rad] of each segment, shape (S,)."""
        return self.angles[list(self.owners)]


NO_TRIMS = RunTrims()
"""All runs share one n0."""


def own_trims(runs: Sequence[Run], trim: Trim) -> RunTrims:
    """Return trims of 0 for each run, or none at all where all share one or there is one run alone."""
    if trim == "common" or len(runs) < 2:
        return NO_TRIMS
    owners = tuple(number for number, run in enumerate(runs) for _ in run.segments)
    return RunTrims(owners, (0.0,) * (len(runs) - 1))


def _contrasts(count: int) -> FloatArray:
    """Return orthonormal columns that add up to 0, shape (R, R - 1), R = `count` + 1."""
    return np.asarray(helmert(count + 1).T, dtype=np.float64)


DIFFERENCE_STEP = 1.0e-6
"""Step of the finite differences in the scaled vector."""

BLOCK_ROWS = 512

TYPICAL_DEAD_BAND = 0.02
"""A play of the steering gear [rad] that one would notice."""

LOGARITHMIC = ("gain", "time_constant", "drift_time")

LOG_BOUND = 25.0
"""Logarithms of K and T beyond this are held: no boat is there, and exp must not overflow."""


class Fitted(NamedTuple):
    """All that a fit may change: the model, what propeller, wind and drift add, the way from the recorded rudder to the
    water, and the runs' own trims."""

    model: Norrbin
    around: RaceAndWind = RaceAndWind()
    train: RudderTrain = DIRECT
    trims: RunTrims = NO_TRIMS


@dataclass(frozen=True)
class Problem:
    """Segments, how they are integrated, what the fit begins with, the names that are free, and their scales."""

    segments: tuple[Segment, ...]
    forcing: Forcing
    base: Fitted
    free: tuple[str, ...]
    typical_rate: float
    units: dict[str, float]
    memory: dict[bytes, list[tuple[FloatArray, FloatArray]]] = field(default_factory=dict, repr=False)
    """The latest response by its vector: minimiser, noise and standard errors ask for the same one in turn."""
    latest: dict[str, Trajectory] = field(default_factory=dict, repr=False)
    """The latest motion: where the search for the next one begins."""

    def fitted(self, z: FloatArray) -> Fitted:
        """Return what the vector stands for."""
        model, around, train, trims = self.base
        return Fitted(
            model._replace(**self._values(z, Norrbin._fields)),
            around._replace(**self._values(z, RaceAndWind._fields)),
            train._replace(**self._values(z, RudderTrain._fields)),
            trims._replace(values=tuple(self._values(z, trims.names).values()) or trims.values),
        )

    def _values(self, z: FloatArray, names: tuple[str, ...]) -> dict[str, float]:
        return {name: self._unscaled(name, float(z[i])) for i, name in enumerate(self.free) if name in names}

    def _unscaled(self, name: str, z: float) -> float:
        if name in LOGARITHMIC:
            return float(np.exp(np.clip(z, -LOG_BOUND, LOG_BOUND)))
        return z * self._unit(name)

    def _unit(self, name: str) -> float:
        return TYPICAL_TRIM_RAD if name.startswith(PREFIX) else self.units[name]

    def _scaled(self, name: str) -> float:
        if name.startswith(PREFIX):
            trims = self.base.trims
            return trims.values[trims.names.index(name)] / TYPICAL_TRIM_RAD
        held = next(part for part in self.base[:3] if name in part._fields)
        value = float(getattr(held, name))
        return float(np.log(value)) if name in LOGARITHMIC else value / self.units[name]

    def parameter_scale(self, z: FloatArray) -> FloatArray:
        """Return d(parameter)/dz, shape (F,): what turns scaled standard errors into those of the parameters."""
        scale = [
            self._unscaled(name, float(z[i])) if name in LOGARITHMIC else self._unit(name)
            for i, name in enumerate(self.free)
        ]
        return np.array(scale)

    def vector(self, states: Sequence[tuple[float, float]]) -> FloatArray:
        """Return the vector of the base model and the initial states (rate [rad/s], heading [rad])."""
        shared = [self._scaled(name) for name in self.free]
        return np.array([*shared, *(rate / self.typical_rate for rate, _ in states), *(psi for _, psi in states)])

    def states(self, z: FloatArray) -> list[tuple[float, float]]:
        """Return the initial states that the vector stands for."""
        S, F = len(self.segments), len(self.free)
        return [(float(z[F + s]) * self.typical_rate, float(z[F + S + s])) for s in range(S)]

    def response(self, z: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        """Return per segment the residuals (N, 2), rate and heading, simulated less measured, and their
        derivatives (N, 2, F + 2) by the free parameters, the initial rate and the initial heading."""
        key = z.tobytes()
        if key not in self.memory:
            self.memory.clear()
            self.memory[key] = self._simulated(z)
        return self.memory[key]

    def _around(self, fitted: Fitted) -> RaceAndWind | None:
        """Return what propeller and wind add, None where they do not count."""
        counts = any(name in RaceAndWind._fields for name in self.free) or self.base.around != RaceAndWind()
        return fitted.around if counts else None

    def _rudder(self, fitted: Fitted) -> FloatArray:
        rudder = rudder_behind(fitted.train, self.forcing)
        if not fitted.trims.values:
            return rudder
        lengths = [moments.shape[1] for moments in self.forcing.moments]
        return rudder + np.repeat(fitted.trims.of_segments(), lengths)

    def _simulated(self, z: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        F, S = len(self.free), len(self.segments)
        moved = [self.fitted(z + DIFFERENCE_STEP * direction) for direction in np.eye(F, z.size)]
        here = self.fitted(z)
        model, around = here.model, self._around(here)
        driven = self.forcing._replace(rudder=self._rudder(here))
        motion = simulate(model, driven, z[F : F + S] * self.typical_rate, around, self.latest.get("motion"))
        self.latest["motion"] = motion
        own = [name for name in self.free if not name.startswith(PREFIX)]
        shifted = [
            (there.model, self._around(there), self._rudder(there) if name in RudderTrain._fields else driven.rudder)
            for name, there in zip(own, moved, strict=False)
        ]
        if len(own) < F:
            # a trim turns its run as the rudder does, and no other run: one derivative serves all of them
            shifted.append((model, around, driven.rudder + DIFFERENCE_STEP))
        derivatives = slopes(model, driven, motion, shifted, DIFFERENCE_STEP, around)
        result = []
        for s, segment in enumerate(self.segments):
            slope = np.zeros((segment.time.size, 2, F + 2))
            for values, columns, scales in zip(derivatives, *self._columns(own, s), strict=True):
                slope[:, 0, columns] = at_samples(values.rate, self.forcing, s)[:, None] * scales
                slope[:, 1, columns] = at_samples(values.turned, self.forcing, s)[:, None] * scales
            slope[:, 1, F + 1] = 1.0
            rate = at_samples(motion.rate, self.forcing, s) - segment.rate
            heading = at_samples(motion.turned, self.forcing, s) + z[F + S + s] - segment.heading
            result.append((np.stack([rate, heading], axis=1), slope))
        return result

    def _columns(self, own: Sequence[str], s: int) -> tuple[list[list[int]], list[FloatArray]]:
        """Return into which columns of segment `s` each derivative goes, and times what."""
        F = len(self.free)
        columns, scales = [[i] for i in range(len(own))], [np.ones(1)] * len(own)
        if len(own) < F:
            columns.append(list(range(len(own), F)))
            scales.append(TYPICAL_TRIM_RAD * self.base.trims.shares()[s])
        return [*columns, [F]], [*scales, np.array([self.typical_rate])]

    def weighted(self, z: FloatArray, noise: Sequence[Noise]) -> list[tuple[FloatArray, FloatArray]]:
        """Return the response times the weights of rate and heading, 0 where nothing was measured."""
        weight = np.array([instrument.weight for instrument in noise])
        result = []
        for values, slope in self.response(z):
            scale = np.isfinite(values) * weight
            result.append((np.where(np.isfinite(values), values, 0.0) * scale, slope * scale[:, :, None]))
        return result

    def anchors(self, z: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the initial states' distance from the first measured ones in units of the instrument noise,
        and what each is divided by: both per segment (rate, heading), shape (S, 2)."""
        spread = np.array([[instrument_noise(s.rate), instrument_noise(s.heading)] for s in self.segments])
        spread[:, 0] /= self.typical_rate
        first = np.array([initial_state(segment) for segment in self.segments])
        first[:, 0] /= self.typical_rate
        F, S = len(self.free), len(self.segments)
        now = np.stack([z[F : F + S], z[F + S :]], axis=1)
        return (now - first) / spread, spread


def units(fitted: Fitted, rate: float, segments: Sequence[Segment]) -> dict[str, float]:
    """Return what each parameter that is not fitted by its logarithm is measured in, given a typical `rate` [rad/s]."""
    base, around = fitted.model, fitted.around
    winds = [np.mean(s.beam_wind**2) + np.mean(s.quarter_wind**2) for s in segments if s.beam_wind.size]
    wind = max(float(np.sqrt(np.mean(winds))), 1.0e-6) if winds else 1.0
    acceleration = rate / base.time_constant
    return {
        "n3": rate**-2,
        "n2": 1.0 / rate,
        "n0": rate,
        "race": (base.reference_speed / max(around.reference_propeller, 1.0e-6)) ** 2,
        "wind_beam": acceleration / wind,
        "wind_quarter": acceleration / wind,
        "steady_race": base.reference_speed**2,
        "drift": 1.0,
        "drift_wind": acceleration / wind,
        "dead_band": TYPICAL_DEAD_BAND,
        "delay": base.time_constant,
        "lag": base.time_constant,
        "lead": base.time_constant,
    }


def initial_state(segment: Segment) -> tuple[float, float]:
    """Return the rate [rad/s] and heading [rad] a segment begins with, taken from its first samples.

    Where no rate is measured it is the slope of the first second of headings, of three samples at least; where
    no heading is, it begins with 0.
    """
    rate = segment.rate[np.isfinite(segment.rate)]
    headed = np.flatnonzero(np.isfinite(segment.heading))
    heading = float(segment.heading[headed[0]]) if headed.size else 0.0
    if rate.size:
        return float(rate[0]), heading
    first = headed[: max(3, int(np.count_nonzero(segment.time[headed] <= segment.time[headed[0]] + 1.0)))]
    slope = np.polyfit(segment.time[first] - segment.time[first[0]], segment.heading[first], 1)[0]
    return float(slope), heading


def typical_rate(segments: Sequence[Segment]) -> float:
    """Return a typical size [rad/s] of the yaw rate in the record, never zero."""
    squares: list[float] = []
    for segment in segments:
        if np.isfinite(segment.rate).any():
            squares.append(float(np.nanmean(segment.rate**2)))
        else:
            known = np.isfinite(segment.heading)
            squares.append(float(np.mean(np.gradient(segment.heading[known], segment.time[known]) ** 2)))
    return max(float(np.sqrt(np.mean(squares))), 1.0e-6)


def triangle(table: FloatArray) -> FloatArray:
    """Return R of table = Q R, shape (C, C), for a tall table of C columns: all that least squares asks of it.

    A block of rows at a time, then the blocks' triangles together: that stays inside the processor's cache.
    """
    columns = table.shape[1]
    blocks = -(-table.shape[0] // BLOCK_ROWS)
    padded = np.zeros((blocks * BLOCK_ROWS, columns))
    padded[: table.shape[0]] = table
    triangles = cast(FloatArray, np.linalg.qr(padded.reshape(blocks, BLOCK_ROWS, columns), mode="r"))
    return cast(FloatArray, np.linalg.qr(triangles.reshape(-1, columns), mode="r"))
