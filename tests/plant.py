"""A boat in a box for closed-loop tests of the pilot alone: Norrbin plant, steering gear, compass, disturbance.

Not the product's simulator: a small second implementation, stepped by hand, without links or clock.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin, rate_step
from autopilot.models.steering_gear import DelayLine, SteeringGear, gear_step
from autopilot.pilot import Pilot
from autopilot.signals import HeadingSample, Order, Sample, Tick


@dataclass
class Plant:
    """The true boat; `disturbance` [rad of rudder] is a function of time."""

    model: Norrbin
    gear: SteeringGear
    heading: float = 0.0
    rate: float = 0.0
    rudder: float = 0.0
    disturbance: Callable[[float], float] = lambda _: 0.0
    heading_noise: float = 0.0
    rate_noise: float | None = 0.0
    latency: float = 0.0
    seed: int = 1
    time: float = 0.0
    step_max: float = 0.01
    """Longest step [s] of its equations."""
    _queue: deque[HeadingSample] = field(default_factory=deque)

    def __post_init__(self) -> None:
        self.random = np.random.default_rng(self.seed)
        self.line = DelayLine(self.gear.delay)

    def step(self, order: float, dt: float) -> None:
        """Move on by `dt` [s] under a rudder `order` [rad]."""
        self.line.give(self.time, order)
        steps = max(1, math.ceil(dt / min(self.step_max, 0.1 * self.model.time_constant)))
        for _ in range(steps):
            h = dt / steps
            self.time += h
            self.rudder = gear_step(self.gear, self.rudder, self.line.effective(self.time), h)
            drive = self.rudder + self.disturbance(self.time)
            before = self.rate
            self.rate = rate_step(self.model, self.rate, drive, h)
            self.heading = wrap(self.heading + 0.5 * h * (before + self.rate))

    def sense(self) -> list[Sample]:
        """Return the compass samples that arrive now."""
        heading = wrap(self.heading + self.heading_noise * self.random.standard_normal())
        rate = None if self.rate_noise is None else self.rate + self.rate_noise * self.random.standard_normal()
        self._queue.append(HeadingSample(self.time, heading, rate, "compass"))
        out: list[Sample] = []
        while self._queue and self._queue[0].time <= self.time - self.latency + 1.0e-9:
            out.append(self._queue.popleft())
        return out


def sail(
    pilot: Pilot, plant: Plant, order: Order | Callable[[float], Order], seconds: float, dt: float, sense_every: int = 1
) -> list[Tick]:
    """Run pilot and plant together for `seconds` at steps of `dt` [s]; return the ticks."""
    ticks = []
    for index in range(round(seconds / dt)):
        now = plant.time
        samples = tuple(plant.sense()) if index % sense_every == 0 else ()
        wanted = order if isinstance(order, Order) else order(now)
        tick = pilot.step(now, samples, wanted)
        ticks.append(tick)
        plant.step(tick.command.angle if tick.command.engaged else 0.0, dt)
    return ticks
