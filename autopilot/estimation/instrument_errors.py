"""How compass and rate sensor err, learnt on the way: the rate sensor's standing error, and the noise of both.

x = (psi, g): the measured rate w carries the heading, psi' = w - g, and g' = 0 + noise; a compass shows psi. A Kalman
filter of two states on measurements alone: no model of boat or rudder is in it, so that neither wind nor a wrong model
is taken for an error of the gyro, nor the other way round. Sensors that lag, deviate or are read at different moments
lie apart by an angle that goes with the rate of turn, for which a heading counts for less in a turn. Where they drift
apart all the same, the heading is begun anew and g is looked for again: an angle that stays is none of a gyro's.

Noise is what an instrument's successive innovations v go back and forth by, d(k) = v(k) - v(k-1). With the innovation's
variance P + R, P what the filter does not know of the boat, white innovations have E[-d(k) d(k-1)] = P + R, so

    R += share (-d(k) d(k-1) - P - R),

and what lies to one side for longer, or comes and stays, wind, a wrong model, a lag, counts for nothing. R is at least
the file's: an instrument that seems better than that may be damped, and its errors no white noise.

Source: the complementary filter of compass and gyro with the gyro's bias as a state, Farrell 2008, Aided Navigation,
section 10.3; noise by what innovations correlate with those before, Mehra 1970; scalar code over NamedTuples, which
campaigns compile as it is.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.estimation.tuning import (
    NOISE_MEMORY,
    NOISE_MOST,
    RATE_BIAS_APART,
    RATE_BIAS_CHANGE,
    RATE_BIAS_UNKNOWN,
    RATE_COMPASS_LAG,
    RATE_HELD,
    RATE_MEAN_TIME,
)


class RateBias(NamedTuple):
    """What is known of g at `time` [s], the newest heading having come at `seen` [s].

    heading [rad]: psi, nan before the first; rate [rad/s]: the newest w, nan where there is no rate sensor; bias
    [rad/s]: g; p00 [rad^2], p01, p11 [(rad/s)^2]: the covariance of both; apart [rad]: how far the compass is from psi
    on the average of late; turning [rad/s]: how fast the boat turned of late.
    """

    time: float
    heading: float
    rate: float
    bias: float
    p00: float
    p01: float
    p11: float
    apart: float
    turning: float
    seen: float


NO_RATE_BIAS = RateBias(-math.inf, math.nan, math.nan, 0.0, 0.0, 0.0, RATE_BIAS_UNKNOWN, 0.0, 0.0, -math.inf)
"""Before the first rate: it is supposed to be right, within what such sensors are off."""


def rate_bias_step(before: RateBias, measured: tuple[float, float, float], noise: tuple[float, float]) -> RateBias:
    """Return what is known after a heading [rad] and a rate [rad/s] at a time [s], nan where they were not measured.

    noise: the variances of a heading [rad^2] and of a rate [(rad/s)^2].
    """
    (time, heading, rate), (of_heading, of_rate) = measured, noise
    last, psi, held, bias, p00, p01, p11, apart, turning, seen = before
    was_rate, is_rate = not math.isnan(held), not math.isnan(rate)
    if not (was_rate or is_rate):
        return before
    dt = time - last
    rate = rate if is_rate else held
    if not 0.0 <= dt <= RATE_HELD or math.isnan(psi):
        # g outlasts a gap, and is known as well as before it
        return RateBias(time, heading, rate, bias, of_heading, 0.0, p11, 0.0, turning, time)
    mean = 0.5 * (held + rate) if was_rate else rate
    psi += dt * (mean - bias)
    turned = mean - bias if mean > bias else bias - mean
    turning -= math.expm1(-dt / RATE_MEAN_TIME) * (turned - turning)
    p00 += dt * (dt * (p11 + of_rate) - 2.0 * p01)
    p01 -= dt * p11
    p11 += RATE_BIAS_CHANGE * dt
    if math.isnan(heading):
        psi = psi if -PI < psi <= PI else wrap(psi)
        return RateBias(time, psi, rate, bias, p00, p01, p11, apart, turning, seen)
    off = heading - psi
    off = off if -PI < off <= PI else wrap(off)
    lag = RATE_COMPASS_LAG * turning
    apart -= math.expm1(-(time - seen) / RATE_MEAN_TIME) * (off - apart)
    if apart * apart > RATE_BIAS_APART + of_heading + 4.0 * lag * lag:
        p11 = p11 if p11 > RATE_BIAS_UNKNOWN else RATE_BIAS_UNKNOWN
        return RateBias(time, heading, rate, bias, of_heading, 0.0, p11, 0.0, turning, time)
    total = p00 + of_heading + lag * lag
    k0, k1 = p00 / total, p01 / total
    psi += k0 * off
    psi = psi if -PI < psi <= PI else wrap(psi)
    bias += k1 * off
    return RateBias(time, psi, rate, bias, p00 - k0 * p00, p01 - k0 * p01, p11 - k1 * p01, apart, turning, time)


class Noise(NamedTuple):
    """An instrument's noise: its variance R, 0 before anything is known; the newest innovation, by how much it was more
    than the one before, nan where none came shortly before, and its time [s]."""

    variance: float
    innovation: float
    step: float
    time: float


NO_NOISE = Noise(0.0, 0.0, math.nan, -math.inf)
"""Before the first measurement."""


def noise_step(before: Noise, filed: float, innovation: float, unknown: float, time: float, longest: float) -> Noise:
    """Return what is known of the noise after an `innovation` at `time` [s], of whose variance `unknown` is the boat's;
    filed: the variance that the file says. Two innovations further apart than `longest` [s] say nothing of it."""
    known, last, back, seen = before
    known, most = known if known > filed else filed, NOISE_MOST * NOISE_MOST * filed
    gap = time - seen
    if not 0.0 < gap <= longest:
        forth = math.nan
    else:
        forth = innovation - last
        if not math.isnan(back):
            known -= math.expm1(-gap / NOISE_MEMORY) * (-forth * back - unknown - known)
    known = filed if known < filed else most if known > most else known
    return Noise(known, innovation, forth, time)
