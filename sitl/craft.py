"""What plants with forces of their own share: the steering gear, wind on the hull, and the motion in surge, sway, roll
and yaw, one Runge-Kutta step at a time; and of those whose roll moves nothing else, the equations of motion too.

A plant of this kind is a function from its speeds, rudder and engine to accelerations. Speeds are through the water:
a uniform current carries water and boat alike, and only the path over the ground shows it. What the sea does comes as

    waves            their yaw acceleration and their slope, as they are
    swell, a push    degrees of rudder: the yaw acceleration of that rudder amidships at the service speed, at any speed
    wind             a force by Blendermann's coefficients; no leeway is given, the hull makes its own
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from autopilot.errors import InputError
from autopilot.models.steering_gear import SteeringGear, gear_step_by
from sitl.boat import BoatState, Disturbance, Hull, PlantStep, Step, over_ground, roll_acceleration

if TYPE_CHECKING:
    from autopilot.vessel.schema import Vessel
    from sitl.scenario import GearSection, Scenario

AIR_DENSITY = 1.225
"""[kg/m^3], the standard atmosphere."""
WATER_DENSITY = 1000.0
"""[kg/m^3] of a towing tank."""
GRAVITY = 9.80665
"""[m/s^2], the standard one."""
SLIGHT = math.radians(0.5)
"""Rudder [rad] that shows what a rudder near amidships does."""


class Motion(NamedTuple):
    """surge, sway [m/s] through the water, rate [rad/s], roll_rate [rad/s], roll [rad]; or their derivatives."""

    surge: float
    sway: float
    rate: float
    roll_rate: float
    roll: float


Accelerations = Callable[[Any, Motion, float, float, Disturbance], Motion]
"""The derivative of a motion: of the plant, the motion, the rudder [rad], the speed [m/s] that the engine would reach
on a straight course, and what acts on the boat."""


class Windage(NamedTuple):
    """Blendermann's coefficients: drag from ahead, from astern and across, cross-force parameter; areas from ahead and
    from the side [m^2]; length [m]; centroid of the side, share of the length ahead of midships; heeling arm [m]."""

    ahead: float
    astern: float
    across: float
    cross_force: float
    front: float
    side: float
    length: float
    centroid: float = 0.0
    arm: float = 0.0


class WindForce(NamedTuple):
    """Force ahead and to starboard [N], moments that turn to starboard and heel to starboard [N m]."""

    ahead: float
    starboard: float
    yaw: float
    roll: float


def wind_force(windage: Windage, ahead: float, starboard: float) -> WindForce:
    """Return the force of an apparent wind, of which so much comes from ahead and from starboard [m/s].

    Blendermann 1994, after Fossen 2011, section 8.1: with g the angle from the bow and l = C_l A_F/(C_t A_L),

        X = -C_l cos(g) q A_F/D,   Y = -C_t sin(g) q A_L/D,   D = 1 - (delta/2)(1 - l) sin^2(2 g)
        N = (s/L - 0.18 (|g| - pi/2)) Y L
    """
    square = ahead * ahead + starboard * starboard
    if square < 1.0e-12:
        return WindForce(0.0, 0.0, 0.0, 0.0)
    pressure = 0.5 * AIR_DENSITY * square
    wind = math.sqrt(square)
    cosine, sine = ahead / wind, starboard / wind
    along = windage.ahead if ahead >= 0.0 else windage.astern
    ratio = along * windage.front / (windage.across * windage.side)
    double = 2.0 * sine * cosine
    divisor = 1.0 - 0.5 * windage.cross_force * (1.0 - ratio) * double * double
    across = -windage.across * sine * pressure * windage.side / divisor
    lever = windage.centroid - 0.18 * (math.atan2(abs(sine), cosine) - 0.5 * math.pi)
    return WindForce(
        -along * cosine * pressure * windage.front / divisor,
        across,
        lever * across * windage.length,
        -windage.arm * across,
    )


def gear_of(own: SteeringGear, section: GearSection) -> SteeringGear:
    """Return the plant's own gear with what a scenario says instead."""
    rate = own.rate_max if section.rate_deg_s is None else math.radians(section.rate_deg_s)
    dead_band = own.dead_band if section.dead_band_deg is None else math.radians(section.dead_band_deg)
    lag = own.lag if section.lag_s is None else section.lag_s
    lag = 0.0 if section.on_off else lag
    return own._replace(rate_max=rate, dead_band=dead_band, lag=lag, play=math.radians(section.play_deg))


def turning(accelerations: Accelerations, plant: Any, speed: float) -> float:
    """Return the yaw acceleration [1/s^2] of a radian of rudder amidships, on a straight course at `speed` [m/s]."""
    straight, calm = Motion(speed, 0.0, 0.0, 0.0, 0.0), Disturbance()
    starboard = accelerations(plant, straight, SLIGHT, speed, calm).rate
    port = accelerations(plant, straight, -SLIGHT, speed, calm).rate
    return (starboard - port) / (2.0 * SLIGHT)


class Inertia(NamedTuple):
    """Masses [kg], [kg m], [kg m^2] of surge, sway and yaw, added mass included."""

    m11: float
    m22: float
    m23: float
    m33: float


class Push(NamedTuple):
    """What drives, holds and turns a craft: force ahead and to starboard [N], moment to starboard [N m]."""

    ahead: float
    starboard: float
    yaw: float


class Craft(NamedTuple):
    """Everything that does not change about a boat in surge, sway and yaw; its roll moves nothing else. push [1/s^2]:
    the yaw acceleration of a radian of disturbance."""

    gear: SteeringGear
    hull: Hull
    inertia: Inertia
    push: float = 0.0


def planar(craft: Craft, motion: Motion, push: Push, acting: Disturbance) -> Motion:
    """Return the derivative of a craft's motion under all forces:

    m11 u' = X + (m22 v + m23 r) r
    m22 v' + m23 r' = Y - m11 u r
    m23 v' + m33 r' = N + (m11 - m22) u v - m23 u r
    """
    u, v, r = motion.surge, motion.sway, motion.rate
    m11, m22, m23, m33 = craft.inertia
    x = push.ahead + (m22 * v + m23 * r) * r
    y = push.starboard - m11 * u * r
    n = push.yaw + (m11 - m22) * u * v - m23 * u * r
    divisor = m22 * m33 - m23 * m23
    return Motion(
        x / m11,
        (m33 * y - m23 * n) / divisor,
        (m22 * n - m23 * y) / divisor + acting.yaw_acceleration + craft.push * acting.rudder,
        roll_acceleration(craft.hull, u, r, motion.roll, motion.roll_rate, acting.roll_slope),
        motion.roll_rate,
    )


def of_one_size(
    kind: str, accelerations: Accelerations, craft: Craft, service_speed: float
) -> Callable[[Vessel, Scenario], Craft]:
    """Return what makes the craft of a vessel and a scenario. It raises InputError for a scale: the drag of such a boat
    goes with the speed, not with its square."""

    def of(vessel: Vessel, scenario: Scenario) -> Craft:
        if scenario.scale != 1.0:
            raise InputError(
                f"plant {kind}: scale is {scenario.scale:g}, and this boat has one size only: leave scale out."
            )
        found = craft._replace(gear=gear_of(craft.gear, scenario.gear))
        return found._replace(push=turning(accelerations, found, service_speed))

    return of


def step_by(accelerations: Accelerations) -> PlantStep:
    """Return a plant's step: the gear, then the classical Runge-Kutta method with the rudder held."""

    def craft_step(
        plant: Any, step: Step, now: BoatState, order: float, thrust_speed: float, acting: Disturbance
    ) -> BoatState:
        dt = step.dt
        rudder = gear_step_by(plant.gear, step.rudder, now.rudder, order, dt)
        start = Motion(now.speed, now.sway, now.rate, now.roll_rate, now.roll)
        k1 = accelerations(plant, start, rudder, thrust_speed, acting)
        k2 = accelerations(plant, _along(start, k1, 0.5 * dt), rudder, thrust_speed, acting)
        k3 = accelerations(plant, _along(start, k2, 0.5 * dt), rudder, thrust_speed, acting)
        k4 = accelerations(plant, _along(start, k3, dt), rudder, thrust_speed, acting)
        sixth, third = dt / 6.0, dt / 3.0
        surge = now.speed + sixth * (k1.surge + k4.surge) + third * (k2.surge + k3.surge)
        sway = now.sway + sixth * (k1.sway + k4.sway) + third * (k2.sway + k3.sway)
        rate = now.rate + sixth * (k1.rate + k4.rate) + third * (k2.rate + k3.rate)
        roll_rate = now.roll_rate + sixth * (k1.roll_rate + k4.roll_rate) + third * (k2.roll_rate + k3.roll_rate)
        roll = now.roll + sixth * (k1.roll + k4.roll) + third * (k2.roll + k3.roll)
        level = math.cos(roll)
        heading = now.heading + 0.5 * dt * (now.rate * math.cos(now.roll) + rate * level)
        moved = BoatState(now.north, now.east, heading, rate, surge, sway, roll, roll_rate, rudder, 0.0, 0.0)
        return over_ground(now, moved, sway * level, acting, dt)

    return craft_step


def _along(start: Motion, slope: Motion, dt: float) -> Motion:
    return Motion(
        start.surge + dt * slope.surge,
        start.sway + dt * slope.sway,
        start.rate + dt * slope.rate,
        start.roll_rate + dt * slope.roll_rate,
        start.roll + dt * slope.roll,
    )
