"""How long until a steering process ticks, what it holds in memory, and what `--help` costs beside bare Python.

python benchmarks/start_up.py
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

RUN = [sys.executable, "-m", "autopilot", "run", "lanxin", "--link", "udpin:127.0.0.1:0", "--wait", "0"]


def to_first_tick(folder: Path) -> tuple[float, float]:
    """Return the time [s] from the start of the process to READY=1, which the first tick sends, and its memory [MB]."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        place = folder / "notify"
        place.unlink(missing_ok=True)
        manager.bind(str(place))
        manager.settimeout(60.0)
        started = time.perf_counter()
        environ = {**os.environ, "NOTIFY_SOCKET": str(place)}
        process = subprocess.Popen(RUN, env=environ, stdout=subprocess.DEVNULL)
        try:
            while b"READY=1" not in manager.recv(4096):
                pass
            taken = time.perf_counter() - started
            time.sleep(1.0)
            status = Path(f"/proc/{process.pid}/status").read_text()
        finally:
            process.terminate()
            process.communicate()
    resident = re.search(r"VmRSS:\s+(\d+) kB", status)
    return taken, int(resident[1]) / 1e3 if resident else 0.0


def whole(command: list[str]) -> Callable[[], tuple[float, float]]:
    """Return a measurement of a command from start to end: time [s] and processor time [s]."""

    def measure() -> tuple[float, float]:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        started = time.perf_counter()
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        taken = time.perf_counter() - started
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return taken, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    return measure


def main() -> None:
    """Measure in turn and print medians and extremes."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--times", type=int, default=10)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        cases: dict[str, Callable[[], tuple[float, float]]] = {
            "bare Python": whole([sys.executable, "-c", "pass"]),
            "--help": whole([sys.executable, "-m", "autopilot", "--help"]),
            "run, to its first tick": lambda: to_first_tick(Path(name)),
        }
        found = {case: [measure() for _ in range(arguments.times)] for case, measure in cases.items()}
    print(f"{os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}, {arguments.times} times")
    for case, pairs in found.items():
        times = [first for first, _ in pairs]
        second = statistics.median(second for _, second in pairs)
        what = f"{second:.0f} MB resident" if "run" in case else f"{second:.3f} s of processor time"
        print(f"{case:34s} {statistics.median(times):.3f} s ({min(times):.3f} to {max(times):.3f})   {what}")


if __name__ == "__main__":
    main()
