"""UDP: `udpin` waits for a peer and latches on to it, `udpout` speaks to the one it was given.

Both know one peer at a time and drop what others send.
"""

from __future__ import annotations

import errno
import socket
from collections.abc import Callable

from autopilot.links.base import LinkError
from autopilot.links.transports.medium import (
    Allows,
    Medium,
    Scheme,
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


class _UdpTransport:
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
        family, address = resolve(name, host, port, socket.SOCK_DGRAM, passive=True)
        sock = socket.socket(family, socket.SOCK_DGRAM)
        sock.setblocking(False)
        try:
            sock.bind(address)
        except OSError as error:
            sock.close()
            raise open_error(name, error, "listen at", host, port) from error
        super().__init__(name, sock, str(address[0]))
        # Listening everywhere takes broadcasts too, which a connected socket would no longer hear.
        self._connects = not is_everywhere(str(address[0]))
        self.accepts = accepts
        """May be set anew, by a link that knows better which sender is the right one."""
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
                elif self._peer is None:
                    self.refused = bytes(room[: min(length, UNKNOWN_SENDER_LIMIT)]), f"{sender[0]}:{sender[1]}"
        return chunks

    def send(self, data: bytes) -> bool:
        """Send one datagram to the peer; False while there is none, or when the system's buffer is full."""
        if self._peer is None:
            if self._closed:
                raise LinkError(f"{self.name}: the link is closed; open it again")
            return False
        try:
            if self._is_connected:
                self._socket.send(data)
            else:
                self._socket.sendto(data, self._peer)
        except OSError as error:
            if error.errno in WOULD_BLOCK or error.errno in TRANSIENT:
                return False
            raise self._failed(error, "sending") from error
        return True

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
        family, address = resolve(name, host, port, socket.SOCK_DGRAM, passive=False)
        sock = socket.socket(family, socket.SOCK_DGRAM)
        sock.setblocking(False)
        try:
            sock.connect(address)
        except OSError as error:
            sock.close()
            raise open_error(name, error, "reach", host, port) from error
        super().__init__(name, sock, str(address[0]))

    def receive(self) -> list[bytes]:
        """Return the peer's datagrams that wait, at most `RECEIVE_LIMIT`."""
        return self._datagrams()

    def send(self, data: bytes) -> bool:
        """Send one datagram; False when it could not leave now (full buffer, or nobody listens there yet)."""
        try:
            self._socket.send(data)
        except OSError as error:
            if error.errno in WOULD_BLOCK or error.errno in TRANSIENT:
                return False
            raise self._failed(error, "sending") from error
        return True

    def forget_peer(self) -> None:
        """Do nothing: the peer is the one the user wrote."""


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
)
