"""`autopilot params diff`, `verify`, `download` and `backup`: what reads a vehicle and sets nothing."""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.cli.params_files import formatted
from autopilot.cli.params_report import Report, difference_table, upload_json, upload_table
from autopilot.cli.progress import ProgressBar
from autopilot.cli.signing import signing_of
from autopilot.cli.waiting import patience_of
from autopilot.errors import ExitCode, InputError, RefusedError
from autopilot.links.base import LinkError
from autopilot.links.url import SCHEMES
from autopilot.params.any_file import ParameterFile, load_any, load_parameters
from autopilot.params.comparison import Difference, differences, flattened
from autopilot.params.download import Download, NamedDownload
from autopilot.params.firmware_dump import Heading, TypedValue
from autopilot.params.firmware_file import FIRMWARE_NAMES, Wanted
from autopilot.params.firmware_owned import LeftOut, Marks, sentence_of, settings_of
from autopilot.params.foreign_files import is_foreign
from autopilot.params.outcome import Verdict
from autopilot.params.saving import refuse_existing, save_text, save_unused
from autopilot.params.session import ParameterSession, Vehicle
from autopilot.params.upload import Upload
from autopilot.params.vehicle_metadata import PX4_WAIT_S, WAIT_S, MetadataDownload
from autopilot.params.vessel import Vessel


def opened_session(arguments: argparse.Namespace, url: str) -> ParameterSession:
    """Return the vehicle at `url`, which may be about to appear. Raises InputError, LinkError."""
    return patience_of(arguments)(lambda: ParameterSession(url, arguments.system, signing_of(arguments)))


def diff(arguments: argparse.Namespace) -> int:
    """Compare a file with another one or with a vehicle."""
    is_link = arguments.other.partition(":")[0] in SCHEMES
    found = _diff_with_link(arguments) if is_link else _diff_files(arguments.file, arguments.other)
    if arguments.json:
        print(json.dumps([each._asdict() for each in found], indent=2))
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
    with opened_session(arguments, arguments.other) as session:
        reading, left = _compared(session, arguments.file, calibration=True)
    if left:
        print(f"autopilot: not compared: {sentence_of(left)}", file=sys.stderr)
    outcomes = reading.outcomes()
    return differences({each.name: each.wanted for each in outcomes}, {each.name: each.old for each in outcomes})


def _compared(session: ParameterSession, file: str, *, calibration: bool) -> tuple[Upload, list[LeftOut]]:
    """Return an upload that has read and compared all settings and set nothing, and what was not compared."""
    parameters = load_parameters(file, vessel_too=True)
    refuse_other_firmware(file, parameters, session.vehicle)
    marks = own_marks(session)
    wanted, left = settings_of(parameters.wanted, session.vehicle.firmware, calibration=calibration, marks=marks)
    reading = Upload(session.vehicle.target, wanted)
    with ProgressBar("reading") as bar:
        session.run(reading, bar.show)
    return reading, left


def own_marks(session: ParameterSession) -> Marks:
    """Return what the vehicle says of its own parameters; where that is nothing usable, one line says so."""
    vehicle = session.vehicle
    client = MetadataDownload(vehicle.target, PX4_WAIT_S if vehicle.firmware == "px4" else WAIT_S)
    with ProgressBar("metadata") as bar:
        session.run(client, bar.show)
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
    with opened_session(arguments, arguments.link) as session:
        reading, left = _compared(session, arguments.file, calibration=arguments.with_calibration)
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
        session.run(client, bar.show)
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
