"""The codec against pymavlink's own reader as an independent peer, on damaged, split and merged bytes, and on noise."""

from __future__ import annotations

import functools
import os
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink import codec as codecs
from autopilot.links.mavlink.codec import MavlinkCodec, is_mavlink, message_id
from autopilot.links.mavlink.frames import EXTRA_MESSAGES, CommandCancel, ComponentMetadata, frame_length

FRAME_MAX = 280


def packets(count: int, system: int = 1) -> list[bytes]:
    """Return `count` ATTITUDE packets, each with its number as the yaw."""
    codec = MavlinkCodec(system, 1)
    return [codec.encode(dialect.MAVLink_attitude_message(n, 0.0, 0.0, float(n), 0.0, 0.0, 0.0)) for n in range(count)]


def yaws(messages: list) -> list[float]:
    return [message.yaw for message in messages]


def test_pymavlink_reads_what_is_written(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(os.environ, "MAVLINK20", "1")
    from pymavlink import mavutil

    log = tmp_path / "packets.tlog"
    stamp = (1_700_000_000_000_000).to_bytes(8, "big")
    log.write_bytes(b"".join(stamp + packet for packet in packets(300, system=42)))
    reader = mavutil.mavlink_connection(str(log))
    read = [reader.recv_match() for _ in range(300)]
    reader.close()
    assert [message.yaw for message in read] == [float(n) for n in range(300)]
    assert [message.get_seq() for message in read] == [n % 256 for n in range(300)]
    assert {(message.get_srcSystem(), message.get_srcComponent()) for message in read} == {(42, 1)}


def test_what_pymavlink_writes_is_read_in_both_versions() -> None:
    peer = dialect.MAVLink(None, srcSystem=9, srcComponent=1)
    message = dialect.MAVLink_attitude_message(1, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0)
    codec = MavlinkCodec()
    for version_1 in (False, True):
        (read,) = codec.decode(bytes(message.pack(peer, force_mavlink1=version_1)))
        assert (read.yaw, read.get_srcSystem()) == (0.25, 9)
    assert (codec.received, codec.bad) == (2, 0)


def test_a_signed_packet_is_read() -> None:
    peer = dialect.MAVLink(None, srcSystem=9, srcComponent=1)
    peer.signing.secret_key = bytes(32)
    peer.signing.sign_outgoing = True
    peer.signing.timestamp = 1
    signed = bytes(dialect.MAVLink_attitude_message(1, 0.0, 0.0, 0.25, 0.0, 0.0, 0.0).pack(peer))
    tail = packets(1)
    for is_stream in (False, True):
        assert yaws(MavlinkCodec(is_stream=is_stream).decode(signed + tail[0])) == [0.25, 0.0]


def test_the_raw_packet_of_each_message_is_kept() -> None:
    sent = packets(3)
    read = MavlinkCodec().decode(b"".join(sent))
    assert [bytes(message.get_msgbuf()) for message in read] == sent


def test_several_messages_in_a_datagram() -> None:
    assert yaws(MavlinkCodec().decode(b"".join(packets(5)))) == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_a_truncated_datagram_takes_nothing_from_the_next() -> None:
    first, second = packets(2)
    codec = MavlinkCodec()
    assert codec.decode(first[:-3]) == []
    assert yaws(codec.decode(second)) == [1.0]
    assert (codec.received, codec.bad) == (1, 1)


def test_noise_that_looks_like_a_header_holds_nothing_back() -> None:
    codec = MavlinkCodec(is_stream=True)
    assert yaws(codec.decode(b"\xfd\xff\x00" + b"".join(packets(3)))) == [0.0, 1.0, 2.0]


def test_a_damaged_frame_does_not_swallow_the_one_behind_it() -> None:
    first, second, third = packets(3)
    for is_stream in (False, True):
        for place in range(len(second)):
            damaged = bytearray(second)
            damaged[place] ^= 0x55
            codec = MavlinkCodec(is_stream=is_stream)
            # A longer length may claim bytes of what follows: give the stream enough to see that it lies.
            read = yaws(codec.decode(first + bytes(damaged) + third)) + yaws(codec.decode(b"\0" * FRAME_MAX))
            assert read == [0.0, 2.0], f"byte {place}"


@given(st.integers(1, 60), st.lists(st.binary(max_size=20), min_size=4, max_size=4))
def test_a_stream_may_be_split_anywhere(size, noise) -> None:
    sent = packets(3)
    clean = [part.replace(b"\xfd", b"").replace(b"\xfe", b"") for part in noise]
    stream = b"".join(part + packet for part, packet in zip(clean, sent, strict=False)) + clean[3]
    codec = MavlinkCodec(is_stream=True)
    read = [m for start in range(0, len(stream), size) for m in codec.decode(stream[start : start + size])]
    assert yaws(read) == [0.0, 1.0, 2.0]


@given(st.binary(max_size=400), st.booleans())
def test_noise_never_raises(data, is_stream) -> None:
    codec = MavlinkCodec(is_stream=is_stream)
    codec.decode(data)
    codec.decode(data[::-1])
    assert len(codec._rest) <= FRAME_MAX
    is_mavlink(data)


def test_long_noise_takes_no_memory_and_next_to_nothing_false_is_accepted() -> None:
    rng = random.Random(7)
    stream, datagrams = MavlinkCodec(is_stream=True), MavlinkCodec()
    for _ in range(500):
        noise = bytes(rng.choice((0xFD, 0xFE, 0, 1, 30, rng.randrange(256))) for _ in range(200))
        stream.decode(noise)
        datagrams.decode(noise)
        assert len(stream._rest) <= FRAME_MAX
    # A checksum of 16 bits lets one false frame in 65536 pass, and half of this noise begins a frame.
    assert stream.received + datagrams.received <= 3
    assert stream.bad > 0
    # An unfinished frame of the noise may still claim what comes next, but no more than one frame's length of it.
    stream.decode(bytes(FRAME_MAX))
    assert yaws(stream.decode(packets(1)[0])) == [0.0]


def test_every_message_of_the_dialect_survives_bit_flips() -> None:
    """Every damaged frame is refused: 16-bit checksums find all single-byte errors."""
    rng = random.Random(3)
    peer = MavlinkCodec(1, 1)
    codec = MavlinkCodec()
    for identity in (0, 22, 30, 33, 35, 36, 65, 70, 74, 77, 253):
        kind = dialect.mavlink_map[identity]
        size = kind.unpacker.size
        arguments = _fill(kind)
        packet = peer.encode(kind(*arguments))
        assert len(packet) <= size + 12
        assert len(codec.decode(packet)) == 1
        for _ in range(100):
            damaged = bytearray(packet)
            damaged[rng.randrange(1, len(damaged))] ^= rng.randrange(1, 256)
            assert codec.decode(bytes(damaged)) == []


def _fill(kind: type) -> list:
    """Return an argument for each field: text where the field is characters, numbers elsewhere."""
    return [b"name" if fieldtype == "char" else 1 for fieldtype in kind.fieldtypes]


@given(st.data())
def test_every_message_is_read_as_pymavlink_reads_it(data) -> None:
    kind = data.draw(st.sampled_from(sorted(dialect.mavlink_map.values(), key=lambda kind: kind.id)))
    payload = data.draw(st.binary(min_size=1, max_size=kind.unpacker.size))
    frame = bytes([0xFD, len(payload), 0, 0, 7, 1, 1]) + kind.id.to_bytes(3, "little") + payload
    frame += dialect.x25crc(frame[1:] + bytes([kind.crc_extra])).crc.to_bytes(2, "little")
    expected = vars(dialect.MAVLink(None).decode(bytearray(frame)))
    (message,) = MavlinkCodec().decode(frame)
    found = vars(message)
    assert type(message) is kind
    # repr, because two nan are not equal; the header has no equality of its own
    assert repr(vars(found.pop("_header"))) == repr(vars(expected.pop("_header")))
    assert bytes(found.pop("_msgbuf")) == bytes(expected.pop("_msgbuf")) == frame
    del found["_payload"], expected["_payload"]  # pymavlink takes a MAVLink 1 header's length off for both versions
    assert {name: repr(value) for name, value in found.items()} == {
        name: repr(value) for name, value in expected.items()
    }
    (again,) = MavlinkCodec().decode(frame)
    peer = dialect.MAVLink(None, srcSystem=9, srcComponent=8)
    assert MavlinkCodec(9, 8).encode(again) == dialect.MAVLink(None).decode(bytearray(frame)).pack(peer)


PAYLOADS = (b"\0", b"\1", bytes(range(1, 256)), bytes(range(255)), bytes(12) + b"\x40\x41\x42", b"ab\0cd" * 51)


@pytest.mark.parametrize(
    ("payload", "is_compiled"), [*((payload, True) for payload in PAYLOADS), (PAYLOADS[2], False), (PAYLOADS[0], False)]
)
def test_all_messages_go_both_ways_as_pymavlink_has_them(payload: bytes, is_compiled: bool, monkeypatch) -> None:
    """Whole, cut short and all zeros, with pymavlink's compiled checksum and without it."""
    if not is_compiled:
        monkeypatch.setattr(dialect, "mcrf4xx", None)
        monkeypatch.setattr(dialect, "x25crc", dialect._x25crc_slow)
    for looked_up in ("layout_of", "writer_of"):
        monkeypatch.setattr(codecs, looked_up, functools.cache(getattr(codecs, looked_up).__wrapped__))
    for kind in dialect.mavlink_map.values():
        body = payload[: kind.unpacker.size]
        frame = bytes([0xFD, len(body), 0, 0, 7, 3, 4]) + kind.id.to_bytes(3, "little") + body
        frame += dialect.x25crc(frame[1:] + bytes([kind.crc_extra])).crc.to_bytes(2, "little")
        expected = dialect.MAVLink(None).decode(bytearray(frame))
        (read,) = MavlinkCodec().decode(frame)
        assert {name: repr(getattr(read, name)) for name in kind.fieldnames} == {
            name: repr(getattr(expected, name)) for name in kind.fieldnames
        }
        assert repr(vars(read._header)) == repr(vars(expected._header)) and message_id(read) == kind.id
        peer = dialect.MAVLink(None, srcSystem=9, srcComponent=8)
        assert MavlinkCodec(9, 8).encode(read) == bytes(expected.pack(peer)), kind.msgname
        if "char" not in kind.fieldtypes:
            assert MavlinkCodec(9, 8).encode_payload(kind, body) == bytes(expected.pack(peer)), kind.msgname


def test_the_messages_that_come_often_are_read_and_written_without_pymavlink_s_own_slow_way() -> None:
    often = (0, 1, 24, 27, 30, 33, 35, 36, 62, 65, 69, 70, 74, 76, 77, 147)
    left_over = {}
    for identity in often:
        kind = dialect.mavlink_map[identity]
        has_arrays = any(kind.array_lengths)
        assert (codecs.layout_of(identity) is None) is has_arrays
        left_over[identity] = codecs.writer_of(kind) is None
    assert [identity for identity, is_left in left_over.items() if is_left] == [147], "numbers in an array"
    assert codecs.writer_of(CommandCancel) is None


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("is_signed", [False, True])
def test_how_long_a_frame_is_is_known_from_its_header(version: int, is_signed: bool) -> None:
    """MAVLink 1: 6 bytes of header and 2 of checksum; MAVLink 2: 10 and 2, and 13 of signature."""
    if version == 1 and is_signed:
        return
    peer = dialect.MAVLink(None, srcSystem=9, srcComponent=1)
    if is_signed:
        peer.signing.secret_key, peer.signing.sign_outgoing, peer.signing.timestamp = bytes(32), True, 1
    message = dialect.MAVLink_attitude_message(1, 0.0, 0.0, 0.25, 0.0, 0.0, 0.5)
    frame = bytes(message.pack(peer, force_mavlink1=version == 1))
    header = 6 if version == 1 else 10
    assert len(frame) == header + 28 + 2 + (13 if is_signed else 0)
    for start in (b"", b"\xfd\xfe\x00"):
        for waiting in range(1, len(frame) + 1):
            found = frame_length(start + frame[:waiting], len(start))
            assert found == (0 if waiting < header else len(frame)), waiting
    stream, ends = MavlinkCodec(is_stream=True), []
    for place in range(3 * len(frame)):
        ends += [place + 1 for _ in stream.decode((3 * frame)[place : place + 1])]
    assert ends == [len(frame), 2 * len(frame), 3 * len(frame)], "each is there with its last byte"


def test_a_header_that_cannot_be_is_noise_as_soon_as_that_is_seen() -> None:
    assert frame_length(b"\x24", 0) == frame_length(b"\x00\xfd", 0) == -1
    for flags in (2, 3, 4, 128, 254):
        assert frame_length(bytes([0xFD, 9, flags]), 0) == -1
    assert frame_length(b"\xfd\x09\x00", 0) == frame_length(b"\xfd\x09\x01", 0) == 0
    attitude = bytes([0xFD, 28, 0, 0, 0, 1, 1])
    for identity, length in ((30, 40), (30 + 256, 40), (30 + 65536, -1), (0xFFFFFF, -1), (50000, -1), (42000, 40)):
        known = dialect.mavlink_map.get(identity) is not None
        assert frame_length(attitude + identity.to_bytes(3, "little"), 0) == (length if known else -1)
    assert frame_length(bytes([0xFE, 28, 0, 1, 1, 30]), 0) == 36
    unknown = next(identity for identity in range(256) if identity not in codecs.KNOWN)
    assert frame_length(bytes([0xFE, 28, 0, 1, 1, unknown]), 0) == -1


def test_three_hundred_false_beginnings_are_looked_at_and_no_more() -> None:
    """A damaged frame has 280 bytes at most; a flood of beginnings holds up no loop, and is one run of noise."""
    for count, found in ((280, 1), (299, 1), (300, 0), (5000, 0)):
        codec = MavlinkCodec()
        assert len(codec.decode(b"\xfd\x00\x02" * count + packets(1)[0])) == found
        assert (codec.received, codec.bad) == (found, 1)
        assert len(codec.decode(packets(1)[0])) == 1


def test_what_was_counted() -> None:
    codec = MavlinkCodec()
    codec.decode(b"noise" + packets(1)[0] + b"more" + packets(2)[1] + packets(1)[0] + b"\xfe")
    assert (codec.received, codec.bad, codec.refused) == (3, 3, 0)


def test_a_stranger_is_known_by_his_first_bytes() -> None:
    packet = packets(1)[0]
    assert is_mavlink(packet)
    assert is_mavlink(packet + b"anything")
    for other in (b"", b"\xfd", packet[:-1], b"\x00" + packet, b"GET / HTTP/1.1"):
        assert not is_mavlink(other)


def test_identity_may_be_learnt_and_sequences_go_on() -> None:
    codec = MavlinkCodec(1, 191)
    codec.system = 7
    heartbeat = dialect.MAVLink_heartbeat_message(18, 8, 0, 0, 3, 3)
    sent = [codec.encode(heartbeat) for _ in range(257)]
    assert {(packet[5], packet[6]) for packet in sent} == {(7, 191)}
    assert [packet[4] for packet in sent] == [*range(256), 0]


@pytest.mark.parametrize("is_stream", [False, True])
def test_empty_chunks_are_nothing(is_stream) -> None:
    codec = MavlinkCodec(is_stream=is_stream)
    assert codec.decode(b"") == []
    assert codec.bad == 0


@pytest.mark.parametrize("version", [0xFD, 0xFE])
def test_messages_beyond_the_dialect_need_their_checksum_too(version: int) -> None:
    cancel = CommandCancel(1, 1, 31010)
    (read,) = MavlinkCodec().decode(MavlinkCodec().encode(cancel))
    assert (read.get_type(), read.target_system, read.target_component, read.command) == ("COMMAND_CANCEL", 1, 1, 31010)
    (read,) = MavlinkCodec().decode(MavlinkCodec(4, 5).encode(ComponentMetadata(258, 7, b"mftp://a")))
    assert (read.get_type(), read.get_srcSystem(), read.get_srcComponent()) == ("COMPONENT_METADATA", 4, 5)
    assert (read.time_boot_ms, read.file_crc, read.uri) == (258, 7, b"mftp://a".ljust(100, b"\0"))
    for identity in EXTRA_MESSAGES:
        head = bytes([version, 4]) + (bytes([0, 0, 0, 1, 1]) if version == 0xFD else bytes([0, 1, 1]))
        frame = head + identity.to_bytes(3, "little")[: 3 if version == 0xFD else 1] + b"abcd" + b"\0\0"
        assert MavlinkCodec().decode(frame) == []


def test_messages_beyond_the_dialect_are_as_their_checksum_says() -> None:
    """CRC_EXTRA by the serialisation guide's rule: names and types in the order on the wire."""
    for kind in EXTRA_MESSAGES.values():
        text = kind.msgname + " "
        for name in kind.ordered_fieldnames:
            place = kind.fieldnames.index(name)
            text += f"{kind.fieldtypes[place]} {name} "
            length = kind.array_lengths[kind.ordered_fieldnames.index(name)]
            text += chr(length) if length else ""
        crc = dialect.x25crc(text.encode()).crc
        assert (crc & 0xFF) ^ (crc >> 8) == kind.crc_extra, kind.msgname


SIZES = {"char": 1, "uint8_t": 1, "uint16_t": 2, "uint32_t": 4}


def test_messages_beyond_the_dialect_are_those_of_the_standard() -> None:
    """Number, checksum seed and length as in https://mavlink.io/en/messages/common.html and development.html."""
    standard = {
        "COMMAND_CANCEL": (80, 14, 4),
        "COMPONENT_INFORMATION": (395, 0, 212),
        "COMPONENT_METADATA": (397, 182, 108),
        "AVAILABLE_MODES": (435, 134, 46),
        "CURRENT_MODE": (436, 193, 9),
    }
    assert {kind.msgname: (kind.id, kind.crc_extra, kind.unpacker.size) for kind in EXTRA_MESSAGES.values()} == standard
    assert all(identity == kind.id for identity, kind in EXTRA_MESSAGES.items())
    beat = dialect.MAVLink_heartbeat_message
    for kind in EXTRA_MESSAGES.values():
        types = {name: kind.fieldtypes[place] for place, name in enumerate(kind.fieldnames)}
        assert sorted(kind.fieldnames) == sorted(kind.ordered_fieldnames)
        assert kind.ordered_fieldnames == sorted(kind.fieldnames, key=lambda name, t=types: -SIZES[t[name]])
        fields = [1 if types[name] != "char" else b"x" for name in kind.fieldnames]
        message = kind(*fields)
        assert (message._instance_field, message._instance_offset) == (beat.instance_field, beat.instance_offset)
        assert message.get_fieldnames() == kind.fieldnames and message.get_type() == kind.msgname


def test_messages_beyond_the_dialect_are_packed_byte_for_byte() -> None:
    """Little-endian, the wide fields first; zeros at the end are left out."""
    from autopilot.links.mavlink.frames import AvailableModes, CurrentMode

    for message, payload in (
        (CommandCancel(1, 2, 0x7922), "22 79 01 02"),
        (CurrentMode(3, 0x01020304, 0x0A0B0C0D), "04 03 02 01 0d 0c 0b 0a 03"),
        (AvailableModes(9, 8, 7, 0x01020304, 5, b"Hold"), "04 03 02 01 05 00 00 00 09 08 07 48 6f 6c 64"),
        (ComponentMetadata(258, 0x01020304, b"mftp:/a"), "02 01 00 00 04 03 02 01 6d 66 74 70 3a 2f 61"),
    ):
        frame = MavlinkCodec(4, 5).encode(message)
        assert frame[10:-2].hex(" ") == payload
        assert frame[:10] == bytes([0xFD, len(frame) - 12, 0, 0, 0, 4, 5]) + message.id.to_bytes(3, "little")
        crc = dialect.x25crc(frame[1:-2] + bytes([message.crc_extra])).crc
        assert frame[-2:] == crc.to_bytes(2, "little")
