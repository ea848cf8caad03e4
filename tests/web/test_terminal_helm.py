"""The helm in a terminal: what it shows at every size, what its keys order, and the real thing on a pseudo-terminal."""

from __future__ import annotations

import curses
import os
import pty
import select
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from alarm_texts import other
from hypothesis import given
from hypothesis import strategies as st
from monitored_boat import Watched, noted

from autopilot.cli.helm import ESCAPE, HelmKeys, draw, request_of
from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.links.mavlink.codec import MavlinkCodec, dialect
from autopilot.signals import AlarmEvent, AlarmSample
from autopilot.web.screen import screen
from autopilot.web.station import Station


class Window:
    """Looks like a curses window: plays keys at their times, keeps what was drawn last, knows its size."""

    def __init__(self, sea: Watched, keys: list[tuple[float, int]], size: tuple[int, int] = (24, 80)) -> None:
        self.sea, self.keys, self.size = sea, keys, size
        self.rows: list[str] = []
        self.drawn: list[list[str]] = []

    def nodelay(self, flag: bool) -> None: ...

    def keypad(self, flag: bool) -> None: ...

    def getmaxyx(self) -> tuple[int, int]:
        return self.size

    def getch(self) -> int:
        if self.keys and self.sea.now >= self.keys[0][0]:
            return self.keys.pop(0)[1]
        return -1

    def erase(self) -> None:
        self.rows = [""] * self.size[0]

    def addstr(self, row: int, column: int, text: str, look: int = 0) -> None:
        assert len(text) < self.size[1] and column == 0 and text.isprintable()
        self.rows[row] = text

    def refresh(self) -> None:
        self.drawn.append(self.rows)


class SailingLine:
    """The line of a boat that sails on whenever it is turned."""

    def __init__(self, sea: Watched) -> None:
        self.sea = sea

    @property
    def trouble(self) -> str:
        return self.sea.line.trouble

    def fileno(self) -> int:
        return -1

    def turn(self, now: float) -> int:
        self.sea.watch(0.05)
        return 0


def play(sea: Watched, presses: list[tuple[float, str | int]], monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Press keys so many seconds from now, then quit two seconds after the last; return every picture drawn."""
    for name in ("curs_set", "use_default_colors", "init_pair"):
        monkeypatch.setattr(curses, name, lambda *_: None)
    monkeypatch.setattr(curses, "color_pair", lambda number: number << 8)
    start = sea.now
    keys = [(start + at, key) for at, text in presses for key in ([text] if isinstance(text, int) else map(ord, text))]
    last = keys[-1][0] if keys else start
    window: Any = Window(sea, [*keys, (last + 2.0, ord("q"))])
    line: Any = SailingLine(sea)
    draw(window, sea.station, line, HelmKeys(sea.station), lambda: sea.now, waits=False)
    return ["\n".join(rows) for rows in window.drawn]


def test_keys_engage_turn_dodge_and_release(sea: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    pictures = play(
        sea,
        [(0.5, "e"), (2.0, curses.KEY_SRIGHT), (2.1, curses.KEY_RIGHT), (3.0, "D"), (5.0, "b"), (15.0, ESCAPE)],
        monkeypatch,
    )
    assert "STANDBY  you steer" in pictures[0]
    assert any("HEADING" in picture and "back to" in picture for picture in pictures)
    assert "STANDBY  you steer" in pictures[-1] and "release: done" in pictures[-1]
    before = next(picture for picture in reversed(pictures) if "HEADING" in picture)
    assert "order" in before and not sea.commands.armed
    assert sea.tick is not None
    assert abs(sea.ticks[-60].state.heading - sea.ticks[20].state.heading) == pytest.approx(0.192, abs=0.03)


def test_typed_lines_set_parameters_and_begin_trials(sea: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    pictures = play(
        sea,
        [(0.5, ":set gui_lookahead 15x"), (1.0, "\x7f\n"), (2.0, ":zigzag 10 10 40\n"), (9.0, ":cancel\n")],
        monkeypatch,
    )
    assert sea.store.running.guidance.lookahead_s == 15.0
    assert any("trial: 1" in picture for picture in pictures) and "trial: ended early" in pictures[-1]
    assert any(":set gui_loo" in picture for picture in pictures)


def test_an_alarm_is_shown_until_it_is_over_and_silence_as_silence(
    sea: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted(sea.pilot, AlarmSample(sea.now, other("gear hot: stop the engine"), "gear"))
    pictures = play(sea, [(2.0, "a")], monkeypatch)
    assert any("! WARNING gear hot: stop the engine" in picture for picture in pictures)
    assert "! gear hot" not in pictures[-1] and "gear hot" in pictures[-1]
    sea.links = []
    assert "NO DATA for" in play(sea, [(6.0, "x")], monkeypatch)[-1]


def test_the_first_alarm_is_acknowledged_alone_and_the_history_has_times(
    sea: Watched, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted(sea.pilot, AlarmSample(sea.now, AlarmEvent("motor_current"), "gear"))
    noted(sea.pilot, AlarmSample(sea.now, AlarmEvent("rudder_stuck"), "rudder"))
    pictures = play(sea, [(2.0, "A"), (4.0, "e"), (8.0, "l")], monkeypatch)
    first = next(picture for picture in pictures if "ALARM steering gear" in picture)
    assert first.index("ALARM steering gear") < first.index("WARNING the rudder motor")
    seen = [" ".join(picture.split()) for picture in pictures]
    assert any("! WARNING the rudder motor" in picture and "! ALARM" not in picture for picture in seen)
    assert "raised, acknowledged, cleared" in pictures[-1] and "terminal helm: hold the heading" in pictures[-1]
    assert "ALARM steering gear: rudder not responding" in pictures[-1]


def test_words_of_strangers_are_drawn_and_not_obeyed(sea: Watched, monkeypatch: pytest.MonkeyPatch) -> None:
    hostile = "\x1b[2J\x00\u202e\r\n\x07"
    boat: Any = sea.links[0]
    boat._transport.send(MavlinkCodec(1, 1).encode(dialect.MAVLink_statustext_message(3, hostile.encode())))
    sea.line.trouble = hostile
    monkeypatch.setattr(HelmKeys, "said", hostile, raising=False)
    assert play(sea, [(1.0, "a")], monkeypatch)


def test_who_only_looks_gives_no_orders(sea: Watched) -> None:
    keys = HelmKeys(sea.station, may=False)
    for key in (ord("e"), ord(":"), curses.KEY_LEFT, ESCAPE):
        keys.press(sea.now, key)
        sea.watch(0.5)
    assert not sea.commands.armed and "view only" in keys.said


@given(st.integers(1, 200), st.integers(1, 60), st.booleans(), st.text(max_size=300))
def test_the_picture_fits_every_terminal(picture_of: Station, width: int, height: int, may: bool, words: str) -> None:
    lines = screen(picture_of, 8.0, (width, height), "", words, may)
    assert len(lines) == height
    assert all(len(line.text) <= width for line in lines)
    if height > 2:
        assert lines[-1].text.strip()[:3] == ("1-9" if may else "vie")[:width][:3].strip() or width < 5


@pytest.fixture(scope="module")
def picture_of(tmp_path_factory: pytest.TempPathFactory) -> Station:
    sea = Watched(tmp_path_factory.mktemp("sea"))
    sea.watch(4.0)
    sea.order(do="zigzag", rudder=10, change=10, duration=30)
    sea.watch(4.0)
    return sea.station


@pytest.mark.parametrize(
    "line", ["", "h", "h north", "p", "p circle", "p wedge + 1", "set A", "zigzag 1 2", "adopt now"]
)
def test_lines_that_make_no_sense_are_refused_in_words(line: str) -> None:
    with pytest.raises(InputError):
        request_of(line)


def test_lines_mean_what_the_page_means() -> None:
    assert request_of("h 90") == {"do": "heading", "degrees": 90.0}
    assert request_of("p s - 40 60") == {"do": "pattern", "number": 5, "side": -1, "sizes": [40.0, 60.0]}
    assert request_of("turn -20 30") == {"do": "turning", "rudder": -20.0, "duration": 30.0}
    assert request_of("revert") == {"do": "revert"}


def test_without_a_terminal_it_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["helm", "--link", "udpin:127.0.0.1:0"]) == 2
    assert "needs a terminal" in capsys.readouterr().err


@pytest.mark.real_time
def test_it_draws_on_a_real_terminal_and_leaves_it_as_it_was(tmp_path: Path) -> None:
    ours, theirs = pty.openpty()
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "80", "LINES": "24"}
    command = [sys.executable, "-m", "autopilot", "helm", "--link", "udpin:127.0.0.1:0"]
    helm = subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment)
    os.close(theirs)
    try:
        heard = read_until(ours, b"NO BOAT YET")
        os.write(ours, b"q")
        heard += read_until(ours, b"\x1b[?1049l")
        assert b"Esc RELEASE" in heard
        assert helm.wait(60.0) == 0
    finally:
        helm.kill()
        helm.wait()
        os.close(ours)


def read_until(descriptor: int, wanted: bytes) -> bytes:
    heard, until = b"", time.monotonic() + 60.0
    while wanted not in heard:
        assert time.monotonic() < until, heard
        if select.select([descriptor], [], [], 0.5)[0]:
            heard += os.read(descriptor, 65536)
    return heard
