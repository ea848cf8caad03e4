"""Pololu Jrk G2: a position servo with feedback, commanded by target, asked for its variables. Pure.

    set target   0xC0 + lower 5 bits, upper 7 bits        0 ... 4095, 2048 in the middle
    motor off    0xFF
    variables    0xE5, offset, length -> `length` bytes, without frame or checksum

In the Pololu protocol 0xAA and the device number go before, and the command byte loses its top bit. Because answers
have no checksum, one is believed only when its length is right, every value in it is possible, and, while we steer,
the target in it is one that we have sent.

Source: Pololu, Jrk G2 User's Guide, sections 10 to 12 (variables, commands, serial encoding), and the register
names of Pololu's Arduino library for it.
"""

from __future__ import annotations

import math
import struct
from collections import deque

from autopilot.links.drives import SILENT_S, DriveSettings, JumpGate, StallWatch
from autopilot.signals import AlarmEvent

SET_TARGET, MOTOR_OFF, GET_VARIABLES = 0xC0, 0xFF, 0xE5
TARGET_MAX = 4095
MIDDLE = 2048
SPAN = 2047
MOTION = (0x02, struct.Struct("<HHHhhh"))
"""Target, feedback, scaled feedback, integral, duty cycle target, duty cycle, from this offset."""
HEALTH = (0x12, struct.Struct("<HHBHH"))
"""Errors that halt, errors that occurred, force mode, supply [mV], current [mA], from this offset."""
ERRORS = (
    "it waits for a command",
    "it has no motor power; switch it on",
    "its motor driver reports an error; check motor and wiring",
    "its input is invalid; set its input mode to serial",
    "its input is disconnected; set its input mode to serial",
    "its feedback is disconnected; check the rudder sensor",
    "its motor drew too much current; look whether the rudder is jammed",
    "the serial line is noisy; check the wiring and ground",
    "its serial buffer overran; lower drive.rate_hz",
    "its serial buffer was full; lower drive.rate_hz",
    "commands came without the checksum it is set to expect; switch CRC off in its settings",
    "it received commands it does not know; check drive.device",
    "it heard no command in time; check the line",
    "its motor drew far too much current; look whether the rudder is jammed",
)
AWAITING_COMMAND = 0x0001
WAIT_S = 0.3
"""An answer later than this is none; what comes after it is dropped until the next request."""
QUIET_S = 0.05
TARGETS_KEPT = 16
DUTY_MAX = 600
SUPPLY_MAX_MV = 60000


class JrkG2:
    """A `Drive`."""

    name = "Jrk motor controller"
    lapse = "it holds the last target, or lets go after the serial timeout in its settings"
    measures = True

    def __init__(self, settings: DriveSettings) -> None:
        self.rejected = 0
        self.supply = 0.0
        self.errors = 0
        self._settings = settings
        self._targets: deque[int] = deque(maxlen=TARGETS_KEPT)
        self._buffer = b""
        self._asked: tuple[int, struct.Struct] | None = None
        self._asked_time = math.nan
        self._turn = 0
        self._received = -math.inf
        self._engaged_since = math.inf
        self._has_released = False
        self._stall = StallWatch(settings.current_max)
        self._gate = JumpGate(settings)

    def feed(self, now: float, data: bytes) -> list[float]:
        """Return the rudder angle [rad] in the answer that `data` completes."""
        if self._asked is None or now - self._asked_time > WAIT_S:
            self.rejected += bool(data)
            self._buffer = b""
            return []
        self._buffer += data
        layout = self._asked[1]
        if len(self._buffer) < layout.size:
            return []
        answer, self._buffer = self._buffer, b""
        asked, self._asked = self._asked, None
        if len(answer) > layout.size:
            self.rejected += 1
            return []
        return self._take(now, asked, layout.unpack(answer))

    def _take(self, now: float, asked: tuple[int, struct.Struct], values: tuple[int, ...]) -> list[float]:
        is_motion = asked is MOTION
        if not (self._is_motion(values) if is_motion else _is_health(values)):
            self.rejected += 1
            return []
        self._received = now
        if is_motion:
            angle = self._settings.angle((values[2] - MIDDLE) / SPAN)
            if self._gate.passes(now, angle):
                return [angle]
            self.rejected += 1
            return []
        self.errors = values[0]
        self._has_released = self._engaged_since == math.inf and bool(values[0] & AWAITING_COMMAND)
        self.supply = values[3] / 1000.0
        self._stall.take(now, values[4] / 1000.0)
        return []

    def _is_motion(self, values: tuple[int, ...]) -> bool:
        target, feedback, scaled, _, _, duty = values
        return (
            max(target, feedback, scaled) <= TARGET_MAX
            and abs(duty) <= DUTY_MAX
            and (not self._targets or target in self._targets)
        )

    def order(self, now: float, angle: float) -> bytes:
        """Return the command that sets the target for `angle` [rad]."""
        self._engaged_since = min(self._engaged_since, now)
        target = min(max(MIDDLE + round(self._settings.place(angle) * SPAN), 0), TARGET_MAX)
        if not self._targets or self._targets[-1] != target:
            self._targets.append(target)
        return self._settings.pololu(SET_TARGET | target & 0x1F, target >> 5)

    def release(self, now: float) -> bytes:
        """Return the command that switches the motor off."""
        self._engaged_since, self._has_released = math.inf, False
        return self._settings.pololu(MOTOR_OFF)

    def has_released(self) -> bool:
        """Return whether the controller has reported since the release that it waits for a command, its motor off."""
        return self._has_released

    def ask(self, now: float) -> bytes:
        """Return the next request once the last was answered or is overdue."""
        if self._asked is not None and now - self._asked_time <= WAIT_S + QUIET_S:
            return b""
        if self._asked is not None:
            self.rejected += 1
        self._buffer = b""
        self._turn += 1
        self._asked = HEALTH if self._turn % 4 == 0 else MOTION
        self._asked_time = now
        return self._settings.pololu(GET_VARIABLES, self._asked[0], self._asked[1].size)

    def fault(self, now: float) -> str:
        """Return why the controller cannot turn the rudder; empty where it can."""
        if now - self._received > SILENT_S:
            return f"the {self.name} does not answer; check its power, line, baud rate and drive.device"
        halting = self.errors & ~AWAITING_COMMAND
        # what it reports may be older than our first command
        if halting and now - self._engaged_since > SILENT_S:
            bit = (halting & -halting).bit_length() - 1
            return f"the {self.name} has stopped: {ERRORS[bit]}"
        return ""

    def warning(self, now: float) -> AlarmEvent | None:
        """Return the alarm of a stalled motor, or None."""
        return self._stall.warning(now)


def _is_health(values: tuple[int, ...]) -> bool:
    halting, occurred, force_mode, supply, _ = values
    return max(halting, occurred) < 1 << len(ERRORS) and force_mode & 0x03 < 3 and supply <= SUPPLY_MAX_MV
