"""What a plant of the simulator is: the equations of a boat, under a name that scenarios choose by."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from autopilot.vessel.schema import Vessel
    from sitl.boat import BoatState, Disturbance, Step
    from sitl.motors import Propulsion
    from sitl.scenario import Scenario

PlantStep = Callable[[Any, "Step", "BoatState", float, float, "Disturbance"], "BoatState"]
"""The state a step later: of the plant, the step, the state, the rudder's order [rad] in effect, the speed [m/s] that
the engine would reach on a straight course, and what sea and wind do."""


class PlantKind(NamedTuple):
    """A kind of plant.

    of: what does not change while it runs, of vessel and scenario: any NamedTuple with the `gear` and the `hull` of
    `sitl.boat.Plant`, which the faults of the rudder and the sea go by. step: see `PlantStep`. motors: what its
    motors make of a flight controller's outputs; None: throttle and speed go together.
    """

    name: str
    of: Callable[[Vessel, Scenario], Any]
    step: PlantStep
    motors: Propulsion | None = None
