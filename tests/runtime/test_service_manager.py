"""What systemd hears: ready at the first tick, life while ticks come, and nothing while one hangs."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from lockstep import Lockstep
from two_processes import free_port

from autopilot import tick
from autopilot.runtime.machine import RealTime, ServiceHooks, ServiceManager
from autopilot.signals import Tick
from autopilot.vessel.file import load_vessel

# threads and processes that keep to the wall clock
pytestmark = pytest.mark.real_time

VESSEL = load_vessel("lanxin")


class Manager:
    """The other end of NOTIFY_SOCKET."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(path))

    def environ(self, watchdog_s: float = 1.0) -> dict[str, str]:
        return {"NOTIFY_SOCKET": str(self.path), "WATCHDOG_USEC": str(int(watchdog_s * 1e6))}

    def heard(self, wait: float = 0.0) -> list[str]:
        """Return the lines that have come; wait so long for the first."""
        lines = []
        self.socket.settimeout(wait or 0.001)
        with contextlib.suppress(TimeoutError):
            while True:
                lines += self.socket.recv(4096).decode().split("\n")
                self.socket.settimeout(0.001)
        return lines

    def hears(self, line: str, within: float) -> bool:
        """Return whether `line` comes within this time [s]."""
        end = time.monotonic() + within
        while time.monotonic() < end:
            if line in self.heard(0.2):
                return True
        return False


@pytest.fixture
def manager(tmp_path: Path) -> Iterator[Manager]:
    listening = Manager(tmp_path / "notify")
    yield listening
    listening.socket.close()


class TickClock:
    def __init__(self, run: Lockstep) -> None:
        self._run = run

    def __call__(self) -> float:
        return self._run.now


def watched(run: Lockstep, manager: Manager, watchdog_s: float = 1.0) -> ServiceManager:
    return ServiceManager(manager.environ(watchdog_s), TickClock(run))


def test_ready_comes_with_the_first_tick_and_life_four_times_a_period(manager: Manager) -> None:
    run = Lockstep(VESSEL)
    ours = watched(run, manager)
    assert manager.heard() == []
    lines = []

    def listen(tick: Tick) -> bool:
        ours.ticked(tick)
        lines.extend(manager.heard())  # the system keeps ten of them for us, no more
        return False

    run.run(10.0, until=listen)
    ours.close()
    ours.close()
    lines += manager.heard(5.0)
    assert lines[0] == "READY=1"
    assert lines[1].startswith("STATUS=STANDBY")
    assert lines.count("READY=1") == 1
    assert 38 <= lines.count("WATCHDOG=1") <= 41
    assert lines[-1] == "STOPPING=1"


def test_mode_and_alarms_are_the_status(manager: Manager) -> None:
    run = Lockstep(VESSEL)
    ours = watched(run, manager)
    run.engage(90.0)
    lines = []
    while run.now < 12.0:
        run.run(0.5, until=lambda tick: bool(ours.ticked(tick)))
        lines += manager.heard()
    ours.close()
    statuses = [line for line in lines if line.startswith("STATUS=")]
    assert statuses[-1] == "STATUS=ENGAGED"
    assert any("not engaged" in status for status in statuses)


@pytest.mark.real_time
def test_a_hung_tick_stops_the_signs_of_life(manager: Manager, monkeypatch: pytest.MonkeyPatch) -> None:
    """The tick hangs in its law; the process, its other threads and its socket live on."""
    for name, value in manager.environ(0.2).items():
        monkeypatch.setenv(name, value)
    run = Lockstep(VESSEL)
    run.engage(90.0)
    assert run.run(20.0, until=run.engaged)
    law, hung, goes_on = tick.ask_law, threading.Event(), threading.Event()

    def hang(*arguments: object) -> float:
        if run.now > 30.0:
            hung.set()
            assert goes_on.wait(60.0)
        return law(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(tick, "ask_law", hang)

    def sail() -> None:
        with ServiceHooks(RealTime(), None, print) as hooks:
            run.run(60.0, until=lambda now: bool(hooks.ticked(now)))

    sailing = threading.Thread(target=sail)
    sailing.start()
    try:
        assert hung.wait(60.0)
        assert "WATCHDOG=1" in manager.heard(5.0)
        assert "WATCHDOG=1" not in manager.heard(1.0)  # five periods
        goes_on.set()
        assert manager.hears("WATCHDOG=1", 30.0)
    finally:
        goes_on.set()
        sailing.join(60.0)


@pytest.mark.parametrize(
    "environ",
    [
        {},
        {"NOTIFY_SOCKET": ""},
        {"NOTIFY_SOCKET": "vsock:2:3"},
        {"NOTIFY_SOCKET": "/nowhere/at/all", "WATCHDOG_USEC": "x"},
        {"NOTIFY_SOCKET": "/nowhere/at/all", "WATCHDOG_USEC": "9" * 5000},
        {"NOTIFY_SOCKET": "@" + "a" * 300},
    ],
)
def test_no_manager_or_a_strange_one_is_no_trouble(environ: dict[str, str]) -> None:
    run = Lockstep(VESSEL)
    ours = ServiceManager(environ, lambda: 0.0)
    run.run(1.0, until=lambda tick: bool(ours.ticked(tick)))
    ours.close()


def test_the_watchdog_of_another_process_is_not_fed(manager: Manager) -> None:
    ours = ServiceManager({**manager.environ(), "WATCHDOG_PID": "1"}, lambda: 0.0)
    run = Lockstep(VESSEL)
    run.run(2.0, until=lambda tick: bool(ours.ticked(tick)))
    ours.close()
    lines = manager.heard(5.0)
    assert "READY=1" in lines
    assert "WATCHDOG=1" not in lines


def test_an_abstract_socket_is_found(tmp_path: Path) -> None:
    name = f"norrbin-{os.getpid()}-{tmp_path.name}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(f"\0{name}")
        listening.settimeout(5.0)
        ServiceManager({"NOTIFY_SOCKET": f"@{name}"}, lambda: 0.0).close()
        assert listening.recv(100) == b"STOPPING=1"


def restarting(manager: Manager, port: int) -> Callable[[], subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", "autopilot", "run", "lanxin", "--link", f"udpin:127.0.0.1:{port}", "--wait", "0"]
    environ = {**os.environ, **manager.environ(2.0)}
    return lambda: subprocess.Popen(command, env=environ, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)


@pytest.mark.real_time
def test_a_process_that_hangs_is_aborted_says_where_and_the_next_one_is_ready(manager: Manager) -> None:
    """What systemd does, step by step, with a process that stands still."""
    start = restarting(manager, free_port())
    first = start()
    try:
        assert manager.hears("READY=1", 60.0)
        assert manager.hears("WATCHDOG=1", 60.0)
        first.send_signal(signal.SIGSTOP)
        end = time.monotonic() + 60.0
        while Path(f"/proc/{first.pid}/stat").read_text().rpartition(")")[2].split()[0] != "T":
            assert time.monotonic() < end, "it does not stand still"
            time.sleep(0.01)
        manager.heard()
        assert "WATCHDOG=1" not in manager.heard(1.5)
    finally:
        first.send_signal(signal.SIGABRT)  # as WatchdogSignal= does
        first.send_signal(signal.SIGCONT)
    _, said = first.communicate(timeout=60.0)
    assert first.returncode == -signal.SIGABRT
    assert b"Fatal Python error: Aborted" in said
    assert b"autopilot/runtime/session.py" in said
    second = start()
    try:
        assert manager.hears("READY=1", 60.0)
    finally:
        second.terminate()
        second.communicate(timeout=60.0)
    assert second.returncode == 0
    assert manager.hears("STOPPING=1", 5.0)
