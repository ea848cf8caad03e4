"""What an endurance run has read of itself: figures of memory and descriptors, their slopes, and the page of a run."""

from __future__ import annotations

import math
import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from autopilot.report.page import Line, Opening, Panel, Section, plane_figure, render, time_figure

PAGE_KB = os.sysconf("SC_PAGE_SIZE") / 1024.0
ROWS = 9
FIGURES = (
    ("resident_kb", "resident memory [kB]", "kB"),
    ("blocks", "Python memory blocks", "blocks"),
    ("descriptors", "file descriptors", "descriptors"),
)


class Reading(NamedTuple):
    """After `hours`: resident memory [kB], live Python memory blocks (nan: not to be had), open file descriptors."""

    hours: float
    resident_kb: float
    blocks: float
    descriptors: float


def reading_of(hours: float, pid: str = "self", blocks: float = math.nan) -> Reading:
    """Return how a process stands."""
    resident = int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * PAGE_KB
    return Reading(hours, resident, blocks, len(list(Path(f"/proc/{pid}/fd").iterdir())))


def slope(readings: Sequence[Reading], name: str) -> tuple[float, float]:
    """Return the slope per hour of one figure over the second half, and its standard error; nan of too few."""
    half = readings[len(readings) // 2 :]
    x, y = (np.array([getattr(each, field) for each in half]) for field in ("hours", name))
    if len(half) < 3:
        return math.nan, math.nan
    deviation = x - x.mean()
    found = float(deviation @ y / (deviation @ deviation))
    residual = y - y.mean() - found * deviation
    return found, float(np.sqrt(residual @ residual / (len(x) - 2) / (deviation @ deviation)))


def slopes(readings: Sequence[Reading]) -> list[str]:
    """Return a line for each figure that was read."""
    lines = []
    for name, _, unit in FIGURES:
        found, error = slope(readings, name)
        if not math.isnan(found):
            lines.append(f"slope of {name:12s} {found:+.3f} +- {error:.3f} {unit} an hour, second half")
    return lines


def rows(readings: Sequence[Reading]) -> list[tuple[str, ...]]:
    """Return the heads and some of the readings."""
    chosen = readings[:: max(1, len(readings) // (ROWS - 1))]
    found = [tuple(f"{value:.{2 if place == 0 else 0}f}" for place, value in enumerate(each)) for each in chosen]
    return [("hours", "resident kB", "Python blocks", "descriptors"), *found]


def print_table(readings: Sequence[Reading]) -> None:
    """Print some of the readings and the slopes."""
    for row in rows(readings):
        print("".join(f"{cell:>15s}" for cell in row))
    for line in slopes(readings):
        print(line)


def page(
    title: str, facts: Sequence[str], readings: Sequence[Reading], gaps: np.ndarray[Any, Any] | None = None
) -> str:
    """Return the page of a run: what is known of it, its readings, and how far apart [s] its ticks were."""
    hours = np.array([each.hours for each in readings])
    panels = []
    for name, label, _ in FIGURES:
        values = np.array([getattr(each, name) for each in readings])
        if not np.isnan(values).all():
            panels.append(Panel(label, [Line(label.partition(" [")[0], hours, values)]))
    figure = time_figure(panels, "time [h]")
    sections = [
        Section("What was run, and what came of it", text=facts),
        Section(
            "Memory and file descriptors", rows(readings), slopes(readings), figure, "one reading every few minutes"
        ),
    ]
    if gaps is not None and len(gaps):
        share = np.arange(len(gaps), 0, -1) / len(gaps)
        panel = Panel("share of ticks [%]", [Line("later than this", 1e3 * np.sort(gaps), 100.0 * share)])
        drawn = plane_figure(panel, "time since the tick before [ms]")
        sections.append(
            Section("How late ticks came", figure=drawn, caption="the share that came later than the abscissa")
        )
    command = shlex.join(["python", "benchmarks/endurance.py", *sys.argv[1:]])
    lead = "Does memory stay, do descriptors, and does the loop keep time?"
    return render(Opening(title, lead), sections, command)
