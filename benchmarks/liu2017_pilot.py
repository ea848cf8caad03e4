"""The sliding mode law for heading and roll in the running pilot, on the ship and in the seas of `liu2017_roll.py`.

    python benchmarks/liu2017_pilot.py [--json] [--seeds 5]      the pilot's table in benchmarks/results/liu2017.md
    python benchmarks/liu2017_pilot.py --variants                what else was tried, and a heel that sets in at once
    python benchmarks/liu2017_pilot.py --vessel                  the numbers of the vessel file `naval_vessel`, from it

`Pilot.step` is called at 20 Hz with what the instruments show, noise on all of it, and nothing else: heading with yaw
rate, roll with roll rate, and once a second the speed. So estimator, wave filter, planning and limits are in the loop.
"""

from __future__ import annotations

import argparse
import json
import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from liu2017_roll import (
    DT,
    FIXED,
    FRESH,
    KEEP,
    QUIET,
    SECONDS,
    SETTLED_S,
    TITLES,
    Array,
    Result,
    Row,
    beside,
    noise_of,
    realisation,
    result_of,
    run,
    sea_from,
    text_of,
)
from naval_vessel import Sea, inverse_mass, linear_motion, motion_step

from autopilot.angles import wrap
from autopilot.control.law import LawInForce, LawInput
from autopilot.control.rudder_roll import Motion
from autopilot.control.sliding_roll import RollMemory, RollNumbers, place_of
from autopilot.control.sliding_roll import steered as steered_by
from autopilot.identification.identify import identify
from autopilot.identification.runs import Run, Segment
from autopilot.models.norrbin import rudder_for
from autopilot.models.steering_gear import gear_step
from autopilot.pilot import Pilot
from autopilot.runtime.build import build_pilot, gear_of
from autopilot.signals import HeadingSample, Order, OrderKind, RollSample, SpeedSample
from autopilot.steering import CornerFrequencies
from autopilot.vessel.file import load_vessel
from sitl.roll_ship import NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED, Load, drag_coefficient, rudder_load

VESSEL = load_vessel("naval_vessel")
GEAR = gear_of(VESSEL)
INVERSE = inverse_mass(NAVAL_HULL)
AHEAD = Order(OrderKind.HEADING, 0.0, serial=1)
REST = Motion(0.0, 0.0, 0.0, 0.0, 0.0)
ZIGZAGS_DEG = (10.0, 20.0)
ZIGZAG_S = 300.0


WAVES_LEFT = 0.05
"""Waves quicker than this [rad/s], all of them, are kept from the law where it is to leave waves alone."""
HEEL, HEEL_FROM_S = math.radians(5.0), 300.0


class Steered(NamedTuple):
    """A row: its name, the law, whether roll is on the link, and what of the pilot is otherwise."""

    name: str
    law: str
    hears_roll: bool
    variant: str = ""


ROWS = (
    Steered("pilot, sliding", "sliding", True),
    Steered("pilot, sliding_roll, no roll sensor", "sliding_roll", False),
    Steered("pilot, sliding_roll", "sliding_roll", True),
)
VARIANTS = (
    ROWS[-1],
    Steered("sway of the model by the rudder", "sliding_roll", True, "own sway"),
    Steered("sway observed by p, r and phi too", "sliding_roll", True, "observed sway"),
    Steered("waves left alone", "sliding_roll", True, "waves left alone"),
)
SEAS = ((135.0, 4.0), (45.0, 4.0))


def own_sway(numbers: RollNumbers, memory: RollMemory, given: LawInput) -> tuple[float, RollMemory]:
    """Steer with sway as the linear model makes it of the rudder."""
    return steered_by(numbers, memory, given, memory.schedule.own.v)


class ObservedSway:
    """Steers with sway as the linear model makes it of rudder, roll, roll rate and yaw rate."""

    def __init__(self) -> None:
        self.sway = 0.0

    def __call__(self, numbers: RollNumbers, memory: RollMemory, given: LawInput) -> tuple[float, RollMemory]:
        state, reference, at = given.state, given.reference, numbers.speeds[place_of(given.ratio)]
        demand, after = steered_by(numbers, memory, given, self.sway)
        dt = memory.owed + given.dt - after.owed
        if after.schedule.time > memory.schedule.time:
            rate, heel = state.rate - reference.rate, given.roll.angle - at.roll_per_rate * reference.rate - after.list
            rudder = state.rudder + state.bias - rudder_for(given.model, reference.rate, reference.acceleration)
            off = np.array([self.sway, given.roll.rate, rate, heel])
            self.sway += dt * float(at.model.A[0, :4] @ off + at.model.b[0] * rudder)
        return demand, after


def pilot_of(case: Steered) -> Pilot:
    """Return the pilot of a row."""
    pilot = build_pilot(VESSEL, case.law)
    steps = {"own sway": own_sway, "observed sway": ObservedSway()}
    if case.variant in steps:
        kind, gains = pilot.law
        return Pilot(pilot.config, LawInForce(kind._replace(step=steps[case.variant]), gains))
    if case.variant == "waves left alone":
        return Pilot(pilot.config._replace(corner_frequencies=CornerFrequencies(WAVES_LEFT)), pilot.law)
    return pilot


def moved(state: Motion, rudder: float, push: list[float]) -> Motion:
    """Return the ship one step later."""
    own = rudder_load(NAVAL_RUDDERS, SERVICE_SPEED, rudder)
    outside = Load(own.Y + push[0], own.K + push[1], own.N + push[2])
    return motion_step(NAVAL_HULL, INVERSE, SERVICE_SPEED, state, outside, DT)


def sail(pilot: Pilot, load: Array, noise: Array, hears_roll: bool) -> Array:
    """Return the rows that `liu2017_roll.sail` returns, the pilot steering."""
    state, rudder, travel, rows = REST, 0.0, 0.0, []
    for i, (push, n) in enumerate(zip(load.tolist(), noise.tolist(), strict=True)):
        now = i * DT
        heard: list[HeadingSample | RollSample | SpeedSample]
        heard = [HeadingSample(now, wrap(state.psi + n[4]), state.r + n[2])]
        if hears_roll:
            heard.append(RollSample(now, state.phi + n[3], state.p + n[1]))
        if i % round(1.0 / DT) == 0:
            heard.append(SpeedSample(now, SERVICE_SPEED))
        command = pilot.step(now, tuple(heard), AHEAD).command
        before, rudder = rudder, gear_step(GEAR, rudder, command.angle, DT)
        travel += abs(rudder - before)
        state = moved(state, rudder, push)
        if (i + 1) % KEEP == 0:
            weight = pilot.state.control.law.schedule.weight if isinstance(pilot.state.control.law, RollMemory) else 0.0
            rows.append((*state, rudder, travel, weight, drag_coefficient(NAVAL_RUDDERS, rudder)))
    return np.array(rows)


@lru_cache(maxsize=256)
def steered(case: Steered, sea: Sea, seed: int) -> Result:
    """Return what one run of the pilot shows."""
    load, water = realisation(sea, seed)
    out = sail(pilot_of(case), load, noise_of(True, seed, len(load)), case.hears_roll)
    return result_of(out[round(SETTLED_S / DT / KEEP) :], sea, water)


def worst_of_heel(sea: Sea, seed: int) -> float:
    """Return how far [deg] the pilot is carried off where a heel of HEEL sets in at once."""
    load, _ = realisation(sea, seed)
    begin = round(HEEL_FROM_S / DT)
    heeled = load[: 2 * begin].copy()
    heeled[begin:, 1] += NAVAL_HULL.roll.restoring * HEEL
    out = sail(pilot_of(ROWS[-1]), heeled, noise_of(True, seed, len(heeled)), hears_roll=True)
    return math.degrees(float(np.max(np.abs(out[begin // KEEP :, 4]))))


def rows_at(degrees: float, height: float, seeds: range, cases: tuple[Steered, ...] = ROWS) -> list[Row]:
    """Return the rows of a sea: fixed rudder, the quiet autopilot that knows the state, then the pilot."""
    sea = sea_from(degrees, height)
    fixed, quiet = ([run(case, sea, seed) for seed in seeds] for case in (FIXED, QUIET))
    found = [(FIXED.name, fixed), (QUIET.name, quiet)]
    found += [(case.name, [steered(case, sea, seed) for seed in seeds]) for case in cases]
    return [
        Row(name, Result(*(float(value) for value in np.mean(each, axis=0))), beside(each, fixed), beside(each, quiet))
        for name, each in found
    ]


def zigzag(degrees: float) -> Run:
    """Return a zigzag of the nonlinear ship in calm water, without noise, as a recording at 5 Hz."""
    state, rudder, goal, rows = REST, 0.0, math.radians(degrees), []
    for i in range(round(ZIGZAG_S / DT)):
        if abs(state.psi) > abs(goal) and state.psi * goal > 0.0:
            goal = -goal
        rudder = gear_step(GEAR, rudder, goal if i * DT > 10.0 else 0.0, DT)
        state = moved(state, rudder, [0.0, 0.0, 0.0])
        if (i + 1) % KEEP == 0:
            rows.append(((i + 1) * DT, state.psi, state.r, rudder, SERVICE_SPEED))
    return Run(f"zigzag {degrees:.0f}/{degrees:.0f}", (Segment(*np.array(rows).T),))


def vessel_numbers() -> str:
    """Return what stands in the vessel file: the linear model's rows, and the model identified from two zigzags."""
    model = linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
    names = ("sway_row", "roll_row", "yaw_row")
    lines = [
        f"{name}: [{', '.join(f'{value:.6g}' for value in (*model.A[row, :4], model.b[row]))}]"
        for row, name in enumerate(names)
    ]
    found = identify([zigzag(degrees) for degrees in ZIGZAGS_DEG]).model
    lines.append(f"K_1_s: {found.gain:.3g}  T_s: {found.time_constant:.3g}  n3_s2_rad2: {found.n3:.3g}")
    return "\n".join(lines)


def main() -> None:
    """Print the table, or the vessel's numbers."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--vessel", action="store_true", help="print the numbers of the vessel file")
    parser.add_argument("--variants", action="store_true", help="sail what else was tried")
    parser.add_argument("--seeds", type=int, default=5, help="fresh seeds of each row (default 5)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    seeds = range(FRESH, FRESH + arguments.seeds)
    cases = VARIANTS if arguments.variants else ROWS
    if arguments.vessel:
        print(vessel_numbers())
        return
    if arguments.json:
        tables = {f"{angle:.0f} deg, {height} m": rows_at(angle, height, seeds, cases) for angle, height in SEAS}
        print(json.dumps({sea: [row._asdict() for row in rows] for sea, rows in tables.items()}, indent=2))
        return
    for angle, height in SEAS:
        print(f"Waves of {height} m at {angle:.0f} deg (180 is head seas), {len(seeds)} seeds, {SECONDS:.0f} s each")
        print("\n".join(TITLES), flush=True)
        for row in rows_at(angle, height, seeds, cases):
            print(text_of(row), flush=True)
        print()
    if arguments.variants:
        print(f"A heel of 5 deg at once, 4 m at 135 deg: {worst_of_heel(sea_from(*SEAS[0]), FRESH):.0f} deg off")


if __name__ == "__main__":
    main()
