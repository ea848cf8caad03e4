"""When the lines of a log in text were received: by the time stamps before them, or spread between those inside.

Stamps known: seconds or milliseconds since 1970, ISO 8601 dates with time, a time of day, seconds from any beginning,
and the tag block of NMEA 4.10 (\\c:SECONDS*hh\\). Without stamps the times that some lines hold are marks, and what
lies between two marks is spread evenly by its place in the file: right to within the pauses of the line.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime

import numpy as np

from autopilot.errors import InputError
from autopilot.logs.series import DAY_S, FloatArray

MILLISECONDS_FROM = 1.0e11
"""Numbers beyond this are milliseconds since 1970, and beyond a thousand times this microseconds."""
EPOCH_FROM = 3.0e8
"""A number of seconds above this is counted from 1970 (1979 on)."""
PREFIX_MOST = 256
"""Characters before a line that are looked at."""
BACK_MOST_S = 1.0
"""Lines may stand in another order than that of their stamps by this much."""

_TAG = re.compile(r"\\[^\\]*?c:(\d+)[^\\]*\\\s*$")
_ISO = re.compile(r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d(?:[.,]\d+)?)\s*(Z|[+-]\d\d:?\d\d)?")
_OF_DAY = re.compile(r"(?<![\d:])(\d\d):(\d\d):(\d\d(?:[.,]\d+)?)(?![\d:])")
_NUMBER = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)(?![\w.])")


def stamp_of(prefix: str) -> tuple[float, bool] | None:
    """Return the time [s] in what stands before a line, and whether it is a time of day; None where none is."""
    prefix = prefix[-PREFIX_MOST:]
    tag = _TAG.search(prefix)
    if tag:
        return _epoch(tag[1])
    iso = _ISO.search(prefix)
    if iso:
        zone = (iso[3] or "Z").replace("Z", "+00:00")
        try:
            moment = datetime.fromisoformat(f"{iso[1]}T{iso[2].replace(',', '.')[:15]}{zone}")
            return moment.timestamp(), False
        except (ValueError, OverflowError):
            return None
    clock = _OF_DAY.search(prefix)
    if clock:
        time = of_day(clock[1], clock[2], clock[3].replace(",", "."))
        return None if time is None else (time, True)
    number = _NUMBER.search(prefix)
    return _epoch(number[1]) if number else None


def _epoch(digits: str) -> tuple[float, bool] | None:
    """Return the seconds that a number of seconds, milliseconds, micro- or nanoseconds is; None where it is no time."""
    value = float(digits)
    for _ in range(3):
        value = value * 1.0e-3 if value > MILLISECONDS_FROM else value
    return (value, False) if value <= MILLISECONDS_FROM else None


def of_day(hours: str, minutes: str, seconds: str) -> float | None:
    """Return the time of day [s], None where no clock shows it; a day may end with a leap second."""
    if int(hours) > 23 or int(minutes) > 59 or float(seconds) >= 61.0:
        return None
    return int(hours) * 3600.0 + int(minutes) * 60.0 + float(seconds)


def without_midnight(times: FloatArray) -> FloatArray:
    """Return times of day [s] counted on over midnight."""
    turns = np.where(np.diff(times) < -0.5 * DAY_S, 1.0, 0.0)
    return times + DAY_S * np.concatenate(([0.0], np.cumsum(turns)))


def spread(places: Sequence[float], marks: Sequence[tuple[float, float]]) -> FloatArray | None:
    """Return the times [s] of lines at `places` in the file from (place, UTC) marks; None with fewer than two marks.

    The first sentence of each new UTC is the mark. Beyond the marks the nearest two are continued.
    """
    fresh = [mark for at, mark in enumerate(marks) if at == 0 or mark[1] != marks[at - 1][1]]
    if len(fresh) < 2:
        return None
    at = np.array([place for place, _ in fresh], dtype=np.float64)
    times = without_midnight(np.array([time for _, time in fresh]))
    rising = np.append(True, np.diff(times) > 0.0)
    at, times = at[rising], times[rising]
    if at.size < 2:
        return None
    x = np.asarray(places, dtype=np.float64)
    inside = np.interp(x, at, times)
    before = times[0] + (x - at[0]) * (times[1] - times[0]) / (at[1] - at[0])
    after = times[-1] + (x - at[-1]) * (times[-1] - times[-2]) / (at[-1] - at[-2])
    return np.asarray(np.where(x < at[0], before, np.where(x > at[-1], after, inside)))


def stamped(path: str, stamps: Sequence[tuple[float, bool]], what: str) -> tuple[FloatArray, bool]:
    """Return the times [s] of lines with stamps, as `stamp_of` has them, and whether they are times of day.

    what: one of the lines, as a refusal names it. Raises InputError where they step back.
    """
    time = np.array([seconds for seconds, _ in stamps])
    is_of_day = all(each for _, each in stamps)
    time = without_midnight(time) if is_of_day else time
    # small steps add up: a file that is written backwards would else be read as sailed forwards
    behind = np.maximum.accumulate(time) - time
    back = np.flatnonzero(behind > BACK_MOST_S)
    if back.size:
        raise InputError(
            f"{path}: the time stamps step back by {behind[back[0]]:.1f} s at {what} {back[0] + 1}: "
            "the clock was set, or two logs were put together; keep one part."
        )
    return time, is_of_day


def without_outliers(stamps: Sequence[tuple[float, bool]]) -> list[bool]:
    """Return which stamps are kept: not one alone that lies outside its neighbours, which are in order."""
    time = np.array([seconds for seconds, _ in stamps])
    kept = np.full(time.size, True)
    if time.size > 2:
        before, here, after = time[:-2], time[1:-1], time[2:]
        odd = (here < before - BACK_MOST_S) | (here > after + BACK_MOST_S)
        kept[1:-1] = ~((before <= after) & odd)
    return [bool(each) for each in kept]
