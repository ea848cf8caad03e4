"""Bytes cut into MAVLink frames without changing or understanding them, for passing on. Nothing that arrives raises."""

from __future__ import annotations

import re
import struct
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.extra_messages import EXTRA_MESSAGES
from autopilot.links.mavlink_codec import MAGIC_V1, TRIES, next_magic
from autopilot.links.signing import MAGIC_V2, SIGNATURE, SIGNED, checksum, identity_of

_known = {**EXTRA_MESSAGES, **dialect.mavlink_map}


class Address(NamedTuple):
    """A system id and a component id; 0 in a target means all of them."""

    system: int
    component: int


EVERYBODY = Address(0, 0)


class Framer:
    """Cuts what one endpoint receives into whole frames, byte for byte as they came.

    A frame of a known message needs the right checksum. That of an unknown one cannot be checked: it is believed
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
            length = _claimed_length(buffer, place)
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
        kind = _known.get(identity_of(frame))
        if kind is None:
            return self._in_step
        end = len(frame) - (SIGNATURE if frame[0] == MAGIC_V2 and frame[2] & SIGNED else 0)
        return checksum(frame[1 : end - 2], kind.crc_extra) == frame[end - 2 : end]


def _claimed_length(buffer: bytes, place: int) -> int:
    """Return how long a frame that begins at `place` would be; 0 where more bytes are needed, -1 where none does."""
    waiting = len(buffer) - place
    if buffer[place] == MAGIC_V1:
        return buffer[place + 1] + 8 if waiting > 1 else 0
    if buffer[place] != MAGIC_V2:
        return -1
    if waiting < 3:
        return 0
    flags = buffer[place + 2]
    return -1 if flags & ~SIGNED else buffer[place + 1] + 12 + SIGNATURE * flags


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


_places: dict[int, tuple[int, int | None] | None] = {}
"""For each message, where in its payload target system and component stand; None where the latter is missing."""


def _target_places(identity: int) -> tuple[int, int | None] | None:
    kind = _known.get(identity)
    if kind is None:
        return None
    tokens = ["".join(token) for token in re.findall(r"(\d*)([a-zA-Z])", kind.unpacker.format)]
    offsets, place = {}, 0
    for name, token in zip(kind.ordered_fieldnames, tokens, strict=True):
        offsets[name] = place
        place += struct.calcsize("<" + token)
    system = offsets.get("target_system", offsets.get("target"))
    return None if system is None else (system, offsets.get("target_component"))
