"""pypilot's motor controller: four-byte packets, a motor speed to give, a rudder angle and currents to read. Pure.

    code, low byte, high byte, crc          crc-8 of the three, polynomial 0x31, from 0xFF, not reflected

The controller takes a motor *speed* (0 full astern ... 1000 stop ... 2000 full ahead; within 100 of 1000 nothing
moves), so the rudder's position loop is here: proportional inside `SLOWING_S` of travel, full speed beyond. Ahead
moves the rudder sensor's reading up, which is to port.

Source: the pypilot project, arduino/motor/motor.ino and pypilot/arduino_servo (GPL-3.0; protocol facts only).
"""

from __future__ import annotations

import math

from autopilot.links.drives import SILENT_S, Drive, DriveSettings, JumpGate, StallWatch
from autopilot.signals import AlarmEvent

COMMAND, RESET, DISENGAGE = 0xC7, 0xE7, 0x68
MAX_CURRENT, RUDDER_MIN, RUDDER_MAX = 0x1E, 0x2B, 0x4D
CURRENT, VOLTAGE, CONTROLLER_TEMPERATURE, MOTOR_TEMPERATURE = 0x1C, 0xB3, 0xF9, 0x48
RUDDER, FLAGS, EEPROM_VALUE = 0xA7, 0x8F, 0x9A
REPORTS = (CURRENT, VOLTAGE, CONTROLLER_TEMPERATURE, MOTOR_TEMPERATURE, RUDDER, FLAGS, EEPROM_VALUE)

OVERTEMPERATURE, OVERCURRENT, CLUTCHED, BAD_VOLTAGE = 0x0002, 0x0004, 0x0008, 0x0080
PORT_SWITCH, STARBOARD_SWITCH = 0x0020, 0x0040
RUDDER_AT_MIN, RUDDER_AT_MAX = 0x0100, 0x0200
FAULTS = {
    OVERTEMPERATURE: "it is too hot; let it cool",
    OVERCURRENT: "its motor drew too much current; look whether the rudder is jammed",
    BAD_VOLTAGE: "its supply voltage is out of range; check battery and wiring",
}
STOPS = {
    PORT_SWITCH: "the port limit switch is pressed",
    STARBOARD_SWITCH: "the starboard limit switch is pressed",
    RUDDER_AT_MIN: "the rudder sensor is at the low end stop",
    RUDDER_AT_MAX: "the rudder sensor is at the high end stop",
}
NEUTRAL, NOTHING_MOVES, FULL = 1000, 100, 1000
SENSOR_FULL = 65472
NO_SENSOR = 65535
PACKET = 4
IN_SYNC = 2
"""Packets in a row with a right checksum before anything is believed; an eighth of a byte of checksum is not much."""
SLOWING_S = 0.4
DEAD_BAND = math.radians(0.4)
SLOWEST = 0.15
SETTINGS_EVERY = 20
"""Limits are repeated after so many orders: the controller forgets them when its power fails."""


def crc8(data: bytes) -> int:
    """Return the controller's checksum of `data`."""
    crc = 0xFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc << 1 ^ 0x31 if crc & 0x80 else crc << 1) & 0xFF
    return crc


def packet(code: int, value: int) -> bytes:
    """Return the packet that carries `value` (0 to 65535) under `code`."""
    body = bytes((code, value & 0xFF, value >> 8))
    return body + bytes((crc8(body),))


class PypilotMotor(Drive):
    """A `Drive`. Needs the controller's rudder sensor: without one there is nothing to position the rudder by."""

    name = "pypilot motor controller"
    lapse = "the controller lets go by itself when no more orders come"

    def __init__(self, settings: DriveSettings) -> None:
        super().__init__(settings)
        self.voltage = 0.0
        self.flags = 0
        self._in_a_row = 0
        self._angle: float | None = None
        self._angle_time = -math.inf
        self._stall = StallWatch(settings.current_max)
        self._gate = JumpGate(settings)
        self._engaged = False
        self._orders = 0

    def feed(self, now: float, data: bytes) -> list[float]:
        """Return the rudder angles [rad] in `data`; packets count after two in a row were right."""
        angles: list[float] = []
        self._buffer += data
        place = 0
        while place + PACKET <= len(self._buffer):
            body = self._buffer[place : place + 3]
            if body[0] in REPORTS and crc8(body) == self._buffer[place + 3]:
                if self._in_a_row >= IN_SYNC:
                    self._take(now, body[0], body[1] | body[2] << 8, angles)
                else:
                    self._in_a_row += 1
                place += PACKET
            else:
                self.rejected += 1
                self._in_a_row = 0
                place += 1
        self._buffer = self._buffer[place:]
        return angles

    def _take(self, now: float, code: int, value: int, angles: list[float]) -> None:
        self._received = now
        if code == FLAGS:
            self.flags = value
            self._has_released = not self._engaged and not value & CLUTCHED
        elif code == CURRENT:
            self._stall.take(now, value / 100.0)
        elif code == VOLTAGE:
            self.voltage = value / 100.0
        elif code == RUDDER and value == NO_SENSOR:
            self._angle = None
        elif code == RUDDER and value <= SENSOR_FULL:
            # a rising reading is a rudder going to port
            angle = -self._settings.angle(2.0 * value / SENSOR_FULL - 1.0)
            if not self._gate.passes(now, angle):
                self.rejected += 1
                return
            self._angle, self._angle_time = angle, now
            angles.append(angle)

    def order(self, now: float, angle: float) -> bytes:
        """Return the motor speed that brings the rudder to `angle` [rad], with the limits now and then."""
        data = b""
        if not self._engaged:
            self._engaged, self._orders = True, 0
            data = packet(RESET, 0)
        if self._orders % SETTINGS_EVERY == 0:
            data += self._limits()
        self._orders += 1
        if self._angle is None or now - self._angle_time > SILENT_S:
            return data + packet(COMMAND, NEUTRAL)
        stop = self._settings.stop
        return data + packet(COMMAND, self._speed(min(max(angle, -stop), stop) - self._angle))

    def _speed(self, error: float) -> int:
        if abs(error) < DEAD_BAND:
            return NEUTRAL
        rate = self._settings.rate if math.isfinite(self._settings.rate) else self._settings.angle_at_full
        share = min(max(abs(error) / (rate * SLOWING_S), SLOWEST), 1.0)
        # within NOTHING_MOVES of neutral the bridge is off; to starboard the reading must fall
        away = NOTHING_MOVES + round(share * (FULL - NOTHING_MOVES))
        is_ahead = (error < 0.0) != self._settings.reversed
        return NEUTRAL + away if is_ahead else NEUTRAL - away

    def _limits(self) -> bytes:
        ends = sorted(self._settings.place(end) for end in (-self._settings.stop, self._settings.stop))
        low, high = (round((end + 1.0) / 2.0 * SENSOR_FULL) for end in ends)
        data = packet(RUDDER_MIN, low) + packet(RUDDER_MAX, high)
        if self._settings.current_max is not None:
            data += packet(MAX_CURRENT, round(self._settings.current_max * 100.0))
        return data

    def release(self, now: float) -> bytes:
        """Return the packet that lets clutch and motor go."""
        self._engaged = self._has_released = False
        return packet(DISENGAGE, 0)

    def ask(self, now: float) -> bytes:
        """Return a disengage while the rudder is not ours: the controller reports only as often as it is spoken to."""
        return b"" if self._engaged else packet(DISENGAGE, 0)

    def fault(self, now: float) -> str:
        """Return why the controller cannot turn the rudder; empty where it can."""
        if now - self._received > SILENT_S:
            return f"the {self.name} does not answer; check its power, line and baud rate"
        if self._angle is None or now - self._angle_time > SILENT_S:
            return f"the {self.name} reports no rudder angle; it cannot be steered without, check its rudder sensor"
        for flag, sentence in FAULTS.items():
            if self.flags & flag and self._engaged:
                return f"the {self.name} has stopped: {sentence}"
        return ""

    def warning(self, now: float) -> AlarmEvent | None:
        """Return what the skipper should know though the rudder moves: a limit reached, a high current."""
        for flag, sentence in STOPS.items():
            if self.flags & flag:
                return AlarmEvent("drive_warning", f"{self.name}: {sentence}")
        return self._stall.warning(now)
