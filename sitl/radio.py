"""Pulse widths as ArduRover computes with them: RC inputs with dead zone, servo outputs, overrides.

Integers are truncated where the firmware truncates (ArduPilot, libraries/RC_Channel and libraries/SRV_Channel):
with 1000/1500/2000 and a dead zone of 30, an input of 1560 us leaves the servo at 1531 us.
"""

from __future__ import annotations

from typing import NamedTuple

CHANNELS = 16
STEERING_FULL = 4500
THROTTLE_FULL = 100
PULSE_MAX = 65535
RELEASED = 0
LEFT_ALONE = 65535
LEFT_ALONE_HIGH = (0, 65535)
"""Channels 9 and up: zero leaves alone too, and 65534 releases."""
RELEASED_HIGH = 65534


class Calibration(NamedTuple):
    """Pulse widths [us] of one channel: RCn_MIN, _TRIM, _MAX, _DZ, _REVERSED (servo outputs have no dead zone)."""

    low: int
    trim: int
    high: int
    dead_zone: int = 0
    is_reversed: bool = False


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


def output_pulse(servo: Calibration, position: float, full: int) -> int:
    """Return the pulse width [us] of a servo at `position` in [-full, full]; never outside low to high."""
    held = min(max(-position if servo.is_reversed else position, -full), full)
    if held > 0:
        pulse = servo.trim + int(held * (servo.high - servo.trim) / full)
    else:
        pulse = servo.trim - int(-held * (servo.trim - servo.low) / full)
    return _sent(min(max(pulse, servo.low), servo.high))


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
