"""NMEA 2000 frames and what they carry: identifiers, messages, fast packets put together and cut, broadcasts put
together. Pure.

A message of up to 8 bytes is a frame. A longer one travels as a fast packet: each frame begins with the packet's
sequence number (3 bits) and its place (5 bits), and the first goes on with the packet's length. A commanded address
travels by the older transport protocol, as a broadcast (BAM): 60416 says how many bytes of which group come, and each
60160 begins with its number, from 1.

Source: identifiers and broadcasts after SAE J1939-21; fast packets as canboat describes them (https://canboat.github.io/canboat/).
"""

from __future__ import annotations

from typing import NamedTuple

from autopilot.links.n2k.fields import COMMANDED_ADDRESS, GROUP_FUNCTION

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
