"""How strong a boat's rudder shows itself while the boat turns: its K in units of the model's.

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

from autopilot.guidance.tuning import DOUBT, DOUBT_BIAS, FORGOTTEN, LEFT, SMOOTHED, STRONGEST, WEAKEST
from autopilot.models.norrbin import Norrbin, yaw_acceleration
from autopilot.models.steering_gear import clip


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
