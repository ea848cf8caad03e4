"""Runs on a ray cluster (extra `ray`): one that runs already, by its address, or one of processes here.

ray does the runs of a worker that is lost again.
"""

from __future__ import annotations

import itertools
import logging
from collections.abc import Iterator
from typing import Any

from autopilot.errors import InputError
from sitl.campaign.cases import Job
from sitl.campaign.engines import AHEAD, Batch, Engine
from sitl.campaign.work import Row, do_runs

RETRIES = 5


def ray_engine(address: str | None) -> Engine:
    """Return the engine. Raises InputError where ray is not installed, or nobody answers at the address."""
    try:
        import ray
    except ImportError as exc:
        raise InputError("--engine ray needs ray: pip install 'norrbin[ray]'") from exc

    def engine(job: Job, batches: list[Batch], workers: int, is_compiled: bool) -> Iterator[list[Row]]:
        _connect(ray, address, workers)
        try:
            yield from _done(ray, job, batches, workers, is_compiled)
        finally:
            ray.shutdown()

    return engine


def _connect(ray: Any, address: str | None, workers: int) -> None:
    if address is None:
        ray.init(num_cpus=workers, include_dashboard=False, logging_level=logging.ERROR, log_to_driver=False)
        return
    try:
        ray.init(address=address, logging_level=logging.ERROR, log_to_driver=False)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise InputError(f"--address {address}: no ray cluster answers there ({error})") from error


def _done(ray: Any, job: Job, batches: list[Batch], workers: int, is_compiled: bool) -> Iterator[list[Row]]:
    remote, shared, waiting = ray.remote(max_retries=RETRIES)(do_runs), ray.put(job), iter(batches)
    cores = max(workers, int(ray.cluster_resources().get("CPU", 1)))
    running = [remote.remote(shared, *batch, is_compiled) for batch in itertools.islice(waiting, AHEAD * cores)]
    while running:
        done, running = ray.wait(running, num_returns=1)
        running += [remote.remote(shared, *batch, is_compiled) for batch in itertools.islice(waiting, len(done))]
        for reference in done:
            rows: list[Row] = ray.get(reference)
            yield rows
