"""NMEA 2000 messages that canboat has decoded, a JSON object a line: its analyser's, and those of canboatjs.

    {"timestamp":"2016-02-28T19:57:02.364Z","prio":2,"src":7,"dst":255,"pgn":127250,"fields":{"Heading":151.0,...}}

The fields have canboat's names or its identifiers (Heading, heading), words as such or as {"value": 0, "name": "True"}.
Angles are in degrees where the first line says "units":"std", in radians where it says "si". Without that line, as
canboatjs writes radians, they are degrees if a heading, course or wind angle is beyond a full turn of radians.
Positions are in degrees.

Source: canboat, analyzer/analyzer.c and print.c; canboatjs.
"""

from __future__ import annotations

import functools
import math
import re
from array import array
from collections.abc import Iterator, Sequence
from itertools import compress
from typing import Any, NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.files.outside import parse_json
from autopilot.links.n2k.packets import LAYOUTS
from autopilot.links.n2k.samples import INSTRUMENTS
from autopilot.logs.n2k_text import BAD_SHARE, LOOK_AT, Message, dashed, recording_of
from autopilot.logs.series import (
    EPOCH_FROM,
    LogFormat,
    Progress,
    Recording,
    counted_on,
    lines_in,
    silent,
    stamp_of,
    without_outliers,
)

LINE_MOST = 65536
GROUP = re.compile(rb'"pgn"\s*:\s*(\d{1,6})\b')
BRACED = re.compile(rb"\s*(\{.*\}\s*)?")
"""A line that may be an object of JSON, or is blank."""
UNITS = re.compile(rb'"units"\s*:\s*"(std|si)"')
PLACES = ("latitude", "longitude")
TURNING = ("heading", "cog", "windAngle")
"""Angles from 0 to a full turn, which distinguish degrees from radians."""
IN_RADIANS = {
    field.name
    for group in INSTRUMENTS
    for field in LAYOUTS[group]
    if not field.words and field.unit in (1.0e-4, 3.125e-8) and field.name not in ("time",)
}


class Written(NamedTuple):
    """What a message says: its parameter group, the address of its source, its fields as they are written."""

    group: int
    source: int
    names: tuple[str, ...]
    values: tuple[object, ...]


def is_n2k_json(data: bytes) -> bool:
    """Return whether a file begins with such lines."""
    head = data[:LOOK_AT]
    return head.lstrip()[:1] == b"{" and GROUP.search(head) is not None and b'"fields"' in head


def read_n2k_json(path: str, data: bytes, variation: float | None = None, progress: Progress = silent) -> Recording:
    """Return the recording in such lines. variation [rad], east positive. Raises InputError."""
    messages: list[Written] = []
    stamps, are_of_day = array("d"), array("b")
    names: dict[tuple[str, ...], tuple[str, ...]] = {}
    good = bad = 0
    for line in lines_in(data, progress):
        group = GROUP.search(line)
        if group is None:
            bad += not BRACED.fullmatch(line)
            continue
        if int(group[1]) not in INSTRUMENTS:
            good += 1
            continue
        message = _message(line, int(group[1]))
        if message is None:
            bad += 1
            continue
        good += 1
        stamp = stamp_of(dashed(message[0]))
        stamps.append(math.nan if stamp is None else stamp[0])
        are_of_day.append(stamp is not None and stamp[1])
        messages.append(message[1]._replace(names=names.setdefault(message[1].names, message[1].names)))
    if bad > BAD_SHARE * (good + bad):
        raise InputError(f"{path}: {bad} of {good + bad} lines are no messages of canboat's; it is damaged.")
    every = np.asarray(stamps)
    kept = np.isfinite(every)
    if not kept.any():
        raise InputError(f"{path}: holds no message with a time stamp of those that are read.")
    kept[kept] = without_outliers(every[kept])
    messages = list(compress(messages, kept))
    bad += every.size - len(messages)
    is_of_day = bool(np.asarray(are_of_day)[kept].all())
    time = counted_on(path, every[kept], is_of_day, "message")
    factor, notes = _radians(path, data, messages)
    if bad:
        notes.append(f"{path}: {bad} of {good + bad} lines are damaged and left out.")

    def among(*groups: int) -> Iterator[Message]:
        for when, (group, source, names, values) in zip(map(float, time), messages, strict=True):
            if not groups or group in groups:
                yield Message(when, group, source, _si(names, values, factor))

    is_dated = not is_of_day and bool(time[-1] > EPOCH_FROM)
    found = recording_of(path, "NMEA 2000 (canboat JSON)", among, variation, is_dated)
    return found._replace(notes=(*notes, *found.notes))


def _message(line: bytes, group: int) -> tuple[str, Written] | None:
    """Return the time stamp of a line, and what it says; None where it is damaged."""
    try:
        content = parse_json(line, "a line", LINE_MOST)
    except InputError:
        return None
    if not isinstance(content, dict) or content.get("pgn") != group:
        return None
    stamp, source, fields = content.get("timestamp"), content.get("src"), content.get("fields")
    if not isinstance(stamp, str) or not isinstance(source, int) or not isinstance(fields, dict):
        return None
    said = {_identifier(name): _plain(value) for name, value in fields.items()}
    return stamp, Written(group, source, tuple(said), tuple(said.values()))


@functools.lru_cache
def _identifier(name: str) -> str:
    """Return canboat's identifier of a field from its name: "Speed Water Referenced" is speedWaterReferenced."""
    words = name.split()
    if not words:
        return ""
    first = words[0].lower() if words[0].isupper() else words[0][:1].lower() + words[0][1:]
    return first + "".join(each[:1].upper() + each[1:] for each in words[1:])


def _plain(value: Any) -> object:
    return value.get("name", value.get("value")) if isinstance(value, dict) else value


def _radians(path: str, data: bytes, messages: list[Written]) -> tuple[float, list[str]]:
    """Return what angles are to be multiplied by, and a note where that was found by their size."""
    stated = UNITS.search(data[:LOOK_AT])
    if stated is not None:
        return (math.radians(1.0) if stated[1] == b"std" else 1.0), []
    fields = (field for each in messages for field in zip(each.names, each.values, strict=True))
    largest = max(
        (abs(value) for name, value in fields if name in TURNING and isinstance(value, int | float)), default=0.0
    )
    if largest > 1.001 * math.tau:
        return math.radians(1.0), [f"{path}: does not say its units; its angles are taken for degrees."]
    return 1.0, [f"{path}: does not say its units; its angles are taken for radians."]


def _si(names: Sequence[str], values: Sequence[object], factor: float) -> dict[str, object]:
    found: dict[str, object] = {}
    for name, value in zip(names, values, strict=True):
        if isinstance(value, int | float) and not isinstance(value, bool):
            number = float(value)
            number *= math.radians(1.0) if name in PLACES else factor if name in IN_RADIANS else 1.0
            found[name] = number
        elif name not in ("date", "time"):
            found[name] = value
    return found


FORMAT = LogFormat(
    "",
    is_n2k_json,
    lambda path, data, options: read_n2k_json(path, data, options.variation, options.progress),
    is_text=True,
)
