"""The residuals of an output-error fit and their derivatives, in a scaled vector of order one.

The vector z holds the free parameters (log of gain and time constants; the others in units that make them of
order one), then per segment the initial rate in that unit, then per segment the initial heading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from autopilot.identification.forcing import Forcing, at_samples, rudder_behind
from autopilot.identification.noise import Noise, instrument_noise
from autopilot.identification.rudder_path import DIRECT, RudderTrain
from autopilot.identification.run_trim import NO_TRIMS, PREFIX, TYPICAL_TRIM_RAD, RunTrims
from autopilot.identification.runs import FloatArray, Segment
from autopilot.identification.simulation import Trajectory, simulate, slopes
from autopilot.identification.whitening import Gusts, bridged, innovations
from autopilot.models.norrbin import Norrbin
from autopilot.models.race_and_wind import RaceAndWind

DIFFERENCE_STEP = 1.0e-6
"""Step of the finite differences in the scaled vector."""

BLOCK_ROWS = 512

TYPICAL_DEAD_BAND = 0.02
"""A play of the steering gear [rad] that one would notice."""

LOGARITHMIC = ("gain", "time_constant", "drift_time")

LOG_BOUND = 25.0
"""Logarithms of K and T beyond this are held: no boat is there, and exp must not overflow."""


@dataclass(frozen=True)
class Problem:
    """Segments, how they are integrated, the model's fixed part, the names that are free, and their scales."""

    segments: tuple[Segment, ...]
    forcing: Forcing
    base: Norrbin
    around: RaceAndWind
    free: tuple[str, ...]
    typical_rate: float
    units: dict[str, float]
    train: RudderTrain = DIRECT
    trims: RunTrims = NO_TRIMS
    gusts: Gusts | None = None
    """Where residuals are weighted by how well they could be foretold, what explains them."""
    memory: dict[bytes, list[tuple[FloatArray, FloatArray]]] = field(default_factory=dict, repr=False)
    """The latest response by its vector: minimiser, noise and standard errors ask for the same one in turn."""
    latest: dict[str, Trajectory] = field(default_factory=dict, repr=False)
    """The latest motion: where the search for the next one begins."""

    def model(self, z: FloatArray) -> Norrbin:
        """Return the model that the vector stands for."""
        return self.base._replace(**self._values(z, Norrbin._fields))

    def race_and_wind(self, z: FloatArray) -> RaceAndWind:
        """Return what the vector says of propeller and wind."""
        return self.around._replace(**self._values(z, RaceAndWind._fields))

    def rudder_train(self, z: FloatArray) -> RudderTrain:
        """Return what the vector says of the way from the recorded rudder to the water."""
        return self.train._replace(**self._values(z, RudderTrain._fields))

    def run_trims(self, z: FloatArray) -> RunTrims:
        """Return what the vector says of the runs' own trims."""
        return self.trims._replace(values=tuple(self._values(z, self.trims.names).values()) or self.trims.values)

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
            return self.trims.values[self.trims.names.index(name)] / TYPICAL_TRIM_RAD
        held = next(part for part in (self.base, self.around, self.train) if name in part._fields)
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

    def _around(self, z: FloatArray) -> RaceAndWind | None:
        """Return what the vector says of propeller and wind, None where they do not count."""
        counts = any(name in RaceAndWind._fields for name in self.free) or self.around != RaceAndWind()
        return self.race_and_wind(z) if counts else None

    def _rudder(self, z: FloatArray) -> FloatArray:
        rudder, trims = rudder_behind(self.rudder_train(z), self.forcing), self.run_trims(z)
        if not trims.values:
            return rudder
        lengths = [moments.shape[1] for moments in self.forcing.moments]
        return rudder + np.repeat(trims.of_segments(), lengths)

    def _simulated(self, z: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        F, S = len(self.free), len(self.segments)
        moved = [z + DIFFERENCE_STEP * direction for direction in np.eye(F, z.size)]
        model, around = self.model(z), self._around(z)
        driven = self.forcing._replace(rudder=self._rudder(z))
        motion = simulate(model, driven, z[F : F + S] * self.typical_rate, around, self.latest.get("motion"))
        self.latest["motion"] = motion
        own = [name for name in self.free if not name.startswith(PREFIX)]
        shifted = [
            (self.model(v), self._around(v), self._rudder(v) if name in RudderTrain._fields else driven.rudder)
            for name, v in zip(own, moved, strict=False)
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
            scales.append(TYPICAL_TRIM_RAD * self.trims.shares()[s])
        return [*columns, [F]], [*scales, np.array([self.typical_rate])]

    def weighted(self, z: FloatArray, noise: Sequence[Noise]) -> list[tuple[FloatArray, FloatArray]]:
        """Return the response times the weights of rate and heading, 0 where nothing was measured; with gusts its
        innovations."""
        if self.gusts is not None:
            return [
                self._innovations(segment, *each) for segment, each in zip(self.segments, self.response(z), strict=True)
            ]
        weight = np.array([instrument.weight for instrument in noise])
        result = []
        for values, slope in self.response(z):
            scale = np.isfinite(values) * weight
            result.append((np.where(np.isfinite(values), values, 0.0) * scale, slope * scale[:, :, None]))
        return result

    def _innovations(self, segment: Segment, values: FloatArray, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
        assert self.gusts is not None
        table = bridged(np.concatenate([slope, values[:, :, None]], axis=2))
        new = innovations(table, float(np.median(np.diff(segment.time))), self.gusts)
        new *= np.isfinite(values)[:, :, None]
        return new[:, :, -1], new[:, :, :-1]

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


def units(base: Norrbin, around: RaceAndWind, rate: float, segments: Sequence[Segment]) -> dict[str, float]:
    """Return what each parameter that is not fitted by its logarithm is measured in, given a typical `rate` [rad/s]."""
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
