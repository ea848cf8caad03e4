"""What keeps a steering process well, beside the steering: service manager, real time, garbage, resumption.

A steering process that died says to the next one what it was doing; that goes on only where the file allows.

The note lies where a reboot forgets it (/run), with the boot's id and the age by a clock that nobody sets.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import math
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import NamedTuple

from autopilot.cli.option_numbers import whole_number
from autopilot.errors import InputError, RefusedError
from autopilot.files.outside import read_regular
from autopilot.links.base import LinkError
from autopilot.runtime.machine import RealTime, ServiceManager, SlackCollector, cpus_of, make_real_time
from autopilot.signals import Mode, OrderKind, Tick
from autopilot.vessel.schema import Vessel

RENEWED_S = 1.0
LONGEST = 4096
BOOT_ID = Path("/proc/sys/kernel/random/boot_id")


class Note(NamedTuple):
    """heading [rad] that was held, and `since` [s] on the monotonic clock of the boot `boot`."""

    heading: float
    since: float
    boot: str


class Resumption:
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


PRIORITY = 40
"""Below the kernel's interrupt threads, which have 50."""
NOTE_NAME = "held-heading.json"
FAULT = "autopilot: the program failed; the rudder was given back. Keep the log and report what follows"


def add_upkeep_options(parser: argparse.ArgumentParser) -> None:
    """Add `--realtime`, `--cpu` and `--state`."""
    parser.add_argument(
        "--realtime",
        metavar="PRIORITY",
        nargs="?",
        action=whole_number(1, 99),
        const=PRIORITY,
        help=f"steer with real-time priority, 1 to 99 (without a number {PRIORITY}), and memory locked",
    )
    parser.add_argument("--cpu", metavar="N", help="keep to this core, or to these: 3 or 2,3")
    parser.add_argument(
        "--state",
        metavar="FILE",
        type=Path,
        help="record the steered heading there, for failsafe.reengage_after_restart_s (default: in $RUNTIME_DIRECTORY)",
    )


def real_time_of(arguments: argparse.Namespace) -> RealTime:
    """Return what the options ask for. Raises InputError."""
    return RealTime(arguments.realtime, () if arguments.cpu is None else cpus_of(arguments.cpu))


def resumption_of(
    arguments: argparse.Namespace, vessel: Vessel, save: Callable[[Path, str], None]
) -> Resumption | None:
    """Return who keeps note of what is steered; None where the vessel file or the place for it is missing."""
    folder = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    place = arguments.state or (Path(folder) / NOTE_NAME if folder else None)
    within = vessel.failsafe.reengage_after_restart_s
    return Resumption(place, within, save) if place is not None and within > 0.0 else None


class Upkeep:
    """Round the running session: enter it when all threads run, call it after every tick.

    An end that was meant, or that a link or a refusal brought, is no end to resume from; a fault of ours is one.
    """

    def __init__(self, wanted: RealTime, resumption: Resumption | None) -> None:
        self._wanted = wanted
        self._resumption = resumption
        self._manager = ServiceManager()
        self._collect: SlackCollector | None = None

    def __enter__(self) -> Upkeep:
        # a watchdog ends the process with SIGABRT: then it says where it stood
        if sys.stderr is not None and not faulthandler.is_enabled():
            faulthandler.enable()
        self._collect = SlackCollector()
        for sentence in make_real_time(self._wanted):
            print(sentence, file=sys.stderr)
        return self

    def ticked(self, tick: Tick) -> None:
        """Do what falls due in the slack behind a tick."""
        self._manager.ticked(tick)
        if self._resumption is not None:
            self._resumption.ticked(tick)
        if self._collect is not None:
            self._collect()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._collect is not None:
            self._collect.close()
        self._manager.close()
        was_meant = error is None or isinstance(error, LinkError | InputError | RefusedError)
        if was_meant and self._resumption is not None:
            self._resumption.close()
        if not was_meant:
            print(FAULT, file=sys.stderr)
