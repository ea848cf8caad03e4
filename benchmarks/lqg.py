"""An LQG law beside the backstepping law, on the same filter, boats and seas; printed as a table.

    python benchmarks/lqg.py [--seconds 150] [--seed 9300]

The LQG law is the linear-quadratic regulator of heading error, rate and rudder with the rudder's rate as its input, for
the cost psi^2 + weight^2 (d delta/dt)^2, on the pilot's own Kalman filter: for Gaussian noise and a linear boat nothing
is better for this cost. Each law is a front: weights for the one, response levels for the other.
"""

from __future__ import annotations

import argparse
import dataclasses

import numpy as np
from scipy.linalg import solve_continuous_are
from study_boats import SEAS, Figures, StudyBoat, boats, figures, sail

from autopilot.angles import wrap
from autopilot.control.backstepping import BacksteppingLaw
from autopilot.control.design import design_backstepping
from autopilot.models.norrbin import Norrbin
from autopilot.pilot import HeadingLaw, Pilot
from autopilot.runtime.build import gear_of, limits_of, model_of, pilot_config
from autopilot.signals import NavState, Order, OrderKind, Reference, Sample
from autopilot.vessel.schema import Backstepping

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


class LqgLaw:
    """Rudder rate by state feedback; the rudder is that which was told last, the bias the filter's."""

    name = "lqg"

    def __init__(self, model: Norrbin, weight: float) -> None:
        t = model.time_constant
        a = np.array([[0.0, 1.0, 0.0], [0.0, -model.n1 / t, model.gain / t], [0.0, 0.0, 0.0]])
        b = np.array([[0.0], [0.0], [1.0]])
        riccati = solve_continuous_are(a, b, np.diag([1.0, 0.0, 0.0]), np.array([[weight * weight]]))
        self._gains = (b.T @ riccati / (weight * weight))[0]

    def reset(self, rudder: float) -> None:
        """Nothing to forget."""

    def update(self, model: Norrbin, reference: Reference, state: NavState, last_rudder: float, dt: float) -> float:
        """Return the rudder demand [rad]."""
        error, rate = wrap(state.heading - reference.heading), state.rate - reference.rate
        moving = self._gains @ (error, rate, last_rudder + state.bias)
        return float(last_rudder - dt * moving)


def sailed(boat: StudyBoat, law: HeadingLaw, sea: str, side: float, seconds: float, seed: int) -> Figures:
    """Return the figures of one run with `law`."""
    pilot, order = Pilot(pilot_config(boat.vessel), law), Order(OrderKind.HEADING, 0.0, serial=1)

    def helmsman(now: float, samples: tuple[Sample, ...]) -> float:
        return pilot.step(now, samples, order).command.angle

    return figures(sail(boat, SEAS[sea], side, seconds, seed, helmsman), SETTLED_S)


def at_level(boat: StudyBoat, level: int) -> tuple[StudyBoat, HeadingLaw]:
    """Return the boat with the backstepping gains of a response level, and the law."""
    vessel, model = boat.vessel, model_of(boat.vessel)
    gains = design_backstepping(model, gear_of(vessel), limits_of(vessel).rate_max, vessel.control.loop_delay_s, level)
    control = dataclasses.replace(vessel.control, backstepping=Backstepping(*gains))
    changed = boat._replace(vessel=dataclasses.replace(vessel, control=control))
    return changed, BacksteppingLaw(gains, model.reference_speed)


def main() -> None:
    """Sail both laws and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=150.0)
    parser.add_argument("--seed", type=int, default=9300)
    asked = parser.parse_args()
    print("boat     sea        from  law                   heading rms [deg]  rudder travel [deg/s]")
    for name, sea, side in CASES:
        boat = boats()[name]
        rows = {f"lqg, weight {weight:g} s": (boat, LqgLaw(model_of(boat.vessel), weight)) for weight in WEIGHTS[name]}
        rows |= {f"backstepping, level {level}": at_level(boat, level) for level in LEVELS}  # type: ignore[dict-item]
        for words, (steered, law) in rows.items():
            found = sailed(steered, law, sea, side, asked.seconds, asked.seed)
            print(
                f"{name:8s} {sea:9s}{side:6.0f}  {words:22s}{found.heading_deg:12.2f}{found.travel_deg_s:22.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
