"""What all tests share: no clock in property tests, and how tests that live in real time get on with the others."""

from __future__ import annotations

import ast
import contextlib
import gc
import os
import signal
import threading
import time
from functools import cache
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest
from hypothesis import HealthCheck, settings

settings.register_profile("norrbin", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("gate", settings.get_profile("norrbin"), derandomize=True, max_examples=50)
settings.load_profile(os.environ.get("NORRBIN_HYPOTHESIS", "norrbin"))

# pymavlink's mavutil chooses its dialect as it is first imported: it has to be MAVLink 2 in whatever order the tests
# come. The product never imports mavutil, and does not look at this.
os.environ.setdefault("MAVLINK20", "1")
# as in the commands; more threads than cores, several workers' together, wait for each other by spinning
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

NIGHTLY = Path(__file__).parent / "nightly.txt"
STALE = pytest.StashKey[list[str]]()
"""Tests that take seconds each and are like others that stay: the night runs them, `.ci/slow tests`."""
REAL_TIME = Path(__file__).parent / "interop"
REAL_TIME_SCOPE, REAL_TIME_GROUPS = "real time", 2


class MachineWatch:
    """Notices how long the machine leaves a sleeper asleep beyond its time on any core: the longest [s] since `begin`.

    A core of a virtual machine may stand still by itself, and take with it what was to run there.
    """

    def __init__(self) -> None:
        self.longest = 0.0
        self._runs = False

    def start(self) -> None:
        """Begin to watch, a thread for each core that may be used."""
        if not self._runs:
            self._runs = True
            cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else [None]
            for core in cores:
                threading.Thread(target=self._sleep, args=(core,), name=f"machine watch {core}", daemon=True).start()

    def _sleep(self, core: int | None) -> None:
        """Sleep for ever, a twentieth of a second at a time."""
        if core is not None:
            os.sched_setaffinity(threading.get_native_id(), {core})
        while True:
            before = time.monotonic()
            time.sleep(0.05)
            self.longest = max(self.longest, time.monotonic() - before - 0.05)

    def begin(self) -> None:
        """Forget what was."""
        self.longest = 0.0


WATCH = MachineWatch()


@pytest.fixture(scope="session", autouse=True)
def _own_state(tmp_path_factory: pytest.TempPathFactory) -> None:
    """No test meets a journal that a user's upload has left, nor leaves one to him."""
    os.environ["NORRBIN_STATE"] = str(tmp_path_factory.mktemp("norrbin-state"))


def pytest_configure(config: pytest.Config) -> None:
    """Name the marker; let what the tests start be ended.

    A shell's `&` and `nohup` leave signals ignored, and every child inherits that: a Ctrl-C that a test sends to a
    command would be none, and the command would stay for ever.
    """
    for number in (signal.SIGHUP, signal.SIGINT, signal.SIGQUIT):
        if signal.getsignal(number) is signal.SIG_IGN:
            # a handler is not inherited: this process goes on ignoring, what it starts does not
            signal.signal(number, lambda *_: None)
    config.addinivalue_line("markers", "real_time: starts processes that keep to the wall clock")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the night's tests out unless NORRBIN_SLOW is set, and keep which of them no whole file has any more."""
    nightly = set(NIGHTLY.read_text(encoding="utf-8").splitlines())
    whole = not config.option.keyword and not any("::" in str(each) for each in config.args)
    names = {f"tests/{_name(item)}" for item in items} if whole else nightly
    files = {name.partition("::")[0] for name in names}
    config.stash[STALE] = sorted(name for name in nightly - names if name.partition("::")[0] in files)
    if "NORRBIN_SLOW" not in os.environ:
        config.hook.pytest_deselected(items=[item for item in items if f"tests/{_name(item)}" in nightly])
        items[:] = [item for item in items if f"tests/{_name(item)}" not in nightly]


def pytest_collection_finish(session: pytest.Session) -> None:
    """Let the garbage collector leave alone what was collected: thousands of tests, which it would look at in each."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)


@pytest.fixture
def stale_nightly(request: pytest.FixtureRequest) -> list[str]:
    """The lines of nightly.txt that are no test of the files collected, where these were collected whole."""
    return request.config.stash[STALE]


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give real-time tests to two workers at most, one after the other, and what shares a costly fixture to one.

    Real-time tests start a simulator and a pilot as a user would, and mostly sleep. They come first: a worker that has
    begun to compute is idle for good where its user may not raise it again, and so would be what it starts.
    """
    if config.getoption("dist") != "loadgroup":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class ByKind(LoadScopeScheduling):
        def _assign_work_unit(self, node: Any) -> None:
            if not self.assigned_work.get(node):
                for scope in [each for each in self.workqueue if each.startswith(REAL_TIME_SCOPE)]:
                    self.workqueue.move_to_end(scope, last=False)
            super()._assign_work_unit(node)

        def _split_scope(self, nodeid: str) -> str:
            file, _, name = nodeid.partition("::")
            marked, shares = _kinds_in(config.rootpath / file)
            together = file if shares else nodeid
            is_real_time = marked is None or name.partition("[")[0] in marked
            if is_real_time and (config.getoption("numprocesses") or 0) > REAL_TIME_GROUPS:
                return f"{REAL_TIME_SCOPE} {crc32(together.encode()) % REAL_TIME_GROUPS}"
            return together

    return ByKind(config, log)


@cache
def _kinds_in(path: Path) -> tuple[frozenset[str] | None, bool]:
    """Return which functions of a file of tests are real-time (None: all), and whether it makes fixtures once."""
    text = path.read_text(encoding="utf-8")
    shares = 'scope="module"' in text
    if REAL_TIME in path.parents or "pytestmark = pytest.mark.real_time" in text:
        return None, shares
    functions = [node for node in ast.parse(text).body if isinstance(node, ast.FunctionDef)]
    marked = {each.name for each in functions if "pytest.mark.real_time" in map(ast.unparse, each.decorator_list)}
    return frozenset(marked), shares


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Any:
    """Say beside a real-time test that failed for how long the machine stood still meanwhile."""
    report = yield
    if report.failed and _is_real_time(item):
        report.sections.append(("machine", f"a sleeper was woken up to {WATCH.longest:.2f} s too late"))
    return report


@cache
def _place(path: Path) -> str:
    return path.relative_to(NIGHTLY.parent).as_posix()


def _name(item: pytest.Item) -> str:
    return _place(item.path) + item.nodeid[item.nodeid.index("::") :]


def _is_real_time(item: pytest.Item) -> bool:
    return REAL_TIME in item.path.parents or item.get_closest_marker("real_time") is not None


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Let what only computes have what tests in real time leave, where several workers share the machine."""
    shares, is_root = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "0")), os.geteuid() == 0
    # nobody but root raises itself again, and two workers have tests of both kinds
    if shares and (is_root or shares > REAL_TIME_GROUPS) and hasattr(os, "SCHED_IDLE"):
        with contextlib.suppress(OSError):
            policy = os.SCHED_OTHER if _is_real_time(item) else os.SCHED_IDLE
            os.sched_setscheduler(0, policy, os.sched_param(0))
    if _is_real_time(item):
        WATCH.start()  # a thread inherits how its maker is scheduled: not one that only computes
        WATCH.begin()
