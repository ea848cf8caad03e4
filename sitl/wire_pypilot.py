"""pypilot's motor controller as the boat's side of a line; behaviour after arduino/motor/motor.ino of that project.

Commands are motor speeds; packets count after two good ones; 0.6 s without a command disengages; reports leave at
the rate at which commands come. Facts of the protocol only, written anew from that source.
"""

from __future__ import annotations

from sitl.drive_line import DriveLine
from sitl.world import STEP, Orders, World

CODE_COMMAND, CODE_RESET, CODE_DISENGAGE = 0xC7, 0xE7, 0x68
CODE_MAX_CURRENT, CODE_RUDDER_MIN, CODE_RUDDER_MAX = 0x1E, 0x2B, 0x4D
FLAG_SYNC, FLAG_OVERCURRENT, FLAG_ENGAGED, FLAG_INVALID, FLAG_MIN, FLAG_MAX = 1, 4, 8, 16, 256, 512
TIMEOUT_S = 0.6
CREDIT_MOST, CREDIT_EACH = 12, 4
SCALE = 65472
SUPPLY = 1250
"""Hundredths of a volt."""
POLYNOMIAL_TABLE = []
for _start in range(256):
    _value = _start
    for _ in range(8):
        _value = (_value << 1) & 0xFF ^ (0x31 if _value & 0x80 else 0)
    POLYNOMIAL_TABLE.append(_value)
CYCLE = ("flags", "current", "rudder", "voltage", "current", "rudder", "current", "rudder", "current", "rudder")


def checksum(data: bytes) -> int:
    """Return the packet's last byte for its first three."""
    value = 0xFF
    for byte in data:
        value = POLYNOMIAL_TABLE[value ^ byte]
    return value


class PypilotController(DriveLine):
    """The controller with its motor, clutch, rudder sensor and current sensor."""

    def __init__(self, world: World, baud: int, has_sensor: bool = True) -> None:
        super().__init__(world, baud)
        self.flags = 0
        self.processed = 0
        self._has_sensor = has_sensor
        self._window = bytearray()
        self._in_sync = 0
        self._speed = 1000
        self._place = world.boat.state.rudder
        self._last_command = -1.0
        self._credit = 0
        self._turn = 0
        self._current_max = 2000
        self._raw_min, self._raw_max = 0, 65535

    def take_byte(self, time: float, byte: int) -> None:
        """Take one byte; a wrong checksum costs the synchronisation and stops the motor."""
        self._window.append(byte)
        if len(self._window) < 4:
            return
        if checksum(bytes(self._window[:3])) != self._window[3]:
            del self._window[0]
            self._in_sync = 0
            self._speed = 1000
            self.flags = self.flags & ~FLAG_SYNC | FLAG_INVALID
            return
        code, low, high = self._window[:3]
        self._window.clear()
        self.flags &= ~FLAG_INVALID
        if self._in_sync < 2:
            self._in_sync += 1
            return
        self.flags |= FLAG_SYNC
        self.processed += 1
        self._process(time, code, low | high << 8)

    def _process(self, time: float, code: int, value: int) -> None:
        if code in (CODE_COMMAND, CODE_DISENGAGE):
            self._credit = min(self._credit + CREDIT_EACH, CREDIT_MOST)
        if code == CODE_COMMAND:
            self._command(time, value)
        elif code == CODE_DISENGAGE:
            self._disengage()
        elif code == CODE_RESET:
            self.flags &= ~FLAG_OVERCURRENT
        elif code == CODE_MAX_CURRENT:
            self._current_max = min(value, 2000)
        elif code == CODE_RUDDER_MIN:
            self._raw_min = value
        elif code == CODE_RUDDER_MAX:
            self._raw_max = value

    def _command(self, time: float, value: int) -> None:
        self._last_command = time
        if value > 2000 or self.flags & FLAG_OVERCURRENT:
            return
        if (self.flags & FLAG_MAX and value > 1000) or (self.flags & FLAG_MIN and value < 1000):
            self._speed = 1000
            return
        if not self.flags & FLAG_ENGAGED:
            self._place = self.world.boat.state.rudder
        self.flags |= FLAG_ENGAGED
        self._speed = value

    def _disengage(self) -> None:
        self._speed = 1000
        self.flags &= ~FLAG_ENGAGED

    def orders(self, time: float) -> Orders:
        """Return the place that the motor has been driven to; disengaged, the clutch lets the rudder go."""
        if not self.flags & FLAG_ENGAGED:
            self.draw(False, 0.0)
            return Orders(rudder=self.released_order())
        rate = self.world.boat.plant.gear.rate_max
        away = self._speed - 1000
        share = 0.0 if abs(away) <= 100 else (abs(away) - 100) / 900.0
        # ahead raises the sensor's reading, which is to port unless the sensor is mounted the other way round
        is_port = (away > 0) != self.world.vessel.drive.reversed
        rudder = self.world.boat.state.rudder
        stop = self.world.boat.plant.gear.angle_max
        self._place += (-share if is_port else share) * rate * STEP
        slack = 0.3 * rate
        self._place = min(max(self._place, -stop, rudder - slack), stop, rudder + slack)
        self.draw(share > 0.0, self._place - rudder)
        return Orders(rudder=self._place)

    @property
    def raw(self) -> int:
        """The rudder sensor's reading, rising to port."""
        drive = self.world.vessel.drive
        share = -self.measured / self.full
        place = drive.amidships + (-share if drive.reversed else share)
        return min(max(round((place + 1.0) / 2.0 * SCALE), 0), SCALE)

    def report(self, time: float) -> None:
        """Check the limits, and send the next report where a command has paid for it."""
        if self.flags & FLAG_ENGAGED and time - self._last_command > TIMEOUT_S:
            self._disengage()
        if round(self.current * 100.0) >= self._current_max:
            self._speed = 1000
            self.flags |= FLAG_OVERCURRENT
        self.flags &= ~(FLAG_MIN | FLAG_MAX)
        if self._has_sensor:
            self.flags |= FLAG_MIN * (self.raw < self._raw_min) | FLAG_MAX * (self.raw > self._raw_max)
        while self._credit >= CREDIT_EACH:
            self._say(time, CYCLE[self._turn % len(CYCLE)])
            self._turn += 1

    def _say(self, time: float, what: str) -> None:
        if what == "current":
            self._credit -= CREDIT_EACH
        values = {
            "flags": (0x8F, self.flags),
            "current": (0x1C, round(self.current * 100.0)),
            "rudder": (0xA7, self.raw if self._has_sensor else 65535),
            "voltage": (0xB3, SUPPLY),
        }
        code, value = values[what]
        body = bytes((code, value & 0xFF, value >> 8))
        self.answer(time, body + bytes((checksum(body),)))
