"""Logs whose damage leaves one thing where another is announced: found by fuzzing, refused or read, never a crash."""

from __future__ import annotations

import math
import struct
from pathlib import Path
from typing import Any

import pytest
from boat_recordings import dataflash, tlog, tlog_events, zigzag_boat
from lockstep import Lockstep
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.logs.dataflash import read_dataflash
from autopilot.logs.reading import read_recording
from autopilot.logs.tlog import read_tlog
from autopilot.logs.ulog import read_ulog
from autopilot.runtime.record import read_log
from autopilot.vessel.file import load_vessel

BOAT = zigzag_boat()


def wrapped(identity: int, inside: Any) -> bytes:
    """A .tlog record that announces a message `identity`, has a wrong checksum, and holds another, sound message."""
    packet = MavlinkCodec(1, 1).encode(inside)
    header = struct.pack("<BBBBBBB", 0xFD, len(packet), 0, 0, 0, 1, 1) + identity.to_bytes(3, "little")
    return struct.pack(">Q", 1_780_308_000_000_000) + header + packet + b"\0\0"


def test_a_telemetry_log_whose_heartbeat_holds_a_servo_message() -> None:
    servo = dialect.MAVLink_servo_output_raw_message(1, 0, *[1500] * 8)
    sound = tlog(tlog_events(BOAT))
    recording = read_tlog("x.tlog", wrapped(dialect.MAVLINK_MSG_ID_HEARTBEAT, servo) + sound)
    assert recording.best("heading_rad") is not None


def test_an_own_log_whose_record_holds_another_message(tmp_path: Path) -> None:
    value = dialect.MAVLink_named_value_float_message(1, b"x", 2.0)
    short = dialect.MAVLink_tunnel_message(0, 0, 0x8E52, 2, [0] * 128)
    path = tmp_path / "own.tlog"
    path.write_bytes(wrapped(dialect.MAVLINK_MSG_ID_TUNNEL, value) + wrapped(dialect.MAVLINK_MSG_ID_TUNNEL, short))
    with pytest.raises(InputError, match="holds no Norrbin ticks"):
        read_log(path)


def test_an_own_log_whose_beginning_is_lost(tmp_path: Path) -> None:
    path = tmp_path / "own.tlog"
    steps = Lockstep(load_vessel("lanxin"), log=path)
    steps.run(2.0)
    steps.session.close()
    whole = path.read_bytes()
    path.write_bytes(whole[:1000] + bytes(100) + whole[1100:])
    with pytest.raises(InputError, match=r"its beginning, which holds the vessel file, is lost or damaged"):
        read_log(path)


def test_a_dataflash_log_whose_parameters_have_lost_their_names(tmp_path: Path) -> None:
    sound = dataflash(BOAT)
    damaged = sound.replace(b"TimeUS,Name,Value", b"TimeUS,Nome,Value")
    assert damaged != sound
    recording = read_dataflash("x.bin", damaged)
    assert recording.best("heading_rad") is not None
    assert any("SERVOn_FUNCTION" in note for note in recording.notes)
    path = tmp_path / "x.bin"
    path.write_bytes(damaged)
    assert read_recording(str(path)).kind == recording.kind


def ulog_record(kind: str, body: bytes) -> bytes:
    return struct.pack("<HB", len(body), ord(kind)) + body


def announced(*formats: str) -> bytes:
    """A .ulg that describes messages and then announces the first of them."""
    described = b"".join(ulog_record("F", each.encode()) for each in formats)
    head = b"ULog\x01\x12\x35\x01" + bytes(8) + ulog_record("B", bytes(40))
    return head + described + ulog_record("A", b"\0\0\0" + formats[0].split(":")[0].encode())


@pytest.mark.parametrize(
    "formats",
    [
        [f"n{depth}:n{depth + 1}[1000] x;" for depth in range(30)] + ["n30:uint64_t timestamp;"],
        [f"n{depth}:n{depth + 1}[2] x;n{depth + 1} y;" for depth in range(60)] + ["n60:"],
        ["a:" + "".join(f"float[65535] x{number};" for number in range(200))],
        ["a:uint64_t timestamp;b x;", "b:a y;"],
    ],
)
def test_a_few_bytes_that_describe_millions_of_fields_are_refused(formats: list[str]) -> None:
    with pytest.raises(InputError, match="describes a message of more than 4096 fields, or one that is inside itself"):
        read_ulog("x.ulg", announced(*formats))


def test_many_long_messages_announced_are_refused_too() -> None:
    data = announced("a:" + "float[2000] x;") + 600 * ulog_record("A", b"\0\0\0a")
    with pytest.raises(InputError, match="describes a message"):
        read_ulog("x.ulg", data)


def test_headings_that_are_no_numbers_are_not_called_missing() -> None:
    field = struct.pack("<Qffff", 1000, *[math.nan] * 4)
    described = announced("vehicle_attitude:uint64_t timestamp;float[4] q;")
    with pytest.raises(InputError, match="holds vehicle_attitude, but not one heading in it is a number"):
        read_ulog("x.ulg", described + 9 * ulog_record("D", b"\0\0" + field))
    kind = struct.pack("<BB4s16s64s", 1, 27, b"ATT", b"Qffff", b"TimeUS,Roll,Pitch,Yaw,DesYaw")
    itself = struct.pack("<BB4s16s64s", 0x80, 89, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns")
    records = b"".join(b"\xa3\x95\x80" + each for each in (itself, kind)) + 9 * (b"\xa3\x95\x01" + field)
    with pytest.raises(InputError, match="holds ATT, but not one heading in it is a number"):
        read_dataflash("x.bin", records)
