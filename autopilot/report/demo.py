"""What the demo found, as tables for the terminal, figures and report.html."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from autopilot import __version__
from autopilot.files.printable import aligned
from autopilot.files.saving import save_text
from autopilot.report.page import Line, Opening, Panel, Section, render, time_figure
from autopilot.report.steered import GOOD_PAST_DEG, Verdict
from autopilot.signals import Tick

SHOWN_HOLD = 60.0
WELL_FOUND = 0.15
"""K and T this near the simulated boat's, relative, are well found: it also drifts and loses speed in turns."""


class DemoFigures(NamedTuple):
    """The ticks to draw: the trial, turns and holds by name."""

    trial: Sequence[Tick]
    turns: dict[str, Sequence[Tick]]
    holds: dict[str, Sequence[Tick]]


def write_demo_report(out: Path, shown: DemoFigures, summary: dict[str, Any]) -> None:
    """Write trial.svg, turn.svg, hold.svg and report.html into the folder `out`."""
    figures = {
        "trial": _trial(shown.trial),
        "turn": _compared(shown.turns, math.inf),
        "hold": _compared(shown.holds, SHOWN_HOLD),
    }
    for name, svg in figures.items():
        save_text(out / f"{name}.svg", svg)
    lead = (
        "A simulated boat sailed a trial over real links; its model was identified from the log, gains were designed "
        "from it, and it steered: over UDP as a MAVLink vehicle, and over a serial line as compass and rudder drive."
    )
    hero = Section("", figure=figures["turn"], caption="a turn of 90 deg in calm water: heading, and rudder ordered")
    page = render(
        Opening("Norrbin demo: from a sea trial to an autopilot", lead, hero, verdict_of_demo(summary)),
        _sections(figures, summary),
        f"autopilot demo --seed {summary['seed']}",
        __version__,
    )
    save_text(out / "report.html", page)


Rows = list[tuple[str, ...]]


def tables_of(summary: dict[str, Any]) -> tuple[Rows, Rows, Rows]:
    """Return what was identified, the turns and the holds as tables, their heads first."""
    parameters: Rows = [("identified", "unit", "true", "found", "standard error", "off by")]
    for name, row in summary["parameters"].items():
        error = "-" if row["std"] is None else f"{row['std']:.4f}"
        off = f"{100.0 * (row['identified'] / row['true'] - 1.0):+.1f} %" if row["true"] else "-"
        parameters.append((name, row["unit"], f"{row['true']:.4f}", f"{row['identified']:z.4f}", error, off))
    turns: Rows = [("turn of 90 deg, calm", "overshoot", "settling to 1 deg", "rudder travel")]
    for name, row in summary["turn_90_deg_calm"].items():
        settling = "never" if row["settling_s"] is None else f"{row['settling_s']:.1f} s"
        turns.append((name, f"{row['overshoot_deg']:.2f} deg", settling, f"{row['rudder_travel_deg']:.1f} deg"))
    holds: Rows = [("hold, sea state 5", "true heading rms", "rudder travel")]
    for name, row in summary["hold_sea_state_5"].items():
        holds.append((name, f"{row['heading_rms_deg']:.2f} deg", f"{row['rudder_travel_deg_s']:.2f} deg/s"))
    return parameters, turns, holds


def verdict_of_demo(summary: dict[str, Any]) -> Verdict:
    """Return how near the identified model is, and how the first of the turns and of the holds went with it."""
    off = max(
        abs(summary["parameters"][name]["identified"] / summary["parameters"][name]["true"] - 1.0)
        for name in ("K", "T")
    )
    turn = next(iter(summary["turn_90_deg_calm"].values()))
    hold = next(iter(summary["hold_sea_state_5"].values()))
    settled = turn["settling_s"]
    said = (
        f"K and T found within {max(math.ceil(100.0 * off), 1)} %; a turn of 90 deg "
        f"{'does not settle' if settled is None else f'in {settled:.0f} s'}, {turn['overshoot_deg']:.1f} deg past the "
        f"course; held within {hold['heading_rms_deg']:.1f} deg rms in sea state 5"
    )
    is_good = off <= WELL_FOUND and settled is not None and turn["overshoot_deg"] <= GOOD_PAST_DEG
    return Verdict("good", f"good: {said}") if is_good else Verdict("fair", f"fair: {said}")


def as_text(summary: dict[str, Any]) -> str:
    """Return the tables for a terminal."""
    parameters, turns, holds = (aligned(rows, right=range(1, len(rows[0]))) for rows in tables_of(summary))
    delay, said = summary["rudder_delay_s"], [*summary["unidentifiable"].values(), summary["model_form"]]
    if delay > 0.0:
        said.insert(
            0,
            f"rudder's delay {delay:.3f} s +- {summary['rudder_delay_std_s'] or 0.0:.3f} s: orders on their way, at "
            "four times the pace",
        )
    verdict = verdict_of_demo(summary).sentence
    return "\n".join([verdict, "", *parameters, *(f"  {sentence}" for sentence in said), "", *turns, "", *holds])


def _sections(figures: dict[str, str], summary: dict[str, Any]) -> list[Section]:
    parameters, turns, holds = tables_of(summary)
    note = (
        "Standard errors tell what sensor noise and sea leave open. The simulated boat also loses speed and drifts in "
        "turns, which the model leaves out: the difference to the true values holds that too.",
    )
    return [
        Section("Identified from the trial", parameters, (*summary["unidentifiable"].values(), *note)),
        Section("The trial", figure=figures["trial"], caption="15/15 zigzag, then turns at eight rudder angles"),
        Section("Turn of 90 deg in calm water", turns),
        Section(
            "Hold in sea state 5",
            holds,
            ("The PID has the same proportional and rate gains, and an integral term.",),
            figures["hold"],
            f"the last {SHOWN_HOLD:.0f} s",
        ),
    ]


def _trial(ticks: Sequence[Tick]) -> str:
    time = np.array([tick.now for tick in ticks])
    return time_figure(
        [
            Panel("heading [deg]", [Line("heading", time, _unwrapped_deg([tick.state.heading for tick in ticks]))]),
            Panel("rate [deg/s]", [Line("yaw rate", time, np.degrees([tick.state.rate for tick in ticks]))]),
            Panel("rudder [deg]", [Line("rudder", time, np.degrees([tick.state.rudder for tick in ticks]))]),
        ]
    )


def _compared(legs: dict[str, Sequence[Tick]], last: float) -> str:
    headings: list[Line] = []
    rudders: list[Line] = []
    for name, ticks in legs.items():
        end = ticks[-1].now
        part = [tick for tick in ticks if end - tick.now <= last and tick.command.engaged]
        time = np.array([tick.now for tick in part]) - part[0].now
        if not headings:
            wanted = _unwrapped_deg([tick.reference.heading for tick in part])
            headings.append(Line("reference", time, wanted, wanted=True))
        headings.append(Line(name, time, _unwrapped_deg([tick.state.heading for tick in part])))
        rudders.append(Line(name, time, np.degrees([tick.command.angle for tick in part])))
    return time_figure([Panel("heading [deg]", headings), Panel("rudder [deg]", rudders)])


def _unwrapped_deg(headings: Sequence[float]) -> np.ndarray[Any, np.dtype[np.float64]]:
    return np.degrees(np.unwrap(np.asarray(headings)))
