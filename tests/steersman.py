"""A law with its memory, asked as the pilot asks it, for tests of laws alone."""

from __future__ import annotations

import math
from typing import Any

from autopilot.control.backstepping import LAW as BACKSTEPPING
from autopilot.control.backstepping import BacksteppingGains, BoundedGains
from autopilot.control.law import NO_ROLL, Law, LawInForce, LawInput, RollInput
from autopilot.control.pid import LAW as PID
from autopilot.control.pid import BoatPid, PidGains
from autopilot.control.sliding_heading import LAW as SLIDING
from autopilot.control.sliding_heading import SlidingGains
from autopilot.models.norrbin import Norrbin
from autopilot.signals import NavState, Reference, RollSample


def law_with(gains: BacksteppingGains | PidGains | SlidingGains, bound: float = math.nan) -> LawInForce:
    """Return the law whose gains these are. bound: the largest error of backstepping, or the PID's K/U; nan: none."""
    if isinstance(gains, BacksteppingGains):
        return LawInForce(BACKSTEPPING, BoundedGains(gains, math.inf if math.isnan(bound) else bound))
    return LawInForce(PID, BoatPid(gains, bound)) if isinstance(gains, PidGains) else LawInForce(SLIDING, gains)


def asked(model: Norrbin, reference: Reference, heading: float, rate: float, **more: Any) -> LawInput:
    """Return what a law is given at the speed at which its gains hold; `more`: other fields, or the state's `bias`."""
    state = NavState(0.0, heading, rate, model.reference_speed, 0.0, more.pop("bias", 0.0), 0.0, True)
    plain = LawInput(model, 1.0, reference, state, NO_ROLL, 0.0, math.inf, 0.05)
    return plain._replace(**more)


class Steersman:
    """One law at sea: `reset`, `on_sample`, `update`, as the pilot does; its memory and its last roll can be looked
    at."""

    def __init__(self, law: LawInForce, reference_speed: float, rudder_max: float = math.inf) -> None:
        self.law, self.reference_speed, self.rudder_max = law, reference_speed, rudder_max
        self.reset(0.0)

    @property
    def kind(self) -> Law:
        return self.law.kind

    @property
    def gains(self) -> Any:
        return self.law.gains

    @property
    def weight(self) -> float:
        return float(self.memory.schedule.weight)

    def reset(self, rudder: float) -> None:
        self.memory, self.roll = self.law.first(rudder), None

    def on_sample(self, sample: RollSample) -> None:
        self.roll: RollSample | None = sample if sample.rate is not None else self.roll

    def update(self, model: Norrbin, reference: Reference, state: NavState, last_rudder: float, dt: float) -> float:
        roll = NO_ROLL
        if self.roll is not None and self.roll.rate is not None:
            roll = RollInput(self.roll.roll, self.roll.rate, state.time - self.roll.time)
        ratio = model.reference_speed / self.reference_speed
        given = LawInput(model, ratio, reference, state, roll, last_rudder, self.rudder_max, dt)
        demand, self.memory = self.law.step(self.memory, given)
        return demand
