"""Ctrl-C and termination at any moment of any command: one line, the documented exit code, never a trace.

`NORRBIN_SLOW=1` tries every command every 0.05 s.
"""

from __future__ import annotations

import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import termios
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from boat_recordings import zigzag_boat
from two_processes import await_bound, free_port, patient_vessel

from autopilot.cli.steering import Ending
from autopilot.interruption import REAL_TIME, STRAY
from autopilot.runtime.app import Plan
from autopilot.runtime.record import read_log
from autopilot.signals import Order, OrderKind
from autopilot.vessel.file import dump_vessel, load_vessel

pytestmark = pytest.mark.real_time

ROOT = Path(__file__).parents[2]

SLOW = os.environ.get("NORRBIN_SLOW") == "1"
MOMENTS = [0.05 * step for step in range(41)] if SLOW else [0.05, 0.2, 0.5, 1.4]
"""Seconds from the start of the process to the signal."""
TOGETHER = 4
LAST_LINE = {signal.SIGINT: "ended by Ctrl-C", signal.SIGTERM: "ended by a termination signal"}


class Command(NamedTuple):
    """A command line, and whether it goes on until it is ended: then its end by a signal is no failure."""

    line: Callable[[Path], list[str]]
    stays: bool = True


def _recording(folder: Path) -> str:
    path = folder / "zigzag.csv"
    if not path.exists():
        boat = zigzag_boat(seconds=90.0, angle=0.26)
        rows = np.stack([boat.time, boat.rudder, boat.heading, boat.rate, boat.speed], axis=1)[::5]
        names = "time_s,rudder_rad,heading_rad,yaw_rate_rad_s,speed_m_s"
        np.savetxt(path, rows, delimiter=",", header=names, comments="", fmt="%.9g")
    return str(path)


def _study(folder: Path) -> str:
    path = folder / "study.yaml"
    path.write_text(
        "schema_version: 1\nname: mine\nboats: {lanxin: {vessel: lanxin}}\nseas: {calm: {}}\n"
        "runs: 400\nseconds: 600\nmeasured_from_s: 50\n"
    )
    return str(path)


def _udp() -> str:
    return f"udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)}"


COMMANDS = {
    "run": Command(lambda folder: ["autopilot", "run", "lanxin", "--link", _udp(), "--log", str(folder / "run.tlog")]),
    "run on a device to come": Command(
        lambda folder: ["autopilot", "run", "lanxin", "--link", f"nmea:{folder}/device:38400"]
    ),
    "trial": Command(lambda _: ["autopilot", "trial", "zigzag", "lanxin", "--link", _udp()]),
    "web": Command(lambda _: ["autopilot", "web", "--link", _udp(), "--listen", "127.0.0.1:0"]),
    "signalk": Command(lambda _: ["autopilot", "signalk", "--link", _udp(), "--listen", "127.0.0.1:0"]),
    "sitl serve": Command(lambda _: ["sitl", "serve", "lanxin", "--mavlink", "udpout:127.0.0.1:9"]),
    "sitl ardupilot-physics": Command(lambda _: ["sitl", "ardupilot-physics", "lanxin", "--listen", "127.0.0.1:0"]),
    "demo": Command(lambda folder: ["autopilot", "demo", "--no-report", "--out", str(folder / "demo")], False),
    "identify": Command(lambda folder: ["autopilot", "identify", _recording(folder), "--json"], False),
    "doctor": Command(lambda _: ["autopilot", "doctor", "lanxin", "--link", _udp()], False),
    "params backup": Command(lambda _: ["autopilot", "params", "backup", "--link", _udp()], False),
    "sitl campaign": Command(
        lambda folder: [
            *("sitl", "campaign", _study(folder), "--workers", "2", "--plain"),
            *("--out", str(folder / "runs.csv"), "--overwrite"),
        ],
        False,
    ),
}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["ctrl-c", "sigterm"])
@pytest.mark.parametrize("name", COMMANDS)
def test_a_command_ends_without_a_trace_at_any_moment(name: str, number: signal.Signals, tmp_path: Path) -> None:
    command = COMMANDS[name]
    for at in range(0, len(MOMENTS), TOGETHER):
        running = [
            (moment, start(command, folder)) for moment, folder in _folders(tmp_path, MOMENTS[at : at + TOGETHER])
        ]
        began = time.monotonic()
        for moment, process in running:
            time.sleep(max(0.0, began + moment - time.monotonic()))
            process.send_signal(number)
        for moment, process in running:
            try:
                said, complained = process.communicate(timeout=120)
            except subprocess.TimeoutExpired:
                process.kill()
                said, complained = process.communicate()
                complained += "\nstill running after 120 s"
            where = f"{name} after {moment:.2f} s: exit {process.returncode}\n{said}{complained}"
            if process.returncode == -number:
                continue  # the interpreter had not come to its own handlers yet
            begins = re.search(r"Traceback|Fatal Python error: init", complained)
            if begins and not re.search(r"/(autopilot|sitl)/|ended by", complained):
                continue  # the interpreter's own start: it has not come to this program yet
            assert "Traceback" not in said + complained, where
            done = not command.stays and process.returncode in (0, 4)
            assert done or process.returncode == (0 if command.stays else 128 + number), where
            assert done or LAST_LINE[number] in said + complained, where


def _folders(folder: Path, moments: list[float]) -> list[tuple[float, Path]]:
    """Return a folder for each moment: what runs at the same time writes no file that another one writes."""
    folders = [(moment, folder / f"{moment:.2f}") for moment in moments]
    for _, mine in folders:
        mine.mkdir()
    return folders


def start(command: Command, folder: Path, process_group: int | None = None) -> subprocess.Popen[str]:
    program, *words = command.line(folder)
    return subprocess.Popen(
        [sys.executable, "-m", program, *words],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        process_group=process_group,
    )


DROPPED = """
import os, signal, time
from autopilot.interruption import Interrupted, as_exceptions, take_signals
take_signals("sitl", "campaign")
os.register_at_fork(after_in_parent=lambda: os.kill(os.getpid(), signal.SIGTERM))
try:
    with as_exceptions():
        if os.fork() == 0:
            os._exit(0)
        time.sleep(20.0)
except Interrupted as signal:
    print("ended by", signal.number)
"""


def test_a_signal_within_a_callback_of_a_fork_is_not_lost() -> None:
    ended = subprocess.run([sys.executable, "-c", DROPPED], capture_output=True, text=True, check=True, timeout=60)
    assert (ended.stdout, ended.stderr) == (f"ended by {signal.SIGTERM:d}\n", "")


def test_the_page_ends_at_once_while_browsers_follow_the_boat(tmp_path: Path) -> None:
    page = start(COMMANDS["web"], tmp_path)
    assert page.stdout is not None
    address = [page.stdout.readline(), page.stdout.readline()][1].split()[-1]
    browsers = [urllib.request.urlopen(f"{address}api/events", timeout=60) for _ in range(3)]
    assert all(browser.readline() for browser in browsers)
    page.send_signal(signal.SIGTERM)
    _, complained = page.communicate(timeout=60)
    for browser in browsers:
        browser.close()
    assert (page.returncode, complained) == (0, "autopilot: ended by a termination signal\n")


def test_output_to_a_full_disk_leaves_the_steering_and_the_log_alone(tmp_path: Path) -> None:
    port = free_port(socket.SOCK_DGRAM)
    (tmp_path / "run.tlog").write_bytes(b"a sea trial")
    boat = start(Command(lambda _: ["sitl", "serve", "lanxin", "--mavlink", f"udpout:127.0.0.1:{port}"]), tmp_path)
    assert boat.stdout is not None and boat.stdout.readline().startswith("ready")
    with Path("/dev/full").open("wb") as full:
        link = f"udpin:127.0.0.1:{port}"
        command = ["run", str(patient_vessel(tmp_path)), "--link", link, "--as-gcs", "--engage", "30"]
        pilot = subprocess.run(
            [sys.executable, "-m", "autopilot", *command, "--duration", "8", "--log", "run.tlog"],
            cwd=tmp_path, stdin=subprocess.DEVNULL, stdout=full, stderr=full, timeout=60, check=False,
        )  # fmt: skip
    boat.terminate()
    boat.communicate(timeout=60)
    assert pilot.returncode == 0
    assert (tmp_path / "run.tlog").read_bytes() == b"a sea trial"
    ticks = read_log(tmp_path / "run-2.tlog").ticks
    assert ticks[-1].mode.name == "ENGAGED"
    assert ticks[-1].now > 7.0


@pytest.mark.parametrize("line", ["params show lanxin", "params schema vessel"])
def test_a_full_disk_under_what_is_printed_is_one_sentence(line: str, tmp_path: Path) -> None:
    with Path("/dev/full").open("wb") as full:
        done = subprocess.run(
            [sys.executable, "-m", "autopilot", *line.split()],
            cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60, check=False,
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (
        2,
        "autopilot: No space left on device; free the disk and start again\n",
    )


def test_a_python_that_is_too_old_is_one_sentence(tmp_path: Path) -> None:
    text = (ROOT / "autopilot" / "__init__.py").read_text(encoding="utf-8")
    assert re.search(r"^requires-python = \">=3\.11\"$", (ROOT / "pyproject.toml").read_text(), re.MULTILINE)
    old = "import sys; sys.version_info = (3, 10, 13, 'final', 0)\n"
    done = subprocess.run(
        [sys.executable, "-c", f"{old}exec({text!r})"], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 1
    assert re.fullmatch(r"Norrbin needs Python 3\.11 or newer; this is .* of version 3\.10\n", done.stderr), done.stderr


def test_a_closed_terminal_ends_a_run_in_good_order(tmp_path: Path) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup the end of a terminal is to end nothing
    try:
        pilot = start(COMMANDS["run"], tmp_path)
    finally:
        signal.signal(signal.SIGHUP, before)
    assert pilot.stdout is not None
    assert "STANDBY" in pilot.stdout.readline()
    pilot.send_signal(signal.SIGHUP)
    said, complained = pilot.communicate(timeout=60)
    assert (pilot.returncode, complained) == (0, "")
    assert said.startswith("ended by the terminal's end: rudder not held; nothing was steered; log ")


@pytest.mark.parametrize(
    ("number", "name"),
    [(each, each.name) for each in STRAY] + [(each, f"signal {each}") for each in (REAL_TIME[0], 51, REAL_TIME[-1])],
    ids=str,
)
def test_no_signal_that_can_be_taken_kills_a_pilot_with_the_rudder_held(number: int, name: str) -> None:
    before = signal.getsignal(number)
    ending = Ending(Plan(load_vessel("lanxin"), lambda *_: Order(OrderKind.STANDBY)), wait=0.0, must_engage=False)
    with ending.at_signals():
        os.kill(os.getpid(), number)
        time.sleep(0.01)
    assert (ending.stop, ending.why) == (True, f"ended by {name}")
    assert signal.getsignal(number) == before


def test_a_pilot_cannot_be_stopped_with_the_rudder_where_it_is(tmp_path: Path) -> None:
    pilot = start(COMMANDS["run"], tmp_path, process_group=0)  # as a shell starts it: Ctrl-Z stops such a group
    assert pilot.stdout is not None
    try:
        assert "STANDBY" in pilot.stdout.readline()
        for number in (signal.SIGTTIN, signal.SIGTTOU, signal.SIGTSTP):
            pilot.send_signal(number)
        said = pilot.stdout.readline()
        pilot.send_signal(signal.SIGQUIT)
        rest, complained = pilot.communicate(timeout=60)
    finally:
        pilot.kill()
    assert (pilot.returncode, complained) == (0, "")
    assert said.startswith("Ctrl-Z is not obeyed: a stopped pilot leaves the rudder where it is; ")
    assert "ended by Ctrl-\\: rudder not held; nothing was steered; log " in rest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["ctrl-c", "sigterm"])
def test_the_helm_in_a_terminal_gives_it_back(number: signal.Signals, tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    before = termios.tcgetattr(theirs)
    helm = subprocess.Popen(
        [sys.executable, "-m", "autopilot", "helm", "--link", _udp()],
        cwd=tmp_path, stdin=theirs, stdout=theirs, stderr=theirs, env={**os.environ, "TERM": "xterm"},
    )  # fmt: skip
    shown = b""
    while b"\x1b[?1049h" not in shown:
        shown += os.read(ours, 65536)
    time.sleep(0.5)
    helm.send_signal(number)
    assert helm.wait(60) == 0
    # a terminal hands out what was written in pieces
    while select.select([ours], [], [], 0.0)[0]:
        shown += os.read(ours, 65536)
    assert b"\x1b[?1049l" in shown
    assert b"Traceback" not in shown
    assert LAST_LINE[number].encode() in shown
    assert termios.tcgetattr(theirs) == before
    os.close(ours)
    os.close(theirs)


def test_who_leaves_the_list_of_a_new_boat_learns_where_it_goes_on(tmp_path: Path) -> None:
    """The step under way ends first, and lets its rudder go; then the list says where it was left."""
    file = tmp_path / "mine.yaml"
    file.write_text(dump_vessel(load_vessel("lanxin")))
    link = _udp()
    line = [sys.executable, "-m", "autopilot", "new-boat", str(file), "--link", link, "--yes"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with subprocess.Popen([*line], start_new_session=True, **pipes) as process:
        assert process.stdout is not None
        assert any(line.startswith("autopilot doctor ") for line in iter(process.stdout.readline, ""))
        await_bound(int(link.rpartition(":")[2]))  # the step has come to its link, and long before to its handlers
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does
        said, complained = process.communicate(timeout=120)
    assert process.returncode == 130, said + complained
    assert "Left before step 1 was done" in said and f"To carry on here: autopilot new-boat {file}" in said
    assert complained.count("ended by Ctrl-C") == 2 and "Traceback" not in complained
