"""`autopilot params diff`, `verify`, `download` and `backup`: what reads a vehicle and sets nothing.

What became of an upload, and what differs, as tables for people and as JSON for programs.

`check`, `show`, `convert` and `schema` need no vehicle.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.cli.options import patience_of, signing_of
from autopilot.cli.terminal import ProgressBar
from autopilot.errors import ExitCode, InputError, RefusedError
from autopilot.files.printable import SENTENCE, aligned, escaped, json_text, print_file, printable
from autopilot.files.saving import refuse_existing, save_schema, save_text, save_unused
from autopilot.firmware.download import Difference, Download, NamedDownload, differences, flattened
from autopilot.firmware.file import (
    FIRMWARE_NAMES,
    FirmwareFile,
    Heading,
    TypedValue,
    Wanted,
    dump_firmware,
    entries,
    implied_kind,
    schema_text,
)
from autopilot.firmware.foreign_files import (
    SUFFIXES,
    ParameterFile,
    dump_foreign,
    is_foreign,
    load_any,
    load_parameters,
)
from autopilot.firmware.metadata import PX4_WAIT_S, WAIT_S, LeftOut, Marks, MetadataDownload, sentence_of, settings_of
from autopilot.firmware.session import ParameterSession, Vehicle
from autopilot.firmware.upload import Change, Outcome, Upload, Verdict
from autopilot.links.base import LinkError
from autopilot.links.url import SCHEMES
from autopilot.vessel.file import doubted, dump_vessel
from autopilot.vessel.schema import Vessel

YAML_SUFFIXES = (".yaml", ".yml")
NUMBERS = 24
"""Characters, at most, of a cell that stands flush right: names and numbers."""


def check(arguments: argparse.Namespace) -> int:
    """Check every file, also after one that fails, and say everything that is wrong."""
    code = ExitCode.OK
    for file in arguments.files:
        try:
            kind = _kind(file)
        except InputError as error:
            for each in error.each():
                print(f"autopilot: {printable(str(each), SENTENCE)}", file=sys.stderr)
            code = ExitCode.USAGE
        else:
            doubtful = doubted(file, kind) if isinstance(kind, Vessel) else []
            for sentence in doubtful:
                print(f"autopilot: {printable(sentence, SENTENCE)}", file=sys.stderr)
            what = "vessel file" if isinstance(kind, Vessel) else kind
            print(f"{file}: {what}, {f'{len(doubtful)} to be looked at' if doubtful else 'nothing wrong'}")
    return int(code)


def _kind(file: str) -> Vessel | str:
    if is_foreign(file):
        return f"{len(load_parameters(file).values)} parameters"
    content = load_any(file)
    return content if isinstance(content, Vessel) else "firmware file"


def show(arguments: argparse.Namespace) -> int:
    """Print a file as it is understood."""
    if is_foreign(arguments.file):
        _show_values(load_parameters(arguments.file), arguments.json)
        return int(ExitCode.OK)
    content = load_any(arguments.file)
    if arguments.json:
        print(json_text(dataclasses.asdict(content)))
    elif isinstance(content, Vessel):
        print_file(dump_vessel(content))
    else:
        _show_firmware(content)
    return int(ExitCode.OK)


def _show_values(file: ParameterFile, as_json: bool) -> None:
    values = {each.name: each.value for each in file.values}
    if as_json:
        print(json_text(values))
    else:
        print("\n".join(f"{escaped(name):<16}  {value}" for name, value in values.items()))


def _show_firmware(firmware: FirmwareFile) -> None:
    print(f"{firmware.firmware}, {firmware.frame}: {firmware.description}")
    print(f"names checked with {', '.join(firmware.checked_with) or 'no version'}")
    for name, parameters in itertools.groupby(entries(firmware), key=lambda each: each[0]):
        doc = firmware.groups[name].doc
        rows: list[tuple[str, str, str]] = []
        for _, parameter, entry in parameters:
            notes = [entry.doc] if entry.doc else []
            notes += [f"also named {', '.join(entry.also_named)}"] if entry.also_named else []
            notes += ["needs a reboot"] if entry.reboot else []
            rows.append((f"  {parameter:<16}", f"{f'{entry.value} {entry.unit}'.rstrip():<10}", "; ".join(notes)))
        print(f"\n{name}{': ' + doc if doc else ''}", *aligned(rows, has_head=False), sep="\n")


def convert(arguments: argparse.Namespace) -> int:
    """Write the parameters of one file in the format that the other's suffix names."""
    file = load_parameters(arguments.file)
    firmware = _firmware_of(arguments, file)
    heading = Heading(
        firmware, file.frame, source=f"converted from {Path(arguments.file).name}", date=time.strftime("%Y-%m-%d")
    )
    save_text(arguments.out, formatted(arguments.out, file, heading, arguments.system), overwrite=arguments.overwrite)
    print(f"{arguments.out}: {len(file.values)} parameters of {arguments.file}")
    _note_losses(arguments.out, file)
    return int(ExitCode.OK)


def schema(arguments: argparse.Namespace) -> int:
    """Print or write the JSON Schema of one kind of file."""
    text = schema_text(arguments.kind)
    if arguments.out:
        save_schema(arguments.out, text)
        print(f"{arguments.out}: begin your file with '# yaml-language-server: $schema={arguments.out}'")
    else:
        print_file(text)
    return int(ExitCode.OK)


def _firmware_of(arguments: argparse.Namespace, file: ParameterFile) -> str:
    """Return for which firmware the file is: as it says itself, else as the user says; `.parm` is ArduPilot's."""
    if file.firmware and arguments.firmware not in (None, file.firmware):
        raise InputError(f"--firmware {arguments.firmware}: {arguments.file} is for {file.firmware}.")
    if found := file.firmware or arguments.firmware:
        return str(found)
    if Path(arguments.file).suffix.lower() in (".param", ".parm"):
        return "ardurover"
    raise InputError(f"{arguments.file} does not say which firmware it is for; give --firmware ardurover or px4.")


def formatted(out: str | Path, file: ParameterFile, heading: Heading, system: int) -> str:
    """Return the text of a file in the format that the suffix of `out` names; raises InputError for others."""
    suffix = Path(out).suffix.lower()
    if suffix in SUFFIXES:
        return dump_foreign(out, file.values, heading, system)
    if suffix in YAML_SUFFIXES:
        return dump_firmware(file.values, heading)
    raise InputError(f"{out}: the suffix says the format; allowed are {', '.join((*YAML_SUFFIXES, *SUFFIXES))}.")


def _note_losses(out: str, file: ParameterFile) -> None:
    """Say on the error output what the other format could not take along."""
    if file.left_out:
        print(f"autopilot: {file.left_out} parameters of other components than 1 were left out.", file=sys.stderr)
    aliases = [each.name for each in file.wanted if len(each.names) > 1]
    if aliases and is_foreign(out):
        print(
            f"autopilot: {out} has one name for each parameter; other firmware versions call some of them otherwise: "
            f"{', '.join(aliases)}.",
            file=sys.stderr,
        )
    untyped = [each for each in file.values if each.kind is None and isinstance(each.value, int)]
    if untyped and Path(out).suffix.lower() == ".params":
        print(
            f"autopilot: the type of {len(untyped)} whole numbers is not known and given as "
            f"{implied_kind(0)} (INT32), which QGroundControl refuses where it differs; a file that was downloaded "
            "from the vehicle has the types.",
            file=sys.stderr,
        )


class Report(NamedTuple):
    """What is said of an upload besides its outcomes: of which file, where the old values are, what was not written."""

    file: str
    backup: str | None = None
    finished: bool = True
    left_out: tuple[LeftOut, ...] = ()


def upload_table(outcomes: Sequence[Outcome], vehicle: Vehicle, report: Report) -> str:
    """Return the table name, old, wanted, now, verdict, and a summary in words below it."""
    rows = [("name", "old", "wanted", "now", "verdict")]
    for each in outcomes:
        verdict = f"{each.verdict}: {each.reason}" if each.reason else str(each.verdict)
        rows.append((each.name, value_text(each.old), value_text(each.wanted), value_text(each.now), verdict))
    lines = _columns(rows)
    counts = Counter(each.verdict for each in outcomes)
    words = ", ".join(f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict])
    lines += ["", f"{report.file} -> vehicle {vehicle.system} ({vehicle.firmware}): {words or 'nothing'}"]
    if report.left_out:
        lines.append(sentence_of(report.left_out))
    if not report.finished:
        lines.append("NOT FINISHED: the vehicle may hold old and new values.")
    if reboot := _reboot_names(outcomes):
        lines.append(f"takes effect after a reboot of the vehicle: {', '.join(reboot)}")
    if report.backup:
        lines.append(f"old values: {report.backup}")
    return "\n".join(lines)


def settled_table(changes: Sequence[Change], held: Mapping[str, Any]) -> str:
    """Return the table name, old, new, now of an upload that was cut off; `held` is what the vehicle holds now."""
    rows = [("name", "old", "new", "now")]
    rows += [
        (each.name, value_text(each.old), value_text(each.new), value_text(held.get(each.name))) for each in changes
    ]
    return "\n".join(_columns(rows))


def difference_table(found: Sequence[Difference], left: str, right: str) -> str:
    """Return the table name, left, right of everything that differs."""
    rows = [("name", left, right)]
    rows += [(each.name, value_text(each.left), value_text(each.right)) for each in found]
    return "\n".join([*_columns(rows), "", f"{len(found)} differ"])


def _columns(rows: Sequence[tuple[str, ...]]) -> list[str]:
    """Return the rows with the first and the last column flush left, those between flush right but for long texts."""
    numbers = range(1, len(rows[0]) - 1) if all(len(cell) <= NUMBERS for row in rows for cell in row[1:-1]) else ()
    return aligned([tuple(map(escaped, row)) for row in rows], right=numbers)


def upload_json(outcomes: Sequence[Outcome], vehicle: Vehicle, report: Report) -> str:
    """Return the same as a JSON object."""
    document = {
        "file": report.file,
        "vehicle": {"system": vehicle.system, "firmware": vehicle.firmware, "armed": vehicle.armed},
        "finished": report.finished,
        "backup": report.backup,
        "counts": Counter(str(each.verdict) for each in outcomes),
        "reboot": _reboot_names(outcomes),
        "left_out": [{"name": each.name, "why": str(each.why)} for each in report.left_out],
        "parameters": [each._asdict() for each in outcomes],
    }
    return json_text(document)


def _reboot_names(outcomes: Sequence[Outcome]) -> list[str]:
    return [each.name for each in outcomes if each.reboot and each.verdict in (Verdict.SET, Verdict.CONSTRAINED)]


def value_text(value: Any) -> str:
    """Return a value as tables show it: `-` for none, floats with the nine digits that 32 bits have."""
    if value is None:
        return "-"
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def opened_session(arguments: argparse.Namespace, url: str) -> ParameterSession:
    """Return the vehicle at `url`, which may be about to appear. Raises InputError, LinkError."""
    return patience_of(arguments)(lambda: ParameterSession(url, arguments.system, signing_of(arguments)))


def diff(arguments: argparse.Namespace) -> int:
    """Compare a file with another one or with a vehicle."""
    is_link = arguments.other.partition(":")[0] in SCHEMES
    found = _diff_with_link(arguments) if is_link else _diff_files(arguments.file, arguments.other)
    if arguments.json:
        print(json_text([each._asdict() for each in found]))
    elif found:
        print(difference_table(found, arguments.file, arguments.other))
    else:
        print(f"{arguments.file} and {arguments.other} hold the same")
    return int(ExitCode.DIFFERENT if found else ExitCode.OK)


def _diff_files(left: str, right: str) -> list[Difference]:
    vessels = [None if is_foreign(file) else _vessel(file) for file in (left, right)]
    if vessels[0] and vessels[1]:
        return differences(flattened(vessels[0]), flattened(vessels[1]))
    sides = [{each.name: each.value for each in load_parameters(file).values} for file in (left, right)]
    return differences(*sides)


def _vessel(file: str) -> Vessel | None:
    content = load_any(file)
    return content if isinstance(content, Vessel) else None


def _diff_with_link(arguments: argparse.Namespace) -> list[Difference]:
    file = load_parameters(arguments.file, vessel_too=True)
    with opened_session(arguments, arguments.other) as session:
        reading, left = _compared(session, arguments.file, file, calibration=True)
    if left:
        print(f"autopilot: not compared: {sentence_of(left)}", file=sys.stderr)
    outcomes = reading.outcomes()
    return differences({each.name: each.wanted for each in outcomes}, {each.name: each.old for each in outcomes})


def _compared(
    session: ParameterSession, name: str, parameters: ParameterFile, *, calibration: bool
) -> tuple[Upload, list[LeftOut]]:
    """Return an upload that has read and compared all settings and set nothing, and what was not compared."""
    refuse_other_firmware(name, parameters, session.vehicle)
    marks = own_marks(session)
    wanted, left = settings_of(parameters.wanted, session.vehicle.firmware, calibration=calibration, marks=marks)
    reading = Upload(session.vehicle.target, wanted)
    with ProgressBar("reading") as bar:
        session.run(reading, bar.update)
    return reading, left


def own_marks(session: ParameterSession) -> Marks:
    """Return what the vehicle says of its own parameters; where that is nothing usable, one line says so."""
    vehicle = session.vehicle
    client = MetadataDownload(vehicle.target, PX4_WAIT_S if vehicle.firmware == "px4" else WAIT_S)
    with ProgressBar("metadata") as bar:
        session.run(client, bar.update)
    trouble = client.trouble
    if vehicle.firmware == "px4" and not client.is_offered:
        trouble = "it offers no metadata"
    if trouble:
        print(
            f"autopilot: vehicle {vehicle.system} does not say which parameters move by themselves ({trouble}); the "
            "built-in table alone does.",
            file=sys.stderr,
        )
    return client.marks


def refuse_other_firmware(file: str, parameters: ParameterFile, vehicle: Vehicle) -> None:
    """Raise RefusedError where a file is for another firmware than the vehicle's."""
    if parameters.firmware and vehicle.firmware != parameters.firmware:
        raise RefusedError(
            f"{file} is for {parameters.firmware}, but vehicle {vehicle.system} is {vehicle.firmware}; nothing was "
            "sent."
        )


def verify(arguments: argparse.Namespace) -> int:
    """Read every parameter of a file back and compare."""
    file = load_parameters(arguments.file, vessel_too=True)
    with opened_session(arguments, arguments.link) as session:
        reading, left = _compared(session, arguments.file, file, calibration=arguments.with_calibration)
        vehicle = session.vehicle
    outcomes = [
        each._replace(verdict=Verdict.DIFFERENT) if each.verdict is Verdict.WOULD_SET else each
        for each in reading.outcomes()
    ]
    printer = upload_json if arguments.json else upload_table
    print(printer(outcomes, vehicle, Report(arguments.file, left_out=tuple(left))))
    return int(ExitCode.OK if all(each.is_good for each in outcomes) else ExitCode.DIFFERENT)


def download(arguments: argparse.Namespace) -> int:
    """Write a vehicle's parameters into a file."""
    names = [name for name in (arguments.names or "").split(",") if name]
    if not arguments.overwrite:
        refuse_existing(arguments.file)
    formatted(arguments.file, ParameterFile([], []), Heading("ardurover", ""), 1)  # a wrong suffix costs no download
    with opened_session(arguments, arguments.link) as session:
        values = fetched(session, names, arguments.link)
        vehicle = session.vehicle
    save_text(arguments.file, vehicle_text(arguments.file, values, vehicle, arguments.link), overwrite=True)
    print(f"{arguments.file}: {len(values)} parameters of vehicle {vehicle.system} ({vehicle.firmware})")
    return int(ExitCode.OK)


def backup(arguments: argparse.Namespace) -> int:
    """Write all parameters into a dated file that nothing has been written to before."""
    with opened_session(arguments, arguments.link) as session:
        values = fetched(session, [], arguments.link)
        marks = own_marks(session)
        vehicle = session.vehicle
    path = Path(arguments.folder) / f"backup-{time.strftime('%Y%m%dT%H%M%S')}-sys{vehicle.system}.yaml"
    path = save_unused(path, vehicle_text(path, values, vehicle, arguments.link, is_backup=True))
    print(f"{path}: {len(values)} parameters of vehicle {vehicle.system} ({vehicle.firmware})")
    _, left = settings_of((Wanted((each.name,), each.value) for each in values), vehicle.firmware, marks=marks)
    if left:
        print(f"a restore leaves {sentence_of(left).replace(' left', '', 1)}")
    return int(ExitCode.OK)


def fetched(session: ParameterSession, names: list[str], link: str) -> list[TypedValue]:
    """Return all parameters of the vehicle, or those named; raises where not every one came."""
    vehicle = session.vehicle
    if vehicle.firmware not in FIRMWARE_NAMES:
        known = ", ".join(FIRMWARE_NAMES)
        raise RefusedError(f"vehicle {vehicle.system} is {vehicle.firmware}; firmware files are for {known}.")
    client = NamedDownload(vehicle.target, names) if names else Download(vehicle.target)
    with ProgressBar("downloading") as bar:
        session.run(client, bar.update)
    _refuse_incomplete(client, link)
    if isinstance(client, Download) and client.hash_agrees is not None:
        words = "agrees" if client.hash_agrees else "differs, as it does where the vehicle has volatile parameters"
        print(f"autopilot: PX4's checksum of the whole table {words}", file=sys.stderr)
    return [TypedValue(name, value.value, value.kind) for name, value in client.values.items()]


def vehicle_text(
    path: str | Path, values: list[TypedValue], vehicle: Vehicle, link: str, *, is_backup: bool = False
) -> str:
    """Return the text of a file with a vehicle's parameters in the format of its suffix."""
    heading = Heading(
        vehicle.firmware,
        "boat" if vehicle.kind == dialect.MAV_TYPE_SURFACE_BOAT else "rover",
        description=f"Parameters of vehicle {vehicle.system}",
        source=f"downloaded over {link}",
        date=time.strftime("%Y-%m-%d %H:%M:%S %z"),
        is_backup=is_backup,
    )
    return formatted(path, ParameterFile([], values), heading, vehicle.system)


def _refuse_incomplete(client: Any, link: str) -> None:
    if isinstance(client, NamedDownload):
        if client.unknown:
            raise InputError(f"the vehicle has no parameter {', '.join(client.unknown)}; nothing was written.")
        return
    have, count = client.progress
    if not count:
        raise LinkError(f"link {link!r}: the vehicle sends no parameters; wait until it has started, and try again.")
    if client.missing:
        raise LinkError(f"link {link!r}: only {have} of {count} parameters came; nothing was written, try again.")
