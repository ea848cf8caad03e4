"""Firmware files: parameters of a flight controller, grouped and commented, read strictly and written back."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Literal, NamedTuple

from autopilot.errors import InputError
from autopilot.params import schema
from autopilot.params.strict_yaml import Node, parse_document, read_document
from autopilot.params.vessel_file import check_schema_version, number_text, string_text

SCHEMA_VERSION = 1
NAME_LENGTH_MAX = 16
"""MAVLink's param_id has 16 characters."""

_NAME = re.compile(r"[A-Z_][A-Z0-9_]*")

Number = int | float


@dataclass(frozen=True)
class ParameterEntry:
    """One parameter with more than its value: why, whether a reboot is needed, its names in other versions."""

    value: int | float
    doc: str = ""
    reboot: bool = False
    also_named: tuple[str, ...] = ()


@dataclass(frozen=True)
class ParameterGroup:
    """Parameters that belong together; each is a number, or a mapping with `value`."""

    parameters: dict[str, int | float | ParameterEntry]
    doc: str = ""


@dataclass(frozen=True)
class FirmwareFile:
    """Parameters to be uploaded to one kind of firmware. `checked_with`: the versions whose names were looked up."""

    schema_version: int
    firmware: Literal["ardurover", "px4"]
    frame: str
    groups: dict[str, ParameterGroup]
    description: str = ""
    checked_with: tuple[str, ...] = ()
    source: str = ""
    date: str = ""


class Wanted(NamedTuple):
    """One parameter as the file wants it. `names` are tried in order: the first that the vehicle knows counts."""

    names: tuple[str, ...]
    value: Number
    reboot: bool = False

    @property
    def name(self) -> str:
        """Its name in the file."""
        return self.names[0]


def load_firmware(path_or_name: str | Path) -> FirmwareFile:
    """Return the firmware file at a path, or the shipped one of that name (`ardurover-boat`). Raises InputError."""
    return firmware_from(firmware_document(path_or_name))


def firmware_document(path_or_name: str | Path) -> Node:
    """Return the root node of a file, or of the shipped firmware file of that name. Raises InputError."""
    path = Path(path_or_name)
    if path.exists() or path.suffix or path.name != str(path_or_name):
        return read_document(path)
    shipped = shipped_firmware()
    name = str(path_or_name)
    if name not in shipped:
        near = schema.nearest(name, shipped)
        hint = f"did you mean {near}?" if near else f"shipped are {', '.join(shipped)}."
        raise InputError(f"{name}: neither a file nor a shipped firmware file; {hint}")
    text = (resources.files("firmware_params") / "firmware" / f"{name}.yaml").read_text(encoding="utf-8")
    return parse_document(text, f"{name}.yaml (shipped)")


def shipped_firmware() -> list[str]:
    """Return the names of the firmware files that come with the product."""
    folder = resources.files("firmware_params") / "firmware"
    names = (entry.name for entry in folder.iterdir())
    return sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml"))


def firmware_from(root: Node) -> FirmwareFile:
    """Return the firmware file that a document holds, every name and value checked. Raises InputError."""
    check_schema_version(root, SCHEMA_VERSION)
    firmware = schema.read(root, FirmwareFile)
    seen: dict[str, str] = {}
    for group, name, entry in _entries(firmware):
        node = root.at("groups", group, "parameters", name)
        for each in (name, *entry.also_named):
            _check_name(node, each)
            if each in seen:
                raise node.key_fault(f"{each} is given twice, also in the group {seen[each]}; keep one of them.")
            seen[each] = group
        _check_value(node, name, entry.value)
    if not seen:
        raise root.fault("no group holds a parameter; there is nothing to upload.")
    return firmware


def wanted_parameters(firmware: FirmwareFile) -> list[Wanted]:
    """Return the parameters in the order of the file."""
    return [Wanted((name, *entry.also_named), entry.value, entry.reboot) for _, name, entry in _entries(firmware)]


def _entries(firmware: FirmwareFile) -> Iterator[tuple[str, str, ParameterEntry]]:
    for group_name, group in firmware.groups.items():
        for name, value in group.parameters.items():
            yield group_name, name, value if isinstance(value, ParameterEntry) else ParameterEntry(value)


def _check_name(node: Node, name: str) -> None:
    if len(name) > NAME_LENGTH_MAX:
        raise node.key_fault(f"{name} has {len(name)} characters, a parameter's name has at most {NAME_LENGTH_MAX}.")
    if not _NAME.fullmatch(name):
        raise node.key_fault(f"{name} is not a parameter's name: capital letters, digits and _ only, no digit first.")


def _check_value(node: Node, name: str, value: Number) -> None:
    try:
        struct.pack("<f", value)
    except OverflowError:
        raise node.fault(f"{name} is {value}, which is outside what a 32-bit float holds (about 3.4e38).") from None


def dump_firmware(
    values: Mapping[str, Number],
    firmware: str,
    frame: str,
    *,
    description: str = "",
    source: str = "",
    date: str = "",
    checked_with: tuple[str, ...] = (),
) -> str:
    """Return YAML text of `values`, grouped by the part of the name before the first `_`; it reads back unchanged."""
    lines = [f"schema_version: {SCHEMA_VERSION}", f"firmware: {firmware}", f"frame: {string_text(frame)}"]
    for key, text in (("description", description), ("source", source), ("date", date)):
        if text:
            lines.append(f"{key}: {string_text(text)}")
    if checked_with:
        lines.append(f"checked_with: [{', '.join(string_text(version) for version in checked_with)}]")
    lines.append("groups:")
    groups: dict[str, list[str]] = {}
    for name in sorted(values):
        groups.setdefault(name.strip("_").split("_")[0] or "OTHER", []).append(name)
    for group, names in groups.items():
        lines += [f"  {string_text(group)}:", "    parameters:"]
        lines += [f"      {string_text(name)}: {_value_text(values[name])}" for name in names]
    return "\n".join(lines) + "\n"


def _value_text(value: Number) -> str:
    return number_text(value) if isinstance(value, float) else str(value)
