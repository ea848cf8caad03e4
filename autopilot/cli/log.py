"""`autopilot log`: what a log of any kind holds, the same as a CSV table, and the manoeuvres in it measured."""

from __future__ import annotations

import argparse
import json
import math
import shlex
import sys
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autopilot.errors import ExitCode
from autopilot.files.printable import SENTENCE, escaped, fixed, printable

if TYPE_CHECKING:
    from autopilot.logs.reading import LogInfo, LogOptions
    from autopilot.logs.series import Recording


def add_parser(subparsers: Any) -> None:
    """Add the `log` subcommand with its actions."""
    from autopilot.cli.log_measures import KINDS_HELP, add_log_options
    from autopilot.cli.options import number

    parser = subparsers.add_parser("log", help="show what a log holds, and convert it", description=KINDS_HELP)
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    info = actions.add_parser("info", help="duration, sources, rates, gaps, and what identification can use")
    info.add_argument("log", metavar="LOG", help="a log, or several of one run: FILE+FILE@SECONDS")
    info.add_argument("--json", action="store_true", help="print JSON")
    table = actions.add_parser("csv", help="write it as a CSV table that `identify` reads")
    table.add_argument("log", metavar="LOG", help="a log, or several of one run: FILE+FILE@SECONDS")
    table.add_argument("--out", dest="to", type=Path, metavar="FILE.csv", required=True, help="the table to write")
    table.add_argument("--overwrite", action="store_true", help="replace FILE.csv if it exists")
    exported = actions.add_parser("export", help="write it as MCAP (Foxglove, PlotJuggler), Parquet or CSV")
    exported.add_argument("log", metavar="LOG", help="a log, or several of one run: FILE+FILE@SECONDS")
    exported.add_argument(
        "--to", type=Path, metavar="FILE", required=True, help="out.mcap, out.parquet (extra `export`) or out.csv"
    )
    exported.add_argument("--overwrite", action="store_true", help="replace FILE if it exists")
    measures = actions.add_parser("measures", help="zigzags, turning circles, pull-outs and spirals in it, measured")
    measures.add_argument("log", metavar="LOG", help="a log, or several of one run: FILE+FILE@SECONDS")
    measures.add_argument(
        "--length-m", action=number(0.1, 1000.0), metavar="L", help="the boat's length, for the criteria"
    )
    measures.add_argument("--json", action="store_true", help="print JSON")
    measures.add_argument(
        "--report", metavar="FILE.html", help="write a page with the figures (extra: norrbin[report])"
    )
    for action in (info, table, exported, measures):
        add_log_options(action)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Read the log and do what was asked; return the exit code."""
    from autopilot.cli.log_measures import log_options, print_newer, vessel_of
    from autopilot.files.saving import refuse_existing
    from autopilot.logs.reading import load_recording

    print_newer([arguments.log])
    options = log_options(arguments, vessel_of(arguments))
    if arguments.action in ("csv", "export") and not arguments.overwrite:
        refuse_existing(arguments.to)
    recording = load_recording(arguments.log, options.reading)
    if arguments.action in ("csv", "export"):
        return _rewrite(arguments, recording, options)
    if arguments.action == "measures":
        return _measure(arguments, recording, options)
    from autopilot.logs.reading import info_of

    info = info_of(recording, options.rudder)
    print(as_json(info) if arguments.json else as_text(info))
    return int(ExitCode.OK)


def _rewrite(arguments: argparse.Namespace, recording: Recording, options: LogOptions) -> int:
    from autopilot.cli.log_measures import export
    from autopilot.files.saving import is_standard_output

    ending = ".csv" if arguments.action == "csv" else arguments.to.suffix.lower()
    say = partial(print, file=sys.stderr if is_standard_output(arguments.to) else sys.stdout)  # not into the table
    for note in recording.notes:
        say(note)
    say(export(arguments.log, recording, options, arguments.to, ending))
    return int(ExitCode.OK)


def _measure(arguments: argparse.Namespace, recording: Recording, options: LogOptions) -> int:
    from autopilot.cli import log_measures as report
    from autopilot.identification.trial_measures import measures_of, record_of
    from autopilot.logs.table import table_of

    length = arguments.length_m
    if arguments.report:
        from autopilot.report import require_extra

        require_extra("without --report")
    record = record_of(arguments.log, table_of(recording, options.rudder).columns)
    measures = measures_of(record)
    shown = report.as_json if arguments.json else report.as_text
    print(shown(arguments.log, measures, length, recording.notes))
    if arguments.report:
        from autopilot.files.saving import save_page
        from autopilot.report.trials import trials_page

        page = trials_page(arguments.log, record, measures, length, shlex.join(arguments.typed))
        save_page(arguments.report, page)
    return int(ExitCode.OK)


def as_json(info: LogInfo) -> str:
    """Return the information as JSON; SI units and radians."""
    found = {**info._asdict(), "series": [series._asdict() for series in info.series], "notes": list(info.notes)}
    return json.dumps(found, indent=2)


def as_text(info: LogInfo) -> str:
    """Return the information as a table for people."""
    lines = [f"{escaped(info.source)}: {info.kind}, {fixed(info.duration, 1)} s{_date(info.began)}", ""]
    heads = f"{'samples':>8s} {'Hz':>6s} {'from s':>8s} {'to s':>8s} {'gaps':>5s} {'longest s':>9s}  range"
    lines.append(f"{'quantity':18s} {'source':38s} {heads}")
    for series in info.series:
        name, factor = _unit_of(series.quantity)
        lines.append(
            f"{name:18s} {printable(series.source, 60):38s} {series.samples:8d} {fixed(series.rate_hz, 1):>6s} "
            f"{fixed(series.begins, 1):>8s} {fixed(series.ends, 1):>8s} {series.gaps:5d} "
            f"{fixed(series.longest_gap, 2):>9s}  "
            f"{series.low * factor:.4g} to {series.high * factor:.4g}"
        )
    lines.append("")
    if info.missing:
        lines.append(f"Identification cannot use it: {printable(info.missing, SENTENCE)}")
    else:
        runs = "one stretch" if info.segments == 1 else f"{info.segments} stretches"
        lines.append(f"Identification can use {fixed(info.usable, 1)} s in {runs}:")
    lines += [f"  {_unit_of(column)[0].rsplit(' ', 1)[0]}: {printable(source)}" for column, source in info.uses.items()]
    return "\n".join(lines + [f"- {printable(note, SENTENCE)}" for note in info.notes])


def _date(began: float | None) -> str:
    if began is None:
        return ""
    try:
        return f", begun {datetime.fromtimestamp(began, UTC).strftime('%Y-%m-%d %H:%M:%S')} UTC"
    except (ValueError, OverflowError, OSError):
        return ", begun at no date of the calendar"


def _unit_of(quantity: str) -> tuple[str, float]:
    """Return a quantity's name with the unit it is shown in, and the factor to it."""
    for ending, unit in (("_rad_s", "deg/s"), ("_rad", "deg")):
        if quantity.endswith(ending):
            return f"{quantity.removesuffix(ending).replace('_', ' ')} {unit}", 180.0 / math.pi
    for ending, unit in (("_m_s", "m/s"), ("_rps", "1/s")):
        if quantity.endswith(ending):
            return f"{quantity.removesuffix(ending).replace('_', ' ')} {unit}", 1.0
    return f"{quantity.replace('_', ' ')} -", 1.0
