"""A day of steering: are memory and file descriptors flat, and does the loop keep time beside programs that hog?

    nice -n 10 python benchmarks/endurance.py simulated --hours 24            # pilot, law, log folder; direct link
    nice -n 10 python benchmarks/endurance.py simulated --hours 2 --mavlink   # with the flight controller on its line
    python benchmarks/endurance.py real --minutes 30 --hogs 2                 # a real process beside two CPU hogs

Simulated: pilot and boat in lockstep, a new heading every ten minutes, five seconds without a compass every half hour
(a fail-safe, then engaged anew), standby every hour, a log folder that is kept below its size. Every simulated ten
minutes: memory, live Python blocks, open descriptors. The slope is that of a straight line through the second half,
with its standard error.

Real: `autopilot run --realtime` over UDP beside processes that count without end, and cyclictest beside it where it is
installed. A tick that is later than two control periods after the one before is a missed deadline: with or without a
heading the loop must tick after one and a half.
"""

from __future__ import annotations

import argparse
import contextlib
import gc
import math
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from lockstep import STEP, Lockstep
from plant import Plant
from wired_vehicle import WiredVehicle

from autopilot.build import build_pilot, gear_of, model_of
from autopilot.loop.clock import ManualClock
from autopilot.loop.log_files import FolderLimits, FolderSink, following_parts
from autopilot.loop.record import Recorder, read_logs
from autopilot.loop.session import Session
from autopilot.params.vessel_file import dump_vessel, load_vessel
from autopilot.signals import HelmSample, Mode, Order, OrderKind, RudderCommand, Sample, Tick

EVERY_S = 600.0
TURN_S, SILENT_S, STANDBY_S = 600.0, 1800.0, 3600.0
LIMITS = FolderLimits(total=40_000_000, part=4_000_000, free=0)
PAGE_KB = os.sysconf("SC_PAGE_SIZE") / 1024.0
PERIODS_MISSED = 2.0


class Reading(NamedTuple):
    """After `hours`: resident memory [kB], live Python memory blocks, open file descriptors."""

    hours: float
    resident_kb: float
    blocks: float
    descriptors: float


def reading_of(hours: float, pid: str = "self", blocks: float = math.nan) -> Reading:
    """Return how a process stands."""
    resident = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_KB
    return Reading(hours, resident, blocks, len(list(Path(f"/proc/{pid}/fd").iterdir())))


def slope(readings: list[Reading], name: str) -> tuple[float, float]:
    """Return the slope per hour of one figure over the second half, and its standard error."""
    half = readings[len(readings) // 2 :]
    x, y = (np.array([getattr(each, field) for each in half]) for field in ("hours", name))
    deviation = x - x.mean()
    found = float(deviation @ y / (deviation @ deviation))
    residual = y - y.mean() - found * deviation
    return found, float(np.sqrt(residual @ residual / max(1, len(x) - 2) / (deviation @ deviation)))


def table(readings: list[Reading]) -> None:
    """Print some of the readings and the slopes."""
    print("  hours  resident kB   Python blocks  descriptors")
    for each in readings[:: max(1, len(readings) // 8)]:
        print(f"{each.hours:7.2f} {each.resident_kb:12.0f} {each.blocks:15.0f} {each.descriptors:12.0f}")
    for name, unit in (("resident_kb", "kB"), ("blocks", "blocks"), ("descriptors", "descriptors")):
        found, error = slope(readings, name)
        if not math.isnan(found):
            print(f"slope of {name:12s} {found:+.3f} +- {error:.3f} {unit} an hour, second half")


class DirectLink:
    """A boat without a wire: its compass goes silent for five seconds every half hour."""

    name = "direct"

    def __init__(self) -> None:
        vessel = load_vessel("lanxin")
        self.plant = Plant(model_of(vessel), gear_of(vessel), heading_noise=0.005, rate_noise=0.003)
        self._command = RudderCommand(0.0, 0.0, False)
        self.releases = 0

    def receive(self, now: float) -> list[Sample]:
        if now > self.plant.time:
            self.plant.step(self._command.angle if self._command.engaged else 0.0, now - self.plant.time)
        seen = self.plant.sense()
        return [] if now % SILENT_S > SILENT_S - 5.0 else [*seen, HelmSample(now, True, "", self.name)]

    def send(self, now: float, command: RudderCommand) -> None:
        self.releases += self._command.engaged and not command.engaged
        self._command = command

    def fileno(self) -> int:
        return -1

    def tell(self, now: float, mode: Mode, alarms: tuple[str, ...]) -> None: ...

    def keep(self, now: float) -> None: ...

    def release(self, now: float) -> None: ...

    def take_packets(self) -> list[tuple[float, bytes]]:
        return []

    def close(self) -> None: ...


class Skipper:
    """A new heading every ten minutes, standby for the last minute of every hour, engaged anew after every trouble."""

    def __init__(self) -> None:
        self._serial = 0

    def __call__(self, now: float, tick: Tick | None) -> Order:
        if now % STANDBY_S > STANDBY_S - 60.0:
            return Order(serial=self._serial)
        if tick is not None and tick.mode in (Mode.FAILSAFE, Mode.OVERRIDE, Mode.STANDBY) and now % 10.0 < 0.1:
            self._serial += 1
        turn = int(now // TURN_S)
        return Order(
            OrderKind.HEADING, math.radians(40.0 * (turn % 3) - 60.0 * (turn % 2)), serial=max(1, self._serial)
        )


class Day:
    """Simulated hours of one session, whose log goes into a folder that is kept below its size."""

    def __init__(self, folder: Path, with_mavlink: bool) -> None:
        vessel = load_vessel("lanxin")
        self.folder = folder
        self.recorder = Recorder(FolderSink(folder, LIMITS), {"vessel": dump_vessel(vessel), "law": None}, 0.0)
        self.readings: list[Reading] = []
        self.modes: dict[str, int] = {}
        self._wire = Lockstep(vessel) if with_mavlink else None
        self._clock = ManualClock()
        if self._wire is not None:
            self.session = self._wire.session
            self.session._recorder, self.session._orders = self.recorder, Skipper()
        else:
            pilot = build_pilot(vessel)
            self.session = Session(pilot, [DirectLink()], self._clock, 20.0, Skipper(), self.recorder)

    def sail(self, hours: float) -> None:
        """Sail so far."""
        step, started, due, now = (STEP if self._wire else 0.05), time.monotonic(), 0.0, 0.0
        last = Mode.STANDBY
        while now < 3600.0 * hours:
            now = round(now + step, 9)
            self._advance(now)
            if self.session.poll(now) and self.session.tick is not None and self.session.tick.mode is not last:
                last = self.session.tick.mode
                self.modes[last.name] = self.modes.get(last.name, 0) + 1
            if now >= due:
                due += EVERY_S
                gc.collect()
                self.readings.append(reading_of(now / 3600.0, blocks=sys.getallocatedblocks()))
                print(f"{now / 3600.0:.2f} h, {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)

    def _advance(self, now: float) -> None:
        if self._wire is None:
            self._clock.advance(now - self._clock.now())
        else:
            self._wire.clock.time = now
            self._wire.carry(now)


def simulated(hours: float, with_mavlink: bool) -> None:
    """Sail, read, print; Ctrl-C and SIGTERM end the day early."""
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        day = Day(Path(name), with_mavlink)
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        with contextlib.suppress(KeyboardInterrupt):
            day.sail(hours)
        kept = sum(path.stat().st_size for path in Path(name).iterdir())
        day.session.close()
    reached, wall = day.readings[-1].hours, time.monotonic() - started
    print(f"{reached:.1f} simulated hours in {wall:.0f} s, {'MAVLink' if with_mavlink else 'direct'} link")
    print(f"changes of mode: {', '.join(f'{count} to {mode}' for mode, count in sorted(day.modes.items()))}")
    print(f"log folder {kept / 1e6:.1f} MB of {LIMITS.total / 1e6:.0f}, ticks not written: {day.recorder.dropped}")
    table(day.readings)


@contextlib.contextmanager
def hogs(count: int) -> Iterator[None]:
    """Run so many processes that take all the processor they get."""
    running = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(count)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


def real(minutes: float, count: int, options: list[str]) -> None:
    """Steer a real process beside hogs, and print what its log and /proc say."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    with contextlib.suppress(PermissionError):
        os.nice(-5)  # the vehicle is hardware elsewhere
    with tempfile.TemporaryDirectory() as name, hogs(count):
        logs = Path(name) / "logs"
        command = [sys.executable, "-m", "autopilot", "run", "lanxin", "--link", f"udpin:127.0.0.1:{port}", "--as-gcs"]
        command += ["--engage", "90", "--log-dir", str(logs), "--wait", "0", *options]
        tester = _cyclictest(minutes)
        vehicle = WiredVehicle(load_vessel("lanxin"), port)
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        try:
            assert vehicle.run(lambda: len(vehicle.overrides) > 40), "never steered"
            readings = []
            for number in range(max(8, round(6 * minutes))):
                vehicle.run_for(60.0 * minutes / max(8, round(6 * minutes)))
                readings.append(
                    reading_of((number + 1) * minutes / 60.0 / max(8, round(6 * minutes)), str(process.pid))
                )
            process.send_signal(signal.SIGTERM)
            released = vehicle.run(lambda: not vehicle.is_held)
            code = process.wait(60.0)
        finally:
            process.kill()
        first = min(logs.glob("*.tlog"))
        ticks = [tick for log in read_logs(*following_parts(first)) for tick in log.ticks]
    print(f"{minutes:g} minutes, {count} hogs on {os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}")
    print(f"exit code {code}, rudder given back at the end: {'yes' if released else 'NO'}")
    _print_pace(ticks, load_vessel("lanxin").control.rate_hz)
    table(readings)
    if tester is not None:
        said = tester.communicate(timeout=60.0)[0].strip().splitlines()
        print(f"cyclictest, 1 ms, priority 40 [us]: {said[-1] if said else 'said nothing'}")


def _print_pace(ticks: list[Tick], rate_hz: float) -> None:
    engaged = [tick for tick in ticks if tick.mode is Mode.ENGAGED]
    gaps = np.diff([tick.now for tick in ticks])
    missed = int(np.sum(gaps > PERIODS_MISSED / rate_hz))
    quantiles = ", ".join(f"{1e3 * float(np.quantile(gaps, share)):.0f}" for share in (0.5, 0.99, 0.999, 1.0))
    print(f"ticks {len(ticks)}, engaged {len(engaged)}, other modes after engaging: {_others(ticks)}")
    print(f"between ticks, 50 %, 99 %, 99.9 %, longest: {quantiles} ms of {1e3 / rate_hz:.0f}")
    print(f"missed deadlines (more than {PERIODS_MISSED:g} periods): {missed} of {len(gaps)}")


def _others(ticks: list[Tick]) -> str:
    first = next((index for index, tick in enumerate(ticks) if tick.mode is Mode.ENGAGED), len(ticks))
    names = sorted({tick.mode.name for tick in ticks[first:]} - {"ENGAGED"})
    return ", ".join(names) or "none"


def _cyclictest(minutes: float) -> subprocess.Popen[str] | None:
    program = shutil.which("cyclictest")
    if program is None:
        return None
    command = [
        program,
        "--quiet",
        "--mlockall",
        "--priority=40",
        "--interval=1000",
        f"--duration={round(60 * minutes)}",
    ]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    kinds = parser.add_subparsers(dest="kind", required=True)
    lockstep = kinds.add_parser("simulated")
    lockstep.add_argument("--hours", type=float, default=24.0)
    lockstep.add_argument("--mavlink", action="store_true")
    process = kinds.add_parser("real")
    process.add_argument("--minutes", type=float, default=30.0)
    process.add_argument("--hogs", type=int, default=2)
    process.add_argument("--plain", action="store_true", help="without --realtime")
    arguments = parser.parse_args()
    if arguments.kind == "simulated":
        simulated(arguments.hours, arguments.mavlink)
    else:
        real(arguments.minutes, arguments.hogs, [] if arguments.plain else ["--realtime"])


if __name__ == "__main__":
    main()
