"""The Otter with its two propellers, steered by their difference as ArduRover mixes it for a skid-steered boat; and its
hull with one outboard motor at the stern, which steers by where it pushes.

With s the steering order as a share of full steering and t the throttle, left and right run at t + s and t - s of full
revolutions; where |t| + |s| exceeds 1, both are divided by it (MOT_STR_THR_MIX 0.5, the default). Thrust goes with the
square of the revolutions, less astern than ahead. An order in radians is a share of FULL, so that whatever turns a
rudder sails this boat; the "rudder" that the boat shows is the steering that its propellers run at.

The hull is that of the Otter, a catamaran of 2 m by Maritime Robotics, in surge, sway and yaw:

    X = Xu u,   Y = Yv v + cross-flow drag,   N = Nr (1 + 10 |r|) r + cross-flow drag

Source: the model `otter` of the Marine Systems Simulator (Fossen, revision of February 2024) with its payload of 25 kg,
its horizontal part. Its numbers are the maker's and estimates from the length, not tank tests: drag from bollard pull
and top speed, sway and yaw damping from time constants of 1 s, added mass in surge by Soeding's formula. The moment of
inertia is taken about the same point as the rest, which the original does twice.

With the outboard

    X = T cos(d),   Y = -T sin(d),   N = -x Y = (L/2) T sin(d)

come to the hull's. The turning moment goes with the thrust T, whatever the speed: a boat that gets under way, or stops
against a current, steers with its engine, and one that coasts does not steer at all. The motor in the place of the two
propellers is a construction of this simulator, not a boat that exists.
"""

from __future__ import annotations

import math

from autopilot.models.steering_gear import SteeringGear
from sitl.boat import Disturbance, Hull, PlantKind
from sitl.craft import Craft, Inertia, Motion, Push, Windage, of_one_size, planar, step_by, wind_force
from sitl.firmware_setup import Propulsion

GRAVITY = 9.81
DENSITY = 1025.0
LENGTH, BEAM, PONTOON_BEAM = 2.0, 1.08, 0.25
HULL_MASS, PAYLOAD = 55.0, 25.0
MASS = HULL_MASS + PAYLOAD
CENTRE = (HULL_MASS * 0.2 + PAYLOAD * 0.05) / MASS
"""Centre of gravity ahead of midships [m]."""
INERTIA = HULL_MASS * ((0.25 * LENGTH) ** 2 + 0.2**2) + PAYLOAD * 0.05**2
"""About midships [kg m^2]."""
DRAUGHT = MASS / DENSITY / (2.0 * 0.4 * PONTOON_BEAM * LENGTH)
"""Of the two pontoons, whose block coefficient is 0.4 [m]."""
M11 = MASS + 2.7 * DENSITY * (HULL_MASS / DENSITY) ** (5.0 / 3.0) / LENGTH**2
M22 = MASS + 1.5 * HULL_MASS
M23 = MASS * CENTRE
M33 = INERTIA + 1.7 * INERTIA
MASSES = Inertia(M11, M22, M23, M33)
PULL, PULL_ASTERN = 24.4 * GRAVITY, 13.6 * GRAVITY
"""Bollard pull of both propellers [N]."""
TOP_SPEED = 6.0 * 0.5144
DRAG = PULL / TOP_SPEED
"""-Xu [kg/s]."""
SWAY_DAMPING, YAW_DAMPING = M22 / 1.0, M33 / 1.0
CROSS_FLOW = 1.0
"""Drag coefficient of a section by Hoerner's curve, beam over twice the draught being 0.64."""
SERVICE_SPEED = 1.5
"""[m/s]: half of the top speed."""
WINDAGE = Windage(ahead=0.55, astern=0.60, across=0.90, cross_force=0.60, front=0.35, side=0.6, length=LENGTH)
"""Blendermann's speed boat; the areas are assumed."""


HULL = Hull(length=LENGTH, beam=BEAM, draught=DRAUGHT, roll_period=1.2, roll_damping=0.2, roll_lever=0.1, windage=True)
"""The hull that the sea meets; its roll, which moves nothing else, is assumed."""


def cross_flow(v: float, r: float) -> tuple[float, float]:
    """Return force [N] and moment [N m] of the flow across the hull: -(rho/2) T C int (1, x) |w| w dx, w = v + x r."""
    half = 0.5 * LENGTH
    share = 0.5 * DENSITY * DRAUGHT * CROSS_FLOW
    if abs(v) >= half * abs(r):
        side = share if v >= 0.0 else -share
        force = 2.0 * half * v * v + 2.0 / 3.0 * half**3 * r * r
        return -side * force, -side * 4.0 / 3.0 * half**3 * v * r
    if abs(r) < 1.0e-9:
        return 0.0, 0.0
    bow, stern = v + half * r, v - half * r
    cubes = (abs(bow) ** 3 - abs(stern) ** 3) / 3.0
    fourths = (bow * abs(bow) ** 3 - stern * abs(stern) ** 3) / 4.0
    return -share * cubes / r, -share * (fourths - v * cubes) / (r * r)


def moved_by(craft: Craft, motion: Motion, push: Push, acting: Disturbance) -> Motion:
    """Return the derivative of the motion of the hull under what its motors give it."""
    u, v, r = motion.surge, motion.sway, motion.rate
    across, twist = cross_flow(v, r)
    wind = wind_force(WINDAGE, acting.wind_ahead, acting.wind_starboard)
    x = push.ahead - DRAG * u + wind.ahead
    y = push.starboard - SWAY_DAMPING * v + across + wind.starboard
    n = push.yaw - YAW_DAMPING * (1.0 + 10.0 * abs(r)) * r + twist + wind.yaw
    return planar(craft, motion, Push(x, y, n), acting)


FULL = math.radians(30.0)
"""Order that is full steering [rad]."""
LEVER = 0.395
"""Of a propeller from the centre line [m]."""
GEAR = SteeringGear(FULL, math.radians(300.0), 0.1)
"""Propellers follow within 0.1 s, as in Fossen's simulator, and need another 0.1 s from nothing to full."""


def throttle_of(speed: float) -> float:
    """Return the throttle, -1 to 1, that holds a straight course at `speed` [m/s]."""
    pull = PULL if speed >= 0.0 else PULL_ASTERN
    share = math.sqrt(min(DRAG * abs(speed) / pull, 1.0))
    return share if speed >= 0.0 else -share


def mixed(throttle: float, steering: float) -> tuple[float, float]:
    """Return what the left and the right propeller run at, -1 to 1."""
    over = max(abs(throttle) + abs(steering), 1.0)
    return (throttle + steering) / over, (throttle - steering) / over


def thrust(revolutions: float) -> float:
    """Return the thrust [N] of one propeller at this share of its full revolutions."""
    pull = PULL if revolutions >= 0.0 else PULL_ASTERN
    return 0.5 * pull * revolutions * abs(revolutions)


def accelerations(craft: Craft, motion: Motion, rudder: float, thrust_speed: float, acting: Disturbance) -> Motion:
    """Return the derivative of the motion."""
    left, right = mixed(throttle_of(thrust_speed), rudder / FULL)
    port, starboard = thrust(left), thrust(right)
    return moved_by(craft, motion, Push(port + starboard, 0.0, LEVER * (port - starboard)), acting)


def speed_of(throttle: float) -> float:
    """Return the speed [m/s] that a throttle, -1 to 1, reaches on a straight course."""
    return 2.0 * thrust(throttle) / DRAG


OUTBOARD_GEAR = SteeringGear(math.radians(35.0), math.radians(25.0), 0.1)
"""Of an outboard with a small electric drive; assumed."""


def outboard_accelerations(
    craft: Craft, motion: Motion, rudder: float, thrust_speed: float, acting: Disturbance
) -> Motion:
    """Return the derivative of the motion."""
    thrust = min(max(DRAG * thrust_speed, -PULL_ASTERN), PULL)
    across = -thrust * math.sin(rudder)
    return moved_by(craft, motion, Push(thrust * math.cos(rudder), across, -0.5 * LENGTH * across), acting)


PLANTS = (
    PlantKind(
        "twin_thruster",
        of_one_size("twin_thruster", accelerations, Craft(GEAR, HULL, MASSES), SERVICE_SPEED),
        step_by(accelerations),
        Propulsion(speed_of, throttle_of, FULL),
    ),
    PlantKind(
        "outboard",
        of_one_size("outboard", outboard_accelerations, Craft(OUTBOARD_GEAR, HULL, MASSES), SERVICE_SPEED),
        step_by(outboard_accelerations),
        Propulsion(speed_of, throttle_of),
    ),
)
