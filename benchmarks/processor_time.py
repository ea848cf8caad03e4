"""A plugin of pytest that writes each test's processor time into its JUnit report: `-p processor_time`.

It imports nothing of the program: what is loaded before coverage begins looks as if no test had imported it.
"""

from __future__ import annotations

import time

import pytest

PROPERTY = "processor_s"
_BEGAN = pytest.StashKey[float]()


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Begin a test's processor time."""
    item.stash[_BEGAN] = time.process_time()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> None:
    """Write it down as a property of the test."""
    if call.when == "call":
        item.user_properties.append((PROPERTY, time.process_time() - item.stash[_BEGAN]))
