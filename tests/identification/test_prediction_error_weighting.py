"""Output error weighed by prediction errors: nearer the truth in gusts, and the same fit without them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autopilot.cli.main import main
from autopilot.guidance.manoeuvres import zigzag_side
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.output_error import Weighting
from autopilot.identification.residuals import DisturbanceModel, bridged, innovations
from autopilot.identification.runs import FloatArray, Run, run_from_columns

RATE, HEADING = math.radians(0.1), math.radians(0.2)


def gusty(q: float, seed: int, seconds: float = 120.0) -> Run:
    """A linear boat, K 0.2 1/s and T 5 s, in a zigzag and in gusts q [rad/s/sqrt(s)], Euler steps of 20 ms."""
    random, dt, side = np.random.default_rng(seed), 0.02, 1
    heading = rate = rudder = 0.0
    rows = []
    for k in range(round(seconds / dt)):
        if k % 10 == 0:
            rows.append((k * dt, heading + HEADING * random.normal(), rate + RATE * random.normal(), rudder, 5.0))
        side = zigzag_side(side, 0.0, heading, 0.25)
        rudder += float(np.clip(0.25 * side - rudder, -0.35 * dt, 0.35 * dt))
        rate += dt * (0.2 * rudder - rate) / 5.0 + q * math.sqrt(dt) * random.normal()
        heading += dt * rate
    names = ("time_s", "heading_rad", "yaw_rate_rad_s", "rudder_rad", "speed_m_s")
    return run_from_columns("gusty", dict(zip(names, np.array(rows).T, strict=True)))


def misses(runs: list[Run], weighting: Weighting) -> FloatArray:
    """Return the errors of K [1/s], and those in units of their standard error, shape (2, runs)."""
    found = [identify([run], Question("nomoto", 5.0, weighting=weighting)) for run in runs]
    errors = np.array([each.model.gain - 0.2 for each in found])
    return np.stack([errors, errors / np.array([each.standard_errors["gain"] for each in found], dtype=float)])


def test_in_gusts_it_is_nearer_the_truth_and_knows_how_near() -> None:
    runs = [gusty(math.radians(0.1), seed) for seed in range(8)]
    weighed, plain = misses(runs, "prediction-error"), misses(runs, "residuals")
    assert np.mean(weighed[0] ** 2) < np.mean(plain[0] ** 2)
    assert np.mean(weighed[1] ** 2) < 0.7 * np.mean(plain[1] ** 2)
    assert np.count_nonzero(np.abs(weighed[1]) < 2.0) >= 6


def test_without_gusts_it_is_the_same_fit() -> None:
    plain, weighed = (
        identify([gusty(0.0, 3)], Question("nomoto", 5.0, weighting=weighting))
        for weighting in ("residuals", "prediction-error")
    )
    error = plain.standard_errors["gain"]
    assert error is not None
    assert abs(weighed.model.gain - plain.model.gain) < 2.0 * error


def test_innovations_of_what_the_filter_assumes_are_white_and_of_size_one() -> None:
    random, dt, memory, q = np.random.default_rng(1), 0.1, 3.0, 0.02
    x = turned = 0.0
    table = np.empty((20_000, 2, 1))
    for k in range(table.shape[0]):
        table[k, :, 0] = x + 0.01 * random.normal(), turned + 0.005 * random.normal()
        for _ in range(10):
            turned += 0.1 * dt * x
            x += 0.1 * dt * -x / memory + q * math.sqrt(0.1 * dt) * random.normal()
    new = innovations(table, dt, DisturbanceModel(q, memory, 0.01, 0.005))[:, :, 0]
    for channel in range(2):
        assert np.std(new[:, channel]) == pytest.approx(1.0, rel=0.03)
        assert abs(np.corrcoef(new[1:, channel], new[:-1, channel])[0, 1]) < 0.03
    assert abs(np.corrcoef(new.T)[0, 1]) < 0.03


def test_a_channel_that_is_not_measured_counts_for_nothing() -> None:
    table = np.full((50, 2, 2), np.nan)
    table[:, 0] = np.random.default_rng(2).normal(size=(50, 2))
    new = innovations(bridged(table), 0.1, DisturbanceModel(0.1, 3.0, 0.1, math.inf))
    assert np.all(new[:, 1] == 0.0)
    assert np.isfinite(new).all() and np.any(new[:, 0] != 0.0)


def test_it_excludes_what_it_cannot_weigh(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", "log.csv", "--weighting", "prediction-error", "--method", "ekf"]) == 2
    assert "--method output-error alone" in capsys.readouterr().err
