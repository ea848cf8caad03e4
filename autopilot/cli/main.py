"""Entry point of the `autopilot` command: finds the subcommand, prints errors as one sentence, sets exit codes."""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence

from autopilot.errors import ExitCode, InputError, RefusedError

SUBCOMMANDS = ("run", "trial", "identify", "identify-dp", "log", "gains", "params", "replay", "demo")

EXIT_CODES = """exit codes:
  0  done as asked
  2  bad usage, or a file or record that cannot be used
  3  a link could not be opened, stayed silent or was lost
  4  refused: engaging would not be safe, the vehicle does not obey, or a trial ended early
  5  ended in fail-safe
  6  compared and found different (params upload, verify, diff; replay)
"""


def build_parser() -> argparse.ArgumentParser:
    """Return the parser with every subcommand in it."""
    parser = argparse.ArgumentParser(
        prog="autopilot",
        description="Identify a boat from its log, design its gains, and steer it over MAVLink or serial.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in SUBCOMMANDS:
        importlib.import_module(f"autopilot.cli.{name.replace('-', '_')}").add_parser(subparsers)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one subcommand and return its exit code."""
    from autopilot.links.base import LinkError

    arguments = build_parser().parse_args(argv)
    try:
        return int(arguments.run(arguments))
    except InputError as error:
        return _complain(error, ExitCode.USAGE)
    except LinkError as error:
        return _complain(error, ExitCode.LINK)
    except RefusedError as error:
        return _complain(error, ExitCode.REFUSED)
    except BrokenPipeError:
        # the reader of our output went away (head, less): nothing left to tell anybody
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return int(ExitCode.OK)
    except KeyboardInterrupt:
        return 130


def _complain(error: Exception, code: ExitCode) -> int:
    print(f"autopilot: {error}", file=sys.stderr)
    return int(code)


if __name__ == "__main__":
    sys.exit(main())
