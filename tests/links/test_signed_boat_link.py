"""The served boat with a signing key: what is not signed changes nothing, and says why once a minute."""

from __future__ import annotations

import socket
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect
from station_doubles import Skipper, Store

from autopilot.guidance.track import TrackGuide
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.mavlink.signing import CountingTimestamps, LinkSigning, Signing
from autopilot.links.mavlink.vehicle import CompanionSettings
from autopilot.links.transports import UdpInTransport, loopback_pair
from autopilot.signals import Mode, NavState, Order, Reference, RudderCommand, Tick

KEY = bytes(range(32))
ARM = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
TUNE = dialect.MAVLink_param_set_message(1, 1, b"GAIN", 3.0, 9)
MODE = dialect.MAVLink_set_mode_message(1, 1, 15)
AT_SEA = Tick(
    1, 0.0, (), Order(), NavState(0.0, 1.0, 0.0, 4.0, 0.0, 0.0, 0.1, True), Reference(0.7), 0.0,
    RudderCommand(0.0, 0.0, False), Mode.STANDBY, (),
)  # fmt: skip
BEAT = dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3)


def signing(key: bytes = KEY) -> LinkSigning:
    return Signing(key, CountingTimestamps(10**12)).link()


def test_only_a_signed_station_arms_sets_and_changes_the_mode() -> None:
    near, far = loopback_pair()
    store, skipper = Store(), Skipper()
    commands = Commands(skipper, armed=False, mission=Mission(TrackGuide()))
    boat = BoatLink(near, commands, ParameterServer(store), signing=signing())
    stations = {
        "unsigned": MavlinkCodec(255, 190),
        "wrong": MavlinkCodec(255, 190, signing=signing(bytes(32)[:-1] + b"\7")),
        "right": MavlinkCodec(255, 190, signing=signing()),
    }
    reader, heard, now, recorded = MavlinkCodec(254, 1), [], 0.0, []

    def turn() -> None:
        nonlocal now
        now += 1.0
        boat.receive(now)
        boat.publish_tick(AT_SEA)
        boat.poll(now)
        heard.extend(message for data in far.receive() for message in reader.decode(data))

    for name in ("unsigned", "wrong"):
        for message in (ARM, TUNE, MODE) * 20:
            far.send(stations[name].encode(message))
        turn()
    assert (commands.armed, store.values["GAIN"], len(skipper.orders)) == (False, 1.0, 0)
    said = [message.text for message in heard if message.get_type() == "STATUSTEXT"]
    assert said == ["refused: messages that are not signed with our key"]
    assert not {"COMMAND_ACK", "PARAM_VALUE"} & {message.get_type() for message in heard}
    for message in (ARM, TUNE, MODE):
        recorded.append(stations["right"].encode(message))
        far.send(recorded[-1])
        turn()
    assert (commands.armed, store.values["GAIN"], len(skipper.orders)) == (True, 3.0, 1)
    commands.armed, store.values["GAIN"] = False, 1.0
    for packet in recorded:
        far.send(packet)
    turn()
    assert (commands.armed, store.values["GAIN"], len(skipper.orders)) == (False, 1.0, 1), "a recording of it does not"


def test_a_station_with_the_right_key_and_a_wrong_clock_gets_word_of_it() -> None:
    near, far = loopback_pair()
    commands = Commands(Skipper(), armed=False, mission=Mission(TrackGuide()))
    boat = BoatLink(near, commands, ParameterServer(Store()), signing=signing())
    late = MavlinkCodec(255, 190, signing=Signing(KEY, CountingTimestamps(10**12 - 10**8)).link())
    reader, said = MavlinkCodec(254, 1), []
    for now in (1.0, 2.0, 3.0):
        far.send(late.encode(ARM))
        boat.receive(now)
        boat.poll(now)
        said += [message.text for data in far.receive() for message in reader.decode(data) if "text" in vars(message)]
    assert not commands.armed
    assert "".join(said) == "refused: messages signed by a clock that is more than a minute behind, or sent long ago"


def served(transport: UdpInTransport, ours: LinkSigning) -> Any:
    return BoatLink(
        transport, Commands(Skipper(), False, Mission(TrackGuide())), ParameterServer(Store()), signing=ours
    )


def test_a_station_with_the_right_clock_comes_in_where_we_listen_after_one_whose_clock_was_ahead() -> None:
    """As pymavlink, MAVLink's C library and with it QGroundControl do: a station goes on from the time it hears."""
    transport = UdpInTransport("udpin:127.0.0.1:0", "127.0.0.1", 0)
    boat = served(transport, signing())
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ahead,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as right,
    ):
        lines, now = {ahead: 10**12 + 36 * 10**7, right: 10**12}, 0.0  # an hour ahead
        stations = {}
        for line, start in lines.items():
            line.connect(("127.0.0.1", transport.port))
            line.settimeout(10.0)
            stations[line] = dialect.MAVLink(None, 255, 190 + len(stations))
            stations[line].signing.secret_key, stations[line].signing.timestamp = KEY, start
            stations[line].signing.sign_outgoing = True

        def turn(line: socket.socket) -> list[str]:
            nonlocal now
            now += 1.0
            line.send(STATION_BEAT.pack(stations[line]))
            boat.receive(now)
            boat.poll(now)
            line.setblocking(False)
            heard = []
            while True:
                try:
                    heard += stations[line].parse_buffer(line.recv(2048)) or []
                except BlockingIOError:
                    return [message.get_type() for message in heard]

        assert "HEARTBEAT" in turn(ahead)
        boat.receive(now + 6.0)  # silent: another may come
        now += 6.0
        recorded = STATION_BEAT.pack(stations[right])
        turn(right)
        assert transport.peer == ahead.getsockname(), "of another time it becomes nobody's peer"
        turn(right)
        assert transport.peer == right.getsockname() and "HEARTBEAT" in turn(right)
        boat.receive(now + 6.0)
        now += 6.0
        ahead.send(recorded)
        boat.receive(now + 1.0)
        assert transport.peer == right.getsockname(), "a recording moves nobody"
    boat.close()


def companion(transport: UdpInTransport, ours: LinkSigning) -> Any:
    return CompanionLink(transport, CompanionSettings(0.5), ours)


STATION_BEAT = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


@pytest.mark.parametrize(("make", "identity", "beat"), [(served, (255, 190), STATION_BEAT), (companion, (1, 1), BEAT)])
def test_who_does_not_sign_cannot_take_the_place_of_who_does(make: Any, identity: tuple[int, int], beat: Any) -> None:
    transport, ours = UdpInTransport("udpin:127.0.0.1:0", "127.0.0.1", 0), signing()
    link = make(transport, ours)
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as friend,
    ):
        for sender in (stranger, friend):
            sender.connect(("127.0.0.1", transport.port))
        stranger.send(MavlinkCodec(*identity).encode(beat))
        link.receive(0.1)
        assert transport.peer is None and ours.signing.refused.total() == 1
        friend.send(MavlinkCodec(*identity, signing=signing()).encode(beat))
        link.receive(0.2)
        assert transport.peer == friend.getsockname()
    link.close()
