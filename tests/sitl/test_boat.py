"""The simulated boat against another integrator, closed forms and common sense of a helmsman."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from autopilot.models.drives import DriveLaw
from autopilot.models.norrbin import Norrbin, steady_rate
from autopilot.models.steering_gear import SteeringGear
from sitl.boat import STILL, Boat, BoatState, Disturbance, Hull, Plant

LANXIN = Norrbin(gain=0.701, time_constant=0.332, n3=3.2828, reference_speed=4.63)
GEAR = SteeringGear(math.radians(30.0), math.radians(20.0), 0.1, 0.0, 0.05)
IDEAL = SteeringGear(math.radians(30.0), math.inf)
RIGID = Hull(turn_speed_loss=0.0, drift_lever=0.0)
DT = 0.01


def run(boat: Boat, seconds: float, order: float, thrust: float, disturbance: Disturbance = STILL) -> BoatState:
    for step in range(round(seconds / DT)):
        boat.step(step * DT, order, thrust, disturbance, DT)
    return boat.state


def test_yaw_agrees_with_another_integrator() -> None:
    """Heading and rate after a hard turn, against scipy's Radau on the paper's equation written out again."""

    def norrbin(_: float, y: np.ndarray) -> list[float]:
        return [y[1], (0.701 * math.radians(15.0) - y[1] - 3.2828 * y[1] ** 3) / 0.332]

    expected = solve_ivp(norrbin, (0.0, 20.0), [0.0, 0.0], method="Radau", rtol=1e-10, atol=1e-12).y[:, -1]
    start = BoatState(speed=4.63, rudder=math.radians(15.0))
    state = run(Boat(Plant(LANXIN, IDEAL, RIGID), start), 20.0, math.radians(15.0), 4.63)
    assert state.rate == pytest.approx(expected[1], rel=1e-6)
    assert state.heading == pytest.approx(expected[0], abs=math.radians(0.02))


def test_positive_rudder_turns_to_starboard_and_east_of_north() -> None:
    state = run(Boat(Plant(LANXIN, GEAR), BoatState(speed=4.63)), 3.0, math.radians(10.0), 4.63)
    assert state.rate > 0.0
    assert 0.0 < state.heading < math.pi
    assert state.east > 0.0


def test_turn_costs_speed_and_drifts_the_stern_outwards() -> None:
    hull = Hull()
    state = run(Boat(Plant(LANXIN, GEAR, hull), BoatState(speed=4.63)), 60.0, math.radians(20.0), 4.63)
    swing = state.rate * hull.length / state.speed
    assert state.speed == pytest.approx(4.63 / (1.0 + hull.turn_speed_loss * swing**2), rel=1e-3)
    assert state.sway == pytest.approx(-hull.drift_lever * state.rate, rel=1e-3)
    assert state.roll < 0.0, "a displacement boat heels outwards: to port in a turn to starboard"
    assert state.rate < steady_rate(LANXIN, math.radians(20.0)), "slower boats turn slower"


def test_steering_gear_delays_then_slews_then_settles() -> None:
    boat = Boat(Plant(LANXIN, GEAR), BoatState(speed=4.63))
    order = math.radians(20.0)
    angles = []
    for step in range(200):
        boat.step(step * DT, order, 4.63, STILL, DT)
        angles.append(boat.state.rudder)
    assert angles[4] == 0.0
    assert angles[5] > 0.0
    assert np.max(np.diff(angles)) <= math.radians(20.0) * DT + 1e-12
    assert angles[-1] == pytest.approx(order, abs=1e-4)


def test_current_moves_the_boat_but_turns_nothing() -> None:
    disturbance = Disturbance(current_north=0.0, current_east=1.0)
    state = run(Boat(Plant(LANXIN, GEAR), BoatState(speed=4.63, north_speed=4.63)), 10.0, 0.0, 4.63, disturbance)
    assert state.heading == 0.0
    assert state.north == pytest.approx(46.3, abs=0.01)
    assert state.east == pytest.approx(10.0, abs=0.02)


def test_yaw_acceleration_enters_as_acceleration() -> None:
    state = run(Boat(Plant(LANXIN, GEAR), BoatState(speed=4.63)), 0.05, 0.0, 4.63, Disturbance(yaw_acceleration=0.1))
    assert state.rate == pytest.approx(0.1 * 0.05, rel=0.1)


def test_course_unstable_boat_leaves_its_course_and_ends_in_a_bounded_turn() -> None:
    unstable = Norrbin(gain=0.1, time_constant=8.0, n3=30.0, n1=-1.0, reference_speed=5.0)
    state = run(Boat(Plant(unstable, GEAR, RIGID), BoatState(speed=5.0, rate=1e-4)), 200.0, 0.0, 5.0)
    assert state.rate == pytest.approx(math.sqrt(1.0 / 30.0), rel=0.01)


def test_boat_at_rest_stays_and_answers_no_rudder() -> None:
    state = run(Boat(Plant(LANXIN, GEAR)), 10.0, math.radians(30.0), 0.0)
    assert (state.heading, state.rate, state.north, state.east) == (0.0, 0.0, 0.0, 0.0)


def test_thrust_turns_a_boat_at_rest_and_turned_thrust_only_where_there_is_some() -> None:
    thrusters = Plant(LANXIN, GEAR, RIGID, DriveLaw(slowest=0.1))
    assert run(Boat(thrusters), 5.0, math.radians(20.0), 0.0).rate > 0.1, "a pivot turn"
    motor = Plant(LANXIN, GEAR, RIGID, DriveLaw(throttle_exponent=2.0, throttle=0.5, way_exponent=1.5))
    coasting, pushed = (run(Boat(motor, BoatState(speed=4.63)), 3.0, math.radians(10.0), way) for way in (0.0, 4.63))
    assert abs(coasting.rate) < 0.02 < pushed.rate
    assert run(Boat(motor), 3.0, math.radians(10.0), -4.63).rate < 0.0, "pulling, it works the other way"


def test_astern_the_rudder_works_the_other_way() -> None:
    state = run(Boat(Plant(LANXIN, GEAR), BoatState(speed=-2.0)), 3.0, math.radians(10.0), -2.0)
    assert state.rate < 0.0
    assert state.north < 0.0


def test_roll_rings_at_its_period_and_dies_out() -> None:
    boat = Boat(Plant(LANXIN, GEAR, Hull(roll_period=2.5, roll_damping=0.1)), BoatState(speed=4.63, roll=0.2))
    rolls = [boat.step(step * DT, 0.0, 4.63, STILL, DT).roll for step in range(1500)]
    signs = np.sign(rolls)
    crossings = np.flatnonzero(signs[1:] != signs[:-1]) * DT
    assert 2.0 * np.mean(np.diff(crossings)) == pytest.approx(2.5 / math.sqrt(1.0 - 0.01), rel=0.02)
    assert abs(rolls[-1]) < 0.02


@settings(max_examples=30, deadline=None)
@given(orders=st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=20), speed=st.floats(-3.0, 15.0))
def test_whatever_is_ordered_the_state_stays_finite_and_the_rudder_within_its_stops(
    orders: list[float], speed: float
) -> None:
    boat = Boat(Plant(LANXIN, GEAR), BoatState(speed=speed))
    for step, order in enumerate(order for order in orders for _ in range(20)):
        before = boat.state.rudder
        state = boat.step(step * DT, order, speed, Disturbance(rudder=0.05, yaw_acceleration=0.2), DT)
        assert all(math.isfinite(value) for value in state)
        assert abs(state.rudder) <= GEAR.angle_max
        assert abs(state.rudder - before) <= GEAR.rate_max * DT + 1e-12


def test_mirrored_orders_give_the_mirrored_track() -> None:
    starboard = run(Boat(Plant(LANXIN, GEAR), BoatState(speed=4.63)), 5.0, math.radians(12.0), 4.63)
    port = run(Boat(Plant(LANXIN, GEAR), BoatState(speed=4.63)), 5.0, math.radians(-12.0), 4.63)
    assert port.east == -starboard.east
    assert port.north == starboard.north
    assert port.heading == -starboard.heading
