"""Whatever fails between opening the links and steering: every link is closed again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from autopilot.cli.main import main
from autopilot.links.base import Link, close_all
from autopilot.runtime import app


class Opened(Link):
    """A link that counts how often it was closed."""

    name = "opened"

    def __init__(self, fails: bool = False) -> None:
        self.closed = 0
        self._fails = fails

    def close(self) -> None:
        self.closed += 1
        if self._fails:
            raise OSError("pulled out")


def fails(*_: Any, **__: Any) -> Any:
    raise MemoryError("no room left")


def is_interrupted(*_: Any, **__: Any) -> Any:
    raise KeyboardInterrupt


WIRED = ("alarm_outputs_of", "GuideAlarms", "LoopHealth", "Session", "track_settings_of", "build_station_links")
PLACES = [
    *(
        "runtime.log_files.FileSink",
        "cli.steering.StatusLine",
        "runtime.record.Recorder",
        "runtime.tuning.TuningService",
    ),
    *("runtime.machine.SlackCollector", *(f"runtime.app.{name}" for name in WIRED)),
]


@pytest.mark.parametrize("how", [fails, is_interrupted])
@pytest.mark.parametrize("place", PLACES)
def test_what_fails_before_steering_closes_every_link(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, place: str, how: Any
) -> None:
    links = [Opened(), Opened()]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(app, "build_links", lambda *_: list(links))
    monkeypatch.setattr(f"autopilot.{place}", how)
    with pytest.raises(BaseException) as caught:
        served = ["--serve", "udpin:127.0.0.1:0", "--log", "run.tlog"]
        raise SystemExit(main(["run", "lanxin", "--link", "udpin:127.0.0.1:0", *served]))
    assert caught.type in (MemoryError, KeyboardInterrupt, SystemExit)
    assert [link.closed for link in links] == [1, 1]


def test_one_link_that_cannot_be_closed_keeps_no_other_open() -> None:
    links: list[Any] = [Opened(), Opened(fails=True), Opened()]
    with pytest.raises(OSError, match="pulled out"):
        close_all(links)
    assert [link.closed for link in links] == [1, 1, 1]
