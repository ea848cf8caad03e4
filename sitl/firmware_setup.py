"""Pulse widths and outputs as ArduRover computes with them, and what its main loop needs of its parameters.

RC inputs with dead zone, servo outputs, overrides: integers are truncated where the firmware truncates (ArduPilot,
libraries/RC_Channel and libraries/SRV_Channel): with 1000/1500/2000 and a dead zone of 30, an input of 1560 us leaves
the servo at 1531 us. Steering and throttle of a skid-steered frame, and the thrust curve: libraries/AR_Motors/
AP_MotorsUGV.cpp (output_regular, output_skid_steering, get_scaled_throttle, get_slew_limited_throttle), Rover/mode.cpp
(get_pilot_input, get_pilot_desired_steering_and_throttle) and mode_manual.cpp, 4.6.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

from sitl.firmware_parameters import ParameterTable
from sitl.guided import gains_of

LEFT_FUNCTION, RIGHT_FUNCTION = 73, 74
"""SERVOn_FUNCTION: ThrottleLeft and ThrottleRight."""
TWO_PADDLES, DIRECTION_UNCHANGED = 1, 3
"""PILOT_STEER_TYPE."""
EXPO_MOST = 0.95
"""From here on MANUAL_STR_EXPO bends nothing (AP_Math/control.cpp, input_expo)."""


class Propulsion(NamedTuple):
    """What a plant's motors make of outputs, -1 to 1.

    speed_of: the speed [m/s] that a throttle reaches on a straight course; throttle_of: its inverse. full [rad]: the
    order that is full steering of two thrusters; 0: it has one motor.
    """

    speed_of: Callable[[float], float]
    throttle_of: Callable[[float], float]
    full: float = 0.0


class MotorSetup(NamedTuple):
    """MOT_THST_ASYM, MOT_THST_EXPO, MOT_STR_THR_MIX, MOT_THR_MIN and _MAX [%], MOT_SLEWRATE [%/s], PILOT_STEER_TYPE.

    manual_expo, is_scaled, base_speed: MANUAL_STR_EXPO, bit 0 of MANUAL_OPTIONS, MOT_SPD_SCA_BASE [m/s].
    """

    asymmetry: float
    expo: float
    steering_mix: float
    least: float
    most: float
    slew: float
    stick: int
    manual_expo: float
    is_scaled: bool
    base_speed: float


def motor_setup(parameters: ParameterTable) -> MotorSetup:
    """Return what the parameters say at this moment."""
    return MotorSetup(
        max(parameters["MOT_THST_ASYM"], 1.0),
        parameters["MOT_THST_EXPO"],
        min(max(parameters["MOT_STR_THR_MIX"], 0.0), 1.0),
        min(max(parameters["MOT_THR_MIN"], 0.0), 20.0),
        min(max(parameters["MOT_THR_MAX"], 30.0), 100.0),
        parameters["MOT_SLEWRATE"],
        int(parameters["PILOT_STEER_TYPE"]),
        parameters["MANUAL_STR_EXPO"],
        bool(int(parameters["MANUAL_OPTIONS"]) & 1),
        parameters["MOT_SPD_SCA_BASE"],
    )


def by_hand(setup: MotorSetup, steering: float, throttle: float, *, is_skid: bool) -> tuple[float, float]:
    """Return steering and throttle, -1 to 1, as MANUAL mode takes them from the sticks."""
    if setup.stick == TWO_PADDLES:
        steering, throttle = 0.5 * (steering - throttle), 0.5 * (steering + throttle)
    elif setup.stick != DIRECTION_UNCHANGED and throttle < 0.0:
        steering = -steering
    total = abs(steering) + abs(throttle)
    if is_skid and total > 1.0:
        steering, throttle = steering / total, throttle / total
    expo = setup.manual_expo
    if expo < EXPO_MOST:
        steering = (1.0 - expo) * steering / (1.0 - expo * abs(steering))
    return steering, throttle


def to_rudder(setup: MotorSetup, steering: float, throttle: float, speed: float) -> float:
    """Return the steering, -1 to 1, that a rudder's outputs get in MANUAL while armed; speed [m/s]: over ground."""
    if not setup.is_scaled:
        return -steering if throttle < 0.0 else steering
    if 0.0 < setup.base_speed < abs(speed):
        steering *= setup.base_speed / abs(speed)
    return -steering if speed < 0.0 else steering


def slewed(setup: MotorSetup, before: float, throttle: float, dt: float) -> float:
    """Return the throttle, -1 to 1, that MOT_SLEWRATE and MOT_THR_MAX leave `dt` [s] after `before`."""
    most = 0.01 * setup.most
    throttle = min(max(throttle, -most), most)
    if setup.slew <= 0.0:
        return throttle
    change = 0.01 * setup.slew * dt
    return min(max(throttle, before - change), before + change)


def skid_outputs(setup: MotorSetup, steering: float, throttle: float) -> tuple[float, float]:
    """Return what the left and the right motor are given, -1 to 1: the mixer, asymmetry and thrust curve."""
    bottom = -1.0 / setup.asymmetry
    ideal = (1.0 + bottom) / 2.0
    # the mixer never gives more throttle than is asked for, so that little throttle leaves little steering
    range_ = max(throttle, 0.0) - bottom if throttle < ideal else 1.0 - ideal
    steering = min(max(steering, -range_), range_)
    throttle = min(max(throttle, bottom), 1.0)
    size = abs(steering)
    saturation = max(throttle + size, (throttle - size) / bottom)
    if saturation > 1.0:
        fair, mix = 1.0 / saturation, setup.steering_mix
        if mix >= 0.5:
            size *= fair + (1.0 - fair) * (mix - 0.5) / 0.5
            throttle = 1.0 - size if throttle >= ideal else size + bottom
        else:
            throttle *= fair + (1.0 - fair) * (0.5 - mix) / 0.5
            size = 1.0 - throttle if throttle >= ideal else throttle - bottom
        steering = math.copysign(size, steering)
    pair = (throttle + steering, throttle - steering)
    left, right = (each * setup.asymmetry if each < 0.0 else each for each in pair)
    return curved(setup, left), curved(setup, right)


def curved(setup: MotorSetup, throttle: float) -> float:
    """Return the output, -1 to 1, for a throttle: MOT_THR_MIN, and the curve of MOT_THST_EXPO inverted."""
    if throttle == 0.0:
        return 0.0
    size = min(0.01 * setup.least + abs(throttle) * (1.0 - 0.01 * setup.least), 1.0)
    expo = setup.expo
    if abs(expo) > 1.0e-6 and -1.0 <= expo <= 1.0:
        size = (expo - 1.0 + math.sqrt((1.0 - expo) ** 2 + 4.0 * expo * size)) / (2.0 * expo)
    return math.copysign(size, throttle)


CHANNELS = 16
STEERING_FULL = 4500
THROTTLE_FULL = 100
PULSE_MAX = 65535
RELEASED = 0
LEFT_ALONE = 65535
LEFT_ALONE_HIGH = (0, 65535)
"""Channels 9 and up: zero leaves alone too, and 65534 releases."""
RELEASED_HIGH = 65534
SERVO_US = (1000.0, 1500.0, 2000.0)
"""Pulses at full rudder to port, amidships and to starboard of a linkage of which the vessel file says nothing."""
SWITCH_LOW_US, SWITCH_HIGH_US = 1200, 1800
"""Below and above these an auxiliary switch is in its low and high position; between, it changes nothing."""
STICK_ARMS, STICK_ARMS_AND_DISARMS = 1, 2
STICK_OVER = 4000
"""Of 4500: a steering stick that wants to arm or disarm."""
STICK_OVER_S = 2.0
"""Seen with ArduRover 4.6.2; the source that all vehicles have shared since waits 3 s."""


class Calibration(NamedTuple):
    """Pulse widths [us] of one channel: RCn_MIN, _TRIM, _MAX, _DZ, _REVERSED (servo outputs have no dead zone)."""

    low: int
    trim: int
    high: int
    dead_zone: int = 0
    is_reversed: bool = False


@lru_cache(256)
def input_angle(channel: Calibration, pulse: int, full: int) -> int:
    """Return the stick's position in [-full, full], 0 within the dead zone around trim."""
    sign = -1 if channel.is_reversed else 1
    held = min(max(pulse, channel.low), channel.high)
    above, below = channel.trim + channel.dead_zone, channel.trim - channel.dead_zone
    if held > above and channel.high != above:
        return _divide(sign * full * (held - above), channel.high - above)
    if held < below and below != channel.low:
        return _divide(sign * full * (held - below), below - channel.low)
    return 0


@lru_cache(256)
def output_pulse(servo: Calibration, position: float, full: int) -> int:
    """Return the pulse width [us] of a servo at `position` in [-full, full]; never outside low to high."""
    held = min(max(-position if servo.is_reversed else position, -full), full)
    if held > 0:
        pulse = servo.trim + int(held * (servo.high - servo.trim) / full)
    else:
        pulse = servo.trim - int(-held * (servo.trim - servo.low) / full)
    return _sent(min(max(pulse, servo.low), servo.high))


def travel(full: tuple[float, float, float], pulse: int) -> float:
    """Return the share of full travel that a linkage makes of a pulse [us]; amidships without pulses (0)."""
    low, middle, high = full
    away = pulse - middle
    return away / (high - middle if away > 0 else middle - low) if pulse else 0.0


def manual_control_pulse(channel: Calibration, value: int) -> int:
    """Return the override [us] that a MANUAL_CONTROL axis in [-1000, 1000] becomes."""
    return _sent(channel.low + int((channel.high - channel.low) * (value + 1000) / 2000.0))


def _sent(pulse: int) -> int:
    """A pulse width fits 16 bits, whatever the parameters say."""
    return min(max(pulse, 0), PULSE_MAX)


def _divide(numerator: int, denominator: int) -> int:
    """Integer division that truncates towards zero, as C does."""
    quotient = abs(numerator) // abs(denominator)
    return quotient if (numerator >= 0) == (denominator >= 0) else -quotient


class Overrides:
    """RC channel overrides: value and age of each, and whether a new one has come since the last look."""

    def __init__(self) -> None:
        self._held: dict[int, tuple[int, float]] = {}
        self.are_new = False

    def put(self, channel: int, pulse: int, time: float) -> None:
        """Override `channel` (from 1) with `pulse` [us]; 0 releases it."""
        if pulse == RELEASED:
            self._held.pop(channel, None)
        else:
            self._held[channel] = (pulse, time)
        self.are_new = True

    def clear(self) -> None:
        """Release every channel."""
        self._held.clear()

    def active(self, time: float, timeout: float) -> dict[int, int]:
        """Return the pulses in force by channel. timeout [s] < 0: they never end; 0: overrides are off."""
        if timeout == 0.0:
            return {}
        return {
            channel: pulse for channel, (pulse, when) in self._held.items() if timeout < 0.0 or time - when < timeout
        }


class OverridePermit:
    """Whether overrides are obeyed: the radio's switch says so, and a stick that moves can end it.

    Source: libraries/RC_Channel, `set_gcs_overrides_enabled`, `should_ignore_overrides` (4.8).
    """

    def __init__(self) -> None:
        self.is_given = True
        self._switch = ""
        self._throttle: int | None = None

    def update(self, setup: Setup, sticks: Sequence[int], are_active: bool) -> bool:
        """Take where the sticks are, behind overrides too; return whether just now one of them ended the overrides.

        The steering stick does out of its dead zone, the throttle where it moves by more since overrides began.
        """
        if setup.override_switch is not None:
            pulse = sticks[setup.override_switch - 1]
            place = "low" if pulse < SWITCH_LOW_US else "high" if pulse > SWITCH_HIGH_US else ""
            if place and place != self._switch:
                self.is_given = place == "high"
            self._switch = place
        throttle = sticks[setup.throttle_channel - 1]
        if not are_active or not self.is_given:
            self._throttle = None
            return False
        self._throttle = throttle if self._throttle is None else self._throttle
        steering = setup.steering_input
        is_moved = (
            abs(sticks[setup.steering_channel - 1] - steering.trim) > steering.dead_zone
            or abs(throttle - self._throttle) > setup.throttle_input.dead_zone
        )
        if setup.clears_by_stick and is_moved:
            self.is_given = False
            return True
        return False


class StickArming:
    """ARMING_RUDDER: arming by the steering stick hard to starboard, disarming hard to port.

    Source: libraries/RC_Channel/RC_Channels.cpp, `rudder_arm_disarm_check`.
    """

    def __init__(self) -> None:
        self._since: float | None = None

    def arming_wanted(self, time: float, setup: Setup, steering: int, throttle: int) -> bool | None:
        """Return True where the stick has asked for arming, False for disarming, None for neither."""
        is_over = setup.stick_arms != 0 and abs(steering) > STICK_OVER
        if not is_over or (steering > 0 and throttle != 0 and setup.arming_checks_throttle):
            self._since = None
            return None
        self._since = time if self._since is None else self._since
        if time - self._since < STICK_OVER_S:
            return None
        self._since = None
        if steering > 0:
            return True
        return False if setup.stick_arms == STICK_ARMS_AND_DISARMS else None


IGNORE_OVERRIDES, CHECK_THROTTLE, CLEAR_BY_STICK = 1 << 1, 1 << 5, 1 << 14
"""RC_OPTIONS: overrides are ignored; no arming by the stick with throttle; a stick that moves ends overrides (from 4.8
on)."""
CLEARS_SINCE = (4, 8)
OVERRIDE_ENABLE = 46
"""RCn_OPTION "RC Override Enable" (libraries/RC_Channel/RC_Channel.h)."""
STEERING_FUNCTION = 26
THROTTLE_FUNCTION = 70
"""SERVOn_FUNCTION: GroundSteering and Throttle."""
SCALED_FUNCTION = 140
"""SERVOn_FUNCTION: RCIN1Scaled; 15 more follow it (libraries/SRV_Channel/SRV_Channel_aux.cpp, output_ch)."""
BOW_US = (1100.0, 1500.0, 1900.0)
"""Pulses of a bow thruster at full to port, at rest and at full to starboard."""


class Setup:
    """What the parameters give at this moment to firmware of a version (major, minor).

    Channels count from 1; override_switch is None where no switch allows overrides.

    steering_outputs, throttle_outputs: servo channels with their calibrations.
    passed_outputs: servo channel, calibration, and the radio's channel that it passes on. safe_mask: SERVO_RC_FS_MSK.
    stick_arms: ARMING_RUDDER, 0: neither arms nor disarms, 1: arms, 2: both.
    is_skid: the frame is skid-steered, an output for either side.
    """

    def __init__(self, parameters: ParameterTable, version: tuple[int, int]) -> None:
        options = int(parameters["RC_OPTIONS"])
        self.steering_channel = _channel(parameters["RCMAP_ROLL"])
        self.throttle_channel = _channel(parameters["RCMAP_THROTTLE"])
        self.pitch_channel = _channel(parameters["RCMAP_PITCH"])
        self.steering_input = input_calibration(parameters, self.steering_channel)
        self.throttle_input = input_calibration(parameters, self.throttle_channel)
        self.steering_outputs = _outputs(parameters, STEERING_FUNCTION)
        self.throttle_outputs = _outputs(parameters, THROTTLE_FUNCTION)
        self.override_time = 0.0 if options & IGNORE_OVERRIDES else parameters["RC_OVERRIDE_TIME"]
        self.radio_failsafe = parameters["FS_THR_ENABLE"] != 0.0
        self.radio_failsafe_pulse = parameters["FS_THR_VALUE"]
        self.radio_timeout = parameters["RC_FS_TIMEOUT"]
        self.station_failsafe = parameters["FS_GCS_ENABLE"] != 0.0
        self.station_timeout = parameters["FS_GCS_TIMEOUT"]
        self.failsafe_time = parameters["FS_TIMEOUT"]
        self.failsafe_holds = parameters["FS_ACTION"] != 0.0
        switches = (n for n in range(1, CHANNELS + 1) if parameters[f"RC{n}_OPTION"] == OVERRIDE_ENABLE)
        self.override_switch = next(switches, None)
        self.clears_by_stick = bool(options & CLEAR_BY_STICK) and version >= CLEARS_SINCE
        self.stick_arms = int(parameters["ARMING_RUDDER"])
        self.arming_checks_throttle = bool(options & CHECK_THROTTLE)
        self.guided = gains_of(parameters)
        self.motors = motor_setup(parameters)
        self.left_outputs = _outputs(parameters, LEFT_FUNCTION)
        self.right_outputs = _outputs(parameters, RIGHT_FUNCTION)
        self.is_skid = bool(self.left_outputs and self.right_outputs)
        self.passed_outputs = _passed_outputs(parameters)
        self.safe_mask = int(parameters["SERVO_RC_FS_MSK"])


def _passed_outputs(parameters: ParameterTable) -> tuple[tuple[int, Calibration, int], ...]:
    numbers = range(1, CHANNELS + 1)
    wanted = {SCALED_FUNCTION - 1 + number: number for number in numbers}
    functions = ((channel, parameters[f"SERVO{channel}_FUNCTION"]) for channel in numbers)
    return tuple(
        (channel, _calibration(parameters, f"SERVO{channel}_"), wanted[int(function)])
        for channel, function in functions
        if function in wanted
    )


def input_calibration(parameters: ParameterTable, channel: int) -> Calibration:
    """Return RCn_MIN, _TRIM, _MAX, _DZ and _REVERSED of a channel."""
    prefix = f"RC{channel}_"
    return _calibration(parameters, prefix)._replace(dead_zone=int(parameters[prefix + "DZ"]))


def _outputs(parameters: ParameterTable, function: int) -> tuple[tuple[int, Calibration], ...]:
    return tuple(
        (channel, _calibration(parameters, f"SERVO{channel}_"))
        for channel in range(1, CHANNELS + 1)
        if parameters[f"SERVO{channel}_FUNCTION"] == function
    )


def _calibration(parameters: ParameterTable, prefix: str) -> Calibration:
    return Calibration(
        low=int(parameters[prefix + "MIN"]),
        trim=int(parameters[prefix + "TRIM"]),
        high=int(parameters[prefix + "MAX"]),
        is_reversed=parameters[prefix + "REVERSED"] != 0.0,
    )


def _channel(value: float) -> int:
    return min(max(int(value), 1), CHANNELS)
