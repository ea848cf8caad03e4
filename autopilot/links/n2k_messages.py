"""NMEA 2000 without a bus: identifiers of frames, fast packets put together, parameter groups decoded to samples. Pure.

    127245 rudder           127250 vessel heading      127251 rate of turn       127257 attitude
    127258 variation        128259 speed through water 129025 position           129026 course and speed over ground
    129029 GNSS position    130306 wind                126992 system time

A value is SI and radians, under canboat's name of its field. Of every number the three highest are no data, but an
error, "not available" and a reserved one.

Source: layouts, resolutions and words of the canboat project's PGN database, canboat.json
(https://canboat.github.io/canboat/canboat.html); identifiers after SAE J1939-21.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from autopilot.links.north import steered
from autopilot.signals import (
    HeadingSample,
    PositionSample,
    RateSample,
    RollSample,
    RudderSample,
    Sample,
    SpeedSample,
)

HEADING, RATE_OF_TURN, RUDDER, ATTITUDE, VARIATION = 127250, 127251, 127245, 127257, 127258
WATER_SPEED, POSITION, GROUND_SPEED, GNSS, WIND, SYSTEM_TIME = 128259, 129025, 129026, 129029, 130306, 126992
EVERYBODY = 255
IDENTIFIER_MOST = 0x1FFFFFFF
NORTHS = ("True", "Magnetic")
RUDDER_MOST = 0.5 * math.pi
RATE_MOST = 10.0
ROLL_MOST = math.pi
SPEED_MOST = 100.0
DAY_S = 86400.0
CLOCKS_FROM_S = 10957 * DAY_S
"""The year 2000: an earlier date is that of a receiver that has heard no satellite yet."""

Fields = Mapping[str, object]


def identifier(group: int, source: int, priority: int = 2, destination: int = EVERYBODY) -> int:
    """Return the 29 bits of a frame's identifier."""
    low = destination if (group >> 8) & 0xFF < 240 else group & 0xFF
    return priority << 26 | (group >> 8) << 16 | low << 8 | source


def group_and_source(identifier: int) -> tuple[int, int]:
    """Return parameter group number and source address of an identifier."""
    group = identifier >> 8 & 0x3FFFF
    return (group & 0x3FF00 if (group >> 8) & 0xFF < 240 else group), identifier & 0xFF


class Field(NamedTuple):
    """A number of `bits` from bit `start` on, little endian; unit: what one step of it is, in SI and radians.

    words: what its values mean, where they are words.
    """

    name: str
    start: int
    bits: int
    unit: float = 1.0
    signed: bool = False
    words: tuple[str, ...] = ()


ANGLE = 1.0e-4
DIRECTION = (*NORTHS, "Error")
FIXES = ("no GNSS", "GNSS fix", "DGNSS fix", "Precise GNSS", "RTK Fixed Integer", "RTK float", "Estimated (DR) mode")
WINDS = ("True (ground referenced to North)", "Magnetic (ground referenced to Magnetic North)", "Apparent")
ORDERS = ("No Order", "Move to starboard", "Move to port")
LAYOUTS: dict[int, tuple[Field, ...]] = {
    HEADING: (
        Field("heading", 8, 16, ANGLE),
        Field("deviation", 24, 16, ANGLE, True),
        Field("variation", 40, 16, ANGLE, True),
        Field("reference", 56, 2, words=DIRECTION),
    ),
    RATE_OF_TURN: (Field("rate", 8, 32, 3.125e-8, True),),
    RUDDER: (
        Field("instance", 0, 8),
        Field("directionOrder", 8, 3, words=ORDERS),
        Field("angleOrder", 16, 16, ANGLE, True),
        Field("position", 32, 16, ANGLE, True),
    ),
    ATTITUDE: (
        Field("yaw", 8, 16, ANGLE, True),
        Field("pitch", 24, 16, ANGLE, True),
        Field("roll", 40, 16, ANGLE, True),
    ),
    VARIATION: (Field("variation", 32, 16, ANGLE, True),),
    WATER_SPEED: (Field("speedWaterReferenced", 8, 16, 0.01),),
    POSITION: (
        Field("latitude", 0, 32, math.radians(1.0e-7), True),
        Field("longitude", 32, 32, math.radians(1.0e-7), True),
    ),
    GROUND_SPEED: (
        Field("cogReference", 8, 2, words=DIRECTION),
        Field("cog", 16, 16, ANGLE),
        Field("sog", 32, 16, 0.01),
    ),
    GNSS: (
        Field("date", 8, 16, DAY_S),
        Field("time", 24, 32, 1.0e-4),
        Field("latitude", 56, 64, math.radians(1.0e-16), True),
        Field("longitude", 120, 64, math.radians(1.0e-16), True),
        Field("method", 252, 4, words=FIXES),
    ),
    WIND: (
        Field("windSpeed", 8, 16, 0.01),
        Field("windAngle", 24, 16, ANGLE),
        Field("reference", 40, 3, words=WINDS),
    ),
    SYSTEM_TIME: (Field("date", 16, 16, DAY_S), Field("time", 32, 32, 1.0e-4)),
}
FAST = (GNSS,)
"""Those of them that are longer than a frame: they travel as fast packets."""
NO_DATA = 3


def decoded(group: int, data: bytes) -> dict[str, object]:
    """Return the fields of `group` that `data` holds, whatever it is; none of a group that is not in LAYOUTS."""
    found: dict[str, object] = {}
    whole, bits = int.from_bytes(data, "little"), 8 * len(data)
    for name, start, width, unit, signed, words in LAYOUTS.get(group, ()):
        if start + width > bits:
            continue
        raw = whole >> start & (1 << width) - 1
        if words:
            if raw < len(words):
                found[name] = words[raw]
        elif signed:
            half = 1 << width - 1
            if not half - NO_DATA <= raw < half:
                found[name] = (raw - 2 * half if raw >= half else raw) * unit
        elif raw < (1 << width) - NO_DATA:
            found[name] = raw * unit
    return found


FRAME_BYTES = 8
PACKET_S = 1.0
"""A fast packet whose next frame comes later than this after its last one is given up; a sender has it out in less."""


class FastPackets:
    """Puts the frames of fast packets together, by source, group and sequence number.

    A frame begins with the sequence number (3 bits) and its place (5 bits); the first goes on with the packet's length.
    `lost`: packets of which a frame did not come.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._begun: dict[tuple[int, int, int], tuple[int, int, float, bytes]] = {}

    def add(self, now: float, group: int, source: int, frame: bytes) -> bytes | None:
        """Return the packet that `frame`, which came at `now` [s], completes; None where it completes none."""
        if len(frame) < 2:
            return None
        key = (source, group, frame[0] >> 5)
        place = frame[0] & 0x1F
        before = self._begun.pop(key, None)
        if place == 0:
            self.lost += before is not None
            length, got = frame[1], frame[2:FRAME_BYTES]
        else:
            if before is None:
                return None
            length, last, then, got = before
            if place != last + 1 or not 0.0 <= now - then <= PACKET_S:
                self.lost += 1
                return None
            got += frame[1:FRAME_BYTES]
        if len(got) >= length:
            return got[:length]
        self._begun[key] = (length, place, now, got)
        return None


class Compass(NamedTuple):
    """variation [rad], east positive, where a heading brings none of its own; magnetic: whether such are steered."""

    variation: float | None = None
    magnetic: bool = False


def sample_of(group: int, now: float, fields: Fields, compass: Compass, source: str) -> Sample | None:
    """Return the sample in the decoded `fields` of `group`; None where it holds none or what cannot be."""
    if group == HEADING:
        return _heading(now, fields, compass, source)
    if group == RATE_OF_TURN:
        rate = number(fields, "rate", RATE_MOST)
        return None if rate is None else RateSample(now, rate, source)
    if group == RUDDER:
        position = number(fields, "position", RUDDER_MOST)
        return None if position is None else RudderSample(now, position, False, source)
    if group == ATTITUDE:
        roll = number(fields, "roll", ROLL_MOST)
        return None if roll is None else RollSample(now, roll, None, source)
    if group in (WATER_SPEED, GROUND_SPEED):
        speed = number(fields, "speedWaterReferenced" if group == WATER_SPEED else "sog", SPEED_MOST)
        return None if speed is None else SpeedSample(now, speed, group == GROUND_SPEED, source)
    if group in (POSITION, GNSS):
        latitude, longitude = number(fields, "latitude", 0.5 * math.pi), number(fields, "longitude", math.pi)
        if latitude is None or longitude is None or fields.get("method") == "no GNSS":
            return None
        return PositionSample(now, latitude, longitude, source)
    return None


def rudder_order(fields: Fields) -> float | None:
    """Return the ordered rudder [rad], starboard positive, in a rudder message; None where it orders none.

    The direction decides the side where there is one: some give the angle without a sign.
    """
    angle = number(fields, "angleOrder", RUDDER_MOST)
    direction = fields.get("directionOrder")
    if angle is None or direction == "No Order":
        return None
    return angle if direction is None else math.copysign(angle, -1.0 if direction == "Move to port" else 1.0)


def apparent_wind(fields: Fields) -> tuple[float, float] | None:
    """Return speed [m/s] and direction off the bow [rad] of the apparent wind; None where it is another or none."""
    speed, angle = number(fields, "windSpeed", SPEED_MOST), number(fields, "windAngle", math.tau)
    if speed is None or angle is None or fields.get("reference") != "Apparent":
        return None
    return speed, math.remainder(angle, math.tau)


def moment(fields: Fields) -> float | None:
    """Return the Unix time [s] in a message that has date and time; None where it has not both, or they are not set."""
    date, time = number(fields, "date", 65532.0 * DAY_S), number(fields, "time", DAY_S + 1.0)
    return None if date is None or time is None or date < CLOCKS_FROM_S else date + time


def own_variation(fields: Fields) -> float | None:
    """Return the variation [rad] in a message; None where it has none."""
    return number(fields, "variation", math.pi)


def is_heading(group: int, fields: Fields) -> bool:
    """Return whether a message holds a heading, usable or not."""
    heading = number(fields, "heading", math.tau)
    return group == HEADING and heading is not None and heading >= 0.0 and fields.get("reference") in NORTHS


def _heading(now: float, fields: Fields, compass: Compass, source: str) -> Sample | None:
    heading = number(fields, "heading", math.tau)
    reference = fields.get("reference")
    if heading is None or heading < 0.0 or reference not in NORTHS:
        return None
    own = own_variation(fields)
    east = compass.variation if own is None else own
    is_magnetic = reference == "Magnetic"
    if is_magnetic:
        heading += number(fields, "deviation", 0.5 * math.pi) or 0.0
    found = steered(heading, is_magnetic=is_magnetic, by_compass=compass.magnetic, variation=east)
    return None if found is None else HeadingSample(now, found, None, source)


def number(fields: Fields, name: str, most: float) -> float | None:
    """Return the field's number where there is one, of at most `most` to both sides."""
    value = fields.get(name)
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= most:
        return None
    return float(value)
