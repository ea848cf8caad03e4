"""The gain design's page: margins, the loop's curves, response levels, and the large-signal response."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from autopilot.control.design import DESIGNED, loop
from autopilot.control.margins import trace
from autopilot.report import steered
from autopilot.report.gains import (
    FRONT_SENTENCE,
    LARGE_SIGNAL_DEG,
    UNSCHEDULED,
    Judged,
    chosen,
    front_table,
    loop_of,
    margin_table,
    sentences,
    speed_table,
)
from autopilot.report.page import FloatArray, Line, Opening, Panel, Section, render, time_figure
from autopilot.runtime.build import gear_of, law_of, loop_gains_of, model_of
from autopilot.runtime.tuning import LevelCost
from autopilot.vessel.schema import Vessel

CURVE_POINTS = 300
STEP_DEG = (5.0, 45.0)


def gains_page(
    priced: tuple[Vessel, Sequence[LevelCost], int | None],
    rows: Mapping[str, Judged],
    levels: Mapping[int, Judged],
    verdict: steered.Verdict,
    command: str,
) -> str:
    """Return the page of a vessel: the front that its gains are chosen from, rows of gains, designs by level."""
    name = priced[0].name
    lead = (
        f"Gains for {name}: the loop of boat, rudder and delay about straight running, its margins, and what the very "
        "functions that steer make of errors that saturate the rudder."
    )
    *steps, hero = (_step(rows, degrees) for degrees in STEP_DEG)
    sections = [
        Section("What each level costs", front_table(*priced), (FRONT_SENTENCE,)),
        Section("Margins", margin_table(rows), points=[(name, sentences(each)) for name, each in rows.items()]),
        Section("Open loop", figure=_open_loop(rows), caption="cut at the rudder; at the crossover |L| is 1"),
        Section(
            "Sensitivity", figure=_sensitivity(rows), caption="what the loop makes of disturbances: above 1 it adds"
        ),
        *steps,
        Section(
            "Large-signal response", _large_signal(rows), ("Without a planned turn: in the pilot a turn is planned.",)
        ),
        *(Section(f"By speed: {name}", speed_table(each), (UNSCHEDULED,)) for name, each in chosen(rows).items()),
        Section("Response levels", _levels(levels)),
    ]
    hero = hero._replace(caption=f"{hero.title}: {hero.caption}")
    return render(Opening(f"Gain design: {name}", lead, hero, verdict), sections, command)


def _stable(rows: Mapping[str, Judged]) -> dict[str, Judged]:
    """Return those whose curves mean anything; all of them where none is stable."""
    return {name: each for name, each in rows.items() if each.verdict.margins.stable} or dict(rows)


def _frequencies(rows: Mapping[str, Judged]) -> FloatArray:
    around = [max(each.verdict.margins.crossover, 1.0e-3) for each in rows.values()]
    return np.geomspace(0.02 * min(around), 30.0 * max(around), CURVE_POINTS)


def _values(each: Judged, omegas: FloatArray) -> FloatArray:
    vessel, gear = each.vessel, gear_of(each.vessel)
    gains, delay = loop_gains_of(vessel, each.law), gear.delay + vessel.control.loop_delay_s
    return np.array([loop(model_of(vessel), gear.lag, delay, gains, float(omega)) for omega in omegas])


def _open_loop(rows: Mapping[str, Judged]) -> str:
    chosen = _stable(rows)
    omegas = _frequencies(chosen)
    size, phase = [], []
    for name, each in chosen.items():
        values = _values(each, omegas)
        size.append(Line(name, omegas, 20.0 * np.log10(np.abs(values))))
        phase.append(Line(name, omegas, np.degrees(np.unwrap(np.angle(values)))))
    panels = [Panel("|L| [dB]", size), Panel("phase [deg]", phase)]
    return time_figure(panels, "frequency [rad/s]", logarithmic=True)


def _sensitivity(rows: Mapping[str, Judged]) -> str:
    chosen = _stable(rows)
    omegas = _frequencies(chosen)
    lines = [Line(name, omegas, np.abs(1.0 / (1.0 + _values(each, omegas)))) for name, each in chosen.items()]
    return time_figure([Panel("|1/(1 + L)|", lines)], "frequency [rad/s]", logarithmic=True)


def _step(rows: Mapping[str, Judged], degrees: float) -> Section:
    """A heading error put right, with the real rudder's angle, rate, lag and delay."""
    seconds = 1.3 * max(
        (row.settling for each in rows.values() for row in each.recoveries if math.isfinite(row.settling)), default=30.0
    )
    headings, rudders = [], []
    for name, each in rows.items():
        motion = trace(loop_of(each.vessel), law_of(each.vessel, each.law), math.radians(degrees), seconds)
        time = np.array(motion.time)
        headings.append(Line(name, time, np.degrees(motion.error)))
        rudders.append(Line(name, time, np.degrees(motion.rudder)))
    figure = time_figure([Panel("heading error [deg]", headings), Panel("rudder [deg]", rudders)])
    return Section(f"An error of {degrees:.0f}° put right", figure=figure, caption="the boat starts at rest in yaw")


def _large_signal(rows: Mapping[str, Judged]) -> list[tuple[str, ...]]:
    table: list[tuple[str, ...]] = [
        ("gains", *(f"from {degrees:.0f} deg: past [deg], settled [s]" for degrees in LARGE_SIGNAL_DEG))
    ]
    for name, each in rows.items():
        cells = []
        for row in each.recoveries:
            past = f"{math.degrees(row.overshoot):.1f}° past, {row.settling:.1f} s"
            cells.append(past if row.corrected else f"swings by {math.degrees(row.swing):.1f}°")
        table.append((name, *cells))
    return table


def _levels(levels: Mapping[int, Judged]) -> list[tuple[str, ...]]:
    table: list[tuple[str, ...]] = [
        (
            "level",
            "k1 [1/s]",
            "k2 [1/s]",
            "gamma [1/s²]",
            "smoothing [s]",
            "crossover [rad/s]",
            "worst sensitivity [-]",
            "delay margin [s]",
            "rate saturates from [deg]",
        )
    ]
    for level, each in levels.items():
        gains, found = getattr(each.vessel.control, DESIGNED), each.verdict.margins
        table.append(
            (
                str(level),
                f"{gains.k1_1_s:.3g}",
                f"{gains.k2_1_s:.3g}",
                f"{gains.gamma_1_s2:.3g}",
                f"{gains.smoothing_s:.3g}",
                f"{found.crossover:.3g}",
                f"{found.sensitivity:.2f}",
                f"{found.delay:.2f}",
                f"{math.degrees(found.saturation):.2f}",
            )
        )
    return table
