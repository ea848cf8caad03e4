"""What the boat tells ground stations of a tick, message by message and field by field, and when."""

from __future__ import annotations

import math
from typing import Any

import pytest
from alarm_texts import other
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.guidance.track import Leg, TrackGuide, Waypoint
from autopilot.links.ground_station.mission import Mission, MissionItem
from autopilot.links.ground_station.telemetry import Telemetry
from autopilot.signals import (
    AlarmEvent,
    AlarmState,
    Mode,
    NavState,
    Order,
    OrderKind,
    PositionSample,
    Reference,
    RollSample,
    RudderCommand,
    Sample,
    Tick,
)
from autopilot.supervision.alarms import CATALOGUE

ATTITUDE, WHERE, HUD, NAVIGATION, NAMED = 30, 33, 74, 62, 251
CURRENT_MODE, MISSION_CURRENT, STATUS, TIME, VERSION = 436, 42, 1, 2, 148
DEG = math.pi / 180.0
STATE = NavState(0.0, 60.0 * DEG, 0.02, 4.0, 5.0 * DEG, -1.0 * DEG, 0.1, True)
UNKNOWN = STATE._replace(valid=False)
STALE = STATE._replace(heading_age=2.0)
JUST_FRESH = STATE._replace(heading_age=1.99)
STEERED = Order(OrderKind.HEADING, 200.0 * DEG, serial=1)


def tick(
    now: float = 0.0,
    mode: Mode = Mode.ENGAGED,
    order: Order = STEERED,
    state: NavState = STATE,
    samples: tuple[Sample, ...] = (),
) -> Tick:
    command = RudderCommand(now, -7.0 * DEG, mode is Mode.ENGAGED)
    return Tick(1, now, samples, order, state, Reference(-30.0 * DEG), 0.1, command, mode, ())


def telemetry(*ticks: Tick, mission: Mission | None = None) -> Telemetry:
    made = Telemetry(mission or Mission(TrackGuide()))
    for each in ticks:
        made.take(each)
    return made


def fields(message: Any) -> dict[str, Any]:
    return {name: getattr(message, name) for name in message.fieldnames}


def message_of(made: Telemetry, identity: int) -> dict[str, Any]:
    (message,) = made.make(identity)
    assert message.id == identity
    return fields(message)


def named(made: Telemetry) -> dict[str, float]:
    return {message.name: message.value for message in made.make(NAMED)}


def near(**values: float) -> dict[str, Any]:
    return {name: pytest.approx(value, abs=1e-9, nan_ok=True) for name, value in values.items()}


def test_attitude_holds_heading_rate_and_a_roll_that_is_fresh() -> None:
    roll = RollSample(10.0, 0.2, -0.03)
    made = telemetry(tick(8.0), tick(10.5, samples=(roll,)))
    level = {"pitch": 0.0, "yaw": 60.0 * DEG, "pitchspeed": 0.0, "yawspeed": 0.02}
    assert message_of(made, ATTITUDE) == near(time_boot_ms=2500, roll=0.2, rollspeed=-0.03, **level)
    made.take(tick(11.99))
    assert message_of(made, ATTITUDE) == near(time_boot_ms=3990, roll=0.2, rollspeed=-0.03, **level)
    made.take(tick(12.0))
    assert message_of(made, ATTITUDE) == near(time_boot_ms=4000, roll=0.0, rollspeed=0.0, **level)
    made.take(tick(13.0, samples=(RollSample(13.0, -0.1),)))
    assert message_of(made, ATTITUDE) == near(time_boot_ms=5000, roll=-0.1, rollspeed=0.0, **level)


@pytest.mark.parametrize("state", [UNKNOWN, STALE])
def test_without_a_fresh_heading_nothing_is_said_that_holds_one(state: NavState) -> None:
    place = PositionSample(0.0, 0.5, 0.6)
    made = telemetry(tick(state=state, samples=(place,)))
    assert made.make(ATTITUDE) == made.make(WHERE) == made.make(HUD) == []
    assert not message_of(made, STATUS)["onboard_control_sensors_health"] & 0x04
    made.take(tick(state=JUST_FRESH))
    assert len(made.make(ATTITUDE) + made.make(WHERE) + made.make(HUD)) == 3
    assert message_of(made, STATUS)["onboard_control_sensors_health"] & 0x04


def test_before_the_first_tick_and_of_unknown_messages_nothing_is_said() -> None:
    assert telemetry().make(ATTITUDE) == []
    assert telemetry().due(0.0) == []
    assert telemetry(tick()).make(9999) == []


def test_the_position_is_in_tens_of_nanodegrees_with_the_way_along_the_heading() -> None:
    place = PositionSample(10.0, -35.5 * DEG, 18.25 * DEG)
    made = telemetry(tick(8.0), tick(10.0, samples=(place,)))
    assert message_of(made, WHERE) == {
        "time_boot_ms": 2000, "lat": -355000000, "lon": 182500000, "alt": 0, "relative_alt": 0,
        "vx": 200, "vy": 346, "vz": 0, "hdg": 6000,
    }  # fmt: skip
    made.take(tick(15.0))
    assert message_of(made, WHERE)["time_boot_ms"] == 7000
    made.take(tick(15.01))
    assert made.make(WHERE) == [], "older than five seconds"


@pytest.mark.parametrize(
    ("deg", "hundredths", "whole"),
    [(0.0, 0, 0), (359.0, 35900, 359), (359.996, 0, 359), (-90.0, 27000, 270), (12.345, 1234, 12), (179.9, 17990, 179)],
)
def test_headings_are_from_0_to_360(deg: float, hundredths: int, whole: int) -> None:
    state = STATE._replace(heading=deg * DEG)
    made = telemetry(tick(state=state, samples=(PositionSample(0.0, 0.5, 0.6),)))
    assert abs(message_of(made, WHERE)["hdg"] - hundredths) <= (deg == 12.345)
    assert message_of(made, HUD) == near(airspeed=0.0, groundspeed=4.0, heading=whole, throttle=0, alt=0.0, climb=0.0)


def test_the_navigation_output_holds_the_heading_led_to_and_the_one_ordered() -> None:
    nothing = {"nav_roll": 0.0, "nav_pitch": 0.0, "alt_error": 0.0, "aspd_error": 0.0}
    made = telemetry(tick())
    held = near(nav_bearing=-30, target_bearing=-160, wp_dist=0, xtrack_error=0.0, **nothing)
    assert message_of(made, NAVIGATION) == held
    made.take(tick(order=STEERED._replace(heading=math.nan)))
    assert message_of(made, NAVIGATION)["target_bearing"] == -30, "none was named: the one that is held"
    made.take(tick(mode=Mode.OVERRIDE))
    assert made.make(NAVIGATION) == []


def test_the_navigation_output_holds_the_leg_while_it_is_followed() -> None:
    mission = Mission(TrackGuide())
    guide = mission.guide
    made = telemetry(tick(), mission=mission)
    leg = Leg(*(0.0 for _ in Leg._fields))._replace(target=100.0 * DEG, distance=1234.6, cross_track=-3.5)
    guide.leg = leg
    assert message_of(made, NAVIGATION)["wp_dist"] == 0, "nothing is followed"
    guide.follow([Waypoint(0.1, 0.1)])
    guide.leg = leg
    said = message_of(made, NAVIGATION)
    assert (said["nav_bearing"], said["target_bearing"]) == (-30, 100)
    assert (said["wp_dist"], said["xtrack_error"]) == (1235, -3.5)
    guide.leg = leg._replace(distance=1.0e6)
    assert message_of(made, NAVIGATION)["wp_dist"] == 65535


def test_the_named_values_are_degrees_of_rudder_order_and_bias_and_compass_degrees() -> None:
    values = named(telemetry(tick()))
    assert {name: values[name] for name in ("rud_deg", "rudcmd_deg", "bias_deg", "ref_deg", "ord_deg")} == near(
        rud_deg=5.0, rudcmd_deg=-7.0, bias_deg=-1.0, ref_deg=330.0, ord_deg=200.0
    )
    for each in (tick(mode=Mode.STANDBY), tick(order=Order(OrderKind.RUDDER, 1.0))):
        values = named(telemetry(each))
        assert math.isnan(values["ref_deg"]) and math.isnan(values["ord_deg"])
        assert math.isnan(values["rudcmd_deg"]) is (each.mode is Mode.STANDBY)
    assert named(telemetry(tick(order=STEERED._replace(heading=math.nan))))["ord_deg"] == pytest.approx(330.0)


def test_how_the_loop_kept_time_is_counted_anew_each_time() -> None:
    made = telemetry(tick(10.0))
    assert math.isnan(named(made)["ticks_hz"]), "no time has passed"
    for now in (10.25, 10.75, 11.0):
        made.take(tick(now, state=STATE._replace(heading_age=0.125)))
    values = named(made)
    assert (values["ticks_hz"], values["gap_ms"], values["hdg_age_ms"]) == (3.0, 500.0, 125.0)
    made.take(tick(11.125))
    values = named(made)
    assert (values["ticks_hz"], values["gap_ms"]) == (8.0, 125.0)
    assert (values["alarms"], values["alarms_new"], values["magnetic"]) == (0.0, 0.0, 0.0)


def test_the_first_count_begins_with_the_first_tick() -> None:
    made = telemetry(tick(10.0), tick(10.5), tick(11.0))
    assert named(made)["ticks_hz"] == 3.0
    assert named(telemetry(tick(0.0)))["gap_ms"] == 0.0


def test_alarms_are_counted_and_those_that_sound() -> None:
    alarm_states = (
        AlarmState.SOUNDING,
        AlarmState.NOTICE,
        AlarmState.ACKNOWLEDGED,
        AlarmState.SOUNDING,
        AlarmState.NOTICE,
    )
    made = telemetry(tick()._replace(alarms=tuple(map(other, "abcde")), alarm_states=alarm_states))
    values = named(made)
    assert (values["alarms"], values["alarms_new"]) == (5.0, 2.0)


class Learner:
    level = 6.0

    def learnt(self) -> dict[str, float]:
        return {"k": 0.5}


def test_what_was_learnt_is_reported_every_two_seconds() -> None:
    made = Telemetry(Mission(TrackGuide()), Learner())  # type: ignore[arg-type]
    when = []
    for step in range(12):
        made.take(tick(step * 0.5))
        values = named(made)
        if "level" in values:
            assert (values["level"], values["k"]) == (6.0, 0.5)
            when.append(step * 0.5)
        assert len(values) == (14 if "level" in values else 12)
    assert when == [0.0, 2.0, 4.0]


def test_every_kind_leaves_at_its_rate_and_no_more_often() -> None:
    made = telemetry(tick(samples=(PositionSample(0.0, 0.5, 0.6),)))
    counts: dict[int, int] = {}
    for step in range(160):
        if step % 32 == 0:
            made.take(tick(step / 32.0, samples=(PositionSample(step / 32.0, 0.5, 0.6),)))
        for message in made.due(step / 32.0):
            counts[message.id] = counts.get(message.id, 0) + 1
    # over five seconds
    assert counts == {
        ATTITUDE: 20, WHERE: 10, HUD: 10, NAVIGATION: 10, NAMED: 10 * 12, MISSION_CURRENT: 5, CURRENT_MODE: 3,
        STATUS: 5, TIME: 3,
    }  # fmt: skip


def times(made: Telemetry, identity: int, begin: int, count: int = 200) -> list[int]:
    return [
        step for step in range(begin, begin + count) if any(m.id == identity for m in made.due(step / 100.0))
    ]  # hundredths of a second


def test_an_interval_is_in_microseconds_0_is_the_usual_and_minus_1_none() -> None:
    made = telemetry(tick())
    assert made.set_interval(ATTITUDE, 500_000.0) == 0
    assert times(made, ATTITUDE, 0) == [0, 50, 100, 150]
    assert made.set_interval(ATTITUDE, 1.0) == 0
    assert times(made, ATTITUDE, 200, 9) == [200, 202, 204, 206, 208], "fifty a second at most"
    assert made.set_interval(ATTITUDE, 0.0) == 0
    assert times(made, ATTITUDE, 300, 100) == [300, 325, 350, 375]
    assert made.set_interval(ATTITUDE, -1.0) == 0
    assert times(made, ATTITUDE, 400) == []
    assert made.set_interval(ATTITUDE, -1.0) == 0, "again"
    for refused in (-2.0, -0.5, math.nan, math.inf):
        assert made.set_interval(ATTITUDE, refused) == 2
    assert times(made, ATTITUDE, 600) == []
    assert made.set_interval(9999, -1.0) == made.set_interval(9999, 1.0e6) == 3
    assert times(made, VERSION, 800) == [], "unasked"
    assert made.set_interval(VERSION, 0.0) == 0
    assert times(made, VERSION, 1000) == [1000, 1100]


def test_who_was_late_does_not_make_up_for_it() -> None:
    made = telemetry(tick())
    assert times(made, ATTITUDE, 0, 1) == [0]
    assert times(made, ATTITUDE, 30, 41) == [30, 50], "in step with the beginning"
    assert times(made, ATTITUDE, 1000, 60) == [1000, 1025, 1050], "or from now on"


ILLS = {
    0x0400: ("rate_disagrees", "innovation", "low_speed"),
    0x1000: ("off_course", "rudder_at_stop"),
    0x8000: ("rudder_stuck", "rudder_not_following", "rudder_reversed", "runaway"),
    0x200000: (
        "heading_lost",
        "heading_frozen",
        "heading_jumping",
        "compass_jumped",
        "heading_disagrees",
        "attitude_unhealthy",
        "compass_doubtful",
    ),
    0x1000000: ("disk_full",),
    0x100000: ("geofence", "shallow"),
    0x2000000: ("battery_low",),
}


def test_the_status_says_which_part_is_ill() -> None:
    every = 0x04 | sum(ILLS)
    made = telemetry(tick())
    assert message_of(made, STATUS) == {
        "onboard_control_sensors_present": every, "onboard_control_sensors_enabled": every,
        "onboard_control_sensors_health": every, "load": 0, "voltage_battery": 65535, "current_battery": -1,
        "battery_remaining": -1, "drop_rate_comm": 0, "errors_comm": 0, "errors_count1": 0, "errors_count2": 0,
        "errors_count3": 0, "errors_count4": 0, "onboard_control_sensors_present_extended": 0,
        "onboard_control_sensors_enabled_extended": 0, "onboard_control_sensors_health_extended": 0,
    }  # fmt: skip


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_each_alarm_makes_its_part_ill_and_no_other(name: str) -> None:
    ill = sum(bit for bit, names in ILLS.items() if name in names)
    for event in (AlarmEvent(name), AlarmEvent(name, is_escalated=True)):
        made = telemetry(tick()._replace(alarms=(other("something in its own words"), event)))
        said = message_of(made, STATUS)
        assert said["onboard_control_sensors_enabled"] - said["onboard_control_sensors_health"] == ill


def test_the_time_since_boot_begins_with_the_first_tick() -> None:
    made = telemetry(tick(100.0), tick(103.5))
    assert message_of(made, TIME) == {"time_unix_usec": 0, "time_boot_ms": 3500}
    made.take(tick(100.0 + 2**32 / 1000.0 + 1.0))
    assert message_of(made, TIME)["time_boot_ms"] == 1000, "thirty-two bits, as MAVLink has it"


def test_the_modes_standard_and_ours() -> None:
    mission = Mission(TrackGuide(), (MissionItem(3, 16, (0.0, 0.0, 0.0, 0.0), 10, 10, 0.0),))
    made = telemetry(tick(), mission=mission)
    for given, number, standard in (
        (tick(), 15, 0),
        (tick(mode=Mode.STANDBY), 0, 0),
        (tick(mode=Mode.FAILSAFE), 0, 0),
        (tick(order=Order(OrderKind.RUDDER)), 3, 0),
    ):
        made.take(given)
        assert message_of(made, CURRENT_MODE) == {
            "standard_mode": standard, "custom_mode": number, "intended_custom_mode": number,
        }  # fmt: skip
    mission.follow()
    made.take(tick())
    assert message_of(made, CURRENT_MODE) == {"standard_mode": 6, "custom_mode": 10, "intended_custom_mode": 10}


def test_the_version_says_what_we_can_do() -> None:
    made = telemetry(tick())
    said = message_of(made, VERSION)
    # MAVLink 2, float parameters, COMMAND_INT, missions of both kinds, FTP
    assert said["capabilities"] == 0x2000 | 0x02 | 0x08 | 0x04 | 0x01 | 0x20
    assert said["flight_sw_version"] == 0x00020000
    assert (said["vendor_id"], said["product_id"], said["uid"]) == (0, 0, 1)
    assert said["middleware_sw_version"] == said["os_sw_version"] == said["board_version"] == 0
    assert said["flight_custom_version"] == said["middleware_custom_version"] == said["os_custom_version"] == [0] * 8


def test_the_mission_is_reported_as_followed_or_suspended() -> None:
    mission = Mission(TrackGuide(), (MissionItem(3, 16, (0.0, 0.0, 0.0, 0.0), 10, 10, 0.0),))
    made = telemetry(tick(), mission=mission)
    said = message_of(made, MISSION_CURRENT)
    assert (said["seq"], said["total"], said["mission_state"], said["mission_mode"]) == (
        0, 1, dialect.MISSION_STATE_NOT_STARTED, 2,
    )  # fmt: skip
    mission.follow()
    said = message_of(made, MISSION_CURRENT)
    assert (said["mission_state"], said["mission_mode"]) == (dialect.MISSION_STATE_ACTIVE, 1)
