"""`autopilot params`: parameter files checked, compared and converted; written to a vehicle, read back, undone."""

from __future__ import annotations

import argparse
import importlib
from functools import partial
from typing import Any

from autopilot.cli.options import SYSTEM_ID, add_signing_option, add_waiting_option
from autopilot.interruption import as_exceptions

LINK_HELP = "udpin:127.0.0.1:14550, serial:/dev/ttyUSB0:57600"
CALIBRATION_HELP = "with the calibration of accelerometers, gyros, compasses; without it, it is left as it is"
WRITE = ("upload", "restore")
ON_FAILURE = ("ask", "rollback", "keep")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the `params` subcommand with its own subcommands."""
    parser.description = (
        "Vessel files describe a boat to Norrbin; firmware files hold parameters of a flight controller. "
        "FILE is a path or the name of a shipped file, such as lanxin or ardurover-boat; where parameters of a flight "
        "controller are meant, also a .param, .parm or .params file of a ground station."
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    _add_file_actions(actions)
    _add_reading_actions(actions)
    _add_upload(actions)
    _add_restore(actions)
    for name, action in actions.choices.items():
        # the module of a name is loaded when it is called: other commands start without it
        action.set_defaults(run=partial(_call, "params_upload" if name in WRITE else "params_reading", name))


def _call(module: str, function: str, arguments: argparse.Namespace) -> int:
    called = getattr(importlib.import_module(f"autopilot.cli.{module}"), function)
    with as_exceptions():  # an upload that is under way is taken back
        return int(called(arguments))


def _add_file_actions(actions: Any) -> None:
    check = actions.add_parser("check", help="read files strictly and list all mistakes")
    check.add_argument("files", nargs="+", metavar="FILE")

    show = actions.add_parser("show", help="print a file with every default filled in and every number explained")
    show.add_argument("file", metavar="FILE")
    show.add_argument("--json", action="store_true", help="print JSON")

    convert = actions.add_parser(
        "convert",
        help="turn a parameter file into another format",
        description="The suffix gives the format: .yaml a firmware file, .param Mission Planner, .parm MAVProxy and "
        "ArduPilot, .params QGroundControl. Values keep every bit of their 32-bit floats.",
    )
    convert.add_argument("file", metavar="FILE")
    convert.add_argument("out", metavar="OUT")
    convert.add_argument(
        "--firmware", choices=("ardurover", "px4", "norrbin"), help="firmware, if FILE does not name it"
    )
    convert.add_argument("--system", action=SYSTEM_ID, default=1, metavar="N", help="vehicle id in a .params file")
    convert.add_argument("--overwrite", action="store_true", help="replace OUT if it exists")

    schema = actions.add_parser(
        "schema",
        help="print the JSON Schema of vessel or firmware files, for editors",
        description="Editors with a YAML language server complete and check a file that begins with the line "
        "'# yaml-language-server: $schema=vessel.schema.json'.",
    )
    schema.add_argument("kind", choices=("vessel", "firmware"))
    schema.add_argument("--out", metavar="FILE", help="write it to this file (default: print it)")


def _add_reading_actions(actions: Any) -> None:
    diff = actions.add_parser(
        "diff",
        help="compare two files, or a file with a vehicle",
        description="Exit code 6 when there is a difference.",
    )
    diff.add_argument("file", metavar="FILE")
    diff.add_argument("other", metavar="FILE|LINK", help=f"another file, or a link: {LINK_HELP}")
    diff.add_argument("--system", action=SYSTEM_ID, metavar="N", help="the vehicle's system id")
    add_signing_option(diff)
    diff.add_argument("--json", action="store_true", help="print JSON")

    verify = actions.add_parser(
        "verify",
        help="read every parameter of a file back from a vehicle and compare; nothing is set",
        description="Exit code 6 when the vehicle does not hold the file's values.",
    )
    verify.add_argument("file", metavar="FILE")
    _add_link_options(verify)
    verify.add_argument("--with-calibration", action="store_true", help=CALIBRATION_HELP)
    verify.add_argument("--json", action="store_true", help="print JSON")

    download = actions.add_parser("download", help="write a vehicle's parameters into a file")
    download.add_argument("file", metavar="FILE", help="the suffix gives the format, as in convert")
    _add_link_options(download)
    download.add_argument("--names", metavar="A,B,...", help="only these parameters (default: all)")
    download.add_argument("--overwrite", action="store_true", help="replace FILE if it exists")

    backup = actions.add_parser("backup", help="write all parameters of a vehicle into a dated firmware file")
    _add_link_options(backup)
    backup.add_argument("--folder", default=".", metavar="DIR", help="where the file goes (default: here)")


def _add_upload(actions: Any) -> None:
    upload = actions.add_parser(
        "upload",
        help="write a file to a vehicle and read every value back, wholly or not at all",
        description="Reads what the vehicle holds, sets what differs, reads all of it back and compares. When not "
        "every parameter holds its wanted value, the old values are put back. Exit code 6 when a parameter does not "
        "hold the value wanted (with --dry-run: before the upload).",
    )
    upload.add_argument("file", metavar="FILE")
    _add_link_options(upload)
    upload.add_argument("--dry-run", action="store_true", help="only read and compare; nothing is set")
    upload.add_argument("--json", action="store_true", help="print JSON")
    upload.add_argument("--backup", metavar="BACKUP", help="where the old values go (default: a dated file here)")
    upload.add_argument("--no-backup", action="store_true", help="keep no file of old values")
    upload.add_argument("--while-armed", action="store_true", help="upload although the vehicle is armed or engaged")
    _add_writing_options(upload)


def _add_restore(actions: Any) -> None:
    restore = actions.add_parser(
        "restore",
        help="finish an interrupted upload, or write the settings of a backup file back",
        description="Without FILE: looks at what the vehicle holds after an upload that was killed or lost its link. "
        "Holds it wholly old or wholly new values, it says so; else the old ones are put back. With FILE: the settings "
        "of the file that differ are written, as an upload does; a backup that holds all that an upload which was cut "
        "off has changed settles that too. What a firmware moves by itself, device ids and calibration stay as they "
        "are.",
    )
    restore.add_argument("file", nargs="?", metavar="FILE")
    _add_link_options(restore)
    restore.add_argument(
        "--to",
        choices=("old", "new", "as-is"),
        help="settle an interrupted upload: write these values as far as the vehicle accepts them, or leave and print "
        "what it holds",
    )
    restore.add_argument("--while-armed", action="store_true", help="write although the vehicle is armed or engaged")
    _add_writing_options(restore)
    restore.add_argument("--json", action="store_true", help="print JSON")


def _add_writing_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--with-calibration", action="store_true", help=CALIBRATION_HELP)
    parser.add_argument(
        "--on-failure",
        choices=ON_FAILURE,
        default="ask",
        help="what to do with values already set if one is not accepted: ask (default; without a terminal: rollback), "
        "rollback, keep",
    )


def _add_link_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--link", required=True, metavar="URL", help=LINK_HELP)
    add_signing_option(parser)
    add_waiting_option(parser)
    parser.add_argument("--system", action=SYSTEM_ID, metavar="N", help="the vehicle's system id, if several answer")
