"""This computer: its programs and disk, how late it wakes, what real time it gives, its memory, supply and clock.

The machine: how late it wakes, what real time it gives, its memory, its supply, its clock.

One thing that was looked at: what was found, whether one can go to sea with it, why not, and the cure.

The system: versions of what Norrbin is built on, the disk for its logs, the serial lines it may use.
"""

from __future__ import annotations

import ctypes
import importlib.metadata
import os
import platform
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple


class Verdict(IntEnum):
    """Go; go, but better this were mended; no go."""

    GO = 0
    WARN = 1
    NO_GO = 2


class Finding(NamedTuple):
    """`found` is said in any case; `cure` says what to do where the verdict is not GO. figures: the same as numbers."""

    name: str
    verdict: Verdict
    found: str
    cure: str = ""
    figures: dict[str, float] = {}  # noqa: RUF012 - never changed


def worst(findings: Iterable[Finding]) -> Verdict:
    """Return the verdict on all of them."""
    return max((finding.verdict for finding in findings), default=Verdict.GO)


def share_below(values: list[float], share: float) -> float:
    """Return the value below which `share` of `values` lie; nan where there are none."""
    return sorted(values)[min(len(values) - 1, int(share * len(values)))] if values else float("nan")


WAKE_S = 3.0
LATE_SHARE = 0.5
"""A wake-up later than this share of the control period is felt in the loop's margins."""
MEMORY_MB = 150.0
HOT_C = 80.0
TIME_ERROR = 5
"""adjtimex(2) returns this while nobody keeps the clock right."""
THROTTLED = Path("/sys/devices/platform/soc/soc:firmware/get_throttled")
UNDERVOLTAGE, CAPPED, HAS_BEEN = 0x1, 0xE, 16
"""Bits of the Raspberry Pi firmware's word: now; those that slow the processor; the same 16 bits up: since boot."""
CYCLICTEST_MAX = re.compile(r"Avg:\s*(\d+)\s+Max:\s*(\d+)")


def wake_up(
    rate_hz: float,
    seconds: float = WAKE_S,
    now: Callable[[], float] = time.monotonic,
    sleep: Callable[[float], None] = time.sleep,
) -> Finding:
    """Return how late this process wakes from the sleeps of a loop of `rate_hz`."""
    period = 1.0 / rate_hz
    late: list[float] = []
    due = now() + period
    for _ in range(max(20, round(seconds * rate_hz))):
        sleep(max(0.0, due - now()))
        late.append(max(0.0, now() - due))
        due = max(due + period, now())
    p99, most = share_below(late, 0.99), max(late)
    figures = {"p50_ms": share_below(late, 0.5) * 1e3, "p99_ms": p99 * 1e3, "worst_ms": most * 1e3}
    found = f"99 % within {p99 * 1e3:.2f} ms, worst {most * 1e3:.2f} ms, of {period * 1e3:.0f} ms"
    verdict = Verdict.GO
    if most > LATE_SHARE * period:
        verdict = Verdict.NO_GO if p99 > LATE_SHARE * period else Verdict.WARN
    cure = "end other programs, run with --realtime (docs/process.md), or lower control.rate_hz in the vessel file"
    return Finding("wake-up", verdict, found, cure, figures)


def cyclictest(seconds: float = WAKE_S) -> Finding:
    """Return what cyclictest measures beside it, where it is installed."""
    program = shutil.which("cyclictest")
    if program is None:
        return Finding("cyclictest", Verdict.GO, "not installed (apt install rt-tests)")
    command = [program, "--quiet", "--interval=1000", f"--duration={max(1, round(seconds))}"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=seconds + 30.0, check=False)
    except subprocess.TimeoutExpired:
        return Finding("cyclictest", Verdict.GO, "did not end")
    return _of_cyclictest(done.stdout + done.stderr)


def _of_cyclictest(said: str) -> Finding:
    numbers = CYCLICTEST_MAX.search(said)
    if numbers is None:
        return Finding("cyclictest", Verdict.GO, f"says: {(said.strip().splitlines() or ['nothing'])[-1]}")
    mean, most = (float(number) / 1e3 for number in numbers.groups())
    figures = {"mean_ms": mean, "worst_ms": most}
    return Finding("cyclictest", Verdict.GO, f"mean {mean:.2f} ms, worst {most:.2f} ms of 1 ms", "", figures)


def real_time(priority: int = 40) -> Finding:
    """Return whether `--realtime` would be granted."""
    is_root = os.geteuid() == 0
    may_prioritise = is_root or resource.getrlimit(resource.RLIMIT_RTPRIO)[1] >= priority
    may_lock = is_root or resource.getrlimit(resource.RLIMIT_MEMLOCK)[1] == resource.RLIM_INFINITY
    kernel = "PREEMPT_RT" if Path("/sys/kernel/realtime").exists() else "ordinary"
    found = (
        f"{kernel} kernel, priority {'granted' if may_prioritise else 'refused'}, "
        f"memory lock {'granted' if may_lock else 'refused'}"
    )
    cure = f"`autopilot install-service`, or rtprio {priority} and memlock unlimited in /etc/security/limits.conf"
    return Finding("real time", Verdict.GO if may_prioritise and may_lock else Verdict.WARN, found, cure)


def memory(meminfo: str | None = None) -> Finding:
    """Return the memory that is free; `meminfo`: the text of /proc/meminfo."""
    try:
        text = Path("/proc/meminfo").read_text() if meminfo is None else meminfo
    except FileNotFoundError:
        return Finding("memory", Verdict.WARN, "not known, /proc is not there", "mount /proc in this container")
    found = re.search(r"^MemAvailable:\s+(\d+) kB", text, re.M)
    if found is None:
        return Finding("memory", Verdict.WARN, "not known", "look with `free -m`")
    free = int(found[1]) / 1e3
    verdict = Verdict.GO if free >= MEMORY_MB else Verdict.NO_GO
    return Finding("memory", verdict, f"{free:.0f} MB free", "end other programs", {"free_mb": free})


def clock_kept(state: int | None = None) -> Finding:
    """Return whether somebody keeps the wall clock right; only the logs' dates and signing depend on it."""
    if state is None:
        state = ctypes.CDLL(None).adjtimex(ctypes.create_string_buffer(512))
    if state != TIME_ERROR:
        return Finding("clock", Verdict.GO, "synchronised")
    cure = "connect to a time server once, fit a clock module, or let chrony or gpsd set it from the GPS"
    return Finding("clock", Verdict.WARN, "nobody keeps it right: dates in logs may be wrong", cure)


def supply(word: str | None = None) -> Finding | None:
    """Return what a Raspberry Pi says of its supply; None elsewhere. `word`: hexadecimal, as the firmware has it."""
    text = _throttled() if word is None else word
    if text is None:
        return None
    bits = int(text.removeprefix("throttled=").strip(), 16)
    before = bits >> HAS_BEEN
    cure = "a supply of 5.1 V and 3 A or more with a short thick cable; a heat sink"
    if bits & UNDERVOLTAGE:
        return Finding("supply", Verdict.NO_GO, "undervoltage now", cure)
    if bits & CAPPED:
        return Finding("supply", Verdict.WARN, "the processor is slowed down now", cure)
    if before & (UNDERVOLTAGE | CAPPED):
        what = "undervoltage" if before & UNDERVOLTAGE else "slowed down"
        return Finding("supply", Verdict.WARN, f"{what} since the last boot", cure)
    return Finding("supply", Verdict.GO, "never undervoltage, never slowed down")


def temperature(zone: Path = Path("/sys/class/thermal/thermal_zone0/temp")) -> Finding | None:
    """Return how hot the processor is; None where it does not tell."""
    try:
        celsius = int(zone.read_text()) / 1000.0
    except (OSError, ValueError):
        return None
    verdict = Verdict.WARN if celsius >= HOT_C else Verdict.GO
    return Finding("temperature", verdict, f"{celsius:.0f} C", "shade, air or a heat sink", {"celsius": celsius})


def hardware_watchdog(device: Path = Path("/dev/watchdog")) -> Finding:
    """Return whether a hardware watchdog could restart a machine that hangs as a whole."""
    if device.exists():
        return Finding("hardware watchdog", Verdict.GO, "present; RuntimeWatchdogSec= uses it (docs/install.md)")
    cure = "dtparam=watchdog=on in config.txt of a Raspberry Pi (docs/install.md)"
    return Finding("hardware watchdog", Verdict.WARN, "none: a machine that hangs stays so", cure)


def _throttled() -> str | None:
    try:
        return THROTTLED.read_text()
    except OSError:
        pass
    program = shutil.which("vcgencmd")
    if program is None:
        return None
    done = subprocess.run([program, "get_throttled"], capture_output=True, text=True, timeout=10.0, check=False)
    return done.stdout if done.returncode == 0 and done.stdout.startswith("throttled=") else None


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
    if not wrong:
        return Finding("versions", Verdict.GO, ", ".join(said))
    cure = f"{'; '.join(wrong)}: python -m pip install --upgrade norrbin"
    return Finding("versions", Verdict.NO_GO, ", ".join(said), cure)


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
    found = sorted(serial_devices() if devices is None else devices)
    if not found:
        return Finding("serial lines", Verdict.GO, "none plugged in")
    closed = [str(path) for path in found if not os.access(path, os.R_OK | os.W_OK)]
    if not closed:
        return Finding("serial lines", Verdict.GO, f"may be used: {', '.join(map(str, found))}")
    cure = "sudo usermod -aG dialout $USER, then log in again"
    return Finding("serial lines", Verdict.WARN, f"permission denied on {', '.join(closed)}", cure)


def serial_devices() -> list[Path]:
    """Return the serial devices that are plugged in."""
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
