"""The simulated flight controller does what an ArduRover boat does towards a companion."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from sitl.firmware_parameters import ParameterTable, default_parameters

MakeBench = Callable[..., Any]


def test_override_moves_the_rudder_through_the_dead_zone(bench: MakeBench) -> None:
    boat = bench()
    boat.override(1560)
    boat.run(0.1)
    assert boat.steering_pulse == 1531
    assert boat.last("HEARTBEAT").custom_mode == 0
    boat.override(2000)
    boat.run(2.5)
    assert math.degrees(boat.world.boat.state.rudder) == pytest.approx(30.0, abs=0.01)
    assert boat.world.boat.state.rate > 0.0


@pytest.mark.parametrize("system", [1, 2, 254])
def test_overrides_of_anyone_but_the_ground_station_are_ignored_in_silence(bench: MakeBench, system: int) -> None:
    boat = bench(system=system)
    boat.run(0.1)
    boat.forget()
    boat.override(1900)
    boat.send(dialect.MAVLink_manual_control_message(1, 32767, 900, 32767, 32767, 0))
    boat.run(0.5)
    assert boat.steering_pulse == 1500
    assert not boat.of("STATUSTEXT")
    boat.parameter_set("SYSID_MYGCS", system)
    boat.override(1900)
    boat.run(0.1)
    assert boat.steering_pulse > 1850


def test_override_holds_for_its_time_and_then_the_stick_has_the_rudder(bench: MakeBench) -> None:
    boat = bench()
    boat.override(1900)
    boat.run(2.95)
    assert boat.steering_pulse == 1893
    boat.run(0.1)
    assert boat.steering_pulse == 1500


def test_leave_alone_does_not_refresh_an_override(bench: MakeBench) -> None:
    boat = bench()
    boat.override(1900)
    for _ in range(31):
        boat.run(0.1)
        boat.override(65535)
    boat.run(0.05)
    assert boat.steering_pulse == 1500


def test_zero_releases_at_once(bench: MakeBench) -> None:
    boat = bench()
    boat.override(1900)
    boat.run(0.2)
    boat.override(0)
    boat.run(0.05)
    assert boat.steering_pulse == 1500


def test_the_radio_s_override_switch_gives_the_stick_the_rudder(bench: MakeBench) -> None:
    boat = bench()
    boat.parameter_set("RC7_OPTION", 46)
    boat.override(1900)
    boat.run(0.2)
    assert boat.steering_pulse == 1893
    boat.firmware.sticks[6] = 1000
    boat.override(1900)
    boat.run(0.2)
    assert boat.steering_pulse == 1500
    boat.firmware.sticks[6] = 1900
    boat.override(1900)
    boat.run(0.2)
    assert boat.steering_pulse == 1893


def test_override_time_is_the_parameter(bench: MakeBench) -> None:
    boat = bench()
    boat.parameter_set("RC_OVERRIDE_TIME", 1.0)
    boat.override(1900)
    boat.run(0.9)
    assert boat.steering_pulse > 1500
    boat.run(0.2)
    assert boat.steering_pulse == 1500


def test_channels_beyond_eight_have_other_special_values(bench: MakeBench) -> None:
    boat = bench()
    alone = [65535] * 8
    boat.send(dialect.MAVLink_rc_channels_override_message(1, 1, *alone, 1700))
    boat.run(0.05)
    assert boat.firmware.channels[8] == 1700
    boat.send(dialect.MAVLink_rc_channels_override_message(1, 1, *alone, 0))
    boat.run(0.05)
    assert boat.firmware.channels[8] == 1700, "zero leaves channels 9 and up alone"
    boat.send(dialect.MAVLink_rc_channels_override_message(1, 1, *alone, 65534))
    boat.run(0.05)
    assert boat.firmware.channels[8] == 1500


def test_without_a_receiver_outputs_go_neutral_and_then_hold(bench: MakeBench) -> None:
    boat = bench(vehicle={"receiver": False})
    for _ in range(20):
        boat.override(1900)
        boat.run(0.1)
    assert boat.steering_pulse == 1893
    boat.run(0.35)
    assert boat.steering_pulse == 1893, "the last override stays applied"
    boat.run(0.2)
    assert boat.steering_pulse == 1500, "neutral after half a second"
    assert boat.last("HEARTBEAT").custom_mode == 0
    boat.run(2.5)
    assert boat.last("HEARTBEAT").custom_mode == 4, "and HOLD after FS_TIMEOUT"
    assert boat.last("HEARTBEAT").system_status == dialect.MAV_STATE_CRITICAL
    assert "Radio Failsafe" in [message.text for message in boat.of("STATUSTEXT")]


def test_manual_control_steers_and_leaves_the_throttle(bench: MakeBench) -> None:
    boat = bench()
    boat.send(dialect.MAVLink_manual_control_message(1, 32767, 500, 32767, 32767, 0))
    boat.run(0.1)
    assert boat.firmware.channels[0] == 1750
    assert boat.steering_pulse == 1500 + (4500 * 220 // 470) * 500 // 4500
    assert boat.firmware.throttle == 50
    boat.send(dialect.MAVLink_manual_control_message(1, 32767, 32767, 32767, 32767, 0))
    boat.run(0.05)
    assert boat.steering_pulse == 1500


def test_manual_control_for_another_vehicle_is_not_ours(bench: MakeBench) -> None:
    boat = bench()
    boat.send(dialect.MAVLink_manual_control_message(7, 32767, 500, 32767, 32767, 0))
    boat.run(0.1)
    assert boat.steering_pulse == 1500


@pytest.mark.parametrize("mode", [4, 15])
def test_in_hold_and_guided_an_override_moves_nothing_and_the_boat_stops(bench: MakeBench, mode: int) -> None:
    boat = bench()
    boat.override(1900)
    boat.run(0.2)
    assert boat.command(dialect.MAV_CMD_DO_SET_MODE, 1, mode).result == dialect.MAV_RESULT_ACCEPTED
    for _ in range(100):
        boat.override(1900)
        boat.run(0.1)
    assert boat.steering_pulse == 1500
    assert boat.last("RC_CHANNELS").chan1_raw == 1900
    assert boat.world.boat.state.speed < 1.0


def test_set_mode_message_changes_the_mode_and_is_acknowledged(bench: MakeBench) -> None:
    boat = bench()
    boat.send(dialect.MAVLink_set_mode_message(1, 1, 4))
    boat.run(1.0)
    assert (boat.last("COMMAND_ACK").command, boat.last("COMMAND_ACK").result) == (11, 0)
    assert boat.last("HEARTBEAT").custom_mode == 4
    boat.send(dialect.MAVLink_set_mode_message(1, 1, 99))
    boat.run(0.1)
    assert boat.last("COMMAND_ACK").result == dialect.MAV_RESULT_FAILED


def test_disarming_stops_the_engine_and_arming_starts_it(bench: MakeBench) -> None:
    boat = bench()
    assert boat.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0).result == 0
    boat.run(1.0)
    assert not boat.last("HEARTBEAT").base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED
    assert boat.last("SERVO_OUTPUT_RAW").servo3_raw == 1500
    boat.override(1900)
    boat.run(0.1)
    assert boat.steering_pulse == 1893, "ArduRover lets the steering move while disarmed"
    assert boat.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1).result == 0
    boat.run(1.0)
    assert boat.last("HEARTBEAT").base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED
    assert boat.last("SERVO_OUTPUT_RAW").servo3_raw == 1750


def test_throttle_override_changes_the_speed(bench: MakeBench) -> None:
    boat = bench()
    for _ in range(300):
        boat.send(dialect.MAVLink_rc_channels_override_message(1, 1, 65535, 65535, 2000, *[65535] * 5))
        boat.run(0.1, step=0.1)
    assert boat.world.boat.state.speed == pytest.approx(2.0 * boat.world.cruise_speed, rel=0.01)


def test_without_station_heartbeats_the_firmware_changes_to_hold(bench: MakeBench) -> None:
    boat = bench()
    boat.parameter_set("FS_GCS_ENABLE", 1)
    boat.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
    boat.run(6.0)
    assert boat.last("HEARTBEAT").custom_mode == 0
    boat.run(2.0)
    assert boat.last("HEARTBEAT").custom_mode == 4


def test_boot_takes_its_time_and_position_comes_later(bench: MakeBench) -> None:
    boat = bench(vehicle={"boot_s": 2.0, "position_after_s": 5.0})
    boat.run(1.5)
    assert boat.last("HEARTBEAT").system_status == dialect.MAV_STATE_CALIBRATING
    assert boat.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1).result == dialect.MAV_RESULT_FAILED
    boat.run(2.0)
    assert boat.last("HEARTBEAT").system_status == dialect.MAV_STATE_ACTIVE
    assert boat.of("ATTITUDE"), "heading comes without a position"
    assert not boat.of("GLOBAL_POSITION_INT")
    assert boat.last("GPS_RAW_INT").fix_type == 1
    boat.run(2.5)
    assert boat.of("GLOBAL_POSITION_INT")
    assert boat.last("GPS_RAW_INT").fix_type == 3


def test_reboot_starts_time_again_disarmed(bench: MakeBench) -> None:
    boat = bench()
    boat.run(5.0)
    assert boat.command(dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1).result == dialect.MAV_RESULT_DENIED
    boat.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0)
    assert boat.command(dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1).result == 0
    boat.forget()
    boat.run(1.2)
    assert boat.of("ATTITUDE")[-1].time_boot_ms < 1500
    assert boat.last("HEARTBEAT").base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED == 0


def test_integers_are_cast_and_read_only_values_stay() -> None:
    table = ParameterTable(default_parameters())
    cast = table.set("RC1_TRIM", 1499.6)
    assert cast is not None
    assert cast.value == 1500.0
    held = table.set("RC1_REVERSED", 1000.0)
    assert held is not None
    assert held.value == 127.0
    single = table.set("FS_TIMEOUT", 0.1)
    assert single is not None
    assert single.value == pytest.approx(0.1, rel=1e-7)
    assert single.value != 0.1
    fixed = table.set("BARO1_GND_PRESS", 3.0)
    assert fixed is not None
    assert fixed.value == 101325.0
    assert table.set("NO_SUCH_NAME", 1.0) is None
    not_a_number = table.set("FS_TIMEOUT", math.nan)
    assert not_a_number is not None
    assert not_a_number.value == single.value


def test_parameter_names_fit_and_are_unique() -> None:
    names = [parameter.name for parameter in default_parameters()]
    assert len(set(names)) == len(names)
    assert all(len(name) <= 16 and name.replace("_", "").isalnum() and name.isupper() for name in names)


@pytest.mark.parametrize(
    ("set_to", "throttle", "servo"),
    [
        ({}, 1750, 1733),
        ({"MANUAL_STR_EXPO": 0.5}, 1750, 1651),
        ({"MANUAL_STR_EXPO": 0.96}, 1750, 1733),
        ({"MANUAL_OPTIONS": 1, "MOT_SPD_SCA_BASE": 2.0}, 1750, 1601),
        ({}, 1250, 1733),
        ({"PILOT_STEER_TYPE": 3}, 1750, 1733),
        ({"PILOT_STEER_TYPE": 3}, 1250, 1268),
        ({"RC_OPTIONS": 2}, 1750, 1500),
    ],
)
def test_what_a_stick_becomes_on_its_way_to_the_rudder(
    bench: MakeBench, set_to: dict[str, float], throttle: int, servo: int
) -> None:
    """Source: Rover/mode.cpp, mode_manual.cpp; AP_Math/control.cpp input_expo; AP_MotorsUGV.cpp output_regular."""
    boat = bench()
    for name, value in set_to.items():
        boat.firmware.parameters.set(name, value)
    boat.firmware.sticks[2] = throttle
    boat.override(1749)
    boat.run(0.1)
    assert boat.firmware.servos[0] == pytest.approx(servo, abs=2)


def test_servo_parameters_move_the_servo_but_not_its_linkage(bench: MakeBench) -> None:
    boat = bench()
    boat.parameter_set("SERVO1_REVERSED", 1)
    boat.override(1900)
    boat.run(2.0)
    assert boat.steering_pulse == 1107
    assert math.degrees(boat.world.boat.state.rudder) == pytest.approx(-30.0 * 393 / 500, abs=0.02)


def over(boat: Any, seconds: float, steering: int, rate_s: float = 0.1) -> None:
    """Repeat an override of the steering for so long."""
    for _ in range(round(seconds / rate_s)):
        boat.override(steering)
        boat.run(rate_s)


@pytest.mark.parametrize(("option", "is_armed"), [(0, True), (1, True), (2, False)])
def test_an_override_hard_to_port_at_neutral_throttle_disarms_where_the_rudder_may(
    bench: MakeBench, option: int, is_armed: bool
) -> None:
    boat = bench()
    boat.parameter_set("ARMING_RUDDER", option)
    boat.firmware.sticks[2] = 1500
    over(boat, 1.8, 1000)
    assert boat.firmware.armed
    over(boat, 1.0, 1000)
    assert boat.firmware.armed is is_armed
    assert ("Throttle disarmed" in [message.text for message in boat.of("STATUSTEXT")]) is not is_armed


def test_with_way_on_the_rudder_disarms_nothing_and_a_moment_amidships_begins_anew(bench: MakeBench) -> None:
    boat = bench()
    over(boat, 4.0, 1000)
    assert boat.firmware.armed, "the motor runs"
    boat.firmware.sticks[2] = 1500
    over(boat, 0.2, 1500)
    over(boat, 1.8, 1000)
    over(boat, 0.2, 1500)
    over(boat, 1.8, 1000)
    assert boat.firmware.armed


@pytest.mark.parametrize(("option", "throttle", "is_armed"), [(0, 1500, False), (1, 1500, True), (2, 1800, False)])
def test_an_override_hard_to_starboard_arms_where_the_rudder_may(
    bench: MakeBench, option: int, throttle: int, is_armed: bool
) -> None:
    boat = bench(vehicle={"armed": False})
    boat.parameter_set("ARMING_RUDDER", option)
    boat.firmware.sticks[2] = throttle
    over(boat, 2.5, 2000)
    assert boat.firmware.armed is is_armed


@pytest.mark.parametrize(("version", "ends"), [("4.6", False), ("4.8", True)])
@pytest.mark.parametrize(("stick", "pulse"), [(0, 2000), (2, 1850)])
def test_a_stick_that_moves_ends_overrides_from_4_8_on_where_bit_14_is_set(
    bench: MakeBench, version: str, ends: bool, stick: int, pulse: int
) -> None:
    boat = bench(vehicle={"firmware": version})
    boat.parameter_set("RC_OPTIONS", 32 + (1 << 14))
    boat.parameter_set("RC7_OPTION", 46)
    over(boat, 1.0, 1400)
    boat.firmware.sticks[stick] = pulse
    over(boat, 3.0, 1400)
    boat.firmware.sticks[0], boat.firmware.sticks[2] = 1500, 1750
    over(boat, 1.0, 1400)
    assert boat.firmware.channels[0] == (1500 if ends else 1400), "and they stay ended"
    texts = [message.text for message in boat.of("STATUSTEXT")]
    assert texts.count("RC overrides cleared by pilot input") == ends
    boat.firmware.sticks[6] = 1000
    over(boat, 0.3, 1400)
    boat.firmware.sticks[6] = 2000
    over(boat, 0.3, 1400)
    assert boat.firmware.channels[0] == 1400, "the switch gives them back"


def test_an_overridden_stick_hard_over_is_neither_obeyed_nor_shown(bench: MakeBench) -> None:
    boat = bench()
    over(boat, 1.0, 1500)
    boat.firmware.sticks[0] = 2000
    boat.forget()
    over(boat, 3.0, 1500)
    assert {message.chan1_raw for message in boat.of("RC_CHANNELS")} == {1500}
    assert boat.steering_pulse == 1500


def test_overrides_keep_a_silent_radio_alive_and_the_throttle_where_it_was(bench: MakeBench) -> None:
    boat = bench()
    over(boat, 1.0, 1600)
    boat.firmware.receiver = boat.firmware.has_receiver = False
    boat.forget()
    over(boat, 10.0, 1600)
    assert not boat.of("STATUSTEXT")
    assert boat.last("HEARTBEAT").custom_mode == 0
    assert boat.last("HEARTBEAT").system_status == dialect.MAV_STATE_ACTIVE
    last = boat.last("RC_CHANNELS")
    assert (last.chan1_raw, last.chan3_raw, last.chancount, last.rssi) == (1600, boat.firmware.sticks[2], 16, 255)
    assert not boat.last("SYS_STATUS").onboard_control_sensors_present & dialect.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
    assert boat.firmware.throttle == 50
    boat.override(0)
    boat.run(3.0)
    assert boat.last("HEARTBEAT").custom_mode == 4, "without overrides the fail-safe acts"


def test_a_vehicle_that_is_disarmed_has_no_safety_switch_on(bench: MakeBench) -> None:
    """ArduPilot has its outputs enabled but for that switch, armed or not (libraries/GCS_MAVLink/GCS.cpp)."""
    boat = bench()
    for is_armed in (True, False):
        boat.firmware.set_armed(is_armed)
        boat.forget()
        boat.run(2.0)
        assert boat.firmware.armed is is_armed
        assert boat.last("SYS_STATUS").onboard_control_sensors_enabled & dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS


def test_a_receiver_that_sends_low_throttle_fails_safe_under_overrides_too(bench: MakeBench) -> None:
    boat = bench()
    over(boat, 1.0, 1600)
    boat.firmware.sticks[2] = 900
    over(boat, 0.3, 1600)
    assert boat.steering_pulse == 1500, "neutral at once"
    assert boat.last("HEARTBEAT").custom_mode == 0
    over(boat, 2.0, 1600)
    assert boat.firmware.mode == 4
    assert "Radio Failsafe" in [message.text for message in boat.of("STATUSTEXT")]


@pytest.mark.parametrize(("kind", "lost"), [(0, 255), (1, 0), (3, 200)])
def test_only_an_analogue_rssi_falls_with_the_radio(bench: MakeBench, kind: int, lost: int) -> None:
    boat = bench()
    boat.parameter_set("RSSI_TYPE", kind)
    over(boat, 1.0, 1600)
    assert boat.last("RC_CHANNELS").rssi == (200 if kind else 255)
    boat.firmware.receiver = boat.firmware.has_receiver = False
    over(boat, 1.0, 1600)
    assert boat.last("RC_CHANNELS").rssi == lost


@pytest.mark.parametrize("seen", [True, False])
def test_the_station_s_failsafe_waits_for_a_station_that_was_there(bench: MakeBench, seen: bool) -> None:
    boat = bench()
    boat.parameter_set("FS_GCS_ENABLE", 1)
    boat.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), system=255 if seen else 254)
    boat.run(10.0)
    assert boat.firmware.mode == (4 if seen else 0)
    if seen:
        boat.forget()
        boat.send(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
        boat.run(0.5)
        assert [(message.severity, message.text) for message in boat.of("STATUSTEXT")] == [(6, "GCS Failsafe Cleared")]


def test_servo_end_points_scale_the_rudder_of_a_linkage_that_reads_500_us(bench: MakeBench) -> None:
    boat = bench()
    boat.parameter_set("SERVO1_MIN", 1100)
    boat.parameter_set("SERVO1_MAX", 1900)
    over(boat, 2.5, 2000)
    assert math.degrees(boat.world.boat.state.rudder) == pytest.approx(0.8 * 30.0, abs=0.02)


def test_parameters_that_move_by_themselves(bench: MakeBench) -> None:
    """Ground pressure while disarmed, run time, boots and the gyros' zero; none of them costs a new setup."""
    boat = bench()
    boat.firmware.set_armed(False)
    table = boat.firmware.parameters
    names = ("BARO1_GND_PRESS", "BARO2_GND_PRESS", "STAT_RUNTIME", "STAT_BOOTCNT", "INS_GYROFFS_X", "CRUISE_SPEED")
    before = {name: table[name] for name in names}
    changes = table.changes
    boat.run(22.0)
    assert {name for name in names if table[name] != before[name]} == {
        "BARO1_GND_PRESS",
        "BARO2_GND_PRESS",
        "STAT_RUNTIME",
    }
    assert table.changes == changes
    boat.firmware.reboot(boat.world.time)
    assert table["STAT_BOOTCNT"] == before["STAT_BOOTCNT"] + 1
    assert table["INS_GYROFFS_X"] != before["INS_GYROFFS_X"]


def test_another_format_version_erases_the_board_at_the_next_boot(bench: MakeBench) -> None:
    boat = bench()
    boat.parameter_set("SERVO1_REVERSED", 1)
    boat.parameter_set("FORMAT_VERSION", 0)
    boat.run(0.5)
    assert boat.firmware.parameters["SERVO1_REVERSED"] == 1
    boat.firmware.reboot(boat.world.time)
    assert boat.firmware.parameters["SERVO1_REVERSED"] == 0
    assert boat.firmware.parameters["FORMAT_VERSION"] == 16
