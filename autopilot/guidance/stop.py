"""What planned turns keep to, and the stop that they look ahead to: D(r, delta), the angle it takes from now.

A course-stable boat is stopped with a deceleration that a share of its rudder always gives, and D is found by
simulating the stop. A turn is begun with more of the rudder than it is ended with: a boat whose rudder is weaker than
the model's is slow to turn then, but the rudder left is enough to stop it in time.

A course-unstable boat whose rudder is weaker than the model's may not be stopped any more from a rate that is easy for
the model. Its plan is the quickest turn of the weakest boat that the evidence leaves, see
`autopilot.guidance.turn` (without any, a boat with `share` of the model's K), with PLANNED_SHARE of the
rudder's angle and rate: every stronger boat can follow it with rudder to spare, and as the doubt goes, the plan goes
quicker.
For r > 0 the quickest stop has three parts. The rudder goes across at its rate R; it stands at its stop, where

    T r' = -(K delta_max + damping(r)),   angle = int T r dr/(K delta_max + damping(r));

and it comes back so that rate and rudder end together. This end is one of constant jerk j, r' = -sqrt(2 j r), and

    j = K R/T/(m + sqrt(1 + m^2)),   m = -n1 delta_max/(R T),

is the most that a rudder of rate R can give against the boat's own moment n1 r. Where the rudder at its stop does not
hold the boat's own moment any more, D is beyond any angle: the stop is begun before. The last NEAR of the angle goes
linearly, r' = -kappa r with kappa^3 = j/NEAR, joined with value and slope (proximate time-optimal servomechanism:
Workman 1987). No faster a rate is planned than `share` of that rudder holds.

Stop of constant jerk and its rate: derived here.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.guidance.tuning import (
    BEGINS,
    CROSSING_STEPS,
    MOST_SHARE,
    NEAR,
    PLANNED_SHARE,
    SHARPEST,
    STABLE_STOP,
    STOP_STEPS,
    STOP_STEPS_MOST,
)
from autopilot.models.norrbin import ROUNDING, Norrbin, damping, rate_step, rudder_for, steady_rate, yaw_acceleration
from autopilot.models.steering_gear import SteeringGear, clip

UNSTOPPED = 2.0 * math.pi * 100.0
"""D [rad] of a boat that the rudder does not stop: further than any turn."""
NO_MOMENT = 1.0e-6
"""A boat with -n1 below this is reckoned with as one with this."""
GAUSS = (
    (-0.906179845938664, 0.236926885056189),
    (-0.538469310105683, 0.478628670499366),
    (0.0, 0.568888888888889),
    (0.538469310105683, 0.478628670499366),
    (0.906179845938664, 0.236926885056189),
)
"""Nodes and weights of the Gauss-Legendre quadrature on (-1, 1)."""


class TurnLimits(NamedTuple):
    """What the virtual boat keeps to, and what follows from it.

    rudder_max [rad] and rudder_rate [rad/s]; rate_max [rad/s]; acceleration [rad/s^2], inf: what the rudder gives;
    kappa [1/s] and mu [1/s^2]. A turn is begun with `begins` [-] times as much. Deceleration ends with jerk [rad/s^3],
    inf: no matter how quickly, and takes less than all of the rudder below the rate `returns` [rad/s]. share [-]: the
    weakest boat's K in units of the model's as long as the boat has not shown its own; watches: whether it is to show
    it. preset [rad/s]: the rate that was asked for. late [s]: the rudder lags so much behind its order.
    """

    rudder_max: float
    rudder_rate: float
    rate_max: float
    acceleration: float
    kappa: float
    mu: float
    begins: float
    jerk: float
    returns: float
    share: float
    preset: float
    late: float
    watches: bool


def relaxed(limits: TurnLimits) -> TurnLimits:
    """Return the limits of a turn that nobody ordered: it leads a boat back that was carried off, with rudder to spare.

    With more a boat that turns 40 % better than its model swings for minutes after a gust that its rudder did not hold.
    """
    most = limits.rudder_max, limits.rudder_rate, limits.rate_max, limits.acceleration
    ends = limits.jerk, limits.returns, limits.share, limits.preset, limits.late
    return TurnLimits(*most, limits.kappa, limits.mu, 1.0, *ends, False)


def turn_limits(
    model: Norrbin, gear: SteeringGear, share: float, rate_max: float = math.inf, begins: float = BEGINS
) -> TurnLimits:
    """Return what the virtual boat may do with `share` of the gear's angle and rate, turning at `rate_max` [rad/s] at
    most.

    A turn is begun with `begins` times as much, where the rudder has it. A course-unstable boat's is that of a boat
    with `share` of the model's K throughout.
    """
    if model.n1 <= 0.0:
        most = PLANNED_SHARE * share
        return unstable_limits(
            model, most * gear.angle_max, most * gear.rate_max, share, rate_max, gear.lag + gear.delay
        )
    usable, fastest = share * gear.angle_max, share * gear.rate_max
    begins = clip(MOST_SHARE / share, 1.0, begins)
    bound = steady_rate(symmetric_of(model), begins * usable)
    acceleration = model.gain * usable / model.time_constant
    jerk = min(model.gain * fastest / model.time_constant, SHARPEST * acceleration)
    quickness, pull = STABLE_STOP
    kappa = quickness * jerk / acceleration
    turning = min(rate_max, 0.98 * bound)
    mu = pull * kappa * kappa
    return TurnLimits(
        usable, fastest, turning, acceleration, kappa, mu, begins, math.inf, math.inf, 1.0, rate_max, 0.0, False
    )


def unstable_limits(
    model: Norrbin, rudder_max: float, rudder_rate: float, share: float, preset: float, late: float
) -> TurnLimits:
    """Return what a course-unstable virtual boat may do, see the module's docstring."""
    drive, own = model.gain * rudder_max, max(-model.n1, NO_MOMENT)
    sharpest = min(model.gain * rudder_rate, SHARPEST * drive) / model.time_constant
    moment = own * drive / (sharpest * model.time_constant * model.time_constant)
    root = math.sqrt(1.0 + moment * moment)
    jerk = sharpest / (moment + root)
    kappa = math.pow(jerk / NEAR, 1.0 / 3.0)
    # the end lasts so long where it begins with all of the rudder
    lasts = (moment - 1.0 + root) * model.time_constant / own
    returns = 0.5 * jerk * (lasts * lasts + 1.0 / (kappa * kappa))
    fastest = min(preset, _rate_held_by(model, share * drive))
    most = rudder_max, rudder_rate, fastest, math.inf
    return TurnLimits(*most, kappa, kappa * kappa, 1.0, jerk, returns, share, preset, late, True)


def lag_of_plan(limits: TurnLimits, rate: float) -> float:
    """Return how far [s] the plan is behind an order that turns at `rate` [rad/s] > 0, beside what it stops in:
    0 = -eased(r) + mu (e - D)."""
    return eased(limits, rate) / (limits.mu * rate)


def preset_rate(rate_max: float, curvature_max: float, speed: float) -> float:
    """Return the rate [rad/s] that turns are preset to at `speed` U [m/s]: r = U/R, or `rate_max` [rad/s] if slower.

    curvature_max: 1/R [1/m], inf for a radius of nothing. What the rudder allows is for `turn_limits` to say.
    """
    return min(rate_max, speed * curvature_max)


def symmetric_of(model: Norrbin) -> Norrbin:
    """Return the model without what makes one side differ from the other."""
    return Norrbin(model.gain, model.time_constant, model.n3, 0.0, model.n1, 0.0, model.reference_speed)


def _rate_held_by(model: Norrbin, drive: float) -> float:
    """Return the largest rate [rad/s] up to which a course-unstable boat's own moment -n1 r - n3 r^3 stays below
    `drive` [rad/s]; where it does so everywhere, the rate of a steady turn with it."""
    own = max(-model.n1, NO_MOMENT)
    if model.n3 <= 0.0:
        return drive / own
    # r = 2 p sin(x/3) makes the moment M sin x, p the rate of the largest, M: the trisection of an angle
    peak = math.sqrt(own / (3.0 * model.n3))
    times = 1.5 * drive / (own * peak)
    if times < 1.0:
        return 2.0 * peak * math.sin(math.asin(times) / 3.0)
    return 2.0 * peak * math.cosh(math.acosh(times) / 3.0)


def stop_angle(model: Norrbin, limits: TurnLimits, rate: float, rudder: float) -> float:
    """Return D, the angle [rad] turned through until a stop begun now at `rate` [rad/s] and `rudder` [rad] ends."""
    if limits.jerk < math.inf:
        return _quickest_stop(model, limits, rate, rudder)
    horizon = abs(rate) / limits.acceleration + 3.0 / limits.kappa
    if not math.isfinite(horizon):
        return math.nan
    dt = min(horizon / STOP_STEPS, model.time_constant)
    turned = 0.0
    for _ in range(min(STOP_STEPS_MOST, math.ceil(horizon / dt))):
        wanted = clip(-limits.kappa * rate, -limits.acceleration, limits.acceleration)
        new_rate, rudder = rate_and_rudder(model, limits, (rate, rudder), wanted, dt, 1.0)
        turned += 0.5 * dt * (rate + new_rate)
        rate = new_rate
    return turned + rate / limits.kappa


def _quickest_stop(model: Norrbin, limits: TurnLimits, rate: float, rudder: float) -> float:
    """Return the same for the stop of three parts: across, hold, back."""
    most = limits.rudder_max
    above = rudder - _ending_rudder(model, limits, rate)
    side = math.copysign(1.0, above if above != 0.0 else rate)
    gain, time_constant, n3, n2, n1, n0, speed = model
    seen = Norrbin(gain, time_constant, n3, side * n2, n1, side * n0, speed)
    rate, rudder, turned = side * rate, side * rudder, 0.0
    across = (rudder + most) / CROSSING_STEPS
    above *= side
    if across > 0.0 and above > 0.0:
        dt, a = across / limits.rudder_rate, yaw_acceleration(seen, rate, rudder)
        for _ in range(CROSSING_STEPS):
            new_rate = rate_step(seen, rate, rudder - 0.5 * across, dt)
            rudder -= across
            wanted = _ending_rudder(seen, limits, new_rate)
            if rudder <= wanted and wanted > -most:
                # a short turn: it comes back before it has come to its stop
                part = above / (above - (rudder - wanted))
                turned += part * dt * (rate + 0.5 * part * (new_rate - rate))
                return side * (turned + _ending_angle(limits, rate + part * (new_rate - rate)))
            before, a, above = a, yaw_acceleration(seen, new_rate, rudder), rudder - wanted
            turned += 0.5 * dt * (rate + new_rate) - dt * dt / 12.0 * (a - before)
            rate = new_rate
    if rate > limits.returns:
        # the boat's own moment is largest at `peak`, and the integrand about there
        peak = clip(math.sqrt(max(-n1, 0.0) / (3.0 * n3)) if n3 > 0.0 else rate, limits.returns, rate)
        if gain * most + damping(seen, peak) <= 0.0 or gain * most + damping(seen, rate) <= 0.0:
            return side * UNSTOPPED
        turned += _held_angle(seen, gain * most, limits.returns, peak) + _held_angle(seen, gain * most, peak, rate)
        rate = limits.returns
    return side * (turned + _ending_angle(limits, rate))


def _held_angle(model: Norrbin, drive: float, low: float, high: float) -> float:
    """Return the angle [rad] turned through from the rate `high` to `low` [rad/s] with `drive` [rad/s] against it."""
    turned, width = 0.0, 0.5 * (high - low)
    for place, weight in GAUSS:
        rate = low + width * (1.0 + place)
        turned += weight * width * model.time_constant * rate / max(drive + damping(model, rate), ROUNDING)
    return turned


def eased(limits: TurnLimits, rate: float) -> float:
    """Return the deceleration [rad/s^2] with which a `rate` [rad/s] ends: kappa r, or sqrt(2 j r) joined to it."""
    near = limits.jerk / (limits.kappa * limits.kappa)
    if abs(rate) <= near:
        return limits.kappa * rate
    return math.copysign(math.sqrt(2.0 * limits.jerk * (abs(rate) - 0.5 * near)), rate)


def _ending_rudder(model: Norrbin, limits: TurnLimits, rate: float) -> float:
    """Return the rudder [rad] with which a `rate` [rad/s] ends: all of it down to the rate from which it comes back."""
    if abs(rate) > limits.returns:
        return -math.copysign(limits.rudder_max, rate)
    return clip(rudder_for(model, rate, -eased(limits, rate)), -limits.rudder_max, limits.rudder_max)


def _ending_angle(limits: TurnLimits, rate: float) -> float:
    """Return the angle [rad] through which a `rate` [rad/s] ends so: the integral of r dr/eased(r)."""
    kappa, jerk = limits.kappa, limits.jerk
    if abs(rate) <= jerk / (kappa * kappa):
        return rate / kappa
    lasts = abs(eased(limits, rate)) / jerk
    return math.copysign(
        jerk * (lasts * lasts * lasts / 6.0 + (0.5 * lasts + 1.0 / (3.0 * kappa)) / (kappa * kappa)), rate
    )


def rate_and_rudder(
    model: Norrbin, limits: TurnLimits, begun: tuple[float, float], acceleration: float, dt: float, more: float
) -> tuple[float, float]:
    """Return rate [rad/s] and rudder [rad] after `dt` [s] of trying for `acceleration` [rad/s^2] from those `begun`
    with.

    more: so many times the rudder's angle and rate may be used.
    """
    rate, rudder = begun
    order = clip(rudder_for(model, rate, acceleration), -limits.rudder_max * more, limits.rudder_max * more)
    reach = limits.rudder_rate * more * dt
    moved = rudder + clip(order - rudder, -reach, reach)
    middle = 0.5 * (rudder + moved)
    half = rate + 0.5 * dt * yaw_acceleration(model, rate, middle)
    return rate + dt * yaw_acceleration(model, half, middle), moved
