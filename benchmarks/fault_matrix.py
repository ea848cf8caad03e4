"""The fault matrix: every fault in every state, what the pilot did about it, and whether that is what it must do.

    python benchmarks/fault_matrix.py                                  # seas and noises of today's date
    python benchmarks/fault_matrix.py --rows "rudder" --states heading,turn --seeds 2
    python benchmarks/fault_matrix.py --date 2026-11-22 --out benchmarks/results/fault_matrix.md

The real links carry real bytes over in-memory lines, on one simulated clock; the same every time for a date. Each cell
is run with several seeds of sea and noise, all of which are judged. Exit code 1 where one is not as
`fault_expectations` wants it.
"""

from __future__ import annotations

import argparse
import datetime
import json
import math
import os
import pickle
import re
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from fault_boat import STATES
from fault_cells import ROWS, Cell, has_cell, run_cells
from fault_expectations import ENGAGED, Expect, complaints, expected

from autopilot.cli.terminal import ProgressBar

BEGIN, END = "<!-- matrix: begin -->", "<!-- matrix: end -->"
WORDS = {"failsafe": "fail-safe", "heading": "steers", "track": "steers", "trial": "steers", "turn": "steers"}

Runs = dict[tuple[str, str], dict[int, Cell]]
"""The cells by row and state, then by seed."""


def main() -> int:
    """Run the cells asked for; print those that have failed, or write the page."""
    options = argparse.ArgumentParser(description="Judge what the pilot does about every fault in every state.")
    options.add_argument("--rows", default="", help="only faults whose name holds this regular expression")
    options.add_argument("--states", default=",".join(STATES), help=f"only these of {','.join(STATES)}")
    options.add_argument("--seeds", type=int, default=5, help="so many seas and noises for every cell (default 5)")
    today = datetime.datetime.now(datetime.UTC).date()
    options.add_argument(
        "--date",
        type=datetime.date.fromisoformat,
        default=today,
        help="the day from which the seeds are drawn, such as 2026-11-22 (default today, UTC)",
    )
    options.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options.add_argument("--cells", type=Path, help="keep the cells here, and take from it what is not asked for")
    options.add_argument("--out", type=Path, help="put the tables into this page, between its marks")
    options.add_argument("--json", action="store_true", help="print JSON, with every run of every cell")
    arguments = options.parse_args()
    states = arguments.states.split(",")
    if unknown := set(states) - set(STATES):
        options.error(f"--states {', '.join(sorted(unknown))}: allowed are {', '.join(STATES)}")
    if arguments.seeds < 1:
        options.error(f"--seeds {arguments.seeds}: allowed are 1 and more")
    day = arguments.date.isoformat()
    runs = kept(arguments.cells, day)
    rows = [row for row in ROWS if re.search(arguments.rows, row.name)]
    total = arguments.seeds * sum(has_cell(row, state) for row in rows for state in states)
    done = 0
    with ProgressBar(f"fault matrix of {day}") as bar:
        for seed in seeds_of(arguments.date, arguments.seeds):
            bar.update(done, total)
            for cell in run_cells(rows, states, arguments.workers, seed):
                runs.setdefault((cell.row, cell.state), {})[seed] = cell
                done += 1
                bar.update(done, total)
            if arguments.cells is not None:
                arguments.cells.write_bytes(pickle.dumps((day, runs)))
    found = {key: list(by_seed.values()) for key, by_seed in runs.items()}
    failed = {key: cells for key, cells in found.items() if has_failed(cells)}
    if arguments.json:
        print(json.dumps(report(day, runs), indent=1))
    else:
        for (row, state), cells in failed.items():
            print(f"FAILED {row} | {state} | {short(cells)} | {verdict(cells)}")
        print(summary(day, found))
    if arguments.out is not None:
        names = [row.name for row in ROWS if any((row.name, state) in found for state in STATES)]
        states = [state for state in STATES if any((name, state) in found for name in names)]
        parts = (summary(day, found), failed_table(failed), first_table(names, found))
        put(arguments.out, "\n\n".join((*parts, second_table(names, states, found))))
    return int(bool(failed))


def seeds_of(day: datetime.date, count: int) -> list[int]:
    """Return so many seeds drawn from a date: the same for the same date, and those of fewer are the first of more."""
    return [int(seed) for seed in np.random.SeedSequence(int(f"{day:%Y%m%d}")).generate_state(count)]


def kept(place: Path | None, day: str) -> Runs:
    """Return the cells of runs before, of the same date."""
    if place is None or not place.exists():
        return {}
    before: str
    runs: Runs
    before, runs = pickle.loads(place.read_bytes())
    return runs if before == day else {}


def has_failed(runs: list[Cell]) -> bool:
    """Return whether a run of the cell is not as wanted."""
    return any(list(complaints(cell)) for cell in runs)


def verdict(runs: list[Cell]) -> str:
    """Return in how many runs a cell has failed, and the figures of the worst of them."""
    failed = [(list(complaints(cell)), cell) for cell in runs]
    failed = [(said, cell) for said, cell in failed if said]
    worst, _ = max(failed, key=lambda each: (each[1].off_deg, len(each[0])))
    return f"{len(failed)} of {len(runs)}: {'; '.join(worst)}"


def short(runs: list[Cell]) -> str:
    """Return a cell in a few words: when it was noticed, what was done, how far the boat was off."""
    seen = f"{when(runs)}: " if when(runs) else ""
    return f"{seen}{action(runs)}, {off(runs):.0f}°" if steered(runs[0]) else f"{seen}{action(runs)}"


def when(runs: list[Cell]) -> str:
    """Return after how long it was noticed, from the soonest to the latest, and whether always."""
    times = sorted(cell.detected for cell in runs if cell.detected is not None)
    if not times:
        return ""
    first, last = f"{times[0]:.1f}", f"{times[-1]:.1f}"
    span = f"{last} s" if first == last else f"{first} to {last} s"
    return span if len(times) == len(runs) else f"{span}, or not"


def off(runs: list[Cell]) -> float:
    """Return how far the boat was off at most [deg]."""
    return max(cell.off_deg for cell in runs)


def steered(cell: Cell) -> bool:
    """Return whether the pilot steered when the fault began."""
    return cell.state in ENGAGED


def action(runs: list[Cell]) -> str:
    """Return what the pilot did, in words, the most frequent first."""
    done = Counter(map(deed, runs))
    return " or ".join(name for name, _ in done.most_common())


def deed(cell: Cell) -> str:
    """Return what the pilot did in one run."""
    through = [WORDS.get(state, state) for state in cell.passed]
    last = through[-1]
    if last == "steers" and "degraded" in through:
        return "degraded for a time"
    return last if last in ("steers", "degraded", "standby") else f"{last}, rudder {cell.rudder}"


def summary(day: str, cells: dict[tuple[str, str], list[Cell]]) -> str:
    """Return the sentence on top."""
    faults, states = len({row for row, _ in cells}), len({state for _, state in cells})
    seeds = max(map(len, cells.values()), default=0)
    failed = sum(map(has_failed, cells.values()))
    return (
        f"{faults} faults in {states} states, {len(cells)} cells with {seeds} seeds drawn from {day}: "
        f"{failed or 'none'} failed."
    )


def failed_table(failed: dict[tuple[str, str], list[Cell]]) -> str:
    """Return the list of the cells that have failed."""
    head = "## Failed cells"
    if not failed:
        return f"{head}\n\nNone."
    lines = [head, "", "| Fault | State | Runs that failed, and the worst of them |", "|---|---|---|"]
    order = {row.name: number for number, row in enumerate(ROWS)}
    for row, state in sorted(failed, key=lambda key: (order[key[0]], list(STATES).index(key[1]))):
        lines.append(f"| {row} | {state} | {verdict(failed[row, state])} |")
    return "\n".join(lines)


def first_table(names: list[str], cells: dict[tuple[str, str], list[Cell]]) -> str:
    """Return the table of what happens where a heading is being held."""
    lines = [
        "## While a heading is held",
        "",
        "| Fault | Noticed after | Off by then | Limit | What the pilot does | Alarm | Most off | Limit | Engages |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name in names:
        runs = cells.get((name, "heading"))
        if runs is None:
            continue
        wanted = expected(runs[0])
        alarm = next((cell.alarms[0].split(":")[0] for cell in runs if cell.alarms), "")
        mark = " **failed**" if has_failed(runs) else ""
        unnoticed = f"{max(cell.unnoticed_deg for cell in runs):.1f}°"
        most = "" if wanted.off_until_noticed else f"{wanted.off_deg:g}°"
        again = "yes" if all(cell.again for cell in runs) else "no"
        texts = (name + mark, when(runs), unnoticed, limit(wanted), action(runs), alarm, f"{off(runs):.1f}°", most)
        lines.append(f"| {' | '.join((*texts, again))} |")
    return "\n".join(lines)


def limit(wanted: Expect) -> str:
    """Return by when it must be noticed, in words."""
    if wanted.soon:
        return f"{wanted.soon:g} s or {wanted.unnoticed_deg:g}°"
    seconds = f"{wanted.within:g} s, " if wanted.within < math.inf else ""
    return f"{seconds}{wanted.unnoticed_deg:g}°"


def second_table(names: list[str], states: list[str], cells: dict[tuple[str, str], list[Cell]]) -> str:
    """Return the table of every state."""
    others = [state for state in states if state != "heading"]
    lines = ["## In the other states", "", f"| Fault | {' | '.join(others)} |", "|---" * (len(others) + 1) + "|"]
    for name in names:
        found = [cells.get((name, state), []) for state in others]
        texts = [short(runs) + " **failed**" * has_failed(runs) if runs else "" for runs in found]
        lines.append(f"| {name} | {' | '.join(texts)} |")
    return "\n".join(lines)


def report(day: str, runs: Runs) -> dict[str, Any]:
    """Return every run of every cell for `--json`: times in seconds, headings in degrees."""
    cells = [
        {"seed": seed, **cell._asdict(), "complaints": list(complaints(cell))}
        for by_seed in runs.values()
        for seed, cell in by_seed.items()
    ]
    failed = sum(any(list(complaints(cell)) for cell in by_seed.values()) for by_seed in runs.values())
    return {"date": day, "cells": len(runs), "failed": failed, "runs": cells}


def put(page: Path, tables: str) -> None:
    """Put the tables between the marks of a page."""
    text = page.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    page.write_text(f"{before}{BEGIN}\n{tables}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
