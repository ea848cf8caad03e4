"""How far from the truth the methods of identification end, beside the least error that any method can have.

    python benchmarks/identification_accuracy.py [--seeds 50] [--method output-error] [--boat Lanxin] [--json]

Simulated zigzags of boats that are known: 10 Hz, white noise of 0.2 deg on heading and 0.1 deg/s on yaw rate, a rudder
of 20 deg/s. The truth is integrated in steps of 5 ms. The bound is Cramer and Rao's for the same record: an error of
1.0 is at the bound. Intervals of 95 % should hold the truth in 95 of 100 cases. Times are processor time.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache, partial
from typing import NamedTuple

import numpy as np
from integral_recursion import RECURSION
from particle_gains import GalerkinGain, KernelGain, moved_by

from autopilot.cli.terminal import ProgressBar
from autopilot.errors import InputError
from autopilot.identification.filter_methods import particle_filter
from autopilot.identification.identified import Question
from autopilot.identification.interval import interval_of
from autopilot.identification.methods import Method
from autopilot.identification.registry import METHODS as REGISTERED
from autopilot.identification.registry import method_named
from autopilot.identification.runs import FloatArray, Run, run_from_columns
from autopilot.identification.trial_design import InstrumentNoise, cramer_rao, planned, zigzag_helm
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear

HEADING_NOISE, RATE_NOISE = math.radians(0.2), math.radians(0.1)
GEAR = SteeringGear(math.radians(35.0), math.radians(20.0))
SPEED, SPACING, FINE = 5.0, 0.1, 0.005
PARAMETERS = ("gain", "time_constant", "n3", "n0")
SYMBOLS = {"gain": "K", "time_constant": "T", "n3": "n3", "n0": "n0"}


class Boat(NamedTuple):
    """A boat that is known, the zigzag's rudder and execute angle [deg], and how long it lasts [s]."""

    name: str
    model: Norrbin
    angle_deg: float
    seconds: float


BOATS = (
    Boat("Lanxin", Norrbin(0.701, 0.332, 3.2828, reference_speed=SPEED), 15.0, 60.0),
    Boat("K 0.2, T 5", Norrbin(0.2, 5.0, 20.0, reference_speed=SPEED), 15.0, 180.0),
    Boat("K 0.1, T 20", Norrbin(0.1, 20.0, 50.0, reference_speed=SPEED), 15.0, 600.0),
    Boat("n1 = -1", Norrbin(0.4, 1.0, 20.0, n1=-1.0, reference_speed=SPEED), 20.0, 120.0),
)

METHODS: dict[str, Method] = {
    **{method.name: method for method in (*REGISTERED, RECURSION)},
    "fpf-galerkin": method_named("fpf")._replace(identify=partial(particle_filter, moved=moved_by(GalerkinGain()))),
    "fpf-kernel": method_named("fpf")._replace(identify=partial(particle_filter, moved=moved_by(KernelGain()))),
}
"""Every method, the particle filter with each of its gains."""


class Estimate(NamedTuple):
    """Value and standard error by parameter, None where the method tells none; what it took [s of processor time];
    and why there is nothing, where it refused to answer."""

    values: dict[str, tuple[float, float | None]]
    seconds: float
    refusal: str = ""


def estimate_by(method: str, run: Run, boat: Boat) -> Estimate:
    """Return what a method makes of a recording."""
    question, began = Question(reference_speed=SPEED, course_unstable=boat.model.n1 < 0.0), time.process_time()
    try:
        found = METHODS[method].identify([run], question)
    except InputError as refused:
        return Estimate({}, time.process_time() - began, str(refused).partition(": ")[2])
    known = [
        name for name in PARAMETERS if found.standard_errors[name] is not None or name in ("gain", "time_constant")
    ]
    values = {name: (float(getattr(found.model, name)), found.standard_errors[name]) for name in known}
    return Estimate(values, time.process_time() - began)


@cache
def clean(boat: Boat) -> dict[str, FloatArray]:
    """Return the boat's zigzag without noise, as a recording."""
    angle = math.radians(boat.angle_deg)
    fine = planned(boat.model, GEAR, zigzag_helm(angle, angle), boat.seconds, FINE, SPEED).segments[0]
    every = slice(None, None, round(SPACING / FINE))
    return {
        "time_s": fine.time[every],
        "heading_rad": fine.heading[every],
        "yaw_rate_rad_s": fine.rate[every],
        "rudder_rad": fine.rudder[every],
        "speed_m_s": fine.speed[every],
    }


def noisy(boat: Boat, seed: int) -> Run:
    """Return a recording of the zigzag by instruments with noise."""
    random, table = np.random.default_rng(seed), clean(boat)
    size = table["time_s"].size
    heading = table["heading_rad"] + HEADING_NOISE * random.normal(size=size)
    rate = table["yaw_rate_rad_s"] + RATE_NOISE * random.normal(size=size)
    return run_from_columns(boat.name, {**table, "heading_rad": heading, "yaw_rate_rad_s": rate})


def trial(boat: Boat, method: str, seed: int) -> Estimate:
    """Return what `method` makes of one recording."""
    return estimate_by(method, noisy(boat, seed), boat)


def row(boat: Boat, method: str, name: str, bound: float, estimates: Sequence[Estimate]) -> dict[str, object]:
    """Return the errors of one parameter: rms and bias over the bound, cover, and in how many trials it was
    determined."""
    values = [estimate.values[name] for estimate in estimates if name in estimate.values]
    truth = float(getattr(boat.model, name))
    errors = np.array([value - truth for value, _ in values])
    intervals = [interval_of(name, value, error) for value, error in values if error is not None]
    inside = [low <= truth <= high for low, high in intervals]
    rms = float(np.sqrt(np.mean(errors**2)))
    return {
        "boat": boat.name,
        "method": method,
        "parameter": SYMBOLS[name],
        "truth": truth,
        "bound": bound,
        "rms": rms,
        "bias_over_bound": float(np.mean(errors)) / bound,
        "rms_over_bound": rms / bound,
        "covered": float(np.mean(inside)) if inside else None,
        "determined": len(values),
        "trials": len(estimates),
        "seconds": float(np.median([estimate.seconds for estimate in estimates])),
    }


def study(
    boats: Sequence[Boat], methods: Sequence[str], seeds: int, processes: int | None = None
) -> list[dict[str, object]]:
    """Return the table."""
    rows, total, done = [], len(boats) * len(methods) * seeds, 0
    with ProcessPoolExecutor(processes) as pool, ProgressBar("identifying") as bar:
        for boat in boats:
            noise = InstrumentNoise(RATE_NOISE, HEADING_NOISE)
            bound = cramer_rao([run_from_columns(boat.name, clean(boat))], boat.model, PARAMETERS, noise)
            for method in methods:
                estimates = []
                for estimate in pool.map(partial(trial, boat, method), range(seeds)):
                    estimates.append(estimate)
                    done += 1
                    bar.update(done, total)
                named = [name for name in PARAMETERS if any(name in estimate.values for estimate in estimates)]
                rows += [row(boat, method, name, bound[name], estimates) for name in named]
                if not named:
                    rows.append({"boat": boat.name, "method": method, "refusal": estimates[0].refusal})
    return rows


def as_table(rows: Sequence[dict[str, object]]) -> str:
    """Return the table in Markdown: a line for each boat and method; of each parameter rms and bias over the bound and
    the cover of 95 % intervals, and in how many trials it was determined where that is not all."""
    lines = [f"| boat | method | {' | '.join(SYMBOLS.values())} | time [s] |", "|---|---|---|---|---|---|---|"]
    pairs = dict.fromkeys((str(r["boat"]), str(r["method"])) for r in rows)
    for boat, method in pairs:
        mine = [r for r in rows if (r["boat"], r["method"]) == (boat, method)]
        if "refusal" in mine[0]:
            lines.append(f"| {boat} | {method} | refused: {mine[0]['refusal']} | | | | |")
            continue
        cells = {str(r["parameter"]): _cell(r) for r in mine}
        row_cells = " | ".join(cells.get(symbol, "-") for symbol in SYMBOLS.values())
        lines.append(f"| {boat} | {method} | {row_cells} | {float(str(mine[0]['seconds'])):.2g} |")
    return "\n".join(lines)


def _cell(r: dict[str, object]) -> str:
    covered = "" if r["covered"] is None else f", {100.0 * float(str(r['covered'])):.0f} %"
    row_cells = "" if r["determined"] == r["trials"] else f" ({r['determined']} of {r['trials']})"
    return f"{r['rms_over_bound']:.2f}, {r['bias_over_bound']:+.2f}{covered}{row_cells}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--method", action="append", choices=list(METHODS), help="one of them; default: all")
    parser.add_argument("--boat", action="append", choices=[boat.name for boat in BOATS], help="default: all")
    parser.add_argument("--processes", type=int, help="default: one to a core")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    boats = [boat for boat in BOATS if not options.boat or boat.name in options.boat]
    rows = study(boats, options.method or list(METHODS), options.seeds, options.processes)
    sys.stdout.write((json.dumps(rows, indent=2) if options.json else as_table(rows)) + "\n")


if __name__ == "__main__":
    main()
