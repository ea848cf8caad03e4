"""Two sets of parameters side by side: what differs, and what only one of them has."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any, NamedTuple

from autopilot.params.value_coding import as_float32


class Difference(NamedTuple):
    """A name whose values differ; None where a side does not have it."""

    name: str
    left: Any
    right: Any


def differences(left: Mapping[str, Any], right: Mapping[str, Any]) -> list[Difference]:
    """Return what differs, in the order of `left` and then of `right`; numbers are compared as 32-bit floats."""
    names = [*left, *(name for name in right if name not in left)]
    pairs = [Difference(name, left.get(name), right.get(name)) for name in names]
    return [pair for pair in pairs if not _same(pair.left, pair.right)]


def _same(left: Any, right: Any) -> bool:
    if isinstance(left, int) and isinstance(right, int):
        return left == right
    if isinstance(left, int | float) and isinstance(right, int | float):
        return as_float32(left) == as_float32(right)
    return bool(left == right)


def flattened(section: Any, path: str = "") -> dict[str, Any]:
    """Return the fields of nested dataclasses by their dotted path, as the keys of a vessel file are quoted."""
    flat: dict[str, Any] = {}
    for field in dataclasses.fields(section):
        value = getattr(section, field.name)
        name = f"{path}.{field.name}" if path else field.name
        if dataclasses.is_dataclass(value):
            flat.update(flattened(value, name))
        else:
            flat[name] = value
    return flat
