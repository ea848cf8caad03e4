"""Where a fit begins: the best of a grid of time constants, for each of which the linear model is solved outright."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.identification.residuals import initial_state
from autopilot.identification.runs import FloatArray, Run, Segment
from autopilot.identification.simulation import at_samples, forcing, simulate, stack
from autopilot.models.norrbin import Norrbin

GRID_POINTS = 24
PAST_THE_BEST = 5
STEPS_PER_TIME_CONSTANT = 4.0
SHORTEST_TIME_CONSTANT_S = 0.05
LONGEST_TIME_CONSTANT_S = 500.0


class StartingPoint(NamedTuple):
    """A linear model near the best one, and the share of the motion's variance that it explains.

    The gain is negative where the record's rudder turns the boat to the other side.
    """

    model: Norrbin
    explained: float


def starting_point(runs: Sequence[Run], reference_speed: float) -> StartingPoint:
    """Return the best linear model on a logarithmic grid of T, from 0.05 s to 500 s.

    With n3 = 0 the motion is linear in K, in n0 and in the initial rate: three simulations per T give them by
    least squares, on yaw rates where measured and on headings elsewhere.
    """
    segments = tuple(segment for run in runs for segment in run.segments)
    duration = max(float(segment.time[-1] - segment.time[0]) for segment in segments)
    longest = max(min(LONGEST_TIME_CONSTANT_S, duration), 2.0 * SHORTEST_TIME_CONSTANT_S)
    # from the slow end, where steps are long: a short T costs most and is seldom worth trying
    tried: list[StartingPoint] = []
    for T in np.geomspace(longest, SHORTEST_TIME_CONSTANT_S, GRID_POINTS):
        tried.append(_linear_fit(segments, float(T), reference_speed))
        best = max(tried, key=lambda point: point.explained)
        if len(tried) - tried.index(best) > PAST_THE_BEST:
            break
    return best


def _linear_fit(segments: Sequence[Segment], T: float, reference_speed: float) -> StartingPoint:
    unit = Norrbin(1.0, T, reference_speed=reference_speed)
    models = stack([unit, unit._replace(gain=0.0, n0=-1.0), unit._replace(gain=0.0)])
    states = [initial_state(segment) for segment in segments]
    starts = np.array([[0.0, 0.0, rate] for rate, _ in states])
    steps = forcing(segments, T / STEPS_PER_TIME_CONSTANT)
    trajectory = simulate(models, steps, starts)
    lefts, columns = [], []
    for s, segment in enumerate(segments):
        measured_rate = bool(np.isfinite(segment.rate).any())
        response = at_samples(trajectory.rate if measured_rate else trajectory.turned, steps, segments, s)
        measured = segment.rate if measured_rate else segment.heading - states[s][1]
        known = np.isfinite(measured)
        lefts.append(measured[known] - response[known, 2])
        columns.append(response[known, :2])
    return _solve(np.concatenate(columns), np.concatenate(lefts), T, reference_speed)


def _solve(columns: FloatArray, left: FloatArray, T: float, reference_speed: float) -> StartingPoint:
    gain, n0 = np.linalg.lstsq(columns, left, rcond=None)[0]
    rest = float(np.sum((left - columns @ np.array([gain, n0])) ** 2))
    without = left - columns[:, 1] * (columns[:, 1] @ left / max(float(columns[:, 1] @ columns[:, 1]), 1e-300))
    total = float(np.sum(without**2))
    explained = 1.0 - rest / total if total > 0.0 else 0.0
    return StartingPoint(Norrbin(float(gain), T, n0=-float(n0), reference_speed=reference_speed), explained)
