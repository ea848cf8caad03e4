"""The heading filter as it is after a long while on a straight course: constant gains, for the judgement of loops.

On a straight course the filter of `heading_ekf` without waves is linear, and its covariance settles:

    x- = A x + B delta,   x = x- + G (y - x-[0:2]),   x = (psi, r, b),  y = (heading, rate)

A, B and G come from the very functions that filter.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

from autopilot.estimation import heading_ekf as ekf
from autopilot.estimation.heading_ekf import FilterNoise, FilterState, fuse_heading, fuse_rate
from autopilot.models.norrbin import Norrbin

RUDDER_IN_USE = math.radians(1.0)
"""So far [rad] the rudder moves about straight running: the model is trusted the less the more it moves."""
STEPS_MOST = 4000
SETTLED = 1.0e-7

Row = tuple[float, float, float]
Matrix = tuple[Row, Row, Row]
PROBE = 1.0e-3


class Prediction(NamedTuple):
    """x- = transition x + drive delta over some time."""

    transition: Matrix
    drive: Row


class SteadyFilter(NamedTuple):
    """The prediction over `interval` [s], the gains on the innovations of heading and rate, one pair a state, and the
    prediction over the age of a heading when it arrives."""

    interval: float
    prediction: Prediction
    gains: tuple[tuple[float, float], ...]
    ahead: Prediction


def linear_of(model: Norrbin) -> Norrbin:
    """Return the model about straight running."""
    return model._replace(n3=0.0, n2=0.0, n0=0.0)


def prediction(model: Norrbin, seconds: float) -> Prediction:
    """Return what `heading_ekf.predict_mean` does over so many `seconds` with the model about straight running."""
    straight, at_rest = linear_of(model), FilterState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    columns = []
    off = (at_rest._replace(psi=PROBE), at_rest._replace(rate=PROBE), at_rest._replace(bias=PROBE))
    for state in off:
        psi, rate, *_ = ekf.predict_mean(straight, state, 0.0, seconds)
        columns.append((psi / PROBE, rate / PROBE, state.bias / PROBE))
    psi, rate, *_ = ekf.predict_mean(straight, at_rest, PROBE, seconds)
    first, second, third = zip(*columns, strict=True)
    return Prediction((first, second, third), (psi / PROBE, rate / PROBE, 0.0))


@lru_cache(maxsize=64)
def steady_filter(model: Norrbin, noise: FilterNoise, interval: float, latency: float = 0.0) -> SteadyFilter:
    """Return the filter that measurements of heading and rate every `interval` [s] settle to, in calm water.

    latency: the age [s] of a heading when it arrives.
    """
    straight, calm = linear_of(model), noise._replace(waves=False)
    state, gains = ekf.initial(0.0, 0.0, 0.0, calm), [(0.0, 0.0)] * 3
    for _ in range(STEPS_MOST):
        # the mean stays at rest: only how well it is known matters
        predicted = ekf.predict(straight, calm, state._replace(time=0.0, psi=0.0, rate=0.0), RUDDER_IN_USE, interval)
        predicted = predicted._replace(psi=0.0, rate=0.0, bias=0.0)
        by_heading = fuse_heading(predicted, 1.0, calm.heading)
        by_rate = fuse_rate(by_heading._replace(psi=0.0, rate=0.0, bias=0.0), 1.0, calm.rate)
        # the rate is fused after the heading, whose part of it is known by then
        on_heading = (by_heading.psi, by_heading.rate, by_heading.bias)
        on_rate = (by_rate.psi, by_rate.rate, by_rate.bias)
        found = [(h - r * by_heading.rate, r) for h, r in zip(on_heading, on_rate, strict=True)]
        moved = max(map(math.dist, found, gains))
        state, gains = by_rate._replace(psi=0.0, rate=0.0, bias=0.0), found
        if moved < SETTLED:
            break
    return SteadyFilter(interval, prediction(model, interval), tuple(gains), prediction(model, latency))
