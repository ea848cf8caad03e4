"""Roll damping through the whole loop: pilot, MAVLink link and the simulated ship that rolls, in lockstep.

    python benchmarks/roll_in_the_loop.py [--seeds 3] [--json]      the tables in benchmarks/results/liu2017.md
    python benchmarks/roll_in_the_loop.py --case rate-0.25          one row of them

The ship (`sitl/roll_ship.py`) surges, sways, rolls and yaws, so that the rudder's drag costs speed at constant thrust.
Each seed is one sea, sailed four times: with the rudder amidships, where the sea turns the ship out of the direction
asked about; on the course with a rudder of a tenth of a degree; under the quiet heading law (no roll reaches the
pilot); and with the roll law. Loss of speed is that of the mean through the water against the quiet law. Cases change
the ship, never the vessel file: rudder rate, metacentric height, age of heading, rate and roll.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from typing import NamedTuple

import numpy as np

import sitl.roll_ship
from autopilot.links.mavlink.companion import CompanionLink
from autopilot.links.mavlink.vehicle import CompanionSettings
from autopilot.links.transports import loopback_pair
from autopilot.runtime.app import App, Plan
from autopilot.signals import Order, OrderKind, RollSample
from autopilot.vessel.file import load_vessel
from sitl.firmware import Firmware
from sitl.roll_ship import NAVAL_HULL, SERVICE_SPEED
from sitl.scenario import GearSection, IttcSection, Scenario, WavesSection, load_scenario
from sitl.wire_mavlink import MavlinkVehicle
from sitl.world import Orders, Pace, World

STEP = 0.025
SETTLED_S = 200.0
"""What is measured begins here: the schedule has decided."""
LASTS_S = 600.0
FRESH = 20261127
"""Seeds count from the date; none was used for tuning."""
PEAK_OF_MEAN = 1.2957
"""Peak period over mean period T1 of the ITTC two-parameter spectrum."""
FILED_RATE_DEG_S = 20.0
COURSE_KEPT = 0.05
"""Rudder per heading error [-] that keeps the course in minutes and leaves the roll as it is."""


class Case(NamedTuple):
    """Sea from `beta` [deg] (180: ahead) and `height` [m], mean `period` [s]; the ship's rudder rate and metacentric
    height in units of the file's, age of heading and roll [s]; whether the rudder's angle is measured."""

    name: str
    beta: float = 135.0
    height: float = 4.0
    period: float = 7.0
    rate: float = 1.0
    stability: float = 1.0
    delay: float = 0.0
    feedback: bool = True


STEERS = ("fixed", "course", "quiet", "roll")
CASES = (
    Case("as filed"),
    Case("2.5 m", height=2.5),
    Case("beta-90", beta=90.0, height=2.5),
    Case("beta-45", beta=45.0),
    Case("beta-30", beta=30.0),
    Case("beta-60", beta=60.0),
    Case("rate-0.25", rate=0.25),
    Case("rate-0.5", rate=0.5),
    Case("rate-2", rate=2.0),
    Case("rate-0.25 no sensor", rate=0.25, feedback=False),
    Case("rate-0.5 no sensor", rate=0.5, feedback=False),
    Case("gm-0.7", stability=0.7),
    Case("gm-1.4", stability=1.4),
    Case("delay-0.4", delay=0.4),
    Case("rate-0.25 gm-0.7 delay-0.4", rate=0.25, stability=0.7, delay=0.4),
    Case("rate-0.25 gm-1.4 delay-0.4", rate=0.25, stability=1.4, delay=0.4),
    Case("rate-2 gm-0.7 delay-0.4", rate=2.0, stability=0.7, delay=0.4),
    Case("rate-2 gm-1.4 delay-0.4", rate=2.0, stability=1.4, delay=0.4),
    Case("beta-45 rate-0.25 delay-0.4", beta=45.0, rate=0.25, delay=0.4),
)


class Sailed(NamedTuple):
    """Standard deviation of roll [deg], rms of heading [deg], mean speed [m/s], rudder travel [deg/s], share of the
    time in which the roll law had the rudder."""

    roll: float
    heading: float
    speed: float
    travel: float
    weight: float


class SlowHelm(NamedTuple):
    """Keeps the ship on its course with a rudder that is all but amidships."""

    world: World

    def orders(self, time: float) -> Orders:
        """Return the rudder against the heading that has come off."""
        return Orders(rudder=-COURSE_KEPT * math.remainder(self.world.boat.state.heading, 2.0 * math.pi))


class _Clock:
    time = 0.0

    def now(self) -> float:
        return self.time

    def wait(self, descriptors: object, until: float) -> None:
        """Never called in lockstep."""


def without_roll(link: CompanionLink) -> CompanionLink:
    """Return the link without the roll that it brings: the same ship, steered by the quiet heading law."""
    receive = link.receive
    link.receive = lambda now: [each for each in receive(now) if not isinstance(each, RollSample)]  # type: ignore[method-assign]
    return link


def scenario_of(case: Case) -> Scenario:
    """Return sea, instruments and gear of a case."""
    waves = WavesSection(
        ittc=IttcSection(case.height, PEAK_OF_MEAN * case.period, from_deg=(180.0 + case.beta) % 360.0)
    )
    calm = load_scenario("calm")
    sensors = dataclasses.replace(calm.sensors, latency_s=case.delay)
    return dataclasses.replace(
        calm, plant="roll_ship", waves=waves, sensors=sensors, gear=GearSection(rate_deg_s=FILED_RATE_DEG_S * case.rate)
    )


def sail(case: Case, seed: int, steers: str, lasts: float = LASTS_S) -> Sailed:
    """Sail one sea: `steers` is fixed (rudder amidships), course, quiet or roll."""
    vessel, scenario = load_vessel("naval_vessel"), scenario_of(case)
    world = World(vessel, scenario, seed, pace=Pace(2, 2))
    if steers == "course":
        world.helms.append(SlowHelm(world))
    firmware = Firmware(world)
    if not case.feedback:
        firmware.parameters.set("SERVO1_FUNCTION", 26.0)
    vehicle = MavlinkVehicle(firmware)
    near, far = loopback_pair()
    full = math.radians(vessel.rudder.angle_max_deg)
    link = CompanionLink(near, CompanionSettings(full, as_gcs=True, angle_max=full))
    clock = _Clock()
    order = (
        Order(OrderKind.HEADING, 0.0, serial=1) if steers in ("quiet", "roll") else Order(OrderKind.RUDDER, serial=1)
    )
    plan = Plan(vessel, lambda _, __: order, links=(link if steers == "roll" else without_roll(link),))
    app = App(plan, clock)
    states, travel, weights, before = [], 0.0, [], 0.0
    for number in range(1, round(lasts / STEP) + 1):
        clock.time = now = round(number * STEP, 9)
        for data in far.receive():
            vehicle.receive(now, data)
        vehicle.advance(now)
        for data in vehicle.transmit(now):
            far.send(data)
        app.session.poll(now)
        state = world.boat.state
        if now > SETTLED_S:
            travel += abs(state.rudder - before)
            states.append((state.roll, math.remainder(state.heading, 2.0 * math.pi), state.speed))
            law = app.pilot.state.control.law
            weights.append(law.schedule.weight if hasattr(law, "schedule") else 0.0)
        before = state.rudder
    roll, heading, speed = np.array(states).T
    return Sailed(
        math.degrees(float(np.std(roll))),
        math.degrees(float(np.sqrt(np.mean(heading**2)))),
        float(np.mean(speed)),
        math.degrees(travel) / (lasts - SETTLED_S),
        float(np.mean(weights)),
    )


def row_of(case: Case, seeds: range) -> dict[str, object]:
    """Return the figures of a case, mean and worst over the seeds."""
    normal = sitl.roll_ship.NAVAL_HULL
    roll = NAVAL_HULL.roll._replace(restoring=NAVAL_HULL.roll.restoring * case.stability)
    sitl.roll_ship.NAVAL_HULL = NAVAL_HULL._replace(roll=roll)
    try:
        runs = [[sail(case, seed, steers) for steers in STEERS] for seed in seeds]
    finally:
        sitl.roll_ship.NAVAL_HULL = normal
    fixed, course, quiet, damped = (np.array([run[place] for run in runs]) for place in range(4))
    against = [1.0 - damped[:, 0] / other[:, 0] for other in (fixed, course, quiet)]
    loss = 1.0 - damped[:, 2] / quiet[:, 2]
    return {
        "case": case.name,
        "roll_deg": [round(float(np.mean(each[:, 0])), 2) for each in (fixed, course, quiet, damped)],
        "less_than_fixed": round(float(np.mean(against[0])), 3),
        "less_than_on_course": round(float(np.mean(against[1])), 3),
        "less_than_quiet": round(float(np.mean(against[2])), 3),
        "worst": [round(float(np.min(each)), 3) for each in against],
        "speed_loss": round(float(np.mean(loss)), 4),
        "speed_loss_fixed": round(float(np.mean(1.0 - damped[:, 2] / fixed[:, 2])), 4),
        "heading_deg": [round(float(np.mean(each[:, 1])), 2) for each in (fixed, course, quiet, damped)],
        "travel_deg_s": [round(float(np.mean(each[:, 3])), 2) for each in (quiet, damped)],
        "weight": round(float(np.mean(damped[:, 4])), 2),
        "service": SERVICE_SPEED,
    }


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first", type=int, default=FRESH)
    parser.add_argument("--case", action="append", choices=[case.name for case in CASES])
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    for case in CASES:
        if not given.case or case.name in given.case:
            print(json.dumps(row_of(case, range(given.first, given.first + given.seeds))), flush=True)


if __name__ == "__main__":
    main()
