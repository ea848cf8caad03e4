"""What reaches a terminal is printable and short, whoever wrote it: the one place for it, and the commands."""

from __future__ import annotations

import io
import json
import math
import os
import sys
import termios
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.cli.log import as_text
from autopilot.cli.log import measures_as_text as measures_text
from autopilot.cli.main import main
from autopilot.cli.params_reading import difference_table
from autopilot.cli.steering import StatusLine
from autopilot.files.printable import PrintableStream, fixed, folded, printable, rewrite_line
from autopilot.firmware.download import Difference
from autopilot.identification.trial_measures import Circle, Measures, PullOut, Spiral, Zigzag
from autopilot.logs.reading import LogInfo, SeriesInfo
from autopilot.signals import AlarmEvent, Mode, NavState, Order, Reference, RudderCommand, Tick
from autopilot.supervision.alarms import OVERRIDDEN

HOSTILE = "\x1b[31m\x1b]0;owned\x07\x9b2J\u202egnp.exe\u2066\x00\r\n\x08\ud800\ufeff"
any_text = st.text(st.characters(exclude_categories=()), max_size=300)


@given(any_text, st.integers(0, 300))
def test_any_text_comes_out_on_one_short_printable_line(text: str, most: int) -> None:
    shown = printable(text, most)
    assert shown.isprintable() and len(shown) <= 10 * most + 40
    if text.isprintable() and len(text) <= most:
        assert shown == text


@given(st.lists(any_text), st.sampled_from(["utf-8", "ascii", "latin-1", "cp437"]))
def test_a_stream_for_people_takes_any_text(parts: list[str], encoding: str) -> None:
    bottom = io.BytesIO()
    stream = PrintableStream(io.TextIOWrapper(bottom, encoding, write_through=True))
    for part in parts:
        assert stream.write(part) == len(part)
    shown = bottom.getvalue().decode(encoding)
    assert shown.replace("\n", "").replace("\t", "").isprintable()
    assert shown.count("\n") == "".join(parts).count("\n")


@given(st.lists(st.text("abc-", min_size=1, max_size=12), min_size=1, max_size=60), st.integers(40, 120))
def test_on_a_terminal_words_stay_whole_and_all_are_there(words: list[str], width: int) -> None:
    master, slave = os.openpty()
    try:
        termios.tcsetwinsize(slave, (24, width))
        with open(slave, "w", closefd=False) as terminal:
            prose = " ".join(words)
            for said in (prose, f"   {prose}"):
                PrintableStream(terminal).write(f"{said}\n")
                terminal.flush()
                lines = os.read(master, 4096).decode().splitlines()
                assert " ".join(lines).split() == said.split()
                assert all(len(line) <= width for line in lines)
                indents = {len(line) - len(line.lstrip()) for line in lines}
                assert indents == {len(said) - len(said.lstrip())}
    finally:
        os.close(master)
        os.close(slave)


@pytest.mark.parametrize(
    "line", ["K  0.6805  0.0078 and on", f"{' ' * 30}head", '  "words": "of JSON",', "autopilot run a.yaml --link b"]
)
def test_tables_json_and_commands_to_copy_are_not_broken(line: str) -> None:
    assert folded(line, 20) == line
    assert folded("prose: --level chooses among nine", 20) == "prose: --level\nchooses among nine"


def test_of_several_lines_none_leaves_what_stood_there(capsys: pytest.CaptureFixture[str]) -> None:
    rewrite_line(sys.stdout, "short\nlonger", "\n")
    assert capsys.readouterr().out == "\rshort\033[K\nlonger\033[K\n"


@given(
    st.floats(-1e308, 1e308) | st.sampled_from([math.nan, math.inf, -math.inf]),
    st.integers(0, 3),
    st.sampled_from(["", "+"]),
)
def test_any_number_is_printed_in_at_most_fifteen_characters(value: float, places: int, sign: str) -> None:
    shown = fixed(value, places, sign)
    assert len(shown) <= 15
    assert math.isnan(value) or float(shown) == pytest.approx(value, rel=0.006, abs=0.6)


anything = st.floats(allow_nan=False)


@given(anything, anything, anything)
def test_numbers_of_a_log_and_of_its_measures_are_short(a: float, b: float, c: float) -> None:
    """Whatever a reader has let pass; what goes to the measures is nan or not."""
    series = SeriesInfo("heading_rad", "table", 10, a, b, c, 3, a, b, c)
    shown = as_text(LogInfo("x.csv", "CSV table", a, b, (series,), {}, c, 2, "", ()))
    assert max(map(len, shown.splitlines())) < 180
    zigzag = Zigzag(a, b, c, a, b, (c, a), (b, c), (a, b), c, math.nan, b)
    circle = Circle(a, b, c, a, b, c, a, b, c, a, b, c, a)
    measures = Measures((zigzag,), (circle,), (PullOut(a, b, c, a, b),), Spiral(a, ((b, c),), ((b, a),), b, c), "x")
    for length in (None, 10.0):
        assert max(map(len, measures_text("x.csv", measures, length).splitlines())) < 180


def is_plain(text: str) -> bool:
    return text.replace("\n", "").isprintable()


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("boat.yaml", '"\\e[31mred\\u202e": 1\n'),
        ("boat.yaml", "schema_version: 2\nname: [\x1b[31m]\n"),
        ("boat.yaml", 'schema_version: 2\nname: "\\e[2J"\nmodel: {K: "\\e]0;x\\a"}\n'),
        ("boat.param", "\x1b[31mNAME,1\n"),
        ("boat.parm", "NAME\x9b2J 1\n"),
        ("boat.yaml", "format: norrbin-firmware-parameters\nparams:\n  'A\x1b[31m': 1\n"),
        ("log.csv", "\x1b[31mtime,\u202erudder\n1,2\n"),
        ("log.csv", "\x1b[31m" * 20 + ("c," * 200000) + "\n1,2\n"),
        ("log.nmea", "$HCHDG,\x1b[31m,,,*00\r\n" * 5),
        ("log.tlog", "\x1b[31m" * 100),
    ],
)
@pytest.mark.parametrize("folder", ["plain", "f\x1b[31m\u202e\udcff"])
def test_no_file_reaches_the_terminal_raw(
    folder: str, name: str, content: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = tmp_path / folder
    place.mkdir()
    path = place / name
    path.write_text(content, encoding="utf-8", errors="surrogateescape")
    commands = [["log", "info"], ["identify"]] if name.startswith("log") else [["params", "check"], ["params", "show"]]
    for command in commands:
        code = main([*command, str(path)])
        shown = capsys.readouterr()
        assert is_plain(shown.out + shown.err) and len(shown.out + shown.err) < 6000
        assert code in (0, 2, 4) and (code == 0 or shown.err)


def test_names_and_words_of_a_vehicle_stay_in_their_line(capsys: pytest.CaptureFixture[str]) -> None:
    table = difference_table([Difference(HOSTILE, 1.0, 2.0)], "left\x1b[31m", "right")
    assert is_plain(table) and table.count("\n") == 3
    series = SeriesInfo("heading_rad", HOSTILE * 50, 2, 1.0, 0.0, 1.0, 0, 1.0, 0.0, 1.0)
    info = LogInfo(HOSTILE, "tlog", 1.0, None, (series,), {"heading_rad": HOSTILE}, 0.0, 0, HOSTILE, (HOSTILE,))
    text = as_text(info)
    assert is_plain(text) and max(map(len, text.splitlines())) < 1000
    assert json.loads(json.dumps(HOSTILE)) == HOSTILE
    state = NavState(0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, True)
    alarms = (AlarmEvent("human_override", HOSTILE, OVERRIDDEN),)
    tick = Tick(1, 0.0, (), Order(), state, Reference(0.0), 0.0, RudderCommand(0.0, 0.0, False), Mode.STANDBY, alarms)
    StatusLine().update(tick)
    shown = capsys.readouterr().out
    assert is_plain(shown) and shown.count("\n") == 1


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_our_own_control_characters_reach_the_terminal_and_no_others(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    stream = PrintableStream(terminal)
    rewrite_line(stream, f"heading {HOSTILE}")
    shown = terminal.getvalue()
    assert shown.startswith("\rheading \\x1b[31m") and shown.endswith("\x1b[K")
    assert shown.count("\x1b") == shown.count("\x1b[K") == 1 + shown.count("\n")
    monkeypatch.setattr(sys, "stdout", stream)
    StatusLine().end()
    assert terminal.getvalue().endswith("\r\x1b[K")


def test_a_vessel_by_a_name_that_no_encoding_has_is_one_sentence(capsys: pytest.CaptureFixture[str]) -> None:
    name = os.fsdecode(b"\xff\x1b[31m" + "é".encode())
    assert main(["params", "check", f"/nowhere/{name}.yaml"]) == 2
    assert is_plain(capsys.readouterr().err)
