"""What the rudder of a rate-weighted regulator makes of the waves that it is shown (`autopilot.steering.wave_shares`).

The filter holds the waves for a motion h of their own on top of the boat's heading. What makes it is the push

    a = h'' + n h',   n = n1/T,   worth the rudder angle a T/K.

For a law with a weight on the rudder's rate, `autopilot.control.design`, the waves are states like any other. It is
shown all of the heading and of the rate, and with w' = M w, w = (h, h', e), the filter's oscillator, the u' that makes
the mean of e^2 + weight^2 u'^2 least is

    u' = -k3 (u - delta - delta_w),   delta_w = -(T/(K k3)) a(N(M) p(-M)^-1 w),
    N(s) = (a k3 - b) s^2 + (c - b k3) s + k3 c,   p(s) = s^3 + a s^2 + b s + c, the closed loop,

the slow waves cancelled, the quick ones kept from the rudder, each neither early nor late. For a push e^(s t) the best
steady rudder is -share T/K, share = c^2/(p(s) p(-s)); N/p(-s) is what this leaves to delta_w, where nothing of p(s) is
left to divide by: a wave may die away as quickly as the loop settles.

Derived here, from e'' + n e' = (K/T) u + a.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.estimation.tuning import WAVE_CORNER, WAVE_DAMPING, WAVE_STIFFENING
from autopilot.models.norrbin import Norrbin

LAGGED = -WAVE_CORNER / WAVE_STIFFENING
"""e w0 in units of h': the best guess of e that goes by h and h' alone."""
RINGING = math.sqrt(1.0 - WAVE_DAMPING * WAVE_DAMPING)


def swung(heading: float, rate: float, frequency: float, ahead: float) -> tuple[float, float]:
    """Return wave heading [rad] and rate [rad/s] `ahead` [s] later, as far as they swing on by themselves."""
    swing = frequency * math.sqrt(WAVE_STIFFENING)
    cosine, sine = math.cos(swing * ahead), math.sin(swing * ahead)
    return cosine * heading + sine / swing * rate, cosine * rate - swing * sine * heading


class ClosedLoop(NamedTuple):
    """The regulator's: its third step k3 [1/s], and b [1/s^2] and c [1/s^3] of p(s); a is k3 + n."""

    k3: float
    b: float
    c: float


def wave_rudder(model: Norrbin, loop: ClosedLoop, heading: float, rate: float, frequency: float) -> float:
    """Return delta_w [rad] for waves of this `heading` [rad], `rate` [rad/s] and `frequency` [rad/s], by the module's
    equations: a polynomial of M by its values at the eigenvalues of M."""
    if frequency <= 0.0:
        return 0.0
    k3, b, c = loop
    n = model.n1 / model.time_constant
    a = k3 + n
    decay, ringing, corner = WAVE_DAMPING * frequency, RINGING * frequency, WAVE_CORNER * frequency
    square = frequency * frequency
    s = complex(-decay, ringing)
    found = ((a * k3 - b) * s * s + (c - b * k3) * s + k3 * c) / (((a - s) * s - b) * s + c)
    slope = found.imag / ringing
    level = found.real + slope * decay
    real = ((a * k3 - b) * corner * corner - (c - b * k3) * corner + k3 * c) / (
        ((a + corner) * corner + b) * corner + c
    )
    bend = (real - level + slope * corner) / (square + corner * (corner - 2.0 * decay))
    h0, h1, e0 = heading, rate, LAGGED * rate / frequency
    h2, e1 = -square * (h0 + e0) - 2.0 * decay * (h1 + corner * h0) - corner * h1, corner * h0
    h3, e2 = -square * (h1 + e1) - 2.0 * decay * (h2 + corner * h1) - corner * h2, corner * h1
    h4 = -square * (h2 + e2) - 2.0 * decay * (h3 + corner * h2) - corner * h3
    # level + slope s + bend (s^2 + 2 decay s + square), of the push h'' + n h'
    straight, once = level + bend * square, slope + 2.0 * decay * bend
    push = straight * (h2 + n * h1) + once * (h3 + n * h2) + bend * (h4 + n * h3)
    return -model.time_constant / (model.gain * k3) * push
