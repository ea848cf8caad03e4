"""What the instruments make of the truth: noise, offset, resolution, latency, drop-outs, freezing.

One set of measured values, as it leaves the sensors.

What faults make of a set of readings, on its way from the sensors to the wire.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from autopilot.angles import wrap, wrap_positive
from autopilot.models.weather import apparent_wind
from autopilot.vessel.schema import Vessel
from sitl.boat import EARTH_RADIUS, BoatState
from sitl.fault_table import COMPASS, EVERYTHING, Acting, Dice
from sitl.faults import FaultBoard
from sitl.registry import Source
from sitl.scenario import Scenario
from sitl.sea import Deviates


class Reading(NamedTuple):
    """One set of measured values and when they were measured, `time` [s] since the start.

    heading [rad] in [0, 2 pi), true; rate [rad/s]; roll [rad]; roll_rate [rad/s]; rudder [rad]; water_speed,
    ground_speed [m/s]; course [rad] over the ground; latitude, longitude [deg]; north_speed, east_speed [m/s];
    wind_angle [rad], clockwise from the bow, and wind_speed [m/s] of the apparent wind.
    """

    time: float
    heading: float
    rate: float
    roll: float
    roll_rate: float
    rudder: float
    water_speed: float
    ground_speed: float
    course: float
    latitude: float
    longitude: float
    north_speed: float
    east_speed: float
    wind_angle: float = 0.0
    wind_speed: float = 0.0


class Measured(NamedTuple):
    """What instruments measured at a time [s], before anybody looks: the boat, the true wind [m/s] and where it comes
    from [rad], and their deviates.

    faulty: what the first and the second compass make of it where faults are at work, else None.
    """

    time: float
    state: BoatState
    air: tuple[float, float]
    drawn: list[float]
    vane: list[float]
    faulty: tuple[Reading, Reading] | None = None


class Noise(NamedTuple):
    """What compass, rate gyro and log make of the truth: standard deviations [rad], [rad/s], [m/s]; the compass's
    constant error and resolution [rad]; latency [s]."""

    heading: float
    rate: float
    speed: float
    offset: float
    resolution: float
    latency: float


DEVIATES_A_SET = 10
"""How many deviates one set of readings takes; heading, rate and speed take these of them."""
HEADING, RATE, SPEED = 0, 5, 9
COMPASSES: tuple[Source, Source] = ("first", "second")


def noise_of(vessel: Vessel, scenario: Scenario) -> Noise:
    """Return the instruments of a scenario; what it leaves open is as the vessel file says."""
    section, filed = scenario.sensors, vessel.sensors
    return Noise(
        heading=math.radians(or_else(section.heading_noise_deg, filed.heading_noise_deg)),
        rate=math.radians(or_else(section.rate_noise_deg_s, filed.rate_noise_deg_s)),
        speed=section.speed_noise_m_s,
        offset=math.radians(section.heading_offset_deg),
        resolution=math.radians(section.heading_step_deg),
        latency=or_else(section.latency_s, filed.heading_latency_s),
    )


def shown(noise: Noise, state: BoatState, heading: float, rate: float, speed: float) -> tuple[float, float, float]:
    """Return heading [rad] in [0, 2 pi), rate [rad/s] and speed through the water [m/s] with the deviates of each."""
    seen = state.heading + noise.offset + noise.heading * heading
    if noise.resolution > 0.0:
        seen = round(seen / noise.resolution) * noise.resolution
    return wrap_positive(seen), state.rate + noise.rate * rate, state.speed + noise.speed * speed


class Sensors:
    """The boat's instruments. `sample` is called once a step; `latest` gives what has left the sensor by then."""

    def __init__(
        self, vessel: Vessel, scenario: Scenario, seed: np.random.SeedSequence, faults: FaultBoard | None = None
    ) -> None:
        section = scenario.sensors
        self._section = section
        self._faults = faults = FaultBoard(scenario.faults) if faults is None else faults
        first, second, vane = seed.spawn(3)
        self._dice = _dice(first), _dice(second)
        self._start = scenario.start
        self._noise = noise_of(vessel, scenario)
        self._deviates = Deviates(np.random.default_rng(seed))
        self._vane = Deviates(np.random.default_rng(vane))
        self._on_their_way: deque[Measured] = deque()
        self._latest: Measured | None = None
        self._shown: tuple[Reading, Reading] | None = None
        variation_deg = or_else(section.variation_deg, or_else(vessel.sensors.variation_deg, 0.0))
        self.variation = math.radians(variation_deg)
        """Magnetic variation [rad] where the boat is, east positive; 0 where neither file says."""

    def sample(self, time: float, state: BoatState, air: tuple[float, float] = (0.0, 0.0)) -> None:
        """Measure the boat, and the wind over it, at `time` [s] since the start.

        What is shown is worked out where somebody looks, which is seldom; faults, which remember, see all of it while
        they are at work. air: the true wind [m/s], and where it comes from [rad].
        """
        measured = Measured(time, state, air, self._deviates.take(DEVIATES_A_SET), self._vane.take(2))
        at_work = [self._faults.acting("reads", time, source) for source in COMPASSES] if self._faults else []
        if any(at_work):
            reading = self._reading(measured)
            one, other = (_faulty(reading, *each) for each in zip(at_work, self._dice, strict=True))
            measured = measured._replace(faulty=(one, other))
        self._on_their_way.append(measured)

    def _reading(self, measured: Measured) -> Reading:
        time, state, air, drawn, vane, _ = measured
        wind = apparent_wind(*air, state.heading, state.north_speed, state.east_speed)
        section, noise = self._section, self._noise
        heading, rate, water_speed = shown(noise, state, drawn[HEADING], drawn[RATE], drawn[SPEED])
        position = section.position_noise_m
        north_speed = state.north_speed + noise.speed * drawn[1]
        east_speed = state.east_speed + noise.speed * drawn[2]
        latitude = self._start.latitude_deg + math.degrees((state.north + position * drawn[3]) / EARTH_RADIUS)
        parallel = EARTH_RADIUS * math.cos(math.radians(latitude))
        longitude = self._start.longitude_deg + math.degrees((state.east + position * drawn[4]) / parallel)
        return Reading(
            time=time,
            heading=heading,
            rate=rate,
            roll=state.roll + math.radians(section.roll_noise_deg) * drawn[6],
            roll_rate=state.roll_rate + noise.rate * drawn[7],
            rudder=state.rudder + math.radians(section.rudder_noise_deg) * drawn[8],
            water_speed=water_speed,
            ground_speed=math.hypot(north_speed, east_speed),
            course=wrap_positive(math.atan2(east_speed, north_speed)),
            latitude=latitude,
            longitude=math.degrees(wrap(math.radians(longitude))),
            north_speed=north_speed,
            east_speed=east_speed,
            wind_angle=wrap(wind.angle + math.radians(section.wind_angle_noise_deg) * vane[0]),
            wind_speed=max(wind.speed + section.wind_speed_noise_m_s * vane[1], 0.0),
        )

    def latest(self, time: float) -> Reading | None:
        """Return the newest reading of the flight controller that has left the sensor by `time` [s]; None before any.

        Times must not go backwards.
        """
        pair = self._newest(time)
        return None if pair is None else pair[0]

    def second(self, time: float) -> Reading | None:
        """Return the newest reading of the instruments on the NMEA line, whose compass has faults of its own."""
        pair = self._newest(time)
        return None if pair is None else pair[1]

    def _newest(self, time: float) -> tuple[Reading, Reading] | None:
        latency = self._noise.latency
        for fault, effect in self._faults.acting("latency", time):
            latency = effect(fault, latency)
        while self._on_their_way and self._on_their_way[0].time + latency <= time + 1.0e-9:
            self._latest, self._shown = self._on_their_way.popleft(), None
        if self._shown is None and self._latest is not None:
            self._shown = self._latest.faulty or (self._reading(self._latest),) * 2
        return self._shown

    def has_heading(self, time: float, source: Source = "first") -> bool:
        """Return whether the heading sensor speaks at `time` [s]."""
        return not self._faults.silences(COMPASS, time, source)

    def is_silent(self, time: float) -> bool:
        """Return whether nothing leaves the boat at all at `time` [s]."""
        return self._faults.silences(EVERYTHING, time)


def _faulty(reading: Reading, at_work: Sequence[tuple[Acting, Callable[..., Any]]], dice: Dice) -> Reading:
    """Return the reading as the faults `at_work` leave it."""
    for fault, effect in at_work:
        reading = effect(fault, reading, dice)
    return reading


def _dice(seed: np.random.SeedSequence) -> Dice:
    rng = np.random.default_rng(seed)
    return Dice(Deviates(rng).next, rng.random)


def or_else(value: float | None, otherwise: float) -> float:
    """Return `value`, or `otherwise` where it is None."""
    return otherwise if value is None else value
