"""`autopilot log`: what a log of any kind holds, the same as a table, and the manoeuvres in it measured; and
`autopilot replay`.

The options are those of every command that reads logs. A manoeuvre's measures stand beside IMO's criteria; the export
is MCAP, Parquet or CSV, by the ending of the file.
"""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from autopilot.cli.options import SYSTEM_ID, add_signing_option, named_vessel, number, signing_of
from autopilot.errors import ExitCode, InputError
from autopilot.files.printable import SENTENCE, aligned, escaped, fixed, json_text, printable
from autopilot.files.saving import is_standard_output, newer_numbered, refuse_existing, save_page
from autopilot.identification import trial_measures as criteria
from autopilot.identification.trial_measures import Measures, measures_of, record_of
from autopilot.report import require_extra
from autopilot.report.log_pages import (
    blocks_of,
    compared,
    comparison_page,
    document_of_runs,
    run_of,
    table_of_runs,
    trials_page,
    verdict_of_trials,
)

if TYPE_CHECKING:
    from autopilot.logs.mcap_log import Entry
    from autopilot.logs.reading import LogInfo, LogOptions
    from autopilot.logs.series import Progress, Recording
    from autopilot.vessel.schema import Vessel


KINDS_HELP = """\
a LOG is a .tlog (any MAVLink vehicle, or our own), an ArduPilot .BIN, a PX4 .ulg (extra `ulog`), NMEA 0183 sentences in
text, NMEA 2000 (canboat, also its JSON; candump, Yacht Devices RAW, Actisense, iKonvert), an exported .mcap (extra
`export`), or a CSV table, known by its content. Several logs of one run: FILE+FILE, or FILE+FILE@SECONDS where the
second begins so much later than the first; without @ the offset is found from how the boat turned, or from the dates.
"""


def add_log_options(parser: argparse.ArgumentParser) -> None:
    """Add the options that say how to read logs and where the rudder comes from."""
    group = parser.add_argument_group("reading logs")
    group.add_argument("--columns", metavar="MAP.yaml", help="map of column names in CSV tables")
    group.add_argument(
        "--system", action=SYSTEM_ID, metavar="ID", help="MAVLink system to read (default: most attitudes)"
    )
    group.add_argument(
        "--vessel", metavar="VESSEL.yaml", help="vessel whose steering gear moves a rudder that is known by orders only"
    )
    group.add_argument(
        "--rudder",
        choices=("auto", "measured", "commands", "servo"),
        default="auto",
        help="where the rudder comes from",
    )
    group.add_argument(
        "--rudder-at-full-deg",
        action=number(-90.0, 90.0),
        metavar="DEG",
        help="rudder at full steering (default: the vessel file's)",
    )
    group.add_argument(
        "--servo", metavar="N:MIN:TRIM:MAX", help="the steering servo, if no parameter in the log gives it"
    )
    group.add_argument(
        "--variation-deg",
        action=number(-180.0, 180.0),
        metavar="DEG",
        help="magnetic variation, east positive, for NMEA compasses and NMEA 2000",
    )


def vessel_of(arguments: argparse.Namespace) -> Vessel | None:
    """Return the vessel of `--vessel`, None without one. Raises InputError."""
    return named_vessel(arguments.vessel) if arguments.vessel else None


def refuse_twice(logs: Iterable[str]) -> None:
    """Raise InputError where a file is given more than once, whatever it is called: it would count so many times."""
    from autopilot.logs.merge import sources_of

    seen: dict[Path, str] = {}
    for log in logs:
        for source in sources_of(log):
            file = Path(source.path).resolve()
            if file in seen:
                also = "" if seen[file] == source.path else f", once as {seen[file]}"
                raise InputError(f"{source.path} is given twice{also}; a log counts once, leave one of them out.")
            seen[file] = source.path


def print_newer(logs: Iterable[str]) -> None:
    """Say on standard error which of `logs` an earlier run wrote: `--log` leaves what exists, and takes a new name."""
    for log in logs:
        newer = newer_numbered(Path(log))
        if newer is not None:
            print(f"{log} is read; the newest log of that name is {newer}", file=sys.stderr)


def log_options(arguments: argparse.Namespace, vessel: Vessel | None) -> LogOptions:
    """Return the options as the readers take them; `vessel`: of `--vessel`. Raises InputError."""
    from autopilot.logs.csv_log import load_column_map
    from autopilot.logs.reading import LogOptions, ReadOptions
    from autopilot.logs.table import RudderSettings, servo_from_text

    variation = arguments.variation_deg
    full = arguments.rudder_at_full_deg
    if full is not None and not 1.0 <= abs(full) <= 90.0:
        raise InputError(f"--rudder-at-full-deg {full:g}: allowed is 1 to 90, negative where the servo is reversed")
    reading = ReadOptions(
        load_column_map(arguments.columns) if arguments.columns else None,
        arguments.system,
        None if arguments.servo is None else servo_from_text(arguments.servo),
        None if variation is None else math.radians(variation),
    )
    options = LogOptions(reading, RudderSettings(arguments.rudder, None if full is None else math.radians(full)))
    return options if vessel is None else options.of_vessel(vessel)


ENDINGS = (".mcap", ".parquet", ".csv")


def export(text: str, recording: Recording, options: LogOptions, path: Path, ending: str) -> str:
    """Write the recording of the log `text` to `path` as its `ending` says; return what to say. Raises InputError."""
    if ending not in ENDINGS:
        raise InputError(f"--to {path}: its ending says what it becomes; allowed are {', '.join(ENDINGS)}.")
    if ending == ".mcap":
        from autopilot.cli.terminal import ProgressBar
        from autopilot.logs.mcap_log import write_mcap
        from autopilot.logs.series import duration

        with ProgressBar("writing") as bar:
            entries = _watched(_entries(text, recording), duration(recording), bar.update_share)
            return f"Wrote {write_mcap(path, entries, text)} messages to {path}."
    from autopilot.logs.table import table_of, write_csv, write_parquet

    table = table_of(recording, options.rudder)
    if ending == ".csv":
        return f"Wrote {write_csv(path, table, text)} rows to {path}."
    return f"Wrote {write_parquet(path, table, text, recording.began)} rows to {path}."


def _watched(entries: Iterable[Entry], lasts: float, progress: Progress) -> Iterator[Entry]:
    """Yield the entries, which are in order of time, telling the share of the log's duration [s] that is done."""
    begin = None
    for place, entry in enumerate(entries):
        begin = entry.time if begin is None else begin
        if place % 1000 == 0:
            progress(min(max(round(entry.time - begin), 0), round(lasts)), round(lasts))
        yield entry


def _entries(text: str, recording: Recording) -> Iterator[Entry]:
    """Return the series, and where the log is one .tlog also its messages and, of our own, its ticks."""
    from autopilot.logs.mcap_log import in_order, message_entries, series_entries, tick_entries
    from autopilot.logs.merge import sources_of
    from autopilot.logs.own_log import began_of
    from autopilot.logs.reading import bytes_of, format_of, head_of
    from autopilot.runtime.record import read_log

    entries = series_entries(recording)
    sources = sources_of(text)
    if len(sources) > 1:
        return entries
    path = sources[0].path
    found = format_of(path, head_of(path))
    if found.ticks:
        log = read_log(Path(path))
        entries = in_order([entries, tick_entries(log, began_of(path, log) or 0.0)])
    return in_order([entries, message_entries(bytes_of(path))]) if found.packets else entries


def measures_as_json(source: str, measures: Measures, length: float | None, notes: Sequence[str] = ()) -> str:
    """Return the measures as JSON; SI units and radians, null where a measure is not known. notes: of the log."""
    found = {
        "verdict": verdict_of_trials(measures)._asdict(),
        "source": source,
        "length_m": length,
        "position": measures.position,
        "zigzags": [one._asdict() for one in measures.zigzags],
        "circles": [one._asdict() for one in measures.circles],
        "pull_outs": [one._asdict() for one in measures.pull_outs],
        "spiral": None if measures.spiral is None else measures.spiral._asdict(),
        "notes": list(notes),
    }
    return json_text(found)


def measures_as_text(source: str, measures: Measures, length: float | None, notes: Sequence[str] = ()) -> str:
    """Return the measures for people, each beside its criterion where there is one and `length` [m] is known, and the
    log's notes."""
    remarks = [f"- {printable(note, SENTENCE)}" for note in notes]
    lines = [verdict_of_trials(measures).sentence, "", f"{source}: positions by {measures.position}"]
    blocks = blocks_of(measures, length)
    if not blocks:
        return "\n".join([*lines, *remarks])
    for block in blocks:
        lines += ["", block.title]
        for name, value, criterion in block.rows:
            lines.append(f"  {name:34s} {value:>22s}{'   criterion ' + criterion if criterion else ''}")
    lines += ["", f"({criteria.SHIPS})"]
    if length is None:
        lines.append("Give the boat's length with --length-m to see distances in lengths and all criteria.")
    return "\n".join(lines + remarks)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the `log` subcommand with its actions."""
    parser.description = KINDS_HELP
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
    both = actions.add_parser("compare", help="two runs of Norrbin side by side: which was steered better")
    both.add_argument("log", metavar="LOG", help="a log that `autopilot run --log` wrote")
    both.add_argument("second", metavar="LOG", help="another")
    both.add_argument("--json", action="store_true", help="print JSON")
    both.add_argument("--report", metavar="FILE.html", help="write a page with the figures (extra: norrbin[report])")
    for action in (info, table, exported, measures):
        add_log_options(action)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Read the log and do what was asked; return the exit code."""
    from autopilot.cli.terminal import ProgressBar
    from autopilot.logs.reading import load_recording

    print_newer([arguments.log])
    if arguments.action == "compare":
        return _compare(arguments)
    options = log_options(arguments, vessel_of(arguments))
    if arguments.action in ("csv", "export") and not arguments.overwrite:
        refuse_existing(arguments.to)
    with ProgressBar("reading") as bar:
        recording = load_recording(arguments.log, options.reading._replace(progress=bar.update_share))
    if arguments.action in ("csv", "export"):
        return _rewrite(arguments, recording, options)
    if arguments.action == "measures":
        return _measure(arguments, recording, options)
    from autopilot.logs.reading import info_of

    info = info_of(recording, options.rudder)
    print(as_json(info) if arguments.json else as_text(info))
    return int(ExitCode.OK)


def _compare(arguments: argparse.Namespace) -> int:
    from autopilot.cli.terminal import ProgressBar
    from autopilot.runtime.record import read_logs

    if arguments.report:
        require_extra("without --report", arguments.report)
    refuse_twice([arguments.log, arguments.second])
    paths = [Path(name) for name in (arguments.log, arguments.second)]
    # a name is enough, where both are not alike
    names = [path.name for path in paths] if paths[0].name != paths[1].name else [str(path) for path in paths]
    with ProgressBar("reading") as bar:
        first, second = (
            run_of(name, *(log.ticks for log in read_logs(path, progress=bar.update_share)))
            for name, path in zip(names, paths, strict=True)
        )
    if arguments.json:
        print(json_text(document_of_runs(first, second)))
    else:
        rows = table_of_runs(first, second)
        print(compared(first, second).sentence, "", *aligned(rows, right=range(1, len(rows[0]))), sep="\n")
    if arguments.report:
        save_page(arguments.report, comparison_page(first, second, shlex.join(arguments.typed)))
    return int(ExitCode.OK)


def _rewrite(arguments: argparse.Namespace, recording: Recording, options: LogOptions) -> int:
    ending = ".csv" if arguments.action == "csv" else arguments.to.suffix.lower()
    say = partial(print, file=sys.stderr if is_standard_output(arguments.to) else sys.stdout)  # not into the table
    for note in recording.notes:
        say(note)
    say(export(arguments.log, recording, options, arguments.to, ending))
    return int(ExitCode.OK)


def _measure(arguments: argparse.Namespace, recording: Recording, options: LogOptions) -> int:
    from autopilot.logs.table import table_of

    length = arguments.length_m
    if arguments.report:
        require_extra("without --report", arguments.report)
    record = record_of(arguments.log, table_of(recording, options.rudder).columns)
    measures = measures_of(record)
    shown = measures_as_json if arguments.json else measures_as_text
    print(shown(arguments.log, measures, length, recording.notes))
    if arguments.report:
        page = trials_page(arguments.log, record, measures, length, shlex.join(arguments.typed))
        save_page(arguments.report, page)
    return int(ExitCode.OK)


def as_json(info: LogInfo) -> str:
    """Return the information as JSON; SI units and radians."""
    found = {**info._asdict(), "series": [series._asdict() for series in info.series], "notes": list(info.notes)}
    return json_text(found)


def as_text(info: LogInfo) -> str:
    """Return the information as a table for people."""
    lines = [f"{escaped(info.source)}: {info.kind}, {fixed(info.duration, 1)} s{_date(info.began)}", ""]
    rows = [("quantity", "samples", "Hz", "from s", "to s", "gaps", "longest s", "range")]
    for series in info.series:
        name, factor = _unit_of(series.quantity)
        times = (fixed(series.rate_hz, 1), fixed(series.begins, 1), fixed(series.ends, 1))
        gaps = (f"{series.gaps}", fixed(series.longest_gap, 2))
        spread = f"{series.low * factor:.4g} to {series.high * factor:.4g}"
        rows.append((name, f"{series.samples}", *times, *gaps, spread))
    head, *numbers = aligned(rows, right=range(1, 7))
    lines.append(head)
    for line, series in zip(numbers, info.series, strict=True):
        lines += [line, f"  from {printable(series.source, 60)}"]
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
    for ending, unit in (("_rad_s", "deg/s"), ("_rad", "deg")):
        if quantity.endswith(ending):
            return f"{quantity.removesuffix(ending).replace('_', ' ')} {unit}", 180.0 / math.pi
    for ending, unit in (("_m_s", "m/s"), ("_rps", "1/s")):
        if quantity.endswith(ending):
            return f"{quantity.removesuffix(ending).replace('_', ' ')} {unit}", 1.0
    return f"{quantity.replace('_', ' ')} -", 1.0


def add_replay_options(parser: argparse.ArgumentParser) -> None:
    """Add `autopilot replay`: a log through a fresh pilot, or onto links, to look at."""
    parser.description = (
        "Run the ticks of a log through a fresh pilot and compare every rudder command bit for bit. With "
        "--link the log is played onto links instead, for ground stations, plotters and pages to look at."
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
    parser.set_defaults(run=replay_log)


def replay_log(arguments: argparse.Namespace) -> int:
    """Replay and report; exit code 6 where a command differs."""
    print_newer([str(arguments.log)])
    if arguments.link:
        return _play(arguments)
    from autopilot.cli.terminal import ProgressBar
    from autopilot.runtime.record import replay

    with ProgressBar("replaying") as bar:
        result = replay(arguments.log, bar.update_share)
    if arguments.json:
        print(json_text(result._asdict(), indent=None))
    elif result.identical:
        gap = f"; {result.left_out} behind a gap in the log are left out" if result.left_out else ""
        print(f"{result.ticks} ticks replayed, every command identical{gap}")
    else:
        print(f"tick {result.first_difference}: {result.detail}")
    return int(ExitCode.OK if result.identical else ExitCode.DIFFERENT)


def _play(arguments: argparse.Namespace) -> int:
    from autopilot.interruption import stop_on_signal
    from autopilot.logs.replay_onto import replay_onto
    from autopilot.runtime.machine import MonotonicClock

    clock, signing = MonotonicClock(arguments.speed), signing_of(arguments)
    print(replay_onto(arguments.log, arguments.link, clock, stop_on_signal(), signing))
    return int(ExitCode.OK)
