"""Runs on a ray cluster (extra `ray`): one that runs already, by its address, or one of processes here.

ray does the runs of a worker that is lost again.
"""

from __future__ import annotations

import itertools
import logging
import time
from collections.abc import Callable, Iterator
from typing import Any

from autopilot.errors import InputError
from sitl.campaign.engines import AHEAD, Batch, Engine, nobody
from sitl.campaign.study import Job
from sitl.campaign.work import Row, do_runs, warm

RETRIES = 5
TOGETHER_S = 60.0
"""So long a warm worker waits for the others to get warm, too: otherwise one of them would be asked twice."""


def ray_engine(address: str | None) -> Engine:
    """Return the engine. Raises InputError where ray is not installed, or nobody answers at the address."""
    try:
        import ray
    except ImportError as exc:
        raise InputError("--engine ray needs ray: pip install '.[ray]'") from exc

    def engine(
        job: Job, batches: list[Batch], workers: int, is_compiled: bool, ready: Callable[[], None] = nobody
    ) -> Iterator[list[Row]]:
        _connect(ray, address, workers)
        try:
            cores, shared = max(workers, int(ray.cluster_resources().get("CPU", 1))), ray.put(job)
            gate = ray.remote(num_cpus=0)(Gate).remote(cores)
            tasks = ray.remote(max_retries=RETRIES)(_warm_together)
            ray.get([tasks.remote(shared, is_compiled, gate) for _ in range(cores)])
            ready()
            yield from _done(ray, shared, batches, cores, is_compiled)
        finally:
            ray.shutdown()

    return engine


class Gate:
    """Counts those who have come; open once all have."""

    def __init__(self, expected: int) -> None:
        self._left = expected

    def come(self) -> None:
        """Be one of them."""
        self._left -= 1

    def is_open(self) -> bool:
        """Return whether all have come."""
        return self._left <= 0


def _warm_together(job: Job, is_compiled: bool, gate: Any) -> None:
    import ray

    warm(job, is_compiled)
    ray.get(gate.come.remote())
    until = time.monotonic() + TOGETHER_S
    while time.monotonic() < until and not ray.get(gate.is_open.remote()):
        time.sleep(0.05)


def _connect(ray: Any, address: str | None, workers: int) -> None:
    if address is None:
        ray.init(num_cpus=workers, include_dashboard=False, logging_level=logging.ERROR, log_to_driver=False)
        return
    try:
        ray.init(address=address, logging_level=logging.ERROR, log_to_driver=False)
    except (ConnectionError, RuntimeError, ValueError) as error:
        raise InputError(f"--address {address}: no ray cluster answers there ({error})") from error


def _done(ray: Any, shared: Any, batches: list[Batch], cores: int, is_compiled: bool) -> Iterator[list[Row]]:
    remote, waiting = ray.remote(max_retries=RETRIES)(do_runs), iter(batches)
    running = [remote.remote(shared, *batch, is_compiled) for batch in itertools.islice(waiting, AHEAD * cores)]
    while running:
        done, running = ray.wait(running, num_returns=1)
        running += [remote.remote(shared, *batch, is_compiled) for batch in itertools.islice(waiting, len(done))]
        for reference in done:
            rows: list[Row] = ray.get(reference)
            yield rows
