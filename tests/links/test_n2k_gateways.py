"""NMEA 2000 through gateways: the text of Yacht Devices and Actisense, the NGT-1's packets; by hand, whole and cut."""

from __future__ import annotations

import math
import random
import socket
import struct
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.estimation.sensor_selection import SelectionSettings, SensorSelection, SourceRule
from autopilot.links.base import LinkError
from autopilot.links.n2k.link import FORMS, Form, GatewayLine, N2kLink, framed, is_spoken
from autopilot.links.n2k.packets import Message
from autopilot.links.n2k.session import READ, N2kSession, N2kSettings
from autopilot.links.transports import LoopbackTransport, loopback_pair
from autopilot.runtime.build_links import LinkOptions, build_link
from autopilot.signals import HeadingSample, HelmSample, RudderCommand
from autopilot.vessel.file import load_vessel

HEADING = struct.pack("<BHhhB", 1, 10000, 0x7FFF, 0x7FFF, 0xFC)
MESSAGE = Message(127250, HEADING, 35, 255, 2)
LONG = Message(129284, bytes(range(34)), 3, 255, 3)
DATA_14 = "01 10 27 FF 7F FF 7F FC"


def heard(form: Form, data: bytes, now: float = 0.0) -> list[Message]:
    return form.feed(now, data)


def as_received(kind: str, message: Message) -> bytes:
    """Return a message as the gateway passes it on."""
    said = FORMS[kind]().encode(message)
    if kind == "ydwg":
        return b"".join(b"12:00:00.123 R " + line + b"\r\n" for line in said.splitlines())
    if kind == "actisense":
        head = bytes((message.priority, *message.group.to_bytes(3, "little"), message.destination, message.source))
        return framed(0x93, head + bytes((0x10, 0x02, 0x10, 0x03, len(message.data))) + message.data)
    return said


def test_the_text_of_yacht_devices_is_read_and_written_as_its_manual_says() -> None:
    form = FORMS["ydwg"]()
    assert heard(form, f"17:33:21.107 R 09F11223 {DATA_14}\r\n".encode()) == [MESSAGE]
    assert heard(form, f"17:33:21.107 T 09F11223 {DATA_14}\r\n".encode()) == [], "what we have sent comes back"
    assert form.encode(MESSAGE) == f"09F11223 {DATA_14}\r\n".encode()
    assert form.encode(LONG).splitlines()[:2] == [
        b"0DF90403 00 22 00 01 02 03 04 05",
        b"0DF90403 01 06 07 08 09 0A 0B 0C",
    ]
    assert form.encode(LONG).startswith(b"0DF90403 20 22"), "the next sequence"


def test_packets_of_the_ngt_1_double_what_marks_their_ends() -> None:
    body = bytes.fromhex("93 13 02 12F101 FF 23 00000000 08") + HEADING
    doubled = body.replace(b"\x10", b"\x10\x10")
    packet = b"\x10\x02" + doubled + bytes((-sum(body) & 255,)) + b"\x10\x03"
    assert heard(FORMS["actisense"](), packet) == [MESSAGE]
    said = FORMS["actisense"]().encode(Message(127245, b"\x10\x10\x03\x02\x00\x00\xff\xff", 99, 255, 2))
    body = bytes.fromhex("94 0E 02 0DF101 FF 08 1010030200 00FFFF")
    assert said == b"\x10\x02" + body.replace(b"\x10", b"\x10\x10") + bytes((-sum(body) & 255,)) + b"\x10\x03"
    assert FORMS["actisense"]().begin() == bytes.fromhex("10 02 A1 03 11 02 00 49 10 03"), "canboat's start-up message"


def test_the_text_of_actisense_is_read_and_written_as_its_paper_says() -> None:
    form = FORMS["n2k-ascii"]()
    assert heard(form, b"A173321.107 23FF2 1F112 011027FF7FFF7FFC\r\n") == [MESSAGE]
    assert form.encode(MESSAGE) == b"A000000.000 23FF2 1F112 011027FF7FFF7FFC\r\n"
    asked = Message(59904, b"\x14\xf0\x01", 35, 204, 6)
    assert heard(form, b"A173321.107 23CC6 0EA00 14F001\r\n") == [asked]


SENT = st.builds(
    Message,
    st.sampled_from(sorted(READ)),
    st.binary(min_size=3, max_size=8),
    st.integers(0, 253),
    st.just(255),
    st.integers(0, 7),
)
LONG_SENT = st.builds(
    Message,
    st.sampled_from([129029, 129284, 129285]),
    st.binary(min_size=1, max_size=223),
    st.integers(0, 253),
    st.just(255),
    st.just(6),
)


@pytest.mark.parametrize("kind", FORMS)
@settings(max_examples=60, deadline=None)
@given(messages=st.lists(st.one_of(SENT, LONG_SENT), max_size=8), seed=st.integers(0, 1 << 30))
def test_messages_survive_any_cutting_of_the_stream(kind: str, messages: list[Message], seed: int) -> None:
    form, chance = FORMS[kind](), random.Random(seed)
    stream = b"".join(as_received(kind, each) for each in messages)
    found = []
    while stream:
        size = chance.randrange(1, 40)
        found += heard(form, stream[:size])
        stream = stream[size:]
    assert form.damaged == 0
    assert found == messages


@pytest.mark.parametrize("kind", FORMS)
@settings(max_examples=60, deadline=None)
@given(noise=st.lists(st.binary(max_size=60), max_size=12))
def test_noise_is_survived_and_what_follows_is_heard(kind: str, noise: list[bytes]) -> None:
    form: Any = FORMS[kind]()
    for data in noise:
        for message in heard(form, data):
            assert message.group in READ and len(message.data) <= 255
    # a line that noise began, or a packet, may swallow what comes next
    ends = b"\r\n" if kind != "actisense" else b"\x10\x03\x10\x03"
    heard(form, ends)
    assert heard(form, as_received(kind, MESSAGE)) == [MESSAGE]


@pytest.mark.parametrize("kind", FORMS)
def test_endless_lines_and_packets_take_no_more_room(kind: str) -> None:
    form: Any = FORMS[kind]()
    for _ in range(100):
        form.feed(0.0, b"\x10\x02" + b"7" * 1000)
    held = form._packet if kind == "actisense" else form._rest
    assert len(held or b"") <= 600


@pytest.mark.parametrize("kind", FORMS)
def test_a_packet_that_is_damaged_is_counted_and_no_message(kind: str) -> None:
    sound = as_received(kind, MESSAGE)
    for place in range(len(sound)):
        form = FORMS[kind]()
        damaged = sound[:place] + bytes((sound[place] ^ 0x55,)) + sound[place + 1 :]
        found = heard(form, damaged + sound)
        if kind == "actisense":
            assert all(each == MESSAGE for each in found), "the checksum protects it"
        assert len(found) <= 2


def test_a_datagram_is_distinguished_from_noise() -> None:
    assert is_spoken("ydwg", f"17:33:21.107 R 09F11223 {DATA_14}\r\n".encode())
    assert is_spoken("ydwg", b"17:33:21.107 R 09F80115 A0 7D\r\n")
    assert not is_spoken("ydwg", b"$HCHDG,1,,,,*00\r\n")
    assert is_spoken("ydwg", b"17:33:21.107 R 09F80115 A0 7D"), "its end ends the line"
    assert not is_spoken("ydwg", b"noise") and not is_spoken("ydwg", b"") and not is_spoken("ydwg", b"\r\n")


def gateway(kind: str, **changes: Any) -> tuple[N2kLink, LoopbackTransport]:
    ours, far = loopback_pair()
    return N2kLink(GatewayLine(ours, FORMS[kind]()), N2kSettings(**changes)), far


@pytest.mark.parametrize("kind", FORMS)
def test_a_link_through_a_gateway_hears_and_steers(kind: str) -> None:
    link, far = gateway(kind)
    far.send(as_received(kind, MESSAGE))
    samples = [each for each in link.receive(0.0) if not isinstance(each, HelmSample)]
    assert samples == [HeadingSample(0.0, pytest.approx(1.0), None, "N2K127250.35")]
    link.poll(0.0)
    link.poll(0.3)
    link.send(1.0, RudderCommand(1.0, 0.2, True))
    said = b"".join(far.receive())
    order = struct.pack("<BBhhH", 0, 0xF9, 2000, 0x7FFF, 0xFFFF)
    if kind == "ydwg":
        assert b"18EEFFCC" in said, "Norrbin is the node: it claims its address"
        assert b"09F10DCC " + order.hex(" ").upper().encode() in said
    else:
        assert (b"EEFF" not in said) and (b"\x00\xee" not in said), "the gateway is the node"
        assert FORMS[kind]().encode(Message(127245, order, 0, 255, 2)) in said
    link.release(2.0)
    assert len(b"".join(far.receive())) > 0
    assert link.release_result(3.0) is not None


def test_through_a_gateway_with_an_address_of_its_own_nobody_can_order() -> None:
    link, far = gateway("n2k-ascii", takes_orders=True)
    far.send(b"A173321.107 23CC3 1ED00 0105F101F8010500\r\n")
    link.receive(0.0)
    assert far.receive() == []


def test_a_gateway_that_is_gone_ends_the_link_and_its_release_says_so() -> None:
    link, far = gateway("ydwg")
    link.poll(0.0)
    link.poll(0.3)
    link.send(1.0, RudderCommand(1.0, 0.2, True))
    far.close()
    with pytest.raises(LinkError):
        link.receive(1.1)
    link.release(1.2)
    found = link.release_result(1.3)
    assert found is not None and "the line is gone" in found.sentence


def test_the_url_of_a_gateway_builds_its_link() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        for kind in ("ydwg-tcp", "actisense-tcp", "ascii-tcp"):
            link = build_link(load_vessel("lanxin"), f"n2k:{kind}:127.0.0.1:{port}", LinkOptions())
            assert isinstance(link, N2kLink) and link.name == f"n2k:{kind}:127.0.0.1:{port}"
            assert (link.session.node is not None) is (kind == "ydwg-tcp")
            assert link.session.settings.rudder_limit == pytest.approx(math.radians(35.0), abs=0.6)
            assert not link.session.settings.takes_orders
            link.close()
    link = build_link(load_vessel("lanxin"), "n2k:ydwg-tcpin:127.0.0.1:0?orders=yes", LinkOptions())
    assert isinstance(link, N2kLink) and link.session.settings.takes_orders
    link.close()


def test_a_gateway_that_sends_datagrams_is_heard_and_answered() -> None:
    link = build_link(load_vessel("lanxin"), "n2k:ydwg-udp:127.0.0.1:0", LinkOptions())
    assert isinstance(link, N2kLink)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far:
        far.bind(("127.0.0.1", 0))
        far.settimeout(5.0)
        with socket.fromfd(link.fileno(), socket.AF_INET, socket.SOCK_DGRAM) as ours:
            where = ours.getsockname()
        far.sendto(b"noise", where)
        far.sendto(f"17:33:21.107 R 09F11223 {DATA_14}".encode(), where)
        samples = []
        while not samples:
            samples = [each for each in link.receive(0.0) if isinstance(each, HeadingSample)]
        link.poll(0.0)
        assert far.recv(1000).startswith(b"18EAFFFE 00 EE 00")
    link.close()


def test_the_compass_that_is_preferred_steers_until_it_is_silent() -> None:
    rules = (SourceRule("N2K127250.36", 1.0), SourceRule("N2K127250.*", 2.0))
    selection = SensorSelection(SelectionSettings(rules))
    session = N2kSession("bus", N2kSettings())
    chosen = []
    for step in range(200):
        now = 0.1 * step
        sent = [MESSAGE] if step % 2 else []
        sent += [MESSAGE._replace(source=36)] if not 8.0 < now < 13.0 else []
        samples = selection.admit(now, session.receive(now, sent), "bus")
        chosen.append([each.source for each in samples if isinstance(each, HeadingSample)])
    assert chosen[40:80] == [["N2K127250.36"]] * 40
    assert {each[0] for each in chosen[100:130] if each} == {"N2K127250.35"}
    assert chosen[175:] == [["N2K127250.36"]] * 25, "back again, and settled"
