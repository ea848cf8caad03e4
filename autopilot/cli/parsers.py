"""The parser of both programs: help in groups with an example, and mistakes answered in one sentence.

A command that is not there, an option that is not there and a choice that is not there are answered with what they come
nearest to; something left out, with an example that works.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NoReturn

from autopilot.errors import ExitCode, InputError
from autopilot.files.printable import brief, escaped

EXAMPLES = {
    "autopilot new-boat": "autopilot new-boat my-boat.yaml --link udpin:127.0.0.1:14550 --as-gcs",
    "autopilot run": "autopilot run my-boat.yaml --link udpin:127.0.0.1:14550 --as-gcs --engage 90 --log run.tlog",
    "autopilot trial": "autopilot trial zigzag my-boat.yaml --link udpin:127.0.0.1:14550 --as-gcs --log zigzag.tlog",
    "autopilot identify": "autopilot identify zigzag.tlog --out my-boat.yaml",
    "autopilot identify-dp": "autopilot identify-dp trials.csv --ship ship.yaml",
    "autopilot log info": "autopilot log info run.tlog",
    "autopilot log csv": "autopilot log csv run.tlog --out run.csv",
    "autopilot log measures": "autopilot log measures zigzag.tlog",
    "autopilot gains": "autopilot gains my-boat.yaml --out my-boat.yaml",
    "autopilot envelope": "autopilot envelope my-boat.yaml --runs 2000 --report envelope.html",
    "autopilot params check": "autopilot params check my-boat.yaml",
    "autopilot params show": "autopilot params show my-boat.yaml",
    "autopilot params upload": "autopilot params upload ardurover-boat --link serial:/dev/ttyACM0:57600 --dry-run",
    "autopilot params download": "autopilot params download all.param --link serial:/dev/ttyACM0:57600",
    "autopilot replay": "autopilot replay run.tlog",
    "autopilot web": "autopilot web --link udpin:127.0.0.1:14551 --logs logs --token-file web.token",
    "autopilot helm": "autopilot helm --link udpin:127.0.0.1:14552",
    "autopilot doctor": "autopilot doctor my-boat.yaml --link serial:/dev/ttyUSB0:115200 --as-gcs",
    "autopilot install-service": "autopilot install-service my-boat.yaml --link serial:/dev/serial0:57600 --dry-run",
    "autopilot demo": "autopilot demo --out demo",
    "sitl serve": "sitl serve lanxin --mavlink udpout:127.0.0.1:14550",
    "sitl ardupilot-physics": "sitl ardupilot-physics lanxin",
}
"""A call of each command that works where its files and links are there."""

OPTION_GROUPS = {
    "links": (
        "--link",
        "--as-gcs",
        "--steer",
        "--vehicle-system",
        "--reconnect",
        "--link-wait",
        "--wait",
        "--with-other-pilot",
    ),
    "log": ("--log", "--log-dir", "--log-total-mb", "--state"),
    "ground stations": ("--serve", "--forward", "--system", "--orders-without-key", "--signing-key"),
    "this machine": ("--realtime", "--cpu", "--speedup"),
}
"""Options that stand under a heading of their own in the help of commands with many."""
MANY = 10
"""Options from which on help is grouped, and its first line short."""
CHOICE = re.compile(r"argument (.+?): invalid choice: '?(.*?)'? \(choose from (.*)\)$")


class Parser(argparse.ArgumentParser):
    """An ArgumentParser as described above; the parsers of its commands are of the same kind."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._given: Sequence[str] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Remember what was typed, so that a mistake can be named whatever fails first."""
        self._given = tuple(sys.argv[1:] if args is None else args)
        known, unknown = super().parse_known_args(args, namespace)
        stray = [word for word in unknown if word.startswith("--")]
        # here and not where the program's own parser finds them: this one knows the command's options
        if stray:
            self._refuse_option(stray[0])
        return known, unknown

    def error(self, message: str) -> NoReturn:
        """End the program with one sentence that says what to type instead."""
        unknown = next((word for word in self._given if self._is_stray(word)), None)
        if unknown is not None:
            self._refuse_option(unknown)
        choice = CHOICE.match(message)
        if choice is not None:
            name, typed, listed = choice.groups()
            known = re.findall(r"[^\s',]+", listed)
            what = f"command of `{self.prog}`" if name in ("COMMAND", "ACTION") else f"choice for {name}"
            self._refuse(f"{typed!r} is no {what}{nearest(typed, known)}")
        self._refuse(message.replace("the following arguments are required", "missing"))

    def _is_stray(self, word: str) -> bool:
        name = word.split("=")[0]
        own = self._option_string_actions
        return name.startswith("--") and len(name) > 2 and not any(option.startswith(name) for option in own)

    def _refuse_option(self, word: str) -> NoReturn:
        name = word.split("=")[0]
        self._refuse(f"{name} is no option of `{self.prog}`{nearest(name, list(self._option_string_actions))}")

    def _refuse(self, sentence: str) -> NoReturn:
        example = EXAMPLES.get(self.prog)
        lines = [f"{self.prog}: {brief(escaped(sentence))}", f"Options and explanations: {self.prog} --help"]
        if example is not None:
            lines.insert(1, f"Example: {example}")
        self.exit(int(ExitCode.USAGE), "\n".join(lines) + "\n")

    def format_usage(self) -> str:
        """Return the first line of the help."""
        formatter = self._get_formatter()
        self._add_usage(formatter)
        return formatter.format_help()

    def format_help(self) -> str:
        """Return the help, options in groups where there are many, and an example."""
        formatter = self._get_formatter()
        self._add_usage(formatter)
        formatter.add_text(self.description)
        for title, actions in self._grouped():
            formatter.start_section(title)
            formatter.add_arguments(actions)
            formatter.end_section()
        example = EXAMPLES.get(self.prog)
        if example is not None:
            formatter.add_text(f"example: {example}")
        formatter.add_text(self.epilog)
        return formatter.format_help()

    def _options(self) -> list[argparse.Action]:
        return [action for action in self._actions if action.option_strings and action.help != argparse.SUPPRESS]

    def _add_usage(self, formatter: argparse.HelpFormatter) -> None:
        if self.usage is not None or len(self._options()) < MANY:
            formatter.add_usage(self.usage, self._actions, self._mutually_exclusive_groups)
            return
        needed = [action for action in self._actions if action.required and action.option_strings]
        places = [action for action in self._actions if not action.option_strings]
        words = [f"{action.option_strings[-1]} {action.metavar or action.dest.upper()}" for action in needed]
        words += [
            str(action.metavar or action.dest) + (" ..." if action.nargs in ("+", "*") else "") for action in places
        ]
        formatter.add_usage(" ".join([self.prog.replace("%", "%%"), *words, "[options]"]), (), ())

    def _grouped(self) -> list[tuple[str | None, list[argparse.Action]]]:
        split = len(self._options()) >= MANY
        groups: list[tuple[str | None, list[argparse.Action]]] = []
        for group in self._action_groups:
            if group is not self._optionals or not split:
                groups.append((group.title, group._group_actions))
                continue
            apart: dict[str, list[argparse.Action]] = {title: [] for title in OPTION_GROUPS}
            rest: list[argparse.Action] = []
            for action in group._group_actions:
                title = next((t for t, names in OPTION_GROUPS.items() if {*names} & {*action.option_strings}), None)
                (rest if title is None else apart[title]).append(action)
            groups.append((group.title, rest))
            groups += [(title, actions) for title, actions in apart.items() if actions]
        return groups


def nearest(typed: str, known: Sequence[str]) -> str:
    """Return "; did you mean X?" for what comes nearest to it, or what there is where nothing does."""
    from autopilot.files.typed import nearest as most_like  # only a mistake needs it

    # the dashes that all options have make none of them alike
    bare = {name.lstrip("-"): name for name in known}
    close = most_like(typed.lstrip("-"), list(bare))
    if close is not None:
        return f"; did you mean {bare[close]}?"
    listed = [name for name in known if not name.startswith("-")]
    return f"; there are {', '.join(listed)}" if listed else ""


def commands_in_groups(groups: Mapping[str, Sequence[str]], summaries: Mapping[str, str]) -> str:
    """Return the commands for a program's help, those that serve one purpose together."""
    width = max(map(len, summaries))
    lines = []
    for title, names in groups.items():
        lines += [f"{title}:", *(f"  {name:<{width}}  {summaries[name]}" for name in names), ""]
    return "\n".join(lines)


def print_completion(parser: argparse.ArgumentParser, shell: str) -> int:
    """Print the completion of a whole `parser` for a shell. Raises InputError without the extra `completion`."""
    try:
        import shtab
    except ImportError:
        raise InputError("completion needs shtab; pip install 'norrbin[completion]'") from None
    for each in parsers_of(parser):
        for action in each._actions:
            if isinstance(action, argparse._SubParsersAction):
                action.help = None  # hidden in the help, which lists the commands in groups
            words = action.metavar if isinstance(action.metavar, str) else ""
            if "FILE" in words or words.endswith(".yaml") or words == "LOG":
                action.complete = shtab.FILE  # type: ignore[attr-defined]
            elif words == "DIR":
                action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
    print(shtab.complete(parser, shell))
    return 0


def parsers_of(parser: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    """Return a parser and those of all its commands."""
    found = [parser]
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for each in action.choices.values():
                found += parsers_of(each)
    return found


SHELLS = ("bash", "zsh", "fish")


def add_completion_parser(subparsers: argparse._SubParsersAction[Any], program: str) -> argparse.ArgumentParser:
    """Add the subcommand `completion`; the caller sets what it runs."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "completion",
        help="print what completes this program's commands and options in a shell",
        description=f"Print the completion for a shell, for example: {program} completion bash > "
        f"~/.local/share/bash-completion/completions/{program}",
    )
    parser.add_argument("shell", choices=SHELLS)
    return parser
