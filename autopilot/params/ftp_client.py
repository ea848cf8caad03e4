"""MAVLink FTP, reading one file after the other: open, read in pieces, close. Pure.

Source: https://mavlink.io/en/services/ftp.html. Plain reads, a few under way at once, not bursts: what is lost is asked
for again by its place. The session is the one that the answer to the opening names: PX4 (mavlink_ftp.cpp) has a single
one, number 0, and opens no other file until it is closed, so that closing waits for its answer too.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.boat.file_server import ACK, DATA_MAX, HEADER, NAK, OPEN, PAYLOAD, READ, TERMINATE
from autopilot.links.mavlink_codec import Message
from autopilot.params.protocol import Target
from autopilot.params.requests import Patience, Requests

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
        """Want no file any more; nobody is called back."""
        self._waiting.clear()
        self._close()

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
        """The next question is a new one."""
        self._tries, self._next = 0, -math.inf


def _after(sequence: int) -> int:
    """The number of the next question: the one between is the answer's."""
    return (sequence + 2) & 0xFFFF


def _message(target: Target, sequence: int, session: int, opcode: int, data: bytes = b"", offset: int = 0) -> Message:
    size = DATA_MAX if opcode == READ else len(data)
    payload = HEADER.pack(sequence, session, opcode, size, 0, 0, offset) + data
    padded = payload + bytes(PAYLOAD - len(payload))
    return dialect.MAVLink_file_transfer_protocol_message(0, target.system, target.component, list(padded))
