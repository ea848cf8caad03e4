"""Where `run` and `trial` keep their log: the options, and the recorder that writes from a thread of its own."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path

from autopilot import __version__
from autopilot.cli.option_numbers import number
from autopilot.errors import InputError
from autopilot.links.base import Link
from autopilot.links.guide_alarms import GuideAlarms
from autopilot.loop.log_files import MEGABYTE, FileSink, FolderLimits, FolderSink, ThreadedSink
from autopilot.loop.record import Recorder
from autopilot.params.vessel import Vessel
from autopilot.params.vessel_file import dump_vessel

PART_MB = 64.0
TOTAL_MB = 2000.0
LEAST_PARTS = 4


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """Add `--log`, `--log-dir` and how much may be in the folder."""
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--log",
        metavar="FILE.tlog",
        type=Path,
        help="write everything to this log; where it exists, to its next free name: FILE-2.tlog",
    )
    where.add_argument(
        "--log-dir",
        metavar="DIR",
        type=Path,
        help=f"write everything to a log in this folder, in parts of {PART_MB:g} MB; the oldest parts are removed",
    )
    parser.add_argument(
        "--log-total-mb",
        metavar="MB",
        action=number(1.0, 1.0e7),
        default=TOTAL_MB,
        help=f"what the logs of --log-dir may need together (default {TOTAL_MB:g})",
    )


def open_log(arguments: argparse.Namespace, vessel: Vessel, law: str | None, now: float) -> Recorder | None:
    """Return the log that the options ask for, None where there is to be none. Raises InputError."""
    total = arguments.log_total_mb
    if arguments.log is not None:
        folder = arguments.log.parent
        if not folder.is_dir():
            raise InputError(
                f"--log {arguments.log}: there is no folder {folder}, perhaps because a disk is not mounted; if it is "
                f"to be a new one, make it first: mkdir -p {shlex.quote(str(folder))}"
            )
        sink: FileSink | FolderSink = FileSink(arguments.log)
    elif arguments.log_dir is not None:
        part = min(PART_MB, total / LEAST_PARTS)
        sink = FolderSink(arguments.log_dir, FolderLimits(int(total * MEGABYTE), int(part * MEGABYTE)))
    else:
        return None
    if arguments.log is not None and sink.path != arguments.log:
        print(f"{arguments.log} exists and is kept: this log is {sink.path}")
    header = {"norrbin": __version__, "vessel": dump_vessel(vessel), "law": law}
    return Recorder(ThreadedSink(sink), header, now)


def alarm_links(recorder: Recorder | None) -> list[Link]:
    """Return what brings the log's troubles to the pilot, and so to every link and terminal."""
    return [] if recorder is None else [GuideAlarms(recorder, "log")]
