"""Transports: UDP, TCP, serial, and a loopback that needs no hardware. None of them blocks."""

from __future__ import annotations

from collections import deque

from autopilot.links.base import LinkError, Transport
from autopilot.links.transports.serial_line import SerialTransport
from autopilot.links.transports.sockets import TcpClientTransport, TcpServerTransport, UdpInTransport, UdpOutTransport

__all__ = [
    "LoopbackTransport",
    "SerialTransport",
    "TcpClientTransport",
    "TcpServerTransport",
    "UdpInTransport",
    "UdpOutTransport",
    "loopback_pair",
]

QUEUE_LIMIT = 10000
"""Chunks that may wait in a loopback before `send` answers that it would block."""


class LoopbackTransport(Transport):
    """One end of a loopback: what one end sends the other receives, in order, boundaries kept.

    Attributes:
        closed: whether this end has been closed.
    """

    def __init__(self, name: str, incoming: deque[bytes], outgoing: deque[bytes]) -> None:
        self.name = name
        self.is_stream = False
        self.is_local = True
        self._incoming = incoming
        self._outgoing = outgoing
        self.closed = False
        self._peer: LoopbackTransport | None = None

    def connect(self, peer: LoopbackTransport) -> None:
        """Name the other end, so that its closing is noticed."""
        self._peer = peer

    def fileno(self) -> int:
        """Return -1: there is nothing to wait on."""
        return -1

    def receive(self) -> list[bytes]:
        """Return every chunk that waits; LinkError when none is left and either end is closed."""
        chunks = list(self._incoming)
        self._incoming.clear()
        if not chunks:
            self._check_open()
        return chunks

    def send(self, data: bytes) -> bool:
        """Queue `data` at the other end; False when its queue is full, LinkError when either end is closed."""
        self._check_open()
        if len(self._outgoing) >= QUEUE_LIMIT:
            return False
        self._outgoing.append(bytes(data))
        return True

    def close(self) -> None:
        """Close this end."""
        self.closed = True

    def _check_open(self) -> None:
        if self.closed:
            raise LinkError(f"{self.name}: this end is closed; open a new pair")
        if self._peer is not None and self._peer.closed:
            raise LinkError(f"{self.name}: the other end has closed; open a new pair")


def loopback_pair(name: str = "loopback") -> tuple[LoopbackTransport, LoopbackTransport]:
    """Return two connected transports, deterministic and without a clock: what one sends the other receives."""
    there: deque[bytes] = deque()
    back: deque[bytes] = deque()
    first = LoopbackTransport(f"{name}:a", back, there)
    second = LoopbackTransport(f"{name}:b", there, back)
    first.connect(second)
    second.connect(first)
    return first, second
