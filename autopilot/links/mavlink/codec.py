"""MAVLink bytes to messages and back: own framing around pymavlink's dialect codec, without I/O or clock.

Nothing that arrives raises. A frame is accepted only whole, with a known id and the right checksum; what is
noise is skipped byte by byte, so that one damaged frame never swallows a good one behind it.
"""

from __future__ import annotations

import functools
import re
import struct
from collections.abc import Callable
from operator import attrgetter
from typing import Any, NamedTuple, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.frames import (
    EXTRA_MESSAGES,
    KNOWN,
    MAGIC_V2,
    SIGNATURE,
    TRIES,
    checksum,
    crc_of,
    frame_length,
    next_magic,
)
from autopilot.links.mavlink.signing import LinkSigning

Message: TypeAlias = Any
"""A pymavlink message; `get_msgbuf()` gives its raw packet, `get_srcSystem()` its sender."""

PART = re.compile(r"(\d*)([A-Za-z])")
"""One field of a struct's format: how many, of which kind."""

HEADER = struct.Struct("<BBBBBBBHB")
"""Magic, payload length, incompatibility and compatibility flags, sequence, system, component, id (16 + 8 bits)."""
SHORTEST = 12
"""Bytes of a frame without payload."""


class Layout(NamedTuple):
    """How the payload of one message is read: pymavlink's own tables, looked up once. Texts of ours come as bytes."""

    kind: type[Any]
    unpack: Callable[[bytes], tuple[float, ...]]
    size: int
    crc_extra: bytes
    names: tuple[str, ...]
    blank: dict[str, Any]


@functools.cache
def layout_of(identity: int) -> Layout | None:
    """Return the layout of the message `identity`; None where nobody knows it, or it has arrays and pymavlink does."""
    kind = KNOWN.get(identity)
    if kind is None:
        return None
    has_arrays = any(kind.array_lengths) or "char" in kind.fieldtypes
    if dialect.mcrf4xx is None or (has_arrays and identity not in EXTRA_MESSAGES):
        return None
    blank = dict(vars(kind(*[0] * len(kind.fieldnames))))
    extra, names = bytes([kind.crc_extra]), tuple(kind.ordered_fieldnames)
    return Layout(kind, kind.unpacker.unpack, kind.unpacker.size, extra, names, blank)


@functools.cache
def writer_of(kind: type[Any]) -> Callable[[Message], bytes] | None:
    """Return what writes the payload of messages of the class `kind`, bytes and texts in one piece; None where that is
    left to the class itself: an array of other numbers, a message of ours, a class derived from the dialect's."""
    if dialect.mcrf4xx is None or dialect.mavlink_map.get(kind.id) is not kind:
        return None
    shape, names, arrays = "<", [], []
    fields = PART.findall(kind.unpacker.format)
    for place, (name, (count, letter)) in enumerate(zip(kind.ordered_fieldnames, fields, strict=True)):
        if count and letter not in "Bs":
            return None
        if count and letter == "B":
            arrays.append(place)
        shape += f"{count}s" if count else letter
        names.append(f"_{name}_raw" if letter in "cs" else name)
    pack = struct.Struct(shape).pack
    read = attrgetter(*names) if len(names) > 1 else lambda message: (getattr(message, names[0]),)
    if not arrays:
        return lambda message: pack(*read(message))

    def with_bytes(message: Message) -> bytes:
        values = list(read(message))
        for place in arrays:
            values[place] = bytes(values[place])
        return pack(*values)

    return with_bytes


def packed(message: Message) -> Message:
    """Return `message` with its payload worked out: one that is sent again and again, and never changed."""
    writer = writer_of(message.__class__)
    if writer is not None:
        message.packed_payload = writer(message).rstrip(b"\0")
    return message


def message_id(message: Message) -> int:
    """Return the id of a message's kind; its attribute `id` will not do, RAW_IMU and others have a field so named."""
    identity: int = message._header.msgId
    return identity


class MavlinkCodec:
    """Decodes what one link receives and encodes what one identity sends; it is the only writer of that identity.

    Args:
        system, component: the identity that `encode` puts on every packet.
        is_stream: whether frames may be split over chunks (TCP, serial); a datagram never borrows from the next.
        signing: signs what is encoded and refuses what is not signed; None: neither, and signatures are not looked at.

    Attributes:
        received: frames accepted.  bad: runs of bytes that were no frame.  refused: frames refused for their signature.
    """

    def __init__(
        self, system: int = 255, component: int = 0, is_stream: bool = False, signing: LinkSigning | None = None
    ) -> None:
        self._mavlink = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self._is_stream = is_stream
        self._signing = signing
        self._rest = b""
        self.received = 0
        self.bad = 0
        self.refused = 0

    @property
    def system(self) -> int:
        """System id on outgoing packets; settable, because a companion learns it from its vehicle."""
        return int(self._mavlink.srcSystem)

    @system.setter
    def system(self, value: int) -> None:
        self._mavlink.srcSystem = value

    @property
    def component(self) -> int:
        """Component id on outgoing packets."""
        return int(self._mavlink.srcComponent)

    def encode(self, message: Message) -> bytes:
        """Return the MAVLink 2 packet of `message` under this identity, with the next sequence number."""
        writer = writer_of(message.__class__)
        if writer is not None:
            payload = message.__dict__.get("packed_payload") or writer(message)
            return self.encode_payload(message.__class__, payload)
        packet: bytes = message.pack(self._mavlink)
        self._mavlink.seq = (self._mavlink.seq + 1) & 0xFF
        return packet if self._signing is None else self._signing.sign(packet, message.crc_extra)

    def encode_payload(self, kind: type[Any], payload: bytes) -> bytes:
        """Return the packet of a message of the class `kind` whose fields are written already, as `encode` would: what
        pymavlink's `pack` makes, at a third of the cost, and without an object."""
        mavlink, identity, payload = self._mavlink, kind.id, payload.rstrip(b"\0") or b"\0"
        sender = mavlink.seq, mavlink.srcSystem, mavlink.srcComponent
        mavlink.seq = (mavlink.seq + 1) & 0xFF
        packet = HEADER.pack(MAGIC_V2, len(payload), 0, 0, *sender, identity & 0xFFFF, identity >> 16) + payload
        crc = crc_of(packet[1:] + bytes((kind.crc_extra,)))
        packet += bytes((crc & 0xFF, crc >> 8))
        return packet if self._signing is None else self._signing.sign(packet, kind.crc_extra)

    def decoded(self, chunks: list[bytes]) -> list[Message]:
        """Return the messages in what has arrived, datagrams or pieces of a stream; never raises."""
        messages: list[Message] = []
        for data in chunks:
            end, message = len(data), None
            if end > SHORTEST and data[0] == MAGIC_V2 and end == data[1] + SHORTEST and not self._rest and not data[2]:
                # one frame without a signature, as nearly all datagrams are
                message = self._decode_frame(data) if self._signing is None else None
            if message is None:
                messages += self.decode(data)
            else:
                self.received += 1
                messages += (message,)
        return messages

    def decode(self, data: bytes) -> list[Message]:
        """Return the messages in a datagram, or those completed by a chunk of the stream; never raises."""
        messages: list[Message] = []
        buffer = self._rest + data if self._rest else data
        end = len(buffer)
        start = 0
        in_noise = False
        tries = TRIES
        while start < end:
            length = frame_length(buffer, start)
            incomplete = length == 0 or start + length > end
            if incomplete and self._is_stream:
                break
            message = self._decode_frame(buffer[start : start + length]) if length > 0 and not incomplete else None
            if message is not None:
                if self._signing is None or self._is_authentic(message, self._signing):
                    messages.append(message)
                    self.received += 1
                start += length
                in_noise = False
                continue
            if not in_noise:
                self.bad += 1
                in_noise = True
            tries -= 1
            start = next_magic(buffer, start + 1) if tries else end
        if self._is_stream:
            self._rest = bytes(buffer[start:])
        return messages

    def _is_authentic(self, message: Message, signing: LinkSigning) -> bool:
        if signing.refuses(bytes(message._msgbuf)):
            self.refused += 1
            return False
        return True

    def _decode_frame(self, frame: bytes) -> Message | None:
        """Return the message in a whole frame, None for one whose checksum is wrong.

        A MAVLink 2 frame without arrays is read here, at a third of what pymavlink's `decode` costs. Only its raw
        packet differs in type: the bytes as they came, not a copy that could be changed.
        """
        is_new = frame[0] == MAGIC_V2
        if not is_new:
            return self._decoded_by_pymavlink(frame, frame[5], -2)
        size, flags, compatible, number, system, component = frame[1:7]
        identity = frame[7] | frame[8] << 8 | frame[9] << 16
        end = -2 - SIGNATURE if flags else -2
        layout = layout_of(identity)
        if layout is None:
            return self._decoded_by_pymavlink(frame, identity, end)
        crc = crc_of(frame[1:end] + layout.crc_extra)
        if crc != frame[end] | frame[end + 1] << 8:
            return None
        # zeros at the end are left out on the way; what a newer sender adds is not read
        payload = frame[10:end]
        if size != layout.size:
            payload = (payload + bytes(layout.size))[: layout.size]
        message: Message = object.__new__(layout.kind)
        message.__dict__ = {
            **layout.blank,
            **dict(zip(layout.names, layout.unpack(payload), strict=True)),
            "_msgbuf": frame,
            "_payload": payload,
            "_crc": crc,
            "_header": dialect.MAVLink_header(identity, flags, compatible, size, number, system, component),
        }
        return message

    def _decoded_by_pymavlink(self, frame: bytes, identity: int, end: int) -> Message | None:
        kind = dialect.mavlink_map.get(identity)
        if kind is None:
            # pymavlink would accept what it does not know, whatever its checksum
            return None
        if checksum(frame[1:end], kind.crc_extra) != frame[end : end + 2 or None]:
            return None  # noise costs little: pymavlink's own check takes ten times as long
        try:
            return self._mavlink.decode(bytearray(frame))
        except dialect.MAVError:
            return None


def is_mavlink(data: bytes) -> bool:
    """Return whether a datagram begins with one valid MAVLink frame."""
    if not data:
        return False
    length = frame_length(data, 0)
    return 0 < length <= len(data) and bool(MavlinkCodec().decode(data[:length]))
