"""Pilot, NMEA 2000 link and the simulated boat's network in lockstep: course, route, a plotter's orders."""

from __future__ import annotations

import dataclasses
import itertools
import math
import struct

import pytest
from alarm_texts import words_of

from autopilot.angles import shortest_turn
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide
from autopilot.links.base import Link
from autopilot.links.ground_station.mission import Mission
from autopilot.links.n2k.link import FORMS, BusLine, GatewayLine, N2kLink, open_bus
from autopilot.links.transports import loopback_pair
from autopilot.links.url import parse_url
from autopilot.operators.skipper import Skipper
from autopilot.runtime.build import build_pilot, limits_of
from autopilot.runtime.build_links import n2k_settings_of
from autopilot.signals import Mode, Tick, WindSample
from autopilot.vessel.file import load_vessel
from sitl.scenario import Scenario, WindSection, load_scenario
from sitl.wire_n2k import BusTransport, N2kNetwork
from sitl.world import World

STEP = 0.02
CALM = load_scenario("calm")
POINTS = ((0.0, 0.0), (300.0, 0.0), (300.0, 300.0), (0.0, 500.0))


class Voyage:
    """Lanxin on NMEA 2000, through a gateway or on a virtual CAN bus."""

    def __init__(self, scenario: Scenario = CALM, orders: str = "no", bus: str = "") -> None:
        vessel = load_vessel("lanxin")
        self.world = World(vessel, scenario)
        self.network = N2kNetwork(self.world, is_text=not bus)
        self.guide = PlotterGuide()
        self.skipper = Skipper(limits_of(vessel).angle_max, self.guide, Mission(TrackGuide(), ()))
        if bus:
            line: BusLine | GatewayLine = BusLine(bus, open_bus("x", "virtual", bus))
            self.far: object = BusTransport(bus, open_bus("x", "virtual", bus))
        else:
            near, self.far = loopback_pair()
            line = GatewayLine(near, FORMS["ydwg"]())
        settings = n2k_settings_of(vessel, parse_url(f"n2k:ydwg-tcp:h:1?orders={orders}"))
        self.link: Link = N2kLink(line, settings, self.guide, self.skipper)
        self.pilot = build_pilot(vessel)
        self.now, self.tick = 0.0, None

    def sail(self, seconds: float) -> list[Tick]:
        ticks: list[Tick] = []
        far: BusTransport = self.far  # type: ignore[assignment]
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            for data in far.receive():
                self.network.receive(self.now, data)
            for data in self.network.transmit(self.now):
                far.send(data)
            samples = self.link.receive(self.now)
            order = self.skipper(self.now, self.tick)
            self.tick = self.pilot.step(self.now, tuple(samples), order)
            self.link.send(self.now, self.tick.command)
            self.link.poll(self.now)
            self.link.publish_tick(self.tick)  # type: ignore[attr-defined]
            ticks.append(self.tick)
        return ticks


@pytest.mark.parametrize("bus", ["", "boat on a bus"])
def test_a_course_is_held_by_what_the_network_brings_and_the_drive_takes(bus: str) -> None:
    voyage = Voyage(dataclasses.replace(CALM, wind=WindSection(speed_m_s=6.0, from_deg=60.0)), bus=bus)
    voyage.sail(2.0)
    voyage.skipper.engage(0.8)
    ticks = voyage.sail(40.0)
    assert ticks[-1].mode is Mode.ENGAGED and words_of(ticks[-1]) == ()
    assert voyage.pilot.state.estimate.path.late == 0.0
    assert shortest_turn(voyage.world.boat.state.heading, 0.8) == pytest.approx(0.0, abs=math.radians(1.0))
    winds = [each for tick in ticks for each in tick.samples if isinstance(each, WindSample)]
    assert len(winds) == pytest.approx(80, abs=3) and winds[-1].speed > 3.0
    kinds = {each.source for tick in ticks for each in tick.samples if each.source.startswith("N2K")}
    assert kinds == {
        *("N2K127250.35:M", "N2K127251.35", "N2K127257.35", "N2K127245.12", "N2K128259.22"),
        *("N2K129025.7", "N2K129026.7", "N2K129029.7", "N2K130306.9"),
    }
    voyage.link.release(voyage.now)
    voyage.sail(0.1)
    assert voyage.world.helms[0].orders(voyage.world.time).rudder is None
    assert {each.group for each in voyage.network.heard} >= {60928, 59904, 127245}


def test_a_plotter_s_route_is_followed_past_its_waypoints() -> None:
    voyage = Voyage(dataclasses.replace(CALM, route=POINTS))
    voyage.sail(2.0)
    voyage.skipper.engage(0.0)
    voyage.skipper.follow()
    errors, headings = [], []
    while not voyage.network._plotter.is_over and voyage.now < 600.0:  # type: ignore[union-attr]
        ticks = voyage.sail(1.0)
        state = voyage.world.boat.state
        headings.append(state.heading)
        errors.append(distance_to_route(state.north, state.east))
        assert ticks[-1].mode is Mode.ENGAGED
    assert voyage.now < 600.0
    assert max(errors) < 12.0, "no further than the corner that is cut and the turn that follows"
    swing = min(shortest_turn(0.0, each) for each in headings[:60])
    assert swing > math.radians(-8.0), "never to port before the first turn, which is to starboard"
    voyage.sail(10.0)
    (words,) = words_of(voyage.sail(0.1)[-1])
    assert words.startswith("the chart plotter does not lead (129284 holds no valid data, its navigation has ended)")


def distance_to_route(north: float, east: float) -> float:
    best = math.inf
    for (a, b), (c, d) in itertools.pairwise(POINTS):
        length2 = (c - a) ** 2 + (d - b) ** 2
        along = min(max(((north - a) * (c - a) + (east - b) * (d - b)) / length2, 0.0), 1.0)
        best = min(best, math.hypot(north - a - along * (c - a), east - b - along * (d - b)))
    return best


def command(mode: int, course: float | None = None) -> bytes:
    pairs = struct.pack("<BB", 5, mode) + (b"" if course is None else struct.pack("<BH", 11, round(course * 1e4)))
    return struct.pack("<B3sBB", 1, (127237).to_bytes(3, "little"), 0xF8, 1 + (course is not None)) + pairs


def test_a_plotter_engages_turns_and_ends_the_steering() -> None:
    voyage = Voyage(orders="yes")
    voyage.sail(2.0)
    voyage.network.command(command(4, 0.5))
    assert voyage.sail(30.0)[-1].mode is Mode.ENGAGED
    assert voyage.world.boat.state.heading == pytest.approx(0.5, abs=0.02)
    voyage.network.command(command(4, 1.0))
    voyage.sail(30.0)
    assert voyage.world.boat.state.heading == pytest.approx(1.0, abs=0.02)
    voyage.network.command(command(0))
    assert voyage.sail(1.0)[-1].mode is Mode.STANDBY
    answers = [each.data for each in voyage.network.heard if each.group == 126208]
    assert [each[4] & 15 for each in answers] == [0, 0, 0]


def test_without_leave_a_plotter_can_only_end_the_steering() -> None:
    voyage = Voyage()
    voyage.sail(2.0)
    voyage.network.command(command(4, 0.5))
    assert voyage.sail(2.0)[-1].mode is Mode.STANDBY
    voyage.skipper.engage(0.0)
    assert voyage.sail(5.0)[-1].mode is Mode.ENGAGED
    voyage.network.command(command(4, 0.5))
    assert voyage.sail(5.0)[-1].order.heading == 0.0
    voyage.network.command(command(0))
    assert voyage.sail(1.0)[-1].mode is Mode.STANDBY
