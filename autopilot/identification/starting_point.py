"""Where a fit begins: the best of a grid of time constants, for each of which the linear model is solved outright."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from autopilot.identification.residuals import initial_state, triangle, typical_rate
from autopilot.identification.runs import FloatArray, Run, Segment, shortest_time_constant
from autopilot.identification.simulation import RATE_BOUND_RAD_S, Forcing, at_samples, forcing, linear_responses
from autopilot.models.norrbin import SPEED_FLOOR_RATIO, Norrbin, at_speed_ratio, yaw_acceleration

GRID_POINTS = 18
EVERY = 2
"""Every so many points of the grid are tried first, and then those beside the best."""
PAST_THE_BEST = 4
STEPS_PER_TIME_CONSTANT = 4.0
ROUGH_STEPS = 2.0
"""The same on the grid of linear models: exact to a few thousandths, which is enough to begin with."""
SHORTEST_TIME_CONSTANT_S = 0.05
LONGEST_TIME_CONSTANT_S = 500.0


LARGEST_TABLE = 4_000_000
"""Numbers that the motions of models simulated side by side may take."""

WELL_EXPLAINED = 0.8
"""Share of the motion from which on a best T that lies behind is believed."""


class StartingPoint(NamedTuple):
    """A linear model near the best one, and the share of the motion's variance that it explains.

    The gain is negative where the record's rudder turns the boat to the other side.
    """

    model: Norrbin
    explained: float


def starting_point(runs: Sequence[Run], reference_speed: float) -> StartingPoint:
    """Return the best linear model on a logarithmic grid of T, from 0.05 s, or what the samples tell, to 500 s.

    With n3 = 0 the motion is linear in K, in n0 and in the initial rates: three simulations per T give them by
    least squares, on yaw rates where measured and on headings elsewhere.
    """
    segments = tuple(segment for run in runs for segment in run.segments)
    duration = max(float(segment.time[-1] - segment.time[0]) for segment in segments)
    longest = max(min(LONGEST_TIME_CONSTANT_S, duration), 2.0 * SHORTEST_TIME_CONSTANT_S)
    grid = np.geomspace(longest, SHORTEST_TIME_CONSTANT_S, GRID_POINTS).tolist()
    shortest = shortest_time_constant(segments)
    times = [T for T in grid if shortest <= T] or [shortest]
    # from the slow end, where steps are long: a short T costs most and is seldom worth trying
    tried: dict[int, StartingPoint] = {}
    for index in range(0, len(times), EVERY):
        tried[index] = _linear_fit(segments, times[index], reference_speed)
        best = max(tried, key=lambda at: tried[at].explained)
        # a regular zigzag is explained by half by a slow boat that turns the wrong way: no reason to stop there
        found = tried[best].model.gain > 0.0 and tried[best].explained > WELL_EXPLAINED
        if found and index - best >= PAST_THE_BEST:
            break
    for index in range(max(best - EVERY + 1, 0), min(best + EVERY, len(times))):
        if index not in tried:
            tried[index] = _linear_fit(segments, times[index], reference_speed)
    return max(tried.values(), key=lambda point: point.explained)


def unstable_starting_point(runs: Sequence[Run], linear: Norrbin) -> Norrbin:
    """Return a course-unstable model (n1 = -1) near the best one, on a grid around the linear model.

    K and T are tried from a quarter to four times those of `linear`, n3 so that the boat left alone would turn
    at a third to three times the typical rate: -r + n3 r^3 = 0 at r = n3^(-1/2).
    """
    segments = tuple(segment for run in runs for segment in run.segments)
    rate = typical_rate(segments)
    factors = np.geomspace(0.25, 4.0, 7)
    candidates = [
        linear._replace(
            gain=linear.gain * k, time_constant=linear.time_constant * t, n1=-1.0, n3=1.0 / (turn * rate) ** 2
        )
        for k in factors
        for t in factors
        for turn in np.geomspace(1.0 / 3.0, 3.0, 7)
    ]
    steps = forcing(segments, linear.time_constant * float(factors[0]) / STEPS_PER_TIME_CONSTANT)
    states = [initial_state(segment) for segment in segments]
    together = max(LARGEST_TABLE // (steps.step.size + 1), 1)
    misfits = [
        _misfits(candidates[first : first + together], segments, steps, states)
        for first in range(0, len(candidates), together)
    ]
    return candidates[int(np.argmin(np.concatenate(misfits)))]


def _misfits(
    candidates: Sequence[Norrbin], segments: Sequence[Segment], steps: Forcing, states: Sequence[tuple[float, float]]
) -> FloatArray:
    """Return the sum of squared errors of each candidate, all of them simulated side by side."""
    rate, turned = _side_by_side(candidates, steps, [start for start, _ in states])
    total = np.zeros(len(candidates))
    for s, segment in enumerate(segments):
        measured_rate = bool(np.isfinite(segment.rate).any())
        measured = segment.rate if measured_rate else segment.heading - states[s][1]
        left, share = steps.samples[s]
        nodes = rate if measured_rate else turned
        response = nodes[left] * (1.0 - share)[:, None] + nodes[left + 1] * share[:, None]
        total += np.nansum((response - measured[:, None]) ** 2, axis=0)
    return total


@np.errstate(over="ignore", invalid="ignore")  # a model that runs away is bounded, not an accident
def _side_by_side(
    candidates: Sequence[Norrbin], steps: Forcing, initial: Sequence[float]
) -> tuple[FloatArray, FloatArray]:
    """Return rate [rad/s] and angle turned [rad] of each candidate at the nodes, both of shape (M+S, candidates), by
    Runge and Kutta's steps."""
    columns = np.array(candidates).T
    model = Norrbin(*columns)
    ratio = np.maximum(np.abs(steps.speed) / candidates[0].reference_speed, SPEED_FLOOR_RATIO)
    rate = np.zeros((steps.step.size + steps.first.size, len(candidates)))
    turned = np.zeros_like(rate)
    rate[steps.first] = np.array(initial)[:, None]
    drives = zip(steps.begin.tolist(), steps.step.tolist(), steps.rudder.T.tolist(), ratio.T.tolist(), strict=True)
    for node, h, rudder, scale in drives:
        boats = [at_speed_ratio(model, each) for each in scale]
        r: Any = rate[node]
        k1 = yaw_acceleration(boats[0], r, rudder[0])
        k2 = yaw_acceleration(boats[1], r + 0.5 * h * k1, rudder[1])
        k3 = yaw_acceleration(boats[1], r + 0.5 * h * k2, rudder[1])
        k4 = yaw_acceleration(boats[2], r + h * k3, rudder[2])
        moved = r + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        rate[node + 1] = np.nan_to_num(np.clip(moved, -RATE_BOUND_RAD_S, RATE_BOUND_RAD_S), nan=RATE_BOUND_RAD_S)
        turned[node + 1] = turned[node] + h * (r + h / 6.0 * (k1 + k2 + k3))
    return rate, turned


def _linear_fit(segments: Sequence[Segment], T: float, reference_speed: float) -> StartingPoint:
    unit = Norrbin(1.0, T, reference_speed=reference_speed)
    steps = forcing(segments, T / ROUGH_STEPS)
    responses = linear_responses(unit, steps)
    rows = []
    for s, segment in enumerate(segments):
        measured_rate = bool(np.isfinite(segment.rate).any())
        response = [at_samples(motion[0 if measured_rate else 1], steps, s) for motion in responses]
        measured = segment.rate if measured_rate else segment.heading - initial_state(segment)[1]
        known = np.isfinite(measured)
        start = np.full(measured.size, 0.0 if measured_rate else 1.0)
        own = triangle(np.stack([*response, start, measured], axis=1)[known])
        row = np.zeros((own.shape[0], 2 + 2 * len(segments) + 1))
        row[:, [0, 1, 2 + 2 * s, 3 + 2 * s, -1]] = own
        rows.append(row)
    table = np.concatenate(rows)
    return _solve(table[:, :-1], table[:, -1], unit)


def _solve(columns: FloatArray, left: FloatArray, unit: Norrbin) -> StartingPoint:
    """Columns: the responses to K = 1 and to n0 = -1, then to each segment's initial rate and heading."""
    coefficients = np.linalg.lstsq(columns, left, rcond=None)[0]
    rest = float(np.sum((left - columns @ coefficients) ** 2))
    others = columns[:, 1:]
    total = float(np.sum((left - others @ np.linalg.lstsq(others, left, rcond=None)[0]) ** 2))
    explained = 1.0 - rest / total if total > 0.0 else 0.0
    return StartingPoint(unit._replace(gain=float(coefficients[0]), n0=-float(coefficients[1])), explained)
