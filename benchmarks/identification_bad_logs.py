"""What a damaged recording does to the output-error fit: an error beside the share of the damage, or one sentence.

    python benchmarks/identification_bad_logs.py [--seeds N]

One zigzag of 180 s at 10 Hz of a boat that is known (K 0.2 1/s, T 5 s, n3 20 s^2/rad^2, 0.2 deg and 0.1 deg/s of white
noise), damaged in one way at a time. Where there is an answer: the rms error of K and T over the seeds, how often they
lie in their 95 % intervals, and what was said of the record; where there is none, the sentence.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from identification_accuracy import BOATS, HEADING_NOISE, RATE_NOISE, SPEED, clean

from autopilot.errors import InputError
from autopilot.identification.identified import Identified, Question
from autopilot.identification.identify import identify
from autopilot.identification.interval import interval_of
from autopilot.identification.runs import FloatArray, run_from_columns

BOAT = BOATS[1]
Table = dict[str, FloatArray]
Damage = Callable[[Table, np.random.Generator], Table]
MOTION = ("heading_rad", "yaw_rate_rad_s")
BURST_S = 2.0


class Case(NamedTuple):
    """What is done to the recording, in words and as a function."""

    name: str
    damage: Damage


def lost(share: float, burst: float) -> Damage:
    """Drop rows, `share` of them, in bursts of `burst` [s]."""

    def damage(table: Table, random: np.random.Generator) -> Table:
        kept = _outside(table["time_s"], share, burst, random)
        return {name: values[kept] for name, values in table.items()}

    return damage


def blank(share: float, names: tuple[str, ...], burst: float) -> Damage:
    """Blank cells of `names`."""

    def damage(table: Table, random: np.random.Generator) -> Table:
        kept = _outside(table["time_s"], share, burst, random)
        return {**table, **{name: np.where(kept, table[name], np.nan) for name in names}}

    return damage


def _outside(time: FloatArray, share: float, burst: float, random: np.random.Generator) -> np.ndarray:
    length = max(round(burst / float(np.median(np.diff(time)))), 1)
    kept = np.ones(time.size, dtype=bool)
    while np.count_nonzero(~kept) < share * time.size:
        start = int(random.integers(0, time.size))
        kept[start : start + length] = False
    return kept


def spiked(share: float, size: float, names: tuple[str, ...]) -> Damage:
    """Put single samples of `names` off by up to `size`."""

    def damage(table: Table, random: np.random.Generator) -> Table:
        result = dict(table)
        for name in names:
            hit = random.random(table[name].size) < share
            result[name] = np.where(hit, table[name] + size * random.uniform(-1.0, 1.0, table[name].size), table[name])
        return result

    return damage


def clock(leap: float) -> Damage:
    """Let the clock leap by `leap` [s] half way."""

    def damage(table: Table, random: np.random.Generator) -> Table:
        time = table["time_s"]
        return {**table, "time_s": np.where(time > 0.5 * time[-1], time + leap, time)}

    return damage


def jitter(size: float) -> Damage:
    """Stamp the rows late by up to `size` [s]."""

    def damage(table: Table, random: np.random.Generator) -> Table:
        return {**table, "time_s": table["time_s"] + size * random.random(table["time_s"].size)}

    return damage


def changed(**by: Callable[[FloatArray], FloatArray]) -> Damage:
    """Change whole columns."""
    return lambda table, random: {**table, **{name: change(table[name]) for name, change in by.items()}}


def frozen(begin: float, end: float, with_rate: bool) -> Damage:
    """Let the compass stand still between two shares of the recording."""

    def damage(table: Table, random: np.random.Generator) -> Table:
        time, heading = table["time_s"], table["heading_rad"].copy()
        still = (time >= begin * time[-1]) & (time <= end * time[-1])
        heading[still] = heading[still][0]
        result = {**table, "heading_rad": heading}
        return result if with_rate else {k: v for k, v in result.items() if k != "yaw_rate_rad_s"}

    return damage


CASES = (
    Case("nothing", lambda table, random: table),
    *(Case(f"{share:.0%} of the rows lost, one by one", lost(share, 0.0)) for share in (0.05, 0.2, 0.5)),
    *(Case(f"{share:.0%} of the rows lost, 2 s at a time", lost(share, BURST_S)) for share in (0.05, 0.2, 0.5)),
    Case("80% of the rows lost, 2 s at a time", lost(0.8, BURST_S)),
    Case("20% of heading and rate blank, 2 s at a time", blank(0.2, MOTION, BURST_S)),
    Case("20% of the rudder blank, 2 s at a time", blank(0.2, ("rudder_rad",), BURST_S)),
    *(Case(f"{share:.0%} spikes in heading and rate", spiked(share, 1.0, MOTION)) for share in (0.01, 0.05)),
    Case("1% spikes in the rudder", spiked(0.01, 1.0, ("rudder_rad",))),
    Case("1% spikes in the speed", spiked(0.01, 20.0, ("speed_m_s",))),
    Case("the clock leaps ahead by 10 s", clock(10.0)),
    Case("the clock leaps ahead by 0.3 s", clock(0.3)),
    Case("the clock steps back by 1 s", clock(-1.0)),
    Case("stamps late by up to 50 ms", jitter(0.05)),
    Case("headings from 0 to 360 deg", changed(heading_rad=lambda values: np.mod(values - 0.1, 2.0 * math.pi))),
    Case("rudder of opposite sign", changed(rudder_rad=lambda values: -values)),
    Case("rudder in degrees", changed(rudder_rad=np.degrees)),
    Case("rudder in pulse widths", changed(rudder_rad=lambda values: 1500.0 + 700.0 * values)),
    Case("compass stands for a fifth, with rate", frozen(0.4, 0.6, True)),
    Case("compass stands for a fifth, no rate", frozen(0.4, 0.6, False)),
    Case("compass stands throughout, no rate", frozen(0.0, 1.0, False)),
    Case("two samples", lambda table, random: {name: values[:2] for name, values in table.items()}),
    Case("no samples", lambda table, random: {name: values[:0] for name, values in table.items()}),
)


def recorded(case: Case, seed: int) -> Table:
    """Return a recording of the zigzag with the case's damage."""
    random, table = np.random.default_rng(seed), clean(BOAT)
    size = table["time_s"].size
    return case.damage(
        {
            **table,
            "heading_rad": table["heading_rad"] + HEADING_NOISE * random.normal(size=size),
            "yaw_rate_rad_s": table["yaw_rate_rad_s"] + RATE_NOISE * random.normal(size=size),
        },
        random,
    )


def answer(case: Case, seed: int) -> tuple[Identified, str] | str:
    """Return the fit and what was said of the recording, or the sentence that refuses it."""
    try:
        run = run_from_columns("log", recorded(case, seed))
        return identify([run], Question(reference_speed=SPEED)), " ".join(run.notes).replace("log: ", "")
    except InputError as error:
        return str(error)


def row(case: Case, seeds: int) -> tuple[str, ...]:
    """Return a line of the table."""
    answers = [answer(case, seed) for seed in range(seeds)]
    answered = [each for each in answers if not isinstance(each, str)]
    refused = [each for each in answers if isinstance(each, str)]
    if not answered:
        return case.name, "-", "-", "-", refused[0]
    errors = {
        name: [getattr(found.model, name) / getattr(BOAT.model, name) - 1.0 for found, _ in answered] for name in KT
    }
    rms = [f"{100.0 * float(np.sqrt(np.mean(np.square(errors[name])))):.2f}" for name in KT]
    intervals = [
        (name, interval_of(name, getattr(found.model, name), found.standard_errors[name] or 0.0))
        for found, _ in answered
        for name in KT
    ]
    inside = [low <= getattr(BOAT.model, name) <= high for name, (low, high) in intervals]
    said = answered[0][1] + (f" ({len(refused)} of {seeds} refused: {refused[0]})" if refused else "")
    return case.name, *rms, f"{np.count_nonzero(inside)}/{len(inside)}", said


KT = ("gain", "time_constant")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    options = parser.parse_args()
    sys.stdout.write("| damage | rms of K % | rms of T % | in the 95 % interval | said |\n|---|---|---|---|---|\n")
    for case in CASES:
        sys.stdout.write("| " + " | ".join(row(case, options.seeds)) + " |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
