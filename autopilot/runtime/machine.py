"""What the loop sees of its machine, and asks of it.

Seen: its clock, a faster one, or a manual one for tests and lockstep; ticks that come late, and a wall clock that
somebody has set. Asked for: priority, memory that stays, a core, quiet collections. Nothing of it is needed: what
cannot be had is one sentence with the way to get it.

What keeps a steering process well, beside the steering: the service manager, real time, garbage, and a restart.

What a service manager gets to know: ready, alive, why not well, leaving. Without one nothing is sent. The protocol is
sd_notify(3) of systemd: datagrams of VARIABLE=value lines to the socket named in NOTIFY_SOCKET. Signs of life come from
the tick and from no other place: when it hangs they stop, and after WatchdogSec the manager aborts the process and
starts another.

A steering process that died says to the next one what it was doing; that goes on only where the file allows. The note
lies where a reboot forgets it (/run), with the boot's id and the age by a clock that nobody sets. How late orders come
to the rudder is noted beside the vessel file, with the links that it was measured over.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import json
import math
import os
import resource
import select
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

from autopilot.errors import InputError, RefusedError
from autopilot.estimation.path_delay import PathDelay
from autopilot.estimation.tuning import PATH_LATER, PATH_MOST
from autopilot.files.outside import parse_json, read_regular
from autopilot.links.base import Link, LinkError
from autopilot.signals import ConditionSample, Mode, OrderKind, Sample, Tick
from autopilot.supervision.panel import sentences_of
from autopilot.supervision.tuning import LATE_PERIODS


def running_time() -> float:
    """Return seconds of a clock that never goes backwards, and goes on while the machine is suspended."""
    return time.clock_gettime(getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC))


class Clock(Protocol):
    """Tells the time and waits."""

    def now(self) -> float:
        """Return seconds of a clock that never goes backwards."""

    def wait(self, descriptors: Sequence[int], until: float) -> None:
        """Return when a descriptor can be read or `until` [s] has come, whichever is first."""


class MonotonicClock:
    """The machine's `running_time`, from 0 at creation, `speedup` times as fast (for a sped-up simulator)."""

    def __init__(self, speedup: float = 1.0) -> None:
        self._speedup = speedup
        self._start = running_time()

    def now(self) -> float:
        """Return seconds since creation, times the speed-up."""
        return (running_time() - self._start) * self._speedup

    def wait(self, descriptors: Sequence[int], until: float) -> None:
        """Wait for bytes or for `until` [s]."""
        left = (until - self.now()) / self._speedup
        if left > 0.0:
            select.select(descriptors, (), (), left)


LATE_COUNT = 3
LATE_WITHIN_S = 10.0
"""So many late ticks within this time are an alarm, until so long passes without one."""
STANDSTILL_S = 1.0
"""One tick later than this is an alarm at once: a stopped process or machine, while the boat went on. As long a vehicle
has to follow an order before it counts as disobedient."""
STEP_S = 1.0
SAID_S = 60.0
CHECK_S = 1.0


class LoopHealth(Link):
    """A `Link` to nobody: is shown every tick, and brings what is wrong with their times into the next one.

    `wall` and `monotonic` return seconds; `period` [s] is the control period, in the loop's own time.
    """

    name = "loop"

    def __init__(
        self,
        period: float,
        wall: Callable[[], float] = time.time,
        monotonic: Callable[[], float] = running_time,
    ) -> None:
        self._longest = LATE_PERIODS * period
        self._wall, self._monotonic = wall, monotonic
        self._last: float | None = None
        self._late: deque[float] = deque()
        self._longest_gap = 0.0
        self._is_late = False
        self._offset = wall() - monotonic()
        self._checked = monotonic()
        self._stepped_at: float | None = None

    def publish_tick(self, tick: Tick) -> None:
        """Take the time of a tick."""
        if self._last is not None and tick.now - self._last > self._longest:
            self._late.append(tick.now)
            self._longest_gap = max(self._longest_gap, tick.now - self._last)
        self._last = tick.now

    def receive(self, now: float) -> list[Sample]:
        """Return what has begun or ended."""
        found = self._lateness(now) if self._late or self._is_late else []
        running = self._monotonic()
        return found if running - self._checked < CHECK_S else [*found, *self._clock(now, running)]

    def _lateness(self, now: float) -> list[Sample]:
        while self._late and now - self._late[0] > LATE_WITHIN_S:
            self._late.popleft()
        stood_still = self._longest_gap > max(STANDSTILL_S, self._longest)
        if not self._is_late and (len(self._late) >= LATE_COUNT or (self._late and stood_still)):
            self._is_late = True
            ticks = "tick" if len(self._late) == 1 else "ticks"
            detail = f"{len(self._late)} {ticks} late by up to {self._longest_gap:.2f} s"
            return [ConditionSample(now, "deadline_missed", True, detail, self.name)]
        if self._is_late and not self._late:
            self._is_late, self._longest_gap = False, 0.0
            return [ConditionSample(now, "deadline_missed", False, "", self.name)]
        return []

    def _clock(self, now: float, running: float) -> list[Sample]:
        self._checked = running
        offset = self._wall() - running
        step, self._offset = offset - self._offset, offset
        if abs(step) > STEP_S:
            self._stepped_at = running
            return [ConditionSample(now, "clock_stepped", True, f"by {step:+.0f} s", self.name)]
        if self._stepped_at is not None and running - self._stepped_at > SAID_S:
            self._stepped_at = None
            return [ConditionSample(now, "clock_stepped", False, "", self.name)]
        return []


MCL_CURRENT, MCL_FUTURE = 1, 2
YOUNG = 2000
"""Objects made since the last collection before one is worth its time."""
OLD_EVERY = 200
"""Young collections from one look through what has lasted to the next."""
SAFETY_NET = (100_000, 50, 100)
"""Thresholds of the automatic collector: only a loop without slack reaches them."""


class RealTime(NamedTuple):
    """priority: of SCHED_FIFO, 1 to 99, None for the usual scheduling.  cpus: cores to keep to, () for any."""

    priority: int | None = None
    cpus: tuple[int, ...] = ()


def make_real_time(wanted: RealTime) -> list[str]:
    """Ask the system for `wanted`; return a sentence for each thing that it refused.

    The threads that exist by now (the log's) get one priority less: they hold the interpreter for moments, and whoever
    holds it must not be kept from going on by programs of lower priority.
    """
    refused = []
    if wanted.cpus:
        refused.append(_pin_to(wanted.cpus))
    if wanted.priority is not None:
        refused.append(_lock_memory())
        refused.append(_schedule(wanted.priority))
    return [sentence for sentence in refused if sentence]


def cpus_of(text: str) -> tuple[int, ...]:
    """Return the cores named in `text`, such as 3 or 2,3. Raises InputError."""
    present = os.cpu_count() or 1
    words = text.split(",")
    if not {*words} <= {str(core) for core in range(present)}:
        raise InputError(f"--cpu {text}: numbers of cores from 0 to {present - 1} are allowed, such as {present - 1}")
    return tuple(int(word) for word in words)


def _pin_to(cpus: Sequence[int]) -> str:
    try:
        os.sched_setaffinity(0, cpus)
    except OSError as error:
        asked, allowed = (",".join(map(str, sorted(some))) for some in (cpus, os.sched_getaffinity(0)))
        return (
            f"not kept to CPU {asked} ({error.strerror}): allowed here are {allowed}; see CPUAffinity= of the service"
        )
    return ""


def _lock_memory() -> str:
    limit = resource.getrlimit(resource.RLIMIT_MEMLOCK)[1]
    way_out = "set LimitMEMLOCK=infinity in the service, or `- memlock unlimited` in /etc/security/limits.conf"
    if limit != resource.RLIM_INFINITY and os.geteuid() != 0:
        # locked within a limit, memory that is asked for later would be refused
        return f"memory is not locked (at most {limit // 1024} kB are allowed): {way_out}"
    import ctypes

    library = ctypes.CDLL(None, use_errno=True)
    if library.mlockall(MCL_CURRENT | MCL_FUTURE) != 0:
        return f"memory is not locked ({os.strerror(ctypes.get_errno())}): {way_out}"
    return ""


def _schedule(priority: int) -> str:
    way_out = f"set LimitRTPRIO={priority} in the service, or `- rtprio {priority}` in /etc/security/limits.conf"
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    try:
        for thread in threading.enumerate():
            if thread is not threading.main_thread() and thread.native_id is not None:
                os.sched_setscheduler(thread.native_id, policy, os.sched_param(max(1, priority - 1)))
        os.sched_setscheduler(0, policy, os.sched_param(priority))
    except OSError as error:
        return f"no real-time priority ({error.strerror}): {way_out}"
    return ""


class SlackCollector:
    """Collects garbage when it is called, in the slack behind a tick, so that no collection falls into one.

    What exists when it is made is never looked through again. `close` gives the collector back as it was.
    """

    def __init__(self, collect: Callable[[int], int] = gc.collect) -> None:
        self._collect = collect
        self._before = gc.get_threshold()
        self._young = 0
        gc.collect()
        gc.freeze()
        gc.set_threshold(*SAFETY_NET)

    def __call__(self) -> None:
        if gc.get_count()[0] >= YOUNG:
            self._young += 1
            self._collect(2 if self._young % OLD_EVERY == 0 else 1)

    def close(self) -> None:
        """Leave the collector as it was found."""
        gc.set_threshold(*self._before)
        gc.unfreeze()


RENEWED_S = 1.0
LONGEST = 4096
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class Note(NamedTuple):
    """heading [rad] that was held by the `compass` NAME@LINK, '' where there was nothing to choose among, and `since`
    [s] by the clock `running_time` of the boot `boot`."""

    heading: float
    since: float
    boot: str
    compass: str = ""


class RestartState:
    """Keeps the note of what is steered, in the file `path`, and reads what another process has left there.

    Args:
        within: a note older than this [s] is forgotten; 0: any.
        save: writes a text to a file, later and from another thread.
        clock: the machine's clock [s], which goes on while it is suspended.
        compass: returns the source of the headings that are steered by.
    """

    def __init__(
        self,
        path: Path,
        within: float,
        save: Callable[[Path, str], None],
        clock: Callable[[], float] = running_time,
        boot: str | None = None,
        compass: Callable[[], str] = str,
    ) -> None:
        self._compass = compass
        self._path, self._within, self._save, self._clock = path, within, save, clock
        self._boot = _boot() if boot is None else boot
        self._next = -math.inf
        self._kept: tuple[float, str] | None = None

    def left(self) -> Note | None:
        """Return the note of a process that held a heading and ended less than `within` ago without leaving it."""
        note = _read(self._path)
        if note is None or note.boot != self._boot:
            return None
        return note if 0.0 <= self._clock() - note.since <= self._within else None

    def ticked(self, tick: Tick) -> None:
        """Renew the note while a heading is held; take it away when it no longer is."""
        holds = tick.mode is Mode.ENGAGED and tick.order.kind is OrderKind.HEADING
        now = self._clock()
        # a heading of nan means the present one
        ordered = tick.order.heading if math.isfinite(tick.order.heading) else tick.reference.heading
        held = (ordered, self._compass()) if holds else None
        if held == self._kept and (held is None or now < self._next):
            return
        self._kept, self._next = held, now + RENEWED_S
        self._save(self._path, json.dumps(Note(held[0], now, self._boot, held[1])._asdict()) if held else "")

    def close(self) -> None:
        """Forget: the helm was left on purpose."""
        if self._kept is not None:
            self._kept = None
            self._save(self._path, "")


def _boot() -> str:
    try:
        return BOOT_ID.read_text().strip()
    except OSError:
        return f"unknown {os.getpid()}"


def _read(path: Path) -> Note | None:
    try:
        fields = parse_json(read_regular(path, LONGEST), str(path), LONGEST)
        heading, since, boot = float(fields["heading"]), float(fields["since"]), str(fields["boot"])
        note = Note(heading, since, boot, str(fields.get("compass", "")))
    except (InputError, OSError, ValueError, KeyError, TypeError, AttributeError):
        return None
    return note if math.isfinite(note.heading) and math.isfinite(note.since) else None


class PathNote:
    """Keeps the note of how late orders come to the rudder over these `links`, and reads what an earlier run has left.

    Args:
        path: the file.  filed: `control.path_delay_s` of the vessel file [s]; a note from when it was another is older
            than what the skipper has written since.  save: writes a text to a file, later and from another thread.

    Attributes:
        kept: the delay [s] that is known; nothing is noted while it is the measured one.
    """

    def __init__(
        self, path: Path, links: Sequence[str], filed: float | None, save: Callable[[Path, str], None]
    ) -> None:
        self._path, self._links, self._filed, self._save = path, list(links), filed, save
        self.kept = math.nan

    def left(self) -> float | None:
        """Return the delay [s] that was measured over the same links, and the file has said nothing else since; None
        where none was, or it can be none."""
        try:
            fields = parse_json(read_regular(self._path, LONGEST), str(self._path), LONGEST)
            links, filed, delay = fields["links"], fields["filed_s"], float(fields["path_delay_s"])
        except (InputError, OSError, ValueError, KeyError, TypeError):
            return None
        return delay if (links, filed) == (self._links, self._filed) and 0.0 <= delay <= PATH_MOST else None

    def steered_by(self, path: PathDelay, filed: float) -> None:
        """Note the delay [s] that is steered by, where it was measured and is another than is known; filed [s]: what
        the file says."""
        delay = filed + path.late
        if not math.isnan(path.delay) and abs(delay - self.kept) > PATH_LATER:
            self.kept = delay
            delay = round(min(delay, PATH_MOST), 3)
            note = {"links": self._links, "filed_s": self._filed, "path_delay_s": delay}
            self._save(self._path, json.dumps(note) + "\n")


FEEDS_A_PERIOD = 4
"""Signs of life in the time that the manager waits for one: systemd asks for two."""


class ServiceManager:
    """Tells the service manager of `environ` how the loop is. Nothing here raises or waits.

    Args:
        environ: NOTIFY_SOCKET names the socket; WATCHDOG_USEC how often life must be shown, WATCHDOG_PID by whom.
        clock: seconds of a clock that never goes backwards.
    """

    def __init__(self, environ: Mapping[str, str] = os.environ, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._address = _address(environ.get("NOTIFY_SOCKET", ""))
        period = _microseconds(environ.get("WATCHDOG_USEC", ""))
        is_for_us = environ.get("WATCHDOG_PID", str(os.getpid())) == str(os.getpid())
        self.feeding_s = period / FEEDS_A_PERIOD if is_for_us else 0.0
        self._next = 0.0
        self._status = ""
        self._socket: socket.socket | None = None
        if self._address:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
            self._socket.setblocking(False)

    def ticked(self, tick: Tick) -> None:
        """Show that the loop lives, at the first tick that it is ready, and its mode and alarms when they change."""
        if self._socket is None:
            return
        lines = []
        status = "; ".join((tick.mode.name, *sentences_of(tick.alarms)))
        if not self._status:
            lines.append("READY=1")
        if status != self._status:
            self._status = status
            lines.append(f"STATUS={' '.join(status.split())}")
        now = self._clock()
        if self.feeding_s and now >= self._next:
            self._next = now + self.feeding_s
            lines.append("WATCHDOG=1")
        self._send(lines)

    def close(self) -> None:
        """Say that the process ends; further calls do nothing."""
        self._send(["STOPPING=1"])
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _send(self, lines: list[str]) -> None:
        if self._socket is not None and lines:
            # a manager that does not listen will abort us; that is its part
            with contextlib.suppress(OSError):
                self._socket.sendto("\n".join(lines).encode(), self._address)


def _address(name: str) -> str:
    """Return the socket's address: a path, or a name in the abstract namespace, which begins with @."""
    if name.startswith("@"):
        return "\0" + name[1:]
    return name if name.startswith("/") else ""


def _microseconds(text: str) -> float:
    return int(text) * 1.0e-6 if text.isascii() and text.isdigit() and len(text) < 19 else 0.0


FAULT = "autopilot: the program failed; the rudder was given back. Keep the log and report what follows"


class ServiceHooks:
    """Round the running session: enter it when all threads run, call it after every tick.

    An end that was meant, or that a link or a refusal brought, is no end to resume from; a fault of ours is one.
    """

    def __init__(self, real_time: RealTime, restart: RestartState | None, warn: Callable[[str], None]) -> None:
        self._real_time = real_time
        self._restart, self._warn = restart, warn
        self._manager = ServiceManager()
        self._collect: SlackCollector | None = None

    def __enter__(self) -> ServiceHooks:
        # a watchdog ends the process with SIGABRT: then it says where it stood
        if sys.stderr is not None and not faulthandler.is_enabled():
            faulthandler.enable()
        self._collect = SlackCollector()
        for sentence in make_real_time(self._real_time):
            self._warn(sentence)
        return self

    def ticked(self, tick: Tick) -> None:
        """Do what falls due in the slack behind a tick."""
        self._manager.ticked(tick)
        if self._restart is not None:
            self._restart.ticked(tick)
        if self._collect is not None:
            self._collect()

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        if self._collect is not None:
            self._collect.close()
        self._manager.close()
        was_meant = error is None or isinstance(error, LinkError | InputError | RefusedError)
        if was_meant and self._restart is not None:
            self._restart.close()
        if not was_meant:
            self._warn(FAULT)
