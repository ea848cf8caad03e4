"""Pololu's Jrk G2 and Maestro as the boat's side of a line; behaviour after Pololu's user's guides.

Both take compact and Pololu protocol; a data byte with its top bit set breaks a command off, as in the real ones.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from sitl.drive_line import DriveLine
from sitl.world import Orders, World

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
        order = self._angle(self._target)
        self.draw(True, order - self.world.boat.state.rudder)
        return Orders(rudder=order)

    def report(self, time: float) -> None:
        """Halt when no command has come in time."""
        if not self.errors & WAITING and time - self._last > JRK_TIMEOUT_S:
            self._halt(TIMED_OUT)

    def _angle(self, target: int) -> float:
        drive = self.world.vessel.drive
        share = (target - 2048) / 2047.0 - drive.amidships
        return (-share if drive.reversed else share) * self.full

    @property
    def feedback(self) -> int:
        """The rudder sensor on the scale of the target."""
        drive = self.world.vessel.drive
        share = self.measured / self.full
        place = drive.amidships + (-share if drive.reversed else share)
        return min(max(2048 + round(place * 2047.0), 0), 4095)

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
        drive = self.world.vessel.drive
        pulse = self._pulses[drive.channel]
        if not pulse:
            return Orders(rudder=self.released_order())
        share = (pulse - NEUTRAL_QUARTERS) / 2000.0 - drive.amidships
        return Orders(rudder=(-share if drive.reversed else share) * self.full)
