"""A boat with nothing but a magnetic compass: what it steers by, what it refuses, and what it says of it."""

from __future__ import annotations

import dataclasses
import math

import pytest
from alarm_texts import words_of

from autopilot.angles import shortest_turn
from autopilot.cli.terminal import status_text
from autopilot.errors import InputError, RefusedError
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide
from autopilot.links.ground_station.mission import Mission, parse_items
from autopilot.links.nmea.link import NmeaLink
from autopilot.links.nmea.sentences import format_sentence
from autopilot.links.transports import loopback_pair
from autopilot.links.url import parse_url
from autopilot.operators.skipper import Skipper
from autopilot.runtime.build import build_pilot, limits_of, track_settings_of
from autopilot.runtime.build_links import nmea_settings_of, refuse_failsafe
from autopilot.signals import Mode, Tick
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel
from sitl.scenario import SensorsSection, load_scenario
from sitl.wire_nmea import NmeaInstruments
from sitl.world import World

STEP = 0.05
VARIATION_DEG = 6.0
LANXIN = load_vessel("lanxin")
ROUTE = "QGC WPL 110\n0\t0\t3\t16\t0\t0\t0\t0\t59.01\t18.0\t0\t1\n"


def with_sensors(**given: object) -> Vessel:
    return dataclasses.replace(LANXIN, sensors=dataclasses.replace(LANXIN.sensors, **given))  # type: ignore[arg-type]


class Boat:
    """One NMEA line with a magnetic compass and the drive, where the variation is 6 deg east; all on one clock."""

    def __init__(self, vessel: Vessel, sentences: tuple[str, ...] = ("HDM",)) -> None:
        scenario = dataclasses.replace(load_scenario("calm"), sensors=SensorsSection(variation_deg=VARIATION_DEG))
        self.world = World(vessel, scenario)
        self.instruments = NmeaInstruments(self.world, {**dict.fromkeys(sentences, 5.0), "RSA": 5.0}, 38400)
        near, self.far = loopback_pair()
        plotter = PlotterGuide()
        self.link = NmeaLink(near, nmea_settings_of(vessel, parse_url("nmea:/dev/x:38400")), plotter)
        mission = Mission(TrackGuide(track_settings_of(vessel)), parse_items(ROUTE, "route"))
        self.skipper = Skipper(limits_of(vessel).angle_max, plotter, mission)
        self.pilot = build_pilot(vessel)
        self.tick: Tick | None = None
        self.now = 0.0

    def sail(self, seconds: float, plotter: str = "") -> Tick:
        """Sail on; `plotter` is an APB sentence without checksum that comes every second."""
        for step in range(round(seconds / STEP)):
            self.now += STEP
            for data in self.far.receive():
                self.instruments.receive(self.now, data)
            for data in self.instruments.transmit(self.now):
                self.far.send(data)
            if plotter and step % 20 == 0:
                self.far.send(format_sentence("GP", "APB", plotter.split(",")))
            samples = tuple(self.link.receive(self.now))
            self.tick = self.pilot.step(self.now, samples, self.skipper(self.now, self.tick))
            self.link.send(self.now, self.tick.command)
            self.link.poll(self.now)
        assert self.tick is not None
        return self.tick

    @property
    def true_deg(self) -> float:
        return math.degrees(self.world.boat.state.heading) % 360.0

    def holds(self, true_deg: float) -> bool:
        return abs(math.degrees(shortest_turn(math.radians(self.true_deg), math.radians(true_deg)))) < 1.5


def apb(bearing_deg: float, north: str) -> str:
    return f"A,A,0.00,L,N,V,V,{bearing_deg:.1f},{north},WP1,{bearing_deg:.1f},{north},{bearing_deg:.1f},{north},A"


def test_without_a_variation_a_magnetic_compass_never_passes_for_true() -> None:
    boat = Boat(LANXIN)
    boat.skipper.engage(math.radians(50.0))
    tick = boat.sail(30.0)
    assert tick.mode is Mode.STANDBY and not tick.state.valid
    assert any(
        "the magnetic variation, which is not known: set sensors.variation_deg, or sensors.magnetic: true" in alarm
        for alarm in words_of(tick)
    )


def test_magnetic_courses_are_held_and_shown_as_such() -> None:
    boat = Boat(with_sensors(magnetic=True))
    boat.skipper.engage(math.radians(50.0))
    tick = boat.sail(60.0)
    assert tick.mode is Mode.ENGAGED and not words_of(tick)
    assert boat.holds(50.0 + VARIATION_DEG)
    assert math.degrees(tick.state.heading) == pytest.approx(50.0, abs=1.5)
    assert "course 050M  heading 0" in status_text(tick, True, 79, north="M")


def test_a_gps_that_brings_the_variation_makes_true_headings_of_a_magnetic_compass() -> None:
    boat = Boat(LANXIN, ("HDM", "RMC"))
    boat.skipper.engage(math.radians(50.0))
    tick = boat.sail(60.0)
    assert tick.mode is Mode.ENGAGED and not words_of(tick)
    assert boat.holds(50.0)


@pytest.mark.parametrize(
    ("magnetic", "sentences", "north", "true_deg"),
    [
        (True, ("HDM",), "M", 80.0 + VARIATION_DEG),
        (True, ("HDM", "RMC"), "T", 80.0),
        (True, ("HDM",), "T", None),
        (False, ("HDM", "RMC"), "M", 80.0 + VARIATION_DEG),
        (False, ("HDM", "RMC"), "T", 80.0),
    ],
)
def test_a_plotter_s_bearings_are_steered_by_the_same_north(
    magnetic: bool, sentences: tuple[str, ...], north: str, true_deg: float | None
) -> None:
    """Bearings for which a variation is missing steer nothing: the course is held."""
    boat = Boat(with_sensors(magnetic=magnetic), sentences)
    boat.skipper.engage(math.radians(50.0))
    boat.sail(40.0)
    held = boat.true_deg
    boat.skipper.follow()
    boat.sail(60.0, apb(80.0, north))
    assert boat.holds(held if true_deg is None else true_deg)


def test_no_route_leads_a_boat_that_steers_magnetic_courses() -> None:
    boat = Boat(with_sensors(magnetic=True), ("HDM", "VTG", "RMC"))
    boat.skipper.engage(math.radians(50.0))
    boat.sail(5.0)
    with pytest.raises(InputError, match=r"courses are magnetic here \(sensors\.magnetic\)"):
        boat.skipper.type_line("t")
    assert not boat.skipper.mission.is_followed


def test_a_flight_controller_s_headings_are_true_and_not_mixed_with_magnetic_courses() -> None:
    with pytest.raises(RefusedError, match=r"sensors\.magnetic is for compasses"):
        refuse_failsafe(with_sensors(magnetic=True), ["udpin:127.0.0.1:14550", "nmea:/dev/x:4800"])


def test_no_shipped_boat_says_that_its_variation_is_nought() -> None:
    """Copied for another boat it would make true headings of magnetic ones."""
    for name in ("lanxin", "lanxin_paper_gains", "naval_vessel"):
        assert load_vessel(name).sensors.variation_deg is None
