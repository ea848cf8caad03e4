"""What a fail-safe steers by when the heading cannot be trusted: dead reckoning, or the wind over the bow. Pure."""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin, rate_step
from autopilot.models.steering_gear import clip
from autopilot.signals import HeadingSample, NavState, RateSample, Reference, Sample, WindSample

RATE_FRESH = 0.5
RATE_MOST = 10.0
"""A rate older than this [s] is replaced by the model's, one beyond this [rad/s] is none."""
WIND_FRESH = 5.0
WIND_SMOOTHING = 2.0
WINDWARD_ANGLE = math.radians(30.0)
"""Further than this off the wind the whole rudder of the slow turn is put over; nearer, in proportion."""


class Wind(NamedTuple):
    """Where the wind comes from, smoothed, as a vector: ahead and to starboard."""

    time: float
    ahead: float
    abeam: float


class Memory(NamedTuple):
    """What the fail-safe remembers: the newest rate [rad/s] with its time [s], the wind, the state that it has
    reckoned, and the heading to hold [rad]."""

    rate: tuple[float, float] | None = None
    wind: Wind | None = None
    state: NavState | None = None
    held: float = math.nan


NO_MEMORY = Memory()


class FailsafeSteering:
    """`on_sample` every tick; `begin` when a fail-safe starts to steer; then `reckon` or `windward` in each tick of it.
    For as long as a tick lasts: what it remembers is `memory`."""

    def __init__(self, memory: Memory = NO_MEMORY) -> None:
        self.memory = memory

    def on_sample(self, samples: tuple[Sample, ...], takes_rates: bool = True, rate_bias: float = 0.0) -> None:
        """Take rates of turn, where they are to be taken, less their standing error `rate_bias` [rad/s], and wind;
        headings are what cannot be trusted."""
        for sample in samples:
            if isinstance(sample, WindSample):
                self.memory = self.memory._replace(wind=wind_after(self.memory.wind, sample))
            elif takes_rates and isinstance(sample, HeadingSample | RateSample):
                self.memory = self.memory._replace(rate=rate_after(self.memory.rate, sample, rate_bias))

    def begin(self, state: NavState) -> None:
        """Start from the last `state`: its heading is to be held."""
        self.memory = self.memory._replace(state=state, held=state.heading)

    def reckon(self, now: float, model: Norrbin, rudder: float) -> tuple[NavState, Reference]:
        """Return where the boat must be heading at `now` [s] by measured rate or model, and the heading to hold.

        `rudder` [rad] is where the steering gear stands. ValueError before `begin`.
        """
        measured, _, before, held = self.memory
        if before is None:
            raise ValueError("reckon: begin first")
        step = clip(now - before.time, 0.0, RATE_FRESH)
        if measured is not None and 0.0 <= now - measured[0] <= RATE_FRESH:
            rate = measured[1]
        else:
            rate = rate_step(model, before.rate, rudder + before.bias, step)
        state = before._replace(
            time=now,
            heading=wrap(before.heading + 0.5 * (before.rate + rate) * step),
            rate=rate,
            rudder=rudder,
            heading_age=before.heading_age + max(now - before.time, 0.0),
            wave_heading=0.0,
            wave_rate=0.0,
            wave_deviation=0.0,
        )
        self.memory = self.memory._replace(state=state)
        return state, Reference(held)

    def windward(self, now: float, rudder_most: float) -> float | None:
        """Return the rudder [rad] of a slow turn into the wind, at most `rudder_most`; None where no wind is known."""
        wind = self.memory.wind
        if wind is None or not 0.0 <= now - wind.time <= WIND_FRESH:
            return None
        angle = math.atan2(wind.abeam, wind.ahead)
        return rudder_most * clip(angle / WINDWARD_ANGLE, -1.0, 1.0)


def rate_after(
    before: tuple[float, float] | None, sample: HeadingSample | RateSample, bias: float
) -> tuple[float, float] | None:
    """Return the newest rate of turn [rad/s] that a boat may have, less its `bias`, with its time [s]."""
    time, rate = sample.time, sample.rate
    return before if rate is None or not abs(rate) <= RATE_MOST or not math.isfinite(time) else (time, rate - bias)


def wind_after(before: Wind | None, sample: WindSample) -> Wind | None:
    """Return the wind after a sample of it, smoothed where it is close enough to the one before."""
    if not (math.isfinite(sample.time) and math.isfinite(sample.angle)):
        return before
    ahead, abeam = math.cos(sample.angle), math.sin(sample.angle)
    if before is not None and 0.0 <= sample.time - before.time <= WIND_FRESH:
        share = -math.expm1(-(sample.time - before.time) / WIND_SMOOTHING)
        ahead = before.ahead + share * (ahead - before.ahead)
        abeam = before.abeam + share * (abeam - before.abeam)
    return Wind(sample.time, ahead, abeam)
