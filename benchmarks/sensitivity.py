"""How much each tuned number matters: each of the two tables 30 % down and 30 % up, over boats, seas and faults.

    python benchmarks/sensitivity.py --out benchmarks/results/sensitivity.md      # about an hour and a half of a core
    python benchmarks/sensitivity.py --only SEA,GUST --seconds 120                # two numbers, sooner
    python benchmarks/sensitivity.py --json                                       # for a machine

Tables: `autopilot.estimation.tuning`, `autopilot.supervision.tuning` and `autopilot.guidance.tuning`. A number is
scaled wherever a module has taken it by its name; one of several values is scaled as a whole. What follows from it by a
formula in the table follows here, too.

Healthy boats: the study boats (`study_boats`) on a course, in calm water and in sea state 5 from 60 deg, and in calm
water in a turn of 60 deg after that; one of them with a rudder that is 30 % weaker than its model's. Faults: the
matrix's boat (`fault_boat`) with each of FAULTS under way. Figures: the largest change, over all, of heading rms and
rudder travel on the course and of the overshoot; alarms that only then a healthy boat raises; faults
that are noticed later, or not at all in WITHIN_S. The numbers of planned turns are judged by turns of 90 deg alone, of
boats of `turns`, ten of them drawn and course-unstable, with K 0.7, 1 and 1.3 times the model's.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import dataclasses
import importlib
import inspect
import json
import math
import pkgutil
import sys
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import turns
from fault_boat import FaultBoat, Injected
from study_boats import CONTROL_HZ, SEAS, StudyBoat, boats, figures, sail

import autopilot
from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin
from autopilot.runtime.build import build_pilot
from autopilot.signals import Mode, Order, OrderKind, Sample

TURNS = "autopilot.guidance.tuning"
TABLES = ("autopilot.estimation.tuning", "autopilot.supervision.tuning", TURNS)
FACTORS = (0.7, 1.3)
TURN = math.radians(60.0)
CALM, ROUGH = "calm", "state 5"
SETTLES_S, TURNS_FOR_S = 40.0, 60.0
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


def numbers() -> list[Number]:
    """Return the numbers of the tables, in their order; those that follow from others by a formula are left out."""
    found = []
    for table in TABLES:
        module = importlib.import_module(table)
        for node in ast.parse(inspect.getsource(module)).body:
            if isinstance(node, ast.Assign) and not _names_in(node.value):
                names = [name for target in node.targets for name in _targets(target)]
                found += [Number(table, name, getattr(module, name)) for name in names]
    return found


def _targets(node: ast.expr) -> list[str]:
    return [each.id for each in ast.walk(node) if isinstance(each, ast.Name)]


def _names_in(node: ast.expr) -> set[str]:
    return {each.id for each in ast.walk(node) if isinstance(each, ast.Name)} - {"math"}


def scaled(value: Any, factor: float) -> Any:
    """Return a number, or several, `factor` times as large; a count stays one, and changes by one at least."""
    if isinstance(value, tuple):
        return tuple(scaled(each, factor) for each in value)
    if isinstance(value, int):
        return max(value + (-1 if factor < 1.0 else 1), 1) if value < 4 else round(value * factor)
    return value * factor


def modules() -> list[ModuleType]:
    """Return every module of the program that can be imported here."""
    found = []
    for info in pkgutil.walk_packages(autopilot.__path__, "autopilot."):
        if ".cli" in info.name or info.name.endswith("__main__"):
            continue
        with contextlib.suppress(ImportError):
            found.append(importlib.import_module(info.name))
    return found


@contextlib.contextmanager
def set_to(number: Number, factor: float) -> Iterator[None]:
    """Have the program use another value of a number, and of what its table works out from it, for a while."""
    before = importlib.import_module(number.table)
    kept = dict(vars(before))
    text = ast.parse(inspect.getsource(before))
    values: dict[str, Any] = {"__name__": number.table}
    for node in text.body:
        exec(compile(ast.Module([node], []), number.table, "exec"), values)
        if number.name in values and isinstance(node, ast.Assign) and number.name in _targets(node.targets[0]):
            values[number.name] = scaled(number.value, factor)
    changed = {
        name: value for name, value in values.items() if name.isupper() and name in kept and _differs(value, kept[name])
    }
    undone: list[tuple[ModuleType, str, Any]] = []
    for module in modules():
        for name, value in changed.items():
            if name in vars(module) and not _differs(vars(module)[name], kept[name]):
                undone.append((module, name, vars(module)[name]))
                setattr(module, name, value)
    try:
        yield
    finally:
        for module, name, value in undone:
            setattr(module, name, value)


def _differs(one: Any, other: Any) -> bool:
    return type(one) is not type(other) or one != other


def study() -> dict[str, tuple[StudyBoat, Norrbin | None]]:
    """Return the boats, each with the model of the hull where that is another than the pilot's."""
    known = boats()
    model = known["launch"].vessel.model
    weak = Norrbin(
        0.7 * model.K_1_s, model.T_s, model.n3_s2_rad2, n1=model.n1, reference_speed=model.reference_speed_m_s
    )
    return {**{name: (boat, None) for name, boat in known.items()}, "launch, K x 0.7": (known["launch"], weak)}


def healthy(name: str, boat: StudyBoat, hull: Norrbin | None, sea: str, seconds: float) -> Healthy:
    """Sail a course, then a turn, and return what it came to."""
    vessel = boat.vessel
    pilot = build_pilot(vessel)
    raised: dict[str, None] = {}

    def helmsman(now: float, samples: tuple[Sample, ...]) -> float:
        turned = now >= seconds
        tick = pilot.step(now, samples, Order(OrderKind.HEADING, TURN if turned else 0.0, serial=1 + turned))
        raised.update(dict.fromkeys(event.name for event in tick.alarms))
        return tick.command.angle

    sailed = boat
    if hull is not None:
        model = dataclasses.replace(vessel.model, K_1_s=hull.gain)
        sailed = boat._replace(vessel=dataclasses.replace(vessel, model=model))
    turning = TURNS_FOR_S + min(3.0 * vessel.model.T_s, 120.0) if sea == CALM else 0.0
    record = sail(sailed, SEAS[sea], 60.0, seconds + turning, 1, helmsman)
    held = type(record)(*(column[: round(seconds * CONTROL_HZ)] for column in record))
    found = figures(held, SETTLES_S)
    after = record.heading[round(seconds * CONTROL_HZ) :]
    overshoot = max((math.degrees(wrap(float(each) - TURN)) for each in after), default=0.0)
    return Healthy(f"{name}, {sea}", found.heading_deg, found.travel_deg_s, max(overshoot, 0.0), tuple(raised))


def faulty(fault: str) -> Faulty:
    """Inject a fault into a boat that has settled on a course and begins a turn, and return when it is noticed."""
    boat = FaultBoat("companion", 3)
    boat.run(5.0)
    boat.type_line("e 40")
    boat.run(20.0)
    known = {event.name for event in boat.tick.alarms}
    boat.add(Injected(fault))
    boat.type_line("+20")
    began = boat.clock.time
    is_said = boat.run(
        WITHIN_S,
        lambda tick: tick.mode is not Mode.ENGAGED or not {event.name for event in tick.alarms} <= known,
    )
    return Faulty(fault, boat.clock.time - began if is_said else math.inf)


def outcome(seconds: float) -> Outcome:
    """Sail everything with the numbers as they are."""
    runs = [
        healthy(name, boat, hull, sea, seconds)
        for name, (boat, hull) in study().items()
        for sea in (CALM, ROUGH)
        if hull is None or sea == CALM
    ]
    return Outcome(tuple(runs), tuple(faulty(fault) for fault in FAULTS))


def outcome_with(seconds: float, number: Number, factor: float) -> Outcome:
    """The same with another value of one number."""
    with set_to(number, factor):
        return outcome(seconds)


def turned() -> Turned:
    """Turn the boats with the numbers as they are."""
    known = {**{name: turns.BOATS[name] for name in ("lanxin", "coaster", "esso")}, **turns.drawn(10)}
    found: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
    for boat in known.values():
        least = turns.quickest(boat)
        for factor in (turns.WEAKER, 1.0, turns.STRONGER):
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


def turned_with(number: Number, factor: float) -> Turned:
    """The same with another value of one number."""
    with set_to(number, factor):
        return turned()


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
    row: dict[str, Any] = {"table": number.table.split(".")[1], "number": number.name, "factor": factor}
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


def record_of(base: Outcome, rows: list[dict[str, Any]], turning: str, date: str, command: str) -> str:
    """Return the record: what was sailed, how it went as the numbers are, and what each change does."""
    quiet = sorted({row["number"] for row in rows} - {row["number"] for row in rows if not is_quiet(row)})
    runs = [
        f"| {each.name} | {each.rms:.2f} | {each.travel:.2f} | {each.overshoot:.1f} | {', '.join(each.alarms)} |"
        for each in base.healthy
    ]
    faults = [f"| {each.name} | {_s(each.noticed)} |" for each in base.faulty]
    loud = [row for row in rows if not is_quiet(row)]
    return "\n".join(
        [
            "# What each tuned number changes",
            "",
            "Record of a measurement. The date is the day on which the numbers entered the repository.",
            "",
            "| part | date | command |",
            "|---|---|---|",
            f"| All | {date} | `{command}` |",
            "",
            "Each number of `autopilot/estimation/tuning.py` and `autopilot/supervision/tuning.py` is scaled by 0.7",
            "and by 1.3. Shown are the runs that change most: rms and rudder travel on a course, overshoot in a turn",
            f"of 60° (of rms + 0.05°, travel + 0.05°/s, overshoot + 1°), where by more than {100 * SHOWN:.0f} %.",
            "",
            "## As the numbers are",
            "",
            "| boat, sea | rms [deg] | travel [deg/s] | overshoot [deg] | alarms |",
            "|---|---|---|---|---|",
            *runs,
            "",
            "| fault | noticed after [s] |",
            "|---|---|",
            *faults,
            "",
            "## What changes",
            "",
            table_of(loud),
            "",
            "## Numbers that change none of this by 30 % of themselves",
            "",
            ", ".join(f"`{name}`" for name in quiet) + ".",
            "",
            "## Planned turns",
            "",
            "Turns of 90° of Lanxin, coaster and Esso Osaka (stable) and of ten drawn course-unstable boats of",
            "`benchmarks/turns.py`, with K 0.7, 1 and 1.3 times the model's, one seed: settling over the least time,",
            "turns past by more than 3°, the furthest [deg]. A number that changes nothing shown is left out.",
            "",
            turning,
            "",
        ]
    )


def is_quiet(row: dict[str, Any]) -> bool:
    """Return whether a change shows in no figure."""
    return not (row["alarms"] or row["later"] or any(_change(row[name]) for name in ("rms", "travel", "overshoot")))


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--only", default="", help="names, separated by commas")
    parser.add_argument("--seconds", type=float, default=80.0, help="on the course (default 80)")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="write the record here")
    parser.add_argument("--points", type=Path, help="keep what was sailed here, and go on from it")
    parser.add_argument("--date", default="undated")
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    names = set(filter(None, arguments.only.split(",")))
    chosen = [number for number in numbers() if not names or number.name in names]
    missing = names - {number.name for number in chosen}
    if missing:
        parser.error(f"no such number: {', '.join(sorted(missing))}")
    kept: dict[str, Any] = {}
    if arguments.points is not None and arguments.points.exists():
        kept = {line["key"]: line["row"] for line in map(json.loads, arguments.points.read_text().splitlines())}
    base, still = outcome(arguments.seconds), turned()
    rows: list[dict[str, Any]] = []
    turning = [("as they are", 1.0, still)]
    waiting = [(number, factor, f"{number.table} {number.name} {factor}") for number in chosen for factor in FACTORS]
    with ProcessPoolExecutor(arguments.workers) as pool:
        futures: dict[str, Future[Any]] = {}
        for number, factor, key in waiting:
            if key not in kept:
                sailed = turned_with if number.table == TURNS else partial(outcome_with, arguments.seconds)
                futures[key] = pool.submit(sailed, number, factor)
        for place, (number, factor, key) in enumerate(waiting, 1):
            found = kept[key] if key in kept else futures[key].result()
            if number.table != TURNS and key not in kept:
                found = row_of(base, number, factor, found)
            if arguments.points is not None and key not in kept:
                with arguments.points.open("a") as file:
                    file.write(json.dumps({"key": key, "row": found}) + "\n")
            if number.table == TURNS:
                turning.append((f"`{number.name}`", factor, Turned(*(tuple(each) for each in found))))
            else:
                rows.append(found)
            print(f"\r{place} of {len(waiting)}", end="", file=sys.stderr, flush=True)
    print(file=sys.stderr)
    shown = [each for each in turning if each[1] == 1.0 or _rounded(each[2]) != _rounded(still)]
    command = "python benchmarks/sensitivity.py " + " ".join(sys.argv[1:])
    if arguments.json:
        print(json.dumps({"base": base, "rows": rows, "turns": turning}))
        return
    record = record_of(base, rows, turned_rows(shown), arguments.date, command.strip())
    if arguments.out is not None:
        arguments.out.write_text(record, encoding="utf-8")
    else:
        print(record)


if __name__ == "__main__":
    np.seterr(all="raise", under="ignore")
    main()
