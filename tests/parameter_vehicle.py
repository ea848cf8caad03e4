"""A vehicle's side of the parameter protocol for tests, over a link that loses, repeats and reorders packets.

Written from the protocol's description, independently of the client: its own table, its own casts.
"""

from __future__ import annotations

import json
import lzma
import random
import struct
import zlib
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.frames import ComponentInformation, ComponentMetadata

INTEGER_FORMATS = {1: "<B", 2: "<b", 3: "<H", 4: "<h", 5: "<I", 6: "<i"}


FTP = struct.Struct("<HBBBBBxI")
GENERAL_URI = "mftp://etc/extras/component_general.json.xz"
PARAMETERS_URI = "mftp://etc/extras/parameters.json.xz"


class FtpServer:
    """Files over MAVLink FTP as PX4 serves them (mavlink_ftp.cpp): one session, number 0, closed before the next."""

    def __init__(self, files: dict[str, bytes]) -> None:
        self.files = files
        self.sizes: dict[str, int] = {}
        self.session = 0
        self.piece_most = 239
        self.open: bytes | None = None
        self.last: tuple[int, bytes] | None = None
        self.opened: list[str] = []

    def answer(self, raw: bytes) -> bytes:
        sequence, session, opcode, size, _, _, offset = FTP.unpack_from(raw)
        if self.last is not None and self.last[0] == sequence:
            return self.last[1]
        error, data = self.work(session, opcode, offset, raw[12 : 12 + size])
        found = bytes([error]) if error else data
        given = self.session if opcode == 4 and not error else session
        reply = FTP.pack((sequence + 1) & 0xFFFF, given, 129 if error else 128, len(found), opcode, 0, offset) + found
        # only a short answer is kept to be said again
        self.last = (sequence, reply) if len(found) <= 4 else None
        return reply

    def work(self, session: int, opcode: int, offset: int, data: bytes) -> tuple[int, bytes]:
        """Return error and data of an opening (4), a reading (5) or a closing (1)."""
        if opcode == 4:
            path = data.decode()
            if self.open is not None:
                return 5, b""
            if path not in self.files:
                return 10, b""
            self.opened.append(path)
            self.open = self.files[path]
            return 0, self.sizes.get(path, len(self.open)).to_bytes(4, "little")
        if session != self.session or self.open is None:
            return 4, b""
        if opcode == 5:
            return (6, b"") if offset >= len(self.open) else (0, self.open[offset : offset + self.piece_most])
        if opcode == 1:
            self.open = None
            return 0, b""
        return 7, b""


def described(parameters: list[dict[str, Any]]) -> FtpServer:
    """A vehicle's metadata as PX4 builds them (generate_component_general.py, jsonout.py)."""
    table = json.dumps({"version": 1, "parameters": parameters, "translation": {}}, indent=2).encode()
    packed = lzma.compress(table, preset=6)
    types = [
        {"type": 4, "uri": "mftp://etc/extras/all_events.json.xz", "fileCrc": 1, "uriFallback": "https://px4.invalid/"},
        {"type": 1, "uri": PARAMETERS_URI, "fileCrc": zlib.crc32(packed, 0xFFFFFFFF) ^ 0xFFFFFFFF, "uriFallback": ""},
    ]
    general = json.dumps({"version": 1, "metadataTypes": types}).encode()
    paths = [uri.replace("mftp:/", "") for uri in (GENERAL_URI, PARAMETERS_URI)]
    return FtpServer(dict(zip(paths, (lzma.compress(general), packed), strict=True)))


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
        self.deaf_after: int | None = None
        """After so many sets it hears no more of them."""
        self.mavlink = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self.waiting: list[tuple[str, int]] = []
        self.replies: list[bytes] = []
        self.refuses_commands = True
        self.ftp = FtpServer({})
        self.uri: dict[int, str] = {}
        """Of the message 397 (COMPONENT_METADATA), or the older 395, where there are metadata."""

    def describe(self, parameters: list[dict[str, Any]]) -> None:
        """Offer metadata of these parameters."""
        self.ftp, self.uri = described(parameters), {397: GENERAL_URI}

    def command(self, command: int, wanted: int) -> None:
        uri = self.uri.get(wanted) if command == dialect.MAV_CMD_REQUEST_MESSAGE else None
        if uri is None and not self.refuses_commands:
            return
        if uri is not None:
            place = uri.encode()
            kind = ComponentMetadata(7, 0, place) if wanted == 397 else ComponentInformation(7, 0, place, 0, b"")
            self.replies.append(bytes(kind.pack(self.mavlink)))
        result = dialect.MAV_RESULT_FAILED if uri is None else dialect.MAV_RESULT_ACCEPTED
        self.replies.append(bytes(dialect.MAVLink_command_ack_message(command, result).pack(self.mavlink)))

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
        if kind == "COMMAND_LONG":
            self.command(message.command, int(message.param1))
        elif kind == "FILE_TRANSFER_PROTOCOL":
            reply = list(self.ftp.answer(bytes(message.payload)).ljust(251, b"\0"))
            self.replies.append(
                bytes(dialect.MAVLink_file_transfer_protocol_message(0, 255, 0, reply).pack(self.mavlink))
            )
        elif kind == "PARAM_REQUEST_LIST":
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
        if self.deaf_after is not None and self.sets_received >= self.deaf_after:
            return
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
        packets += self.replies[:at_most]
        del self.waiting[:at_most], self.replies[:at_most]
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
    client: Any,
    vehicle: ParameterVehicle,
    up: BadLink,
    down: BadLink,
    limit_s: float,
    rate: int = 20,
    begin: float = 0.0,
) -> float:
    """Let both talk on a manual clock of 20 ms ticks from `begin` until the client is finished; returns the seconds."""
    from autopilot.links.mavlink.codec import MavlinkCodec

    ground, aboard = MavlinkCodec(255, 190), MavlinkCodec(1, 1)
    tick = 0
    while not client.finished:
        now = begin + 0.02 * tick
        assert 0.02 * tick < limit_s, f"not finished after {limit_s} s: {client.progress}"
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
