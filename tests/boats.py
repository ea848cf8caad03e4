"""The boats of the closed-loop tests, from quick to slow and course-unstable, with gains designed for each."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

from autopilot.control.backstepping import Backstepping
from autopilot.control.design import design_backstepping
from autopilot.control.pid import Pid, equivalent_pid
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.vessel.schema import Control, Model, Rudder, Vessel


class Boat(NamedTuple):
    """Model and rudder, in the units of a vessel file."""

    K: float
    T: float
    n3: float
    n1: float
    speed: float
    rudder_rate_deg_s: float


BOATS = {
    "lanxin": Boat(0.701, 0.332, 3.2828, 1.0, 4.63, 20.0),
    "middle": Boat(0.2, 5.0, 5.0, 1.0, 3.0, 5.0),
    "slow": Boat(0.1, 20.0, 50.0, 1.0, 3.0, 2.5),
    "unstable": Boat(0.2, 5.0, 20.0, -1.0, 3.0, 5.0),
}
LAUNCH = Boat(0.2, 5.0, 5.0, 1.0, 4.0, 5.0)


@functools.cache
def vessel_of(boat: Boat) -> Vessel:
    """Return the boat's vessel file with gains designed for it; the design is made once in a process."""
    model = Norrbin(boat.K, boat.T, boat.n3, n1=boat.n1, reference_speed=boat.speed)
    gear = SteeringGear(math.radians(30.0), math.radians(boat.rudder_rate_deg_s), 0.1, 0.0, 0.05)
    gains = design_backstepping(model, gear, gear.rate_max, 0.05)
    pid = equivalent_pid(model, gains, 10.0 + 3.0 * boat.T)
    return Vessel(
        2,
        "test boat",
        Model(boat.K, boat.T, boat.speed, boat.n1, boat.n3),
        Rudder(30.0, boat.rudder_rate_deg_s, 0.1, 0.05),
        control=Control(backstepping=Backstepping(*gains), pid=Pid(*pid)),
    )
