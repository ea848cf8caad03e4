"""`autopilot replay`: run a log's ticks through a fresh pilot and compare every command, bit for bit."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from autopilot.errors import ExitCode


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    parser = subparsers.add_parser(
        "replay",
        help="run a log again and compare every rudder command bit for bit",
        description="Run the ticks of a log through a fresh pilot and compare every rudder command bit for bit.",
    )
    parser.add_argument("log", metavar="LOG.tlog", type=Path)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Replay and report; exit code 6 where a command differs."""
    from autopilot.loop.replay import replay

    result = replay(arguments.log)
    if arguments.json:
        print(json.dumps(result._asdict()))
    elif result.identical:
        print(f"{result.ticks} ticks replayed, every command identical")
    else:
        print(f"tick {result.first_difference}: {result.detail}")
    return int(ExitCode.OK if result.identical else ExitCode.DIFFERENT)
