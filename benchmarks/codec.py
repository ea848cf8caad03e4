"""What the MAVLink codec costs, a message and a tick, beside pymavlink's `mavutil.recv_match` on the same bytes.

    python benchmarks/codec.py [--json]

Both read the same datagrams over the same kind of loopback UDP socket in this process, in turn, block by block: a
second of what an ArduRover boat sends to a companion at 20 Hz ATTITUDE, 10 Hz RC_CHANNELS and SERVO_OUTPUT_RAW, 5 Hz
GLOBAL_POSITION_INT and 1 Hz HEARTBEAT, one message a datagram. The median over the blocks of each block's ratio is the
figure to trust; microseconds are those of this machine on this day.
"""

from __future__ import annotations

import argparse
import json
import os
import socket
import statistics
import time
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.signing import CountingTimestamps, Signing
from autopilot.links.transports import UdpInTransport

BLOCKS = 60
TICK_HZ = 20


def second_of_traffic() -> list[bytes]:
    """Return the datagrams of one second."""
    codec = MavlinkCodec(1, 1)
    packets = []
    for tick in range(TICK_HZ):
        boot_ms = 1000 + 50 * tick
        messages = [dialect.MAVLink_attitude_message(boot_ms, 0.01, 0.02, 0.5, 0.0, 0.0, 0.01)]
        if tick % 2 == 0:
            messages.append(dialect.MAVLink_rc_channels_message(boot_ms, 16, *[1500] * 18, 200))
            messages.append(dialect.MAVLink_servo_output_raw_message(boot_ms * 1000, 0, *[1500] * 8))
        if tick % 4 == 0:
            messages.append(
                dialect.MAVLink_global_position_int_message(boot_ms, 590000000, 100000000, 0, 0, 200, 10, 0, 9000)
            )
        if tick == 0:
            messages.append(dialect.MAVLink_heartbeat_message(11, 3, 209, 0, 4, 3))
        packets += [codec.encode(message) for message in messages]
    return packets


def ours(packets: list[bytes], repeats: int) -> float:
    """Return the seconds that our transport and codec take for `repeats` seconds of traffic."""
    transport = UdpInTransport("udpin:127.0.0.1:0", "127.0.0.1", 0)
    codec = MavlinkCodec(255, 190)

    def read() -> int:
        return sum(len(codec.decode(data)) for data in transport.receive())

    try:
        return _timed(transport.port, packets, repeats, read)
    finally:
        transport.close()


def mavutil_s(packets: list[bytes], repeats: int) -> float:
    """Return the seconds that mavutil's connection takes for the same."""
    os.environ["MAVLINK20"] = "1"
    from pymavlink import mavutil

    connection: Any = mavutil.mavlink_connection("udpin:127.0.0.1:0")

    def read() -> int:
        count = 0
        while connection.recv_match() is not None:
            count += 1
        return count

    try:
        return _timed(connection.port.getsockname()[1], packets, repeats, read)
    finally:
        connection.close()


def _timed(port: int, packets: list[bytes], repeats: int, read: Callable[[], int]) -> float:
    used = 0.0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.connect(("127.0.0.1", port))
        for _ in range(repeats):
            for packet in packets:
                line.send(packet)
            started = time.perf_counter()
            count = read()
            used += time.perf_counter() - started
            assert count == len(packets), f"{count} of {len(packets)} messages were read"
    return used


def _signed_us(message: Any, rounds: int) -> dict[str, float]:
    """Return what signing, checking a signature, and refusing a forged one cost, in us of processor time a message."""
    boat, station, liar = (
        MavlinkCodec(system, 1, signing=Signing(key, CountingTimestamps()).link())
        for system, key in ((1, bytes(32)), (255, bytes(32)), (1, bytes(31) + b"x"))
    )
    started = time.process_time()
    frames = [boat.encode(message) for _ in range(rounds)]
    encoded = time.process_time()
    accepted = sum(len(station.decode(frame)) for frame in frames)
    decoded = time.process_time()
    forged = [liar.encode(message) for _ in range(1000)]
    before = time.process_time()
    believed = sum(len(station.decode(frame)) for _ in range(rounds // 1000) for frame in forged)
    refused = time.process_time()
    assert (accepted, believed) == (rounds, 0)
    return {
        "encode_signed_us": 1e6 * (encoded - started) / rounds,
        "decode_signed_us": 1e6 * (decoded - encoded) / rounds,
        "refuse_forged_us": 1e6 * (refused - before) / (rounds // 1000 * 1000),
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")
    arguments = parser.parse_args()
    packets = second_of_traffic()
    pairs = [(ours(packets, 5), mavutil_s(packets, 5)) for _ in range(BLOCKS)]
    messages = 5 * len(packets)
    our_us, their_us = (1e6 * statistics.median(column) / messages for column in zip(*pairs, strict=True))
    per_tick = len(packets) / TICK_HZ
    codec = MavlinkCodec(255, 190)
    override = dialect.MAVLink_rc_channels_override_message(1, 1, 1520, *[65535] * 7)
    rounds = 20000
    started = time.perf_counter()
    for _ in range(rounds):
        codec.encode(override)
    encode_us = 1e6 * (time.perf_counter() - started) / rounds
    signed = _signed_us(override, rounds)
    figures = {
        "ours_us_a_message": our_us,
        "mavutil_us_a_message": their_us,
        "mavutil_to_ours": statistics.median(theirs / mine for mine, theirs in pairs),
        "ours_us_a_tick": our_us * per_tick,
        "mavutil_us_a_tick": their_us * per_tick,
        "encode_override_us": encode_us,
        "messages_a_tick": per_tick,
        **signed,
    }
    if arguments.json:
        print(json.dumps(figures, indent=2))
        return
    for name, value in figures.items():
        print(f"{name:24s}{value:9.2f}")


if __name__ == "__main__":
    main()
