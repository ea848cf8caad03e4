"""A steering process that died says to the next one what it was doing; that goes on only where the file allows.

The note lies where a reboot forgets it (/run), with the boot's id and the age by a clock that nobody sets.
"""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from autopilot.regular_file import read_regular
from autopilot.signals import Mode, OrderKind, Tick

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
