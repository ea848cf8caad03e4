"""Values of a vehicle written as a firmware file, grouped, every type kept, so that it reads back unchanged."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.params.firmware_file import SCHEMA_VERSION, Number, checksum_of
from autopilot.params.value_coding import type_name
from autopilot.params.vessel_file import number_text, string_text


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
    told = {key: str(getattr(heading, key)) for key in ("description", "source", "date")}
    lines += [f"{key}: {string_text(text)}" for key, text in told.items() if text]
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
