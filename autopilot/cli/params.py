"""`autopilot params`: check and show parameter files, upload them to a flight controller, download from it."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from autopilot.errors import ExitCode, InputError, RefusedError

if TYPE_CHECKING:
    from autopilot.params.firmware_file import FirmwareFile
    from autopilot.params.session import Vehicle
    from autopilot.params.upload import Upload
    from autopilot.params.vessel import Vessel


def add_parser(subparsers: Any) -> None:
    """Add the `params` subcommand with its own subcommands."""
    parser = subparsers.add_parser(
        "params",
        help="check, show, upload and download parameter files",
        description="Vessel files describe a boat to Norrbin; firmware files hold parameters of a flight controller. "
        "FILE is a path or the name of a shipped file, such as lanxin or ardurover-boat.",
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    check = actions.add_parser("check", help="read files strictly and say what is wrong with them")
    check.add_argument("files", nargs="+", metavar="FILE")
    check.set_defaults(run=_check)
    show = actions.add_parser("show", help="print a file with every default filled in and every number explained")
    show.add_argument("file", metavar="FILE")
    show.add_argument("--json", action="store_true", help="print JSON")
    show.set_defaults(run=_show)
    _add_upload(actions)
    _add_download(actions)


def _add_link_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--link", required=True, metavar="URL", help="udpin:127.0.0.1:14550, serial:/dev/ttyUSB0:57600")
    parser.add_argument(
        "--system", type=_system_id, metavar="N", help="the vehicle's system id where several are heard"
    )


def _add_upload(actions: Any) -> None:
    upload = actions.add_parser(
        "upload",
        help="write a firmware file to a flight controller and read every value back",
        description="Reads what the vehicle holds, sets what differs, reads all of it back and compares. "
        "Exit code 6 when a parameter does not hold the value wanted (with --dry-run: before the upload).",
    )
    upload.add_argument("file", metavar="FILE")
    _add_link_options(upload)
    upload.add_argument("--dry-run", action="store_true", help="only read and compare; nothing is set")
    upload.add_argument("--json", action="store_true", help="print JSON")
    upload.add_argument("--backup", metavar="FILE", help="where the old values go (default: a dated file here)")
    upload.add_argument("--no-backup", action="store_true", help="keep no old values")
    upload.set_defaults(run=_upload)


def _add_download(actions: Any) -> None:
    download = actions.add_parser("download", help="write a flight controller's parameters into a firmware file")
    download.add_argument("file", metavar="FILE")
    _add_link_options(download)
    download.add_argument("--names", metavar="A,B,...", help="only these parameters (default: all)")
    download.add_argument("--overwrite", action="store_true", help="replace FILE where it exists")
    download.set_defaults(run=_download)


def _system_id(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 255:
        raise argparse.ArgumentTypeError(f"{text} is not a system id; allowed are 1 to 255")
    return int(text)


def _check(arguments: argparse.Namespace) -> int:
    """Check every file, also after one that fails."""
    import sys

    from autopilot.params.any_file import load_any
    from autopilot.params.vessel import Vessel

    code = ExitCode.OK
    for file in arguments.files:
        try:
            content = load_any(file)
        except InputError as error:
            print(f"autopilot: {error}", file=sys.stderr)
            code = ExitCode.USAGE
        else:
            print(f"{file}: {'vessel' if isinstance(content, Vessel) else 'firmware'} file, nothing wrong")
    return int(code)


def _show(arguments: argparse.Namespace) -> int:
    import dataclasses
    import json

    from autopilot.params.any_file import load_any
    from autopilot.params.vessel import Vessel
    from autopilot.params.vessel_file import dump_vessel

    content: Vessel | FirmwareFile = load_any(arguments.file)
    if arguments.json:
        print(json.dumps(dataclasses.asdict(content), indent=2))
    elif isinstance(content, Vessel):
        print(dump_vessel(content), end="")
    else:
        _show_firmware(content)
    return int(ExitCode.OK)


def _show_firmware(firmware: FirmwareFile) -> None:
    from autopilot.params.firmware_file import ParameterEntry

    print(f"{firmware.firmware}, {firmware.frame}: {firmware.description}")
    print(f"names checked with {', '.join(firmware.checked_with) or 'no version'}")
    for name, group in firmware.groups.items():
        print(f"\n{name}{': ' + group.doc if group.doc else ''}")
        for parameter, given in group.parameters.items():
            entry = given if isinstance(given, ParameterEntry) else ParameterEntry(given)
            notes = [entry.doc] if entry.doc else []
            notes += [f"also named {', '.join(entry.also_named)}"] if entry.also_named else []
            notes += ["needs a reboot"] if entry.reboot else []
            print(f"  {parameter:<16}  {entry.value:<10}  {'; '.join(notes)}".rstrip())


def _upload(arguments: argparse.Namespace) -> int:
    from autopilot.cli.progress import ProgressBar
    from autopilot.params.firmware_file import wanted_parameters
    from autopilot.params.session import ParameterSession
    from autopilot.params.upload import Upload

    firmware = _uploadable(arguments.file)
    wanted = wanted_parameters(firmware)
    with ParameterSession(arguments.link, arguments.system) as session:
        _refuse_other_firmware(arguments.file, firmware, session.vehicle)
        upload = Upload(session.vehicle.target, wanted)
        with ProgressBar("reading") as bar:
            session.run(upload, bar.show)
        if arguments.dry_run or not upload.differs:
            return _report(arguments, session.vehicle, upload, None)
        backup = _back_up(arguments, session.vehicle, firmware, upload)
        upload.proceed()
        try:
            with ProgressBar("uploading") as bar:
                session.run(upload, bar.show)
        finally:  # whatever ends it, what is known to be set is said
            code = _report(arguments, session.vehicle, upload, backup)
    return code


def _uploadable(file: str) -> FirmwareFile:
    from autopilot.params.any_file import load_any
    from autopilot.params.vessel import Vessel

    content: Vessel | FirmwareFile = load_any(file)
    if isinstance(content, Vessel):
        raise InputError(
            f"{file} is a vessel file, which Norrbin reads itself (autopilot run {file}); only firmware files can be "
            "uploaded to a flight controller, and a running Norrbin takes no upload in this version."
        )
    return content


def _refuse_other_firmware(file: str, firmware: FirmwareFile, vehicle: Vehicle) -> None:
    import sys

    if vehicle.firmware != firmware.firmware:
        raise RefusedError(
            f"{file} is for {firmware.firmware}, but vehicle {vehicle.system} is {vehicle.firmware}; nothing was sent."
        )
    if vehicle.armed:
        print(f"autopilot: vehicle {vehicle.system} is armed; parameters take effect at once.", file=sys.stderr)


def _back_up(arguments: argparse.Namespace, vehicle: Vehicle, firmware: FirmwareFile, upload: Upload) -> str | None:
    """Save the old values before anything changes; a backup that cannot be written stops the upload."""
    import time
    from pathlib import Path

    from autopilot.params.firmware_file import dump_firmware
    from autopilot.params.saving import save_text

    if arguments.no_backup:
        return None
    stamp = time.strftime("%Y%m%dT%H%M%S")
    path = arguments.backup or f"{Path(arguments.file).stem}.before-{stamp}-sys{vehicle.system}.yaml"
    text = dump_firmware(
        {outcome.name: outcome.old for outcome in upload.outcomes() if outcome.old is not None},
        firmware.firmware,
        firmware.frame,
        description=f"Values of vehicle {vehicle.system} before the upload of {arguments.file}",
        source=f"read back over {arguments.link}",
        date=time.strftime("%Y-%m-%d %H:%M:%S %z"),
    )
    save_text(path, text)
    return str(path)


def _report(arguments: argparse.Namespace, vehicle: Vehicle, upload: Upload, backup: str | None) -> int:
    """Print what became of every parameter and return the exit code."""
    from autopilot.cli.params_report import upload_json, upload_table
    from autopilot.params.upload import GOOD

    outcomes = upload.outcomes()
    printer = upload_json if arguments.json else upload_table
    print(printer(outcomes, arguments.file, vehicle, backup, finished=upload.finished))
    return int(ExitCode.OK if all(outcome.verdict in GOOD for outcome in outcomes) else ExitCode.DIFFERENT)


def _download(arguments: argparse.Namespace) -> int:
    import time
    from pathlib import Path

    from autopilot.cli.progress import ProgressBar
    from autopilot.params.firmware_file import dump_firmware
    from autopilot.params.protocol import Download, NamedDownload
    from autopilot.params.saving import save_text
    from autopilot.params.session import ParameterSession

    names = [name for name in (arguments.names or "").split(",") if name]
    if Path(arguments.file).exists() and not arguments.overwrite:
        raise InputError(f"{arguments.file}: exists already; give another name, or --overwrite to replace it.")
    with ParameterSession(arguments.link, arguments.system) as session:
        vehicle = session.vehicle
        if vehicle.firmware not in ("ardurover", "px4"):
            raise RefusedError(f"vehicle {vehicle.system} is {vehicle.firmware}; firmware files are for these two.")
        client = NamedDownload(vehicle.target, names) if names else Download(vehicle.target)
        with ProgressBar("downloading") as bar:
            session.run(client, bar.show)
    _refuse_incomplete(client, arguments.link)
    text = dump_firmware(
        {name: value.value for name, value in client.values.items()},
        vehicle.firmware,
        "boat" if vehicle.kind == _surface_boat() else "rover",
        description=f"Parameters of vehicle {vehicle.system}",
        source=f"downloaded over {arguments.link}",
        date=time.strftime("%Y-%m-%d %H:%M:%S %z"),
    )
    save_text(arguments.file, text, overwrite=arguments.overwrite)
    print(f"{arguments.file}: {len(client.values)} parameters of vehicle {vehicle.system} ({vehicle.firmware})")
    return int(ExitCode.OK)


def _surface_boat() -> int:
    from pymavlink.dialects.v20 import ardupilotmega as dialect

    return int(dialect.MAV_TYPE_SURFACE_BOAT)


def _refuse_incomplete(client: Any, link: str) -> None:
    from autopilot.links.base import LinkError
    from autopilot.params.protocol import NamedDownload

    if isinstance(client, NamedDownload):
        if client.unknown:
            raise InputError(f"the vehicle has no parameter {', '.join(client.unknown)}; nothing was written.")
        return
    have, count = client.progress
    if not count:
        raise LinkError(f"link {link!r}: the vehicle sends no parameters; wait until it has started, and try again.")
    if client.missing:
        raise LinkError(f"link {link!r}: only {have} of {count} parameters came; nothing was written, try again.")
