"""A vehicle's side of the parameter protocol for tests, over a link that loses, repeats and reorders packets.

Written from the protocol's description, independently of the client: its own table, its own casts.
"""

from __future__ import annotations

import random
import struct
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

INTEGER_FORMATS = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}


class ParameterVehicle:
    """Holds name -> (value, kind); `bytewise` is PX4's encoding, else ArduPilot's cast."""

    def __init__(self, table: dict[str, tuple[float, int]], bytewise: bool = False) -> None:
        self.table = {name: list(entry) for name, entry in table.items()}
        self.bytewise = bytewise
        self.read_only: set[str] = set()
        self.limits: dict[str, tuple[float, float]] = {}
        self.silent_sets: set[str] = set()
        self.enables: dict[str, dict[str, tuple[float, int]]] = {}
        self.hash = False
        self.says_errors = False
        self.errors: list[tuple[str, int]] = []
        self.list_stops_after: int | None = None
        self.sets_received = 0
        self.mavlink = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self.waiting: list[tuple[str, int]] = []

    def packet(self, name: str, index: int) -> bytes:
        """Return the PARAM_VALUE packet; integers that travel as bytes are written into it as bytes."""
        value, kind = self.table[name]
        message = dialect.MAVLink_param_value_message(name.encode(), float(value), kind, len(self.table), index)
        packet = bytearray(message.pack(self.mavlink))
        if self.bytewise and kind in INTEGER_FORMATS:
            packet[10:14] = struct.pack(INTEGER_FORMATS[kind], int(value)).ljust(4, b"\0")
            crc = dialect.x25crc(packet[1:-2])
            crc.accumulate(bytes([message.crc_extra]))
            packet[-2:] = struct.pack("<H", crc.crc)
        return bytes(packet)

    def hash_packet(self) -> bytes:
        """PX4's _HASH_CHECK: bit by bit, the reflected CRC-32 polynomial without inversions."""
        crc = 0
        for name in sorted(self.table):
            value, kind = self.table[name]
            form = INTEGER_FORMATS.get(kind, "<f")
            for byte in name.encode() + struct.pack(form, value).ljust(4, b"\0"):
                crc ^= byte
                for _ in range(8):
                    crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
        message = dialect.MAVLink_param_value_message(b"_HASH_CHECK", 0.0, 5, len(self.table), 65535)
        packet = bytearray(message.pack(self.mavlink))
        packet[10:14] = struct.pack("<I", crc)
        checksum = dialect.x25crc(packet[1:-2])
        checksum.accumulate(bytes([message.crc_extra]))
        packet[-2:] = struct.pack("<H", checksum.crc)
        return bytes(packet)

    def handle(self, message: Any) -> None:
        kind = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            names = list(self.table)[: self.list_stops_after]
            self.waiting += [(name, index) for index, name in enumerate(names)]
        elif kind == "PARAM_REQUEST_READ":
            names = list(self.table)
            if message.param_index >= 0:
                if message.param_index < len(names):
                    self.waiting.append((names[message.param_index], message.param_index))
            elif message.param_id in self.table:
                self.waiting.append((message.param_id, 65535))
            else:
                self.errors.append((message.param_id, dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST))
        elif kind == "PARAM_SET" and message.param_id in self.table:
            self.set(message)

    def set(self, message: Any) -> None:
        self.sets_received += 1
        name, entry = message.param_id, self.table[message.param_id]
        assert message.param_type == entry[1]
        if name in self.read_only:
            self.errors.append((name, dialect.MAV_PARAM_ERROR_READ_ONLY))
        else:
            entry[0] = self.stored(name, entry[1], message.param_value, bytes(message.get_msgbuf()[10:14]))
            self.table.update({key: list(value) for key, value in self.enables.get(name, {}).items() if entry[0]})
        if name not in self.silent_sets:
            self.waiting.append((name, 65535))

    def stored(self, name: str, kind: int, field: float, raw: bytes) -> float:
        if kind in INTEGER_FORMATS and self.bytewise:
            size = struct.calcsize(INTEGER_FORMATS[kind])
            value = struct.unpack(INTEGER_FORMATS[kind], raw[:size])[0]
        elif kind in INTEGER_FORMATS:
            value = int(field + (0.01 if field >= 0 else -0.01))  # AP_Param::set_float
        else:
            value = field
        low, high = self.limits.get(name, (value, value))
        return min(max(value, low), high)

    def transmit(self, at_most: int) -> list[bytes]:
        packets = [self.packet(*each) for each in self.waiting[:at_most]]
        if self.hash and ("P0000", 0) in self.waiting[:at_most]:
            packets.insert(0, self.hash_packet())
        if self.says_errors:
            for name, error in self.errors:
                message = dialect.MAVLink_param_error_message(255, 190, name.encode(), -1, error)
                packets.append(bytes(message.pack(self.mavlink)))
        self.errors.clear()
        del self.waiting[:at_most]
        return packets


class BadLink:
    """Loses, repeats and delays packets; everything from one seed."""

    def __init__(
        self, seed: int, loss: float, repeat: float = 0.0, delay_s: tuple[float, float] = (0.01, 0.01)
    ) -> None:
        self.random = random.Random(seed)
        self.loss, self.repeat, self.delay_s = loss, repeat, delay_s
        self.under_way: list[tuple[float, int, bytes]] = []
        self.number = 0

    def send(self, now: float, packet: bytes) -> None:
        for _ in range(2 if self.random.random() < self.repeat else 1):
            if self.random.random() >= self.loss:
                self.number += 1
                self.under_way.append((now + self.random.uniform(*self.delay_s), self.number, packet))

    def arrived(self, now: float) -> list[bytes]:
        ready = sorted(each for each in self.under_way if each[0] <= now)
        self.under_way = [each for each in self.under_way if each[0] > now]
        return [packet for _, _, packet in ready]


def converse(
    client: Any, vehicle: ParameterVehicle, up: BadLink, down: BadLink, limit_s: float, rate: int = 20
) -> float:
    """Let both talk on a manual clock of 20 ms ticks until the client is finished; returns the seconds it took."""
    from autopilot.links.mavlink_codec import MavlinkCodec

    ground, aboard = MavlinkCodec(255, 190), MavlinkCodec(1, 1)
    tick = 0
    while not client.finished:
        now = 0.02 * tick
        assert now < limit_s, f"not finished after {limit_s} s: {client.progress}"
        for message in client.due(now):
            up.send(now, ground.encode(message))
        for packet in up.arrived(now):
            for message in aboard.decode(packet):
                vehicle.handle(message)
        for packet in vehicle.transmit(rate):
            down.send(now, packet)
        for packet in down.arrived(now):
            for message in ground.decode(packet):
                client.receive(now, message)
        tick += 1
    return 0.02 * tick
