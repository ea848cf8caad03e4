"""The naval vessel against published statements, another integrator, and what mechanics demands."""

from __future__ import annotations

import math

import naval_vessel as naval
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate, linalg

from autopilot.control.rudder_roll import Motion
from sitl import roll_ship
from sitl.roll_ship import NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED, Load

INVERSE = naval.inverse_mass(NAVAL_HULL)
STRAIGHT = Motion(0.0, 0.0, 0.0, 0.0, 0.0)
angles = st.floats(-0.7, 0.7)
states = st.builds(
    Motion,
    st.floats(-1.0, 1.0),
    st.floats(-0.2, 0.2),
    st.floats(-0.05, 0.05),
    st.floats(-0.3, 0.3),
    st.floats(-3.0, 3.0),
)


def test_rudder_to_roll_is_non_minimum_phase_with_the_zeros_stated() -> None:
    """det of the pencil [A - s I, b; c, 0] vanishes at +0.418 and -0.302 rad/s at 15 knots."""
    model = naval.linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
    a, b = model.A[:4, :4], model.b[:4, None]
    roll = np.array([[0.0, 0.0, 0.0, 1.0]])
    left = np.block([[a, b], [roll, np.zeros((1, 1))]])
    right = np.zeros((5, 5))
    right[:4, :4] = np.eye(4)
    values = linalg.eigvals(left, right)
    zeros = sorted(float(value.real) for value in values if np.isfinite(value) and abs(value) < 1e6)
    assert zeros == pytest.approx([-0.302, 0.418], abs=5e-4)


def test_the_roll_period_is_the_published_hulls() -> None:
    model = naval.linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
    roll = max(linalg.eigvals(model.A[:4, :4]), key=lambda value: value.imag)
    assert 2.0 * math.pi / abs(roll) == pytest.approx(5.6, abs=0.1)
    assert -roll.real / abs(roll) == pytest.approx(0.09, abs=0.01)


def test_first_inward_then_outward() -> None:
    """A step of the rudder to starboard heels the vessel to starboard, then, turning to starboard, to port."""
    state, heel = STRAIGHT, []
    load = roll_ship.rudder_load(NAVAL_RUDDERS, SERVICE_SPEED, math.radians(10.0))
    for _ in range(1200):
        state = naval.motion_step(NAVAL_HULL, INVERSE, SERVICE_SPEED, state, load, 0.05)
        heel.append(state.phi)
    assert max(heel[:40]) > 0.005
    assert state.r > 0.01 and state.phi < -0.01 and state.v < 0.0


def test_added_mass_of_sway_and_roll_is_reciprocal_and_positive_definite() -> None:
    mass = naval.mass_matrix(NAVAL_HULL)
    assert mass[0, 1] == mass[1, 0]
    assert np.all(np.linalg.eigvalsh(0.5 * (mass + mass.T)) > 0.0)


def test_the_printed_sign_of_y_pdot_breaks_the_reciprocity() -> None:
    printed = NAVAL_HULL._replace(sway=NAVAL_HULL.sway._replace(p_dot=-NAVAL_HULL.sway.p_dot))
    mass = naval.mass_matrix(printed)
    assert mass[0, 1] != mass[1, 0]


def test_twenty_seconds_in_a_swell_agree_with_scipys_runge_kutta() -> None:
    """Twenty seconds with rudder and a swell, against scipy's adaptive Runge-Kutta of order 8."""

    def swell(time: float) -> Load:
        rudder = roll_ship.rudder_load(NAVAL_RUDDERS, SERVICE_SPEED, 0.2 * math.sin(0.3 * time))
        return Load(rudder.Y, rudder.K + 4.0e5 * math.sin(1.1 * time), rudder.N)

    def rate(time: float, x: np.ndarray) -> tuple[float, ...]:
        return tuple(naval.motion_rate(NAVAL_HULL, INVERSE, SERVICE_SPEED, Motion(*x), swell(time)))

    peer = integrate.solve_ivp(rate, (0.0, 20.0), STRAIGHT, method="DOP853", rtol=1e-10, atol=1e-12)
    state, dt = STRAIGHT, 0.01
    for step in range(2000):
        # the load is held over the step: taken at its middle it errs by the square of dt
        state = naval.motion_step(NAVAL_HULL, INVERSE, SERVICE_SPEED, state, swell((step + 0.5) * dt), dt)
    np.testing.assert_allclose(state, peer.y[:, -1], rtol=1e-3, atol=1e-6)


def test_one_held_step_is_of_fourth_order() -> None:
    # no sign changes on the way: at zero speed the terms with |v|, |p| and |r| have kinks
    load, start = Load(9e4, 4e5, 9e5), Motion(0.5, 0.1, 0.02, 0.0, 0.0)

    def after_one_second(dt: float) -> np.ndarray:
        state = start
        for _ in range(round(1.0 / dt)):
            state = naval.motion_step(NAVAL_HULL, INVERSE, SERVICE_SPEED, state, load, dt)
        return np.array(state)

    exact = after_one_second(0.01)
    coarse, fine = (np.max(np.abs(after_one_second(dt) - exact)) for dt in (0.2, 0.1))
    assert 12.0 < coarse / fine < 22.0


def test_the_linear_model_is_the_slope_of_the_nonlinear_one() -> None:
    model = naval.linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
    small = 1.0e-6
    for column in range(5):
        values = [0.0] * 5
        values[column] = small
        rate = naval.motion_rate(NAVAL_HULL, INVERSE, SERVICE_SPEED, Motion(*values), Load(0.0, 0.0, 0.0))
        np.testing.assert_allclose(np.array(rate) / small, model.A[:, column], rtol=1e-4, atol=1e-5)
    push = roll_ship.rudder_load(NAVAL_RUDDERS, SERVICE_SPEED, small)
    rate = naval.motion_rate(NAVAL_HULL, INVERSE, SERVICE_SPEED, STRAIGHT, push)
    np.testing.assert_allclose(np.array(rate) / small, model.b, rtol=1e-6, atol=1e-9)


@given(state=states, sway=st.floats(-1e5, 1e5), roll=st.floats(-1e6, 1e6), yaw=st.floats(-1e6, 1e6))
def test_port_mirrors_starboard(state: Motion, sway: float, roll: float, yaw: float) -> None:
    rate = naval.motion_rate(NAVAL_HULL, INVERSE, SERVICE_SPEED, state, Load(sway, roll, yaw))
    mirrored = Motion(*(-value for value in state))
    other = naval.motion_rate(NAVAL_HULL, INVERSE, SERVICE_SPEED, mirrored, Load(-sway, -roll, -yaw))
    np.testing.assert_allclose(np.array(other), -np.array(rate), rtol=1e-9, atol=1e-12)


def test_at_rest_a_heeled_hull_loses_energy_and_comes_upright() -> None:
    """Without speed nothing feeds the motion: kinetic energy and righting energy only fall."""
    mass = naval.mass_matrix(NAVAL_HULL)
    mass = 0.5 * (mass + mass.T)
    state, energies = Motion(0.0, 0.0, 0.0, 0.25, 0.0), []
    stiff, cubic = NAVAL_HULL.roll.restoring, -NAVAL_HULL.roll.bbb
    for _ in range(1200):
        speeds = np.array(state[:3])
        righting = 0.5 * stiff * state.phi**2 + 0.25 * cubic * state.phi**4
        energies.append(0.5 * speeds @ mass @ speeds + righting)
        state = naval.motion_step(NAVAL_HULL, INVERSE, 0.0, state, Load(0.0, 0.0, 0.0), 0.05)
    assert np.all(np.diff(energies) <= 1e-6 * energies[0])
    assert energies[-1] < 0.02 * energies[0]


@given(angle=angles)
def test_lift_rises_to_the_stall_and_drag_is_even(angle: float) -> None:
    lift = roll_ship.lift_coefficient(NAVAL_RUDDERS, angle)
    assert abs(lift) <= 0.054 * 23.0 + 1e-12
    assert lift == -roll_ship.lift_coefficient(NAVAL_RUDDERS, -angle)
    drag = roll_ship.drag_coefficient(NAVAL_RUDDERS, angle)
    assert drag == roll_ship.drag_coefficient(NAVAL_RUDDERS, -angle) >= 0.0


def test_the_naval_vessel_s_rudder_has_the_published_figures() -> None:
    """Ten degrees at 15 knots by hand: Y = 0.5 x 1014 x 3 x 0.54 x 7.7167^2 N to port."""
    load = roll_ship.rudder_load(NAVAL_RUDDERS, SERVICE_SPEED, math.radians(10.0))
    assert pytest.approx(-0.5 * 1014.0 * 3.0 * 0.54 * SERVICE_SPEED**2) == load.Y
    assert pytest.approx(-1.55 * load.Y) == load.K
    assert pytest.approx(-23.79 * load.Y) == load.N
    assert roll_ship.drag_coefficient(NAVAL_RUDDERS, math.radians(10.0)) == pytest.approx(0.54**2 / (2.7 * math.pi))
    past = math.radians(30.0)
    assert roll_ship.drag_coefficient(NAVAL_RUDDERS, past) == pytest.approx(1.242 * 0.5)


def test_the_roll_response_has_the_frequency_response_of_the_linear_model() -> None:
    """A small sine of the rudder near the roll frequency: amplitude of roll against the transfer function."""
    model = naval.linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
    omega, dt, amplitude = 1.0, 0.02, 1.0e-3
    response = np.linalg.solve(1j * omega * np.eye(5) - model.A, model.b)[3]
    state, roll = STRAIGHT, []
    for step in range(15000):
        load = roll_ship.rudder_load(NAVAL_RUDDERS, SERVICE_SPEED, amplitude * math.sin(omega * (step + 0.5) * dt))
        state = naval.motion_step(NAVAL_HULL, INVERSE, SERVICE_SPEED, state, load, dt)
        roll.append(state.phi)
    last = np.array(roll[-3141:])
    assert math.sqrt(2.0) * last.std() / amplitude == pytest.approx(abs(response), rel=0.01)
