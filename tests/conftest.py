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

REAL_TIME = Path(__file__).parent / "interop"


def pytest_configure(config: pytest.Config) -> None:
    """Let the second of two workers give way: the first is dealt the tests that live in real time, see below."""
    config.addinivalue_line("markers", "real_time: starts processes that keep to the wall clock")
    if os.environ.get("PYTEST_XDIST_WORKER", "gw0") != "gw0":
        with contextlib.suppress(OSError):
            os.nice(10)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Keep real-time tests to one worker, one after the other, and give each three tries.

    They start a simulator and a pilot as a user would. A machine that takes one of them away for some seconds makes the
    boat sail on unsteered, which says nothing about the pilot; a fault of ours fails three times. Reruns are printed.
    """
    for item in items:
        if REAL_TIME in item.path.parents or item.get_closest_marker("real_time"):
            item.add_marker(pytest.mark.xdist_group("real time"))
            item.add_marker(pytest.mark.flaky(reruns=2))
