"""The ship that rolls: the published linear figures, surge, and a rudder that damps the roll."""

from __future__ import annotations

import dataclasses
import math

import naval_vessel as naval
import numpy as np
import pytest
from lockstep import Lockstep

from autopilot.vessel.file import load_vessel
from sitl import roll_ship
from sitl.boat import STILL, Boat, BoatState
from sitl.craft import Motion
from sitl.registry import PLANTS
from sitl.roll_ship import NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED, RollShip
from sitl.scenario import IttcSection, Scenario, WavesSection, load_scenario

DT = 0.01


def ship(scale: float = 1.0) -> RollShip:
    return roll_ship.of(load_vessel("roll_ship"), Scenario(1, "trial", plant="roll_ship", scale=scale))


def under_way(plant: RollShip, speed: float = SERVICE_SPEED) -> Boat:
    return Boat(plant, BoatState(speed=speed, north_speed=speed), PLANTS["roll_ship"].step)


def test_about_a_straight_course_it_is_the_linear_model() -> None:
    """Sway, roll and yaw at 15 kn by small differences against the model whose zeros are published."""
    linear = naval.linear_motion(NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED)
    straight, small = Motion(SERVICE_SPEED, 0.0, 0.0, 0.0, 0.0), 1.0e-6
    places = {"sway": 0, "roll_rate": 1, "rate": 2, "roll": 3}
    for name, column in places.items():
        rate = roll_ship.accelerations(ship(), straight._replace(**{name: small}), 0.0, SERVICE_SPEED, STILL)
        mine = [getattr(rate, row) / small for row in places]
        np.testing.assert_allclose(mine, linear.A[:4, column], rtol=1e-4, atol=1e-5)
    helm = roll_ship.accelerations(ship(), straight, small, SERVICE_SPEED, STILL)
    np.testing.assert_allclose([getattr(helm, row) / small for row in places], linear.b[:4], rtol=1e-6, atol=1e-9)


def test_the_rudder_heels_it_inwards_and_the_turn_outwards() -> None:
    boat = under_way(ship())
    heel = [boat.step(step * DT, math.radians(10.0), SERVICE_SPEED, STILL, DT).roll for step in range(6000)]
    assert max(heel[:200]) > math.radians(0.3)
    assert heel[-1] < -math.radians(0.5)


def test_left_alone_it_rolls_with_the_published_period() -> None:
    """5.6 s and 9 % of damping at 15 kn; Perez 2005 has 5.6 s for the hull."""
    boat = under_way(ship())
    boat.state = boat.state._replace(roll=0.05)
    roll = [boat.step(step * DT, 0.0, SERVICE_SPEED, STILL, DT).roll for step in range(2000)]
    crossings = [step * DT for step in range(1, 2000) if roll[step - 1] < 0.0 <= roll[step]]
    assert float(np.mean(np.diff(crossings))) == pytest.approx(5.6, abs=0.2)


def test_a_turn_costs_speed_and_rudder_drag_alone_costs_some() -> None:
    losses = []
    for degrees in (10.0, 20.0, 35.0):
        boat = under_way(ship())
        for step in range(9000):
            boat.step(step * DT, math.radians(degrees), SERVICE_SPEED, STILL, DT)
        losses.append(1.0 - boat.state.speed / SERVICE_SPEED)
    assert 0.05 < losses[0] < losses[1] < losses[2] < 0.4


def test_port_mirrors_starboard() -> None:
    one, other = under_way(ship()), under_way(ship())
    for step in range(3000):
        here, there = one.step(step * DT, 0.4, 7.0, STILL, DT), other.step(step * DT, -0.4, 7.0, STILL, DT)
        assert (here.speed, here.sway, here.rate) == pytest.approx((there.speed, -there.sway, -there.rate), abs=1e-12)
        assert (here.roll, here.heading) == pytest.approx((-there.roll, -there.heading), abs=1e-12)


def test_froude_makes_a_model_of_it() -> None:
    root = math.sqrt(0.1)
    large, small = under_way(ship()), under_way(ship(0.1), SERVICE_SPEED * root)
    for step in range(2000):
        large.step(step * DT, 0.2, SERVICE_SPEED, STILL, DT)
        small.step(step * DT * root, 0.2, SERVICE_SPEED * root, STILL, DT * root)
    assert small.state.heading == pytest.approx(large.state.heading, rel=1e-9)
    assert small.state.roll == pytest.approx(large.state.roll, rel=1e-9)
    assert small.state.north == pytest.approx(0.1 * large.state.north, rel=1e-9)


def test_the_roll_law_damps_its_roll_in_a_beam_sea() -> None:
    """The same sea with the heading law alone and with that of the file `naval_vessel` for both."""
    sea = WavesSection(ittc=IttcSection(1.5, 7.0, from_deg=90.0))
    rolls = {}
    for law in ("backstepping", "sliding_roll"):
        scenario = dataclasses.replace(load_scenario("calm"), plant="roll_ship", waves=sea)
        boat = Lockstep(load_vessel("naval_vessel"), law=law, scenario=scenario, measured_every=2)
        boat.engage(0.0)
        assert boat.run(60.0, boat.engaged)
        boat.run(20.0)
        states = []
        for _ in range(600):
            boat.run(0.2)
            states.append(boat.world.boat.state)
        rolls[law] = float(np.std([state.roll for state in states]))
        assert max(abs(state.heading) for state in states) < math.radians(5.0)
    assert rolls["sliding_roll"] < 0.9 * rolls["backstepping"]
