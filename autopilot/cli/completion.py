"""`autopilot completion`: what completes commands and options in a shell."""

from __future__ import annotations

import argparse
from typing import Any

from autopilot.cli.parsers import add_completion_parser, print_completion


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    add_completion_parser(subparsers, "autopilot").set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print it."""
    from autopilot.cli.main import build_parser

    return print_completion(build_parser(), arguments.shell)
