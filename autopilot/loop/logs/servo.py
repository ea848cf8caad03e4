"""From the pulses that went to a steering servo to the share of full rudder, by the parameters in the same log.

ArduPilot: the servo whose SERVOn_FUNCTION is 26 (GroundSteering), with SERVOn_MIN, TRIM, MAX and REVERSED; what is
not in the log has the firmware's default (libraries/SRV_Channel/SRV_Channel.cpp: 1100, 1500, 1900, 0).
PX4: the output whose PWM_MAIN_FUNCn or PWM_AUX_FUNCn is 201 (Servo 1), with MINn, MAXn and a bit in REV
(src/lib/mixer_module); amidships is CENTn where newer versions have it between them, else the middle.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.links.steering_pwm import LONGEST_US, SHORTEST_US
from autopilot.loop.logs.series import FloatArray

GROUND_STEERING = 26
FIRST_SERVO = 201
SERVOS = range(1, 17)
SHAPE = "NUMBER:MIN:TRIM:MAX, with :reversed behind it where it turns the other way, such as 1:1100:1500:1900"


class Servo(NamedTuple):
    """The steering servo: its number, and pulses [us] at full port, amidships and full starboard, unless reversed."""

    number: int
    low: float = 1100.0
    trim: float = 1500.0
    high: float = 1900.0
    reversed: bool = False

    def check(self, source: str) -> None:
        """Raise InputError where these are no end points of a servo."""
        if not SHORTEST_US <= self.low < self.trim < self.high <= LONGEST_US or self.number not in SERVOS:
            raise InputError(
                f"{source}: the steering servo {self.number} goes from {self.low:g} over {self.trim:g} to "
                f"{self.high:g} us; numbers 1 to 16 and rising pulses from {SHORTEST_US} to {LONGEST_US} us are "
                "allowed: give the right ones with --servo."
            )

    def share(self, pulses: FloatArray) -> FloatArray:
        """Return shares of full rudder, starboard positive, nan where there was no pulse."""
        away = pulses - self.trim
        share = np.clip(np.where(away > 0.0, away / (self.high - self.trim), away / (self.trim - self.low)), -1.0, 1.0)
        return np.where(pulses > 0.0, -share if self.reversed else share, np.nan)


class ServoScale(NamedTuple):
    """Pulses [us] at full rudder to one side, amidships and to the other, where they are not the servo's end points."""

    low: float
    trim: float
    high: float


def steering_servo(source: str, values: Mapping[str, float], chosen: Servo | ServoScale | None = None) -> Servo | None:
    """Return the servo that was chosen, or that of the parameters, on the scale that was chosen; None: not known.

    Raises InputError where the end points in the parameters are impossible.
    """
    if isinstance(chosen, Servo):
        return chosen
    found = servo_from_parameters(source, values)
    return found if found is None or chosen is None else found._replace(**chosen._asdict())


def servo_from_text(text: str) -> Servo:
    """Return the servo that `--servo` describes. Raises InputError."""
    number, *rest = text.split(":")
    is_reversed = bool(rest) and rest[-1] == "reversed"
    pulses = rest[:-1] if is_reversed else rest
    if len(pulses) != 3 or not all(word.isascii() and word.isdecimal() and len(word) < 6 for word in (number, *pulses)):
        raise InputError(f"--servo {text!r}: write {SHAPE}")
    low, trim, high = (float(pulse) for pulse in pulses)
    servo = Servo(int(number), low, trim, high, is_reversed)
    servo.check(f"--servo {text}")
    return servo


def servo_from_parameters(source: str, values: Mapping[str, float]) -> Servo | None:
    """Return the steering servo as a flight controller's parameters have it, None where they do not tell.

    Raises InputError where its end points are impossible.
    """
    servo = _ardupilot(values) or _px4(values)
    if servo is not None:
        servo.check(source)
    return servo


def _ardupilot(values: Mapping[str, float]) -> Servo | None:
    for number in SERVOS:
        if values.get(f"SERVO{number}_FUNCTION") == GROUND_STEERING:
            defaults = Servo(number)
            return Servo(
                number,
                values.get(f"SERVO{number}_MIN", defaults.low),
                values.get(f"SERVO{number}_TRIM", defaults.trim),
                values.get(f"SERVO{number}_MAX", defaults.high),
                bool(values.get(f"SERVO{number}_REVERSED", 0.0)),
            )
    return None


def _px4(values: Mapping[str, float]) -> Servo | None:
    for group in ("PWM_MAIN", "PWM_AUX"):
        for number in SERVOS:
            if values.get(f"{group}_FUNC{number}") == FIRST_SERVO:
                low, high = values.get(f"{group}_MIN{number}", 1000.0), values.get(f"{group}_MAX{number}", 2000.0)
                centre = values.get(f"{group}_CENT{number}", -1.0)
                trim = centre if low < centre < high else 0.5 * (low + high)
                bits = int(values.get(f"{group}_REV", 0.0))
                return Servo(number, low, trim, high, bool(bits >> (number - 1) & 1))
    return None
