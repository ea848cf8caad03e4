"""A flight controller's own wind vane is held to as one at an NMEA link is; where it has none, that is said."""

from __future__ import annotations

import dataclasses
import math

import pytest
from alarm_texts import words
from lockstep import Lockstep, stick_follows
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import RefusedError
from autopilot.guidance.plotter import PlotterGuide
from autopilot.guidance.track import TrackGuide
from autopilot.links.ground_station.mission import Mission
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.operators.skipper import Skipper
from autopilot.runtime.build_links import refuse_wind_hold
from autopilot.signals import Mode, WindSample
from autopilot.vessel.file import load_vessel
from sitl.faults import Fault
from sitl.scenario import WindSection, load_scenario
from sitl.telemetry import BUILDERS

VANE = {"WNDVN_TYPE": 4.0, "WNDVN_SPEED_TYPE": 4.0}
"""An NMEA instrument at the flight controller."""


def sailing(parameters: dict[str, float], from_deg: float = 40.0, seed: int = 1) -> tuple[Lockstep, Skipper]:
    """Return a boat whose skipper waits for the wind, in 6 m/s of it."""
    calm = load_scenario("calm")
    wind = WindSection(speed_m_s=6.0, from_deg=from_deg, gust_m_s=0.5)
    boat = Lockstep(
        load_vessel("lanxin"), parameters=parameters, scenario=dataclasses.replace(calm, wind=wind, seed=seed)
    )
    skipper = Skipper(math.radians(35.0), PlotterGuide(), Mission(TrackGuide(), ()))
    skipper.await_wind()
    seen: list[int] = []

    def ask(boat: Lockstep) -> None:
        if boat.ticks and boat.tick.number not in seen:
            seen[:] = [boat.tick.number]
            boat.order = skipper(boat.now, boat.tick)

    boat.hooks += [stick_follows, ask]
    return boat, skipper


def angle_deg(boat: Lockstep) -> float:
    """Return where the apparent wind comes from in truth, off the bow."""
    return math.degrees(boat.world.sensors.latest(boat.world.time).wind_angle)


def mean_deg(boat: Lockstep, seconds: float) -> float:
    angles = []
    for _ in range(round(seconds * 2.0)):
        boat.run(0.5)
        angles.append(math.radians(angle_deg(boat)))
    return math.degrees(math.atan2(sum(map(math.sin, angles)), sum(map(math.cos, angles))))


@pytest.mark.parametrize(("from_deg", "seed"), [(40.0, 11), (300.0, 12)])
def test_the_wind_of_a_flight_controller_s_vane_is_held(from_deg: float, seed: int) -> None:
    boat, skipper = sailing(VANE, from_deg, seed)
    boat.run(20.0)
    assert boat.tick.mode is Mode.ENGAGED and skipper.wind.following
    skipper.type_line("w 60")
    boat.run(60.0)
    assert mean_deg(boat, 40.0) == pytest.approx(60.0, abs=5.0)
    skipper.type_line("w -100")
    boat.run(90.0)
    assert mean_deg(boat, 40.0) == pytest.approx(-100.0, abs=5.0)


@pytest.mark.parametrize("parameters", [{}, {"WNDVN_TYPE": 4.0}], ids=["no vane", "no anemometer"])
def test_a_flight_controller_without_a_whole_vane_is_not_engaged_and_it_is_said_what_is_missing(
    parameters: dict[str, float],
) -> None:
    boat, skipper = sailing(parameters)
    boat.run(15.0)
    assert boat.tick.mode is Mode.STANDBY and not skipper.wind.following
    assert "WNDVN_TYPE, WNDVN_SPEED_TYPE" in words(skipper.wind.alarm)
    heard = [sample for tick in boat.ticks for sample in tick.samples if isinstance(sample, WindSample)]
    assert all(sample.speed == 0.0 for sample in heard) and bool(heard) == bool(parameters)


def test_a_vane_that_falls_silent_leads_no_more_and_the_heading_stays() -> None:
    boat, skipper = sailing(VANE)
    boat.run(20.0)
    boat.world.faults.add(Fault("wind_lost", boat.now, math.inf, 1.0))
    boat.run(8.0)
    assert "no wind is heard" in skipper.wind.lost and boat.tick.mode is Mode.ENGAGED
    order = boat.order
    boat.run(10.0)
    assert boat.order == order


def test_the_true_wind_is_where_it_comes_from() -> None:
    boat, _ = sailing(VANE, from_deg=300.0)
    boat.run(10.0)
    seen = MavlinkCodec()
    winds = []
    for _ in range(100):
        boat.run(0.1)
        reading = boat.world.sensors.latest(boat.world.time)
        assert reading is not None
        found = BUILDERS[dialect.MAVLINK_MSG_ID_WIND](boat.firmware, boat.now, reading)
        winds.append(seen.decode(MavlinkCodec(1, 1).encode(found))[0])
    assert sum(wind.direction for wind in winds) / 100.0 == pytest.approx(300.0, abs=4.0)
    assert sum(wind.speed for wind in winds) / 100.0 == pytest.approx(6.0, abs=1.0)


def test_only_links_that_can_bring_no_wind_are_refused() -> None:
    refuse_wind_hold(["udpin:127.0.0.1:0"])
    refuse_wind_hold(["pypilot:/dev/ttyUSB9:38400", "nmea:/dev/ttyUSB1:4800"])
    with pytest.raises(RefusedError, match="WNDVN_TYPE"):
        refuse_wind_hold(["pypilot:/dev/ttyUSB9:38400"])
