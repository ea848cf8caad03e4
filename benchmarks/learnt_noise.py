"""What gains designed for the noise that the instruments turn out to have would be worth; a table.

    python benchmarks/learnt_noise.py [--boats lanxin,outboard] [--times 3] [--seeds 3]

Compass and gyro are so many times as noisy as the file says, which the filter learns while it steers. The boat is
sailed on a course, in lockstep with the simulated flight controller, with gains that `gains` designs for the file's
noise, and with those that it designs for the noise there is. Seeds are the date's unless `--first-seed` says others.
"""

from __future__ import annotations

import argparse
import dataclasses
import datetime
import math
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from path_delay import afloat_as

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from lockstep import Lockstep

from autopilot.angles import wrap
from autopilot.runtime.tuning import designed
from autopilot.vessel.schema import Vessel
from sitl.scenario import Scenario

BEFORE_S, HELD_S = 60.0, 120.0


class Held(NamedTuple):
    """rms of the true heading error on the course [deg], and travel [deg/s]."""

    rms_deg: float
    travel_deg_s: float


def noisier(vessel: Vessel, times: float) -> Vessel:
    """Return the vessel with so much noisier instruments."""
    sensors = vessel.sensors
    heading, rate = times * sensors.heading_noise_deg, times * sensors.rate_noise_deg_s
    return dataclasses.replace(
        vessel, sensors=dataclasses.replace(sensors, heading_noise_deg=heading, rate_noise_deg_s=rate)
    )


def held(vessel: Vessel, scenario: Scenario) -> Held:
    """Return how the boat holds north, a minute after it was engaged on it."""
    boat = Lockstep(vessel, scenario=scenario)
    headings: list[float] = []
    boat.hooks.append(lambda boat: headings.append(wrap(boat.world.boat.state.heading)))
    boat.engage(0.0)
    boat.run(BEFORE_S)
    headings.clear()
    first = len(boat.ticks)
    boat.run(HELD_S)
    boat.session.close()
    orders = np.array([tick.command.angle for tick in list(boat.ticks)[first:]])
    travel = float(np.sum(np.abs(np.diff(orders)))) / HELD_S
    return Held(math.degrees(float(np.sqrt(np.mean(np.square(headings))))), math.degrees(travel))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--boats", default="lanxin,outboard")
    parser.add_argument("--seas", default="calm,sea-state-5")
    parser.add_argument("--times", type=float, default=3.0)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=datetime.date.today().toordinal() * 1000 + 500)
    asked = parser.parse_args()
    print("| boat | sea | rms, gains of the file's noise → of the real [deg] | travel [deg/s] |\n|---|---|---|---|")
    for name in asked.boats.split(","):
        for sea in asked.seas.split(","):
            pairs = []
            for seed in range(asked.first_seed, asked.first_seed + asked.seeds):
                filed, scenario = afloat_as(name, sea, seed)
                real = noisier(filed, asked.times).sensors
                sensors = dataclasses.replace(
                    scenario.sensors, heading_noise_deg=real.heading_noise_deg, rate_noise_deg_s=real.rate_noise_deg_s
                )
                scenario = dataclasses.replace(scenario, sensors=sensors)
                better = designed(noisier(filed, asked.times))
                pairs.append(
                    [
                        held(designed(filed), scenario),
                        held(dataclasses.replace(better, sensors=filed.sensors), scenario),
                    ]
                )
            rms, travel = np.median(np.array(pairs), axis=0).T
            print(f"| {name} | {sea} | {rms[0]:.2f} → {rms[1]:.2f} | {travel[0]:.2f} → {travel[1]:.2f} |", flush=True)


if __name__ == "__main__":
    main()
