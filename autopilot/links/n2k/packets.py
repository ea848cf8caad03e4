"""NMEA 2000 frames and what they carry: identifiers, messages, fast packets put together and cut, broadcasts put
together; and the fields of messages, read and written by one table. Pure.

A message of up to 8 bytes is a frame. A longer one travels as a fast packet: each frame begins with the packet's
sequence number (3 bits) and its place (5 bits), and the first goes on with the packet's length. A commanded address
travels by the older transport protocol, as a broadcast (BAM): 60416 says how many bytes of which group come, and each
60160 begins with its number, from 1.

Source: identifiers and broadcasts after SAE J1939-21; fast packets as canboat describes them
(https://canboat.github.io/canboat/).

Groups in the table:

    59392 acknowledgement   59904 request              60928 address claim       65240 commanded address
    126208 group function
    126464 groups           126992 system time         126993 heartbeat          126996 product   126998 configuration
    127237 heading control  127245 rudder              127250 vessel heading     127251 rate of turn
    127257 attitude         127258 variation           128259 speed in water     129025 position
    129026 course and speed over ground                129029 GNSS position      129283 cross-track error
    129284 navigation data  129285 route and waypoints 130306 wind

A value is SI and radians, under canboat's name of its field. Of every number the three highest are no data, but an
error, "not available" and a reserved one. What has no table here (strings, lists, group functions) is written where it
is used.

Source: layouts, resolutions and words of the canboat project's PGN database, canboat.json
(https://canboat.github.io/canboat/canboat.html).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

ACKNOWLEDGEMENT, REQUEST, ADDRESS_CLAIM, COMMANDED_ADDRESS = 59392, 59904, 60928, 65240
GROUP_FUNCTION, GROUPS, SYSTEM_TIME, HEARTBEAT = 126208, 126464, 126992, 126993
PRODUCT, CONFIGURATION = 126996, 126998
ALERT, ALERT_RESPONSE, ALERT_TEXT = 126983, 126984, 126985
OVERBOARD = 127233
CONTROL, RUDDER, HEADING, RATE_OF_TURN, ATTITUDE, VARIATION = 127237, 127245, 127250, 127251, 127257, 127258
WATER_SPEED, POSITION, GROUND_SPEED, GNSS, WIND = 128259, 129025, 129026, 129029, 130306
CROSS_TRACK, NAVIGATION, ROUTE = 129283, 129284, 129285
NORTHS = ("True", "Magnetic")
DAY_S = 86400.0

Fields = Mapping[str, object]


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
PLACE = math.radians(1.0e-7)
DIRECTION = (*NORTHS, "Error")
YES_NO = ("No", "Yes")
FIXES = ("no GNSS", "GNSS fix", "DGNSS fix", "Precise GNSS", "RTK Fixed Integer", "RTK float", "Estimated (DR) mode")
WINDS = ("True (ground referenced to North)", "Magnetic (ground referenced to Magnetic North)", "Apparent")
ORDERS = ("No Order", "Move to starboard", "Move to port")
MAIN, FOLLOW_UP, HEADING_CONTROL, TRACK_CONTROL = (
    "Main Steering",
    "Follow-Up Device",
    "Heading Control",
    "Track Control",
)
STEERING = (MAIN, "Non-Follow-Up Device", FOLLOW_UP, "Heading Control Standalone", HEADING_CONTROL, TRACK_CONTROL)
TURNS = ("Rudder limit controlled", "Turn rate controlled", "Radius controlled")
BEACON, BUTTON, OVERBOARD_TEST = "MOB Emitter Activated", "Manual on-board MOB Button Activation", "Test mode"
BY_VESSEL = "Position estimated by the vessel"
XTE_MODES = ("Autonomous", "Differential enhanced", "Estimated", "Simulator", "Manual")

LAYOUTS: dict[int, tuple[Field, ...]] = {
    ACKNOWLEDGEMENT: (Field("control", 0, 8), Field("groupFunction", 8, 8), Field("pgn", 40, 24)),
    REQUEST: (Field("pgn", 0, 24),),
    SYSTEM_TIME: (Field("date", 16, 16, DAY_S), Field("time", 32, 32, 1.0e-4)),
    HEARTBEAT: (
        Field("dataTransmitOffset", 0, 16, 0.01),
        Field("sequenceCounter", 16, 8),
        Field("controller1State", 24, 2, words=("Error Active", "Error Passive", "Bus Off")),
        Field("equipmentStatus", 28, 2, words=("Operational", "Fault")),
    ),
    CONTROL: (
        Field("rudderLimitExceeded", 0, 2, words=YES_NO),
        Field("offHeadingLimitExceeded", 2, 2, words=YES_NO),
        Field("offTrackLimitExceeded", 4, 2, words=YES_NO),
        Field("override", 6, 2, words=YES_NO),
        Field("steeringMode", 8, 3, words=STEERING),
        Field("turnMode", 11, 3, words=TURNS),
        Field("headingReference", 14, 2, words=DIRECTION),
        Field("reserved", 16, 5),
        Field("commandedRudderDirection", 21, 3, words=ORDERS),
        Field("commandedRudderAngle", 24, 16, ANGLE, True),
        Field("headingToSteerCourse", 40, 16, ANGLE),
        Field("track", 56, 16, ANGLE),
        Field("rudderLimit", 72, 16, ANGLE),
        Field("offHeadingLimit", 88, 16, ANGLE),
        Field("radiusOfTurnOrder", 104, 16, 1.0, True),
        Field("rateOfTurnOrder", 120, 16, 3.125e-5, True),
        Field("offTrackLimit", 136, 16, 1.0, True),
        Field("vesselHeading", 152, 16, ANGLE),
    ),
    OVERBOARD: (
        Field("mobEmitterId", 8, 32),
        Field("manOverboardStatus", 40, 3, words=(BEACON, BUTTON, OVERBOARD_TEST)),
        Field("positionSource", 80, 3, words=(BY_VESSEL, "Position reported by MOB emitter")),
        Field("latitude", 136, 32, PLACE, True),
        Field("longitude", 168, 32, PLACE, True),
    ),
    RUDDER: (
        Field("instance", 0, 8),
        Field("directionOrder", 8, 3, words=ORDERS),
        Field("angleOrder", 16, 16, ANGLE, True),
        Field("position", 32, 16, ANGLE, True),
    ),
    HEADING: (
        Field("heading", 8, 16, ANGLE),
        Field("deviation", 24, 16, ANGLE, True),
        Field("variation", 40, 16, ANGLE, True),
        Field("reference", 56, 2, words=DIRECTION),
    ),
    RATE_OF_TURN: (Field("rate", 8, 32, 3.125e-8, True),),
    ATTITUDE: (
        Field("yaw", 8, 16, ANGLE, True),
        Field("pitch", 24, 16, ANGLE, True),
        Field("roll", 40, 16, ANGLE, True),
    ),
    VARIATION: (Field("variation", 32, 16, ANGLE, True),),
    WATER_SPEED: (Field("speedWaterReferenced", 8, 16, 0.01),),
    POSITION: (Field("latitude", 0, 32, PLACE, True), Field("longitude", 32, 32, PLACE, True)),
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
    CROSS_TRACK: (
        Field("xteMode", 8, 4, words=XTE_MODES),
        Field("navigationTerminated", 14, 2, words=YES_NO),
        Field("xte", 16, 32, 0.01, True),
    ),
    NAVIGATION: (
        Field("distanceToWaypoint", 8, 32, 0.01),
        Field("courseBearingReference", 40, 2, words=DIRECTION),
        Field("perpendicularCrossed", 42, 2, words=YES_NO),
        Field("arrivalCircleEntered", 44, 2, words=YES_NO),
        Field("bearingOriginToDestinationWaypoint", 96, 16, ANGLE),
        Field("bearingPositionToDestinationWaypoint", 112, 16, ANGLE),
        Field("destinationWaypointNumber", 160, 32),
        Field("destinationLatitude", 192, 32, PLACE, True),
        Field("destinationLongitude", 224, 32, PLACE, True),
        Field("waypointClosingVelocity", 256, 16, 0.01, True),
    ),
    WIND: (
        Field("windSpeed", 8, 16, 0.01),
        Field("windAngle", 24, 16, ANGLE),
        Field("reference", 40, 3, words=WINDS),
    ),
}
BYTES = {REQUEST: 3, OVERBOARD: 35, CONTROL: 21, GNSS: 43, NAVIGATION: 34}
"""Of a message, where they are not 8."""
FAST = frozenset(
    (
        GROUP_FUNCTION,
        GROUPS,
        PRODUCT,
        CONFIGURATION,
        CONTROL,
        GNSS,
        NAVIGATION,
        ROUTE,
        ALERT,
        ALERT_RESPONSE,
        ALERT_TEXT,
        OVERBOARD,
    )
)
"""The groups that travel as fast packets."""
NO_DATA = 3


def decoded(group: int, data: bytes) -> dict[str, object]:
    """Return the fields of `group` that `data` holds, whatever it is; none of a group that is not in LAYOUTS."""
    found: dict[str, object] = {}
    whole, bits = int.from_bytes(data, "little"), 8 * len(data)
    for field in LAYOUTS.get(group, ()):
        if field.start + field.bits <= bits:
            value = value_of(field, whole >> field.start & (1 << field.bits) - 1)
            if value is not None:
                found[field.name] = value
    return found


def value_of(field: Field, raw: int) -> float | str | None:
    """Return what the bits `raw` of a field mean, None where they are no data."""
    if field.words:
        return field.words[raw] if raw < len(field.words) else None
    if field.signed:
        half = 1 << field.bits - 1
        if half - NO_DATA <= raw < half:
            return None
        return (raw - 2 * half if raw >= half else raw) * field.unit
    return raw * field.unit if raw < (1 << field.bits) - NO_DATA else None


def encoded(group: int, fields: Fields) -> bytes:
    """Return the data of `group` with these fields, the others not available. ValueError where one cannot be said."""
    size = BYTES.get(group, 8)
    layout = {field.name: field for field in LAYOUTS[group]}
    whole = (1 << 8 * size) - 1
    for field in LAYOUTS[group]:
        # the highest number a field can hold
        whole ^= field.signed << field.start + field.bits - 1
    for name, value in fields.items():
        if name not in layout:
            raise ValueError(f"group {group} has no field {name!r}")
        field = layout[name]
        mask = (1 << field.bits) - 1
        whole = whole & ~(mask << field.start) | (_raw(group, field, value) & mask) << field.start
    return whole.to_bytes(size, "little")


def _raw(group: int, field: Field, value: object) -> int:
    if field.words:
        if value in field.words:
            return field.words.index(str(value))
    elif isinstance(value, int | float) and math.isfinite(value):
        raw = round(value / field.unit)
        half = 1 << field.bits - 1
        low, high = (-half, half) if field.signed else (0, 2 * half)
        if low <= raw < high - NO_DATA:
            return raw
    raise ValueError(f"group {group}, {field.name}: {value!r} cannot be said")


def number(fields: Fields, name: str, most: float) -> float | None:
    """Return the field's number where there is one, of at most `most` to both sides."""
    value = fields.get(name)
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) <= most:
        return None
    return float(value)


def text_of(data: bytes, at: int) -> tuple[str, int]:
    """Return the string with length and kind (0 UTF-16, 1 ASCII or UTF-8) at byte `at`, and the byte behind it.

    The end of the data where the length goes beyond it.
    """
    if at + 2 > len(data) or data[at] < 2:
        return "", min(at + 2, len(data))
    end = min(at + data[at], len(data))
    coding = "utf-16-le" if data[at + 1] == 0 else "utf-8"
    return data[at + 2 : end].decode(coding, "replace").rstrip("\0 \xff\ufffd"), end


def text(words: str) -> bytes:
    """Return a string with length and kind, in ASCII."""
    letters = words.encode("ascii", "replace")[:250]
    return bytes((len(letters) + 2, 1)) + letters


def fixed_text(words: str, size: int) -> bytes:
    """Return a string of `size` bytes, filled up as canboat's senders do."""
    return words.encode("ascii", "replace")[:size].ljust(size, b"\xff")


EVERYBODY = 255
IDENTIFIER_MOST = 0x1FFFFFFF
FRAME_BYTES = 8
PACKET_MOST = 223
"""Bytes of a fast packet: 6 in the first frame and 7 in each of 31 more."""
PACKET_S = 1.0
"""A fast packet whose next frame comes later than this after its last one is given up; a sender has it out in less."""
BARE = b"\x01\x05\xf1\x01"
"""A command (126208) of 127237 with one field, which canboatjs sends as it is: its 8 bytes fit a frame."""
ANNOUNCED, CARRIED = 60416, 60160
BROADCAST = 32
"""The control byte of a broadcast's announcement."""
BROADCAST_S = 0.75
"""Its next frame comes within this time."""
BROADCAST_MOST = 1785
BEGUN_MOST = 64
"""Packets under way; of more the oldest is given up."""


class Message(NamedTuple):
    """A parameter group with its data, from an address to another or to everybody."""

    group: int
    data: bytes
    source: int = 0
    destination: int = EVERYBODY
    priority: int = 6


class Frame(NamedTuple):
    """A CAN frame: the 29 bits of its identifier, and up to 8 bytes."""

    identifier: int
    data: bytes


def is_addressed(group: int) -> bool:
    """Return whether messages of a group go to one address (PDU 1)."""
    return (group >> 8) & 0xFF < 240


def identifier(group: int, source: int, priority: int = 2, destination: int = EVERYBODY) -> int:
    """Return the 29 bits of a frame's identifier."""
    low = destination if is_addressed(group) else group & 0xFF
    return priority << 26 | (group >> 8) << 16 | low << 8 | source


def group_and_source(identifier: int) -> tuple[int, int]:
    """Return parameter group number and source address of an identifier."""
    group = identifier >> 8 & 0x3FFFF
    return (group & 0x3FF00 if is_addressed(group) else group), identifier & 0xFF


class FastPackets:
    """Puts the frames of fast packets together, by source, group and sequence number.

    `lost`: packets of which a frame did not come.
    """

    def __init__(self) -> None:
        self.lost = 0
        self._begun: dict[tuple[int, int, int], tuple[int, int, float, bytes]] = {}

    def is_begun(self, group: int, source: int, frame: bytes) -> bool:
        """Return whether a packet is under way that `frame` may belong to."""
        return bool(frame) and (source, group, frame[0] >> 5) in self._begun

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
            if place == last and got.endswith(frame[1:FRAME_BYTES]):
                self._begun[key] = before  # the same frame by a second way
                return None
            if place != last + 1 or not 0.0 <= now - then <= PACKET_S:
                self.lost += 1
                return None
            got += frame[1:FRAME_BYTES]
        if len(got) >= length:
            return got[:length]
        if len(self._begun) >= BEGUN_MOST:
            del self._begun[next(iter(self._begun))]
            self.lost += 1
        self._begun[key] = (length, place, now, got)
        return None


class Broadcasts:
    """Puts broadcasts of the groups that are `wanted` together, one at a time from each source."""

    def __init__(self, wanted: frozenset[int]) -> None:
        self._wanted = wanted
        self._begun: dict[int, tuple[int, int, float, bytes]] = {}

    def add(self, now: float, group: int, source: int, frame: bytes) -> tuple[int, bytes] | None:
        """Return the group and the data that `frame`, which came at `now` [s], completes; None where it does not."""
        if len(frame) != FRAME_BYTES:
            return None
        before = self._begun.pop(source, None)
        if group == ANNOUNCED:
            size, carried = int.from_bytes(frame[1:3], "little"), int.from_bytes(frame[5:8], "little")
            if frame[0] == BROADCAST and FRAME_BYTES < size <= BROADCAST_MOST and carried in self._wanted:
                self._begun[source] = (carried, size, now, b"")
            return None
        if before is None:
            return None
        carried, size, then, got = before
        if frame[0] != len(got) // (FRAME_BYTES - 1) + 1 or not 0.0 <= now - then <= BROADCAST_S:
            return None
        got += frame[1:]
        if len(got) >= size:
            return carried, got[:size]
        self._begun[source] = (carried, size, now, got)
        return None


class Framing:
    """Frames to messages and back, on one bus. `fast`: the groups that travel as fast packets; `read`: those wanted.

    A sequence number is counted for each group that is sent, as its receivers expect.
    """

    def __init__(self, fast: frozenset[int], read: frozenset[int]) -> None:
        self.packets = FastPackets()
        self._fast, self._read = fast, read
        self._broadcasts = Broadcasts(read & {COMMANDED_ADDRESS})
        self._sequences: dict[int, int] = {}

    def take(self, now: float, frame: Frame) -> Message | None:
        """Return the message that `frame`, which came at `now` [s], completes; None where it completes none."""
        group, source = group_and_source(frame.identifier)
        if group in (ANNOUNCED, CARRIED) and frame.identifier >> 8 & 0xFF == EVERYBODY:
            whole = self._broadcasts.add(now, group, source, frame.data)
            return None if whole is None else Message(*whole, source, priority=frame.identifier >> 26 & 7)
        if group not in self._read:
            return None
        data: bytes | None = frame.data
        is_bare = group == GROUP_FUNCTION and frame.data[:4] == BARE
        if group in self._fast and not (is_bare and not self.packets.is_begun(group, source, frame.data)):
            data = self.packets.add(now, group, source, frame.data)
        if data is None:
            return None
        destination = frame.identifier >> 8 & 0xFF if is_addressed(group) else EVERYBODY
        return Message(group, data, source, destination, frame.identifier >> 26 & 7)

    def frames(self, message: Message) -> list[Frame]:
        """Return the frames of a message; of a fast packet the last one filled up. ValueError where it is too long."""
        name = identifier(message.group, message.source, message.priority, message.destination)
        data = message.data
        if message.group not in self._fast:
            if len(data) > FRAME_BYTES:
                raise ValueError(f"group {message.group}: {len(data)} bytes, a frame holds {FRAME_BYTES}")
            return [Frame(name, data)]
        if len(data) > PACKET_MOST:
            raise ValueError(f"group {message.group}: {len(data)} bytes, a fast packet holds {PACKET_MOST}")
        sequence = self._sequences.get(message.group, 0)
        self._sequences[message.group] = (sequence + 1) & 7
        pieces = [bytes((len(data),)) + data[:6], *(data[at : at + 7] for at in range(6, len(data), 7))]
        return [
            Frame(name, bytes((sequence << 5 | place,)) + piece.ljust(FRAME_BYTES - 1, b"\xff"))
            for place, piece in enumerate(pieces)
        ]
