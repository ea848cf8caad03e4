"""The gains in force and the margins they leave, from a fifth of the trial's speed to one and a half times it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from autopilot.report.gains_judged import Judged, gains_of

if TYPE_CHECKING:
    from autopilot.control.design import Verdict

RATIOS = (0.2, 0.5, 0.75, 1.0, 1.25, 1.5)
UNSCHEDULED = (
    "Until a link brings a speed, the model and the gains of the trial's speed are in force, whatever the boat does."
)
HEAD = ("speed", "K [1/s]", "T [s]", "gain margin", "phase margin", "delay margin")


class AtSpeed(NamedTuple):
    """One speed: share of the trial's and [m/s], K [1/s], T [s], the gains by their keys in the file, and the verdict.

    waits: slower than the steerage, where the rudder waits amidships and no gains are in force.
    """

    ratio: float
    speed: float
    gain: float
    time_constant: float
    gains: dict[str, float]
    verdict: Verdict
    waits: bool


def by_speed(each: Judged) -> list[AtSpeed]:
    """Return the law of `each` at every share of the trial's speed in RATIOS."""
    from autopilot.build import pilot_config, verdict_of
    from autopilot.build_laws import gains_in_force, model_of
    from autopilot.models.norrbin import at_speed_ratio

    present = gains_in_force(each.vessel, each.law)
    steerage = pilot_config(each.vessel, each.law).steerage
    found = []
    for ratio in RATIOS:
        model = at_speed_ratio(model_of(each.vessel), ratio)
        scaled = gains_in_force(each.vessel, each.law, ratio)
        # in the units of the file
        shares = (new / old if old else 1.0 for new, old in zip(scaled, present, strict=True))
        gains = {key: value * share for (key, value), share in zip(gains_of(each).items(), shares, strict=True)}
        verdict, waits = verdict_of(each.vessel, each.law, ratio), model.reference_speed < steerage
        found.append(AtSpeed(ratio, model.reference_speed, model.gain, model.time_constant, gains, verdict, waits))
    return found


def chosen(rows: Mapping[str, Judged]) -> dict[str, Judged]:
    """Return the rows of the law that the file steers with."""
    return {name: each for name, each in rows.items() if each.law == each.vessel.control.law}


def speeds_as_json(each: Judged) -> dict[str, Any]:
    """Return the entry "speeds" with the unit in every key; null for what is infinite."""
    return {"speeds": [_as_json(row) for row in by_speed(each)]}


def _as_json(row: AtSpeed) -> dict[str, Any]:
    found = row.verdict.margins
    return {
        "speed_percent": round(100.0 * row.ratio),
        "speed_m_s": row.speed,
        "K_1_s": row.gain,
        "T_s": row.time_constant,
        "gains": row.gains,
        "stable": found.stable,
        "gain_margin": found.gain if math.isfinite(found.gain) else None,
        "phase_margin_deg": math.degrees(found.phase),
        "delay_margin_s": found.delay if math.isfinite(found.delay) else None,
        "below_steerage": row.waits,
        "refusal": row.verdict.refusal or None,
    }


def speeds_as_text(rows: Mapping[str, Judged]) -> str:
    """Return a table of speeds for each set of gains of the law that the file steers with."""
    lines = []
    for name, each in chosen(rows).items():
        head, *cells = speed_table(each)
        widths = [max(len(row[column]) for row in (head, *cells)) for column in range(len(head))]
        lines.append(f"{name}, by speed")
        lines += [
            "    " + "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in (head, *cells)
        ]
    return "\n".join([*lines, UNSCHEDULED])


def speed_table(each: Judged) -> list[tuple[str, ...]]:
    """Return the table of one set of gains, its head first."""
    keys = tuple(gains_of(each))
    return [(*HEAD[:3], *keys, *HEAD[3:], ""), *(_cells(row, keys) for row in by_speed(each))]


def _cells(row: AtSpeed, keys: tuple[str, ...]) -> tuple[str, ...]:
    found = row.verdict.margins
    said = "rudder waits: below steerage" if row.waits else "not to be engaged" if row.verdict.refusal else ""
    margins = (f"{found.gain:.2f}", f"{math.degrees(found.phase):.0f} deg", f"{found.delay:.2f} s")
    return (
        f"{100.0 * row.ratio:.0f} % = {row.speed:.2f} m/s",
        f"{row.gain:.3g}",
        f"{row.time_constant:.3g}",
        *(f"{row.gains[key]:.3g}" for key in keys),
        *(margins if found.stable else ("unstable", "", "")),
        said,
    )
