"""The residuals of an output-error fit and their derivatives, in a scaled vector of order one.

The vector z holds the free parameters (log of gain and time constant; n3 and n0 in units of the typical rate),
then per segment the initial rate in that unit, then per segment the initial heading.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from autopilot.identification.noise import Noise, instrument_noise
from autopilot.identification.runs import FloatArray, Segment
from autopilot.identification.simulation import Forcing, at_samples, simulate, stack
from autopilot.models.norrbin import Norrbin

DIFFERENCE_STEP = 1.0e-6
"""Step of the finite differences in the scaled vector."""

LOG_BOUND = 25.0
"""Logarithms of K and T beyond this are held: no boat is there, and exp must not overflow."""


@dataclass(frozen=True)
class Problem:
    """Segments, how they are integrated, the model's fixed part, the names that are free, and the rate scale."""

    segments: tuple[Segment, ...]
    forcing: Forcing
    base: Norrbin
    free: tuple[str, ...]
    typical_rate: float
    memory: dict[bytes, list[tuple[FloatArray, FloatArray]]] = field(default_factory=dict, repr=False)
    """The latest response by its vector: minimiser, noise and standard errors ask for the same one in turn."""

    def model(self, z: FloatArray) -> Norrbin:
        """Return the model that the vector stands for."""
        values = {name: _unscale(name, float(z[i]), self.typical_rate) for i, name in enumerate(self.free)}
        return self.base._replace(**values)

    def vector(self, states: Sequence[tuple[float, float]]) -> FloatArray:
        """Return the vector of the base model and the initial states (rate [rad/s], heading [rad])."""
        shared = [_scale(name, getattr(self.base, name), self.typical_rate) for name in self.free]
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

    def _simulated(self, z: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
        F, S = len(self.free), len(self.segments)
        shifted = np.tile(z, (F + 2, 1))
        shifted[np.arange(1, F + 1), np.arange(F)] += DIFFERENCE_STEP
        shifted[F + 1, F : F + S] += DIFFERENCE_STEP
        models = stack([self.model(row) for row in shifted])
        trajectory = simulate(models, self.forcing, shifted[:, F : F + S].T * self.typical_rate)
        result = []
        for s, segment in enumerate(self.segments):
            rate = at_samples(trajectory.rate, self.forcing, self.segments, s)
            heading = at_samples(trajectory.turned, self.forcing, self.segments, s) + z[F + S + s]
            simulated = np.stack([rate, heading], axis=1)
            slope = np.zeros((segment.time.size, 2, F + 2))
            slope[:, :, : F + 1] = (simulated[:, :, 1:] - simulated[:, :, :1]) / DIFFERENCE_STEP
            slope[:, 1, F + 1] = 1.0
            result.append((simulated[:, :, 0] - np.stack([segment.rate, segment.heading], axis=1), slope))
        return result

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


def _scale(name: str, value: float, typical_rate: float) -> float:
    if name in ("gain", "time_constant"):
        return float(np.log(value))
    return value * typical_rate**2 if name == "n3" else value / typical_rate


def _unscale(name: str, z: float, typical_rate: float) -> float:
    if name in ("gain", "time_constant"):
        return float(np.exp(np.clip(z, -LOG_BOUND, LOG_BOUND)))
    return z / typical_rate**2 if name == "n3" else z * typical_rate


def physical_scale(model: Norrbin, free: Sequence[str], typical_rate: float) -> FloatArray:
    """Return d(parameter)/dz, shape (F,): what turns scaled standard errors into those of the parameters."""
    factors = {"gain": model.gain, "time_constant": model.time_constant, "n3": typical_rate**-2, "n0": typical_rate}
    return np.array([factors[name] for name in free])


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
