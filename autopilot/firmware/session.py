"""A vehicle on a real link: found by its heartbeat, then asked until a protocol client is finished.

One client is here: MAVLink FTP, reading one file after the other: open, read in pieces, close.
Source: https://mavlink.io/en/services/ftp.html. Plain reads, a few under way at once, not bursts: what is lost is asked
for again by its place. The session is the one that the answer to the opening names: PX4 (mavlink_ftp.cpp) has a single
one, number 0, and opens no other file until it is closed, so that closing waits for its answer too.
"""

from __future__ import annotations

import math
import select
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.firmware.protocol import BYTEWISE_AUTOPILOTS, Message, Patience, Requests, Target, is_from
from autopilot.links.base import LinkError, Transport
from autopilot.links.ground_station.file_server import ACK, DATA_MAX, HEADER, NAK, OPEN, PAYLOAD, READ, TERMINATE
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.requests import station_heartbeat
from autopilot.links.mavlink.signing import Signing, hint_of
from autopilot.links.url import accept_signed, open_transport, parse_url

GROUND_STATION_SYSTEM = 255
"""The id that ground stations use, so that a vehicle that enforces its SYSID_MYGCS still listens."""
GROUND_STATION_COMPONENT = dialect.MAV_COMP_ID_MISSIONPLANNER
NORRBIN = "norrbin"
"""What a running Norrbin is called among the kinds of firmware; a boat with a generic autopilot may be one."""
HEARTBEAT_WAIT_S = 10.0
OTHERS_WAIT_S = 1.2
"""After the first heartbeat, so long for others: vehicles send one a second."""
SILENCE_MAX_S = 10.0
IDENTITY_WAIT_S = 1.2
IDENTITY_INTERVAL_S = 0.4
TICK_S = 0.02
Progress = Callable[[int, int], None]


class Client(Protocol):
    """A protocol client without I/O, such as `Download` and `Upload`."""

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to do."""

    @property
    def progress(self) -> tuple[int, int]:
        """Done, of how much."""

    def receive(self, now: float, message: Any) -> None:
        """Take a message."""

    def due(self, now: float) -> list[Any]:
        """Return the messages to send."""


class Vehicle(NamedTuple):
    """Who answers: ids, MAV_AUTOPILOT and MAV_TYPE from its heartbeat, and whether it is armed."""

    system: int
    component: int
    autopilot: int
    kind: int
    armed: bool

    @property
    def target(self) -> Target:
        """Whom to address, and how integers travel."""
        return Target(self.system, self.component, self.autopilot in BYTEWISE_AUTOPILOTS)

    @property
    def firmware(self) -> str:
        """`ardurover`, `px4`, `norrbin`, or a description of something else."""
        is_rover = self.kind in (dialect.MAV_TYPE_GROUND_ROVER, dialect.MAV_TYPE_SURFACE_BOAT)
        if self.autopilot == dialect.MAV_AUTOPILOT_ARDUPILOTMEGA and is_rover:
            return "ardurover"
        if self.autopilot == dialect.MAV_AUTOPILOT_PX4:
            return "px4"
        if self.autopilot == dialect.MAV_AUTOPILOT_GENERIC and self.kind == dialect.MAV_TYPE_SURFACE_BOAT:
            return NORRBIN
        return f"neither ArduRover nor PX4 (MAV_AUTOPILOT {self.autopilot}, MAV_TYPE {self.kind})"


class Identity(NamedTuple):
    """Which board and which version of its firmware answers, each empty where it does not say."""

    uid: str = ""
    version: str = ""


class AskIdentity:
    """Asks for AUTOPILOT_VERSION, a few times; `identity` is empty where the vehicle does not tell."""

    def __init__(self, target: Target) -> None:
        self._target = target
        self._start: float | None = None
        self._next = 0.0
        self.identity = Identity()
        self.finished = False
        self.progress = (0, 1)

    def receive(self, now: float, message: Any) -> None:
        """Take any message."""
        if message.get_type() != "AUTOPILOT_VERSION" or not is_from(message, self._target):
            return
        uid = bytes(message.uid2).rstrip(b"\0").hex() or (f"{message.uid:x}" if message.uid else "")
        number = message.flight_sw_version
        version = f"{number >> 24}.{number >> 16 & 255}.{number >> 8 & 255}" if number else ""
        self.identity = Identity(uid, version)
        self.finished = True

    def due(self, now: float) -> list[Any]:
        """Return the messages to send now."""
        if self._start is None:
            self._start = now
        if now - self._start >= IDENTITY_WAIT_S:
            self.finished = True
        if self.finished or now < self._next:
            return []
        self._next = now + IDENTITY_INTERVAL_S
        system, component, _ = self._target
        wanted = dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION
        command = dialect.MAV_CMD_REQUEST_MESSAGE
        return [dialect.MAVLink_command_long_message(system, component, command, 0, wanted, 0, 0, 0, 0, 0, 0)]


class ParameterSession:
    """One vehicle on one link, for as long as parameters are exchanged. Use it as a context manager.

    `signing`: everything sent is signed, and nothing is heard that is not.

    Raises InputError for a URL that is no MAVLink link, LinkError when it cannot be opened, when no heartbeat
    of a vehicle comes, or when the vehicle falls silent.
    """

    def __init__(self, url: str, system: int | None = None, signing: Signing | None = None) -> None:
        link = parse_url(url)
        if link.protocol != "mavlink":
            raise InputError(f"link {url!r}: parameters travel over MAVLink; give a udpin, udpout, tcp or serial link.")
        self._transport: Transport = open_transport(link)
        ours = signing.link() if signing is not None else None
        accept_signed(self._transport, ours)
        self._signing = signing
        self._codec = MavlinkCodec(GROUND_STATION_SYSTEM, GROUND_STATION_COMPONENT, self._transport.is_stream, ours)
        self._next_heartbeat = 0.0
        self._url = url
        try:
            self.vehicle = self._find(system)
        except BaseException:
            self._transport.close()
            raise

    def __enter__(self) -> ParameterSession:
        return self

    def __exit__(self, *_: object) -> None:
        self._transport.close()

    def run(self, client: Client, progress: Progress) -> None:
        """Drive `client` until it is finished; LinkError when the vehicle falls silent meanwhile."""
        received = time.monotonic()
        while not client.finished:
            now = time.monotonic()
            for message in self._receive():
                if message.get_srcSystem() == self.vehicle.system:
                    received = now
                    # whether it is armed may have changed
                    self.vehicle = vehicle_of(message) or self.vehicle
                client.receive(now, message)
            for message in client.due(now):
                # a full line drops it, and the client asks again
                self._transport.send(self._codec.encode(message))
            if now - received > SILENCE_MAX_S:
                raise LinkError(
                    f"link {self._url!r}: vehicle {self.vehicle.system} has been silent for {SILENCE_MAX_S:g} s; "
                    "check the cable or the radio, and run this command again."
                )
            progress(*client.progress)
            self._send_heartbeat(now)
            if not client.finished:
                self._wait()

    def identify(self) -> Identity:
        """Return what the vehicle says of itself, nothing where it does not answer."""
        client = AskIdentity(self.vehicle.target)
        self.run(client, lambda done, total: None)
        return client.identity

    def _receive(self) -> list[Any]:
        return self._codec.decoded(self._transport.receive())

    def _wait(self) -> None:
        descriptor = self._transport.fileno()
        if descriptor >= 0:
            select.select([descriptor], [], [], TICK_S)
        else:
            time.sleep(TICK_S)

    def _send_heartbeat(self, now: float) -> None:
        if now < self._next_heartbeat:
            return
        self._next_heartbeat = now + 1.0
        self._transport.send(self._codec.encode(station_heartbeat()))

    def _find(self, system: int | None) -> Vehicle:
        """Wait for the vehicle; of several, the one with the id asked for."""
        start = time.monotonic()
        deadline = start + HEARTBEAT_WAIT_S
        found: dict[int, Vehicle] = {}
        while (now := time.monotonic()) < deadline:
            for vehicle in map(vehicle_of, self._receive()):
                if vehicle is None or vehicle.system in found:
                    continue
                if not found and system is None:
                    deadline = now + OTHERS_WAIT_S
                found[vehicle.system] = vehicle
            if system in found:
                return found[system]
            self._send_heartbeat(now)
            self._wait()
        return self._chosen(found, system)

    def _chosen(self, found: dict[int, Vehicle], system: int | None) -> Vehicle:
        ids = ", ".join(str(number) for number in sorted(found))
        if not found:
            raise LinkError(
                f"link {self._url!r}: no heartbeat of a vehicle within {HEARTBEAT_WAIT_S:g} s; check that it is "
                f"powered, that it sends to this port, and the baud rate.{hint_of(self._signing)}"
            )
        if system is not None:
            raise LinkError(f"link {self._url!r}: no vehicle with system id {system}; heard: {ids}.")
        if len(found) > 1:
            raise LinkError(f"link {self._url!r}: several vehicles are heard ({ids}); choose one with --system.")
        return next(iter(found.values()))


def vehicle_of(message: Any) -> Vehicle | None:
    """Return the vehicle that sent a heartbeat; None for other messages, ground stations and companions."""
    if message.get_type() != "HEARTBEAT" or message.autopilot == dialect.MAV_AUTOPILOT_INVALID:
        return None
    if message.get_srcComponent() != dialect.MAV_COMP_ID_AUTOPILOT1:
        return None
    armed = bool(message.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED)
    return Vehicle(message.get_srcSystem(), message.get_srcComponent(), message.autopilot, message.type, armed)


AGAIN_S = 0.4
TRIES = 8
CLOSING_TRIES = 4
FILE_MOST = 1_000_000
SESSION = 1
"""The number asked for; who serves may give another."""
READS = Patience(interval_s=1.0, tries=8, window=4)
"""Four answers of 280 bytes take a telemetry radio a third of a second."""
Got = Callable[[bytes | None], None]


class _Reading:
    """A file that is open: its pieces by their place, and which question asked for which of them."""

    def __init__(self, session: int, size: int) -> None:
        self.session, self.size = session, size
        self.pieces: dict[int, bytes] = {}
        self.asked: dict[int, int] = {}
        self.requests: Requests[int] = Requests(range(0, size, DATA_MAX), READS)


class FtpClient:
    """`fetch` asks for a file; its content, or None, comes to the callback."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[str, Got]] = deque()
        self._reading: _Reading | None = None
        self._closing: int | None = None
        self._sequence = 0
        self._tries = 0
        self._next = -math.inf

    @property
    def is_idle(self) -> bool:
        """Whether no file is wanted and none is open."""
        return not self._waiting and self._closing is None

    @property
    def progress(self) -> tuple[int, int]:
        """How many bytes of the file that is open have come, of how many; 0 of 0 where none is."""
        reading = self._reading
        return (0, 0) if reading is None else (min(DATA_MAX * len(reading.pieces), reading.size), reading.size)

    def fetch(self, path: str, got: Got) -> None:
        """Ask for a file by its path; asked for already, it is not asked for twice."""
        if all(path != waiting for waiting, _ in self._waiting):
            self._waiting.append((path, got))

    def abandon(self) -> None:
        """Want no file any more: None comes for each."""
        waiting, self._waiting = self._waiting, deque()
        self._close()
        for _, got in waiting:
            got(None)

    def receive(self, now: float, message: Message) -> None:
        """Take a FILE_TRANSFER_PROTOCOL message of the boat."""
        raw = bytes(message.payload)
        sequence, session, opcode, size, asked, _, offset = HEADER.unpack_from(raw)
        if opcode not in (ACK, NAK):
            return
        is_good = opcode == ACK
        question = (sequence - 1) & 0xFFFF
        data = raw[HEADER.size : HEADER.size + min(size, DATA_MAX)]
        if self._reading is not None:
            place = self._reading.asked.get(question)
            if asked == READ and session == self._reading.session and place is not None:
                self._take(now, self._reading, place, data if is_good and place == offset else None)
        elif question != self._sequence or self._tries == 0:
            return
        elif asked == TERMINATE and self._closing is not None:
            self._closing = None
            self._settle()
        elif asked == OPEN and self._closing is None and self._waiting:
            self._opened(session, int.from_bytes(data, "little") if is_good and len(data) == 4 else None)

    def due(self, now: float, target: Target) -> list[Message]:
        """Return what to send at `now` [s]."""
        if self._reading is not None:
            return self._reads(now, target, self._reading)
        if self.is_idle or now < self._next:
            return []
        if self._tries >= (TRIES if self._closing is None else CLOSING_TRIES):
            if self._closing is None:
                self._end(None)
            self._closing = None
            self._settle()
            return []
        if self._tries == 0:
            self._sequence = _after(self._sequence)  # repeated, a question keeps its number: it is carried out once
        self._tries += 1
        self._next = now + AGAIN_S
        if self._closing is not None:
            return [_message(target, self._sequence, self._closing, TERMINATE)]
        return [_message(target, self._sequence, SESSION, OPEN, self._waiting[0][0].encode())]

    def _opened(self, session: int, size: int | None) -> None:
        self._settle()
        if size is None:
            self._end(None)
            return
        self._reading = _Reading(session, size)
        if size > FILE_MOST:
            self._end(None)
        elif size == 0:
            self._end(b"")

    def _reads(self, now: float, target: Target, reading: _Reading) -> list[Message]:
        messages = []
        for place in reading.requests.due(now):
            self._sequence = _after(self._sequence)
            reading.asked[self._sequence] = place
            messages.append(_message(target, self._sequence, reading.session, READ, offset=place))
        if reading.requests.given_up:
            self._end(None)
        return messages

    def _take(self, now: float, reading: _Reading, place: int, data: bytes | None) -> None:
        """Take a piece; one that is refused, or not as long as the file's size says, ends the file."""
        if data is None or len(data) != min(DATA_MAX, reading.size - place):
            self._end(None)
            return
        reading.pieces[place] = data
        reading.requests.answered(place, now)
        if reading.requests.done:
            self._end(b"".join(reading.pieces[each] for each in sorted(reading.pieces)))

    def _end(self, content: bytes | None) -> None:
        _, got = self._waiting.popleft()
        self._close()
        got(content)

    def _close(self) -> None:
        if self._reading is not None:
            self._closing, self._reading = self._reading.session, None
        self._settle()

    def _settle(self) -> None:
        self._tries, self._next = 0, -math.inf


def _after(sequence: int) -> int:
    return (sequence + 2) & 0xFFFF


def _message(target: Target, sequence: int, session: int, opcode: int, data: bytes = b"", offset: int = 0) -> Message:
    size = DATA_MAX if opcode == READ else len(data)
    payload = HEADER.pack(sequence, session, opcode, size, 0, 0, offset) + data
    padded = payload + bytes(PAYLOAD - len(payload))
    return dialect.MAVLink_file_transfer_protocol_message(0, target.system, target.component, list(padded))
