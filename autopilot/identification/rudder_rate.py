"""How fast the steering gear moves the rudder, from a recorded rudder angle with noise.

A gear that slews draws straight lines from one angle to another. The record is cut into the fewest straight pieces that
stay within its noise (Ramer-Douglas-Peucker), every long piece is fitted by least squares, and the fastest ones that
agree are averaged. What comes out is the fastest that was seen: orders that never asked for more show no more.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.identification.runs import FloatArray, Run, Segment

SMALLEST_TRAVEL = math.radians(2.0)
"""Pieces that move the rudder by less [rad] are corrections, not slewing."""
TRAVEL_NOISES = 8.0
"""Nor are pieces of fewer deviations of the noise."""
FEWEST_SAMPLES = 3
"""So many samples inside a piece, besides its corners, make a slope; fewer may as well be a jump."""
CORNER_NOISES = 3.5
"""A sample further from the line than so many deviations is a corner: one in 2000 by chance."""
ALIKE = 0.15
"""Slopes within this share of the fastest group's are one rate, seen several times."""
FASTEST_SHARE = 0.75
"""The fastest group stands at this quantile of all slopes, weighted by travel: a few flukes are not a rate."""
FEWEST_MOVEMENTS = 3
"""One straight line may be a hand on the wheel, or a gap in the record that was bridged."""
WORST_ERROR = 0.1
"""A slope with a larger standard error, as a share of it, says nothing."""


class RudderRate(NamedTuple):
    """The rudder's rate [rad/s], its standard error [rad/s], and how many movements show it."""

    rate: float
    standard_error: float
    movements: int


class _Slope(NamedTuple):
    rate: float
    error: float
    travel: float


def measured_rudder_rate(segments: Sequence[Segment]) -> RudderRate | None:
    """Return the fastest rate at which the recorded rudder slews; None where the record cannot show one.

    segments: rudder [rad] over time [s]. A rudder that gets from one angle to another between two or three samples
    shows no rate: it moved at that rate or any faster one; fewer than FEWEST_MOVEMENTS are none either.
    """
    slopes = [slope for segment in segments for slope in _slopes(segment.time, segment.rudder)]
    group = _fastest_group(slopes) if slopes else []
    if len(group) < FEWEST_MOVEMENTS:
        return None
    rates = np.array([slope.rate for slope in group])
    weights = np.array([slope.error for slope in group]) ** -2.0
    rate = float(weights @ rates / weights.sum())
    # what the slopes scatter beyond their own errors, the mean carries too
    excess = float(weights @ (rates - rate) ** 2) / max(len(group) - 1, 1)
    error = math.sqrt(max(1.0, excess) / float(weights.sum()))
    return RudderRate(rate, error, len(group))


def rudder_rate_of(runs: Sequence[Run]) -> RudderRate | None:
    """Return the rate at which the rudder moved in the runs that have a sensor on it."""
    return measured_rudder_rate([segment for run in runs if run.rudder == "measured" for segment in run.segments])


def rate_sentence(rate: RudderRate) -> str:
    """Return a measured rudder rate in words."""
    return (
        f"{math.degrees(rate.rate):.3g} +- {math.degrees(rate.standard_error):.1g} deg/s over {rate.movements} "
        f"movement{'s' if rate.movements > 1 else ''}"
    )


def _fastest_group(slopes: Sequence[_Slope]) -> list[_Slope]:
    ordered = sorted(slopes, key=lambda slope: slope.rate)
    reach = np.cumsum([slope.travel for slope in ordered])
    middle = ordered[int(np.searchsorted(reach, FASTEST_SHARE * reach[-1]))].rate
    return [slope for slope in ordered if abs(slope.rate - middle) <= ALIKE * middle]


def _slopes(time: FloatArray, rudder: FloatArray) -> list[_Slope]:
    """Return the slope of every straight piece of a stretch that is long enough to be slewing."""
    if time.size < FEWEST_SAMPLES + 2:
        return []
    noise = _noise(rudder)
    least = max(SMALLEST_TRAVEL, TRAVEL_NOISES * noise)
    corners = _corners(time, rudder, max(CORNER_NOISES * noise, 0.05 * SMALLEST_TRAVEL))
    pieces = [
        _slope(time[first : last + 1], rudder[first : last + 1], noise)
        for first, last in itertools.pairwise(corners)
        if abs(rudder[last] - rudder[first]) >= least
    ]
    return [slope for slope in pieces if slope is not None]


def _slope(time: FloatArray, rudder: FloatArray, noise: float) -> _Slope | None:
    """Return the least-squares slope between two corners; both lie beside the straight part by up to one sample."""
    inside = slice(1, -1)
    if time[inside].size < FEWEST_SAMPLES:
        return None
    moments, angles = time[inside] - time[inside].mean(), rudder[inside]
    spread = float(moments @ moments)
    rate = float(moments @ angles) / spread
    residual = angles - angles.mean() - rate * moments
    scatter = math.sqrt(float(residual @ residual) / max(angles.size - 2, 1))
    error = max(scatter, noise, 1.0e-6) / math.sqrt(spread)
    travel = abs(float(rudder[-1] - rudder[0]))
    return None if error > WORST_ERROR * abs(rate) else _Slope(abs(rate), error, travel)


def _noise(rudder: FloatArray) -> float:
    """Return the standard deviation of the noise [rad] from second differences, which straight lines do not have.

    Their median keeps corners out of it; 0.6745 is a normal distribution's median of absolute values, 6 the variance
    of a second difference of white noise.
    """
    return float(np.median(np.abs(np.diff(rudder, 2)))) / (0.6745 * math.sqrt(6.0))


def _corners(time: FloatArray, rudder: FloatArray, tolerance: float) -> list[int]:
    """Return the indices between which straight lines stay within `tolerance` [rad] of the record."""
    corners, stack = [0, time.size - 1], [(0, time.size - 1)]
    while stack:
        first, last = stack.pop()
        if last - first < 2:
            continue
        line = np.interp(time[first : last + 1], time[[first, last]], rudder[[first, last]])
        away = np.abs(rudder[first : last + 1] - line)
        at = int(np.argmax(away))
        if away[at] > tolerance:
            corners.append(first + at)
            stack += [(first, first + at), (first + at, last)]
    return sorted(set(corners))
