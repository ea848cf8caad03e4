"""What a worker does: some runs of a study, compiled where that serves, in the full simulator where it does not."""

from __future__ import annotations

import contextlib
import functools
import math
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

from autopilot.control.registry import own_step
from autopilot.errors import InputError, RefusedError
from autopilot.vessel.file import dump_vessel, parse_vessel
from sitl.campaign.setting import measured_every, rooms_of, run_fully, setting_of
from sitl.campaign.study import BoatSection, Job, Study, case_and_seed, steps_of, vessel_of
from sitl.campaign.swift import Figures, figures, run_swiftly
from sitl.compiled import is_kept
from sitl.world import STEP

COMPILED, FULL, REFUSED = "compiled", "full", "refused"
UNKNOWN = Figures(*[math.nan] * len(Figures._fields))
BATCH_STEPS = 2_000_000
"""Steps in a batch: half a second of one core's work, so that handing it out costs nothing beside it."""


class Row(NamedTuple):
    """One run: its number and seed, what did it, and its figures, nan where the gains must not be engaged."""

    run: int
    seed: int
    done_by: str
    figures: Figures


@functools.cache
def swift(law: str) -> Callable[..., Any] | None:
    """Return the run compiled with a law's own step; None where numba is not installed."""
    from sitl.compiled import compiled

    try:
        return compiled(run_swiftly, quick=True, instead=own_step(law))
    except InputError:
        return None


def warm(job: Job, is_compiled: bool) -> None:
    """Load what a worker needs by one run whose row is thrown away, and have it compiled where that was never done.

    What a process compiled itself differs in the last digit from what the others load from disk, and cannot be
    exchanged in it. So it is compiled in a process of its own, and loaded by all.
    """
    if not is_compiled:
        return
    for law in job.study.laws:
        quick, own = swift(law), job._replace(study=replace(job.study, laws=(law,)))
        if quick is not None and not is_kept(quick):
            boat = dump_vessel(vessel_of(own, case_and_seed(own, 0)[0]))
            subprocess.run([sys.executable, "-m", __name__, law], input=boat, text=True, check=False)
        load(own)


def load(job: Job) -> None:
    """Make one run by the compiled loop, which compiles it where it is not on disk."""
    with contextlib.suppress(RefusedError):
        done_swiftly(job, 0)


def do_runs(job: Job, first: int, last: int, is_compiled: bool = True) -> list[Row]:
    """Return the rows of the runs from `first` to before `last`. A run depends on its study and number alone."""
    return [_done(job, run, is_compiled) for run in range(first, last)]


def _done(job: Job, run: int, is_compiled: bool) -> Row:
    seed = case_and_seed(job, run)[1]
    try:
        found = done_swiftly(job, run) if is_compiled else None
        if found is not None:
            return Row(run, seed, COMPILED, found)
        return Row(run, seed, FULL, run_fully(job, run))
    except RefusedError:
        return Row(run, seed, REFUSED, UNKNOWN)


def done_swiftly(job: Job, run: int) -> Figures | None:
    """Return the figures of a run by the compiled loop; None where there is none, or the run is none for it."""
    quick = swift(case_and_seed(job, run)[0].law)
    setting = setting_of(job, run) if quick is not None else None
    if quick is None or setting is None:
        return None
    score, is_whole = quick(setting, rooms_of(setting))
    if not is_whole:
        return None
    return figures(score, measured_every(job.study) * STEP, 1.0)


def batches_of(job: Job, runs: int) -> list[tuple[int, int]]:
    """Return the runs in batches, from and to before."""
    size = max(1, BATCH_STEPS // max(steps_of(job.study, STEP), 1))
    return [(first, min(first + size, runs)) for first in range(0, runs, size)]


if __name__ == "__main__":
    # every study of a law has the same types, whatever it sails
    short = Study(1, "short", {"boat": BoatSection("lanxin")}, laws=(sys.argv[1],), seconds=3.0, measured_from_s=1.0)
    load(Job(short, ".", parse_vessel(sys.stdin.read())))
