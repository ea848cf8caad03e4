"""Forwarding: byte for byte, where the addresses say, never back, never in circles, never more than the line bears."""

from __future__ import annotations

import contextlib
import socket
import time
from typing import Any

import pytest
from alarm_texts import other, shown, words
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.ground_station.access import AccessPolicy, AccessRules, Budget
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.mavlink.frames import EVERYBODY, Address, Framer, source_of, target_of
from autopilot.links.mavlink.router import ForwardLink, RoutedTransport, Router, budget_for
from autopilot.links.mavlink.signing import CountingTimestamps, Signing
from autopilot.links.mavlink.vehicle import CompanionSettings
from autopilot.links.transports import TcpServerTransport, UdpOutTransport, loopback_pair
from autopilot.runtime.build_links import LinkOptions, build_links
from autopilot.signals import AlarmSample, Mode
from autopilot.vessel.file import load_vessel

MOST_ADDRESSES = 64
REMEMBERED = 512
FRAMES_PER_TURN = 200

BEAT = dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3)
STATION_BEAT = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
ATTITUDE = dialect.MAVLink_attitude_message(1, 0.5, 0.0, 0.25, 0.0, 0.0, 0.0)


def speaker(system: int, component: int) -> dialect.MAVLink:
    return dialect.MAVLink(None, srcSystem=system, srcComponent=component)


def packed(message: Any, who: dialect.MAVLink, version_1: bool = False) -> bytes:
    frame = bytes(message.pack(who, force_mavlink1=version_1))
    who.seq = (who.seq + 1) & 0xFF
    return frame


def unknown(system: int, component: int, identity: int = 54321, sequence: int = 0) -> bytes:
    """A frame of a message that our dialect does not have; its checksum cannot be known either."""
    payload = b"\1\2\3\4\5"
    header = bytes([0xFD, len(payload), 0, 0, sequence, system, component]) + identity.to_bytes(3, "little")
    return header + payload + b"\xaa\x55"


def command(system: int, component: int) -> Any:
    return dialect.MAVLink_command_long_message(system, component, 400, 0, 1, 0, 0, 0, 0, 0, 0)


class Net:
    """A router with a flight controller (0) and ground stations (1, 2, ...); `got` holds what each was sent."""

    def __init__(self, stations: int = 2) -> None:
        self.router = Router()
        self.got: list[list[bytes]] = [[] for _ in range(stations + 1)]
        for number, box in enumerate(self.got):
            assert self.router.join(lambda frame, box=box: box.append(frame) or True, number == 0) == number

    def take(self, endpoint: int, frame: bytes) -> list[int]:
        for box in self.got:
            box.clear()
        self.router.take(endpoint, frame)
        assert all(box in ([], [frame]) for box in self.got), "unchanged, and once"
        return [number for number, box in enumerate(self.got) if box]


@pytest.mark.parametrize("name", ["COMMAND_LONG", "PARAM_SET", "MISSION_COUNT", "FILE_TRANSFER_PROTOCOL", "SET_MODE"])
def test_a_target_is_read_as_pymavlink_reads_it(name: str) -> None:
    kind = next(kind for kind in dialect.mavlink_map.values() if kind.msgname == name)
    fields = {
        field: 42 if field == "target_system" else 7 if field == "target_component" else 0 for field in kind.fieldnames
    }
    for field, length in zip(kind.ordered_fieldnames, kind.array_lengths, strict=True):
        if length:
            fields[field] = b"x" if "PARAM" in name else [0] * length
    for version_1 in (False, True):
        frame = packed(kind(**fields), speaker(9, 8), version_1)
        assert target_of(frame) == Address(42, 7 if "target_component" in kind.fieldnames else 0)
        assert source_of(frame) == Address(9, 8)


def test_every_message_of_the_dialect_says_whom_it_is_for() -> None:
    for kind in dialect.mavlink_map.values():
        payload = bytearray(kind.unpacker.size)
        frame = bytes([0xFD, len(payload), 0, 0, 0, 1, 1]) + kind.id.to_bytes(3, "little") + bytes(payload) + b"\0\0"
        assert target_of(frame) == EVERYBODY


def test_every_message_with_a_target_says_so_as_pymavlink_packs_it() -> None:
    """Fields, in the order on the wire, hold their own place: what is read is the byte of the target."""
    seen = 0
    for kind in dialect.mavlink_map.values():
        if not {"target_system", "target"} & set(kind.fieldnames) or any(kind.array_lengths):
            continue
        system_field = "target_system" if "target_system" in kind.fieldnames else "target"
        if kind.fieldtypes[kind.fieldnames.index(system_field)] != "uint8_t":
            continue
        values = dict.fromkeys(kind.fieldnames, b"x" if "char" in kind.fieldtypes else 3)
        message = kind(**{**values, system_field: 42})
        message.target_component = 7
        for version_1 in (False, True) if kind.id < 256 else (False,):
            expected = Address(42, 7 if "target_component" in kind.fieldnames else 0)
            assert target_of(packed(message, speaker(9, 8), version_1)) == expected, kind.msgname
        seen += 1
    assert seen > 40


def test_zeros_that_mavlink_2_leaves_out_are_read_as_everybody() -> None:
    """The payload of a message to everybody ends before its target where nothing else follows."""
    for system, component in ((0, 0), (5, 0), (0, 6), (5, 6)):
        message = dialect.MAVLink_command_long_message(system, component, 0, 0, 0, 0, 0, 0, 0, 0, 0)
        frame = packed(message, speaker(9, 8))
        assert frame[1] == (32 if component else 31 if system else 1)
        assert target_of(frame) == Address(system, component)


def test_what_is_for_everybody_goes_everywhere_but_back() -> None:
    net, vehicle, station = Net(), speaker(1, 1), speaker(255, 190)
    assert net.take(0, packed(BEAT, vehicle)) == [1, 2]
    assert net.take(0, packed(ATTITUDE, vehicle)) == [1, 2]
    assert net.take(1, packed(STATION_BEAT, station)) == [0, 2]
    assert net.take(0, unknown(1, 1)) == [1, 2]
    assert net.take(2, packed(STATION_BEAT, speaker(254, 1), version_1=True)) == [0, 1]


def test_what_has_an_address_goes_where_it_was_heard() -> None:
    net, vehicle, camera, one, two = Net(), speaker(1, 1), speaker(1, 100), speaker(255, 190), speaker(254, 190)
    for endpoint, who in ((0, vehicle), (0, camera), (1, one), (2, two)):
        net.take(endpoint, packed(BEAT, who))
    assert net.take(1, packed(command(1, 1), one)) == [0]
    assert net.take(1, packed(command(1, 0), one)) == [0]
    assert net.take(1, packed(command(1, 100), one)) == [0]
    assert net.take(1, packed(command(1, 57), one)) == [0], "an unknown component of a known system"
    assert net.take(0, packed(dialect.MAVLink_command_ack_message(400, 0, 0, 0, 254, 190), vehicle)) == [2]
    assert net.take(1, packed(command(254, 190), one)) == [2], "from station to station"
    assert net.take(1, packed(command(33, 1), one)) == []
    assert net.take(0, packed(command(1, 1), vehicle)) == [], "its own address: never back"
    assert net.router.counts["for nobody we know"] == 2


def test_radios_and_keys_are_not_passed_on() -> None:
    net = Net()
    radio = dialect.MAVLink_radio_status_message(1, 2, 3, 4, 5, 6, 7)
    key = dialect.MAVLink_setup_signing_message(1, 1, bytes(32), 0)
    assert net.take(0, packed(radio, speaker(51, 68))) == []
    net.take(0, packed(BEAT, speaker(1, 1)))
    assert net.take(1, packed(key, speaker(255, 190))) == []
    assert net.router.counts["not for other links"] == 2


def test_nobody_behind_us_speaks_for_the_vehicle_or_for_us() -> None:
    net, vehicle = Net(), speaker(1, 1)
    net.take(0, packed(BEAT, vehicle))
    net.router.show_own(0, packed(BEAT, speaker(1, 191)))
    assert net.take(1, packed(ATTITUDE, speaker(1, 1))) == []
    assert net.take(1, packed(ATTITUDE, speaker(1, 191))) == []
    assert net.router.counts["pretended to be the vehicle or us"] == 2
    net.take(0, packed(BEAT, speaker(255, 190)))  # a ground station on the vehicle's own radio
    assert net.take(1, packed(STATION_BEAT, speaker(255, 190))) == [0, 2]


def test_two_routers_in_a_ring_send_nothing_round_twice() -> None:
    """Two stations are joined by a cable of their own: what goes out at one comes in at the other."""
    router, sent = Router(), {0: 0, 1: 0, 2: 0}

    def cable(number: int, other: int) -> Any:
        def send(frame: bytes) -> bool:
            sent[number] += 1
            assert sum(sent.values()) < 100
            router.take(other, frame)
            return True

        return send

    def vehicle(frame: bytes) -> bool:
        sent[0] += 1
        return True

    router.join(vehicle, True)
    router.join(cable(1, 2))
    router.join(cable(2, 1))
    router.take(0, packed(BEAT, speaker(1, 1)))
    router.take(0, unknown(1, 1))
    router.take(1, packed(STATION_BEAT, speaker(255, 190)))
    assert sent == {0: 1, 1: 2, 2: 3}
    assert sum(router.counts.values()) < 20


def test_a_sender_that_does_not_count_its_packets_is_no_loop() -> None:
    net = Net()
    frame = packed(STATION_BEAT, speaker(255, 190))
    for now, passed in ((0.0, [0, 2]), (0.1, []), (1.0, [0, 2])):
        net.router.now = now
        assert net.take(1, frame) == passed


@given(st.lists(st.tuples(st.integers(0, 2), st.integers(0, 255), st.integers(0, 255)), max_size=50))
def test_memory_stays_bounded(arrivals) -> None:
    net = Net()
    for _ in range(3):
        for endpoint, system, component in arrivals:
            net.take(endpoint, packed(BEAT, speaker(system, component)))
    for number in range(3 * MOST_ADDRESSES):
        net.take(1, unknown(number % 250 + 1, 77, sequence=number % 256))
    assert all(len(heard) <= MOST_ADDRESSES for heard in net.router._received.values())
    assert len(net.router._recent) == len(net.router._order) <= REMEMBERED


def stream() -> tuple[list[bytes], bytes]:
    vehicle = speaker(1, 1)
    signer = speaker(1, 1)
    signer.signing.secret_key, signer.signing.sign_outgoing, signer.signing.timestamp = bytes(range(32)), True, 5
    frames = [
        packed(BEAT, vehicle),
        unknown(1, 1),
        packed(ATTITUDE, vehicle, version_1=True),
        packed(ATTITUDE, signer),
        unknown(1, 1, identity=0xFFFFFE),
        packed(ATTITUDE, vehicle),
    ]
    return frames, b"".join(frames)


@given(st.integers(1, 90))
def test_a_stream_split_anywhere_is_cut_into_the_same_frames(size: int) -> None:
    frames, data = stream()
    framer = Framer(is_stream=True)
    assert [f for start in range(0, len(data), size) for f in framer.frames(data[start : start + size])] == frames


def test_a_frame_of_a_stream_goes_on_with_its_last_byte_and_not_before_or_after() -> None:
    frames, data = stream()
    framer, ends = Framer(is_stream=True), []
    for place in range(len(data)):
        ends += [(place + 1, frame) for frame in framer.frames(data[place : place + 1])]
    assert ends == [(sum(map(len, frames[: n + 1])), frame) for n, frame in enumerate(frames)]


def test_a_beginning_that_cannot_be_is_passed_over_at_once() -> None:
    """Flags that no one has agreed on: what is behind them is not held back."""
    frames, _ = stream()
    for flags in (2, 3, 128, 255):
        framer = Framer(is_stream=True)
        assert framer.frames(bytes([0xFD, 200, flags]) + frames[0]) == [frames[0]]


def test_three_hundred_false_beginnings_are_looked_at_and_no_more() -> None:
    """A damaged frame has 280 bytes at most; a flood of them holds up no loop."""
    frames, _ = stream()
    for count, found in ((280, 1), (299, 1), (300, 0), (5000, 0)):
        framer = Framer()
        assert len(framer.frames(b"\xfd\x00\x02" * count + frames[0])) == found
        assert framer.frames(frames[0]) == [frames[0]]


def test_a_datagram_is_cut_too_and_borrows_nothing() -> None:
    frames, data = stream()
    framer = Framer()
    assert framer.frames(data) == frames
    assert framer.frames(frames[0][:-2]) == [] and framer.frames(frames[1]) == [frames[1]]
    damaged = bytearray(frames[0])
    damaged[-1] ^= 1
    assert framer.frames(bytes(damaged) + frames[0]) == [frames[0]]
    assert framer.frames(b"noise" + frames[1]) == [], "an unknown message behind noise is not believed"


@given(st.binary(max_size=600), st.booleans())
def test_noise_never_raises_and_is_not_kept(noise: bytes, is_stream: bool) -> None:
    framer = Framer(is_stream)
    for _ in range(3):
        framer.frames(noise)
        assert len(framer._rest) <= 280


def rig(budget: Budget | None = None, signing: Signing | None = None) -> tuple[Any, ...]:
    """A companion link and a link to a ground station behind it, each with its far end."""
    near, vehicle = loopback_pair()
    behind, station = loopback_pair()
    router = Router()
    ours = signing.link() if signing else None
    companion = CompanionLink(RoutedTransport(near, router, ours), CompanionSettings(0.5), ours)
    forward = ForwardLink(behind, router, budget or budget_for(0), signing.link() if signing else None)
    return companion, vehicle, forward, station


def kinds(transport: Any) -> list[str]:
    return [speaker(0, 0).decode(bytearray(frame)).get_type() for frame in transport.receive()]


def test_a_station_sees_vehicle_and_companion_and_its_words_arrive_unchanged() -> None:
    companion, vehicle, forward, station = rig()
    frames = [packed(BEAT, one := speaker(1, 1)), packed(ATTITUDE, one), unknown(1, 1)]
    for frame in frames:
        vehicle.send(frame)
    companion.receive(0.1)
    assert companion.session.vehicle == 1
    assert station.receive() == frames
    companion.poll(0.2)
    companion.publish_tick(shown(0.2, Mode.STANDBY, (other("hello"),)))
    companion.poll(0.3)
    assert sorted(kinds(station)) == ["HEARTBEAT", "NAMED_VALUE_INT", "STATUSTEXT"]
    vehicle.receive()
    words = [packed(command(1, 1), gcs := speaker(255, 190)), unknown(255, 190), packed(STATION_BEAT, gcs)]
    for word in words:
        station.send(word)
    assert forward.receive(0.4) == []
    assert vehicle.receive() == words
    assert [packet for _, packet in forward.take_packets()] == [words[0], words[2]], "what the log can hold"
    assert companion.receive(0.5) == [] and companion.session.vehicle == 1


def test_what_we_send_as_a_ground_station_and_to_the_vehicle_alone_stays_there() -> None:
    near, vehicle = loopback_pair()
    behind, station = loopback_pair()
    router = Router()
    companion = CompanionLink(RoutedTransport(near, router), CompanionSettings(0.5, as_gcs=True))
    ForwardLink(behind, router, budget_for(0))
    vehicle.send(packed(BEAT, speaker(1, 1)))
    for tick in range(40):
        companion.receive(0.1 * tick)
        companion.poll(0.1 * tick)
    sent = [speaker(0, 0).decode(bytearray(frame)) for frame in vehicle.receive()]
    assert {m.get_type() for m in sent} > {"HEARTBEAT", "COMMAND_LONG"}
    assert {m.get_srcSystem() for m in sent} == {1, 255}
    seen = [speaker(0, 0).decode(bytearray(frame)) for frame in station.receive()]
    assert {(m.get_type(), m.get_srcSystem(), m.get_srcComponent()) for m in seen} == {
        ("HEARTBEAT", 1, 1),
        ("HEARTBEAT", 1, 191),
        ("NAMED_VALUE_INT", 1, 191),
    }, "another pilot may be behind us: it is to hear what we are"


def test_a_flood_takes_no_more_of_a_serial_line_than_its_share() -> None:
    _, vehicle, forward, station = rig(budget_for(57600))
    gcs = speaker(255, 190)
    passed = 0
    for tick in range(100):
        for _ in range(50):
            station.send(unknown(255, 190, identity=60000 + tick, sequence=gcs.seq))
            gcs.seq = (gcs.seq + 1) & 0xFF
        forward.receive(0.05 * tick)
        passed += sum(map(len, vehicle.receive()))
    assert 0.95 * 2880.0 * 5.0 < passed < 1.05 * 2880.0 * 5.5
    assert forward.dropped > 3000
    _, vehicle, forward, station = rig()
    for number in range(3 * FRAMES_PER_TURN):
        station.send(unknown(255, 190, identity=60000 + number))
    forward.receive(0.0)
    assert len(vehicle.receive()) == FRAMES_PER_TURN and forward.dropped == 2 * FRAMES_PER_TURN
    assert forward._access.crowded


def test_with_a_key_nothing_unsigned_passes_either_way_and_what_is_signed_passes_unchanged() -> None:
    key = bytes(range(32))
    companion, vehicle, forward, station = rig(signing=Signing(key, CountingTimestamps(10**12)))
    boat, gcs = speaker(1, 1), speaker(255, 190)
    vehicle.send(packed(BEAT, boat))
    station.send(packed(command(1, 1), gcs))
    companion.receive(0.1)
    forward.receive(0.1)
    assert station.receive() == [] and vehicle.receive() == [] and companion.session.vehicle == 0
    for who in (boat, gcs):
        who.signing.secret_key, who.signing.sign_outgoing, who.signing.timestamp = key, True, 10**12
    beat, word = packed(BEAT, boat), packed(command(1, 1), gcs)
    vehicle.send(beat)
    companion.receive(0.2)
    assert companion.session.vehicle == 1 and station.receive() == [beat]
    station.send(word)
    forward.receive(0.3)
    assert vehicle.receive() == [word]
    station.send(word)
    forward.receive(0.4)
    assert vehicle.receive() == [], "a recording is not passed on again"


def test_a_dead_and_a_slow_station_hold_nothing_up() -> None:
    near, vehicle = loopback_pair()
    router = Router()
    companion = CompanionLink(RoutedTransport(near, router), CompanionSettings(0.5))
    slow = TcpServerTransport("tcpin:127.0.0.1:0", "127.0.0.1", 0)
    slow._listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as unheard:
        unheard.bind(("127.0.0.1", 0))
        nobody = unheard.getsockname()[1]
    dead = UdpOutTransport("udpout:dead", "127.0.0.1", nobody)
    links = [ForwardLink(transport, router, budget_for(0)) for transport in (slow, dead)]
    behind, station = loopback_pair()
    links.append(ForwardLink(behind, router, budget_for(0)))
    with socket.create_connection(("127.0.0.1", slow.port)) as lazy:
        lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        boat, samples, heard = speaker(1, 1), 0, 0
        vehicle.send(packed(BEAT, boat))
        for tick in range(6000):
            for number in range(20):
                vehicle.send(packed(dialect.MAVLink_attitude_message(20 * tick + number, 0, 0, 0, 0, 0, 0), boat))
            samples += len(companion.receive(0.01 * tick))
            heard += len(station.receive())
            if router.counts["dropped: endpoint full or away"] > 10 * tick + 2000:
                break
        for link in links:
            assert link.receive(1.0) == []
    assert tick < 5999, "more is dropped than the dead one drops: the slow one's buffer has filled"
    assert heard == 20 * (tick + 1) + 1 and samples > 0
    for link in links:
        link.close()


def test_a_station_that_is_gone_is_an_alarm_once_and_the_others_go_on() -> None:
    companion, vehicle, forward, station = rig()
    station.close()
    (alarm,) = forward.receive(0.1)
    assert isinstance(alarm, AlarmSample) and "steering goes on" in words(alarm.event)
    forward._transport.fileno = lambda: 17
    assert forward.receive(0.2) == [] and forward.fileno() == -1
    vehicle.send(packed(BEAT, speaker(1, 1)))
    companion.receive(0.3)
    assert companion.session.vehicle == 1


def test_a_station_that_floods_us_is_looked_away_from_until_the_next_tick() -> None:
    _, _, forward, _ = rig()
    forward._transport.fileno = lambda: 17
    assert forward.fileno() == 17
    forward._access.crowded = True
    assert forward.fileno() == -1 and forward.receive(0.1) == []
    forward.publish_tick(shown(0.2))
    assert forward.fileno() == 17


def test_frames_lost_on_a_broken_link_are_not_counted_as_forwarded() -> None:
    companion, vehicle, forward, station = rig()
    vehicle.send(packed(BEAT, speaker(1, 1)))
    companion.receive(0.1)
    passed = forward._router.counts["passed on"]
    vehicle.close()
    station.send(packed(STATION_BEAT, speaker(255, 190)))
    forward.receive(0.2)
    counts = forward._router.counts
    assert (counts["passed on"] - passed, counts["dropped: endpoint full or away"]) == (0, 1)


def test_the_same_bytes_come_round_for_two_seconds_and_again_after_a_quarter() -> None:
    frame = packed(STATION_BEAT, speaker(255, 190))
    for endpoint, later, passes in ((1, 0.24, False), (1, 0.26, True), (2, 1.99, False), (2, 2.01, True)):
        net = Net()
        assert net.take(1, frame) == [0, 2]
        net.router.now = later
        assert bool(net.take(endpoint, frame)) is passes
        assert net.router.counts["came round in a loop"] == (not passes)


def test_five_hundred_and_twelve_frames_are_remembered() -> None:
    for others, is_known in ((511, True), (512, False)):
        net, who = Net(), speaker(255, 190)
        frame = packed(STATION_BEAT, who)
        net.take(1, frame)
        for number in range(others):
            net.take(1, unknown(255, 190, 40000 + number))
        net.take(2, frame)
        assert net.router.counts["came round in a loop"] == is_known


def test_sixty_four_addresses_are_learnt_at_an_endpoint() -> None:
    net = Net()
    for system in range(1, 70):
        net.take(1, packed(STATION_BEAT, speaker(system, 190)))
    net.take(1, packed(STATION_BEAT, speaker(0, 190)))
    reached = [bool(net.take(2, packed(command(system, 190), speaker(255, 1)))) for system in range(1, 70)]
    assert reached == [True] * 64 + [False] * 5
    assert net.router.counts["for nobody we know"] == 5


def test_who_has_left_is_sent_nothing_and_found_nowhere() -> None:
    net = Net()
    net.take(1, packed(STATION_BEAT, speaker(255, 190)))
    net.router.leave(1)
    assert net.take(0, packed(BEAT, speaker(1, 1))) == [2]
    assert net.router.counts["dropped: endpoint full or away"] == 1
    assert net.take(2, packed(command(255, 190), speaker(254, 190))) == []


@pytest.mark.parametrize(("baud", "rate"), [(57600, 2880.0), (115200, 5760.0), (0, 200_000.0)])
def test_half_a_serial_line_is_for_stations_and_half_a_second_s_worth_at_once(baud: int, rate: float) -> None:
    budget = budget_for(baud)
    assert budget.part(0.0, 1_000_000) == rate / 2.0
    assert budget.part(0.25, 1_000_000) == pytest.approx(rate / 4.0, abs=1.0)
    assert budget.part(9.0, 1_000_000) == rate / 2.0


@pytest.mark.parametrize("is_stream", [False, True])
@pytest.mark.parametrize("stray", [b"\xfd", b"\xfe", b"\xfd\xfd", b"\xfe\xfd\xfe", b"x\xfd", b"\xfdx"])
def test_a_stray_beginning_directly_before_a_frame_hides_it_from_nobody(stray: bytes, is_stream: bool) -> None:
    frame = packed(BEAT, speaker(1, 1))
    assert Framer(is_stream).frames(stray + 30 * frame) == [frame] * 30
    decoded = MavlinkCodec(is_stream=is_stream).decode(stray + 30 * frame)
    assert [message.get_type() for message in decoded] == ["HEARTBEAT"] * 30


class Lan:
    """A transport to another machine, over a loopback."""

    is_local = False

    def __init__(self, near: Any) -> None:
        self._near = near

    def __getattr__(self, name: str) -> Any:
        return getattr(self._near, name)


def forwarded(message: Any, *, is_local: bool = False, rules: AccessRules | None = None, key: bool = False) -> bool:
    """Return whether the vehicle gets what a station behind us says."""
    signing = Signing(bytes(range(32)), CountingTimestamps(10**12)) if key else None
    router, (near, vehicle), (behind, station) = Router(), loopback_pair(), loopback_pair()
    ours = RoutedTransport(near, router)
    transport = behind if is_local else Lan(behind)
    access = AccessPolicy(rules or AccessRules()).link()
    link = ForwardLink(transport, router, budget_for(0), signing and signing.link(), access)
    vehicle.send(packed(BEAT, speaker(1, 1)))
    ours.receive()
    other = Signing(bytes(range(32)), CountingTimestamps(2 * 10**12)) if key else None
    station.send(MavlinkCodec(255, 190, signing=other and other.link()).encode(message))
    link.receive(0.1)
    return bool(vehicle.receive())


OVERRIDE = dialect.MAVLink_rc_channels_override_message(1, 1, *[1900] * 8, *[0] * 10)
INTERVAL = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 0, 30, -1, *[0] * 5)


@pytest.mark.parametrize(
    "message",
    [
        command(1, 1),
        OVERRIDE,
        INTERVAL,
        dialect.MAVLink_set_mode_message(1, 1, 4),
        dialect.MAVLink_param_set_message(1, 1, b"RC1_REVERSED", 1.0, 9),
        dialect.MAVLink_mission_clear_all_message(1, 1, 0),
        dialect.MAVLink_request_data_stream_message(1, 1, 10, 0, 0),
        dialect.MAVLink_manual_control_message(1, 0, 1000, 0, 0, 0),
        dialect.MAVLink_set_attitude_target_message(0, 1, 1, 0, [1.0, 0.0, 0.0, 0.0], 0.0, 0.0, 0.0, 1.0),
        dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, [0] * 251),
    ],
    ids=lambda message: message.get_type(),
)
def test_without_a_key_another_machine_gives_the_flight_controller_no_order(message: Any) -> None:
    assert not forwarded(message)
    assert forwarded(message, is_local=True)
    assert forwarded(message, rules=AccessRules(orders_without_key=True))
    assert forwarded(message, key=True)


@pytest.mark.parametrize(
    "message",
    [
        STATION_BEAT,
        dialect.MAVLink_param_request_list_message(1, 1),
        dialect.MAVLink_param_request_read_message(1, 1, b"RC1_TRIM", -1),
        dialect.MAVLink_mission_request_list_message(1, 1, 0),
        dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_REQUEST_MESSAGE, 0, 148, *[0] * 6),
    ],
    ids=lambda message: message.get_type(),
)
def test_without_a_key_another_machine_may_look_at_the_flight_controller(message: Any) -> None:
    assert forwarded(message)


def test_a_line_that_is_opened_again_and_again_takes_no_new_place() -> None:
    router = Router()
    seen: list[bytes] = []
    router.join(lambda frame: seen.append(frame) or True, has_vehicle=True)
    for _ in range(5):
        behind, station = loopback_pair()
        link = ForwardLink(behind, router, budget_for(0))
        station.send(packed(STATION_BEAT, speaker(255, 190)))
        router.now += 10.0
        link.receive(router.now)
        link.close()
    assert len(router._senders) == 2
    assert len(seen) == 5


def test_with_reconnect_a_forward_that_is_lost_is_opened_again(capsys: pytest.CaptureFixture[str]) -> None:
    vessel = load_vessel("lanxin")
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        server.listen()
        url = f"tcp:127.0.0.1:{server.getsockname()[1]}"
        options = LinkOptions(reconnect=True, forward=(url,))
        boat, forward = build_links(vessel, ["udpin:127.0.0.1:0"], options)
        first, _ = server.accept()
        first.close()
        server.setblocking(False)
        turn, end = 0, time.monotonic() + 60.0
        while True:
            assert time.monotonic() < end, "not opened again"
            forward.receive(0.1 * (turn := turn + 1))
            time.sleep(0.02)  # it is opened by a thread
            with contextlib.suppress(BlockingIOError):
                again, _ = server.accept()
                break
        again.close()
        for link in (boat, forward):
            link.close()


def test_a_forward_to_other_machines_says_that_it_takes_no_orders(capsys: pytest.CaptureFixture[str]) -> None:
    vessel = load_vessel("lanxin")
    for reconnect in (False, True):
        options = LinkOptions(reconnect=reconnect, forward=("udpin:0.0.0.0:0", "udpin:127.0.0.1:0"))
        for link in build_links(vessel, ["udpin:127.0.0.1:0"], options):
            link.close()
        assert capsys.readouterr().err.count("give no orders: no signing key is set") == 1


def test_nothing_is_sent_where_its_sender_has_been_heard() -> None:
    """A camera with a link of its own, and two stations that both have the usual id."""
    net, camera = Net(3), speaker(1, 100)
    net.take(0, packed(BEAT, speaker(1, 1)))
    net.take(1, packed(STATION_BEAT, camera))
    net.router.now = 10.0
    assert net.take(2, packed(STATION_BEAT, camera)) == [0, 3], "round over another link, however late"
    net.take(1, packed(STATION_BEAT, one := speaker(255, 190)))
    net.router.now = 20.0
    assert net.take(3, packed(STATION_BEAT, one)) == [0, 2]
    assert net.router.counts["its sender is there"] == 2
    net.take(0, packed(STATION_BEAT, one))
    assert net.take(3, packed(command(1, 1), one)) == [0], "but the flight controller obeys each of them"


def test_what_the_vehicle_says_is_not_sent_back_to_it_round_a_slow_ring() -> None:
    net, camera = Net(), speaker(1, 100)
    net.take(0, packed(BEAT, speaker(1, 1)))
    beat = packed(STATION_BEAT, camera)
    assert net.take(0, beat) == [1, 2]
    net.router.now = 30.0
    assert net.take(1, beat) == [2]


def test_who_spoke_as_the_vehicle_before_it_was_heard_is_not_cut_off_from_it() -> None:
    net, vehicle, ours = Net(), speaker(1, 1), speaker(1, 191)
    net.take(1, packed(BEAT, vehicle))
    net.take(1, packed(BEAT, ours))
    net.router.now = 10.0
    assert net.take(0, packed(ATTITUDE, vehicle)) == [1, 2]
    for box in net.got:
        box.clear()
    net.router.show_own(0, packed(STATION_BEAT, ours))
    assert [len(box) for box in net.got] == [0, 1, 1]
    assert net.take(2, packed(command(1, 1), speaker(255, 190))) == [0]
