"""Roll damping added to any heading law where the link brings roll: rudder against roll rate, kept only while it helps.

    delta = delta_heading + weight clip(-k p, +-most)

k > 0 fits a displacement hull, whose rudder below the centre of gravity first heels it into the turn. No roll model is
asked for, so nothing is foreseen: whether it helps is measured, again and again,

    off for PERIOD s -> on for PERIOD s -> keep the better for KEEP s -> ...

and it stays off unless the roll with it was at least `least` smaller than without. It is off at once where roll or its
rate is missing or old, and within PERIOD where the roll's own frequency sqrt(var p/var phi) falls below `lowest` (the
stern-quartering seas in which every roll law amplifies) or the roll has grown by GROWN over that measured without.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from autopilot.models.steering_gear import clip
from autopilot.signals import RollSample

PERIOD = 60.0
"""Time [s] over which the roll is measured with and without."""
SETTLE = 10.0
"""Time [s] after a switch that is not measured."""
KEEP = 600.0
"""Time [s] for which a decision stands."""
GROWN = 1.25
OLD = 0.5
"""Age [s] at which a roll sample is no longer used."""
FADE = 5.0
"""Time [s] in which the weight goes from 0 to 1."""


class RollDamping(NamedTuple):
    """rate_gain k [s] (rudder per roll rate), most [rad] rudder it may add, lowest [rad/s] roll frequency for it, least
    [-] reduction of roll that keeps it on."""

    rate_gain: float
    most: float
    lowest: float
    least: float = 0.05


class Phase(IntEnum):
    """What the damper is doing: measuring without, measuring with, keeping one of them."""

    WITHOUT = 0
    WITH = 1
    KEPT_ON = 2
    KEPT_OFF = 3


class Tally(NamedTuple):
    """Sums over what was measured: time [s], roll and its square, square of the roll rate, each times dt."""

    time: float = 0.0
    roll: float = 0.0
    roll_2: float = 0.0
    rate_2: float = 0.0

    def with_sample(self, roll: float, rate: float, dt: float) -> Tally:
        """Return the sums with `dt` [s] of `roll` [rad] and `rate` [rad/s] more."""
        return Tally(
            self.time + dt, self.roll + dt * roll, self.roll_2 + dt * roll * roll, self.rate_2 + dt * rate * rate
        )

    @property
    def deviation(self) -> float:
        """Standard deviation of the roll [rad]; a list is not a roll."""
        if self.time <= 0.0:
            return 0.0
        mean = self.roll / self.time
        return math.sqrt(max(self.roll_2 / self.time - mean * mean, 0.0))

    @property
    def frequency(self) -> float:
        """Mean frequency of the roll [rad/s], 0 where there is none."""
        deviation = self.deviation
        return math.sqrt(self.rate_2 / self.time) / deviation if deviation > 0.0 else 0.0


class RollDamper(NamedTuple):
    """All that the damper remembers: the newest sample, what it is doing, for how long [s], what was measured
    meanwhile, the roll without the rudder's help [rad], and the share in which it is on."""

    sample: RollSample | None = None
    phase: Phase = Phase.WITHOUT
    in_phase: float = 0.0
    tally: Tally = Tally()
    without: float = math.nan
    weight: float = 0.0


def checked(damping: RollDamping) -> RollDamping:
    """Return `damping`. ValueError where its numbers are none to damp with."""
    if not all(math.isfinite(value) for value in damping) or damping.most <= 0.0 or damping.lowest < 0.0:
        raise ValueError(f"roll damping: finite numbers, most above 0 and lowest not below 0, got {damping}")
    return damping


def rolled(damper: RollDamper, sample: RollSample) -> RollDamper:
    """Return the damper after a sample; what is not finite or has no rate is left out."""
    if sample.rate is None or not (math.isfinite(sample.roll) and math.isfinite(sample.rate)):
        return damper
    return damper._replace(sample=sample)


def damped(
    damping: RollDamping, damper: RollDamper, now: float, dt: float, *, engaged: bool
) -> tuple[RollDamper, float]:
    """Return the damper at `now` [s], `dt` [s] after the last tick, and the rudder [rad] to add."""
    sample = damper.sample
    if not engaged or sample is None or sample.rate is None or now - sample.time > OLD:
        return RollDamper(sample, without=damper.without), 0.0
    in_phase, tally = damper.in_phase + dt, damper.tally
    if in_phase > SETTLE:
        tally = tally.with_sample(sample.roll, sample.rate, dt)
    damper = _decided(damping, damper._replace(in_phase=in_phase, tally=tally))
    goal = 1.0 if damper.phase in (Phase.WITH, Phase.KEPT_ON) else 0.0
    weight = damper.weight + clip(goal - damper.weight, -dt / FADE, dt / FADE)
    rudder = weight * clip(-damping.rate_gain * sample.rate, -damping.most, damping.most)
    return damper._replace(weight=weight), rudder


def _decided(damping: RollDamping, damper: RollDamper) -> RollDamper:
    tally = damper.tally
    if tally.time < PERIOD:
        return damper
    slow, begins = tally.frequency < damping.lowest, damper._replace(in_phase=0.0, tally=Tally())
    if damper.phase is Phase.WITHOUT:
        return begins._replace(without=tally.deviation, phase=Phase.KEPT_OFF if slow else Phase.WITH)
    if damper.phase is Phase.WITH:
        helps = tally.deviation <= (1.0 - damping.least) * damper.without
        return begins._replace(phase=Phase.KEPT_ON if helps and not slow else Phase.KEPT_OFF)
    is_worse = damper.phase is Phase.KEPT_ON and (slow or tally.deviation > GROWN * damper.without)
    if damper.in_phase > KEEP or is_worse:
        return begins._replace(phase=Phase.WITHOUT)
    # what the sea does now counts, not what it did at the beginning
    return damper._replace(tally=Tally())
