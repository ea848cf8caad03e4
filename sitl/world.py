"""The simulated world: one boat in its sea, moved on in fixed steps by whoever asks for a later time."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from autopilot.vessel.schema import Vessel
from sitl.boat import STILL, Boat, BoatState, BowShaft, Plant
from sitl.faults import BoatFaults, FaultBoard
from sitl.registry import kind_of
from sitl.scenario import Scenario
from sitl.sea import Sea
from sitl.sensors import Sensors

STEP = 0.01
"""Step of the physics [s]."""


class Orders(NamedTuple):
    """What one helm wants: rudder [rad] and engine speed [m/s], None leaves it to others; and the bow thruster's share
    of full, starboard positive."""

    rudder: float | None = None
    thrust_speed: float | None = None
    bow: float = 0.0


class Helm(Protocol):
    """Whoever can turn the rudder or work the engine."""

    def orders(self, time: float) -> Orders:
        """Return the orders at `time` [s]; called once for each step of the world."""


class Pace(NamedTuple):
    """Sensors measure, and the sea is felt anew, at every so many steps."""

    measured_every: int = 1
    felt_every: int = 1


class World:
    """Boat, sea and sensors of one run. Time is seconds since the start of the run: simulated time.

    `helms` are asked for their orders before each step, `watchers` are called with the time after each.
    The same vessel, scenario, seed and orders give the same readings, bit for bit. A `plant` takes the place of the one
    that vessel and scenario describe; `pace` says how often sensors measure and the sea is felt anew.
    """

    def __init__(
        self,
        vessel: Vessel,
        scenario: Scenario,
        seed: int | None = None,
        epoch: float = 0.0,
        plant: Plant | None = None,
        pace: Pace = Pace(),  # noqa: B008 - a tuple that nobody can change
    ) -> None:
        self.vessel = vessel
        self.scenario = scenario
        seeds = np.random.SeedSequence(scenario.seed if seed is None else seed).spawn(4)
        sea_seed, sensor_seed, fault_seed, self.chaos_seed = seeds
        self.faults = FaultBoard(scenario.faults, fault_seed)
        kind = kind_of(scenario)
        self.motors = kind.motors
        fitted = vessel.drive.bow_thruster
        proportional = fitted is not None and fitted.proportional
        self.bow = None if kind.bow is None else BowShaft(kind.bow._replace(proportional=proportional))
        plant = kind.of(vessel, scenario) if plant is None else plant
        start = scenario.start
        self.cruise_speed = vessel.model.reference_speed_m_s if start.speed_m_s is None else start.speed_m_s
        heading = math.radians(start.heading_deg)
        self.boat = Boat(
            plant,
            BoatState(
                heading=heading,
                speed=self.cruise_speed,
                north_speed=self.cruise_speed * math.cos(heading),
                east_speed=self.cruise_speed * math.sin(heading),
            ),
            kind.step,
        )
        self._sea = Sea(scenario, plant.hull, sea_seed, pace.felt_every * STEP)
        self._boat_faults = BoatFaults(self.faults, plant.gear)
        self.sensors = Sensors(vessel, scenario, sensor_seed, self.faults)
        self.helms: list[Helm] = []
        self.watchers: list[Callable[[float], None]] = []
        self._epoch = epoch
        self._steps = 0
        self._pace = pace
        self._felt = STILL
        self.sensors.sample(0.0, self.boat.state, self._sea.air)

    @property
    def time(self) -> float:
        """Simulated seconds since the start, on the grid of steps."""
        return self._steps * STEP

    def time_at(self, now: float) -> float:
        """Return the simulated time at `now` [s] of the caller's clock, which showed `epoch` at the start."""
        return now - self._epoch

    @property
    def next_step(self) -> float:
        """When the next step is complete."""
        return (self._steps + 1) * STEP

    def advance(self, now: float) -> None:
        """Move on to the last step that ends at or before `now` [s]; earlier times change nothing."""
        time = self.time_at(now)
        while self.next_step <= time + 1.0e-9:
            self._step()
            reached = self.time
            for watch in self.watchers:
                watch(reached)

    def _step(self) -> None:
        time = self.time
        state = self.boat.state
        order, thrust, bow = self._orders(time)
        order = self._boat_faults.order(time, order, state.rudder)
        thrust = self._boat_faults.thrust(time, thrust, self.cruise_speed)
        if self.motors is not None and self.motors.full and self.faults:
            order, thrust = self._boat_faults.motors(time, self.motors, order, thrust)
        if self._steps % self._pace.felt_every == 0:
            self._felt = self._sea.step(time, state)
        disturbance = self._boat_faults.pushed(time, state.heading, self._felt)
        if self.bow is not None:
            share = self.bow.step(time, self._boat_faults.bow(time, bow), STEP)
            disturbance = disturbance._replace(bow=share)
        after = self.boat.step(time, order, thrust, disturbance, STEP)
        rudder = self._boat_faults.reached(time, state.rudder, after.rudder, STEP)
        if rudder != after.rudder:
            after = self.boat.state = after._replace(rudder=rudder)
        state = after
        self._steps += 1
        if self._steps % self._pace.measured_every == 0:
            self.sensors.sample(self.time, state, self._sea.air)

    def _orders(self, time: float) -> tuple[float, float, float]:
        """The first helm that wants the rudder has it, and likewise the engine; nobody: as it was at the start."""
        rudder: float | None = None
        thrust: float | None = None
        bow = 0.0
        for helm in self.helms:
            order = helm.orders(time)
            rudder = order.rudder if rudder is None else rudder
            thrust = order.thrust_speed if thrust is None else thrust
            bow = bow or order.bow
        return 0.0 if rudder is None else rudder, self.cruise_speed if thrust is None else thrust, bow
