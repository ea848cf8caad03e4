"""Compass and rate of turn are sent on as they were: what is known of the boat stays as it was."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autopilot.models.norrbin import yaw_acceleration
from autopilot.runtime.build import build_pilot, model_of
from autopilot.signals import HeadingSample, Order, OrderKind, SpeedSample
from autopilot.vessel.file import load_vessel

PUSH_DEG = 3.0
BEGINS_S, STANDS_S = 120.0, 6.0


@pytest.mark.parametrize("seed", range(2026112961, 2026112964))
def test_no_disturbance_is_learnt_from_instruments_that_stand(seed: int) -> None:
    """They stood as a turn of 4 deg began: the estimate went on learning, and had -6 deg of rudder for 3 deg."""
    vessel, random = load_vessel("lanxin"), np.random.default_rng(seed)
    pilot, model = build_pilot(vessel), model_of(vessel)
    heading, rate, rudder, learnt = 0.0, 0.0, 0.0, []
    order, shown = Order(), (0.0, 0.0)
    for tick in range(round(10.0 * (BEGINS_S + STANDS_S))):
        now = 0.1 * tick
        for _ in range(10):
            rate += 0.01 * yaw_acceleration(model, rate, rudder + math.radians(PUSH_DEG))
            heading += 0.01 * rate
        if now < BEGINS_S:
            noise = np.radians(0.2 * random.standard_normal(2))
            shown = math.remainder(heading + noise[0], math.tau), rate + noise[1]
        if tick in (30, 1198):
            order = Order(OrderKind.HEADING, 0.0 if tick == 30 else math.radians(4.0), serial=order.serial + 1)
        samples = HeadingSample(now, *shown), SpeedSample(now, model.reference_speed, True)
        command = pilot.step(now, samples, order).command
        rudder = command.angle if command.engaged else 0.0
        if now >= BEGINS_S + 1.5:
            learnt.append(math.degrees(pilot.state.estimate.fusion.state.bias))
    assert np.allclose(learnt, PUSH_DEG, atol=0.5)
