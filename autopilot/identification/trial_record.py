"""One recording as the manoeuvring measures see it: track, and the stretches in which the rudder stood still."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.errors import InputError
from autopilot.identification.runs import FloatArray, gap_limit

MEASURED = "measured positions"
STEADY_PART = 0.3
"""The last part of a hold in which the motion is taken to be steady."""
STEADY_CHANGE = 0.1
RECKONED = "dead reckoning from speed and heading (leeway and current left out)"

EARTH_M = 6371000.8
"""Mean radius (IUGG): over the few hundred metres of a trial the Earth is a plane."""
STILL_RAD = math.radians(0.5)
STILL_SHARE = 0.02
"""The rudder stands still within this, or within this share of the range it goes through."""
SHORTEST_S = 0.3
SHORTEST_SAMPLES = 3
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


class Hold(NamedTuple):
    """The rudder standing still: rows `first` to `last` of the record, at a median `angle` [rad]; `ordered` is the row
    at which it had begun to move there."""

    ordered: int
    first: int
    last: int
    angle: float


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


def still_within(rudder: FloatArray) -> float:
    """Return the band [rad] within which the rudder counts as standing still."""
    return max(STILL_RAD, STILL_SHARE * float(np.ptp(rudder)))


def holds_of(record: TrialRecord) -> list[Hold]:
    """Return the stretches in which the rudder stands still, in order of time."""
    time, rudder = record.time, record.rudder
    band = still_within(rudder)
    cuts = gap_limit(time)
    found: list[Hold] = []
    first = 0
    while first < time.size:
        last = first
        low = high = rudder[first]
        while last + 1 < time.size and time[last + 1] - time[last] <= cuts:
            lower, upper = min(low, rudder[last + 1]), max(high, rudder[last + 1])
            if upper - lower > band:
                break
            low, high, last = lower, upper, last + 1
        if last - first + 1 >= SHORTEST_SAMPLES and time[last] - time[first] >= SHORTEST_S:
            _append(found, Hold(first, first, last, float(np.median(rudder[first : last + 1]))), band)
            first = last + 1
        else:
            first += 1
    return [_ordered(found, number) for number in range(len(found))]


def _append(found: list[Hold], hold: Hold, band: float) -> None:
    """Append a hold, or lengthen the last one where the rudder stood at the same angle."""
    if found and abs(found[-1].angle - hold.angle) < band:
        before = found.pop()
        hold = hold._replace(ordered=before.ordered, first=before.first, angle=before.angle)
    found.append(hold)


def _ordered(found: list[Hold], number: int) -> Hold:
    """Return the hold with the row at which the rudder began to move to it: the last of the hold before."""
    hold = found[number]
    return hold._replace(ordered=found[number - 1].last) if number else hold


def steady_rate(record: TrialRecord, hold: Hold) -> float:
    """Return the mean yaw rate [rad/s] in the last part of a hold."""
    begin = record.time[hold.last] - STEADY_PART * (record.time[hold.last] - record.time[hold.first])
    rows = slice(int(np.searchsorted(record.time, begin)), hold.last + 1)
    return float(np.mean(record.rate[rows]))


def is_steady(record: TrialRecord, hold: Hold) -> bool:
    """Return whether the yaw rate of the last part of a hold differs little from that of the part before.

    Where nothing came in the part before, it is not.
    """
    time, length = record.time, STEADY_PART * (record.time[hold.last] - record.time[hold.first])
    late, early = (int(np.searchsorted(time, time[hold.last] - parts * length)) for parts in (1.0, 2.0))
    if early == late:
        return False
    rates = float(np.mean(record.rate[early:late])), float(np.mean(record.rate[late : hold.last + 1]))
    return abs(rates[1] - rates[0]) < STEADY_CHANGE * abs(rates[1])


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


def value_at(values: FloatArray, row: float) -> float:
    """Return the value at a row with its fraction; nan for nan."""
    return math.nan if math.isnan(row) else float(np.interp(row, np.arange(values.size), values))
