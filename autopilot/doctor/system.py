"""The system: versions of what Norrbin is built on, the disk for its logs, the serial lines it may use."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

from autopilot.doctor.finding import Finding, Verdict

NEEDED = {"pymavlink": "2.4.49", "pyserial": "3.5", "numpy": "1.26", "scipy": "1.11", "pyyaml": "6.0"}
PYTHON = (3, 11)
LEAST_FREE_MB, GOOD_FREE_MB = 50.0, 500.0
WRITTEN_MB = 4
SLOW_MB_S = 1.0
"""A log needs some ten kilobytes a second; a card ten times slower than this stalls for seconds at a time."""


def versions() -> Finding:
    """Return the versions of Python and the libraries, and which are too old or missing."""
    said = [f"Python {platform.python_version()} on {platform.machine()}"]
    wrong = [] if sys.version_info >= PYTHON else [f"Python {'.'.join(map(str, PYTHON))} or newer is needed"]
    for name, least in NEEDED.items():
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            wrong.append(f"{name} is missing")
            continue
        said.append(f"{name} {version}")
        if _numbers(version) < _numbers(least):
            wrong.append(f"{name} {least} or newer is needed")
    verdict = Verdict.NO_GO if wrong else Verdict.GO
    return Finding("versions", verdict, ", ".join(said), f"{'; '.join(wrong)}: python -m pip install --upgrade norrbin")


def disk(folder: Path) -> Finding:
    """Return the room for logs in `folder` and how fast they are written through to the disk."""
    try:
        free = shutil.disk_usage(folder).free / 1e6
        speed, worst = _written(folder) if free > 4 * WRITTEN_MB else (0.0, 0.0)
    except OSError as error:
        return Finding("disk", Verdict.NO_GO, f"{folder}: {error.strerror}", "give another folder with --log-dir")
    found = f"{free:.0f} MB free in {folder}, {speed:.1f} MB/s flushed, longest write {worst * 1e3:.0f} ms"
    figures = {"free_mb": free, "mb_s": speed, "longest_write_ms": worst * 1e3}
    if free < LEAST_FREE_MB:
        return Finding("disk", Verdict.NO_GO, found, "remove what is not needed, or log elsewhere", figures)
    is_good = free >= GOOD_FREE_MB and speed >= SLOW_MB_S
    verdict = Verdict.GO if is_good else Verdict.WARN
    return Finding("disk", verdict, found, "make room, use a faster card, or log to another disk", figures)


def serial_lines(devices: Iterable[Path] | None = None) -> Finding:
    """Return the serial devices that are plugged in and whether they may be used."""
    found = sorted(_devices() if devices is None else devices)
    if not found:
        return Finding("serial lines", Verdict.GO, "none plugged in")
    closed = [str(path) for path in found if not os.access(path, os.R_OK | os.W_OK)]
    if not closed:
        return Finding("serial lines", Verdict.GO, f"may be used: {', '.join(map(str, found))}")
    cure = "sudo usermod -aG dialout $USER, then log in again"
    return Finding("serial lines", Verdict.WARN, f"permission denied on {', '.join(closed)}", cure)


def _devices() -> list[Path]:
    return [
        path for pattern in ("ttyUSB*", "ttyACM*", "ttyAMA*", "serial[0-9]*") for path in Path("/dev").glob(pattern)
    ]


def _written(folder: Path) -> tuple[float, float]:
    """Return the speed [MB/s] and the longest write [s] of a file written through to the disk in small pieces."""
    block, worst = os.urandom(65536), 0.0
    with tempfile.TemporaryFile(dir=folder, buffering=0) as file:
        started = time.monotonic()
        for _ in range(WRITTEN_MB * 1_000_000 // len(block)):
            before = time.monotonic()
            file.write(block)
            worst = max(worst, time.monotonic() - before)
        os.fsync(file.fileno())
        return WRITTEN_MB / max(time.monotonic() - started, 1e-6), worst


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])
