"""What all simulated rudder drives share: a line at the pace of its baud rate, the rudder, and the motor's current."""

from __future__ import annotations

import math

from sitl.uart import UartLine
from sitl.world import STEP, Orders, World

RUNNING_A, STALL_A = 2.5, 15.0
"""Current of a motor that turns the rudder, and of one that cannot; assumed, of the size of small linear drives."""
STALL_ERROR = math.radians(2.0)


class DriveLine:
    """A helm that goes before the flight controller, fed byte by byte. Times are those of the world's clock."""

    def __init__(self, world: World, baud: int) -> None:
        self.world = world
        self.current = 0.0
        self._to_host = UartLine(baud)
        self._to_drive = UartLine(baud)
        self._last_rudder = world.boat.state.rudder
        world.helms.insert(0, self)
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
