"""The wire: messages on request, parameters, and bytes read by hand from the published layouts."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.vessel.file import load_vessel
from sitl.firmware import Firmware
from sitl.scenario import FaultSection, load_scenario
from sitl.wire_mavlink import MavlinkVehicle
from sitl.world import World

MakeBench = Callable[..., Any]


def x25(data: bytes) -> int:
    """CRC-16/MCRF4XX, written out here so that no library vouches for its own frames."""
    crc = 0xFFFF
    for byte in data:
        low = byte ^ (crc & 0xFF)
        low = (low ^ (low << 4)) & 0xFF
        crc = (crc >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)
    return crc


def payload(packet: bytes, identity: int, crc_extra: int, size: int) -> bytes:
    """Check a MAVLink 2 frame by hand and return its payload, trailing zeros put back."""
    assert packet[0] == 0xFD
    assert int.from_bytes(packet[7:10], "little") == identity
    assert (packet[5], packet[6]) == (1, 1)
    length = packet[1]
    assert len(packet) == length + 12
    assert int.from_bytes(packet[-2:], "little") == x25(packet[1:-2] + bytes([crc_extra]))
    return packet[10 : 10 + length].ljust(size, b"\0")


def packets_of(boat: Any, identity: int) -> list[bytes]:
    return packets_in(boat.packets, identity)


def packets_in(packets: list[bytes], identity: int) -> list[bytes]:
    return [packet for packet in packets if int.from_bytes(packet[7:10], "little") == identity]


def test_bytes_mean_what_the_message_definitions_say(bench: MakeBench) -> None:
    """Layouts and CRC_EXTRA from common.xml: ATTITUDE 30/39, GLOBAL_POSITION_INT 33/104, VFR_HUD 74/20."""
    noiseless = {
        "heading_noise_deg": 0.0,
        "rate_noise_deg_s": 0.0,
        "roll_noise_deg": 0.0,
        "speed_noise_m_s": 0.0,
        "position_noise_m": 0.0,
    }
    boat = bench(sensors=noiseless, start={"heading_deg": 250.0, "latitude_deg": -33.5, "longitude_deg": 151.25})
    boat.override(1900)
    boat.run(2.05)
    state = boat.world.boat.state
    stamp, roll, _, yaw, _, _, rate = struct.unpack("<I6f", payload(packets_of(boat, 30)[2], 30, 39, 28))
    assert stamp == 2000
    assert -math.pi < yaw <= math.pi
    assert math.degrees(yaw) % 360.0 == pytest.approx(math.degrees(state.heading), abs=1.0)
    assert rate == pytest.approx(state.rate, rel=0.05)
    assert rate > 0.1
    assert roll < 0.0

    fields = struct.unpack("<IiiiihhhH", payload(packets_of(boat, 33)[2], 33, 104, 28))
    _, latitude, longitude, _, _, north, east, _, heading = fields
    assert latitude / 1e7 == pytest.approx(-33.5, abs=1e-3)
    assert longitude / 1e7 == pytest.approx(151.25, abs=1e-3)
    assert math.hypot(north, east) / 100.0 == pytest.approx(math.hypot(state.north_speed, state.east_speed), abs=0.2)
    assert heading / 100.0 == pytest.approx(math.degrees(state.heading), abs=1.0)
    assert (north < 0, east < 0) == (True, True)

    _, ground, _, _, compass, throttle = struct.unpack("<ffffhH", payload(packets_of(boat, 74)[2], 74, 20, 20))
    assert ground == pytest.approx(math.hypot(state.north_speed, state.east_speed), abs=0.2)
    assert compass == round(math.degrees(yaw) % 360.0)
    assert throttle == 50

    custom_mode, kind, autopilot, base_mode, _, version = struct.unpack(
        "<IBBBBB", payload(packets_of(boat, 0)[0], 0, 50, 9)
    )
    assert (custom_mode, kind, autopilot, version) == (0, 11, 3, 3)
    assert base_mode & 0x80
    assert base_mode & 0x01


def test_default_streams_run_at_one_hertz(bench: MakeBench) -> None:
    boat = bench()
    boat.run(10.0)
    for kind in ("HEARTBEAT", "ATTITUDE", "GLOBAL_POSITION_INT", "VFR_HUD", "SERVO_OUTPUT_RAW", "SYS_STATUS"):
        assert len(boat.of(kind)) == 11, kind


def test_message_interval_on_request_default_and_off(bench: MakeBench) -> None:
    boat = bench()
    boat.run(0.05)
    assert boat.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 20000).result == 0
    boat.forget()
    boat.run(2.0)
    assert len(boat.of("ATTITUDE")) == 100
    assert np.diff([message.time_boot_ms for message in boat.of("ATTITUDE")]).tolist() == [20] * 99
    boat.command(dialect.MAV_CMD_GET_MESSAGE_INTERVAL, 30)
    assert boat.last("MESSAGE_INTERVAL").interval_us == 20000
    boat.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 30, -1)
    boat.forget()
    boat.run(3.0)
    assert not boat.of("ATTITUDE")
    boat.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 0)
    boat.forget()
    boat.run(5.0)
    assert len(boat.of("ATTITUDE")) == 5
    assert boat.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 9999, 20000).result == dialect.MAV_RESULT_FAILED
    assert boat.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, math.nan, math.inf).result == dialect.MAV_RESULT_FAILED


def test_request_data_stream_sets_the_group(bench: MakeBench) -> None:
    boat = bench()
    boat.send(dialect.MAVLink_request_data_stream_message(1, 1, dialect.MAV_DATA_STREAM_EXTRA1, 10, 1))
    boat.run(0.05)
    boat.forget()
    boat.run(2.0)
    assert len(boat.of("ATTITUDE")) == 20
    assert boat.firmware.parameters["SR0_EXTRA1"] == 10.0
    boat.send(dialect.MAVLink_request_data_stream_message(1, 1, dialect.MAV_DATA_STREAM_ALL, 0, 0))
    boat.run(0.05)
    boat.forget()
    boat.run(3.0)
    assert {message.get_type() for message in boat.messages} == {"HEARTBEAT"}


def test_request_message_and_unknown_commands(bench: MakeBench) -> None:
    boat = bench()
    assert boat.command(dialect.MAV_CMD_REQUEST_MESSAGE, 148).result == 0
    version = boat.last("AUTOPILOT_VERSION")
    assert version.flight_sw_version >> 24 == 4
    assert version.capabilities & dialect.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
    assert boat.command(dialect.MAV_CMD_REQUEST_MESSAGE, 12345).result == dialect.MAV_RESULT_FAILED
    assert boat.command(dialect.MAV_CMD_NAV_TAKEOFF).result == dialect.MAV_RESULT_UNSUPPORTED
    acknowledged = boat.last("COMMAND_ACK")
    assert (acknowledged.target_system, acknowledged.target_component) == (255, 191)


def test_command_int_is_a_command_too(bench: MakeBench) -> None:
    boat = bench()
    boat.send(dialect.MAVLink_command_int_message(1, 1, 0, dialect.MAV_CMD_DO_SET_MODE, 0, 0, 1, 4, 0, 0, 0, 0, 0))
    boat.run(1.0)
    assert boat.last("COMMAND_ACK").result == 0
    assert boat.last("HEARTBEAT").custom_mode == 4


def test_messages_for_others_are_not_ours(bench: MakeBench) -> None:
    boat = bench()
    boat.send(dialect.MAVLink_command_long_message(7, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 0, 0, 0, 0, 0, 0))
    boat.send(
        dialect.MAVLink_command_long_message(1, 191, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 0, 0, 0, 0, 0, 0)
    )
    boat.run(0.1)
    assert not boat.of("COMMAND_ACK")
    assert boat.firmware.armed
    boat.send(dialect.MAVLink_command_long_message(0, 0, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 0, 0, 0, 0, 0, 0))
    boat.run(0.1)
    assert not boat.firmware.armed


def test_parameter_list_is_whole_and_numbered(bench: MakeBench) -> None:
    boat = bench()
    boat.send(dialect.MAVLink_param_request_list_message(1, 1))
    boat.run(2.0)
    values = boat.of("PARAM_VALUE")
    count = len(boat.firmware.parameters)
    assert [value.param_index for value in values] == list(range(count))
    assert {value.param_count for value in values} == {count}
    by_name = {value.param_id: value for value in values}
    assert by_name["FRAME_CLASS"].param_value == 2.0
    assert by_name["FRAME_CLASS"].param_type == dialect.MAV_PARAM_TYPE_INT8
    assert by_name["SERVO1_FUNCTION"].param_value == 26.0
    assert by_name["RC_OVERRIDE_TIME"].param_type == dialect.MAV_PARAM_TYPE_REAL32


def test_parameter_read_by_name_index_and_neither(bench: MakeBench) -> None:
    boat = bench()
    boat.send(dialect.MAVLink_param_request_read_message(1, 1, b"SYSID_MYGCS", -1))
    boat.run(0.05)
    by_name = boat.last("PARAM_VALUE")
    assert by_name.param_value == 255.0
    boat.send(dialect.MAVLink_param_request_read_message(1, 1, b"", by_name.param_index))
    boat.run(0.05)
    assert boat.last("PARAM_VALUE").param_id == "SYSID_MYGCS"
    boat.forget()
    boat.send(dialect.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    boat.send(dialect.MAVLink_param_request_read_message(1, 1, b"", 30000))
    boat.run(0.2)
    assert not boat.of("PARAM_VALUE")


def test_a_changed_parameter_is_shown_at_every_port_that_is_in_use(bench: MakeBench) -> None:
    boat = bench()
    used, unused = MavlinkVehicle(boat.firmware), MavlinkVehicle(boat.firmware)
    used.sources.add((254, 190))
    boat.parameter_set("RC1_DZ", 12.0, dialect.MAV_PARAM_TYPE_INT16)
    boat.run(0.05)
    assert boat.last("PARAM_VALUE").param_value == 12.0
    assert packets_in(used.outgoing, dialect.MAVLINK_MSG_ID_PARAM_VALUE)
    assert not packets_in(unused.outgoing, dialect.MAVLINK_MSG_ID_PARAM_VALUE)


def test_a_parameter_is_not_set_to_no_number_and_a_read_only_one_not_at_all(bench: MakeBench) -> None:
    boat = bench()
    for value in (math.nan, math.inf):
        boat.parameter_set("RC1_DZ", value, dialect.MAV_PARAM_TYPE_INT16)
    boat.run(0.05)
    assert not packets_of(boat, dialect.MAVLINK_MSG_ID_PARAM_VALUE)
    boat.parameter_set("MIS_TOTAL", 3.0, dialect.MAV_PARAM_TYPE_INT16)
    boat.run(0.05)
    assert boat.last("PARAM_VALUE").param_value == 0.0
    assert boat.firmware.notices[-1] == (4, "Param write denied (MIS_TOTAL)")


def test_parameter_set_is_answered_by_the_value_as_it_is_then(bench: MakeBench) -> None:
    boat = bench()
    boat.parameter_set("RC1_DZ", 10.4, dialect.MAV_PARAM_TYPE_INT16)
    boat.run(0.05)
    echo = boat.last("PARAM_VALUE")
    assert (echo.param_id, echo.param_value, echo.param_index) == ("RC1_DZ", 10.0, 65535)
    boat.override(1560)
    boat.run(0.05)
    assert boat.steering_pulse == 1500 + (4500 * 50 // 490) * 500 // 4500
    boat.forget()
    boat.parameter_set("NO_SUCH", 1.0)
    boat.run(0.1)
    assert not boat.of("PARAM_VALUE")


def test_timesync_mission_and_file_transfer(bench: MakeBench) -> None:
    boat = bench()
    boat.run(1.5)
    boat.send(dialect.MAVLink_timesync_message(0, 123456789))
    boat.send(dialect.MAVLink_mission_request_list_message(1, 1, 0))
    request = [5, 0, 0, 4, *[0] * 247]
    boat.send(dialect.MAVLink_file_transfer_protocol_message(0, 1, 1, request))
    boat.run(0.05)
    assert boat.last("TIMESYNC").ts1 == 123456789
    assert boat.last("TIMESYNC").tc1 == pytest.approx(1.5e9, abs=1e7)
    assert boat.last("MISSION_COUNT").count == 0
    reply = boat.last("FILE_TRANSFER_PROTOCOL").payload
    assert (reply[0], reply[3], reply[5]) == (6, 129, 4)


def test_latency_shows_in_the_stamp(bench: MakeBench) -> None:
    boat = bench(sensors={"latency_s": 0.2})
    boat.run(0.05)
    boat.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 50000)
    boat.run(1.0)
    sent = boat.now
    assert sent * 1000.0 - boat.last("ATTITUDE").time_boot_ms == pytest.approx(200.0, abs=51.0)


def test_faults_silence_freeze_and_jam(bench: MakeBench) -> None:
    boat = bench(faults=(FaultSection("heading_dropout", 2.0, 4.0), FaultSection("silence", 6.0, 8.0)))
    boat.run(0.05)
    boat.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 30, 100000)
    boat.run(10.0)
    stamps = np.array([message.time_boot_ms for message in boat.of("ATTITUDE")]) / 1000.0
    assert not np.any((stamps > 2.05) & (stamps < 3.95))
    assert not np.any((stamps > 6.05) & (stamps < 7.95))
    assert np.count_nonzero((stamps > 4.0) & (stamps < 6.0)) >= 19
    assert len(boat.of("HEARTBEAT")) == 9, "a lost heading is not a lost flight controller, silence is"

    jammed = bench(faults=(FaultSection("rudder_stuck", 1.0, 3.0), FaultSection("heading_frozen", 1.0, 3.0)))
    jammed.run(1.0)
    for _ in range(18):
        jammed.override(1900)
        jammed.run(0.1)
    assert jammed.world.boat.state.rudder == 0.0
    for _ in range(20):
        jammed.override(1900)
        jammed.run(0.1)
    assert jammed.world.boat.state.rudder > 0.3


def transcript(seed: int | None) -> bytes:
    """All the bytes of half a minute in a seaway with a talkative companion, read at odd times."""
    world = World(load_vessel("lanxin"), load_scenario("sea-state-5"), seed)
    vehicle = MavlinkVehicle(Firmware(world))
    codec = dialect.MAVLink(None, srcSystem=255, srcComponent=191)
    sent = bytearray()
    interval = dialect.MAVLink_command_long_message(1, 1, 511, 0, 30, 50000, 0, 0, 0, 0, 0)
    vehicle.receive(0.013, bytes(interval.pack(codec)))
    now = 0.0
    for turn in range(300):
        now += 0.0937
        steering = 1500 + (turn * 37) % 300
        override = dialect.MAVLink_rc_channels_override_message(1, 1, steering, *[65535] * 7)
        vehicle.receive(now, bytes(override.pack(codec)))
        for packet in vehicle.transmit(now):
            sent += packet
    return bytes(sent)


def test_same_seed_same_bytes_other_seed_other_bytes() -> None:
    first = transcript(7)
    assert first == transcript(7)
    assert first != transcript(8)
    assert len(first) > 20000


def test_how_often_the_world_is_asked_changes_nothing() -> None:
    coarse, fine = (World(load_vessel("lanxin"), load_scenario("sea-state-5")) for _ in range(2))
    coarse.advance(5.0)
    for tick in range(1, 5001):
        fine.advance(tick / 1000.0)
    assert coarse.boat.state == fine.boat.state
    fine.advance(2.0)
    assert coarse.boat.state == fine.boat.state, "earlier times change nothing"


def test_the_simulation_does_not_depend_on_where_its_clock_starts() -> None:
    plain = World(load_vessel("lanxin"), load_scenario("jiang"))
    shifted = World(load_vessel("lanxin"), load_scenario("jiang"), epoch=1000.0)
    plain.advance(3.0)
    shifted.advance(1003.0)
    assert plain.boat.state == shifted.boat.state


@settings(max_examples=60, deadline=None)
@given(chunks=st.lists(st.binary(max_size=300), max_size=8))
def test_noise_never_raises_and_never_steers(chunks: list[bytes]) -> None:
    world = World(load_vessel("lanxin"), load_scenario("calm"))
    vehicle = MavlinkVehicle(Firmware(world), is_stream=True)
    for number, chunk in enumerate(chunks):
        vehicle.receive(0.02 * number, chunk)
        vehicle.transmit(0.02 * number)
    vehicle.advance(0.5)
    assert vehicle.firmware.servos[0] == 1500


MESSAGES = sorted(identity for identity in dialect.mavlink_map if identity < 300)


@settings(max_examples=200, deadline=None)
@given(identity=st.sampled_from(MESSAGES), body=st.binary(min_size=0, max_size=255))
def test_any_valid_frame_with_any_content_is_survived(identity: int, body: bytes) -> None:
    """Right checksum, absurd content: what a broken or hostile sender can do."""
    kind = dialect.mavlink_map[identity]
    content = body[: struct.calcsize(kind.unpacker.format)].ljust(1, b"\0")
    head = bytes([len(content), 0, 0, 0, 255, 191]) + identity.to_bytes(3, "little")
    frame = b"\xfd" + head + content + x25(head + content + bytes([kind.crc_extra])).to_bytes(2, "little")
    world = World(load_vessel("lanxin"), load_scenario("calm"))
    vehicle = MavlinkVehicle(Firmware(world))
    vehicle.receive(0.05, frame)
    for packet in vehicle.transmit(0.3):
        assert packet[0] == 0xFD
    assert all(math.isfinite(value) for value in world.boat.state)
