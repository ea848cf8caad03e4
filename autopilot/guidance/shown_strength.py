"""How strong a boat's rudder shows itself while the boat turns: its K in units of the model's.

With K a share q of the model's and a push b0 that the estimator has not learnt,

    T r' = q u - damping(r) + b0,   u = K delta.

Low-passed over tau = SMOOTHED T this needs no derivative of r:

    y = T (r_)' + (u - m)_ = q u_ + b0,   m = T r' by the model = u - damping(r),

where _ marks what is low-passed. q and b0 are found by least squares, weighed against the belief that q is 1 and b0 is
0. Rudder to one side alone does not tell a strong boat from one that is pushed, counter-rudder does; until then q is
left in doubt, and who asks with care is told less.

Derived here; a low-pass in place of a derivative is the state variable filter of Young (1981, Automatica 17, 23).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.models.norrbin import Norrbin, yaw_acceleration
from autopilot.models.steering_gear import clip

WEAKEST, STRONGEST = 0.7, 1.0 / 0.7
"""q is looked for between these."""
SMOOTHED = 1.0
"""tau in units of T."""
DOUBT = 0.0011
"""The whole of a planned rudder, held over for so many time constants, counts for as much as the belief that q is 1."""
DOUBT_BIAS = 0.01
"""So many time constants count for as much as the belief that there is no b0."""
LEFT = 10.0
"""And so many times what the fit leaves over is doubt too: gusts, waves and noise are no constant push."""
FORGOTTEN = 4.0
"""Evidence fades in so many time constants."""


class Shown(NamedTuple):
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


NOTHING_SHOWN = Shown(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def watched(model: Norrbin, shown: Shown, rate: float, rudder: float, dt: float) -> Shown:
    """Return what has been shown after `dt` [s] more at `rate` r [rad/s] with `rudder` delta [rad], bias included."""
    if dt <= 0.0:
        return shown
    tau = SMOOTHED * model.time_constant
    share, kept = 1.0 - math.exp(-dt / tau), math.exp(-dt / (FORGOTTEN * model.time_constant))
    before = shown.rate if shown.sum_time > 0.0 else rate
    slow = before + share * (rate - before)
    moment = shown.moment + share * (model.time_constant * yaw_acceleration(model, rate, rudder) - shown.moment)
    drive = shown.drive + share * (model.gain * rudder - shown.drive)
    found = model.time_constant * (slow - before) / dt + drive - moment
    return Shown(
        slow,
        moment,
        drive,
        kept * shown.sum_drive_squared + dt * drive * drive,
        kept * shown.sum_drive_found + dt * drive * found,
        kept * shown.sum_drive + dt * drive,
        kept * shown.sum_time + dt,
        kept * shown.sum_found + dt * found,
        kept * shown.sum_found_squared + dt * found * found,
    )


def strength(model: Norrbin, rudder: float, shown: Shown, care: float = 0.0) -> float:
    """Return q [-], less `care` times what is left of the doubt: 1 - care before anything was shown.

    `rudder` [rad] is what turns are planned with.
    """
    most = model.gain * rudder
    doubt, doubt_bias = DOUBT * model.time_constant * most * most, DOUBT_BIAS * model.time_constant
    more, off = shown.sum_drive_found - shown.sum_drive_squared, shown.sum_found - shown.sum_drive
    share, push, _ = _fitted(shown, doubt, doubt_bias, more, off)
    strange = shown.sum_found_squared - 2.0 * shown.sum_drive_found + shown.sum_drive_squared
    left = max(strange - share * more - push * off, 0.0) / (shown.sum_time + doubt_bias)
    grown = 1.0 + LEFT * left / (DOUBT * most * most)
    share, _, spread = _fitted(shown, grown * doubt, grown * doubt_bias, more, off)
    return clip(1.0 + share - care * spread, WEAKEST, STRONGEST)


def _fitted(shown: Shown, doubt: float, doubt_bias: float, more: float, off: float) -> tuple[float, float, float]:
    """Return q - 1 and b0 [rad/s], and how much of the doubt in q is left [-]; more, off: of y - u_, as the sums."""
    squared, time = shown.sum_drive_squared + doubt, shown.sum_time + doubt_bias
    known = squared * time - shown.sum_drive * shown.sum_drive
    share, push = more * time - off * shown.sum_drive, off * squared - more * shown.sum_drive
    return share / known, push / known, math.sqrt(doubt * time / known)
