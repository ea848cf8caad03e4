"""Estimator and rudder observer with their state held for a test: what the pilot holds in its own."""

from __future__ import annotations

from collections.abc import Iterator

from autopilot.estimation.disturbance import FilterNoise, noises_of
from autopilot.estimation.estimator import (
    Beliefs,
    EstimatorConfig,
    EstimatorState,
    believing,
    estimated,
    first_state,
    nav_state,
)
from autopilot.estimation.fusion import stretch
from autopilot.estimation.rudder_observer import (
    RudderObserver,
    RudderPast,
    advanced,
    all_effective,
    is_fed_back,
    newest_angle,
    ordered,
    rudder_memory,
    tick_at,
    with_feedback,
)
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.signals import NavState, Sample


def held(past: RudderPast, start: float, end: float, grain: float) -> Iterator[tuple[float, float]]:
    """Yield (until [s], angle [rad]) from `start` to `end` [s], oldest first; stretch by stretch."""
    at = start
    while at < end:
        at, angle = stretch(past, at, end, grain)
        yield at, angle


class OutputFeedbackLoop:
    """A rudder that is observed."""

    def __init__(self, gear: SteeringGear) -> None:
        self.gear, self.state, self.memory = gear, RudderObserver(), rudder_memory()

    @property
    def past(self) -> RudderPast:
        return (self.memory.times, self.memory.angles, self.state.ticks)

    @property
    def angle(self) -> float:
        return newest_angle(self.past)

    def order(self, now: float, angle: float) -> None:
        self.state = ordered(self.state, self.memory, now, angle)

    def feed_back(self, time: float, angle: float) -> None:
        self.state = with_feedback(self.state, time, angle)

    def is_known(self, now: float) -> bool:
        return is_fed_back(self.state, now)

    def advance(self, now: float) -> float:
        self.state = advanced(self.gear, self.state, self.memory, now)
        return self.angle

    def change(self, gear: SteeringGear) -> None:
        self.gear, self.state = gear, all_effective(self.state, self.memory)

    def held(self, start: float, end: float, grain: float) -> list[tuple[float, float]]:
        return list(held(self.past, start, end, grain))


class Estimating:
    """An estimator at work."""

    def __init__(self, model: Norrbin, gear: SteeringGear, noise: FilterNoise) -> None:
        self.config = EstimatorConfig(model, gear, noises_of(noise))
        self.reset()

    def reset(self) -> None:
        self.state: EstimatorState = first_state(self.config)

    @property
    def known(self) -> EstimatorState:
        """All that is remembered, but for the rings that cannot be compared."""
        return self.state._replace(memory=None)

    def update(self, now: float, samples: tuple[Sample, ...]) -> NavState:
        self.state = estimated(self.config, self.state, now, samples)
        return nav_state(self.config, self.state, now)

    def take_rates(self, wanted: bool) -> None:
        self.state = believing(self.config, self.state, Beliefs(takes_rates=wanted))

    def order(self, now: float, angle: float) -> None:
        self.state = self.state._replace(rudder=ordered(self.state.rudder, self.state.memory, now, angle))

    def modelled_at(self, time: float) -> float:
        """Return where the steering gear's model stood at `time` [s]."""
        memory = self.state.memory
        past = (memory.times, memory.angles, self.state.rudder.ticks)
        return memory.gears[tick_at(past, time) & (len(memory.gears) - 1)]
