"""Pilot, NMEA links and the simulated boat in lockstep: a compass lost, a plotter followed, a drive that steers."""

from __future__ import annotations

import dataclasses
import math

import pytest
from alarm_texts import words_of

from autopilot.angles import wrap
from autopilot.estimation.sensor_selection import SensorSelection
from autopilot.links.nmea.link import NmeaLink
from autopilot.links.reconnect import SelectingLink
from autopilot.links.transports import loopback_pair
from autopilot.links.url import parse_url
from autopilot.runtime.build import build_pilot
from autopilot.runtime.build_links import nmea_settings_of, selection_of
from autopilot.signals import HeadingSample, Mode, Order, OrderKind, Tick
from autopilot.vessel.file import load_vessel
from sitl.scenario import SensorsSection, load_scenario
from sitl.wire_nmea import NmeaInstruments
from sitl.world import World

STEP = 0.02


class Voyage:
    """Two NMEA lines of one boat: a gyro with the rudder drive, and a magnetic compass `offset_deg` off."""

    def __init__(self, offset_deg: float = 0.0) -> None:
        vessel = load_vessel("lanxin")
        sensors = dataclasses.replace(vessel.sensors, priority=(("HEHDT", 1.0), ("HCHDM", 2.0)), variation_deg=4.0)
        self.vessel = dataclasses.replace(vessel, sensors=sensors)
        world = World(self.vessel, load_scenario("calm"))
        # the second line's boat is the first's: only its compass is off
        off = dataclasses.replace(load_scenario("calm"), sensors=SensorsSection(heading_offset_deg=offset_deg))
        other = World(self.vessel, off)
        self.world = world
        self.gyro = NmeaInstruments(world, {"HDT": 10.0, "RSA": 5.0}, 38400)
        self.compass = NmeaInstruments(other, {"HDM": 5.0}, 38400)
        self.other = other
        priority = SensorSelection(selection_of(self.vessel))
        settings = nmea_settings_of(self.vessel, parse_url("nmea:/dev/x:38400"))
        self.ends = []
        self.links = []
        for _ in range(2):
            near, far = loopback_pair()
            self.ends.append(far)
            self.links.append(SelectingLink(NmeaLink(near, settings), priority))
        self.pilot = build_pilot(self.vessel)
        self.now = 0.0

    def sail(self, seconds: float, heading_deg: float, gyro_speaks: bool = True) -> list[Tick]:
        order = Order(OrderKind.HEADING, wrap(math.radians(heading_deg)), serial=1)
        ticks = []
        for _ in range(round(seconds / STEP)):
            self.now += STEP
            for data in self.ends[0].receive():
                self.gyro.receive(self.now, data)
            self.ends[1].receive()
            for data in self.gyro.transmit(self.now):
                if gyro_speaks:
                    self.ends[0].send(data)
            self.other.boat.state = self.world.boat.state
            for data in self.compass.transmit(self.now):
                self.ends[1].send(data)
            samples = [sample for link in self.links for sample in link.receive(self.now)]
            tick = self.pilot.step(self.now, tuple(samples), order)
            for link in self.links:
                link.send(self.now, tick.command)
                link.poll(self.now)
            ticks.append(tick)
        return ticks


def sources(ticks: list[Tick]) -> set[str]:
    return {sample.source for tick in ticks for sample in tick.samples if isinstance(sample, HeadingSample)}


def test_the_second_compass_takes_over_before_the_fail_safe_and_gives_back() -> None:
    voyage = Voyage()
    ticks = voyage.sail(20.0, 30.0)
    assert sources(ticks[50:]) == {"HEHDT"}
    assert ticks[-1].mode is Mode.ENGAGED
    ticks = voyage.sail(20.0, 30.0, gyro_speaks=False)
    assert all(tick.mode is Mode.ENGAGED for tick in ticks), "the fail-safe waits 1 s, the compass takes over at 0.6 s"
    assert sources(ticks[50:]) == {"HCHDM"}
    assert math.degrees(ticks[-1].state.heading) == pytest.approx(30.0, abs=1.5)
    ticks = voyage.sail(10.0, 30.0)
    assert sources(ticks[-200:]) == {"HEHDT"}
    assert math.degrees(voyage.world.boat.state.heading) == pytest.approx(30.0, abs=1.5)


def test_a_compass_that_disagrees_is_an_alarm_and_does_not_steer() -> None:
    voyage = Voyage(offset_deg=25.0)
    ticks = voyage.sail(30.0, 30.0)
    assert ticks[-1].mode is Mode.ENGAGED
    (alarm,) = words_of(ticks[-1])
    assert alarm.startswith("heading monitor: two compasses disagree by 2")
    assert "HEHDT 0" in alarm
    assert "HCHDM 05" in alarm
    assert math.degrees(voyage.world.boat.state.heading) == pytest.approx(30.0, abs=1.0), "the gyro alone is believed"
