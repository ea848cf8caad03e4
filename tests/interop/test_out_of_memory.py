"""A process whose memory is used up gives the rudder back and ends with 1; the next one steers."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from two_processes import free_port
from wired_vehicle import OVERRIDE_TIME_S, STEERED, WiredVehicle

from autopilot.runtime.log_files import following_parts
from autopilot.runtime.record import read_logs, replay
from autopilot.signals import Mode
from autopilot.vessel.file import load_vessel

pytestmark = pytest.mark.real_time

LEAKS = """
import resource, signal, sys
from pathlib import Path

from autopilot.cli.main import main
from autopilot.pilot import Pilot

# flat: Python 3.13 dies of taking a deep one apart without memory
kept, count, step, is_leaking = [None] * 500_000, 0, Pilot.step, False


def limit(*_):
    global is_leaking
    taken = resource.getpagesize() * int(Path("/proc/self/statm").read_text().split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (taken + 4_000_000, resource.RLIM_INFINITY))
    is_leaking = True


def leaking(self, now, samples, order):
    global count
    for size in (65536, 4096, 256, 1):
        try:
            while is_leaking:
                kept[count] = bytes(size)
                count += 1
        except MemoryError:
            pass  # the tick meets it, wherever it first needs a few bytes
    return step(self, now, samples, order)


Pilot.step = leaking
signal.signal(signal.SIGURG, limit)
sys.exit(main())
"""
SPEEDUP = 2.0
WITHOUT_MEMORY = ("MemoryError", "SystemError: error return without exception set")
"""CPython raises the second where one of its own C functions finds no memory and forgets to say so."""


def started(arguments: list[str], port: int, logs: Path) -> subprocess.Popen[str]:
    command = [sys.executable, *arguments, "run", "lanxin", "--link", f"udpin:127.0.0.1:{port}", "--as-gcs"]
    command += ["--engage", "90", "--wait", "0", "--speedup", str(SPEEDUP), "--log-dir", str(logs)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def test_a_process_without_memory_lets_go_and_the_next_one_steers(tmp_path: Path) -> None:
    port, logs = free_port(), tmp_path / "logs"
    vehicle = WiredVehicle(load_vessel("lanxin"), port, SPEEDUP)
    try:
        with started(["-c", LEAKS], port, logs) as process:
            try:
                assert vehicle.run(lambda: len(vehicle.overrides) > STEERED)
                process.send_signal(signal.SIGURG)
                assert vehicle.run(lambda: process.poll() is not None), "it went on without memory"
            finally:
                process.kill()
            assert process.stderr is not None
            said = process.stderr.read()
        vehicle.run_for(0.1)
        # given back with a message, not by the vehicle's own timeout after the last one
        assert not vehicle.is_held, said
        assert vehicle.held_until - vehicle.overrides[-1].time < 0.5 * OVERRIDE_TIME_S, said
        assert process.returncode == 1, said
        assert said.rstrip().endswith(WITHOUT_MEMORY), said
        (first,) = logs.glob("*.001.tlog")
        ticks = [tick for log in read_logs(*following_parts(first)) for tick in log.ticks]
        assert ticks[-1].mode is Mode.ENGAGED
        assert replay(first).identical

        before = len(vehicle.overrides)
        with started(["-m", "autopilot"], port, logs) as process:
            try:
                assert vehicle.run(lambda: len(vehicle.overrides) > before + STEERED)
                process.send_signal(signal.SIGTERM)
                assert vehicle.run(lambda: process.poll() is not None)
            finally:
                process.kill()
        assert process.returncode == 0
    finally:
        vehicle.close()
