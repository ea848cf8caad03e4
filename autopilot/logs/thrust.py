"""Steering and throttle in the logs of boats that steer by thrust, from the outputs and parameters of an ArduRover."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from autopilot.logs.series import SHARE, THROTTLE, FloatArray, Series, series_of
from autopilot.logs.table import SERVOS, Servo
from autopilot.models.drives.two_thrusters import LEFT, RIGHT, Mixing, moment, unmixed

MOTOR = 70
"""SERVOn_FUNCTION of the one throttle."""
Pulses = Callable[[int], tuple[FloatArray, FloatArray] | None]
"""Times [s] and pulses [us] of an output, by its number; None where the log has none."""


def thrust_series(path: str, values: Mapping[str, float], thrusters: Mixing, pulses: Pulses) -> tuple[Series, ...]:
    """Return the throttle, and of a skid-steered frame the steering, as shares of full; empty where there are none.

    thrusters: what the vessel file says of the two thrusters; how the firmware mixes stands in its parameters.
    """
    left, right = _output(values, LEFT), _output(values, RIGHT)
    if left is None or right is None:
        motor = _output(values, MOTOR)
        found = None if motor is None else pulses(motor.number)
        if motor is None or found is None:
            return ()
        return series_of(THROTTLE, f"servo {motor.number}", found[0], motor.share(found[1]))
    of_left, of_right = pulses(left.number), pulses(right.number)
    if of_left is None or of_right is None:
        return ()
    (time, port), (other, starboard) = of_left, of_right
    shares = left.share(port), np.interp(time, other, right.share(starboard)) if other.size else port * np.nan
    mixing = thrusters._replace(
        asymmetry=values.get("MOT_THST_ASYM", thrusters.asymmetry),
        expo=values.get("MOT_THST_EXPO", thrusters.expo),
        priority=values.get("MOT_STR_THR_MIX", thrusters.priority),
    )
    pairs = list(zip(*(each.tolist() for each in shares), strict=True))
    steering = np.array([moment(mixing, *pair) for pair in pairs])
    throttle = np.array([unmixed(mixing, *pair)[1] for pair in pairs])
    source = f"servos {left.number} and {right.number}, two thrusters"
    return (*series_of(SHARE, source, time, steering), *series_of(THROTTLE, source, time, throttle))


def _output(values: Mapping[str, float], function: int) -> Servo | None:
    for number in SERVOS:
        if values.get(f"SERVO{number}_FUNCTION") == function:
            usual = Servo(number)
            ends = (values.get(f"SERVO{number}_{name}") for name in ("MIN", "TRIM", "MAX"))
            low, trim, high = (default if end is None else end for end, default in zip(ends, usual[1:4], strict=True))
            return Servo(number, low, trim, high, bool(values.get(f"SERVO{number}_REVERSED", 0.0)))
    return None
