"""The compiled particle filter is the plain one, from the same functions and the same random numbers."""

from __future__ import annotations

import builtins
from typing import Any

import numpy as np
import pytest

from autopilot.errors import InputError
from autopilot.filters.compiled_particles import CompiledParticleFilter
from autopilot.filters.feedback_particle import fpf_predict, fpf_update
from autopilot.filters.kalman import Gaussian
from autopilot.filters.midpoint import FloatArray
from autopilot.models.dynamic_positioning import DREDGER, REALISTIC, sway_yaw_drive, sway_yaw_rates, sway_yaw_shown

NOISE = np.zeros((9, 2))
NOISE[2, 0] = NOISE[3, 1] = 1.0e-4
R = np.array([[1.0e-6, 2.0e-7], [2.0e-7, 3.0e-6]])


def start() -> Gaussian:
    spread = np.array([1.0e-3, 1.0e-3, 1.0e-4, 1.0e-4, *(0.3 * np.abs(REALISTIC))])
    return Gaussian(np.array([0.0, 0.0, 0.0, 0.0, *REALISTIC]), np.diag(spread**2))


def test_the_ships_own_functions_compiled_give_the_same_particles() -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    fast = CompiledParticleFilter(sway_yaw_rates, sway_yaw_shown, NOISE, R, moving=4)
    particles = fast.start(start(), 150, np.random.default_rng(1))
    plain: FloatArray = particles.copy()
    random, again = np.random.default_rng(2), np.random.default_rng(2)
    drive = sway_yaw_drive(DREDGER, 1.5e5)
    for k in range(20):
        z = np.array([3.0e-4 * k, 2.0e-3 * k])
        if k % 4 == 3:
            z[k % 8 // 4] = np.nan
        fast.predict(particles, drive, 0.3, random, substeps=2)
        fast.update(particles, z)
        plain = fpf_predict(plain, sway_yaw_rates, drive, NOISE, 0.3, again, substeps=2)
        plain = fpf_update(plain, sway_yaw_shown, z, R)
    np.testing.assert_allclose(particles, plain, rtol=0.0, atol=float(1.0e-9 * plain.std(axis=0).min()) + 1.0e-12)
    assert np.all(np.abs(plain - start().mean).max(axis=0) > 0.0)
    with pytest.raises(ValueError, match="Fortran's order"):
        fast.update(np.ascontiguousarray(particles), np.array([0.0, 0.0]))


def test_noise_on_a_parameter_is_refused() -> None:
    noise = NOISE.copy()
    noise[5, 0] = 1.0
    with pytest.raises(ValueError, match="beyond the first 4"):
        CompiledParticleFilter(sway_yaw_rates, sway_yaw_shown, noise, R, moving=4)


def test_without_numba_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    real = builtins.__import__

    def without(name: str, *rest: Any, **more: Any) -> Any:
        if name.startswith("numba"):
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)

    def fresh(state: Any, _: Any) -> Any:
        return (state[0],)

    with pytest.raises(InputError, match=r"pip install 'norrbin\[fast\]'"):
        CompiledParticleFilter(fresh, fresh, np.zeros((1, 1)), np.eye(1))
