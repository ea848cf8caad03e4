"""What all tests share: no clock in property tests, and how tests that live in real time get on with the others."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("norrbin", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("gate", settings.get_profile("norrbin"), derandomize=True)
settings.load_profile(os.environ.get("NORRBIN_HYPOTHESIS", "norrbin"))

# pymavlink's mavutil chooses its dialect as it is first imported: it has to be MAVLink 2 in whatever order the tests
# come. The product never imports mavutil, and does not look at this.
os.environ.setdefault("MAVLINK20", "1")
# as in the commands; more threads than cores, several workers' together, wait for each other by spinning
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

REAL_TIME = Path(__file__).parent / "interop"
REAL_TIME_GROUPS = 2


def pytest_configure(config: pytest.Config) -> None:
    """Name the marker."""
    config.addinivalue_line("markers", "real_time: starts processes that keep to the wall clock")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep real-time tests to two workers, on each one after the other, and give each three tries.

    They start a simulator and a pilot as a user would, and mostly sleep. A machine that takes one of them away for some
    seconds makes the boat sail on unsteered, which says nothing about the pilot; a fault of ours fails three times.
    Reruns are printed.
    """
    real_time = [item for item in items if _is_real_time(item)]
    for number, item in enumerate(real_time):
        item.add_marker(pytest.mark.xdist_group(f"real time {number % REAL_TIME_GROUPS}"))
        item.add_marker(pytest.mark.flaky(reruns=2))


def _is_real_time(item: pytest.Item) -> bool:
    return REAL_TIME in item.path.parents or item.get_closest_marker("real_time") is not None


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Let what only computes have what tests in real time leave, where several workers share the machine."""
    if "PYTEST_XDIST_WORKER" in os.environ and hasattr(os, "SCHED_IDLE"):
        with contextlib.suppress(OSError):
            policy = os.SCHED_OTHER if _is_real_time(item) else os.SCHED_IDLE
            os.sched_setscheduler(0, policy, os.sched_param(0))
