"""NMEA 0183 sentences in a text file, with or without time stamps: heading, yaw rate, rudder, speed, position, wind.

Sentences mean what they mean on a line (`autopilot.links.nmea.samples`); RPM gives the propeller.

Without time stamps (`autopilot.logs.series`) the UTC in RMC, GGA, GLL and ZDA marks the times. Stamps of whole seconds
mark them where sentences of one type come several a second.
"""

from __future__ import annotations

import math
import re
from array import array
from collections import Counter
from datetime import UTC, datetime
from functools import reduce
from operator import xor
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.links.nmea.samples import NmeaReader
from autopilot.links.nmea.sentences import NmeaFramer, NoDataError, Sentence, letter, number, status
from autopilot.logs.series import (
    EPOCH_FROM,
    HEADING,
    PROPELLER,
    ROLL,
    SPEED,
    WIND_DIRECTION,
    WIND_SPEED,
    FloatArray,
    Gathered,
    LogFormat,
    Progress,
    Recording,
    Series,
    counted_on,
    lines_in,
    of_day,
    on_one_clock,
    quantities_of,
    series_of,
    silent,
    spread,
    stamp_of,
)
from autopilot.signals import WindSample

UTC_FIELD = {"RMC": 0, "GGA": 0, "GLL": 4, "ZDA": 0}

_ZDA_DATE = re.compile(r"(\d\d?),(\d\d?),(\d{4})")
_RMC_DATE = re.compile(r"(\d\d)(\d\d)(\d\d)")


def utc_of(sentence: Sentence) -> float | None:
    """Return the UTC time of day [s] in a sentence that has one, None in others."""
    place = UTC_FIELD.get(sentence.type)
    if place is None or place >= len(sentence.fields):
        return None
    text = sentence.fields[place]
    if not re.fullmatch(r"\d{6}(\.\d*)?", text):
        return None
    return of_day(text[:2], text[2:4], text[4:])


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


RPM_LIMIT = 100_000.0
_PASHR = re.compile(rb"\$(PASHR,([^*]{0,80}))\*([0-9A-Fa-f]{2})")
"""Attitude of a satellite compass: time, heading, T, roll, pitch, ... behind the commas."""
XDR_ROLLS = (("A", "D", "ROLL"), ("A", "D", "HEEL"))
"""Kind, unit and name of a transducer that measures roll [deg]."""
BAD_SHARE = 0.2
SEVERAL = 1.5
"""More sentences of one type than so many a second are not said once a second."""
THROUGH_WATER = "VHW"
LOOK_AT = 65536


class Lines(NamedTuple):
    """The sentences of a file, by numbers alone: of millions everything else is read again where it is used.

    places: bytes of the file before each. stamps [s]: what stands before each says, nan where nothing does. is_of_day:
    all of those are times of day. marks: place and UTC [s] of those that tell it. day: the beginning of the first day
    that one names [s since 1970], None where none does. types: theirs.
    """

    places: array[int]
    stamps: array[float]
    is_of_day: bool
    marks: list[tuple[float, float]]
    day: float | None
    types: Counter[str]


def is_nmea_text(data: bytes) -> bool:
    """Return whether the beginning of a file holds a sentence with a right checksum."""
    return bool(_lines(data[:LOOK_AT])[0].places)


def read_nmea(path: str, data: bytes, variation: float | None = None, progress: Progress = silent) -> Recording:
    """Return the recording in a file of sentences. variation [rad], east positive: of magnetic compasses, None to take
    what the sentences say, and where they say none leave headings magnetic. Raises InputError.
    """
    lines, bad = _lines(data, progress)
    if bad > BAD_SHARE * (len(lines.places) + bad):
        raise InputError(
            f"{path}: {bad} of {len(lines.places) + bad} sentences have a wrong checksum or form; it is damaged."
        )
    time, date, notes = _times(path, lines)
    if bad:
        notes.append(f"{path}: {bad} sentences with a wrong checksum or form are left out.")
    series, remarks = _series(path, data, lines, time, variation)
    notes.extend(remarks)
    if not series:
        raise InputError(
            f"{path}: holds no heading, rate, rudder or speed (HDG, HDM, HDT, THS, ROT, RSA, VHW, RMC, VTG)."
        )
    return on_one_clock(Recording(path, "NMEA 0183 sentences", tuple(series), date, tuple(notes)))


def _lines(data: bytes, progress: Progress = silent) -> tuple[Lines, int]:
    """Return the sentences, and how many lines had a sentence that was wrong."""
    places, stamps = array("q"), array("d")
    marks: list[tuple[float, float]] = []
    types = Counter[str]()
    day: float | None = None
    bad, place, of_day = 0, 0, 0
    is_torn = False
    for raw in lines_in(data, progress):
        start = raw.find(b"$")
        if start >= 0:
            framer = NmeaFramer()
            sentence = next(iter(framer.feed(raw[start:].rstrip().rstrip(b'"') + b"\r\n")), None)
            if sentence is None and (attitude := _PASHR.match(raw, start)) is not None:
                # a maker's own sentence, which no link reads
                if reduce(xor, attitude[1]) == int(attitude[3], 16):
                    sentence = _sentence(raw, start)
                else:
                    bad += 1
            if sentence is not None:
                stamp = stamp_of(raw[:start].decode("ascii", "replace"))
                of_day += stamp is not None and stamp[1]
                places.append(place + start)
                stamps.append(math.nan if stamp is None else stamp[0])
                types[sentence.type] += 1
                if (utc := utc_of(sentence)) is not None:
                    marks.append((place + start, utc))
                day = date_of(sentence) if day is None else day
            bad += framer.counts.checksum_errors + framer.counts.malformed
        elif raw.strip():
            # of a last line that was being written, what stands before the sentence may be all there is
            is_torn = not raw.endswith((b"\n", b"\r")) and stamp_of(raw.decode("ascii", "replace")) is not None
        place += len(raw)
    return Lines(places, stamps, of_day == len(stamps), marks, day, types), bad + is_torn


def _sentence(data: bytes, place: int) -> Sentence:
    """Return the sentence of which the $ stands at a place; that it is sound is known."""
    address, *fields = data[place + 1 : data.index(b"*", place)].decode("ascii", "replace").split(",")
    return Sentence(address[:2], address[2:], tuple(fields), 0)


def _times(path: str, lines: Lines) -> tuple[FloatArray, float | None, list[str]]:
    """Return the time [s] of each line, the Unix time of zero or None, and notes."""
    stamps = np.array(lines.stamps)
    count = int(np.count_nonzero(np.isfinite(stamps)))
    if 0 < count == stamps.size:
        time, notes = counted_on(path, stamps, lines.is_of_day, "sentence"), []
        seconds = np.unique(time)
        if np.all(seconds % 1.0 == 0.0) and max(lines.types.values()) > SEVERAL * seconds.size:
            finer = spread(np.array(lines.places), list(zip(lines.places, stamps, strict=True)))
            time = time if finer is None else finer
            notes.append(f"{path}: its time stamps are whole seconds; times are spread between them.")
        return time, lines.day if lines.is_of_day else 0.0 if time[-1] > EPOCH_FROM else None, notes
    spread_out = spread(np.array(lines.places), lines.marks)
    if spread_out is None:
        raise InputError(
            f"{path}: when its sentences came cannot be determined: {count} of {stamps.size} have a time stamp before "
            f"them, and {len(lines.marks)} a UTC inside (RMC, GGA, GLL, ZDA); record with time stamps."
        )
    return spread_out, lines.day, [f"{path}: has no time stamps; times are spread between the UTC in its sentences."]


def _series(
    path: str, data: bytes, lines: Lines, time: FloatArray, variation: float | None
) -> tuple[list[Series], list[str]]:
    found = _values(data, lines, time, variation)
    notes = []
    if not any(quantity == HEADING for quantity, _ in found) and not lines.types.keys().isdisjoint(("HDG", "HDM")):
        found = _values(data, lines, time, 0.0)
        notes.append(f"{path}: the variation is not known; headings are magnetic, which does for the identification.")
    ordered = sorted(found.items(), key=lambda item: item[0][0] == SPEED and not item[0][1].endswith(THROUGH_WATER))
    return [series for key, pairs in ordered for series in series_of(*key, *pairs)], notes


def _values(data: bytes, lines: Lines, time: FloatArray, variation: float | None) -> Gathered[tuple[str, str]]:
    """Return times and values by quantity and source."""
    reader = NmeaReader(variation)
    found = Gathered[tuple[str, str]]()
    for place, when in zip(lines.places, time, strict=True):
        sentence = _sentence(data, place)
        source = sentence.talker + sentence.type
        pairs = _around(sentence)
        sample = reader.read(float(when), sentence)
        for one in (sample, *reader.take_others()):
            if isinstance(one, WindSample):
                pairs += [(WIND_SPEED, one.speed), (WIND_DIRECTION, one.angle)]
            elif one is not None:
                pairs += quantities_of(one)
        for quantity, value in pairs:
            found.put((quantity, source), when, value)
    return found


def _around(sentence: Sentence) -> list[tuple[str, float]]:
    """Return a shaft's RPM (S, number, rpm, pitch, A), the roll of XDR (A, value, D, name; any number of them) or PASHR
    (time, heading, T, roll, ...)."""
    fields = sentence.fields
    try:
        if sentence.type == "RPM":
            letter(fields, 0, "S")
            status(fields, 4)
            return [(PROPELLER, number(fields, 2, -RPM_LIMIT, RPM_LIMIT) / 60.0)]
        if sentence.type == "XDR":
            groups = zip(*(fields[part::4] for part in range(4)), strict=False)
            rolls = tuple(value for kind, value, unit, name in groups if (kind, unit, name.upper()) in XDR_ROLLS)
            return [(ROLL, math.radians(number(rolls, 0, -180.0, 180.0)))] if rolls else []
        if sentence.talker + sentence.type == "PASHR":
            return [(ROLL, math.radians(number(fields, 3, -180.0, 180.0)))]
    except (ValueError, KeyError, NoDataError):
        return []
    return []


FORMAT = LogFormat(
    "NMEA sentences in text",
    is_nmea_text,
    lambda path, data, options: read_nmea(path, data, options.variation, options.progress),
    is_text=True,
)
