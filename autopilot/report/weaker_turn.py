"""What becomes of a planned turn where the rudder is weaker than the model's: the pilot itself, simulated.

For course-unstable boats: one that turns faster than its rudder can stop is lost, and linear margins do not say so.
"""

from __future__ import annotations

import math
from random import Random
from typing import TYPE_CHECKING

from autopilot.angles import wrap

if TYPE_CHECKING:
    from autopilot.params.vessel import Vessel

TURN = math.radians(90.0)
STRAIGHT_S = 10.0
HEADING_EVERY_S = 0.1
TURNING_TIMES = 1.5
SETTLED = math.radians(3.0)
SEEDS = (1, 2, 3)
"""The instruments' noise decides whether a boat on the brink is lost: the worst of these runs counts."""
WEAKER = 0.7
PAST_MOST = math.radians(5.0)
"""A turn that leads further past with WEAKER times the model's K is not well in hand."""


def overshoot(vessel: Vessel, gain_factor: float) -> float:
    """Return how far [rad] a turn of 90 deg leads past with K `gain_factor` times the model's; inf: not settled.

    Noise as in the vessel file. Raises RefusedError where the gains must not be engaged.
    """
    return max(_one(vessel, gain_factor, seed) for seed in SEEDS)


def survives(vessel: Vessel) -> bool:
    """Return whether a turn stays in hand where the rudder is 30 % weaker than the model's."""
    return all(_one(vessel, WEAKER, seed) <= PAST_MOST for seed in SEEDS)


def _one(vessel: Vessel, gain_factor: float, seed: int) -> float:
    from autopilot.build import build_pilot
    from autopilot.build_laws import gear_of, limits_of, model_of
    from autopilot.guidance.turn import turn_limits, turning_time
    from autopilot.models.norrbin import rate_step
    from autopilot.models.steering_gear import DelayLine, gear_step
    from autopilot.signals import HeadingSample, Order, OrderKind

    model, gear, limits, random = model_of(vessel), gear_of(vessel), limits_of(vessel), Random(seed)
    pilot, line = build_pilot(vessel), DelayLine(gear.delay + vessel.control.loop_delay_s)
    true = model._replace(gain=gain_factor * model.gain)
    turn = turn_limits(model, limits.angle_max, limits.rate_max, vessel.guidance.rudder_share)
    dt, noise, rate_noise = (
        1.0 / vessel.control.rate_hz,
        vessel.sensors.heading_noise_deg,
        vessel.sensors.rate_noise_deg_s,
    )
    heading = rate = rudder = 0.0
    heard, errors = -math.inf, list[float]()
    for tick in range(round((STRAIGHT_S + TURNING_TIMES * turning_time(model, turn, TURN)) / dt)):
        now, samples = tick * dt, tuple[HeadingSample, ...]()
        if now >= heard + HEADING_EVERY_S - 1.0e-6:
            heard = now
            seen = heading + random.gauss(0.0, math.radians(noise)), rate + random.gauss(0.0, math.radians(rate_noise))
            samples = (HeadingSample(now, wrap(seen[0]), seen[1]),)
        order = Order(OrderKind.HEADING, 0.0 if now < STRAIGHT_S else TURN, serial=1)
        line.give(now, pilot.step(now, samples, order).command.angle)
        for part in (0.25, 0.75):
            moved = gear_step(gear, rudder, line.effective(now + part * dt), 0.5 * dt)
            before, rate = rate, rate_step(true, rate, 0.5 * (rudder + moved), 0.5 * dt)
            heading, rudder = heading + 0.25 * dt * (before + rate), moved
        errors.append(heading - TURN)
    late = errors[-len(errors) // 10 :]
    return max(errors) if max(map(abs, late)) < SETTLED else math.inf
