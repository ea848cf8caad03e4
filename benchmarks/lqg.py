"""Gains that weigh the rudder's rate beside those that do not, on the same filter, boats and seas; a table.

    python benchmarks/lqg.py [--seconds 150] [--seed 9300]

`spared` is the pilot with the gains of the linear-quadratic regulator of heading error, rate and rudder for the cost
psi^2 + weight^2 (d delta/dt)^2 (`autopilot.control.spared_rudder`), on its own Kalman filter: for Gaussian noise, a
linear boat and a filter that knows both, nothing is better for this cost. Each is a front: weights for the one,
response levels for the other.
"""

from __future__ import annotations

import argparse
import dataclasses
import math

from study_boats import SEAS, StudyBoat, boats, figures, sail

from autopilot.build import gear_of, limits_of, model_of
from autopilot.control.backstepping import BacksteppingGains
from autopilot.control.design import design_backstepping
from autopilot.control.spared_rudder import spared_gains
from autopilot.params.vessel import Backstepping

CASES = (
    ("lanxin", "state 3", 45.0),
    ("lanxin", "state 5", 45.0),
    ("coaster", "state 3", 45.0),
    ("coaster", "state 5", 45.0),
    ("lanxin", "state 5", 135.0),
    ("coaster", "state 3", 135.0),
)
WEIGHTS = {"lanxin": (0.1, 0.3, 1.0), "coaster": (1.0, 5.0, 25.0)}
LEVELS = (3, 5, 7)
SETTLED_S = 60.0


def with_weight(boat: StudyBoat, weight: float) -> StudyBoat:
    """Return the boat with the regulator's gains for a weight [s] on the rudder's rate."""
    model = model_of(boat.vessel)
    return with_gains(boat, spared_gains(model, math.cbrt(model.gain / (model.time_constant * weight))))


def at_level(boat: StudyBoat, level: int) -> StudyBoat:
    """Return the boat with the gains of a response level."""
    vessel, model = boat.vessel, model_of(boat.vessel)
    rate_max, delay = limits_of(vessel).rate_max, vessel.control.loop_delay_s
    return with_gains(boat, design_backstepping(model, gear_of(vessel), rate_max, delay, level))


def with_gains(boat: StudyBoat, gains: BacksteppingGains) -> StudyBoat:
    """Return the boat with other gains."""
    control = dataclasses.replace(boat.vessel.control, backstepping=Backstepping(*gains))
    return boat._replace(vessel=dataclasses.replace(boat.vessel, control=control))


def main() -> None:
    """Sail both laws and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=150.0)
    parser.add_argument("--seed", type=int, default=9300)
    asked = parser.parse_args()
    print("boat     sea        from  gains                 heading rms [deg]  rudder travel [deg/s]")
    for name, sea, side in CASES:
        boat = boats()[name]
        rows = {f"spared, weight {weight:g} s": with_weight(boat, weight) for weight in WEIGHTS[name]}
        rows |= {f"plain, level {level}": at_level(boat, level) for level in LEVELS}
        for words, steered in rows.items():
            found = figures(sail(steered, SEAS[sea], side, asked.seconds, asked.seed), SETTLED_S)
            print(
                f"{name:8s} {sea:9s}{side:6.0f}  {words:22s}{found.heading_deg:12.2f}{found.travel_deg_s:22.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
