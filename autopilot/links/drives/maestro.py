"""Pololu Maestro: a servo on one channel, or the on/off valves of a hydraulic steering gear on two. Pure.

The servo is commanded by pulse width, and nothing is fed back of the rudder itself.

    set target     0x84, channel, lower 7 bits, upper 7 bits     quarter microseconds; 0 stops the pulses
    get position   0x90, channel -> 2 bytes, low first           the pulse given now, not where the rudder is
    get errors     0xA1 -> 2 bytes, and clears them

In the Pololu protocol 0xAA and the device number go before, and the command byte loses its top bit. The scale
-1 ... 1 is 1000 ... 2000 us.

Source: Pololu, Maestro Servo Controller User's Guide, sections 5.c and 5.e.

Valves are on two digital outputs. Channel n opens the valve to port and n + 1 the one to starboard: 6000 and more is
on, less is off. A rudder sensor may be wired to an analogue input of the same board, which is asked for with the same
request:

    get position   0x90, channel -> 2 bytes, low first       0 ... 1023 of an input, the target of an output

When to open and to shut is worked out in `autopilot.models.steering_gear`. Without a sensor the rudder is reckoned from
the time for which each valve was open; that drifts, and the law's own estimate of a bias takes it up.

Source: Pololu, Maestro Servo Controller User's Guide, sections 4.b, 5.b and 5.e.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections import deque

from autopilot.errors import InputError
from autopilot.links.drives import SILENT_S, AskedDrive, DriveSettings, JumpGate
from autopilot.models.steering_gear import (
    LEAK_SHARE,
    Gate,
    Leak,
    Reckoned,
    Swing,
    corrected,
    leaked,
    reckoned,
    switched,
    swung,
    zone_in,
)
from autopilot.signals import AlarmEvent

SET_TARGET, GET_POSITION, GET_ERRORS = 0x84, 0x90, 0xA1
BOARD = "Maestro servo controller"
MIDDLE_US, SPAN_US, QUARTERS = 1500.0, 500.0, 4
ANSWER = 2
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


class _Board(AskedDrive):
    """A Maestro: requests for the value of a channel or for the errors, and what it answers."""

    def __init__(self, settings: DriveSettings) -> None:
        super().__init__(settings)
        self._asked = GET_ERRORS
        """The channel whose value was asked for, or GET_ERRORS."""
        self._warning: AlarmEvent | None = None

    @abstractmethod
    def _next(self) -> int:
        """Return what is asked for next: a channel, or GET_ERRORS."""

    @abstractmethod
    def _is_possible(self, channel: int, value: int) -> bool:
        """Return whether a channel can have the value."""

    @abstractmethod
    def _take(self, now: float, channel: int, value: int) -> list[float]:
        """Return the rudder angle [rad] that the value of a channel tells, if any."""

    def _answered(self, now: float, answer: bytes) -> list[float] | None:
        value = int.from_bytes(answer, "little")
        if self._asked != GET_ERRORS:
            return self._take(now, self._asked, value) if self._is_possible(self._asked, value) else None
        if value >= 1 << len(ERRORS):
            return None
        bit = (value & -value).bit_length() - 1
        self._warning = AlarmEvent("drive_warning", f"{BOARD}: {ERRORS[bit]}") if value else None
        return []

    def _request(self) -> tuple[bytes, int]:
        self._asked = self._next()
        ours = (GET_ERRORS,) if self._asked == GET_ERRORS else (GET_POSITION, self._asked)
        return self._settings.pololu(*ours), ANSWER

    def warning(self, now: float) -> AlarmEvent | None:
        """Return the error that the board reported last, or None."""
        return self._warning


class Maestro(_Board):
    """A `Drive` that cannot see the rudder: what it returns is the pulse that it gives."""

    name = BOARD
    lapse = "it holds the last pulse, or stops it after the serial timeout in its settings"
    measures = False

    def __init__(self, settings: DriveSettings) -> None:
        super().__init__(settings)
        self._targets: deque[int] = deque(maxlen=TARGETS_KEPT)
        self._turn = 0
        self._engaged = False
        self._position = 0

    def _next(self) -> int:
        self._turn += 1
        return GET_ERRORS if self._turn % 8 == 0 else self._settings.channel

    def _take(self, now: float, channel: int, value: int) -> list[float]:
        self._position = value
        self._has_released = not self._engaged and value == 0
        if not self._engaged or not value:
            return []
        return [self._settings.angle((value / QUARTERS - MIDDLE_US) / SPAN_US)]

    def _is_possible(self, channel: int, value: int) -> bool:
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


OFF, ON = 4000, 8000
"""Quarter microseconds: clearly below and above 6000."""
SWITCHES_AT = 6000
INPUT_MOST = 1023
UNSURE_COUNTS = 2.0
"""Of an analogue input: what the angle that it shows may be wrong by."""
REST_S = 1.0
"""A sensor that has not been heard for this long is not reckoned on from."""


class ValveDrive(_Board):
    """A `Drive`. Opens and shuts valves; knows the rudder by its sensor, or reckons it."""

    name = "steering valves"
    lapse = "the valves shut by the Maestro's serial timeout; without one they stay as they are"

    def __init__(self, settings: DriveSettings) -> None:
        if settings.valve is None:
            raise InputError(
                "valve: rudder.rate_max_deg_s is null; valves need the rate at which the pump moves the rudder"
            )
        super().__init__(settings)
        self.measures = settings.sensor_channel is not None
        self.openings = 0
        self.open_s = 0.0
        self._valve = settings.valve
        self._turn = 1.0 / settings.order_rate_hz
        unsure = UNSURE_COUNTS * 2.0 / INPUT_MOST * settings.angle_at_full if self.measures else 0.0
        self.zone = max(self._valve.zone(self._turn, unsure), settings.dead_band)
        self._gate, self._rudder, self._swing = Gate(), Reckoned(), Swing()
        self._leak, self._leaks = Leak(), ""
        self._engaged_s, self._last = 0.0, math.nan
        self._turns = 0
        self._seen = -math.inf
        self._shown = {self._channel(-1): True, self._channel(1): True}
        self._jumps = JumpGate(settings)
        port, starboard = self._shown
        sensor = settings.sensor_channel
        often = (port, starboard) if sensor is None else (sensor, sensor, port, sensor, sensor, starboard)
        self._cycle = 2 * often + (GET_ERRORS,)

    def _channel(self, side: int) -> int:
        is_second = (side > 0) != self._settings.reversed
        return self._settings.channel + is_second

    def _next(self) -> int:
        self._turns += 1
        return self._cycle[(self._turns - 1) % len(self._cycle)]

    def _take(self, now: float, channel: int, value: int) -> list[float]:
        """Return the rudder angle [rad] that is measured, or reckoned."""
        if channel != self._settings.sensor_channel:
            self._shown[channel] = value >= SWITCHES_AT
            return [self._rudder.angle] if not (self.measures or math.isnan(self._last)) else []
        angle = self._settings.angle(2.0 * value / INPUT_MOST - 1.0)
        if not self._jumps.passes(now, angle):
            self.rejected += 1
            return []
        self._move_on(now)
        age = now - self._seen
        self._rudder = corrected(self._rudder, angle, age if age <= REST_S else math.inf)
        self._seen = now
        if not math.isnan(self._last):
            self._leak = leaked(self._valve, self._leak, self._gate, now, angle)
        return [angle]

    def _is_possible(self, channel: int, value: int) -> bool:
        return value <= INPUT_MOST if channel == self._settings.sensor_channel else value in (0, OFF, ON)

    def _move_on(self, now: float) -> None:
        if self._gate.side and self._rudder.time < now:
            self.open_s += now - self._rudder.time
        self._rudder = reckoned(self._valve, self._settings.stop, self._gate, self._rudder, now)

    def order(self, now: float, angle: float) -> bytes:
        """Return the commands that bring the rudder to `angle` [rad]: which valve is open, and that no other is."""
        dt = 0.0 if math.isnan(self._last) else now - self._last
        if math.isnan(self._last):
            self._swing, self._leak = Swing(), Leak()
            if not self.measures:
                self._rudder = Reckoned(0.0, 0.0, now)  # as a hand leaves it that has steered straight on
        self._engaged_s += dt
        self._last = now
        self._move_on(now)
        stop = self._settings.stop
        before = self._gate
        if self.measures and now - self._seen > REST_S:
            self._gate = Gate(0, now, before.side)
        else:
            wanted = min(max(angle, -stop), stop)
            self._swing = swung(self._swing, self.zone, wanted, dt)
            # a reckoned rudder is wrong by more the less often it is moved: there the zone stays what it is
            zone = zone_in(self._swing, self.zone) if self.measures else self.zone
            self._gate = switched(self._valve, zone, self._turn, before, self._rudder, wanted)
        self.openings += self._gate.side != 0 and before.side == 0
        return self._outputs()

    def _outputs(self) -> bytes:
        # what shuts goes first: never both at once
        sides = sorted((-1, 1), key=lambda side: side == self._gate.side)
        return b"".join(self._output(side, side == self._gate.side) for side in sides)

    def _output(self, side: int, is_on: bool) -> bytes:
        target = ON if is_on else OFF
        return self._settings.pololu(SET_TARGET, self._channel(side), target & 0x7F, target >> 7)

    def release(self, now: float) -> bytes:
        """Return the commands that shut both valves."""
        self._move_on(now)
        if self._gate.side:
            self._gate = Gate(0, now, self._gate.side)
        self._last = math.nan
        self._shown = dict.fromkeys(self._shown, True)
        return self._outputs()

    def has_released(self) -> bool:
        """Return whether the board has answered since the release that both outputs are off."""
        return not any(self._shown.values())

    def warning(self, now: float) -> AlarmEvent | None:
        """Return that the rudder moves behind shut valves, or the error that the board reported last; None for neither.

        The weaker of two valves that is stuck open is held by the other one, and a leak by many openings: the course is
        held, and nothing else tells of it.
        """
        rate, least = self._leak.rate, LEAK_SHARE * min(self._valve.port, self._valve.starboard)
        if abs(rate) < 0.5 * least:
            self._leaks = ""
        elif abs(rate) > least and not self._leaks:
            side = "starboard" if rate > 0.0 else "port"
            self._leaks = f"with both valves shut the rudder moves to {side}: a valve that does not close, or a leak"
        return AlarmEvent("drive_warning", self._leaks) if self._leaks else super().warning(now)

    def fault(self, now: float) -> str:
        """Return why the valves cannot turn the rudder; empty where they can."""
        if now - self._received > SILENT_S:
            return (
                "the Maestro of the steering valves does not answer; check its power, line, baud rate and drive.device"
            )
        if self.measures and now - self._seen > SILENT_S:
            return "the rudder sensor on drive.valve.sensor_channel shows no angle; check its wiring"
        return ""

    def usage(self) -> str:
        """Return how often and how long the valves were open, a clause; empty before the first order."""
        if self._engaged_s <= 0.0:
            return ""
        hourly = 3600.0 / self._engaged_s
        return (
            f"valves opened {self.openings} times in {self._engaged_s / 3600.0:.2f} h ({self.openings * hourly:.0f} an "
            f"hour), the pump at work for {100.0 * self.open_s / self._engaged_s:.0f} % of it; dead zone "
            f"{math.degrees(self.zone):.1f} deg"
        )
