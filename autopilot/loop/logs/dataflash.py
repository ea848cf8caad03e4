"""ArduPilot's DataFlash logs (.BIN), which describe themselves: messages by name, a column for each field.

A record is 0xA3 0x95, a type and the type's payload. Type 128 (FMT) says of a type its number, its length with these
three bytes, its name, a letter for each field and the fields' names. Written from the format's description in
ArduPilot, libraries/AP_Logger/LogStructure.h and README.md; pymavlink's own reader needs mavutil.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.errors import InputError
from autopilot.loop.logs.series import FloatArray

HEAD = b"\xa3\x95"
FMT = 128
FMT_LENGTH = 89
DAMAGED_SHARE = 0.2

NUMBERS = {
    "b": ("i1", 1.0),
    "B": ("u1", 1.0),
    "M": ("u1", 1.0),
    "h": ("<i2", 1.0),
    "H": ("<u2", 1.0),
    "i": ("<i4", 1.0),
    "I": ("<u4", 1.0),
    "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
    "f": ("<f4", 1.0),
    "d": ("<f8", 1.0),
    "g": ("<f2", 1.0),
    "c": ("<i2", 0.01),
    "C": ("<u2", 0.01),
    "e": ("<i4", 0.01),
    "E": ("<u4", 0.01),
    "L": ("<i4", 1.0e-7),
}
"""Letter -> how a number is stored, and what it is multiplied by."""
TEXTS = {"n": "S4", "N": "S16", "Z": "S64", "a": "V64"}


class Layout(NamedTuple):
    """One kind of message: its name, length with the three head bytes, and how its payload is laid out."""

    name: str
    length: int
    letters: str
    labels: tuple[str, ...]
    dtype: np.dtype[np.void]


class DataFlash:
    """The messages of a log. Raises InputError where the file is none, or damaged beyond use.

    Attributes: skipped: bytes that belonged to no message. torn: bytes of a message that the file's end cut off.
    """

    def __init__(self, path: str, data: bytes, wanted: Sequence[str]) -> None:
        self._path = path
        self._lengths = [0] * 256
        self._lengths[FMT] = FMT_LENGTH
        self._wanted = frozenset(wanted)
        self._places: dict[str, list[int]] = {}
        self._kept: dict[str, Layout] = {}
        self._lists: list[list[int] | None] = [None] * 256
        self.skipped = 0
        self.torn = 0
        self._data = np.frombuffer(data, dtype=np.uint8)
        self._walk(data)
        if self.skipped > DAMAGED_SHARE * len(data):
            raise InputError(
                f"{path}: {self.skipped} of {len(data)} bytes belong to no message; the log is damaged beyond use."
            )

    def __contains__(self, name: str) -> bool:
        return bool(self._places.get(name))

    def column(self, name: str, *labels: str) -> FloatArray | None:
        """Return the numbers in the first of the fields `labels` that messages `name` have; None where none has."""
        layout = self._kept.get(name)
        label = next((label for label in labels if layout is not None and label in layout.labels), None)
        if layout is None or label is None or name not in self:
            return None
        letter = layout.letters[layout.labels.index(label)]
        if letter not in NUMBERS:
            raise InputError(f"{self._path}: {name}.{label} is text where a number belongs; it is no log of a vehicle.")
        return np.asarray(self._records(name)[label], dtype=np.float64) * NUMBERS[letter][1]

    def texts(self, name: str, label: str) -> list[str]:
        """Return the texts in a field of messages `name`; none where there are no such."""
        layout = self._kept.get(name)
        if layout is None or name not in self or label not in layout.labels:
            return []
        if layout.letters[layout.labels.index(label)] not in ("n", "N", "Z"):
            raise InputError(f"{self._path}: {name}.{label} is a number where text belongs; it is no log of a vehicle.")
        return [bytes(text).split(b"\0")[0].decode("ascii", "replace") for text in self._records(name)[label]]

    def _records(self, name: str) -> NDArray[np.void]:
        layout = self._kept[name]
        starts = np.asarray(self._places[name])[:, np.newaxis] + 3
        payload = self._data[starts + np.arange(layout.dtype.itemsize)]
        return np.ascontiguousarray(payload).view(layout.dtype)[:, 0]

    def _walk(self, data: bytes) -> None:
        place, end, lengths, lists = 0, len(data), self._lengths, self._lists
        while place + 3 <= end:
            kind = data[place + 2]
            length = lengths[kind] if data[place] == 0xA3 and data[place + 1] == 0x95 else 0
            if not length:
                follows = self._next_start(data, place + 1)
                self.skipped += follows - place
                place = follows
                continue
            if place + length > end:
                break
            if kind == FMT:
                self._define(data, place)
            found = lists[kind]
            if found is not None:
                found.append(place)
            place += length
        self.torn = end - place

    def _next_start(self, data: bytes, place: int) -> int:
        """Return where, from `place` on, a message of a known type begins that another one or the end follows."""
        while True:
            place = data.find(HEAD, place)
            if place < 0 or place + 3 > len(data):
                return len(data)
            length = self._lengths[data[place + 2]]
            behind = data[place + length : place + length + 2]
            if length and (behind == HEAD or place + length == len(data)):
                return place
            place += 1

    def _define(self, data: bytes, place: int) -> None:
        kind, length = data[place + 3], data[place + 4]
        name, letters, labels = (
            data[place + start : place + stop].split(b"\0")[0].decode("ascii", "replace")
            for start, stop in ((5, 9), (9, 25), (25, 89))
        )
        if kind == FMT:
            return
        layout = _layout(name, length, letters, labels)
        if layout is None and name not in self._wanted and length > len(HEAD):
            # a field of a kind that is newer than this reader: its length is all that matters
            self._lengths[kind] = length
            return
        if layout is None:
            raise InputError(
                f"{self._path}: the description of message {(name or kind)!r} at byte {place} does not agree with "
                f"itself (length {length}, format {letters!r}, fields {labels!r}); the log is damaged there."
            )
        self._lengths[kind] = length
        if name in self._wanted:
            if name in self._kept and self._kept[name] != layout:
                raise InputError(f"{self._path}: message {name} is described twice, differently; it holds two logs.")
            self._kept[name] = layout
            self._lists[kind] = self._places.setdefault(name, [])


def _layout(name: str, length: int, letters: str, labels: str) -> Layout | None:
    """Return the layout that a FMT describes, None where it cannot be."""
    names = tuple(labels.split(",")) if labels else ()
    if len(names) != len(letters) or len(set(names)) != len(names) or any(letter not in SIZES for letter in letters):
        return None
    dtype = np.dtype([(label, SIZES[letter]) for label, letter in zip(names, letters, strict=True)])
    return Layout(name, length, letters, names, dtype) if dtype.itemsize + 3 == length else None


SIZES = {**{letter: stored for letter, (stored, _) in NUMBERS.items()}, **TEXTS}
