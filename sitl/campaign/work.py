"""What a worker does: some runs of a study, compiled where that serves, in the full simulator where it does not.

Who does the runs: this process, a pool of processes here, or an engine of others over many machines.
An engine yields the rows of batches as they are done, in any order; `in_order` puts them in the order of the runs, so
that results are the same whoever did them, and however many.

Runs on a dask cluster (extra `dask`): one that runs already, by its scheduler's address, or one of processes here.

dask hands the runs of a worker that is lost to another one.
"""

from __future__ import annotations

import contextlib
import ctypes
import functools
import itertools
import math
import multiprocessing
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from itertools import islice
from typing import Any, NamedTuple, Protocol

from autopilot.control.registry import own_step
from autopilot.errors import InputError, RefusedError
from autopilot.files.printable import rewrite_line
from autopilot.vessel.file import dump_vessel, parse_vessel
from sitl.campaign.compiled_run import Figures, figures, run_compiled
from sitl.campaign.setting import measured_every, run_reference, setting_of, workspace_of
from sitl.campaign.study import BoatSection, Job, Study, case_and_seed, steps_of, vessel_of
from sitl.compiled import compiled, is_kept
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
def compiled_loop(law: str) -> Callable[..., Any] | None:
    """Return the run compiled with a law's own step; None where numba is not installed."""
    try:
        return compiled(run_compiled, quick=True, instead=own_step(law))
    except InputError:
        return None


@functools.cache
def announce(law: str) -> None:
    """Say on standard error where a law's run is not on disk, so that it is compiled now: a minute without a word."""
    loop = compiled_loop(law)
    if loop is not None and not is_kept(loop):
        said = "compiling, which takes a minute or two; the next campaign finds it on disk"
        if sys.stderr.isatty():
            rewrite_line(sys.stderr, said, "\n")
        else:
            print(said, file=sys.stderr, flush=True)


def warm(job: Job, is_compiled: bool) -> None:
    """Load what a worker needs by one run whose row is thrown away, and have it compiled where that was never done.

    What a process compiled itself differs in the last digit from what the others load from disk, and cannot be
    exchanged in it. So it is compiled in a process of its own, and loaded by all.
    """
    if not is_compiled:
        return
    for law in job.study.laws:
        quick, own = compiled_loop(law), job._replace(study=replace(job.study, laws=(law,)))
        if quick is not None and not is_kept(quick):
            announce(law)
            boat = dump_vessel(vessel_of(own, case_and_seed(own, 0)[0]))
            compiler = [sys.executable, "-m", __name__, law]
            # in a group of its own Ctrl-C ends it through us, without a word
            subprocess.run(compiler, input=boat, text=True, check=False, process_group=0)
        load(own)


def load(job: Job) -> None:
    """Make one run by the compiled loop, which compiles it where it is not on disk."""
    with contextlib.suppress(RefusedError):
        done_compiled(job, 0)


def do_runs(job: Job, first: int, last: int, is_compiled: bool = True) -> list[Row]:
    """Return the rows of the runs from `first` to before `last`. A run depends on its study and number alone."""
    return [_done(job, run, is_compiled) for run in range(first, last)]


def _done(job: Job, run: int, is_compiled: bool) -> Row:
    seed = case_and_seed(job, run)[1]
    try:
        found = done_compiled(job, run) if is_compiled else None
        if found is not None:
            return Row(run, seed, COMPILED, found)
        return Row(run, seed, FULL, run_reference(job, run))
    except RefusedError:
        return Row(run, seed, REFUSED, UNKNOWN)


def done_compiled(job: Job, run: int) -> Figures | None:
    """Return the figures of a run by the compiled loop; None where there is none, or the run is none for it."""
    quick = compiled_loop(case_and_seed(job, run)[0].law)
    setting = setting_of(job, run) if quick is not None else None
    if quick is None or setting is None:
        return None
    score, is_whole = quick(setting, workspace_of(setting))
    if not is_whole:
        return None
    return figures(score, measured_every(job.study) * STEP, 1.0)


def batches_of(job: Job, runs: int) -> list[tuple[int, int]]:
    """Return the runs in batches, from and to before."""
    size = max(1, BATCH_STEPS // max(steps_of(job.study, STEP), 1))
    return [(first, min(first + size, runs)) for first in range(0, runs, size)]


Batch = tuple[int, int]
MOST_LOSSES = 5
"""So many times in a row a batch may lose its worker before the study is given up."""
PR_SET_PDEATHSIG = 1
"""prctl(2)."""
AHEAD = 3
"""Batches that wait for each worker."""


def nobody() -> None:
    """Take notice that the workers are ready, and do nothing."""


class Engine(Protocol):
    """Yields the rows of batches as they are done, by so many workers, compiled or not.

    `ready` is called when every worker has started and has loaded what it needs, before the first batch.
    """

    def __call__(
        self, job: Job, batches: list[Batch], workers: int, is_compiled: bool, ready: Callable[[], None] = nobody
    ) -> Iterator[list[Row]]: ...


def in_order(done: Iterable[list[Row]]) -> Iterator[list[Row]]:
    """Yield the batches by their runs; those that are early wait."""
    waiting: dict[int, list[Row]] = {}
    following = 0
    for rows in done:
        waiting[rows[0].run] = rows
        while following in waiting:
            ready = waiting.pop(following)
            following = ready[-1].run + 1
            yield ready


def local(
    job: Job, batches: list[Batch], workers: int, is_compiled: bool, ready: Callable[[], None] = nobody
) -> Iterator[list[Row]]:
    """Do the batches in `workers` processes of this machine; a batch whose process died is done again."""
    # compiled once, before there are many
    warm(job, is_compiled)
    ready()
    if workers == 1:
        for first, last in batches:
            yield do_runs(job, first, last, is_compiled)
        return
    left, losses = list(batches), 0
    while left:
        before = len(left)
        for rows in _pooled(job, list(left), workers, is_compiled):
            left.remove((rows[0].run, rows[-1].run + 1))
            yield rows
        losses = losses + 1 if len(left) == before else 0
        if losses > MOST_LOSSES:
            raise InputError(
                f"run {left[0][0]} or one after it ended its process {losses} times; is there memory enough? Try "
                "--workers 1"
            )


def _pooled(job: Job, batches: list[Batch], workers: int, is_compiled: bool) -> Iterator[list[Row]]:
    """Yield batches until all are done or a process has died."""
    pool = pool_of(workers)
    coming = iter(batches)

    def more(count: int) -> set[Future[list[Row]]]:
        return {pool.submit(do_runs, job, *batch, is_compiled) for batch in islice(coming, count)}

    try:
        running = more(AHEAD * workers)
        while running:
            done, running = wait(running, return_when=FIRST_COMPLETED)
            running |= more(len(done))
            for future in done:
                yield future.result()
    except BrokenProcessPool:
        return
    except BaseException:
        # nobody waits for what is no longer wanted: the processes end with this one
        pool.shutdown(wait=False, cancel_futures=True)
        raise
    pool.shutdown()


def pool_of(workers: int) -> ProcessPoolExecutor:
    """Return a pool of processes that end with this one."""
    context = multiprocessing.get_context("fork" if sys.platform == "linux" else None)
    return ProcessPoolExecutor(workers, mp_context=context, initializer=end_with_parent, initargs=(os.getpid(),))


def end_with_parent(parent: int) -> None:
    """Let this process of a pool end when the process `parent` that made it has ended, however that was (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
        # one that ended before sends no signal any more, and its work would be waited for for ever
        if os.getppid() != parent:
            os._exit(1)


def engine_of(name: str, address: str | None = None) -> Engine:
    """Return the engine `name`: local or dask. Raises InputError where it is not installed."""
    return local if name == "local" else dask_engine(address)


def default_workers() -> int:
    """Return the number of cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


RETRIES = 5
LEAN = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.memory.monitor-interval": "1s",
}
"""For workers of our own: nobody looks at their profiles, and a run needs little memory."""


def dask_engine(address: str | None) -> Engine:
    """Return the engine. Raises InputError where dask is not installed, or nobody answers at the address."""
    try:
        import dask
        import distributed
    except ImportError as exc:
        raise InputError("--engine dask needs dask: pip install '.[dask]'") from exc

    def engine(
        job: Job, batches: list[Batch], workers: int, is_compiled: bool, ready: Callable[[], None] = nobody
    ) -> Iterator[list[Row]]:
        with dask.config.set(LEAN), _client(distributed, address, workers) as client:
            shared = client.scatter(job, broadcast=True, hash=False)
            client.gather(
                [
                    client.submit(warm, shared, is_compiled, workers=[worker], pure=False, retries=RETRIES)
                    for worker in client.ncores()
                ]
            )
            ready()
            waiting = iter(batches)

            def more(count: int) -> list[Any]:
                return [
                    client.submit(do_runs, shared, *batch, is_compiled, pure=False, retries=RETRIES)
                    for batch in itertools.islice(waiting, count)
                ]

            running = distributed.as_completed(more(AHEAD * max(workers, len(client.ncores()))))
            for future in running:
                rows: list[Row] = future.result()
                future.release()
                for following in more(1):
                    running.add(following)
                yield rows

    return engine


def _client(distributed: Any, address: str | None, workers: int) -> Any:
    if address is None:
        return distributed.Client(n_workers=workers, threads_per_worker=1, dashboard_address=None)
    try:
        return distributed.Client(address, timeout=10.0)
    except (OSError, ValueError) as error:
        raise InputError(f"--address {address}: no dask scheduler answers there ({error})") from error


if __name__ == "__main__":
    # every study of a law has the same types, whatever it sails
    short = Study(1, "short", {"boat": BoatSection("lanxin")}, laws=(sys.argv[1],), seconds=3.0, measured_from_s=1.0)
    load(Job(short, ".", parse_vessel(sys.stdin.read())))
