"""The Otter with its two propellers, steered by their difference as ArduRover mixes it for a skid-steered boat.

With s the steering order as a share of full steering and t the throttle, left and right run at t + s and t - s of full
revolutions; where |t| + |s| exceeds 1, both are divided by it (MOT_STR_THR_MIX 0.5, the default). Thrust goes with the
square of the revolutions, less astern than ahead (`sitl/otter.py`). An order in radians is a share of FULL, so that
whatever turns a rudder sails this boat; the "rudder" that the boat shows is the steering that its propellers run at.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from autopilot.models.steering_gear import SteeringGear
from sitl import otter
from sitl.boat import Disturbance, Hull
from sitl.craft import Motion, gear_of, refuse_scale, step_by, turning
from sitl.motors import Propulsion
from sitl.plant_kind import PlantKind

if TYPE_CHECKING:
    from autopilot.vessel.schema import Vessel
    from sitl.scenario import Scenario

FULL = math.radians(30.0)
"""Order that is full steering [rad]."""
LEVER = 0.395
"""Of a propeller from the centre line [m]."""
GEAR = SteeringGear(FULL, math.radians(300.0), 0.1)
"""Propellers follow within 0.1 s, as in Fossen's simulator, and need another 0.1 s from nothing to full."""


class TwinThruster(NamedTuple):
    """Everything about the boat that does not change."""

    gear: SteeringGear
    hull: Hull
    play: float = 0.0
    push: float = 0.0


def throttle_of(speed: float) -> float:
    """Return the throttle, -1 to 1, that holds a straight course at `speed` [m/s]."""
    pull = otter.PULL if speed >= 0.0 else otter.PULL_ASTERN
    share = math.sqrt(min(otter.DRAG * abs(speed) / pull, 1.0))
    return share if speed >= 0.0 else -share


def mixed(throttle: float, steering: float) -> tuple[float, float]:
    """Return what the left and the right propeller run at, -1 to 1."""
    over = max(abs(throttle) + abs(steering), 1.0)
    return (throttle + steering) / over, (throttle - steering) / over


def thrust(revolutions: float) -> float:
    """Return the thrust [N] of one propeller at this share of its full revolutions."""
    pull = otter.PULL if revolutions >= 0.0 else otter.PULL_ASTERN
    return 0.5 * pull * revolutions * abs(revolutions)


def accelerations(
    boat: TwinThruster, motion: Motion, rudder: float, thrust_speed: float, acting: Disturbance
) -> Motion:
    """Return the derivative of the motion."""
    left, right = mixed(throttle_of(thrust_speed), rudder / FULL)
    port, starboard = thrust(left), thrust(right)
    push = otter.Push(port + starboard, 0.0, LEVER * (port - starboard))
    return otter.moved_by(push, motion, boat.hull, boat.push, acting)


def of(vessel: Vessel, scenario: Scenario) -> TwinThruster:
    """Return the boat. InputError for a scale: its drag does not go with the square of the speed."""
    refuse_scale("twin_thruster", scenario.scale)
    boat = TwinThruster(gear_of(GEAR, scenario.gear), otter.HULL, math.radians(scenario.gear.play_deg))
    return boat._replace(push=turning(accelerations, boat, otter.SERVICE_SPEED))


def speed_of(throttle: float) -> float:
    """Return the speed [m/s] that a throttle, -1 to 1, reaches on a straight course."""
    return 2.0 * thrust(throttle) / otter.DRAG


PLANT = PlantKind("twin_thruster", of, step_by(accelerations), Propulsion(speed_of, throttle_of, FULL))
