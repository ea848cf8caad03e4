"""Who is let in and how much of it: system ids, addresses, rates, bytes; where links listen."""

from __future__ import annotations

import contextlib
import dataclasses
import ipaddress
import os
import pty
import socket
import tty
from pathlib import Path
from typing import Any

import pytest
from alarm_texts import shown, words
from boat_at_sea import STEP
from hypothesis import given
from hypothesis import strategies as st
from monitored_boat import Watched
from pymavlink.dialects.v20 import ardupilotmega as dialect
from station_doubles import Skipper, Store

from autopilot.errors import InputError
from autopilot.files.strict_yaml import parse_document
from autopilot.guidance.track import TrackGuide
from autopilot.links.base import LinkError
from autopilot.links.ground_station.access import AccessPolicy, AccessRules, Budget, Presence, Stops
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.orders import gives_rudder_back
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.mavlink import frames
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.router import ForwardLink, Router, budget_for
from autopilot.links.mavlink.signing import CountingTimestamps, Signing
from autopilot.links.transports import (
    TcpClientTransport,
    TcpServerTransport,
    UdpInTransport,
    UdpOutTransport,
    loopback_pair,
)
from autopilot.links.transports.medium import interface_address, is_everywhere, only_from
from autopilot.links.transports.serial_line import SerialTransport
from autopilot.links.url import open_transport, parse_url
from autopilot.runtime.build import build_pilot
from autopilot.runtime.build_links import LinkOptions, Stations, access_rules_of, build_station_links
from autopilot.runtime.vessel_store import VesselStore
from autopilot.signals import (
    AlarmEvent,
    AlarmSample,
    AlarmState,
    Mode,
    NavState,
    Order,
    OrderKind,
    Reference,
    RudderCommand,
    Tick,
)
from autopilot.vessel.file import dump_vessel, load_vessel, vessel_from
from autopilot.vessel.parameters import parameters_of
from autopilot.vessel.schema import Security, Vessel
from autopilot.web.requests import asked_of

BYTES_AT_ONCE = 8_000.0
STATION_SILENT_S = 5.0
TRIES = 300

ARM = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
DISARM = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 0, 0, 0, 0, 0, 0)
MANUAL = dialect.MAVLink_set_mode_message(1, 1, 0)
TUNE = dialect.MAVLink_param_set_message(1, 1, b"GAIN", 3.0, 9)


class Bench:
    def __init__(self, rules: AccessRules) -> None:
        self.near, self.far = loopback_pair()
        self.store, self.hand, self.policy = Store(), Skipper(), AccessPolicy(rules)
        self.commands = Commands(self.hand, armed=False, mission=Mission(TrackGuide()))  # type: ignore[arg-type]
        server = ParameterServer(self.store)
        self.boat = BoatLink(self.near, self.commands, server, access=self.policy.link())

    def send_text(self, now: float, *messages: Any, system: int = 255) -> None:
        codec = MavlinkCodec(system, 190)
        for message in messages:
            self.far.send(codec.encode(message))
        self.boat.receive(now)

    def texts(self, now: float) -> list[str]:
        self.boat.poll(now)
        read = MavlinkCodec()
        messages = [message for data in self.far.receive() for message in read.decode(data)]
        return [message.text for message in messages if message.get_type() == "STATUSTEXT"]


def test_only_the_systems_that_are_allowed_are_obeyed() -> None:
    bench = Bench(AccessRules(systems=frozenset({255, 254})))
    bench.send_text(0.0, ARM, TUNE, system=77)
    assert not bench.commands.armed and not bench.store.written
    assert bench.policy.refused == {"from system ids not allowed": 2}
    assert [text for text in bench.texts(0.1) if "system id that is not allowed" in text]
    assert "2 from system ids not allowed" in bench.policy.summary
    bench.send_text(1.0, ARM, TUNE, system=254)
    assert bench.commands.armed and bench.store.written == 1


def test_writes_and_commands_have_a_rate_and_what_frees_the_rudder_has_none() -> None:
    bench = Bench(AccessRules(commands_hz=2.0, writes_hz=5.0))
    bench.send_text(0.0, *[TUNE] * 90)
    assert bench.store.written == 20  # four seconds' worth at once
    bench.send_text(1.0, *[TUNE] * 90)
    assert bench.store.written == 25
    assert bench.policy.refused["writes too many"] == 70 + 85
    assert any("parameter writes beyond 5 a second" in text for text in bench.texts(1.1))
    bench.send_text(10.0, *[ARM] * 50)
    assert bench.policy.refused["commands too many"] == 42
    released = bench.hand.released
    bench.send_text(10.0, DISARM)
    assert not bench.commands.armed and bench.hand.released == released + 1
    bench.send_text(10.0, ARM)
    assert not bench.commands.armed
    bench.send_text(10.0, dialect.MAVLink_set_mode_message(1, 1, 0))
    assert bench.hand.released == released + 2


def test_a_flood_is_cut_off_unseen_and_wakes_nobody_until_the_next_tick(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = Bench(AccessRules())
    monkeypatch.setattr(bench.near, "fileno", lambda: 7)
    assert bench.boat.fileno() == 7
    flood = MavlinkCodec(255, 190).encode(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)) * 4000
    bench.far.send(flood)
    bench.boat.receive(0.0)
    assert len(bench.boat.take_packets()) <= BYTES_AT_ONCE / 21
    assert bench.boat.fileno() == -1
    bench.boat.publish_tick(shown(0.05))
    assert bench.boat.fileno() == 7
    assert any("beyond what one link may bring" in reason for reason in bench.policy.refused)


def test_forwarding_passes_on_the_systems_that_are_allowed() -> None:
    to_station, station = loopback_pair()
    seen: list[bytes] = []
    router = Router()
    router.join(lambda frame: bool(seen.append(frame)) or True, has_vehicle=True)
    link = ForwardLink(to_station, router, budget_for(0), access=AccessPolicy(AccessRules(frozenset({255}))).link())
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)
    frames = [MavlinkCodec(system, 190).encode(beat) for system in (9, 255)]
    for frame in frames:
        station.send(frame)
    link.receive(0.0)
    assert seen == frames[1:]


def test_to_be_asked_who_may_have_sent_a_message_changes_no_answer() -> None:
    access = AccessPolicy().link()
    beat = dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3)
    (vehicle,) = MavlinkCodec(9, 1).decode(MavlinkCodec(9, 1).encode(beat))
    (asked,) = MavlinkCodec(9, 1).decode(MavlinkCodec(9, 1).encode(dialect.MAVLink_param_request_list_message(0, 0)))
    assert [access.accepts(message) for message in (asked, vehicle, asked)] == [True, False, True]
    access.heard(vehicle)
    assert not access.accepts(asked)


@given(st.floats(0.1, 100.0), st.lists(st.tuples(st.floats(0.0, 2.0), st.integers(0, 50)), max_size=50))
def test_a_budget_never_gives_more_than_its_rate_and_what_was_saved(
    rate: float, asked: list[tuple[float, int]]
) -> None:
    budget, most, now, got = Budget(rate, 10.0), 10.0, 0.0, 0
    for wait, size in asked:
        now += wait
        got += budget.part(now, size)
    assert got <= most + rate * now + 1e-6
    assert not Budget(rate, 10.0).spend(now, 10.5)
    assert Budget(rate, 10.0).spend(now, 10.0)


@pytest.mark.parametrize("fill", [b"\xfe", b"\xfd", b"\xfd\x00\x00", b"\xfe\x09\x00\x01\x01\x00"])
def test_noise_of_frame_starts_is_given_up_but_a_frame_behind_it_read(fill: bytes, monkeypatch) -> None:
    frame = MavlinkCodec(1, 1).encode(ARM)
    (read,) = MavlinkCodec().decode(b"\xfd" * (TRIES - 100) + frame)
    assert read.command == dialect.MAV_CMD_COMPONENT_ARM_DISARM
    for is_stream in (False, True):
        codec, looks = MavlinkCodec(is_stream=is_stream), 0
        real = codec._decode_frame

        def counted(data: bytes, real: Any = real) -> Any:
            nonlocal looks
            looks += 1
            return real(data)

        monkeypatch.setattr(codec, "_decode_frame", counted)
        assert codec.decode((fill * 65536)[:65536] + frame) in ([], [None])
        assert looks <= TRIES


def test_only_addresses_of_the_allowed_networks_are_let_in() -> None:
    allows = only_from([ipaddress.ip_network("127.0.0.0/30"), ipaddress.ip_network("fe80::/10")])
    assert allows("127.0.0.1") and allows("::ffff:127.0.0.2") and allows("fe80::1%eth0")
    assert not allows("127.0.0.9") and not allows("::1")
    assert only_from([])("203.0.113.7")


def test_an_address_that_is_not_allowed_never_becomes_the_peer() -> None:
    link = open_transport("udpin:127.0.0.1:0?allow=127.0.0.2")
    assert isinstance(link, UdpInTransport)
    hello = MavlinkCodec(1, 1).encode(ARM)
    stranger = UdpOutTransport("stranger", "127.0.0.1", link.port)
    stranger.send(hello)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as friend:
        friend.bind(("127.0.0.2", 0))
        friend.sendto(hello, ("127.0.0.1", link.port))
        got: list[bytes] = []
        while not got:
            got = link.receive()
        assert got == [hello] and link.peer == friend.getsockname() and link.refused_senders == 1
    for each in (stranger, link):
        each.close()


def test_a_connection_from_elsewhere_is_hung_up_on() -> None:
    link = open_transport("nmea-tcpin:127.0.0.1:0", [ipaddress.ip_network("10.0.0.0/8")])
    assert isinstance(link, TcpServerTransport)
    client = TcpClientTransport("client", "127.0.0.1", link.port)
    with pytest.raises(LinkError, match="closed the connection"):
        while True:
            assert link.receive() == [] and not link.send(b"$")
            client.receive()
    assert link.refused_senders == 1
    client.close()
    link.close()


def test_listening_everywhere_is_said_and_an_interface_can_be_named(capsys: pytest.CaptureFixture[str]) -> None:
    for url in ("udpin:0.0.0.0:0", "tcpin:0.0.0.0:0", "nmea-udp:0.0.0.0:0", "nmea-tcpin:0.0.0.0:0"):
        open_transport(url).close()
        said = capsys.readouterr().err
        assert said.count("\n") == 2 and said.count(repr(url)) == 2 and "listens on every network" in said
    assert is_everywhere("0.0.0.0") and is_everywhere("::") and not is_everywhere("localhost")
    assert interface_address("lo") == "127.0.0.1" and interface_address("nosuch0") is None
    link = open_transport("udpin:lo:0")
    assert isinstance(link, UdpInTransport) and link._socket.getsockname()[0] == "127.0.0.1"
    assert capsys.readouterr().err == f"link 'udpin:lo:0' listens at port {link.port}\n"
    link.close()
    with pytest.raises(InputError, match="incomplete"):
        parse_url("udpin::14550")


@pytest.mark.parametrize(
    ("url", "sentence"),
    [
        ("udpin:127.0.0.1:14550?allow=10.0.0.1/24", "'10.0.0.1/24' is no network"),
        ("tcpin:127.0.0.1:5760?allow=", "'' is no network"),
        ("udpout:127.0.0.1:14550?allow=10.0.0.1", "takes none"),
    ],
)
def test_bad_allowances_are_one_sentence(url: str, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        parse_url(url)


def is_security(line: str) -> bool:
    return line.startswith("security") or "_per_s" in line or "orders_without_key" in line


def test_the_vessel_file_says_who_may_come_and_no_station_can_change_it() -> None:
    text = dump_vessel(load_vessel("lanxin"))
    text = "\n".join(line for line in text.splitlines() if not is_security(line))
    asked = (
        "\nsecurity:\n  allow_systems: [255, 254]\n  allow_addresses: [127.0.0.1/32, 10.0.0.0/24]\n  writes_per_s: 3\n"
    )
    vessel = vessel_from(parse_document(text + asked, "boat.yaml"))
    assert vessel.security == Security((255, 254), ("127.0.0.1/32", "10.0.0.0/24"), 10.0, 3.0, False)
    assert vessel_from(parse_document(dump_vessel(vessel), "again")) == vessel
    assert not [each for each in parameters_of(vessel) if "security" in each.path]
    with pytest.raises(Exception, match=r"allow_addresses has '10\.0\.0\.300', which is no network"):
        vessel_from(parse_document(text + "\nsecurity:\n  allow_addresses: [10.0.0.300]\n", "boat.yaml"))
    with pytest.raises(Exception, match="needed is a whole number from 1 to 255"):
        vessel_from(parse_document(text + "\nsecurity:\n  allow_systems: [0]\n", "boat.yaml"))


def stations_at(urls: tuple[str, ...], vessel: Vessel, folder: Path, options: LinkOptions | None = None) -> list[Any]:
    """The links of a run to ground stations."""
    store = VesselStore(vessel, build_pilot(vessel), None, folder / "boat.tuned.yaml")
    commands = Commands(Skipper(), armed=False, mission=Mission(TrackGuide()))  # type: ignore[arg-type]
    return build_station_links(vessel, Stations(urls), commands, store, options or LinkOptions())


def test_what_the_file_allows_holds_for_the_links_of_a_run(tmp_path: Path) -> None:
    boat = load_vessel("lanxin")
    security = Security((255,), ("127.0.0.2",), 10.0, 25.0)
    vessel = dataclasses.replace(boat, security=security)
    options = LinkOptions(policy=AccessPolicy(access_rules_of(vessel)))
    (served,) = stations_at(("udpin:127.0.0.1:0",), vessel, tmp_path, options)
    assert isinstance(served, BoatLink) and isinstance(served._transport, UdpInTransport)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ok,
    ):
        far.bind(("127.0.0.1", 0))
        ok.bind(("127.0.0.2", 0))
        goal = ("127.0.0.1", served._transport.port)
        far.sendto(MavlinkCodec(255, 190).encode(ARM), goal)
        ok.sendto(MavlinkCodec(77, 190).encode(ARM), goal)
        for _ in range(100):
            served.receive(0.0)
            if served._transport.refused_senders == 2:
                break
        assert not served._commands.armed and served._transport.peer is None and served._transport.refused_senders == 2
        ok.sendto(MavlinkCodec(255, 190).encode(ARM), goal)
        for _ in range(100):
            served.receive(0.1)
        assert served._commands.armed and served._transport.peer == ok.getsockname()
    served.close()


EVERYBODY = AccessRules()


class Wired:
    """A boat served at a port of its own to stations with sockets of their own, on a clock moved by hand."""

    def __init__(self, host: str = "127.0.0.1", rules: AccessRules = EVERYBODY, tcp: bool = False) -> None:
        kind = TcpServerTransport if tcp else UdpInTransport
        self.transport = kind("served", host, 0)
        self.hand, self.store, self.now = Skipper(), Store(), 0.0
        self.commands = Commands(self.hand, armed=False, mission=Mission(TrackGuide()))  # type: ignore[arg-type]
        self.boat = BoatLink(
            self.transport, self.commands, ParameterServer(self.store), access=AccessPolicy(rules).link()
        )
        self.samples: list[Any] = []
        self.ends: list[Any] = []

    def station(self) -> UdpOutTransport | TcpClientTransport:
        kind = TcpClientTransport if isinstance(self.transport, TcpServerTransport) else UdpOutTransport
        self.ends.append(kind("station", "127.0.0.1", self.transport.port))
        return self.ends[-1]  # type: ignore[no-any-return]

    def run(self, seconds: float, *talking: Any, message: Any = None, codec: MavlinkCodec | None = None) -> None:
        """Let time pass while some stations send a message twice a second: heartbeats, unless it is named."""
        codec = codec or MavlinkCodec(255, 190)
        for turn in range(round(seconds * 20)):
            if turn % 10 == 0:
                for station in talking:
                    station.send(codec.encode(message or STATION_BEAT))
            self.now += 0.05
            self.samples += self.boat.receive(self.now)
            self.boat.poll(self.now)

    def alarms(self) -> list[tuple[str, bool]]:
        return [(sample.name, sample.present) for sample in self.samples]

    def close(self) -> None:
        for end in (self.boat, *self.ends):
            end.close()


STATION_BEAT = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


def heard(station: Any) -> list[str]:
    codec = MavlinkCodec(255, 190, is_stream=True)
    try:
        return [message.get_type() for data in station.receive() for message in codec.decode(data)]
    except LinkError:
        return []


@pytest.mark.parametrize("tcp", [False, True], ids=["udp", "tcp"])
def test_a_station_that_starts_again_from_another_port_is_heard_and_reported(tcp: bool) -> None:
    boat = Wired(tcp=tcp)
    first = boat.station()
    boat.run(10.0, first)
    boat.run(0.5, first, message=ARM)
    assert boat.commands.armed and "HEARTBEAT" in heard(first) and not boat.alarms()
    again = boat.station()  # the first one's process is gone without a word, its connection stands for all we know
    boat.run(STATION_SILENT_S - 1.0, again)
    assert "HEARTBEAT" not in heard(again), "somebody else holds the place"
    boat.run(3.0, again)
    boat.run(0.5, again, message=DISARM)
    assert not boat.commands.armed and boat.hand.released == 1
    assert "HEARTBEAT" in heard(again)
    assert boat.alarms() == [("station_silent", True), ("station_silent", False)]
    boat.close()


@pytest.mark.parametrize("tcp", [False, True], ids=["udp", "tcp"])
def test_a_station_that_only_listens_hears_of_the_boat_until_another_comes(tcp: bool) -> None:
    boat = Wired(tcp=tcp)
    quiet = boat.station()
    boat.run(0.5, quiet)
    boat.run(30.0)
    assert heard(quiet).count("HEARTBEAT") >= 30
    assert boat.alarms() == [("station_silent", True)]
    boat.run(3.0, boat.station())
    heard(quiet)
    boat.run(3.0)
    assert "HEARTBEAT" not in heard(quiet)
    boat.close()


def test_a_stray_datagram_does_not_block_a_station() -> None:
    boat = Wired()
    stray, skipper = boat.station(), boat.station()
    vehicle = dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3)
    for data in (
        b"GET / HTTP/1.1\r\n\r\n",
        b"\xfd\x09\x00\x00",
        MavlinkCodec(9, 1).encode(vehicle),
        MavlinkCodec(0, 190).encode(STATION_BEAT),
        MavlinkCodec(1, 1).encode(STATION_BEAT),
        MavlinkCodec(255, 190).encode(STATION_BEAT)[:-1] + b"\x00",
    ):
        stray.send(data)
    boat.run(1.0)
    assert boat.transport.peer is None
    stray.send(MavlinkCodec(77, 190).encode(STATION_BEAT))
    boat.run(STATION_SILENT_S + 1.5, skipper)
    boat.run(0.5, skipper, message=DISARM)
    assert boat.hand.released == 1
    boat.close()


def test_a_companion_that_fills_in_an_autopilot_in_its_beats_is_heard() -> None:
    boat = Wired()
    companion, codec = boat.station(), MavlinkCodec(255, dialect.MAV_COMP_ID_ONBOARD_COMPUTER)
    beat = dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_ONBOARD_CONTROLLER, 0, 0, 0, 4, 3)
    for _ in range(3 * round(STATION_SILENT_S)):
        companion.send(codec.encode(beat))
        boat.run(1.0)
    assert boat.transport.peer is not None
    companion.send(codec.encode(DISARM))
    boat.run(0.5)
    assert boat.hand.released == 1
    boat.close()


def test_of_two_stations_one_is_heard_until_it_is_silent_and_then_the_other() -> None:
    boat = Wired()
    one, other = boat.station(), boat.station()
    boat.run(1.0, one)
    boat.run(30.0, one, other)
    heard(one), heard(other)
    boat.run(2.0, one, other)
    assert "HEARTBEAT" in heard(one) and not heard(other)
    boat.run(7.0, other)
    heard(one), heard(other)
    boat.run(20.0, one, other)
    assert "HEARTBEAT" in heard(other) and not heard(one)
    boat.close()


def test_a_forwarding_link_lets_go_of_a_silent_station_too() -> None:
    transport, router, seen = UdpInTransport("behind", "127.0.0.1", 0), Router(), []  # type: ignore[var-annotated]
    router.join(lambda frame: bool(seen.append(frame)) or True, has_vehicle=True)
    link = ForwardLink(transport, router, budget_for(0), access=AccessPolicy(AccessRules()).link())
    first, again = (UdpOutTransport("station", "127.0.0.1", transport.port) for _ in range(2))
    samples = []
    for turn in range(200):
        if turn % 10 == 0:
            (first if turn < 50 else again).send(MavlinkCodec(255, 190).encode(STATION_BEAT))
        samples += link.receive(0.05 * turn)
    assert transport.peer == again._socket.getsockname() and len(seen) > 5
    assert [(sample.name, sample.present) for sample in samples] == [
        ("station_silent", True),
        ("station_silent", False),
    ]
    for end in (link, first, again):
        end.close()


ITEM = dialect.MAVLink_mission_item_int_message(1, 1, 0, 3, 16, 0, 1, 0, 0, 0, 0, 590000000, 180000000, 0)
ORDERED = [
    ARM,
    dialect.MAVLink_command_int_message(1, 1, 0, dialect.MAV_CMD_DO_REPOSITION, 0, 0, -1, 1, 0, 0, 1, 1, 0),
    *[
        dialect.MAVLink_command_long_message(1, 1, command, 0, 1, 1, 1, 0, 0, 0, 0)
        for command in (dialect.MAV_CMD_CONDITION_YAW, dialect.MAV_CMD_DO_SET_MODE, 31000, 31009, 31010, 12345)
    ],
    dialect.MAVLink_set_mode_message(1, 1, 15),
    TUNE,
    dialect.MAVLink_mission_count_message(1, 1, 2, 0),
    ITEM,
    dialect.MAVLink_mission_clear_all_message(1, 1, 0),
    dialect.MAVLink_mission_set_current_message(1, 1, 1),
    dialect.MAVLink_mission_write_partial_list_message(1, 1, 0, 1, 0),
    frames.CommandCancel(1, 1, dialect.MAV_CMD_USER_1),
]


class Listener:
    """A pilot with a system id that listens for stations of its own or, `forwards`, of its flight controller."""

    def __init__(self, system: int, forwards: bool) -> None:
        self.transport = UdpInTransport(f"pilot {system}", "127.0.0.1", 0)
        self._codec, self._router, self._forwards = MavlinkCodec(system, 1), Router(), forwards
        self._router.join(lambda _: True, has_vehicle=True)
        commands = Commands(Skipper(), armed=False, mission=Mission(TrackGuide()))  # type: ignore[arg-type]
        self.link: BoatLink | ForwardLink = (
            ForwardLink(self.transport, self._router, budget_for(0))
            if forwards
            else BoatLink(self.transport, commands, ParameterServer(Store()), system=system)
        )

    def turn(self, now: float) -> None:
        self.link.receive(now)
        self.link.poll(now)
        self.link.publish_tick(ordered(now, HEADING))
        if self._forwards:
            beat = dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_SURFACE_BOAT, 3, 0, 0, 4, 3)
            for message in (dialect.MAVLink_attitude_message(int(1e3 * now), 0, 0, 1, 0, 0, 0), beat):
                self._router.take(0, self._codec.encode(message))


@pytest.mark.parametrize("forwards", [False, True])
def test_two_pilots_whom_one_forged_datagram_makes_peers_let_go_of_each_other(forwards: bool) -> None:
    first, second = pilots = Listener(1, forwards), Listener(2, forwards)
    station, codec = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), MavlinkCodec(255, 190)
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    with contextlib.closing(first.link), contextlib.closing(second.link), station:
        # as if the second had sent it
        second.transport._socket.sendto(codec.encode(beat), ("127.0.0.1", first.transport.port))
        station.bind(("127.0.0.1", 0))
        station.setblocking(False)
        for step in range(400):
            if step >= 200 and step % 20 == 0:
                station.sendto(codec.encode(beat), ("127.0.0.1", first.transport.port))
            for pilot in pilots:
                pilot.turn(0.05 * step)
            assert step != 20 or first.transport.peer == ("127.0.0.1", second.transport.port)
        assert first.transport.peer == station.getsockname(), "the skipper's station comes in"
        assert station.recv(1000)


class Lan:
    """A transport to another machine, over a loopback."""

    def __init__(self, is_local: bool) -> None:
        self.near, self.far = loopback_pair()
        self.is_local = is_local

    def __getattr__(self, name: str) -> Any:
        return getattr(self.near, name)


HEADING, STANDBY = OrderKind.HEADING, OrderKind.STANDBY


def ordered(now: float, kind: OrderKind, event: AlarmEvent | None = None, state: AlarmState | None = None) -> Tick:
    """Return a tick at which an order is in force, and an alarm shown in a state."""
    state_of_boat = NavState(0.0, 0.7, 0.0, 2.0, 0.0, 0.0, 0.0, True)
    engaged = kind is HEADING
    return Tick(
        *(1, now, (), Order(kind, 0.7), state_of_boat, Reference(0.7), 0.0, RudderCommand(now, 0.0, engaged)),
        Mode.ENGAGED if engaged else Mode.STANDBY,
        () if event is None else (event,),
        alarm_states=() if state is None else (state,),
    )


def acknowledged(far: Any) -> list[Any]:
    messages = [each for data in far.receive() for each in MavlinkCodec().decode(data)]
    return [each for each in messages if each.get_type() == "COMMAND_ACK"]


def lan_boat(
    rules: AccessRules = EVERYBODY, is_local: bool = False, signing: Any = None
) -> tuple[BoatLink, Any, Commands, Store]:
    lan, store = Lan(is_local), Store()
    commands = Commands(Skipper(), armed=False, mission=Mission(TrackGuide()))  # type: ignore[arg-type]
    access = AccessPolicy(rules).link()
    return BoatLink(lan, commands, ParameterServer(store), signing=signing, access=access), lan.far, commands, store


def test_without_a_key_another_machine_gives_no_order_and_hears_why_once() -> None:
    boat, far, commands, store = lan_boat()
    station = MavlinkCodec(255, 190)
    results, texts, now = [], [], 0.0
    for message in ORDERED:
        far.send(station.encode(message))
        for _ in range(10):
            now += 0.1
            boat.receive(now)
            boat.poll(now)
        answers = [each for data in far.receive() for each in MavlinkCodec().decode(data)]
        texts += [each.text for each in answers if each.get_type() == "STATUSTEXT"]
        answer, *more = (each for each in answers if each.get_type() not in ("STATUSTEXT", "HEARTBEAT", "SYS_STATUS"))
        assert [each.get_type() for each in more] == ["PARAM_ERROR"] * (message.get_type() == "PARAM_SET")
        results.append(
            (message.get_type(), answer.get_type(), getattr(answer, "result", getattr(answer, "type", None)))
        )
    denied, refused = dialect.MAV_RESULT_DENIED, dialect.MAV_MISSION_DENIED
    for asked, kind, result in results:
        if asked == "PARAM_SET":
            assert kind == "PARAM_VALUE"
        elif asked == "MISSION_SET_CURRENT":
            assert kind == "MISSION_CURRENT"
        else:
            assert (kind, result) == (("MISSION_ACK", refused) if "MISSION" in asked else ("COMMAND_ACK", denied)), (
                asked
            )
    assert not commands.armed and not store.written and not commands.mission.items
    assert commands._helmsman.released == 0 and "".join(texts).count("signing key") == 1


@pytest.mark.parametrize(
    "message",
    [
        DISARM,
        dialect.MAVLink_set_mode_message(1, 1, 0),
        dialect.MAVLink_command_long_message(1, 1, 176, 0, 1, *[0] * 6),
        dialect.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, 0.0, 0, 0, 0, 0, 0, 0),
    ],
)
def test_without_a_key_another_machine_may_let_the_pilot_stand_by_and_everybody_hears_who(message: Any) -> None:
    boat, far, commands, _ = lan_boat()
    boat._transport.peer = ("192.0.2.9", 50312)
    boat.publish_tick(ordered(0.0, HEADING))
    far.send(MavlinkCodec(255, 190).encode(message))
    (said,) = boat.receive(0.1)
    assert commands._helmsman.released == 1
    assert words(said.event) == (
        "a ground station without a key has put the pilot in standby (system 255 at 192.0.2.9:50312): steer by hand"
    )
    boat.publish_tick(ordered(0.2, STANDBY, said.event, AlarmState.SOUNDING))
    assert boat.receive(31.0) == [], "nobody has acknowledged it"
    boat.publish_tick(ordered(31.1, STANDBY, said.event._replace(is_escalated=True), AlarmState.ACKNOWLEDGED))
    assert [sample.event for sample in boat.receive(31.2)] == [None]


@pytest.mark.parametrize(
    ("message", "armed", "result"), [(DISARM, True, "DENIED"), (DISARM, False, "ACCEPTED"), (MANUAL, True, "ACCEPTED")]
)
def test_where_nothing_is_steered_there_is_nothing_that_another_machine_may_end(
    message: Any, armed: bool, result: str
) -> None:
    boat, far, commands, _ = lan_boat()
    commands.armed = armed
    boat.publish_tick(ordered(0.0, STANDBY))
    far.send(MavlinkCodec(255, 190).encode(message))
    assert boat.receive(0.1) == []
    assert commands._helmsman.released == 0 and commands.armed is armed, "the skipper may be about to engage"
    assert [each.result for each in acknowledged(far)] == [getattr(dialect, f"MAV_RESULT_{result}")]


def test_a_release_in_two_orders_disarms_too_and_sounds_until_it_is_acknowledged(tmp_path: Path) -> None:
    sea, lan, station = Watched(tmp_path), Lan(is_local=False), MavlinkCodec(255, 190)
    sea.links.append(BoatLink(lan, sea.commands, ParameterServer(Store()), access=AccessPolicy(EVERYBODY).link()))
    assert sea.order(do="engage") == (True, "")
    for message in (MANUAL, DISARM):
        acknowledged(lan.far)
        lan.far.send(station.encode(message))
        sea.watch(0.5)
        assert [each.result for each in acknowledged(lan.far)] == [dialect.MAV_RESULT_ACCEPTED]
    assert not sea.commands.armed
    sea.watch(40.0)
    (alarm,) = sea.station.alarms.active
    assert alarm["name"] == "station_stopped" and alarm["sounds"] and "system 255" in alarm["words"]
    assert sea.order(do="acknowledge") == (True, "")
    sea.watch(6.0)
    assert sea.station.alarms.active == []


def test_a_mode_that_is_none_of_ours_stops_nobody() -> None:
    boat, far, commands, _ = lan_boat()
    boat.publish_tick(ordered(0.0, HEADING))
    for message in (
        dialect.MAVLink_command_long_message(1, 1, 176, 0, 0.0, *[0] * 6),
        dialect.MAVLink_command_long_message(1, 1, 176, 0, float("nan"), *[0] * 6),
        dialect.MAVLink_set_mode_message(1, 128, 0),
    ):
        far.send(MavlinkCodec(255, 190).encode(message))
        assert boat.receive(0.1) == []
    assert commands._helmsman.released == 0


def test_who_has_engaged_anew_is_not_stopped_again_so_soon() -> None:
    boat, far, commands, _ = lan_boat()
    hand, station = commands._helmsman, MavlinkCodec(255, 190)

    def asks(now: float, kind: OrderKind) -> list[str]:
        boat.publish_tick(ordered(now, kind))
        for message in (dialect.MAVLink_set_mode_message(1, 1, 0), DISARM):
            far.send(station.encode(message))
        samples = boat.receive(now)
        return [sample.event.name for sample in samples if isinstance(sample, AlarmSample) and sample.event]

    assert asks(0.0, HEADING) == ["station_stopped"] and hand.released == 2, "both came at once"
    assert asks(5.0, STANDBY) == [] and hand.released == 2
    acknowledged(far)
    assert asks(10.0, HEADING) == ["stop_refused"] and hand.released == 2
    assert {each.result for each in acknowledged(far)} == {dialect.MAV_RESULT_DENIED}
    for now in range(11, 20):
        boat.poll(float(now))
    texts = [each.text for data in far.receive() for each in MavlinkCodec().decode(data) if "text" in each.to_dict()]
    assert "the skipper has engaged again" in "".join(texts)
    assert asks(69.9, HEADING) == [] and hand.released == 2, "it is on already"
    asks(70.0, HEADING)
    assert hand.released == 4


def test_each_time_the_skipper_keeps_the_helm_twice_as_long() -> None:
    stops, now = Stops(), 0.0
    stops.ticked(now, True)
    for keeps in (60.0, 120.0, 240.0, 480.0, 960.0, 1920.0, 3600.0, 3600.0):
        assert stops.obeys(now) and stops.obeys(now), "no tick has come between them"
        stops.ticked(now, False)
        assert not stops.obeys(now + 0.1) and not stops.keeps(now + 0.1)
        assert stops.has_just_obeyed(now + 1.9) and not stops.has_just_obeyed(now + 2.1)
        stops.ticked(now := now + 100.0, True)
        assert not stops.obeys(now + keeps - 0.1) and stops.keeps(now + keeps - 0.1)
        now += keeps


def test_after_two_hours_without_one_a_stop_is_the_first_again() -> None:
    stops = Stops()
    for now, keeps in ((0.0, 60.0), (200.0, 120.0), (7399.9, 240.0), (14599.9, 60.0)):
        stops.ticked(now, True)
        assert stops.obeys(now)
        stops.ticked(now + 3.0, False)
        stops.ticked(now + 4.0, True)
        assert stops.keeps(now + 3.9 + keeps) and not stops.keeps(now + 4.0 + keeps)


def test_strangers_who_order_a_stop_in_every_turn_do_not_keep_the_skipper_from_steering(tmp_path: Path) -> None:
    sea = Watched(tmp_path)
    policy = AccessPolicy(EVERYBODY)
    strangers = [Lan(is_local=False) for _ in range(2)]
    served = [BoatLink(lan, sea.commands, ParameterServer(Store()), access=policy.link()) for lan in strangers]
    sea.links += served
    engaged, named = 0, set()
    for turn in range(round(100.0 / STEP)):
        for lan in strangers:
            station = MavlinkCodec(turn % 250 + 2, 190)
            lan.far.send(station.encode(dialect.MAVLink_set_mode_message(1, 1, 0)))
            lan.far.send(station.encode(DISARM))
            lan.far.receive()
        sea.watch(STEP)
        tick = sea.tick
        assert tick is not None
        engaged += tick.mode is Mode.ENGAGED
        named |= {event.name for event, state in zip(tick.alarms, tick.alarm_states, strict=True) if event.detail}
        if turn % 20 == 10 and tick.mode is not Mode.ENGAGED:
            asked_of(sea.station, {"do": "engage"})(sea.now, lambda taken, words: None)
    assert engaged * STEP > 90.0, f"{engaged * STEP:.0f} s of 100 s"
    assert {"station_stopped", "stop_refused"} <= named


def test_with_a_key_an_unsigned_disarm_is_refused() -> None:
    boat, far, commands, _ = lan_boat(signing=signing_of_two()[0])
    far.send(MavlinkCodec(255, 190).encode(DISARM))
    boat.receive(0.1)
    assert commands._helmsman.released == 0


def test_without_a_key_another_machine_sees_everything() -> None:
    boat, far, _, _ = lan_boat()
    station, kinds = MavlinkCodec(255, 190), set()
    interval = int(dialect.MAV_CMD_SET_MESSAGE_INTERVAL)
    for message in (
        dialect.MAVLink_param_request_list_message(1, 1),
        dialect.MAVLink_mission_request_list_message(1, 1, 0),
        dialect.MAVLink_timesync_message(0, 5),
        dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_REQUEST_MESSAGE, 0, 148, 0, 0, 0, 0, 0, 0),
        dialect.MAVLink_command_long_message(1, 1, interval, 0, 30, 100000, 0, 0, 0, 0, 0),
    ):
        far.send(station.encode(message))
        boat.receive(0.1)
        boat.poll(0.1)
    for data in far.receive():
        for each in MavlinkCodec().decode(data):
            kinds.add(each.get_type())
            assert each.get_type() != "COMMAND_ACK" or each.result == dialect.MAV_RESULT_ACCEPTED
    assert {"HEARTBEAT", "PARAM_VALUE", "MISSION_COUNT", "TIMESYNC", "AUTOPILOT_VERSION", "COMMAND_ACK"} <= kinds


@pytest.mark.parametrize("how", ["same machine", "said so", "key"])
def test_orders_need_this_machine_a_key_or_the_skipper_s_word(how: str) -> None:
    ours = signing_of_two() if how == "key" else (None, None)
    rules = AccessRules(orders_without_key=how == "said so")
    boat, far, commands, _ = lan_boat(rules, is_local=how == "same machine", signing=ours[0])
    far.send(MavlinkCodec(255, 190, signing=ours[1]).encode(ARM))
    boat.receive(0.1)
    assert commands.armed


def signing_of_two() -> tuple[Any, Any]:
    key = bytes(range(32))
    return tuple(Signing(key, CountingTimestamps(10**12)).link() for _ in range(2))  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("url", "is_loopback_alone"),
    [
        ("udpin:127.0.0.1:0", True),
        ("udpin:127.5.6.7:0", True),
        ("udpin:localhost:0", True),
        ("udpin:lo:0", True),
        ("udpin:[::1]:0", True),
        ("udpin:[::ffff:127.0.0.1]:0", True),
        ("tcpin:127.0.0.1:0", True),
        ("udpout:127.0.0.1:14550", True),
        ("udpin:0.0.0.0:0", False),
        ("udpin:[::]:0", False),
        ("tcpin:0.0.0.0:0", False),
        ("tcpin:[::]:0", False),
        ("udpout:192.0.2.7:14550", False),
    ],
)
def test_which_links_only_this_machine_can_reach(url: str, is_loopback_alone: bool) -> None:
    try:
        transport = open_transport(url)
    except LinkError as error:
        pytest.skip(f"not on this machine: {error}")
    assert transport.is_local is is_loopback_alone
    transport.close()


def test_the_terminal_says_that_a_served_link_takes_no_order(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    master, slave = pty.openpty()
    serial = f"serial:{os.ttyname(slave)}:57600"
    urls = ("udpin:0.0.0.0:0", "udpin:127.0.0.1:0", serial)
    links = stations_at(urls, load_vessel("lanxin"), tmp_path)
    printed = capsys.readouterr().err
    assert (
        printed.count("give no orders: no signing key is set") == 2 and f"--serve {serial}: whoever is there" in printed
    )
    assert [link.takes_orders for link in links if isinstance(link, BoatLink)] == [False, True, False]
    for link in links:
        link.close()
    os.close(master), os.close(slave)


def test_a_radio_on_a_serial_line_gives_no_order_until_the_skipper_says_so() -> None:
    for rules, signing, takes in (
        (AccessRules(), None, False),
        (AccessRules(orders_without_key=True), None, True),
        (AccessRules(), signing_of_two()[0], True),
    ):
        master, slave = pty.openpty()
        tty.setraw(master)
        path = os.ttyname(slave)
        transport = SerialTransport(f"serial:{path}:57600", path, 57600)
        commands = Commands(Skipper(), armed=False, mission=Mission(TrackGuide()))  # type: ignore[arg-type]
        access = AccessPolicy(rules).link()
        boat = BoatLink(transport, commands, ParameterServer(Store()), signing=signing, access=access)
        router = Router()
        assert boat.takes_orders is ForwardLink(transport, router, budget_for(0), signing, access).takes_orders is takes
        if signing is None:
            os.write(master, MavlinkCodec(255, 190).encode(ARM))
            boat.receive(0.1)
            assert commands.armed is takes
        boat.close()
        os.close(master), os.close(slave)


@pytest.mark.parametrize(
    ("message", "gives"),
    [
        (dialect.MAVLink_command_long_message(1, 191, 400, 0, 0.0, 0, 0, 0, 0, 0, 0), True),
        (dialect.MAVLink_command_long_message(1, 191, 400, 0, 1.0, 0, 0, 0, 0, 0, 0), False),
        (dialect.MAVLink_command_long_message(1, 191, 176, 0, 1.0, 0, 0, 0, 0, 0, 0), True),
        (dialect.MAVLink_command_long_message(1, 191, 176, 0, 1.0, 10.0, 0, 0, 0, 0, 0), False),
        (dialect.MAVLink_command_long_message(1, 191, 177, 0, 0.0, 0.0, 0, 0, 0, 0, 0), False),
        (dialect.MAVLink_command_int_message(1, 191, 0, 400, 0, 0, 0.0, 0, 0, 0, 0, 0, 0), True),
        (dialect.MAVLink_set_mode_message(1, 1, 0), True),
        (dialect.MAVLink_set_mode_message(1, 1, 10), False),
        (dialect.MAVLink_param_set_message(1, 191, b"X", 0.0, 9), False),
    ],
)
def test_messages_that_release_the_rudder_are_never_rate_limited(message: Any, gives: bool) -> None:
    assert gives_rudder_back(message) is gives
    access = AccessPolicy(AccessRules(commands_hz=1.0, writes_hz=1.0)).link()
    refused = [bool(access.refusal(0.0, message)) for _ in range(6)]
    assert refused == ([False] * 6 if gives else [False] * 4 + [True] * 2), "four seconds' worth at once"
    assert bool(access.refusal(1.0, message)) is False


def test_a_rate_budget_gives_what_was_worked_out_by_hand() -> None:
    budget = Budget(10.0, 40.0)
    assert [budget.part(0.0, 30), budget.part(0.0, 30), budget.part(0.0, 30)] == [30, 10, 0]
    assert not budget.spend(0.5, 5.1) and budget.spend(0.5, 5.0) and not budget.spend(0.5, 0.1)
    assert budget.part(100.0, 1000) == 40
    assert not budget.spend(99.0, 1.0), "a clock that goes back gives nothing"
    assert budget.spend(99.5, 5.0)


@pytest.mark.parametrize(("datagrams", "crowded"), [(0, False), (20, False), (21, True)])
def test_more_than_twenty_strangers_at_a_time_crowd_a_link(datagrams: int, crowded: bool) -> None:
    policy = AccessPolicy()
    access = policy.link()
    access.count_refused_senders(datagrams)
    assert (access.crowded, policy.refused.total()) == (crowded, datagrams)
    expected = f"{datagrams} MAVLink messages were not let in: {datagrams} datagrams from others than the station"
    assert policy.summary.startswith(expected) if datagrams else policy.summary == ""


def test_eight_kilobytes_at_once_and_fifty_a_second_are_looked_at() -> None:
    policy = AccessPolicy()
    access = policy.link()
    assert [len(chunk) for chunk in access.taken(0.0, [bytes(5000), bytes(5000), bytes(5000)])] == [5000, 3000]
    assert access.crowded and policy.refused.total() == 2
    assert [len(chunk) for chunk in access.taken(0.1, [bytes(9000)])] == [5000]
    assert [len(chunk) for chunk in access.taken(9.0, [bytes(8000)])] == [8000]
    assert policy.refused.total() == 3


def test_a_station_is_silent_after_more_than_five_seconds() -> None:
    transport, _ = loopback_pair()
    now, forgotten = -1.0, list[float]()
    transport.forget_peer = lambda: forgotten.append(now)  # type: ignore[method-assign]
    presence, said = Presence(transport), []
    presence.on_packet(-1.0, is_heartbeat=True)
    presence.update(-1.0)
    forgotten.clear()
    presence.on_packet(0.0, is_heartbeat=False)
    for now in (5.0, 5.001):
        said += presence.update(now)
    assert forgotten == [5.001] and [sample.time for sample in said] == [5.001]
