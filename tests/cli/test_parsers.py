"""What is typed wrong is answered with what to type; the help has every option once; completions are valid."""

from __future__ import annotations

import argparse
import re
import shlex
import shutil
import subprocess

import pytest

from autopilot.cli.main import GROUPS, SUBCOMMANDS
from autopilot.cli.main import build_parser as autopilot_parser
from autopilot.cli.options import EXAMPLES, SHELLS, Parser, parsers_of, print_completion
from sitl.cli import build_parser as sitl_parser

PROGRAMS = {"autopilot": autopilot_parser, "sitl": sitl_parser}
ALL = [command for program in PROGRAMS.values() for command in parsers_of(program())]


@pytest.mark.parametrize(
    ("typed", "answer"),
    [
        ("autopilot rnu", "'rnu' is no command of `autopilot`; did you mean run?"),
        ("autopilot trial zigzg lanxin --link x", "'zigzg' is no command of `autopilot trial`; did you mean zigzag?"),
        ("autopilot params upload2", "'upload2' is no command of `autopilot params`; did you mean upload?"),
        ("autopilot run lanxin --lnk udpin:127.0.0.1:1", "--lnk is no option of `autopilot run`; did you mean --link?"),
        ("autopilot run lanxin --lnk=udpin:127.0.0.1:1", "--lnk is no option of `autopilot run`; did you mean --link?"),
        ("autopilot run lanxin --link x --enage 90", "--enage is no option of `autopilot run`; did you mean --engage?"),
        ("autopilot run lanxin --link x --law pdi", "'pdi' is no choice for --law; did you mean pid?"),
        ("autopilot run lanxin", "missing: --link"),
        ("autopilot gains lanxin --zzz", "--zzz is no option of `autopilot gains`"),
        ("autopilot gains lanxin boat.yaml", "'boat.yaml' is one word too many; it takes VESSEL.yaml"),
        ("autopilot run lanxin --link x -5", "-5 is no option of `autopilot run`"),
        ("sitl sreve", "'sreve' is no command of `sitl`; did you mean serve?"),
        ("sitl serve lanxin --mavlnk x", "--mavlnk is no option of `sitl serve`; did you mean --mavlink?"),
    ],
)
def test_a_mistake_is_answered_with_what_to_type(typed: str, answer: str, capsys: pytest.CaptureFixture[str]) -> None:
    program, *words = shlex.split(typed)
    with pytest.raises(SystemExit) as ended:
        PROGRAMS[program]().parse_args(words)
    assert ended.value.code == 2
    first, *others = capsys.readouterr().err.splitlines()
    assert first.endswith(f": {answer}")
    assert others[-1].startswith("Options and explanations: ") and others[-1].endswith(" --help")


def test_escape_sequences_that_are_typed_are_not_printed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        autopilot_parser().parse_args(["\x1b[31mrun"])
    assert "\x1b" not in capsys.readouterr().err


@pytest.mark.parametrize("parser", ALL, ids=lambda parser: parser.prog)
def test_help_shows_every_option_once_and_is_of_our_kind(parser: argparse.ArgumentParser) -> None:
    assert isinstance(parser, Parser)
    shown = parser.format_help()
    for action in parser._actions:
        if action.option_strings and action.help != argparse.SUPPRESS:
            lines = re.findall(rf"^  (?:-\w, )?{re.escape(action.option_strings[-1])}(?![\w-])", shown, re.MULTILINE)
            others = re.findall(rf"^  {re.escape(action.option_strings[0])}(?![\w-])", shown, re.MULTILINE)
            assert 1 in (len(lines), len(others)), action.option_strings
    assert shown.endswith("\n")


@pytest.mark.parametrize("parser", ALL, ids=lambda parser: parser.prog)
def test_help_fits_its_terminal(parser: argparse.ArgumentParser, monkeypatch: pytest.MonkeyPatch) -> None:
    for columns in (75, 80):
        monkeypatch.setenv("COLUMNS", str(columns))
        assert [line for line in parser.format_help().splitlines() if len(line) > columns] == []


@pytest.mark.parametrize("columns", ["", "0", "-1", "x", "60", "9" * 5000])
def test_the_help_comes_whatever_width_is_given(columns: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    assert "autopilot COMMAND" in autopilot_parser([]).format_help()


def test_every_command_of_the_program_stands_in_one_group_of_its_help() -> None:
    grouped = [name for names in GROUPS.values() for name in names]
    assert sorted(grouped) == sorted(SUBCOMMANDS)
    shown = autopilot_parser().format_help()
    assert all(re.search(rf"^  {name} +\S", shown, re.MULTILINE) for name in SUBCOMMANDS)


@pytest.mark.parametrize("named", EXAMPLES)
def test_every_example_is_one_that_its_command_takes(named: str) -> None:
    program, *words = shlex.split(EXAMPLES[named])
    assert EXAMPLES[named].startswith(named + " ")
    PROGRAMS[program]().parse_args(words)
    assert named in {parser.prog for parser in ALL}


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize("program", PROGRAMS)
def test_completion_is_a_script_that_the_shell_reads(
    program: str, shell: str, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("shtab")
    assert print_completion(PROGRAMS[program](), shell) == 0
    script = capsys.readouterr().out
    assert "--link" in script if program == "autopilot" else "--mavlink" in script
    if program == "autopilot" and shell != "bash":  # whose menus show no words beside a command
        assert (
            "compare two files, or a file with a vehicle" in script
            and "Exit code 6 when there is a difference" not in script
        )
    if shutil.which(shell) is not None:
        assert subprocess.run([shell, "-n"], input=script, text=True, check=False).returncode == 0
