"""A ship under its thrusters, sailed by the simulator of `benchmarks/dp_intervals.py`, which shares no equation."""

from __future__ import annotations

import math

import dp_intervals
import numpy as np
import pytest
from dp_intervals import CONDITIONS, HULL, orders, sailed, truth_of

from autopilot.identification.dynamic_positioning import DpFit, Trial, identify_dp, usual_beliefs


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
