"""What the instruments make of the truth: noise, offset, resolution, latency, drop-outs, freezing."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from autopilot.angles import wrap, wrap_positive
from autopilot.params.vessel import Vessel
from sitl.boat import BoatState
from sitl.fault_kinds import Source
from sitl.faults import FaultBoard
from sitl.reading import EARTH_RADIUS, Reading
from sitl.scenario import Scenario
from sitl.sea import Deviates
from sitl.sensor_faults import SensorFaults


class Sensors:
    """The boat's instruments. `sample` is called once a step; `latest` gives what has left the sensor by then."""

    def __init__(
        self, vessel: Vessel, scenario: Scenario, seed: np.random.SeedSequence, faults: FaultBoard | None = None
    ) -> None:
        section = scenario.sensors
        self._section = section
        self._faults = faults = FaultBoard(scenario.faults) if faults is None else faults
        first, second = seed.spawn(2)
        self._spoilers = SensorFaults(faults, first), SensorFaults(faults, second, "second")
        self._start = scenario.start
        self._heading_noise = math.radians(or_else(section.heading_noise_deg, vessel.sensors.heading_noise_deg))
        self._rate_noise = math.radians(or_else(section.rate_noise_deg_s, vessel.sensors.rate_noise_deg_s))
        self._latency = or_else(section.latency_s, vessel.sensors.heading_latency_s)
        self._deviates = Deviates(np.random.default_rng(seed))
        self._on_their_way: deque[tuple[Reading, Reading]] = deque()
        self._latest: tuple[Reading, Reading] | None = None
        variation_deg = or_else(section.variation_deg, or_else(vessel.sensors.variation_deg, 0.0))
        self.variation = math.radians(variation_deg)
        """Magnetic variation [rad] where the boat is, east positive; 0 where neither file says."""

    def sample(self, time: float, state: BoatState) -> None:
        """Measure the boat at `time` [s] since the start."""
        deviate = self._deviates.next
        section = self._section
        heading = state.heading + math.radians(section.heading_offset_deg) + self._heading_noise * deviate()
        position = section.position_noise_m
        speed_noise = section.speed_noise_m_s
        north_speed = state.north_speed + speed_noise * deviate()
        east_speed = state.east_speed + speed_noise * deviate()
        latitude = self._start.latitude_deg + math.degrees((state.north + position * deviate()) / EARTH_RADIUS)
        parallel = EARTH_RADIUS * math.cos(math.radians(latitude))
        longitude = self._start.longitude_deg + math.degrees((state.east + position * deviate()) / parallel)
        reading = Reading(
            time=time,
            heading=self._shown_heading(heading),
            rate=state.rate + self._rate_noise * deviate(),
            roll=state.roll + math.radians(section.roll_noise_deg) * deviate(),
            roll_rate=state.roll_rate + self._rate_noise * deviate(),
            rudder=state.rudder + math.radians(section.rudder_noise_deg) * deviate(),
            water_speed=state.speed + speed_noise * deviate(),
            ground_speed=math.hypot(north_speed, east_speed),
            course=wrap_positive(math.atan2(east_speed, north_speed)),
            latitude=latitude,
            longitude=math.degrees(wrap(math.radians(longitude))),
            north_speed=north_speed,
            east_speed=east_speed,
        )
        one, other = self._spoilers
        self._on_their_way.append((one.spoil(time, reading), other.spoil(time, reading)))

    def _shown_heading(self, heading: float) -> float:
        """Resolution, after noise and offset."""
        step = math.radians(self._section.heading_step_deg)
        return wrap_positive(round(heading / step) * step if step > 0.0 else heading)

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
        latency = self._latency + (self._faults.size("heading_late", time) or 0.0)
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
