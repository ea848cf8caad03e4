"""A day of steering: are memory and file descriptors flat, and does the loop keep time beside programs that hog?

    nice -n 10 python benchmarks/endurance.py simulated --hours 24            # pilot, law, log folder; direct link
    nice -n 10 python benchmarks/endurance.py simulated --hours 2 --mavlink   # with the flight controller on its line
    python benchmarks/endurance.py real --minutes 30 --hogs 2                 # a real process beside two CPU hogs
    python benchmarks/endurance.py alarms --hours 24 [--plant coaster]        # false alarms on every plant of the tests

Simulated: pilot and boat in lockstep, a new heading every ten minutes, five seconds without a compass every half hour
(a fail-safe, then engaged anew), standby every hour, a log folder that is kept below its size. Every simulated ten
minutes: memory, live Python blocks, open descriptors. The slope is that of a straight line through the second half,
with its standard error. A rudder that is still held a second after the pilot stood by is a missed release.

Real: `autopilot run --realtime` over UDP beside processes that count without end, and cyclictest beside it where it is
installed. The vehicle is this process; where it may, it takes SCHED_FIFO, for it stands for hardware. A tick that is
later than two control periods after the one before is a missed deadline: with or without a heading the loop must tick
after one and a half. `--report FILE.html` writes the page of a run (extra `report`).
Alarms: pilot, monitors and supervisor on each plant with healthy instruments and their noise, in calm, sea state 3 and
5 by the hour, a new course every five minutes; the seed is the day's date. An alarm that says what is so (a boat that
is off heading indeed, a rudder that is at its stop, a boat that turns against it, a whole turn) is counted apart. The
boats of the closed-loop tests have no hull there; here they have one as long as their turning makes it.

Exit code 1 where a descriptor stays open, simulated where a release was missed, real where the process did not steer to
the end; there a missed release is reported beside what cyclictest saw, for a machine that stands still misses
them too; of the alarms where a plant has more than one that is false in 24 hours, or any fail-safe.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from endurance_alarms import plants, watched
from endurance_day import LIMITS, PERIODS_MISSED, Day
from endurance_page import Reading, page, print_table, reading_of
from wired_vehicle import WiredVehicle

from autopilot.report import require_extra
from autopilot.runtime.log_files import following_parts
from autopilot.runtime.record import read_logs
from autopilot.runtime.session import PATIENCE
from autopilot.signals import Mode, Tick
from autopilot.supervision.panel import sentences_of
from autopilot.vessel.file import load_vessel

VEHICLE_PRIORITY = 60
"""Of SCHED_FIFO, above the pilot's 40 and cyclictest's."""


def simulated(hours: float, with_mavlink: bool, report: Path | None) -> bool:
    """Sail, read, print; Ctrl-C and SIGTERM end the day early. Return whether nothing was missed or left open."""
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        day = Day(Path(name), with_mavlink)
        signal.signal(signal.SIGTERM, signal.default_int_handler)
        with contextlib.suppress(KeyboardInterrupt):
            day.sail(hours)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)  # timeout(1) sends its own to who was sent one
        kept = sum(path.stat().st_size for path in Path(name).iterdir())
        day.session.close()
    reached, wall = day.sailed_s / 3600.0, time.monotonic() - started
    facts = [
        f"{reached:.1f} simulated hours in {wall:.0f} s, {'MAVLink' if with_mavlink else 'direct'} link",
        f"changes of mode: {', '.join(f'{count} to {mode}' for mode, count in sorted(day.modes.items()))}",
        f"releases of the rudder {day.releases}, missed {day.kept_hold}",
        f"ticks {day.ticks}, more than {PERIODS_MISSED:g} periods after the one before {day.missed}",
        f"log folder {kept / 1e6:.1f} MB of {LIMITS.total / 1e6:.0f}, ticks not written: {day.recorder.dropped}",
    ]
    report_run(f"Endurance: {reached:.1f} simulated hours", facts, day.readings, report)
    is_flat = not day.readings or day.readings[-1].descriptors <= day.readings[0].descriptors
    return is_flat and not (day.kept_hold or day.missed or day.recorder.dropped)


def report_run(
    title: str, facts: list[str], readings: list[Reading], report: Path | None, gaps: np.ndarray[Any, Any] | None = None
) -> None:
    """Print a run, and write its page where asked for."""
    print("\n".join(facts))
    print_table(readings)
    if report is not None:
        report.write_text(page(title, facts, readings, gaps), encoding="utf-8")


@contextlib.contextmanager
def hogs(count: int, nice: int) -> Iterator[None]:
    """Run so many processes that take all the processor they get, at this niceness."""
    program = f"import os; os.nice({nice})\nwhile True: pass"
    running = [subprocess.Popen([sys.executable, "-c", program]) for _ in range(count)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()


def real(minutes: float, count: int, nice: int, options: list[str], report: Path | None) -> bool:
    """Steer a real process beside hogs, print what its log and /proc say; return whether it steered to the end."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    hardware = _as_hardware()
    with tempfile.TemporaryDirectory() as name, hogs(count, nice):
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
            with contextlib.suppress(PermissionError):
                os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
        first = min(logs.glob("*.tlog"))
        ticks = [tick for log in read_logs(*following_parts(first)) for tick in log.ticks]
    gaps = np.diff([tick.now for tick in ticks])
    facts = [
        f"{minutes:g} minutes, {count} hogs on {os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}",
        hardware,
        f"exit code {code}, rudder given back at the end: {'yes' if released else 'NO'}",
        *_pace(ticks, gaps, load_vessel("lanxin").control.rate_hz),
    ]
    if tester is not None:
        said = tester.communicate(timeout=60.0)[0].strip().splitlines()
        facts.append(f"cyclictest, 1 ms, priority 40 [us]: {said[-1] if said else 'said nothing'}")
    report_run(f"Endurance: {minutes:g} minutes beside {count} hogs", facts, readings, report, gaps)
    is_flat = readings[-1].descriptors <= readings[0].descriptors
    return code == 0 and released and is_flat and _others(ticks) == "none"


def _as_hardware() -> str:
    """Let this process, the vehicle, go before every program, but not its children: a flight controller has a processor
    of its own. Return what came of it."""
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    try:
        os.sched_setscheduler(0, policy, os.sched_param(VEHICLE_PRIORITY))
    except PermissionError:
        return "the vehicle is a program like any other (no right to SCHED_FIFO): its waits count as the pilot's"
    return f"the vehicle, hardware elsewhere, at SCHED_FIFO {VEHICLE_PRIORITY}: it goes before the pilot"


def _pace(ticks: list[Tick], gaps: np.ndarray[Any, Any], rate_hz: float) -> list[str]:
    engaged = sum(tick.mode is Mode.ENGAGED for tick in ticks)
    late = int(np.sum(gaps > PERIODS_MISSED / rate_hz))
    skipped = int(np.sum(gaps > 2.0 * PATIENCE / rate_hz))
    quantiles = ", ".join(f"{1e3 * float(np.quantile(gaps, share)):.0f}" for share in (0.5, 0.99, 0.999, 1.0))
    return [
        f"ticks {len(ticks)}, engaged {engaged}, other modes after engaging: {_others(ticks)}",
        f"alarms: {'; '.join(dict.fromkeys(said for tick in ticks for said in sentences_of(tick.alarms))) or 'none'}",
        f"between ticks, 50 %, 99 %, 99.9 %, longest: {quantiles} ms of {1e3 / rate_hz:.0f}",
        f"missed deadlines (more than {PERIODS_MISSED:g} periods): {late} of {len(gaps)}",
        f"missed releases (a tick that the timer owed and that did not come): {skipped}",
    ]


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


def main() -> int:
    """Run what is asked for; 1 where something was missed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    kinds = parser.add_subparsers(dest="kind", required=True)
    lockstep = kinds.add_parser("simulated")
    lockstep.add_argument("--hours", type=float, default=24.0)
    lockstep.add_argument("--mavlink", action="store_true")
    process = kinds.add_parser("real")
    process.add_argument("--minutes", type=float, default=30.0)
    process.add_argument("--hogs", type=int, default=2)
    process.add_argument("--nice", type=int, default=0, help="of the hogs: what others do on this machine goes first")
    process.add_argument("--plain", action="store_true", help="without --realtime")
    alarms = kinds.add_parser("alarms")
    alarms.add_argument("--hours", type=int, default=24, help="simulated hours of each plant")
    alarms.add_argument("--plant", action="append", choices=list(plants()), help="this one only; may be repeated")
    alarms.add_argument("--seed", type=int, default=int(f"{date.today():%Y%m%d}"))
    for each in (lockstep, process):
        each.add_argument("--report", type=Path, metavar="FILE.html")
    arguments = parser.parse_args()
    if arguments.kind == "alarms":
        print(f"seed {arguments.seed}\n| plant | simulated | false alarms | fail-safes | which | said and so |")
        print("|---|---|---|---|---|---|", flush=True)
        borne = [watched(plant, arguments.hours, arguments.seed) for plant in arguments.plant or plants()]
        return 0 if all(borne) else 1
    if arguments.report is not None:
        require_extra("by leaving --report out")
    if arguments.kind == "simulated":
        is_well = simulated(arguments.hours, arguments.mavlink, arguments.report)
    else:
        options = [] if arguments.plain else ["--realtime"]
        is_well = real(arguments.minutes, arguments.hogs, arguments.nice, options, arguments.report)
    return 0 if is_well else 1


if __name__ == "__main__":
    sys.exit(main())
