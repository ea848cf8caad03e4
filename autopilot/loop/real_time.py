"""What the machine can do for a loop that must not be late: priority, memory that stays, a core, quiet collections.

Each is asked for, none is needed: what cannot be had is one sentence with the way to get it.
"""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import threading
from collections.abc import Callable, Sequence
from typing import NamedTuple

from autopilot.errors import InputError

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
        refused.append(_keep_to(wanted.cpus))
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


def _keep_to(cpus: Sequence[int]) -> str:
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
        """Collect where there is enough to collect."""
        if gc.get_count()[0] >= YOUNG:
            self._young += 1
            self._collect(2 if self._young % OLD_EVERY == 0 else 1)

    def close(self) -> None:
        """Leave the collector as it was found."""
        gc.set_threshold(*self._before)
        gc.unfreeze()
