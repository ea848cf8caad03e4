"""Random seas and sensors: repeatable, of the size they claim, late and faulty where they are set so."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from naval_vessel import encounter_frequency

from autopilot.models import weather
from autopilot.vessel.file import load_vessel
from sitl.boat import STILL, BoatState, Hull
from sitl.scenario import (
    CurrentSection,
    FaultSection,
    IttcSection,
    Scenario,
    SensorsSection,
    WavesSection,
    load_scenario,
)
from sitl.sea import IttcSea, Sea, ittc_waves
from sitl.sensors import Reading, Sensors
from sitl.world import STEP, Orders, World


def sea_of(name: str, seed: int = 1) -> Sea:
    return Sea(load_scenario(name), Hull(), np.random.SeedSequence(seed), STEP)


def test_paper_waves_have_their_standard_deviation() -> None:
    sea = sea_of("jiang")
    still = BoatState(speed=4.63)
    values = np.degrees([sea.step(step * STEP, still).rudder for step in range(60000)])
    assert np.std(values) == pytest.approx(0.1565, rel=0.15)
    assert weather.standard_deviation(weather.JIANG_DEG) == pytest.approx(0.1565, abs=1e-4)


def test_the_same_seed_gives_the_same_sea() -> None:
    def realisation(seed: int) -> list[float]:
        sea = sea_of("sea-state-5", seed)
        state = BoatState(speed=4.63, heading=0.3)
        return [sea.step(step * STEP, state).yaw_acceleration for step in range(200)]

    assert realisation(4) == realisation(4)
    assert realisation(4) != realisation(5)


def test_a_calm_sea_pushes_the_boat_nowhere() -> None:
    assert sea_of("calm").step(1.0, BoatState(speed=4.63)) == STILL


def test_a_boat_that_drifts_with_the_current_meets_the_sea_of_still_water() -> None:
    def met(current: CurrentSection) -> list[float]:
        waves_ = WavesSection(ittc=IttcSection(significant_height_m=2.0, peak_period_s=6.0, from_deg=30.0))
        sea = Sea(Scenario(1, "stream", waves=waves_, current=current), Hull(), np.random.SeedSequence(3), STEP)
        towards = math.radians(current.towards_deg)
        north, east = current.speed_m_s * math.cos(towards), current.speed_m_s * math.sin(towards)
        return [
            sea.step(time, BoatState(north=north * time, east=east * time)).yaw_acceleration
            for time in np.arange(0.0, 60.0, 0.5)
        ]

    still = met(CurrentSection())
    assert max(still) > 0.05
    assert met(CurrentSection(speed_m_s=3.0, towards_deg=200.0)) == pytest.approx(still, abs=1e-9)


def still_sea(from_deg: float) -> IttcSea:
    section = IttcSection(significant_height_m=2.0, peak_period_s=6.0, from_deg=from_deg)
    return IttcSea(ittc_waves(section, Hull(), np.random.default_rng(2)))


def test_head_seas_neither_roll_nor_yaw() -> None:
    sea = still_sea(0.0)
    forces = [sea.at(0.5 * step, BoatState(heading=0.0)) for step in range(50)]
    assert np.max(np.abs(forces)) < 1e-12


def test_beam_seas_roll_and_bow_seas_yaw() -> None:
    beam = np.array([still_sea(90.0).at(0.2 * step, BoatState()) for step in range(2000)])
    bow = np.array([still_sea(45.0).at(0.2 * step, BoatState()) for step in range(2000)])
    assert np.std(beam[:, 1]) > np.std(bow[:, 1]), "roll slope is largest abeam"
    assert np.std(beam[:, 0]) < 1e-3 * np.std(bow[:, 0]), "and the yaw moment vanishes there"


def test_slope_has_the_variance_of_the_spectrum() -> None:
    """Abeam, the slope's variance is the integral of k^2 S, with the hull's reductions near one for long waves."""
    section = IttcSection(significant_height_m=2.0, peak_period_s=9.0, from_deg=90.0, components=200)
    small = Hull(length=1.0, beam=0.1, draught=0.02)
    sea = IttcSea(ittc_waves(section, small, np.random.default_rng(0)))
    slopes = [sea.at(0.3 * step, BoatState())[1] for step in range(8000)]
    frequency = np.linspace(math.pi / 9.0, 6.0 * math.pi / 9.0, 2000)
    density = weather.ittc_spectrum(frequency, 2.0, weather.mean_period_of(9.0))
    expected = math.sqrt(float(np.trapezoid(weather.wave_number(frequency) ** 2 * density, frequency)))
    assert np.std(slopes) == pytest.approx(expected, rel=0.08)


def test_a_moving_boat_meets_head_seas_more_often() -> None:
    """The encounter comes out of the boat's own motion, as the formula says it must."""
    section = IttcSection(significant_height_m=1.0, peak_period_s=8.0, from_deg=30.0, components=2)
    sea = IttcSea(ittc_waves(section, Hull(), np.random.default_rng(1)))
    frequency = np.asarray(sea._waves.frequency)
    speed, towards = 6.0, math.radians(210.0)
    times = 0.05 * np.arange(40000)
    yaw = [sea.at(time, BoatState(north=speed * time))[0] for time in times]
    spectrum = np.abs(np.fft.rfft(np.array(yaw) * np.hanning(len(yaw))))
    found = 2.0 * math.pi * np.fft.rfftfreq(len(yaw), 0.05)[np.argmax(spectrum)]
    expected = encounter_frequency(frequency, speed, towards)
    assert np.min(np.abs(expected - found)) < 0.01
    assert np.all(expected > frequency)


def sensors_of(scenario: Scenario) -> Sensors:
    return Sensors(load_vessel("lanxin"), scenario, np.random.SeedSequence(1))


def readings(scenario: Scenario, state: BoatState, count: int) -> list[Reading]:
    sensors = sensors_of(scenario)
    found = []
    for step in range(count):
        sensors.sample(step * STEP, state)
        reading = sensors.latest(step * STEP)
        if reading is not None:
            found.append(reading)
    return found


def test_noise_has_the_size_the_vessel_file_says() -> None:
    vessel = load_vessel("lanxin")
    found = readings(load_scenario("calm"), BoatState(heading=1.0, rate=0.1, speed=4.63), 4000)
    headings = np.degrees([reading.heading for reading in found])
    rates = np.degrees([reading.rate for reading in found])
    assert np.mean(headings) == pytest.approx(math.degrees(1.0), abs=0.03)
    assert np.std(headings) == pytest.approx(vessel.sensors.heading_noise_deg, rel=0.06)
    assert np.std(rates) == pytest.approx(vessel.sensors.rate_noise_deg_s, rel=0.06)


def with_sensors(**values: float) -> Scenario:
    return dataclasses.replace(load_scenario("calm"), sensors=SensorsSection(**values))


def test_latency_holds_a_reading_back() -> None:
    sensors = sensors_of(with_sensors(latency_s=0.25))
    for step in range(25):
        sensors.sample(step * STEP, BoatState())
        assert sensors.latest(step * STEP) is None
    sensors.sample(0.25, BoatState())
    reading = sensors.latest(0.25)
    assert reading is not None
    assert reading.time == 0.0


def test_resolution_and_offset() -> None:
    scenario = with_sensors(heading_noise_deg=0.0, heading_step_deg=1.0, heading_offset_deg=10.0)
    (reading,) = readings(scenario, BoatState(heading=math.radians(123.4)), 1)
    assert math.degrees(reading.heading) == pytest.approx(133.0)


def test_frozen_heading_stands_still_and_thaws() -> None:
    scenario = dataclasses.replace(load_scenario("calm"), faults=(FaultSection("heading_frozen", 0.5, 1.0),))
    sensors = sensors_of(scenario)
    headings = []
    for step in range(150):
        sensors.sample(step * STEP, BoatState(heading=0.05 * step))
        reading = sensors.latest(step * STEP)
        assert reading is not None
        headings.append(reading.heading)
    assert len(set(headings[50:100])) == 1
    assert len(set(headings[100:])) == 50


def test_position_is_metres_on_the_globe() -> None:
    scenario = with_sensors(position_noise_m=0.0)
    (reading,) = readings(scenario, BoatState(north=1852.0, east=926.0), 1)
    start = scenario.start
    assert (reading.latitude - start.latitude_deg) * 60.0 == pytest.approx(1.0, abs=0.002)
    east = (reading.longitude - start.longitude_deg) * 60.0 * math.cos(math.radians(reading.latitude))
    assert east == pytest.approx(0.5, abs=0.002)


def test_first_helm_that_wants_the_rudder_has_it() -> None:
    class Fixed:
        def __init__(self, orders: Orders) -> None:
            self._orders = orders

        def orders(self, time: float) -> Orders:
            return self._orders

    world = World(load_vessel("lanxin"), load_scenario("calm"))
    world.helms += [Fixed(Orders()), Fixed(Orders(rudder=0.2)), Fixed(Orders(rudder=-0.3, thrust_speed=2.0))]
    world.advance(30.0)
    assert world.boat.state.rudder == pytest.approx(0.2, abs=1e-6)
    assert world.boat.state.speed < 2.01


def test_sea_state_5_disturbs_the_boat_but_leaves_it_steerable() -> None:
    """What the seaway does to a boat with its rudder amidships: degrees, not revolutions, within a wave or two."""
    world = World(load_vessel("lanxin"), load_scenario("sea-state-5"))
    rates, rolls = [], []
    for tick in range(1, 3000):
        world.advance(tick * STEP)
        rates.append(world.boat.state.rate)
        rolls.append(world.boat.state.roll)
    assert 0.3 < math.degrees(float(np.std(rates))) < 6.0
    assert 1.0 < math.degrees(float(np.std(rolls))) < 20.0
