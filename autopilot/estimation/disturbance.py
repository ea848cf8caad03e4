"""What moves the boat beside its rudder: what the file says of it, and what is learnt on the way, the waves, and how
quickly wind and current change.

The waves' part of the heading is a lightly damped oscillator whose size and frequency are learnt,

    h' = s,   s' = -w0^2 (h + e) - 2 xi w0 (s + c h) - c s + white noise,   e' = c h,   c = kappa w0

which is white noise through s/((s + c)(s^2 + 2 xi w0 s + w0^2)): a spectrum with its peak at the frequency of encounter
and none at zero, so that a lasting heading error is never put down to the waves, and a rate of finite variance, so that
a gyro counts for what it is worth. (The usual s/(s^2 + 2 xi w0 s + w0^2), Fossen 2011, section 8.2, has none such.)

Two running means describe the sea, V = E[h^2] and U = E[s^2]; in balance U = (1 + 2 xi kappa) w0^2 V.
They are learnt as expectation and maximisation learn a variance (Shumway and Stoffer 1982), from the filter's estimate
*and* its covariance, V += share (h^2 + P_hh - V): a filter that sees little does not take this for calm, and a calm
that the compass shows makes the oscillator fade away.

Wind, current and trim are the bias b that the filter finds. It wanders, b' = white noise of the density q. Its means
over a time t, taken twice, and then over five times as long,

    t x' = b - x,   t y' = x - y,   5 t z' = y - z,

lie apart by y - z, and E[(y - z)^2] = SPREAD t q: waves are too quick to show in y, trim too slow to part it from z.
A rudder that does more or less than the model says looks like a bias, too, that goes with it. With the same means v and
w of the rudder's angle, q is learnt as the sea is, by the estimate and what is not known of it,

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
    BIAS_CHANGE,
    BIAS_CHANGE_IN_WAVES,
    BIAS_CHANGE_PUSHED,
    BIAS_CHANGE_STOPPED,
    BIAS_TIME,
    DISTURBANCE_TIME,
    DOUBT_SHARE,
    GUST,
    GUST_BIAS_FOUND,
    GUST_BIAS_UNKNOWN,
    GUST_LONGER,
    GUST_MEMORY,
    GUST_SPREAD,
    GUST_SURGE,
    GUST_TIME_LEAST,
    GUST_TIME_SHARE,
    LEAN_GROWTH,
    MODEL_ERROR,
    MODEL_ERROR_UNSTABLE,
    RATE_UNKNOWN,
    SEA,
    SLIDE_LASTS,
    SLIDE_UNKNOWN,
    STRENGTH_ERROR,
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
    WAVE_STIFFENING,
    WAVE_VARIANCE_LEAST,
)
from autopilot.models.norrbin import Norrbin, quickest_turn


class Sea(NamedTuple):
    """What the heading feels of the sea: E[h^2] [rad^2], E[s^2] [(rad/s)^2], and how long [s] it has been watched.

    The variances are 0 where waves are left out.
    """

    heading: float
    rate: float
    watched: float = 0.0


NO_SEA = Sea(0.0, 0.0)
FIRST_SEA = Sea(WAVE_DEVIATION_FIRST**2, (WAVE_DEVIATION_FIRST * WAVE_FREQUENCY_FIRST) ** 2 * WAVE_STIFFENING)


EXTREME_SQUARED, EXTREME_LEAST_SQUARED = WAVE_EXTREME * WAVE_EXTREME, WAVE_EXTREME_LEAST * WAVE_EXTREME_LEAST
SLOWEST, FASTEST = WAVE_FREQUENCY_LEAST**2 * WAVE_STIFFENING, WAVE_FREQUENCY_MOST**2 * WAVE_STIFFENING
"""E[s^2] in units of E[h^2] of the slowest waves and of the fastest."""
LAG = WAVE_CORNER * (2.0 * WAVE_DAMPING + WAVE_CORNER)
"""E[e^2] in units of E[h^2]."""


def frequency(sea: Sea) -> float:
    """Return the frequency of encounter w0 [rad/s]; 0 where waves are left out."""
    return math.sqrt(sea.rate / (sea.heading * WAVE_STIFFENING)) if sea.heading > 0.0 else 0.0


def in_balance(sea: Sea, w0: float) -> tuple[float, float, float, float]:
    """Return the stationary E[h^2], E[s^2], E[s e] and E[e^2]; E[h s] and E[h e] are 0. w0: the sea's `frequency`."""
    return sea.heading, sea.rate, -WAVE_CORNER * w0 * sea.heading, LAG * sea.heading


def is_extreme(sea: Sea, wave: float) -> bool:
    """Return whether a heading `wave` [rad] put down to the waves is too much for them."""
    return wave * wave > EXTREME_SQUARED * sea.heading + EXTREME_LEAST_SQUARED


def learn(sea: Sea, heading: float, rate: float, dt: float) -> Sea:
    """Return the sea after `dt` [s] in which h^2 and s^2 were expected at `heading` and `rate`."""
    before, rate_before, watched = sea
    watched += dt
    memory = WAVE_MEMORY_FIRST if watched < WAVE_MEMORY_FIRST else WAVE_MEMORY if watched > WAVE_MEMORY else watched
    share = 1.0 - math.exp(-dt / memory)
    variance, rate_variance = before + share * (heading - before), rate_before + share * (rate - rate_before)
    # a swing too slow for waves is taken for one only as far as its rate goes
    most = rate_variance / SLOWEST
    variance = most if most < variance else variance
    variance = WAVE_VARIANCE_LEAST if variance < WAVE_VARIANCE_LEAST else variance
    slowest, fastest = SLOWEST * variance, FASTEST * variance
    rate_variance = slowest if rate_variance < slowest else fastest if rate_variance > fastest else rate_variance
    return Sea(variance, rate_variance, watched)


Means = tuple[float, float, float]
"""Of an angle [rad]: x, y and z of the module's equations."""


class Intensity(NamedTuple):
    """density: q [rad^2/s], 0 where it is not learnt; the means of bias and rudder, and the bias's variance [rad^2], 0
    before anything is known."""

    density: float
    bias: Means
    rudder: Means
    variance: float


NO_MEANS: Means = (0.0, 0.0, 0.0)
NO_INTENSITY = Intensity(0.0, NO_MEANS, NO_MEANS, 0.0)


def adapt_intensity(
    intensity: Intensity,
    changes: tuple[float, float, float],
    bias: float,
    variance: float,
    rudder: float,
    dt: float,
) -> Intensity:
    """Return what is known of the gusts `dt` [s] later: a `bias` [rad], known to a `variance` [rad^2], and the `rudder`
    [rad] as it stands. changes: least and largest density [rad^2/s] that is to be believed, and the time t [s] of the
    means."""
    density, pushed, steered, known = intensity
    least, most, time = changes
    density = least if density < least else density
    density = most if density > most else density
    if known == 0.0 or variance > GUST_BIAS_UNKNOWN or variance < known * math.exp(-dt / (GUST_BIAS_FOUND * time)):
        return Intensity(density, (bias, bias, bias), (rudder, rudder, rudder), variance)
    quick, slow = -math.expm1(-dt / time), -math.expm1(-dt / (GUST_LONGER * time))
    x, y, z = pushed
    x += quick * (bias - x)
    y += quick * (x - y)
    z += slow * (y - z)
    u, v, w = steered
    u += quick * (rudder - u)
    v += quick * (u - v)
    w += slow * (v - w)
    apart, explained = y - z, STRENGTH_ERROR * (v - w)
    scale = 1.0 / (GUST_SPREAD * time)
    moved, surge = apart * apart - explained * explained, GUST_SURGE * density
    seen = scale * (0.0 if moved < 0.0 else moved)
    seen = surge if surge < seen else seen
    doubt = scale * DOUBT_SHARE * variance
    seen += density if density < doubt else doubt
    memory = 2.0 * GUST_LONGER * time
    memory = memory if memory > GUST_MEMORY else GUST_MEMORY
    density -= math.expm1(-dt / memory) * (seen - density)
    density = least if density < least else density
    density = most if density > most else density
    return Intensity(density, (x, y, z), (u, v, w), variance)


def reset_intensity(intensity: Intensity) -> Intensity:
    """Return the gusts for a bias that is to be found anew."""
    return Intensity(intensity.density, NO_MEANS, NO_MEANS, 0.0)


def raised_intensity(intensity: Intensity, changes: tuple[float, float, float], dt: float) -> Intensity:
    """Return what is known of the gusts after `dt` [s] in which the headings leant to one side: q has grown.

    A bias that is slow because no gusts are known explains none, so that b shows none of them, and q would learn none.
    One push raises q so often and not to its most, and that is forgotten; gusts raise it again and again.
    """
    density, (least, most, time) = intensity.density, changes
    density = least if density < least else density
    density *= math.exp(LEAN_GROWTH * dt / time)
    density = most if density > most else density
    return Intensity(density, intensity.bias, intensity.rudder, intensity.variance)


def reset_density(intensity: Intensity) -> Intensity:
    """Return the gusts as the least there are: what the headings lean to for longer is none."""
    return Intensity(0.0, intensity.bias, intensity.rudder, intensity.variance)


def slide_step(model: Norrbin, before: float, rate: float, most: float, dt: float) -> float:
    """Return what brakes a boat that slides [rad of rudder], `dt` [s] after it was braked by `before`; it turns at
    `rate` [rad/s], its rudder's limit is `most` [rad].

    The model has neither sway nor, without a log, the way that a turn takes: both may brake the boat by as much as its
    own damping, and more, or take from a course-unstable one what turns it. They build up with about its
    time constant, last longer than the turn, and turn no boat against its rudder: what a fault does.
    """
    one, square = model.n1, model.n2 * rate
    damped = (one if one > 0.0 else -one) + (square if square > 0.0 else -square) + model.n3 * rate * rate
    own = damped * rate / model.gain
    own = -most if own > most else most if own < -most else -own
    fades = 0.0 <= own < before or before < own <= 0.0
    lasts = SLIDE_LASTS * model.time_constant if fades else model.time_constant
    return before - math.expm1(-dt / lasts) * (own - before)


def slide_planned(model: Norrbin, before: float, rate: float, most: float, dt: float) -> tuple[float, float]:
    """Return what a planned turn at `rate` [rad/s] leaves of slide, see `slide_step`, and what it adds [rad^2/s] to
    what is unknown of that: of what is left of an old slide nothing."""
    slide = slide_step(model, before, rate, most, dt)
    left = before * math.exp(-dt / (SLIDE_LASTS * model.time_constant))
    added = slide * slide - left * left
    return slide, SLIDE_UNKNOWN * SLIDE_UNKNOWN * added / dt if dt > 0.0 and added > 0.0 else 0.0


class FilterNoise(NamedTuple):
    """Variances: heading [rad^2], rate [(rad/s)^2]; densities a second: acceleration [(rad/s)^2/s], bias [rad^2/s].

    model_error [s^(1/2)]: the rudder's yaw acceleration is wrong by this share, as white noise. With `waves` the
    sea is learnt and kept out of psi and r, and so is learnt how quickly the bias wanders, from `bias` to `gusty_bias`
    [rad^2/s], by what it does over `gust_time` [s] (`intensity`). `gust` [(rad/s)^2/s] and `gust_bias` [rad^2/s] take
    the places of `acceleration` and of that while the boat is pushed further than waves would; `gust_bias` also while
    the measurements lie to one side of what was expected for seconds. While the rudder is further over than `stop`
    [rad] the bias wanders by `stop_bias` [rad^2/s]: a boat that needs all of it is pushed, and comes back with a wrong
    rudder until the end of the push is learnt. It may be quick there: a rudder at its stop does not move with what is
    learnt. rate_unknown [(rad/s)^2]: of a rate of which nothing is known; two noisy headings a moment apart show rates
    that no ship turns with, and what a heavy one is once assumed to do it takes minutes to correct. slide [rad^2/s]:
    the ordered turn makes the boat slide.
    """

    heading: float
    rate: float
    acceleration: float
    bias: float
    model_error: float = 0.0
    waves: bool = False
    gust: float = 0.0
    gust_bias: float = 0.0
    stop: float = math.inf
    stop_bias: float = 0.0
    rate_unknown: float = RATE_UNKNOWN
    gusty_bias: float = 0.0
    gust_time: float = 1.0
    slide: float = 0.0


class Filtered(NamedTuple):
    """What the noise is worked out from: variances of heading [rad^2] and rate [(rad/s)^2], the time [s] in which wind
    and trim change, the rudder's stop [rad], beyond what order it counts as at its stop [rad], inf: never, and whether
    waves are filtered."""

    heading: float
    rate: float
    bias_time: float
    rudder_max: float
    stop: float
    waves: bool


def filter_noise(model: Norrbin, given: Filtered) -> FilterNoise:
    """Return the noise of a boat's filter: disturbances are rudder angles [rad], whose moment is K/T times them."""
    moment = model.gain / model.time_constant
    calm, bias = (GUST, BIAS_CHANGE_IN_WAVES) if given.waves else (SEA, BIAS_CHANGE)
    lasts = manoeuvre_time(model, given.rudder_max)
    error = MODEL_ERROR * math.sqrt(lasts) if model.n1 > 0.0 else MODEL_ERROR_UNSTABLE
    return FilterNoise(
        heading=given.heading,
        rate=given.rate,
        acceleration=(moment * calm) ** 2 * DISTURBANCE_TIME,
        bias=bias * bias / given.bias_time,
        model_error=error if given.waves else 0.0,
        waves=given.waves,
        gust=(moment * SEA) ** 2 * DISTURBANCE_TIME,
        gust_bias=BIAS_CHANGE_PUSHED * BIAS_CHANGE_PUSHED / given.bias_time,
        stop=given.stop,
        stop_bias=BIAS_CHANGE_STOPPED * BIAS_CHANGE_STOPPED / BIAS_TIME,
        gusty_bias=BIAS_CHANGE * BIAS_CHANGE / given.bias_time,
        gust_time=max(GUST_TIME_LEAST, GUST_TIME_SHARE * given.bias_time),
        rate_unknown=min(quickest_turn(model, given.rudder_max) ** 2, RATE_UNKNOWN),
    )


def manoeuvre_time(model: Norrbin, rudder_max: float) -> float:
    """Return the time [s] in which a wrong model looks like wind: the time constant, but no longer than the rudder hard
    over, up to `rudder_max` [rad], takes to turn the boat by a radian from rest, t = sqrt(2 T/(K rudder_max)).

    A boat of neutral stability has any T that is long beside its manoeuvres, and K/T alone says what it does.
    """
    return min(model.time_constant, math.sqrt(2.0 * model.time_constant / (model.gain * rudder_max)))


def usual_bias_time(model: Norrbin, rudder_max: float) -> float:
    """Return the time [s] in which wind, current and trim change where nobody says."""
    return max(BIAS_TIME, 2.0 * manoeuvre_time(model, rudder_max))


class Noises(NamedTuple):
    """The filter's noise, that of a boat which something lasting pushes, and with the rudder at its stop; rate_most
    [rad/s]: a rate that lies further from what is expected, and not for noise, is none."""

    usual: FilterNoise
    pushed: FilterNoise
    stopped: FilterNoise
    rate_most: float


def noises_of(noise: FilterNoise, rate_most: float = math.inf) -> Noises:
    """Return the noises; without waves the bias is quick anyway where something pushes."""
    pushed = noise._replace(bias=noise.gust_bias) if noise.waves else noise
    wandered, gusty = max(pushed.bias, noise.stop_bias), max(noise.gust_bias, noise.stop_bias)
    return Noises(noise, pushed, noise._replace(bias=wandered, gust_bias=gusty), rate_most)


def sliding(noises: Noises, slide: float) -> Noises:
    """Return the noises of a boat in which an ordered turn adds so much unknown `slide` [rad^2/s]."""
    usual, pushed, stopped, rate_most = noises
    return Noises(
        FilterNoise(*usual[:-1], slide), FilterNoise(*pushed[:-1], slide), FilterNoise(*stopped[:-1], slide), rate_most
    )
