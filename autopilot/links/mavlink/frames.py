"""MAVLink frames as bytes: where one begins and ends, its checksum, whose it is and whom it is for. Pure.

Layouts of both versions and the checksum: https://mavlink.io/en/guide/serialization.html. No function of a frame
knows what a message says; the fields of its address are looked up in pymavlink's tables.

And the messages of the standard that pymavlink's ArduPilot dialect does not have, in the form of its own classes.

A class tells its id and its fields as https://mavlink.io/en/messages/common.html and development.html list them; the
order on the wire (wide types first) and CRC_EXTRA follow from names and types by the rules of
https://mavlink.io/en/guide/serialization.html.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Container, Iterator
from typing import Any, ClassVar, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

MODE_NAME_LENGTH = 35
LETTERS = {"uint32_t": "I", "uint16_t": "H", "uint8_t": "B", "char": "s"}
FIELD = re.compile(r"(\w+)(?:\[(\d+)\])? (\w+)")
"""`uint8_t name` or `char[35] name`."""


class _ExtraMessage(dialect.MAVLink_message):
    """What pymavlink's generated classes have in common. Values come in the order of the fields, texts as bytes."""

    id: ClassVar[int]
    msgname: ClassVar[str]
    fieldnames: ClassVar[list[str]]
    ordered_fieldnames: ClassVar[list[str]]
    fieldtypes: ClassVar[list[str]]
    array_lengths: ClassVar[list[int]]
    crc_extra: ClassVar[int]
    unpacker: ClassVar[struct.Struct]
    fielddisplays_by_name: ClassVar[dict[str, str]] = {}
    fieldenums_by_name: ClassVar[dict[str, str]] = {}
    fieldunits_by_name: ClassVar[dict[str, str]] = {}
    instance_field = None
    instance_offset = -1

    def __init_subclass__(cls, identity: int, fields: str) -> None:
        given = [(kind, int(length or 0), name) for kind, length, name in FIELD.findall(fields)]
        wire = sorted(given, key=lambda field: -struct.calcsize(LETTERS[field[0]]))
        cls.id = identity
        cls.msgname = re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).upper()
        cls.fieldtypes, cls.fieldnames = [kind for kind, _, _ in given], [name for _, _, name in given]
        cls.array_lengths, cls.ordered_fieldnames = [length for _, length, _ in wire], [name for _, _, name in wire]
        cls.unpacker = struct.Struct("<" + "".join(f"{length or ''}{LETTERS[kind]}" for kind, length, _ in wire))
        layout = b"".join(f"{kind} {name} ".encode() + bytes([length] * (length > 0)) for kind, length, name in wire)
        crc = int(dialect.x25crc(f"{cls.msgname} ".encode() + layout).crc)
        cls.crc_extra = (crc & 0xFF) ^ (crc >> 8)

    def __init__(self, *values: Any) -> None:
        super().__init__(self.id, self.msgname)
        self._fieldnames = self.fieldnames
        self._instance_field = self.instance_field
        self._instance_offset = self.instance_offset
        for name, value in zip(self.fieldnames, values, strict=True):
            setattr(self, name, value)

    def pack(self, mav: Any, force_mavlink1: bool = False) -> bytes:
        """Return the packet."""
        payload = self.unpacker.pack(*(getattr(self, name) for name in self.ordered_fieldnames))
        packet: bytes = self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)
        return packet


class CommandCancel(
    _ExtraMessage, identity=80, fields="uint8_t target_system, uint8_t target_component, uint16_t command"
):
    """Cancel a command that is being carried out."""


class AvailableModes(
    _ExtraMessage,
    identity=435,
    fields="uint8_t number_modes, uint8_t mode_index, uint8_t standard_mode, uint32_t custom_mode, "
    f"uint32_t properties, char[{MODE_NAME_LENGTH}] mode_name",
):
    """One of the modes there are."""


class CurrentMode(
    _ExtraMessage, identity=436, fields="uint8_t standard_mode, uint32_t custom_mode, uint32_t intended_custom_mode"
):
    """The mode that is, and the one that was last asked for."""


class ComponentMetadata(_ExtraMessage, identity=397, fields="uint32_t time_boot_ms, uint32_t file_crc, char[100] uri"):
    """Where a component's general metadata file is, and its CRC-32."""


class ComponentInformation(
    _ExtraMessage,
    identity=395,
    fields="uint32_t time_boot_ms, uint32_t general_metadata_file_crc, char[100] general_metadata_uri, "
    "uint32_t peripherals_metadata_file_crc, char[100] peripherals_metadata_uri",
):
    """The same as older ground stations ask for it; we have no peripherals."""


KINDS: tuple[type[Any], ...] = (CommandCancel, AvailableModes, CurrentMode, ComponentMetadata, ComponentInformation)
EXTRA_MESSAGES: dict[int, type[Any]] = {kind.id: kind for kind in KINDS}
KNOWN: dict[int, type[Any]] = {**EXTRA_MESSAGES, **dialect.mavlink_map}
"""Every message that can be read, by its id."""


MAGIC_V1, MAGIC_V2 = 0xFE, 0xFD
SIGNED = 0x01
SIGNATURE = 13
"""Bytes behind the checksum: link id 1, timestamp 6, signature 6."""
TRIES = 300
"""Places of one chunk looked at in vain before the rest of it is dropped: more than the 280 bytes of one damaged frame.
Bytes made to look like the beginnings of frames cannot hold the loop."""
ANY_MAGIC = re.compile(rb"[\xfd\xfe]")
ANY = range(1 << 24)
"""Every id there can be."""


class Address(NamedTuple):
    """A system id and a component id; 0 in a target means all of them."""

    system: int
    component: int


EVERYBODY = Address(0, 0)


def frame_length(buffer: bytes, start: int, known: Container[int] = KNOWN) -> int:
    """Return the length of the frame that begins at `start`; 0 where more bytes are needed, -1 where none does.

    An id that is not `known`, as one outside the dialect whose checksum nobody knows, is taken for noise at once, so
    that a stray magic byte cannot hold back the messages behind it.
    """
    magic = buffer[start]
    waiting = len(buffer) - start
    if magic == MAGIC_V2:
        if waiting < 3:
            return 0
        flags = buffer[start + 2]
        if flags & ~SIGNED:
            return -1
        if waiting < 10:
            return 0
        identity = buffer[start + 7] | buffer[start + 8] << 8 | buffer[start + 9] << 16
        length = buffer[start + 1] + 12 + 13 * flags
    elif magic == MAGIC_V1:
        if waiting < 6:
            return 0
        identity = buffer[start + 5]
        length = buffer[start + 1] + 8
    else:
        return -1
    return length if identity in known else -1


def next_magic(buffer: bytes, start: int) -> int:
    """Return where, from `start` on, a frame could next begin; the buffer's length where nowhere."""
    found = ANY_MAGIC.search(buffer, start)
    return found.start() if found is not None else len(buffer)


crc_of: Callable[[bytes], int] = dialect.mcrf4xx or (lambda seeded: int(dialect.x25crc(seeded).crc))
"""MAVLink's checksum of a frame without its magic, with its message's seed behind it."""


def checksum(data: bytes, crc_extra: int) -> bytes:
    """Return MAVLink's checksum of `data`, a frame without its magic, for a message with this seed."""
    return crc_of(data + bytes([crc_extra])).to_bytes(2, "little")


def identity_of(frame: bytes) -> int:
    """Return the id of a whole frame's message."""
    return frame[7] | frame[8] << 8 | frame[9] << 16 if frame[0] == MAGIC_V2 else frame[5]


def is_signed(frame: bytes) -> bool:
    """Return whether a whole frame carries a signature."""
    return frame[0] == MAGIC_V2 and bool(frame[2] & SIGNED)


def source_of(frame: bytes) -> Address:
    """Return who sent a whole frame."""
    return Address(frame[5], frame[6]) if frame[0] == MAGIC_V2 else Address(frame[3], frame[4])


def target_of(frame: bytes) -> Address:
    """Return whom a whole frame is for; everybody where its message names nobody or is not known."""
    identity = identity_of(frame)
    if identity not in _places:
        _places[identity] = _target_places(identity)
    places = _places[identity]
    if places is None:
        return EVERYBODY
    start = 10 if frame[0] == MAGIC_V2 else 6
    length = frame[1]
    # MAVLink 2 leaves zeros at the end of a payload out
    ids = (frame[start + place] if place is not None and place < length else 0 for place in places)
    return Address(*ids)


def instance_of(frame: bytes) -> bytes:
    """Return which of several a whole frame's message is about, as its bytes say: the name of a NAMED_VALUE_FLOAT, the
    number of a battery; b'' where its message is about one thing."""
    identity = identity_of(frame)
    if identity not in _instances:
        kind = KNOWN.get(identity)
        field = None if kind is None else kind.instance_field
        _instances[identity] = None if kind is None or field is None else _layout(kind)[field]
    found = _instances[identity]
    if found is None:
        return b""
    start = (10 if frame[0] == MAGIC_V2 else 6) + found.start
    end = (10 if frame[0] == MAGIC_V2 else 6) + min(found.stop, frame[1])
    return frame[start:end].rstrip(b"\0")


_places: dict[int, tuple[int, int | None] | None] = {}
"""For each message, where in its payload target system and component stand; None where the latter is missing."""
_instances: dict[int, range | None] = {}
"""For each message, which bytes of its payload say which of several it is about."""


def _target_places(identity: int) -> tuple[int, int | None] | None:
    kind = KNOWN.get(identity)
    if kind is None:
        return None
    layout = _layout(kind)
    system = layout.get("target_system", layout.get("target"))
    component = layout.get("target_component")
    return None if system is None else (system.start, None if component is None else component.start)


def _layout(kind: type[Any]) -> dict[str, range]:
    """Return which bytes of its payload each field of a message has."""
    tokens = ["".join(token) for token in re.findall(r"(\d*)([a-zA-Z])", kind.unpacker.format)]
    layout, place = {}, 0
    for name, token in zip(kind.ordered_fieldnames, tokens, strict=True):
        size = struct.calcsize("<" + token)
        layout[name] = range(place, place + size)
        place += size
    return layout


class Framer:
    """Cuts what one endpoint receives into whole frames, byte for byte as they came.

    A frame of a known message needs the right checksum. That of an unknown one cannot be checked: it is accepted
    where it begins a datagram or stands directly behind a good frame.

    Args:
        is_stream: whether frames may be split over chunks; a datagram never borrows from the next.
    """

    def __init__(self, is_stream: bool = False) -> None:
        self._is_stream = is_stream
        self._rest = b""
        self._in_step = not is_stream

    def frames(self, data: bytes) -> list[bytes]:
        """Return the frames in a datagram, or those completed by a chunk of the stream."""
        found: list[bytes] = []
        buffer = self._rest + data
        self._in_step = self._in_step or not self._is_stream
        place, tries = 0, TRIES
        while place < len(buffer):
            length = frame_length(buffer, place, ANY)
            if self._is_stream and (length == 0 or place + length > len(buffer)):
                break
            frame = buffer[place : place + length] if length > 0 else b""
            if frame and len(frame) == length and self._is_good(frame):
                found.append(frame)
                place += length
                self._in_step = True
            else:
                tries -= 1
                place = next_magic(buffer, place + 1) if tries else len(buffer)
                self._in_step = False
        self._rest = bytes(buffer[place:]) if self._is_stream else b""
        return found

    def _is_good(self, frame: bytes) -> bool:
        kind = KNOWN.get(identity_of(frame))
        if kind is None:
            return self._in_step
        end = len(frame) - (SIGNATURE if frame[0] == MAGIC_V2 and frame[2] & SIGNED else 0)
        return checksum(frame[1 : end - 2], kind.crc_extra) == frame[end - 2 : end]


STAMP = 8
YEARS_US = (315_532_800_000_000, 4_102_444_800_000_000)
"""Stamps from 1980 to 2100 are believed; a vehicle's own clock without a date counts too, from zero on."""
WITHOUT_DATE_US = 40_000_000_000_000


class TlogPackets:
    """Iterates over (stamp [s], message id, packet) of a .tlog. Unknown messages are stepped over; what is no packet is
    skipped, as the zeros that a power cut leaves.

    skipped: bytes that belonged to no packet.  torn: bytes of a last one that is not whole.
    """

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.skipped = 0
        self.torn = 0

    def __iter__(self) -> Iterator[tuple[float, int, bytes]]:
        data, place, end = self._data, 0, len(self._data)
        while place + STAMP + 2 <= end:
            length = frame_length(data, place + STAMP, ANY)
            follows = place + STAMP + length
            if length == 0 or (follows > end and not self._goes_on(place)):
                self.torn = end - place
                return
            if length < 0 or not self._is_start(follows):
                follows = self._next_start(place + 1)
                self.skipped += follows - place
            else:
                packet = data[place + STAMP : follows]
                yield int.from_bytes(data[place : place + STAMP], "big") * 1.0e-6, identity_of(packet), packet
            place = follows
        self.torn = end - place

    def _is_start(self, place: int) -> bool:
        """Return whether a record begins at `place`, or the file ends before that can be seen."""
        data = self._data
        if place + STAMP >= len(data):
            return place <= len(data)
        stamp = int.from_bytes(data[place : place + STAMP], "big")
        likely = YEARS_US[0] < stamp < YEARS_US[1] or stamp < WITHOUT_DATE_US
        return likely and data[place + STAMP] in (MAGIC_V1, MAGIC_V2)

    def _goes_on(self, place: int) -> bool:
        """Return whether another record begins behind `place`: then a length that leaves the file was a lie."""
        return self._next_start(place + 1) < len(self._data)

    def _next_start(self, place: int) -> int:
        data, end = self._data, len(self._data)
        magic = place + STAMP
        while True:
            magic = next_magic(data, magic)
            if magic >= end:
                return end
            start = magic - STAMP
            length = frame_length(data, magic, ANY)
            if self._is_start(start) and length > 0 and magic + length < end and self._is_start(magic + length):
                return start
            magic += 1
