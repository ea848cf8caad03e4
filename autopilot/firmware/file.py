"""Firmware files: parameters of a flight controller, grouped and commented, read strictly, one built on another.

Values of a vehicle written as a firmware file, grouped, every type kept, so that it reads back unchanged.

And the JSON Schema of vessel and firmware files, made from the typed schema, for editors that complete and check. Draft
7, which is the newest that the editors' YAML language server knows whole. It says what a file may hold; what holds
across fields is checked by reading alone.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import math
import re
import struct
import types
import typing
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal, NamedTuple, Union

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.files import typed
from autopilot.files.strict_yaml import Node, check_version
from autopilot.files.typed import Bounds, hints_of
from autopilot.firmware.protocol import type_name
from autopilot.vessel.file import number_text, string_text
from autopilot.vessel.parameters import counts_of
from autopilot.vessel.schema import SCHEMA_VERSION as VESSEL_VERSION
from autopilot.vessel.schema import Counts, Vessel

SCHEMA_VERSION = 2
NAME_LENGTH_MAX = 16
"""MAVLink's param_id has 16 characters."""
INCLUDE_DEPTH_MAX = 8
FIRMWARE_FILES = typed.Shipped("firmware_params", "firmware", "a shipped firmware file")

_NAME = re.compile(r"[A-Z_][A-Z0-9_]*")

Number = int | float
TypeName = Literal["UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "REAL32"]
FirmwareName = Literal["ardurover", "px4", "norrbin"]
FIRMWARE_NAMES: tuple[str, ...] = typing.get_args(FirmwareName)


@dataclass(frozen=True)
class ParameterEntry:
    """One parameter with more than its value.

    `doc`: why; `unit`, `min`, `max`: as the firmware documents it; `type`: its MAV_PARAM_TYPE; `reboot`: takes
    effect after a reboot; `enables`: brings others into being; `also_named`: its names in other versions.
    """

    value: int | float
    doc: str = ""
    unit: str = ""
    min: int | float | None = None
    max: int | float | None = None
    type: TypeName | None = None
    reboot: bool = False
    enables: bool = False
    also_named: tuple[str, ...] = ()


@dataclass(frozen=True)
class ParameterGroup:
    """Parameters that belong together; each is a number, or a mapping with `value`."""

    parameters: dict[str, int | float | ParameterEntry]
    doc: str = ""


@dataclass(frozen=True)
class FirmwareFile:
    """Parameters to be uploaded to one kind of firmware. `checked_with`: the versions whose names were looked up.

    `include` names shipped files, or files beside this one; what this file gives again overrides them, and
    `leave_out` takes parameters away. As read, `groups` holds all of it.
    `count` and `checksum`: what a backup is held against, that nothing of one that was cut off is written.
    """

    schema_version: int
    firmware: FirmwareName
    frame: str
    groups: dict[str, ParameterGroup] = field(default_factory=dict)
    include: tuple[str, ...] = ()
    leave_out: tuple[str, ...] = ()
    description: str = ""
    checked_with: tuple[str, ...] = ()
    source: str = ""
    date: str = ""
    count: int | None = None
    checksum: str = ""


class Wanted(NamedTuple):
    """One parameter as the file wants it. `names` are tried in order: the first that the vehicle knows counts."""

    names: tuple[str, ...]
    value: Number
    reboot: bool = False
    enables: bool = False
    allowed: str = ""
    """`; documented are 0 to 5 s` where the file knows, for the sentence about a value that was not taken."""

    @property
    def name(self) -> str:
        """Its name in the file."""
        return self.names[0]


def load_firmware(path_or_name: str | Path) -> FirmwareFile:
    """Return the firmware file at a path, or the shipped one of that name (`ardurover-boat`). Raises InputError."""
    return firmware_from(firmware_document(path_or_name))


def firmware_document(path_or_name: str | Path) -> Node:
    """Return the root node of a file, or of the shipped firmware file of that name. Raises InputError."""
    return FIRMWARE_FILES.document(path_or_name)


def shipped_firmware() -> list[str]:
    """Return the names of the firmware files that come with the product."""
    return FIRMWARE_FILES.names()


def firmware_from(root: Node, included_by: tuple[str, ...] = ()) -> FirmwareFile:
    """Return the firmware file that a document holds, with what it includes, all checked. Raises InputError."""
    check_version(root, SCHEMA_VERSION, "firmware file")
    firmware = typed.read(root, FirmwareFile)
    _check_names(root, firmware)
    _check_whole(root, firmware)
    base = _included(root, firmware, (*included_by, root.file))
    groups = _merged(root, firmware, base)
    if not any(group.parameters for group in groups.values()):
        raise root.fault("no group holds a parameter; there is nothing to upload.")
    return dataclasses.replace(firmware, groups=groups)


def wanted_parameters(firmware: FirmwareFile) -> list[Wanted]:
    """Return the parameters in the order of the file."""
    return [
        Wanted((name, *entry.also_named), entry.value, entry.reboot, entry.enables, _allowed(entry))
        for _, name, entry in entries(firmware)
    ]


def entries(firmware: FirmwareFile) -> Iterator[tuple[str, str, ParameterEntry]]:
    """Yield the group, the name and the whole entry of each parameter."""
    for group_name, group in firmware.groups.items():
        for name, value in group.parameters.items():
            yield group_name, name, _entry(value)


def _entry(value: Number | ParameterEntry) -> ParameterEntry:
    return value if isinstance(value, ParameterEntry) else ParameterEntry(value)


def _check_names(root: Node, firmware: FirmwareFile) -> None:
    seen: dict[str, str] = {}
    for group, name, entry in entries(firmware):
        node = root.at("groups", group, "parameters", name)
        for each in (name, *entry.also_named):
            check_name(node, each)
            if each in seen:
                raise node.key_fault(f"{each} is given twice, also in the group {seen[each]}; keep one of them.")
            seen[each] = group


def checksum_of(values: Iterable[tuple[str, Number]]) -> str:
    """Return the CRC-32 of names and values, in whatever order they come, as eight hexadecimal digits."""
    text = "".join(f"{name} {value!r}\n" for name, value in sorted(values))
    return f"crc32 {zlib.crc32(text.encode()):08x}"


def _check_whole(root: Node, firmware: FirmwareFile) -> None:
    """Raise InputError where parameters are missing of the file's own, or are not those that were written."""
    values = [(name, entry.value) for _, name, entry in entries(firmware)]
    changed = "if you changed it on purpose, take count and checksum out."
    if firmware.count is not None and firmware.count != len(values):
        raise root.at("count").fault(
            f"this backup was written with {firmware.count} parameters and holds {len(values)}: it was cut off; "
            f"{changed}"
        )
    if firmware.checksum and firmware.checksum != checksum_of(values):
        raise root.at("checksum").fault(
            f"this backup does not hold the values it was written with: it was cut off or damaged; {changed}"
        )


def _included(root: Node, firmware: FirmwareFile, chain: tuple[str, ...]) -> dict[str, ParameterGroup]:
    node = root.at("include")
    groups: dict[str, dict[str, Number | ParameterEntry]] = {}
    docs: dict[str, str] = {}
    origin: dict[str, str] = {}
    own = {name for _, name, _ in entries(firmware)}
    for name in firmware.include:
        other = _read_included(node, root.file, name, chain)
        if other.firmware != firmware.firmware:
            raise node.fault(f"include: {name} is for {other.firmware}, this file is for {firmware.firmware}.")
        for group, parameter, entry in entries(other):
            if parameter in origin and parameter not in own:
                raise node.fault(
                    f"include: {parameter} is in {origin[parameter]} and in {name}; give the value that counts here."
                )
            origin[parameter] = name
            groups.setdefault(group, {})[parameter] = entry
            docs.setdefault(group, other.groups[group].doc)
    for name in firmware.leave_out:
        if name not in origin:
            near = typed.nearest(name, list(origin))
            hint = f"did you mean {near}?" if near else "no included file has it."
            raise root.at("leave_out").fault(f"leave_out: {name} is not in what this file includes; {hint}")
        for parameters in groups.values():
            parameters.pop(name, None)
    return {name: ParameterGroup(parameters, docs[name]) for name, parameters in groups.items() if parameters}


def _read_included(node: Node, file: str, name: str, chain: tuple[str, ...]) -> FirmwareFile:
    if name not in shipped_firmware():
        name = str(Path(file).parent / name)
    try:
        document = firmware_document(name)
    except InputError as error:
        raise node.fault(f"include: {error}") from None
    if document.file in chain or len(chain) > INCLUDE_DEPTH_MAX:
        way = " -> ".join((*chain, document.file))
        raise node.fault(f"include: the files include each other without end ({way}); take one include out.")
    return firmware_from(document, chain)


def _merged(root: Node, firmware: FirmwareFile, base: dict[str, ParameterGroup]) -> dict[str, ParameterGroup]:
    merged = {name: (dict(group.parameters), group.doc) for name, group in base.items()}
    place = {parameter: name for name, group in base.items() for parameter in group.parameters}
    others = {
        other: parameter
        for group in base.values()
        for parameter, entry in group.parameters.items()
        for other in _entry(entry).also_named
    }
    for group, name, own in entries(firmware):
        node = root.at("groups", group, "parameters", name)
        if name in others:
            raise node.key_fault(f"{name} is another name of {others[name]}, which is included; override that one.")
        target = place.get(name, group)
        parameters, _ = merged.setdefault(target, ({}, ""))
        parameters[name] = _overridden(_entry(parameters[name]), own) if name in parameters else own
        _check_value(node, name, _entry(parameters[name]))
    for group, held in firmware.groups.items():
        if group in merged and held.doc:
            merged[group] = (merged[group][0], held.doc)
    return {name: ParameterGroup(parameters, doc) for name, (parameters, doc) in merged.items() if parameters}


def _overridden(base: ParameterEntry, own: ParameterEntry) -> ParameterEntry:
    given = {
        each.name: getattr(own, each.name)
        for each in dataclasses.fields(own)
        if each.name == "value" or getattr(own, each.name) != each.default
    }
    return dataclasses.replace(base, **given)


def check_name(node: Node, name: str) -> None:
    """Raise InputError where `name` cannot be a parameter's name."""
    if len(name) > NAME_LENGTH_MAX:
        raise node.key_fault(f"{name} has {len(name)} characters, a parameter's name has at most {NAME_LENGTH_MAX}.")
    if not _NAME.fullmatch(name):
        raise node.key_fault(f"{name} is not a parameter's name: capital letters, digits and _ only, no digit first.")


def _check_value(node: Node, name: str, entry: ParameterEntry) -> None:
    node = node.at("value")
    try:
        struct.pack("<f", float(entry.value))
    except OverflowError:
        raise node.fault(
            f"{name} is {entry.value}, which is outside what a 32-bit float holds (about 3.4e38)."
        ) from None
    low, high = entry.min, entry.max
    if (low is not None and entry.value < low) or (high is not None and entry.value > high):
        raise node.fault(f"{name} is {entry.value}{_allowed(entry).replace('; documented', ', allowed')}.")


def _allowed(entry: ParameterEntry) -> str:
    """Return `; documented are 0 to 5 s` from the entry's range, or nothing."""
    unit = f" {entry.unit}" if entry.unit else ""
    if entry.min is not None and entry.max is not None:
        return f"; documented are {entry.min} to {entry.max}{unit}"
    if entry.min is not None:
        return f"; documented are values of at least {entry.min}{unit}"
    return f"; documented are values of at most {entry.max}{unit}" if entry.max is not None else ""


class TypedValue(NamedTuple):
    """A parameter's value and its MAV_PARAM_TYPE, None where it is not known."""

    name: str
    value: Number
    kind: int | None = None


class Heading(NamedTuple):
    """What a firmware file says of itself. is_backup: it also says by how much it would show that it was cut off."""

    firmware: str
    frame: str
    description: str = ""
    source: str = ""
    date: str = ""
    checked_with: tuple[str, ...] = ()
    is_backup: bool = False


def dump_firmware(values: Iterable[TypedValue], heading: Heading) -> str:
    """Return YAML text of `values`, grouped by the part of the name before the first `_`; it reads back unchanged.

    A bare whole number stands for INT32 and one with a point for REAL32; other types are written out. What is
    not a finite number cannot be asked of a vehicle and becomes a comment.
    """
    lines = [
        f"schema_version: {SCHEMA_VERSION}",
        f"firmware: {heading.firmware}",
        f"frame: {string_text(heading.frame)}",
    ]
    texts = {key: str(getattr(heading, key)) for key in ("description", "source", "date")}
    lines += [f"{key}: {string_text(text)}" for key, text in texts.items() if text]
    if heading.checked_with:
        lines.append(f"checked_with: [{', '.join(string_text(version) for version in heading.checked_with)}]")
    values = sorted(values)
    if heading.is_backup:
        kept = [(each.name, each.value) for each in values if math.isfinite(each.value)]
        lines += [f"count: {len(kept)}", f"checksum: {string_text(checksum_of(kept))}"]
    lines.append("groups:")
    groups: dict[str, list[TypedValue]] = {}
    for each in values:
        groups.setdefault(each.name.strip("_").split("_")[0] or "OTHER", []).append(each)
    for group, members in groups.items():
        if any(math.isfinite(each.value) for each in members):
            lines += [f"  {string_text(group)}:", "    parameters:"]
        for each in members:
            line = f"{string_text(each.name)}: {_value_text(each)}"
            lines.append(f"      {line}" if math.isfinite(each.value) else f"      # {line}")
    return "\n".join(lines) + "\n"


def _value_text(each: TypedValue) -> str:
    text = number_text(each.value) if isinstance(each.value, float) else str(each.value)
    if each.kind is None or each.kind == implied_kind(each.value):
        return text
    return f"{{value: {text}, type: {type_name(each.kind)}}}"


def implied_kind(value: Number) -> int:
    """Return the MAV_PARAM_TYPE that a bare number in a firmware file stands for."""
    return int(dialect.MAV_PARAM_TYPE_REAL32 if isinstance(value, float) else dialect.MAV_PARAM_TYPE_INT32)


Schema = dict[str, Any]

KINDS = ("vessel", "firmware")
_SCALARS = {bool: "boolean", int: "integer", float: "number", str: "string"}


def schema_text(kind: str) -> str:
    """Return the JSON Schema of `vessel` or `firmware` files, as it is shipped."""
    root: type[Any] = Vessel if kind == "vessel" else FirmwareFile
    known = VESSEL_VERSION if kind == "vessel" else SCHEMA_VERSION
    schema = {
        "$schema": "http://json-schema.org/draft-07/schema#",
        "title": f"Norrbin {kind} file",
        **_object(root),
    }
    schema["properties"]["schema_version"] = {"const": known}
    return json.dumps(schema, indent=1) + "\n"


def _object(section: type[Any]) -> Schema:
    hints = hints_of(section)
    fields = [field for field in dataclasses.fields(section) if field.init]
    required = [
        field.name
        for field in fields
        if field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
    ]
    counts = counts_of(section)
    properties = {
        field.name: _with_counts(_with_default(_of(hints[field.name], None), field), counts[field.name])
        for field in fields
    }
    described = (inspect.getdoc(section) or "").partition("\n\n")[0].replace("\n", " ")
    schema: Schema = {"type": "object", "description": described, "properties": properties}
    if required:
        schema["required"] = required
    return {**schema, "additionalProperties": False}


def _with_default(schema: Schema, field: dataclasses.Field[Any]) -> Schema:
    is_scalar = isinstance(field.default, bool | int | float | str) and field.default != ""
    return {**schema, "default": field.default} if is_scalar else schema


def _with_counts(schema: Schema, counts: Counts | None) -> Schema:
    """Say beside a field from when on a change counts while the pilot runs."""
    return schema if counts is None else {**schema, "x-counts": counts.value}


def _of(hint: Any, bounds: Bounds | None) -> Schema:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is typing.Annotated:
        return _of(arguments[0], next((extra for extra in arguments[1:] if isinstance(extra, Bounds)), bounds))
    if origin in (Union, types.UnionType):
        return _any_of([_of(member, bounds) for member in arguments])
    if origin is Literal:
        return {"enum": list(arguments), **(_range(bounds) if bounds else {})}
    if origin is tuple:
        return _array(arguments, bounds)
    if origin is dict:
        return {"type": "object", "additionalProperties": _of(arguments[1], bounds)}
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return _object(hint)
    if hint is type(None):
        return {"type": "null"}
    return {"type": _SCALARS[hint], **(_range(bounds) if bounds else {})}


def _any_of(members: list[Schema]) -> Schema:
    """Return one schema for several; a description that all numbers share moves up, where editors show it."""
    description = next((member["description"] for member in members if "description" in member), None)
    return {"anyOf": members, "description": description} if description else {"anyOf": members}


def _array(arguments: tuple[Any, ...], bounds: Bounds | None) -> Schema:
    if arguments[-1] is Ellipsis:
        return {"type": "array", "items": _of(arguments[0], bounds)}
    items = [_of(argument, bounds) for argument in arguments]
    return {"type": "array", "items": items, "additionalItems": False, "minItems": len(items)}


def _range(bounds: Bounds) -> Schema:
    found: Schema = {"description": bounds.doc}
    if bounds.low is not None:
        found["minimum"] = bounds.low
    if bounds.high is not None:
        found["maximum"] = bounds.high
    return found
