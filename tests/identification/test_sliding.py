"""A boat that slides in its turns is found, its prediction made with it, and one that does not slide is not said to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autopilot.identification.identified import Identified
from autopilot.identification.identify import identify
from autopilot.identification.runs import RudderOrigin, Run, run_from_columns
from autopilot.models.norrbin import Norrbin

NAMES = ("time_s", "rudder_rad", "speed_m_s", "heading_rad", "yaw_rate_rad_s")
DT, SAMPLED = 0.02, 10
K, T1 = 0.3, 40.0


def zigzag(seconds: float, lag: float, lead: float, *, gust: float = 0.0, seed: int = 1) -> Run:
    """Sail a 10/10 zigzag with the rudder at 5 deg/s: T1 r' + r = K v, v the rudder behind (1 + T3 s)/(1 + T2 s), and
    gusts worth so much rudder [rad] over 6 s."""
    random = np.random.default_rng(seed)
    rate = heading = rudder = lagged = push = 0.0
    side, rows = 1.0, []
    for step in range(round(seconds / DT)):
        if step % SAMPLED == 0:
            noise = np.radians(0.1) * random.standard_normal(2)
            rows.append((step * DT, rudder, 3.0, heading + noise[0], rate + noise[1]))
        side = -side if side * heading > math.radians(10.0) else side
        way = side * math.radians(10.0) - rudder
        rudder += min(max(way, -math.radians(5.0) * DT), math.radians(5.0) * DT)
        lagged += DT / lag * (rudder - lagged) if lag > 0.0 else rudder - lagged
        driven = lagged + (lead / lag * (rudder - lagged) if lag > 0.0 else 0.0)
        push += -DT / 6.0 * push + gust * math.sqrt(2.0 * DT / 6.0) * float(random.standard_normal())
        rate += DT / T1 * (K * (driven + push) - rate)
        heading += DT * rate
    return run_from_columns("zigzag", dict(zip(NAMES, np.array(rows).T, strict=True)))


def found(run: Run) -> Identified:
    return identify([run])


@pytest.mark.parametrize("rudder", ["measured", "ordered"])
def test_lag_and_lead_of_a_boat_that_slides_are_found_and_predict_another_run(rudder: RudderOrigin) -> None:
    answer = found(zigzag(300.0, 3.0, 9.0, gust=math.radians(0.3))._replace(rudder=rudder))
    assert answer.sliding is not None and answer.differing is None
    model, fit = answer.sliding
    errors = fit.train_errors
    assert abs(fit.train.lag - 3.0) < 3.0 * errors["lag"] < 3.0
    assert abs(fit.train.lead - 9.0) < 3.0 * errors["lead"] < 6.0
    assert model.gain / model.time_constant == pytest.approx(K / T1, rel=0.2)
    assert any("slides" in note for note in answer.notes)
    other = zigzag(300.0, 3.0, 9.0, seed=2)
    # in a calm the boat that was found misses less than a twentieth of what the one of first order does not explain
    first = answer._replace(sliding=None).predict(other)
    second = answer.predict(other)
    assert second.yaw_rate_r2 is not None and first.yaw_rate_r2 is not None
    assert second.yaw_rate_r2 > 0.95 > first.yaw_rate_r2


@pytest.mark.parametrize(
    ("rudder", "seed"), [(rudder, seed) for rudder in ("measured", "ordered") for seed in range(3)]
)
def test_gusts_make_no_boat_slide(rudder: RudderOrigin, seed: int) -> None:
    run = zigzag(200.0, 0.0, 0.0, gust=math.radians(1.0), seed=20261127 + seed)
    assert found(run._replace(rudder=rudder)).sliding is None


def sideways(gust: float, seed: int, side: float) -> Run:
    """Sail a 20/20 zigzag by compass alone with a hull that its drift x turns further: T r' = K (v + gusts) - r + x,
    Td x' = d r - x; gusts worth so much rudder [rad] over 5 s. By the midpoint rule."""
    random, h, over = np.random.default_rng([seed, int(side > 0.0)]), 0.02, side * math.radians(20.0)
    heading = rate = drift = rudder = push = 0.0
    rows = []

    def turning(r: float, x: float, drive: float) -> tuple[float, float]:
        return (HULL_K * drive - r + x) / HULL_T, (SHARE * r - x) / HULL_T

    for step in range(round(150.0 / h)):
        if step % 5 == 0:
            rows.append((step * h, rudder, 3.0, heading + math.radians(0.3) * random.standard_normal()))
        over = -over if heading * math.copysign(1.0, over) >= math.radians(20.0) else over
        before, travel = rudder, math.radians(15.0) * h
        rudder += min(max(over - rudder, -travel), travel)
        push += -h / 5.0 * push + gust * math.sqrt(2.0 * h / 5.0) * float(random.standard_normal())
        drive = 0.5 * (before + rudder) + push
        there, aside = (0.5 * h * change for change in turning(rate, drift, drive))
        middle = rate + there
        by_rate, by_drift = turning(middle, drift + aside, drive)
        heading, rate, drift = heading + h * middle, rate + h * by_rate, drift + h * by_drift
    return run_from_columns(f"{side:+.0f}", dict(zip(NAMES[:4], np.array(rows).T, strict=True)))


HULL_K, HULL_T, SHARE = 0.1, 6.0, 0.5
"""In a turn held K/(1 - d); (1 + 6 s)/(1 - d) times what turns it over 1 + 24 s + 72 s^2: T1 20.5, T2 3.5, T3 6 s."""
SLOW_K, SLOW_T, T2, T3 = 0.2, 18.0, 12.0 - 72.0**0.5, 6.0


@pytest.mark.parametrize("gust", [0.0, math.radians(0.5)])
@pytest.mark.parametrize("seed", [20261128, 20261129])
def test_a_slide_is_found_by_compass_alone_and_intervals_hold_k_and_t_of_a_slow_rudder(gust: float, seed: int) -> None:
    answer = identify([sideways(gust, seed, side) for side in (1.0, -1.0)])
    assert answer.sliding is not None
    model, fit = answer.sliding
    slow = Norrbin(SLOW_K, SLOW_T)
    for name in ("gain", "time_constant"):
        error = answer.standard_errors[name]
        assert error is not None
        assert abs(getattr(answer.model, name) - getattr(slow, name)) < 2.0 * error
    assert abs(fit.train.lag - T2) < 3.0 * fit.train_errors["lag"] < 2.5
    assert abs(fit.train.lead - T3) < 3.0 * fit.train_errors["lead"] < 5.0
    assert model.gain == pytest.approx(SLOW_K, rel=0.1 if gust == 0.0 else 0.25)


def test_a_boat_that_may_slide_is_said_to_and_its_intervals_hold_both() -> None:
    answer = identify([sideways(math.radians(2.0), MAYBE, side) for side in (1.0, -1.0)])
    assert answer.sliding is None
    assert any("do not tell whether the boat slides" in note for note in answer.notes)
    error = answer.standard_errors["gain"]
    assert error is not None
    assert abs(answer.model.gain - SLOW_K) < 2.0 * error


MAYBE = 20261128
