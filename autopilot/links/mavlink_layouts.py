"""How the payloads of messages are read and written: pymavlink's own tables, looked up once for each kind."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.extra_messages import EXTRA_MESSAGES

PART = re.compile(r"(\d*)([A-Za-z])")
"""One field of a struct's format: how many, of which kind."""
KNOWN: dict[int, type[Any]] = {**EXTRA_MESSAGES, **dialect.mavlink_map}


class Layout(NamedTuple):
    """How the payload of one message is read: pymavlink's own tables, looked up once. Texts of ours come as bytes."""

    kind: type[Any]
    unpack: Callable[[bytes], tuple[float, ...]]
    size: int
    crc_extra: bytes
    names: tuple[str, ...]
    blank: dict[str, Any]


def _layout(kind: type[Any]) -> Layout | None:
    has_arrays = any(kind.array_lengths) or "char" in kind.fieldtypes
    if dialect.mcrf4xx is None or (has_arrays and kind.id not in EXTRA_MESSAGES):
        return None
    blank = dict(vars(kind(*[0] * len(kind.fieldnames))))
    extra = bytes([kind.crc_extra])
    names = tuple(kind.ordered_fieldnames)
    return Layout(kind, kind.unpacker.unpack, kind.unpacker.size, extra, names, blank)


class Writer(NamedTuple):
    """How the payload of one message is written; `values` returns what `pack` takes."""

    pack: Callable[..., bytes]
    values: Callable[[Any], Sequence[Any]]
    crc_extra: bytes


def _writer(kind: type[Any]) -> Writer | None:
    """Return how messages of a kind are written: bytes and texts in one piece. None for arrays of other numbers."""
    if dialect.mcrf4xx is None:
        return None
    shape, names, arrays = "<", [], []
    fields = PART.findall(kind.unpacker.format)
    for place, (name, (count, letter)) in enumerate(zip(kind.ordered_fieldnames, fields, strict=True)):
        if count and letter not in "Bs":
            return None
        if count and letter == "B":
            arrays.append(place)
        shape += f"{count}s" if count else letter
        names.append(f"_{name}_raw" if letter in "cs" else name)
    return Writer(struct.Struct(shape).pack, _values(names, arrays), bytes([kind.crc_extra]))


def _values(names: Sequence[str], arrays: Sequence[int]) -> Callable[[Any], Sequence[Any]]:
    """Return what reads the attributes `names`, those at the places `arrays` as bytes."""
    read = attrgetter(*names) if len(names) > 1 else lambda message: (getattr(message, names[0]),)
    if not arrays:
        return read

    def with_bytes(message: Any) -> list[Any]:
        values = list(read(message))
        for place in arrays:
            values[place] = bytes(values[place])
        return values

    return with_bytes


_writers: dict[type[Any], Writer | None] = {}
_layouts: dict[int, Layout | None] = {}


def writer_of(kind: type[Any]) -> Writer | None:
    """Return how messages of the class `kind` are written; None where that is left to the class itself."""
    try:
        return _writers[kind]
    except KeyError:
        # our own messages, and classes derived from the dialect's, pack their fields in a way of their own
        writer = _writers[kind] = _writer(kind) if dialect.mavlink_map.get(kind.id) is kind else None
        return writer


def layout_of(identity: int) -> Layout | None:
    """Return the layout of the message `identity`; None where it has arrays and pymavlink knows it."""
    try:
        return _layouts[identity]
    except KeyError:
        layout = _layouts[identity] = _layout(KNOWN[identity])
        return layout
