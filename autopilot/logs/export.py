"""Logs for other programs: CSV and Parquet tables, and MCAP.

A log as MCAP, which Foxglove and PlotJuggler open: JSON messages, each channel with its JSON schema (mcap.dev).

Channels: `/log/<quantity>/<source>` for every series, in SI units and radians, as the log was understood;
`/mavlink/<system>/<component>/<MESSAGE>` for every message of a .tlog, fields as they travelled; `/norrbin/tick` for
every tick of a log of ours.

A table of a log as a file that others read: CSV and Parquet, positions in degrees, each column with its source.
"""

from __future__ import annotations

import base64
import json
import math
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.files.saving import write_new
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.frames import TlogPackets
from autopilot.logs.series import FloatArray, Recording
from autopilot.logs.table import Table
from autopilot.runtime.record import PAYLOAD_TYPE, Log
from autopilot.signals import Tick
from autopilot.supervision.panel import sentences_of

EXTRA = "pip install '.[export]'"


def shown_columns(table: Table) -> dict[str, FloatArray]:
    """Return the columns under the names and in the units in which they are written: SI, positions in degrees."""
    shown = {}
    for name, values in table.columns.items():
        other = name.replace("tude_rad", "tude_deg")
        shown[other] = values if other == name else values * (180.0 / math.pi)
    return shown


def write_csv(path: Path, table: Table, source: str) -> int:
    """Write a table with where its columns come from as comments; return the rows. Raises InputError."""
    lines = [f"# from {source}"] + [f"# {name}: {table.uses[name]}" for name in table.columns if name in table.uses]
    comments = len(lines)
    shown = shown_columns(table)
    lines.append(",".join(shown))
    for row in zip(*(column.tolist() for column in shown.values()), strict=True):
        lines.append(",".join("" if value != value else f"{value:.10g}" for value in row))  # noqa: PERF401
    save(path, lambda new: new.write_text("\n".join(lines) + "\n", encoding="utf-8"))
    return len(lines) - comments - 1


def write_parquet(path: Path, table: Table, source: str, began: float | None) -> int:
    """Write a table as Parquet: blanks are null, each column's source is in its metadata; return the rows.

    began: Unix time [s] of the clock's zero, kept in the file's metadata. Raises InputError, also without the extra.
    """
    try:
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    except ModuleNotFoundError:
        raise InputError(f"{path}: writing Parquet needs pyarrow; install it with {EXTRA}.") from None
    shown = shown_columns(table)
    fields, columns = [], []
    for (name, values), original in zip(shown.items(), table.columns, strict=True):
        uses = table.uses.get(original)
        fields.append(arrow.field(name, arrow.float64(), metadata={"source": uses} if uses else None))
        columns.append(arrow.array(values, mask=np.isnan(values)))
    metadata = {"source": source, **({} if began is None else {"began_unix_s": repr(began)})}
    whole: Any = arrow.Table.from_arrays(columns, schema=arrow.schema(fields, metadata=metadata))
    save(path, lambda new: parquet.write_table(whole, new, compression="zstd"))
    return int(whole.num_rows)


def save(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a file, which has the name `path` once it is whole. Raises InputError where that fails."""
    try:
        write_new(path, write)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}; give another place.") from error


LATEST_S = 1.8e10
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
    """Yield every sample of every series; on a clock from zero where the log does not tell the date."""
    began = recording.began or 0.0
    for series in recording.series:
        topic = f"/log/{series.quantity}/{_word(series.source)}"
        for time, value in zip(series.time.tolist(), series.values.tolist(), strict=True):
            yield Entry(topic, "norrbin.Sample", VALUE, began + time, {"value": _number(value)})


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
    return round(min(max(time, 0.0), LATEST_S) * 1.0e9) if math.isfinite(time) else 0


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
