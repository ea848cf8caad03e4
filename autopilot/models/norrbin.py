"""Norrbin's yaw model, scaled with speed; Nomoto's first-order model is its case n3 = n2 = n0 = 0, n1 = 1.

    T r' + n3 r^3 + n2 r^2 + n1 r + n0 = K delta

Source: Jiang et al. 2016, eqs (1)-(3); Norrbin 1963. Everything in SI units and radians.
"""

from __future__ import annotations

import math
from typing import NamedTuple

SPEED_FLOOR_RATIO = 0.05
"""Below this share of the reference speed the scaling is held: K ~ U/L and T ~ L/U have no sense at rest."""

ROUNDING = 1.0e-9


class Norrbin(NamedTuple):
    """Parameters at `reference_speed` U0 [m/s].

    gain K [1/s], time_constant T [s], n3 [s^2/rad^2], n2 [s/rad], n1 [-] (+1 course-stable, -1 course-unstable), n0
    [rad/s]. n2 goes with r^2, not r|r|: it is what the two sides differ by, 0 for a symmetric hull.
    """

    gain: float
    time_constant: float
    n3: float = 0.0
    n2: float = 0.0
    n1: float = 1.0
    n0: float = 0.0
    reference_speed: float = 1.0


def yaw_acceleration(model: Norrbin, rate: float, rudder: float) -> float:
    """Return r' [rad/s^2] = (K delta - n3 r^3 - n2 r^2 - n1 r - n0)/T at rate r [rad/s] and rudder [rad].

    Also elementwise over numpy arrays.
    """
    gain, time_constant, n3, n2, n1, n0, _ = model
    return (gain * rudder - (((n3 * rate + n2) * rate + n1) * rate + n0)) / time_constant


def damping(model: Norrbin, rate: float) -> float:
    """Return n3 r^3 + n2 r^2 + n1 r + n0 [rad/s], the right-hand side K delta in a steady turn at rate r.

    Functions that every tick calls have it written out.
    """
    return ((model.n3 * rate + model.n2) * rate + model.n1) * rate + model.n0


def steady_rudder(model: Norrbin, rate: float) -> float:
    """Return the rudder angle [rad] that keeps a steady turn at `rate` [rad/s]: Jiang 2016 eq. (5)."""
    return damping(model, rate) / model.gain


def rudder_for(model: Norrbin, rate: float, acceleration: float) -> float:
    """Return the rudder [rad] that gives yaw `acceleration` [rad/s^2] at `rate` [rad/s]: the inverse model."""
    gain, time_constant, n3, n2, n1, n0, _ = model
    return (time_constant * acceleration + (((n3 * rate + n2) * rate + n1) * rate + n0)) / gain


def rudder_within(model: Norrbin, rate: float, planned: float, acceleration: float, rudder_max: float) -> float:
    """Return the same with n3 r^3 and n2 r^2 at the rate that is `planned` [rad/s], the damping counted for no more
    rudder than `rudder_max` [rad].

    |damping| = K rudder_max at the steady rate of a rudder hard over: no trial has seen what the damping is beyond.
    """
    gain, time_constant, n3, n2, n1, n0, _ = model
    held = ((n3 * planned + n2) * planned * planned + n1 * rate + n0) / gain
    held = -rudder_max if held < -rudder_max else held
    held = rudder_max if held > rudder_max else held
    return time_constant * acceleration / gain + held


def at_speed(model: Norrbin, speed: float) -> Norrbin:
    """Return the model at `speed` U [m/s]: K ~ U, T ~ 1/U, n3 ~ 1/U^2, n2 ~ 1/U, n0 ~ U, n1 constant.

    These are the Norrbin coefficients made dimensionless with L/U (SNAME prime system); the hull length
    cancels against the reference speed. Speeds below `SPEED_FLOOR_RATIO` of the reference are raised to it.
    """
    ratio = abs(speed) / model.reference_speed
    return at_speed_ratio(model, SPEED_FLOOR_RATIO if ratio < SPEED_FLOOR_RATIO else ratio)


def at_speed_ratio(model: Norrbin, ratio: float) -> Norrbin:
    """Return the model at `ratio` > 0 times its reference speed. Also elementwise over numpy arrays."""
    gain, time_constant, n3, n2, n1, n0, speed = model
    return Norrbin(gain * ratio, time_constant / ratio, n3 / (ratio * ratio), n2 / ratio, n1, n0 * ratio, speed * ratio)


def liveliness(model: Norrbin, gain_per_speed: float) -> float:
    """Return how many times as much the model answers its rudder, at any speed, as a boat with K/U of `gain_per_speed`
    [1/m]: 1 but for the rounding of the speed's scaling."""
    times = model.gain / (model.reference_speed * gain_per_speed)
    return 1.0 if abs(times - 1.0) < ROUNDING else times


def rate_step(model: Norrbin, rate: float, rudder: float, dt: float) -> float:
    """Return the yaw rate [rad/s] one classical Runge-Kutta step of `dt` [s] later, rudder [rad] held."""
    gain, time_constant, n3, n2, n1, n0, _ = model
    drive, half = gain * rudder, 0.5 * dt
    k1 = (drive - (((n3 * rate + n2) * rate + n1) * rate + n0)) / time_constant
    r = rate + half * k1
    k2 = (drive - (((n3 * r + n2) * r + n1) * r + n0)) / time_constant
    r = rate + half * k2
    k3 = (drive - (((n3 * r + n2) * r + n1) * r + n0)) / time_constant
    r = rate + dt * k3
    k4 = (drive - (((n3 * r + n2) * r + n1) * r + n0)) / time_constant
    return rate + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def folds(model: Norrbin) -> bool:
    """Return whether the damping of a course-stable boat (n1 > 0) turns back on itself at some rate, so that it may
    turn faster and faster to one side: its slope 3 n3 r^2 + 2 n2 r + n1 has a root where n2^2 >= 3 n3 n1, n2 not 0."""
    return model.n1 > 0.0 and model.n2 != 0.0 and model.n2**2 >= 3.0 * model.n3 * model.n1


def steady_rate(model: Norrbin, rudder: float) -> float:
    """Return the stable steady yaw rate [rad/s] at `rudder` [rad]: K delta = n3 r^3 + n2 r^2 + n1 r + n0.

    A course-unstable boat (n1 < 0) has three solutions at small angles; the one returned lies on the branch
    of the rudder's sign, where the boat ends up when the rudder is put over. Bisection; a model without a
    bounded steady rate (n3 = 0 and n1 <= 0, or a damping that `folds`) raises ValueError.
    """
    if model.n3 <= 0.0 and model.n1 <= 0.0:
        raise ValueError("steady_rate: n3 = 0 with n1 <= 0 has no bounded steady turn")
    if folds(model):
        raise ValueError("steady_rate: n2^2 >= 3 n3 n1 has no bounded steady turn to one side")
    drive = model.gain * rudder
    sign = 1.0 if drive - model.n0 >= 0.0 else -1.0
    bound = 1.0e-6
    while sign * (damping(model, sign * bound) - drive) <= 0.0 and bound < 1.0e6:
        bound *= 2.0
    low = _branch_start(model, sign) if model.n1 < 0.0 else 0.0
    for _ in range(200):
        middle = 0.5 * (low + bound)
        if sign * (damping(model, sign * middle) - drive) > 0.0:
            bound = middle
        else:
            low = middle
    return sign * 0.5 * (low + bound)


def quickest_turn(model: Norrbin, angle_max: float) -> float:
    """Return the rate [rad/s] of the quicker of the steady turns with the rudder hard over, `angle_max` [rad] to either
    side; inf where nothing bounds it."""
    if folds(model) or (model.n3 <= 0.0 and model.n1 <= 0.0) or not math.isfinite(angle_max):
        return math.inf
    return max(steady_rate(model, angle_max), -steady_rate(model, -angle_max))


def _branch_start(model: Norrbin, side: float) -> float:
    """Return the rate [rad/s] to one `side` (+1 starboard, -1) at which a course-unstable boat's spiral curve turns
    stable: 3 n3 r^2 + 2 n2 r + n1 = 0."""
    n2 = side * model.n2
    return float(((n2 * n2 - 3.0 * model.n3 * model.n1) ** 0.5 - n2) / (3.0 * model.n3))
