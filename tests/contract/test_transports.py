"""What every transport promises, checked once over all of them. Each case is a pair of ends that talk to each other."""

from __future__ import annotations

import os
import pty
import select
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import pytest

from autopilot.errors import InputError
from autopilot.links import url
from autopilot.links.base import LinkError, Transport
from autopilot.links.mavlink.codec import MavlinkCodec, dialect
from autopilot.links.transports import (
    SerialTransport,
    TcpClientTransport,
    TcpServerTransport,
    UdpInTransport,
    UdpOutTransport,
    loopback_pair,
)
from autopilot.links.transports.medium import Accepts, Allows, LinkUrl, Medium, Scheme, own_address

HELLO = MavlinkCodec(1, 1).encode(dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3))


@dataclass
class Pair:
    """The transport under test, and its other side as plain functions."""

    near: Transport
    write: Callable[[bytes], None]
    read: Callable[[], bytes]
    hang_up: Callable[[], None]
    loses_peer: bool
    """Whether the other side's going is an error here (not for listeners and datagrams)."""


def wait(fileno: int) -> None:
    """Let the kernel deliver: as a rule within microseconds."""
    if fileno >= 0:
        select.select([fileno], [], [], 60.0)


def collect(transport: Transport, length: int) -> bytes:
    data = b""
    while len(data) < length:
        wait(transport.fileno())
        chunks = transport.receive()
        if not chunks:
            break
        data += b"".join(chunks)
    return data


def drained(transport: Transport) -> bytes:
    return collect(transport, 1)


def udp_in() -> Pair:
    near = UdpInTransport("udpin:127.0.0.1:0", "127.0.0.1", 0)
    far = UdpOutTransport("far", "127.0.0.1", near.port)
    far.send(HELLO)
    assert collect(near, len(HELLO)) == HELLO
    return Pair(near, lambda data: void(far.send(data)), lambda: drained(far), far.close, False)


def udp_out() -> Pair:
    far = UdpInTransport("far", "127.0.0.1", 0)
    near = UdpOutTransport("udpout:127.0.0.1:1", "127.0.0.1", far.port)
    near.send(HELLO)
    assert collect(far, len(HELLO)) == HELLO
    return Pair(near, lambda data: void(far.send(data)), lambda: drained(far), far.close, False)


def tcp_client() -> Pair:
    far = TcpServerTransport("far", "127.0.0.1", 0)
    near = TcpClientTransport("tcp:127.0.0.1:1", "127.0.0.1", far.port)
    wait(far.fileno())
    far.receive()
    return Pair(near, lambda data: void(far.send(data)), lambda: drained(far), far.close, True)


def tcp_server() -> Pair:
    near = TcpServerTransport("tcpin:127.0.0.1:0", "127.0.0.1", 0)
    far = TcpClientTransport("far", "127.0.0.1", near.port)
    wait(near.fileno())
    near.receive()
    return Pair(near, lambda data: void(far.send(data)), lambda: drained(far), far.close, False)


def serial_line() -> Pair:
    master, slave = pty.openpty()
    tty.setraw(master)
    path = os.ttyname(slave)
    near = SerialTransport(f"serial:{path}:115200", path, 115200)
    os.close(slave)

    def read() -> bytes:
        wait(master)
        return os.read(master, 65536)

    return Pair(near, lambda data: void(os.write(master, data)), read, lambda: os.close(master), True)


def loopback() -> Pair:
    near, far = loopback_pair()
    return Pair(near, lambda data: void(far.send(data)), lambda: b"".join(far.receive()), far.close, True)


def void(sent: object) -> None:
    assert sent


PAIRS = [udp_in, udp_out, tcp_client, tcp_server, serial_line, loopback]


@pytest.fixture(params=PAIRS, ids=[make.__name__ for make in PAIRS])
def pair(request: pytest.FixtureRequest) -> Iterator[Pair]:
    made: Pair = request.param()
    yield made
    made.near.close()
    try:
        made.hang_up()
    except OSError:
        assert made.loses_peer, "only a descriptor that the test itself closed may be closed already"


def test_idle_gives_nothing_and_does_not_wait(pair: Pair) -> None:
    assert pair.near.receive() == []


def test_bytes_arrive_whole_and_in_order(pair: Pair) -> None:
    for part in (b"one", b"two", b"three"):
        pair.write(part)
    assert collect(pair.near, 11) == b"onetwothree"


def test_datagrams_keep_their_boundaries(pair: Pair) -> None:
    if pair.near.is_stream:
        pytest.skip("a stream has no boundaries")
    pair.write(b"one")
    pair.write(b"two")
    chunks: list[bytes] = []
    while len(chunks) < 2:
        wait(pair.near.fileno())
        chunks += pair.near.receive()
    assert chunks == [b"one", b"two"]


def test_what_is_sent_is_received(pair: Pair) -> None:
    assert pair.near.send(b"rudder")
    assert pair.read() == b"rudder"


def test_a_full_line_refuses_whole_messages_and_loses_none_it_took(pair: Pair) -> None:
    message = bytes(range(256)) * 4
    taken = 0
    while taken < 20000 and pair.near.send(message):
        taken += 1
    assert taken > 0
    if not pair.near.is_stream:
        return
    assert taken < 20000, "a stream nobody reads must say at last that it is full"
    got = b""
    while len(got) < taken * len(message):
        got += pair.read()
        if len(got) >= taken * len(message) - len(message):
            # The tail of the last message leaves with the next send.
            pair.near.send(b"")
    assert got == message * taken


def test_closing_is_final_and_may_be_repeated(pair: Pair) -> None:
    pair.near.close()
    pair.near.close()
    assert pair.near.fileno() == -1
    with pytest.raises(LinkError, match="clos"):
        pair.near.receive()
    with pytest.raises(LinkError, match="clos"):
        pair.near.send(b"x")


def test_after_the_peer_hangs_up_its_last_bytes_are_read(pair: Pair) -> None:
    pair.write(b"last words")
    pair.hang_up()
    if pair.loses_peer:
        words = b""
        with pytest.raises(LinkError) as caught:
            for _ in range(5):
                wait(pair.near.fileno())
                words += b"".join(pair.near.receive())
        assert words in (b"last words", b""), "what arrived before is still given"
        assert pair.near.name in str(caught.value)
    else:
        for _ in range(3):
            pair.near.receive()
            pair.near.send(b"anybody there?")


def test_a_kind_of_transport_is_one_line_in_the_registry(monkeypatch: pytest.MonkeyPatch) -> None:
    """A toy: a loopback whose other end has a number, and which others come to."""
    far: dict[int, Transport] = {}

    def opened(link: LinkUrl, accepts: Accepts, allows: Allows) -> Transport:
        near, far[link.port] = loopback_pair()
        assert accepts(HELLO) and not accepts(b"$GPHDT") and not allows("192.0.2.1") and allows("127.0.0.1")
        return near

    medium = Medium("wire", (Scheme("wire", "mavlink", "wire:localhost:7"),), own_address, opened, listens=True)
    monkeypatch.setattr(url, "MEDIA", {**url.MEDIA, medium.name: medium})
    for table, each in (("SCHEMES", ("mavlink", "wire")), ("EXAMPLES", "wire:localhost:7")):
        monkeypatch.setattr(url, table, {**getattr(url, table), "wire": each})
    near = url.open_transport("wire:127.0.0.1:7?allow=127.0.0.1")
    near.send(HELLO)
    assert far[7].receive() == [HELLO]
    with pytest.raises(InputError, match=r"port 'x' is not a whole number .* write it like wire:localhost:7"):
        url.parse_url("wire:127.0.0.1:x")
    with pytest.raises(InputError, match=r"unknown kind 'wires'; write wire:localhost:7"):
        url.parse_url("wires:127.0.0.1:7")
