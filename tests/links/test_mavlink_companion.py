"""The companion link against a small stand-in for an ArduRover boat, on a manual clock over a loopback."""

from __future__ import annotations

import math
from itertools import pairwise
from random import Random

import pytest
from alarm_texts import other, shown, words
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec, is_mavlink
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.mavlink.vehicle import CompanionSettings
from autopilot.links.rudder_order import ReleaseState
from autopilot.links.transports import UdpInTransport, UdpOutTransport, loopback_pair
from autopilot.signals import (
    AlarmSample,
    HeadingSample,
    HelmCause,
    HelmSample,
    Mode,
    RollSample,
    RudderCommand,
    RudderSample,
    SpeedSample,
)

FULL = math.radians(30.0)
PARAMETERS = {
    "SYSID_MYGCS": 255.0,
    "RCMAP_ROLL": 1.0,
    "RC_OVERRIDE_TIME": 3.0,
    "MANUAL_STR_EXPO": 0.0,
    "RC1_MIN": 1000.0,
    "RC1_TRIM": 1500.0,
    "RC1_MAX": 2000.0,
    "RC1_DZ": 30.0,
    "RC1_REVERSED": 0.0,
    "SERVO1_FUNCTION": 26.0,
    "SERVO1_MIN": 1000.0,
    "SERVO1_TRIM": 1500.0,
    "SERVO1_MAX": 2000.0,
    "SERVO1_REVERSED": 0.0,
}


class Rover:
    """Answers as far as the link needs; knows nothing of the code under test but the wire."""

    def __init__(self, transport, system: int = 1, **parameters: float) -> None:
        self.transport = transport
        self.codec = MavlinkCodec(system, 1)
        self.parameters = {**PARAMETERS, **parameters}
        self.mode = 0
        self.armed = True
        self.status = dialect.MAV_STATE_ACTIVE
        self.boot = 100.0
        self.stick = 1500
        self.others = dict.fromkeys(range(2, 9), 1500)
        self.pulse = 1500
        self.obeys = self.answers = True
        self.received: list = []
        self.reads: list[str] = []
        self.intervals: dict[int, float] = {}

    def send(self, message) -> None:
        self.transport.send(self.codec.encode(message))

    def heartbeat(self) -> None:
        armed = dialect.MAV_MODE_FLAG_SAFETY_ARMED if self.armed else 0
        self.send(dialect.MAVLink_heartbeat_message(11, 3, armed | 1, self.mode, self.status, 3))

    def attitude(self, yaw: float = 0.5, rate: float = 0.1) -> None:
        self.send(dialect.MAVLink_attitude_message(round(self.boot * 1000), 0.02, 0.0, yaw, 0.01, 0.0, rate))

    def listen(self) -> None:
        for data in self.transport.receive():
            for message in self.codec.decode(data):
                self.received.append(message)
                kind = message.get_type()
                if kind == "PARAM_REQUEST_READ":
                    self.reads.append(message.param_id)
                    if message.param_id in self.parameters and self.answers:
                        value = self.parameters[message.param_id]
                        self.send(dialect.MAVLink_param_value_message(message.param_id.encode(), value, 9, 14, 0))
                elif kind == "COMMAND_LONG" and message.command == dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
                    self.intervals[round(message.param1)] = message.param2
                elif self.obeys and message.get_srcSystem() == self.parameters["SYSID_MYGCS"]:
                    self.steer(message)

    def steer(self, message) -> None:
        if message.get_type() == "RC_CHANNELS_OVERRIDE" and message.chan1_raw != 65535:
            self.pulse = message.chan1_raw or self.stick
        if message.get_type() == "MANUAL_CONTROL":
            self.pulse = self.stick if message.y == 32767 else 1000 + (message.y + 1000) // 2

    def report_rudder(self) -> None:
        others = [*self.others.values(), *[1500] * 10]
        self.send(dialect.MAVLink_rc_channels_message(round(self.boot * 1000), 8, self.pulse, *others, 255))


def steering_of(pulse: int) -> int:
    """ArduRover's dead zone and end points, written out by hand."""
    return 4500 * max(pulse - 1530, 0) // 470 - 4500 * max(1470 - pulse, 0) // 470


class Bench:
    """A link and a rover that step through time together."""

    def __init__(self, settings: CompanionSettings | None = None, **parameters: float) -> None:
        near, far = loopback_pair()
        self.link = CompanionLink(near, settings or CompanionSettings(FULL, as_gcs=True))
        self.rover = Rover(far, **parameters)
        self.now = 1000.0
        self.command = RudderCommand(0.0, 0.0, False)
        self.samples: list = []
        self.talks = True

    def run(self, seconds: float, step: float = 0.05) -> list:
        samples = []
        for _ in range(round(seconds / step)):
            self.now += step
            self.rover.boot += step
            if self.talks:
                if round(self.now / step) % round(1.0 / step) == 0:
                    self.rover.heartbeat()
                self.rover.attitude()
                self.rover.report_rudder()
            samples += self.link.receive(self.now)
            self.link.send(self.now, self.command)
            self.link.poll(self.now)
            self.rover.listen()
        self.samples += samples
        return samples

    @property
    def helm(self) -> HelmSample:
        return [sample for sample in self.samples if isinstance(sample, HelmSample)][-1]

    def overrides(self) -> list:
        return [m for m in self.rover.received if m.get_type() in ("RC_CHANNELS_OVERRIDE", "MANUAL_CONTROL")]


def ready(**kwargs) -> Bench:
    bench = Bench(**kwargs)
    bench.run(4.0)
    assert bench.helm.available, bench.helm.reason
    return bench


def test_gets_the_helm_of_a_boat_that_answers() -> None:
    bench = Bench()
    bench.link.receive(bench.now)
    bench.run(4.0)
    assert bench.helm.available
    assert bench.link.session.vehicle == 1
    assert bench.rover.intervals[dialect.MAVLINK_MSG_ID_ATTITUDE] == pytest.approx(50000)
    assert bench.overrides()[-1].chan1_raw == 0, "what proved that the vehicle listens is released"
    assert all(abs(m.chan1_raw - 1500) < 30 or m.chan1_raw == 0 for m in bench.overrides()), "and moved nothing"


@pytest.mark.parametrize("method", ["rc_override", "manual_control"])
@pytest.mark.parametrize("stick", [0, 1000, 1432, 1500, 1528, 1777, 2000])
def test_the_proof_that_the_vehicle_listens_leaves_the_rudder_where_the_hand_has_it(method, stick) -> None:
    bench = Bench(settings=CompanionSettings(FULL, method=method, as_gcs=True))
    bench.rover.stick = bench.rover.pulse = stick
    pulses = set()
    for _ in range(80):
        bench.run(0.05)
        pulses.add(bench.rover.pulse)
    assert bench.helm.available
    assert len(pulses) > 1 and bench.rover.pulse == stick
    servos = [steering_of(pulse) for pulse in pulses if pulse]
    assert max(servos) - min(servos) <= 45, "a hundredth of full rudder at most, where there is no dead zone"


@pytest.mark.parametrize("method", ["rc_override", "manual_control"])
def test_a_vehicle_that_does_not_listen_is_found_out_before_the_pilot_engages(method) -> None:
    """The parameters are as they should be, and yet another hand has the radio: the switch for overrides is off."""
    bench = Bench(settings=CompanionSettings(FULL, method=method, as_gcs=True))
    bench.rover.obeys = False
    bench.command = RudderCommand(bench.now, 0.3, True)
    bench.run(6.0)
    assert not bench.helm.available
    assert "does not take our steering: RC channel 1 stays at 1500 us while 149" in bench.helm.reason
    assert "--as-gcs" in bench.helm.reason
    if method == "rc_override":
        assert all(abs(m.chan1_raw - 1500) < 30 or m.chan1_raw == 0 for m in bench.overrides())
    bench.rover.obeys = True
    bench.command = RudderCommand(bench.now, 0.0, False)
    bench.run(6.0)
    assert bench.helm.available, "tried again: the switch is on now"


def test_a_stick_that_does_not_steer_takes_the_helm_at_once() -> None:
    bench = ready()
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.rover.others[4] = 1420
    bench.run(1.0)
    assert bench.helm.available, "a stick that rests off its centre is no hand"
    bench.rover.others[4] = 1600
    bench.run(0.1)
    assert bench.helm.reason == "the stick on RC channel 4 was moved"
    bench.rover.others[3] = 1900
    bench.command = RudderCommand(bench.now, 0.0, False)
    bench.run(5.0)
    assert bench.helm.available, "the throttle is the human's to move"


def test_the_radio_s_override_switch_takes_the_helm_at_once() -> None:
    bench = Bench(RC7_OPTION=46.0)
    bench.rover.others[7] = 1900
    bench.run(6.0)
    assert bench.helm.available
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(0.5)
    bench.rover.others[7] = 1000
    bench.rover.obeys = False
    bench.run(0.1)
    assert bench.helm.reason == "the radio's switch for overrides is off; switch it on"
    bench.rover.received.clear()
    bench.run(1.0)
    assert {m.chan1_raw for m in bench.overrides()} <= {0}


def test_no_engagement_without_reports_of_the_steering_input() -> None:
    bench = Bench()
    bench.rover.report_rudder = lambda: None
    bench.run(6.0)
    assert bench.helm.reason == "waiting for the vehicle to report its steering input (RC_CHANNELS)"


@pytest.mark.parametrize("method", ["rc_override", "manual_control"])
@pytest.mark.parametrize("degrees", [-30.0, -5.0, -1.0, 0.0, 1.0, 12.0, 30.0])
def test_rudder_goes_where_it_is_commanded(method, degrees) -> None:
    bench = ready(settings=CompanionSettings(FULL, method=method, as_gcs=True))
    bench.command = RudderCommand(bench.now, math.radians(degrees), True)
    bench.run(0.5)
    moved = int(steering_of(bench.rover.pulse) * 500 / 4500) / 500.0 * 30.0
    assert moved == pytest.approx(degrees, abs=0.07)
    assert bench.overrides()[-1].get_srcSystem() == 255
    others = bench.overrides()[-1]
    if method == "rc_override":
        assert [getattr(others, f"chan{n}_raw") for n in range(2, 9)] == [65535] * 7
        assert [getattr(others, f"chan{n}_raw") for n in range(9, 19)] == [0] * 10
    else:
        assert (others.x, others.z, others.r) == (32767, 32767, 32767)


def test_releases_several_times_and_then_is_silent() -> None:
    bench = ready()
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(1.0)
    bench.rover.received.clear()
    bench.command = RudderCommand(bench.now, 0.2, False)
    bench.run(3.0)
    assert [m.chan1_raw for m in bench.overrides()] == [0] * 5
    bench.rover.received.clear()
    bench.link.release(bench.now)
    bench.rover.listen()
    assert [m.chan1_raw for m in bench.overrides()] == [0] * 5


def test_wrong_ground_station_id_is_found_out_before_anything_moves() -> None:
    bench = Bench(settings=CompanionSettings(FULL))
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(4.0)
    assert not bench.helm.available
    assert bench.helm.reason == "the vehicle obeys only system id 255; start with --as-gcs or set SYSID_MYGCS to 1"
    assert not bench.overrides()


def test_own_id_steers_where_the_vehicle_obeys_it() -> None:
    bench = ready(settings=CompanionSettings(FULL), SYSID_MYGCS=1.0)
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(1.0)
    message = bench.overrides()[-1]
    assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 191)
    assert bench.rover.pulse > 1600


def test_a_rudder_that_does_not_obey_is_noticed() -> None:
    bench = ready()
    bench.rover.obeys = False
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(0.9)
    assert bench.helm.available
    bench.run(0.5)
    assert not bench.helm.available
    assert "does not obey: RC channel 1 is at 1500" in bench.helm.reason
    bench.rover.received.clear()
    bench.run(1.0)
    assert {m.chan1_raw for m in bench.overrides()} <= {0}, "no steering without the helm"


def test_a_vehicle_that_ignores_us_is_noticed_while_the_rudder_rests_amidships() -> None:
    bench = ready()
    bench.command = RudderCommand(bench.now, 0.0, True)
    bench.run(2.0)
    assert bench.helm.available
    assert steering_of(bench.rover.pulse) == 0, "amidships moves nothing"
    bench.rover.obeys, bench.rover.pulse = False, bench.rover.stick
    bench.run(1.5)
    assert not bench.helm.available
    assert "does not obey: RC channel 1 is at 1500" in bench.helm.reason


def test_a_pulse_that_stands_still_between_two_orders_is_none_of_them() -> None:
    bench = ready()
    bench.rover.obeys, bench.rover.pulse = False, bench.rover.stick
    for swing in (0.1, -0.1) * 4:
        if bench.helm.available:
            bench.command = RudderCommand(bench.now, swing, True)
            bench.run(0.4)
    assert not bench.helm.available
    assert "does not obey: RC channel 1 is at 1500" in bench.helm.reason


def test_a_servo_that_is_reversed_while_we_steer_takes_the_helm_at_once() -> None:
    bench = ready()
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(1.0)
    bench.rover.send(dialect.MAVLink_param_value_message(b"SERVO1_MIN", 1010.0, 9, 14, 0))
    bench.run(0.2)
    assert bench.helm.available
    bench.rover.send(dialect.MAVLink_param_value_message(b"SERVO1_REVERSED", 1.0, 9, 14, 0))
    bench.run(0.2)
    assert not bench.helm.available and "SERVO1_REVERSED was changed" in bench.helm.reason


def said_of_servo(bench: Bench) -> list[str]:
    """Return what was said of the servo's end points, '' for their being as they were."""
    mine = [each for each in bench.samples if isinstance(each, AlarmSample) and each.source.endswith("servo")]
    return [each.event.detail if each.event else "" for each in mine]


@pytest.mark.parametrize("tells", [True, False])
def test_end_points_that_change_while_we_steer_move_no_rudder(tells: bool) -> None:
    bench = ready()
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(1.0)
    pulse = bench.rover.pulse
    assert 1000 + (steering_of(pulse) + 4500) / 9.0 == pytest.approx(1500 + 500 * 0.2 / FULL, abs=2)
    bench.rover.parameters |= {"SERVO1_MAX": 2500.0, "SERVO1_MIN": 500.0}
    if tells:
        for name in ("SERVO1_MAX", "SERVO1_MIN"):
            bench.rover.send(dialect.MAVLink_param_value_message(name.encode(), bench.rover.parameters[name], 9, 14, 0))
    bench.run(60.0)
    assert bench.helm.available
    servo = 1500 + steering_of(bench.rover.pulse) * 1000 / 4500
    assert servo == pytest.approx(1500 + 500 * 0.2 / FULL, abs=3), "the same rudder by the servo's pulse"
    assert "SERVO1_MAX was changed from 2000 to 2500" in said_of_servo(bench)[-1]
    bench.rover.parameters |= {"SERVO1_MAX": 2000.0, "SERVO1_MIN": 1000.0}
    bench.run(60.0)
    assert said_of_servo(bench)[-1] == "" and bench.rover.pulse == pulse


def test_end_points_that_leave_too_little_rudder_end_the_steering() -> None:
    bench = ready(settings=CompanionSettings(FULL, as_gcs=True, angle_max=FULL))
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(1.0)
    bench.rover.send(dialect.MAVLink_param_value_message(b"SERVO1_MAX", 1750.0, 9, 14, 0))
    bench.run(0.2)
    assert not bench.helm.available
    assert "SERVO1_MAX was changed from 2000 to 1750 while we steered, which leaves 15 deg" in bench.helm.reason


def test_end_points_that_change_while_nobody_steers_are_the_new_scale() -> None:
    bench = ready()
    bench.rover.parameters |= {"SERVO1_MAX": 2500.0, "SERVO1_MIN": 500.0}
    bench.run(60.0)
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(1.0)
    assert steering_of(bench.rover.pulse) / 4500 == pytest.approx(0.2 / FULL, abs=0.01) and not said_of_servo(bench)


@pytest.mark.parametrize("restored", [False, True])
def test_a_new_scale_set_in_standby_counts_whatever_changed_while_we_steered(restored: bool) -> None:
    bench = ready(FS_GCS_TIMEOUT=5.0)
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(1.0)
    changes = (("SERVO1_MAX", 2500.0), ("SERVO1_MAX", 2000.0)) if restored else (("FS_GCS_TIMEOUT", 6.0),)
    for name, value in changes:
        bench.rover.parameters[name] = value
        bench.rover.send(dialect.MAVLink_param_value_message(name.encode(), value, 9, 14, 0))
        bench.run(0.5)
    assert bench.helm.available
    bench.command = RudderCommand(bench.now, 0.0, False)
    bench.run(2.0)
    said = said_of_servo(bench)
    bench.rover.parameters |= {"SERVO1_MAX": 2500.0, "SERVO1_MIN": 500.0}
    bench.run(60.0)
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(1.0)
    assert steering_of(bench.rover.pulse) / 4500 == pytest.approx(0.2 / FULL, abs=0.01)
    assert said_of_servo(bench) == said and (not said or said[-1] == "")


@pytest.mark.parametrize("moved", [("SERVO1_FUNCTION", "SERVO2_FUNCTION"), ("SERVO2_FUNCTION", "SERVO1_FUNCTION")])
def test_a_parameter_file_that_moves_the_steering_to_another_servo_ends_it(moved: tuple[str, str]) -> None:
    """A ground station that writes a file tells of each value as it comes; what comes first is no change."""
    bench = ready()
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(1.0)
    values = {"SERVO1_FUNCTION": 0.0, "SERVO2_FUNCTION": 26.0}
    written = {name: values[name] for name in moved}
    written |= {"SERVO2_MIN": 1050.0, "SERVO2_TRIM": 1550.0, "SERVO2_MAX": 2050.0, "SERVO2_REVERSED": 0.0}
    bench.rover.parameters |= written
    for name, value in written.items():
        bench.rover.send(dialect.MAVLink_param_value_message(name.encode(), value, 9, 14, 0))
    bench.run(0.5)
    assert not bench.helm.available and "SERVO1_FUNCTION was changed from 26 to 0" in bench.helm.reason
    assert said_of_servo(bench) == []


def test_what_keeps_the_vehicle_from_obeying_is_asked_for_anew_and_named() -> None:
    bench = ready(RC_OPTIONS=0.0)
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(1.0)
    bench.rover.parameters["RC_OPTIONS"] = 2.0
    bench.rover.obeys, bench.rover.pulse = False, bench.rover.stick
    bench.run(2.5)
    assert not bench.helm.available and "RC_OPTIONS has bit 1 set" in bench.helm.reason


def test_the_safety_switch_keeps_the_helm_until_it_is_pressed() -> None:
    bench = ready()
    outputs = dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    for enabled in (0, outputs):
        bench.rover.send(dialect.MAVLink_sys_status_message(outputs, enabled, outputs, 0, 12000, 0, 80, *[0] * 6))
        bench.run(1.0)
        assert bench.helm.available is bool(enabled)
        assert enabled or "safety switch" in bench.helm.reason


def test_a_vehicle_that_is_given_another_system_id_is_named() -> None:
    bench = ready()
    bench.rover.codec.system = 7
    bench.run(5.0)
    assert not bench.helm.available
    assert bench.helm.reason.endswith("system 7 is heard: if that is this boat, start with --vehicle-system 7")


@pytest.mark.parametrize(
    ("attribute", "value", "words"), [("mode", 4, "mode HOLD"), ("mode", 15, "GUIDED"), ("armed", False, "disarmed")]
)
def test_mode_and_arming_take_the_helm(attribute, value, words) -> None:
    bench = ready()
    bench.command = RudderCommand(bench.now, 0.2, True)
    bench.run(1.0)
    setattr(bench.rover, attribute, value)
    bench.run(1.1)
    assert not bench.helm.available
    assert words in bench.helm.reason


def test_reboot_is_noticed_and_everything_asked_anew() -> None:
    bench = ready()
    bench.rover.boot = 0.0
    bench.rover.reads.clear()
    bench.rover.intervals.clear()
    samples = bench.run(0.1)
    helm = [sample for sample in samples if isinstance(sample, HelmSample)]
    assert not helm[0].available
    assert "rebooted" in helm[0].reason
    bench.run(4.0)
    assert "RC1_DZ" in bench.rover.reads
    assert dialect.MAVLINK_MSG_ID_ATTITUDE in bench.rover.intervals
    assert bench.helm.available


def test_silence_is_noticed() -> None:
    bench = ready()
    bench.talks = bench.rover.answers = False
    bench.run(4.2)
    assert not bench.helm.available
    assert "no heartbeat" in bench.helm.reason
    bench.talks = True
    bench.run(2.0)
    assert bench.helm.available


def test_a_second_vehicle_and_a_ground_station_are_not_heard() -> None:
    bench = ready()
    stranger = Rover(bench.rover.transport, system=7)
    stranger.mode = 4
    stranger.heartbeat()
    stranger.attitude(yaw=3.0)
    samples = bench.link.receive(bench.now)
    assert samples == []


def test_no_command_before_the_firmware_is_up() -> None:
    bench = Bench()
    bench.rover.status = dialect.MAV_STATE_BOOT
    bench.run(3.0)
    kinds = {message.get_type() for message in bench.rover.received}
    assert kinds == {"HEARTBEAT"}
    assert not bench.helm.available


def test_no_other_message_of_the_vehicle_is_taken_for_one_of_those_known() -> None:
    """Some kinds have a field named `id`, which hides the message's own."""
    bench = ready()
    for kind in dialect.mavlink_map.values():
        # time does not go backwards, so that nothing looks like a reboot
        payload = round(bench.rover.boot * 1000).to_bytes(4, "little") + bytes(kind.unpacker.size)
        payload = payload[: kind.unpacker.size]
        frame = bytes([0xFD, len(payload), 0, 0, 7, 1, 1]) + kind.id.to_bytes(3, "little") + payload
        crc = dialect.x25crc(frame[1:] + bytes([kind.crc_extra])).crc
        if kind.id != dialect.MAVLINK_MSG_ID_HEARTBEAT:
            bench.rover.transport.send(frame + crc.to_bytes(2, "little"))
    bench.run(0.1)
    assert bench.link.session.bad_packets == 0
    assert bench.helm.available, bench.helm.reason


def test_whatever_a_vehicle_sends_is_survived() -> None:
    """Real kinds with any content, and steering parameters with values that no firmware should have."""
    random = Random(9)
    near, far = loopback_pair()
    link, codec = CompanionLink(near, CompanionSettings(FULL, as_gcs=True)), MavlinkCodec(1, 1)
    far.send(codec.encode(dialect.MAVLink_heartbeat_message(11, 3, 129, 0, 4, 3)))
    kinds = list(dialect.mavlink_map.values())
    names = [*PARAMETERS, "RC7_OPTION", "RCMAP_PITCH", "RCMAP_YAW", "MAV_GCS_SYSID_HI"]
    values = [0.0, 1.0, 26.0, 46.0, 255.0, 1000.0, 1500.0, 2000.0, 30.0, -5.0, 1e9, -1e30, math.inf, math.nan, 3.7]
    now = 0.0
    for number in range(6000):
        if random.random() < 0.3:
            message = dialect.MAVLink_param_value_message(random.choice(names).encode(), random.choice(values), 9, 9, 0)
            far.send(codec.encode(message))
        else:
            kind = dialect.mavlink_map[random.choice([0, 24, 30, 33, 35, 36, 65, 74])]
            kind = kind if random.random() < 0.8 else random.choice(kinds)
            payload = random.randbytes(random.randint(1, kind.unpacker.size))
            frame = bytes([0xFD, len(payload), 0, 0, 7, 1, 1]) + kind.id.to_bytes(3, "little") + payload
            far.send(frame + dialect.x25crc(frame[1:] + bytes([kind.crc_extra])).crc.to_bytes(2, "little"))
        if number % 5 == 0:
            now += random.choice([0.01, 0.05, 0.3])
            for sample in link.receive(now):
                assert not isinstance(sample, HeadingSample) or abs(sample.heading) < 7.0
            link.send(now, RudderCommand(now, random.uniform(-1.0, 1.0), random.random() < 0.5))
            link.poll(now)
            link.take_packets()
            far.receive()


def test_a_ground_station_id_that_is_none_is_said() -> None:
    bench = Bench(SYSID_MYGCS=70000.0)
    bench.run(2.0)
    assert bench.helm.reason == "the vehicle's SYSID_MYGCS is no system id; set it to 255"


def test_samples_carry_measurement_time_and_si_units() -> None:
    bench = ready(SYSID_MYGCS=255.0)
    bench.rover.attitude(yaw=1.25, rate=-0.2)
    bench.rover.send(
        dialect.MAVLink_global_position_int_message(round(bench.rover.boot * 1e3), 0, 0, 0, 0, 300, 400, 0, 0)
    )
    usec = round(bench.rover.boot * 1e6)
    bench.rover.send(dialect.MAVLink_servo_output_raw_message(usec, 0, 1750, *[0] * 7))
    late = bench.now + 0.3
    samples = bench.link.receive(late)
    heading = next(sample for sample in samples if isinstance(sample, HeadingSample))
    speed = next(sample for sample in samples if isinstance(sample, SpeedSample))
    rudder = next(sample for sample in samples if isinstance(sample, RudderSample))
    assert (heading.heading, heading.rate) == pytest.approx((1.25, -0.2))
    assert speed.speed == pytest.approx(5.0)
    assert rudder.angle == pytest.approx(math.radians(15.0))
    assert rudder.ordered
    roll = next(sample for sample in samples if isinstance(sample, RollSample))
    assert (roll.roll, roll.rate) == pytest.approx((0.02, 0.01))
    for sample in (heading, speed, rudder, roll):
        assert sample.time == pytest.approx(bench.now, abs=0.002), "300 ms on the way do not make a sample younger"


def test_packets_of_both_directions_are_kept_for_the_log() -> None:
    bench = ready()
    reader = MavlinkCodec()
    kinds = {m.get_type() for _, packet in bench.link.take_packets() for m in reader.decode(packet)}
    assert {"HEARTBEAT", "ATTITUDE", "PARAM_REQUEST_READ", "PARAM_VALUE", "COMMAND_LONG"} <= kinds
    assert bench.link.take_packets() == []


def test_px4_is_refused_with_a_sentence() -> None:
    bench = Bench()
    bench.rover.send(dialect.MAVLink_heartbeat_message(11, dialect.MAV_AUTOPILOT_PX4, 0, 0, 4, 3))
    samples = bench.link.receive(bench.now)
    assert "start with --steer offboard" in samples[0].reason


def test_long_texts_leave_in_pieces() -> None:
    bench = ready()
    bench.link.publish_tick(shown(bench.now, Mode.ENGAGED, (other("x" * 70),)))
    bench.run(1.0)
    texts = [m for m in bench.rover.received if m.get_type() == "STATUSTEXT"]
    assert [len(m.text) for m in texts] == [50, 20]
    assert [m.chunk_seq for m in texts] == [0, 1]
    assert texts[0].id == texts[1].id != 0


def test_a_listening_link_passes_over_a_ground_station_and_follows_a_vehicle_that_moves() -> None:
    listening = UdpInTransport("udpin:127.0.0.1:0", "127.0.0.1", 0, is_mavlink)
    station, vehicle = (UdpOutTransport("far", "127.0.0.1", listening.port) for _ in range(2))
    link = CompanionLink(listening, CompanionSettings(FULL))
    gcs = MavlinkCodec(255, 190).encode(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    rover = Rover(vehicle)
    for second in range(3):
        station.send(gcs)
        rover.heartbeat()
        link.receive(float(second))
        link.poll(float(second))
    assert link.session.vehicle == 1
    assert listening.peer == vehicle._socket.getsockname()
    moved = UdpOutTransport("far", "127.0.0.1", listening.port)
    rover.transport = moved
    for second in range(3, 12):
        station.send(gcs)
        rover.heartbeat()
        link.receive(float(second))
        link.poll(float(second))
    assert listening.peer == moved._socket.getsockname(), "a restarted vehicle sends from another port"
    for end in (link, station, vehicle, moved):
        end.close()


def alarms(samples: list) -> list[AlarmSample]:
    return [sample for sample in samples if isinstance(sample, AlarmSample)]


def test_headings_that_stay_slow_though_asked_for_are_an_alarm_with_what_to_do() -> None:
    bench = ready()
    attitude = bench.rover.attitude
    asked = bench.rover.intervals
    number = 0

    def seldom() -> None:
        nonlocal number
        number += 1
        if number % 5 == 0:
            attitude()

    bench.rover.attitude = seldom
    asked.clear()
    assert not alarms(bench.run(4.0)), "a request may get lost: it is asked again first"
    assert dialect.MAVLINK_MSG_ID_ATTITUDE in asked
    (alarm,) = alarms(bench.run(5.0))
    assert words(alarm.event).startswith("headings (ATTITUDE) come at 4 Hz though 20 Hz were asked for")
    for way_out in ("SERIALn_BAUD", "SRn_", "control.rate_hz"):
        assert way_out in words(alarm.event)
    assert bench.helm.available, "steering goes on"
    bench.rover.attitude = attitude
    (over,) = alarms(bench.run(5.0))
    assert (over.event, over.source) == (None, alarm.source)


def test_no_headings_at_all_and_a_reboot_are_said_otherwise() -> None:
    bench = ready()
    bench.rover.attitude = lambda: None
    assert not alarms(bench.run(10.0)), "the fail-safe says it"


@pytest.mark.parametrize(
    ("field", "limit", "kind"),
    [
        ("yaw", 7.0, HeadingSample),
        ("yawspeed", 100.0, HeadingSample),
        ("roll", 7.0, RollSample),
        ("rollspeed", 100.0, RollSample),
    ],
)
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_an_attitude_that_cannot_be_is_no_sample(field: str, limit: float, kind: type, side: float) -> None:
    """Each part for itself: a wild roll rate leaves the heading, a wild yaw leaves the roll."""
    bench = ready(SYSID_MYGCS=255.0)
    for value, is_taken in ((0.9 * limit, True), (1.1 * limit, False), (math.nan, False), (math.inf, False)):
        fields = {"roll": 0.0, "pitch": 0.0, "yaw": 0.0, "rollspeed": 0.0, "pitchspeed": 0.0, "yawspeed": 0.0}
        bench.rover.boot += 0.05
        fields[field] = side * value
        bench.rover.send(dialect.MAVLink_attitude_message(round(bench.rover.boot * 1e3), **fields))
        bench.now += 0.05
        kinds = {type(sample) for sample in bench.link.receive(bench.now)} & {HeadingSample, RollSample}
        assert (kind in kinds) is is_taken, value
        assert len(kinds) == 1 + is_taken, "the other one is untouched"


@pytest.mark.parametrize(("speed", "is_taken"), [(199.5, True), (200.5, False)])
def test_a_speed_beyond_any_boats_is_no_sample(speed: float, is_taken: bool) -> None:
    bench = ready(SYSID_MYGCS=255.0)
    position = dialect.MAVLink_global_position_int_message
    bench.rover.send(
        position(round(bench.rover.boot * 1e3), 0, 0, 0, 0, round(60.0 * speed), round(80.0 * speed), 0, 0)
    )
    assert any(isinstance(sample, SpeedSample) for sample in bench.link.receive(bench.now)) is is_taken


def when(bench: Bench, kind: str, seconds: float, **fields: object) -> list[float]:
    """Return at which hundredths of a second messages of a kind arrive at a silent vehicle."""
    bench.rover.listen()
    bench.rover.received.clear()
    times = []
    for step in range(round(100 * seconds)):
        bench.link.poll(bench.now + 0.01 * step + 1e-6)
        bench.rover.listen()
        times += [step for m in bench.rover.received if m.get_type() == kind
                  and all(getattr(m, name) == value for name, value in fields.items())]  # fmt: skip
        bench.rover.received.clear()
    return times


def test_heartbeats_leave_once_a_second_the_station_s_only_where_we_speak_in_its_name() -> None:
    for as_gcs in (False, True):
        bench = Bench(CompanionSettings(FULL, as_gcs=as_gcs))
        ours = when(bench, "HEARTBEAT", 3.5, type=18)
        assert ours[0] == 0 and len(ours) == 4 and set(spaces(ours)) <= {100, 101}
        bench.now += 10.0
        assert len(when(bench, "HEARTBEAT", 3.5, type=6, system_status=4)) == 4 * as_gcs


def spaces(times: list[float]) -> list[float]:
    return [after - before for before, after in pairwise(times)]


def test_a_peer_silent_for_five_seconds_is_let_go_of_every_five_seconds() -> None:
    near, _ = loopback_pair()
    forgotten: list[float] = []
    link = CompanionLink(near, CompanionSettings(FULL))
    near.forget_peer = lambda: forgotten.append(now)  # type: ignore[method-assign]
    for step in range(171):
        now = 0.1 * step
        link.poll(now)
    assert forgotten == pytest.approx([5.1, 10.2, 15.3], abs=0.11)


@pytest.mark.parametrize(
    ("override_time", "lapse"),
    [
        (3.0, "the flight controller lets go by itself after RC_OVERRIDE_TIME 3 s"),
        (0.5, "the flight controller lets go by itself after RC_OVERRIDE_TIME 0.5 s"),
        (-1.0, "RC_OVERRIDE_TIME is -1, so the flight controller keeps it; switch the vehicle's mode"),
    ],
)
def test_the_way_out_says_when_the_vehicle_lets_go_by_itself(override_time: float, lapse: str) -> None:
    bench = ready()
    bench.command = RudderCommand(0.0, 0.2, True)
    bench.run(1.0)
    bench.link.session.parameters.take("RC_OVERRIDE_TIME", override_time)
    bench.rover.obeys = False
    bench.link.release(bench.now)
    start, waited, released = bench.now, None, None
    while released is None:
        bench.now += 0.05
        bench.rover.report_rudder()
        bench.link.receive(bench.now)
        released, waited = bench.link.release_result(bench.now), bench.now - start
    assert (released.state, released.lapse) == (ReleaseState.UNCONFIRMED, lapse)
    assert released.waited == pytest.approx(waited) and 1.2 < waited < 1.6


def test_releases_are_sent_again_each_fifth_of_a_second_while_no_report_shows_one() -> None:
    bench = ready()
    bench.command = RudderCommand(0.0, 0.2, True)
    bench.run(1.0)
    bench.rover.listen()
    bench.rover.received.clear()
    times = []
    bench.link.release(bench.now)
    for step in range(39):
        bench.link.release_result(bench.now + 0.01 * step + 1e-6)
        bench.rover.listen()
        times += [step] * len(bench.overrides())
        bench.rover.received.clear()
    assert sorted(set(times)) in ([0, 20], [0, 21]) and len(times) == 10, "five at a time"


@pytest.mark.parametrize(
    ("mode", "state", "severity"),
    [(Mode.STANDBY, 3, 5), (Mode.ENGAGED, 4, 4), (Mode.OVERRIDE, 3, 4), (Mode.FAILSAFE, 5, 2), (Mode.FAULT, 6, 1)],
)
def test_the_heartbeat_and_the_texts_say_how_bad_it_is(mode: Mode, state: int, severity: int) -> None:
    bench = Bench()
    bench.rover.heartbeat()
    bench.link.receive(0.0)
    bench.link.publish_tick(shown(0.0, mode, (other("words in no catalogue"),)))
    bench.link.publish_tick(shown(0.1, mode, (other("words in no catalogue"),)))
    bench.link.poll(0.2)
    bench.rover.listen()
    said = [m for m in bench.rover.received if m.get_type() == "STATUSTEXT"]
    assert [(m.severity, m.text) for m in said] == [(severity, "words in no catalogue")]
    assert {m.system_status for m in bench.rover.received if m.get_type() == "HEARTBEAT" and m.type == 18} == {state}


@pytest.mark.parametrize(
    ("autopilot", "component", "system", "wanted", "is_ours"),
    [(3, 1, 7, None, True), (3, 1, 7, 7, True), (3, 1, 7, 8, False), (3, 2, 7, None, False), (8, 1, 7, None, False),
     (3, 1, 0, None, False), (12, 1, 7, None, True)],
)  # fmt: skip
def test_whose_heartbeat_is_latched_on_to(
    autopilot: int, component: int, system: int, wanted: int | None, is_ours: bool
) -> None:
    near, far = loopback_pair()
    link = CompanionLink(near, CompanionSettings(FULL, vehicle_system=wanted))
    beat = dialect.MAVLink_heartbeat_message(11, autopilot, 0, 0, 4, 3)
    far.send(MavlinkCodec(system, component).encode(beat))
    link.receive(0.0)
    assert link.session.vehicle == (system if is_ours else 0)


def test_what_the_transport_cannot_take_is_counted_and_not_kept() -> None:
    near, _ = loopback_pair()
    link = CompanionLink(near, CompanionSettings(FULL))
    near.send = lambda data: False  # type: ignore[method-assign]
    for number in range(3):
        assert link.dropped == number
        link.poll(float(number))
    assert link.take_packets() == []


@pytest.mark.parametrize(
    ("settings", "firmware", "spoken"),
    [
        (CompanionSettings(FULL, as_gcs=True), 255, {255}),
        (CompanionSettings(FULL, as_gcs=True), 250, {250}),
        (CompanionSettings(FULL, as_gcs=True, gcs_system=200), 250, {200}),
        (CompanionSettings(FULL, as_gcs=True, gcs_system=200), 200, {200}),
        (CompanionSettings(FULL), 250, set()),
        (CompanionSettings(FULL, gcs_system=200), 250, set()),
    ],
)
def test_a_ground_station_s_id_is_the_one_given_or_else_the_vehicle_s(
    settings: CompanionSettings, firmware: int, spoken: set[int]
) -> None:
    bench = Bench(settings, SYSID_MYGCS=firmware)
    bench.run(4.0)
    bench.rover.received.clear()
    bench.run(2.0)
    beats = [m for m in bench.rover.received if m.get_type() == "HEARTBEAT"]
    assert {m.get_srcSystem() for m in beats if m.type == dialect.MAV_TYPE_GCS} == spoken
    assert {(m.get_srcSystem(), m.get_srcComponent()) for m in beats if m.type == 18} == {(1, 191)}
    steering = [m for m in bench.overrides() if m.get_type() == "RC_CHANNELS_OVERRIDE"]
    assert {m.get_srcSystem() for m in steering} <= (spoken or {1})
    assert bench.helm.available is (spoken == {firmware})


def test_the_helm_sample_precedes_the_measurements() -> None:
    bench = ready()
    due = bench.link.session._judge_at
    assert due > bench.now + 0.01
    bench.rover.attitude()
    assert [type(sample) for sample in bench.link.receive(bench.now + 0.01)] == [HeadingSample, RollSample]
    assert bench.link.session._judge_at == due
    bench.rover.mode = 10
    bench.rover.heartbeat()
    (helm,) = bench.link.receive(bench.now + 0.01)
    assert isinstance(helm, HelmSample) and (helm.available, helm.cause) == (False, HelmCause.TAKEN)
    bench.rover.mode = 0
    bench.rover.attitude()
    bench.rover.heartbeat()
    helm, *rest = bench.link.receive(bench.now + 0.02)
    assert isinstance(helm, HelmSample) and helm.cause is HelmCause.TAKEN
    assert any(isinstance(sample, HeadingSample) for sample in rest)


def test_times_of_the_companion_s_line_to_the_bit() -> None:
    """A heartbeat a second, a peer let go of after more than 5 s, a silence of ours after more than one."""
    near, far = loopback_pair()
    link = CompanionLink(near, CompanionSettings(FULL))
    beats, forgotten, unheard = [], [], []
    near.forget_peer = lambda: forgotten.append(now)
    link.session._reader.silence = lambda: unheard.append(now)
    for now in (0.0, 0.9999, 1.0, 1.9999, 2.0, 5.0, 5.001):
        link.poll(now)
        beats += [now] * len(far.receive())
    assert (beats, forgotten) == ([0.0, 1.0, 2.0, 5.0], [5.001])
    for now in (10.0, 11.0, 12.001):
        link.receive(now)
    assert unheard[-1:] == [12.001] and 11.0 not in unheard


@pytest.mark.parametrize(("override_time", "patience"), [(None, 3.0), (0.0, 3.0), (-1.0, 3.0), (0.5, 0.5), (9.0, 9.0)])
def test_orders_may_stay_away_as_long_as_the_vehicle_keeps_the_last(override_time, patience) -> None:
    link = CompanionLink(loopback_pair()[0], CompanionSettings(FULL))
    if override_time is not None:
        link.session._reader.parameters.take("RC_OVERRIDE_TIME", override_time)
    assert link.session._reader.parameters.patience == patience
