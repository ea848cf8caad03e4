"""The parser of both programs, and options of several commands.

Help stands in groups, with an example, and a mistake is answered in one sentence: a command, an option or a choice that
is not there with what it comes nearest to, something left out with an example that works. A number is read strictly,
and refused with what is allowed. What is not there yet may come: a device that is being plugged in, a program that is
being started.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
import time
from collections.abc import Callable, Mapping, Sequence

from autopilot.errors import ExitCode, InputError, NotYetError
from autopilot.files.printable import SENTENCE, brief, escaped, print_file, printable

TYPE_CHECKING = False  # see `autopilot`
if TYPE_CHECKING:
    from pathlib import Path
    from typing import Any, NoReturn, TypeVar

    from autopilot.links.mavlink.signing import Signing
    from autopilot.vessel.schema import Vessel

    Opened = TypeVar("Opened")


WHOLE = re.compile(r"[+-]?[0-9]{1,20}")


class NumberOption(argparse.Action):
    """An option with a finite number from `low` to `high`, also whole where `is_whole`."""

    low = -math.inf
    high = math.inf
    is_whole = False

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Set the number; raises InputError, which argparse passes on."""
        is_given = isinstance(values, str)  # else it is the const of an option without a value
        setattr(namespace, self.dest, self._read(values) if is_given else values)

    def _read(self, text: str) -> float:
        from autopilot.files.outside import SHOWN, typed_number  # a help reads no number

        try:
            value = int(text) if self.is_whole and WHOLE.fullmatch(text) else typed_number(text)
        except InputError:
            value = math.nan
        if not self.low <= value <= self.high or (self.is_whole and not isinstance(value, int)):
            shown = printable(text, SHOWN) or repr(text)
            raise InputError(f"{self.option_strings[0]} {shown}{_why_no_number(text)}: allowed is {self.allowed}")
        return value

    @property
    def allowed(self) -> str:
        """What is allowed, in words."""
        if self.is_whole:
            return f"a whole number from {self.low} to {self.high}"
        return "a number" if math.isinf(self.high) else f"{self.low:.10g} to {self.high:.10g}"


def named_vessel(path: str) -> Vessel:
    """Return the vessel of a file or a shipped name; what hardly any boat has is said on standard error. InputError."""
    from autopilot.vessel.file import doubted, load_vessel

    vessel = load_vessel(path)
    for sentence in doubted(path, vessel):
        print(f"autopilot: {printable(sentence, SENTENCE)}", file=sys.stderr)
    return vessel


def _why_no_number(text: str) -> str:
    """Return what is wrong with 33ft and 10,5, whose number may well be one of those allowed; else ''."""
    if not text[:1].isdecimal():
        return ""
    try:
        float(text)
    except ValueError:
        return " is no bare number (a point, no comma; no unit behind it)"
    return ""


def number(low: float, high: float) -> type[NumberOption]:
    """Return the action of an option with a number; one without bounds, NumberOption itself, is looked at later."""
    return type("Number", (NumberOption,), {"low": low, "high": high})


def whole_number(low: int, high: int) -> type[NumberOption]:
    """Return the action of an option with a whole number."""
    return type("WholeNumber", (NumberOption,), {"low": low, "high": high, "is_whole": True})


SECONDS = number(0.001, 1.0e9)
"""Of a duration: up to thirty years."""
WAITING = number(0.0, 1.0e6)
SPEEDUP = number(0.001, 1.0e6)
SYSTEM_ID = whole_number(1, 255)
SEED = whole_number(0, 2**63 - 1)

LINK_WAIT_S = 10.0
PAUSE_S = 0.1


def add_waiting_option(parser: argparse.ArgumentParser) -> None:
    """Add `--link-wait`."""
    parser.add_argument(
        "--link-wait",
        action=WAITING,
        default=LINK_WAIT_S,
        metavar="S",
        help="wait this long for a device or connection that is not there yet (%(default)g; 0: do not wait)",
    )


class Patience:
    """Opens what may not be there yet, for so long [s] altogether; says once what it waits for."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._until: float | None = None

    def __call__(self, opener: Callable[[], Opened]) -> Opened:
        """Return what `opener` opens, tried again while that is not there. Raises LinkError, InputError."""
        from autopilot.links.base import NotThereError, parted

        is_said = False
        while True:
            try:
                return opener()
            except (NotThereError, NotYetError) as error:
                now = time.monotonic()
                self._until = now + self._seconds if self._until is None else self._until
                if now >= self._until:
                    raise
                if not is_said:
                    is_said = True
                    left = self._until - now
                    what, _ = parted(str(error))
                    print(f"{what}: waiting up to {left:.0f} s for it (--link-wait)", file=sys.stderr, flush=True)
            time.sleep(PAUSE_S)


def patience_of(arguments: argparse.Namespace) -> Patience:
    """Return the patience that the options ask for."""
    return Patience(getattr(arguments, "link_wait", 0.0))


SIGNING_HELP = (
    "sign MAVLink messages with the key in FILE (mode 0600: 64 hex digits or a passphrase), and refuse unsigned ones"
)


def add_signing_option(parser: argparse.ArgumentParser) -> None:
    """Add `--signing-key`."""
    parser.add_argument("--signing-key", metavar="FILE", help=SIGNING_HELP)


def signing_of(arguments: argparse.Namespace) -> Signing | None:
    """Return signing with the key that was given, None without one. Raises InputError."""
    if arguments.signing_key is None:
        return None
    from autopilot.links.mavlink.signing import open_signing

    return open_signing(arguments.signing_key)


def check_places(report: str | Path | None, vessel: str | None = None) -> None:
    """Raise InputError where the page of `--report` or the vessel file of `--out` cannot be written: said before the
    work."""
    from autopilot.files.saving import check_folder

    if report:
        from autopilot.report import require_extra

        require_extra("by leaving out --report", report)
        check_folder(report)
    if vessel:
        check_folder(vessel)
        from autopilot.vessel.file import refuse_bare_name

        refuse_bare_name(vessel)


EXAMPLES = {
    "autopilot": "autopilot new-boat my-boat.yaml",
    "sitl": "sitl serve lanxin --mavlink udpout:127.0.0.1:14550",
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


SECOND_COLUMN = re.compile(r" *(\S+ {2,})?")
"""What stands before the second column of a line, or before its words."""


class HelpText(argparse.RawDescriptionHelpFormatter):
    """As wide as the terminal: by itself argparse loads a module of archives to learn that."""

    def __init__(self, prog: str) -> None:
        columns = os.environ.get("COLUMNS", "")
        try:
            width = int(columns) if columns.isdecimal() else os.get_terminal_size(1).columns
        except (OSError, ValueError):  # no terminal, or more digits than a number has
            width = 0
        super().__init__(prog, width=(width or 80) - 2)

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        """Keep the lines as they are; one that is too long goes on below its second column."""
        import textwrap

        lines = []
        for line in text.splitlines():
            head = SECOND_COLUMN.match(line)
            hanging = " " * (len(head[0]) if head else 0)
            fitting = textwrap.wrap(
                line, width, subsequent_indent=hanging, break_long_words=False, break_on_hyphens=False
            )
            lines += fitting if len(line) > width else [line]
        return "\n".join(f"{indent}{line}" for line in lines)


class Parser(argparse.ArgumentParser):
    """An ArgumentParser as described above; the parsers of its commands are of the same kind."""

    def __init__(self, *arguments: Any, **options: Any) -> None:
        super().__init__(*arguments, **options)
        self._given: Sequence[str] = ()

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Remember what was typed, so that a mistake can be named whatever fails first."""
        self._given = tuple(sys.argv[1:] if args is None else args)
        known, unknown = super().parse_known_args(args, namespace)
        stray = [word for word in unknown if word.startswith("-")]
        # here and not where the program's own parser finds them: this one knows the command's options
        if stray:
            self._refuse_option(stray[0])
        if unknown and not any(map(_has_commands, self._actions)):
            takes = " ".join(str(each.metavar or each.dest) for each in self._actions if not each.option_strings)
            self._refuse(f"{unknown[0]!r} is one word too many; it takes {takes or 'options alone'}")
        return known, unknown

    def error(self, message: str) -> NoReturn:
        """End the program with one sentence that says what to type instead."""
        choice = CHOICE.match(message)
        unknown = next((word for word in self._given if self._is_stray(word)), None)
        commands = [each.metavar for each in self._actions if _has_commands(each)]
        # what follows a mistyped command are options of the command that was meant
        if unknown is not None and (choice is None or choice[1] not in commands):
            self._refuse_option(unknown)
        if choice is not None:
            name, typed, listed = choice.groups()
            known = re.findall(r"[^\s',]+", listed)
            what = f"command of `{self.prog}`" if name in commands else f"choice for {name}"
            self._refuse(f"{typed!r} is no {what}{nearest(typed, known)}")
        sentence = message.replace("the following arguments are required", "missing")
        for each in self._actions:
            if not each.option_strings and each.choices and sentence == f"missing: {each.metavar or each.dest}":
                sentence += f"; there are {', '.join(each.choices)}"
        self._refuse(sentence)

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


def _has_commands(action: argparse.Action) -> bool:
    return isinstance(action, argparse._SubParsersAction)


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
        raise InputError("completion needs shtab: pip install '.[completion]'") from None
    for each in parsers_of(parser):
        for action in each._actions:
            if isinstance(action, argparse._SubParsersAction):
                action.help = None  # hidden in the help, which lists the commands in groups
                for command in action._choices_actions:  # a menu has room for a line, not for the description
                    action.choices[command.dest].description = command.help
            words = action.metavar if isinstance(action.metavar, str) else ""
            if "FILE" in words or words.endswith(".yaml") or words == "LOG":
                action.complete = shtab.FILE  # type: ignore[attr-defined]
            elif words == "DIR":
                action.complete = shtab.DIRECTORY  # type: ignore[attr-defined]
    print_file(f"{shtab.complete(parser, shell)}\n")
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


def add_completion_parser(
    subparsers: argparse._SubParsersAction[Any], program: str, whole: Callable[[], argparse.ArgumentParser]
) -> None:
    """Add the subcommand `completion`; `whole` makes the parser with every command in it."""
    parser: argparse.ArgumentParser = subparsers.add_parser(
        "completion",
        help="print what completes this program's commands and options in a shell",
        description=f"Print the completion for a shell, for example: {program} completion bash > "
        f"~/.local/share/bash-completion/completions/{program}",
    )
    parser.add_argument("shell", choices=SHELLS)
    parser.set_defaults(run=lambda arguments: print_completion(whole(), arguments.shell))
