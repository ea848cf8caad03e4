"""What a ship is measured by in its trials: zigzag, turning circle, pull-out, spiral.

Definitions: IMO MSC.137(76), annex, section 4.2 (advance, tactical diameter, overshoot angles), and ITTC 7.5-04-02-01,
Full Scale Manoeuvring Trials (times of the zigzag, transfer, steady turn, pull-out, spiral). The rudder is executed
when it begins to move; angles are counted from the heading at that moment. Positions are the recorder's own place.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.identification.runs import FloatArray
from autopilot.identification.trial_record import (
    STEADY_PART,
    Hold,
    TrialRecord,
    crossing,
    first_row,
    holds_of,
    is_steady,
    speed_before,
    steady_rate,
    stretches_of,
    value_at,
    way_of,
)

QUARTER, HALF, FULL = 0.5 * math.pi, math.pi, 2.0 * math.pi
LEAST_ANGLE = math.radians(2.0)
"""A rudder at smaller angles counts as amidships."""
ALIKE = 0.25
"""Two sides of a zigzag differ by less than this share of the angle."""
SPIRAL_ANGLES = 5
LEAST_TURN = math.radians(30.0)
"""A pull-out begins from a turn that has become steady over this much at least."""
SWING_MOST = math.radians(170.0)


class Zigzag(NamedTuple):
    """Angles [rad], times [s], distances [m] (nan where the speed is not known).

    rudder, execute: the angles at which it was sailed. initial_time and initial_distance: from the first execute to the
    second. overshoots: beyond the heading at the second, third, ... execute; checks: how long the heading went on
    after it. reach: from the first execute until the heading is back at the base course. period: from one execute to
    the next but one, mean from the second on, nan with fewer than four.
    """

    begins: float
    rudder: float
    execute: float
    initial_time: float
    initial_distance: float
    initial_turn: tuple[float, float]
    overshoots: tuple[float, ...]
    checks: tuple[float, ...]
    reach: float
    period: float
    speed: float


class Circle(NamedTuple):
    """A turn at a held rudder [rad], starboard positive; distances [m], times [s]; nan where it did not turn so far.

    advance and transfer at 90 deg, tactical_diameter at 180 deg, radius: speed over yaw rate of the steady end.
    """

    begins: float
    rudder: float
    turned: float
    advance: float
    transfer: float
    tactical_diameter: float
    radius: float
    rate: float
    time_90: float
    time_180: float
    time_360: float
    speed: float
    speed_lost: float


class PullOut(NamedTuple):
    """Yaw rates [rad/s] in the steady turn before, and `time` [s] after the rudder has been put amidships."""

    begins: float
    rudder: float
    turn_rate: float
    residual_rate: float
    time: float


class Spiral(NamedTuple):
    """Steady yaw rates [rad/s] at rudder angles [rad], from starboard to port and back; loop width [rad] of rudder
    between where the boat turns over on the way to port and on the way back, height [rad/s] at the rudder amidships."""

    begins: float
    down: tuple[tuple[float, float], ...]
    up: tuple[tuple[float, float], ...]
    width: float
    height: float


class Measures(NamedTuple):
    """Everything found in a record; `position` says where the distances come from."""

    zigzags: tuple[Zigzag, ...]
    circles: tuple[Circle, ...]
    pull_outs: tuple[PullOut, ...]
    spiral: Spiral | None
    position: str


def measures_of(record: TrialRecord) -> Measures:
    """Return what the record can be measured by; empty where it holds none of these manoeuvres."""
    parts = [(part, holds_of(part)) for part in stretches_of(record)]
    spirals = [spiral for part, holds in parts if (spiral := _spiral(part, holds)) is not None]
    return Measures(
        tuple(found for part, holds in parts for found in _zigzags(part, holds)),
        tuple(found for part, holds in parts for found in _circles(part, holds)),
        tuple(found for part, holds in parts for found in _pull_outs(part, holds)),
        max(spirals, key=lambda spiral: len(spiral.down) + len(spiral.up), default=None),
        record.position,
    )


def _is_over(hold: Hold) -> bool:
    return abs(hold.angle) >= LEAST_ANGLE


def _zigzags(record: TrialRecord, holds: Sequence[Hold]) -> list[Zigzag]:
    groups: list[list[Hold]] = []
    for hold in holds:
        turns = abs(record.heading[hold.last] - record.heading[hold.ordered]) > SWING_MOST
        joins = groups and groups[-1] and _opposite(groups[-1][-1], hold)
        if not _is_over(hold) or turns:
            groups.append([])
        elif joins:
            groups[-1].append(hold)
        else:
            groups.append([hold])
    return [_zigzag(record, group) for group in groups if len(group) >= 3]


def _opposite(before: Hold, after: Hold) -> bool:
    return abs(before.angle + after.angle) < ALIKE * abs(before.angle)


def _zigzag(record: TrialRecord, holds: Sequence[Hold]) -> Zigzag:
    time, rows = record.time, [hold.ordered for hold in holds]
    side = math.copysign(1.0, holds[0].angle)
    swing = side * (record.heading - record.heading[rows[0]])
    overshoots, checks = [], []
    for number, start in enumerate(rows[1:]):
        end = rows[number + 2] if number + 2 < len(rows) else holds[-1].last
        sign = 1.0 if number % 2 == 0 else -1.0
        peak = start + int(np.argmax(sign * swing[start : end + 1]))
        if peak < end or end < holds[-1].last:
            overshoots.append(float(sign * (swing[peak] - swing[start])))
            checks.append(float(time[peak] - time[start]))
    back = first_row(swing[rows[1] :] <= 0.0)
    periods = [time[later] - time[row] for row, later in zip(rows[1:], rows[3:], strict=False)]
    way = way_of(record)
    return Zigzag(
        float(time[rows[0]]),
        abs(holds[0].angle),
        float(swing[rows[1]]),
        float(time[rows[1]] - time[rows[0]]),
        float(way[rows[1]] - way[rows[0]]),
        _initial_turn(record, rows[0], swing, way),
        tuple(overshoots),
        tuple(checks),
        math.nan if back is None else float(time[rows[1] + back] - time[rows[0]]),
        float(np.mean(periods)) if periods else math.nan,
        speed_before(record, rows[0]),
    )


def _initial_turn(record: TrialRecord, start: int, swing: FloatArray, way: FloatArray) -> tuple[float, float]:
    """Return time [s] and distance [m] from the first execute to a heading changed by 10 deg."""
    at = crossing(swing[start:], math.radians(10.0))
    if math.isnan(at):
        return math.nan, math.nan
    return value_at(record.time, start + at) - float(record.time[start]), value_at(way, start + at) - float(way[start])


def _circles(record: TrialRecord, holds: Sequence[Hold]) -> list[Circle]:
    return [
        _circle(record, hold)
        for hold in holds
        if _is_over(hold) and abs(record.heading[hold.last] - record.heading[hold.ordered]) >= HALF
    ]


def _circle(record: TrialRecord, hold: Hold) -> Circle:
    start, end = hold.ordered, hold.last + 1
    course, side = record.heading[start], math.copysign(1.0, hold.angle)
    turned = side * (record.heading[start:end] - course)
    north, east = record.north[start:end] - record.north[start], record.east[start:end] - record.east[start]
    ahead = north * math.cos(course) + east * math.sin(course)
    abeam = side * (east * math.cos(course) - north * math.sin(course))
    quarter, half, full = (crossing(turned, angle) for angle in (QUARTER, HALF, FULL))
    time = record.time[start:end] - record.time[start]
    # the steady end: beyond 270 deg, or the last part of a shorter turn
    steady = turned >= min(1.5 * HALF, (1.0 - STEADY_PART) * float(turned[-1]))
    speed, rate = float(np.mean(record.speed[start:end][steady])), float(np.mean(record.rate[start:end][steady]))
    before = speed_before(record, start)
    return Circle(
        float(record.time[start]),
        hold.angle,
        float(turned[-1]),
        value_at(ahead, quarter),
        value_at(abeam, quarter),
        value_at(abeam, half),
        speed / abs(rate) if rate else math.inf,
        rate,
        value_at(time, quarter),
        value_at(time, half),
        value_at(time, full),
        before,
        1.0 - speed / before if before > 0.0 else math.nan,
    )


def _pull_outs(record: TrialRecord, holds: Sequence[Hold]) -> list[PullOut]:
    found = []
    for turn, after in itertools.pairwise(holds):
        turned = abs(record.heading[turn.last] - record.heading[turn.ordered])
        if _is_over(turn) and not _is_over(after) and turned >= LEAST_TURN and is_steady(record, turn):
            time = float(record.time[after.last] - record.time[after.ordered])
            rates = steady_rate(record, turn), steady_rate(record, after)
            found.append(PullOut(float(record.time[after.ordered]), turn.angle, *rates, time))
    return found


def _spiral(record: TrialRecord, holds: Sequence[Hold]) -> Spiral | None:
    """Return the spiral: the longest row of holds whose angles go down and then up again."""
    angles = [hold.angle for hold in holds]
    best: tuple[int, int, int] = (0, 0, 0)
    for start in range(len(holds)):
        turn = start
        while turn + 1 < len(holds) and angles[turn + 1] < angles[turn]:
            turn += 1
        end = turn
        while end + 1 < len(holds) and angles[end + 1] > angles[end]:
            end += 1
        if min(turn - start, end - turn) > min(best[1] - best[0], best[2] - best[1]):
            best = (start, turn, end)
    start, turn, end = best
    if min(turn - start, end - turn) + 1 < SPIRAL_ANGLES:
        return None
    rates = {at: steady_rate(record, holds[at]) for at in range(start, end + 1)}
    down = tuple((angles[at], rates[at]) for at in range(start, turn + 1))
    up = tuple((angles[at], rates[at]) for at in range(turn, end + 1))
    width = max(_turns_over(up) - _turns_over(tuple(reversed(down))), 0.0)
    height = abs(_rate_at(down[::-1]) - _rate_at(up))
    return Spiral(float(record.time[holds[start].ordered]), down, up, width, height)


def _turns_over(branch: Sequence[tuple[float, float]]) -> float:
    """Return the rudder angle [rad] at which the yaw rate changes sign on a branch sorted by angle; nan where never."""
    for (low, before), (high, after) in itertools.pairwise(branch):
        if before <= 0.0 < after:
            return low + (high - low) * before / (before - after)
    return math.nan


def _rate_at(branch: Sequence[tuple[float, float]]) -> float:
    """Return the yaw rate [rad/s] at the rudder amidships on a branch sorted by angle."""
    return float(np.interp(0.0, [angle for angle, _ in branch], [rate for _, rate in branch]))
