"""How ArduRover turns steering and throttle into outputs: the mixer of a skid-steered frame, and the thrust curve.

Source: ArduPilot, libraries/AR_Motors/AP_MotorsUGV.cpp (output_skid_steering, get_scaled_throttle,
get_slew_limited_throttle) and Rover/mode.cpp (get_pilot_input, get_pilot_desired_steering_and_throttle), 4.6.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from sitl.firmware_parameters import ParameterTable

LEFT_FUNCTION, RIGHT_FUNCTION = 73, 74
"""SERVOn_FUNCTION: ThrottleLeft and ThrottleRight."""
TWO_PADDLES, DIRECTION_UNCHANGED = 1, 3
"""PILOT_STEER_TYPE."""


class Propulsion(NamedTuple):
    """What a plant's motors make of outputs, -1 to 1.

    speed_of: the speed [m/s] that a throttle reaches on a straight course; throttle_of: its inverse. full [rad]: the
    order that is full steering of two thrusters; 0: it has one motor.
    """

    speed_of: Callable[[float], float]
    throttle_of: Callable[[float], float]
    full: float = 0.0


class MotorSetup(NamedTuple):
    """MOT_THST_ASYM, MOT_THST_EXPO, MOT_STR_THR_MIX, MOT_THR_MIN and _MAX [%], MOT_SLEWRATE [%/s], PILOT_STEER_TYPE."""

    asymmetry: float
    expo: float
    steering_mix: float
    least: float
    most: float
    slew: float
    stick: int


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
    )


def by_hand(setup: MotorSetup, steering: float, throttle: float, *, is_skid: bool) -> tuple[float, float]:
    """Return steering and throttle, -1 to 1, as MANUAL mode takes them from the sticks."""
    if setup.stick == TWO_PADDLES:
        steering, throttle = 0.5 * (steering - throttle), 0.5 * (steering + throttle)
    elif setup.stick != DIRECTION_UNCHANGED and throttle < 0.0:
        steering = -steering
    total = abs(steering) + abs(throttle)
    return (steering / total, throttle / total) if is_skid and total > 1.0 else (steering, throttle)


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
