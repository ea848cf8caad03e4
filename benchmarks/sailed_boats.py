"""One boat of the simulator with the product's pilot at its helm, without links: what `sensitivity` sails.

The plant is the simulator's own (`sitl.registry`), so its equations are not the pilot's model; sensors, sea and faults
are the simulator's, at a coarser step.
"""

from __future__ import annotations

import dataclasses
import math
from itertools import pairwise

import sensitivity
import study_boats

import sitl.world
from autopilot.angles import wrap
from autopilot.runtime.build import build_pilot
from autopilot.signals import HeadingSample, Mode, Order, OrderKind, Sample, SpeedSample
from autopilot.vessel.file import load_vessel
from sitl.faults import Fault
from sitl.registry import KINDS, PLANTS, USUAL
from sitl.scenario import Scenario, SecondOrderSection, WavesSection, WindSection
from sitl.world import Orders, Pace, World

sitl.world.STEP = sensitivity.STEP_S
ROUGH, SLIGHT = 4.0, 1.0
"""Waves that push the boat as so many degrees of rudder do."""
WIND_M_S, GUST_M_S = 10.0, 2.0
SPEED_EVERY = 10


class OneBoat:
    """`run` sails on; `alarms` are those that were raised."""

    def __init__(self, name: str, *, rough: bool, slight: bool = False) -> None:
        known = name.split(",", maxsplit=1)[0]
        unstable = name == sensitivity.UNSTABLE
        vessel = study_boats.boats()[known].vessel if unstable else load_vessel(known)
        real = vessel
        if name == sensitivity.WEAK:
            real = dataclasses.replace(vessel, model=dataclasses.replace(vessel.model, K_1_s=0.7 * vessel.model.K_1_s))
        degrees = ROUGH if rough else SLIGHT if slight else 0.0
        # the output's deviation is sqrt(xi w0 x intensity) times sigma
        sigma = degrees / math.sqrt(0.1 * 1.0 * 0.1) if degrees else 0.0
        waves = WavesSection(second_order=SecondOrderSection(1.0, 0.1, sigma) if degrees else None)
        wind = WindSection(WIND_M_S, 60.0, GUST_M_S) if rough else WindSection()
        kind = PLANTS[known if known in PLANTS else USUAL]
        scenario = Scenario(1, "study", plant=kind.name, waves=waves, wind=wind)
        every = sensitivity.HEADING_EVERY
        self.world = World(real, scenario, 1, plant=kind.of(real, scenario), pace=Pace(every, 2))
        self.world.helms.append(self)
        self.pilot = build_pilot(vessel)
        self.alarms: dict[str, None] = {}
        self.headings: list[float] = []
        self.commands: list[float] = []
        self.is_engaged = False
        self._order, self._rudder = Order(OrderKind.HEADING, 0.0, serial=1), None
        self._steps = 0

    def orders(self, time: float) -> Orders:
        """Return what the pilot commanded last; the world asks."""
        return Orders(self._rudder)

    def order(self, heading: float) -> None:
        """Order a heading [rad]."""
        self._order = Order(OrderKind.HEADING, heading, serial=self._order.serial + 1)

    def run(self, seconds: float, until_news: bool = False) -> bool:
        """Sail on; return whether, if asked for, an alarm is new or the pilot has let go."""
        known = set(self.alarms)
        for _ in range(round(seconds / sensitivity.STEP_S)):
            now = self.world.time
            if self._steps % sensitivity.HEADING_EVERY == 0:
                self._tick(now)
                if until_news and (not self.is_engaged or not self.alarms.keys() <= known):
                    return True
            self._steps += 1
            self.world.advance(self.world.next_step)
        return False

    def _tick(self, now: float) -> None:
        samples: tuple[Sample, ...] = ()
        reading, sensors = self.world.sensors.latest(now), self.world.sensors
        if reading is not None and sensors.has_heading(now):
            samples = (HeadingSample(reading.time, wrap(reading.heading), reading.rate),)
            if self._steps // sensitivity.HEADING_EVERY % SPEED_EVERY == 0:
                samples += (SpeedSample(reading.time, reading.water_speed),)
        tick = self.pilot.step(now, samples, self._order)
        self._rudder = tick.command.angle if tick.command.engaged else None
        self.is_engaged = tick.mode is Mode.ENGAGED
        self.alarms.update(dict.fromkeys(event.name for event in tick.alarms))
        self.headings.append(self.world.boat.state.heading)
        self.commands.append(tick.command.angle)

    def figures(self, since: float) -> tuple[float, float]:
        """Return rms of the heading [deg] on the course north, and rudder travel [deg/s], from `since` [s] on."""
        pace = 1.0 / (sensitivity.STEP_S * sensitivity.HEADING_EVERY)
        headings, commands = self.headings[round(since * pace) :], self.commands[round(since * pace) :]
        square = sum(wrap(each) ** 2 for each in headings) / len(headings)
        travel = sum(abs(after - before) for before, after in pairwise(commands))
        return math.degrees(math.sqrt(square)), math.degrees(travel) * pace / len(commands)

    def past(self, heading: float, since: float) -> float:
        """Return how far [deg] the boat led past a heading [rad] that it turned to starboard for at `since` [s]."""
        begun = round(since / (sensitivity.STEP_S * sensitivity.HEADING_EVERY))
        return max(0.0, *(math.degrees(wrap(each - heading)) for each in self.headings[begun:]))


def noticed_after(boat: OneBoat, fault: str, within: float) -> float:
    """Return after how long [s] a fault is noticed that comes as the boat begins a turn, inf: not `within` [s]."""
    begun = boat.world.time
    boat.world.faults.add(Fault(fault, begun, math.inf, KINDS[fault].size, 0.0, "both"))
    boat.order(math.radians(20.0))
    return boat.world.time - begun if boat.run(within, until_news=True) else math.inf
