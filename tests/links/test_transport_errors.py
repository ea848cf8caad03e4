"""Errors of the transports and the URLs: one sentence that says what, where and what to do; and who is heard."""

from __future__ import annotations

import os
import pty
import socket
import stat
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.errors import InputError
from autopilot.links.base import LinkError
from autopilot.links.mavlink.codec import MavlinkCodec, dialect, is_mavlink
from autopilot.links.transports import TcpServerTransport, UdpInTransport, UdpOutTransport
from autopilot.links.url import EXAMPLES, SCHEMES, open_transport, parse_url

HEARTBEAT = MavlinkCodec(1, 1).encode(dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3))


@pytest.mark.parametrize(
    ("url", "words"),
    [
        ("tcp:127.0.0.1:1", "connection refused, nothing listens there; start the other side first"),
        ("udpin:203.0.113.7:14550", "this machine does not have that address"),
        ("udpin:no such host:14550", "host 'no such host' is not an address"),
        ("nmea:/dev/does-not-exist:4800", "there is no device /dev/does-not-exist; plug it in"),
        ("serial:/dev/null:115200", "/dev/null is not a serial port; name a device such as /dev/ttyUSB0"),
        ("serial:/:115200", "/ is not a serial port"),
        ("upd:127.0.0.1:14550", "unknown kind 'upd'; write one of udpin:"),
        ("serail:/dev/ttyUSB0:57600", "unknown kind 'serail'; write serial:"),
        ("", "unknown kind ''"),
        ("udpin", "unknown kind 'udpin'; write one of udpin:"),
        ("udpin:14550", "incomplete; write it like udpin:127.0.0.1:14550"),
        ("udpin:127.0.0.1:99999", "port '99999' is not a whole number from 0 to 65535"),
        ("udpout:127.0.0.1:0", "port '0' is not a whole number from 1 to 65535"),
        ("tcp:::1:5760", "host '::1' is not an address"),
        ("serial:/dev/ttyUSB0", "incomplete; write it like serial:/dev/ttyUSB0:115200"),
        ("nmea:/dev/ttyUSB0:fast", "baud rate 'fast' is not a whole number"),
        ("nmea:/dev/ttyUSB0:100", "baud rate '100' is not a whole number from 300"),
    ],
)
def test_one_sentence_says_what_where_and_what_to_do(url: str, words: str) -> None:
    with pytest.raises((InputError, LinkError)) as caught:
        open_transport(url)
    text = str(caught.value)
    assert words in text
    assert url in text
    assert "\n" not in text


def test_a_forbidden_port_names_the_group(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    device = tmp_path / "ttyS9"
    device.write_bytes(b"")
    device.chmod(0)
    if os.access(device, os.R_OK):
        # The superuser may open anything: let the system call itself refuse.
        real_open = os.open

        def refuse(path, *args, **kwargs):
            if str(path) == str(device):
                raise PermissionError(13, "Permission denied", str(path))
            return real_open(path, *args, **kwargs)

        monkeypatch.setattr(os, "open", refuse)
    assert stat.S_IMODE(device.stat().st_mode) == 0
    with pytest.raises(LinkError, match=r"permission denied on .*ttyS9; add your user to the group dialout"):
        open_transport(f"serial:{device}:115200")


def test_a_port_in_use_is_named() -> None:
    first = UdpInTransport("udpin:127.0.0.1:0", "127.0.0.1", 0)
    with pytest.raises(LinkError, match="in use by another program"):
        open_transport(f"udpin:127.0.0.1:{first.port}")
    first.close()
    server = TcpServerTransport("tcpin:127.0.0.1:0", "127.0.0.1", 0)
    with pytest.raises(LinkError, match="in use by another program"):
        open_transport(f"tcpin:127.0.0.1:{server.port}")
    server.close()


def test_a_serial_port_is_opened_by_one_program_only() -> None:
    master, slave = pty.openpty()
    path = os.ttyname(slave)
    first = open_transport(f"nmea:{path}:4800")
    with pytest.raises(LinkError, match="in use by another program"):
        open_transport(f"nmea:{path}:4800")
    first.close()
    open_transport(f"nmea:{path}:4800").close()
    os.close(slave)
    os.close(master)


def test_an_unplugged_line_is_noticed_by_both_directions() -> None:
    master, slave = pty.openpty()
    path = os.ttyname(slave)
    line = open_transport(f"nmea:{path}:4800")
    os.close(slave)
    os.close(master)
    with pytest.raises(LinkError, match=r"gone \(unplugged\?\); plug it in again"):
        line.receive()
    with pytest.raises(LinkError, match=r"gone \(unplugged\?\)"):
        line.send(b"$AGROR,0.0,A,,V,B*1C\r\n")
    line.close()


def test_udpin_latches_on_to_the_first_valid_peer_and_hears_no_stranger() -> None:
    link = UdpInTransport("udpin:127.0.0.1:0", "127.0.0.1", 0, is_mavlink)
    noise, vehicle, stranger = (UdpOutTransport("peer", "127.0.0.1", link.port) for _ in range(3))
    assert link.send(b"x") is False, "nobody to send to yet"
    noise.send(b"GET / HTTP/1.1\r\n\r\n")
    vehicle.send(HEARTBEAT)
    stranger.send(HEARTBEAT)
    assert link.receive() == [HEARTBEAT]
    assert link.refused_senders == 2
    assert link.send(b"to the vehicle")
    assert vehicle.receive() == [b"to the vehicle"]
    assert stranger.receive() == []
    stranger.send(HEARTBEAT)  # dropped by the kernel: no stranger wakes the loop or fills the buffer
    assert link.receive() == [] and link.refused_senders == 2
    vehicle.send(HEARTBEAT)
    assert link.receive() == [HEARTBEAT]
    link.forget_peer()
    assert stranger.receive() == []  # takes note that it was refused
    stranger.send(HEARTBEAT)
    assert link.receive() == [HEARTBEAT]
    for end in (link, noise, vehicle, stranger):
        end.close()


def test_udpout_hears_only_its_peer() -> None:
    peer = UdpInTransport("peer", "127.0.0.1", 0)
    link = UdpOutTransport("udpout", "127.0.0.1", peer.port)
    link.send(HEARTBEAT)
    peer.receive()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
        stranger.sendto(b"false", ("127.0.0.1", link._socket.getsockname()[1]))
        peer.send(b"true")
        assert link.receive() == [b"true"]
    link.close()
    peer.close()


def test_a_refused_datagram_is_no_end() -> None:
    vacant = UdpInTransport("vacant", "127.0.0.1", 0)
    port = vacant.port
    vacant.close()
    link = UdpOutTransport("udpout", "127.0.0.1", port)
    for _ in range(4):
        link.send(HEARTBEAT)
        assert link.receive() == []
    peer = UdpInTransport("peer", "127.0.0.1", port)
    for _ in range(3):
        link.send(HEARTBEAT)
    assert HEARTBEAT in peer.receive()
    link.close()
    peer.close()


def test_tcp_server_takes_the_next_client_when_one_leaves() -> None:
    server = TcpServerTransport("tcpin:127.0.0.1:0", "127.0.0.1", 0)
    for word in (b"first", b"second"):
        with socket.create_connection(("127.0.0.1", server.port)) as client:
            client.sendall(word)
            got: list[bytes] = []
            while not got:
                got = server.receive()
            assert got == [word]
        while server.fileno() != server._listener.fileno():
            server.receive()
    server.close()


@pytest.mark.parametrize("scheme", EXAMPLES)
def test_every_example_is_a_link(scheme: str) -> None:
    link = parse_url(EXAMPLES[scheme])
    assert (link.protocol, link.medium) == SCHEMES[scheme]


def test_addresses_with_colons_go_in_brackets() -> None:
    assert parse_url("udpin:[::1]:14550").host == "::1"
    assert parse_url("serial:/dev/serial/by-id/usb-a:b:57600").path == "/dev/serial/by-id/usb-a:b"


@given(st.text(max_size=40))
def test_any_text_is_a_link_or_one_sentence(text: str) -> None:
    try:
        parse_url(text)
    except InputError as error:
        assert "write" in str(error)


@pytest.mark.parametrize(
    ("url", "is_link"),
    [
        ("udpin:127.0.0.1:0", True),
        ("tcpin:127.0.0.1:0", True),
        ("udpout:127.0.0.1:0", False),
        ("udpout:127.0.0.1:1", True),
        ("tcp:127.0.0.1:0", False),
        ("tcp:127.0.0.1:65535", True),
        ("tcp:127.0.0.1:65536", False),
        ("udpin:127.0.0.1:65536", False),
        ("serial:/dev/x:300", True),
        ("serial:/dev/x:299", False),
        ("serial:/dev/x:4000000", True),
        ("serial:/dev/x:4000001", False),
        ("serial:/dev/x:-9600", False),
        ("serial:/dev/x:0000009600", False),
        ("tcp:[::1]:5760", True),
        ("tcp:::1:5760", False),
        ("tcp:[::1:5760", False),
        ("tcp:a b:5760", False),
        ("tcp:[]:5760", False),
        ("n2k:socketcan:can0", True),
        ("n2k:socketcan:", False),
        ("n2k:socket can:can0", False),
        ("nmea:/dev/x:4800?send=HDT:0.1", True),
        ("nmea:/dev/x:4800?send=HDT:0.09", False),
        ("nmea:/dev/x:4800?send=HDT:50", True),
        ("nmea:/dev/x:4800?send=HDT:50.1", False),
        ("nmea:/dev/x:4800?send=HDT:5,HDT:5", False),
        ("nmea:/dev/x:4800?send=HDT:1.0000001", False),
        ("nmea:/dev/x:4800?send=GGA", False),
        ("nmea:/dev/x:4800?talker=II&steer=no", True),
        ("nmea:/dev/x:4800?talker=I", False),
        ("nmea:/dev/x:4800?talker=ii", False),
        ("nmea:/dev/x:4800?talker=III", False),
        ("nmea:/dev/x:4800?steer=no&steer=no", False),
        ("nmea:/dev/x:4800?allow=10.0.0.1", False),
        ("nmea-udp:127.0.0.1:1?allow=10.0.0.1", True),
        ("udpin:127.0.0.1:1?allow=10.0.0.0/8", True),
        ("udpin:127.0.0.1:1?steer=no", False),
        ("n2k:socketcan:can0?steer=no", True),
        ("n2k:socketcan:can0?orders=yes&steer=yes", True),
        ("n2k:socketcan:can0?orders=maybe", False),
        ("nmea:/dev/x:4800?orders=yes", False),
        ("n2k:ydwg-tcp:192.168.4.1:1457", True),
        ("n2k:ydwg-tcp:192.168.4.1", False),
        ("n2k:ydwg-tcp:192.168.4.1:0", False),
        ("n2k:ydwg-udp:127.0.0.1:1457?allow=10.0.0.1", True),
        ("n2k:ydwg-sctp:127.0.0.1:1457", False),
        ("n2k:actisense:/dev/ttyUSB0", True),
        ("n2k:actisense:/dev/ttyUSB0:230400", True),
        ("n2k:actisense:/dev/ttyUSB0:200", False),
        ("n2k:actisense:", False),
        ("n2k:socketcan:can0?send=HDT", False),
    ],
)
def test_a_url_is_taken_up_to_its_limits(url: str, is_link: bool) -> None:
    if is_link:
        assert parse_url(url).text == url
    else:
        with pytest.raises(InputError, match=r"^link "):
            parse_url(url)


def test_what_a_url_says_is_in_its_place() -> None:
    network = parse_url("tcp:[::1]:5760")
    assert (network.protocol, network.medium, network.host, network.port) == ("mavlink", "tcp", "::1", 5760)
    assert (network.path, network.baud) == ("", 0)
    line = parse_url("nmea:/dev/serial/by-id/a:b:4800?send=HDT,ROT:2.5&talker=II")
    assert (line.medium, line.path, line.baud, line.host) == ("serial", "/dev/serial/by-id/a:b", 4800, "")
    assert line.options == ((True, (("HDT", 1.0), ("ROT", 2.5)), "II", (), False, (), ()))
    bus = parse_url("n2k:socketcan:can0")
    assert (bus.medium, bus.host, bus.path, bus.options.steers) == ("can", "socketcan", "can0", True)
