"""What reaches a terminal is printable and short, whoever wrote it: the one place for it, and the commands."""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import subprocess
import sys
import termios
from dataclasses import replace
from pathlib import Path

import pytest
from boat_recordings import dataflash, zigzag_boat
from hypothesis import given
from hypothesis import strategies as st

from autopilot.cli.log import as_text
from autopilot.cli.log import measures_as_text as measures_text
from autopilot.cli.main import main
from autopilot.cli.params_reading import difference_table
from autopilot.cli.steering import StatusLine
from autopilot.doctor import machine
from autopilot.files.printable import PrintableStream, aligned, fixed, folded, printable, rewrite_line
from autopilot.firmware.download import Difference
from autopilot.identification.trial_measures import Circle, Measures, PullOut, Spiral, Zigzag
from autopilot.logs.reading import LogInfo, SeriesInfo
from autopilot.signals import AlarmEvent, Mode, NavState, Order, Reference, RudderCommand, Tick
from autopilot.supervision.alarms import OVERRIDDEN
from autopilot.vessel.file import dump_vessel, load_vessel

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


def test_a_command_to_copy_stays_whole_and_the_words_before_it_are_broken() -> None:
    said = "it should move less: see autopilot gains boat.yaml --level 3; then run it again"
    assert folded(said, 40).splitlines() == [
        "it should move less: see",
        "autopilot gains boat.yaml --level 3;",
        "then run it again",
    ]


@pytest.mark.parametrize(
    "command",
    [
        ["install-service", "BOAT", "--link", f"serial:/dev/{'x' * 30}:115200", "--adapter", "abc=FT6A2B", "--dry-run"],
        ["params", "show", "BOAT"],
        ["params", "schema", "vessel"],
    ],
    ids=lambda command: command[0] + command[1],
)
def test_a_file_is_printed_on_a_terminal_as_it_would_be_written(command: list[str], tmp_path: Path) -> None:
    boat = tmp_path / "boat.yaml"
    boat.write_text(dump_vessel(replace(load_vessel("lanxin"), description="one word and another, " * 10)))
    words = [str(boat) if word == "BOAT" else word for word in command]
    master, slave = os.openpty()
    attributes = termios.tcgetattr(slave)
    attributes[1] &= ~termios.OPOST
    termios.tcsetattr(slave, termios.TCSANOW, attributes)
    termios.tcsetwinsize(slave, (24, 80))
    call = [sys.executable, "-m", "autopilot", *words]
    whole = subprocess.run(call, capture_output=True, check=True).stdout
    with subprocess.Popen(call, stdout=slave) as program:
        os.close(slave)
        shown = b""
        with contextlib.suppress(OSError):  # the end of a terminal
            while piece := os.read(master, 65536):
                shown += piece
    os.close(master)
    assert program.returncode == 0
    assert max(map(len, whole.splitlines())) > 80
    assert shown == whole


def test_a_key_and_what_it_does_stay_on_one_line() -> None:
    keys = ["e [DEG]: engage (present heading)", "r DEG: hold a rudder angle", "s: standby", "q: quit"]
    for width in (40, 60, 79):
        lines = folded("  ".join(keys), width, 0).splitlines()
        assert [key for line in lines for key in line.split("  ")] == keys
        assert max(map(len, lines)) <= width


WORDS = st.lists(st.text("abc.:-", min_size=1, max_size=9), min_size=1, max_size=12).map(" ".join)


@given(st.lists(st.tuples(WORDS, st.integers(0, 10**9).map(str), WORDS), min_size=1, max_size=6))
def test_a_table_fits_eighty_columns_and_holds_every_word_once(rows: list[tuple[str, str, str]]) -> None:
    lines = "\n".join(aligned(rows, right=(1,))).splitlines()
    assert max(map(len, lines)) <= 80
    assert sorted(" ".join(lines).split()) == sorted(" ".join(" ".join(row) for row in rows).split())


def test_what_people_read_at_the_dock_fits_eighty_columns(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As a terminal shows it: prose is folded there."""
    monkeypatch.chdir(tmp_path)
    log = Path("trial.BIN")
    log.write_bytes(dataflash(zigzag_boat(seconds=40.0)))
    monkeypatch.setattr(machine, "wake_up", lambda rate: None)
    for command in (
        ["log", "info", str(log)],
        ["identify", str(log), "--vessel", "lanxin"],
        ["identify", str(log), "--vessel", "lanxin", "--model", "auto"],
        ["identify", "--method", "list"],
        ["params", "show", "ardurover-boat"],
        ["params", "show", "px4-rover-boat"],
        ["gains", "naval_vessel"],
        ["doctor"],
    ):
        main(command)
        wide = [line for line in folded(capsys.readouterr().out, 80).splitlines() if len(line) > 80]
        assert wide == [], command


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
