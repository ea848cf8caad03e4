"""The fault matrix: every fault in every state, what the pilot did about it, and whether that is what it must do.

    python benchmarks/fault_matrix.py --out docs/fault_matrix.md
    python benchmarks/fault_matrix.py --rows "rudder" --states heading,turn

The real links carry real bytes over in-memory lines, on one simulated clock; the same every time. Exit code 1 where a
cell is not as `fault_expectations` wants it.
"""

from __future__ import annotations

import argparse
import os
import pickle
import re
import sys
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
    for cell in run_cells(rows, states, arguments.workers):
        cells[cell.row, cell.state] = cell
        complaint = "; ".join(complaints(cell))
        print(f"{'WRONG' if complaint else 'ok':5} {cell.row} | {cell.state} | {short(cell)} | {complaint}", flush=True)
        if arguments.cells is not None:
            arguments.cells.write_bytes(pickle.dumps(cells))
    wrong = sum(bool(list(complaints(cell))) for cell in cells.values())
    print(f"{len(cells)} cells, {wrong} not as expected")
    if arguments.out is not None:
        names = [row.name for row in ROWS if any((row.name, state) in cells for state in STATES)]
        states = [state for state in STATES if any((name, state) in cells for name in names)]
        parts = (summary(cells, wrong), first_table(names, cells), second_table(names, states, cells))
        put(arguments.out, "\n\n".join(parts))
    return int(wrong > 0)


def kept(place: Path | None) -> dict[tuple[str, str], Cell]:
    """Return the cells of runs before."""
    if place is None or not place.exists():
        return {}
    cells: dict[tuple[str, str], Cell] = pickle.loads(place.read_bytes())
    return cells


def short(cell: Cell) -> str:
    """Return a cell in a few words: when it was seen, what was done, how far she was off."""
    seen = "" if cell.detected is None else f"{cell.detected:.1f} s: "
    return f"{seen}{action(cell)}, {cell.off_deg:.0f}°" if steered(cell) else f"{seen}{action(cell)}"


def steered(cell: Cell) -> bool:
    """Return whether the pilot steered when the fault began."""
    return cell.state not in ("standby", "override", "fail-safe")


def action(cell: Cell) -> str:
    """Return what the pilot did, in words."""
    through = [WORDS.get(state, state) for state in cell.passed]
    last = through[-1]
    if last == "steers" and "degraded" in through:
        return "degraded for a time"
    return last if last in ("steers", "degraded", "standby") else f"{last}, rudder {cell.rudder}"


def summary(cells: dict[tuple[str, str], Cell], wrong: int) -> str:
    """Return the sentence on top."""
    faults, states = len({row for row, _ in cells}), len({state for _, state in cells})
    verdict = f"{wrong} not as expected, marked **!**" if wrong else "each as expected"
    return f"{faults} rows in {states} states, {len(cells)} cells: {verdict}."


def first_table(names: list[str], cells: dict[tuple[str, str], Cell]) -> str:
    """Return the table of what happens where a heading is being held."""
    lines = [
        "## While a heading is held",
        "",
        "| Fault | Seen after | Limit | What the pilot does | Alarm | Off her course | Limit | Engages again |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for name in names:
        cell = cells.get((name, "heading"))
        if cell is None:
            continue
        wanted = expected(cell)
        seen = "" if cell.detected is None else f"{cell.detected:.1f} s"
        limit = f"{wanted.within:g} s" if wanted.within < 1e6 else ""
        alarm = cell.alarms[0].split(":")[0] if cell.alarms else ""
        mark = " **!**" if list(complaints(cell)) else ""
        off = (f"{cell.off_deg:.1f}°", f"{wanted.off_deg:g}°")
        again = "yes" if cell.again else "no"
        lines.append(f"| {' | '.join((name + mark, seen, limit, action(cell), alarm, *off, again))} |")
    return "\n".join(lines)


def second_table(names: list[str], states: list[str], cells: dict[tuple[str, str], Cell]) -> str:
    """Return the table of every state."""
    others = [state for state in states if state != "heading"]
    lines = ["## In the other states", "", f"| Fault | {' | '.join(others)} |", "|---" * (len(others) + 1) + "|"]
    for name in names:
        found = [cells.get((name, state)) for state in others]
        texts = ["" if cell is None else short(cell) + " **!**" * bool(list(complaints(cell))) for cell in found]
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
