"""What `autopilot log` makes of logs: their options, the export, and the manoeuvres in them, measured.

The options are those of every command that reads logs. A manoeuvre's measures stand beside IMO's criteria; the export
is MCAP, Parquet or CSV, by the ending of the file.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from autopilot.cli.options import SYSTEM_ID, number
from autopilot.errors import InputError
from autopilot.files.printable import SENTENCE, printable
from autopilot.files.saving import newer_numbered
from autopilot.identification import trial_measures as criteria
from autopilot.identification.trial_measures import Measures
from autopilot.report.trials import blocks_of

if TYPE_CHECKING:
    from autopilot.logs.export import Entry
    from autopilot.logs.reading import LogOptions
    from autopilot.logs.series import Recording
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
    from autopilot.vessel.file import load_vessel

    return load_vessel(arguments.vessel) if arguments.vessel else None


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
    from autopilot.logs.table import RudderSettings, Servo, ServoScale, servo_from_text
    from autopilot.models.drives.two_thrusters import PLAIN
    from autopilot.runtime.build import gear_of, thrusters_of

    variation = arguments.variation_deg
    full = arguments.rudder_at_full_deg
    if full is not None and not 1.0 <= abs(full) <= 90.0:
        raise InputError(f"--rudder-at-full-deg {full:g}: allowed is 1 to 90, negative where the servo is reversed")
    if full is None and vessel is not None:
        full = vessel.helm.rudder_at_full_pwm_deg or vessel.rudder.angle_max_deg
        full = -full if vessel.helm.reversed else full
    servo: Servo | ServoScale | None = servo_from_text(arguments.servo) if arguments.servo else None
    if servo is None and vessel is not None and vessel.helm.servo_us is not None:
        servo = ServoScale(*vessel.helm.servo_us)
    reading = ReadOptions(
        load_column_map(arguments.columns) if arguments.columns else None,
        arguments.system,
        servo,
        None if variation is None else math.radians(variation),
        PLAIN if vessel is None else thrusters_of(vessel),
    )
    gear = None if vessel is None else gear_of(vessel)
    return LogOptions(reading, RudderSettings(arguments.rudder, None if full is None else math.radians(full), gear))


ENDINGS = (".mcap", ".parquet", ".csv")


def export(text: str, recording: Recording, options: LogOptions, path: Path, ending: str) -> str:
    """Write the recording of the log `text` to `path` as its `ending` says; return what to say. Raises InputError."""
    if ending not in ENDINGS:
        raise InputError(f"--to {path}: its ending says what it becomes; allowed are {', '.join(ENDINGS)}.")
    if ending == ".mcap":
        from autopilot.logs.export import write_mcap

        return f"Wrote {write_mcap(path, _entries(text, recording), text)} messages to {path}."
    from autopilot.logs.export import write_csv, write_parquet
    from autopilot.logs.table import table_of

    table = table_of(recording, options.rudder)
    if ending == ".csv":
        return f"Wrote {write_csv(path, table, text)} rows to {path}."
    return f"Wrote {write_parquet(path, table, text, recording.began)} rows to {path}."


def _entries(text: str, recording: Recording) -> Iterator[Entry]:
    """Return the series, and where the log is one .tlog also its messages and, of our own, its ticks."""
    from autopilot.logs.export import message_entries, series_entries, tick_entries
    from autopilot.logs.merge import sources_of
    from autopilot.logs.own_log import began_of
    from autopilot.logs.reading import bytes_of, format_of
    from autopilot.runtime.record import read_log

    entries = series_entries(recording)
    sources = sources_of(text)
    if len(sources) > 1:
        return entries
    path = sources[0].path
    data = bytes_of(path)
    found = format_of(path, data)
    if found.ticks:
        log = read_log(Path(path))
        entries = chain(entries, tick_entries(log, began_of(path, log) or 0.0))
    return chain(entries, message_entries(data)) if found.packets else entries


NOTHING = (
    "No manoeuvre found: a zigzag needs three executes, a turning circle 180 deg at a held rudder, a pull-out a turn "
    "and then the rudder amidships, a spiral five angles down and up again."
)


def as_json(source: str, measures: Measures, length: float | None, notes: Sequence[str] = ()) -> str:
    """Return the measures as JSON; SI units and radians, null where a measure is not known. notes: of the log."""
    found = {
        "source": source,
        "length_m": length,
        "position": measures.position,
        "zigzags": [one._asdict() for one in measures.zigzags],
        "circles": [one._asdict() for one in measures.circles],
        "pull_outs": [one._asdict() for one in measures.pull_outs],
        "spiral": None if measures.spiral is None else measures.spiral._asdict(),
        "notes": list(notes),
    }
    return json.dumps(_without_nan(found), indent=2)


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _without_nan(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def as_text(source: str, measures: Measures, length: float | None, notes: Sequence[str] = ()) -> str:
    """Return the measures for people, each beside its criterion where there is one and `length` [m] is known, and the
    log's notes."""
    remarks = [f"- {printable(note, SENTENCE)}" for note in notes]
    lines = [f"{source}: positions by {measures.position}"]
    blocks = blocks_of(measures, length)
    if not blocks:
        return "\n".join([*lines, NOTHING, *remarks])
    for block in blocks:
        lines += ["", block.title]
        for name, value, criterion in block.rows:
            lines.append(f"  {name:34s} {value:>22s}{'   criterion ' + criterion if criterion else ''}")
    lines += ["", f"({criteria.SHIPS})"]
    if length is None:
        lines.append("Give the boat's length with --length-m to see distances in lengths and all criteria.")
    return "\n".join(lines + remarks)
