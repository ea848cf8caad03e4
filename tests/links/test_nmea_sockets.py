"""NMEA 0183 over real TCP and UDP sockets, both ways: instruments in, rudder orders and repeated sentences out."""

from __future__ import annotations

import contextlib
import math
import select
import socket
import time
from collections.abc import Callable

import pytest

from autopilot.links.base import LinkError
from autopilot.links.nmea import sentences as encode
from autopilot.links.nmea.link import NmeaLink
from autopilot.runtime.build_links import LinkOptions, build_link
from autopilot.signals import HeadingSample, Mode, NavState, Order, OrderKind, Reference, RudderCommand, Sample, Tick
from autopilot.vessel.file import load_vessel

VESSEL = load_vessel("lanxin")
OPTIONS = "?send=HDT:10"


def tick(now: float) -> Tick:
    state = NavState(now, 1.0, 0.0, 4.0, 0.0, 0.0, 0.0, True)
    command = RudderCommand(now, 0.1, True)
    return Tick(0, now, (), Order(OrderKind.HEADING, 1.0), state, Reference(1.0), 0.1, command, Mode.ENGAGED, ())


def link_of(url: str) -> NmeaLink:
    link = build_link(VESSEL, url, LinkOptions())
    assert isinstance(link, NmeaLink)
    return link


def until(done: Callable[[], object]) -> object:
    """Poll until `done` gives something; the sockets are local, but a busy machine may let us wait."""
    end = time.monotonic() + 60.0
    while not (got := done()):
        assert time.monotonic() < end, "nothing came"
        select.select([], [], [], 0.005)
    return got


def headings(link: NmeaLink, now: float) -> list[Sample]:
    return [sample for sample in link.receive(now) if isinstance(sample, HeadingSample)]


def speak(link: NmeaLink, now: float) -> None:
    link.send(now, RudderCommand(now, math.radians(5.0), True))
    link.publish_tick(tick(now))
    link.poll(now)


def test_a_plotter_that_connects_to_us_hears_and_is_heard() -> None:
    link = link_of("nmea-tcpin:127.0.0.1:0" + OPTIONS)
    port = link._line.port
    with socket.create_connection(("127.0.0.1", port), timeout=60.0) as plotter:
        plotter.sendall(encode.encode_hdt(1.0)[:7])
        plotter.sendall(encode.encode_hdt(1.0)[7:])
        (heading,) = until(lambda: headings(link, 1.0))
        assert heading.heading == pytest.approx(1.0, abs=1e-3)
        speak(link, 1.0)
        got = b""
        while b"HDT" not in got:
            got += plotter.recv(200)
        assert got.startswith(b"$AGROR,5.00,A,,V,B*")
    # it leaves; the next one is served as well
    until(lambda: not link.receive(2.0))
    with socket.create_connection(("127.0.0.1", port), timeout=60.0) as plotter:
        plotter.sendall(encode.encode_hdt(2.0))
        until(lambda: headings(link, 3.0))
    link.close()


def test_we_connect_to_a_multiplexer_and_say_when_it_is_gone() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        link = link_of(f"nmea-tcp:127.0.0.1:{server.getsockname()[1]}?steer=no")
        multiplexer, _ = server.accept()
        with multiplexer:
            multiplexer.sendall(encode.encode_hdt(1.0) + encode.encode_rot(0.1))
            until(lambda: headings(link, 1.0))
            speak(link, 1.0)
            multiplexer.setblocking(False)
            with pytest.raises(BlockingIOError):
                multiplexer.recv(10)

    def lost() -> bool:
        try:
            link.receive(2.0)
        except LinkError as error:
            return "nmea-tcp:127.0.0.1" in str(error)
        return False

    assert until(lost)
    link.release(2.0)
    link.close()


def test_nmea_over_udp_sends_one_sentence_a_datagram_and_hears_replies() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as display:
        display.bind(("127.0.0.1", 0))
        display.settimeout(60.0)
        link = link_of(f"nmea-udpout:127.0.0.1:{display.getsockname()[1]}{OPTIONS}&steer=no")
        speak(link, 1.0)
        data, address = display.recvfrom(200)
        assert data.startswith(b"$AGHDT,057.3,T*"), "one sentence in a datagram, and no order"
        display.sendto(encode.encode_hdt(0.5).strip(), address)
        until(lambda: headings(link, 1.1))
        link.close()


@pytest.mark.parametrize("scheme", ["nmea-udp", "nmea-tcpin"])
def test_an_instrument_that_starts_again_from_another_port_is_heard_again(scheme: str) -> None:
    link = link_of(f"{scheme}:127.0.0.1:0")
    kind = socket.SOCK_DGRAM if scheme == "nmea-udp" else socket.SOCK_STREAM
    ends = [socket.socket(socket.AF_INET, kind) for _ in range(2)]
    counts = []
    for number, end in enumerate(ends):  # the first one is not closed: it hangs
        end.connect(("127.0.0.1", link._line.port))
        start = 20.0 * number
        heard = 0
        for step in range(200):
            with contextlib.suppress(ConnectionRefusedError):  # while the first one holds the place
                end.sendall(encode.encode_hdt(1.0))
            heard += len(headings(link, start + 0.05 * step))
        counts.append(heard)
    assert counts[0] >= 190 and counts[1] >= 80, counts
    for end in ends:
        end.close()
    link.close()
