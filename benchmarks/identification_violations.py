"""What `autopilot identify` says of logs that break what it takes for granted, and how many it calls good wrongly.

    python benchmarks/identification_violations.py [--seeds 6] [--first-seed 0 | --today] [--case WORDS] [--said]

Two 20/20 zigzags to either side at 10 Hz, unless the case says otherwise, of a boat that is integrated in
`independent_boat.py`, which imports nothing of the project; CSV files as a user has them. "Nothing, PLANT" are sound
zigzags of 12 to 25 deg of the simulator's plants, in weather that the seed draws. Of each case: how many logs were
refused, called not enough, good for a start, good; of those called good, how many have K or T of any boat in the logs
outside of its 95 % interval; median error of K and T of all that were answered. --said prints the sentences.
"""

from __future__ import annotations

import argparse
import datetime
import math
import sys
import tempfile
import time as clock
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from independent_boat import Boat, FloatArray, Sea, sailed
from learning_seasons import kind_of, weather_of
from learning_seasons import sailed as sailed_by_plant
from zoo_predictions import FINER, FIT_H, NAMES, Zigzag

from autopilot.errors import InputError
from autopilot.identification.identified import Identified
from autopilot.identification.identify import identify
from autopilot.identification.interval import interval_of
from autopilot.identification.verdict import verdict_on_runs
from autopilot.logs.reading import load_run

Table = dict[str, FloatArray]
Tables = list[Table]
K, T = 0.43, 3.5
BOAT = Boat(K / T, 1.0 / T, 6.0 / T, 0.0015)
SECONDS = 70.0
DEGREES = math.pi / 180.0


class Case(NamedTuple):
    """A violation in words, the logs that show it, and K [1/s] and T [s] of every boat in them."""

    name: str
    logs: Callable[[int, Sea], Tables]
    truths: tuple[tuple[float, float], ...] = ((K, T),)


def pair(boat: Boat, seed: int, sea: Sea, other: Boat | None = None, **how: object) -> Tables:
    """Return zigzags to starboard and to port, the second one of `other` where that is given."""
    boats = ((boat, 1), (other or boat, -1))
    return [sailed(each, sea, [seed, k], SECONDS, side=side, **how) for k, (each, side) in enumerate(boats)]


def of_plant(name: str) -> Callable[[int, Sea], Tables]:
    """Return zigzags of a plant of the simulator, which are sound."""

    def logs(seed: int, sea: Sea) -> Tables:
        random, kind = np.random.default_rng([seed, 41]), kind_of(name)
        weather, reference = weather_of(random, kind.h), kind.model.reference_speed
        speed, angle = reference * random.uniform(0.75, 1.1), random.uniform(12.0, 25.0) * DEGREES
        often, tables = kind._replace(h=kind.h / FINER), []
        for side in (1, -1):
            samples = sailed_by_plant(often, weather, Zigzag(angle, side), FIT_H * kind.h, speed, random)
            rows = np.array(list(samples)).T[:5] * np.array([1.0, 1.0, reference, 1.0, 1.0])[:, None]
            tables.append(dict(zip(NAMES, rows, strict=True)))
        return tables

    return logs


def damaged(damage: Callable[[Table, np.random.Generator], Table]) -> Callable[[int, Sea], Tables]:
    """Return pairs of zigzags whose records are damaged."""
    return lambda seed, sea: [
        damage(table, np.random.default_rng([seed, 9, k])) for k, table in enumerate(pair(BOAT, seed, sea))
    ]


def half(table: Table) -> np.ndarray:
    """Return the rows of the second half."""
    return table["time_s"] > 0.5 * table["time_s"][-1]


def late(by: float, part: Callable[[Table], np.ndarray]) -> Callable[[Table, np.random.Generator], Table]:
    """Record heading and rate late by so much [s] in a part."""

    def damage(table: Table, random: np.random.Generator) -> Table:
        time, result = table["time_s"], dict(table)
        for name in ("heading_rad", "yaw_rate_rad_s"):
            if name in table:
                result[name] = np.where(part(table), np.interp(time - by, time, table[name]), table[name])
        return result

    return damage


def changed(**by: Callable[[Table], FloatArray]) -> Callable[[Table, np.random.Generator], Table]:
    """Change whole columns."""
    return lambda table, random: {**table, **{name: change(table) for name, change in by.items()}}


def deviating(size: float, harmonic: int, phase: float) -> Callable[[Table, np.random.Generator], Table]:
    """Let the compass deviate by up to `size` [rad], sin(harmonic (heading + phase))."""
    return changed(heading_rad=lambda t: t["heading_rad"] + size * np.sin(harmonic * (t["heading_rad"] + phase)))


def jittered(size: float) -> Callable[[Table, np.random.Generator], Table]:
    """Stamp the rows late by up to `size` [s], kept in order."""
    return lambda t, random: {**t, "time_s": np.sort(t["time_s"] + size * random.random(t["time_s"].size))}


def gap(seconds: float) -> Callable[[Table, np.random.Generator], Table]:
    """Lose the rows of so long a time in the middle, and let the clock run on as if they had not been."""

    def damage(table: Table, random: np.random.Generator) -> Table:
        begin = 0.4 * table["time_s"][-1]
        kept = (table["time_s"] < begin) | (table["time_s"] > begin + seconds)
        cut = {name: values[kept] for name, values in table.items()}
        return {**cut, "time_s": np.where(cut["time_s"] > begin, cut["time_s"] - seconds + 0.1, cut["time_s"])}

    return damage


def slower(table: Table, random: np.random.Generator) -> Table:
    """Record at 1 Hz from the middle on."""
    kept = ~half(table) | (np.arange(table["time_s"].size) % 10 == 0)
    return {name: values[kept] for name, values in table.items()}


def current(table: Table, random: np.random.Generator) -> Table:
    """Record the speed over ground in a current of 1.2 m/s that sets along the first heading."""
    return {**table, "speed_m_s": np.abs(table["speed_m_s"] + 1.2 * np.cos(table["heading_rad"]))}


def around(boat: Boat, courses: Sequence[float]) -> Callable[[int, Sea], Tables]:
    """Return zigzags about courses [rad] with a compass that deviates by 8 deg, sin(heading)."""

    def logs(seed: int, sea: Sea) -> Tables:
        damage = deviating(8.0 * DEGREES, 1, 0.0)
        tables = [
            sailed(boat, sea, [seed, k], SECONDS, side=1 - 2 * (k % 2), heading=course)
            for k, course in enumerate(courses)
        ]
        return [damage(table, np.random.default_rng(0)) for table in tables]

    return logs


LOADED = BOAT._replace(a=BOAT.a / 1.65)
HEAVY = Boat(BOAT.a / 1.5, BOAT.b / 1.5, BOAT.d / 1.5, BOAT.e / 1.5)
QUICK = Boat(0.25 / 2.0, 1.0 / 2.0, 3.0 / 2.0, 0.001)
WAVES = Sea("waves of 5 s", gust_deg=0.5, wave_deg=3.0, wave_period_s=5.0, gyro_deg_s=0.1)


def stiff(gain: float, rate_gain: float, legs: float) -> Callable[[int, Sea], Tables]:
    """Return what a stiff pilot steers in waves of 5 s, with course changes of so much [rad] every 40 s."""

    def helm(time: float, heading: float, rate: float) -> float:
        wanted = legs * (int(time / 40.0) % 2)
        return float(np.clip(gain * (wanted - heading) - rate_gain * rate, -0.5, 0.5))

    return lambda seed, sea: [sailed(QUICK, WAVES, [seed, k], 150.0, helm=helm) for k in range(2)]


CASES = (
    Case("nothing", lambda seed, sea: pair(BOAT, seed, sea)),
    *(Case(f"nothing, {name}", of_plant(name), ()) for name in ("mmg_tanker", "roll_ship", "small_craft")),
    Case("two boats, K x1.65, a log each", lambda s, sea: pair(BOAT, s, sea, LOADED), ((K, T), (K / 1.65, T))),
    Case("two loadings, T x1.5, a log each", lambda s, sea: pair(BOAT, s, sea, HEAVY), ((K, T), (K, 1.5 * T))),
    Case(
        "two boats, K x1.65, in one log",
        lambda s, sea: pair(BOAT, s, sea, later=LOADED),
        ((K, T), (K / 1.65, T)),
    ),
    Case("loading shifts, T x1.5, in one log", lambda s, sea: pair(BOAT, s, sea, later=HEAVY), ((K, T), (K, 1.5 * T))),
    Case("compass deviates 8 deg, sin, near the slope", damaged(deviating(8.0 * DEGREES, 1, 0.0))),
    Case("compass deviates 8 deg, 2 sin", damaged(deviating(8.0 * DEGREES, 2, 0.0))),
    Case("compass deviates 8 deg, sin, opposite courses", around(BOAT, (0.0, math.pi))),
    Case("compass deviates 8 deg, sin, beam courses", around(BOAT, (0.5 * math.pi, 1.5 * math.pi))),
    Case("stiff pilot in waves of 5 s, no course changes", stiff(2.0, 2.0, 0.0), ((0.25, 2.0),)),
    Case("stiff pilot in waves of 5 s, course changes", stiff(2.0, 2.0, 0.35), ((0.25, 2.0),)),
    Case("wind turns the boat by its heading, 4 deg", lambda s, sea: pair(BOAT, s, sea, wind=4.0 * DEGREES)),
    Case("wind shifts by 90 deg in the log, 4 deg", lambda s, sea: pair(BOAT, s, sea, wind=4.0 * DEGREES, veer=1.57)),
    Case("heading and rate 0.6 s late from the middle", damaged(late(0.6, half))),
    Case("heading and rate 0.6 s late", damaged(late(0.6, lambda t: t["time_s"] >= 0.0))),
    Case("rudder's sensor shows 1.3 times", damaged(changed(rudder_rad=lambda t: 1.3 * t["rudder_rad"]))),
    Case("rudder stops at 12 deg, the record goes on", lambda s, sea: pair(BOAT, s, sea, stop=12.0 * DEGREES)),
    Case("log fouled, 0.6 of the speed", damaged(changed(speed_m_s=lambda t: 0.6 * t["speed_m_s"]))),
    Case(
        "log fouled from the middle, 0.6",
        damaged(changed(speed_m_s=lambda t: np.where(half(t), 0.6, 1.0) * t["speed_m_s"])),
    ),
    Case("log stuck, throttle from 5 to 3.5 m/s", lambda s, sea: pair(BOAT, s, sea, slow=0.7, log_stuck=True)),
    Case("throttle from 5 to 3.5 m/s, log works", lambda s, sea: pair(BOAT, s, sea, slow=0.7)),
    Case("stamps late by up to 50 ms", damaged(jittered(0.05))),
    Case("stamps late by up to 0.5 s", damaged(jittered(0.5))),
    Case("12 s lost, the clock runs on", damaged(gap(12.0))),
    Case("10 Hz, 1 Hz from the middle on", damaged(slower)),
    Case("current of 1.2 m/s in the speed", damaged(current)),
    Case(
        "rudder mirrored from the middle",
        damaged(changed(rudder_rad=lambda t: np.where(half(t), -1.0, 1.0) * t["rudder_rad"])),
    ),
    Case("heading from -pi to pi", damaged(changed(heading_rad=lambda t: np.angle(np.exp(1j * t["heading_rad"]))))),
    Case(
        "rate in deg/s for rad/s, from the middle",
        damaged(changed(yaw_rate_rad_s=lambda t: np.where(half(t), 1.0 / DEGREES, 1.0) * t["yaw_rate_rad_s"])),
    ),
    Case("gyro shows 1.15 times", damaged(changed(yaw_rate_rad_s=lambda t: 1.15 * t["yaw_rate_rad_s"]))),
    Case("gyro off by 1 deg/s", damaged(changed(yaw_rate_rad_s=lambda t: t["yaw_rate_rad_s"] + DEGREES))),
    Case("rudder has 2 deg of play", lambda s, sea: pair(BOAT, s, sea, play=2.0 * DEGREES)),
    Case("at anchor, 0.5 m/s of stream", lambda s, sea: pair(BOAT, s, sea, slow=0.1, slow_from=0.0, anchor=0.05)),
)
SEAS = (
    Sea("calm, gyro", gyro_deg_s=0.1),
    Sea("gusts, gyro", gust_deg=1.0, gyro_deg_s=0.1),
    Sea("gusts, no gyro", gust_deg=1.0),
)


class Answer(NamedTuple):
    """The grade; whether it is good and K or T is outside of its interval; errors of K and T as shares; the words."""

    grade: str
    is_wrong: bool
    errors: tuple[float, float]
    said: str


def answer(case: Case, seed: int, sea: Sea, folder: str) -> Answer:
    """Return what is said of the case's logs."""
    paths = []
    for k, table in enumerate(case.logs(seed, sea)):
        paths.append(f"{folder}/run{k + 1}.csv")
        names = [name for name in table if name != "yaw_rate_rad_s" or sea.gyro_deg_s is not None]
        rows = np.stack([table[name] for name in names], axis=1)
        np.savetxt(paths[-1], rows, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
    try:
        runs = [load_run(path) for path in paths]
        found = identify(runs)
    except InputError as error:
        return Answer("refused", False, (math.nan, math.nan), str(error).replace(folder + "/", ""))
    verdict = verdict_on_runs(found, runs, math.inf)
    wrong = [name for name in ("K", "T") if any(not _holds(found, name, truth) for truth in case.truths)]
    said = " ".join([verdict.sentence, *found.notes, *(note for run in runs for note in run.notes)])
    said = said.replace(folder + "/", "")
    if not case.truths:
        return Answer(verdict.grade, False, (math.nan, math.nan), said)
    at = [abs(math.log(max(found.model.gain, 1.0e-9) / gain)) for gain, _ in case.truths]
    gain, time_constant = case.truths[int(np.argmax(at))]
    scale = found.model.reference_speed / SPEED
    errors = (found.model.gain / scale / gain - 1.0, found.model.time_constant * scale / time_constant - 1.0)
    return Answer(verdict.grade, verdict.grade == "good" and bool(wrong), errors, said)


SPEED = 5.0


def _holds(found: Identified, name: str, truth: tuple[float, float]) -> bool:
    field = "gain" if name == "K" else "time_constant"
    value, error = getattr(found.model, field), found.standard_errors[field]
    scale = found.model.reference_speed / SPEED
    true = truth[0] * scale if name == "K" else truth[1] / scale
    low, high = interval_of(field, value, error or 0.0)
    return low <= true <= high


def row(case: Case, seeds: Sequence[int], sea: Sea, says: bool) -> str:
    """Return the line of one case and sea."""
    began = clock.process_time()
    with tempfile.TemporaryDirectory() as folder:
        answers = [answer(case, seed, sea, folder) for seed in seeds]
    took = (clock.process_time() - began) / len(seeds)
    counts = [sum(each.grade == grade for each in answers) for grade in ("refused", "not enough", "start", "good")]
    wrong = sum(each.is_wrong for each in answers)
    errors = np.array([each.errors for each in answers if each.grade != "refused"])
    middle = (
        ["-", "-"] if not np.isfinite(errors).any() else [f"{100.0 * each:+.0f}" for each in np.median(errors, axis=0)]
    )
    cells = [case.name, sea.name, *map(str, counts), str(wrong), *middle, f"{took:.1f}"]
    words = "".join(f"\n    {line}" for line in dict.fromkeys(each.said for each in answers)) if says else ""
    return f"| {' | '.join(cells)} |{words}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--today", action="store_true", help="seeds drawn from today's date")
    parser.add_argument("--case", default="", help="those whose name has these words")
    parser.add_argument("--sea", action="append", choices=[sea.name for sea in SEAS], help="default: all")
    parser.add_argument("--said", action="store_true", help="print what was said, too")
    options = parser.parse_args()
    first = datetime.date.today().toordinal() * 1000 if options.today else options.first_seed
    print(f"Seeds {first} to {first + options.seeds - 1}\n")
    print("| logs | sea | refused | not enough | start | good | good and wrong | K off % | T off % | time [s] |")
    print(f"|{'---|' * 10}", flush=True)
    for case in CASES:
        for sea in SEAS:
            if options.case in case.name and sea.name in (options.sea or [sea.name]):
                print(row(case, range(first, first + options.seeds), sea, options.said), flush=True)


if __name__ == "__main__":
    sys.exit(main())
