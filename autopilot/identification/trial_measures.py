"""What a ship is measured by in its trials: zigzag, turning circle, pull-out, spiral.

Definitions: IMO MSC.137(76), annex, section 4.2 (advance, tactical diameter, overshoot angles), and ITTC 7.5-04-02-01,
Full Scale Manoeuvring Trials (times of the zigzag, transfer, steady turn, pull-out, spiral). The rudder is executed
when it begins to move; angles are counted from the heading at that moment. Positions are the recorder's own place.

The yardsticks of ship manoeuvrability beside a boat's measures. They are made for ships of 100 m and more.

IMO MSC.137(76), annex, section 5.3, and for the loop of the spiral MSC/Circ.1053, the explanatory notes to it.
L is the length [m], V the speed [m/s] at which the trial began.

One recording as the manoeuvring measures see it: track and motion; `rudder_orders` says where the rudder stood.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.errors import InputError
from autopilot.identification.rudder_orders import LEAST_ANGLE, SHORTEST_SAMPLES, Hold, holds_of
from autopilot.identification.runs import FloatArray, gap_limit

SHIPS = "criteria of IMO MSC.137(76), made for ships of 100 m and more: a yardstick here, no verdict"
ADVANCE_LENGTHS = 4.5
TACTICAL_LENGTHS = 5.0
INITIAL_LENGTHS = 2.5
FIRST_OVERSHOOT_20 = math.radians(25.0)
TEN, TWENTY = math.radians(10.0), math.radians(20.0)
NEAR = math.radians(1.5)
"""A zigzag counts as 10/10 or 20/20 within this."""


def first_overshoot_10(length: float, speed: float) -> float:
    """Return the largest first overshoot [rad] of a 10/10 zigzag: 10 deg, 5 + L/V / 2, 20 deg."""
    return math.radians(min(max(5.0 + 0.5 * length / speed, 10.0), 20.0))


def second_overshoot_10(length: float, speed: float) -> float:
    """Return the largest second overshoot [rad] of a 10/10 zigzag: 25 deg, 17.5 + 0.75 L/V, 40 deg."""
    return math.radians(min(max(17.5 + 0.75 * length / speed, 25.0), 40.0))


def loop_width(length: float, speed: float) -> float:
    """Return the largest width [rad] of an unstable boat's loop: 0 below L/V of 9 s, (L/V)/3 - 3, 12 deg from 45 s."""
    return math.radians(min(max(length / speed / 3.0 - 3.0, 0.0), 12.0))


def zigzag_kind(rudder: float, execute: float) -> int:
    """Return 10 or 20 for a 10/10 or 20/20 zigzag (angles [rad]), 0 for others, which have no criterion."""
    for degrees, angle in ((10, TEN), (20, TWENTY)):
        if abs(rudder - angle) < NEAR and abs(execute - angle) < NEAR:
            return degrees
    return 0


MEASURED = "measured positions"
STEADY_PART = 0.3
"""The last part of a hold in which the motion is taken to be steady."""
STEADY_CHANGE = 0.1
RECKONED = "dead reckoning from speed and heading (leeway and current left out)"

EARTH_M = 6371000.8
"""Mean radius (IUGG): over the few hundred metres of a trial the Earth is a plane."""
PAUSE_S = 30.0
"""No manoeuvre is measured over a longer one."""
POSITION_SHARE = 0.9
"""Positions are used where this share of the rows at least has them."""


class TrialRecord(NamedTuple):
    """Arrays of one length N: time [s], heading [rad] unwrapped, rate [rad/s], rudder [rad], speed [m/s], north and
    east [m] from the first row; `position` says where those come from."""

    time: FloatArray
    heading: FloatArray
    rate: FloatArray
    rudder: FloatArray
    speed: FloatArray
    north: FloatArray
    east: FloatArray
    position: str


def record_of(source: str, columns: Mapping[str, FloatArray]) -> TrialRecord:
    """Return the record in columns as identification takes them, rows with rudder and heading only.

    A missing yaw rate is taken from the heading, a missing speed makes every distance nan. Positions are
    `latitude_rad`, `longitude_rad`. Raises InputError, naming `source`.
    """
    for name in ("rudder_rad", "heading_rad"):
        if name not in columns:
            raise InputError(f"{source}: {name} is missing; measures need rudder and heading.")
    time = columns["time_s"]
    known = np.isfinite(time) & np.isfinite(columns["rudder_rad"]) & np.isfinite(columns["heading_rad"])
    if np.count_nonzero(known) < 10:
        raise InputError(
            f"{source}: rudder and heading are known together {np.count_nonzero(known)} times; 10 are needed."
        )
    rows = {name: np.asarray(values)[known] for name, values in columns.items()}
    time = rows["time_s"]
    heading = np.unwrap(rows["heading_rad"])
    rate = _filled(time, rows.get("yaw_rate_rad_s"))
    speed = _filled(time, rows.get("speed_m_s"))
    if np.isnan(rate).any():
        rate = np.gradient(heading, time)
    north, east, position = _track(time, heading, speed, rows)
    return TrialRecord(time, heading, rate, rows["rudder_rad"], speed, north, east, position)


def _filled(time: FloatArray, values: FloatArray | None) -> FloatArray:
    if values is None or not np.isfinite(values).any():
        return np.full(time.size, np.nan)
    known = np.isfinite(values)
    return np.interp(time, time[known], values[known])


def _track(
    time: FloatArray, heading: FloatArray, speed: FloatArray, rows: Mapping[str, FloatArray]
) -> tuple[FloatArray, FloatArray, str]:
    latitude, longitude = rows.get("latitude_rad"), rows.get("longitude_rad")
    if latitude is not None and longitude is not None and np.mean(np.isfinite(latitude)) >= POSITION_SHARE:
        known = np.isfinite(longitude)
        longitude[known] = np.unwrap(longitude[known])  # a turn across the date line is no way round the earth
        latitude, longitude = _filled(time, latitude), _filled(time, longitude)
        north = EARTH_M * (latitude - latitude[0])
        east = EARTH_M * math.cos(float(latitude[0])) * (longitude - longitude[0])
        return north, east, MEASURED
    dt = np.diff(time)
    middle_speed, middle = 0.5 * (speed[1:] + speed[:-1]), 0.5 * (heading[1:] + heading[:-1])
    steps = middle_speed * dt
    north = np.concatenate(([0.0], np.cumsum(steps * np.cos(middle))))
    east = np.concatenate(([0.0], np.cumsum(steps * np.sin(middle))))
    return north, east, RECKONED


def stretches_of(record: TrialRecord) -> list[TrialRecord]:
    """Return the record in parts, cut where nothing came for so long that nobody knows what the boat did."""
    cuts = np.flatnonzero(np.diff(record.time) > max(PAUSE_S, gap_limit(record.time))) + 1
    parts = [part for part in np.split(np.arange(record.time.size), cuts) if part.size >= SHORTEST_SAMPLES]
    return [TrialRecord._make([*(array[part] for array in record[:-1]), record.position]) for part in parts]


def steady_rate(record: TrialRecord, hold: Hold) -> float:
    """Return the yaw rate [rad/s] in the last part of a hold."""
    begin = record.time[hold.last] - STEADY_PART * (record.time[hold.last] - record.time[hold.first])
    return _rate_in(record, slice(int(np.searchsorted(record.time, begin)), hold.last + 1))


def _rate_in(record: TrialRecord, rows: slice) -> float:
    """Return the slope [rad/s] of the line through the headings, which waves and noise bend less than they do a mean of
    rates; of few rows that mean."""
    time, heading = record.time[rows], record.heading[rows]
    if time.size < SHORTEST_SAMPLES:
        return float(np.mean(record.rate[rows]))
    off = time - time.mean()
    return float(np.dot(off, heading - heading.mean()) / np.dot(off, off))


def is_steady(record: TrialRecord, hold: Hold) -> bool:
    """Return whether the yaw rate of the last part of a hold differs little from that of the part before.

    Where nothing came in the part before, it is not.
    """
    return _change(record, hold) < STEADY_CHANGE * abs(steady_rate(record, hold))


def _change(record: TrialRecord, hold: Hold) -> float:
    """Return by how much [rad/s] the yaw rate of the last part of a hold is off that of the part before; infinite where
    nothing came in that."""
    time, length = record.time, STEADY_PART * (record.time[hold.last] - record.time[hold.first])
    late, early = (int(np.searchsorted(time, time[hold.last] - parts * length)) for parts in (1.0, 2.0))
    if early == late:
        return math.inf
    return abs(_rate_in(record, slice(late, hold.last + 1)) - _rate_in(record, slice(early, late)))


def speed_before(record: TrialRecord, row: int) -> float:
    """Return the mean speed [m/s] in the two seconds before a row, or at it."""
    first = int(np.searchsorted(record.time, record.time[row] - 2.0))
    return float(np.mean(record.speed[first : row + 1]))


def way_of(record: TrialRecord) -> FloatArray:
    """Return the way gone [m] up to each row."""
    return np.concatenate(([0.0], np.cumsum(np.hypot(np.diff(record.north), np.diff(record.east)))))


def first_row(where: NDArray[np.bool_]) -> int | None:
    """Return the first row that is true, None where none is."""
    found = np.flatnonzero(where)
    return int(found[0]) if found.size else None


def crossing(values: FloatArray, level: float) -> float:
    """Return where `values` first reach `level`, as a row with its fraction; nan where never."""
    at = first_row(values >= level)
    if at is None:
        return math.nan
    if at == 0 or values[at] == values[at - 1]:
        return float(at)
    return float(at - (values[at] - level) / (values[at] - values[at - 1]))


def _passing(values: FloatArray, level: float) -> float:
    """Return where `values` pass `level` on their way up, as a row with its fraction: half way between where
    noise first takes them there and where it last takes them back; nan where they never do."""
    first = crossing(values, level)
    if math.isnan(first) or first == 0.0:
        return first
    return 0.5 * (first + values.size - 1 - crossing(-values[::-1], -level))


def value_at(values: FloatArray, row: float) -> float:
    """Return the value at a row with its fraction; nan for nan."""
    return math.nan if math.isnan(row) else float(np.interp(row, np.arange(values.size), values))


QUARTER, HALF, FULL = 0.5 * math.pi, math.pi, 2.0 * math.pi
ALIKE = 0.25
"""Two sides of a zigzag differ by less than this share of the angle."""
LIKE_SWING, LEAST_SWING = 0.3, math.radians(2.0)
"""From one execute of a zigzag to the next the heading goes through this share of the median at least, and this."""
PEAK_PART = 0.5
"""Half the time over which a peak is taken to be a parabola, as a part of the time that it took to come to it."""
PEAK_STEPS, MEAN_PART = 3, 8
"""A wave beside the peak may be higher than it: the mean over an eighth of the rows says where to begin, and the
parabola is moved to where it leads, so often at most."""
SHARP_PART, SHARP_SAMPLES = 0.05, 7
"""Part of the time between two executes over which the heading is taken to be a parabola, and samples it needs."""
SPIRAL_ANGLES = 5
PASSED = 0.2
"""A hold of less than this share of those before and after it is no angle of a spiral."""
UNSTEADY, MOST_STEADY = 0.2, 0.75
"""The yaw rate of so large a share of a spiral's holds changes by less than this share of its largest, in the end."""
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
    parts = [(part, holds_of(part.time, part.rudder)) for part in stretches_of(record)]
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
    for hold in _sides(holds):
        turns = abs(record.heading[hold.last] - value_at(record.heading, hold.ordered)) > SWING_MOST
        joins = groups and groups[-1] and _opposite(groups[-1][-1], hold)
        if not _is_over(hold) or turns:
            groups.append([])
        elif joins:
            groups[-1].append(hold)
        else:
            groups.append([hold])
    followed = [_followed(record, group) for group in groups if len(group) >= 3]
    return [_zigzag(record, group) for group in followed if len(group) >= 3]


def _sides(holds: Sequence[Hold]) -> list[Hold]:
    """Return the holds, those after one another at nearly the same angle as one."""
    found: list[Hold] = []
    for hold in holds:
        if found and min(abs(found[-1].angle), abs(hold.angle)) >= LEAST_ANGLE and _alike(found[-1], hold):
            before = found.pop()
            longer = max((before, hold), key=lambda one: one.last - one.first)
            hold = Hold(before.ordered, before.first, hold.last, longer.angle)
        found.append(hold)
    return found


def _opposite(before: Hold, after: Hold) -> bool:
    """Return whether the rudder went over: to nearly the same angle where it stood at both."""
    return _alike(before, after._replace(angle=-after.angle))


def _alike(before: Hold, after: Hold) -> bool:
    stood = before.last > before.first and after.last > after.first
    near = abs(before.angle - after.angle) < ALIKE * abs(before.angle)
    return before.angle * after.angle > 0.0 and (near or not stood)


def _followed(record: TrialRecord, holds: Sequence[Hold]) -> list[Hold]:
    """Return the longest part in which the rudder went over because the heading had: to the side of the rudder, by
    like angles from one execute to the next. A rudder that works against waves, or by the clock, does not."""
    headings = [value_at(record.heading, hold.ordered) for hold in holds[1:]]
    sides = [math.copysign(1.0, hold.angle) for hold in holds]
    swings = [side * (one - after) for side, one, after in zip(sides, headings, headings[1:], strict=False)]
    least = max(LIKE_SWING * float(np.median(swings)), LEAST_SWING)
    parts: list[list[Hold]] = [[holds[0], holds[1]]]
    for number, swing in enumerate(swings):
        if swing >= least:
            parts[-1].append(holds[number + 2])
        else:
            parts.append([holds[number + 1], holds[number + 2]])
    return max(parts, key=len)


def _zigzag(record: TrialRecord, holds: Sequence[Hold]) -> Zigzag:
    rows = [hold.ordered for hold in holds]
    times = [value_at(record.time, row) for row in rows]
    ends = float(holds[-1].last)
    side = math.copysign(1.0, holds[0].angle)
    swing = side * (record.heading - _sharp(record, record.heading, rows, 0))
    executed = [_sharp(record, swing, rows, number) for number in range(len(rows))]
    overshoots, checks = [], []
    for number, start in enumerate(rows[1:]):
        end = rows[number + 2] if number + 2 < len(rows) else ends
        sign = 1.0 if number % 2 == 0 else -1.0
        moment, peak = _peak(record.time, sign * swing, start, end)
        if moment < value_at(record.time, end) or end < ends:
            overshoots.append(peak - sign * executed[number + 1])
            checks.append(moment - times[number + 1])
    after = math.ceil(rows[1])
    back = crossing(-swing[after:], 0.0)
    periods = [later - time for time, later in zip(times[1:], times[3:], strict=False)]
    way = way_of(record)
    return Zigzag(
        times[0],
        _angle_of(holds),
        executed[1],
        times[1] - times[0],
        value_at(way, rows[1]) - value_at(way, rows[0]),
        _initial_turn(record, rows[0], swing, way),
        tuple(overshoots),
        tuple(checks),
        value_at(record.time, after + back) - times[0],
        float(np.mean(periods)) if periods else math.nan,
        speed_before(record, int(rows[0])),
    )


def _angle_of(holds: Sequence[Hold]) -> float:
    """Return the rudder [rad] of a zigzag: where it seldom stood, as a slow one whose swings grow, that of the largest
    swings."""
    stood = [abs(hold.angle) for hold in holds if hold.last > hold.first]
    swings = [abs(hold.angle) for hold in holds]
    often = 2 * len(stood) >= len(holds)
    return float(np.median(stood if often else [angle for angle in swings if angle >= 0.9 * max(swings)]))


def _sharp(record: TrialRecord, values: FloatArray, rows: Sequence[float], number: int) -> float:
    """Return the value at an execute, of the parabola through what was recorded about it, so that noise counts less."""
    moments = [value_at(record.time, row) for row in rows]
    least = min((after - before for before, after in itertools.pairwise(moments)), default=0.0)
    near = np.flatnonzero(np.abs(record.time - moments[number]) <= SHARP_PART * least)
    if near.size < SHARP_SAMPLES:
        return value_at(values, rows[number])
    return float(np.polyfit(record.time[near] - moments[number], values[near], 2)[2])


def _peak(time: FloatArray, values: FloatArray, start: float, end: float) -> tuple[float, float]:
    """Return time [s] and value of the largest of `values` from row `start` to row `end`: of the parabola through the
    rows about it, so that neither noise nor sampling adds to it; the largest itself at either end."""
    first, last = math.ceil(start), math.floor(end)
    top = first + int(np.argmax(_mean_about(values[first : last + 1]))) if last >= first else first
    found = float(time[top]), float(values[top])
    for _ in range(PEAK_STEPS):
        if not first < top < last:
            return float(time[top]), float(values[top])
        width = PEAK_PART * float(time[top] - time[first])
        near = np.flatnonzero(np.abs(time[first : last + 1] - time[top]) <= width) + first
        if near.size < 5:
            near = np.arange(top - 1, top + 2)
        a, b, c = np.polyfit(time[near] - time[top], values[near], 2)
        if a >= 0.0:
            return found
        moment = min(max(-0.5 * b / a, float(time[near[0]] - time[top])), float(time[near[-1]] - time[top]))
        found = float(time[top] + moment), float(c + b * moment + a * moment * moment)
        if near[0] < top < near[-1] and abs(moment) < width:
            return found
        top = int(near[0] if moment < 0.0 else near[-1])
    return found


def _mean_about(values: FloatArray) -> FloatArray:
    """Return the mean of the rows about each, fewer at either end."""
    reach, rows = values.size // (2 * MEAN_PART), np.arange(values.size)
    width = np.minimum(np.minimum(rows, rows[::-1]), reach)
    sums = np.concatenate(([0.0], np.cumsum(values)))
    means: FloatArray = (sums[rows + width + 1] - sums[rows - width]) / (2 * width + 1)
    return means


def _initial_turn(record: TrialRecord, begins: float, swing: FloatArray, way: FloatArray) -> tuple[float, float]:
    """Return time [s] and distance [m] from the first execute to a heading changed by 10 deg."""
    first = math.ceil(begins)
    at = first + crossing(swing[first:], math.radians(10.0))
    return value_at(record.time, at) - value_at(record.time, begins), value_at(way, at) - value_at(way, begins)


def _circles(record: TrialRecord, holds: Sequence[Hold]) -> list[Circle]:
    found = []
    for hold in holds:
        turned = math.copysign(1.0, hold.angle) * (record.heading[hold.last] - value_at(record.heading, hold.ordered))
        if _is_over(hold) and hold.last > hold.first and turned >= HALF:
            found.append(_circle(record, hold))
    return found


def _circle(record: TrialRecord, hold: Hold) -> Circle:
    begins, side = hold.ordered, math.copysign(1.0, hold.angle)
    start, end = math.ceil(begins), hold.last + 1
    course, moment = value_at(record.heading, begins), value_at(record.time, begins)
    turned = side * (record.heading[start:end] - course)
    north = record.north[start:end] - value_at(record.north, begins)
    east = record.east[start:end] - value_at(record.east, begins)
    ahead = north * math.cos(course) + east * math.sin(course)
    abeam = side * (east * math.cos(course) - north * math.sin(course))
    quarter, half, full = (_passing(turned, angle) for angle in (QUARTER, HALF, FULL))
    time = record.time[start:end] - moment
    # the steady end: beyond 270 deg, or the last part of a shorter turn
    steady = turned >= min(1.5 * HALF, (1.0 - STEADY_PART) * float(turned[-1]))
    steady &= np.arange(start, end) >= hold.first
    speed, rate = float(np.mean(record.speed[start:end][steady])), float(np.mean(record.rate[start:end][steady]))
    before = speed_before(record, int(begins))
    return Circle(
        moment,
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
        turned = abs(record.heading[turn.last] - value_at(record.heading, turn.ordered))
        if _is_over(turn) and not _is_over(after) and turned >= LEAST_TURN and is_steady(record, turn):
            begins = value_at(record.time, after.ordered)
            rates = steady_rate(record, turn), steady_rate(record, after)
            found.append(PullOut(begins, turn.angle, *rates, float(record.time[after.last]) - begins))
    return found


def _long(record: TrialRecord, holds: Sequence[Hold]) -> list[Hold]:
    """Return the holds without those that are passed through between two longer ones."""
    lasts = [float(record.time[hold.last] - record.time[hold.first]) for hold in holds]
    beside = [min(before, after) for before, after in zip([0.0, *lasts][:-1], [*lasts, 0.0][1:], strict=True)]
    return [
        hold
        for hold, time, other in zip(holds, lasts, beside, strict=True)
        if hold.last > hold.first and time >= PASSED * other
    ]


def _is_spiral(record: TrialRecord, holds: Sequence[Hold]) -> bool:
    """Return whether the rudder went to both sides, and stood at its angles until the boat turned steadily."""
    angles = [hold.angle for hold in holds]
    if max(angles) < LEAST_ANGLE or min(angles) > -LEAST_ANGLE:
        return False
    largest = max(abs(steady_rate(record, hold)) for hold in holds)
    steady = [_change(record, hold) < UNSTEADY * largest for hold in holds]
    return sum(steady) >= MOST_STEADY * len(steady)


def _spiral(record: TrialRecord, every: Sequence[Hold]) -> Spiral | None:
    """Return the spiral: the longest row of holds whose angles go down and then up again."""
    holds = _long(record, every)
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
    if min(turn - start, end - turn) + 1 < SPIRAL_ANGLES or not _is_spiral(record, holds[start : end + 1]):
        return None
    rates = {at: steady_rate(record, holds[at]) for at in range(start, end + 1)}
    down = tuple((angles[at], rates[at]) for at in range(start, turn + 1))
    up = tuple((angles[at], rates[at]) for at in range(turn, end + 1))
    width = max(_turns_over(up) - _turns_over(tuple(reversed(down))), 0.0)
    height = abs(_rate_at(down[::-1]) - _rate_at(up))
    return Spiral(value_at(record.time, holds[start].ordered), down, up, width, height)


def _turns_over(branch: Sequence[tuple[float, float]]) -> float:
    """Return the rudder angle [rad] at which the yaw rate changes sign on a branch sorted by angle; nan where never."""
    for (low, before), (high, after) in itertools.pairwise(branch):
        if before <= 0.0 < after:
            return low + (high - low) * before / (before - after)
    return math.nan


def _rate_at(branch: Sequence[tuple[float, float]]) -> float:
    """Return the yaw rate [rad/s] at the rudder amidships on a branch sorted by angle."""
    return float(np.interp(0.0, [angle for angle, _ in branch], [rate for _, rate in branch]))
