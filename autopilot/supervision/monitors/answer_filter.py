"""How a boat should answer its rudder, parted from what the sea and the wind do to it: a filter for `answer`.

State (psi, r, p, w): psi' = r, T r' = K (a delta + p + w) - lambda r. p [rad of rudder] is wind, trim and a rudder that
stands anywhere, a random walk; w [rad of rudder] is the sea, w' = -w/tau + white noise. lambda = n1 + n2 r + n3 r^2 at
the rate that is, so that the answers to the rudder and to all else add up. A compass shows psi.

By this the innovation of a filter that supposes the share a of the rudder's answer is nu - a s: nu that of a filter
which knows of no rudder, s the part of the rudder's answer which could not have been p or w. Both come from the same
gains. Source: Willsky and Jones 1976, the generalised likelihood ratio of an additive change, here for a change in a.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.models.norrbin import Norrbin

RATE_UNKNOWN = 0.2**2
PUSH_UNKNOWN = math.radians(20.0) ** 2
"""Variances of a rate [(rad/s)^2] and a push [rad^2] of which nothing is known."""
STEEPEST = 20.0


class Step(NamedTuple):
    """What the state becomes: psi += turn r + drift u, r = decay r + gain u, w = kept w; u: rudder, push and sea."""

    turn: float
    drift: float
    decay: float
    gain: float
    kept: float


class Noise(NamedTuple):
    """heading [rad^2]; densities a second of acceleration [(rad/s)^2/s] and push [rad^2/s]; sea [rad^2] about zero,
    which changes at its pace [1/s]."""

    heading: float
    acceleration: float
    push: float
    sea: float
    pace: float


class Spread(NamedTuple):
    """The covariance, common to all suppositions about the rudder; i and j count psi, r, p, w."""

    p00: float
    p01: float
    p02: float
    p03: float
    p11: float
    p12: float
    p13: float
    p22: float
    p23: float
    p33: float


class Mean(NamedTuple):
    """psi [rad], r [rad/s], p [rad], w [rad]."""

    psi: float
    rate: float
    push: float
    sea: float


class Gains(NamedTuple):
    """What a heading is believed, and the variance [rad^2] of its innovation."""

    variance: float
    psi: float
    rate: float
    push: float
    sea: float


NOTHING = Mean(0.0, 0.0, 0.0, 0.0)


def first_spread(noise: Noise) -> Spread:
    """Return the covariance after the first heading."""
    return Spread(noise.heading, 0.0, 0.0, 0.0, RATE_UNKNOWN, 0.0, 0.0, PUSH_UNKNOWN, 0.0, noise.sea)


def step_of(model: Norrbin, rate: float, noise: Noise, dt: float) -> Step:
    """Return the transition over `dt` [s] of a boat that turns at about `rate` [rad/s]."""
    slope = model.n1 + (model.n2 + model.n3 * rate) * rate
    x = max(slope * dt / model.time_constant, -STEEPEST)
    lost = -math.expm1(-x)
    once, twice = (1.0 - 0.5 * x, 0.5) if abs(x) < 1.0e-3 else (lost / x, (x - lost) / (x * x))
    drive = model.gain * dt / model.time_constant
    return Step(dt * once, drive * dt * twice, 1.0 - lost, drive * once, math.exp(-noise.pace * dt))


def moved(step: Step, mean: Mean, rudder: float) -> Mean:
    """Return the mean a step later under a held `rudder` [rad]."""
    pushed = rudder + mean.push + mean.sea
    return Mean(
        mean.psi + step.turn * mean.rate + step.drift * pushed,
        step.decay * mean.rate + step.gain * pushed,
        mean.push,
        step.kept * mean.sea,
    )


def spread_moved(step: Step, spread: Spread, noise: Noise, dt: float) -> Spread:
    """Return the covariance `dt` [s] later: F P F' + Q."""
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = spread
    turn, drift, decay, gain, kept = step
    a00 = p00 + turn * p01 + drift * (p02 + p03)
    a01 = p01 + turn * p11 + drift * (p12 + p13)
    a02 = p02 + turn * p12 + drift * (p22 + p23)
    a03 = p03 + turn * p13 + drift * (p23 + p33)
    a11 = decay * p11 + gain * (p12 + p13)
    a12 = decay * p12 + gain * (p22 + p23)
    a13 = decay * p13 + gain * (p23 + p33)
    q = noise.acceleration * dt
    return Spread(
        a00 + turn * a01 + drift * (a02 + a03) + q * dt * dt / 3.0,
        decay * a01 + gain * (a02 + a03) + 0.5 * q * dt,
        a02,
        kept * a03,
        decay * a11 + gain * (a12 + a13) + q,
        a12,
        kept * a13,
        p22 + noise.push * dt,
        kept * p23,
        kept * kept * p33 + (1.0 - kept * kept) * noise.sea,
    )


def gains_of(spread: Spread, noise: Noise) -> Gains:
    """Return what a heading is believed."""
    variance = spread.p00 + noise.heading
    return Gains(variance, spread.p00 / variance, spread.p01 / variance, spread.p02 / variance, spread.p03 / variance)


def spread_measured(gains: Gains, spread: Spread) -> Spread:
    """Return the covariance after a heading."""
    _, k0, k1, k2, k3 = gains
    p00, p01, p02, p03, p11, p12, p13, p22, p23, p33 = spread
    return Spread(
        p00 - k0 * p00,
        p01 - k0 * p01,
        p02 - k0 * p02,
        p03 - k0 * p03,
        p11 - k1 * p01,
        p12 - k1 * p02,
        p13 - k1 * p03,
        p22 - k2 * p02,
        p23 - k2 * p03,
        p33 - k3 * p03,
    )


def corrected(gains: Gains, mean: Mean, innovation: float) -> Mean:
    """Return the mean after a heading that was `innovation` [rad] off."""
    return Mean(
        mean.psi + gains.psi * innovation,
        mean.rate + gains.rate * innovation,
        mean.push + gains.push * innovation,
        mean.sea + gains.sea * innovation,
    )
