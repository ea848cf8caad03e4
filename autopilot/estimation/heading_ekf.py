"""Extended Kalman filter of heading, yaw rate, rudder-equivalent bias and wave motion on the Norrbin model.

State x = (psi, r, b, h, s, e). The boat: psi' = r, T r' = K (delta + b) - damping(r), b' = 0 + noise. The waves: a
heading h and rate s of their own on top of the boat's, see `disturbance`. A compass shows psi + h and a gyro r + s;
the boat is steered by psi and r alone. Without a sea h, s and e stay 0. Scalar code over a NamedTuple: the covariance's
upper triangle is written out, so the loop needs no array library.

A part g of b is what the hull's slide leaves of an ordered turn: g' = -g/(SLIDE_LASTS T), of an unknown size that the
plan of the turn gives (`disturbance.slide_planned`). In place of a seventh state g and its variance are kept beside b:
what is learnt of b goes to g and to the rest as what is not known of either, as if the two were independent.

Source: that wave motion adds to the boat's own, and the filter for it, are Fossen 2011, section 8.2 and ch. 11.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.estimation.disturbance import (
    EXTREME_LEAST_SQUARED,
    EXTREME_SQUARED,
    FIRST_SEA,
    LAG,
    NO_INTENSITY,
    NO_SEA,
    FilterNoise,
    Intensity,
    Sea,
    adapt_intensity,
    frequency,
    in_balance,
    learn,
    reset_intensity,
)
from autopilot.estimation.tuning import (
    BIAS_UNKNOWN,
    SLIDE_LASTS,
    STEEPEST_GROWTH,
    WAVE_CORNER,
    WAVE_DAMPING,
    WAVE_STIFFENING,
)
from autopilot.models.norrbin import Norrbin, yaw_acceleration


class FilterState(NamedTuple):
    """Mean (psi [rad], r [rad/s], b [rad], h [rad], s [rad/s], e [rad]) at `time` [s], covariance p_ij, sea and gusts.

    i and j count psi, r, b, h, s, e. slide [rad]: how much of b is what the hull's slide has left of an ordered turn,
    and its variance [rad^2], which is a part of p22.
    """

    time: float
    psi: float
    rate: float
    bias: float
    p00: float
    p01: float
    p02: float
    p11: float
    p12: float
    p22: float
    wave: float = 0.0
    wave_rate: float = 0.0
    wave_lag: float = 0.0
    p03: float = 0.0
    p04: float = 0.0
    p05: float = 0.0
    p13: float = 0.0
    p14: float = 0.0
    p15: float = 0.0
    p23: float = 0.0
    p24: float = 0.0
    p25: float = 0.0
    p33: float = 0.0
    p34: float = 0.0
    p35: float = 0.0
    p44: float = 0.0
    p45: float = 0.0
    p55: float = 0.0
    slide: float = 0.0
    slide_variance: float = 0.0
    sea: Sea = NO_SEA
    intensity: Intensity = NO_INTENSITY


def with_bias_of(model: Norrbin, noise: FilterNoise, before: FilterState, state: FilterState) -> FilterState:
    """Return the state with the bias, and how well it is known, as they were `before`: but for the slide in it."""
    dt = state.time - before.time
    _, gone, grown = slide_goes(model, noise, before.slide, before.slide_variance, dt)
    bias, slide, unknown = before.bias - gone, before.slide - gone, before.slide_variance + grown
    boat = (state.time, state.psi, state.rate, bias, state.p00, state.p01, 0.0, state.p11, 0.0, before.p22 + grown)
    waves = (state.wave, state.wave_rate, state.wave_lag, state.p03, state.p04, state.p05)
    across = (state.p13, state.p14, state.p15, 0.0, 0.0, 0.0)
    own = (state.p33, state.p34, state.p35, state.p44, state.p45, state.p55)
    return FilterState(*boat, *waves, *across, *own, slide, unknown, state.sea, before.intensity)


NO_WAVES = (
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
)  # fmt: skip
"""h, s, e and p03 to p55."""


def slide_goes(
    model: Norrbin, noise: FilterNoise, slide: float, unknown: float, dt: float
) -> tuple[float, float, float]:
    """Return which share of a `slide` [rad] is gone in `dt` [s], how much that is, and by how much more of it is then
    unknown than the variance `unknown` [rad^2]."""
    fades = -math.expm1(-dt / (SLIDE_LASTS * model.time_constant))
    return fades, fades * slide, noise.slide * dt - fades * (2.0 - fades) * unknown


def initial(
    time: float, heading: float, rate: float | None, noise: FilterNoise, before: FilterState | None = None
) -> FilterState:
    """Return the state after the first heading [rad]; without a rate the boat is taken as possibly turning.

    The bias, the sea and the gusts of a state `before` a gap are kept.
    """
    sea = NO_SEA
    if noise.waves:
        sea = FIRST_SEA if before is None or before.sea == NO_SEA else before.sea
    p33, p44, p45, p55 = in_balance(sea, frequency(sea))
    return FilterState(
        time=time,
        psi=heading,
        rate=rate if rate is not None else 0.0,
        bias=0.0 if before is None else before.bias,
        p00=noise.heading,
        p01=0.0,
        p02=0.0,
        p11=noise.rate if rate is not None else noise.rate_unknown,
        p12=0.0,
        p22=BIAS_UNKNOWN,
        p33=p33,
        p44=p44,
        p45=p45,
        p55=p55,
        sea=sea,
        intensity=NO_INTENSITY if before is None else before.intensity,
    )


def without_bias(state: FilterState) -> FilterState:
    """Return the state with a bias of which nothing is known."""
    unknown = state._replace(bias=0.0, p02=0.0, p12=0.0, p22=BIAS_UNKNOWN, intensity=reset_intensity(state.intensity))
    return unknown._replace(p23=0.0, p24=0.0, p25=0.0, slide=0.0, slide_variance=0.0)


def without_sea(state: FilterState) -> FilterState:
    """Return the state with a sea of which nothing is known: all that the heading shows is the boat's own."""
    if state.sea == NO_SEA:
        return state
    p33, p44, p45, p55 = in_balance(FIRST_SEA, frequency(FIRST_SEA))
    alone = state._replace(psi=wrap(state.psi + state.wave), rate=state.rate + state.wave_rate)
    alone = alone._replace(wave=0.0, wave_rate=0.0, wave_lag=0.0, sea=FIRST_SEA)
    alone = alone._replace(p00=state.p00 + state.p33, p11=state.p11 + state.p44)
    alone = alone._replace(p03=0.0, p04=0.0, p05=0.0, p13=0.0, p14=0.0, p15=0.0, p23=0.0, p24=0.0, p25=0.0)
    return alone._replace(p33=p33, p34=0.0, p35=0.0, p44=p44, p45=p45, p55=p55)


WaveStep = tuple[float, float, float, float, float, float, float, float, float]
"""Exact transition of (h, s, e) over one step, a row after the other."""
RINGING = math.sqrt(1.0 - WAVE_DAMPING * WAVE_DAMPING)
"""Frequency of the damped oscillator in units of w0."""


def wave_step(w0: float, dt: float) -> WaveStep:
    """Return the transition over `dt` [s] of waves of the `frequency` w0 [rad/s], which is positive."""
    decay, corner = WAVE_DAMPING * w0, WAVE_CORNER * w0
    ringing = w0 * RINGING
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
    return (
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


def _transition(model: Norrbin, rate: float, dt: float) -> tuple[float, float, float]:
    """Return exp(-x), (1 - exp(-x))/x and (x - 1 + exp(-x))/x^2 with x = dt/T times the damping's slope at `rate`."""
    slope = model.n1 + (2.0 * model.n2 + 3.0 * model.n3 * rate) * rate
    x = slope * dt / model.time_constant
    x = -STEEPEST_GROWTH if x < -STEEPEST_GROWTH else x
    lost = -math.expm1(-x)
    if -1.0e-3 < x < 1.0e-3:
        return 1.0 - lost, 1.0 - 0.5 * x, 0.5
    return 1.0 - lost, lost / x, (x - lost) / (x * x)


def predict_mean(model: Norrbin, state: FilterState, rudder: float, time: float) -> tuple[float, float, float, float]:
    """Return psi, r, h and s at `time` [s] under a held `rudder` [rad]; see `predict`."""
    before, psi, rate, bias = state[:4]
    h, s, e, sea, dt = state.wave, state.wave_rate, state.wave_lag, state.sea, time - before
    _, once, twice = _transition(model, rate, dt)
    k, time_constant, n3, n2, n1, n0, _ = model
    acceleration = (k * (rudder + bias) - (((n3 * rate + n2) * rate + n1) * rate + n0)) / time_constant
    psi += dt * (rate + dt * twice * acceleration)
    psi = psi if -PI < psi <= PI else wrap(psi)
    rate += dt * once * acceleration
    if sea.heading > 0.0:
        a33, a34, a35, a43, a44, a45, _, _, _ = wave_step(frequency(sea), dt)
        h, s = a33 * h + a34 * s + a35 * e, a43 * h + a44 * s + a45 * e
    return psi, rate, h, s


def carried_ahead(
    model: Norrbin, heading: float, rate: float, rudders: tuple[float, float], seconds: float
) -> tuple[float, float]:
    """Return heading [rad] and rate [rad/s] in so many `seconds` under a rudder that goes evenly from the first of the
    two `rudders` [rad] to the second, the bias counted in; see `predict`."""
    begin, end = rudders
    _, once, twice = _transition(model, rate, seconds)
    x = seconds * (model.n1 + (2.0 * model.n2 + 3.0 * model.n3 * rate) * rate) / model.time_constant
    thrice = (0.5 - twice) / x if x < -1.0e-3 or x > 1.0e-3 else 1.0 / 6.0
    acceleration = yaw_acceleration(model, rate, begin)
    grown = model.gain / model.time_constant * (end - begin)
    psi = heading + seconds * (rate + seconds * (twice * acceleration + thrice * grown))
    return psi if -PI < psi <= PI else wrap(psi), rate + seconds * (once * acceleration + twice * grown)


def predict(model: Norrbin, noise: FilterNoise, state: FilterState, rudder: float, time: float) -> FilterState:
    """Return the state at `time` [s] under a `rudder` [rad] held until then.

    The model linearised at the present rate is solved exactly (exponential Rosenbrock-Euler step; Hochbruck and
    Ostermann 2010, section 2): exact for Nomoto's model, and stable however stiff n3 r^2 makes a wild rate.
    """
    (
        before, psi, rate, bias, p00, p01, p02, p11, p12, p22,
        h, s, e, p03, p04, p05, p13, p14, p15, p23, p24, p25, p33, p34, p35, p44, p45, p55,
        slide, unknown, sea, intensity,
    ) = state  # fmt: skip
    k, time_constant, n3, n2, n1, n0, _ = model
    dt = time - before
    decay, once, twice = _transition(model, rate, dt)
    acceleration = (k * (rudder + bias) - (((n3 * rate + n2) * rate + n1) * rate + n0)) / time_constant
    drive = k * dt / time_constant
    turn, drift, gain = dt * once, drive * dt * twice, drive * once
    # F = [[1, turn, drift], [0, decay, gain], [0, 0, 1]]; P = F P F' + Q
    a01 = p01 + turn * p11 + drift * p12
    a02 = p02 + turn * p12 + drift * p22
    a12 = decay * p12 + gain * p22
    # counted from the rudder that keeps the boat straight, so that it needs no more trust to port than to starboard
    steered = noise.model_error * (k * (rudder + bias) - n0) / time_constant
    pushed, wandered = noise.acceleration, noise.bias
    wandered = intensity.density if intensity.density > wandered else wandered
    variance, rate_variance, _ = sea
    # see `is_extreme`
    if noise.waves and h * h > EXTREME_SQUARED * variance + EXTREME_LEAST_SQUARED:
        pushed, wandered = noise.gust, noise.gust_bias
    q = (pushed + steered * steered) * dt
    psi += dt * (rate + dt * twice * acceleration)
    psi = psi if -PI < psi <= PI else wrap(psi)
    rate += turn * acceleration
    p00 = p00 + turn * p01 + drift * p02 + turn * a01 + drift * a02 + q * dt * dt / 3.0
    p01 = decay * a01 + gain * a02 + 0.5 * q * dt
    p11 = decay * (decay * p11 + gain * p12) + gain * a12 + q
    p22, kept = p22 + wandered * dt, 1.0
    if unknown > 0.0 or noise.slide > 0.0:
        # the slide's part of the bias goes with time, and takes that part of its covariances along
        fades, gone, grown = slide_goes(model, noise, slide, unknown, dt)
        kept -= fades * unknown / p22
        a02, a12 = kept * a02, kept * a12
        unknown, p22 = unknown + grown, p22 + grown
        bias, slide = bias - gone, slide - gone
    if variance <= 0.0:
        boat = time, psi, rate, bias, p00, p01, a02, p11, a12, p22
        return FilterState(*boat, *NO_WAVES, slide, unknown, NO_SEA, NO_INTENSITY)
    # the waves' own transition A; F of the boat on the left of what both have in common, A on the right
    w0 = math.sqrt(rate_variance / (variance * WAVE_STIFFENING))
    a33, a34, a35, a43, a44, a45, a53, a54, a55 = wave_step(w0, dt)
    l3 = p03 + turn * p13 + drift * p23
    l4 = p04 + turn * p14 + drift * p24
    l5 = p05 + turn * p15 + drift * p25
    m3, m4, m5 = decay * p13 + gain * p23, decay * p14 + gain * p24, decay * p15 + gain * p25
    # A (P - balance) A' + balance: what is gained is what keeps the sea as it is, see `in_balance`
    v45, v55 = -WAVE_CORNER * w0 * variance, LAG * variance
    d33, d44, d45, d55 = p33 - variance, p44 - rate_variance, p45 - v45, p55 - v55
    x33 = a33 * d33 + a34 * p34 + a35 * p35
    x34 = a33 * p34 + a34 * d44 + a35 * d45
    x35 = a33 * p35 + a34 * d45 + a35 * d55
    x43 = a43 * d33 + a44 * p34 + a45 * p35
    x44 = a43 * p34 + a44 * d44 + a45 * d45
    x45 = a43 * p35 + a44 * d45 + a45 * d55
    x53 = a53 * d33 + a54 * p34 + a55 * p35
    x54 = a53 * p34 + a54 * d44 + a55 * d45
    x55 = a53 * p35 + a54 * d45 + a55 * d55
    return FilterState(
        time, psi, rate, bias, p00, p01, a02, p11, a12, p22,
        a33 * h + a34 * s + a35 * e,
        a43 * h + a44 * s + a45 * e,
        a53 * h + a54 * s + a55 * e,
        a33 * l3 + a34 * l4 + a35 * l5,
        a43 * l3 + a44 * l4 + a45 * l5,
        a53 * l3 + a54 * l4 + a55 * l5,
        a33 * m3 + a34 * m4 + a35 * m5,
        a43 * m3 + a44 * m4 + a45 * m5,
        a53 * m3 + a54 * m4 + a55 * m5,
        kept * (a33 * p23 + a34 * p24 + a35 * p25),
        kept * (a43 * p23 + a44 * p24 + a45 * p25),
        kept * (a53 * p23 + a54 * p24 + a55 * p25),
        x33 * a33 + x34 * a34 + x35 * a35 + variance,
        x33 * a43 + x34 * a44 + x35 * a45,
        x33 * a53 + x34 * a54 + x35 * a55,
        x43 * a43 + x44 * a44 + x45 * a45 + rate_variance,
        x43 * a53 + x44 * a54 + x45 * a55 + v45,
        x53 * a53 + x54 * a54 + x55 * a55 + v55,
        slide, unknown, sea, intensity,
    )  # fmt: skip


def innovations(
    state: FilterState, variances: tuple[float, float], heading: float, rate: float
) -> tuple[float, float, float]:
    """Return how many standard deviations the measured rate [rad/s] is above the expected one, by the heading [rad]
    where the rate is nan, not measured; the innovation of the heading, the short way round, and its standard deviation
    [rad]. variances: of a heading [rad^2] and of a rate [(rad/s)^2] as they are measured."""
    of_heading, of_rate = variances
    innovation = heading - state.psi - state.wave
    innovation = innovation if -PI < innovation <= PI else wrap(innovation)
    deviation = math.sqrt(state.p00 + 2.0 * state.p03 + state.p33 + of_heading)
    if rate != rate:  # what is no number is not itself
        return innovation / deviation, innovation, deviation
    total = state.p11 + 2.0 * state.p14 + state.p44 + of_rate
    return (rate - state.rate - state.wave_rate) / math.sqrt(total), innovation, deviation


def fused(
    state: FilterState,
    changes: tuple[float, float, float],
    variances: tuple[float, float],
    shown: tuple[float, float],
    rudder: float,
    dt: float,
) -> FilterState:
    """Return the state after a heading [rad] and a yaw rate [rad/s] were `shown`, nan where it was not measured, and
    with what it says then of sea and gusts, `dt` [s] with the `rudder` [rad] after it said so last; nan: nothing is
    learnt of them. changes: see `adapt_intensity`; variances: of heading and rate as they are measured.

    The compass shows psi + h and the gyro r + s; one is taken in after the other.
    """
    (heading, rate), (of_heading, of_rate) = shown, variances
    (
        time, psi, r, bias, p00, p01, p02, p11, p12, p22,
        h, s, e, p03, p04, p05, p13, p14, p15, p23, p24, p25, p33, p34, p35, p44, p45, p55,
        slide, unknown, sea, intensity,
    ) = state  # fmt: skip
    has_sea = sea.heading > 0.0
    for measured, is_heading in ((heading, True), (rate, False)):
        if measured != measured:
            continue
        # the innovation, its variance, and its covariance P H' with the state
        if is_heading:
            innovation = measured - psi - h
            innovation = innovation if -PI < innovation <= PI else wrap(innovation)
            share = 1.0 / (p00 + 2.0 * p03 + p33 + of_heading)
            c0, c1, c2, c3, c4, c5 = p00 + p03, p01 + p13, p02 + p23, p03 + p33, p04 + p34, p05 + p35
        else:
            innovation = measured - r - s
            share = 1.0 / (p11 + 2.0 * p14 + p44 + of_rate)
            c0, c1, c2, c3, c4, c5 = p01 + p04, p11 + p14, p12 + p24, p13 + p34, p14 + p44, p15 + p45
        g0, g1, g2 = c0 * share, c1 * share, c2 * share
        psi += g0 * innovation
        psi = psi if -PI < psi <= PI else wrap(psi)
        r += g1 * innovation
        bias += g2 * innovation
        if unknown > 0.0:
            # what is not known of slide and wind goes together
            part = unknown / p22
            slide += part * g2 * innovation
            unknown -= part * g2 * c2
        p00 -= g0 * c0
        p01 -= g0 * c1
        p02 -= g0 * c2
        p11 -= g1 * c1
        p12 -= g1 * c2
        p22 -= g2 * c2
        if has_sea:
            g3, g4, g5 = c3 * share, c4 * share, c5 * share
            h += g3 * innovation
            s += g4 * innovation
            e += g5 * innovation
            p03 -= g0 * c3
            p04 -= g0 * c4
            p05 -= g0 * c5
            p13 -= g1 * c3
            p14 -= g1 * c4
            p15 -= g1 * c5
            p23 -= g2 * c3
            p24 -= g2 * c4
            p25 -= g2 * c5
            p33 -= g3 * c3
            p34 -= g3 * c4
            p35 -= g3 * c5
            p44 -= g4 * c4
            p45 -= g4 * c5
            p55 -= g5 * c5
    if not has_sea:
        sea, intensity = NO_SEA, NO_INTENSITY
    if rudder == rudder:
        # see `is_extreme`
        if not h * h > EXTREME_SQUARED * sea.heading + EXTREME_LEAST_SQUARED:
            sea = learn(sea, h * h + p33, s * s + p44, dt)
        intensity = adapt_intensity(intensity, changes, bias - slide, p22 - unknown, rudder, dt)
    return FilterState(
        time, psi, r, bias, p00, p01, p02, p11, p12, p22,
        h, s, e, p03, p04, p05, p13, p14, p15, p23, p24, p25, p33, p34, p35, p44, p45, p55,
        slide, unknown, sea, intensity,
    )  # fmt: skip


def fuse_heading(state: FilterState, heading: float, variance: float) -> FilterState:
    """Return the state after a heading [rad] of `variance` [rad^2] alone."""
    return fused(state, (0.0, 0.0, 1.0), (variance, 0.0), (heading, math.nan), math.nan, 0.0)


def fuse_rate(state: FilterState, rate: float, variance: float) -> FilterState:
    """Return the state after a yaw rate [rad/s] of `variance` [(rad/s)^2] alone."""
    return fused(state, (0.0, 0.0, 1.0), (0.0, variance), (math.nan, rate), math.nan, 0.0)


def is_sound(state: FilterState) -> bool:
    """Return whether mean and variances are finite and the variances not negative."""
    density, bias, rudder, variance = state.intensity
    # a sum is finite only where every part of it is
    return (
        -math.inf < sum((*state[:-2], *state.sea, density, *bias, *rudder, variance)) < math.inf
        and state.p00 >= 0.0
        and state.p11 >= 0.0
        and state.p22 >= 0.0
        and state.p33 >= 0.0
        and state.p44 >= 0.0
        and state.p55 >= 0.0
    )
