"""Who does the runs: this process, a pool of processes here, or an engine of others over many machines.

An engine yields the rows of batches as they are done, in any order; `in_order` puts them in the order of the runs, so
that results are the same whoever did them, and however many.

Runs on a dask cluster (extra `dask`): one that runs already, by its scheduler's address, or one of processes here.

dask hands the runs of a worker that is lost to another one.
"""

from __future__ import annotations

import ctypes
import itertools
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from itertools import islice
from typing import Any, Protocol

from autopilot.errors import InputError
from sitl.campaign.study import Job
from sitl.campaign.work import Row, do_runs, warm

Batch = tuple[int, int]
MOST_LOSSES = 5
"""So many times in a row a batch may lose its worker before the study is given up."""
PR_SET_PDEATHSIG = 1
"""prctl(2)."""
AHEAD = 3
"""Batches that wait for each worker."""


def nobody() -> None:
    """Be told that the workers are ready, and do nothing."""


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
    context = multiprocessing.get_context("fork" if sys.platform == "linux" else None)
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=end_with_parent)
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


def end_with_parent() -> None:
    """Let this process of a pool end when the one that made it has ended, however that was (Linux)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)


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
