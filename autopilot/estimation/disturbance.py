"""How quickly wind and current change, learnt from the bias that the filter finds.

The bias b wanders, b' = white noise of the density q. Its means over a time t, taken twice, and then over five times as
long,

    t x' = b - x,   t y' = x - y,   5 t z' = y - z,

lie apart by y - z, and E[(y - z)^2] = SPREAD t q: waves are too quick to show in y, trim too slow to part it from z.
A rudder that does more or less than the model says looks like a bias, too, that goes with it. With the same means v and
w of the rudder's angle, q is learnt as the sea is (`waves`), by the estimate and what is not known of it,

    q += share (((y - z)^2 - STRENGTH_ERROR^2 (v - w)^2) / (GUST_SPREAD t) + doubt - q),

where the difference is positive.

Without it the filter has one density for all weathers: with a low one gusts are put down to the waves, which grow until
they explain them, with a high one the rudder answers waves and noise.

Derived here: d = y - z is b' through 5 t/((1 + t s)^2 (1 + 5 t s)).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.estimation.tuning import (
    DOUBT_SHARE,
    GUST_BIAS_FOUND,
    GUST_BIAS_UNKNOWN,
    GUST_LONGER,
    GUST_MEMORY,
    GUST_SPREAD,
    GUST_SURGE,
    STRENGTH_ERROR,
)


class Means(NamedTuple):
    """Of an angle [rad]: x, y and z of the module's equations."""

    first: float
    second: float
    third: float


class Intensity(NamedTuple):
    """density: q [rad^2/s], 0 where it is not learnt; the means of bias and rudder, and the bias's variance [rad^2], 0
    before anything is known."""

    density: float
    bias: Means
    rudder: Means
    variance: float


NO_MEANS = Means(0.0, 0.0, 0.0)
NO_INTENSITY = Intensity(0.0, NO_MEANS, NO_MEANS, 0.0)


class Changes(NamedTuple):
    """Least and largest density [rad^2/s] that is to be believed, and the time t [s] of the means."""

    least: float
    most: float
    time: float


def followed(means: Means, angle: float, quick: float, slow: float) -> Means:
    """Return the means after a step that is worth the shares `quick` and `slow` of t and of 5 t."""
    first = means.first + quick * (angle - means.first)
    second = means.second + quick * (first - means.second)
    return Means(first, second, means.third + slow * (second - means.third))


def adapt_intensity(
    intensity: Intensity, changes: Changes, bias: float, variance: float, rudder: float, dt: float
) -> Intensity:
    """Return what is known of the gusts `dt` [s] later: a `bias` [rad], known to a `variance` [rad^2], and the `rudder`
    [rad] as it stands."""
    density, known = min(max(intensity.density, changes.least), changes.most), intensity.variance
    if (
        known == 0.0
        or variance > GUST_BIAS_UNKNOWN
        or variance < known * math.exp(-dt / (GUST_BIAS_FOUND * changes.time))
    ):
        return Intensity(density, Means(bias, bias, bias), Means(rudder, rudder, rudder), variance)
    quick, slow = -math.expm1(-dt / changes.time), -math.expm1(-dt / (GUST_LONGER * changes.time))
    pushed, steered = followed(intensity.bias, bias, quick, slow), followed(intensity.rudder, rudder, quick, slow)
    apart, explained = pushed.second - pushed.third, STRENGTH_ERROR * (steered.second - steered.third)
    scale = 1.0 / (GUST_SPREAD * changes.time)
    moved = max(apart * apart - explained * explained, 0.0)
    seen = min(scale * moved, GUST_SURGE * density) + min(scale * DOUBT_SHARE * variance, density)
    density -= math.expm1(-dt / max(GUST_MEMORY, 2.0 * GUST_LONGER * changes.time)) * (seen - density)
    return Intensity(min(max(density, changes.least), changes.most), pushed, steered, variance)


def unsettled_intensity(intensity: Intensity) -> Intensity:
    """Return the gusts for a bias that is to be found anew."""
    return Intensity(intensity.density, NO_MEANS, NO_MEANS, 0.0)


def is_finite(intensity: Intensity) -> bool:
    """Return whether everything is finite."""
    return math.isfinite(intensity.density + sum(intensity.bias) + sum(intensity.rudder) + intensity.variance)
