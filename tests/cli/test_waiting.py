"""A device that is about to appear and a program that is about to listen are waited for, and that is said."""

from __future__ import annotations

import os
import pty
import socket
import threading
import time
from pathlib import Path

import pytest

from autopilot.cli.options import Patience
from autopilot.links.base import LinkError, NotThereError, Transport
from autopilot.links.url import open_transport


def later(work: object, seconds: float = 0.5) -> threading.Timer:
    timer = threading.Timer(seconds, work)  # type: ignore[arg-type]
    timer.start()
    return timer


def test_a_device_that_appears_is_opened(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ours, theirs = pty.openpty()
    device = tmp_path / "boat"
    timer = later(lambda: device.symlink_to(os.ttyname(theirs)))
    transport: Transport = Patience(20.0)(lambda: open_transport(f"nmea:{device}:4800"))
    timer.join()
    transport.close()
    os.close(ours)
    os.close(theirs)
    said = capsys.readouterr().err
    assert said == f"nmea:{device}:4800: there is no device {device}: waiting up to 20 s for it (--link-wait)\n"


def test_a_program_that_begins_to_listen_is_connected_to(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    servers: list[socket.socket] = []
    timer = later(lambda: servers.append(socket.create_server(("127.0.0.1", port))))
    transport: Transport = Patience(20.0)(lambda: open_transport(f"tcp:127.0.0.1:{port}"))
    timer.join()
    transport.close()
    servers[0].close()
    assert "connection refused" in capsys.readouterr().err


def test_what_does_not_come_is_an_error_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(NotThereError, match=r"there is no device .*; plug it in"):
        Patience(0.3)(lambda: open_transport(f"nmea:{tmp_path}/boat:4800"))


@pytest.mark.parametrize("url", ["serial:/dev/null:4800", "carrier-pigeon:7"])
def test_what_waiting_does_not_cure_is_said_at_once(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    begun = time.monotonic()
    with pytest.raises(LinkError):
        Patience(30.0)(lambda: open_transport(url))
    assert time.monotonic() - begun < 20.0
    assert capsys.readouterr().err == ""
