"""`autopilot replay`: a log through a fresh pilot, every command compared bit for bit; or onto links, to look at."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from autopilot.cli.options import number
from autopilot.errors import ExitCode


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    from autopilot.cli.options import add_signing_option

    parser = subparsers.add_parser(
        "replay",
        help="run a log again and compare every rudder command bit for bit",
        description="Run the ticks of a log through a fresh pilot and compare every rudder command bit for bit. With "
        "--link the log is played onto links instead, for ground stations, plotters and pages to look at.",
    )
    parser.add_argument("log", metavar="LOG.tlog", type=Path)
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.add_argument(
        "--link",
        action="append",
        default=[],
        metavar="URL",
        help="play the log onto this link: udpout:127.0.0.1:14550, 'nmea-tcpin:127.0.0.1:10110?send=HDT:5'; repeatable",
    )
    parser.add_argument(
        "--speed", action=number(0.01, 10_000.0), default=1.0, metavar="X", help="speed factor (default 1)"
    )
    add_signing_option(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Replay and report; exit code 6 where a command differs."""
    from autopilot.cli.log import print_newer

    print_newer([str(arguments.log)])
    if arguments.link:
        return _play(arguments)
    from autopilot.cli.terminal import ProgressBar
    from autopilot.runtime.record import replay

    with ProgressBar("replaying") as bar:
        result = replay(arguments.log, bar.update_share)
    if arguments.json:
        print(json.dumps(result._asdict()))
    elif result.identical:
        gap = f"; {result.left_out} behind a gap in the log are left out" if result.left_out else ""
        print(f"{result.ticks} ticks replayed, every command identical{gap}")
    else:
        print(f"tick {result.first_difference}: {result.detail}")
    return int(ExitCode.OK if result.identical else ExitCode.DIFFERENT)


def _play(arguments: argparse.Namespace) -> int:
    import signal

    from autopilot.cli.options import signing_of
    from autopilot.interruption import print_end
    from autopilot.logs.replay_onto import replay_onto
    from autopilot.runtime.machine import MonotonicClock

    stopped: list[int] = []
    for each in (signal.SIGINT, signal.SIGTERM):
        signal.signal(each, lambda each, _: stopped.append(each))
    clock, signing = MonotonicClock(arguments.speed), signing_of(arguments)
    print(replay_onto(arguments.log, arguments.link, clock, lambda: bool(stopped), signing))
    if stopped:
        print_end(stopped[0])
    return int(ExitCode.OK)
