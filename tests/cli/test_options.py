"""Every option of `autopilot` and `sitl` that takes a number takes numbers in its range and refuses all else."""

from __future__ import annotations

import argparse
import math
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

from autopilot.cli.main import build_parser as autopilot_parser
from autopilot.cli.main import main as autopilot
from autopilot.cli.options import NumberOption
from autopilot.errors import InputError
from sitl.cli import build_parser as sitl_parser
from sitl.cli import main as sitl

PROGRAMS: dict[str, tuple[Callable[[], argparse.ArgumentParser], Callable[[list[str]], int]]] = {
    "autopilot": (autopilot_parser, autopilot),
    "sitl": (sitl_parser, sitl),
}
NO_NUMBERS = ("nan", "inf", "Infinity", "1e400", "9" * 5000, "1_0", "٣", "", "0x10", "x")
TOO_MUCH = ("1e300", "-1e300", "99999999999999999999")


class Option(NamedTuple):
    """An option of a command: the command's words, and what argparse makes of it."""

    words: tuple[str, ...]
    action: argparse.Action

    @property
    def name(self) -> str:
        """As it is written."""
        return self.action.option_strings[0] if self.action.option_strings else self.action.dest


def options_of(parser: argparse.ArgumentParser, words: tuple[str, ...]) -> Iterator[Option]:
    """Yield the options of a parser and of all commands below it."""
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield from options_of(below, (*words, name))
        else:
            yield Option(words, action)


OPTIONS = [option for program, (build, _) in PROGRAMS.items() for option in options_of(build(), (program,))]
NUMBERS = [option for option in OPTIONS if isinstance(option.action, NumberOption)]


def read(option: Option, text: str) -> float:
    """Return the number that the option makes of a text. Raises InputError."""
    found = argparse.Namespace()
    option.action(argparse.ArgumentParser(), found, text, option.name)
    value: float = getattr(found, option.action.dest)
    return value


def test_every_number_is_read_strictly() -> None:
    assert len(NUMBERS) > 100
    loose = [option for option in OPTIONS if option.action.type in (int, float)]
    loose += [
        option
        for option in OPTIONS
        if isinstance(option.action.default, int | float)
        and not isinstance(option.action.default, bool)
        and option not in NUMBERS
    ]
    assert loose == []


@pytest.mark.parametrize("option", NUMBERS, ids=lambda option: " ".join((*option.words, option.name)))
def test_an_option_takes_its_range_and_nothing_else(option: Option, capsys: pytest.CaptureFixture[str]) -> None:
    action = option.action
    assert isinstance(action, NumberOption)
    refused = [*NO_NUMBERS, " 1", "-nan", "-inf"]
    if math.isfinite(action.high):
        step = 1.0 if action.is_whole else 1.0e-6 * max(abs(action.low), abs(action.high))
        low, high = (str(action.low), str(action.high)) if action.is_whole else (repr(action.low), repr(action.high))
        assert (read(option, low), read(option, high)) == (action.low, action.high)
        refused += [*TOO_MUCH, f"{action.low - step:.0f}" if action.is_whole else repr(action.low - step)]
        refused += [f"{action.high + 1}" if action.is_whole else repr(action.high + step)]
        refused += ["1e-320", "1e-400", "0"] if action.low > 0.0 else []
        refused += ["1.5", "1e1"] if action.is_whole else []
        if action.default is not None:
            assert action.low <= action.default <= action.high
    for text in refused:
        with pytest.raises(InputError) as caught:
            read(option, text)
        said = str(caught.value)
        assert said.startswith(f"{option.name} ") and said.endswith(f": allowed is {action.allowed}")
        assert len(said) < 200
    # as the command says it, before all else
    program, *words = option.words
    assert PROGRAMS[program][1]([*words, f"{option.name}=nan"]) == 2
    assert capsys.readouterr().err.splitlines() == [f"{program}: {option.name} nan: allowed is {action.allowed}"]


RUN = "autopilot run lanxin --link udpin:127.0.0.1:0 --wait 0.1"
SERVE = "sitl serve lanxin --duration 0.1"


@pytest.mark.parametrize(
    "line",
    [
        f"{RUN} --cpu N",
        f"{RUN} --engage N",
        f"{RUN} --turn-rate-deg-s=N",
        f"{RUN} --turn-radius-m=N",
        f"{RUN} --serve udpout:127.0.0.1:N",
        f"{RUN} --forward udpin:127.0.0.1:N",
        "autopilot run lanxin --link udpin:127.0.0.1:N",
        "autopilot run lanxin --link serial:TMP/none:N --link-wait 0",
        "autopilot run lanxin --link nmea:TMP/none:N --link-wait 0",
        "autopilot run lanxin --link nmea:TMP/none:4800?send=HDT:N --link-wait 0",
        "autopilot trial turning lanxin --predict --rudder-deg=N",
        "autopilot trial turning lanxin --predict --rudder-deg=10,N",
        "autopilot trial zigzag lanxin --predict --rudder-deg=N",
        "autopilot trial spiral lanxin --predict --step-deg=N",
        "autopilot trial design lanxin --time 20 --water Nx100",
        "autopilot trial design lanxin --time 20 --water 100xN",
        "autopilot trial design lanxin --time 20 --water 100x100 --margin-m=N",
        "autopilot gains lanxin --bandwidth-rad-s=N",
        "autopilot log info TMP/none --servo N:1100:1500:1900",
        "autopilot log info TMP/none --servo 1:N:1500:1900",
        "autopilot log info TMP/none+TMP/other@N",
        "autopilot web --link udpin:127.0.0.1:0 --listen 127.0.0.1:N",
        "autopilot signalk --link udpin:127.0.0.1:0 --listen 127.0.0.1:N",
        f"{SERVE} --mavlink udpout:127.0.0.1:N",
        f"{SERVE} --nmea TMP/line:N",
        f"{SERVE} --nmea TMP/line:4800 --sentences HDG:N",
        f"{SERVE} --drive pypilot:TMP/line:N",
        f"{SERVE} --chaos loss=N",
        f"{SERVE} --control 127.0.0.1:N",
        "sitl ardupilot-physics lanxin --duration 0.1 --listen 127.0.0.1:N",
        "sitl fault rudder_stuck for=N --link-wait 0",
        "sitl fault rudder_stuck --control 127.0.0.1:N --link-wait 0",
    ],
)
def test_a_number_within_a_word_is_refused_in_one_sentence(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = [(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM)]
    program, *words = line.replace("TMP", str(tmp_path)).split(" ")
    for text in NO_NUMBERS:
        try:
            code = PROGRAMS[program][1]([word.replace("N", text) for word in words])
        finally:
            for number, handler in kept:
                signal.signal(number, handler)
        said = capsys.readouterr().err.splitlines()
        assert code in (2, 3) and len(said) == 1, (text[:20], code, said)
        assert said[0].startswith(f"{program}: ") and len(said[0]) < 1000


@pytest.mark.parametrize("text", ["33ft", "10,5", "10m"])
def test_a_unit_or_a_comma_is_not_answered_with_a_range_that_holds_the_number(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert PROGRAMS["autopilot"][1](["new-boat", "no-such-boat.yaml", f"--length-m={text}"]) == 2
    said = f"--length-m {text} is no bare number (a point, no comma; no unit behind it): allowed is 0.2 to 500\n"
    assert capsys.readouterr().err.endswith(said)
