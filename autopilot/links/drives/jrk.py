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

from autopilot.links.drives import SILENT_S, AskedDrive, DriveSettings, JumpGate, StallWatch
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
TARGETS_KEPT = 16
DUTY_MAX = 600
SUPPLY_MAX_MV = 60000


class JrkG2(AskedDrive):
    """A `Drive`."""

    name = "Jrk motor controller"
    lapse = "it holds the last target, or lets go after the serial timeout in its settings"

    def __init__(self, settings: DriveSettings) -> None:
        super().__init__(settings)
        self.supply = 0.0
        self.errors = 0
        self._targets: deque[int] = deque(maxlen=TARGETS_KEPT)
        self._asked = MOTION
        self._turn = 0
        self._engaged_since = math.inf
        self._stall = StallWatch(settings.current_max)
        self._gate = JumpGate(settings)

    def _answered(self, now: float, answer: bytes) -> list[float] | None:
        values = self._asked[1].unpack(answer)
        if self._asked is MOTION:
            if not self._is_motion(values):
                return None
            angle = self._settings.angle((values[2] - MIDDLE) / SPAN)
            if self._gate.passes(now, angle):
                return [angle]
            self.rejected += 1
            return []
        if not _is_health(values):
            return None
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

    def _request(self) -> tuple[bytes, int]:
        self._turn += 1
        self._asked = HEALTH if self._turn % 4 == 0 else MOTION
        place, layout = self._asked
        return self._settings.pololu(GET_VARIABLES, place, layout.size), layout.size

    def fault(self, now: float) -> str:
        """Return why the controller cannot turn the rudder; empty where it can."""
        if silent := super().fault(now):
            return silent
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
