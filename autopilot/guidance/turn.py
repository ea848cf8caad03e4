"""Reference model for changes of heading: a virtual boat that turns with part of the real rudder.

The virtual boat obeys the identified Norrbin model, and its rudder keeps to a share of the real rudder's
angle and rate. Its heading, rate and acceleration are therefore a manoeuvre that the real boat can follow
with rudder to spare. It is steered by looking ahead: D(r, delta) is the angle it would still turn through if
it began to stop now, see `autopilot.guidance.stop`. With the heading still to go e and the error that a stop
now would leave, e - D, the wanted acceleration is

    r' = -kappa r + mu (e - D),   held to what rate and rudder allow.

Close to the goal D = r/kappa, and the poles are -kappa and -mu/kappa: no overshoot; far from it, e = D is
the moment to meet the turn with counter-rudder.

A boat whose rudder is weaker than the model's is slow to turn at first: `hold_back` waits for it. A course-unstable one
is turned as the weakest boat that the evidence leaves (`Effectiveness`): as the doubt goes, the plan
goes quicker. What its rudder needs more, or less, than planned is fed forward (`reference_of`). What it lags behind the
plan is not caught up with while it turns: that would take it beyond the rate that the plan keeps to. The plan goes with
it instead (`couple`).

Effectiveness: how strong a boat's rudder shows itself while the boat turns, its K in units of the model's.

With K a share q of the model's and a push b0 that the estimator has not learnt,

    T r' = q u - damping(r) + b0,   u = K delta.

Low-passed over tau = SMOOTHED T this needs no derivative of r:

    y = T (r_)' + (u - m)_ = q u_ + b0,   m = T r' by the model = u - damping(r),

where _ marks what is low-passed. q and b0 are found by least squares, weighed against the belief that q is 1 and b0 is
0. Rudder to one side alone does not tell a strong boat from one that is pushed, counter-rudder does; until then q is
left in doubt, and with caution a lower share is returned.

Derived here; a low-pass in place of a derivative is the state variable filter of Young (1981, Automatica 17, 23).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.guidance.stop import TurnLimits, eased, rate_and_rudder, relaxed, stop_angle, unstable_limits
from autopilot.guidance.tuning import (
    AHEAD,
    ARRIVED,
    BEHIND,
    CARRIED_OFF,
    DOUBT,
    DOUBT_BIAS,
    DRAWN,
    DRAWN_RATE,
    FORGOTTEN,
    LEFT,
    NO_TURN,
    RESET_BEYOND,
    RESET_BEYOND_EARLY,
    SETTLING_TIME_CONSTANTS,
    SMOOTHED,
    STRONGEST,
    TURNING_RUDDER,
    TURNING_SHARE,
    TURNING_SLACK,
    WEAKEST,
)
from autopilot.models.norrbin import Norrbin, rudder_for, yaw_acceleration
from autopilot.models.steering_gear import clip
from autopilot.signals import NavState, Reference


class Effectiveness(NamedTuple):
    """r_, m_ and u_ [rad/s], and the sums over time of u_^2, u_ y, u_, 1, y and y^2."""

    rate: float = 0.0
    moment: float = 0.0
    drive: float = 0.0
    sum_drive_squared: float = 0.0
    sum_drive_found: float = 0.0
    sum_drive: float = 0.0
    sum_time: float = 0.0
    sum_found: float = 0.0
    sum_found_squared: float = 0.0


NO_EVIDENCE = Effectiveness(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def updated_effectiveness(
    model: Norrbin, estimate: Effectiveness, rate: float, rudder: float, dt: float
) -> Effectiveness:
    """Return what has been shown after `dt` [s] more at `rate` r [rad/s] with `rudder` delta [rad], bias included."""
    if dt <= 0.0:
        return estimate
    tau = SMOOTHED * model.time_constant
    share, kept = 1.0 - math.exp(-dt / tau), math.exp(-dt / (FORGOTTEN * model.time_constant))
    before = estimate.rate if estimate.sum_time > 0.0 else rate
    slow = before + share * (rate - before)
    moment = estimate.moment + share * (model.time_constant * yaw_acceleration(model, rate, rudder) - estimate.moment)
    drive = estimate.drive + share * (model.gain * rudder - estimate.drive)
    found = model.time_constant * (slow - before) / dt + drive - moment
    return Effectiveness(
        slow,
        moment,
        drive,
        kept * estimate.sum_drive_squared + dt * drive * drive,
        kept * estimate.sum_drive_found + dt * drive * found,
        kept * estimate.sum_drive + dt * drive,
        kept * estimate.sum_time + dt,
        kept * estimate.sum_found + dt * found,
        kept * estimate.sum_found_squared + dt * found * found,
    )


def rudder_effectiveness(model: Norrbin, rudder: float, estimate: Effectiveness, caution: float = 0.0) -> float:
    """Return q [-], less `caution` times what is left of the doubt: 1 - caution without evidence.

    `rudder` [rad] is what turns are planned with.
    """
    most = model.gain * rudder
    doubt, doubt_bias = DOUBT * model.time_constant * most * most, DOUBT_BIAS * model.time_constant
    more, off = estimate.sum_drive_found - estimate.sum_drive_squared, estimate.sum_found - estimate.sum_drive
    share, push, _ = _fitted(estimate, doubt, doubt_bias, more, off)
    unexplained = estimate.sum_found_squared - 2.0 * estimate.sum_drive_found + estimate.sum_drive_squared
    left = max(unexplained - share * more - push * off, 0.0) / (estimate.sum_time + doubt_bias)
    grown = 1.0 + LEFT * left / (DOUBT * most * most)
    share, _, spread = _fitted(estimate, grown * doubt, grown * doubt_bias, more, off)
    return clip(1.0 + share - caution * spread, min(WEAKEST, 1.0 - caution), STRONGEST)


def _fitted(
    estimate: Effectiveness, doubt: float, doubt_bias: float, more: float, off: float
) -> tuple[float, float, float]:
    """Return q - 1 and b0 [rad/s], and how much of the doubt in q is left [-]; more, off: of y - u_, as the sums."""
    squared, time = estimate.sum_drive_squared + doubt, estimate.sum_time + doubt_bias
    known = squared * time - estimate.sum_drive * estimate.sum_drive
    share, push = more * time - off * estimate.sum_drive, off * squared - more * estimate.sum_drive
    return share / known, push / known, math.sqrt(doubt * time / known)


class VirtualBoat(NamedTuple):
    """Heading [rad], rate [rad/s] and rudder [rad] of the virtual boat, and what the real one has shown beside it."""

    heading: float
    rate: float = 0.0
    rudder: float = 0.0
    effectiveness: Effectiveness = NO_EVIDENCE


def turn_step(
    model: Norrbin, limits: TurnLimits, boat: VirtualBoat, target: float, dt: float, is_late: bool = False
) -> VirtualBoat:
    """Return the virtual boat `dt` [s] later on its way to the heading `target` [rad], the short way round. is_late: no
    ordered turn is under way any more."""
    straight, left = model.n0 / model.gain, target - boat.heading
    left = left if -PI < left <= PI else wrap(left)
    if abs(left) + abs(boat.rate) + abs(boat.rudder - straight) < ARRIVED:
        # no need to look ahead from where there is nowhere to go
        return VirtualBoat(target, 0.0, straight, NO_EVIDENCE)
    limits = scaled_by_confidence(model, relaxed(limits) if is_late else limits, boat)
    # a stop of constant deceleration is forgiving, one that the rudder only just gives has its moment
    finest = min((0.2 if limits.jerk == math.inf else 0.03) * model.time_constant, 0.4 / limits.kappa)
    steps = max(1, min(20, math.ceil(dt / finest)))
    for _ in range(steps):
        boat = _substep(model, limits, boat, target, dt / steps)
    return boat


def _substep(model: Norrbin, limits: TurnLimits, boat: VirtualBoat, target: float, dt: float) -> VirtualBoat:
    error = wrap(target - boat.heading)
    left = error - stop_angle(model, limits, boat.rate, boat.rudder)
    wanted = -eased(limits, boat.rate) + limits.mu * left
    wanted = clip(wanted, -eased(limits, limits.rate_max + boat.rate), eased(limits, limits.rate_max - boat.rate))
    more = limits.begins if wanted * boat.rate >= 0.0 else 1.0
    most = more * limits.acceleration
    wanted = clip(wanted, -most, most)
    rate, rudder = rate_and_rudder(model, limits, (boat.rate, boat.rudder), wanted, dt, more)
    heading = wrap(boat.heading + 0.5 * dt * (boat.rate + rate))
    return VirtualBoat(heading, rate, rudder, boat.effectiveness)


def couple(model: Norrbin, limits: TurnLimits, boat: VirtualBoat, real: NavState, dt: float) -> VirtualBoat:
    """Return the virtual boat after `dt` [s] beside the real one, and drawn to it the more the faster it turns."""
    rate = real.rate
    over = abs(boat.rudder - rudder_for(model, 0.0, 0.0)) / limits.rudder_max
    turning = min(max(abs(boat.rate) / limits.rate_max, over), 1.0) * dt / model.time_constant
    near = wrap(boat.heading + min(DRAWN * turning, 1.0) * wrap(real.heading - boat.heading))
    slow = boat.rate + min(DRAWN_RATE * turning, 1.0) * (rate - boat.rate)
    if abs(rate) > CARRIED_OFF * limits.rate_max:
        slow = clip(slow, -limits.rate_max, limits.rate_max)
    return VirtualBoat(
        near, slow, boat.rudder, updated_effectiveness(model, boat.effectiveness, rate, real.rudder + real.bias, dt)
    )


def scaled_by_confidence(model: Norrbin, limits: TurnLimits, boat: VirtualBoat) -> TurnLimits:
    """Return the limits for the weakest boat that what `boat` has shown of itself leaves."""
    if not limits.watches:
        return limits
    planned = limits.rudder_max / limits.share
    weakest = clip(rudder_effectiveness(model, planned, boat.effectiveness, 1.0 - limits.share), limits.share, 1.0)
    rate = limits.rudder_rate / limits.share
    return unstable_limits(model, weakest * planned, weakest * rate, limits.share, limits.preset, limits.late)


def reference_of(model: Norrbin, limits: TurnLimits, boat: VirtualBoat) -> Reference:
    """Return psi_d, psi_d' and psi_d'' of the virtual boat.

    psi_d'' is what makes the law tell the real rudder what the boat has been seen to need for the planned one. The boat
    turns when its rudder has come: psi_d and psi_d' are those of so much earlier.
    """
    rudder, late = boat.rudder, limits.late
    if limits.watches:
        rudder /= rudder_effectiveness(model, limits.rudder_max / limits.share, boat.effectiveness)
    acceleration = yaw_acceleration(model, boat.rate, rudder)
    if late == 0.0:
        return Reference(boat.heading, boat.rate, acceleration)
    turned = late * (boat.rate - 0.5 * late * acceleration)
    return Reference(wrap(boat.heading - turned), boat.rate - late * acceleration, acceleration)


def hold_back(boat: VirtualBoat, heading: float, rate: float, hard_over: int) -> VirtualBoat:
    """Return the virtual boat, waiting where the real one at `heading` [rad] and `rate` [rad/s] cannot keep up with it.

    hard_over: the side, 1 or -1, on which the real rudder is at its stop; 0: at neither. A boat that turns worse than
    its model is then never more than BEHIND, so that the turn is met when it must be met; and one that is blown away
    is led back from where it is when its rudder holds it again, not from where a plan ran to without it.
    """
    behind = hard_over * wrap(boat.heading - heading)
    if behind <= BEHIND or hard_over * boat.rate <= max(hard_over * rate, 0.0):
        return boat
    caught = hard_over * max(hard_over * rate, 0.0)
    return VirtualBoat(wrap(heading + hard_over * BEHIND), caught, boat.rudder, boat.effectiveness)


def advance(model: Norrbin, limits: TurnLimits, boat: VirtualBoat, heading: float, target: float) -> VirtualBoat:
    """Return the virtual boat, taken along where the real one at `heading` [rad] is far ahead on the way to `target`
    [rad], but no further than where it must begin to stop.

    The plan keeps its rate. A law that saw more error would have the boat wait with more rudder than the rudder's rate
    can take off again in time, and a boat that turns better than its model would swing about the plan. A plan that goes
    with a course-unstable boat anyway, `couple`, is left to that.
    """
    ahead = heading - boat.heading
    ahead = ahead if -PI < ahead <= PI else wrap(ahead)
    if limits.watches or ahead * boat.rate <= 0.0 or abs(ahead) <= AHEAD or not is_turning(model, limits, boat):
        return boat
    side = math.copysign(1.0, ahead)
    room = side * (wrap(target - boat.heading) - stop_angle(model, limits, boat.rate, boat.rudder))
    shift = min(abs(ahead) - AHEAD, max(room, 0.0))
    return VirtualBoat(wrap(boat.heading + side * shift), boat.rate, boat.rudder, boat.effectiveness)


def is_turning(model: Norrbin, limits: TurnLimits, boat: VirtualBoat) -> bool:
    """Return whether the planned turn keeps the rudder busy: it tells of its own strength then, not of wind."""
    is_over = abs(boat.rudder - rudder_for(model, 0.0, 0.0)) > TURNING_RUDDER
    return is_over or abs(boat.rate) > TURNING_SHARE * limits.rate_max


def turning_time(model: Norrbin, limits: TurnLimits, turn: float) -> float:
    """Return how long [s] the boat may need for a `turn` [rad]; a touch is no turn."""
    if abs(turn) < NO_TURN:
        return 0.0
    return TURNING_SLACK * abs(turn) / limits.rate_max + SETTLING_TIME_CONSTANTS * model.time_constant


def reset_threshold(model: Norrbin, limits: TurnLimits, is_late: bool, stuck: float) -> float:
    """Return how far [rad] the boat may be carried off from the planned turn before it is planned anew.

    is_late: no ordered turn is under way any more. stuck: how long [s] the rudder has been at its stop. A boat that
    keeps a course is carried off where the rudder has been there for as long as it takes from stop to stop. What lasts
    less is a wave, and the law brings the boat back from it sooner than a turn planned from where the wave threw it.
    """
    if model.n1 < 0.0:
        return RESET_BEYOND_EARLY
    if not is_late:
        return RESET_BEYOND
    return RESET_BEYOND_EARLY if stuck * limits.rudder_rate > 2.0 * limits.rudder_max else math.inf


def reset_reference(model: Norrbin, limits: TurnLimits, heading: float, rate: float, rudder: float) -> VirtualBoat:
    """Return a virtual boat where the real one is, turning no faster than it may; `rudder` [rad] as it acts."""
    most = limits.rudder_max * limits.begins
    begun = clip(rudder, -most, most)
    return VirtualBoat(heading, clip(rate, -limits.rate_max, limits.rate_max), begun, NO_EVIDENCE)
