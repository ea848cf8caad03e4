"""Two runs side by side: how well each was steered, as a table and as a page."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from autopilot import __version__
from autopilot.angles import wrap
from autopilot.report.page import Line, Opening, Panel, Section, render, time_figure
from autopilot.report.steered import Steered, Verdict
from autopilot.signals import Mode, OrderKind, Tick

POINTS_MOST = 4000
NEARLY = 0.1
"""Figures that differ by less than this share are called alike."""


class RunOf(NamedTuple):
    """A run: the log's name, its ticks, and how well it was steered."""

    name: str
    ticks: Sequence[Tick]
    steered: Steered


def run_of(name: str, ticks: Sequence[Tick]) -> RunOf:
    """Return a run with its measures."""
    steered = Steered()
    for tick in ticks:
        steered(tick)
    return RunOf(name, ticks, steered)


def measures_of_run(run: RunOf) -> dict[str, float | int | None]:
    """Return the measures by name, the unit in each key; None for what is not known."""
    found = run.steered
    largest = max(found.turns, key=lambda turn: abs(turn.angle), default=None)
    values: dict[str, float | int] = {
        "engaged_s": found.seconds,
        "on_course_s": found.on_course,
        "heading_rms_deg": found.rms_deg,
        "heading_off_95_percent_deg": found.off_deg,
        "rudder_travel_deg_s": found.travel_deg_s,
        "turns": len(found.turns),
        "worst_past_deg": found.past_deg,
        "largest_turn_deg": math.nan if largest is None else abs(math.degrees(largest.angle)),
        "largest_turn_settled_s": math.nan if largest is None else largest.settled,
        "steering_lost": found.lost,
    }
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


ROWS = (
    ("engaged_s", "engaged", "s", 0),
    ("on_course_s", "on a course, out of turns", "s", 0),
    ("heading_rms_deg", "off the planned course, rms", "deg", 2),
    ("heading_off_95_percent_deg", "off the course, 95 % of the time", "deg", 1),
    ("rudder_travel_deg_s", "travel of the ordered rudder", "deg/s", 2),
    ("turns", "turns", "", 0),
    ("worst_past_deg", "worst past the course", "deg", 1),
    ("largest_turn_deg", "largest turn", "deg", 0),
    ("largest_turn_settled_s", "its settling to 3 deg", "s", 1),
    ("steering_lost", "steering lost", "times", 0),
)


def table_of_runs(first: RunOf, second: RunOf) -> list[tuple[str, ...]]:
    """Return both runs' measures and the second's as a share of the first's, the heads first."""
    one, other = measures_of_run(first), measures_of_run(second)
    table: list[tuple[str, ...]] = [("", first.name, second.name, "second of first")]
    for key, words, unit, digits in ROWS:
        left, right = one[key], other[key]
        share = f"{100.0 * right / left:.0f} %" if left and right is not None and unit not in ("", "times") else ""
        table.append((words, _cell(left, digits, unit), _cell(right, digits, unit), share))
    return table


def _cell(value: float | None, digits: int, unit: str) -> str:
    return "-" if value is None else f"{value:.{digits}f} {unit}".rstrip()


def compared(first: RunOf, second: RunOf) -> Verdict:
    """Return which run was steered better: by the course that was held and by the rudder that it took."""
    pairs = [
        (words, getattr(first.steered, name), getattr(second.steered, name))
        for name, words in (("rms_deg", "course"), ("travel_deg_s", "rudder"))
    ]
    if any(math.isnan(value) or value == 0.0 for _, *values in pairs for value in values):
        return Verdict("not enough", "not enough: a course must be held in both runs")
    said, better = [], []
    for words, left, right in pairs:
        share = right / left
        how = "alike" if abs(share - 1.0) < NEARLY else f"{share:.2f} times"
        better.append(0 if abs(share - 1.0) < NEARLY else 1 if share < 1.0 else -1)
        said.append(f"{'off the course' if words == 'course' else 'rudder travel'} {how}")
    lost = first.steered.lost - second.steered.lost
    sums = sum(better) + (2 * lost)
    if min(better) < 0 < max(better) and not lost:
        grade, what = "traded", "traded: one holds the course better, the other spares the rudder"
    elif sums == 0:
        grade, what = "alike", "alike"
    else:
        grade = "better" if sums > 0 else "worse"
        what = f"the second run is {grade}"
    return Verdict(grade, f"{what}; second against first: {', '.join(said)}. Seas differ: compare runs of one day.")


def document_of_runs(first: RunOf, second: RunOf) -> dict[str, Any]:
    """Return the comparison for programs."""
    return {
        "verdict": compared(first, second)._asdict(),
        "runs": [
            {"log": run.name, "verdict": run.steered.verdict and run.steered.verdict._asdict(), **measures_of_run(run)}
            for run in (first, second)
        ],
    }


def comparison_page(first: RunOf, second: RunOf, command: str) -> str:
    """Return the page: how far each was off and its rudder over time, the verdict, then the table."""
    runs = (first, second)
    offs = [_line(run, "off") for run in runs]
    rudders = [_line(run, "rudder") for run in runs]
    figure = time_figure([Panel("off the course [deg]", offs), Panel("rudder ordered [deg]", rudders)])
    sections = [
        Section("Measures", table_of_runs(first, second)),
        Section(
            "Each run by itself",
            text=tuple(f"{run.name}: {run.steered.verdict.sentence}" for run in runs if run.steered.verdict),
        ),
    ]
    hero = Section("", figure=figure, caption="time since each run engaged; starboard positive")
    lead = "The same measures on both logs: how well a course was held, how turns ended, and what the rudder did."
    opening = Opening("Two runs compared", lead, hero, compared(first, second))
    return render(opening, sections, command, __version__)


def _line(run: RunOf, what: str) -> Line:
    engaged = [tick for tick in run.ticks if tick.mode is Mode.ENGAGED and tick.order.kind is OrderKind.HEADING]
    shown = engaged[:: max(1, len(engaged) // POINTS_MOST)]
    begun = shown[0].now if shown else 0.0
    values = [
        wrap(tick.state.heading - tick.reference.heading) if what == "off" else tick.command.angle for tick in shown
    ]
    return Line(run.name, np.array([tick.now - begun for tick in shown]), np.degrees(values))
