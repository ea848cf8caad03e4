"""NMEA 0183 sentences in a text file, with or without time stamps: heading, yaw rate, rudder, speed, position, wind.

Sentences mean what they mean on a line (`links.nmea_samples`); MWV gives the apparent wind and RPM the propeller.
"""

from __future__ import annotations

import math
from collections import defaultdict
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.links.nmea0183 import NmeaFramer, Sentence
from autopilot.links.nmea_encoders import KMH_M_S, KNOT_M_S
from autopilot.links.nmea_fields import SPEED_LIMIT, NoDataError, angle, letter, number, status
from autopilot.links.nmea_samples import NmeaReader
from autopilot.loop.logs.nmea_clock import EPOCH_FROM, date_of, spread, stamp_of, utc_of, without_midnight
from autopilot.loop.logs.series import (
    HEADING,
    LATITUDE,
    LONGITUDE,
    PROPELLER,
    RATE,
    RUDDER,
    SPEED,
    WIND_DIRECTION,
    WIND_SPEED,
    FloatArray,
    Recording,
    Series,
    on_one_clock,
    series_of,
)
from autopilot.signals import HeadingSample, PositionSample, RateSample, RudderSample, Sample, SpeedSample

WIND_UNITS = {"N": KNOT_M_S, "M": 1.0, "K": KMH_M_S}
RPM_LIMIT = 100_000.0
BAD_SHARE = 0.2
THROUGH_WATER = "VHW"
LOOK_AT = 65536


class Line(NamedTuple):
    """A sentence, what stands before it, and at which byte it begins."""

    sentence: Sentence
    prefix: str
    place: int


def is_nmea_text(data: bytes) -> bool:
    """Return whether the beginning of a file holds a sentence with a right checksum."""
    return bool(_lines(data[:LOOK_AT])[0])


def read_nmea(path: str, data: bytes, variation: float | None = None) -> Recording:
    """Return the recording in a file of sentences. variation [rad], east positive: of magnetic compasses, None to take
    what the sentences say, and where they say none leave headings magnetic. Raises InputError.
    """
    lines, bad = _lines(data)
    if bad > BAD_SHARE * (len(lines) + bad):
        raise InputError(f"{path}: {bad} of {len(lines) + bad} sentences have a wrong checksum or form; it is damaged.")
    time, date, notes = _times(path, lines)
    if bad:
        notes.append(f"{path}: {bad} sentences with a wrong checksum or form are left out.")
    series, told = _series(path, lines, time, variation)
    notes.extend(told)
    if not series:
        raise InputError(
            f"{path}: holds no heading, rate, rudder or speed (HDG, HDM, HDT, THS, ROT, RSA, VHW, RMC, VTG)."
        )
    return on_one_clock(Recording(path, "NMEA 0183 sentences", tuple(series), date, tuple(notes)))


def _lines(data: bytes) -> tuple[list[Line], int]:
    """Return the sentences, and how many lines had a sentence that was wrong."""
    lines, bad, place = [], 0, 0
    for raw in data.splitlines(keepends=True):
        start = raw.find(b"$")
        if start >= 0:
            framer = NmeaFramer()
            found = framer.feed(raw[start:].rstrip().rstrip(b'"') + b"\r\n")
            if found:
                lines.append(Line(found[0], raw[:start].decode("ascii", "replace"), place + start))
            bad += framer.counts.checksum_errors + framer.counts.malformed
        place += len(raw)
    return lines, bad


def _times(path: str, lines: list[Line]) -> tuple[FloatArray, float | None, list[str]]:
    """Return the time [s] of each line, the Unix time of zero or None, and notes."""
    stamps = [stamp_of(line.prefix) for line in lines]
    if lines and all(stamp is not None for stamp in stamps):
        return _stamped(path, lines, [stamp for stamp in stamps if stamp is not None])
    marks = [(line.place, utc) for line in lines if (utc := utc_of(line.sentence)) is not None]
    time = spread([line.place for line in lines], marks)
    if time is None:
        stamped = sum(stamp is not None for stamp in stamps)
        raise InputError(
            f"{path}: when its sentences came cannot be told: {stamped} of {len(lines)} have a time stamp before them, "
            f"and {len(marks)} a UTC inside (RMC, GGA, GLL, ZDA); record with time stamps."
        )
    note = f"{path}: has no time stamps; times are spread between the UTC in its sentences."
    return time, _day(lines), [note]


def _stamped(
    path: str, lines: list[Line], stamps: list[tuple[float, bool]]
) -> tuple[FloatArray, float | None, list[str]]:
    time = np.array([seconds for seconds, _ in stamps])
    of_day = all(of_day for _, of_day in stamps)
    time = without_midnight(time) if of_day else time
    back = np.flatnonzero(np.diff(time) < -1.0)
    if back.size:
        raise InputError(
            f"{path}: the time stamps step back by {time[back[0]] - time[back[0] + 1]:.1f} s at sentence "
            f"{back[0] + 2}: the clock was set, or two logs were put together; keep one part."
        )
    if of_day:
        return time, _day(lines), []
    return time, 0.0 if time[-1] > EPOCH_FROM else None, []


def _day(lines: list[Line]) -> float | None:
    """Return the beginning of the first day that a sentence names [s since 1970], None where none does."""
    return next((day for line in lines if (day := date_of(line.sentence)) is not None), None)


def _series(path: str, lines: list[Line], time: FloatArray, variation: float | None) -> tuple[list[Series], list[str]]:
    found = _values(lines, time, variation)
    notes = []
    if not any(quantity == HEADING for quantity, _ in found) and any(
        line.sentence.type in ("HDG", "HDM") for line in lines
    ):
        found = _values(lines, time, 0.0)
        notes.append(f"{path}: the variation is not known; headings are magnetic, which does for the identification.")
    ordered = sorted(found.items(), key=lambda item: item[0][0] == SPEED and not item[0][1].endswith(THROUGH_WATER))
    return [
        series
        for (quantity, source), pairs in ordered
        for series in series_of(quantity, source, [when for when, _ in pairs], [value for _, value in pairs])
    ], notes


def _values(
    lines: list[Line], time: FloatArray, variation: float | None
) -> dict[tuple[str, str], list[tuple[float, float]]]:
    reader = NmeaReader(variation)
    found: defaultdict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    for line, when in zip(lines, time.tolist(), strict=True):
        source = line.sentence.talker + line.sentence.type
        pairs = _around(line.sentence)
        sample = reader.read(when, line.sentence)
        for one in (sample, reader.take_position()):
            pairs += [] if one is None else _pairs(one)
        for quantity, value in pairs:
            found[quantity, source].append((when, value))
    return found


def _pairs(sample: Sample) -> list[tuple[str, float]]:
    match sample:
        case HeadingSample(heading=heading):
            return [(HEADING, heading)]
        case RateSample(rate=rate):
            return [(RATE, rate)]
        case RudderSample(angle=rudder):
            return [(RUDDER, rudder)]
        case SpeedSample(speed=speed):
            return [(SPEED, speed)]
        case PositionSample(latitude=latitude, longitude=longitude):
            return [(LATITUDE, latitude), (LONGITUDE, longitude)]
    return []


def _around(sentence: Sentence) -> list[tuple[str, float]]:
    """Return the apparent wind of MWV (angle, R, speed, unit, A) and a shaft's RPM (S, number, rpm, pitch, A)."""
    fields = sentence.fields
    try:
        if sentence.type == "MWV" and fields[1:2] == ("R",):
            status(fields, 4)
            speed = number(fields, 2, 0.0, SPEED_LIMIT) * WIND_UNITS[fields[3]]
            return [(WIND_SPEED, speed), (WIND_DIRECTION, math.remainder(angle(fields, 0), math.tau))]
        if sentence.type == "RPM":
            letter(fields, 0, "S")
            status(fields, 4)
            return [(PROPELLER, number(fields, 2, -RPM_LIMIT, RPM_LIMIT) / 60.0)]
    except (ValueError, KeyError, NoDataError):
        return []
    return []
