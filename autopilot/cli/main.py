"""Entry point of the `autopilot` command: finds the subcommand, prints errors as one sentence, sets exit codes."""

from __future__ import annotations

import argparse
import importlib
import itertools
import os
import sys
from collections.abc import Callable, Sequence

from autopilot import __version__
from autopilot.cli.options import HelpText, Parser, add_completion_parser, commands_in_groups
from autopilot.errors import ExitCode, InputError, LinkError, RefusedError, unreachable
from autopilot.files.printable import brief, escaped, printable_output

SUBCOMMANDS = {
    "new-boat": "begin with a boat of your own: its file, then every step to the first hold",
    "run": "steer a boat in real time",
    "trial": "sail manoeuvres to identify and measure the boat",
    "identify": "identify a boat's model from recordings of rudder, speed and motion",
    "identify-dp": "identify a ship's thrust and damping from trials under its thrusters",
    "log": "show what a log holds, and convert it",
    "gains": "design gains for a vessel's model and rudder, and show the margins",
    "envelope": "search how wrong a vessel file may be before the boat is not held",
    "params": "check, convert, upload, verify and restore parameter files",
    "replay": "run a log again and compare every rudder command bit for bit",
    "web": "the helm as a page for phone, tablet and desktop",
    "signalk": "the running pilot in Signal K: its state as deltas, orders from Signal K programs",
    "doctor": "check whether this machine and these links are fit to steer",
    "install-service": "steer from power-on: a system service with watchdog and user",
    "helm": "the helm in a terminal, for SSH",
    "demo": "trial, identification and steering of the simulated Lanxin boat, in about a minute",
    "completion": "print what completes this program's commands and options in a shell",
}
"""The commands, and what stands beside each in `--help`; the module of each is loaded when needed."""
ADDED_BY = {
    "envelope": ("gains", "add_envelope"),
    "signalk": ("web", "add_signalk_options"),
    "replay": ("log", "add_replay_options"),
}
"""The module and function that add a command's options, where it is not `add_options` in a module of its name."""

GROUPS = {
    "begin": ("demo", "new-boat"),
    "from a trial to gains": ("trial", "log", "identify", "identify-dp", "gains", "envelope", "params"),
    "steer": ("doctor", "run", "helm", "web", "signalk", "replay"),
    "set it up": ("install-service", "completion"),
}
EXIT_CODES = """exit codes:
  0  done as asked
  1  the program failed: the rudder was given back, the trace says where
  2  bad usage, or a file or record that cannot be used
  3  a link could not be opened, stayed silent or was lost
  4  refused: engaging would not be safe, the vehicle does not obey, or a trial ended early; doctor: no go
  5  ended in fail-safe, or in fault
  6  a difference was found (params upload, verify, diff; replay)
  129  its terminal closed before it was done; as for 130
  130  ended by Ctrl-C before it was done; run, trial, web, signalk and helm, which go on until they are ended: 0
  143  ended by a termination signal before it was done; as for 130
"""


def build_parser(argv: Sequence[str] | None = None) -> argparse.ArgumentParser:
    """Return the parser with every subcommand in it; for given arguments only the one they name is whole."""
    parser = Parser(
        prog="autopilot",
        usage="autopilot COMMAND ...",
        description="Identify a boat from its log, design its gains, and steer it over MAVLink or serial.",
        epilog=f"{commands_in_groups(GROUPS, SUBCOMMANDS)}\neach has a help of its own: autopilot COMMAND --help\n\n"
        + EXIT_CODES,
        formatter_class=HelpText,
    )
    parser.add_argument("--version", action="version", version=f"norrbin {__version__}")
    subparsers = parser.add_subparsers(
        dest="command", metavar="COMMAND", required=True, help=argparse.SUPPRESS, prog="autopilot"
    )
    named = None if argv is None else next((word for word in argv if not word.startswith("-")), "")
    for name, summary in SUBCOMMANDS.items():
        if named not in (None, name):
            subparsers._name_parser_map[name] = parser  # to choose from, and never asked
        elif name == "completion":
            add_completion_parser(subparsers, "autopilot", build_parser)
        else:
            module, function = ADDED_BY.get(name, (name.replace("-", "_"), "add_options"))
            add_options = getattr(importlib.import_module(f"autopilot.cli.{module}"), function)
            add_options(subparsers.add_parser(name, help=summary))
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one subcommand and return its exit code."""
    # before numpy comes: its threads spin on cores that others need, and a sum's last digit hangs on their number
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    return answer("autopilot", sys.argv[1:] if argv is None else argv, build_parser)


def answer(program: str, given: Sequence[str], parser_for: Callable[[Sequence[str]], argparse.ArgumentParser]) -> int:
    """Run what the arguments `given` to a program ask for; return its exit code.

    An error becomes one sentence; what is printed is made printable, whoever it comes from.
    """
    with printable_output():
        return _answer(program, given, parser_for)


def _answer(program: str, given: Sequence[str], parser_for: Callable[[Sequence[str]], argparse.ArgumentParser]) -> int:
    try:
        _refuse_empty(given)
        arguments = parser_for(given).parse_args(given)
        arguments.typed = [program, *given]  # reports print it, whole
        return int(arguments.run(arguments))
    except InputError as error:
        return _complain(program, error, ExitCode.USAGE)
    except OSError as error:
        return _complain(program, unreachable(error), ExitCode.USAGE)
    except LinkError as error:
        return _complain(program, error, ExitCode.LINK)
    except RefusedError as error:
        return _complain(program, error, ExitCode.REFUSED)


def _refuse_empty(given: Sequence[str]) -> None:
    for before, word in itertools.pairwise(["", *given]):
        if word == "" or (word.startswith("--") and word.find("=") == len(word) - 1):
            whose = f" ({word or before})" if (word or before).startswith("--") else ""
            raise InputError(
                f"an argument is empty{whose}, such as a variable of the shell that is not set; leave it out, or give "
                "what --help says"
            )


def _complain(program: str, error: Exception, code: ExitCode) -> int:
    print(f"{program}: {brief(escaped(str(error)))}", file=sys.stderr)
    return int(code)
