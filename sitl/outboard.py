"""The Otter's hull with one outboard motor at its stern, which steers by where it pushes.

    X = T cos(d),   Y = -T sin(d),   N = -x Y = (L/2) T sin(d)

The turning moment goes with the thrust T, whatever the speed: a boat that gets under way, or stops against a current,
steers with its engine, and one that coasts does not steer at all. Hull and pull are the Otter's (`twin_thruster.py`);
the motor in the place of its two propellers is a construction of this simulator, not a boat that exists.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

from autopilot.models.steering_gear import SteeringGear
from autopilot.vessel.schema import Vessel
from sitl import twin_thruster as otter
from sitl.boat import Disturbance, Hull, PlantKind
from sitl.craft import Motion, gear_of, refuse_scale, step_by, turning
from sitl.firmware_setup import Propulsion

if TYPE_CHECKING:
    from sitl.scenario import Scenario

GEAR = SteeringGear(math.radians(35.0), math.radians(25.0), 0.1)
"""Of an outboard with a small electric drive; assumed."""


class Outboard(NamedTuple):
    """Everything about the boat that does not change."""

    gear: SteeringGear
    hull: Hull
    push: float = 0.0


def accelerations(boat: Outboard, motion: Motion, rudder: float, thrust_speed: float, acting: Disturbance) -> Motion:
    """Return the derivative of the motion."""
    thrust = min(max(otter.DRAG * thrust_speed, -otter.PULL_ASTERN), otter.PULL)
    across = -thrust * math.sin(rudder)
    push = otter.Push(thrust * math.cos(rudder), across, -0.5 * otter.LENGTH * across)
    return otter.moved_by(push, motion, boat.hull, boat.push, acting)


def of(vessel: Vessel, scenario: Scenario) -> Outboard:
    """Return the boat. InputError for a scale: its drag does not go with the square of the speed."""
    refuse_scale("outboard", scenario.scale)
    boat = Outboard(gear_of(GEAR, scenario.gear), otter.HULL)
    return boat._replace(push=turning(accelerations, boat, otter.SERVICE_SPEED))


def speed_of(throttle: float) -> float:
    """Return the speed [m/s] that a throttle, -1 to 1, reaches: thrust goes with the square of the revolutions."""
    pull = otter.PULL if throttle >= 0.0 else otter.PULL_ASTERN
    return pull * throttle * abs(throttle) / otter.DRAG


def throttle_of(speed: float) -> float:
    """Return the throttle, -1 to 1, that holds a straight course at `speed` [m/s]."""
    pull = otter.PULL if speed >= 0.0 else otter.PULL_ASTERN
    return math.copysign(math.sqrt(min(otter.DRAG * abs(speed) / pull, 1.0)), speed)


PLANT = PlantKind("outboard", of, step_by(accelerations), Propulsion(speed_of, throttle_of))
