"""Group function 126208: what one node asks of another, and how it is acknowledged. Pure.

    0 request: send a group, at an interval     1 command: set fields of a group    2 acknowledge
    3 read fields    4 its reply    5 write fields    6 its reply

Source: fields, codes and their words as in canboat's canboat.json (nmeaRequestGroupFunction and those after it).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from autopilot.links.n2k.fields import LAYOUTS

ASK, COMMAND, ACKNOWLEDGE, READ, WRITE = 0, 1, 2, 3, 5
DONE, UNKNOWN_GROUP, NOT_NOW, DENIED, UNSUPPORTED, NO_READ_OR_WRITE = 0, 1, 2, 3, 4, 6
"""Codes of the group as a whole."""
FIXED_INTERVAL, FIXED_PRIORITY, TOO_OFTEN = 1, 1, 2
"""Codes of the interval, or of the priority, that is asked for."""
NO_SUCH_FIELD, TEMPORARY, OUT_OF_RANGE, FIELD_DENIED, FIELD_UNSUPPORTED = 1, 2, 3, 4, 5
"""Codes of a field."""
AS_IS, AS_BY_DEFAULT = 0xFFFFFFFF, 0xFFFFFFFE
"""Intervals that ask for no change, or for the usual one."""
PRIORITIES_AS_IS = (8, 9, 15)
"""Leave unchanged, the usual one, none given."""


class GroupFunction(NamedTuple):
    """What is asked: kind, group, interval [ms] of a request, priority of a command, number of the fields named.

    pairs: index and bits of the fields of a command whose group is in LAYOUTS; None where they do not fit the data.
    """

    kind: int
    group: int
    interval: int = AS_IS
    priority: int = 8
    named: int = 0
    pairs: tuple[tuple[int, int], ...] | None = None


def group_function(data: bytes) -> GroupFunction | None:
    """Return what a message asks; None where it is too short."""
    if len(data) < 5:
        return None
    kind, group = data[0], int.from_bytes(data[1:4], "little")
    if kind == ASK and len(data) >= 11:
        return GroupFunction(kind, group, int.from_bytes(data[4:8], "little"), named=data[10])
    if kind == COMMAND and len(data) >= 6:
        return GroupFunction(kind, group, priority=data[4] & 15, named=data[5], pairs=_pairs(group, data[5], data[6:]))
    return GroupFunction(kind, group) if kind in (READ, WRITE) else None


def _pairs(group: int, count: int, data: bytes) -> tuple[tuple[int, int], ...] | None:
    """Return index and bits of each field; what is behind one that the group has not cannot be taken apart."""
    layout, found, at = LAYOUTS.get(group), [], 0
    if layout is None:
        return None
    for _ in range(count):
        if at >= len(data) or not 0 < data[at] <= len(layout):
            return None
        bits = layout[data[at] - 1].bits
        end = at + 1 + (bits + 7) // 8
        if end > len(data):
            return None
        found.append((data[at], int.from_bytes(data[at + 1 : end], "little") & (1 << bits) - 1))
        at = end
    return tuple(found)


def acknowledgement(group: int, code: int, other: int = DONE, fields: Sequence[int] = ()) -> bytes:
    """Return the data of an acknowledgement: codes of the group, of interval or priority, and of each field."""
    nibbles = [*fields, *([15] if len(fields) % 2 else [])]
    packed = bytes(low | high << 4 for low, high in zip(nibbles[::2], nibbles[1::2], strict=True))
    return bytes((ACKNOWLEDGE,)) + group.to_bytes(3, "little") + bytes((code | other << 4, len(fields))) + packed
