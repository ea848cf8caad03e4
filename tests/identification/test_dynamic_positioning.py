"""A ship under its thrusters, sailed by the simulator of `benchmarks/dp_intervals.py`, which shares no equation."""

from __future__ import annotations

import math

import dp_intervals
import numpy as np
import pytest
from dp_intervals import CONDITIONS, HULL, orders, sailed, truth_of

from autopilot.identification.dynamic_positioning import (
    BE,
    BN,
    PSI,
    DpFit,
    Floats,
    R,
    Trial,
    _rates,
    _Ships,
    _slopes,
    identify_dp,
    usual_beliefs,
)


def fitted(trial: Trial, lag: float | None = None) -> DpFit:
    return identify_dp(HULL, trial, usual_beliefs(HULL, trial, lag), lag or 0.0)


def off(fit: DpFit, lag: float = 0.0) -> dict[str, float]:
    """Errors in standard deviations."""
    truth = truth_of(fit.names, lag)
    return {
        name: (found.value - true) / found.deviation
        for name, found, true in zip(fit.names, fit.found, truth, strict=True)
    }


def cut(trial: Trial, rows: int) -> Trial:
    return Trial(trial.time[:rows], trial.orders[:rows], trial.measured[:rows])


def test_thrust_damping_and_lag_are_found_in_a_current_and_in_gusts() -> None:
    fit = fitted(sailed("all", 5, **CONDITIONS["both"]))
    assert fit.converged
    errors = off(fit, CONDITIONS["both"]["lag"])
    assert set(errors) == {"Xu", "Yv", "Yr", "Nv", "Nr", "k1", "k2", "k3", "lag"}
    assert max(abs(error) for error in errors.values()) < 4.0
    found = dict(zip(fit.names, fit.found, strict=True))
    for name in ("Xu", "Yv", "Nr", "k1", "k2", "k3"):
        assert found[name].deviation < 0.1 * found[name].value, name
    stream = math.hypot(fit.drift[0].value, fit.drift[1].value)
    assert stream == pytest.approx(0.2, abs=0.02)


def in_wind(calm: float) -> tuple[_Ships, Floats]:
    """Two ships in a wind from ahead and abeam alike, twice as strong for the second."""
    nothing, both = np.zeros((2, 0)), np.ones(2)
    wind = np.array([0.3 * both, 0.02 * both, 0.1 * both])
    ships = _Ships(nothing, nothing[:0, :], np.zeros((5, 2)), (1.0, 2.0, 0.0), np.eye(3), wind, calm, True)
    x = np.zeros((2, 14))
    x[:, BN] = x[:, BE] = [1.0, 2.0]
    return ships, x


def test_the_winds_lever_goes_with_its_angle_and_not_with_its_strength() -> None:
    ships, x = in_wind(0.0)
    turning = _rates(ships, x, np.zeros((2, 3)))[:, R]
    assert turning == pytest.approx([0.02 + 0.1 * math.sqrt(0.5), 2.0 * (0.02 + 0.1 * math.sqrt(0.5))])


def test_the_slopes_are_those_of_the_rates() -> None:
    ships, x = in_wind(0.5)
    A, J = np.zeros((2, 14, 14)), np.zeros((2, 3, 14))
    _slopes(ships, x, A, J)
    for state in (PSI, BN, BE):
        beside = 1.0e-5 * np.eye(14)[state]
        more, less = (_rates(ships, x + by, np.zeros((2, 3))) for by in (beside, -beside))
        assert A[:, R, state] == pytest.approx((more - less)[:, R] / 2.0e-5, rel=1.0e-6)


def test_a_current_does_not_pass_for_sway_damping() -> None:
    """Without the current as a state Yv came out seventy times too large, and sure of it."""
    fit = fitted(sailed("sway-yaw", 6, current=0.2), 0.0)
    found = dict(zip(fit.names, fit.found, strict=True))
    assert abs(off(fit)["Yv"]) < 4.0
    assert found["Yv"].deviation < 0.15 * found["Yv"].value


def test_a_minute_cannot_tell_the_couplings() -> None:
    short = fitted(cut(sailed("sway-yaw", 7), 60), 0.0)
    found = dict(zip(short.names, short.found, strict=True))
    size = math.sqrt(abs(found["Yv"].value * found["Nr"].value))
    assert 1.96 * found["Yr"].deviation > size and 1.96 * found["Nv"].deviation > size


def test_surge_alone_tells_of_surge_alone() -> None:
    fit = fitted(sailed("surge", 8, wind=8.0, gust=1.0, lag=3.0))
    assert fit.names == ("Xu", "k1", "k2", "lag")
    assert max(abs(error) for error in off(fit, 3.0).values()) < 4.0
    assert all(belief.value == 0.0 for belief in (fit.drift[1], fit.drift[3], fit.drift[4]))


def test_two_thrusters_that_always_push_alike_are_not_distinguished(monkeypatch: pytest.MonkeyPatch) -> None:
    def alike(kind: str, random: np.random.Generator) -> np.ndarray:
        return orders(kind, random)[:, [0, 0, 2]]

    monkeypatch.setattr(dp_intervals, "orders", alike)
    fit = fitted(sailed("surge", 9), 0.0)
    k1, k2 = fit.found[1].deviation, fit.found[2].deviation
    assert fit.covariance[1, 2] / (k1 * k2) < -0.99
    assert min(k1, k2) > 0.3, "almost all that was unknown of each"


def test_blank_rows_and_closer_rows_cost_little() -> None:
    trial = cut(sailed("surge", 10, lag=3.0), 300)
    closer = Trial(
        np.arange(0.0, 299.0, 0.25),
        np.repeat(trial.orders[:299], 4, axis=0),
        np.repeat(trial.measured[:299], 4, axis=0),
    )
    closer.measured[:, 0] = np.interp(closer.time, trial.time, trial.measured[:, 0])
    closer.measured[400:560] = np.nan
    for a, b in zip(fitted(trial).found, fitted(closer).found, strict=True):
        assert abs(a.value - b.value) < 2.0 * max(a.deviation, b.deviation)
