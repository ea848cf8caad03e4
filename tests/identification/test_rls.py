"""Recursive least squares: the batch solution, forgetting, and bad measurements."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.identification.two_stage import rls_start, rls_step


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
def test_without_forgetting_it_is_batch_least_squares(seed: int, n: int) -> None:
    random = np.random.default_rng(seed)
    phi = random.normal(size=(40, n))
    y = phi @ random.normal(size=n) + 0.1 * random.normal(size=40)
    state = rls_start(np.zeros(n), variance=1.0e9)
    for row, value in zip(phi, y, strict=True):
        state = rls_step(state, row.tolist(), float(value))
    np.testing.assert_allclose(state.theta, np.linalg.lstsq(phi, y, rcond=None)[0], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(state.P, np.linalg.inv(phi.T @ phi), rtol=1e-4, atol=1e-8)


def test_forgetting_follows_a_changed_parameter_and_remembering_does_not() -> None:
    random = np.random.default_rng(1)
    phi = random.normal(size=400)
    y = np.where(np.arange(400) < 200, 1.0, 3.0) * phi
    forgetful, faithful = rls_start([0.0]), rls_start([0.0])
    for value, measured in zip(phi, y, strict=True):
        forgetful = rls_step(forgetful, [value], measured, forgetting=0.95)
        faithful = rls_step(faithful, [value], measured)
    assert forgetful.theta[0] == pytest.approx(3.0, abs=0.01)
    assert 1.5 < faithful.theta[0] < 2.5


def test_forgetting_without_anything_new_keeps_the_covariance_bounded() -> None:
    bounded, growing = rls_start([0.0], variance=1.0), rls_start([0.0], variance=1.0)
    for _ in range(1000):
        bounded = rls_step(bounded, [0.0], 0.0, forgetting=0.95, trace_max=10.0)
        growing = rls_step(growing, [0.0], 0.0, forgetting=0.95)
    assert bounded.P[0][0] < 11.0
    assert growing.P[0][0] > 1.0e20


def test_each_parameter_may_have_its_own_variance() -> None:
    state = rls_step(rls_start([0.0, 0.0], variance=[1.0, 1.0e-12]), [1.0, 1.0], 1.0)
    assert state.theta == pytest.approx((0.5, 0.0), abs=1.0e-9)
    with pytest.raises(ValueError, match="variance"):
        rls_start([0.0, 0.0], variance=[1.0])


def test_a_measurement_that_is_not_finite_changes_nothing() -> None:
    state = rls_step(rls_start([0.0, 0.0]), [1.0, 2.0], 3.0)
    assert rls_step(state, [1.0, float("nan")], 1.0) is state
    assert rls_step(state, [1.0, 1.0], float("inf")) is state


@pytest.mark.parametrize("forgetting", [0.0, 1.1, -1.0, float("nan")])
def test_a_forgetting_factor_outside_zero_to_one_is_refused(forgetting: float) -> None:
    with pytest.raises(ValueError, match="forgetting factor"):
        rls_step(rls_start([0.0]), [1.0], 1.0, forgetting)


def test_a_variance_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ValueError, match="variance"):
        rls_start([0.0], variance=0.0)
