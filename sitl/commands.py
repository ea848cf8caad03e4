"""MAVLink commands as the simulated flight controller answers them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from pymavlink.dialects.v20 import ardupilotmega as dialect

from sitl.telemetry import BUILDERS

if TYPE_CHECKING:
    from sitl.wire_mavlink import MavlinkVehicle

Parameters = tuple[float, ...]
ACCEPTED = int(dialect.MAV_RESULT_ACCEPTED)
DENIED = int(dialect.MAV_RESULT_DENIED)
FAILED = int(dialect.MAV_RESULT_FAILED)
FORCED_REBOOT = 20190226.0
"""MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, parameter 6 (libraries/GCS_MAVLink/GCS_Common.cpp)."""
UNSUPPORTED = int(dialect.MAV_RESULT_UNSUPPORTED)


def execute(vehicle: MavlinkVehicle, time: float, command: int, parameters: Parameters) -> int:
    """Carry out `command` with its parameters 1 to 7; return the MAV_RESULT. What is unknown is UNSUPPORTED."""
    action = _ACTIONS.get(command)
    return action(vehicle, time, parameters) if action else UNSUPPORTED


def _arm(vehicle: MavlinkVehicle, time: float, parameters: Parameters) -> int:
    if parameters[0] not in (0.0, 1.0):
        return UNSUPPORTED
    return ACCEPTED if vehicle.firmware.set_armed(parameters[0] == 1.0) else FAILED


def _set_mode(vehicle: MavlinkVehicle, time: float, parameters: Parameters) -> int:
    if not int(_whole(parameters[0])) & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED:
        return DENIED
    return ACCEPTED if vehicle.firmware.set_mode(_whole(parameters[1])) else FAILED


def _set_interval(vehicle: MavlinkVehicle, time: float, parameters: Parameters) -> int:
    message, interval_us = _whole(parameters[0]), parameters[1]
    if message not in BUILDERS or not math.isfinite(interval_us):
        return FAILED
    if interval_us == 0.0:
        vehicle.streams.set_default(message, time)
    elif interval_us == -1.0:
        vehicle.streams.set_interval(message, 0.0, time)
    elif interval_us > 0.0:
        vehicle.streams.set_interval(message, interval_us * 1.0e-6, time)
    else:
        return DENIED
    return ACCEPTED


def _get_interval(vehicle: MavlinkVehicle, time: float, parameters: Parameters) -> int:
    message = _whole(parameters[0])
    if not 0 <= message <= 65535:
        return FAILED
    interval = vehicle.streams.interval(message)
    if message not in BUILDERS:
        interval_us = 0
    else:
        interval_us = round(interval * 1.0e6) if interval > 0.0 else -1
    vehicle.send(dialect.MAVLink_message_interval_message(message, interval_us))
    return ACCEPTED


def _request_message(vehicle: MavlinkVehicle, time: float, parameters: Parameters) -> int:
    return ACCEPTED if vehicle.send_now(_whole(parameters[0]), time) else FAILED


def _request_capabilities(vehicle: MavlinkVehicle, time: float, parameters: Parameters) -> int:
    vehicle.send_now(int(dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION), time)
    return ACCEPTED


def _reboot(vehicle: MavlinkVehicle, time: float, parameters: Parameters) -> int:
    """Refused while armed, unless parameter 6 forces it."""
    if parameters[0] != 1.0 or (vehicle.firmware.armed and parameters[5] != FORCED_REBOOT):
        return DENIED
    vehicle.reboots_at = time
    return ACCEPTED


_ACTIONS = {
    int(dialect.MAV_CMD_COMPONENT_ARM_DISARM): _arm,
    int(dialect.MAV_CMD_DO_SET_MODE): _set_mode,
    int(dialect.MAV_CMD_SET_MESSAGE_INTERVAL): _set_interval,
    int(dialect.MAV_CMD_GET_MESSAGE_INTERVAL): _get_interval,
    int(dialect.MAV_CMD_REQUEST_MESSAGE): _request_message,
    int(dialect.MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES): _request_capabilities,
    int(dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN): _reboot,
}


def _whole(value: float) -> int:
    """A number that must be whole: -1, which is no message and no mode, where it is not."""
    return int(value) if math.isfinite(value) and value == int(value) else -1
