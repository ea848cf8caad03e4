"""The simulator and the pilot as two processes, started and ended as a user would."""

from __future__ import annotations

import contextlib
import itertools
import os
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from autopilot.vessel.file import dump_vessel, load_vessel
from sitl.faults import ask

PATIENCE_S = 60.0
"""Wall time in which what is waited for must happen on however busy a machine."""


def patient_vessel(folder: Path) -> Path:
    """Write Lanxin with a patient fail-safe: a busy machine may take a process away for a moment."""
    boat = load_vessel("lanxin")
    path = folder / "boat.yaml"
    path.write_text(dump_vessel(replace(boat, failsafe=replace(boat.failsafe, heading_timeout_s=6.0))))
    return path


PORTS = range(10_000, 32_000)
"""Below those that Linux gives to who asks for any: until the program that it is for opens a port, nobody gets it."""
_worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0")[2:])
_asked = itertools.count(os.getpid() * 37 % 5000)


def free_port(kind: socket.SocketKind = socket.SOCK_DGRAM) -> int:
    """Return a port that is free now, and that no other worker is given."""
    while True:
        port = PORTS[(5000 * _worker + next(_asked) % 5000) % len(PORTS)]
        with socket.socket(socket.AF_INET, kind) as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


def await_bound(port: int) -> None:
    """Return when a program has opened a UDP port of this machine."""
    end = time.monotonic() + PATIENCE_S
    while f":{port:04X} " not in Path("/proc/net/udp").read_text():
        assert time.monotonic() < end, f"nobody has opened {port}"
        time.sleep(0.05)


@contextlib.contextmanager
def simulator(speedup: float, *arguments: str, kind: str = "lanxin") -> Iterator[subprocess.Popen[str]]:
    """Run `sitl serve` at `speedup` while the block lasts."""
    command = [sys.executable, "-m", "sitl", "serve", kind, "--speedup", str(speedup), *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().startswith("ready")
            yield process
        finally:
            process.terminate()
            process.communicate()


def wait_until_engaged(run: subprocess.Popen[str]) -> None:
    """Return when the pilot has said that it steers."""
    assert run.stdout is not None
    while "ENGAGED" not in run.stdout.readline():
        assert run.poll() is None


def truth_of(path: Path) -> dict[str, float]:
    """Return the last whole row that `sitl serve --truth` has written."""
    header, *rows = path.read_text().splitlines(keepends=True)
    last = next(row for row in reversed(rows) if row.endswith("\n"))
    return dict(zip(header.strip().split(","), map(float, last.split(",")), strict=True))


def sailed(path: Path, is_so: Callable[[dict[str, float]], bool]) -> dict[str, float]:
    """Return the first row of the truth, of those to come too, in which that is so: by the boat's time, not by ours."""
    end = time.monotonic() + PATIENCE_S
    while not is_so(row := truth_of(path)):
        assert time.monotonic() < end, row
        time.sleep(0.05)
    return row


def sailed_for(path: Path, seconds: float) -> dict[str, float]:
    """Return the row of the truth when the boat has sailed for so many more seconds."""
    since = truth_of(path)["time_s"]
    return sailed(path, lambda row: row["time_s"] >= since + seconds)


def provoke(control: int, fault: str) -> None:
    """Let the simulator that listens at the port `control` have a fault from now on."""
    answer = ask(f"127.0.0.1:{control}", fault, PATIENCE_S)
    assert not answer.startswith("error"), answer
