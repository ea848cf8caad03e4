"""One MAVLink port of the simulated flight controller: bytes in, bytes out, on whatever clock is given.

Behaves as ArduRover 4.6 on a boat does towards a companion or a ground station (ArduPilot,
libraries/GCS_MAVLink/GCS_Common.cpp and Rover/GCS_MAVLink_Rover.cpp).

MAVLink commands as the simulated flight controller answers them.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.signing import LinkSigning
from sitl import firmware_setup
from sitl.firmware import Firmware
from sitl.firmware_parameters import Parameter, ParameterTable
from sitl.guided import Target
from sitl.telemetry import BESIDE, BUILDERS, REQUESTS, Streams

Parameters = tuple[float, ...]
ACCEPTED = int(dialect.MAV_RESULT_ACCEPTED)
DENIED = int(dialect.MAV_RESULT_DENIED)
FAILED = int(dialect.MAV_RESULT_FAILED)
FORCED_REBOOT = 20190226.0
"""MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, parameter 6 (libraries/GCS_MAVLink/GCS_Common.cpp)."""
UNSUPPORTED = int(dialect.MAV_RESULT_UNSUPPORTED)
VELOCITY = dialect.POSITION_TARGET_TYPEMASK_VX_IGNORE | dialect.POSITION_TARGET_TYPEMASK_VY_IGNORE
PLACE = dialect.POSITION_TARGET_TYPEMASK_X_IGNORE | dialect.POSITION_TARGET_TYPEMASK_Y_IGNORE


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
    firmware = vehicle.firmware
    number = firmware.mode_of(_whole(parameters[1]), _whole(parameters[2]))
    return ACCEPTED if firmware.set_mode(number) else firmware.mode_refusal


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


PASSED_ON = frozenset(
    (
        dialect.MAVLINK_MSG_ID_HEARTBEAT,
        dialect.MAVLINK_MSG_ID_NAMED_VALUE_INT,
        dialect.MAVLINK_MSG_ID_NAMED_VALUE_FLOAT,
        dialect.MAVLINK_MSG_ID_STATUSTEXT,
    )
)
"""Messages without a target that companions send."""
INT16_MAX = 32767
PARAMETERS_PER_STEP = 5
"""How fast a parameter list leaves: 500 a second."""


class MavlinkVehicle:
    """A port of the flight controller. Times are those of the world's clock (see `World.time_at`).

    is_stream: whether the bytes that arrive may be split anywhere (TCP, serial line).
    signing: signs what is sent and refuses what is not signed, as the firmware does on all ports but its first.
    """

    def __init__(self, firmware: Firmware, is_stream: bool = False, signing: LinkSigning | None = None) -> None:
        self.firmware = firmware
        self.world = firmware.world
        system = own_system(firmware.parameters)
        self.codec = MavlinkCodec(system=system, component=1, is_stream=is_stream, signing=signing)
        self.streams = Streams(firmware.parameters, self.world.time)
        self.reboots_at: float | None = None
        self.outgoing: list[bytes] = []
        self.sources: set[tuple[int, int]] = set()
        firmware.ports.append(self)
        self._parameter_queue: deque[int] = deque()
        self._notices_seen = len(firmware.notices)
        self._reboots_seen = firmware.reboots
        self._handlers = {
            dialect.MAVLINK_MSG_ID_HEARTBEAT: self._on_heartbeat,
            dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE: self._on_override,
            dialect.MAVLINK_MSG_ID_MANUAL_CONTROL: self._on_manual_control,
            dialect.MAVLINK_MSG_ID_SET_ATTITUDE_TARGET: self._on_attitude_target,
            dialect.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED: self._on_position_target,
            dialect.MAVLINK_MSG_ID_SET_MODE: self._on_set_mode,
            dialect.MAVLINK_MSG_ID_COMMAND_LONG: self._on_command_long,
            dialect.MAVLINK_MSG_ID_COMMAND_INT: self._on_command_int,
            dialect.MAVLINK_MSG_ID_PARAM_REQUEST_LIST: self._on_parameter_list,
            dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ: self._on_parameter_read,
            dialect.MAVLINK_MSG_ID_PARAM_SET: self._on_parameter_set,
            dialect.MAVLINK_MSG_ID_REQUEST_DATA_STREAM: self._on_request_stream,
            dialect.MAVLINK_MSG_ID_TIMESYNC: self._on_timesync,
            dialect.MAVLINK_MSG_ID_MISSION_REQUEST_LIST: self._on_mission_list,
            dialect.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL: self._on_file_transfer,
        }
        self.world.watchers.append(self._after_step)

    def receive(self, now: float, data: bytes) -> None:
        """Take what has arrived at `now` [s]: a datagram, or a chunk of a stream. Never raises on bad bytes."""
        self.world.advance(now)
        time = self.world.time_at(now)
        for message in self.codec.decode(data):
            self._pass_on(message)
            if self._is_for_us(message):
                handler = self._handlers.get(message.get_msgId())
                if handler:
                    handler(message, time)

    def _pass_on(self, message: Any) -> None:
        """What is for everybody leaves on every other port where anybody was heard; a heartbeat on none where its own
        address was (libraries/GCS_MAVLink/MAVLink_routing.cpp)."""
        source = (message.get_srcSystem(), message.get_srcComponent())
        self.sources.add(source)
        if message.get_msgId() in PASSED_ON:
            is_heartbeat = message.get_msgId() == dialect.MAVLINK_MSG_ID_HEARTBEAT
            for port in self.firmware.ports:
                if port is not self and port.sources and not (is_heartbeat and source in port.sources):
                    port.outgoing.append(bytes(message.get_msgbuf()))

    def advance(self, now: float) -> None:
        """Move the world on to `now` [s]; what falls due on the way is ready for `transmit`."""
        self.world.advance(now)

    def transmit(self, now: float) -> list[bytes]:
        """Return what has left by `now` [s], one packet each, oldest first."""
        self.world.advance(now)
        outgoing, self.outgoing = self.outgoing, []
        return outgoing

    def send(self, message: Any) -> None:
        """Put a message on the wire, unless the scenario has silenced the boat."""
        if not self.world.sensors.is_silent(self.world.time):
            self.outgoing.append(self.codec.encode(message))

    def send_now(self, identity: int, time: float) -> bool:
        """Send one message of those that can be streamed; False where it is none of them or not to be had."""
        reading = self.world.sensors.latest(time)
        if identity not in BUILDERS or reading is None:
            return False
        if self.world.faults.silences(dialect.mavlink_map[identity].msgname, time):
            return False
        message = BUILDERS[identity](self.firmware, time, reading)
        if message is None:
            return False
        for each in (message, *(BESIDE[identity](self.firmware, time, reading) if identity in BESIDE else ())):
            self.send(each)
        return True

    def _after_step(self, time: float) -> None:
        for identity in self.streams.take_due(time):
            self.send_now(identity, time)
        for _ in range(min(PARAMETERS_PER_STEP, len(self._parameter_queue))):
            self._send_parameter(self._parameter_queue.popleft())
        while self._notices_seen < len(self.firmware.notices):
            severity, text = self.firmware.notices[self._notices_seen]
            self._notices_seen += 1
            self.send(dialect.MAVLink_statustext_message(severity, text.encode()[:50]))
        if self.reboots_at is not None and time > self.reboots_at:
            self.reboots_at = None
            self.firmware.reboot(time)
        if self._reboots_seen != self.firmware.reboots:
            self._reboots_seen = self.firmware.reboots
            self.streams.reset(time)

    def _is_for_us(self, message: Any) -> bool:
        """Messages with a target are for us when it names us or everybody; our own echo is not."""
        if message.get_srcSystem() == self.codec.system and message.get_srcComponent() == self.codec.component:
            return False
        if self.firmware.parameters["SYSID_ENFORCE"] and not self._is_from_station(message):
            return False
        system = getattr(message, "target_system", getattr(message, "target", 0))
        component = getattr(message, "target_component", 0)
        return system in (0, self.codec.system) and component in (0, self.codec.component)

    def _is_from_station(self, message: Any) -> bool:
        return bool(message.get_srcSystem() == self.firmware.parameters["SYSID_MYGCS"])

    def _on_heartbeat(self, message: Any, time: float) -> None:
        if self._is_from_station(message):
            self.firmware.on_station(time)

    def _on_override(self, message: Any, time: float) -> None:
        """From anyone but the ground station it is ignored without a word, as the firmware does."""
        if not self._is_from_station(message):
            return
        self.firmware.on_station(time)
        if self.world.faults.silences(message.get_type(), time):
            return
        for channel in range(1, firmware_setup.CHANNELS + 1):
            pulse = getattr(message, f"chan{channel}_raw")
            if channel <= 8:
                if pulse != firmware_setup.LEFT_ALONE:
                    self.firmware.overrides.put(channel, pulse, time)
            elif pulse not in firmware_setup.LEFT_ALONE_HIGH:
                released = pulse == firmware_setup.RELEASED_HIGH
                self.firmware.overrides.put(channel, firmware_setup.RELEASED if released else pulse, time)

    def _on_manual_control(self, message: Any, time: float) -> None:
        """y steers, z is the throttle; an axis of INT16_MAX is released."""
        if not self._is_from_station(message) or message.target != self.codec.system:
            return
        self.firmware.on_station(time)
        if self.world.faults.silences(message.get_type(), time):
            return
        setup = self.firmware.setup
        for value, channel, calibration in (
            (message.y, setup.steering_channel, setup.steering_input),
            (message.z, setup.throttle_channel, setup.throttle_input),
        ):
            pulse = (
                firmware_setup.RELEASED
                if value == INT16_MAX
                else firmware_setup.manual_control_pulse(calibration, value)
            )
            self.firmware.overrides.put(channel, pulse, time)

    def _on_attitude_target(self, message: Any, time: float) -> None:
        """Obeyed from any system id, in GUIDED mode, with the thrust; a heading, or the turn rate if not masked."""
        if self.world.faults.silences(message.get_type(), time):
            return
        mask, values = message.type_mask, (*message.q, message.body_yaw_rate, message.thrust)
        if mask & dialect.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE or not all(math.isfinite(value) for value in values):
            return
        is_heading = bool(mask & dialect.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE)
        w, x, y, z = message.q
        heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        thrust = min(max(message.thrust, -1.0), 1.0)
        self.firmware.guide(Target(heading if is_heading else None, message.body_yaw_rate, thrust, time))

    def _on_position_target(self, message: Any, time: float) -> None:
        """Of all that it may carry, a velocity over the ground alone."""
        carries = VELOCITY & ~message.type_mask == VELOCITY and PLACE & message.type_mask == PLACE
        is_silenced = self.world.faults.silences(message.get_type(), time)
        if carries and message.coordinate_frame == dialect.MAV_FRAME_LOCAL_NED and not is_silenced:
            self.firmware.go(message.vx, message.vy, time)

    def _on_set_mode(self, message: Any, time: float) -> None:
        is_custom = message.base_mode & dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        done = bool(is_custom) and self.firmware.set_mode(message.custom_mode)
        self._acknowledge(message, dialect.MAVLINK_MSG_ID_SET_MODE, ACCEPTED if done else FAILED)

    def _on_command_long(self, message: Any, time: float) -> None:
        parameters = tuple(float(getattr(message, f"param{number}")) for number in range(1, 8))
        self._acknowledge(message, message.command, execute(self, time, message.command, parameters))

    def _on_command_int(self, message: Any, time: float) -> None:
        first = tuple(float(getattr(message, f"param{number}")) for number in range(1, 5))
        parameters = (*first, float(message.x), float(message.y), float(message.z))
        self._acknowledge(message, message.command, execute(self, time, message.command, parameters))

    def _acknowledge(self, message: Any, command: int, result: int) -> None:
        if result == UNSUPPORTED and not 0 <= command <= 65535:
            return
        sender = (message.get_srcSystem(), message.get_srcComponent())
        self.send(dialect.MAVLink_command_ack_message(command, result, 0, 0, *sender))

    def _on_parameter_list(self, message: Any, time: float) -> None:
        self._parameter_queue = deque(range(len(self.firmware.parameters)))

    def _on_parameter_read(self, message: Any, time: float) -> None:
        """By name where the index is -1; what does not exist is not answered, as the firmware does."""
        table = self.firmware.parameters
        if message.param_index >= 0:
            if table.at(message.param_index):
                self._send_parameter(message.param_index)
            return
        name = parameter_name(message.param_id)
        if table.find(name):
            self._send_parameter(table.index_of(name))

    def _on_parameter_set(self, message: Any, time: float) -> None:
        """The value as it is then goes to every port in use; integers are cast from the float that carried them.

        What does not exist, or is no number, is not answered; what is read-only by a text and its value. (ArduPilot,
        libraries/GCS_MAVLink/GCS_Param.cpp, handle_param_set and GCS::send_parameter_value.)
        """
        known = self.firmware.parameters.find(parameter_name(message.param_id))
        if known is None or not math.isfinite(message.param_value):
            return
        if known.is_read_only:
            self.firmware.notices.append((4, f"Param write denied ({known.name})"))
            self.send_value(known, 65535)
            return
        parameter = self.firmware.parameters.set(known.name, message.param_value)
        assert parameter is not None
        self.streams.set_group(parameter.name, time)
        for port in self.firmware.ports:
            if port is self or port.sources:
                port.send_value(parameter, 65535)
        if parameter.name == "SYSID_THISMAV":
            self.codec.system = own_system(self.firmware.parameters)

    def _send_parameter(self, index: int) -> None:
        parameter = self.firmware.parameters.at(index)
        if parameter:
            self.send_value(parameter, index)

    def send_value(self, parameter: Parameter, index: int) -> None:
        """Send a parameter; 65535 for the index of one that nobody has asked for by its index."""
        count = len(self.firmware.parameters)
        name = parameter.name.encode()
        self.send(dialect.MAVLink_param_value_message(name, parameter.value, int(parameter.kind), count, index))

    def _on_request_stream(self, message: Any, time: float) -> None:
        """Sets the SR0_ parameters of the group, as the firmware does; stopping is rate 0."""
        rate = message.req_message_rate if message.start_stop == 1 else 0
        for name in REQUESTS.get(message.req_stream_id, ()):
            self.firmware.parameters.set(name, rate)
            self.streams.set_group(name, time)

    def _on_timesync(self, message: Any, time: float) -> None:
        """A request has tc1 = 0; the answer carries our nanoseconds since boot and the asker's own time."""
        if message.tc1 == 0:
            nanoseconds = round(self.firmware.time_since_boot(time) * 1.0e9)
            self.send(dialect.MAVLink_timesync_message(nanoseconds, message.ts1))

    def _on_mission_list(self, message: Any, time: float) -> None:
        sender = (message.get_srcSystem(), message.get_srcComponent())
        self.send(dialect.MAVLink_mission_count_message(*sender, 0, message.mission_type))

    def _on_file_transfer(self, message: Any, time: float) -> None:
        """There are no files: every request is refused (NAK, unknown command), so that the asker falls back."""
        request = bytes(message.payload)
        sequence = (int.from_bytes(request[0:2], "little") + 1) & 0xFFFF
        reply = bytearray(251)
        reply[0:2] = sequence.to_bytes(2, "little")
        reply[2], reply[3], reply[4], reply[5], reply[12] = request[2], 129, 1, request[3], 7
        sender = (message.get_srcSystem(), message.get_srcComponent())
        self.send(dialect.MAVLink_file_transfer_protocol_message(0, *sender, list(reply)))


def own_system(parameters: ParameterTable) -> int:
    """Return the system id that SYSID_THISMAV gives, in the byte that it travels in."""
    return min(max(int(parameters["SYSID_THISMAV"]), 1), 255)


def parameter_name(raw: str | bytes) -> str:
    """Return a parameter's name from the 16 characters of the message, with or without padding."""
    text = raw.decode("ascii", "replace") if isinstance(raw, bytes) else raw
    return text.split("\x00", 1)[0]
