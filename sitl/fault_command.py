"""`sitl fault`: a fault for a boat that is being served, from the command line."""

from __future__ import annotations

import argparse
from typing import Any

from autopilot.cli.options import add_waiting_option, patience_of
from autopilot.errors import ExitCode, InputError

DEFAULT_DESK = "127.0.0.1:14599"


def add_fault_command(commands: Any, epilog: str) -> None:
    """Add `sitl fault` to the commands of a parser."""
    fault = commands.add_parser(
        "fault",
        help="a fault for a boat that is being served with --control",
        description="Give a served boat a fault: `sitl fault rudder_stuck for=10`. `list` names "
        "the active faults, `clear [KIND]` ends them; --kinds shows every kind with its size.",
        epilog=epilog,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    fault.add_argument(
        "words",
        metavar="WORD",
        nargs="*",
        help="KIND [size=X] [for=S] [ramp=S] [after=S] [source=first|second], list, clear",
    )
    fault.add_argument(
        "--control", metavar="HOST:PORT", default=DEFAULT_DESK, help="where the boat listens (default %(default)s)"
    )
    fault.add_argument("--kinds", action="store_true", help="print the table of faults, and stop")
    add_waiting_option(fault)
    fault.set_defaults(run=run_fault)


def run_fault(arguments: argparse.Namespace) -> int:
    """Pass one line to a served boat and print its answer."""
    from sitl.fault_desk import ask, kinds_table

    if arguments.kinds:
        print(kinds_table())
        return int(ExitCode.OK)
    said = patience_of(arguments)(lambda: ask(arguments.control, " ".join(arguments.words)))
    verdict, _, answer = said.partition(" ")
    if verdict != "ok":
        raise InputError(answer)
    print(answer)
    return int(ExitCode.OK)
