"""What the instruments make of the truth: noise, offset, resolution, latency, drop-outs, freezing.

One set of measured values, as it leaves the sensors.

What faults make of a set of readings, on its way from the sensors to the wire.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

import numpy as np

from autopilot.angles import wrap, wrap_positive
from autopilot.vessel.schema import Vessel
from sitl.boat import BoatState
from sitl.fault_kinds import FaultKind, Source
from sitl.faults import Effects, FaultBoard
from sitl.faults_of_the_boat import delayed
from sitl.scenario import Scenario
from sitl.sea import Deviates

EARTH_RADIUS = 6371008.8
"""Mean radius [m], IUGG."""


class Reading(NamedTuple):
    """One set of measured values and when they were measured, `time` [s] since the start.

    heading [rad] in [0, 2 pi), true; rate [rad/s]; roll [rad]; roll_rate [rad/s]; rudder [rad]; water_speed,
    ground_speed [m/s]; course [rad] over the ground; latitude, longitude [deg]; north_speed, east_speed [m/s].
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


class SensorFaults:
    """Corrupts the readings of one source, one after the other. Memory: values that have frozen or are on their way."""

    def __init__(self, faults: FaultBoard, seed: np.random.SeedSequence, source: Source = "first") -> None:
        self._faults = faults
        self._source = source
        rng = np.random.default_rng(seed)
        self._deviate = Deviates(rng).next
        self._chance = rng.random
        self._held: dict[str, tuple[float, ...]] = {}
        self._on_their_way: dict[str, deque[tuple[float, float]]] = {}
        self._effects = Effects(faults, "reads")

    def corrupt(self, time: float, reading: Reading) -> Reading:
        """Return the reading measured at `time` [s] as the faults of that time leave it."""
        if not self._faults:
            return reading
        rate, roll_rate = self._rates(time, reading)
        water_speed, ground_speed, north_speed, east_speed = self._speeds(time, reading)
        jump = self._size("position_jump", time) or 0.0
        for fault, effect in self._effects.acting(time, self._source):
            reading = effect(fault, reading)
        return reading._replace(
            heading=self._heading(time, reading.heading),
            rate=rate,
            roll_rate=roll_rate,
            rudder=self._feedback(time, reading.rudder),
            water_speed=water_speed,
            ground_speed=ground_speed,
            north_speed=north_speed,
            east_speed=east_speed,
            latitude=reading.latitude + math.degrees(jump / EARTH_RADIUS),
        )

    def _size(self, kind: FaultKind, time: float) -> float | None:
        return self._faults.size(kind, time, self._source)

    def _heading(self, time: float, heading: float) -> float:
        size = self._size
        heading = self._delay("heading_lag", time, heading)
        (heading,) = self._freeze("heading_frozen", time, heading)
        lasted = self._faults.lasted("heading_drift", time, self._source)
        off = math.radians((size("heading_jump", time) or 0.0) + (size("heading_drift", time) or 0.0) * lasted)
        if (noise := size("heading_noise", time)) is not None:
            off += math.radians(noise) * self._deviate()
        if (share := size("heading_spikes", time)) is not None and self._chance() < share:
            off += 2.0 * math.pi * self._chance()
        return wrap_positive(heading + off) if off else heading

    def _rates(self, time: float, reading: Reading) -> tuple[float, float]:
        size = self._size
        rate = self._delay("rate_lag", time, reading.rate)
        rate, roll_rate = self._freeze("rate_frozen", time, rate, reading.roll_rate)
        if self._faults.is_on("rate_reversed", time, self._source):
            rate = -rate
        if (bias := size("rate_bias", time)) is not None:
            rate += math.radians(bias)
        if (noise := size("rate_noise", time)) is not None:
            rate += math.radians(noise) * self._deviate()
        return rate, roll_rate

    def _speeds(self, time: float, reading: Reading) -> tuple[float, ...]:
        """Through the water, over the ground, and that one's parts: a GPS is wrong in all of them at once."""
        shown = (reading.water_speed, reading.ground_speed, reading.north_speed, reading.east_speed)
        speeds = self._freeze("speed_frozen", time, *shown)
        times = self._size("speed_wrong", time)
        return speeds if times is None else tuple(speed * times for speed in speeds)

    def _feedback(self, time: float, rudder: float) -> float:
        (rudder,) = self._freeze("feedback_frozen", time, rudder)
        return rudder + math.radians(self._size("feedback_offset", time) or 0.0)

    def _delay(self, kind: FaultKind, time: float, value: float) -> float:
        """The value of some time ago, under the time stamp of now."""
        if (delay := self._size(kind, time)) is None:
            self._on_their_way.pop(kind, None)
            return value
        return delayed(self._on_their_way.setdefault(kind, deque()), time, value, delay)

    def _freeze(self, kind: FaultKind, time: float, *values: float) -> tuple[float, ...]:
        """The values of the moment when the fault began, for as long as it lasts."""
        if not self._faults.is_on(kind, time, self._source):
            self._held.pop(kind, None)
            return values
        return self._held.setdefault(kind, values)


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
        first, second = seed.spawn(2)
        self._corruptions = SensorFaults(faults, first), SensorFaults(faults, second, "second")
        self._start = scenario.start
        self._noise = noise_of(vessel, scenario)
        self._deviates = Deviates(np.random.default_rng(seed))
        self._on_their_way: deque[tuple[Reading, Reading]] = deque()
        self._latest: tuple[Reading, Reading] | None = None
        variation_deg = or_else(section.variation_deg, or_else(vessel.sensors.variation_deg, 0.0))
        self.variation = math.radians(variation_deg)
        """Magnetic variation [rad] where the boat is, east positive; 0 where neither file says."""

    def sample(self, time: float, state: BoatState) -> None:
        """Measure the boat at `time` [s] since the start."""
        drawn = [self._deviates.next() for _ in range(DEVIATES_A_SET)]
        section, noise = self._section, self._noise
        heading, rate, water_speed = shown(noise, state, drawn[HEADING], drawn[RATE], drawn[SPEED])
        position = section.position_noise_m
        north_speed = state.north_speed + noise.speed * drawn[1]
        east_speed = state.east_speed + noise.speed * drawn[2]
        latitude = self._start.latitude_deg + math.degrees((state.north + position * drawn[3]) / EARTH_RADIUS)
        parallel = EARTH_RADIUS * math.cos(math.radians(latitude))
        longitude = self._start.longitude_deg + math.degrees((state.east + position * drawn[4]) / parallel)
        reading = Reading(
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
        )
        one, other = self._corruptions
        self._on_their_way.append((one.corrupt(time, reading), other.corrupt(time, reading)))

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
        latency = self._noise.latency + (self._faults.size("heading_late", time) or 0.0)
        while self._on_their_way and self._on_their_way[0][0].time + latency <= time + 1.0e-9:
            self._latest = self._on_their_way.popleft()
        return self._latest

    def has_heading(self, time: float, source: Source = "first") -> bool:
        """Return whether the heading sensor speaks at `time` [s]."""
        return not self._faults.is_on("heading_dropout", time, source)

    def is_silent(self, time: float) -> bool:
        """Return whether nothing leaves the boat at all at `time` [s]."""
        return self._faults.is_on("silence", time)


def or_else(value: float | None, otherwise: float) -> float:
    """Return `value`, or `otherwise` where it is None."""
    return otherwise if value is None else value
