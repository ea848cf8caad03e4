"""What each transport does at its limits: how much it takes at once, what it sends in part, which errors end it."""

from __future__ import annotations

import errno
import ipaddress
import math
import os
import pty
import socket
import termios
import time
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import serial

from autopilot.links.base import LinkError, NotThereError, Transport
from autopilot.links.transports import (
    SerialTransport,
    TcpClientTransport,
    TcpServerTransport,
    UdpInTransport,
    UdpOutTransport,
    loopback_pair,
)
from autopilot.links.transports.medium import (
    disconnect,
    interface_address,
    is_everywhere,
    is_loopback,
    network_of,
    only_from,
    open_error,
    peer_of,
    resolve,
)
from autopilot.links.transports.serial_line import _open_error, carried

PATIENCE = 5000
"""Milliseconds that the kernel is given to deliver."""
PEER, OTHER = ("192.0.2.1", 14550), ("192.0.2.2", 14550)
PASSING = ("ECONNREFUSED", "EHOSTUNREACH", "ENETUNREACH", "ENETDOWN", "EHOSTDOWN", "EINTR")
FULL = ("EAGAIN", "EWOULDBLOCK", "ENOBUFS")
BAD = ("EBADF", "EMSGSIZE", "EPERM", "EIO")


def failure(name: str) -> OSError:
    number = getattr(errno, name)
    return OSError(number, os.strerror(number))


class Wire:
    """A socket that gives what is put into it, and takes as many bytes as it is set to."""

    def __init__(self, *arriving: Any) -> None:
        self.arriving = list(arriving)
        self.taking: list[Any] = []
        self.sent: list[Any] = []
        self.asked: list[int] = []
        self.connected: list[Any] = []

    def _next(self) -> Any:
        if not self.arriving:
            raise BlockingIOError
        found = self.arriving.pop(0)
        if isinstance(found, Exception):
            raise found
        return found

    def recvfrom_into(self, room: memoryview) -> tuple[int, Any]:
        data, sender = self._next()
        self.asked.append(len(room))
        room[: len(data)] = data
        return len(data), sender

    def recv_into(self, room: memoryview) -> int:
        data = self._next()
        room[: len(data)] = data
        return len(data)

    def recv(self, size: int) -> bytes:
        self.asked.append(size)
        data: bytes = self._next()
        return data

    def send(self, data: bytes) -> int:
        most = self.taking.pop(0) if self.taking else len(data)
        if isinstance(most, Exception):
            raise most
        self.sent.append(bytes(data[:most]))
        return min(most, len(data))

    def sendto(self, data: bytes, peer: Any) -> int:
        self.sent.append(peer)
        return self.send(data)

    def connect(self, peer: Any) -> None:
        self.connected.append(peer)

    def close(self) -> None:
        pass


def udp_in(*arriving: Any, accepts: Any = None) -> tuple[UdpInTransport, Wire]:
    link = UdpInTransport("udpin:x", "127.0.0.1", 0, *([accepts] if accepts else []))
    link._socket.close()
    wire: Any = Wire(*arriving)
    link._socket = wire
    return link, wire


def udp_out(*arriving: Any) -> tuple[UdpOutTransport, Wire]:
    link = UdpOutTransport("udpout:x", "127.0.0.1", 9)
    link._socket.close()
    wire: Any = Wire(*arriving)
    link._socket = wire
    return link, wire


# UDP


def test_five_hundred_datagrams_are_taken_at_once() -> None:
    link, wire = udp_in(*((b"%d" % number, PEER) for number in range(502)))
    assert link.receive() == [b"%d" % number for number in range(500)]
    assert link.receive() == [b"500", b"501"] and link.receive() == []
    assert set(wire.asked) == {65536} and wire.connected == [PEER]
    out, _ = udp_out(*(b"%d" % number for number in range(502)))
    assert [len(out.receive()) for _ in range(3)] == [500, 2, 0]


@pytest.mark.parametrize("name", PASSING)
def test_errors_that_pass_are_passed_over(name: str) -> None:
    link, wire = udp_in((b"a", PEER), failure(name), (b"b", PEER))
    assert link.receive() == [b"a", b"b"]
    wire.taking = [failure(name)]
    assert link.send(b"x") is False
    out, wire = udp_out(b"a", failure(name), b"b")
    assert out.receive() == [b"a", b"b"]
    wire.taking = [failure(name)]
    assert out.send(b"x") is False and out.send(b"y") is True


@pytest.mark.parametrize("name", FULL)
def test_a_full_buffer_is_no_error(name: str) -> None:
    link, wire = udp_in((b"a", PEER))
    link.receive()
    wire.taking = [failure(name)]
    assert link.send(b"x") is False and link.send(b"y") is True
    assert wire.sent == [b"y"]
    out, wire = udp_out()
    wire.taking = [failure(name)]
    assert out.send(b"x") is False


@pytest.mark.parametrize("name", BAD)
def test_other_errors_end_a_datagram_link_with_their_reason(name: str) -> None:
    words = os.strerror(getattr(errno, name))
    near, wire = udp_in((b"a", PEER))
    near.receive()
    out, far = udp_out()
    for each in (wire, far):
        each.arriving, each.taking = [failure(name)], [failure(name)]
    for link in (near, out):
        for way, doing in ((link.receive, "receiving"), (lambda link=link: link.send(b"x"), "sending")):
            with pytest.raises(LinkError) as caught:
                way()
            assert str(caught.value) == f"{link.name}: {doing} failed: {words}; check the network and start again"


def test_twenty_strangers_are_looked_into_at_once_and_the_beginning_of_what_they_say() -> None:
    seen: list[int] = []

    def accepts(data: bytes) -> bool:
        seen.append(len(data))
        return data == b"good"

    link, wire = udp_in(*((bytes(1600), OTHER) for _ in range(25)), accepts=accepts)
    assert link.receive() == []
    assert seen == [1500] * 20 and link.refused_senders == 25
    assert link.refused == (bytes(1500), "192.0.2.2:14550")
    assert link.peer is None and link.send(b"x") is False
    wire.arriving = [*((b"bad", OTHER) for _ in range(19)), (b"good", PEER), (b"bad", PEER), (b"worse", OTHER)]
    assert link.receive() == [b"good", b"bad"], "who is latched on to is not looked into again"
    assert link.peer == PEER and link.refused_senders == 25 + 19 + 1
    assert link.refused == (b"bad", "192.0.2.2:14550")
    assert link.refused[0] == b"bad", "once there is a peer, nobody is to blame"
    wire.arriving = [b"good"]
    assert link.receive() == [b"good"], "the kernel drops what others send to a connected socket"


def test_who_is_not_allowed_is_not_looked_into() -> None:
    looked: list[bytes] = []

    def accepts(data: bytes) -> bool:
        looked.append(data)
        return True

    link = UdpInTransport("udpin:x", "127.0.0.1", 0, accepts, lambda address: address == PEER[0])
    link._socket.close()
    wire: Any = Wire((b"a", OTHER), (b"b", PEER))
    link._socket = wire
    assert link.receive() == [b"b"] and looked == [b"b"]
    assert link.refused_senders == 1 and link.refused is None


def test_an_answer_that_cannot_leave_is_no_fault_of_the_line() -> None:
    """The system takes no datagram to port 0, from where one may come: the line was said to fail."""
    link, wire = udp_in((b"late", OTHER), accepts=lambda data: data == b"good")
    link.answers = lambda: True
    wire.taking = [failure("EINVAL")]
    assert link.receive() == [] and link.send(b"x") is False
    assert wire.sent == [OTHER], "once"
    wire.arriving = [(b"good", PEER)]
    assert link.receive() == [b"good"] and link.send(b"y") is True
    assert wire.sent == [OTHER, b"y"]


def test_an_empty_datagram_makes_nobody_the_peer() -> None:
    link, _ = udp_in((b"", PEER), (b"x", OTHER))
    assert link.receive() == [b"x"] and link.peer == OTHER


def test_the_peer_is_held_until_it_is_let_go_of_and_still_sent_to_then() -> None:
    link, wire = udp_in((b"a", PEER), (b"b", OTHER))
    link._connects = False
    assert link.receive() == [b"a"]
    assert wire.connected == []
    link.forget_peer()
    assert link.peer == PEER and link.send(b"x") and wire.sent == [PEER, b"x"]
    wire.arriving = [(b"c", OTHER)]
    assert link.receive() == [b"c"] and link.peer == OTHER
    wire.arriving = [(b"d", PEER)]
    assert link.receive() == []


@pytest.mark.parametrize(("host", "connects"), [("127.0.0.1", True), ("0.0.0.0", False)])
def test_only_who_listens_at_one_address_lets_the_kernel_drop_strangers(host: str, connects: bool) -> None:
    link = UdpInTransport("udpin:x", host, 0)
    assert link.is_local is connects
    far = UdpOutTransport("far", "127.0.0.1", link.port)
    assert far.is_local and far.refused_senders == link.refused_senders == 0 and not link.is_stream
    far.send(b"a")
    assert heard_at(link) == [b"a"]
    stranger = UdpOutTransport("stranger", "127.0.0.1", link.port)
    stranger.send(b"b")
    link.receive()
    assert link.refused_senders == (0 if connects else 1)
    port = link.port
    link.forget_peer()
    assert link.port == port, "the kernel chose it, and would forget it"
    stranger.receive()
    stranger.send(b"c")
    assert link.receive() == [b"c"]
    for end in (link, far, stranger):
        end.close()


def test_a_socket_hears_everybody_again_at_its_port() -> None:
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as near,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far,
    ):
        near.bind(("127.0.0.1", 0))
        far.bind(("127.0.0.1", 0))
        bound = near.getsockname()
        near.connect(("127.0.0.1", 9))
        disconnect(near)
        assert near.getsockname()[1] == bound[1]
        far.sendto(b"x", bound)
        near.settimeout(2.0)
        assert near.recv(9) == b"x"


# TCP


@pytest.fixture
def server() -> Iterator[TcpServerTransport]:
    made = TcpServerTransport("tcpin:x", "127.0.0.1", 0)
    yield made
    made.close()


def heard_at(link: Transport) -> list[bytes]:
    for _ in range(PATIENCE):
        chunks = link.receive()
        if chunks:
            return chunks
        time.sleep(0.001)
    raise AssertionError("nothing came")


def awaited(server: TcpServerTransport) -> None:
    for _ in range(PATIENCE):
        server.receive()
        if server.connected:
            return
        time.sleep(0.001)
    raise AssertionError("nobody came")


def client_of(server: TcpServerTransport) -> TcpClientTransport:
    return TcpClientTransport("tcp:x", "127.0.0.1", server.port)


def test_four_chunks_of_a_stream_are_taken_at_once(server: TcpServerTransport) -> None:
    client = client_of(server)
    real = client._connection.socket
    wire: Any = Wire(*(b"%d" % number for number in range(6)))
    client._connection.socket = wire
    assert client.receive() == [b"0", b"1", b"2", b"3"] and client.receive() == [b"4", b"5"]
    assert set(wire.asked) == {65536}
    assert client.receive() == [], "idle"
    wire.arriving = [b"last", failure("ECONNRESET")]
    assert client.receive() == [b"last"], "what came before is still given"
    with pytest.raises(LinkError, match="tcp:x: the other side closed the connection; check that program"):
        client.receive()
    real.close()


def test_a_stream_that_takes_a_part_takes_the_rest_before_anything_else(server: TcpServerTransport) -> None:
    client = client_of(server)
    real = client._connection.socket
    wire: Any = Wire()
    client._connection.socket = wire
    wire.taking = [4]
    assert client.send(b"abcdef") is True
    wire.taking = [1]
    assert client.send(b"gh") is False, "the tail is not out yet"
    wire.taking = [BlockingIOError()]
    assert client.send(b"gh") is False
    assert client.send(b"ij") is True
    wire.taking = [BlockingIOError()]
    assert client.send(b"kl") is False
    wire.taking = [BlockingIOError()]
    assert client.send(b"") is True, "nothing is always sent"
    assert wire.sent == [b"abcd", b"e", b"f", b"ij"]
    wire.taking = [failure("EPIPE")]
    with pytest.raises(LinkError, match="the other side closed the connection"):
        client.send(b"x")
    real.close()


def test_a_connection_is_made_within_three_seconds_and_sends_at_once(
    server: TcpServerTransport, monkeypatch: pytest.MonkeyPatch
) -> None:
    waits: list[Any] = []
    real = socket.socket.settimeout

    def settimeout(self: socket.socket, value: float | None) -> None:
        waits.append(value)
        real(self, value)

    monkeypatch.setattr(socket.socket, "settimeout", settimeout)
    client = client_of(server)
    assert waits == [3.0]
    sock = client._connection.socket
    assert sock.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY) and not sock.getblocking()
    assert client.is_local and server.is_local and client.is_stream and server.is_stream
    assert server._listener.getsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR)
    client.close()
    everywhere = TcpServerTransport("tcpin:x", "0.0.0.0", 0)
    assert not everywhere.is_local
    everywhere.close()


def test_one_tcp_client_at_a_time_is_served(server: TcpServerTransport) -> None:
    assert server.receive() == [] and server.send(b"x") is False and not server.connected
    assert server.fileno() == server._listener.fileno()
    first = client_of(server)
    awaited(server)
    assert server.fileno() != server._listener.fileno()
    second = client_of(server)
    second.send(b"second")
    for _ in range(100):
        assert server.receive() == []
    assert server.send(b"to the first")
    server.forget_peer()
    first.send(b"still here")
    heard = heard_at(server)
    assert heard == [b"second"], "the newcomer takes its place"
    with pytest.raises(LinkError):
        for _ in range(PATIENCE):
            first.receive()
            time.sleep(0.001)
    third = client_of(server)
    server.forget_peer()
    server.receive()
    assert server.connected
    for end in (first, second, third):
        end.close()


def test_who_speaks_after_it_was_let_go_of_stays(server: TcpServerTransport) -> None:
    first = client_of(server)
    awaited(server)
    server.forget_peer()
    first.send(b"still here")
    heard_at(server)
    second = client_of(server)
    for _ in range(100):
        assert server.receive() == []
    assert server.send(b"x")
    assert heard_at(first) == [b"x"]
    for end in (first, second):
        end.close()


def test_strangers_are_hung_up_on_and_counted() -> None:
    server = TcpServerTransport("tcpin:x", "127.0.0.1", 0, lambda address: address != "127.0.0.1")
    assert server.refused_senders == 0
    client = client_of(server)
    for _ in range(PATIENCE):
        server.receive()
        if server.refused_senders:
            break
        time.sleep(0.001)
    assert server.refused_senders == 1 and not server.connected
    with pytest.raises(LinkError):
        for _ in range(PATIENCE):
            client.receive()
            time.sleep(0.001)
    client.close()
    server.close()


def test_a_server_lets_go_of_a_broken_connection(server: TcpServerTransport) -> None:
    client = client_of(server)
    awaited(server)
    held: Any = server._client
    real = held.socket
    wire: Any = Wire()
    held.socket = wire
    wire.taking = [failure("EPIPE")]
    assert server.send(b"x") is False and not server.connected
    real.close()
    client.close()


# serial lines


@pytest.fixture
def line() -> Iterator[tuple[SerialTransport, int]]:
    master, slave = pty.openpty()
    tty.setraw(master)
    made = SerialTransport("serial:x", os.ttyname(slave), 4800)
    os.close(slave)
    yield made, master
    made.close()
    os.close(master)


def test_a_serial_port_is_opened_for_itself_alone_and_never_waits(line: tuple[SerialTransport, int]) -> None:
    port = line[0]._port
    assert (port.timeout, port.write_timeout, port.exclusive, port.baudrate) == (0, 0, True, 4800)
    assert (port.bytesize, port.parity, port.stopbits, port.rtscts, port.xonxoff) == (8, "N", 1, False, False)
    assert line[0].baud == 4800 and line[0].is_stream


def test_sixty_four_chunks_of_a_serial_line_are_taken_at_once(
    line: tuple[SerialTransport, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes: list[int] = []
    waiting: list[Any] = [b"%d" % number for number in range(70)]

    def read(_: int, size: int) -> bytes:
        sizes.append(size)
        found = waiting.pop(0) if waiting else b""
        if isinstance(found, Exception):
            raise found
        return bytes(found)

    monkeypatch.setattr(os, "read", read)
    assert len(line[0].receive()) == 64 and len(line[0].receive()) == 6
    assert set(sizes) == {4096}
    assert line[0].receive() == [], "no bytes from a line that stands: it is idle"
    assert len(sizes) == 64 + (6 + 1) + 1, "and is not asked again"
    waiting[:] = [b"a", BlockingIOError(), b"b"]
    assert line[0].receive() == [b"a"] and line[0].receive() == [b"b"]
    waiting[:] = [b"a", failure("EIO"), failure("EIO")]
    assert line[0].receive() == [b"a"], "what came before is still given"
    with pytest.raises(LinkError, match="is gone"):
        line[0].receive()


def test_a_serial_line_that_takes_a_part_takes_the_rest_before_anything_else(
    line: tuple[SerialTransport, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    taking: list[Any] = [4, 1, BlockingIOError(), 1]
    sent: list[bytes] = []

    def write(_: int, data: bytes) -> int:
        most = taking.pop(0) if taking else len(data)
        if isinstance(most, Exception):
            raise most
        sent.append(bytes(data[:most]))
        return min(int(most), len(data))

    monkeypatch.setattr(os, "write", write)
    transport = line[0]
    assert transport.send(b"abcdef") is True
    assert transport.send(b"gh") is False
    assert transport.send(b"gh") is False
    assert transport.send(b"ij") is True
    assert sent == [b"abcd", b"e", b"f", b"ij"]
    taking[:] = [BlockingIOError(), BlockingIOError(), failure("EIO")]
    assert transport.send(b"kl") is False and transport.send(b"") is True
    with pytest.raises(LinkError, match="is gone"):
        transport.send(b"x")


@pytest.mark.parametrize(
    ("error", "kind", "words"),
    [
        *(
            (failure(name), NotThereError, "there is no device /dev/x; plug it in")
            for name in ("ENOENT", "ENODEV", "ENXIO")
        ),
        *((failure(name), LinkError, "permission denied on /dev/x; add your user") for name in ("EACCES", "EPERM")),
        *((failure(name), LinkError, "/dev/x is in use by another program") for name in ("EBUSY", "EAGAIN")),
        (serial.SerialException("Could not exclusively lock port"), LinkError, "/dev/x is in use by another program"),
        (ValueError("no such rate"), LinkError, "77 baud is not possible on /dev/x"),
        *((failure(name), LinkError, "/dev/x is not a serial port") for name in ("ENOTTY", "EINVAL", "EISDIR")),
        (termios.error(errno.ENOTTY, "no"), LinkError, "/dev/x is not a serial port"),
        (termios.error(errno.ENXIO, "no"), NotThereError, "there is no device /dev/x"),
        (termios.error(999, "no"), LinkError, "/dev/x is not a serial port"),
        (serial.SerialException("Could not configure port"), LinkError, "/dev/x is not a serial port"),
        (failure("EIO"), LinkError, "cannot open /dev/x: [Errno 5] Input/output error; check the device"),
    ],
)
def test_why_a_serial_port_does_not_open(error: Exception, kind: type[LinkError], words: str) -> None:
    found = _open_error("serial:x", "/dev/x", 77, error)
    assert type(found) is kind and str(found).startswith(f"serial:x: {words}")


# addresses


@pytest.mark.parametrize(
    ("name", "kind", "words"),
    [
        ("EADDRINUSE", LinkError, "the port is in use by another program"),
        ("EADDRNOTAVAIL", NotThereError, "this machine does not have that address"),
        ("EACCES", LinkError, "permission denied; choose a port above 1023"),
        ("ECONNREFUSED", NotThereError, "connection refused, nothing listens there"),
        ("ENETUNREACH", NotThereError, "the network cannot be reached"),
        ("EHOSTUNREACH", NotThereError, "the host cannot be reached"),
        ("ETIMEDOUT", NotThereError, "no answer in time"),
        ("ENETDOWN", NotThereError, "Network is down; check the address"),
        ("EHOSTDOWN", NotThereError, "Host is down; check the address"),
        ("ECONNRESET", NotThereError, "Connection reset by peer; check the address"),
        ("EINVAL", LinkError, "Invalid argument; check the address"),
    ],
)
def test_why_an_address_does_not_open(name: str, kind: type[LinkError], words: str) -> None:
    found = open_error("tcp:x", failure(name), "connect to", "host", 99)
    assert type(found) is kind and str(found).startswith(f"tcp:x: cannot connect to host port 99: {words}")


def test_a_time_that_is_over_and_an_error_without_a_number() -> None:
    late = open_error("tcp:x", TimeoutError("timed out"), "connect to", "host", 99)
    assert type(late) is NotThereError and "no answer in time" in str(late)
    bare = open_error("tcp:x", OSError("odd"), "reach", "host", 99)
    assert type(bare) is LinkError and str(bare) == "tcp:x: cannot reach host port 99: odd; check the address"


@pytest.mark.parametrize(
    ("address", "everywhere", "loopback"),
    [
        ("0.0.0.0", True, False),
        ("::", True, False),
        ("127.0.0.1", False, True),
        ("127.9.9.9", False, True),
        ("::1", False, True),
        ("::ffff:127.0.0.1", False, True),
        ("::ffff:192.0.2.1", False, False),
        ("192.0.2.1", False, False),
        ("fe80::1%eth0", False, False),
        ("::1%lo", False, True),
        ("boat.local", False, False),
    ],
)
def test_addresses_are_parted_as_everywhere_loopback_or_neither(address: str, everywhere: bool, loopback: bool) -> None:
    assert (is_everywhere(address), is_loopback(address)) == (everywhere, loopback)


def test_only_the_networks_named_may_come_in() -> None:
    allows = only_from([network_of("192.0.2.0/24"), network_of("fe80::/10"), network_of("198.51.100.7")])
    for address, is_allowed in (
        ("192.0.2.255", True),
        ("192.0.3.0", False),
        ("::ffff:192.0.2.9", True),
        ("fe80::1%wlan0", True),
        ("fec0::1", False),
        ("198.51.100.7", True),
        ("198.51.100.8", False),
    ):
        assert allows(address) is is_allowed, address
    assert only_from([])("203.0.113.1")
    assert network_of("192.0.2.0/24") == ipaddress.ip_network("192.0.2.0/24")
    with pytest.raises(ValueError, match="host bits"):
        network_of("192.0.2.1/24")


def test_an_interface_is_an_address_to_listen_at() -> None:
    assert interface_address("lo") == "127.0.0.1"
    assert interface_address("no-such-one") is None
    assert resolve("udpin:x", "lo", 9, socket.SOCK_DGRAM, True) == (socket.AF_INET, ("127.0.0.1", 9))
    with pytest.raises(LinkError, match="udpin:x: host 'no such host' is not known"):
        resolve("udpin:x", "no such host", 9, socket.SOCK_DGRAM, False)
    with pytest.raises(LinkError, match="host 'lo' is not known"):
        resolve("udpout:x", "lo", 9, socket.SOCK_DGRAM, False)
    for kind in (TcpServerTransport, UdpInTransport):
        listening = kind("x", "lo", 0)
        assert listening.port > 0
        listening.close()
    for calling in (lambda: TcpClientTransport("x", "lo", 9), lambda: UdpOutTransport("x", "lo", 9)):
        with pytest.raises(LinkError, match="host 'lo' is not known"):
            calling()


# in memory


def test_a_loopback_holds_ten_thousand_chunks() -> None:
    near, far = loopback_pair()
    assert (near.name, far.name, near.is_stream, near.closed) == ("loopback:a", "loopback:b", False, False)
    assert sum(near.send(b"x") for _ in range(10_001)) == 10_000
    assert len(far.receive()) == 10_000 and near.send(b"x")


@pytest.mark.parametrize("first", [True, False])
def test_a_loopback_that_is_closed_at_either_end_gives_what_waits_and_then_says_so(first: bool) -> None:
    near, far = loopback_pair("x")
    far.send(b"last words")
    (near if first else far).close()
    assert near.receive() == [b"last words"]
    words = "x:a: this end is closed" if first else "x:a: the other end has closed"
    for way in (near.receive, lambda: near.send(b"x")):
        with pytest.raises(LinkError, match=words):
            way()


def test_a_serial_line_on_which_bytes_wait_is_still_sent_to(line: tuple[SerialTransport, int]) -> None:
    os.write(line[1], b"waiting")
    assert line[0].send(b"x") and heard_at(line[0]) == [b"waiting"]


def test_who_is_at_the_other_end_of_a_listening_link() -> None:
    listening = TcpServerTransport("tcpin:127.0.0.1:0", "127.0.0.1", 0)
    assert peer_of(listening) == ""
    client = TcpClientTransport("far", "127.0.0.1", listening.port)
    while not listening.connected:
        listening.receive()
    host, port = client._connection.socket.getsockname()
    client.close()
    assert peer_of(listening) == f"{host}:{port}"
    listening.peer = ("fe80::1%eth0", 50312, 0, 2)
    assert peer_of(listening) == "[fe80::1%eth0]:50312"
    listening.close()


@pytest.mark.parametrize(
    ("device", "bytes_per_s"),
    [("ttyUSB0", 5760.0), ("ttyAMA0", 5760.0), ("ttyACM0", math.inf), ("cu.usbmodem101", math.inf)],
)
def test_a_board_s_own_usb_carries_more_than_its_baud_rate_says(
    tmp_path: Path, device: str, bytes_per_s: float
) -> None:
    (tmp_path / "usb-ArduPilot-if00").symlink_to(tmp_path / device)
    assert carried(str(tmp_path / device), 57600) == bytes_per_s
    assert carried(str(tmp_path / "usb-ArduPilot-if00"), 57600) == bytes_per_s
