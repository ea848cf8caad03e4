"""Turns and courses behind a line that is slower than its file says, with its delay measured and without; a table.

    python benchmarks/path_delay.py [--boats lanxin,outboard] [--delays 0,0.1,0.4] [--seas calm,sea-state-5] [--seeds 3]

The whole pilot in lockstep with the simulated flight controller over a line in memory, 20 Hz, each datagram so many
seconds later there and back, of which the file knows nothing. The boat is engaged on north and turns by 30 deg, in
which the line shows itself, back by 20, on by 60, and holds its course. Overshoot is how far beyond its order the boat
goes in the second and third turn, the first turn's stands by itself; rms, of the true heading error, and travel are
those of 60 s of the course held after them. Seeds are the date's unless `--first-seed` says others.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import datetime
import math
import sys
from pathlib import Path
from typing import NamedTuple
from unittest import mock

import numpy as np
from study_boats import boats as study_boats

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from lockstep import Lockstep, SlowLine

from autopilot.angles import wrap
from autopilot.estimation.path_delay import NOT_ECHOED
from autopilot.signals import Mode
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel
from sitl.scenario import HullSection, Scenario, load_scenario
from sitl.serve import afloat

BOATS = ("lanxin", "outboard", "small_craft", "blueboat", "coaster")
STEP = "autopilot.estimation.estimator.path_step"
BEFORE_S, HELD_S = 10.0, 60.0
TURNS_DEG = (30.0, 10.0, 70.0)
STUDIED = "coaster"
"""A boat of the steering studies, which has no file of its own."""


class Sailed(NamedTuple):
    """overshoot of the first turn and the most of the others, rms on the course after them [deg], travel [deg/s], the
    delay measured [s], and whether the boat was steered to the end."""

    first_deg: float
    later_deg: float
    rms_deg: float
    travel_deg_s: float
    delay: float
    is_steered: bool


def afloat_as(name: str, sea: str, seed: int) -> tuple[Vessel, Scenario]:
    """Return the boat's vessel file, and what it sails in."""
    scenario = dataclasses.replace(load_scenario(sea), seed=seed)
    if name != STUDIED:
        vessel = load_vessel(name)
        return vessel, afloat(name, scenario, vessel.drive.kind)
    vessel, hull = study_boats()[name]
    units = {field.name: field.name for field in dataclasses.fields(HullSection)}
    known = hull._asdict()
    section = HullSection(**{key: known[_without_unit(key, known)] for key in units})
    return vessel, dataclasses.replace(scenario, hull=section)


def _without_unit(key: str, known: dict[str, float]) -> str:
    return key if key in known else key.rpartition("_")[0]


def sailed(name: str, sea: str, delay: float, seed: int, *, is_measured: bool) -> Sailed:
    """Return how the boat turns and holds its course."""
    vessel, scenario = afloat_as(name, sea, seed)
    boat = Lockstep(vessel, lines=(SlowLine(delay), SlowLine(delay)), scenario=scenario)
    leg = max(12.0, 4.0 * vessel.model.T_s)
    headings: list[float] = []
    boat.hooks.append(lambda boat: headings.append(boat.world.boat.state.heading))
    with contextlib.nullcontext() if is_measured else mock.patch(STEP, lambda *_: NOT_ECHOED):
        boat.engage(0.0)
        boat.run(BEFORE_S)
        before, over = 0.0, []
        for turn in TURNS_DEG:
            headings.clear()
            boat.engage(turn)
            boat.run(leg)
            off = np.degrees([wrap(heading - math.radians(turn)) for heading in headings])
            over.append(max(0.0, float(np.max(math.copysign(1.0, turn - before) * off))))
            before = turn
        headings.clear()
        first = len(boat.ticks)
        boat.run(HELD_S)
    boat.session.close()
    off = np.degrees([wrap(heading - math.radians(before)) for heading in headings])
    orders = np.degrees([tick.command.angle for tick in list(boat.ticks)[first:]])
    return Sailed(
        over[0],
        max(over[1:]),
        float(np.sqrt(np.mean(off**2))),
        float(np.sum(np.abs(np.diff(orders)))) / HELD_S,
        boat.pilot.state.estimate.path.delay,
        boat.tick.mode is Mode.ENGAGED,
    )


def main() -> None:
    """Print the table asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--boats", default=",".join(BOATS))
    parser.add_argument("--delays", default="0,0.1,0.4", help="each way [s]")
    parser.add_argument("--seas", default="calm,sea-state-5")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=datetime.date.today().toordinal() * 1000)
    asked = parser.parse_args()
    seeds = range(asked.first_seed, asked.first_seed + asked.seeds)
    print(
        "| boat | sea | each way [s] | measured [s] | first turn past [deg] | later turns past [deg], worst "
        "| rms [deg] | travel [deg/s] | lost |\n|---|---|---|---|---|---|---|---|---|"
    )
    for name in asked.boats.split(","):
        for sea in asked.seas.split(","):
            for delay in map(float, asked.delays.split(",")):
                by = [
                    [sailed(name, sea, delay, seed, is_measured=is_measured) for seed in seeds]
                    for is_measured in (False, True)
                ]
                columns = [[[run[column] for run in runs] for column in range(len(Sailed._fields))] for runs in by]
                cells = [" → ".join(f"{np.median(c[k]):.1f}" for c in columns) for k in (0, 1, 2, 3)]
                worst = " → ".join(f"{max(c[1]):.1f}" for c in columns)
                lost = " → ".join(str(sum(not each for each in c[5])) for c in columns)
                print(
                    f"| {name} | {sea} | {delay:g} | {np.median(columns[1][4]):.2f} | {cells[0]} | {cells[1]}, {worst} "
                    f"| {cells[2]} | {cells[3]} | {lost} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
