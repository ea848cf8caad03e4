"""What NMEA 2000 parameter groups mean: decoded fields to samples, and a node's address. Pure.

    127250 vessel heading   127251 rate of turn   127245 rudder   127237 heading/track control
     60928 ISO address claim: the node with the lower name keeps a contested address

Source: field names and encodings of the canboat project's PGN database (https://canboat.github.io/canboat/), which
the decoder package uses; address claim after SAE J1939-81.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import NamedTuple

from autopilot.links.north import steered
from autopilot.signals import HeadingSample, RateSample, RudderSample, Sample

HEADING, RATE_OF_TURN, RUDDER, CONTROL = 127250, 127251, 127245, 127237
ADDRESS_CLAIM, REQUEST = 60928, 59904
READ = (HEADING, RATE_OF_TURN, RUDDER)
EVERYBODY = 255
ADDRESS_LAST = 251
NO_ADDRESS = 254
NORTHS = ("True", "Magnetic")
RUDDER_MOST = 0.5 * math.pi
RATE_MOST = 10.0
NAME = 1 << 63 | 4 << 60 | 40 << 49 | 150 << 40 | 2046 << 21
"""Arbitrary address capable, marine, class 40 "steering and control surfaces", function 150 "autopilot", maker 2046
(none of the registered ones); the unique number comes below."""

Fields = Mapping[str, object]


def identifier(group: int, source: int, priority: int = 2, destination: int = EVERYBODY) -> int:
    """Return the 29 bits of a frame's identifier."""
    low = destination if (group >> 8) & 0xFF < 240 else group & 0xFF
    return priority << 26 | (group >> 8) << 16 | low << 8 | source


def group_and_source(identifier: int) -> tuple[int, int]:
    """Return parameter group number and source address of an identifier."""
    group = identifier >> 8 & 0x3FFFF
    return (group & 0x3FF00 if (group >> 8) & 0xFF < 240 else group), identifier & 0xFF


class Compass(NamedTuple):
    """variation [rad], east positive, where a heading brings none of its own; magnetic: whether such are steered."""

    variation: float | None = None
    magnetic: bool = False


def sample_of(group: int, now: float, fields: Fields, compass: Compass, source: str) -> Sample | None:
    """Return the sample in the decoded `fields` of `group`; None where it holds none or what cannot be."""
    if group == HEADING:
        return _heading(now, fields, compass, source)
    if group == RATE_OF_TURN:
        rate = _number(fields, "rate", RATE_MOST)
        return None if rate is None else RateSample(now, rate, source)
    if group == RUDDER:
        position = _number(fields, "position", RUDDER_MOST)
        return None if position is None else RudderSample(now, position, False, source)
    return None


def own_variation(fields: Fields) -> float | None:
    """Return the variation [rad] in a heading message; None where it has none."""
    return _number(fields, "variation", math.pi)


def is_heading(group: int, fields: Fields) -> bool:
    """Return whether a message holds a heading, usable or not."""
    heading = _number(fields, "heading", math.tau)
    return group == HEADING and heading is not None and heading >= 0.0 and fields.get("reference") in NORTHS


def _heading(now: float, fields: Fields, compass: Compass, source: str) -> Sample | None:
    heading = _number(fields, "heading", math.tau)
    reference = fields.get("reference")
    if heading is None or heading < 0.0 or reference not in NORTHS:
        return None
    own = own_variation(fields)
    east = compass.variation if own is None else own
    is_magnetic = reference == "Magnetic"
    if is_magnetic:
        heading += _number(fields, "deviation", 0.5 * math.pi) or 0.0
    found = steered(heading, is_magnetic=is_magnetic, by_compass=compass.magnetic, variation=east)
    return None if found is None else HeadingSample(now, found, None, source)


def _number(fields: Fields, name: str, most: float) -> float | None:
    value = fields.get(name)
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= most:
        return None
    return float(value)


class NodeAddress:
    """Our address on the bus: claimed at the start, defended against higher names, left to lower ones.

    `current` is NO_ADDRESS where every address was taken: then nothing may be sent but that.
    """

    def __init__(self, first: int = 204, unique: int = 1) -> None:
        self.current = first
        self.name = NAME | unique & 0x1FFFFF
        self._refused: set[int] = set()

    def claim(self) -> tuple[int, bytes]:
        """Return identifier and data of our claim."""
        return identifier(ADDRESS_CLAIM, self.current, 6), struct.pack("<Q", self.name)

    def heard(self, group: int, source: int, data: bytes) -> bool:
        """Take a claim or request of another node; return whether we have to claim (again)."""
        if group == REQUEST and len(data) >= 3:
            return int.from_bytes(data[:3], "little") == ADDRESS_CLAIM
        if group != ADDRESS_CLAIM or source != self.current or len(data) != 8:
            return False
        (name,) = struct.unpack("<Q", data)
        if name > self.name:
            return True
        self._refused.add(self.current)
        free = [address for address in range(128, ADDRESS_LAST + 1) if address not in self._refused]
        self.current = free[0] if free else NO_ADDRESS
        return True
