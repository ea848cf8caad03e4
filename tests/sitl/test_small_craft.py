"""CyberShip II against its matrices under another integrator, and its rudder and propellers by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from autopilot.vessel.file import load_vessel
from sitl import small_craft as cs
from sitl.boat import STILL, Boat, BoatState
from sitl.registry import PLANTS
from sitl.scenario import Scenario

DT = 0.01


def boat_of(state: BoatState) -> Boat:
    plant = cs.PLANTS[0].of(load_vessel("small_craft"), Scenario(1, "trial", plant="small_craft"))
    return Boat(plant, state, PLANTS["small_craft"].step)


def sailed(boat: Boat, seconds: float, order: float, thrust: float) -> BoatState:
    for step in range(round(seconds / DT)):
        boat.step(step * DT, order, thrust, STILL, DT)
    return boat.state


@pytest.mark.parametrize("degrees", [8.0, -30.0])
def test_the_motion_is_that_of_the_papers_matrices(degrees: float) -> None:
    """M nu' + C(nu) nu + D(nu) nu = tau, written out again with numbers and solved by scipy's DOP853."""
    rudder, turns = math.radians(degrees), cs.revolutions_of(0.5)
    mass = np.array([[25.8, 0.0, 0.0], [0.0, 33.8, 1.0948], [0.0, 1.0948, 2.76]])

    def rate(_: float, nu: np.ndarray) -> np.ndarray:
        u, v, r = nu
        coriolis = np.array([[0.0, 0.0, -33.8 * v - 1.0948 * r], [0.0, 0.0, 25.8 * u], [0.0, 0.0, 0.0]])
        coriolis[2, :2] = -coriolis[0, 2], -25.8 * u
        damping = np.array(
            [
                [0.72253 + 1.32742 * abs(u) + 5.86643 * u * u, 0.0, 0.0],
                [
                    0.0,
                    0.88965 + 36.47287 * abs(v) + 0.805 * abs(r),
                    7.250 + 0.845 * abs(v) + 3.450 * abs(r),
                ],
                [
                    0.0,
                    -0.0313 - 3.95645 * abs(v) - 0.130 * abs(r),
                    1.900 - 0.080 * abs(v) + 0.750 * abs(r),
                ],
            ]
        )
        pull = 3.65034e-3 * turns**2 - 1.52468e-4 * turns * u
        flow = 0.5 * u + 0.5 * math.sqrt(u * u + 8.0 * pull / (math.pi * 1000.0 * 0.08**2))
        lift = (6.43306 - 5.83594 * abs(rudder)) * rudder * flow * flow
        load = np.array([2.0 * pull, -2.0 * lift, 2.0 * 0.549 * lift])
        return np.linalg.solve(mass, load - (coriolis + damping) @ nu)

    expected = solve_ivp(rate, (0.0, 30.0), [0.5, 0.0, 0.0], method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    state = sailed(boat_of(BoatState(speed=0.5, rudder=rudder)), 30.0, rudder, 0.5)
    assert (state.speed, state.sway, state.rate) == pytest.approx(tuple(expected), rel=1e-6)


def test_port_mirrors_starboard() -> None:
    here, there = (sailed(boat_of(BoatState(speed=0.5)), 20.0, side * 0.4, 0.5) for side in (1.0, -1.0))
    assert (here.speed, here.sway, here.rate) == pytest.approx((there.speed, -there.sway, -there.rate), abs=1e-12)


def test_the_race_steers_it_from_rest_and_sternway_turns_the_rudder_round() -> None:
    assert sailed(boat_of(BoatState()), 2.0, 0.3, 0.5).rate > 0.01
    assert sailed(boat_of(BoatState(speed=-0.3)), 2.0, 0.3, -0.3).rate < 0.0


def test_revolutions_hold_the_speed_ahead_and_astern() -> None:
    for speed in (0.3, 0.7, -0.3):
        resistance = -(cs.X_U + cs.X_UU * abs(speed) + cs.X_UUU * speed * speed) * speed
        assert 2.0 * cs.thrust(cs.revolutions_of(speed), speed) == pytest.approx(resistance, rel=1e-9)
    assert cs.revolutions_of(5.0) == 33.0
    assert cs.thrust(33.0, 0.0) == pytest.approx(3.975, abs=1e-3), "of the 8 N that both are said to give"
