"""What ArduRover makes of a steering input, and the input that gives a wanted rudder. Pure.

In MANUAL mode the steering channel's pulse goes through the channel's dead zone and end points to -4500..4500,
through the steering exponent, and through the servo's end points to a pulse again, in whole numbers each time.
Here that whole way is computed once for every possible input, and the wanted rudder is looked up backwards:
dead zone, rounding, asymmetric trims and reversals are all inverted exactly.

Source: ArduPilot, libraries/RC_Channel/RC_Channel.cpp (pwm_to_angle_dz_trim), Rover/mode_manual.cpp,
libraries/SRV_Channel/SRV_Channel.cpp (pwm_from_angle), libraries/GCS_MAVLink/GCS_Common.cpp (manual_override).
Measured on ArduRover 4.6: 1560 in gives 1531 out with 1000/1500/2000 and a dead zone of 30.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterable
from typing import NamedTuple

FULL = 4500
"""ArduRover's steering runs from -4500 to 4500, positive turns clockwise."""
EXPO_LIMIT = 0.95
SHORTEST_US, LONGEST_US = 500, 2500
"""Pulse widths [us] beyond these are no calibration of a servo or a radio."""


class SteeringChannel(NamedTuple):
    """The firmware's parameters on the way from steering input to rudder servo, pulses in microseconds."""

    rc_min: int = 1100
    rc_trim: int = 1500
    rc_max: int = 1900
    rc_dead_zone: int = 30
    rc_reversed: bool = False
    servo_min: int = 1100
    servo_trim: int = 1500
    servo_max: int = 1900
    servo_reversed: bool = False
    expo: float = 0.0
    scale: tuple[float, float, float] | None = None
    """Pulses [us] at -1, 0 and 1 of full rudder; None: the servo's own end points and trim."""

    def check(self) -> None:
        """Raise ValueError where the end points are no pulse widths, or leave no room to steer."""
        pulses = (self.rc_min, self.rc_trim, self.rc_max, self.servo_min, self.servo_trim, self.servo_max)
        if not all(SHORTEST_US <= pulse <= LONGEST_US for pulse in pulses) or not 0 <= self.rc_dead_zone <= LONGEST_US:
            raise ValueError(f"pulses go from {SHORTEST_US} to {LONGEST_US} us: {self}")
        for name, low, trim, high in (
            ("steering input", self.rc_min + self.rc_dead_zone, self.rc_trim, self.rc_max - self.rc_dead_zone),
            ("steering servo", self.servo_min, self.servo_trim, self.servo_max),
            ("helm.servo_us", *(self.scale or (SHORTEST_US, SHORTEST_US + 1, LONGEST_US))),
        ):
            if not low < trim < high:
                raise ValueError(f"{name}: minimum, trim and maximum must rise with room for the dead zone: {self}")


def steering_from_pulse(channel: SteeringChannel, pulse: int) -> int:
    """Return the steering -4500..4500 that the firmware reads from an input `pulse` [us]."""
    high = channel.rc_trim + channel.rc_dead_zone
    low = channel.rc_trim - channel.rc_dead_zone
    held = min(max(pulse, channel.rc_min), channel.rc_max)
    if held > high:
        steering = FULL * (held - high) // (channel.rc_max - high)
    elif held < low:
        steering = -(FULL * (low - held) // (low - channel.rc_min))
    else:
        steering = 0
    return -steering if channel.rc_reversed else steering


def servo_from_steering(channel: SteeringChannel, steering: int) -> int:
    """Return the servo pulse [us] for `steering` -4500..4500."""
    held = min(max(_with_expo(channel.expo, steering), -FULL), FULL)
    if channel.servo_reversed:
        held = -held
    if held > 0:
        return channel.servo_trim + held * (channel.servo_max - channel.servo_trim) // FULL
    return channel.servo_trim - (-held * (channel.servo_trim - channel.servo_min) // FULL)


def share_from_servo(channel: SteeringChannel, pulse: int) -> float:
    """Return the share of full rudder, starboard positive, that a servo `pulse` [us] stands for.

    It is held to -1..1, unless the channel has a scale of its own: a servo may go beyond it.
    """
    low, trim, high = channel.scale or (channel.servo_min, channel.servo_trim, channel.servo_max)
    away = pulse - trim
    share = away / (high - trim if away > 0 else trim - low)
    if channel.scale is None:
        share = min(max(share, -1.0), 1.0)
    return -share if channel.servo_reversed else share


def reach(channel: SteeringChannel) -> float:
    """Return the share of full rudder that the servo's end points let it reach to both sides."""
    return min(abs(share_from_servo(channel, pulse)) for pulse in (channel.servo_min, channel.servo_max))


def pulse_from_manual(channel: SteeringChannel, y: int) -> int:
    """Return the input pulse [us] that MANUAL_CONTROL's `y`, -1000..1000, is turned into."""
    return int(channel.rc_min + (channel.rc_max - channel.rc_min) * (y + 1000) / 2000.0)


class InputTable:
    """The input, pulse or stick, for every share of full rudder that the servo can show."""

    def __init__(self, inputs: Iterable[int], share_of: Callable[[int], float], neutral: int) -> None:
        by_share: dict[float, list[int]] = {}
        for value in inputs:
            by_share.setdefault(share_of(value), []).append(value)
        self._shares = sorted(by_share)
        self._inputs = [_middle(by_share[share], neutral) for share in self._shares]

    def nearest(self, share: float) -> int:
        """Return the input that brings the servo nearest to `share` of full rudder."""
        shares = self._shares
        place = bisect_left(shares, share)
        if place == 0:
            return self._inputs[0]
        if place == len(shares):
            return self._inputs[-1]
        if shares[place] - share > share - shares[place - 1]:
            place -= 1
        return self._inputs[place]


def pulse_table(channel: SteeringChannel) -> InputTable:
    """Return the table of input pulses [us] for RC_CHANNELS_OVERRIDE; ValueError where the channel cannot steer."""
    channel.check()
    return InputTable(range(channel.rc_min, channel.rc_max + 1), _share_of_pulse(channel), _neutral(channel))


def manual_table(channel: SteeringChannel) -> InputTable:
    """Return the table of MANUAL_CONTROL `y`, -1000..1000; ValueError where the channel cannot steer."""
    channel.check()
    of_pulse = _share_of_pulse(channel)
    neutral = round(2000.0 * (_neutral(channel) - channel.rc_min) / (channel.rc_max - channel.rc_min)) - 1000
    return InputTable(range(-1000, 1001), lambda y: of_pulse(pulse_from_manual(channel, y)), neutral)


def _neutral(channel: SteeringChannel) -> int:
    """Amidships, half a dead zone off the trim: the rudder does not move for it, and RC_CHANNELS can tell it from a
    stick at rest. At the trim itself a vehicle that ignores us would seem to obey for as long as the rudder rests.
    """
    return channel.rc_trim + channel.rc_dead_zone // 2


def _share_of_pulse(channel: SteeringChannel) -> Callable[[int], float]:
    def share(pulse: int) -> float:
        return share_from_servo(channel, servo_from_steering(channel, steering_from_pulse(channel, pulse)))

    return share


def _middle(values: list[int], neutral: int) -> int:
    return neutral if neutral in values else values[len(values) // 2]


def _with_expo(expo: float, steering: int) -> int:
    if expo == 0.0 or expo >= EXPO_LIMIT:
        return steering
    share = steering / FULL
    return int(FULL * ((1.0 - expo) * share + expo * share**3))
