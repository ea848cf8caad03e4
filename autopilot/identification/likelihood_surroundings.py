"""What besides its rudder turns a boat, in the likelihood of a recording: the propeller's race and wind
(`models.weather`).

    r' = a delta - b r - d r^3 - e + c1 Ua^2 sin g + c2 Ua^2 sin 2g + gusts + noise

a, b, d and e are scaled with the flow past the rudder, W/W0, in place of U/U0. Beforehand wind is about as strong as
the rudder, and the race doubles the rudder's force, within a factor of some: what the runs show is nearly theirs alone,
and what they do not show keeps its doubt, in K and T too.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from autopilot.identification.likelihood_record import Form, Record, Scales, scales_of, without_noise
from autopilot.identification.runs import FloatArray, Segment
from autopilot.models.norrbin import SPEED_FLOOR_RATIO
from autopilot.models.weather import RaceAndWind, inflow_ratio, wind_acceleration

RACE_DOUBT = 1.5
"""The race cannot be below 0 and is searched for by its logarithm: the deviation of that, before a record is known."""
USUAL_RACE = 0.5
"""Of the speed's square: what a race usually adds to the flow past the rudder at the mean revolutions."""


def usual_race(reference_speed: float, reference_propeller: float) -> float:
    """Return the race that is usual at the reference speed [m/s] and revolutions [1/s]."""
    return USUAL_RACE * (reference_speed / max(reference_propeller, 1.0e-9)) ** 2


class Surroundings(NamedTuple):
    """names: of `RaceAndWind`'s fields, what is searched for, beginning at `start`."""

    names: tuple[str, ...]
    start: RaceAndWind


class Beside(NamedTuple):
    """Surroundings on the substeps of a record, shape (S, M): ratio, the speed to the reference [m/s], propeller [1/s],
    and beam and quarter wind [m^2/s^2]. unit [rad/m^2]: of wind that turns the boat as the rudder does."""

    names: tuple[str, ...]
    start: RaceAndWind
    unit: float
    form: Form
    reference_speed: float
    ratio: FloatArray
    propeller: FloatArray
    beam: FloatArray
    quarter: FloatArray

    @property
    def units(self) -> FloatArray:
        """Of each number that is searched for, as it stands in a covariance."""
        return np.array([1.0 if name == "race" else self.unit for name in self.names])

    def opened(self, z: Mapping[str, float]) -> RaceAndWind:
        """Return what the numbers that are searched for stand for."""
        return self.start._replace(
            **{
                name: math.exp(min(max(z[name], -WIDE), WIDE)) if name == "race" else z[name] * self.unit
                for name in self.names
            }
        )

    def closed(self) -> list[float]:
        """Return the numbers that stand for the start."""
        values = [(name, float(getattr(self.start, name))) for name in self.names]
        return [math.log(value) if name == "race" else value / self.unit for name, value in values]

    def turning(self, around: RaceAndWind) -> tuple[Scales, FloatArray]:
        """Return how the boat goes with the flow, and the push [rad/s^2] on it."""
        flow = inflow_ratio(around, self.reference_speed, self.ratio, self.propeller)
        return scales_of(self.form, flow), wind_acceleration(around, self.beam, self.quarter)

    def changes(self, z: Mapping[str, float], by: float) -> list[tuple[Scales, FloatArray]]:
        """Return how scales and push change with each of the numbers, by differences."""
        found = []
        for name in self.names:
            (more, push), (less, pull) = (self.turning(self.opened({**z, name: z[name] + d})) for d in (by, -by))
            scales = Scales(*((one - other) / (2.0 * by) for one, other in zip(more, less, strict=True)))
            found.append((scales, (push - pull) / (2.0 * by)))
        return found


WIDE = 40.0
"""Logarithms beyond this are held."""


def beside_of(
    record: Record,
    segments: Sequence[Segment],
    surroundings: Surroundings,
    reference_speed: float,
    moment: float,
    form: Form,
) -> Beside:
    """Return the surroundings on the record's substeps; moment [rad/s^2]: the rudder's largest."""
    names, start = surroundings
    columns: list[list[FloatArray]] = [[], [], [], []]
    for segment, edges in zip(segments, record.edges, strict=True):
        speed = np.maximum(without_noise(np.abs(segment.speed)) / reference_speed, SPEED_FLOOR_RATIO)
        ahead = np.maximum(segment.propeller, 0.0)
        for column, values in zip(columns, (speed, ahead, segment.beam_wind, segment.quarter_wind), strict=True):
            column.append(_means(edges, segment.time, values, record.substeps))
    ratio, propeller, beam, quarter = (np.concatenate(column, axis=1) for column in columns)
    unit = moment / max(float(np.sqrt(np.mean(np.square([beam, quarter])))), NO_WIND)
    return Beside(names, start, unit, form, reference_speed, ratio, propeller, beam, quarter)


NO_WIND = 1.0e-9
"""A wind whose speed's square [m^2/s^2] is less is none."""


def _means(edges: FloatArray, time: FloatArray, values: FloatArray, substeps: int) -> FloatArray:
    """Return the means over the substeps, shape (S, M), of what is recorded; zeros where nothing is."""
    if not values.size:
        return np.zeros((substeps, (edges.size - 1) // substeps))
    grid = np.union1d(time, edges)
    there = np.interp(grid, time, values)
    area = np.concatenate([[0.0], np.cumsum(0.5 * (there[1:] + there[:-1]) * np.diff(grid))])
    return np.asarray((np.diff(area[np.searchsorted(grid, edges)]) / np.diff(edges)).reshape(-1, substeps).T)
