"""The status line fits every terminal, what is typed stays whole, and no terminal can hold up the steering."""

from __future__ import annotations

import fcntl
import math
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from pathlib import Path
from unittest.mock import Mock

import pytest
from lockstep import Lockstep
from two_processes import PATIENCE_S, patient_vessel

from autopilot.angles import compass_text
from autopilot.cli.terminal import TYPED_MOST, Steady, TypedLines, course_text, line_of, status_text
from autopilot.errors import ExitCode
from autopilot.runtime.record import read_log
from autopilot.signals import Mode, Order, OrderKind, Tick
from autopilot.vessel.file import load_vessel


@pytest.fixture(scope="module")
def tick() -> Tick:
    run = Lockstep(load_vessel("lanxin"))
    run.engage(90.0)
    run.run(20.0)
    assert run.tick is not None
    return run.tick


@pytest.mark.parametrize("width", [1, 10, 20, 40, 60, 79, 80, 81, 104, 132, 300])
@pytest.mark.parametrize("typed", ["", "e 90", "x" * 100])
def test_the_line_leaves_the_last_column_free_and_keeps_what_is_typed(tick: Tick, width: int, typed: str) -> None:
    line = line_of(tick, False, "2/8 zigzag  133 s left  120 m off", typed, width)
    assert len(line) < max(width, 2)
    assert line.endswith(typed[-min(len(typed), 30, max(width - 1, 1)) :])


def test_what_must_be_there_is_there_in_eighty_columns(tick: Tick) -> None:
    text = status_text(tick, True, 79)
    assert re.search(r"^ENGAGED  course 090  heading 0[89]\d  rudder [+-]\d+\.\d measured  ", text), text
    assert "ordered" in status_text(tick, False, 79)
    wide = status_text(tick, False, 200, "1/2 circle")
    assert wide.startswith("1/2 circle  ENGAGED") and " kn" in wide and "bias" in wide and "deg/s" in wide
    assert status_text(tick, False, 55).count("  ") == 3
    sailed = status_text(tick._replace(order=Order(OrderKind.ZIGZAG)), True, 79, "2/8 zigzag  133 s left")
    assert "zigzag  133 s left" in sailed and "rudder" in sailed and "---" not in sailed


@pytest.mark.parametrize(("degrees", "shown"), [(359.96, "000"), (0.0, "000"), (359.4, "359"), (-0.2, "000")])
def test_a_heading_is_shown_as_on_a_compass(degrees: float, shown: str) -> None:
    assert compass_text(math.radians(degrees)) == shown


def test_without_a_course_there_are_dashes(tick: Tick) -> None:
    assert course_text(tick._replace(order=Order())) == "---"
    assert course_text(tick._replace(order=Order(OrderKind.RUDDER, rudder=0.1))) == "---"
    present = tick._replace(order=Order(OrderKind.HEADING, math.nan))
    assert course_text(present) == compass_text(tick.reference.heading)


def test_output_that_nobody_takes_keeps_nobody_waiting() -> None:
    reading, writing = os.pipe()
    output = Steady(writing)
    for _ in range(1000):
        assert output.write("x" * 1000) == 1000
    assert len(os.read(reading, 1 << 20)) >= 4096
    os.close(reading)
    output.write("nobody reads")
    os.close(writing)
    output.write("closed")
    full = os.open("/dev/full", os.O_WRONLY)
    Steady(full).write("x")
    os.close(full)


@pytest.mark.parametrize("may_be_opened", [True, False], ids=["its own", "somebody else's"])
@pytest.mark.parametrize("is_stopped", [True, False], ids=["stopped after the look", "full"])
def test_a_terminal_keeps_nobody_waiting_either(
    may_be_opened: bool, is_stopped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = pty.openpty()
    if not may_be_opened:
        monkeypatch.setattr(os, "ttyname", Mock(side_effect=PermissionError))
    output = Steady(theirs)
    if is_stopped:
        termios.tcflow(theirs, termios.TCOOFF)
    monkeypatch.setattr(select, "select", lambda readers, writers, others, timeout: (readers, writers, others))
    writing = threading.Thread(target=lambda: [output.write("x" * 1000) for _ in range(1000)], daemon=True)
    writing.start()
    writing.join(30.0)
    is_done = not writing.is_alive()
    os.close(ours)  # lets go of who waits
    assert is_done
    output.give_back()
    assert os.get_blocking(theirs), "the shell's as it was"
    os.close(theirs)


@pytest.mark.parametrize("may_be_opened", [True, False], ids=["its own", "somebody else's"])
def test_keys_that_another_program_takes_first_keep_nobody_waiting(
    may_be_opened: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    ours, theirs = pty.openpty()
    if not may_be_opened:
        monkeypatch.setattr(os, "ttyname", Mock(side_effect=PermissionError))
    with os.fdopen(theirs, closefd=False) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        typed, found = TypedLines(), list[list[str]]()
        monkeypatch.setattr(typed, "_is_ours", lambda: True)
        os.write(ours, b"+1")
        assert typed.poll() == [] and typed.text == "+1"
        with monkeypatch.context() as patch:
            patch.setattr(select, "select", lambda readers, writers, others, timeout: (readers, writers, others))
            asking = threading.Thread(target=lambda: found.append(typed.poll()), daemon=True)
            asking.start()
            asking.join(30.0)
        is_done = not asking.is_alive()
        os.write(ours, b"0\r")
        assert is_done
        assert typed.poll() == ["+10"], "and the next ones come"
        typed.close()
    os.close(ours)
    os.close(theirs)


def in_one_line(shown: str) -> str:
    """Return what is shown with its lines joined: sentences are broken between words."""
    return re.sub(r"(?:\x1b\[K)?\r\n *", " ", shown)


class AtTerminal:
    """`autopilot run` on a pseudo-terminal of its own, beside a simulated boat."""

    def __init__(self, folder: Path, columns: int, *options: str) -> None:
        line = folder / "boat"
        command = [sys.executable, "-m", "sitl", "serve", "lanxin", "--nmea", f"{line}:38400"]
        command += ["--sentences", "HDG:10,ROT:10,RSA:5,VHW:1"]
        self._boat = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        assert self._boat.stdout is not None
        assert self._boat.stdout.readline().startswith(b"ready"), "the pilot waits 10 s for its line, and no longer"
        self._ours, theirs = pty.openpty()
        fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", 24, columns, 0, 0))
        self.before = termios.tcgetattr(theirs)
        self._theirs = theirs
        self.pilot = subprocess.Popen(
            [
                *(sys.executable, "-m", "autopilot", "run", str(patient_vessel(folder))),
                *("--link", f"nmea:{line}:38400", *options),
            ],
            cwd=folder,
            stdin=theirs,
            stdout=theirs,
            stderr=theirs,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(theirs, termios.TIOCSCTTY, 0),
        )
        self.shown = ""

    def until(self, pattern: str, seconds: float = PATIENCE_S) -> str:
        """Read until the screen has shown `pattern`; return what came."""
        since, end = len(self.shown), time.monotonic() + seconds
        os.set_blocking(self._ours, False)
        while not re.search(pattern, in_one_line(self.shown[since:])):
            assert time.monotonic() < end, f"{pattern}\n{self.shown[-3000:]}"
            time.sleep(0.02)
            try:
                self.shown += os.read(self._ours, 65536).decode(errors="replace")
            except BlockingIOError:
                continue
            except OSError:  # the pilot has ended
                break
        return in_one_line(self.shown[since:])

    def type(self, text: str) -> None:
        """Press keys."""
        os.write(self._ours, text.encode())

    def lose_headings(self) -> None:
        """Stop the boat's instruments."""
        self._boat.send_signal(signal.SIGSTOP)

    def modes(self) -> list[object]:
        """Return the terminal's modes."""
        return termios.tcgetattr(self._theirs)

    def close(self) -> None:
        """End both."""
        for process in (self.pilot, self._boat):
            process.kill()
            process.communicate()
        os.close(self._ours)
        os.close(self._theirs)


@pytest.mark.real_time
def test_orders_typed_slowly_under_a_running_status_line(tmp_path: Path) -> None:
    at = AtTerminal(tmp_path, 80)
    try:
        at.until(r"STANDBY  course ---  heading \d\d\d")
        for key in "e 9x\x7f0":
            at.type(key)
            time.sleep(0.3)
        at.until(r"> e 90\x1b")
        at.type("\r")
        at.until("engaging")
        at.until(r"ENGAGED  course 090  heading \d\d\d  rudder [+-]\d+\.\d measured")
        at.type("+10\r")
        at.until(r"course 100")
        at.type("h\r")
        at.until(r"tack, gybe: (.|\s)*p zigzag")
        lines = [re.sub(r"\x1b\[K", "", line) for line in re.split(r"[\r\n]+", at.shown)]
        status = [line for line in lines if re.match(r"(STANDBY|ENGAGED)  ", line)]
        assert len(status) > 5
        assert max(map(len, status)) < 80
        at.type("\x03")
        last = at.until(r"no log\s+was kept")
        # how well it was steered is said of a course that was come to: not of a second
        assert re.search(r"ended by Ctrl-C: rudder released.*; steered \d+ s, last course 100", last, re.DOTALL)
        assert at.pilot.wait(60) == 0
        assert at.modes() == at.before
    finally:
        at.close()


@pytest.mark.real_time
def test_a_terminal_that_is_stopped_does_not_stop_the_steering(tmp_path: Path) -> None:
    log = tmp_path / "run.tlog"
    at = AtTerminal(tmp_path, 80, "--log", str(log))
    try:
        at.type("e 90\r")
        at.until("ENGAGED  course 090")
        at.type("\x13")  # Ctrl-S
        at.lose_headings()  # an alarm, which rings the bell
        end = time.monotonic() + PATIENCE_S
        while read_log(log).ticks[-1].mode is not Mode.FAILSAFE:
            assert time.monotonic() < end, "the screen that stands still holds up the steering"
            time.sleep(0.1)
        at.pilot.send_signal(signal.SIGTERM)
        assert at.pilot.wait(60) == ExitCode.FAILSAFE
    finally:
        at.close()


def test_a_key_that_is_held_fills_no_memory_and_the_line_can_still_be_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    with Path(os.devnull).open() as nothing, monkeypatch.context() as patch:
        patch.setattr(sys, "stdin", nothing)
        typed = TypedLines()
    keys = ["x" * 512] * 40 + ["\b\b\b\n"]
    monkeypatch.setattr(typed, "_is_ours", lambda: True)
    monkeypatch.setattr(typed, "_take_keys", lambda: None)
    monkeypatch.setattr(typed, "_keys", lambda: keys.pop(0))
    typed._input = 0
    for _ in range(40):
        assert typed.poll() == []
        assert len(typed.text) <= TYPED_MOST
    assert typed.poll() == ["x" * (TYPED_MOST - 3)]
