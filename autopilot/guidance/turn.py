"""Reference model for changes of heading: a virtual boat that turns with part of the real rudder.

The virtual boat obeys the identified Norrbin model, and its rudder keeps to a share of the real rudder's
angle and rate. Its heading, rate and acceleration are therefore a manoeuvre that the real boat can follow
with rudder to spare. It is steered by looking ahead: D(r, delta) is the angle it would still turn through if
it began to stop now, found by simulating the stop. With the heading still to go e and the error that a stop
now would leave, e - D, the wanted acceleration is

    r' = -kappa r + mu (e - D),   held to what rate and rudder allow.

Close to the goal D = r/kappa, and the poles are -kappa and -mu/kappa: no overshoot; far from it, e = D is
the moment to meet the turn with counter-rudder.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin, damping, rudder_for, steady_rate, yaw_acceleration
from autopilot.models.steering_gear import clip
from autopilot.signals import Reference

SHARPEST = 5.0
"""Deceleration is built up in no less than 1/SHARPEST [s], even by a rudder of unlimited rate."""
STABLE_STOP = (2.5, 2.0)
UNSTABLE_STOP = (1.0, 0.8)
"""kappa in units of jerk/acceleration, and mu in units of kappa^2, by course stability: tuned on boats with T
from 0.3 to 20 s for turns without overshoot in little more than the time-optimal time."""
ARRIVED = 1.0e-6
"""Heading [rad] and rate [rad/s] to go, and rudder [rad] off straight, together: below it the turn is over."""
STOP_STEPS = 24
STOP_STEPS_MOST = 60


class TurnLimits(NamedTuple):
    """rudder_max [rad] and rudder_rate [rad/s] the virtual boat may use, and what follows from them: rate_max
    [rad/s], acceleration [rad/s^2], kappa [1/s] and mu [1/s^2]."""

    rudder_max: float
    rudder_rate: float
    rate_max: float
    acceleration: float
    kappa: float
    mu: float


class VirtualBoat(NamedTuple):
    """Heading [rad], rate [rad/s] and rudder [rad] of the virtual boat."""

    heading: float
    rate: float = 0.0
    rudder: float = 0.0


def turn_limits(
    model: Norrbin, rudder_max: float, rudder_rate: float, share: float, rate_max: float = math.inf
) -> TurnLimits:
    """Return what the virtual boat may do with `share` of the rudder's angle [rad] and rate [rad/s].

    A course-unstable boat brakes against its own wish to turn: the worst of it is taken off.
    """
    usable = share * rudder_max
    drive = model.gain * usable
    symmetric = symmetric_of(model)
    if model.n1 > 0.0:
        bound = steady_rate(symmetric, usable)
        braking = drive
    else:
        # half of the rudder is kept to stop what the boat does by itself
        bound = _rate_held_by(symmetric, 0.5 * drive)
        braking = 0.5 * drive
    acceleration = braking / model.time_constant
    fastest = share * rudder_rate
    jerk = min(model.gain * fastest / model.time_constant, SHARPEST * acceleration)
    quickness, pull = STABLE_STOP if model.n1 > 0.0 else UNSTABLE_STOP
    kappa = quickness * jerk / acceleration
    return TurnLimits(usable, fastest, min(rate_max, 0.98 * bound), acceleration, kappa, pull * kappa * kappa)


def symmetric_of(model: Norrbin) -> Norrbin:
    """Return the model without what makes one side differ from the other."""
    return Norrbin(model.gain, model.time_constant, model.n3, 0.0, model.n1, 0.0, model.reference_speed)


def _rate_held_by(model: Norrbin, drive: float) -> float:
    """Return the largest rate [rad/s] up to which a course-unstable boat's own moment stays below `drive`."""
    low, high = 0.0, drive / -model.n1
    if model.n3 > 0.0:
        # the moment -n1 r - n3 r^3 is largest here; below `drive` everywhere means no bound from it
        peak = math.sqrt(-model.n1 / (3.0 * model.n3))
        if -damping(model, peak) <= drive:
            return steady_rate(model, drive / model.gain)
        low, high = 0.0, peak
    for _ in range(60):
        middle = 0.5 * (low + high)
        if -damping(model, middle) < drive:
            low = middle
        else:
            high = middle
    return low


def stop_angle(model: Norrbin, limits: TurnLimits, rate: float, rudder: float) -> float:
    """Return D, the angle [rad] turned through until a stop begun now at `rate` [rad/s] and `rudder` [rad] ends."""
    horizon = abs(rate) / limits.acceleration + 3.0 / limits.kappa
    dt = min(horizon / STOP_STEPS, model.time_constant)
    turned = 0.0
    for _ in range(min(STOP_STEPS_MOST, math.ceil(horizon / dt))):
        new_rate, rudder = _rudder_and_rate(model, limits, rate, rudder, -limits.kappa * rate, dt)
        turned += 0.5 * dt * (rate + new_rate)
        rate = new_rate
    return turned + rate / limits.kappa


def _rudder_and_rate(
    model: Norrbin, limits: TurnLimits, rate: float, rudder: float, acceleration: float, dt: float
) -> tuple[float, float]:
    """Return rate [rad/s] and rudder [rad] after `dt` [s] of trying for `acceleration` [rad/s^2]."""
    wanted = clip(acceleration, -limits.acceleration, limits.acceleration)
    order = clip(rudder_for(model, rate, wanted), -limits.rudder_max, limits.rudder_max)
    reach = limits.rudder_rate * dt
    moved = rudder + clip(order - rudder, -reach, reach)
    middle = 0.5 * (rudder + moved)
    half = rate + 0.5 * dt * yaw_acceleration(model, rate, middle)
    return rate + dt * yaw_acceleration(model, half, middle), moved


def turn_step(model: Norrbin, limits: TurnLimits, boat: VirtualBoat, target: float, dt: float) -> VirtualBoat:
    """Return the virtual boat `dt` [s] later on its way to the heading `target` [rad], the short way round."""
    straight = rudder_for(model, 0.0, 0.0)
    if abs(wrap(target - boat.heading)) + abs(boat.rate) + abs(boat.rudder - straight) < ARRIVED:
        # no need to look ahead from where there is nowhere to go
        return VirtualBoat(target, 0.0, straight)
    finest = min(0.2 * model.time_constant, 0.4 / limits.kappa)
    steps = max(1, min(20, math.ceil(dt / finest)))
    for _ in range(steps):
        boat = _substep(model, limits, boat, target, dt / steps)
    return boat


def _substep(model: Norrbin, limits: TurnLimits, boat: VirtualBoat, target: float, dt: float) -> VirtualBoat:
    error = wrap(target - boat.heading)
    left = error - stop_angle(model, limits, boat.rate, boat.rudder)
    wanted = -limits.kappa * boat.rate + limits.mu * left
    wanted = clip(wanted, limits.kappa * (-limits.rate_max - boat.rate), limits.kappa * (limits.rate_max - boat.rate))
    rate, rudder = _rudder_and_rate(model, limits, boat.rate, boat.rudder, wanted, dt)
    return VirtualBoat(heading=wrap(boat.heading + 0.5 * dt * (boat.rate + rate)), rate=rate, rudder=rudder)


def reference_of(model: Norrbin, boat: VirtualBoat) -> Reference:
    """Return psi_d, psi_d' and psi_d'' of the virtual boat."""
    return Reference(boat.heading, boat.rate, yaw_acceleration(model, boat.rate, boat.rudder))
