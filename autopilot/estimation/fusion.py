"""One measurement taken in: gate, filter and sea, as scalar functions that `sitl.compiled` compiles as they are.

The estimator keeps the memory around them: late samples, broken instruments, and where the rudder was.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.estimation import heading_ekf as ekf
from autopilot.estimation import waves
from autopilot.estimation.heading_ekf import (
    FilterNoise,
    FilterState,
    fuse_heading,
    fuse_rate,
    heading_variance,
    learn_intensity,
    learn_waves,
    normalised_innovation,
)
from autopilot.estimation.rudder_observer import RudderPast, angle_at, stretch, tick_at
from autopilot.estimation.tuning import (
    BIAS_MOST,
    GATE_LEAST,
    GATE_SIGMAS,
    GRAIN_SHARE,
    INNOVATION_LASTING,
    INNOVATION_MEAN_TIME,
    INNOVATION_MOST,
    LONGEST_SHARE,
    PREDICT_LONGEST,
)
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import clip
from autopilot.signals import NavState


class Fusion(NamedTuple):
    """What the measurements have left: the filter's state, what lies between expectation and measurement on average
    [standard deviations], how many spikes in a row agree, and the newest of them [rad]."""

    state: FilterState
    innovation_mean: float = 0.0
    spikes: int = 0
    spike: float = 0.0


NOT_BEGUN = Fusion(FilterState(-math.inf, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
"""Before the first heading."""


class Measured(NamedTuple):
    """A measurement at `time` [s]: heading [rad] and rate [rad/s], nan where they were not measured."""

    time: float
    heading: float
    rate: float


class Moment(NamedTuple):
    """When the boat is looked at [s], its speed then [m/s], and when the newest heading was measured [s]."""

    now: float
    speed: float
    heading_time: float


class Noises(NamedTuple):
    """The filter's noise, that of a boat which something lasting pushes, and with the rudder at its stop."""

    usual: FilterNoise
    pushed: FilterNoise
    stopped: FilterNoise


def noises_of(noise: FilterNoise) -> Noises:
    """Return the noises; without waves the bias is quick anyway where something pushes."""
    pushed = noise._replace(bias=noise.gust_bias) if noise.waves else noise
    wandered, gusty = max(pushed.bias, noise.stop_bias), max(noise.gust_bias, noise.stop_bias)
    return Noises(noise, pushed, noise._replace(bias=wandered, gust_bias=gusty))


def carried(model: Norrbin, noises: Noises, fusion: Fusion, past: RudderPast, to: float) -> FilterState:
    """Return the filter's state carried to the time `to` [s] under the rudder that was."""
    state = fusion.state
    longest = LONGEST_SHARE * model.time_constant
    end = min(to, state.time + PREDICT_LONGEST)
    moving = noises.usual if abs(fusion.innovation_mean) < INNOVATION_LASTING else noises.pushed
    tick = tick_at(past, state.time)
    while state.time < end:
        until, angle, tick = stretch(past, tick, state.time, end, GRAIN_SHARE * model.time_constant)
        noise = moving if abs(angle) < noises.usual.stop else noises.stopped
        for left in range(math.ceil((until - state.time) / longest), 1, -1):
            state = ekf.predict(model, noise, state, angle, state.time + (until - state.time) / left)
        state = ekf.predict(model, noise, state, angle, until)
    return state if state.time == to else FilterState(to, *state[1:])


def seen_at(model: Norrbin, noises: Noises, fusion: Fusion, past: RudderPast, at: Moment) -> NavState:
    """Return what the filter knows of the boat; the waves that are not yet known count as the boat's own."""
    psi, rate, wave, wave_rate = _moved(model, noises, fusion, past, at.now)
    sea = fusion.state.sea
    unknown = 1.0 - waves.known(sea)
    psi, rate = psi + unknown * wave, rate + unknown * wave_rate
    wave, wave_rate = wave - unknown * wave, wave_rate - unknown * wave_rate
    return NavState(
        at.now,
        wrap(psi + wave),
        rate + wave_rate,
        at.speed,
        past.angles[(past.ticks - 1) & (len(past.angles) - 1)],
        clip(fusion.state.bias, -BIAS_MOST, BIAS_MOST),
        at.now - at.heading_time,
        True,
        wave,
        wave_rate,
        math.sqrt(sea.heading),
        waves.frequency(sea),
    )


def _moved(
    model: Norrbin, noises: Noises, fusion: Fusion, past: RudderPast, now: float
) -> tuple[float, float, float, float]:
    """Return psi, r, h and s as the filter has them at `now` [s]; what is a moment away needs no covariance."""
    state = fusion.state
    if now <= state.time:
        return state.psi, state.rate, state.wave, state.wave_rate
    end = min(now, state.time + PREDICT_LONGEST)
    tick = tick_at(past, state.time)
    until, angle, _ = stretch(past, tick, state.time, end, GRAIN_SHARE * model.time_constant)
    if until >= end and until - state.time <= LONGEST_SHARE * model.time_constant:
        return ekf.predict_mean(model, state, angle, until)
    ahead = carried(model, noises, fusion, past, now)
    return ahead.psi, ahead.rate, ahead.wave, ahead.wave_rate


def fuse_measured(
    model: Norrbin, noises: Noises, fusion: Fusion, past: RudderPast, measured: Measured
) -> tuple[Fusion, bool]:
    """Return what a measurement leaves, and whether it was fused: a spike is not."""
    time, heading, rate = measured
    noise, dt = noises.usual, time - fusion.state.time
    state = carried(model, noises, fusion, past, time)
    off = clip(normalised_innovation(state, heading, rate, noise), -INNOVATION_MOST, INNOVATION_MOST)
    lasting = fusion.innovation_mean - math.expm1(-dt / INNOVATION_MEAN_TIME) * (off - fusion.innovation_mean)
    spikes, spike = fusion.spikes, fusion.spike
    if not math.isnan(heading):
        gate = max(GATE_LEAST, GATE_SIGMAS * math.sqrt(heading_variance(state) + noise.heading))
        if abs(wrap(heading - state.psi - state.wave)) > gate:
            agrees = spikes > 0 and abs(wrap(heading - spike)) <= gate
            return Fusion(fusion.state, lasting, spikes + 1 if agrees else 1, heading), False
        spikes = 0
        state = fuse_heading(state, heading, noise.heading)
    if not math.isnan(rate):
        state = fuse_rate(state, rate, noise.rate)
    if noise.waves and abs(lasting) < INNOVATION_LASTING:
        state = learn_intensity(learn_waves(state, dt), noise, angle_at(past, time), dt)
    return Fusion(state, lasting, spikes, spike), True
