"""A starter without a console may close the standard streams: the exit code stays, and no file becomes one of them."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from two_processes import free_port

ROOT = Path(__file__).parents[2]
CLOSINGS = (">&-", "2>&-", "<&- >&- 2>&-")


def started(closing: str, *words: str) -> subprocess.CompletedProcess[str]:
    """Start a program of ours by a shell that closes some of its standard streams."""
    return subprocess.run(
        ["bash", "-c", f'exec "$@" {closing}', "bash", sys.executable, *words],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        stdin=subprocess.DEVNULL,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )


@pytest.mark.parametrize("closing", CLOSINGS)
@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("autopilot params show lanxin", 0),
        ("autopilot params check nowhere.yaml", 2),
        ("autopilot run lanxin --link udpin:127.0.0.1:PORT --wait 0.3", 3),
        ("sitl fault --kinds", 0),
        ("sitl serve lanxin --mavlink udpout:127.0.0.1:PORT --duration 0.2", 0),
    ],
)
def test_a_command_ends_as_it_does_with_open_streams(words: str, code: int, closing: str) -> None:
    line = words.replace("PORT", str(free_port(socket.SOCK_DGRAM))).split(" ")
    done = started(closing, "-m", *line)
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr + done.stdout


@pytest.mark.parametrize("closing", CLOSINGS)
def test_no_file_that_is_opened_later_becomes_a_standard_stream(closing: str) -> None:
    script = (
        "import os, subprocess, sys; from autopilot.__main__ import start\n"
        "def run():\n"
        "    opened = os.open(os.devnull, os.O_RDONLY)\n"
        "    subprocess.run(['sh', '-c', ': <&0 >&1 2>&2'], check=True)\n"
        "    sys.stdin.read(); print('said'); print('complained', file=sys.stderr, flush=True)\n"
        "    return 40 + opened\n"
        "start('test', run)"
    )
    assert started(closing, "-c", script).returncode == 43


def test_that_orders_by_a_pipe_are_not_read_is_said() -> None:
    words = f"run lanxin --link udpin:127.0.0.1:{free_port(socket.SOCK_DGRAM)} --wait 0.3".split(" ")
    program = [sys.executable, "-m", "autopilot", *words]
    for given, is_said in ({"input": "+10\n"}, True), ({"stdin": subprocess.DEVNULL}, False):
        done = subprocess.run(program, capture_output=True, text=True, timeout=120, check=False, cwd=ROOT, **given)
        assert ("what comes by a pipe is not read" in done.stdout) is is_said, done.stdout
        assert done.returncode == 3
