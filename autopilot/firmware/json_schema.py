"""JSON Schema of vessel and firmware files, made from the typed schema, for editors that complete and check.

Draft 7, which is the newest that the editors' YAML language server knows whole. It says what a file may hold; what
holds across fields is checked by reading alone.
"""

from __future__ import annotations

import dataclasses
import inspect
import json
import types
import typing
from typing import Any, Literal, Union

from autopilot.files.typed import Bounds, hints_of
from autopilot.firmware.file import SCHEMA_VERSION as FIRMWARE_VERSION
from autopilot.firmware.file import FirmwareFile
from autopilot.vessel.parameters import counts_of
from autopilot.vessel.schema import SCHEMA_VERSION as VESSEL_VERSION
from autopilot.vessel.schema import Counts, Vessel

Schema = dict[str, Any]

KINDS = ("vessel", "firmware")
_SCALARS = {bool: "boolean", int: "integer", float: "number", str: "string"}


def schema_text(kind: str) -> str:
    """Return the JSON Schema of `vessel` or `firmware` files, as it is shipped."""
    root: type[Any] = Vessel if kind == "vessel" else FirmwareFile
    known = VESSEL_VERSION if kind == "vessel" else FIRMWARE_VERSION
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
        return {"enum": list(arguments)}
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
