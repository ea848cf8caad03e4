"""The companion's session with a vehicle, driven by lists of byte chunks: no transport, no clock, no socket."""

from __future__ import annotations

import math
from collections.abc import Iterable

import pytest
from alarm_texts import other, shown
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec, Message
from autopilot.links.mavlink.companion import CompanionSession
from autopilot.links.mavlink.vehicle import CompanionSettings
from autopilot.links.rudder_order import Release, ReleaseState
from autopilot.signals import HeadingSample, HelmSample, Mode, RudderCommand, Sample

FULL = math.radians(30.0)
STEER = RudderCommand(0.0, math.radians(15.0), True)
LET_GO = RudderCommand(0.0, 0.0, False)
EVEN = {"MIN": 1000.0, "TRIM": 1500.0, "MAX": 2000.0, "REVERSED": 0.0}
PARAMETERS = {
    "SYSID_MYGCS": 255.0,
    "RCMAP_ROLL": 1.0,
    "SERVO1_FUNCTION": 26.0,
    "RC1_DZ": 0.0,
    "RC_OVERRIDE_TIME": 3.0,
    "MANUAL_STR_EXPO": 0.0,
    "MAV_GCS_SYSID_HI": 255.0,
    "RC1_OPTION": 0.0,
    **{f"{what}_{name}": value for what in ("RC1", "SERVO1") for name, value in EVEN.items()},
}


class Vehicle:
    """Says in bytes what a flight controller does, and reads what the session sends to it."""

    def __init__(self, settings: CompanionSettings | None = None, is_stream: bool = False) -> None:
        self.session = CompanionSession("line", settings or CompanionSettings(FULL, as_gcs=True), is_stream)
        self.codec = MavlinkCodec(1, 1)
        self.input = 1500
        self.now = 0.0

    def said(self, *messages: Message) -> list[bytes]:
        return [self.codec.encode(message) for message in messages]

    def beat(self) -> Message:
        armed = dialect.MAV_MODE_FLAG_SAFETY_ARMED
        return dialect.MAVLink_heartbeat_message(11, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, armed | 1, 0, 4, 3)

    def reports(self) -> list[Message]:
        boot, pulses = round(1000.0 * self.now), [self.input, *[1500] * 15, 0, 0]
        return [
            dialect.MAVLink_rc_channels_message(boot, 16, *pulses, 255),
            dialect.MAVLink_servo_output_raw_message(1000 * boot, 0, self.input, *[1500] * 7),
            dialect.MAVLink_attitude_message(boot, 0.0, 0.0, 0.5, 0.0, 0.0, 0.01),
        ]

    def hears(self, packets: Iterable[bytes]) -> list[Message]:
        """Take what the session sends as ArduRover does: an override shows as the steering input."""
        heard = [message for packet in packets for message in MavlinkCodec().decode(packet)]
        for message in heard:
            if message.get_type() == "RC_CHANNELS_OVERRIDE":
                self.input = message.chan1_raw or 1500
        return heard

    def turn(self, command: RudderCommand = LET_GO) -> tuple[list[Sample], list[Message]]:
        """Let 50 ms pass, with a heartbeat each second."""
        self.now = round(self.now + 0.05, 9)
        said = self.reports() if round(self.now * 20) % 20 else [self.beat(), *self.reports()]
        samples = self.session.receive(self.now, self.said(*said))
        packets = self.session.send(self.now, command) + self.session.poll(self.now)
        return samples, self.hears(packets)


@pytest.mark.parametrize(
    ("system", "component", "autopilot", "words"),
    [
        (0, 1, 3, "heard is system 0, component 1: no vehicle may have the system id 0: set MAV_SYSID"),
        (7, 1, 3, "heard is system 7, component 1: start with --vehicle-system 7"),
        (1, 2, 3, "heard is system 1, component 2: an autopilot is component 1"),
        (255, 190, 8, "heard is system 255, component 190, which is no autopilot"),
    ],
)
def test_who_is_heard_in_place_of_the_vehicle_is_named(system: int, component: int, autopilot: int, words: str) -> None:
    session = CompanionSession("line", CompanionSettings(FULL, vehicle_system=1))
    foreign = dialect.MAVLink_heartbeat_message(11, autopilot, 0, 0, 4, 3)
    (helm,) = session.receive(0.0, [MavlinkCodec(system, component).encode(foreign)])
    assert isinstance(helm, HelmSample) and not helm.available
    assert helm.reason.startswith("waiting for the heartbeat of a vehicle") and words in helm.reason
    # a listening line lets in nobody but the vehicle, and asks here of each datagram
    asked = CompanionSession("line", CompanionSettings(FULL, vehicle_system=1))
    assert not asked.holds_our_vehicle(MavlinkCodec(system, component).encode(foreign))
    (helm,) = asked.receive(0.0, [])
    assert isinstance(helm, HelmSample) and words in helm.reason
    (helm, *_) = asked.receive(1.0, [MavlinkCodec(1, 1).encode(Vehicle().beat())])
    assert isinstance(helm, HelmSample) and "heard is" not in helm.reason and asked.vehicle == 1


def test_of_several_strangers_the_first_autopilot_is_named_and_no_news_comes_of_the_others() -> None:
    session = CompanionSession("line", CompanionSettings(FULL, vehicle_system=1))
    strangers = [(255, 190, 8), (7, 1, 3), (8, 1, 3), (255, 190, 8)]
    said = []
    for turn in range(20):
        system, component, autopilot = strangers[turn % len(strangers)]
        beat = dialect.MAVLink_heartbeat_message(11, autopilot, 0, 0, 4, 3)
        packets = [MavlinkCodec(system, component).encode(beat)]
        said += [sample.reason for sample in session.receive(0.5 * turn, packets) if isinstance(sample, HelmSample)]
    assert ["system 255" in said[0], *("system 7" in reason for reason in said[1:])] == [True] * len(said)


def steering() -> Vehicle:
    """A vehicle that is known, has shown that it takes our steering, and is steered."""
    vehicle = Vehicle()
    vehicle.session.receive(0.0, vehicle.said(vehicle.beat()))
    known = [dialect.MAVLink_param_value_message(name.encode(), value, 9, 60, 0) for name, value in PARAMETERS.items()]
    vehicle.session.receive(0.0, vehicle.said(*known))
    for _ in range(120):
        vehicle.turn()
    for _ in range(10):
        vehicle.turn(STEER)
    return vehicle


def test_bytes_in_samples_out_with_who_has_the_helm_before_the_others() -> None:
    vehicle = Vehicle()
    (lost,) = vehicle.session.receive(0.0, [])
    assert isinstance(lost, HelmSample) and vehicle.session.vehicle == 0
    samples = vehicle.session.receive(1.0, vehicle.said(vehicle.beat(), *vehicle.reports()))
    assert vehicle.session.vehicle == 1 and isinstance(samples[0], HelmSample) and not samples[0].available
    headings = [sample for sample in samples if isinstance(sample, HeadingSample)]
    assert [(sample.time, sample.source) for sample in headings] == [(1.0, "attitude")]
    assert headings[0].heading == pytest.approx(0.5, abs=1e-6)


def test_a_stream_cut_anywhere_gives_the_same_samples_as_whole_frames() -> None:
    def samples_of(size: int) -> list[Sample]:
        vehicle = Vehicle(is_stream=True)
        stream = b"".join(vehicle.said(vehicle.beat(), *vehicle.reports()))
        chunks = [stream[place : place + size] for place in range(0, len(stream), size)]
        return vehicle.session.receive(1.0, chunks)

    whole = samples_of(10_000)
    assert len(whole) > 2 and all(samples_of(size) == whole for size in (1, 2, 7, 41))


def test_commands_in_bytes_out_once_the_vehicle_has_shown_that_it_obeys() -> None:
    vehicle = steering()
    _, heard = vehicle.turn(STEER)
    (override,) = [message for message in heard if message.get_type() == "RC_CHANNELS_OVERRIDE"]
    assert (override.target_system, override.chan1_raw, override.chan2_raw) == (1, 1750, 65535)


def test_the_release_is_bytes_to_send_until_a_report_shows_it() -> None:
    vehicle = steering()
    vehicle.hears(vehicle.session.release(vehicle.now))
    found: list[bytes] | Release = []
    while isinstance(found, list):
        vehicle.hears(found)
        vehicle.now = round(vehicle.now + 0.05, 9)
        vehicle.session.receive(vehicle.now, vehicle.said(*vehicle.reports()))
        found = vehicle.session.release_result(vehicle.now)
    assert (found.state, found.shown_by) == (ReleaseState.CONFIRMED, "RC_CHANNELS") and vehicle.input == 1500


def test_a_line_that_is_gone_is_reported_by_who_carries_the_bytes() -> None:
    vehicle = steering()
    vehicle.session.release(vehicle.now)
    vehicle.session.is_gone = True
    found = vehicle.session.release_result(vehicle.now)
    assert isinstance(found, Release) and found.state is ReleaseState.LOST


def test_alarms_leave_as_texts_and_the_state_in_the_heartbeat() -> None:
    vehicle = steering()
    vehicle.session.on_tick(shown(vehicle.now, Mode.FAILSAFE, (other("the compass is silent"),)))
    heard = [message for _ in range(25) for message in vehicle.turn()[1]]
    assert "the compass is silent" in [message.text for message in heard if message.get_type() == "STATUSTEXT"]
    states = {message.system_status for message in heard if message.get_type() == "HEARTBEAT" and message.type == 18}
    assert states == {dialect.MAV_STATE_CRITICAL}


def test_the_same_chunks_at_the_same_times_give_the_same_samples_and_bytes() -> None:
    def run() -> list[object]:
        vehicle = steering()
        turns = [vehicle.turn(STEER) for _ in range(40)]
        return [(samples, [message.to_dict() for message in heard]) for samples, heard in turns]

    assert run() == run()
