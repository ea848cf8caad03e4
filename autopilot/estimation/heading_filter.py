"""Extended Kalman filter of heading, yaw rate and rudder-equivalent bias on the Norrbin model.

State x = (psi, r, b) with psi' = r, T r' = K (delta + b) - damping(r), b' = 0 + noise. Scalar code over a
NamedTuple: the covariance's upper triangle is written out, so the loop needs no array library.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin, yaw_acceleration

BIAS_UNKNOWN = math.radians(3.0) ** 2
RATE_UNKNOWN = 0.2**2
"""Variances of a bias [rad^2] and of a rate [(rad/s)^2] of which nothing is known."""
STEEPEST_GROWTH = 20.0
"""A step in which a course-unstable boat would grow by more than exp of this is cut there."""


class FilterState(NamedTuple):
    """Mean (psi [rad], r [rad/s], b [rad]) at `time` [s] and covariance p_ij, i and j of (psi, r, b)."""

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


class FilterNoise(NamedTuple):
    """Variances: heading [rad^2], rate [(rad/s)^2]; densities a second: acceleration [(rad/s)^2/s], bias [rad^2/s]."""

    heading: float
    rate: float
    acceleration: float
    bias: float


def initial(time: float, heading: float, rate: float | None, noise: FilterNoise) -> FilterState:
    """Return the state after the first heading [rad]; without a rate the boat is taken as possibly turning."""
    known = rate is not None
    return FilterState(
        time=time,
        psi=heading,
        rate=rate if rate is not None else 0.0,
        bias=0.0,
        p00=noise.heading,
        p01=0.0,
        p02=0.0,
        p11=noise.rate if known else RATE_UNKNOWN,
        p12=0.0,
        p22=BIAS_UNKNOWN,
    )


def predict(model: Norrbin, noise: FilterNoise, state: FilterState, rudder: float, dt: float) -> FilterState:
    """Return the state `dt` [s] later under a held `rudder` [rad].

    The model linearised at the present rate is solved exactly (exponential Rosenbrock-Euler step; Hochbruck and
    Ostermann 2010, section 2): exact for Nomoto's model, and stable however stiff n3 r^2 makes a wild rate.
    """
    slope = model.n1 + (2.0 * model.n2 + 3.0 * model.n3 * state.rate) * state.rate
    x = max(slope * dt / model.time_constant, -STEEPEST_GROWTH)
    decay = math.exp(-x)
    # (1 - exp(-x))/x and (x - 1 + exp(-x))/x^2
    once, twice = (-math.expm1(-x) / x, (x + math.expm1(-x)) / (x * x)) if abs(x) > 1.0e-3 else (1.0 - 0.5 * x, 0.5)
    acceleration = yaw_acceleration(model, state.rate, rudder + state.bias)
    drive = model.gain * dt / model.time_constant
    turn, drift, gain = dt * once, drive * dt * twice, drive * once
    # F = [[1, turn, drift], [0, decay, gain], [0, 0, 1]]; P = F P F' + Q
    a00 = state.p00 + turn * state.p01 + drift * state.p02
    a01 = state.p01 + turn * state.p11 + drift * state.p12
    a02 = state.p02 + turn * state.p12 + drift * state.p22
    a11 = decay * state.p11 + gain * state.p12
    a12 = decay * state.p12 + gain * state.p22
    q = noise.acceleration * dt
    return FilterState(
        time=state.time + dt,
        psi=wrap(state.psi + dt * (state.rate + dt * twice * acceleration)),
        rate=state.rate + turn * acceleration,
        bias=state.bias,
        p00=a00 + turn * a01 + drift * a02 + q * dt * dt / 3.0,
        p01=decay * a01 + gain * a02 + 0.5 * q * dt,
        p02=a02,
        p11=decay * a11 + gain * a12 + q,
        p12=a12,
        p22=state.p22 + noise.bias * dt,
    )


def fuse_heading(state: FilterState, heading: float, variance: float) -> FilterState:
    """Return the state after a heading [rad] of `variance` [rad^2], the innovation taken the short way round."""
    gain0, gain1, gain2 = (p / (state.p00 + variance) for p in (state.p00, state.p01, state.p02))
    innovation = wrap(heading - state.psi)
    return FilterState(
        state.time,
        wrap(state.psi + gain0 * innovation),
        state.rate + gain1 * innovation,
        state.bias + gain2 * innovation,
        state.p00 - gain0 * state.p00,
        state.p01 - gain0 * state.p01,
        state.p02 - gain0 * state.p02,
        state.p11 - gain1 * state.p01,
        state.p12 - gain1 * state.p02,
        state.p22 - gain2 * state.p02,
    )


def fuse_rate(state: FilterState, rate: float, variance: float) -> FilterState:
    """Return the state after a yaw rate [rad/s] of `variance` [(rad/s)^2]."""
    gain0, gain1, gain2 = (p / (state.p11 + variance) for p in (state.p01, state.p11, state.p12))
    innovation = rate - state.rate
    return FilterState(
        state.time,
        wrap(state.psi + gain0 * innovation),
        state.rate + gain1 * innovation,
        state.bias + gain2 * innovation,
        state.p00 - gain0 * state.p01,
        state.p01 - gain0 * state.p11,
        state.p02 - gain0 * state.p12,
        state.p11 - gain1 * state.p11,
        state.p12 - gain1 * state.p12,
        state.p22 - gain2 * state.p12,
    )


def is_sound(state: FilterState) -> bool:
    """Return whether mean and variances are finite and the variances not negative."""
    return all(map(math.isfinite, state)) and state.p00 >= 0.0 and state.p11 >= 0.0 and state.p22 >= 0.0
