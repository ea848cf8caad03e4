"""With a key set, every message of the dialect, unsigned, is refused on every link and changes nothing."""

from __future__ import annotations

from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.guidance.track import TrackGuide
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.mavlink.router import ForwardLink, RoutedTransport, Router, budget_for
from autopilot.links.mavlink.signing import UNSIGNED, UNSIGNED_IDS, WRONG_KEY, CountingTimestamps, Signing
from autopilot.links.mavlink.vehicle import CompanionSettings
from autopilot.links.transports import loopback_pair
from autopilot.signals import HelmSample

KEY, OTHER_KEY = bytes(range(32)), bytes(range(1, 33))
NOW = 10**12
BEAT = dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3)


def every_message() -> list[Any]:
    """Return one of each kind, for our system and component where it names a target."""
    messages = []
    for kind in dialect.mavlink_map.values():
        lengths = dict(zip(kind.ordered_fieldnames, kind.array_lengths, strict=True))
        types = zip(kind.fieldnames, kind.fieldtypes, strict=True)
        fields = [b"x" if field == "char" else [1] * lengths[name] if lengths[name] else 1 for name, field in types]
        messages.append(kind(*fields))
    return messages


def commands() -> list[Any]:
    """Return every command that is known, as COMMAND_LONG and COMMAND_INT, arming and steering ones among them."""
    numbers = sorted(dialect.enums["MAV_CMD"])
    return [dialect.MAVLink_command_long_message(1, 1, number, 0, 1, 1, 1, 0, 0, 0, 0) for number in numbers] + [
        dialect.MAVLink_command_int_message(1, 1, 0, number, 0, 0, 1, 1, 1, 0, 0, 0, 0) for number in numbers
    ]


class Untouched:
    """A helmsman and a parameter store at once; whatever is done to them fails the test."""

    names = ("GAIN",)
    revision = 0

    def get(self, name: str) -> float:
        return 1.0

    def __getattr__(self, name: str) -> Any:
        raise AssertionError(f"{name} was called")


def unsigned(message: Any) -> list[bytes]:
    """Return a message as it comes from strangers: unsigned in both versions of MAVLink, and with another key."""
    plain = MavlinkCodec(255, 190).encode(message)
    forged = MavlinkCodec(255, 190, signing=Signing(OTHER_KEY, CountingTimestamps(NOW)).link()).encode(message)
    frames = [plain, forged]
    if type(message).id < 256:
        old = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
        frames.append(bytes(message.pack(old, force_mavlink1=True)))
    return frames


FORGED = [
    frame
    for message in every_message() + commands()
    if type(message).id not in UNSIGNED_IDS
    for frame in unsigned(message)
]


def test_a_served_boat_with_a_key_ignores_unsigned_orders() -> None:
    near, far = loopback_pair()
    signing, hand = Signing(KEY, CountingTimestamps(NOW)), Untouched()
    doing = Commands(hand, armed=False, mission=Mission(TrackGuide()))  # type: ignore[arg-type]
    boat = BoatLink(near, doing, ParameterServer(hand), signing=signing.link())  # type: ignore[arg-type]
    now = 0.0
    for frame in FORGED:
        now += 1.0  # within what a link may bring
        far.send(frame)
        boat.receive(now)
    answers = far.receive()
    assert answers == [] and not doing.armed and not doing.mission.items
    assert signing.refused.total() == len(FORGED) and set(signing.refused) == {UNSIGNED, WRONG_KEY}


@pytest.mark.parametrize("is_latched", [False, True])
def test_a_companion_with_a_key_ignores_unsigned_messages(is_latched: bool) -> None:
    """Not even heartbeats, which take the helm away, or servo positions, which the rudder watch believes."""
    near, far = loopback_pair()
    signing = Signing(KEY, CountingTimestamps(NOW))
    link = CompanionLink(near, CompanionSettings(rudder_at_full=0.6), signing.link())
    vehicle = MavlinkCodec(1, 1, signing=Signing(KEY, CountingTimestamps(NOW)).link())
    if is_latched:
        far.send(vehicle.encode(BEAT))
        link.receive(0.0)
    for frame in FORGED:
        far.send(frame)
    for message in every_message():
        if type(message).id not in UNSIGNED_IDS:
            far.send(MavlinkCodec(1, 1).encode(message))
    samples = [sample for sample in link.receive(0.1) if not isinstance(sample, HelmSample)]
    assert samples == []
    assert link.session.vehicle == (1 if is_latched else 0)


def test_none_is_passed_on_in_either_direction() -> None:
    to_vehicle, vehicle = loopback_pair()
    to_station, station = loopback_pair()
    router, signing = Router(), Signing(KEY, CountingTimestamps(NOW))
    tapped = RoutedTransport(to_vehicle, router, signing.link())
    forward = ForwardLink(to_station, router, budget_for(0), signing.link())
    for number, frame in enumerate(FORGED):
        station.send(frame)
        vehicle.send(frame)
        forward.receive(float(number))
        tapped.receive()
    assert vehicle.receive() == [] and station.receive() == []


def test_a_vehicle_whose_key_is_changed_while_we_listen_is_said_to_have_another() -> None:
    near, far = loopback_pair()
    link = CompanionLink(near, CompanionSettings(rudder_at_full=0.6), Signing(KEY, CountingTimestamps(NOW)).link())
    before, after = (
        MavlinkCodec(1, 1, signing=Signing(key, CountingTimestamps(NOW)).link()) for key in (KEY, OTHER_KEY)
    )
    reasons: list[str] = []
    for second in range(40):
        far.send((before if second < 20 else after).encode(BEAT))
        reasons += [each.reason for each in link.receive(float(second)) if isinstance(each, HelmSample)]
    assert "no heartbeat from the vehicle" in reasons[-1] and "use the same key on both sides" in reasons[-1]
    assert not any("key" in reason for reason in reasons[: len(reasons) // 3])


@pytest.mark.parametrize("signs", [True, False])
def test_a_vehicle_that_begins_to_sign_and_obeys_no_more_is_said_to_sign(signs: bool) -> None:
    """A ground station gives the vehicle a key while we listen without one: it answers no question of ours then."""
    near, far = loopback_pair()
    link = CompanionLink(near, CompanionSettings(rudder_at_full=0.6))
    plain, signed = (MavlinkCodec(1, 1, signing=each) for each in (None, Signing(KEY, CountingTimestamps(NOW)).link()))
    reasons: list[str] = []
    for step in range(600):
        if step % 10 == 0:
            far.send((signed if signs and step >= 50 else plain).encode(BEAT))
        reasons += [each.reason for each in link.receive(0.1 * step) if isinstance(each, HelmSample)]
        link.poll(0.1 * step)
    assert "does not answer" in reasons[-1]
    assert reasons[-1].endswith("(it signs its messages: without --signing-key it may take none of ours)") is signs
