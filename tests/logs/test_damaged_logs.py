"""Logs whose damage leaves one thing where another is announced: found by fuzzing, refused or read, never a crash."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import pytest
from boat_recordings import dataflash, tlog, tlog_events, zigzag_boat
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.logs.dataflash import read_dataflash
from autopilot.logs.reading import read_recording
from autopilot.logs.tlog import read_tlog
from autopilot.runtime.record import read_log

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
