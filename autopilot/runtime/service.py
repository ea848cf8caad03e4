"""What keeps a steering process well, beside the steering: the service manager, real time, garbage, and a restart.

What a service manager gets to know: ready, alive, why not well, leaving. Without one nothing is sent. The protocol is
sd_notify(3) of systemd: datagrams of VARIABLE=value lines to the socket named in NOTIFY_SOCKET. Signs of life come from
the tick and from no other place: when it hangs they stop, and after WatchdogSec the manager aborts the process and
starts another.

A steering process that died says to the next one what it was doing; that goes on only where the file allows. The note
lies where a reboot forgets it (/run), with the boot's id and the age by a clock that nobody sets.
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import math
import os
import socket
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from autopilot.errors import InputError, RefusedError
from autopilot.files.outside import read_regular
from autopilot.links.base import LinkError
from autopilot.runtime.machine import RealTime, SlackCollector, make_real_time
from autopilot.signals import Mode, OrderKind, Tick
from autopilot.supervision.panel import sentences_of

RENEWED_S = 1.0
LONGEST = 4096
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class Note(NamedTuple):
    """heading [rad] that was held, and `since` [s] on the monotonic clock of the boot `boot`."""

    heading: float
    since: float
    boot: str


class RestartState:
    """Keeps the note of what is steered, in the file `path`, and reads what another process has left there.

    Args:
        within: a note older than this [s] is forgotten; 0: any.
        save: writes a text to a file, later and from another thread.
        clock: the machine's monotonic clock [s].
    """

    def __init__(
        self,
        path: Path,
        within: float,
        save: Callable[[Path, str], None],
        clock: Callable[[], float] = time.monotonic,
        boot: str | None = None,
    ) -> None:
        self._path, self._within, self._save, self._clock = path, within, save, clock
        self._boot = _boot() if boot is None else boot
        self._next = -math.inf
        self._kept: float | None = None

    def left(self) -> float | None:
        """Return the heading [rad] that a process held which ended less than `within` ago without leaving the helm."""
        note = _read(self._path)
        if note is None or note.boot != self._boot:
            return None
        return note.heading if 0.0 <= self._clock() - note.since <= self._within else None

    def ticked(self, tick: Tick) -> None:
        """Renew the note while a heading is held; take it away when it no longer is."""
        holds = tick.mode is Mode.ENGAGED and tick.order.kind is OrderKind.HEADING
        now = self._clock()
        # a heading of nan means the present one
        ordered = tick.order.heading if math.isfinite(tick.order.heading) else tick.reference.heading
        heading = ordered if holds else None
        if heading == self._kept and (heading is None or now < self._next):
            return
        self._kept, self._next = heading, now + RENEWED_S
        self._save(self._path, "" if heading is None else json.dumps(Note(heading, now, self._boot)._asdict()))

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
        fields = json.loads(read_regular(path, LONGEST))
        note = Note(float(fields["heading"]), float(fields["since"]), str(fields["boot"]))
    except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
        return None
    return note if math.isfinite(note.heading) and math.isfinite(note.since) else None


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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._collect is not None:
            self._collect.close()
        self._manager.close()
        was_meant = error is None or isinstance(error, LinkError | InputError | RefusedError)
        if was_meant and self._restart is not None:
            self._restart.close()
        if not was_meant:
            self._warn(FAULT)
