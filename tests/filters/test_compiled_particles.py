"""The compiled particle filter is the plain one, from the same functions and the same random numbers."""

from __future__ import annotations

import builtins
from typing import Any

import numpy as np
import pytest
from compiled_particles import CompiledParticleFilter, _damped_by_one, _damped_by_two

from autopilot.errors import InputError
from autopilot.filters.feedback_particle import damping_matrices, fpf_predict, fpf_update
from autopilot.filters.kalman import FloatArray, Gaussian, Motion
from autopilot.identification.norrbin_filter import YawDrive, cubic_rates, heading_and_rate

NOISE = np.zeros((6, 1))
NOISE[1, 0] = 0.01
R = np.array([[1.0e-5, 2.0e-6], [2.0e-6, 3.0e-5]])


def start() -> Gaussian:
    mean = np.array([0.0, 0.0, np.log(0.7), np.log(0.3), 0.0, np.log(0.1)])
    return Gaussian(mean, np.diag(np.square([1.0e-3, 1.0e-3, 0.2, 0.2, 0.1, 0.5])))


def test_the_boats_own_functions_compiled_with_all_they_call_give_the_same_particles() -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    fast = CompiledParticleFilter(cubic_rates, heading_and_rate, NOISE, R, moving=2)
    particles = fast.start(start(), 150, np.random.default_rng(1))
    plain: FloatArray = particles.copy()
    random, again = np.random.default_rng(2), np.random.default_rng(2)
    for k in range(20):
        drive = YawDrive(0.2 * (-1.0) ** (k // 7), 1.0 + 0.01 * k, 1.0, 0.15)
        z = np.array([1.0e-3 * k, 2.0e-2 * np.sin(0.3 * k)])
        if k % 4 == 3:
            z[k % 8 // 4] = np.nan
        fast.predict(particles, drive, 0.1, random, substeps=2)
        fast.update(particles, z)
        plain = fpf_predict(plain, Motion(cubic_rates, NOISE, 2), drive, 0.1, again)
        plain = fpf_update(plain, heading_and_rate, z, R)
    np.testing.assert_allclose(particles, plain, rtol=0.0, atol=1.0e-9)
    assert np.all(plain.std(axis=0) > 1.0e-6)
    assert abs(plain[:, 2].mean() - np.log(0.7)) > 0.01, "the measurements have moved the parameters"
    with pytest.raises(ValueError, match="Fortran's order"):
        fast.update(np.ascontiguousarray(particles), np.array([0.0, 0.0]))


@pytest.mark.parametrize(("m", "damped"), [(1, _damped_by_one), (2, _damped_by_two)])
def test_the_closed_forms_are_the_damping_of_the_plain_filter(m: int, damped: Any) -> None:
    random = np.random.default_rng(m)
    for step in (1.0e-3, 0.3, 1.0):
        root = random.normal(size=(m, m + 1))
        S, gain, off = root @ root.T, random.normal(size=(4, m)), random.normal(size=m)
        towards, back = np.empty(4), np.empty((4, m))
        lost = damped(S, step, gain, off, towards, back)
        pull, shrink = damping_matrices(S, step)
        np.testing.assert_allclose(towards, step * gain @ pull @ off, rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(back, step * gain @ shrink, rtol=1e-10, atol=1e-14)
        assert lost == pytest.approx(np.trace(np.eye(m) - pull), rel=1e-9)


def test_noise_on_a_parameter_and_a_third_measured_value_are_refused() -> None:
    noise = NOISE.copy()
    noise[5, 0] = 1.0
    with pytest.raises(ValueError, match="beyond the first 2"):
        CompiledParticleFilter(cubic_rates, heading_and_rate, noise, R, moving=2)
    with pytest.raises(ValueError, match="at most 2 measured values"):
        CompiledParticleFilter(cubic_rates, heading_and_rate, NOISE, np.eye(3))


def test_without_numba_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any, **more: Any) -> Any:
        if name.startswith("numba"):
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)

    def fresh(state: Any, _: Any) -> Any:
        return (state[0],)

    with pytest.raises(InputError, match=r"pip install '\.\[fast\]'"):
        CompiledParticleFilter(fresh, fresh, np.zeros((1, 1)), np.eye(1))
