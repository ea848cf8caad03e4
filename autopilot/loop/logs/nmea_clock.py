"""When the lines of an NMEA log were received: by the time stamps before them, or by the UTC inside some sentences.

Stamps known: seconds or milliseconds since 1970, ISO 8601 dates with time, a time of day, seconds from any beginning,
and the tag block of NMEA 4.10 (\\c:SECONDS*hh\\). Without stamps the times of RMC, GGA, GLL and ZDA are marks, and what
lies between two marks is spread evenly by its place in the file: right to within the pauses of the line.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime

import numpy as np

from autopilot.links.nmea0183 import Sentence
from autopilot.loop.logs.series import FloatArray

DAY_S = 86400.0
MILLISECONDS_FROM = 1.0e11
"""Numbers beyond this are milliseconds since 1970, and beyond a thousand times this microseconds."""
EPOCH_FROM = 3.0e8
"""A number of seconds above this is counted from 1970 (1979 on)."""
PREFIX_MOST = 256
"""Characters before a sentence that are looked at."""
UTC_FIELD = {"RMC": 0, "GGA": 0, "GLL": 4, "ZDA": 0}

_TAG = re.compile(r"\\[^\\]*?c:(\d+)[^\\]*\\\s*$")
_ISO = re.compile(r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d(?:[.,]\d+)?)\s*(Z|[+-]\d\d:?\d\d)?")
_OF_DAY = re.compile(r"(?<![\d:])(\d\d):(\d\d):(\d\d(?:[.,]\d+)?)(?![\d:])")
_NUMBER = re.compile(r"(?<![\w.])(\d+(?:\.\d+)?)(?![\w.])")
_ZDA_DATE = re.compile(r"(\d\d?),(\d\d?),(\d{4})")
_RMC_DATE = re.compile(r"(\d\d)(\d\d)(\d\d)")


def stamp_of(prefix: str) -> tuple[float, bool] | None:
    """Return the time [s] in what stands before a sentence, and whether it is a time of day; None where none is."""
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
        time = _of_day(clock[1], clock[2], clock[3].replace(",", "."))
        return None if time is None else (time, True)
    number = _NUMBER.search(prefix)
    return _epoch(number[1]) if number else None


def _epoch(digits: str) -> tuple[float, bool] | None:
    """Return the seconds that a number of seconds, milliseconds, micro- or nanoseconds is; None where it is no time."""
    value = float(digits)
    for _ in range(3):
        value = value * 1.0e-3 if value > MILLISECONDS_FROM else value
    return (value, False) if value <= MILLISECONDS_FROM else None


def _of_day(hours: str, minutes: str, seconds: str) -> float | None:
    """Return the time of day [s], None where no clock shows it; a day may end with a leap second."""
    if int(hours) > 23 or int(minutes) > 59 or float(seconds) >= 61.0:
        return None
    return int(hours) * 3600.0 + int(minutes) * 60.0 + float(seconds)


def utc_of(sentence: Sentence) -> float | None:
    """Return the UTC time of day [s] in a sentence that has one, None in others."""
    place = UTC_FIELD.get(sentence.type)
    if place is None or place >= len(sentence.fields):
        return None
    text = sentence.fields[place]
    if not re.fullmatch(r"\d{6}(\.\d*)?", text):
        return None
    return _of_day(text[:2], text[2:4], text[4:])


def date_of(sentence: Sentence) -> float | None:
    """Return the Unix time [s] of the day's beginning in RMC or ZDA, None where it is not there."""
    fields = sentence.fields
    if sentence.type == "RMC" and len(fields) > 8:
        found, century = _RMC_DATE.fullmatch(fields[8]), 2000
    elif sentence.type == "ZDA":
        found, century = _ZDA_DATE.fullmatch(",".join(fields[1:4])), 0
    else:
        return None
    if found is None:
        return None
    try:
        return datetime(century + int(found[3]), int(found[2]), int(found[1]), tzinfo=UTC).timestamp()
    except ValueError:  # a day that no calendar has
        return None


def without_midnight(times: FloatArray) -> FloatArray:
    """Return times of day [s] counted on over midnight."""
    turns = np.where(np.diff(times) < -0.5 * DAY_S, 1.0, 0.0)
    return times + DAY_S * np.concatenate(([0.0], np.cumsum(turns)))


def spread(places: Sequence[int], marks: Sequence[tuple[int, float]]) -> FloatArray | None:
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
