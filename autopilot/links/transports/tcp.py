"""TCP: a client that connects once, and a server for one client at a time. Both are streams."""

from __future__ import annotations

import socket

from autopilot.links.base import LinkError
from autopilot.links.transports.medium import (
    Allows,
    Medium,
    Scheme,
    WholeChunks,
    everyone,
    is_loopback,
    open_error,
    own_address,
    peer,
    resolve,
)

CONNECT_TIMEOUT_S = 3.0
CHUNK_LIMIT = 65536
RECEIVE_LIMIT = 4
"""Chunks taken in one `receive`: the rest waits in the kernel, and slows down who sends too much."""


class _Connection:
    """One connected, non-blocking socket. A message the kernel took in part is completed before the next."""

    def __init__(self, sock: socket.socket) -> None:
        sock.setblocking(False)
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket = sock
        self._chunks = WholeChunks(self._push)

    def receive(self) -> tuple[list[bytes], bool]:
        """Return the chunks that wait and whether the connection still stands."""
        chunks: list[bytes] = []
        for _ in range(RECEIVE_LIMIT):
            try:
                data = self.socket.recv(CHUNK_LIMIT)
            except BlockingIOError:
                return chunks, True
            except OSError:
                return chunks, False
            if not data:
                return chunks, False
            chunks.append(data)
        return chunks, True

    def send(self, data: bytes) -> bool:
        """Send all or nothing; OSError when the connection has broken."""
        return self._chunks.send(data)

    def _push(self, data: bytes) -> int:
        try:
            return self.socket.send(data)
        except BlockingIOError:
            return 0


class TcpClientTransport:
    """Connects to a host and port; LinkError where nothing answers within `CONNECT_TIMEOUT_S`.

    Opening is the one moment that may wait; afterwards nothing blocks.
    """

    is_stream = True

    def __init__(self, name: str, host: str, port: int) -> None:
        self.name = name
        family, address = resolve(name, host, port, socket.SOCK_STREAM, passive=False)
        sock = socket.socket(family, socket.SOCK_STREAM)
        sock.settimeout(CONNECT_TIMEOUT_S)
        try:
            sock.connect(address)
        except OSError as error:
            sock.close()
            raise open_error(name, error, "connect to", host, port) from error
        self.is_local = is_loopback(str(address[0]))
        self._connection = _Connection(sock)
        self._lost = False
        self._closed = False

    def fileno(self) -> int:
        """Return the socket's descriptor, -1 when closed."""
        return self._connection.socket.fileno()

    def receive(self) -> list[bytes]:
        """Return the chunks that wait; LinkError once the other side has gone and all it sent has been read."""
        if self._lost or self._closed:
            raise self._gone()
        chunks, standing = self._connection.receive()
        self._lost = not standing
        if self._lost and not chunks:
            raise self._gone()
        return chunks

    def send(self, data: bytes) -> bool:
        """Send all of `data` or nothing; LinkError when the connection has broken."""
        try:
            return self._connection.send(data)
        except OSError as error:
            raise self._gone() from error

    def forget_peer(self) -> None:
        """Do nothing: the peer is the one the user wrote."""

    def close(self) -> None:
        """Close the connection."""
        self._closed = True
        self._connection.socket.close()

    def _gone(self) -> LinkError:
        if self._closed:
            return LinkError(f"{self.name}: the link is closed; open it again")
        return LinkError(f"{self.name}: the other side closed the connection; check that program and start again")


class TcpServerTransport:
    """Listens for one client at a time. When it leaves or is let go of, the next may come; that is no error.

    allows: says of an address whether it may connect; others are hung up on, and counted as `refused_senders`.
    """

    is_stream = True

    def __init__(self, name: str, host: str, port: int, allows: Allows = everyone) -> None:
        self.name = name
        self.refused_senders = 0
        self._allows = allows
        family, address = resolve(name, host, port, socket.SOCK_STREAM, passive=True)
        self.is_local = is_loopback(str(address[0]))
        self._listener = socket.socket(family, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.setblocking(False)
        self._client: _Connection | None = None
        self.peer: tuple[str | int, ...] | None = None
        """Address of the client that was there last."""
        self._is_held = False
        try:
            self._listener.bind(address)
            self._listener.listen(1)
        except OSError as error:
            self._listener.close()
            raise open_error(name, error, "listen at", host, port) from error

    @property
    def port(self) -> int:
        """The local port, of use where 0 was asked for."""
        return int(self._listener.getsockname()[1])

    @property
    def connected(self) -> bool:
        """Whether a client is there."""
        return self._client is not None

    def fileno(self) -> int:
        """Return the client's descriptor, the listener's while there is no client, -1 when closed."""
        return self._listener.fileno() if self._client is None else self._client.socket.fileno()

    def receive(self) -> list[bytes]:
        """Return what the client sent; [] while there is none. LinkError when closed."""
        client = self._connected()
        if client is None:
            return []
        chunks, standing = client.receive()
        self._is_held = self._is_held or bool(chunks)
        if not standing:
            self._hang_up()
        return chunks

    def send(self, data: bytes) -> bool:
        """Send all of `data` to the client or nothing; False while there is none. LinkError when closed."""
        client = self._connected()
        if client is None:
            return False
        try:
            return client.send(data)
        except OSError:
            self._hang_up()
            return False

    def forget_peer(self) -> None:
        """Hang up on the client as soon as another comes, unless it sends something before."""
        self._is_held = False

    def close(self) -> None:
        """Hang up and stop listening."""
        self._hang_up()
        self._listener.close()

    def _connected(self) -> _Connection | None:
        """Return the client: the one there is, or the next where there is none or it was let go of."""
        if not self._is_held:
            newcomer = self._accept()
            if newcomer is not None:
                self._hang_up()
                self._client, self._is_held = newcomer, True
        return self._client

    def _hang_up(self) -> None:
        if self._client is not None:
            self._client.socket.close()
        self._client, self._is_held = None, False

    def _accept(self) -> _Connection | None:
        try:
            sock, sender = self._listener.accept()
        except (BlockingIOError, ConnectionError):
            return None
        except OSError as error:
            raise LinkError(f"{self.name}: the link is closed; open it again") from error
        if not self._allows(sender[0]):
            self.refused_senders += 1
            sock.close()
            return None
        self.peer = sender
        return _Connection(sock)


MEDIA = (
    Medium(
        "tcp",
        (
            Scheme("tcp", "mavlink", "tcp:127.0.0.1:5760"),
            Scheme("nmea-tcp", "nmea", "nmea-tcp:192.168.1.20:10110"),
            Scheme("n2k:ydwg-tcp", "ydwg", "n2k:ydwg-tcp:192.168.4.1:1457"),
            Scheme("n2k:actisense-tcp", "actisense", "n2k:actisense-tcp:192.168.1.20:60002"),
            Scheme("n2k:ascii-tcp", "n2k-ascii", "n2k:ascii-tcp:192.168.1.20:60003"),
        ),
        peer,
        lambda link, *_: TcpClientTransport(link.text, link.host, link.port),
    ),
    Medium(
        "tcpin",
        (
            Scheme("tcpin", "mavlink", "tcpin:127.0.0.1:5760"),
            Scheme("nmea-tcpin", "nmea", "nmea-tcpin:wlan0:10110"),
            Scheme("n2k:ydwg-tcpin", "ydwg", "n2k:ydwg-tcpin:127.0.0.1:1457"),
        ),
        own_address,
        lambda link, _, allows: TcpServerTransport(link.text, link.host, link.port, allows),
        listens=True,
    ),
)
