"""An LQG law beside the backstepping law, on the same filter, boats and seas; printed as a table.

    python benchmarks/lqg.py [--seconds 150] [--seed 9300]

The LQG law is the linear-quadratic regulator of heading error, rate and rudder with the rudder's rate as its input, for
the cost psi^2 + weight^2 (d delta/dt)^2, on the pilot's own Kalman filter: for Gaussian noise and a linear boat nothing
is better for this cost. Each law is a front: weights for the one, response levels for the other.
"""

from __future__ import annotations

import argparse
import dataclasses
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_continuous_are
from study_boats import SEAS, Figures, StudyBoat, boats, figures, sail

from autopilot.angles import wrap
from autopilot.control.backstepping import Backstepping
from autopilot.control.design import design_backstepping
from autopilot.control.law import Law, LawInForce, LawInput, NoMemory
from autopilot.models.norrbin import Norrbin
from autopilot.pilot import Pilot
from autopilot.runtime.build import gear_of, law_of, limits_of, model_of, pilot_config
from autopilot.signals import Order, OrderKind, Sample

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


class LqgGains(NamedTuple):
    """Rudder rate [1/s] per heading error, [1] per rate error, and [1/s] per rudder."""

    error: float
    rate: float
    rudder: float


def lqg_step(gains: LqgGains, memory: NoMemory, given: LawInput) -> tuple[float, NoMemory]:
    """Return the rudder demand [rad]: its rate by state feedback; the rudder is the last command, the bias the
    filter's."""
    state, reference = given.state, given.reference
    error, rate = wrap(state.heading - reference.heading), state.rate - reference.rate
    moving = float(np.array(gains) @ (error, rate, given.last_rudder + state.bias))
    return given.last_rudder - given.dt * moving, memory


LQG = Law("lqg", "LQG law", "LQG", None, LqgGains, lambda gains, boat: gains, lqg_step, None)


def lqg_law(model: Norrbin, weight: float) -> LawInForce:
    """Return the law for a boat and a weight [s] on the rudder's rate."""
    t = model.time_constant
    a = np.array([[0.0, 1.0, 0.0], [0.0, -model.n1 / t, model.gain / t], [0.0, 0.0, 0.0]])
    b = np.array([[0.0], [0.0], [1.0]])
    riccati = solve_continuous_are(a, b, np.diag([1.0, 0.0, 0.0]), np.array([[weight * weight]]))
    return LawInForce(LQG, LqgGains(*(float(gain) for gain in (b.T @ riccati / (weight * weight))[0])))


def sailed(boat: StudyBoat, law: LawInForce, sea: str, side: float, seconds: float, seed: int) -> Figures:
    """Return the figures of one run with `law`."""
    pilot, order = Pilot(pilot_config(boat.vessel), law), Order(OrderKind.HEADING, 0.0, serial=1)

    def helmsman(now: float, samples: tuple[Sample, ...]) -> float:
        return pilot.step(now, samples, order).command.angle

    return figures(sail(boat, SEAS[sea], side, seconds, seed, helmsman), SETTLED_S)


def at_level(boat: StudyBoat, level: int) -> tuple[StudyBoat, LawInForce]:
    """Return the boat with the backstepping gains of a response level, and the law."""
    vessel, model = boat.vessel, model_of(boat.vessel)
    gains = design_backstepping(model, gear_of(vessel), limits_of(vessel).rate_max, vessel.control.loop_delay_s, level)
    control = dataclasses.replace(vessel.control, backstepping=Backstepping(*gains))
    changed = boat._replace(vessel=dataclasses.replace(vessel, control=control))
    return changed, law_of(changed.vessel, "backstepping")


def main() -> None:
    """Sail both laws and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=150.0)
    parser.add_argument("--seed", type=int, default=9300)
    asked = parser.parse_args()
    print("boat     sea        from  law                   heading rms [deg]  rudder travel [deg/s]")
    for name, sea, side in CASES:
        boat = boats()[name]
        rows = {f"lqg, weight {weight:g} s": (boat, lqg_law(model_of(boat.vessel), weight)) for weight in WEIGHTS[name]}
        rows |= {f"backstepping, level {level}": at_level(boat, level) for level in LEVELS}  # type: ignore[dict-item]
        for words, (steered, law) in rows.items():
            found = sailed(steered, law, sea, side, asked.seconds, asked.seed)
            print(
                f"{name:8s} {sea:9s}{side:6.0f}  {words:22s}{found.heading_deg:12.2f}{found.travel_deg_s:22.2f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
