"""MAVLink FTP, reading one file after the other: open, read until the end, close. Pure.

Source: https://mavlink.io/en/services/ftp.html. Plain reads, not bursts: the files are small.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.boat.file_server import ACK, DATA_MAX, END, HEADER, NAK, OPEN, PAYLOAD, READ, TERMINATE
from autopilot.links.mavlink_codec import Message
from autopilot.params.protocol import Target

AGAIN_S = 0.4
TRIES = 8
FILE_MOST = 1_000_000
SESSION = 1

Got = Callable[[bytes | None], None]


class FtpClient:
    """`fetch` asks for a file; its content, or None, comes to the callback."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[str, Got]] = deque()
        self._content: bytes | None = None
        self._sequence = 0
        self._tries = 0
        self._next = -math.inf
        self._closing = False

    def fetch(self, path: str, got: Got) -> None:
        """Ask for a file by its path; asked for already, it is not asked for twice."""
        if all(path != waiting for waiting, _ in self._waiting):
            self._waiting.append((path, got))

    def receive(self, now: float, message: Message) -> None:
        """Take a FILE_TRANSFER_PROTOCOL message of the boat."""
        raw = bytes(message.payload)
        sequence, session, opcode, size, asked, _, offset = HEADER.unpack_from(raw)
        if not self._waiting or session != SESSION or sequence != (self._sequence + 1) & 0xFFFF or self._tries == 0:
            return
        data = raw[HEADER.size : HEADER.size + min(size, DATA_MAX)]
        if opcode == ACK:
            self._advance(asked, offset, data)
        elif opcode == NAK:
            self._end(self._content if data[:1] == bytes([END]) else None)

    def due(self, now: float, target: Target) -> list[Message]:
        """Return what to send at `now` [s]."""
        messages = []
        if self._closing:
            self._closing = False
            messages.append(self._message(target, TERMINATE, 0, b""))
        if not self._waiting or now < self._next:
            return messages
        if self._tries >= TRIES:
            self._end(None)
            return messages
        self._tries += 1
        self._next = now + AGAIN_S
        if self._content is None:
            messages.append(self._message(target, OPEN, 0, self._waiting[0][0].encode()))
        else:
            messages.append(self._message(target, READ, len(self._content), b""))
        return messages

    def _advance(self, asked: int, offset: int, data: bytes) -> None:
        if asked == OPEN and self._content is None:
            self._content = b""
        elif asked == READ and self._content is not None and offset == len(self._content) and data:
            self._content += data
        else:
            return
        if len(self._content) > FILE_MOST:
            self._end(None)
            return
        self._tries, self._next = 0, -math.inf
        self._sequence = (self._sequence + 2) & 0xFFFF

    def _end(self, content: bytes | None) -> None:
        _, got = self._waiting.popleft()
        self._closing = self._content is not None
        self._content = None
        self._tries, self._next = 0, -math.inf
        self._sequence = (self._sequence + 2) & 0xFFFF
        got(content)

    def _message(self, target: Target, opcode: int, offset: int, data: bytes) -> Message:
        size = len(data) if opcode == OPEN else DATA_MAX
        payload = HEADER.pack(self._sequence, SESSION, opcode, size, 0, 0, offset) + data
        padded = payload + bytes(PAYLOAD - len(payload))
        return dialect.MAVLink_file_transfer_protocol_message(0, target.system, target.component, list(padded))
