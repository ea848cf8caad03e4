"""MCAP files (mcap.dev): the series of a log as `export` writes them, and what else is in the file by its topics.

A channel `/log/<quantity>/<source>` with the schema norrbin.Sample holds JSON {"value": number or null}, in SI units
and radians, at its log time. The MAVLink messages and ticks beside them are what the series were made of.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator
from io import BytesIO
from typing import Any

from autopilot.errors import InputError
from autopilot.files.outside import parse_json
from autopilot.files.printable import printable
from autopilot.logs.export import EXTRA
from autopilot.logs.series import (
    EPOCH_FROM,
    HEADING,
    LATITUDE,
    LONGITUDE,
    ORDER,
    PROPELLER,
    RATE,
    ROLL,
    RUDDER,
    SHARE,
    SPEED,
    WIND_DIRECTION,
    WIND_SPEED,
    LogFormat,
    Recording,
    Series,
    on_one_clock,
    series_of,
)

HEAD = b"\x89MCAP0\r\n"
SAMPLE = "norrbin.Sample"
QUANTITIES = (
    HEADING,
    RATE,
    ROLL,
    SPEED,
    RUDDER,
    ORDER,
    SHARE,
    LATITUDE,
    LONGITUDE,
    PROPELLER,
    WIND_SPEED,
    WIND_DIRECTION,
)
CHUNK_MOST = 64 << 20
"""Bytes that a chunk may unpack to; writers make them of 1 to 4 MB."""
MESSAGE_MOST = 4096
NAMED_MOST = 8


def read_mcap(path: str, data: bytes) -> Recording:
    """Return the recording in an exported file. Raises InputError, also without the extra."""
    try:
        import mcap.records as kinds
    except ModuleNotFoundError:
        raise InputError(f"{path}: reading MCAP needs mcap; install it with {EXTRA}.") from None
    schemas: dict[int, str] = {}
    topics: dict[int, tuple[str, str, str]] = {}
    found: defaultdict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    damage, broken = "", 0
    records = _records(data)
    while True:
        try:
            record = next(records, None)
        except Exception as error:
            # the package raises what struct, the unpackers and its own classes raise
            damage = str(error) or type(error).__name__
            break
        if record is None:
            break
        if isinstance(record, kinds.Schema):
            schemas[record.id] = record.name
        elif isinstance(record, kinds.Channel):
            topics[record.id] = (record.topic, schemas.get(record.schema_id, "no schema"), record.message_encoding)
        elif isinstance(record, kinds.Message) and (named := _series(topics.get(record.channel_id))) is not None:
            value = _value(record.data)
            if value is None:
                broken += 1
            elif not math.isnan(value):
                found[named].append((1.0e-9 * record.log_time, value))
    notes = _notes(path, topics, damage, broken)
    if not found:
        raise InputError(_nothing(path, topics, damage))
    series: list[Series] = []
    for (quantity, source), pairs in found.items():
        series += series_of(quantity, source, [time for time, _ in pairs], [value for _, value in pairs])
    is_dated = max(float(each.time[-1]) for each in series) > EPOCH_FROM
    return on_one_clock(Recording(path, "MCAP", tuple(series), 0.0 if is_dated else None, notes))


def _records(data: bytes) -> Iterator[Any]:
    """Yield the records of a file, those of a chunk unpacked to what it announces and no more than CHUNK_MOST."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    for record in StreamReader(BytesIO(data), emit_chunks=True, record_size_limit=len(data)).records:
        if not isinstance(record, Chunk):
            yield record
            continue
        if record.uncompressed_size > CHUNK_MOST:
            raise ValueError(f"a chunk of {record.uncompressed_size} bytes")
        record.data = _unpacked(record.compression, record.data, record.uncompressed_size + 1)
        record.compression = ""
        if len(record.data) != record.uncompressed_size:
            raise ValueError(f"a chunk that does not unpack to its {record.uncompressed_size} bytes")
        yield from breakup_chunk(record, validate_crc=True)


def _unpacked(compression: str, data: bytes, most: int) -> bytes:
    if compression == "zstd":
        import zstandard

        return bytes(zstandard.ZstdDecompressor().stream_reader(data).read(most))
    if compression == "lz4":
        import lz4.frame

        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, most))
    if compression:
        raise ValueError(f"packed by {printable(compression)}, which is not known")
    return data


def _series(channel: tuple[str, str, str] | None) -> tuple[str, str] | None:
    """Return quantity and source of a channel that is read, None of another."""
    if channel is None or channel[1:] != (SAMPLE, "json"):
        return None
    parts = channel[0].split("/", 3)
    is_ours = len(parts) == 4 and parts[:2] == ["", "log"] and parts[2] in QUANTITIES
    return (parts[2], parts[3]) if is_ours else None


def _value(data: bytes) -> float | None:
    """Return the number in a message, nan where it is null; None where the message is none of ours."""
    try:
        content = parse_json(data, "a message", MESSAGE_MOST)
    except InputError:
        return None
    value = content.get("value", "") if isinstance(content, dict) else ""
    if value is None:
        return math.nan
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else None


def _notes(path: str, topics: dict[int, tuple[str, str, str]], damage: str, broken: int) -> tuple[str, ...]:
    notes = []
    if damage:
        notes.append(f"{path}: is damaged or cut off ({printable(damage)}); what comes before that is read.")
    if broken:
        notes.append(f"{path}: {broken} samples are no numbers and are left out.")
    others = [each for each in topics.values() if _series(each) is None]
    if others:
        notes.append(f"{path}: of {len(others)} other topics nothing is read: {_names(others)}.")
    return tuple(notes)


def _nothing(path: str, topics: dict[int, tuple[str, str, str]], damage: str) -> str:
    if not topics:
        return f"{path}: is an MCAP file without topics" + (f", damaged ({printable(damage)})." if damage else ".")
    return (
        f"{path}: is an MCAP file without /log topics of {SAMPLE}, which alone are read; its topics are "
        f"{_names(list(topics.values()))}. Write heading, rudder and speed of these as a CSV table."
    )


def _names(channels: list[tuple[str, str, str]]) -> str:
    named = [f"{printable(topic)} ({printable(schema)}, {printable(form)})" for topic, schema, form in channels]
    more = f" and {len(named) - NAMED_MOST} more" if len(named) > NAMED_MOST else ""
    return ", ".join(named[:NAMED_MOST]) + more


FORMAT = LogFormat(
    "an exported .mcap",
    lambda data: data.startswith(HEAD),
    lambda path, data, options: read_mcap(path, data),
    ".mcap",
    "is no MCAP file, or its beginning is lost.",
)
