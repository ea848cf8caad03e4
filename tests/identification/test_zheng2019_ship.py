"""The ship under its thrusters, against Newton's law written down in SI units and another integrator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from zheng2019_ship import (
    DREDGER,
    REALISTIC,
    TABLE_1,
    TABLE_1_SURGE,
    surge_drive,
    surge_rates,
    sway_yaw_drive,
    sway_yaw_rates,
)

from autopilot.identification.feedback_particle import midpoint_step

L, m, g = 128.0, 1.9413e7, 9.81
UNIT_T, UNIT_V = np.sqrt(L / g), np.sqrt(L * g)


def test_surge_is_newtons_law_in_metres_and_newtons() -> None:
    F1, F2 = 450.0e3, 120.0e3
    mass, damping = 1.05 * m, TABLE_1_SURGE.Xu * m * np.sqrt(g / L)

    def rates(_: float, x: np.ndarray) -> list[float]:
        return [x[1], (TABLE_1_SURGE.k1 * F1 + TABLE_1_SURGE.k2 * F2 - damping * x[1]) / mass]

    exact = solve_ivp(rates, (0.0, 120.0), [0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
    state = np.array([[0.0, 0.0, *TABLE_1_SURGE]])
    for _ in range(120):
        state = midpoint_step(surge_rates, surge_drive(DREDGER, F1, F2), state, 1.0 / UNIT_T)
    assert state[0, 0] * L == pytest.approx(exact[0], rel=1e-5)
    assert state[0, 1] * UNIT_V == pytest.approx(exact[1], rel=1e-5)
    assert exact[0] > 50.0


def test_sway_and_yaw_are_newtons_law_in_metres_and_newtons() -> None:
    F3 = 150.0e3
    M = m * np.array([[1.642, 0.0375 * L], [0.0375 * L, 0.0977 * L**2]])
    damping = np.array([[REALISTIC.Yv, REALISTIC.Yr * L], [REALISTIC.Nv * L, REALISTIC.Nr * L**2]])
    D = m * np.sqrt(g / L) * damping

    def rates(_: float, x: np.ndarray) -> list[float]:
        push = REALISTIC.k3 * F3 * np.array([1.0, 50.0])
        v_dot, r_dot = np.linalg.solve(M, push - D @ x[2:])
        return [x[2] * np.cos(x[1]), x[3], v_dot, r_dot]

    exact = solve_ivp(rates, (0.0, 100.0), [0.0, 0.0, 0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
    state = np.array([[0.0, 0.0, 0.0, 0.0, *REALISTIC]])
    drive = sway_yaw_drive(DREDGER, F3)
    for _ in range(400):
        state = midpoint_step(sway_yaw_rates, drive, state, 0.25 / UNIT_T)
    v = drive.a * state[0, 2] + drive.b * state[0, 3]
    r = drive.b * state[0, 2] + drive.c * state[0, 3]
    assert state[0, 0] * L == pytest.approx(exact[0], rel=1e-4)
    assert state[0, 1] == pytest.approx(exact[1], rel=1e-4)
    assert v * UNIT_V == pytest.approx(exact[2], rel=1e-4)
    assert r / UNIT_T == pytest.approx(exact[3], rel=1e-4)
    assert exact[1] > 0.5, "the ship has turned far enough for the cosine to matter"


def test_a_thrust_to_starboard_before_midships_turns_the_bow_to_starboard() -> None:
    rates = sway_yaw_rates((0.0, 0.0, 0.0, 0.0, *REALISTIC), sway_yaw_drive(DREDGER, 1.0e5))
    assert rates[2] > 0.0
    assert rates[3] > 0.0


def test_many_ships_at_once_are_the_ships_one_by_one() -> None:
    random = np.random.default_rng(0)
    states = random.normal(size=(9, 7))
    drive = sway_yaw_drive(DREDGER, 1.0e5)
    together = np.array([np.broadcast_to(rate, 7) for rate in sway_yaw_rates(states, drive)])
    for i in range(7):
        np.testing.assert_allclose(together[:, i], sway_yaw_rates(states[:, i], drive))


def test_table_1_in_bis_scaling_would_steady_in_hours() -> None:
    """What the paper's Nr means here, and why a realistic D stands beside it."""
    assert DREDGER.yaw_mass / TABLE_1.Nr * DREDGER.time_unit == pytest.approx(18_900.0, rel=0.005)
    assert DREDGER.yaw_mass / REALISTIC.Nr * DREDGER.time_unit < 60.0
