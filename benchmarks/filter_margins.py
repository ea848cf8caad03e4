"""The margins that the heading filter leaves, beside those of the law alone, for the boats of `turns.py`; a table.

python benchmarks/filter_margins.py
"""

from __future__ import annotations

import math

from turns import BOATS, vessel_of

from autopilot.build import observed_of, verdict_of
from autopilot.control.observed_margins import observed_margins

LEVELS = {"lanxin": (1, 5, 9), "esso": (5,), "coaster": (5,), "unstable": (1, 5, 9)}


def main() -> None:
    """Print a row for each boat and level."""
    print("                 law alone            with the heading filter")
    print("boat      level  delay [s]  worst S   delay [s]  worst S  K from    to")
    for name, levels in LEVELS.items():
        for level in levels:
            vessel = vessel_of(BOATS[name]._replace(level=level))
            alone, whole = verdict_of(vessel).margins, observed_margins(observed_of(vessel))
            most = f"{whole.gain_up:.1f}" if math.isfinite(whole.gain_up) else "any"
            print(
                f"{name:9s} {level:5d} {alone.delay:10.2f} {alone.sensitivity:8.2f} {whole.delay:11.2f} "
                f"{whole.sensitivity:8.2f} {whole.gain_down:7.2f} {most:>5s}"
            )


if __name__ == "__main__":
    main()
