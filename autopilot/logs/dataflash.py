"""ArduPilot's DataFlash logs (.BIN), which describe themselves: messages by name, a column for each field.

A record is 0xA3 0x95, a type and the type's payload. Type 128 (FMT) says of a type its number, its length with these
three bytes, its name, a letter for each field and the fields' names. Written from the format's description in
ArduPilot, libraries/AP_Logger/LogStructure.h and README.md; pymavlink's own reader needs mavutil.

What ArduPilot's DataFlash messages mean for a boat: heading, yaw rate, speed, position, steering, propeller, wind.

ATT.Yaw [deg], STER.TurnRate [deg/s], RATE.Y [deg/s], IMU.GyrZ [rad/s], GPS.Spd [m/s], POS and GPS positions, RCOU
pulses [us] through the servo's parameters in PARM, STER.SteerOut as a share of 4500, RPM [1/min], WIND off the bow.
Times are TimeUS since boot; GPS week and time of week give the date. Source: ArduPilot, Rover/Log.cpp,
libraries/AP_Logger/LogStructure.h, libraries/AP_GPS and AP_RPM/LogStructure.h, libraries/AP_WindVane/AP_WindVane.cpp.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.errors import InputError
from autopilot.links.mavlink.steering import FULL
from autopilot.logs.series import (
    HEADING,
    LATITUDE,
    LONGITUDE,
    PROPELLER,
    RATE,
    ROLL,
    SHARE,
    SHOWN_SHARE,
    SPEED,
    WIND_DIRECTION,
    WIND_SPEED,
    FloatArray,
    LogFormat,
    Progress,
    ReadOptions,
    Recording,
    Series,
    on_one_clock,
    series_of,
    silent,
    without_zeros,
)
from autopilot.logs.table import steering_series, steering_servo

HEAD = b"\xa3\x95"
FMT = 128
FMT_LENGTH = 89
DAMAGED_SHARE = 0.2

NUMBERS = {
    "b": ("i1", 1.0),
    "B": ("u1", 1.0),
    "M": ("u1", 1.0),
    "h": ("<i2", 1.0),
    "H": ("<u2", 1.0),
    "i": ("<i4", 1.0),
    "I": ("<u4", 1.0),
    "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
    "f": ("<f4", 1.0),
    "d": ("<f8", 1.0),
    "g": ("<f2", 1.0),
    "c": ("<i2", 0.01),
    "C": ("<u2", 0.01),
    "e": ("<i4", 0.01),
    "E": ("<u4", 0.01),
    "L": ("<i4", 1.0e-7),
}
"""Letter -> how a number is stored, and what it is multiplied by."""
TEXTS = {"n": "S4", "N": "S16", "Z": "S64", "a": "V64"}


class Layout(NamedTuple):
    """One kind of message: its name, length with the three head bytes, and how its payload is laid out."""

    name: str
    length: int
    letters: str
    labels: tuple[str, ...]
    dtype: np.dtype[np.void]


class DataFlash:
    """The messages of a log. Raises InputError where the file is none, or damaged beyond use.

    Attributes: skipped: bytes that belonged to no message. torn: bytes of a message that the file's end cut off.
    """

    def __init__(self, path: str, data: bytes, wanted: Sequence[str], progress: Progress = silent) -> None:
        self._path = path
        self._lengths = [0] * 256
        self._lengths[FMT] = FMT_LENGTH
        self._wanted = frozenset(wanted)
        self._places: dict[str, array[int]] = {}
        self._kept: dict[str, Layout] = {}
        self._lists: list[array[int] | None] = [None] * 256
        self.skipped = 0
        self.torn = 0
        self._data = np.frombuffer(data, dtype=np.uint8)
        self._walk(data, progress)
        sound = without_zeros(data)
        if self.skipped - (len(data) - sound) > DAMAGED_SHARE * sound:
            raise InputError(
                f"{path}: {self.skipped} of {len(data)} bytes belong to no message; the log is damaged beyond use."
            )

    def __contains__(self, name: str) -> bool:
        return bool(self._places.get(name))

    def column(self, name: str, *labels: str) -> FloatArray | None:
        """Return the numbers in the first of the fields `labels` that messages `name` have; None where none has."""
        layout = self._kept.get(name)
        label = next((label for label in labels if layout is not None and label in layout.labels), None)
        if layout is None or label is None or name not in self:
            return None
        letter = layout.letters[layout.labels.index(label)]
        if letter not in NUMBERS:
            raise InputError(f"{self._path}: {name}.{label} is text where a number belongs; it is no log of a vehicle.")
        return np.asarray(self._field(name, label), dtype=np.float64) * NUMBERS[letter][1]

    def texts(self, name: str, label: str) -> list[str]:
        """Return the texts in a field of messages `name`; none where there are no such."""
        layout = self._kept.get(name)
        if layout is None or name not in self or label not in layout.labels:
            return []
        if layout.letters[layout.labels.index(label)] not in ("n", "N", "Z"):
            raise InputError(f"{self._path}: {name}.{label} is a number where text belongs; it is no log of a vehicle.")
        return [bytes(text).split(b"\0")[0].decode("ascii", "replace") for text in self._field(name, label)]

    def _field(self, name: str, label: str) -> NDArray[Any]:
        """Return a field of messages `name` as it is stored, gathered byte by byte: places of all their bytes at once
        would take more than the file."""
        fields = self._kept[name].dtype.fields
        assert fields is not None
        stored, offset = fields[label][:2]
        places = np.asarray(self._places[name]) + (len(HEAD) + 1 + offset)
        payload = np.stack([self._data[places + at] for at in range(stored.itemsize)], axis=1)
        return payload.view(stored)[:, 0]

    def _walk(self, data: bytes, progress: Progress) -> None:
        place, end, lengths, lists = 0, len(data), self._lengths, self._lists
        shown = 0
        while place + 3 <= end:
            if place >= shown:
                progress(place, end)
                shown = place + end // SHOWN_SHARE
            kind = data[place + 2]
            length = lengths[kind] if data[place] == 0xA3 and data[place + 1] == 0x95 else 0
            if not length:
                follows = self._next_start(data, place + 1)
                self.skipped += follows - place
                place = follows
                continue
            if place + length > end:
                break
            if kind == FMT:
                self._define(data, place)
            found = lists[kind]
            if found is not None:
                found.append(place)
            place += length
        self.torn = end - place

    def _next_start(self, data: bytes, place: int) -> int:
        """Return where, from `place` on, a message of a known type begins that another one or the end follows."""
        while True:
            place = data.find(HEAD, place)
            if place < 0 or place + 3 > len(data):
                return len(data)
            length = self._lengths[data[place + 2]]
            behind = data[place + length : place + length + 2]
            if length and (behind == HEAD or place + length == len(data)):
                return place
            place += 1

    def _define(self, data: bytes, place: int) -> None:
        kind, length = data[place + 3], data[place + 4]
        name, letters, labels = (
            data[place + start : place + stop].split(b"\0")[0].decode("ascii", "replace")
            for start, stop in ((5, 9), (9, 25), (25, 89))
        )
        if kind == FMT:
            return
        layout = _layout(name, length, letters, labels)
        if layout is None and name not in self._wanted and length > len(HEAD):
            # a field of a kind that is newer than this reader: its length is all that matters
            self._lengths[kind] = length
            return
        if layout is None:
            raise InputError(
                f"{self._path}: the description of message {(name or kind)!r} at byte {place} does not agree with "
                f"itself (length {length}, format {letters!r}, fields {labels!r}); the log is damaged there."
            )
        self._lengths[kind] = length
        if name in self._wanted:
            if name in self._kept and self._kept[name] != layout:
                raise InputError(f"{self._path}: message {name} is described twice, differently; it holds two logs.")
            self._kept[name] = layout
            self._lists[kind] = self._places.setdefault(name, array("q"))


def _layout(name: str, length: int, letters: str, labels: str) -> Layout | None:
    """Return the layout that a FMT describes, None where it cannot be."""
    names = tuple(labels.split(",")) if labels else ()
    if len(names) != len(letters) or len(set(names)) != len(names) or any(letter not in SIZES for letter in letters):
        return None
    dtype = np.dtype([(label, SIZES[letter]) for label, letter in zip(names, letters, strict=True)])
    return Layout(name, length, letters, names, dtype) if dtype.itemsize + 3 == length else None


SIZES = {**{letter: stored for letter, (stored, _) in NUMBERS.items()}, **TEXTS}


DEG = math.pi / 180.0
FIRST = 0.0
FIX_2D = 2
MEANINGS = (
    (HEADING, "ATT", "Yaw", DEG),
    (ROLL, "ATT", "Roll", DEG),
    (RATE, "STER", "TurnRate", DEG),
    (RATE, "RATE", "Y", DEG),
    (RATE, "IMU", "GyrZ", 1.0),
    (SPEED, "GPS", "Spd", 1.0),
    (SPEED, "THR", "Speed", 1.0),
    (LATITUDE, "POS", "Lat", DEG),
    (LONGITUDE, "POS", "Lng", DEG),
    (LATITUDE, "GPS", "Lat", DEG),
    (LONGITUDE, "GPS", "Lng", DEG),
    (PROPELLER, "RPM", "rpm1", 1.0 / 60.0),
    (PROPELLER, "RPM", "RPM", 1.0 / 60.0),
    (WIND_SPEED, "WIND", "SpdApp", 1.0),
    (WIND_DIRECTION, "WIND", "DrApp", DEG),
)
"""Quantity, message, field, factor; those of a quantity in order of preference."""
WANTED = (*{message for _, message, _, _ in MEANINGS}, "PARM", "RCOU")
GPS_EPOCH_S = 315_964_800.0
GPS_AHEAD_S = 18.0
"""GPS time is ahead of UTC by the leap seconds since 1980: 18 since 2017 (IERS Bulletin C)."""
WEEK_S = 604_800.0


def read_dataflash(path: str, data: bytes, options: ReadOptions = ReadOptions()) -> Recording:  # noqa: B008 - immutable
    """Return the recording in a .BIN. Raises InputError."""
    log = DataFlash(path, data, WANTED, options.progress)
    with np.errstate(all="ignore"):  # a damaged number may be anything; what is not finite is left out
        return _recording(path, log, options)


def _recording(path: str, log: DataFlash, options: ReadOptions) -> Recording:
    series = [found for meaning in MEANINGS for found in _series(log, *meaning)]
    if not any(s.quantity in (HEADING, RATE) for s in series):
        if "ATT" in log:
            raise InputError(f"{path}: holds ATT, but not one heading in it is a number; it is damaged.")
        raise InputError(
            f"{path}: holds no ATT, so no heading; set LOG_BITMASK so that attitude is logged, and LOG_DISARMED 1 "
            "where the boat is not armed."
        )
    notes = _damage(path, log)
    steering = _steering(path, log, options, notes)
    return on_one_clock(Recording(path, "ArduPilot DataFlash log", (*series, *steering), _began(log), tuple(notes)))


def _series(log: DataFlash, quantity: str, message: str, field: str, factor: float) -> tuple[Series, ...]:
    values, time = log.column(message, field), _time(log, message)
    if values is None or time is None:
        return ()
    keep = _first_instance(log, message)
    if message == "GPS":
        fix = log.column(message, "Status")
        keep = keep if fix is None else keep & (fix >= FIX_2D)
    return series_of(quantity, f"{message}.{field}", time[keep], values[keep] * factor)


def _time(log: DataFlash, message: str) -> FloatArray | None:
    micros, millis = log.column(message, "TimeUS"), log.column(message, "TimeMS")
    if micros is not None:
        return micros * 1.0e-6
    return None if millis is None else millis * 1.0e-3


def _first_instance(log: DataFlash, message: str) -> NDArray[np.bool_]:
    instance = log.column(message, "I", "Instance", "C")
    time = _time(log, message)
    assert time is not None
    return np.ones(time.size, dtype=bool) if instance is None else instance == FIRST


def _steering(path: str, log: DataFlash, options: ReadOptions, notes: list[str]) -> tuple[Series, ...]:
    names, values = log.texts("PARM", "Name"), log.column("PARM", "Value")
    # a damaged FMT may have left one of the two without its field
    parameters = dict(zip(names, values.tolist(), strict=True)) if names and values is not None else {}
    time = _time(log, "RCOU")

    def of_output(number: int) -> tuple[FloatArray, FloatArray] | None:
        pulses = log.column("RCOU", f"C{number}", f"Ch{number}")
        return None if pulses is None or time is None else (time, pulses)

    found = steering_series(path, parameters, options, of_output, "RCOU")
    if found is not None:
        return found
    if "RCOU" in log and steering_servo(path, parameters, options.servo) is None:
        notes.append(
            f"{path}: no PARM says which servo steers (SERVOn_FUNCTION 26); the firmware's steering output is taken "
            "instead where it is logged (STER), or say it with --servo NUMBER:MIN:TRIM:MAX."
        )
    return _series(log, SHARE, "STER", "SteerOut", 1.0 / FULL)


def _began(log: DataFlash) -> float | None:
    """Return the Unix time of the boot by the first fix that knows the week, None where there is none."""
    week, of_week, time = log.column("GPS", "GWk", "Week"), log.column("GPS", "GMS", "TimeMS"), _time(log, "GPS")
    fix = log.column("GPS", "Status")
    if week is None or of_week is None or time is None or fix is None:
        return None
    known = np.flatnonzero((week > 0.0) & (fix > FIX_2D))
    if known.size == 0:
        return None
    at = known[0]
    return float(GPS_EPOCH_S + week[at] * WEEK_S + of_week[at] * 1.0e-3 - GPS_AHEAD_S - time[at])


def _damage(path: str, log: DataFlash) -> list[str]:
    notes = []
    if log.skipped:
        notes.append(f"{path}: {log.skipped} bytes are damaged and left out; the rest of the log is used.")
    if log.torn:
        notes.append(f"{path}: the last {log.torn} bytes are a torn message and left out.")
    return notes


FORMAT = LogFormat(
    "an ArduPilot .BIN",
    lambda data: data.startswith(HEAD),
    lambda path, data, options: read_dataflash(path, data, options),
    ".bin",
    "does not begin with a DataFlash message (A3 95): this is no .BIN of ArduPilot",
)
