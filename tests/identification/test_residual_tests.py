"""Whiteness and the rudder's trace in the residuals, on boats whose residuals are known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from identification_accuracy import BOATS, clean
from identification_accuracy import noisy as noisy_boat
from independent_boat import Boat, Sea, sailed
from zigzag_trials import LANXIN, noisy, run_of, zigzag

from autopilot.identification import simulation
from autopilot.identification.residual_tests import (
    ResidualTest,
    answered_share,
    correlations,
    residual_tests,
    simulate_run,
)
from autopilot.models.norrbin import Norrbin

TRUTH = Norrbin(LANXIN["K"], LANXIN["T"], LANXIN["n3"], reference_speed=5.0)
TABLE = zigzag(np.radians(15.0), 60.0, 0.1)


def of_rate(table: dict[str, np.ndarray], model: Norrbin = TRUTH) -> ResidualTest:
    return residual_tests([run_of(table)], model)[0]


def test_the_true_model_leaves_white_residuals() -> None:
    """At a level of 1 % two of twenty would be rare: what is white is called white."""
    verdicts = [of_rate(noisy(TABLE, 0.002, 0.0, seed)) for seed in range(20)]
    assert sum(not test.is_white for test in verdicts) <= 2
    assert not any(test.follows_rudder for test in verdicts)
    assert "white" in verdicts[0].sentences()[0]


def test_gusts_are_remembered_but_do_not_follow_the_rudder() -> None:
    gusty = zigzag(np.radians(15.0), 240.0, 0.1, gust=0.03, gust_memory=2.0, seed=3)
    test = of_rate(noisy(gusty, 0.001, 0.001, 3))
    assert not test.is_white
    assert 0.5 < test.memory < 20.0
    assert not test.follows_rudder


def test_a_gain_that_is_wrong_leaves_the_rudder_in_the_residuals() -> None:
    test = of_rate(noisy(TABLE, 0.002, 0.002, 5), TRUTH._replace(gain=0.8 * LANXIN["K"]))
    assert test.follows_rudder
    assert test.rudder > 0.5
    assert test.rudder_lag < 1.0
    assert any("misses part of what the rudder does" in sentence for sentence in test.sentences())


def test_correlations_of_segments_with_blanks_are_those_of_the_products_lag_by_lag() -> None:
    random = np.random.default_rng(8)
    one, other = ([random.normal(size=size) for size in (400, 37, 9)] for _ in range(2))
    other[0][50:80] = one[1][3] = math.nan
    found = correlations(one, other, 60)
    scale = math.sqrt(float(np.nanmean(np.concatenate(one) ** 2)) * float(np.nanmean(np.concatenate(other) ** 2)))
    for lag in range(61):
        products = np.concatenate(
            [a[: a.size - lag] * b[lag:] for a, b in zip(one, other, strict=True) if lag < a.size]
        )
        assert found[lag] == pytest.approx(float(np.nanmean(products)) / scale, abs=1.0e-12)


def test_nothing_follows_a_rudder_that_stands_still() -> None:
    random, time = np.random.default_rng(1239), np.arange(39) / 20.0
    still = np.full(time.size, 0.1)
    for drift in (0.0, 0.05):
        table = {"time_s": time, "rudder_rad": still, "speed_m_s": still + 4.9, "heading_rad": drift * time**2}
        table["heading_rad"] = table["heading_rad"] + random.normal(0.0, 0.003, time.size)
        (test,) = residual_tests([run_of(table)] * 2, TRUTH)
        assert test.rudder == 0.0 and not test.follows_rudder


def test_only_what_was_measured_is_tested() -> None:
    heading_only = {key: values for key, values in noisy(TABLE, 0.0, 0.003, 1).items() if key != "yaw_rate_rad_s"}
    assert [test.signal for test in residual_tests([run_of(heading_only)], TRUTH)] == ["heading"]
    short = {key: values[:12] for key, values in TABLE.items()}
    assert residual_tests([run_of(short)], TRUTH) == []


@pytest.mark.parametrize(
    ("gain", "changes_deg", "low", "high"), [(3.0, 0.0, 0.6, 1.0), (3.0, 20.0, 0.0, 0.3), (0.0, 0.0, 0.0, 0.3)]
)
def test_a_rudder_that_only_answers_waves_is_distinguished_from_a_manoeuvre(
    gain: float, changes_deg: float, low: float, high: float
) -> None:
    """A gain of 0 is a zigzag."""
    sea = Sea("waves", gust_deg=0.5, wave_deg=3.0, gyro_deg_s=0.1)

    def helm(time: float, heading: float, rate: float) -> float:
        course = math.radians(changes_deg) * (int(time / 40.0) % 2)
        return min(max(gain * (course - heading) - 0.5 * rate, -0.5), 0.5)

    run = run_of(sailed(Boat(0.125, 0.5, 1.5, 0.001), sea, 5, 150.0, helm=helm if gain else None))
    model = Norrbin(0.25, 2.0, 3.0, n0=0.002, reference_speed=5.0)
    assert low <= answered_share(model, [run], [simulate_run(model, run)]) <= high


@pytest.mark.parametrize("missing", [0.0, 0.5])
def test_missing_samples_leave_the_residual_tests_verdict(missing: float) -> None:
    table = {key: values.copy() for key, values in noisy(TABLE, 0.002, 0.0, 7).items()}
    blank = np.random.default_rng(8).random(table["time_s"].size) < missing
    table["yaw_rate_rad_s"][blank] = np.nan
    test = of_rate(table)
    assert np.isfinite([test.whiteness, test.memory, test.rudder, test.by_chance]).all()
    assert test.is_white


def test_a_course_unstable_boat_is_simulated_all_steps_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    boat = BOATS[3]
    monkeypatch.setattr(simulation, "_one_by_one", None)
    (motion,) = simulate_run(boat.model, noisy_boat(boat, 1))
    assert np.std(motion[:, 0]) == pytest.approx(np.std(clean(boat)["yaw_rate_rad_s"]), rel=0.05)
