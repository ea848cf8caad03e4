"""The log: a .tlog that every MAVLink tool reads, with each tick inside it exactly.

A .tlog is a row of (8-byte big-endian time in microseconds since 1970, MAVLink packet). Norrbin writes into it
what its MAVLink links received and sent, a few NAMED_VALUE_FLOAT and ATTITUDE for plotting, and TUNNEL
messages that carry the records of `tick_codec` in pieces. One write call a tick, not buffered here: a killed
process loses at most the tick it was in. Where the log is kept in parts, or ticks could not be written, it goes on
with a header, so that every part can be read alone; parts with no tick missing between them are read as one log.

A replay is each tick of a log through a fresh pilot, and every command compared bit for bit.
"""

from __future__ import annotations

import math
import os
import struct
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple, overload

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.files.outside import ByteRows, read_regular
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.frames import (
    MAGIC_V1,
    MAGIC_V2,
    SIGNATURE,
    STAMP,
    TlogPackets,
    checksum,
    identity_of,
    is_signed,
)
from autopilot.links.mavlink.signing import without_signature
from autopilot.runtime.build import build_pilot, law_of, pilot_config
from autopilot.runtime.log_files import FileSink, Sink, following_parts
from autopilot.runtime.tick_codec import HEADER, TICKS, VESSEL, decode_header, decode_tick, encode_header, encode_tick
from autopilot.signals import AlarmEvent, RudderCommand, Tick
from autopilot.supervision.alarms import VERBATIM
from autopilot.vessel.file import parse_vessel

PAYLOAD_TYPE = 0x8E52
"""TUNNEL payload type of our records: above 32767, where the MAVLink standard leaves them to everybody."""
PIECE = 124
PART_HEAD = 4
"""Bytes before a piece: serial, number and count of pieces."""
MOST_PIECES = 255
TUNNEL_HEAD = struct.Struct("<HBBBHBB")
"""payload_type, target system and component, payload_length, and the four bytes before a piece."""
PAYLOAD_AT = 10
"""Where a MAVLink 2 packet's payload begins."""
NAMED_VALUE = struct.Struct("<If10s")
"""time_boot_ms, value, name."""
PLOT_PERIOD = 0.1
COMPONENT = 191
FORMAT = 2
LONGEST_STEP_S = 1.0e6
"""From tick to tick by the loop's clock, which is never set."""
SETUP_SIGNING = dialect.MAVLINK_MSG_ID_SETUP_SIGNING


class Recorder:
    """Writes one log into a file or another sink. InputError where the file cannot be written."""

    def __init__(self, place: Path | Sink, header: dict[str, Any], clock_now: float) -> None:
        self._sink = FileSink(place) if isinstance(place, Path) else place
        self._codec = MavlinkCodec(1, COMPONENT)
        self._offset = time.time() - clock_now
        self._now = clock_now
        self._serial = 0
        self._next_plot = 0.0
        self._stopped = ""
        self._header = {"format": FORMAT, "run": f"{os.getpid()}-{time.time_ns()}", **header}
        self._part = 0
        self._written = 0
        self._lost = 0
        self._write(self._opening(clock_now, 0))

    @property
    def failed(self) -> str:
        """Why nothing is written now and what to do, '' while all is well."""
        return self._stopped or self._sink.trouble

    @property
    def alarm(self) -> AlarmEvent | None:
        """The same, for whoever brings it to the skipper."""
        return AlarmEvent("disk_full", self.failed, VERBATIM) if self.failed else None

    @property
    def path(self) -> Path:
        """The file that is written now, or was last."""
        return self._sink.path

    @property
    def dropped(self) -> int:
        """How many ticks were not written."""
        return self._sink.dropped

    def record(self, tick: Tick, packets: list[tuple[float, bytes]]) -> None:
        """Append one tick and the MAVLink packets that went with it. A full disk stops the log, not the boat."""
        self._now = tick.now
        parts = self._stamped(packets)
        if tick.now >= self._next_plot:
            self._next_plot = tick.now + PLOT_PERIOD
            parts.extend(self._plots(tick))
        try:
            if self._begins_anew():
                parts.insert(0, self._opening(tick.now, tick.number))
            parts.append(self._tunnel(tick.now, encode_tick(tick)))
        except (struct.error, InputError) as error:
            self._stopped = f"log stopped: tick {tick.number} cannot be written ({error}); start a new log"
            return
        self._write(b"".join(parts), 1)

    def keep_packets(self, packets: list[tuple[float, bytes]]) -> None:
        """Append MAVLink packets that belong to no tick."""
        self._write(b"".join(self._stamped(packets)))

    def keep_vessel(self, text: str) -> None:
        """Append the vessel as it is from the next tick on."""
        self._header["vessel"] = text
        self._write(self._tunnel(self._now, bytes([VESSEL]) + text.encode()))

    def close(self) -> None:
        """Close the file; further calls do nothing."""
        self._sink.close()

    def _write(self, data: bytes, ticks: int = 0) -> None:
        if data and not self._stopped:
            self._sink.write(data, ticks)
            self._written += len(data)

    def _begins_anew(self) -> bool:
        """Return whether a header must come first: in a new part, and behind what was lost."""
        if self._sink.part_bytes is not None and self._written >= self._sink.part_bytes:
            self._sink.next_part()
            return True
        return self._sink.lost != self._lost

    def _opening(self, now: float, tick_number: int) -> bytes:
        """Return the header; `first` is the tick that follows, by which a reader knows what is missing before it."""
        self._part += 1
        self._written = 0
        self._lost = self._sink.lost
        return self._tunnel(now, encode_header({**self._header, "part": self._part, "first": tick_number}))

    def _stamped(self, packets: list[tuple[float, bytes]]) -> list[bytes]:
        """Nothing goes into a log that helps towards a signing key: no signatures, no message that carries one."""
        return [
            self._stamp(when) + without_signature(packet)
            for when, packet in packets
            if identity_of(packet) != SETUP_SIGNING
        ]

    def _stamp(self, when: float) -> bytes:
        return struct.pack(">Q", int((when + self._offset) * 1.0e6))

    def _tunnel(self, when: float, record: bytes) -> bytes:
        self._serial = (self._serial + 1) & 0xFFFF
        stamp, size = self._stamp(when), len(record)
        count = -(-size // PIECE)
        if count > MOST_PIECES:
            raise InputError(f"log: a record of {size} bytes does not fit; {MOST_PIECES * PIECE} are allowed")
        out: list[bytes] = []
        for index in range(count):
            piece = record[index * PIECE : (index + 1) * PIECE]
            head = TUNNEL_HEAD.pack(PAYLOAD_TYPE, 0, 0, PART_HEAD + len(piece), self._serial, index, count)
            out += stamp, self._codec.encode_payload(dialect.MAVLink_tunnel_message, head + piece)
        return b"".join(out)

    def _plots(self, tick: Tick) -> Iterator[bytes]:
        stamp = self._stamp(tick.now)
        boot_ms = int(tick.now * 1000.0) & 0xFFFFFFFF
        state = tick.state
        # NAMED_VALUE_FLOAT cuts a name after ten characters
        values = {
            b"psi_deg": math.degrees(state.heading),
            b"psi_d_deg": math.degrees(tick.reference.heading),
            b"rudcmd_deg": math.degrees(tick.command.angle),
            b"rud_deg": math.degrees(state.rudder),
            b"bias_deg": math.degrees(state.bias),
            b"mode": float(tick.mode),
        }
        for name, value in values.items():
            payload = NAMED_VALUE.pack(boot_ms, value, name)
            yield stamp + self._codec.encode_payload(dialect.MAVLink_named_value_float_message, payload)


Progress = Callable[[int, int], None]
"""What is called with how much is done, and of how much."""


def _silent(done: int, total: int) -> None:
    """Do nothing."""


class Ticks(Sequence[Tick]):
    """The ticks of a log, each decoded where it is looked at: all of them would take ten times the file.

    last: the last one, None where there are none.
    """

    def __init__(self) -> None:
        self.last: Tick | None = None
        self._records = ByteRows()

    def append(self, tick: Tick, record: bytes) -> None:
        """Append one and the record that it was decoded from."""
        self.last = tick
        self._records.append(record)

    def __len__(self) -> int:
        return len(self._records)

    @overload
    def __getitem__(self, at: int) -> Tick: ...

    @overload
    def __getitem__(self, at: slice) -> list[Tick]: ...

    def __getitem__(self, at: int | slice) -> Tick | list[Tick]:
        if isinstance(at, slice):
            return [self[place] for place in range(len(self))[at]]
        return decode_tick(self._records[at])

    def __iter__(self) -> Iterator[Tick]:
        return map(decode_tick, self._records)


class Log(NamedTuple):
    """A log that has been read; `changes` holds the vessel file's text in force from a tick (by its place) on."""

    header: dict[str, Any]
    ticks: Ticks
    changes: dict[int, str]


def read_packets(path: Path) -> Iterator[tuple[float, bytes]]:
    """Yield (seconds since 1970, packet) of a .tlog, past what is damaged in it. Raises InputError."""
    for stamp, _, packet in TlogPackets(_bytes_of(path)):
        yield stamp, packet


def read_logs(*paths: Path, progress: Progress = _silent) -> list[Log]:
    """Return the logs in files, several where one was put together from several; a torn last record is left out.

    Parts that follow one another without a gap are one log. `progress` is called with the bytes of each file. Raises
    InputError where there is none.
    """
    logs: list[Log] = []
    unread = 0
    for path in paths:
        for record in _records(path, progress):
            unread += not logs and record[0] in TICKS
            try:
                _take(logs, record)
            except InputError as error:
                raise InputError(f"{path}: {error}") from error
    if not logs and unread:
        raise InputError(
            f"{paths[0]}: its beginning, which holds the vessel file, is lost or damaged, and its {unread} ticks "
            "cannot be read without; give another log"
        )
    if not logs:
        raise InputError(f"{paths[0]}: holds no Norrbin ticks; give a log that `autopilot run --log` wrote")
    return logs


def is_headless(log: Log) -> bool:
    """Return whether ticks are missing before the first one."""
    return bool(log.header.get("part", 1) > 1)


def _take(logs: list[Log], record: bytes) -> None:
    if record[0] == HEADER:
        _take_header(logs, decode_header(record))
    elif record[0] in TICKS and logs:
        _take_tick(logs, decode_tick(record), record)
    elif record[0] == VESSEL and logs:
        logs[-1].changes[len(logs[-1].ticks)] = record[1:].decode(errors="replace")


def _take_tick(logs: list[Log], tick: Tick, record: bytes) -> None:
    """Append a tick; behind missing ones it begins a log without a head.

    Raises InputError where the loop's clock cannot have shown its time.
    """
    last = logs[-1]
    newest = last.ticks.last or tick
    before = newest.now
    if not 0.0 <= tick.now - before <= LONGEST_STEP_S:
        raise InputError(
            f"a tick in the log is damaged: number {tick.number} at {tick.now:.9g} s comes behind {before:.9g} s; give "
            "another log."
        )
    if tick.number > newest.number + 1:
        header = {**last.header, "vessel": _in_force(last), "part": last.header.get("part", 1) + 1}
        last = Log({**header, "first": tick.number}, Ticks(), {})
        logs.append(last)
    last.ticks.append(tick, record)


def _in_force(log: Log) -> Any:
    """Return the text of the vessel file that the last tick was steered by."""
    return list(log.changes.values())[-1] if log.changes else log.header.get("vessel")


def _take_header(logs: list[Log], header: dict[str, Any]) -> None:
    """Begin a log with a header, or go on with the last one where it is the next part and no tick is missing."""
    last = logs[-1] if logs else None
    is_next = last is not None and header.get("run") is not None and header["run"] == last.header.get("run")
    if last is None or not is_next or last.ticks.last is None or header.get("first") != last.ticks.last.number + 1:
        logs.append(Log(header, Ticks(), {}))
        return
    in_force = _in_force(last)
    vessel = header.get("vessel", in_force)
    if vessel != in_force:
        last.changes[len(last.ticks)] = str(vessel)


def read_log(path: Path) -> Log:
    """Return the first log in a file. Raises InputError where there is none."""
    return read_logs(path)[0]


def _records(path: Path, progress: Progress) -> Iterator[bytes]:
    serial = -1
    parts: list[bytes] = []
    for payload in _payloads(path, progress):
        kind, _, _, length, number, index, count = TUNNEL_HEAD.unpack_from(payload)
        if kind != PAYLOAD_TYPE or length <= PART_HEAD:
            continue
        if index == 0:
            serial, parts = number, []
        if number != serial or index != len(parts):
            continue
        parts.append(payload[TUNNEL_HEAD.size : TUNNEL_HEAD.size + length - PART_HEAD])
        if len(parts) == count:
            yield b"".join(parts)


def _payloads(path: Path, progress: Progress) -> Iterator[bytes]:
    """Yield the payload of each TUNNEL whose checksum is right, read from its bytes: pymavlink takes ten times as long.

    Zeros at its end, which are left out on the way, are put back.
    """
    kind = dialect.MAVLink_tunnel_message
    data = _bytes_of(path)
    done = 0
    for _, identity, packet in TlogPackets(data):
        done += STAMP + len(packet)
        if packet[0] != MAGIC_V2 or identity != kind.id:
            continue
        progress(done, len(data))
        end = (len(packet) - SIGNATURE if is_signed(packet) else len(packet)) - 2
        if checksum(packet[1:end], kind.crc_extra) == packet[end : end + 2]:
            yield packet[PAYLOAD_AT:end].ljust(kind.unpacker.size, b"\0")


def _bytes_of(path: Path) -> bytes:
    try:
        data = read_regular(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; give a log that exists and can be read") from error
    if not data:
        raise InputError(f"{path}: the log is empty; give one that `autopilot run` has written")
    if len(data) > STAMP and data[STAMP] not in (MAGIC_V1, MAGIC_V2):
        raise InputError(
            f"{path}: no MAVLink packet at byte {STAMP}: this is not a .tlog, or it is damaged there; give "
            "one that `autopilot run --log` has written"
        )
    return data


class ReplayResult(NamedTuple):
    """How many ticks were compared, whether all were identical, where the first difference is, and how many ticks
    behind a gap were left out."""

    ticks: int
    identical: bool
    first_difference: int | None
    detail: str
    left_out: int = 0


def replay(path: Path, progress: Progress = _silent) -> ReplayResult:
    """Run every log in the file at `path`, and in the parts that follow it, again, each from its own header.

    What comes behind a gap is left out. `progress` is called with the bytes read, then with the ticks run. Raises
    InputError.
    """
    count = 0
    logs = read_logs(*following_parts(path), progress=progress)
    if is_headless(logs[0]):
        # the header's number counts gaps, too, and attempts that a disk refused: no file has it
        first = logs[0].header.get("first", "later than the first")
        raise InputError(
            f"{path}: begins with tick {first} of its run, and those before are in other parts of the log, or missing; "
            "a replay starts with the first part, and needs all of them."
        )
    for log in logs:
        if is_headless(log):
            continue
        count += len(log.ticks)
        difference = _first_difference(path, log, progress)
        if difference is not None:
            return ReplayResult(count, False, *difference)
    return ReplayResult(count, True, None, "", sum(len(log.ticks) for log in logs if is_headless(log)))


def _first_difference(path: Path, log: Log, progress: Progress) -> tuple[int, str] | None:
    vessel = log.header.get("vessel")
    if not isinstance(vessel, str):
        raise InputError(f"{path}: its header names no vessel; it was written by another version")
    pilot = build_pilot(parse_vessel(vessel, f"{path} (header)"), log.header.get("law"))
    for place, recorded in enumerate(log.ticks):
        progress(place, len(log.ticks))
        if place in log.changes:
            changed = parse_vessel(log.changes[place], f"{path} (change before tick {recorded.number})")
            law = log.header.get("law")
            pilot.reconfigure(pilot_config(changed, law), law_of(changed, law))
        tick = pilot.step(recorded.now, recorded.samples, recorded.order)
        if _bits(tick.command) != _bits(recorded.command) or tick.mode != recorded.mode:
            return recorded.number, (
                f"recorded {recorded.mode.name} {recorded.command.angle!r} rad, "
                f"replayed {tick.mode.name} {tick.command.angle!r} rad"
            )
    return None


def _bits(command: RudderCommand) -> bytes:
    return struct.pack("<dd?d", command.time, command.angle, command.engaged, command.thruster)
