"""UDP and TCP, over IP. None of the four blocks.

UDP: `udpin` waits for a peer and latches on to it, `udpout` speaks to the one it was given. Both know one peer at a
time and drop what others send. TCP: a client that connects once, and a server for one client at a time; both are
streams.
"""

from __future__ import annotations

import contextlib
import errno
import socket
from collections.abc import Callable
from typing import Any

from autopilot.links.base import LinkError, Transport
from autopilot.links.transports.medium import (
    Allows,
    Medium,
    Scheme,
    WholeChunks,
    disconnect,
    everyone,
    is_everywhere,
    is_loopback,
    open_error,
    own_address,
    peer,
    resolve,
)

DATAGRAM_LIMIT = 65536
RECEIVE_LIMIT = 500
"""Datagrams taken in one `receive`, so that a flood cannot hold the loop."""
JUDGE_LIMIT = 20
"""Datagrams of others looked into in one `receive`: checking a signature costs more than dropping a datagram."""
UNKNOWN_SENDER_LIMIT = 1500
"""Bytes of such a datagram that may be looked into: a heartbeat, with what a router packs around it."""
WOULD_BLOCK = (errno.EAGAIN, errno.EWOULDBLOCK, errno.ENOBUFS)
TRANSIENT = (errno.ECONNREFUSED, errno.EHOSTUNREACH, errno.ENETUNREACH, errno.ENETDOWN, errno.EHOSTDOWN, errno.EINTR)
"""Errors that pass by themselves: the peer has not started yet, or the network is away for a while."""


def anything(data: bytes) -> bool:
    """Accept every datagram."""
    return bool(data)


LISTEN = "listen at"
Begin = Callable[[socket.socket, Any], object]


def _opened(name: str, host: str, port: int, kind: int, doing: str, begin: Begin) -> tuple[socket.socket, str]:
    """Return a socket, which does not block but as `begin` sets it to listen at or reach an address, and that."""
    family, address = resolve(name, host, port, kind, passive=doing == LISTEN)
    sock = socket.socket(family, kind)
    sock.setblocking(False)
    try:
        begin(sock, address)
    except OSError as error:
        sock.close()
        raise open_error(name, error, doing, host, port) from error
    return sock, str(address[0])


def _connect(sock: socket.socket, address: Any) -> None:
    sock.settimeout(CONNECT_TIMEOUT_S)
    sock.connect(address)


def _listen(sock: socket.socket, address: Any) -> None:
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    sock.bind(address)
    sock.listen(1)


class _UdpTransport(Transport):
    """What both kinds share: the socket and the draining of it."""

    is_stream = False

    def __init__(self, name: str, sock: socket.socket, address: str) -> None:
        self.name = name
        self.is_local = is_loopback(address)
        self.refused_senders = 0
        """Datagrams dropped because they came from somebody else than the peer."""
        self._socket = sock
        self._closed = False
        # received into again and again: a new buffer of this size for each datagram costs more than the datagram
        self._room = memoryview(bytearray(DATAGRAM_LIMIT))

    def fileno(self) -> int:
        """Return the socket's descriptor, -1 when closed."""
        return self._socket.fileno()

    def close(self) -> None:
        """Close the socket."""
        self._closed = True
        self._socket.close()

    def _datagrams(self) -> list[bytes]:
        """Return what waits, at most `RECEIVE_LIMIT`, where the kernel drops what others than the peer send."""
        chunks: list[bytes] = []
        receive, room = self._socket.recv_into, self._room
        for _ in range(RECEIVE_LIMIT):
            try:
                length = receive(room)
                chunks.append(bytes(room[:length]))
            except BlockingIOError:
                break
            except OSError as error:
                if error.errno not in TRANSIENT:
                    raise self._failed(error, "receiving") from error
        return chunks

    def _has_left(self, data: bytes, *to: Any) -> bool:
        """Send one datagram to the socket's peer, or `to` an address; return whether it could leave now."""
        try:
            if to:
                self._socket.sendto(data, *to)
            else:
                self._socket.send(data)
        except OSError as error:
            if error.errno in WOULD_BLOCK or error.errno in TRANSIENT:
                return False
            raise self._failed(error, "sending") from error
        return True

    def _failed(self, error: OSError, doing: str) -> LinkError:
        if self._closed:
            return LinkError(f"{self.name}: the link is closed; open it again")
        return LinkError(f"{self.name}: {doing} failed: {error.strerror or error}; check the network and start again")


class UdpInTransport(_UdpTransport):
    """Listens on the address the user wrote and latches on to the first peer whose datagram `accepts` finds valid.

    Args:
        name: the URL as written, for messages.
        host, port: the local address; port 0 lets the system choose (see `port`).
        accepts: says of a datagram whether its sender may become the peer.
        allows: says of an address whether its datagrams are looked at.
    """

    def __init__(
        self,
        name: str,
        host: str,
        port: int,
        accepts: Callable[[bytes], bool] = anything,
        allows: Allows = everyone,
    ) -> None:
        sock, address = _opened(name, host, port, socket.SOCK_DGRAM, LISTEN, socket.socket.bind)
        super().__init__(name, sock, address)
        # Listening everywhere takes broadcasts too, which a connected socket would no longer hear.
        self._connects = not is_everywhere(address)
        self.accepts = accepts
        """May be set anew, by a link that knows better which sender is the right one."""
        self.answers: Callable[[], bool] = lambda: False
        """Whether the sender that `accepts` has just refused is sent the next datagram that leaves."""
        self._asker: tuple[str | int, ...] | None = None
        self.refused: tuple[bytes, str] | None = None
        """The newest datagram that could make nobody our peer, as far as it was looked into, and who sent it."""
        self._allows = allows
        self._peer: tuple[str | int, ...] | None = None
        self._is_held = self._is_connected = self._is_alone = False

    @property
    def port(self) -> int:
        """The local port, of use where 0 was asked for."""
        return int(self._socket.getsockname()[1])

    @property
    def peer(self) -> tuple[str | int, ...] | None:
        """Address of the peer latched on to, or let go of and not replaced yet; None before the first."""
        return self._peer

    def receive(self) -> list[bytes]:
        """Return the peer's datagrams that wait, at most `RECEIVE_LIMIT`."""
        if self._is_alone:
            return self._datagrams()
        chunks: list[bytes] = []
        receive, room = self._socket.recvfrom_into, self._room
        judged = 0
        for _ in range(RECEIVE_LIMIT):
            try:
                length, sender = receive(room)
            except BlockingIOError:
                # what others sent before the kernel held them off has been taken
                self._is_alone = self._is_connected
                break
            except OSError as error:
                if error.errno in TRANSIENT:
                    continue
                raise self._failed(error, "receiving") from error
            if sender == self._peer and self._is_held:
                chunks.append(bytes(room[:length]))
                continue
            self.refused_senders += 1
            if not self._is_held and judged < JUDGE_LIMIT and self._allows(sender[0]):
                judged += 1
                if self.accepts(bytes(room[: min(length, UNKNOWN_SENDER_LIMIT)])):
                    self._latch(sender)
                    self.refused_senders -= 1
                    chunks.append(bytes(room[:length]))
                    continue
                if self.answers():
                    self._asker = sender
                if self._peer is None:
                    self.refused = bytes(room[: min(length, UNKNOWN_SENDER_LIMIT)]), f"{sender[0]}:{sender[1]}"
        return chunks

    def send(self, data: bytes) -> bool:
        """Send one datagram to the peer; False while there is none, or when the system's buffer is full."""
        asker, self._asker = self._asker, None
        if asker is not None and not self._is_held:
            with contextlib.suppress(LinkError):  # from port 0, or where a firewall holds it: no fault of the line
                self._has_left(data, asker)
        if self._peer is None:
            if self._closed:
                raise LinkError(f"{self.name}: the link is closed; open it again")
            return False
        return self._has_left(data) if self._is_connected else self._has_left(data, self._peer)

    def forget_peer(self) -> None:
        """Latch on to whoever is the next to send a valid datagram; until then the old one is still sent to."""
        if self._is_held and self._connects:
            disconnect(self._socket)
        self._is_held = self._is_connected = self._is_alone = False

    def _latch(self, sender: tuple[str | int, ...]) -> None:
        """Let the kernel drop what others send from now on, so that no flood fills our buffer or wakes the loop."""
        self._peer, self._is_held = sender, True
        if self._connects:
            try:
                self._socket.connect(sender)
                self._is_connected = True
            except OSError:
                self._connects = False


class UdpOutTransport(_UdpTransport):
    """Sends to one host and port, and receives from there alone (the kernel drops all others).

    A peer that is not there yet is no error: its refusals are passed over until it starts.
    """

    def __init__(self, name: str, host: str, port: int) -> None:
        super().__init__(name, *_opened(name, host, port, socket.SOCK_DGRAM, "reach", socket.socket.connect))

    def receive(self) -> list[bytes]:
        """Return the peer's datagrams that wait, at most `RECEIVE_LIMIT`."""
        return self._datagrams()

    def send(self, data: bytes) -> bool:
        """Send one datagram; False when it could not leave now (full buffer, or nobody listens there yet)."""
        return self._has_left(data)


CONNECT_TIMEOUT_S = 3.0
CHUNK_LIMIT = 65536
CHUNKS_MOST = 4
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
        for _ in range(CHUNKS_MOST):
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


class TcpClientTransport(Transport):
    """Connects to a host and port; LinkError where nothing answers within `CONNECT_TIMEOUT_S`.

    Opening is the one moment that may wait; afterwards nothing blocks.
    """

    is_stream = True

    def __init__(self, name: str, host: str, port: int) -> None:
        self.name = name
        sock, address = _opened(name, host, port, socket.SOCK_STREAM, "connect to", _connect)
        self.is_local = is_loopback(address)
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
        self._listener, address = _opened(name, host, port, socket.SOCK_STREAM, LISTEN, _listen)
        self.is_local = is_loopback(address)
        self._client: _Connection | None = None
        self.peer: tuple[str | int, ...] | None = None
        """Address of the client that was there last."""
        self._is_held = False

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
        "udpin",
        (
            Scheme("udpin", "mavlink", "udpin:127.0.0.1:14550"),
            Scheme("nmea-udp", "nmea", "nmea-udp:127.0.0.1:10110"),
            Scheme("n2k:ydwg-udp", "ydwg", "n2k:ydwg-udp:wlan0:1457"),
        ),
        own_address,
        lambda link, accepts, allows: UdpInTransport(link.text, link.host, link.port, accepts, allows),
        listens=True,
    ),
    Medium(
        "udpout",
        (
            Scheme("udpout", "mavlink", "udpout:192.168.1.10:14550"),
            Scheme("nmea-udpout", "nmea", "nmea-udpout:192.168.1.20:10110"),
            Scheme("n2k:ydwg-udpout", "ydwg", "n2k:ydwg-udpout:192.168.4.1:1457"),
        ),
        peer,
        lambda link, *_: UdpOutTransport(link.text, link.host, link.port),
    ),
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
