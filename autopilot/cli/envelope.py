"""`autopilot envelope`: how wrong the vessel file may be before the pilot does not hold the boat any more.

The simulator does it in a process of its own, `sitl envelope`, since the autopilot itself knows no simulator.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from autopilot.cli.options import whole_number
from autopilot.interruption import Interrupted, run_child


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add what `autopilot envelope` and `sitl envelope` are given."""
    parser.add_argument("vessel", metavar="VESSEL.yaml", help="vessel file, or the name of a shipped one (lanxin)")
    parser.add_argument(
        "--runs", metavar="N", action=whole_number(1, 10_000_000), default=400, help="runs to sail (default 400)"
    )
    parser.add_argument(
        "--seed",
        metavar="N",
        action=whole_number(0, 2**31 - 1),
        default=1,
        help="the runs are drawn by it (default 1)",
    )
    parser.add_argument("--workers", metavar="N", action=whole_number(1, 1024), help="processes (default: all cores)")
    parser.add_argument("--compass-only", action="store_true", help="without a rate of turn")
    parser.add_argument("--report", metavar="FILE.html", type=Path, help="write tables and figures into one page")
    parser.add_argument("--json", action="store_true", help="print JSON")


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "envelope",
        help="search how wrong a vessel file may be before the boat is not held",
        description="Sail runs drawn about the vessel file: boat, rudder, delay, backlash, speed and sea that are not "
        "what it says. Prints the bounds within which every run was held; exit code 6 where one was not, and no alarm "
        "said so within 5 s.",
    )
    add_options(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Have the simulator sail what was asked of us; what it prints is for the user as it is."""
    try:
        return run_child(simulator(*arguments.typed[1:]))
    except Interrupted as signal:  # it has said so
        return 128 + signal.number


def simulator(*words: str) -> list[str]:
    """Return the command line of `sitl`, whose messages are in the name of this program."""
    return [sys.executable, "-c", "from sitl.__main__ import main; main('autopilot')", *words]
