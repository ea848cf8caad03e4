"""The simulated flight controller on a UDP port, in this process, where its rudder can be looked at; steering
processes that are started, killed and looked into, as a test and as a benchmark of many."""

from __future__ import annotations

import contextlib
import json
import math
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from random import Random
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.transports import UdpOutTransport
from autopilot.runtime.log_files import following_parts
from autopilot.runtime.record import read_logs, read_packets, replay
from autopilot.signals import Mode
from autopilot.vessel.file import dump_vessel, load_vessel
from autopilot.vessel.schema import Vessel
from sitl.firmware import Firmware
from sitl.scenario import load_scenario
from sitl.serve import Pace
from sitl.wire_mavlink import MavlinkVehicle
from sitl.world import World

OVERRIDE = dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE
OVERRIDE_TIME_S = 3.0
"""RC_OVERRIDE_TIME: the vehicle lets go of a companion that is silent for this long."""
STEERED = 60
"""Overrides of a process that is certainly engaged."""
PATIENCE_S = 90.0
"""Wall time in which what is waited for must happen on however busy a machine."""


class Heard(NamedTuple):
    """An override that reached the vehicle, at its time [s]."""

    time: float
    packet: bytes


class WiredVehicle:
    """An armed boat in MANUAL, `speedup` times as fast as the wall clock."""

    def __init__(self, vessel: Vessel, port: int, speedup: float = 1.0) -> None:
        self.world = World(vessel, load_scenario("calm"))
        self.firmware = Firmware(self.world)
        self._vehicle = MavlinkVehicle(self.firmware)
        self._transport = UdpOutTransport("vehicle", "127.0.0.1", port)
        self._pace = Pace(speedup)
        self.overrides: list[Heard] = []
        self.held_until = -math.inf
        """The vehicle's time when an override was last in force, seen at every step of its simulation."""
        self.world.watchers.append(self._after_step)

    def _after_step(self, now: float) -> None:
        if self.firmware.overrides.active(now, OVERRIDE_TIME_S):
            self.held_until = now

    @property
    def now(self) -> float:
        """The vehicle's time [s]."""
        return self.world.time

    @property
    def is_held(self) -> bool:
        """Whether an override is in force."""
        return bool(self.firmware.overrides.active(self.now, OVERRIDE_TIME_S))

    @property
    def rudder(self) -> float:
        """Where the rudder is [rad]."""
        return self.world.boat.state.rudder

    def run(self, until: Callable[[], bool]) -> bool:
        """Sail until that is so; False where it is not within PATIENCE_S of wall time."""
        end = time.monotonic() + PATIENCE_S
        while not until():
            if time.monotonic() > end:
                return False
            now = self._pace.simulated(self.now)
            for data in self._transport.receive():
                if data[7] == OVERRIDE and data[8:10] == b"\0\0":
                    self.overrides.append(Heard(now, data))
                self._vehicle.receive(now, data)
            self._vehicle.advance(now)
            for data in self._vehicle.transmit(now):
                self._transport.send(data)
            select.select([self._transport.fileno()], (), (), 0.005)
        return True

    def run_for(self, seconds: float) -> None:
        """Sail for so many seconds of the vehicle's time."""
        end = self.now + seconds
        assert self.run(lambda: self.now >= end)

    def close(self) -> None:
        """Give the port back."""
        self._transport.close()


class Killed(NamedTuple):
    """What one kill left behind.

    had_engaged: whether the rudder was ours at the kill; over: the rudder [rad] then.  released_s: the vehicle's time
    until it let go, 0 where it was not held.  ticks: in the log; replays: whether they replay bit for bit, False
    where there was no log yet.  unlogged_s: age, at the kill, of the
    last override that reached the vehicle and is not in the log, behind the first such one: 0 where all are.
    resumed: the process had engaged by itself, from the note of the one before.  starved: it had waited for a core for
    longer than it ran.
    """

    had_engaged: bool
    over: float
    released_s: float
    ticks: int
    replays: bool
    unlogged_s: float
    resumed: bool
    starved: bool


def waited_more_than_it_ran(pid: int) -> bool:
    """Return whether a process has spent more time in the queue for a core than on one (proc(5), schedstat)."""
    ran, waited, _ = map(int, Path(f"/proc/{pid}/schedstat").read_text().split())
    return waited > ran


class KillingField:
    """Starts `autopilot run` on one boat again and again, and kills it at random moments."""

    def __init__(self, folder: Path, port: int, seed: int, speedup: float = 4.0) -> None:
        boat = load_vessel("lanxin")
        safe = replace(boat.failsafe, heading_timeout_s=6.0, reengage_after_restart_s=600.0)
        self._vessel = folder / "boat.yaml"
        self._vessel.write_text(dump_vessel(replace(boat, failsafe=safe)))
        self._folder, self._state = folder, folder / "held.json"
        self._speedup, self._port = speedup, port
        self._random = Random(seed)
        self.vehicle = WiredVehicle(boat, port, speedup)
        self._turn = 0

    def kill_one(self) -> Killed | None:
        """Start a process, kill it, and return what it left; AssertionError where the rudder or the log is not well.

        None where it gave up by itself before it steered, or dropped the order: speeded up on a machine that lets it
        wait for longer than it runs its patience is short.
        """
        logs = self._folder / f"logs-{self._turn}"
        resumes = self._random.random() < 0.5 and self._holds_a_note()
        if not resumes:
            self._state.unlink(missing_ok=True)
        first, is_early = len(self.vehicle.overrides), self._random.random() < 0.2
        with self._process(logs, resumes) as process:
            if is_early:
                end = time.monotonic() + self._random.uniform(0.0, 1.5)
                self.vehicle.run(lambda: time.monotonic() >= end)
            else:
                steers = lambda: self._is_steered(first) or process.poll() is not None  # noqa: E731 - read at once
                steered = self.vehicle.run(steers)
                assert steered or waited_more_than_it_ran(process.pid), "never steered"
                if process.poll() is not None or not steered:
                    self._turn += 1
                    return None
                self.vehicle.run_for(self._random.uniform(0.0, 3.0))
            starved = waited_more_than_it_ran(process.pid)
            process.send_signal(signal.SIGKILL)
            process.wait()
        # what was under way arrives, in the vehicle's time of now: the wait for the end may have been long
        self.vehicle.run_for(0.02)
        over, was_held, killed = self.vehicle.rudder, self.vehicle.is_held, self.vehicle.now
        assert self.vehicle.run(lambda: not self.vehicle.is_held)
        released = self.vehicle.held_until - killed if was_held else 0.0
        assert released <= OVERRIDE_TIME_S + 0.5, f"held for {released:.1f} s after the kill"
        self.vehicle.run_for(3.0)
        assert abs(self.vehicle.rudder) < math.radians(1.0), "the rudder did not come back"
        self._turn += 1
        ticks, replays, unlogged = self._look_into(logs, self.vehicle.overrides[first:])
        engaged, resumed = was_held and not is_early, resumes and not is_early
        return Killed(engaged, over, released, ticks, replays, unlogged, resumed, starved)

    def _is_steered(self, first: int) -> bool:
        """The pulse that proves who steers is an override too: steering is a rudder laid over, or many of them."""
        return abs(self.vehicle.rudder) > math.radians(3.0) or len(self.vehicle.overrides) - first > STEERED

    def _holds_a_note(self) -> bool:
        try:
            return bool(json.loads(self._state.read_text()))
        except (OSError, ValueError):
            return False

    @contextlib.contextmanager
    def _process(self, logs: Path, resumes: bool) -> Iterator[subprocess.Popen[bytes]]:
        side = 90 if self._turn % 2 else 270
        ordered = [] if resumes else ["--engage", str(side)]
        command = [
            sys.executable, "-m", "autopilot", "run", str(self._vessel), "--link", f"udpin:127.0.0.1:{self._port}",
            "--as-gcs", "--speedup", str(self._speedup), "--wait", "0", "--log-dir", str(logs),
            "--state", str(self._state), *ordered,
        ]  # fmt: skip
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
            try:
                yield process
            finally:
                process.kill()

    def _look_into(self, logs: Path, heard: Sequence[Heard]) -> tuple[int, bool, float]:
        files = sorted(logs.glob("*.tlog")) if logs.exists() else []
        if not files or not files[0].stat().st_size:
            return 0, False, 0.0  # killed before it had a log
        ticks = [tick for log in read_logs(*following_parts(files[0])) for tick in log.ticks]
        assert replay(files[0]).identical
        kept = {packet for _, packet in read_packets(files[0])}
        missing = [override.time for override in heard if override.packet not in kept]
        unlogged = heard[-1].time - missing[0] if missing else 0.0
        if heard and ticks and any(tick.mode is Mode.ENGAGED for tick in ticks):
            assert unlogged <= 0.5 * self._speedup, f"{unlogged:.2f} s of overrides are not in the log"
        return len(ticks), True, unlogged

    def close(self) -> None:
        """Give the port back."""
        self.vehicle.close()
