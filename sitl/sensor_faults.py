"""What faults make of a set of readings, on its way from the sensors to the wire."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from autopilot.angles import wrap_positive
from sitl.fault_kinds import FaultKind, Source
from sitl.faults import FaultBoard
from sitl.reading import EARTH_RADIUS, Reading
from sitl.rudder_faults import delayed
from sitl.sea import Deviates


class SensorFaults:
    """Spoils the readings of one source, one after the other. Memory: values that have frozen or are on their way."""

    def __init__(self, faults: FaultBoard, seed: np.random.SeedSequence, source: Source = "first") -> None:
        self._faults = faults
        self._source = source
        rng = np.random.default_rng(seed)
        self._deviate = Deviates(rng).next
        self._chance = rng.random
        self._held: dict[str, tuple[float, ...]] = {}
        self._on_their_way: dict[str, deque[tuple[float, float]]] = {}

    def spoil(self, time: float, reading: Reading) -> Reading:
        """Return the reading measured at `time` [s] as the faults of that time leave it."""
        if not self._faults:
            return reading
        rate, roll_rate = self._rates(time, reading)
        water_speed, ground_speed, north_speed, east_speed = self._speeds(time, reading)
        jump = self._size("position_jump", time) or 0.0
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
