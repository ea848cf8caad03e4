"""The margins that the heading filter leaves, beside those of the law alone, for the boats of `turns.py`; a table.

    python benchmarks/filter_margins.py

In gusts: with the bias as quick as the filter learns it to be at most.
"""

from __future__ import annotations

import math

from turns import BOATS, vessel_of

from autopilot.control.margins import OutputFeedbackLoop, output_feedback_margins
from autopilot.runtime.build import output_feedback_loop, verdict_of

LEVELS = {"lanxin": (1, 5, 9), "esso": (5,), "coaster": (5,), "unstable": (1, 5, 9)}


def main() -> None:
    """Print a row for each boat and level."""
    print("                 law alone            with the heading filter               in the strongest gusts")
    print(f"boat      level  delay [s]  worst S{2 * '   delay [s]  worst S  K from    to'}")
    for name, levels in LEVELS.items():
        for level in levels:
            vessel = vessel_of(BOATS[name]._replace(level=level))
            alone = verdict_of(vessel).margins
            row = f"{name:9s} {level:5d} {alone.delay:10.2f} {alone.sensitivity:8.2f}"
            print(row + cells(output_feedback_loop(vessel)) + cells(output_feedback_loop(vessel, disturbed=True)))


def cells(loop: OutputFeedbackLoop) -> str:
    """Return the margins of a loop as the table's columns."""
    found = output_feedback_margins(loop)
    most = f"{found.gain_up:.1f}" if math.isfinite(found.gain_up) else "any"
    return f" {found.delay:11.2f} {found.sensitivity:8.2f} {found.gain_down:7.2f} {most:>5s}"


if __name__ == "__main__":
    main()
