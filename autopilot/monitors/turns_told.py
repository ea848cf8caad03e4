"""What heading and rate of turn tell of the boat's turns: how far apart they are, and whether they go opposite ways.

Scalar functions over NamedTuples, compiled by `sitl.compiled` as they are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.models.steering_gear import clip

APART_TIME = 5.0
"""Turns by heading and by rate are compared over about this time [s]."""
SENSE_TIME = 2.0
"""Which way the boat turns is taken from its turns over about this time [s]."""
SENSE_LASTS = 4.0
SENSE_LEAST = math.radians(2.0) ** 2
SENSE_SHARE = 4.0
"""They go opposite ways where the mean square of their difference, over this time [s], is this many times that of
their sum and by so much [rad^2] more: a compass that lags by less than 120 deg of a wave is right yet, and so is
a gyro that is off by a degree a second."""


class Turns(NamedTuple):
    """apart [rad]: the turn by heading less that by rate, of late; heading and rate [rad]: the turns over a shorter
    time by each; difference and sum [rad^2]: the mean squares of both."""

    apart: float
    heading: float
    rate: float
    difference: float
    sum: float


NO_TURNS = Turns(0.0, 0.0, 0.0, 0.0, 0.0)


def turns_told(turns: Turns, by_heading: float, by_rate: float, step: float) -> Turns:
    """Return what is known after a step of `step` [s] in which the boat turned `by_heading` and `by_rate` [rad]."""
    fades = math.exp(-step / SENSE_TIME)
    # no boat turns further between two headings, and an instrument that says so must not spoil the sums
    by_rate = clip(by_rate, -math.pi, math.pi)
    heading, rate = turns.heading * fades + by_heading, turns.rate * fades + by_rate
    share = -math.expm1(-step / SENSE_LASTS)
    return Turns(
        turns.apart * math.exp(-step / APART_TIME) + by_heading - by_rate,
        heading,
        rate,
        turns.difference + share * ((heading - rate) ** 2 - turns.difference),
        turns.sum + share * ((heading + rate) ** 2 - turns.sum),
    )


def are_opposite(turns: Turns) -> bool:
    """Return whether heading and rate tell of turns to opposite sides."""
    return turns.difference > SENSE_SHARE * turns.sum + SENSE_LEAST


def are_alike(turns: Turns) -> bool:
    """Return whether they tell of turns to the same side: where the boat hardly turns neither holds."""
    return turns.sum > SENSE_SHARE * turns.difference + SENSE_LEAST
