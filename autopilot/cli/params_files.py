"""`autopilot params check`, `show` and `convert`: what needs no vehicle."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import time
from pathlib import Path

from autopilot.errors import ExitCode, InputError
from autopilot.files.printable import SENTENCE, escaped, printable
from autopilot.files.saving import save_schema, save_text
from autopilot.firmware.file import FirmwareFile, Heading, dump_firmware, entries, implied_kind
from autopilot.firmware.foreign_files import (
    SUFFIXES,
    ParameterFile,
    dump_foreign,
    is_foreign,
    load_any,
    load_parameters,
)
from autopilot.vessel.file import doubted, dump_vessel
from autopilot.vessel.schema import Vessel

YAML_SUFFIXES = (".yaml", ".yml")


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
        print(json.dumps(dataclasses.asdict(content), indent=2))
    elif isinstance(content, Vessel):
        print(dump_vessel(content), end="")
    else:
        _show_firmware(content)
    return int(ExitCode.OK)


def _show_values(file: ParameterFile, as_json: bool) -> None:
    values = {each.name: each.value for each in file.values}
    if as_json:
        print(json.dumps(values, indent=2))
    else:
        print("\n".join(f"{escaped(name):<16}  {value}" for name, value in values.items()))


def _show_firmware(firmware: FirmwareFile) -> None:
    print(f"{firmware.firmware}, {firmware.frame}: {firmware.description}")
    print(f"names checked with {', '.join(firmware.checked_with) or 'no version'}")
    group = None
    for name, parameter, entry in entries(firmware):
        if name != group:
            group, doc = name, firmware.groups[name].doc
            print(f"\n{name}{': ' + doc if doc else ''}")
        notes = [entry.doc] if entry.doc else []
        notes += [f"also named {', '.join(entry.also_named)}"] if entry.also_named else []
        notes += ["needs a reboot"] if entry.reboot else []
        value = f"{entry.value} {entry.unit}".rstrip()
        print(f"  {parameter:<16}  {value:<10}  {'; '.join(notes)}".rstrip())


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
    from autopilot.firmware.json_schema import schema_text

    text = schema_text(arguments.kind)
    if arguments.out:
        save_schema(arguments.out, text)
        print(f"{arguments.out}: begin your file with '# yaml-language-server: $schema={arguments.out}'")
    else:
        print(text, end="")
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
