"""Runs on a dask cluster (extra `dask`): one that runs already, by its scheduler's address, or one of processes here.

dask hands the runs of a worker that is lost to another one.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

from autopilot.errors import InputError
from sitl.campaign.cases import Job
from sitl.campaign.engines import AHEAD, Batch, Engine, nobody
from sitl.campaign.work import Row, do_runs, warm

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
