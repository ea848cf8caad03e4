"""Rudder drives as the boat's side of a line at the pace of its baud rate, with the rudder and the motor's current:
Pololu's Jrk G2 and Maestro, two valves on a Maestro's outputs, and pypilot's motor controller.

Pololu's after the user's guides: both take compact and Pololu protocol; a data byte with its top bit set breaks a
command off, as in the real ones. pypilot's after arduino/motor/motor.ino of that project, facts of the protocol only:
commands are motor speeds; packets count after two good ones; 0.6 s without a command disengages; reports leave at the
rate at which commands come.

A serial line's pace: ten bits a byte, one byte after the other, and what has to wait waits.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Callable

from autopilot.vessel.schema import Valves
from sitl.world import STEP, Orders, World

BITS_PER_BYTE = 10
"""Start bit, eight data bits, stop bit."""


class UartLine:
    """One direction of a line. Bytes put in come out when their last bit has passed."""

    def __init__(self, baud: int) -> None:
        if baud <= 0:
            raise ValueError(f"baud rate must be above 0, got {baud}")
        self.byte_time = BITS_PER_BYTE / baud
        self._waiting: deque[tuple[float, bytes]] = deque()
        self._free_at = 0.0

    def put(self, time: float, data: bytes) -> None:
        """Begin to send `data` at `time` [s], or as soon as what is before it has gone."""
        if not data:
            return
        start = max(time, self._free_at)
        self._waiting.append((start, data))
        self._free_at = start + len(data) * self.byte_time

    def backlog(self, time: float) -> float:
        """Return the seconds of sending that still wait at `time` [s]."""
        return max(self._free_at - time, 0.0)

    def take(self, time: float) -> bytes:
        """Return the bytes that have passed whole by `time` [s] and have not been taken yet."""
        passed = bytearray()
        while self._waiting:
            start, data = self._waiting[0]
            count = min(int((time - start) / self.byte_time + 1.0e-6), len(data))
            if count <= 0:
                break
            passed += data[:count]
            if count < len(data):
                self._waiting[0] = (start + count * self.byte_time, data[count:])
                break
            self._waiting.popleft()
        return bytes(passed)


RUNNING_A, STALL_A = 2.5, 15.0
"""Current of a motor that turns the rudder, and of one that cannot; assumed, of the size of small linear drives."""
STALL_ERROR = math.radians(2.0)


class BoatSide:
    """The boat's side of a serial line, both directions at the pace of its baud rate. Times are the world's."""

    def __init__(self, world: World, baud: int) -> None:
        self.world = world
        self._to_host = UartLine(baud)
        self._to_drive = UartLine(baud)
        world.watchers.append(self._after_step)

    def receive(self, now: float, data: bytes) -> None:
        """Take bytes that the other side began to send at `now` [s]; they arrive at the line's pace."""
        self.world.advance(now)
        self._to_drive.put(self.world.time_at(now), data)

    def advance(self, now: float) -> None:
        """Move the world on to `now` [s]."""
        self.world.advance(now)

    def transmit(self, now: float) -> list[bytes]:
        """Return the bytes that have passed the line by `now` [s]."""
        self.world.advance(now)
        passed = self._to_host.take(self.world.time_at(now))
        return [passed] if passed else []

    def _after_step(self, time: float) -> None:
        """Take what has arrived, and say what falls due."""
        raise NotImplementedError


class DriveLine(BoatSide):
    """A helm that goes before the flight controller, fed byte by byte."""

    def __init__(self, world: World, baud: int) -> None:
        super().__init__(world, baud)
        self.current = 0.0
        self._last_rudder = world.boat.state.rudder
        world.helms.insert(0, self)

    def orders(self, time: float) -> Orders:
        """Return what the drive does to the rudder; each kind of drive has its own."""
        raise NotImplementedError

    def take_byte(self, time: float, byte: int) -> None:
        """Take one byte of the host's."""
        raise NotImplementedError

    def report(self, time: float) -> None:
        """Do what falls due after a step: timeouts, unasked reports."""

    @property
    def measured(self) -> float:
        """What the drive's own sensor makes of the rudder [rad]."""
        reading = self.world.sensors.latest(self.world.time)
        return self.world.boat.state.rudder if reading is None else reading.rudder

    @property
    def full(self) -> float:
        """Rudder angle [rad] at the end of the drive's scale."""
        vessel = self.world.vessel
        return math.radians(vessel.drive.angle_at_full_deg or vessel.rudder.angle_max_deg)

    def angle_at(self, share: float) -> float:
        """Return the rudder angle [rad] that a place on the drive's scale, -1 to 1, stands for."""
        drive = self.world.vessel.drive
        share -= drive.amidships
        return (-share if drive.reversed else share) * self.full

    def place_of(self, share: float) -> float:
        """Return the place on the drive's scale, -1 to 1, of a share of the full rudder."""
        drive = self.world.vessel.drive
        return drive.amidships + (-share if drive.reversed else share)

    def driven(self, place: float, rate: float) -> float:
        """Return the `place` [rad] that something which knows no angle has driven to: within the stops, and no further
        ahead of the rudder than it goes in 0.3 s at `rate` [rad/s]."""
        rudder, stop = self.world.boat.state.rudder, self.world.boat.plant.gear.angle_max
        return min(max(place, -stop, rudder - 0.3 * rate), stop, rudder + 0.3 * rate)

    def answer(self, time: float, data: bytes) -> None:
        """Send bytes to the host."""
        self._to_host.put(time, data)

    def released_order(self) -> float | None:
        """Return the order of a rudder that nobody holds: where it is, or left to others, as the scenario says."""
        return self.world.boat.state.rudder if self.world.scenario.drive.released == "hold" else None

    def draw(self, is_driven: bool, error: float) -> None:
        """Work out the motor's current from whether it is driven and how far the rudder is from where it should be."""
        rudder = self.world.boat.state.rudder
        moves = abs(rudder - self._last_rudder) > 0.01 * STEP
        self._last_rudder = rudder
        is_stalled = is_driven and not moves and abs(error) > STALL_ERROR
        # as slow as a winding warms its shunt: a start is no stall
        goal = STALL_A if is_stalled else RUNNING_A if is_driven and moves else 0.0
        self.current += (goal - self.current) * STEP / 0.1

    def _after_step(self, time: float) -> None:
        for byte in self._to_drive.take(time):
            self.take_byte(time, byte)
        self.report(time)


JRK_DEVICE, MAESTRO_DEVICE = 11, 12
"""Device numbers as delivered; the vessel file's own goes before."""
JRK_TIMEOUT_S = 1.0
WAITING, PROTOCOL_ERROR, TIMED_OUT = 1 << 0, 1 << 11, 1 << 12
SUPPLY_MV = 12600
NEUTRAL_QUARTERS = 6000


class CommandReader:
    """Cuts bytes into commands. `lengths` gives the count of data bytes of a command byte; None: unknown."""

    def __init__(self, device: int, lengths: Callable[[int], int | None]) -> None:
        self.errors = 0
        self._device = device
        self._lengths = lengths
        self._command = bytearray()
        self._missing = 0

    def take(self, byte: int) -> tuple[int, bytes] | None:
        """Return the command byte and data that `byte` completes."""
        if byte & 0x80:
            self.errors += bool(self._command)
            self._command = bytearray((byte,))
            # in the Pololu protocol device number and command come first
            needed = 2 if byte == 0xAA else self._lengths(byte)
        elif not self._command:
            return None
        else:
            self._command.append(byte)
            needed = self._still_needed()
        if needed is None:
            self.errors += 1
            self._command.clear()
            return None
        self._missing = needed
        if self._missing:
            return None
        command, self._command = bytes(self._command), bytearray()
        if command[0] != 0xAA:
            return command[0], command[1:]
        return (command[2] | 0x80, command[3:]) if command[1] == self._device else None

    def _still_needed(self) -> int | None:
        if self._command[0] == 0xAA and len(self._command) == 3:
            return self._lengths(self._command[2] | 0x80)
        return self._missing - 1


def jrk_length(command: int) -> int | None:
    """Count of data bytes of a Jrk command."""
    if 0xC0 <= command <= 0xDF or command in (0xE0, 0xE1):
        return 1
    return {0xFF: 0, 0xE5: 2, 0xF2: 2, 0xF4: 2}.get(command, 0 if 0x81 <= command <= 0xBB else None)


def maestro_length(command: int) -> int | None:
    """Count of data bytes of a Maestro command."""
    return {0x84: 3, 0x87: 3, 0x89: 3, 0x90: 1, 0x93: 0, 0xA1: 0, 0xA2: 0}.get(command)


class JrkController(DriveLine):
    """A position servo with its own feedback, current sensor and serial timeout."""

    def __init__(self, world: World, baud: int) -> None:
        super().__init__(world, baud)
        device = world.vessel.drive.device
        self.reader = CommandReader(JRK_DEVICE if device is None else device, jrk_length)
        self.errors = WAITING
        self._target = 2048
        self._last = 0.0
        self._held = world.boat.state.rudder

    def take_byte(self, time: float, byte: int) -> None:
        """Take one byte of the host's."""
        before = self.reader.errors
        command = self.reader.take(byte)
        if self.reader.errors > before:
            self._halt(PROTOCOL_ERROR)
        if command is None:
            return
        self._last = time
        code, data = command
        if 0xC0 <= code <= 0xDF:
            self._target = min((code & 0x1F) | data[0] << 5, 4095)
            self.errors &= ~(WAITING | TIMED_OUT)
        elif code == 0xFF:
            self._halt(WAITING)
        elif code == 0xE5:
            self.answer(time, self._variables()[data[0] : data[0] + min(data[1], 15)])

    def _halt(self, error: int) -> None:
        if not self.errors:
            self._held = self.world.boat.state.rudder
        self.errors |= error

    def orders(self, time: float) -> Orders:
        """Return the angle that the target stands for; halted, the motor stays where it is."""
        if self.errors & ~PROTOCOL_ERROR:
            self.draw(False, 0.0)
            return Orders(rudder=self._held)
        order = self.angle_at((self._target - 2048) / 2047.0)
        self.draw(True, order - self.world.boat.state.rudder)
        return Orders(rudder=order)

    def report(self, time: float) -> None:
        """Halt when no command has come in time."""
        if not self.errors & WAITING and time - self._last > JRK_TIMEOUT_S:
            self._halt(TIMED_OUT)

    @property
    def feedback(self) -> int:
        """The rudder sensor on the scale of the target."""
        return min(max(2048 + round(self.place_of(self.measured / self.full) * 2047.0), 0), 4095)

    def _variables(self) -> bytes:
        feedback = self.feedback
        duty = 0 if self.errors else max(min(2 * (self._target - feedback), 600), -600)
        head = struct.pack(
            "<HHHHhhhBBH", self._target, self._target, feedback, feedback, 0, duty, duty, round(self.current), 0, 0
        )
        return head + struct.pack(
            "<HHBHH", self.errors, self.errors, 0, SUPPLY_MV, min(round(self.current * 1000.0), 65535)
        )


class MaestroController(DriveLine):
    """Pulses on channels; a servo hangs on the channel that the vessel file names."""

    def __init__(self, world: World, baud: int) -> None:
        super().__init__(world, baud)
        device = world.vessel.drive.device
        self.reader = CommandReader(MAESTRO_DEVICE if device is None else device, maestro_length)
        self._pulses = [0] * 24
        self._errors = 0

    def take_byte(self, time: float, byte: int) -> None:
        """Take one byte of the host's."""
        before = self.reader.errors
        command = self.reader.take(byte)
        if self.reader.errors > before:
            self._errors |= 1 << 4
        if command is None:
            return
        code, data = command
        if code == 0x84 and data[0] < len(self._pulses):
            self._pulses[data[0]] = data[1] | data[2] << 7
        elif code == 0x90 and data[0] < len(self._pulses):
            self.answer(time, struct.pack("<H", self._pulses[data[0]]))
        elif code == 0xA1:
            self.answer(time, struct.pack("<H", self._errors))
            self._errors = 0

    def orders(self, time: float) -> Orders:
        """Return the angle that the servo's pulse stands for; without pulses the servo is limp."""
        pulse = self._pulses[self.world.vessel.drive.channel]
        if not pulse:
            return Orders(rudder=self.released_order())
        return Orders(rudder=self.angle_at((pulse - NEUTRAL_QUARTERS) / 2000.0))


PRESSURE_S = 0.03
"""In which the oil behind a valve that has opened comes up to its full flow; assumed."""
SWITCHES_AT = 6000
MAESTRO_TIMEOUT_S = 0.5


class ValveController(MaestroController):
    """Two valves on outputs of a Maestro, and a rudder sensor on one of its inputs.

    After the dead time of `drive.valve` the flow to one side comes up in PRESSURE_S; of a valve that is shut it goes
    down evenly, over twice the coasting time. With both valves open oil goes round and moves nothing. Outputs go off
    when no command has come for MAESTRO_TIMEOUT_S.
    """

    def __init__(self, world: World, baud: int) -> None:
        super().__init__(world, baud)
        self._valves = world.vessel.drive.valve or Valves()
        self._rates = [math.radians(min(rate, 30.0)) for rate in world.vessel.rudder.rates_deg_s]
        self._pressed, self._flow, self._last_side = 0.0, 0.0, 0
        self._place = world.boat.state.rudder
        self._last = -math.inf
        self.openings = 0

    def take_byte(self, time: float, byte: int) -> None:
        """Take one byte of the host's; an input's position is its voltage."""
        self._last = time
        super().take_byte(time, byte)
        if self._valves.sensor_channel is not None:
            place = self.place_of(self.measured / self.full)
            self._pulses[self._valves.sensor_channel] = min(max(round(0.5 * (place + 1.0) * 1023.0), 0), 1023)

    def report(self, time: float) -> None:
        """Shut the valves when no command has come in time."""
        if time - self._last > MAESTRO_TIMEOUT_S:
            channel = self.world.vessel.drive.channel
            self._pulses[channel] = self._pulses[channel + 1] = 0

    @property
    def _side(self) -> int:
        drive = self.world.vessel.drive
        first, second = (self._pulses[drive.channel + each] >= SWITCHES_AT for each in (0, 1))
        return (second - first) * (-1 if drive.reversed else 1)

    def orders(self, time: float) -> Orders:
        """Return the place that the oil has brought the rudder to; nothing holds it but the oil."""
        side, valves = self._side, self._valves
        if side != self._last_side:
            self._pressed, self._last_side = 0.0, side
            self.openings += side != 0
        self._pressed += STEP
        if side and self._pressed > valves.opening_s:
            self._flow = min(max(self._flow + side * STEP / PRESSURE_S, -1.0), 1.0)
        elif not side or side * self._flow < 0.0:
            fall = STEP / max(2.0 * valves.coasting_s, STEP)
            self._flow = math.copysign(max(abs(self._flow) - fall, 0.0), self._flow)
        rudder, stop = self.world.boat.state.rudder, self.world.boat.plant.gear.angle_max
        self._place = self.driven(self._place + self._flow * self._rates[self._flow > 0.0] * STEP, max(self._rates))
        self.draw(side != 0, side * stop - rudder)
        return Orders(rudder=self._place)


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

    def __init__(self, world: World, baud: int) -> None:
        super().__init__(world, baud)
        self.flags = 0
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
        self._place = self.driven(self._place + (-share if is_port else share) * rate * STEP, rate)
        self.draw(share > 0.0, self._place - self.world.boat.state.rudder)
        return Orders(rudder=self._place)

    @property
    def raw(self) -> int:
        """The rudder sensor's reading, rising to port."""
        return min(max(round((self.place_of(-self.measured / self.full) + 1.0) / 2.0 * SCALE), 0), SCALE)

    def report(self, time: float) -> None:
        """Check the limits, and send the next report where a command has paid for it."""
        if self.flags & FLAG_ENGAGED and time - self._last_command > TIMEOUT_S:
            self._disengage()
        if round(self.current * 100.0) >= self._current_max:
            self._speed = 1000
            self.flags |= FLAG_OVERCURRENT
        self.flags &= ~(FLAG_MIN | FLAG_MAX)
        self.flags |= FLAG_MIN * (self.raw < self._raw_min) | FLAG_MAX * (self.raw > self._raw_max)
        while self._credit >= CREDIT_EACH:
            self._send(time, CYCLE[self._turn % len(CYCLE)])
            self._turn += 1

    def _send(self, time: float, what: str) -> None:
        if what == "current":
            self._credit -= CREDIT_EACH
        values = {
            "flags": (0x8F, self.flags),
            "current": (0x1C, round(self.current * 100.0)),
            "rudder": (0xA7, self.raw),
            "voltage": (0xB3, SUPPLY),
        }
        code, value = values[what]
        body = bytes((code, value & 0xFF, value >> 8))
        self.answer(time, body + bytes((checksum(body),)))
