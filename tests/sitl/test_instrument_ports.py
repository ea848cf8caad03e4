"""Instruments, chart plotter and drives of `sitl serve`: options refused in one sentence, and what they say."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import pytest

from autopilot.errors import InputError
from autopilot.vessel.file import load_vessel
from sitl.boat import EARTH_RADIUS
from sitl.drives import CommandReader, jrk_length, maestro_length
from sitl.scenario import load_scenario
from sitl.sensors import Reading
from sitl.serve import Lines, drive_port, nmea_port, open_ports
from sitl.wire_nmea import ChartPlotter, NmeaInstruments
from sitl.world import World


def world(**sections: object) -> World:
    return World(load_vessel("lanxin"), dataclasses.replace(load_scenario("calm"), **sections))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("hydraulic:/tmp/x:9600", "'hydraulic' is no drive; allowed are pypilot, jrk, maestro, valve"),
        ("jrk:/tmp/x", "--drive /tmp/x: write a path and a baud rate"),
        ("jrk", "--drive : write a path and a baud rate"),
    ],
)
def test_a_bad_drive_is_one_sentence(text: str, words: str) -> None:
    with pytest.raises(InputError) as caught:
        drive_port(world(), text)
    assert words in str(caught.value)


def test_bad_nmea_places_and_a_plotter_without_a_route_are_one_sentence() -> None:
    with pytest.raises(InputError, match="or an NMEA link without options"):
        nmea_port(world(), "udpin:127.0.0.1:0", "HDG")
    with pytest.raises(InputError, match="or an NMEA link without options"):
        nmea_port(world(), "nmea-udp:127.0.0.1:0?steer=no", "HDG")
    with pytest.raises(InputError, match="APB come from a chart plotter; give the scenario a route"):
        open_ports(world(), [], Lines("/tmp/x:4800", "HDG,APB:2"))


def test_a_route_that_stands_still_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "route.yaml"
    path.write_text("schema_version: 1\nname: r\nroute: [[0, 0], [50, 0], [50, 0.5]]\n")
    with pytest.raises(InputError, match=r"route\[2\] is the place of the waypoint before it"):
        load_scenario(path)


def test_datagrams_hold_whole_sentences() -> None:
    instruments = NmeaInstruments(world(), {"HDG": 10.0, "ROT": 10.0}, 4800, is_stream=False)
    chunks = [chunk for step in range(300) for chunk in instruments.transmit(step * 0.01)]
    assert len(chunks) > 20
    assert all(chunk.startswith(b"$") and chunk.endswith(b"\r\n") and chunk.count(b"$") == 1 for chunk in chunks)


def reading(north: float, east: float) -> Reading:
    start = load_scenario("calm").start
    latitude = start.latitude_deg + math.degrees(north / EARTH_RADIUS)
    parallel = EARTH_RADIUS * math.cos(math.radians(start.latitude_deg))
    longitude = start.longitude_deg + math.degrees(east / parallel)
    return Reading(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, latitude, longitude, 0.0, 0.0)


def test_the_plotter_s_error_bearing_and_switch() -> None:
    route = ((0.0, 0.0), (0.0, 1852.0), (1852.0, 1852.0))
    plotter = ChartPlotter(dataclasses.replace(load_scenario("calm"), route=route))
    plotter.update(reading(-92.6, 926.0))
    apb = plotter.sentence("APB", reading(-92.6, 926.0)).decode().split(",")
    assert apb[3:6] == ["0.050", "L", "N"], "south of a track to the east is starboard of it: steer left"
    assert apb[8:11] == ["90.0", "T", "WP1"]
    rmb = plotter.sentence("RMB", reading(-92.6, 926.0)).decode().split(",")
    assert float(rmb[10]) == pytest.approx(math.hypot(92.6, 926.0) / 1852.0, abs=1e-3)
    assert float(rmb[11]) == pytest.approx(90.0 - math.degrees(math.atan2(92.6, 926.0)), abs=0.1)
    plotter.update(reading(0.0, 1840.0))
    assert plotter.sentence("APB", reading(0.0, 1840.0)).decode().split(",")[8:11] == ["0.0", "T", "WP2"]
    plotter.update(reading(1860.0, 1900.0))
    assert plotter.is_over
    assert plotter.sentence("XTE", reading(1860.0, 1900.0)).startswith(b"$ECXTE,V,V*")


def test_pololu_commands_in_both_protocols_and_broken_off() -> None:
    jrk = CommandReader(11, jrk_length)
    got = [
        command
        for byte in bytes((0xDD, 0x64, 0xAA, 11, 0x65, 2, 15, 0xAA, 12, 0x7F, 0xFF))
        if (command := jrk.take(byte))
    ]
    assert got == [(0xDD, b"\x64"), (0xE5, b"\x02\x0f"), (0xFF, b"")], "device 12 is another one"
    assert jrk.errors == 0
    maestro = CommandReader(12, maestro_length)
    got = [command for byte in bytes((0x84, 0, 0x84, 0, 0x70, 0x2E, 0x99)) if (command := maestro.take(byte))]
    assert got == [(0x84, b"\x00\x70\x2e")]
    assert maestro.errors == 2, "one broken off, one unknown"
