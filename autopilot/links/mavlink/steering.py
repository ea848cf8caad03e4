"""Rudder angles to the MAVLink messages that steer an ArduRover boat, and the releases that give the helm back. Pure.

RC_CHANNELS_OVERRIDE touches the steering channel alone (65535 leaves channels 1 to 8 alone, 0 the others);
MANUAL_CONTROL carries steering in `y` and INT16_MAX, "not this axis", elsewhere, as ArduRover reads it
(Rover/GCS_MAVLink_Rover.cpp, handle_manual_control_axes).

What a companion sends besides steering: heartbeats and requests. Pure.

Hands the boat back to the flight controller in a fail-safe: orders it into a mode, sees whether it goes. Pure.
"""

from __future__ import annotations

import math
from typing import Literal

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.requests import VehicleParameters
from autopilot.links.mavlink.steering_pwm import (
    InputTable,
    SteeringChannel,
    manual_table,
    pulse_from_manual,
    pulse_table,
    reach,
    servo_from_steering,
    steering_from_pulse,
)
from autopilot.links.rudder_follow import ORDER_AGE_S, RELEASE_SPACING_S, RELEASES
from autopilot.signals import ConditionSample, Mode

AUTOPILOT_COMPONENT = 1
BOATS = (dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_TYPE_GROUND_ROVER)


def companion_heartbeat(state: int) -> Message:
    """Return our own heartbeat, with MAV_STATE `state`."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, state, 3
    )


def station_heartbeat() -> Message:
    """Return the heartbeat of the ground station in whose name we steer."""
    return dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_GCS, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
    )


def interval_request(vehicle: int, identity: int, interval_us: int) -> Message:
    """Return the request to stream the message `identity` every `interval_us`."""
    return dialect.MAVLink_command_long_message(
        vehicle,
        AUTOPILOT_COMPONENT,
        dialect.MAV_CMD_SET_MESSAGE_INTERVAL,
        0,
        identity,
        interval_us,
        0,
        0,
        0,
        0,
        0,
    )


def parameter_request(vehicle: int, name: str) -> Message:
    """Return the request for one parameter by its name."""
    return dialect.MAVLink_param_request_read_message(vehicle, AUTOPILOT_COMPONENT, name.encode(), -1)


def obstacle_of(autopilot: int, kind: int) -> str:
    """Return why a vehicle of this MAV_AUTOPILOT and MAV_TYPE cannot be steered; '' where it can."""
    if autopilot != dialect.MAV_AUTOPILOT_ARDUPILOTMEGA:
        return "the vehicle does not run ArduPilot, whose steering input is the only one known so far; use ArduRover"
    if kind not in BOATS:
        return f"the vehicle is of MAV_TYPE {kind}, not a boat or rover; connect to the boat's flight controller"
    return ""


MODES = {"HOLD": 4, "LOITER": 5, "RTL": 11}
"""ArduRover's custom modes; source: ArduPilot, Rover/mode.h."""
REPEAT_S = 0.5
HANDOVER_PATIENCE_S = 3.0
"""A vehicle that is not in the mode after this does not take it; it is asked on, but people must know."""
GIVE_UP_S = 30.0


class ModeHandover:
    """`tell` it the pilot's mode; `due` has what to send; `seen` tells of a vehicle that does not obey."""

    def __init__(self, mode: int) -> None:
        self._mode = mode
        self._since: float | None = None
        self._next = math.nan
        self._is_done = self._is_told = False

    def tell(self, now: float, mode: Mode) -> None:
        """Take the pilot's mode: a fail-safe or a fault begins to hand back. Who takes the helm then is not fought."""
        if mode not in (Mode.FAILSAFE, Mode.FAULT):
            self._since = None
        elif self._since is None:
            self._since, self._next, self._is_done = now, now, False

    def due(self, now: float, vehicle: int) -> list[Message]:
        """Return the command that is due: until the vehicle is in the mode, or half a minute has passed."""
        if self._since is None or self._is_done or now < self._next or now - self._since > GIVE_UP_S:
            return []
        self._next = now + REPEAT_S
        flags = dialect.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        command = dialect.MAV_CMD_DO_SET_MODE
        return [
            dialect.MAVLink_command_long_message(
                vehicle, AUTOPILOT_COMPONENT, command, 0, flags, self._mode, 0, 0, 0, 0, 0
            )
        ]

    def seen(self, now: float, mode: int, link: str) -> list[ConditionSample]:
        """Take the vehicle's mode; return what has changed in whether it refuses."""
        self._is_done = self._is_done or (self._since is not None and mode == self._mode)
        refuses = self._since is not None and not self._is_done and now - self._since > HANDOVER_PATIENCE_S
        if refuses == self._is_told:
            return []
        self._is_told = refuses
        return [ConditionSample(now, "handback_refused", refuses, f"still in mode {mode}" if refuses else "", link)]


LEAVE_ALONE = 65535
RELEASE_HIGH_CHANNEL = 65534
NOT_THIS_AXIS = 32767
REACH_TOLERANCE_DEG = 0.5
TOLD_APART_US = 3
"""A radio's own noise; further apart than this two pulses are different."""


class SteeringOutput:
    """Makes steering messages for one vehicle.

    Attributes:
        target: the vehicle's system id.
        channel: its way from steering input to rudder servo, None while unknown.
        commanded_pulse: input pulse [us] that the last steering message asks for.
    """

    def __init__(
        self,
        method: Literal["rc_override", "manual_control", "guided"],
        rudder_at_full: float,
        reversed_: bool,
        servo_us: tuple[float, float, float] | None = None,
        angle_max: float = 0.0,
    ) -> None:
        if not 0.0 < rudder_at_full < math.inf:
            raise ValueError(f"rudder_at_full must be a positive angle in radians, got {rudder_at_full}")
        self.target = 0
        self.channel: SteeringChannel | None = None
        self.commanded_pulse = 0
        self._by_pulse = method != "manual_control"
        self._share_per_radian = (-1.0 if reversed_ else 1.0) / rudder_at_full
        self._scale, self._angle_max = servo_us, angle_max
        self._number = 0
        self._table: InputTable | None = None
        self._last: Message | None = None
        self._last_sent = math.nan
        self._given = math.nan
        self._releases_left = 0
        self._touched = False

    def use(self, parameters: VehicleParameters) -> str:
        """Take the vehicle's parameters as known so far; return what makes steering impossible, or ''."""
        number, channel = parameters.steering_input, parameters.steering_channel()
        if channel is not None:
            channel = channel._replace(scale=self._scale)
        if channel == self.channel and number == self._number:
            return "" if channel is None else self._short_of_angle(channel, parameters.steering_servo)
        self.forget()
        if number is None or channel is None:
            return ""
        try:
            self._table = pulse_table(channel) if self._by_pulse else manual_table(channel)
        except ValueError as error:
            return f"the vehicle's parameters leave no room to steer ({error}); correct them"
        self._number, self.channel = number, channel
        return self._short_of_angle(channel, parameters.steering_servo)

    def _short_of_angle(self, channel: SteeringChannel, servo: int | None) -> str:
        """A rudder that stops short of what may be ordered would look as if it did not follow."""
        degrees = math.degrees(abs(self.angle_from_share(reach(channel))))
        ordered = math.degrees(self._angle_max)
        if channel.scale is None or degrees > ordered - REACH_TOLERANCE_DEG:
            return ""
        low, middle, high = (round(pulse) for pulse in channel.scale)
        share = self._angle_max * abs(self._share_per_radian)
        least, most = round(middle - share * (middle - low)), round(middle + share * (high - middle))
        return (
            f"SERVO{servo}_MIN to _MAX, {channel.servo_min} to {channel.servo_max} us, is {degrees:.0f} deg of rudder "
            f"by helm.servo_us [{low}, {middle}, {high}], and rudder.angle_max_deg is {ordered:.0f}; set "
            f"SERVO{servo}_MIN to {least} and SERVO{servo}_MAX to {most}, or rudder.angle_max_deg to "
            f"{math.floor(degrees)}, or correct helm.servo_us"
        )

    def forget(self) -> None:
        """Forget the vehicle's parameters and the last command, as after a reboot."""
        self._number, self.channel, self._table, self._last = 0, None, None, None

    def angle_from_share(self, share: float) -> float:
        """Return the rudder angle [rad] that a share -1..1 of full steering stands for."""
        return share / self._share_per_radian

    def steer(self, now: float, angle: float) -> Message | None:
        """Return the message for rudder `angle` [rad]; None where the vehicle is not known well enough."""
        if self._table is None or self.channel is None or not math.isfinite(angle):
            return None
        value = self._table.nearest(min(max(angle * self._share_per_radian, -1.0), 1.0))
        self.commanded_pulse = value if self._by_pulse else pulse_from_manual(self.channel, value)
        self._last = self._override(value) if self._by_pulse else self._manual(value)
        self._given = self._last_sent = now
        self._releases_left = RELEASES
        self._touched = True
        return self._last

    def unmoving(self, pulse: int) -> tuple[Message, int] | None:
        """Return a message, and the input [us] it asks for, that leaves the servo where an input `pulse` [us] has it.

        The input can be told from `pulse`; where none such moves nothing, it is the one that moves least. A vehicle
        without a radio receiver shows 0: then it is near the trim. None where the vehicle is not known yet.
        """
        channel = self.channel
        if channel is None:
            return None
        held = min(max(pulse, channel.rc_min), channel.rc_max) if pulse else channel.rc_trim
        inputs = range(channel.rc_min, channel.rc_max + 1) if self._by_pulse else range(-1000, 1001)

        def asked(value: int) -> int:
            return value if self._by_pulse else pulse_from_manual(channel, value)

        def moved(value: int) -> tuple[int, int]:
            there, here = (servo_from_steering(channel, steering_from_pulse(channel, p)) for p in (asked(value), held))
            return abs(there - here), abs(asked(value) - held)

        value = min((value for value in inputs if abs(asked(value) - pulse) > TOLD_APART_US), key=moved)
        self._releases_left, self._touched = RELEASES, True
        return (self._override(value) if self._by_pulse else self._manual(value)), asked(value)

    def amidships(self) -> tuple[Message, int] | None:
        """Return the message, and its input [us], that leave the servo at its trim; None for an unknown vehicle."""
        channel = self.channel
        if channel is None or self._table is None:
            return None
        value = self._table.nearest(0.0)
        return (
            (self._override(value), value)
            if self._by_pulse
            else (self._manual(value), pulse_from_manual(channel, value))
        )

    def release(self, now: float) -> Message | None:
        """Return the next of `RELEASES` releases after steering, `RELEASE_SPACING_S` apart; None when done."""
        if self._last is not None:
            self._last = None
        elif now - self._last_sent < RELEASE_SPACING_S:
            return None
        if self._releases_left == 0:
            return None
        self._releases_left -= 1
        self._last_sent = now
        return self._release()

    def repeat(self, now: float, rate_hz: float) -> Message | None:
        """Return what is due again: the last command at `rate_hz` at least, or a release that is left."""
        if self._last is None:
            return self.release(now) if self._releases_left else None
        if now - self._last_sent < 1.0 / rate_hz or now - self._given > ORDER_AGE_S:
            return None
        self._last_sent = now
        return self._last

    def release_burst(self) -> list[Message]:
        """Return all releases at once, for the way out; none where the rudder was never touched."""
        self._last = None
        self._releases_left = 0
        return [self._release() for _ in range(RELEASES)] if self._touched and self._number else []

    def _release(self) -> Message:
        if not self._by_pulse:
            return self._manual(NOT_THIS_AXIS)
        return self._override(0 if self._number <= 8 else RELEASE_HIGH_CHANNEL)

    def _override(self, value: int) -> Message:
        channels = [LEAVE_ALONE] * 8 + [0] * 10
        channels[self._number - 1] = value
        return dialect.MAVLink_rc_channels_override_message(self.target, 1, *channels)

    def _manual(self, y: int) -> Message:
        return dialect.MAVLink_manual_control_message(self.target, NOT_THIS_AXIS, y, NOT_THIS_AXIS, NOT_THIS_AXIS, 0)
