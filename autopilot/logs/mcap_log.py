"""MCAP files (mcap.dev), which Foxglove and PlotJuggler open, written and read: JSON messages, each channel with its
JSON schema.

Channels: `/log/<quantity>/<source>` with the schema norrbin.Sample for every series, {"value": number or null} in SI
units and radians, at its log time, which is what is read; `/mavlink/<system>/<component>/<MESSAGE>` for every message
of a .tlog, fields as they travelled; `/norrbin/tick` for every tick of a log of ours.
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
import math
import re
import struct
from collections.abc import Iterable, Iterator
from heapq import merge
from pathlib import Path
from typing import Any, NamedTuple

from autopilot.errors import InputError
from autopilot.files.outside import parse_json
from autopilot.files.printable import printable
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.frames import TlogPackets
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
    CountedBytes,
    Gathered,
    LogFormat,
    Progress,
    Recording,
    Series,
    on_one_clock,
    series_of,
    silent,
)
from autopilot.logs.table import EXTRA, save
from autopilot.runtime.record import PAYLOAD_TYPE, Log
from autopilot.signals import Tick
from autopilot.supervision.panel import sentences_of

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


def read_mcap(path: str, data: bytes, progress: Progress = silent) -> Recording:
    """Return the recording in an exported file. Raises InputError, also without the extra."""
    try:
        import mcap.records as kinds
    except ModuleNotFoundError:
        raise InputError(f"{path}: reading MCAP needs mcap; install it with {EXTRA}.") from None
    schemas: dict[int, str] = {}
    topics: dict[int, tuple[str, str, str]] = {}
    found = Gathered[tuple[str, str]]()
    damage, broken = "", 0
    records = _records(data, progress)
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
                found.put(named, 1.0e-9 * record.log_time, value)
    notes = _notes(path, topics, damage, broken)
    if not found:
        raise InputError(_nothing(path, topics, damage))
    series = [one for key, pairs in found.items() for one in series_of(*key, *pairs)]
    is_dated = max(float(each.time[-1]) for each in series) > EPOCH_FROM
    return on_one_clock(Recording(path, "MCAP", tuple(series), 0.0 if is_dated else None, notes))


def _records(data: bytes, progress: Progress) -> Iterator[Any]:
    """Yield the records of a file, those of a chunk unpacked to what it announces and no more than CHUNK_MOST; of a
    last chunk that is cut off those that are whole, before what is raised."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, get_chunk_data_stream

    file = CountedBytes(data, progress)
    records = iter(StreamReader(file, emit_chunks=True, record_size_limit=len(data)).records)
    while True:
        begins = file.tell()
        try:
            record = next(records, None)
        except Exception:
            yield from _whole_in_torn(data, max(begins, len(HEAD)))
            raise
        if record is None:
            return
        if not isinstance(record, Chunk):
            yield record
            continue
        if record.uncompressed_size > CHUNK_MOST:
            raise ValueError(f"a chunk of {record.uncompressed_size} bytes")
        record.data = _unpacked(record.compression, record.data, record.uncompressed_size + 1)
        record.compression = ""
        if len(record.data) != record.uncompressed_size:
            raise ValueError(f"a chunk that does not unpack to its {record.uncompressed_size} bytes")
        get_chunk_data_stream(record, validate_crc=True)
        yield from _records_in(record.data)


CHUNK, LAST_KNOWN = 6, 15
"""Opcodes: of a chunk, and the last one that the format gives a meaning."""
RECORD_HEAD, CHUNK_HEAD = struct.Struct("<BQ"), struct.Struct("<BQQQQII")
"""Opcode and length of what follows; of a chunk also time of first and last message, size and checksum unpacked, length
of the packing's name, which stands before the length of the records and these."""


def _whole_in_torn(data: bytes, begins: int) -> Iterator[Any]:
    """Yield the records that are whole in a chunk that begins there, or behind records of unknown kinds, and that the
    file's end cuts off, before that is raised; nothing where there is none."""
    while len(data) >= begins + RECORD_HEAD.size and data[begins] > LAST_KNOWN:
        begins += RECORD_HEAD.size + RECORD_HEAD.unpack_from(data, begins)[1]
    if len(data) < begins + CHUNK_HEAD.size or data[begins] != CHUNK:
        return
    _, length, _, _, size, _, named = CHUNK_HEAD.unpack_from(data, begins)
    name, missing = begins + CHUNK_HEAD.size, begins + RECORD_HEAD.size + length - len(data)
    if missing <= 0 or size > CHUNK_MOST:
        return
    # of what is damaged, too, a reader raises what it likes
    with contextlib.suppress(Exception):
        yield from _records_in(_unpacked(data[name : name + named].decode(), data[name + named + 8 :], size))
    raise ValueError(f"of a chunk of {length} bytes the last {missing} are missing")


def _records_in(chunk: bytes) -> Iterator[Any]:
    """Yield the records in an unpacked chunk one at a time: all of them together take ten times as much. Those of kinds
    that no chunk has are passed over."""
    from mcap.data_stream import ReadDataStream
    from mcap.opcode import Opcode
    from mcap.records import Channel, Message, Schema

    at = 0
    while at < len(chunk):
        kind, length = RECORD_HEAD.unpack_from(chunk, at)
        begins, at = at + RECORD_HEAD.size, at + RECORD_HEAD.size + length
        if at > len(chunk):
            raise ValueError("a record that goes beyond its chunk")
        content = ReadDataStream(io.BytesIO(chunk[begins:at]))
        if kind == Opcode.MESSAGE:
            yield Message.read(content, length)
        elif kind in (Opcode.CHANNEL, Opcode.SCHEMA):
            yield (Channel if kind == Opcode.CHANNEL else Schema).read(content)


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


MCAP_LATEST_S = 1.8e10
NUMBER = {"type": ["number", "null"]}
TEXT = {"type": "string"}
VALUE = {"value": NUMBER}
TICK: dict[str, Any] = {
    **dict.fromkeys(("heading_rad", "yaw_rate_rad_s", "speed_m_s", "rudder_rad", "rudder_bias_rad"), NUMBER),
    **dict.fromkeys(("reference_heading_rad", "order_heading_rad", "rudder_order_rad", "heading_age_s"), NUMBER),
    "mode": TEXT,
    "engaged": {"type": "boolean"},
    "alarms": {"type": "array", "items": TEXT},
}
TOGETHER = 4096
"""Samples of a series that are made numbers of Python at a time."""
NAMED = ("NAMED_VALUE_FLOAT", "NAMED_VALUE_INT", "DEBUG_VECT")


class Entry(NamedTuple):
    """One message: its channel, the properties of its schema, when [s since 1970], and what it says."""

    topic: str
    kind: str
    properties: dict[str, Any]
    time: float
    content: dict[str, Any]


def write_mcap(path: Path, entries: Iterable[Entry], source: str) -> int:
    """Write messages in any order; return how many. Raises InputError, also without the extra."""
    try:
        from mcap.writer import Writer
    except ModuleNotFoundError:
        raise InputError(f"{path}: writing MCAP needs mcap; install it with {EXTRA}.") from None
    count = 0

    def write(new: Path) -> None:
        nonlocal count
        with new.open("wb") as file:
            writer = Writer(file)
            writer.start(profile="", library="norrbin")
            writer.add_metadata("log", {"source": source})
            schemas: dict[str, int] = {}
            channels: dict[str, int] = {}
            for entry in entries:
                if entry.topic not in channels:
                    if entry.kind not in schemas:
                        schema = {"title": entry.kind, "type": "object", "properties": entry.properties}
                        schemas[entry.kind] = writer.register_schema(
                            entry.kind, "jsonschema", json.dumps(schema).encode()
                        )
                    channels[entry.topic] = writer.register_channel(entry.topic, "json", schemas[entry.kind])
                when = _nanoseconds(entry.time)
                data = json.dumps(entry.content, allow_nan=False, separators=(",", ":")).encode()
                writer.add_message(channels[entry.topic], when, data, when)
                count += 1
            writer.finish()

    save(path, write)
    return count


def series_entries(recording: Recording) -> Iterator[Entry]:
    """Yield every sample of all series, in order of time; on a clock from zero where the log does not tell the date."""
    return in_order([_entries_of(series, recording.began or 0.0) for series in recording.series])


def _entries_of(series: Series, began: float) -> Iterator[Entry]:
    topic = f"/log/{series.quantity}/{_word(series.source)}"
    for at in range(0, series.time.size, TOGETHER):
        part = slice(at, at + TOGETHER)
        for time, value in zip(series.time[part].tolist(), series.values[part].tolist(), strict=True):
            yield Entry(topic, SAMPLE, VALUE, began + time, {"value": _number(value)})


def in_order(entries: Iterable[Iterable[Entry]]) -> Iterator[Entry]:
    """Yield entries in order of time that are so each by themselves: a chunk of a .mcap then holds one stretch of time,
    and who seeks a moment, or plays the log, reads the chunks of that moment alone."""
    return merge(*entries, key=lambda entry: entry.time)


def tick_entries(log: Log, began: float) -> Iterator[Entry]:
    """Yield every tick of a log of ours; `began`: Unix time [s] of the loop clock's zero."""
    for tick in log.ticks:
        yield Entry("/norrbin/tick", "norrbin.Tick", TICK, began + tick.now, _tick(tick))


def message_entries(data: bytes) -> Iterator[Entry]:
    """Yield every MAVLink message that the dialect knows in a .tlog, without the records of our own ticks."""
    codec = MavlinkCodec()
    schemas: dict[str, dict[str, Any]] = {}
    for stamp, _, packet in TlogPackets(data):
        for message in codec.decode(packet):
            kind = message.get_type()
            if kind == "TUNNEL" and message.payload_type == PAYLOAD_TYPE:
                continue
            content = {name: _plain(getattr(message, name)) for name in message.get_fieldnames()}
            if kind not in schemas:
                schemas[kind] = {name: _schema(value) for name, value in content.items()}
            topic = f"/mavlink/{message.get_srcSystem()}/{message.get_srcComponent()}/{kind}"
            if kind in NAMED:  # each name a channel of its own, or plots would mix them
                topic += f"/{_word(content['name'])}"
            yield Entry(topic, f"mavlink.{kind}", schemas[kind], stamp, content)


def _tick(tick: Tick) -> dict[str, Any]:
    state = tick.state
    return {
        "heading_rad": _number(state.heading),
        "yaw_rate_rad_s": _number(state.rate),
        "speed_m_s": _number(state.speed),
        "rudder_rad": _number(state.rudder),
        "rudder_bias_rad": _number(state.bias),
        "reference_heading_rad": _number(tick.reference.heading),
        "order_heading_rad": _number(tick.order.heading),
        "rudder_order_rad": _number(tick.command.angle) if tick.command.engaged else None,
        "heading_age_s": _number(state.heading_age),
        "mode": tick.mode.name,
        "engaged": tick.command.engaged,
        "alarms": list(sentences_of(tick.alarms)),
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _nanoseconds(time: float) -> int:
    """Return a time as a .mcap holds it, which is up to the year 2554; a damaged one may be anything."""
    return round(min(max(time, 0.0), MCAP_LATEST_S) * 1.0e9) if math.isfinite(time) else 0


def _plain(value: Any) -> Any:
    """Return a field's value as JSON has it: bytes in base 64, what is not finite as null."""
    if isinstance(value, float):
        return _number(value)
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    if isinstance(value, bytes | bytearray):
        return base64.b64encode(value).decode()
    return value


def _schema(value: Any) -> dict[str, Any]:
    if isinstance(value, list):
        return {"type": "array", "items": NUMBER}
    return TEXT if isinstance(value, str) else NUMBER


def _word(source: str) -> str:
    return re.sub(r"[^A-Za-z0-9_.+-]+", "_", source) or "log"


FORMAT = LogFormat(
    "an exported .mcap",
    lambda data: data.startswith(HEAD),
    lambda path, data, options: read_mcap(path, data, options.progress),
    ".mcap",
    "is no MCAP file, or its beginning is lost.",
)
