"""The Otter's hull with one outboard motor at its stern, which steers by where it pushes.

    X = T cos(d),   Y = -T sin(d),   N = -x Y = (L/2) T sin(d)

The turning moment goes with the thrust T, whatever the speed: a boat that gets under way, or stops against a current,
steers with its engine, and one that coasts does not steer at all. Hull and pull are the Otter's (`twin_thruster.py`);
the motor in the place of its two propellers is a construction of this simulator, not a boat that exists.
"""

from __future__ import annotations

import math

from autopilot.models.steering_gear import SteeringGear
from sitl import twin_thruster as otter
from sitl.boat import Disturbance, PlantKind
from sitl.craft import Craft, Motion, Push, of_one_size, step_by
from sitl.firmware_setup import Propulsion

GEAR = SteeringGear(math.radians(35.0), math.radians(25.0), 0.1)
"""Of an outboard with a small electric drive; assumed."""


def accelerations(craft: Craft, motion: Motion, rudder: float, thrust_speed: float, acting: Disturbance) -> Motion:
    """Return the derivative of the motion."""
    thrust = min(max(otter.DRAG * thrust_speed, -otter.PULL_ASTERN), otter.PULL)
    across = -thrust * math.sin(rudder)
    return otter.moved_by(craft, motion, Push(thrust * math.cos(rudder), across, -0.5 * otter.LENGTH * across), acting)


PLANT = PlantKind(
    "outboard",
    of_one_size("outboard", accelerations, Craft(GEAR, otter.HULL, otter.MASSES), otter.SERVICE_SPEED),
    step_by(accelerations),
    Propulsion(otter.speed_of, otter.throttle_of),
)
