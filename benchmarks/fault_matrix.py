"""The fault matrix: every fault in every state, what the pilot did about it, and whether that is what it must do.

    python benchmarks/fault_matrix.py --out docs/fault_matrix.md
    python benchmarks/fault_matrix.py --rows "rudder" --states heading,turn --seeds 2

The real links carry real bytes over in-memory lines, on one simulated clock; the same every time. Each cell is run with
several seeds of sea and noise, all of which are judged. Exit code 1 where one is not as `fault_expectations` wants it.
"""

from __future__ import annotations

import argparse
import os
import pickle
import re
import sys
from collections import Counter
from pathlib import Path

from fault_boat import STATES
from fault_cells import Cell, run_cells
from fault_expectations import complaints, expected
from fault_rows import ROWS

BEGIN, END = "<!-- matrix: begin -->", "<!-- matrix: end -->"
WORDS = {"failsafe": "fail-safe", "heading": "steers", "track": "steers", "trial": "steers", "turn": "steers"}


def main() -> int:
    """Run the cells asked for; print those that are wrong, or write the page."""
    options = argparse.ArgumentParser()
    options.add_argument("--rows", default="", help="only faults whose name holds this regular expression")
    options.add_argument("--states", default=",".join(STATES), help=f"only these of {','.join(STATES)}")
    options.add_argument("--seeds", type=int, default=5, help="so many seas and noises for every cell")
    options.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    options.add_argument(
        "--cells", type=Path, help="keep the cells here, and take those that are not asked for from it"
    )
    options.add_argument("--out", type=Path, help="put the tables into this page, between its marks")
    arguments = options.parse_args()
    states = arguments.states.split(",")
    if unknown := set(states) - set(STATES):
        options.error(f"--states {', '.join(sorted(unknown))}: allowed are {', '.join(STATES)}")
    rows = [row for row in ROWS if re.search(arguments.rows, row.name)]
    cells = kept(arguments.cells)
    for seed in range(1, arguments.seeds + 1):
        for cell in run_cells(rows, states, arguments.workers, seed):
            cells.setdefault((cell.row, cell.state), {})[seed] = cell
            complaint = "; ".join(complaints(cell))
            verdict = "WRONG" if complaint else "ok"
            print(f"{verdict:5} {seed} {cell.row} | {cell.state} | {short([cell])} | {complaint}", flush=True)
        if arguments.cells is not None:
            arguments.cells.write_bytes(pickle.dumps(cells))
    found = {key: list(runs.values()) for key, runs in cells.items()}
    wrong = sum(map(is_wrong, found.values()))
    print(f"{len(found)} cells with {arguments.seeds} seeds, {wrong} not as expected")
    if arguments.out is not None:
        names = [row.name for row in ROWS if any((row.name, state) in found for state in STATES)]
        states = [state for state in STATES if any((name, state) in found for name in names)]
        parts = (summary(found, wrong), first_table(names, found), second_table(names, states, found))
        put(arguments.out, "\n\n".join(parts))
    return int(wrong > 0)


def kept(place: Path | None) -> dict[tuple[str, str], dict[int, Cell]]:
    """Return the cells of runs before, by row, state and seed."""
    if place is None or not place.exists():
        return {}
    cells: dict[tuple[str, str], dict[int, Cell]] = pickle.loads(place.read_bytes())
    return cells


def is_wrong(runs: list[Cell]) -> bool:
    """Return whether a run of the cell is not as expected."""
    return any(list(complaints(cell)) for cell in runs)


def short(runs: list[Cell]) -> str:
    """Return a cell in a few words: when it was seen, what was done, how far she was off."""
    seen = f"{when(runs)}: " if when(runs) else ""
    return f"{seen}{action(runs)}, {off(runs):.0f}°" if steered(runs[0]) else f"{seen}{action(runs)}"


def when(runs: list[Cell]) -> str:
    """Return after how long it was seen, from the soonest to the latest, and whether always."""
    times = sorted(cell.detected for cell in runs if cell.detected is not None)
    if not times:
        return ""
    first, last = f"{times[0]:.1f}", f"{times[-1]:.1f}"
    span = f"{last} s" if first == last else f"{first} to {last} s"
    return span if len(times) == len(runs) else f"{span}, or not"


def off(runs: list[Cell]) -> float:
    """Return how far she was off at most [deg]."""
    return max(cell.off_deg for cell in runs)


def steered(cell: Cell) -> bool:
    """Return whether the pilot steered when the fault began."""
    return cell.state not in ("standby", "override", "fail-safe")


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


def summary(cells: dict[tuple[str, str], list[Cell]], wrong: int) -> str:
    """Return the sentence on top."""
    faults, states = len({row for row, _ in cells}), len({state for _, state in cells})
    seeds = max(map(len, cells.values()))
    verdict = f"{wrong} not as expected, marked **!**" if wrong else "each as expected with each seed"
    return f"{faults} rows in {states} states, {len(cells)} cells with {seeds} seeds: {verdict}."


def first_table(names: list[str], cells: dict[tuple[str, str], list[Cell]]) -> str:
    """Return the table of what happens where a heading is being held."""
    lines = [
        "## While a heading is held",
        "",
        "| Fault | Seen after | Limit | What the pilot does | Alarm | Off her course | Limit | Engages again |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in names:
        runs = cells.get((name, "heading"))
        if runs is None:
            continue
        wanted = expected(runs[0])
        limit = f"{wanted.within:g} s" if wanted.within < 1e6 else ""
        alarm = next((cell.alarms[0].split(":")[0] for cell in runs if cell.alarms), "")
        mark = " **!**" if is_wrong(runs) else ""
        turned = (f"{off(runs):.1f}°", f"{wanted.off_deg:g}°")
        again = "yes" if all(cell.again for cell in runs) else "no"
        lines.append(f"| {' | '.join((name + mark, when(runs), limit, action(runs), alarm, *turned, again))} |")
    return "\n".join(lines)


def second_table(names: list[str], states: list[str], cells: dict[tuple[str, str], list[Cell]]) -> str:
    """Return the table of every state."""
    others = [state for state in states if state != "heading"]
    lines = ["## In the other states", "", f"| Fault | {' | '.join(others)} |", "|---" * (len(others) + 1) + "|"]
    for name in names:
        found = [cells.get((name, state), []) for state in others]
        texts = [short(runs) + " **!**" * is_wrong(runs) if runs else "" for runs in found]
        lines.append(f"| {name} | {' | '.join(texts)} |")
    return "\n".join(lines)


def put(page: Path, tables: str) -> None:
    """Put the tables between the marks of a page."""
    text = page.read_text(encoding="utf-8")
    before, rest = text.split(BEGIN)
    _, after = rest.split(END)
    page.write_text(f"{before}{BEGIN}\n{tables}\n{END}{after}", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
