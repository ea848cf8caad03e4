"""The rate that a rudder shows: a slow one is found, one as its file says is left alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autopilot.control.rudder_roll import PROOF, SETTLE, UNPROVEN, Proof, proof_step
from autopilot.control.shown_rate import RATE_UNSEEN, seen
from autopilot.models.steering_gear import SteeringGear, gear_step

FILED = SteeringGear(math.radians(40.0), math.radians(20.0), 0.1)


def shown_deg_s(true_deg_s: float, dt: float, amplitude_deg: float = 15.0) -> float:
    """Rate [deg/s] after two minutes of orders that swing at 1 rad/s, with 0.2 deg of noise on the sensor."""
    gear, random = FILED._replace(rate_max=math.radians(true_deg_s)), np.random.default_rng(3)
    shown, rudder, order = RATE_UNSEEN, 0.0, 0.0
    for index in range(round(120.0 / dt)):
        shown = seen(shown, FILED, rudder + math.radians(0.2) * random.standard_normal(), order, dt)
        order = math.radians(amplitude_deg) * math.sin(index * dt)
        rudder = gear_step(gear, rudder, order, dt)
    return math.degrees(min(shown.rate, FILED.rate_max))


@pytest.mark.parametrize("dt", [0.05, 0.1])
@pytest.mark.parametrize("rate", [3.0, 5.0, 8.0])
def test_a_slow_rudder_is_found(rate: float, dt: float) -> None:
    assert shown_deg_s(rate, dt) == pytest.approx(rate, rel=0.3)


@pytest.mark.parametrize("dt", [0.05, 0.1])
def test_a_rudder_as_its_file_says_keeps_its_rate(dt: float) -> None:
    assert shown_deg_s(20.0, dt) == pytest.approx(20.0)


def proven(without: float, under: float) -> Proof:
    """Two minutes without the law, then until the first judgement, rolling by so much [rad]; a third is promised."""
    proof, dt = UNPROVEN, 0.1
    for index in range(1200):
        proof = proof_step(proof, 0.0, without * math.sin(index * dt), 0.3, dt)
    proof = proof_step(proof, 0.5, 0.0, 0.3, dt)
    for index in range(round((SETTLE + PROOF) / dt) + 1):
        proof = proof_step(proof, 1.0, under * math.sin(index * dt), 0.3, dt)
    return proof


def test_a_law_under_which_the_roll_has_grown_is_barred_and_comes_back() -> None:
    proof = proven(0.1, 0.108)
    assert proof.failures == 1
    assert proof.barred > 0.0
    for _ in range(round(PROOF / 0.1) + 1):
        proof = proof_step(proof, 0.0, 0.0, 0.3, 0.1)
    assert proof.barred == 0.0


@pytest.mark.parametrize("under", [0.07, 0.09])
def test_a_law_under_which_the_roll_has_fallen_stays(under: float) -> None:
    proof = proven(0.1, under)
    assert proof.failures == 0
    assert proof.barred == 0.0
