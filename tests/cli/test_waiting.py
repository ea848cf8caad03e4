"""A device that is about to appear and a program that is about to listen are waited for, and that is said."""

from __future__ import annotations

import os
import pty
import socket
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from autopilot.cli import options
from autopilot.cli.options import Patience
from autopilot.errors import InputError
from autopilot.links.base import LinkError, NotThereError, Transport
from autopilot.links.url import open_transport

Meanwhile = Callable[[Callable[[], object]], None]


@pytest.fixture
def meanwhile(monkeypatch: pytest.MonkeyPatch) -> Meanwhile:
    """Let something happen in the third pause of who waits."""
    pauses: list[float] = []

    def happen(work: Callable[[], object]) -> None:
        def pause(seconds: float) -> None:
            pauses.append(seconds)
            if len(pauses) == 3:
                work()

        monkeypatch.setattr(options, "time", SimpleNamespace(monotonic=time.monotonic, sleep=pause))

    return happen


def test_a_device_that_appears_is_opened(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], meanwhile: Meanwhile
) -> None:
    ours, theirs = pty.openpty()
    device = tmp_path / "boat"
    meanwhile(lambda: device.symlink_to(os.ttyname(theirs)))
    transport: Transport = Patience(20.0)(lambda: open_transport(f"nmea:{device}:4800"))
    transport.close()
    os.close(ours)
    os.close(theirs)
    said = capsys.readouterr().err
    assert said == f"nmea:{device}:4800: there is no device {device}: waiting up to 20 s for it (--link-wait)\n"


def test_a_program_that_begins_to_listen_is_connected_to(
    capsys: pytest.CaptureFixture[str], meanwhile: Meanwhile
) -> None:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        meanwhile(server.listen)
        transport: Transport = Patience(20.0)(lambda: open_transport(f"tcp:127.0.0.1:{server.getsockname()[1]}"))
        transport.close()
    assert "connection refused" in capsys.readouterr().err


def test_what_does_not_come_is_an_error_with_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(NotThereError, match=r"there is no device .*; plug it in"):
        Patience(0.3)(lambda: open_transport(f"nmea:{tmp_path}/boat:4800"))


@pytest.mark.parametrize("url", ["serial:/dev/null:4800", "carrier-pigeon:7"])
def test_what_waiting_does_not_cure_is_said_at_once(
    url: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    never = SimpleNamespace(monotonic=time.monotonic, sleep=lambda _: pytest.fail("it waits"))
    monkeypatch.setattr(options, "time", never)
    with pytest.raises((InputError, LinkError)):
        Patience(30.0)(lambda: open_transport(url))
    assert capsys.readouterr().err == ""
