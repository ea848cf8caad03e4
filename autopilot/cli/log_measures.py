"""`autopilot log measures`: the manoeuvres in a log and what a ship is measured by in them, beside IMO's criteria."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from autopilot.identification import manoeuvring_criteria as criteria
from autopilot.identification.trial_measures import Measures
from autopilot.printable import SENTENCE, printable
from autopilot.report.measure_rows import blocks_of

NOTHING = (
    "No manoeuvre found: a zigzag needs three executes, a turning circle 180 deg at a held rudder, a pull-out a turn "
    "and then the rudder amidships, a spiral five angles down and up again."
)


def as_json(source: str, measures: Measures, length: float | None, notes: Sequence[str] = ()) -> str:
    """Return the measures as JSON; SI units and radians, null where a measure is not known. notes: of the log."""
    found = {
        "source": source,
        "length_m": length,
        "position": measures.position,
        "zigzags": [one._asdict() for one in measures.zigzags],
        "circles": [one._asdict() for one in measures.circles],
        "pull_outs": [one._asdict() for one in measures.pull_outs],
        "spiral": None if measures.spiral is None else measures.spiral._asdict(),
        "notes": list(notes),
    }
    return json.dumps(_without_nan(found), indent=2)


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _without_nan(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def as_text(source: str, measures: Measures, length: float | None, notes: Sequence[str] = ()) -> str:
    """Return the measures for people, each beside its criterion where there is one and `length` [m] is known, and the
    log's notes."""
    told = [f"- {printable(note, SENTENCE)}" for note in notes]
    lines = [f"{source}: positions by {measures.position}"]
    blocks = blocks_of(measures, length)
    if not blocks:
        return "\n".join([*lines, NOTHING, *told])
    for block in blocks:
        lines += ["", block.title]
        for name, value, criterion in block.rows:
            lines.append(f"  {name:34s} {value:>22s}{'   criterion ' + criterion if criterion else ''}")
    lines += ["", f"({criteria.SHIPS})"]
    if length is None:
        lines.append("Give the boat's length with --length-m to see distances in lengths and all criteria.")
    return "\n".join(lines + told)
