"""Signing against pymavlink's own signer and checker as independent peer: both directions, forged, replayed, echoed."""

from __future__ import annotations

import hashlib
import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec, is_mavlink
from autopilot.links.mavlink.frames import checksum, identity_of
from autopilot.links.mavlink.signing import (
    BEHIND,
    OLD,
    UNSIGNED,
    WRONG_KEY,
    CountingTimestamps,
    LinkSigning,
    Signing,
    hint_of,
    without_signature,
)

MINUTE = 6_000_000

KEY = bytes(range(32))
NOW = 37_000_000_000_000
ATTITUDE = dialect.MAVLink_attitude_message(1, 0.5, 0.0, 0.25, 0.0, 0.0, 0.0)
COMMAND = dialect.MAVLink_command_long_message(1, 1, 400, 0, 1.0, 0, 0, 0, 0, 0, 0)
PARAMETER = dialect.MAVLink_param_set_message(1, 1, b"BS_K1", 2.0, 9)
MESSAGES = (ATTITUDE, COMMAND, PARAMETER)


def ours(key: bytes = KEY, start: int = NOW) -> LinkSigning:
    return Signing(key, CountingTimestamps(start)).link()


def peer(key: bytes = KEY, start: int = NOW, system: int = 255, link_id: int = 7) -> dialect.MAVLink:
    """pymavlink as `mavutil.setup_signing` sets it up."""
    mavlink = dialect.MAVLink(None, srcSystem=system, srcComponent=190)
    mavlink.signing.secret_key = key
    mavlink.signing.sign_outgoing = True
    mavlink.signing.link_id = link_id
    mavlink.signing.timestamp = start
    return mavlink


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.get_type())
def test_pymavlink_believes_what_we_sign_and_nothing_else(message) -> None:
    codec, reader = MavlinkCodec(1, 1, signing=ours()), peer()
    frames = [codec.encode(message) for _ in range(3)]
    for frame in frames:
        assert reader.decode(bytearray(frame)).get_type() == message.get_type()
    assert (reader.signing.goodsig_count, reader.signing.badsig_count) == (3, 0)
    stranger = MavlinkCodec(1, 1, signing=ours(key=bytes(31) + b"\1", start=NOW + 100)).encode(message)
    for refused in (frames[0], frames[2], stranger, MavlinkCodec(1, 1).encode(message)):
        with pytest.raises(dialect.MAVError, match="Invalid signature"):
            reader.decode(bytearray(refused))


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.get_type())
def test_we_believe_what_pymavlink_signs_and_nothing_else(message) -> None:
    signing = ours()
    codec = MavlinkCodec(1, 1, signing=signing)
    frame = bytes(message.pack(peer()))
    (read,) = codec.decode(frame)
    assert read.to_dict() == message.to_dict() and read.get_srcSystem() == 255
    assert codec.decode(frame) == []
    assert codec.decode(bytes(message.pack(peer(key=bytes(31) + b"\1", start=NOW + 9)))) == []
    unsigned = dialect.MAVLink(None, srcSystem=255)
    assert codec.decode(bytes(message.pack(unsigned))) == []
    assert codec.decode(bytes(message.pack(unsigned, force_mavlink1=True))) == []
    assert signing.signing.refused == {OLD: 1, WRONG_KEY: 1, UNSIGNED: 2}
    assert (codec.received, codec.refused, codec.bad) == (1, 4, 0)


def test_a_radio_speaks_without_a_key() -> None:
    radio = dialect.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7)
    frames = [bytes(radio.pack(dialect.MAVLink(None, 51, 68), force_mavlink1=one)) for one in (False, True)]
    codec = MavlinkCodec(signing=ours())
    assert [message.rssi for frame in frames for message in codec.decode(frame)] == [1, 1]
    assert codec.decode(bytes(radio.pack(peer(key=bytes(31) + b"\1")))) == [], "one with a wrong signature is refused"


def test_timestamps_count_for_each_stream_alone() -> None:
    codec = MavlinkCodec(signing=ours())
    heard = [
        peer(start=NOW + 50, link_id=1),
        peer(start=NOW + 10, link_id=2),
        peer(start=NOW + 10, link_id=1, system=254),
    ]
    assert all(len(codec.decode(bytes(ATTITUDE.pack(one)))) == 1 for one in heard)
    assert codec.decode(bytes(ATTITUDE.pack(peer(start=NOW + 50, link_id=1)))) == []
    assert len(codec.decode(bytes(ATTITUDE.pack(peer(start=NOW + 51, link_id=1))))) == 1


@pytest.mark.parametrize(("behind", "believed"), [(6_000_000, 1), (6_000_001, 0)])
def test_a_new_stream_may_be_a_minute_behind(behind: int, believed: int) -> None:
    """The guide's rule for a new stream: one minute, which is 6,000,000 units of 10 microseconds."""
    codec = MavlinkCodec(signing=ours())
    assert len(codec.decode(bytes(ATTITUDE.pack(peer(start=NOW - behind))))) == believed


def test_a_clock_ahead_takes_ours_with_it_only_when_the_signature_is_right() -> None:
    signing = ours()
    codec = MavlinkCodec(signing=signing)
    codec.decode(bytes(ATTITUDE.pack(peer(key=bytes(31) + b"\1", start=NOW + 9 * MINUTE))))
    assert signing.signing.timestamps.current == NOW
    codec.decode(bytes(ATTITUDE.pack(peer(start=NOW + 9 * MINUTE))))
    assert signing.signing.timestamps.current == NOW + 9 * MINUTE
    assert int.from_bytes(codec.encode(ATTITUDE)[-12:-6], "little") == NOW + 9 * MINUTE + 1


def test_our_own_words_are_not_taken_back_from_an_echo() -> None:
    codec = MavlinkCodec(1, 191, signing=ours())
    frames = [codec.encode(ATTITUDE) for _ in range(2)]
    assert codec.decode(frames[1]) == codec.decode(frames[0]) == []


def test_what_was_sent_over_one_link_cannot_be_replayed_over_another() -> None:
    signing = Signing(KEY, CountingTimestamps(NOW))
    first, second = (MavlinkCodec(signing=signing.link()) for _ in range(2))
    frame = bytes(COMMAND.pack(peer()))
    assert len(first.decode(frame)) == 1 and second.decode(frame) == []


def test_looking_at_a_datagram_does_not_use_it_up() -> None:
    signing = ours()
    frame = bytes(COMMAND.pack(peer()))
    for _ in range(2):
        assert len(MavlinkCodec(signing=signing.observer()).decode(frame)) == 1
    assert signing.signing.refused.total() == 0 and not signing.signing.streams
    assert MavlinkCodec(signing=signing.observer()).decode(frame[:-1] + b"x") == []
    assert signing.signing.refused == {WRONG_KEY: 1}, "but what is refused is counted, for it is not read again"
    assert len(MavlinkCodec(signing=signing).decode(frame)) == 1


def test_a_refused_frame_takes_nothing_with_it_and_hides_nothing_that_is_read() -> None:
    """A forged frame's payload may hold a whole frame that needs no signature: it is not looked into."""
    radio = bytes(dialect.MAVLink_radio_status_message(9, 2, 3, 4, 5, 6, 7).pack(dialect.MAVLink(None, 51, 68)))
    carrier = dialect.MAVLink_tunnel_message(0, 0, 1, len(radio), radio + bytes(128 - len(radio)))
    good = bytes(ATTITUDE.pack(peer()))
    for is_stream in (False, True):
        codec = MavlinkCodec(is_stream=is_stream, signing=ours())
        forged = bytes(carrier.pack(peer(key=bytes(31) + b"\1")))
        assert [message.get_type() for message in codec.decode(forged + good)] == ["ATTITUDE"]
        assert (codec.refused, codec.bad) == (1, 0)


@given(st.sampled_from(MESSAGES), st.integers(0, 300), st.integers(1, 255))
def test_no_changed_byte_is_believed(message, place, change) -> None:
    frame = bytearray(message.pack(peer()))
    frame[place % len(frame)] ^= change
    assert MavlinkCodec(signing=ours()).decode(bytes(frame)) == []


def test_twenty_thousand_forged_frames_are_refused() -> None:
    rng = random.Random(3)
    codec = MavlinkCodec(1, 1, signing=ours())
    genuine = peer()
    recorded = [bytes(COMMAND.pack(genuine)) for _ in range(50)]
    assert sum(len(codec.decode(frame)) for frame in recorded) == 50
    liar = peer(key=rng.randbytes(32), start=NOW + 1000)
    forged = [bytes(COMMAND.pack(liar)) for _ in range(100)]
    unsigned = bytes(COMMAND.pack(dialect.MAVLink(None, 255, 190)))
    for _ in range(4_000):
        guess = bytearray(rng.choice(forged))
        guess[-6:] = rng.randbytes(6)
        for frame in (bytes(guess), rng.choice(forged), rng.choice(recorded), recorded[-1], unsigned):
            assert codec.decode(frame) == []
    assert codec.refused == 20_000
    assert len(codec.decode(bytes(COMMAND.pack(genuine)))) == 1, "and the true one is still heard"


def test_a_log_gets_no_signatures() -> None:
    for message in MESSAGES:
        plain = bytes(message.pack(dialect.MAVLink(None, srcSystem=255, srcComponent=190)))
        signed = bytes(message.pack(peer()))
        assert without_signature(signed) == plain == without_signature(plain)
        old = bytes(message.pack(dialect.MAVLink(None, srcSystem=255), force_mavlink1=True))
        assert without_signature(old) == old
    unknown = bytearray(ATTITUDE.pack(peer()))
    unknown[7:10] = (0xFFFFFE).to_bytes(3, "little")
    assert without_signature(bytes(unknown)) == unknown


def test_without_a_key_signatures_are_not_looked_at() -> None:
    frame = bytes(PARAMETER.pack(peer()))
    assert len(MavlinkCodec().decode(frame)) == 1 and is_mavlink(frame)


def test_the_key_is_not_shown() -> None:
    signing = Signing(KEY, CountingTimestamps())
    assert KEY.hex() not in repr(signing) + repr(vars(signing)) and repr(KEY) not in repr(vars(signing))
    with pytest.raises(ValueError, match="32 bytes, not 5"):
        Signing(b"short", CountingTimestamps())


MAVUTIL = """
import sys
from pymavlink import mavutil
link = mavutil.mavlink_connection(sys.argv[1], source_system=255)
link.setup_signing(bytes.fromhex(sys.argv[2]))
heard = link.recv_match(type="ATTITUDE", blocking=True, timeout=60)
link.mav.command_long_send(1, 1, 400, 0, 1, 0, 0, 0, 0, 0, 0)
print(heard.yaw, heard.get_signed(), link.mav.signing.goodsig_count > 0)
"""


def test_mavutil_with_its_own_setup_signing_hears_us_and_is_heard(tmp_path: Path) -> None:
    from autopilot.links.mavlink.signing import open_signing
    from autopilot.links.transports import UdpInTransport
    from autopilot.links.url import accept_signed

    key = tmp_path / "signing.key"
    key.write_text("a passphrase of some length\n")
    key.chmod(0o600)
    signing = open_signing(key).link()
    transport = UdpInTransport("udpin:127.0.0.1:0", "127.0.0.1", 0)
    accept_signed(transport, signing)
    codec = MavlinkCodec(1, 1, signing=signing)
    digest = hashlib.sha256(b"a passphrase of some length").hexdigest()
    command = [sys.executable, "-W", "ignore", "-c", MAVUTIL, f"udpout:127.0.0.1:{transport.port}", digest]
    # mavutil's udpout speaks first: a heartbeat of its own makes it our peer
    command[4] = command[4].replace("heard =", "link.mav.heartbeat_send(6, 8, 0, 0, 4)\nheard =")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "MAVLINK20": "1"}) as process:
        messages, end = [], time.monotonic() + 120.0
        while time.monotonic() < end:
            messages += [m for data in transport.receive() for m in codec.decode(data)]
            transport.send(codec.encode(ATTITUDE))
            try:
                process.wait(0.01)
            except subprocess.TimeoutExpired:
                continue
            break
        messages += [m for data in transport.receive() for m in codec.decode(data)]
        assert process.stdout is not None
        assert process.stdout.read().split() == ["0.25", "True", "True"]
    transport.close()
    assert [message.get_type() for message in messages] == ["HEARTBEAT", "COMMAND_LONG"]
    assert codec.refused == 0


def test_each_link_signs_under_its_own_number() -> None:
    signing = Signing(KEY, CountingTimestamps(NOW))
    assert signing.summary == ""
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    numbers = [MavlinkCodec(255, 190, signing=signing.link()).encode(beat)[-13] for _ in range(3)]
    assert numbers == [numbers[0], numbers[0] + 1, numbers[0] + 2]
    signing.refused.update({"unsigned": 3, "signed with another key": 5})
    assert signing.summary == "8 MAVLink messages were refused: 5 signed with another key, 3 unsigned"
    for size in (31, 33, 0):
        with pytest.raises(ValueError, match="has 32 bytes, not"):
            Signing(bytes(size), CountingTimestamps(NOW))


def test_a_process_that_opens_links_for_ever_stays_clear_of_the_ground_stations_numbers() -> None:
    """Ground stations number their links from 0: ours lie from 64 to 255, each used once before any again."""
    for first in (64, 100, 255):
        signing = Signing(KEY, CountingTimestamps(NOW), first)
        numbers = [signing.link().link_id for _ in range(2 * 192)]
        assert numbers[0] == first and numbers[:192] == numbers[192:]
        assert sorted(numbers[:192]) == list(range(64, 256))


def test_an_echo_is_a_replay_whatever_our_sequence_number_and_ids() -> None:
    """The stream of a packet is its link, system and component: nothing else of its header."""
    for system, component in ((1, 191), (200, 1), (3, 3)):
        signing = ours()
        codec = MavlinkCodec(system, component, signing=signing)
        frames = [codec.encode(message) for message in MESSAGES]
        assert codec.decode(b"".join(frames)) == []
        assert signing.signing.refused == {OLD: 3} and set(signing.signing.streams) == {(64, system, component)}


def test_the_streams_of_a_thousand_stations_are_kept_and_no_more() -> None:
    signing = ours()
    codec = MavlinkCodec(signing=signing)
    for number in range(1100):
        frame = ATTITUDE.pack(peer(start=NOW + 50, system=1 + number % 250, link_id=number // 250))
        assert len(codec.decode(bytes(frame))) == (number < 1024), number
    assert len(codec.decode(bytes(ATTITUDE.pack(peer(start=NOW + 60, system=1, link_id=0))))) == 1, "the old go on"


def test_counted_timestamps_begin_behind_their_start_and_never_fall_back() -> None:
    stamps = CountingTimestamps()
    assert [stamps.next(), stamps.next()] == [2, 3]
    stamps.saw(10)
    stamps.saw(4)
    assert (stamps.current, stamps.next()) == (10, 11)


def test_why_nothing_was_heard_is_hinted_at_only_where_something_was_refused() -> None:
    signing = Signing(KEY, CountingTimestamps(NOW))
    assert hint_of(None) == hint_of(signing) == ""
    MavlinkCodec(signing=signing.link()).decode(bytes(ATTITUDE.pack(dialect.MAVLink(None))))
    assert hint_of(signing) == (
        " (1 MAVLink messages were refused: 1 not signed: use the same key on both sides, or none)"
    )


@given(st.integers(0, 2**24 - 1), st.binary(max_size=255))
def test_the_message_id_of_a_frame_is_read_whole_in_both_versions(identity: int, payload: bytes) -> None:
    """MAVLink 2 has 24 bits, the lowest first, in bytes 7 to 9; MAVLink 1 one byte, the fifth."""
    second = bytes([0xFD, len(payload), 0, 0, 9, 8, 7]) + identity.to_bytes(3, "little") + payload + b"\1\2"
    assert identity_of(second) == identity
    first = bytes([0xFE, len(payload), 9, 8, 7, identity & 0xFF]) + payload + b"\1\2"
    assert identity_of(first) == identity & 0xFF
    assert checksum(second[1:], 50) == dialect.x25crc(second[1:] + b"\x32").crc.to_bytes(2, "little")


def test_a_station_whose_clock_is_behind_is_said_to_be_and_not_to_replay() -> None:
    signing = Signing(KEY, CountingTimestamps(NOW))
    late = Signing(KEY, CountingTimestamps(NOW - 2 * MINUTE))
    for _ in range(2):
        MavlinkCodec(signing=signing.link()).decode(MavlinkCodec(255, 190, signing=late.link()).encode(ATTITUDE))
    assert signing.refused == {BEHIND: 2} and signing.last_refusal == BEHIND
    assert "set the clock of who sends them" in hint_of(signing) and "key" not in hint_of(signing)
