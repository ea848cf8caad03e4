"""What one message of the vehicle makes: samples with their times and units, at both sides of every limit."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.steering import SteeringOutput
from autopilot.links.mavlink.vehicle import CompanionSettings, VehicleReader
from autopilot.signals import (
    CourseSample,
    HeadingSample,
    PositionSample,
    RollSample,
    RudderSample,
    Sample,
    SpeedSample,
    WindSample,
)
from autopilot.supervision.panel import sentence_of

CHANNEL = {"MIN": 1100.0, "TRIM": 1500.0, "MAX": 1900.0, "REVERSED": 0.0}
STEERED = {
    "MAV_GCS_SYSID": 255.0,
    "RCMAP_ROLL": 1.0,
    "SERVO3_FUNCTION": 26.0,
    "RC1_DZ": 30.0,
    **{f"RC1_{name}": value for name, value in CHANNEL.items()},
    **{f"SERVO3_{name}": value for name, value in CHANNEL.items()},
}


class Boat:
    """A reader, and messages to it as they arrive."""

    def __init__(self, guided: bool = False, latency: float = 0.0, **parameters: float) -> None:
        self.output = SteeringOutput("guided" if guided else "rc_override", math.radians(30.0), False)
        settings = CompanionSettings(math.radians(30.0), heading_latency=latency)
        self.reader = VehicleReader(self.output, settings._replace(method="guided") if guided else settings)
        for name, value in parameters.items():
            self.take(0.0, dialect.MAVLink_param_value_message(name.encode(), value, 9, 1, 0))

    def take(self, now: float, message: Any) -> list[Sample]:
        (received,) = MavlinkCodec(1, 0).decode(MavlinkCodec(1, 1).encode(message))
        samples: list[Sample] = []
        self.reader.take(now, received, samples)
        return samples

    def heartbeat(self, now: float, mode: int = 0, armed: bool = True) -> None:
        base = dialect.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        self.take(now, dialect.MAVLink_heartbeat_message(11, 3, base | 1, mode, 4, 3))

    def fix(self, kind: int) -> None:
        self.take(0.0, dialect.MAVLink_gps_raw_int_message(0, kind, 0, 0, 0, 99, 99, 0, 0, 9))

    def channels(self, now: float, boot_ms: int = 0, **pulses: int) -> list[Sample]:
        all_ = {f"chan{number}_raw": 1500 for number in range(1, 19)} | pulses
        return self.take(now, dialect.MAVLink_rc_channels_message(boot_ms, 16, **all_, rssi=255))

    def servos(self, now: float, pulse: int, port: int = 0, time_usec: int = 0) -> list[Sample]:
        return self.take(
            now, dialect.MAVLink_servo_output_raw_message(time_usec, port, 1111, 1222, pulse, 0, 0, 0, 0, 0)
        )


def attitude(boot_ms: int, roll: float = 0.0, yaw: float = 0.0, roll_rate: float = 0.0, rate: float = 0.0) -> Any:
    return dialect.MAVLink_attitude_message(boot_ms, roll, 0.3, yaw, roll_rate, 0.4, rate)


def position(boot_ms: int, latitude: float, longitude: float, vx: int = 0, vy: int = 0) -> Any:
    place = (round(latitude * 1e7), round(longitude * 1e7), 0, 0)
    return dialect.MAVLink_global_position_int_message(boot_ms, *place, vx, vy, 0, 0)


def hud(speed: float, throttle: int = 0) -> Any:
    return dialect.MAVLink_vfr_hud_message(99.0, speed, 0, throttle, 0.0, 0.0)


def test_what_is_asked_of_a_vehicle_and_how_often() -> None:
    asked = dict(Boat().reader.streams.due(0.0))
    often = {30: 50_000, 36: 100_000, 65: 100_000, 33: 200_000, 74: 500_000, 24: 1_000_000, 1: 1_000_000}
    assert asked == often | {168: 500_000, 193: 1_000_000}, "a vane's wind and a filter's word, where they are"
    guided = dict(Boat(guided=True).reader.streams.due(0.0))
    assert guided == asked | {74: 200_000, 62: 200_000}


def test_an_attitude_is_a_heading_and_a_roll_at_the_time_of_measurement() -> None:
    boat = Boat(latency=0.25)
    heading, roll = boat.take(5.0, attitude(2000, roll=0.1, yaw=-1.5, roll_rate=-0.2, rate=0.3))
    assert isinstance(heading, HeadingSample) and isinstance(roll, RollSample)
    assert (heading.time, heading.source, roll.source) == (4.75, "attitude", "attitude")
    assert (heading.heading, heading.rate) == pytest.approx((-1.5, 0.3), abs=1e-6)
    assert (roll.time, roll.roll, roll.rate) == pytest.approx((4.75, 0.1, -0.2), abs=1e-6)
    # the second came half a second later than its stamp tells
    heading, _ = boat.take(6.5, attitude(3000))
    assert heading.time == pytest.approx(5.75)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize(("field", "limit"), [("yaw", 7.0), ("rate", 100.0), ("roll", 7.0), ("roll_rate", 100.0)])
def test_an_attitude_counts_just_below_its_limit_and_not_at_it(field: str, limit: float, sign: float) -> None:
    kind = HeadingSample if field in ("yaw", "rate") else RollSample
    for value, is_taken in ((0.999 * limit, True), (limit, False), (1.001 * limit, False), (math.nan, False)):
        samples = Boat().take(0.0, attitude(0, **{field: sign * value}))
        assert any(isinstance(sample, kind) for sample in samples) is is_taken
        assert len(samples) == 1 + is_taken, "the other one is sound"


@pytest.mark.parametrize(
    ("latitude", "longitude", "is_place"),
    [
        (54.5, -10.25, True),
        (90.0, 180.0, True),
        (-90.0, -180.0, True),
        (90.01, 0.0, False),
        (-90.01, 0.0, False),
        (0.0, 180.01, False),
        (0.0, -180.01, False),
    ],
)
def test_a_position_is_in_radians_and_on_earth(latitude: float, longitude: float, is_place: bool) -> None:
    boat = Boat()
    boat.take(9.0, position(1000, 0.0, 0.0))
    *place, speed, course = boat.take(10.5, position(2000, latitude, longitude, 300, -400))
    assert isinstance(speed, SpeedSample) and isinstance(course, CourseSample)
    assert (course.time, course.course) == (10.0, pytest.approx(math.atan2(-4.0, 3.0)))
    assert (speed.time, speed.speed, speed.over_ground, speed.source) == (10.0, 5.0, True, "global_position_int")
    assert len(place) == is_place
    for each in place:
        assert isinstance(each, PositionSample)
        assert (each.time, each.source) == (10.0, "global_position_int")
        expected = (latitude * math.pi / 180.0, longitude * math.pi / 180.0)
        assert (each.latitude, each.longitude) == pytest.approx(expected, abs=1e-9)


def test_speeds_are_believed_below_two_hundred_metres_a_second() -> None:
    assert len(Boat().take(0.0, position(0, 1.0, 1.0, 19_999, 0))) == 3
    assert len(Boat().take(0.0, position(0, 1.0, 1.0, 20_000, 0))) == 1
    for speed, count in ((0.0, 1), (199.9, 1), (200.0, 0), (-0.1, 0), (math.nan, 0)):
        assert len(Boat().take(5.0, hud(speed))) == count


@pytest.mark.parametrize(("kind", "is_there"), [(0, False), (1, False), (2, True), (3, True), (6, True)])
def test_before_a_fix_in_two_dimensions_there_is_neither_place_nor_speed(kind: int, is_there: bool) -> None:
    boat = Boat()
    boat.fix(kind)
    assert bool(boat.take(0.0, position(0, 1.0, 1.0))) is is_there
    assert bool(boat.take(5.0, hud(3.0))) is is_there


def test_the_vehicle_s_vane_gives_the_apparent_wind_once_its_speed_and_angle_have_come() -> None:
    def named(name: str, value: float) -> Any:
        return dialect.MAVLink_named_value_float_message(1000, name.encode(), value)

    boat = Boat()
    assert boat.take(1.0, named("AppWndDir", 40.0)) == [] == boat.take(1.1, named("AppWndSpd", 8.0))
    (wind,) = boat.take(1.1, named("AppWndDir", 320.0))
    assert wind == WindSample(1.1, pytest.approx(math.radians(-40.0), abs=1e-6), 8.0, "windvane")
    for speed, angle in ((math.nan, 40.0), (-1.0, 40.0), (8.0, math.nan), (8.0, 400.0)):
        boat.take(2.0, named("AppWndSpd", speed))
        assert boat.take(2.0, named("AppWndDir", angle)) == []


def test_the_lesser_speed_is_used_where_the_better_one_has_been_silent_for_two_seconds() -> None:
    boat = Boat()
    (speed,) = boat.take(1.0, hud(3.5))
    assert speed == SpeedSample(1.0, 3.5, True, "vfr_hud")
    boat.take(2.0, position(0, 1.0, 1.0))
    assert boat.take(4.0, hud(3.5)) == []
    assert len(boat.take(4.1, hud(3.5))) == 1


@pytest.mark.parametrize(
    ("pulse", "degrees"), [(1900, 30.0), (1700, 15.0), (1500, 0.0), (1400, -7.5), (1100, -30.0), (2100, 30.0)]
)
def test_the_steering_servo_s_pulse_is_a_rudder_angle(pulse: int, degrees: float) -> None:
    (rudder,) = Boat(**STEERED).servos(8.0, pulse)
    assert isinstance(rudder, RudderSample)
    assert (rudder.time, rudder.ordered, rudder.source) == (8.0, True, "servo_output_raw")
    assert math.degrees(rudder.angle) == pytest.approx(degrees)


def test_a_servo_without_pulse_or_on_another_port_or_unknown_shows_no_rudder() -> None:
    boat = Boat(**STEERED)
    assert boat.servos(0.0, 0) == []
    assert boat.servos(0.0, 1500, port=1) == []
    assert Boat().servos(0.0, 1500) == []


def test_a_servo_s_microseconds_begin_again_every_71_minutes() -> None:
    boat = Boat(**STEERED)
    wrap_s = 4294.967296
    boat.take(0.0, attitude(0))
    for turn in range(4):
        now = turn * wrap_s + 10.0
        boat.take(now, attitude(int(now * 1000.0)))
        (rudder,) = boat.servos(now, 1500, time_usec=9_900_000)
        assert rudder.time == pytest.approx(now - 0.1, abs=2e-3)
    (rudder,) = boat.servos(now, 1500, time_usec=12_000_000)
    assert rudder.time == now, "nothing is measured in the future"


@pytest.mark.parametrize(("pulse", "is_off"), [(0, False), (1, True), (900, True), (1199, True), (1200, False)])
def test_the_override_switch_is_off_in_its_low_position(pulse: int, is_off: bool) -> None:
    boat = Boat(RC7_OPTION=46.0, **STEERED)
    boat.channels(0.0, chan7_raw=pulse)
    assert boat.reader.authority.switched_off is is_off


@pytest.mark.parametrize("nothing", [0, 65535])
def test_the_proof_leaves_the_rudder_amidships_where_no_stick_is_shown(nothing: int) -> None:
    boat = Boat(**STEERED)
    boat.channels(0.0, chan1_raw=nothing)
    assert boat.reader.lacks_receiver
    message = boat.reader.probe.due(0.1)
    assert message is not None and abs(message.chan1_raw - 1500) <= 40, "it took 65535 us for a stick hard over"


def test_a_vehicle_that_never_showed_a_pulse_has_no_receiver() -> None:
    boat = Boat(**STEERED)
    boat.channels(0.0)
    assert not boat.reader.lacks_receiver
    boat.channels(0.1, chan1_raw=0)
    assert boat.reader.lacks_receiver
    boat.channels(0.2)
    assert not boat.reader.lacks_receiver, "nothing was ordered: that is a stick"
    boat.channels(0.3, chan1_raw=0)
    boat.reader.release.ordered(0.35, 1520)
    boat.channels(0.4, chan1_raw=1520)
    assert boat.reader.lacks_receiver, "it shows our own order"


@pytest.mark.parametrize(
    ("pulse", "asks"), [(1500, False), (1470, False), (1530, False), (1469, True), (1531, True), (0, False)]
)
def test_a_throttle_stick_asks_for_way_outside_its_dead_zone(pulse: int, asks: bool) -> None:
    boat = Boat(guided=True, **STEERED)
    boat.channels(0.0, chan3_raw=pulse)
    assert boat.reader.guided is not None
    assert boat.reader.guided._shown.stick_asks is None, "its calibration has not come"
    for name, value in {"RC3_TRIM": 1500.0, "RC3_DZ": 30.0}.items():
        boat.take(0.0, dialect.MAVLink_param_value_message(name.encode(), value, 9, 1, 0))
    boat.channels(0.1, chan3_raw=pulse)
    assert boat.reader.guided._shown.stick_asks is asks


def test_a_vehicle_that_fills_in_no_time_is_read_as_it_arrives_and_has_not_rebooted() -> None:
    boat = Boat(**STEERED)
    boat.heartbeat(0.0)
    boat.take(0.0, position(300_000, 0.5, 0.5))
    for step in range(1, 100):
        now = 0.1 * step
        heading = boat.take(now, attitude(0))[0]
        assert isinstance(heading, HeadingSample) and heading.time == now
        (shown,) = boat.servos(now, 1500)
        assert isinstance(shown, RudderSample) and shown.time == now
        boat.heartbeat(now)
    assert boat.reader.parameters.steering_servo == 3, "nothing is asked anew"
    assert boat.reader.authority.armed


def test_headings_that_come_late_by_the_vehicle_s_clock_are_an_alarm_with_what_to_do() -> None:
    output = SteeringOutput("rc_override", math.radians(30.0), False)
    reader = VehicleReader(output, CompanionSettings(math.radians(30.0), heading_timeout=1.5))
    said, ages = [], []
    for step in range(1200):
        now = 0.05 * step
        message = MavlinkCodec(1, 1).encode(attitude(round(1000.0 * (100.0 + 0.9 * now))))
        (received,) = MavlinkCodec(1, 0).decode(message)
        samples: list[Sample] = []
        reader.take(now, received, samples)
        reader.streams.due(now)
        ages.append(now - samples[0].time)
        said.append(reader.streams.late)
    assert max(ages) > 1.5, "the fail-safe comes"
    first = next(event for event in said if event)
    assert ages[said.index(first)] < 1.5, "and the alarm before it"
    assert first.name == "headings_late" and "clock runs slow" in sentence_of(first)
    for step in range(1200, 2400):  # right again
        now = 0.05 * step
        (received,) = MavlinkCodec(1, 0).decode(MavlinkCodec(1, 1).encode(attitude(round(1000.0 * (94.0 + now)))))
        reader.take(now, received, [])
        reader.streams.due(now)
    assert reader.streams.late is None


@pytest.mark.parametrize("silence", [10.0, 10.1])
def test_a_vehicle_back_after_ten_seconds_is_asked_for_its_parameters_anew(silence: float) -> None:
    boat = Boat(**STEERED)
    boat.heartbeat(0.0)
    boat.take(0.0, attitude(0))
    boat.heartbeat(silence)
    assert (boat.reader.parameters.steering_servo is None) is (silence > 10.0)
    assert (boat.output.channel is None) is (silence > 10.0)


def test_a_stick_that_clears_our_overrides_takes_the_helm_by_the_firmware_s_words() -> None:
    boat = Boat()
    boat.take(0.0, dialect.MAVLink_statustext_message(4, b"RC overrides cleared by pilot"))
    assert not boat.reader.authority.disobeyed
    boat.take(0.0, dialect.MAVLink_statustext_message(4, b"RC overrides cleared by pilot input (ch 1)"))
    assert boat.reader.authority.disobeyed.startswith("the stick was moved: the helm is yours")


@pytest.mark.parametrize(
    ("mode", "armed", "throttle", "ran", "runs"),
    [(0, True, 30, True, False), (0, False, 30, False, False), (0, True, 0, False, False), (15, True, 30, False, True)],
)
def test_the_engine_runs_where_the_boat_is_armed_and_has_throttle(
    mode: int, armed: bool, throttle: int, ran: bool, runs: bool
) -> None:
    boat = Boat(guided=True, **STEERED)
    boat.heartbeat(0.0, mode, armed)
    boat.take(1.0, hud(2.0, throttle))
    assert boat.reader.guided is not None
    shown = boat.reader.guided._shown
    assert (shown.has_servo, shown.ran_time == 1.0, shown.runs) == (True, ran, runs)


@pytest.mark.parametrize(("later", "counts"), [(1.0, False), (1.001, True)])
def test_the_servo_shows_a_release_where_the_input_has_been_silent_for_a_second(later: float, counts: bool) -> None:
    boat, shown = Boat(**STEERED), []
    boat.channels(0.0)
    boat.reader.release.report = lambda now, pulse, name, *_: shown.append((now, name))  # type: ignore[method-assign]
    boat.servos(later, 1500)
    assert shown == ([(later, "SERVO_OUTPUT_RAW")] if counts else [])


def test_a_report_of_the_input_that_was_overtaken_on_its_way_accuses_nobody() -> None:
    boat = Boat(**STEERED)
    probe = boat.reader.probe
    boat.channels(1.0, 1000)
    assert probe.due(1.0) is not None
    boat.channels(1.1, 1100, chan1_raw=probe.pulse)
    for late in (1050, 1060, 1070):
        boat.channels(1.15, late)
    assert "another pilot" not in probe.reason
    boat.channels(1.2, 1200, chan1_raw=probe.pulse)
    boat.channels(1.3, 1300, chan1_raw=probe.pulse)
    boat.channels(1.4, 1400)
    assert "another pilot" in probe.reason
    boat.channels(9.0, 4_000_000_000, chan1_raw=1700)
    boat.channels(9.1, 100, chan1_raw=1710)
    boat.channels(9.1, 50, chan1_raw=1720)
    assert probe._reported == 1710, "its clock began anew"


def test_a_servo_report_that_was_overtaken_accuses_no_bow_thruster() -> None:
    output = SteeringOutput("rc_override", math.radians(30.0), False)
    reader = VehicleReader(output, CompanionSettings(math.radians(30.0), bow_channel=9))
    assert reader.bow is not None
    reader.bow.output, shown = 5, []
    reader.bow.report_output = lambda now, pulse: shown.append(pulse)  # type: ignore[method-assign]
    for time_usec, pulse in ((2_000_000, 1700), (1_900_000, 1500), (2_100_000, 1710)):
        message = dialect.MAVLink_servo_output_raw_message(time_usec, 0, 0, 0, 0, 0, pulse, 0, 0, 0)
        (received,) = MavlinkCodec(1, 0).decode(MavlinkCodec(1, 1).encode(message))
        reader.take(5.0, received, [])
    assert shown == [1700, 1710]


def test_headings_that_are_late_by_a_clock_a_little_slow_are_said_once() -> None:
    output = SteeringOutput("rc_override", math.radians(30.0), False)
    reader = VehicleReader(output, CompanionSettings(math.radians(30.0), heading_timeout=1.0))
    said: list[bool] = []
    for step in range(2400):
        now = 0.05 * step
        (received,) = MavlinkCodec(1, 0).decode(MavlinkCodec(1, 1).encode(attitude(round(1000.0 * (9.0 + 0.95 * now)))))
        reader.take(now, received, [])
        reader.streams.due(now)
        said.append(reader.streams.late is not None)
    assert sum(before != after for before, after in pairwise(said)) == 1 and said[-1]
