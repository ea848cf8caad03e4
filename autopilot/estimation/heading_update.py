"""The heading filter's other half: what a compass, a gyro and the past minute tell it.

A heading shows psi + h, a rate r + s; see `heading_filter` for the state.
"""

from __future__ import annotations

import math

from autopilot.angles import wrap
from autopilot.estimation import wave_motion
from autopilot.estimation.gusts import NO_GUSTS, Changes, bias_seen, is_finite
from autopilot.estimation.heading_filter import NO_WAVES, FilterNoise, FilterState
from autopilot.estimation.wave_motion import NO_SEA


def fuse_heading(state: FilterState, heading: float, variance: float) -> FilterState:
    """Return the state after a heading [rad] of `variance` [rad^2], the innovation taken the short way round."""
    return _fuse(
        state,
        (
            state.p00 + state.p03,
            state.p01 + state.p13,
            state.p02 + state.p23,
            state.p03 + state.p33,
            state.p04 + state.p34,
            state.p05 + state.p35,
        ),
        wrap(heading - state.psi - state.wave),
        heading_variance(state) + variance,
    )


def heading_variance(state: FilterState) -> float:
    """Return the variance [rad^2] of psi + h, which the compass shows."""
    return state.p00 + 2.0 * state.p03 + state.p33


def fuse_rate(state: FilterState, rate: float, variance: float) -> FilterState:
    """Return the state after a yaw rate [rad/s] of `variance` [(rad/s)^2]."""
    return _fuse(
        state,
        (
            state.p01 + state.p04,
            state.p11 + state.p14,
            state.p12 + state.p24,
            state.p13 + state.p34,
            state.p14 + state.p44,
            state.p15 + state.p45,
        ),
        rate - state.rate - state.wave_rate,
        state.p11 + 2.0 * state.p14 + state.p44 + variance,
    )


def surprise(state: FilterState, heading: float, rate: float, noise: FilterNoise) -> float:
    """Return how many standard deviations the measured rate [rad/s] is above the expected one; by the heading [rad]
    where the rate is nan, not measured."""
    if not math.isnan(rate):
        total = state.p11 + 2.0 * state.p14 + state.p44 + noise.rate
        return (rate - state.rate - state.wave_rate) / math.sqrt(total)
    return wrap(heading - state.psi - state.wave) / math.sqrt(heading_variance(state) + noise.heading)


def _fuse(
    state: FilterState, with_state: tuple[float, float, float, float, float, float], innovation: float, total: float
) -> FilterState:
    """Return the state after an `innovation` of variance `total` and of covariance P H' `with_state`."""
    time, psi, rate, bias, p00, p01, p02, p11, p12, p22 = state[:10]
    c0, c1, c2, c3, c4, c5 = with_state
    share = 1.0 / total
    g0, g1, g2 = c0 * share, c1 * share, c2 * share
    boat = (
        time,
        wrap(psi + g0 * innovation),
        rate + g1 * innovation,
        bias + g2 * innovation,
        p00 - g0 * c0,
        p01 - g0 * c1,
        p02 - g0 * c2,
        p11 - g1 * c1,
        p12 - g1 * c2,
        p22 - g2 * c2,
    )
    if state.sea.heading <= 0.0:
        return FilterState(*boat, *NO_WAVES, NO_SEA, NO_GUSTS)
    h, s, e, p03, p04, p05, p13, p14, p15, p23, p24, p25, p33, p34, p35, p44, p45, p55, sea, gusts = state[10:]
    g3, g4, g5 = c3 * share, c4 * share, c5 * share
    return FilterState(
        *boat,
        h + g3 * innovation,
        s + g4 * innovation,
        e + g5 * innovation,
        p03 - g0 * c3,
        p04 - g0 * c4,
        p05 - g0 * c5,
        p13 - g1 * c3,
        p14 - g1 * c4,
        p15 - g1 * c5,
        p23 - g2 * c3,
        p24 - g2 * c4,
        p25 - g2 * c5,
        p33 - g3 * c3,
        p34 - g3 * c4,
        p35 - g3 * c5,
        p44 - g4 * c4,
        p45 - g4 * c5,
        p55 - g5 * c5,
        sea,
        gusts,
    )


def learn_waves(state: FilterState, dt: float) -> FilterState:
    """Return the state with what it says of the sea after `dt` [s] taken in."""
    if wave_motion.is_extreme(state.sea, state.wave):
        return state
    heading, rate = state.wave * state.wave + state.p33, state.wave_rate * state.wave_rate + state.p44
    return FilterState(*state[:-2], wave_motion.learn(state.sea, heading, rate, dt), state.gusts)


def learn_gusts(state: FilterState, noise: FilterNoise, rudder: float, dt: float) -> FilterState:
    """Return the state with what its bias says of the gusts after `dt` [s] with the `rudder` [rad] taken in."""
    changes = Changes(noise.bias, noise.gusty_bias, noise.gust_time)
    return FilterState(*state[:-1], bias_seen(state.gusts, changes, state.bias, state.p22, rudder, dt))


def is_sound(state: FilterState) -> bool:
    """Return whether mean and variances are finite and the variances not negative."""
    # a sum is finite only where every part of it is
    return (
        math.isfinite(sum(state[:-2]) + sum(state.sea))
        and is_finite(state.gusts)
        and min(state.p00, state.p11, state.p22, state.p33, state.p44, state.p55) >= 0.0
    )
