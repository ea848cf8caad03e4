"""Serving the simulated boat in real time: transports on one side, the sans-clock endpoints on the other."""

from __future__ import annotations

import csv
import select
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import IO, NamedTuple, Protocol

from autopilot.errors import InputError
from autopilot.links.base import Transport
from autopilot.params.saving import create_unused
from sitl.world import STEP, World

LAG_MAX_S = 2.0
"""Wall time that the simulation may fall behind before its clock is set back instead of running after it."""
SILENT_PEER_S = 5.0
"""Simulated time without a word from a peer, after which another may take its place."""

TRUTH_PERIOD = 0.1
TRUTH_COLUMNS = (
    *("time_s", "north_m", "east_m", "heading_rad", "yaw_rate_rad_s", "rudder_rad"),
    *("speed_m_s", "sway_m_s", "roll_rad"),
)


class Endpoint(Protocol):
    """The boat's side of one link, on whatever clock is given."""

    def receive(self, now: float, data: bytes) -> None:
        """Take bytes that arrived at `now` [s]."""

    def transmit(self, now: float) -> list[bytes]:
        """Return what has left by `now` [s]."""


class Desk(Protocol):
    """Where faults are ordered while the boat sails."""

    def fileno(self) -> int:
        """Return the descriptor to wait on."""

    def serve(self) -> None:
        """Answer every line that waits."""


class Port(NamedTuple):
    """An endpoint and the transport that carries it."""

    transport: Transport
    endpoint: Endpoint


class TruthFile:
    """What the boat really did, ten times a simulated second, as CSV; where `path` exists, its next free name.

    A full disk ends the record, not the boat. Raises InputError where the file cannot be made.
    """

    def __init__(self, path: Path, world: World) -> None:
        try:
            descriptor, self.path = create_unused(path)
        except OSError as error:
            raise InputError(f"--truth: {path} cannot be written: {error.strerror}.") from error
        self._file: IO[str] = open(descriptor, "w", newline="", encoding="utf-8")  # noqa: PTH123, SIM115
        self._world = world
        self._rows = csv.writer(self._file)
        self._failed = False
        self._next = 0.0
        self._write(TRUTH_COLUMNS)
        self._after_step(world.time)
        world.watchers.append(self._after_step)

    def _after_step(self, now: float) -> None:
        if now + 1.0e-9 < self._next:
            return
        self._next += TRUTH_PERIOD
        state = self._world.boat.state
        values = (state.north, state.east, state.heading, state.rate, state.rudder, state.speed, state.sway, state.roll)
        self._write([f"{now:.3f}", *(f"{value:.7g}" for value in values)])

    def close(self) -> None:
        """Write what is left and close the file."""
        try:
            self._file.close()
        except OSError as error:
            self._fail(error)

    def _write(self, row: Sequence[str]) -> None:
        if not self._failed:
            try:
                self._rows.writerow(row)
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        if not self._failed:
            self._failed = True
            print(f"sitl: {self.path} ends before its time: {error.strerror}", file=sys.stderr)


class Pace:
    """Simulated time from wall time: `speedup` times as fast, and late rather than rushed when it cannot keep up."""

    def __init__(self, speedup: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._speedup = speedup
        self._clock = clock
        self._start = clock()
        self.lost = 0.0
        """Wall seconds given up because the machine was too slow."""

    def simulated(self, reached: float) -> float:
        """Return the simulated time of this instant, where the simulation has reached `reached` [s]."""
        now = (self._clock() - self._start) * self._speedup
        late = (now - reached) / self._speedup - LAG_MAX_S
        if late > 0.0:
            self._start += late
            self.lost += late
            now -= late * self._speedup
        return now

    def wait_for(self, simulated: float) -> float:
        """Return the wall seconds until the simulated time, at least 0."""
        return max(simulated / self._speedup - (self._clock() - self._start), 0.0)


def serve(
    world: World,
    ports: Sequence[Port],
    pace: Pace,
    duration: float | None,
    should_stop: Callable[[], bool],
    desk: Desk | None = None,
) -> None:
    """Run until `should_stop` or for `duration` simulated seconds. Raises LinkError when a transport is gone."""
    heard = [world.time] * len(ports)
    while not should_stop():
        now = pace.simulated(world.time)
        if duration is not None and now >= duration:
            world.advance(duration)
            return
        # ports in turn, in the order the user gave them: one clock reading for all
        for number, (transport, endpoint) in enumerate(ports):
            for data in transport.receive():
                heard[number] = now
                endpoint.receive(now, data)
            if now - heard[number] > SILENT_PEER_S:
                # whoever starts again speaks from another port
                heard[number] = now
                transport.forget_peer()
        world.advance(now)
        if desk is not None:
            desk.serve()
        for transport, endpoint in ports:
            for packet in endpoint.transmit(now):
                transport.send(packet)
        descriptors = [port.transport.fileno() for port in ports] + ([desk.fileno()] if desk is not None else [])
        _sleep(descriptors, pace.wait_for(world.time + STEP))


def _sleep(descriptors: Sequence[int], seconds: float) -> None:
    select.select([descriptor for descriptor in descriptors if descriptor >= 0], [], [], seconds)
