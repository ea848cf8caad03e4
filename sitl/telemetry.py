"""What the simulated flight controller reports, message by message, in each field's own unit and sign.

The field meanings are written out here, from the MAVLink message definitions (common.xml), and not taken from
the side that reads them.

Which messages leave one port, and when: ArduPilot's stream groups and message intervals.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.angles import wrap
from sitl.fault_table import battery_mv
from sitl.firmware import Firmware, FirmwareMode
from sitl.firmware_parameters import ParameterTable
from sitl.sensors import Reading

UNKNOWN_HEADING = 65535
FULL_PERCENT = 90.0
"""What SYS_STATUS says of a battery that nothing ails."""
OFFICIAL = 255
RSSI_UNKNOWN, RSSI_GOOD = 255, 200
RSSI_ANALOGUE = 1
"""RSSI_TYPE of a voltage that falls with the radio; what comes in a receiver's frames stays as the last one had it."""


def boot_ms(firmware: Firmware, time: float) -> int:
    """Milliseconds since the firmware started, as 32 bits hold them."""
    return round(firmware.time_since_boot(time) * 1000.0) & 0xFFFFFFFF


def heartbeat(firmware: Firmware) -> Any:
    """HEARTBEAT of a surface boat."""
    base_mode = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
    if firmware.mode is FirmwareMode.MANUAL:
        base_mode |= dialect.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
    if firmware.mode is FirmwareMode.GUIDED:
        base_mode |= dialect.MAV_MODE_FLAG_GUIDED_ENABLED
    if firmware.armed:
        base_mode |= dialect.MAV_MODE_FLAG_SAFETY_ARMED
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_SURFACE_BOAT,
        firmware.autopilot,
        base_mode,
        firmware.custom_mode,
        _state(firmware),
        3,
    )


def _state(firmware: Firmware) -> int:
    if firmware.mode is FirmwareMode.INITIALISING:
        return int(dialect.MAV_STATE_CALIBRATING)
    if firmware.failsafe:
        return int(dialect.MAV_STATE_CRITICAL)
    if firmware.mode is FirmwareMode.HOLD:
        return int(dialect.MAV_STATE_STANDBY)
    return int(dialect.MAV_STATE_ACTIVE)


def attitude(firmware: Firmware, time: float, reading: Reading) -> Any:
    """ATTITUDE: radians, yaw in (-pi, pi]; stamped with the time of measurement."""
    yaw = wrap(reading.heading)
    for fault, effect in firmware.world.faults.acting("attitude", time):
        yaw = effect(fault, yaw)
    return dialect.MAVLink_attitude_message(
        boot_ms(firmware, reading.time),
        reading.roll,
        0.0,
        yaw,
        reading.roll_rate,
        0.0,
        reading.rate,
    )


def global_position(firmware: Firmware, time: float, reading: Reading) -> Any | None:
    """GLOBAL_POSITION_INT: degrees x 1e7, mm, cm/s north, east, down, heading in hundredths of a degree."""
    if not firmware.has_position(time):
        return None
    has_heading = firmware.world.sensors.has_heading(time)
    return dialect.MAVLink_global_position_int_message(
        boot_ms(firmware, reading.time),
        round(reading.latitude * 1.0e7),
        round(reading.longitude * 1.0e7),
        0,
        0,
        _int16(reading.north_speed * 100.0),
        _int16(reading.east_speed * 100.0),
        0,
        round(math.degrees(reading.heading) * 100.0) % 36000 if has_heading else UNKNOWN_HEADING,
    )


def vfr_hud(firmware: Firmware, time: float, reading: Reading) -> Any | None:
    """VFR_HUD: ground speed in m/s, heading in whole degrees, throttle in per cent; a boat has no airspeed."""
    if not firmware.world.sensors.has_heading(time):
        return None
    return dialect.MAVLink_vfr_hud_message(
        0.0,
        reading.ground_speed if firmware.has_position(time) else 0.0,
        round(math.degrees(reading.heading)) % 360,
        abs(firmware.throttle),
        0.0,
        0.0,
    )


def gps_raw(firmware: Firmware, time: float, reading: Reading) -> Any:
    """GPS_RAW_INT: time in us since boot, degrees x 1e7, mm, cm/s, course in hundredths of a degree."""
    has_fix = firmware.has_position(time)
    return dialect.MAVLink_gps_raw_int_message(
        round(firmware.time_since_boot(reading.time) * 1.0e6),
        3 if has_fix else 1,
        round(reading.latitude * 1.0e7) if has_fix else 0,
        round(reading.longitude * 1.0e7) if has_fix else 0,
        0,
        121 if has_fix else 65535,
        200 if has_fix else 65535,
        min(round(reading.ground_speed * 100.0), 65534) if has_fix else 65535,
        round(math.degrees(reading.course) * 100.0) % 36000 if has_fix else 65535,
        10 if has_fix else 0,
    )


def local_position(firmware: Firmware, time: float, reading: Reading) -> Any | None:
    """LOCAL_POSITION_NED: metres from the start, m/s."""
    if not firmware.has_position(time):
        return None
    state = firmware.world.boat.state
    return dialect.MAVLink_local_position_ned_message(
        boot_ms(firmware, reading.time),
        state.north,
        state.east,
        0.0,
        reading.north_speed,
        reading.east_speed,
        0.0,
    )


def navigation(firmware: Firmware, time: float, reading: Reading) -> Any | None:
    """NAV_CONTROLLER_OUTPUT: bearings in whole degrees, speed error in m/s.

    Sent in the modes in which the firmware steers by itself. While it holds a heading and a speed in GUIDED all but the
    speed error is 0, whatever the target (Rover/mode_guided.cpp up to 4.7); a boat that loiters shows its bearing.
    """
    if firmware.mode is not FirmwareMode.GUIDED or firmware.autopilot != dialect.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return None
    wanted = firmware.throttle / 100.0 * firmware.guided.fastest(firmware.setup.guided)
    bearing, target = firmware.guided.bearings_deg(firmware.version)
    return dialect.MAVLink_nav_controller_output_message(
        0.0, 0.0, bearing, target, 0, 0.0, wanted - firmware.world.boat.state.speed, 0.0
    )


def servo_outputs(firmware: Firmware, time: float, reading: Reading) -> Any:
    """SERVO_OUTPUT_RAW: pulse widths in us, 0 where no pulses go out."""
    return dialect.MAVLink_servo_output_raw_message(
        round(firmware.time_since_boot(time) * 1.0e6) & 0xFFFFFFFF, 0, *firmware.servos
    )


def rc_channels(firmware: Firmware, time: float, reading: Reading) -> Any:
    """RC_CHANNELS: pulse widths in us as the firmware uses them, overrides included: a stick behind one is not seen.

    The count of channels is that of the receiver's last frame, and stays when frames stay away.
    """
    count = 16 if firmware.has_received_radio else 0
    return dialect.MAVLink_rc_channels_message(
        boot_ms(firmware, time), count, *firmware.channels, 0, 0, _rssi(firmware)
    )


def _rssi(firmware: Firmware) -> int:
    kind = firmware.parameters["RSSI_TYPE"]
    if kind == 0 or not firmware.has_received_radio:
        return RSSI_UNKNOWN
    return 0 if kind == RSSI_ANALOGUE and not firmware.receiver else RSSI_GOOD


def sys_status(firmware: Firmware, time: float, reading: Reading) -> Any:
    """SYS_STATUS: mV, hundredths of an ampere, load in tenths of a per cent.

    ArduRover sets no bit for the radio receiver (Rover/GCS_Rover.cpp), other vehicles of ArduPilot do. There is no
    safety switch, which alone would have the outputs not enabled (libraries/GCS_MAVLink/GCS.cpp).
    """
    fitted = (
        dialect.MAV_SYS_STATUS_SENSOR_3D_GYRO
        | dialect.MAV_SYS_STATUS_SENSOR_3D_MAG
        | dialect.MAV_SYS_STATUS_SENSOR_GPS
        | dialect.MAV_SYS_STATUS_AHRS
        | dialect.MAV_SYS_STATUS_SENSOR_MOTOR_OUTPUTS
    )
    failed = 0 if firmware.has_position(time) else dialect.MAV_SYS_STATUS_SENSOR_GPS
    if not firmware.world.sensors.has_heading(time):
        failed |= dialect.MAV_SYS_STATUS_SENSOR_3D_MAG | dialect.MAV_SYS_STATUS_AHRS
    left = FULL_PERCENT
    for fault, effect in firmware.world.faults.acting("charge", time):
        left = effect(fault, left)
    fitted |= dialect.MAV_SYS_STATUS_SENSOR_BATTERY
    failed |= dialect.MAV_SYS_STATUS_SENSOR_BATTERY if left != FULL_PERCENT else 0
    return dialect.MAVLink_sys_status_message(
        *(fitted, fitted, fitted & ~failed, 120, battery_mv(left)),
        *(100 + 20 * abs(firmware.throttle), round(left), 0, 0, 0, 0, 0, 0),
    )


FILTER_RUNS = (
    dialect.EKF_ATTITUDE
    | dialect.EKF_VELOCITY_HORIZ
    | dialect.EKF_VELOCITY_VERT
    | dialect.EKF_POS_HORIZ_REL
    | dialect.EKF_POS_HORIZ_ABS
    | dialect.EKF_POS_VERT_ABS
    | dialect.EKF_PRED_POS_HORIZ_REL
    | dialect.EKF_PRED_POS_HORIZ_ABS
)
WELL = 0.05
"""What a filter says of instruments that nothing ails: their innovations as a share of what it lets pass."""


def filter_report(firmware: Firmware, time: float, reading: Reading) -> Any:
    """EKF_STATUS_REPORT of a filter that runs."""
    compass = WELL
    for fault, effect in firmware.world.faults.acting("variance", time):
        compass = effect(fault, compass)
    return dialect.MAVLink_ekf_status_report_message(FILTER_RUNS, WELL, WELL, WELL, compass, 0.0, 0.0)


def system_time(firmware: Firmware, time: float, reading: Reading) -> Any:
    """SYSTEM_TIME: us since 1970 and ms since boot."""
    unix_us = firmware.world.scenario.start.unix_time_s * 1_000_000 + round(time * 1.0e6)
    return dialect.MAVLink_system_time_message(unix_us if firmware.has_position(time) else 0, boot_ms(firmware, time))


def autopilot_version(firmware: Firmware, time: float, reading: Reading) -> Any:
    """AUTOPILOT_VERSION: what this firmware can do, truthfully for what is simulated."""
    capabilities = (
        dialect.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
        | dialect.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
        | dialect.MAV_PROTOCOL_CAPABILITY_MAVLINK2
    )
    nothing = [0] * 8
    major, minor = firmware.version
    version = (major << 24) | (minor << 16) | OFFICIAL
    return dialect.MAVLink_autopilot_version_message(capabilities, version, 0, 0, 0, nothing, nothing, nothing, 0, 0, 0)


def simstate(firmware: Firmware, time: float, reading: Reading) -> Any:
    """SIMSTATE, as ArduPilot's simulator sends it: the truth, without sensors. Radians, degrees x 1e7."""
    state = firmware.world.boat.state
    return dialect.MAVLink_simstate_message(
        state.roll,
        0.0,
        wrap(state.heading),
        0.0,
        0.0,
        0.0,
        state.roll_rate,
        0.0,
        state.rate,
        round(reading.latitude * 1.0e7),
        round(reading.longitude * 1.0e7),
    )


def wind(firmware: Firmware, time: float, reading: Reading) -> Any | None:
    """WIND: the true wind, degrees it comes from and m/s; none without a vane (libraries/AP_WindVane, send_wind)."""
    if not firmware.parameters["WNDVN_TYPE"]:
        return None
    speed, course = _felt_speed(firmware, reading), reading.heading + reading.wind_angle + math.pi
    north = speed * math.cos(course) + reading.north_speed
    east = speed * math.sin(course) + reading.east_speed
    come_from = math.degrees(math.atan2(-east, -north)) % 360.0
    return dialect.MAVLink_wind_message(come_from, math.hypot(north, east), 0.0)


def apparent_wind(firmware: Firmware, time: float, reading: Reading) -> tuple[Any, ...]:
    """The named values that go with WIND: the apparent wind, m/s and degrees clockwise from the bow."""
    values = {"AppWndSpd": _felt_speed(firmware, reading), "AppWndDir": math.degrees(wrap(reading.wind_angle))}
    return tuple(
        dialect.MAVLink_named_value_float_message(boot_ms(firmware, time), name.encode(), value)
        for name, value in values.items()
    )


def _felt_speed(firmware: Firmware, reading: Reading) -> float:
    """A vane without an anemometer shows a calm."""
    return reading.wind_speed if firmware.parameters["WNDVN_SPEED_TYPE"] else 0.0


Builder = Callable[[Firmware, float, Reading], Any | None]

BUILDERS: dict[int, Builder] = {
    dialect.MAVLINK_MSG_ID_HEARTBEAT: lambda firmware, time, reading: heartbeat(firmware),
    dialect.MAVLINK_MSG_ID_ATTITUDE: attitude,
    dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: global_position,
    dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED: local_position,
    dialect.MAVLINK_MSG_ID_VFR_HUD: vfr_hud,
    dialect.MAVLINK_MSG_ID_GPS_RAW_INT: gps_raw,
    dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW: servo_outputs,
    dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT: navigation,
    dialect.MAVLINK_MSG_ID_RC_CHANNELS: rc_channels,
    dialect.MAVLINK_MSG_ID_SYS_STATUS: sys_status,
    dialect.MAVLINK_MSG_ID_SYSTEM_TIME: system_time,
    dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT: filter_report,
    dialect.MAVLINK_MSG_ID_MISSION_CURRENT: lambda *_: dialect.MAVLink_mission_current_message(0),  # there is none
    dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION: autopilot_version,
    dialect.MAVLINK_MSG_ID_SIMSTATE: simstate,
    dialect.MAVLINK_MSG_ID_WIND: wind,
}
"""Every message that can be streamed or requested."""
BESIDE: dict[int, Callable[[Firmware, float, Reading], tuple[Any, ...]]] = {dialect.MAVLINK_MSG_ID_WIND: apparent_wind}
"""What leaves together with a message."""


def _int16(value: float) -> int:
    return min(max(round(value), -32768), 32767)


GROUPS: dict[str, tuple[int, ...]] = {
    "SR0_EXT_STAT": (
        dialect.MAVLINK_MSG_ID_SYS_STATUS,
        dialect.MAVLINK_MSG_ID_MISSION_CURRENT,
        dialect.MAVLINK_MSG_ID_GPS_RAW_INT,
        dialect.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
    ),
    "SR0_POSITION": (dialect.MAVLINK_MSG_ID_GLOBAL_POSITION_INT, dialect.MAVLINK_MSG_ID_LOCAL_POSITION_NED),
    "SR0_RC_CHAN": (dialect.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW, dialect.MAVLINK_MSG_ID_RC_CHANNELS),
    "SR0_EXTRA1": (dialect.MAVLINK_MSG_ID_ATTITUDE, dialect.MAVLINK_MSG_ID_SIMSTATE),
    "SR0_EXTRA2": (dialect.MAVLINK_MSG_ID_VFR_HUD,),
    "SR0_EXTRA3": (
        dialect.MAVLINK_MSG_ID_WIND,
        dialect.MAVLINK_MSG_ID_SYSTEM_TIME,
        dialect.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
    ),
}
REQUESTS: dict[int, tuple[str, ...]] = {
    dialect.MAV_DATA_STREAM_ALL: (*GROUPS, "SR0_RAW_SENS", "SR0_RAW_CTRL"),
    dialect.MAV_DATA_STREAM_RAW_SENSORS: ("SR0_RAW_SENS",),
    dialect.MAV_DATA_STREAM_EXTENDED_STATUS: ("SR0_EXT_STAT",),
    dialect.MAV_DATA_STREAM_RC_CHANNELS: ("SR0_RC_CHAN",),
    dialect.MAV_DATA_STREAM_RAW_CONTROLLER: ("SR0_RAW_CTRL",),
    dialect.MAV_DATA_STREAM_POSITION: ("SR0_POSITION",),
    dialect.MAV_DATA_STREAM_EXTRA1: ("SR0_EXTRA1",),
    dialect.MAV_DATA_STREAM_EXTRA2: ("SR0_EXTRA2",),
    dialect.MAV_DATA_STREAM_EXTRA3: ("SR0_EXTRA3",),
}
"""The stream-rate parameters that REQUEST_DATA_STREAM sets, by its stream id."""

INTERVAL_MAX = 60.0
"""Longest interval [s] that the firmware keeps."""


class Streams:
    """Interval and next due time of every message of one port."""

    def __init__(self, parameters: ParameterTable, time: float) -> None:
        self._parameters = parameters
        self._interval: dict[int, float] = {}
        self._due: dict[int, float] = {}
        self.next_due = time
        self.reset(time)

    def reset(self, time: float) -> None:
        """Set every message to its default: HEARTBEAT at 1 Hz, the rest by its group's SR0_ parameter."""
        self._interval.clear()
        self._due.clear()
        self.set_interval(dialect.MAVLINK_MSG_ID_HEARTBEAT, 1.0, time)
        for message in BUILDERS:
            self.set_default(message, time)

    def default_interval(self, message: int) -> float:
        """Return the default interval [s], 0 where the message is not streamed."""
        if message == dialect.MAVLINK_MSG_ID_HEARTBEAT:
            return 1.0
        for name, messages in GROUPS.items():
            if message in messages and self._parameters[name] > 0.0:
                return 1.0 / self._parameters[name]
        return 0.0

    def set_default(self, message: int, time: float) -> None:
        """Give one message its default interval."""
        self.set_interval(message, self.default_interval(message), time)

    def set_group(self, name: str, time: float) -> None:
        """Give the messages of an SR0_ parameter the interval it says now."""
        for message in GROUPS.get(name, ()):
            self.set_default(message, time)

    def set_interval(self, message: int, interval: float, time: float) -> None:
        """Stream a message every `interval` [s], no faster than the main loop; 0 or less stops it."""
        if interval <= 0.0:
            self._interval.pop(message, None)
            self._due.pop(message, None)
        else:
            shortest = 1.0 / max(self._parameters["SCHED_LOOP_RATE"], 1.0)
            self._interval[message] = min(max(interval, shortest), INTERVAL_MAX)
            self._due[message] = time
        self.next_due = min(self._due.values(), default=float("inf"))

    def interval(self, message: int) -> float:
        """Return the interval [s] of a message, 0 where it is not streamed."""
        return self._interval.get(message, 0.0)

    def take_due(self, time: float) -> list[int]:
        """Return the messages that are due at `time` [s], in a fixed order, and set their next times."""
        if time + 1.0e-9 < self.next_due:
            return []
        due = [message for message, when in self._due.items() if when <= time + 1.0e-9]
        for message in due:
            following = self._due[message] + self._interval[message]
            # after a pause the stream goes on from now: no burst to catch up
            self._due[message] = following if following > time else time + self._interval[message]
        self.next_due = min(self._due.values(), default=float("inf"))
        return due
