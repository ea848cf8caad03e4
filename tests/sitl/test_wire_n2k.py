"""The simulated boat's NMEA 2000 network: what its gateway shows, what the drive obeys, and what faults take away."""

from __future__ import annotations

import dataclasses
import math
import struct

import pytest

from autopilot.errors import InputError
from autopilot.vessel.file import load_vessel
from sitl.faults import Fault
from sitl.scenario import DriveSection, load_scenario
from sitl.serve import n2k_port
from sitl.wire_n2k import CLASSES, N2kNetwork
from sitl.world import World

CALM = load_scenario("calm")


def network(**changes: object) -> N2kNetwork:
    return N2kNetwork(World(load_vessel("lanxin"), dataclasses.replace(CALM, **changes)))  # type: ignore[arg-type]


def order(angle: float | None) -> bytes:
    side = 0 if angle is None else 1 if angle > 0.0 else 2
    raw = 0x7FFF if angle is None else round(abs(angle) * 1e4)
    data = struct.pack("<BBhhH", 0, 0xF8 | side, raw, 0x7FFF, 0xFFFF)
    return f"09F10DCC {data.hex(' ').upper()}\r\n".encode()


def groups(lines: list[bytes]) -> list[int]:
    identifiers = [int(line.split()[2], 16) for line in lines]
    return [each >> 8 & 0x1FFFF if each >> 16 & 255 >= 240 else each >> 8 & 0x1FF00 for each in identifiers]


def test_every_node_claims_its_address_and_says_so_again_when_asked() -> None:
    boat = network()
    first = boat.transmit(0.0)
    assert groups(first) == [60928] * len(CLASSES)
    assert {int(line.split()[2], 16) & 255 for line in first} == set(CLASSES)
    boat.receive(0.0, b"18EAFFFE 00 EE 00\r\n18EA23FE 00 EE 00\r\n")
    said = boat.transmit(0.0)
    assert [line.split()[1] for line in said] == [b"T", *[b"R"] * len(CLASSES), b"T", b"R"]


def test_what_is_sent_moves_the_rudder_comes_back_marked_and_lapses() -> None:
    boat = network(drive=DriveSection(silence_s=1.0))
    boat.receive(0.0, order(0.2)[:20])
    boat.receive(0.0, order(0.2)[20:] + b"nonsense\r\n")
    boat.transmit(0.9)
    assert boat.world.boat.state.rudder == pytest.approx(0.2, abs=0.01)
    boat.receive(0.9, order(-0.1))
    assert any(b" T 09F10DCC 00 FA" in line for line in boat.transmit(0.95))
    boat.transmit(1.88)
    assert boat.world.boat.state.rudder == pytest.approx(-0.1, abs=0.02)
    boat.transmit(4.0)
    assert boat.world.boat.state.rudder == pytest.approx(0.0, abs=0.01), "no order for a second"
    boat.receive(4.0, order(0.2))
    boat.receive(4.1, order(None))
    assert boat.drive.orders(4.1).rudder is None


def test_instruments_speak_at_their_rates_and_fall_silent_with_their_faults() -> None:
    boat = network(route=((0.0, 0.0), (500.0, 0.0)))
    for kind in ("log_lost", "position_lost", "heading_dropout"):
        boat.world.faults.add(Fault(kind, 5.0, math.inf, 1.0))
    lines = [line for step in range(1, 101) for line in boat.transmit(0.1 * step)]
    found = groups(lines)
    counted = [found.count(group) for group in (127250, 127251, 127245, 128259, 129025, 130306, 129283)]
    assert counted == pytest.approx([50, 100, 100, 5, 25, 20, 10], abs=1)
    assert all(line.endswith(b"\r\n") and line[12:15] == b" R " for line in lines)


@pytest.mark.parametrize(
    "url", ["nmea-tcpin:127.0.0.1:0", "n2k:actisense:/dev/x", "n2k:ydwg-tcpin:127.0.0.1:0?steer=no"]
)
def test_what_cannot_be_served_is_refused_with_an_example(url: str) -> None:
    with pytest.raises(InputError, match=r"n2k:ydwg-tcpin:127\.0\.0\.1:1457 or n2k:socketcan:vcan0"):
        n2k_port(World(load_vessel("lanxin"), CALM), url)
