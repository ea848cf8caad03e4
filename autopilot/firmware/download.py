"""Download of a vehicle's parameters: the whole table in one pass, or those named.

No clock and no I/O, as in `protocol`. Source of PX4's checksum: PX4's param_hash_check, which NuttX's crc32part feeds.

Two sets of parameters side by side: what differs, and what only one of them has.
"""

from __future__ import annotations

import dataclasses
import struct
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

from autopilot.firmware.protocol import (
    NO_INDEX,
    PATIENCE,
    LinkQuality,
    Message,
    Number,
    ParameterValue,
    Requests,
    Target,
    as_float32,
    controls,
    encode,
    is_from,
    parameter_value,
    read_by_index,
    read_by_name,
    refused_name,
    request_list,
)

HASH_NAME = "_HASH_CHECK"
"""PX4 adds it to every list; it is a checksum, not a parameter."""


def table_hash(values: Iterable[ParameterValue]) -> int:
    """Return PX4's checksum of a table: CRC-32 without inversions over each name and the four bytes of its value."""
    crc = 0
    for each in sorted(values):
        raw = struct.pack("<f", each.value) if isinstance(each.value, float) else encode(each.value, each.kind, True)
        crc = zlib.crc32(each.name.encode() + raw, crc ^ 0xFFFFFFFF) ^ 0xFFFFFFFF
    return crc


class Download:
    """Fetches the whole table: the list first, then what was lost, by index and a few at a time.

    Give `receive` every message and send what `due` returns, until `finished`. `values` holds what came, by
    name; `missing` the indices that never came (empty, or the download has failed).
    """

    QUIET_S = 0.8
    """A list that has paused this long has ended, and what is missing is asked for."""
    LIST_TRIES = 8
    SMALLER_TO_ACCEPT = 20
    """So many packets in a row must tell of a smaller table before it counts."""
    RESTARTS_MAX = 3
    """A vehicle whose table changes under our hands is read again, this often."""
    ROUNDS = 8
    """So often what stands at two places is asked for again: of one answer in five at a wrong one nothing is left."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self._by_index: dict[int, ParameterValue] = {}
        self._count = 0
        self._list_tries = 0
        self._last_news: float | None = None
        self._gaps: Requests[int] | None = None
        self._restarts = self._rounds = 0
        self._smaller_in_a_row = 0
        self._hash: Number | None = None
        self.finished = False

    @property
    def hash_agrees(self) -> bool | None:
        """Whether all values together have the checksum that PX4 gave; None where none was given.

        PX4 leaves its volatile parameters out, so that a table with such does not agree though nothing is wrong.
        """
        return None if self._hash is None else self._hash == table_hash(self.values.values())

    @property
    def values(self) -> dict[str, ParameterValue]:
        """What has come so far, by name, in the vehicle's order."""
        return {value.name: value for _, value in sorted(self._by_index.items())}

    @property
    def missing(self) -> list[int]:
        """Indices that have not come."""
        return [index for index in range(self._count) if index not in self._by_index]

    @property
    def progress(self) -> tuple[int, int]:
        """How many came, of how many (0 while not known)."""
        return len(self._by_index), self._count

    def receive(self, now: float, message: Message) -> None:
        """Take any message; those that are not the target's PARAM_VALUE are ignored."""
        value = parameter_value(message, self._target)
        if value is None or self.finished:
            return
        if value.name == HASH_NAME:
            self._hash = value.value
            return
        if value.position == NO_INDEX:
            self.update(value)
            return
        if not value.position < value.table_size:
            return
        if self._is_of_old_table(value):
            return
        if self._has_changed(value):
            self._restart()
        self._count = value.table_size
        if value.position not in self._by_index:
            self._last_news = now
        self._by_index[value.position] = value
        if self._gaps is not None:
            self._gaps.answered(value.position, now)
        if len(self._by_index) == self._count:
            self._end()

    def _end(self) -> None:
        """Finish, unless a name stands at two places of the table: one of them is another's, and both are asked for."""
        often = Counter(value.name for value in self._by_index.values())
        doubled = [index for index, value in self._by_index.items() if often[value.name] > 1]
        for index in doubled:
            del self._by_index[index]
        self.finished = not doubled or self._rounds == self.ROUNDS
        if not self.finished:
            self._rounds += 1
            self._gaps = Requests(self.missing, PATIENCE)

    def update(self, value: ParameterValue) -> None:
        """Somebody set a parameter meanwhile: the newer value counts."""
        for index, known in self._by_index.items():
            if known.name == value.name:
                self._by_index[index] = known._replace(value=value.value)
                return

    def _is_of_old_table(self, value: ParameterValue) -> bool:
        """Tables grow when a parameter enables others; packets of the smaller table may still be under way."""
        if value.table_size >= self._count:
            self._smaller_in_a_row = 0
            return False
        self._smaller_in_a_row += 1
        return self._smaller_in_a_row < self.SMALLER_TO_ACCEPT

    def _has_changed(self, value: ParameterValue) -> bool:
        known = self._by_index.get(value.position)
        changed = (self._count not in (0, value.table_size)) or (known is not None and known.name != value.name)
        return changed and self._restarts < self.RESTARTS_MAX

    def _restart(self) -> None:
        self._restarts += 1
        self._by_index.clear()
        self._gaps = None
        self._list_tries = 0
        self._last_news = None

    def due(self, now: float) -> list[Message]:
        """Return the messages to send now."""
        if self.finished:
            return []
        if self._gaps is None:
            return self._list_due(now)
        messages = [read_by_index(self._target, index) for index in self._gaps.due(now)]
        if self._gaps.done:
            self._end()
        return messages

    def _list_due(self, now: float) -> list[Message]:
        if self._last_news is not None and now - self._last_news < self.QUIET_S:
            return []
        if self._count:
            self._gaps = Requests(self.missing, PATIENCE)
            return self.due(now)
        if self._list_tries >= self.LIST_TRIES:
            self.finished = True
            return []
        self._list_tries += 1
        self._last_news = now
        return [request_list(self._target)]


class NamedDownload:
    """Fetches the parameters named. `values` by name; `unknown` the names that stayed unanswered."""

    def __init__(self, target: Target, names: Sequence[str]) -> None:
        self._target = target
        self._names = set(names)
        self._quality = LinkQuality()
        self._requests: Requests[str] = Requests(names, PATIENCE, self._quality)
        self.values: dict[str, ParameterValue] = {}

    @property
    def finished(self) -> bool:
        """Whether every name is answered or given up."""
        return self._requests.done

    @property
    def unknown(self) -> list[str]:
        """Names that the vehicle never answered, or said that it does not have."""
        return list(self._requests.given_up)

    @property
    def progress(self) -> tuple[int, int]:
        """How many names are settled, of how many."""
        return len(self.values) + len(self._requests.given_up), len(self._names)

    def receive(self, now: float, message: Message) -> None:
        """Take any message; those that are not the target's PARAM_VALUE of a name wanted are ignored."""
        if is_from(message, self._target):
            self._quality.on_packet(now)
        if (refused := refused_name(message, self._target)) is not None:
            self._requests.refused(refused)
        value = parameter_value(message, self._target)
        if value is not None and value.position == 0:
            self._quality.control_answered()
        if value is not None and value.name in self._names:
            self.values[value.name] = value
            self._requests.answered(value.name, now)

    def due(self, now: float) -> list[Message]:
        """Return the messages to send now."""
        names = self._requests.due(now)
        return [read_by_name(self._target, name) for name in names] + controls(
            self._target, self._quality, self._requests.repeats(names)
        )


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
