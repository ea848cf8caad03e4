"""Pololu Maestro: a servo on one channel, commanded by pulse width; no feedback of the rudder itself. Pure.

    set target     0x84, channel, lower 7 bits, upper 7 bits     quarter microseconds; 0 stops the pulses
    get position   0x90, channel -> 2 bytes, low first           the pulse given now, not where the rudder is
    get errors     0xA1 -> 2 bytes, and clears them

In the Pololu protocol 0xAA and the device number go before, and the command byte loses its top bit. The scale
-1 ... 1 is 1000 ... 2000 us.

Source: Pololu, Maestro Servo Controller User's Guide, sections 5.c and 5.e.
"""

from __future__ import annotations

import math
from collections import deque

from autopilot.links.drives.base import SILENT_S, DriveSettings
from autopilot.signals import AlarmEvent

SET_TARGET, GET_POSITION, GET_ERRORS = 0x84, 0x90, 0xA1
MIDDLE_US, SPAN_US, QUARTERS = 1500.0, 500.0, 4
ANSWER = 2
WAIT_S = 0.3
QUIET_S = 0.05
TARGETS_KEPT = 64
PULSE_MIN, PULSE_MAX = 256, 16383
ERRORS = (
    "the serial line is noisy; check the wiring and ground",
    "its serial buffer overran; lower drive.rate_hz",
    "its serial buffer was full; lower drive.rate_hz",
    "commands came without the checksum it is set to expect; switch CRC off in its settings",
    "it received commands it does not know; check drive.device and drive.channel",
    "it heard no command in time; check the line",
    "its script ran over its stack; remove the script",
    "its script called too deep; remove the script",
    "its script left its memory; remove the script",
)


class Maestro:
    """A `Drive` that cannot see the rudder: what it returns is the pulse that it gives."""

    name = "Maestro servo controller"
    lapse = "it holds the last pulse, or stops it after the serial timeout in its settings"
    measures = False

    def __init__(self, settings: DriveSettings) -> None:
        self.rejected = 0
        self._settings = settings
        self._targets: deque[int] = deque(maxlen=TARGETS_KEPT)
        self._buffer = b""
        self._asked = 0
        self._asked_time = math.nan
        self._turn = 0
        self._received = -math.inf
        self._warning: AlarmEvent | None = None
        self._engaged = self._has_released = False
        self._position = 0

    def feed(self, now: float, data: bytes) -> list[float]:
        """Return the angle [rad] of the pulse in the answer that `data` completes."""
        if not self._asked or now - self._asked_time > WAIT_S:
            self.rejected += bool(data)
            self._buffer = b""
            return []
        self._buffer += data
        if len(self._buffer) < ANSWER:
            return []
        answer, self._buffer = self._buffer, b""
        asked, self._asked = self._asked, 0
        value = int.from_bytes(answer, "little")
        if len(answer) > ANSWER or not self._is_possible(asked, value):
            self.rejected += 1
            return []
        self._received = now
        if asked == GET_POSITION:
            self._position = value
            self._has_released = not self._engaged and value == 0
        if asked == GET_ERRORS:
            bit = (value & -value).bit_length() - 1
            self._warning = AlarmEvent("drive_warning", f"{self.name}: {ERRORS[bit]}") if value else None
            return []
        if not self._engaged or not value:
            return []
        return [self._settings.angle((value / QUARTERS - MIDDLE_US) / SPAN_US)]

    def _is_possible(self, asked: int, value: int) -> bool:
        if asked == GET_ERRORS:
            return value < 1 << len(ERRORS)
        if not self._engaged:
            return value == 0 or PULSE_MIN <= value <= PULSE_MAX
        # with speed and acceleration limits it is anywhere between the targets of late
        places = (self._position or self._targets[-1], *self._targets)
        return value == 0 or min(places) <= value <= max(places)

    def order(self, now: float, angle: float) -> bytes:
        """Return the command that sets the pulse for `angle` [rad]."""
        self._engaged = True
        target = round((MIDDLE_US + SPAN_US * self._settings.place(angle)) * QUARTERS)
        self._targets.append(target)
        return self._settings.pololu(SET_TARGET, self._settings.channel, target & 0x7F, target >> 7)

    def release(self, now: float) -> bytes:
        """Return the command that stops the pulses: the servo goes limp."""
        self._engaged = self._has_released = False
        self._targets.clear()
        return self._settings.pololu(SET_TARGET, self._settings.channel, 0, 0)

    def has_released(self) -> bool:
        """Return whether the controller has answered since the release that it gives no pulse."""
        return self._has_released

    def ask(self, now: float) -> bytes:
        """Return the next request once the last was answered or is overdue."""
        if self._asked and now - self._asked_time <= WAIT_S + QUIET_S:
            return b""
        self.rejected += bool(self._asked)
        self._buffer = b""
        self._turn += 1
        self._asked = GET_ERRORS if self._turn % 8 == 0 else GET_POSITION
        self._asked_time = now
        if self._asked == GET_ERRORS:
            return self._settings.pololu(GET_ERRORS)
        return self._settings.pololu(GET_POSITION, self._settings.channel)

    def fault(self, now: float) -> str:
        """Return why the controller cannot move the servo; empty where it can."""
        if now - self._received > SILENT_S:
            return f"the {self.name} does not answer; check its power, line, baud rate and drive.device"
        return ""

    def warning(self, now: float) -> AlarmEvent | None:
        """Return the error it reported last, or None."""
        return self._warning
