"""The waves' part of the heading: a lightly damped oscillator whose size and frequency are learnt on the way.

    h' = s,   s' = -w0^2 (h + e) - 2 xi w0 (s + c h) - c s + white noise,   e' = c h,   c = kappa w0

which is white noise through s/((s + c)(s^2 + 2 xi w0 s + w0^2)): a spectrum with its peak at the frequency of encounter
and none at zero, so that a lasting heading error is never put down to the waves, and a rate of finite variance, so that
a gyro counts for what it is worth. (The usual s/(s^2 + 2 xi w0 s + w0^2), Fossen 2011, section 8.2, has none such.)

Two running means describe the sea, V = E[h^2] and U = E[s^2]; in balance U = (1 + 2 xi kappa) w0^2 V.
They are learnt as expectation and maximisation learn a variance (Shumway and Stoffer 1982), from the filter's estimate
*and* its covariance, V += share (h^2 + P_hh - V): a filter that sees little does not take this for calm, and a calm
that the compass shows makes the oscillator fade away.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.estimation.tuning import (
    WAVE_CORNER,
    WAVE_DAMPING,
    WAVE_DEVIATION_FIRST,
    WAVE_EXTREME,
    WAVE_EXTREME_LEAST,
    WAVE_FREQUENCY_FIRST,
    WAVE_FREQUENCY_LEAST,
    WAVE_FREQUENCY_MOST,
    WAVE_MEMORY,
    WAVE_MEMORY_FIRST,
    WAVE_SHARPNESS,
    WAVE_STIFFENING,
    WAVE_VARIANCE_LEAST,
)


class Sea(NamedTuple):
    """What the heading feels of the sea: E[h^2] [rad^2], E[s^2] [(rad/s)^2], and how long [s] it has been watched.

    The variances are 0 where waves are left out.
    """

    heading: float
    rate: float
    watched: float = 0.0


NO_SEA = Sea(0.0, 0.0)
FIRST_SEA = Sea(WAVE_DEVIATION_FIRST**2, (WAVE_DEVIATION_FIRST * WAVE_FREQUENCY_FIRST) ** 2 * WAVE_STIFFENING)


class WaveStep(NamedTuple):
    """Exact transition of (h, s, e) over one step, a row after the other."""

    a33: float
    a34: float
    a35: float
    a43: float
    a44: float
    a45: float
    a53: float
    a54: float
    a55: float


def frequency(sea: Sea) -> float:
    """Return the frequency of encounter w0 [rad/s]; 0 where waves are left out."""
    return math.sqrt(sea.rate / (sea.heading * WAVE_STIFFENING)) if sea.heading > 0.0 else 0.0


def in_balance(sea: Sea) -> tuple[float, float, float, float]:
    """Return the stationary E[h^2], E[s^2], E[s e] and E[e^2]; E[h s] and E[h e] are 0."""
    w0 = frequency(sea)
    return (
        sea.heading,
        sea.rate,
        -WAVE_CORNER * w0 * sea.heading,
        WAVE_CORNER * (2.0 * WAVE_DAMPING + WAVE_CORNER) * sea.heading,
    )


def wave_step(sea: Sea, dt: float) -> WaveStep:
    """Return the transition over `dt` [s]; `sea` must not be NO_SEA."""
    w0 = frequency(sea)
    decay, corner = WAVE_DAMPING * w0, WAVE_CORNER * w0
    ringing = w0 * math.sqrt(1.0 - WAVE_DAMPING * WAVE_DAMPING)
    envelope = math.exp(-decay * dt)
    cosine = envelope * math.cos(ringing * dt)
    # the oscillator g = h + e by itself, g'' + 2 xi w0 g' + w0^2 g = noise
    g2 = envelope * math.sin(ringing * dt) / ringing
    g1, v1, v2 = cosine + decay * g2, -w0 * w0 * g2, cosine - decay * g2
    # e' = c (g - e), with the row (c/D) ((c - 2 decay)(A - E) - ..) of c (M + c I)^-1 (exp(M dt) - E I)
    left = math.exp(-corner * dt)
    spread, share = corner - 2.0 * decay, corner / (corner * corner - 2.0 * decay * corner + w0 * w0)
    e1, e2 = share * (spread * (g1 - left) - v1), share * (spread * g2 - v2 + left)
    # back to h = g - e, s = g' - c h
    a53, a54, a55 = e1 + corner * e2, e2, e1 + left
    a33, a34, a35 = g1 + corner * g2 - a53, g2 - a54, g1 - a55
    return WaveStep(
        a33,
        a34,
        a35,
        v1 + corner * v2 - corner * a33,
        v2 - corner * a34,
        v1 - corner * a35,
        a53,
        a54,
        a55,
    )


def known(sea: Sea) -> float:
    """Return which share of the wave motion is to be believed: none until the sea has been watched for
    WAVE_MEMORY_FIRST, all of it after twice as long. At first every motion of the boat is taken for a wave."""
    return min(max(sea.watched / WAVE_MEMORY_FIRST - 1.0, 0.0), 1.0)


def is_extreme(sea: Sea, wave: float) -> bool:
    """Return whether a heading `wave` [rad] put down to the waves is too much for them."""
    return wave * wave > _most_squared(sea.heading)


def plausible_share(deviation: float, wave: float) -> float:
    """Return which share of a heading `wave` [rad] put down to waves of this standard deviation [rad] is one: all of it
    up to where it is too much for them, and no more than that."""
    return min(math.sqrt(_most_squared(deviation * deviation)) / abs(wave), 1.0) if wave != 0.0 else 1.0


def _most_squared(variance: float) -> float:
    return WAVE_EXTREME * WAVE_EXTREME * variance + WAVE_EXTREME_LEAST * WAVE_EXTREME_LEAST


def learn(sea: Sea, heading: float, rate: float, dt: float) -> Sea:
    """Return the sea after `dt` [s] in which h^2 and s^2 were expected at `heading` and `rate`."""
    watched = sea.watched + dt
    share = 1.0 - math.exp(-dt / min(max(watched, WAVE_MEMORY_FIRST), WAVE_MEMORY))
    variance, rate_variance = sea.heading + share * (heading - sea.heading), sea.rate + share * (rate - sea.rate)
    # a swing too slow for waves is taken for one only as far as its rate goes
    variance = max(min(variance, rate_variance / (WAVE_FREQUENCY_LEAST**2 * WAVE_STIFFENING)), WAVE_VARIANCE_LEAST)
    slowest, fastest = (
        WAVE_FREQUENCY_LEAST**2 * WAVE_STIFFENING * variance,
        WAVE_FREQUENCY_MOST**2 * WAVE_STIFFENING * variance,
    )
    return Sea(variance, min(max(rate_variance, slowest), fastest), watched)


def filtered_share(frequency: float, corner: float) -> float:
    """Return which share of waves of `frequency` [rad/s] is kept from the rudder: half of it at `corner` [rad/s].

    A boat whose loop is quicker than the waves holds its heading against them; a slower one only wears its rudder.
    """
    if corner <= 0.0:
        return 1.0
    if math.isinf(corner):
        return 0.0
    ratio = min(frequency / corner, 1.0e3) ** WAVE_SHARPNESS
    return ratio / (1.0 + ratio)
