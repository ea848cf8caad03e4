"""Reference model for changes of heading: a virtual boat that turns with part of the real rudder.

The virtual boat obeys the identified Norrbin model, and its rudder keeps to a share of the real rudder's
angle and rate. Its heading, rate and acceleration are therefore a manoeuvre that the real boat can follow
with rudder to spare. It is steered by looking ahead: D(r, delta) is the angle it would still turn through if
it began to stop now, found by simulating the stop. With the heading still to go e and the error that a stop
now would leave, e - D, the wanted acceleration is

    r' = -kappa r + mu (e - D),   held to what rate and rudder allow.

A turn is begun with more of the rudder than it is ended with: a boat whose rudder is weaker than the model's is slow to
turn then, and `hold_back` waits for it, but the rudder left is enough to stop it in time.

A course-unstable boat whose rudder is weaker than the model's may not be stopped any more from a rate that is easy for
the model. So its rudder's effectiveness is estimated (`Effectiveness`). Turns begin carefully; with evidence that the
model is right the rest is planned with more of the rudder, and what it needs more, or less, than planned is fed forward
from then on (`reference_of`). What it lags behind the plan is not caught up with while it turns: that would take it
beyond the rate that the plan keeps to. The plan goes with it instead (`couple`).

Close to the goal D = r/kappa, and the poles are -kappa and -mu/kappa: no overshoot; far from it, e = D is
the moment to meet the turn with counter-rudder.

How strong a boat's rudder shows itself while the boat turns: its K in units of the model's.

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

from autopilot.angles import wrap
from autopilot.guidance.tuning import (
    AHEAD,
    ARRIVED,
    BEGINS,
    BEGUN_UNSTABLE,
    BEHIND,
    BRAKED_RANGE,
    BRAKED_UNSTABLE,
    CARRIED_OFF,
    CAUTION,
    DOUBT,
    DOUBT_BIAS,
    DRAWN,
    DRAWN_RATE,
    EASED_UNSTABLE,
    FORGOTTEN,
    HARD_OVER,
    HELD_UNSTABLE,
    LEFT,
    MOST_SHARE,
    NO_TURN,
    RATE_UNSTABLE,
    RESET_BEYOND,
    RESET_BEYOND_EARLY,
    SETTLING_TIME_CONSTANTS,
    SHARPEST,
    SMOOTHED,
    STABLE_STOP,
    STOP_STEPS,
    STOP_STEPS_MOST,
    STRONGEST,
    SURE_RATE,
    SURE_RUDDER,
    TURNING_RUDDER,
    TURNING_SHARE,
    TURNING_SLACK,
    UNSTABLE_STOP,
    WEAKEST,
)
from autopilot.models.norrbin import Norrbin, damping, rudder_for, steady_rate, yaw_acceleration
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
    return clip(1.0 + share - caution * spread, WEAKEST, STRONGEST)


def _fitted(
    estimate: Effectiveness, doubt: float, doubt_bias: float, more: float, off: float
) -> tuple[float, float, float]:
    """Return q - 1 and b0 [rad/s], and how much of the doubt in q is left [-]; more, off: of y - u_, as the sums."""
    squared, time = estimate.sum_drive_squared + doubt, estimate.sum_time + doubt_bias
    known = squared * time - estimate.sum_drive * estimate.sum_drive
    share, push = more * time - off * estimate.sum_drive, off * squared - more * estimate.sum_drive
    return share / known, push / known, math.sqrt(doubt * time / known)


class TurnLimits(NamedTuple):
    """rudder_max [rad] and rudder_rate [rad/s] the virtual boat may use, and what follows from them: rate_max
    [rad/s], acceleration [rad/s^2], kappa [1/s] and mu [1/s^2]. A turn is begun with `begins` [-] times rudder_max and
    rudder_rate and with `begun` [rad/s^2]; rate_max is approached with no more than `eases` [rad/s^3]. watches: whether
    a boat as strong as its model is led quicker."""

    rudder_max: float
    rudder_rate: float
    rate_max: float
    acceleration: float
    kappa: float
    mu: float
    begins: float
    begun: float
    eases: float
    watches: bool


def relaxed(limits: TurnLimits) -> TurnLimits:
    """Return the limits of a turn that nobody ordered: it leads a boat back that was carried off, with rudder to spare.

    With more a boat that turns 40 % better than its model swings for minutes after a gust that its rudder did not hold.
    """
    most = limits.rudder_max, limits.rudder_rate, limits.rate_max, limits.acceleration
    return TurnLimits(*most, limits.kappa, limits.mu, 1.0, limits.acceleration, limits.eases, False)


class VirtualBoat(NamedTuple):
    """Heading [rad], rate [rad/s] and rudder [rad] of the virtual boat, and what the real one has shown beside it."""

    heading: float
    rate: float = 0.0
    rudder: float = 0.0
    effectiveness: Effectiveness = NO_EVIDENCE


def turn_limits(
    model: Norrbin,
    rudder_max: float,
    rudder_rate: float,
    share: float,
    rate_max: float = math.inf,
    begins: float = BEGINS,
) -> TurnLimits:
    """Return what the virtual boat may do with `share` of the rudder's angle [rad] and rate [rad/s].

    A turn is begun with `begins` times as much, where the rudder has it.
    A course-unstable boat brakes against its own tendency to turn: the worst of it is taken off.
    """
    usable = share * rudder_max
    begins = clip(MOST_SHARE / share, 1.0, begins)
    drive = model.gain * usable
    symmetric = symmetric_of(model)
    if model.n1 > 0.0:
        bound = steady_rate(symmetric, begins * usable)
        braking = drive
    else:
        # the rest of the rudder is kept to stop what the boat does by itself
        bound = _rate_held_by(symmetric, HELD_UNSTABLE * drive)
        slowness = model.time_constant * share * rudder_rate / usable if math.isfinite(rudder_rate) else math.inf
        braking = clip(BRAKED_UNSTABLE * slowness, *BRAKED_RANGE) * drive
    acceleration = braking / model.time_constant
    fastest = share * rudder_rate * (1.0 if model.n1 > 0.0 else RATE_UNSTABLE)
    jerk = min(model.gain * fastest / model.time_constant, SHARPEST * acceleration)
    quickness, pull = STABLE_STOP if model.n1 > 0.0 else UNSTABLE_STOP
    kappa = quickness * jerk / acceleration
    begun, eases, watches = begins * acceleration, math.inf, False
    if model.n1 < 0.0:
        begun = max(acceleration, BEGUN_UNSTABLE * drive / model.time_constant)
        eases, watches = EASED_UNSTABLE * jerk, True
    fastest_turn = min(rate_max, 0.98 * bound)
    return TurnLimits(
        usable, fastest, fastest_turn, acceleration, kappa, pull * kappa * kappa, begins, begun, eases, watches
    )


def preset_rate(rate_max: float, curvature_max: float, speed: float) -> float:
    """Return the rate [rad/s] that turns are preset to at `speed` U [m/s]: r = U/R, or `rate_max` [rad/s] if slower.

    curvature_max: 1/R [1/m], inf for a radius of nothing. What the rudder allows is for `turn_limits` to say.
    """
    return min(rate_max, speed * curvature_max)


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
    if not math.isfinite(horizon):
        return math.nan
    dt = min(horizon / STOP_STEPS, model.time_constant)
    turned = 0.0
    for _ in range(min(STOP_STEPS_MOST, math.ceil(horizon / dt))):
        wanted = clip(-limits.kappa * rate, -limits.acceleration, limits.acceleration)
        new_rate, rudder = _rate_and_rudder(model, limits, (rate, rudder), wanted, dt, 1.0)
        turned += 0.5 * dt * (rate + new_rate)
        rate = new_rate
    return turned + rate / limits.kappa


def _rate_and_rudder(
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


def turn_step(model: Norrbin, limits: TurnLimits, boat: VirtualBoat, target: float, dt: float) -> VirtualBoat:
    """Return the virtual boat `dt` [s] later on its way to the heading `target` [rad], the short way round."""
    straight = rudder_for(model, 0.0, 0.0)
    if abs(wrap(target - boat.heading)) + abs(boat.rate) + abs(boat.rudder - straight) < ARRIVED:
        # no need to look ahead from where there is nowhere to go
        return VirtualBoat(target, 0.0, straight, NO_EVIDENCE)
    limits = scaled_by_confidence(model, limits, boat)
    finest = min(0.2 * model.time_constant, 0.4 / limits.kappa)
    steps = max(1, min(20, math.ceil(dt / finest)))
    for _ in range(steps):
        boat = _substep(model, limits, boat, target, dt / steps)
    return boat


def _substep(model: Norrbin, limits: TurnLimits, boat: VirtualBoat, target: float, dt: float) -> VirtualBoat:
    error = wrap(target - boat.heading)
    left = error - stop_angle(model, limits, boat.rate, boat.rudder)
    wanted = -limits.kappa * boat.rate + limits.mu * left
    wanted = clip(wanted, -_towards(limits, limits.rate_max + boat.rate), _towards(limits, limits.rate_max - boat.rate))
    more, most = (limits.begins, limits.begun) if wanted * boat.rate >= 0.0 else (1.0, limits.acceleration)
    wanted = clip(wanted, -most, most)
    rate, rudder = _rate_and_rudder(model, limits, (boat.rate, boat.rudder), wanted, dt, more)
    heading = wrap(boat.heading + 0.5 * dt * (boat.rate + rate))
    return VirtualBoat(heading, rate, rudder, boat.effectiveness)


def _towards(limits: TurnLimits, left: float) -> float:
    """Return the most acceleration [rad/s^2] with `left` [rad/s] to the fastest rate: it must end there."""
    if left <= 0.0 or limits.eases == math.inf:
        return limits.kappa * left
    return min(limits.kappa * left, math.sqrt(2.0 * limits.eases * left))


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
    """Return the limits for a boat that has shown itself as strong as `boat` knows of it."""
    if not limits.watches:
        return limits
    strong = rudder_effectiveness(model, limits.rudder_max, boat.effectiveness, CAUTION)
    sure = clip((strong - WEAKEST) / (1.0 - WEAKEST), 0.0, 1.0)
    rudder = 1.0 + sure * (SURE_RUDDER - 1.0)
    return TurnLimits(
        limits.rudder_max * rudder,
        limits.rudder_rate * rudder,
        limits.rate_max * (1.0 + sure * (SURE_RATE - 1.0)),
        limits.acceleration * rudder,
        limits.kappa,
        limits.mu,
        max(limits.begins / rudder, 1.0),
        limits.begun,
        limits.eases,
        limits.watches,
    )


def reference_of(model: Norrbin, limits: TurnLimits, boat: VirtualBoat) -> Reference:
    """Return psi_d, psi_d' and psi_d'' of the virtual boat.

    psi_d'' is what makes the law tell the real rudder what the boat has been seen to need for the planned one.
    """
    rudder = boat.rudder
    if limits.watches:
        rudder /= rudder_effectiveness(model, limits.rudder_max, boat.effectiveness)
    return Reference(boat.heading, boat.rate, yaw_acceleration(model, boat.rate, rudder))


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
    ahead = wrap(heading - boat.heading)
    if limits.watches or ahead * boat.rate <= 0.0 or abs(ahead) <= AHEAD or not is_turning(model, limits, boat):
        return boat
    side = math.copysign(1.0, ahead)
    room = side * (wrap(target - boat.heading) - stop_angle(model, limits, boat.rate, boat.rudder))
    shift = min(abs(ahead) - AHEAD, max(room, 0.0))
    return VirtualBoat(wrap(boat.heading + side * shift), boat.rate, boat.rudder, boat.effectiveness)


def side_hard_over(command: float, angle_max: float) -> int:
    """Return the side, 1 or -1, on which a rudder `command` [rad] stands at its stop; 0: on neither."""
    if abs(command) < HARD_OVER * angle_max:
        return 0
    return 1 if command > 0.0 else -1


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
