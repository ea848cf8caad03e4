"""How often the 95 % intervals of `autopilot identify` hold the truth, on boats of an independent simulator.

    python benchmarks/identification_intervals.py [--seeds 100] [--first-seed 0 | --today] [--plant NAME] [--sea NAME]
                                                  [--fit-rudder delay] [--orders HZ]

A pair of 20/20 zigzags to either side, 10 Hz (`independent_boat.py`, which imports nothing of the project). For each
plant and sea: in how many of 100 the interval holds the truth, median error and scatter [% of the truth; n0 and e in
% of K and a times a degree of rudder], and in how many there was an answer. K and T count where they are determined: of
so many, where that is not in all. --today draws seeds from the date. --orders: the rudder is a quick servo's, known by
its orders alone, of which so many a second are reported.
"""

from __future__ import annotations

import argparse
import datetime
import math
import time
from collections.abc import Sequence

import numpy as np
from independent_boat import FINE_S, SPEED_M_S, FloatArray, Plant, Sea, zigzags

from autopilot.errors import InputError
from autopilot.identification.identified import Identified, Question
from autopilot.identification.identify import identify
from autopilot.identification.interval import interval_of
from autopilot.identification.runs import Run, run_from_columns
from autopilot.logs.series import HEADING, RATE, SHARE, SPEED, Recording, Series
from autopilot.logs.table import RudderSettings, table_of
from autopilot.models.steering_gear import SteeringGear
from autopilot.report.identification import undetermined

PLANTS = (
    Plant("K 0.43, T 3.5", 0.43 / 3.5, 1.0 / 3.5, 6.0 / 3.5, 0.0015, 15.0, 60.0),
    Plant("Lanxin", 0.701 / 0.332, 1.0 / 0.332, 3.2828 / 0.332, 0.01 / 0.332, 20.0, 40.0),
    Plant("K 0.1, T 20", 0.1 / 20.0, 1.0 / 20.0, 120.0 / 20.0, 0.0001, 5.0, 400.0),
    Plant("unstable", 0.2, -0.5, 10.0, 0.003, 15.0, 60.0),
    Plant("neutral", 0.2, 0.02, 6.0, 0.002, 15.0, 60.0),
)
SEAS = (
    Sea("calm"),
    Sea("noisy rudder and log", rudder_deg=0.2, speed_share=0.015),
    Sea("gusts and waves", gust_deg=1.0, wave_deg=1.0),
    Sea("gusts, waves, noise", gust_deg=1.0, wave_deg=1.0, rudder_deg=0.2, speed_share=0.015),
    Sea("gusts, noise, gyro", gust_deg=1.0, rudder_deg=0.3, speed_share=0.02, gyro_deg_s=0.1),
)
NAMES = {"K": "gain", "T": "time_constant", "n3": "n3", "n0": "n0"}
FREE, RATIOS = tuple(NAMES), ("a", "b", "d", "e")


def truth_of(plant: Plant) -> dict[str, float]:
    """Return the plant's parameters in both conventions."""
    T = 1.0 / abs(plant.b)
    norrbin = {"K": plant.a * T, "T": T, "n3": plant.d * T, "n0": plant.e * T}
    return {**norrbin, "a": plant.a, "b": plant.b, "d": plant.d, "e": plant.e}


def estimates_of(found: Identified) -> dict[str, tuple[float, float | None]]:
    """Return value and standard error of what was determined."""
    result = {
        symbol: (float(getattr(found.model, name)), found.standard_errors[name])
        for symbol, name in NAMES.items()
        if symbol not in undetermined(found)
    }
    if found.ratios is not None:
        values, errors = found.ratios
        result |= {name: (values[i], errors[i]) for i, name in enumerate(RATIOS)}
    return result


def reported(table: dict[str, FloatArray], hz: float, seed: int, gear: SteeringGear | None = None) -> Run:
    """Return the run of a log that has the servo's orders, so many of them a second, in place of the rudder; gear: that
    of the boat's file."""
    at = np.arange(np.random.default_rng([seed, 99]).uniform(0.0, 1.0 / hz), table["time_s"][-1], 1.0 / hz)
    shares = Series(SHARE, "servo", at, table["order_rad"][(at / FINE_S).astype(int)] / FULL_RAD)
    series = [Series(name, "log", table["time_s"], table[name]) for name in (HEADING, RATE, SPEED) if name in table]
    recording = Recording("log", "zigzag", (*series, shares))
    log = table_of(recording, RudderSettings(at_full=FULL_RAD, gear=gear), between_motions=True)
    return run_from_columns("log", log.columns)._replace(rudder=log.rudder)


FULL_RAD, SERVO_DEG_S = math.radians(30.0), 300.0
"""Rudder at full steering, and the rate of the servo behind it."""


def row(plant: Plant, sea: Sea, seeds: Sequence[int], train: tuple[str, ...], hz: float = 0.0) -> str:
    """Return the line of one plant and sea; hz: how many orders a second are reported, 0: the rudder is measured."""
    boat = plant._replace(rudder_rate_deg_s=SERVO_DEG_S) if hz > 0.0 else plant
    starboard, port = (zigzags(boat, sea, list(seeds), side, with_orders=hz > 0.0) for side in (1, -1))
    truth, answers, refused, began = truth_of(plant), [], 0, time.process_time()
    for seed, *tables in zip(seeds, starboard, port, strict=True):
        if hz > 0.0:
            runs = [
                reported(table, hz, 2 * seed + side)._replace(source="sp"[side]) for side, table in enumerate(tables)
            ]
        else:
            runs = [run_from_columns(f"{side}.csv", table) for side, table in zip(("s", "p"), tables, strict=True)]
        try:
            answers.append(estimates_of(identify(runs, Question(reference_speed=SPEED_M_S, rudder_train=train))))
        except InputError:
            refused += 1
    took = (time.process_time() - began) / len(seeds)
    found = {name: [answer[name] for answer in answers if name in answer] for name in (*FREE, *RATIOS)}
    cells = [_cell(name, truth, each, len(answers)) for name, each in found.items()]
    return f"| {plant.name} | {sea.name} | {' | '.join(cells)} | {len(answers)} of {len(seeds)} | {took:.2f} |"


def _cell(name: str, truth: dict[str, float], found: Sequence[tuple[float, float | None]], answered: int) -> str:
    if not found:
        return "-"
    lever = {"n0": "K", "e": "a"}.get(name)
    size = truth[lever] * math.radians(1.0) if lever else abs(truth[name])
    intervals = [interval_of(NAMES.get(name, name), value, 0.0 if std is None else std) for value, std in found]
    inside = [low <= truth[name] <= high for low, high in intervals]
    errors = 100.0 * (np.array([value for value, _ in found]) - truth[name]) / size
    low, middle, high = np.quantile(errors, (0.16, 0.5, 0.84))
    of = f" of {len(found)}" if len(found) < answered else ""
    return f"{100.0 * float(np.mean(inside)):.0f}{of} ({middle:+.1f}, {0.5 * (high - low):.1f})"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--today", action="store_true", help="seeds drawn from today's date")
    parser.add_argument("--plant", action="append", choices=[plant.name for plant in PLANTS], help="default: all")
    parser.add_argument("--sea", action="append", choices=[sea.name for sea in SEAS], help="default: all")
    parser.add_argument("--fit-rudder", default="", metavar="LIST")
    parser.add_argument("--orders", type=float, default=0.0, metavar="HZ")
    options = parser.parse_args()
    first = datetime.date.today().toordinal() * 1000 if options.today else options.first_seed
    train = tuple(name for name in options.fit_rudder.split(",") if name)
    print(f"Seeds {first} to {first + options.seeds - 1}; held in % (median error, scatter)\n")
    print(f"| boat | sea | {' | '.join((*FREE, *RATIOS))} | answers | time [s] |\n|{'---|' * 12}", flush=True)
    for plant in PLANTS:
        for sea in SEAS:
            if plant.name in (options.plant or [plant.name]) and sea.name in (options.sea or [sea.name]):
                print(row(plant, sea, range(first, first + options.seeds), train, options.orders), flush=True)


if __name__ == "__main__":
    main()
