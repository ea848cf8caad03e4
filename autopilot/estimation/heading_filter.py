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


def _transition(model: Norrbin, rate: float, dt: float) -> tuple[float, float, float]:
    """Return exp(-x), (1 - exp(-x))/x and (x - 1 + exp(-x))/x^2 with x = dt/T times the damping's slope at `rate`."""
    slope = model.n1 + (2.0 * model.n2 + 3.0 * model.n3 * rate) * rate
    x = max(slope * dt / model.time_constant, -STEEPEST_GROWTH)
    lost = -math.expm1(-x)
    if -1.0e-3 < x < 1.0e-3:
        return 1.0 - lost, 1.0 - 0.5 * x, 0.5
    return 1.0 - lost, lost / x, (x - lost) / (x * x)


def predict_mean(model: Norrbin, state: FilterState, rudder: float, time: float) -> tuple[float, float]:
    """Return heading [rad] and rate [rad/s] at `time` [s] under a held `rudder` [rad]; see `predict`."""
    dt = time - state.time
    _, once, twice = _transition(model, state.rate, dt)
    acceleration = yaw_acceleration(model, state.rate, rudder + state.bias)
    return (
        wrap(state.psi + dt * (state.rate + dt * twice * acceleration)),
        state.rate + dt * once * acceleration,
    )


def predict(model: Norrbin, noise: FilterNoise, state: FilterState, rudder: float, time: float) -> FilterState:
    """Return the state at `time` [s] under a `rudder` [rad] held until then.

    The model linearised at the present rate is solved exactly (exponential Rosenbrock-Euler step; Hochbruck and
    Ostermann 2010, section 2): exact for Nomoto's model, and stable however stiff n3 r^2 makes a wild rate.
    """
    _, psi, rate, bias, p00, p01, p02, p11, p12, p22 = state
    dt = time - state.time
    decay, once, twice = _transition(model, rate, dt)
    acceleration = yaw_acceleration(model, rate, rudder + bias)
    drive = model.gain * dt / model.time_constant
    turn, drift, gain = dt * once, drive * dt * twice, drive * once
    # F = [[1, turn, drift], [0, decay, gain], [0, 0, 1]]; P = F P F' + Q
    a01 = p01 + turn * p11 + drift * p12
    a02 = p02 + turn * p12 + drift * p22
    a12 = decay * p12 + gain * p22
    q = noise.acceleration * dt
    return FilterState(
        time,
        wrap(psi + dt * (rate + dt * twice * acceleration)),
        rate + turn * acceleration,
        bias,
        p00 + turn * p01 + drift * p02 + turn * a01 + drift * a02 + q * dt * dt / 3.0,
        decay * a01 + gain * a02 + 0.5 * q * dt,
        a02,
        decay * (decay * p11 + gain * p12) + gain * a12 + q,
        a12,
        p22 + noise.bias * dt,
    )


def fuse_heading(state: FilterState, heading: float, variance: float) -> FilterState:
    """Return the state after a heading [rad] of `variance` [rad^2], the innovation taken the short way round."""
    time, psi, rate, bias, p00, p01, p02, p11, p12, p22 = state
    share = 1.0 / (p00 + variance)
    gain0, gain1, gain2 = p00 * share, p01 * share, p02 * share
    innovation = wrap(heading - psi)
    return FilterState(
        time,
        wrap(psi + gain0 * innovation),
        rate + gain1 * innovation,
        bias + gain2 * innovation,
        p00 - gain0 * p00,
        p01 - gain0 * p01,
        p02 - gain0 * p02,
        p11 - gain1 * p01,
        p12 - gain1 * p02,
        p22 - gain2 * p02,
    )


def fuse_rate(state: FilterState, rate: float, variance: float) -> FilterState:
    """Return the state after a yaw rate [rad/s] of `variance` [(rad/s)^2]."""
    time, psi, old, bias, p00, p01, p02, p11, p12, p22 = state
    share = 1.0 / (p11 + variance)
    gain0, gain1, gain2 = p01 * share, p11 * share, p12 * share
    innovation = rate - old
    return FilterState(
        time,
        wrap(psi + gain0 * innovation),
        old + gain1 * innovation,
        bias + gain2 * innovation,
        p00 - gain0 * p01,
        p01 - gain0 * p11,
        p02 - gain0 * p12,
        p11 - gain1 * p11,
        p12 - gain1 * p12,
        p22 - gain2 * p12,
    )


def is_sound(state: FilterState) -> bool:
    """Return whether mean and variances are finite and the variances not negative."""
    # a sum is finite only where every part of it is
    return math.isfinite(sum(state)) and state.p00 >= 0.0 and state.p11 >= 0.0 and state.p22 >= 0.0
