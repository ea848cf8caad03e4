"""What the firmware's main loop needs of its parameters, worked out once for each change of them."""

from __future__ import annotations

from typing import NamedTuple

from sitl.firmware_parameters import ParameterTable
from sitl.guided import GuidedGains, gains_of
from sitl.radio import CHANNELS, Calibration

CHECK_THROTTLE, CLEAR_BY_STICK = 1 << 5, 1 << 14
"""RC_OPTIONS: no arming by the stick with throttle; a stick that moves ends overrides (from 4.8 on)."""
CLEARS_SINCE = (4, 8)
OVERRIDE_ENABLE = 46
"""RCn_OPTION "RC Override Enable" (libraries/RC_Channel/RC_Channel.h)."""
STEERING_FUNCTION = 26
THROTTLE_FUNCTION = 70
"""SERVOn_FUNCTION: GroundSteering and Throttle."""


class Setup(NamedTuple):
    """Channels count from 1; override_switch is None where no switch allows overrides.

    steering_outputs, throttle_outputs: servo channels with their calibrations.
    stick_arms: ARMING_RUDDER, 0: neither arms nor disarms, 1: arms, 2: both.
    """

    steering_channel: int
    throttle_channel: int
    pitch_channel: int
    steering_input: Calibration
    throttle_input: Calibration
    steering_outputs: tuple[tuple[int, Calibration], ...]
    throttle_outputs: tuple[tuple[int, Calibration], ...]
    override_time: float
    radio_failsafe: bool
    radio_failsafe_pulse: float
    radio_timeout: float
    station_failsafe: bool
    station_timeout: float
    failsafe_time: float
    failsafe_holds: bool
    override_switch: int | None
    clears_by_stick: bool
    stick_arms: int
    arming_checks_throttle: bool
    guided: GuidedGains


def setup_of(parameters: ParameterTable, version: tuple[int, int]) -> Setup:
    """Return the setup that the parameters give at this moment to firmware of that version (major, minor)."""
    options = int(parameters["RC_OPTIONS"])
    steering = _channel(parameters["RCMAP_ROLL"])
    throttle = _channel(parameters["RCMAP_THROTTLE"])
    return Setup(
        steering_channel=steering,
        throttle_channel=throttle,
        pitch_channel=_channel(parameters["RCMAP_PITCH"]),
        steering_input=input_calibration(parameters, steering),
        throttle_input=input_calibration(parameters, throttle),
        steering_outputs=_outputs(parameters, STEERING_FUNCTION),
        throttle_outputs=_outputs(parameters, THROTTLE_FUNCTION),
        override_time=parameters["RC_OVERRIDE_TIME"],
        radio_failsafe=parameters["FS_THR_ENABLE"] != 0.0,
        radio_failsafe_pulse=parameters["FS_THR_VALUE"],
        radio_timeout=parameters["RC_FS_TIMEOUT"],
        station_failsafe=parameters["FS_GCS_ENABLE"] != 0.0,
        station_timeout=parameters["FS_GCS_TIMEOUT"],
        failsafe_time=parameters["FS_TIMEOUT"],
        failsafe_holds=parameters["FS_ACTION"] != 0.0,
        override_switch=next(
            (n for n in range(1, CHANNELS + 1) if parameters[f"RC{n}_OPTION"] == OVERRIDE_ENABLE), None
        ),
        clears_by_stick=bool(options & CLEAR_BY_STICK) and version >= CLEARS_SINCE,
        stick_arms=int(parameters["ARMING_RUDDER"]),
        arming_checks_throttle=bool(options & CHECK_THROTTLE),
        guided=gains_of(parameters),
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
