"""The rate that a rudder shows: a slow one is found, one as its file says is left alone."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autopilot.control.limits import RATE_UNSEEN, ShownRate, seen
from autopilot.control.rudder_roll import PROOF, SETTLE, UNPROVEN, Proof, proof_step
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
        proof = proof_step(proof, 0.0, without * math.sin(index * dt), 0.3, dt, 10.0)
    proof = proof_step(proof, 0.5, 0.0, 0.3, dt, 10.0)
    for index in range(round((SETTLE + PROOF) / dt) + 1):
        proof = proof_step(proof, 1.0, under * math.sin(index * dt), 0.3, dt, 10.0)
    return proof


def test_a_law_under_which_the_roll_has_grown_is_barred_and_comes_back() -> None:
    proof = proven(0.1, 0.112)
    assert proof.failures == 1
    assert proof.barred > 0.0
    for _ in range(round(PROOF / 0.1) + 1):
        proof = proof_step(proof, 0.0, 0.0, 0.3, 0.1, 10.0)
    assert proof.barred == 0.0


@pytest.mark.parametrize("under", [0.07, 0.09])
def test_a_law_under_which_the_roll_has_fallen_stays(under: float) -> None:
    proof = proven(0.1, under)
    assert proof.failures == 0
    assert proof.barred == 0.0


def window(
    travel_deg: float, order_deg: float, known: float = math.inf, steps: int = 5, gear: SteeringGear = FILED
) -> ShownRate:
    """What is known after a window, that of its first look with it, in which the rudder moved so far from amidships."""
    shown, dt = ShownRate(known), 0.1
    for step in range(steps + 1):
        shown = seen(shown, gear, math.radians(travel_deg) * step / 5, math.radians(order_deg), dt)
    return shown


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("travel_deg", "rate_deg_s"), [(5.1, math.inf), (4.9, 4.9 / 0.6), (1.2, 2.0), (0.12, 0.5), (0.0, math.inf)]
)
def test_a_rudder_that_falls_five_degrees_behind_its_file_within_a_window_is_slow(
    side: float, travel_deg: float, rate_deg_s: float
) -> None:
    """The file's gear makes 10 deg meanwhile; one that stands is another matter, and so is one that goes wrong."""
    found = window(side * travel_deg, side * 30.0)
    share = 20.0 + 0.1 * (rate_deg_s - 20.0)
    assert math.degrees(found.rate) == pytest.approx(share), "a tenth of the way from the file's 20 deg/s"
    assert (found.since, found.begin) == (0.1, found.filed), "a new window has begun"
    assert found.begin == pytest.approx(side * math.radians(travel_deg))
    assert window(-side * travel_deg, side * 30.0).rate == math.inf


def test_nothing_is_judged_before_the_window_is_over() -> None:
    for steps in range(5):
        found = window(0.5, 30.0, steps=steps)
        assert (found.rate, found.begin) == (math.inf, 0.0) and found.since == pytest.approx(0.1 * (steps + 1))


def test_a_window_counts_a_tenth_once_a_rate_is_known_and_a_faster_one_always() -> None:
    known = math.radians(4.0)
    assert window(1.2, 30.0, known).rate == pytest.approx(known + 0.1 * (math.radians(2.0) - known))
    assert window(4.8, 30.0, known).rate == pytest.approx(known + 0.1 * (math.radians(8.0) - known))
    assert window(2.3, 2.4, known).rate == known, "a small order is done with in time"
    quick = math.radians(19.9)
    assert window(60.0, 30.0, quick).rate == pytest.approx(math.radians(20.0)), "never above the file's"
    assert window(0.06, 30.0, known).rate == pytest.approx(known + 0.1 * (math.radians(0.5) - known)), "0.5 deg/s"


def test_where_the_file_knows_no_rate_the_first_window_s_counts() -> None:
    unlimited = FILED._replace(rate_max=math.inf)
    assert math.degrees(window(1.2, 30.0, gear=unlimited).rate) == pytest.approx(2.0)
    assert window(-1.2, 30.0, gear=unlimited).rate == math.inf


@pytest.mark.parametrize("since", [0.0, -0.1])
def test_a_window_without_time_or_of_a_clock_that_was_put_back_begins_anew(since: float) -> None:
    known = math.radians(4.0)
    assert seen(ShownRate(known, since, 0.1, 0.2), FILED, 0.3, 0.5, 0.05) == ShownRate(known, 0.05, 0.3, 0.3)
