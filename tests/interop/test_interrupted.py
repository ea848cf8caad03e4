"""Ctrl-C and termination at any moment of any command: one line, the documented exit code, never a trace.

`NORRBIN_SLOW=1` tries every command every 0.05 s.
"""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from boat_recordings import zigzag_boat
from two_processes import free_port

pytestmark = pytest.mark.real_time

SLOW = os.environ.get("NORRBIN_SLOW") == "1"
MOMENTS = [0.05 * step for step in range(41)] if SLOW else [0.0, 0.1, 0.2, 0.35, 0.6, 1.0, 1.6]
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
        running = [(moment, start(command, tmp_path)) for moment in MOMENTS[at : at + TOGETHER]]
        began = time.monotonic()
        for moment, process in running:
            time.sleep(max(0.0, began + moment - time.monotonic()))
            process.send_signal(number)
        for moment, process in running:
            try:
                said, complained = process.communicate(timeout=40)
            except subprocess.TimeoutExpired:
                process.kill()
                said, complained = process.communicate()
                complained += "\nstill running after 40 s"
            where = f"{name} after {moment:.2f} s: exit {process.returncode}\n{said}{complained}"
            if process.returncode == -number:
                continue  # the interpreter had not come to its own handlers yet
            if "Traceback" in complained and not re.search(r"/(autopilot|sitl)/|ended by", complained):
                continue  # the interpreter's own start: it has not come to this program yet
            assert "Traceback" not in said + complained, where
            done = not command.stays and process.returncode in (0, 4)
            assert done or process.returncode == (0 if command.stays else 128 + number), where
            assert done or LAST_LINE[number] in said + complained, where


def start(command: Command, folder: Path) -> subprocess.Popen[str]:
    program, *words = command.line(folder)
    return subprocess.Popen(
        [sys.executable, "-m", program, *words],
        cwd=folder,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
