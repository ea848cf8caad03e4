"""How much each tuned number matters: each of the three tables 30 % down and 30 % up, over boats, seas and faults.

    python benchmarks/sensitivity.py --out benchmarks/results/sensitivity.md      # about 15 minutes of two cores
    python benchmarks/sensitivity.py --only SEA,GUST                              # two numbers, sooner
    python benchmarks/sensitivity.py --points FILE --minutes 10                   # goes on from FILE another time
    python benchmarks/sensitivity.py --points FILE --minutes 0 --beside           # writes it beside the numbers

Tables: `autopilot.estimation.tuning`, `autopilot.supervision.tuning` and `autopilot.guidance.tuning`. Each value is
tried in a process of its own, which changes the table before anything has read it: what follows from a number by a
formula follows, wherever the formula stands. One of several values is scaled as a whole; a count changes by one.

The boats are the simulator's own plants, whose equations are not the pilot's, with their shipped files, a
course-unstable tanker (`study_boats`), and Lanxin with a rudder 30 % weaker than filed. Healthy: on a course for
COURSE_S and through a turn of 60 deg in calm water; on a course in waves and gusts. Faults: two of the boats on a
course in slight waves begin a turn when the fault comes. Figures: the largest change, over all, of heading rms and
rudder travel on the course and of the overshoot; alarms that only then a healthy boat raises; faults that are noticed
later, or not at all in WITHIN_S. The numbers of planned turns are judged by turns of 90 deg alone, of boats of `turns`,
four of them drawn and course-unstable, with K 0.7 and 1.3 times the model's.
"""

from __future__ import annotations

import argparse
import ast
import copy
import json
import math
import multiprocessing
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

# what is no part of the program is loaded once, before each number's process begins
import numpy as np
import pymavlink.dialects.v20.ardupilotmega  # noqa: F401
import scipy.signal  # noqa: F401
import yaml  # noqa: F401

ROOT = Path(__file__).parents[1]
TURNS = "autopilot.guidance.tuning"
TABLES = ("autopilot.estimation.tuning", "autopilot.supervision.tuning", TURNS)
FACTORS = (0.7, 1.3)
SIZES = ("TICKS_KEPT", "ORDERS_KEPT")
"""Lengths of rings, powers of two by construction: not scaled."""
STEP_S, HEADING_EVERY = 0.025, 4
"""The simulator's step here [s], and how many of them lie between two headings."""
COURSE_S, SETTLES_S, TURN_S = 60.0, 20.0, 60.0
TURN = math.radians(60.0)
BOATS = ("lanxin", "naval_vessel", "outboard", "mmg_tanker")
FAULTY_BOATS = ("lanxin", "outboard")
UNSTABLE, WEAK = "tanker, course-unstable", "lanxin, K x 0.7"
WITHIN_S = 20.0
FAULTS = (
    "rudder_stuck",
    "rudder_reversed",
    "rudder_hard_over",
    "rudder_slow",
    "heading_frozen",
    "heading_jump",
    "rate_reversed",
)
DRAWN = 4
"""Course-unstable boats of `turns` that are turned."""
SHOWN = 0.05
"""Changes of a figure by less than this share are not shown."""


class Number(NamedTuple):
    """A number of a table: its module, its name, and its value: one, or several that belong together."""

    table: str
    name: str
    value: Any


class Healthy(NamedTuple):
    """A run without a fault: heading rms [deg], travel [deg/s], overshoot [deg], and the alarms that were raised."""

    name: str
    rms: float
    travel: float
    overshoot: float
    alarms: tuple[str, ...]


class Faulty(NamedTuple):
    """A fault: the time [s] until something was said or done, inf where nothing was in WITHIN_S."""

    name: str
    noticed: float


class Outcome(NamedTuple):
    """What was sailed with a number."""

    healthy: tuple[Healthy, ...]
    faulty: tuple[Faulty, ...]


class Turned(NamedTuple):
    """Turns of 90 deg: the mean settling time over the quickest possible, how many went past by more than 3 deg, and
    the furthest [deg]; of course-stable boats and of unstable ones."""

    stable: tuple[float, int, float]
    unstable: tuple[float, int, float]


def source_of(table: str) -> str:
    """Return the text of a table's module."""
    return (ROOT / table.replace(".", "/")).with_suffix(".py").read_text(encoding="utf-8")


def numbers() -> list[Number]:
    """Return the numbers of the tables, in their order; those that follow from others by a formula are left out."""
    found = []
    for table in TABLES:
        text, values = source_of(table), dict[str, Any]()
        exec(compile(text, table, "exec"), values)
        for node in ast.parse(text).body:
            if isinstance(node, ast.Assign) and not _names_in(node.value):
                names = [name for target in node.targets for name in _names_in(target) if name not in SIZES]
                found += [Number(table, name, values[name]) for name in names]
    return found


def _names_in(node: ast.expr) -> list[str]:
    return [each.id for each in ast.walk(node) if isinstance(each, ast.Name) and each.id != "math"]


def scaled(value: Any, factor: float) -> Any:
    """Return a number, or several, `factor` times as large; a count stays one, and changes by one at least."""
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    if isinstance(value, int):
        return max(value + (-1 if factor < 1.0 else 1), 1) if value < 4 else round(value * factor)
    return value * factor


def change(number: Number, factor: float) -> None:
    """Change a number of a table that nothing has read yet, and with it what the table works out from it."""
    import importlib

    assert not any(name.startswith(("autopilot", "sitl")) for name in sys.modules), "the program has read its numbers"
    values = vars(importlib.import_module(number.table))
    for node in ast.parse(source_of(number.table)).body:
        exec(compile(ast.Module([node], []), number.table, "exec"), values)
        if isinstance(node, ast.Assign) and number.name in _names_in(node.targets[0]):
            values[number.name] = scaled(number.value, factor)


def sailed_with(job: tuple[Number, float]) -> tuple[str, Any]:
    """Return what is sailed with a number `factor` times as large, and its key; in a process of its own."""
    number, factor = job
    np.seterr(all="raise", under="ignore")
    if factor != 1.0:
        change(number, factor)
    return key_of(number, factor), turned() if number.table == TURNS else outcome()


def key_of(number: Number, factor: float) -> str:
    """Return the name of a point."""
    return f"{number.table} {number.name} {factor}"


def outcome() -> Outcome:
    """Sail everything with the numbers as they are."""
    from sailed_boats import OneBoat, noticed_after

    runs = []
    for name in (*BOATS, UNSTABLE, WEAK):
        for rough in (False, True):
            boat = OneBoat(name, rough=rough)
            boat.run(COURSE_S)
            rms, travel = boat.figures(SETTLES_S)
            past = 0.0
            if not rough:
                boat.order(TURN)
                boat.run(TURN_S)
                past = boat.past(TURN, COURSE_S)
            runs.append(Healthy(f"{name}, {'rough' if rough else 'calm'}", rms, travel, past, tuple(boat.alarms)))
    faults = []
    for name in FAULTY_BOATS:
        settled = OneBoat(name, rough=False, slight=True)
        settled.run(30.0)
        faults += [
            Faulty(f"{fault}, {name}", noticed_after(copy.deepcopy(settled), fault, WITHIN_S)) for fault in FAULTS
        ]
    return Outcome(tuple(runs), tuple(faults))


def turned() -> Turned:
    """Turn the boats with the numbers as they are."""
    import turns

    known = {**{name: turns.BOATS[name] for name in ("lanxin", "coaster", "esso")}, **turns.drawn(DRAWN)}
    found: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
    for boat in known.values():
        least = turns.quickest(boat)
        for factor in (turns.WEAKER, turns.STRONGER):
            each = turns.turned(boat, factor, 0.3, turns.WATCHED * least)
            found[boat.model.n1 > 0.0].append((min(each.settling_s / least, turns.WATCHED), each.overshoot_deg))
    stable, unstable = (
        (
            sum(time for time, _ in each) / len(each),
            sum(past > turns.FAR_DEG for _, past in each),
            max(past for _, past in each),
        )
        for each in (found[True], found[False])
    )
    return Turned(stable, unstable)


def turned_rows(rows: list[tuple[str, float, Turned]]) -> str:
    """Return turns as Markdown: settling over the quickest, turns past by more than 3 deg, and the furthest [deg]."""
    lines = [
        "| number | times | stable: settling | past 3° | furthest | unstable: settling | past 3° | furthest |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name, factor, found in rows:
        cells = [f"{time:.2f} | {past} | {far:.1f}" for time, past, far in found]
        lines.append(f"| {name} | {factor:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def row_of(base: Outcome, number: Number, factor: float, found: Outcome) -> dict[str, Any]:
    """Return what changed: for each figure the run in which it changed most, and by how much."""
    name = f"{number.table.split('.')[1]}.{number.name}"
    row: dict[str, Any] = {"number": name, "factor": factor}
    for figure, least in (("rms", 0.05), ("travel", 0.05), ("overshoot", 1.0)):
        changes = {
            after.name: (getattr(after, figure) + least) / (getattr(before, figure) + least)
            for before, after in zip(base.healthy, found.healthy, strict=True)
        }
        worst = max(changes, key=lambda name: changes[name])
        best = min(changes, key=lambda name: changes[name])
        row[figure] = {"most": changes[worst], "at": worst, "least": changes[best], "least_at": best}
    row["alarms"] = [
        f"{name} ({after.name})"
        for before, after in zip(base.healthy, found.healthy, strict=True)
        for name in after.alarms
        if name not in before.alarms
    ]
    row["later"] = {
        after.name: (before.noticed, after.noticed)
        for before, after in zip(base.faulty, found.faulty, strict=True)
        if after.noticed > before.noticed + 0.5
    }
    return row


def table_of(rows: list[dict[str, Any]]) -> str:
    """Return the rows as Markdown."""
    lines = [
        "| number | times | rms | rudder travel | overshoot | new alarms of healthy boats | faults noticed later [s] |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        cells = [f"`{row['number']}`", f"{row['factor']:g}"]
        cells += [_change(row[figure]) for figure in ("rms", "travel", "overshoot")]
        cells.append("; ".join(row["alarms"]))
        cells.append("; ".join(f"{name} {_s(before)} → {_s(after)}" for name, (before, after) in row["later"].items()))
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _rounded(found: Turned) -> list[tuple[float, int, float]]:
    return [(round(time, 2), past, round(far, 1)) for time, past, far in found]


def _change(found: dict[str, Any]) -> str:
    parts = []
    if found["most"] > 1.0 + SHOWN:
        parts.append(f"× {found['most']:.2f} ({found['at']})")
    if found["least"] < 1.0 - SHOWN:
        parts.append(f"× {found['least']:.2f} ({found['least_at']})")
    return ", ".join(parts)


def _s(seconds: float) -> str:
    return "never" if math.isinf(seconds) else f"{seconds:.1f}"


def is_quiet(row: dict[str, Any]) -> bool:
    """Return whether a change shows in no figure."""
    return not (row["alarms"] or row["later"] or any(_change(row[name]) for name in ("rms", "travel", "overshoot")))


def record_of(points: dict[str, Any], chosen: list[Number], date: str, command: str) -> str:
    """Return the record: what was sailed, how it went as the numbers are, and what each change does."""
    base, still = points["base"], points["turns"]
    rows, turning, missing = [], [("as they are", 1.0, still)], []
    for number in chosen:
        for factor in FACTORS:
            found = points.get(key_of(number, factor))
            if found is None:
                missing.append(f"{number.table.split('.')[1]}.{number.name}")
            elif number.table != TURNS:
                rows.append(row_of(base, number, factor, found))
            elif _rounded(found) != _rounded(still):
                turning.append((f"`{number.name}`", factor, found))
    loud = [row for row in rows if not is_quiet(row)]
    quiet = sorted({row["number"] for row in rows} - {row["number"] for row in loud})
    parts = [
        "# What each tuned number changes",
        "Record of a measurement. The date is the day on which the numbers entered the repository.",
        f"| part | date | command |\n|---|---|---|\n| All | {date} | `{command}` |",
        "Each number of `autopilot/estimation/tuning.py` and `autopilot/supervision/tuning.py` is scaled by 0.7\n"
        "and by 1.3. Shown are the runs that change most: rms and rudder travel on a course, overshoot in a turn\n"
        f"of 60° (of rms + 0.05°, travel + 0.05°/s, overshoot + 1°), where by more than {100 * SHOWN:.0f} %.",
        "## As the numbers are",
        "| boat, sea | rms [deg] | travel [deg/s] | overshoot [deg] | alarms |\n|---|---|---|---|---|\n"
        + "\n".join(
            f"| {each.name} | {each.rms:.2f} | {each.travel:.2f} | {each.overshoot:.1f} | {', '.join(each.alarms)} |"
            for each in base.healthy
        ),
        "| fault, boat | noticed after [s] |\n|---|---|\n"
        + "\n".join(f"| {each.name} | {_s(each.noticed)} |" for each in base.faulty),
        "## What changes",
        table_of(loud),
        "## Numbers that change none of this by 30 % of themselves",
        ", ".join(f"`{name}`" for name in quiet) + ".",
        "## Planned turns",
        "Turns of 90° of Lanxin, coaster and Esso Osaka (stable) and of four drawn course-unstable boats of\n"
        "`benchmarks/turns.py`, with K 0.7 and 1.3 times the model's, one seed: settling over the least time,\n"
        "turns past by more than 3°, the furthest [deg]. A number that changes nothing shown is left out.",
        turned_rows(turning),
    ]
    if missing:
        parts += ["## Not sailed", ", ".join(f"`{name}`" for name in dict.fromkeys(missing)) + "."]
    return "\n\n".join(parts) + "\n"


def beside(points: dict[str, Any], chosen: list[Number]) -> None:
    """Write into the tables, behind each number that was sailed both ways, the most that 30 % of it change."""
    for table in TABLES:
        text = source_of(table)
        lines = text.splitlines()
        for node in ast.parse(text).body:
            if not isinstance(node, ast.Assign):
                continue
            names = {name for target in node.targets for name in _names_in(target)}
            notes = [note_of(points, number) for number in chosen if number.table == table and number.name in names]
            if notes and all(notes):
                place = (node.end_lineno or node.lineno) - 1
                lines[place] = f"{lines[place].partition('  # 30 %')[0]}  # 30 %: {'; '.join(dict.fromkeys(notes))}"
        (ROOT / table.replace(".", "/")).with_suffix(".py").write_text("\n".join(lines) + "\n", encoding="utf-8")


def note_of(points: dict[str, Any], number: Number) -> str:
    """Return in a few words what 30 % more or less of a number changes, "" where that was not sailed."""
    found = [points.get(key_of(number, factor)) for factor in FACTORS]
    if None in found:
        return ""
    if number.table == TURNS:
        times = [each.stable[0] + each.unstable[0] for each in found]
        past = max(each.stable[1] + each.unstable[1] for each in found)
        still = points["turns"]
        change = max(times, key=lambda time: abs(time - sum(side[0] for side in still[:2])))
        said = (
            []
            if all(_rounded(each) == _rounded(still) for each in found)
            else [
                f"settling {0.5 * (change - still.stable[0] - still.unstable[0]):+.2f}",
                *([f"{past} turns past"] if past else []),
            ]
        )
        return ", ".join(said) or "nothing"
    rows = [row_of(points["base"], number, factor, each) for factor, each in zip(FACTORS, found, strict=True)]
    said = []
    for figure in ("rms", "travel", "overshoot"):
        most, least = max(row[figure]["most"] for row in rows), min(row[figure]["least"] for row in rows)
        furthest = most if most * least > 1.0 else least
        if abs(furthest - 1.0) > SHOWN:
            said.append(f"{figure} x {furthest:.2f}")
    alarms, later = (len({each for row in rows for each in row[key]}) for key in ("alarms", "later"))
    said += [f"new alarms: {alarms}"] if alarms else []
    said += [f"faults noticed later: {later}"] if later else []
    return ", ".join(said) or "nothing"


def read(line: str) -> tuple[str, Any]:
    """Return a point as it was kept."""
    key, found = json.loads(line)
    if len(found) == 2 and isinstance(found[0][0], list):
        healthy = tuple(Healthy(*each[:4], tuple(each[4])) for each in found[0])
        return key, Outcome(healthy, tuple(Faulty(*each) for each in found[1]))
    return key, Turned(*(tuple(each) for each in found))


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", default="", help="names, separated by commas")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument(
        "--minutes", type=float, default=math.inf, help="begin no other number after this time; 0: sail none"
    )
    parser.add_argument("--out", type=Path, help="write the record here")
    parser.add_argument("--points", type=Path, help="keep what was sailed here, and go on from it")
    parser.add_argument("--date", default="undated")
    parser.add_argument("--beside", action="store_true", help="write into the tables what each number changes")
    arguments = parser.parse_args()
    names = set(filter(None, arguments.only.split(",")))
    chosen = [number for number in numbers() if not names or number.name in names]
    if missing := names - {number.name for number in chosen}:
        parser.error(f"no such number: {', '.join(sorted(missing))}")
    points: dict[str, Any] = {}
    if arguments.points is not None and arguments.points.exists():
        points = dict(map(read, arguments.points.read_text(encoding="utf-8").splitlines()))
    as_they_are = {"base": Number(TABLES[0], "base", 1.0), "turns": Number(TURNS, "turns", 1.0)}
    jobs = [(number, 1.0) for name, number in as_they_are.items() if name not in points]
    jobs += [(number, factor) for number in chosen for factor in FACTORS if key_of(number, factor) not in points]
    jobs = jobs if arguments.minutes > 0.0 else []
    ends = time.monotonic() + 60.0 * arguments.minutes
    with multiprocessing.get_context("fork").Pool(arguments.workers, maxtasksperchild=1) as pool:
        for place, (key, found) in enumerate(pool.imap(sailed_with, jobs), 1):
            name = next((name for name, number in as_they_are.items() if key == key_of(number, 1.0)), key)
            points[name] = found
            if arguments.points is not None:
                with arguments.points.open("a", encoding="utf-8") as file:
                    file.write(json.dumps([name, found]) + "\n")
            print(f"\r{place} of {len(jobs)}", end="", file=sys.stderr, flush=True)
            if time.monotonic() > ends:
                pool.terminate()
                break
    print(file=sys.stderr)
    command = "python benchmarks/sensitivity.py " + " ".join(sys.argv[1:])
    if arguments.beside:
        beside(points, chosen)
        return
    record = record_of(points, chosen, arguments.date, command.strip())
    if arguments.out is not None:
        arguments.out.write_text(record, encoding="utf-8")
    else:
        print(record)


if __name__ == "__main__":
    main()
