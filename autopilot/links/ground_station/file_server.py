"""MAVLink FTP, read only: a handful of files, listed, read, burst and summed. Pure.

Source: https://mavlink.io/en/services/ftp.html, as QGroundControl (FTPManager.cc), MAVProxy and pymavlink's mavftp use
it: a burst is numbered on from its request, its last packet says so, and a read behind the end is refused with EOF.

The alarms that are on, as a file for ground stations: STATUSTEXT tells when an alarm begins, never when it ends.

Where ground stations find the description of our parameters: COMPONENT_METADATA, and its older form.

What a ground station reads about our parameters: component metadata, JSON files that it fetches over MAVLink FTP.

Source: https://mavlink.io/en/services/component_information.html with general.schema.json and parameter.schema.json
of the folder component_metadata of the repository mavlink/mavlink. QGroundControl takes parameter files of version 1
(CompInfoParam.cc), which is also what PX4 sends.
"""

from __future__ import annotations

import json
import lzma
import math
import struct
import zlib
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.estimation.sensor_selection import Compass
from autopilot.guidance.track import Waypoint
from autopilot.links.mavlink.codec import Message
from autopilot.links.mavlink.frames import ComponentInformation, ComponentMetadata
from autopilot.signals import AlarmEvent, AlarmState
from autopilot.supervision.alarms import OTHER, kind_of
from autopilot.supervision.panel import sentence_of
from autopilot.vessel.parameters import VesselParameter
from autopilot.vessel.schema import RESTART

ALARMS = "/alarms.json"
"""A list over MAVLink FTP; to be read again when the value `alarms`, how many are on, or `alarms_new`, how many of them
nobody has acknowledged, changes."""


def alarm_list(alarms: Sequence[AlarmEvent], alarm_states: Sequence[AlarmState]) -> bytes:
    """Return the file: of each alarm its name ("" where it has no kind), its priority (`emergency`, `alarm`, `warning`,
    `caution`), its words, its state (`notice`, `sounding`, `acknowledged`), and whether it is said again because nobody
    acknowledges it. alarm_states: those that are not known count as notices."""
    states = alarm_states if len(alarm_states) == len(alarms) else [AlarmState.NOTICE] * len(alarms)
    entries = [
        {
            "name": "" if event.name == OTHER else event.name,
            "priority": kind_of(event).priority.name.lower(),
            "words": sentence_of(event._replace(is_escalated=False)),
            "state": state.name.lower(),
            "escalated": event.is_escalated,
        }
        for event, state in zip(alarms, states, strict=True)
    ]
    return json.dumps(entries, ensure_ascii=False, separators=(",", ":")).encode()


ROUTE = "/route.json"
"""The waypoints over MAVLink FTP; how many there are stands in MISSION_CURRENT."""


def route_list(route: Sequence[Waypoint]) -> bytes:
    """Return the file: latitude and longitude [deg] of each waypoint."""
    places = [[round(math.degrees(each.latitude), 7), round(math.degrees(each.longitude), 7)] for each in route]
    return json.dumps(places, separators=(",", ":")).encode()


COMPASSES = "/compasses.json"
"""The compasses that the boat hears over MAVLink FTP; to be read again when the value `cmp_n`, how many, changes."""


def compass_list(compasses: Sequence[Compass]) -> bytes:
    """Return the file: the name of each compass, its link, and whether it measures from magnetic north."""
    entries = []
    for each in compasses:
        name, _, link = each.source.partition("@")
        entries.append({"name": name, "link": link, "magnetic": each.is_magnetic})
    return json.dumps(entries, ensure_ascii=False, separators=(",", ":")).encode()


HEADER = struct.Struct("<HBBBBBxI")
"""Sequence, session, opcode, size, opcode asked for, burst complete, padding, offset."""
PAYLOAD = 251
DATA_MAX = PAYLOAD - HEADER.size
NONE, TERMINATE, RESET, LIST, OPEN, READ, CHECKSUM, BURST = 0, 1, 2, 3, 4, 5, 14, 15
WRITING = frozenset({6, 7, 8, 9, 10, 11, 12, 13})
"""Create, write, remove, make and remove folders, open for writing, truncate, rename."""
ACK, NAK = 128, 129
BAD_SIZE, BAD_SESSION, END, UNKNOWN, PROTECTED, NOT_FOUND = 3, 4, 6, 7, 9, 10
MOST_SESSIONS = 8
"""Files open at once; of more, the one not read for longest is closed: its reader may have gone."""
BURST_PACKETS = 40
PER_TURN = 5
"""Packets of bursts that leave in one turn of the loop, all bursts together."""

Session = tuple[int, int, int]
"""System and component of who asks, and the number it has chosen, as ArduPilot takes it; PX4's clients say 0."""


class Request(NamedTuple):
    """What is asked for; `data` has `size` bytes where it is a name, else none."""

    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes


class _Burst(NamedTuple):
    content: bytes
    offset: int
    chunk: int
    sequence: int
    packets: int


Content = bytes | Callable[[], bytes]
"""A file as it stays, or what makes it as it is now."""


def checksum(content: bytes) -> int:
    """Return the CRC-32 of MAVLink FTP: as zlib's, but begun with 0 and not inverted at the end."""
    return zlib.crc32(content, 0xFFFFFFFF) ^ 0xFFFFFFFF


class FileServer:
    """Serves `files`: absolute path ("/general.json") to content; what is made anew is made when it is opened."""

    def __init__(self, files: Mapping[str, Content]) -> None:
        self._files = dict(files)
        self._open: OrderedDict[Session, bytes] = OrderedDict()
        self._bursts: OrderedDict[Session, _Burst] = OrderedDict()
        self._answers: OrderedDict[Session, tuple[bytes, bytes]] = OrderedDict()

    def take(self, message: Message) -> list[Message]:
        """Return the answer to a FILE_TRANSFER_PROTOCOL message; a burst follows with `due`."""
        raw = bytes(message.payload)
        sequence, number, opcode, size, _, _, offset = HEADER.unpack_from(raw)
        session = (message.get_srcSystem(), message.get_srcComponent(), number)
        if opcode in (ACK, NAK):
            return []
        last = self._answers.get(session)
        if last is not None and last[0] == raw:
            return [_message(session, last[1])]  # our answer was lost: the same again
        request = Request(sequence, number, opcode, size, offset, raw[HEADER.size : HEADER.size + size])
        answer = self._answer(session, request)
        if answer is None:
            self._answers.pop(session, None)  # asked again, a burst begins again
            return []
        self._answers[session] = (raw, answer)
        self._answers.move_to_end(session)
        if len(self._answers) > MOST_SESSIONS:
            self._answers.popitem(last=False)
        return [_message(session, answer)]

    def due(self) -> list[Message]:
        """Return the next few packets of the bursts that are under way, in turn."""
        packets: list[Message] = []
        while self._bursts and len(packets) < PER_TURN:
            session, burst = self._bursts.popitem(last=False)
            packets.append(_message(session, self._burst_packet(session, burst)))
        return packets

    def _answer(self, session: Session, request: Request) -> bytes | None:
        opcode = request.opcode
        if opcode in (TERMINATE, RESET):
            return self._close(session, request)
        if opcode in (LIST, OPEN, CHECKSUM):
            return _nak(request, BAD_SIZE) if request.size > DATA_MAX else self._by_name(session, request)
        if opcode in (READ, BURST):
            return self._read(session, request)
        if opcode == NONE:
            return _ack(request)
        return _nak(request, PROTECTED if opcode in WRITING else UNKNOWN)

    def _close(self, session: Session, request: Request) -> bytes:
        closing = [session] if request.opcode == TERMINATE else [each for each in self._open if each[:2] == session[:2]]
        if request.opcode == TERMINATE and session not in self._open:
            return _nak(request, BAD_SESSION)
        for each in closing:
            self._open.pop(each)
            self._bursts.pop(each, None)
        return _ack(request)

    def _by_name(self, session: Session, request: Request) -> bytes:
        path = "/" + request.data.split(b"\0", 1)[0].decode("utf-8", "replace").strip("/")
        if request.opcode == LIST:
            return self._list(request) if path == "/" else _nak(request, NOT_FOUND)
        if path not in self._files:
            return _nak(request, NOT_FOUND)
        content = _now(self._files[path])
        if request.opcode == CHECKSUM:
            return _ack(request, checksum(content).to_bytes(4, "little"))
        self._bursts.pop(session, None)
        self._open[session] = content
        self._open.move_to_end(session)
        if len(self._open) > MOST_SESSIONS:
            forgotten, _ = self._open.popitem(last=False)
            self._bursts.pop(forgotten, None)
        return _ack(request, len(content).to_bytes(4, "little"))

    def _list(self, request: Request) -> bytes:
        entries = [f"F{path[1:]}\t{len(_now(self._files[path]))}\0".encode() for path in sorted(self._files)]
        listed = b""
        for entry in entries[request.offset :]:
            if len(listed) + len(entry) > DATA_MAX:
                break
            listed += entry
        return _ack(request, listed) if listed else _nak(request, END)

    def _read(self, session: Session, request: Request) -> bytes | None:
        content = self._open.get(session)
        if content is None:
            return _nak(request, BAD_SESSION)
        self._open.move_to_end(session)
        if request.offset >= len(content):
            self._bursts.pop(session, None)
            return _nak(request, END)
        chunk = min(request.size or DATA_MAX, DATA_MAX)
        if request.opcode == READ:
            return _ack(request, content[request.offset : request.offset + chunk])
        first = (request.sequence + 1) & 0xFFFF
        self._bursts[session] = _Burst(content, request.offset, chunk, first, BURST_PACKETS)
        return None

    def _burst_packet(self, session: Session, burst: _Burst) -> bytes:
        data = burst.content[burst.offset : burst.offset + burst.chunk]
        following = burst.offset + len(data)
        is_last = burst.packets == 1 or following >= len(burst.content)
        if not is_last:
            self._bursts[session] = burst._replace(
                offset=following, sequence=(burst.sequence + 1) & 0xFFFF, packets=burst.packets - 1
            )
        return HEADER.pack(burst.sequence, session[2], ACK, len(data), BURST, is_last, burst.offset) + data


def _now(content: Content) -> bytes:
    return content if isinstance(content, bytes) else content()


def _ack(request: Request, data: bytes = b"") -> bytes:
    return _reply(request, ACK, data)


def _nak(request: Request, error: int) -> bytes:
    return _reply(request, NAK, bytes([error]))


def _reply(request: Request, opcode: int, data: bytes) -> bytes:
    sequence = (request.sequence + 1) & 0xFFFF
    return HEADER.pack(sequence, request.session, opcode, len(data), request.opcode, 0, request.offset) + data


def _message(session: Session, payload: bytes) -> Message:
    padded = payload + bytes(PAYLOAD - len(payload))
    return dialect.MAVLink_file_transfer_protocol_message(0, session[0], session[1], list(padded))


GENERAL = "/general.json"
"""The file that names all others; served over MAVLink FTP like them."""
NO_FILES: Mapping[str, bytes] = MappingProxyType({})


def metadata_messages(identity: int, general: bytes | None) -> list[Message]:
    """Return the message `identity` that says where the file `general` is; nothing where there is none."""
    if general is None:
        return []
    uri, crc = f"mftp://{GENERAL}".encode(), checksum(general)
    if identity == ComponentMetadata.id:
        return [ComponentMetadata(0, crc, uri)]
    return [ComponentInformation(0, crc, uri, 0, b"")] if identity == ComponentInformation.id else []


PARAMETERS = "/parameters.json.xz"
PARAMETER_TYPE = 1
"""COMP_METADATA_TYPE_PARAMETER."""


def metadata_files(parameters: Sequence[VesselParameter], version: str) -> dict[str, bytes]:
    """Return the metadata files by path.

    Args:
        parameters: what is described.  version: ours, such as "0.2.0".
    """
    table = {"version": 1, "parameters": [_described(parameter) for parameter in parameters]}
    # a ground station that asks for metadata must be able to expand .xz, and a radio is slow
    packed = lzma.compress(_json(table), format=lzma.FORMAT_XZ, check=lzma.CHECK_CRC32)
    numbers = version.split(".")[:3]
    general: dict[str, Any] = {
        "version": 1,
        "vendorName": "Norrbin",
        "modelName": "Norrbin autopilot",
        "metadataTypes": [{"type": PARAMETER_TYPE, "uri": f"mftp://{PARAMETERS}", "fileCrc": checksum(packed)}],
    }
    if len(numbers) == 3 and all(number.isdecimal() for number in numbers):
        general["firmwareVersion"] = ".".join(numbers)
    return {GENERAL: _json(general), PARAMETERS: packed}


def _described(parameter: VesselParameter) -> dict[str, Any]:
    allowed = f" Allowed: {parameter.allowed}." if parameter.low is not None else ""
    entry: dict[str, Any] = {
        "name": parameter.name,
        "type": "Float",
        "shortDesc": parameter.doc,
        "longDesc": f"{parameter.doc} ({parameter.path} of the vessel file).{allowed}",
        "group": parameter.group,
    }
    if parameter.unit:
        entry["units"] = parameter.unit
    if parameter.low is not None:
        entry["min"] = parameter.low
    if parameter.high is not None:
        entry["max"] = parameter.high
    if parameter.choices:
        entry["values"] = [{"value": number, "description": word} for number, word in enumerate(parameter.choices)]
    if parameter.choices or parameter.is_whole:
        entry["decimalPlaces"] = 0
    if parameter.counts is RESTART:
        entry["rebootRequired"] = True
    return entry


def _json(document: Any) -> bytes:
    return json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
