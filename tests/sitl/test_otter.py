"""The Otter's hull, and the two boats that are made of it: differential thrust, and an outboard that steers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.errors import InputError
from autopilot.vessel.file import load_vessel
from sitl import twin_thruster as otter
from sitl.boat import STILL, Boat, BoatState
from sitl.craft import Craft, Motion, Push
from sitl.registry import PLANTS
from sitl.scenario import Scenario

DT = 0.01
KINDS = ("twin_thruster", "outboard")
speeds, rates = st.floats(-2.0, 2.0), st.floats(-2.0, 2.0)


def plant_of(kind: str, scale: float = 1.0) -> Any:
    return PLANTS[kind].of(load_vessel(kind), Scenario(1, "trial", plant=kind, scale=scale))


def sailed(kind: str, state: BoatState, order: float, thrust: float, seconds: float) -> BoatState:
    boat = Boat(plant_of(kind), state, PLANTS[kind].step)
    for step in range(round(seconds / DT)):
        boat.step(step * DT, order, thrust, STILL, DT)
    return boat.state


@given(v=speeds, r=rates)
def test_cross_flow_drag_is_the_integral_over_the_length(v: float, r: float) -> None:
    x = (np.arange(20000) + 0.5) / 20000.0 * otter.LENGTH - 0.5 * otter.LENGTH
    flow = (v + x * r) * np.abs(v + x * r) * 0.5 * otter.DENSITY * otter.DRAUGHT * otter.CROSS_FLOW
    force, moment = otter.cross_flow(v, r)
    assert force == pytest.approx(-float(flow.mean()) * otter.LENGTH, rel=1e-5, abs=1e-4)
    assert moment == pytest.approx(-float((x * flow).mean()) * otter.LENGTH, rel=1e-5, abs=1e-4)


@given(u=speeds, v=speeds, r=rates)
def test_the_hull_never_gives_energy(u: float, v: float, r: float) -> None:
    """d/dt of (m11 u^2 + m22 v^2 + 2 m23 v r + m33 r^2)/2: damping takes it, Coriolis terms leave it alone."""
    craft = Craft(otter.GEAR, otter.HULL, otter.MASSES)
    rate = otter.moved_by(craft, Motion(u, v, r, 0.0, 0.0), Push(0.0, 0.0, 0.0), STILL)
    power = otter.M11 * u * rate.surge + (otter.M22 * v + otter.M23 * r) * rate.sway
    power += (otter.M23 * v + otter.M33 * r) * rate.rate
    assert power <= 1e-9
    if abs(u) + abs(v) + abs(r) > 0.1:
        assert power < 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_its_top_speed_is_the_published_one(kind: str) -> None:
    """Six knots at full thrust of 24.4 kgf; more is not to be had."""
    assert sailed(kind, BoatState(speed=2.0), 0.0, 10.0, 30.0).speed == pytest.approx(6.0 * 0.5144, rel=1e-3)
    assert sailed(kind, BoatState(), 0.0, -10.0, 30.0).speed == pytest.approx(-6.0 * 0.5144 * 13.6 / 24.4, rel=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_port_mirrors_starboard(kind: str) -> None:
    here, there = (sailed(kind, BoatState(speed=1.5), side * 0.3, 1.5, 20.0) for side in (1.0, -1.0))
    assert (here.speed, here.sway, here.rate) == pytest.approx((there.speed, -there.sway, -there.rate), abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_it_has_one_size(kind: str) -> None:
    with pytest.raises(InputError, match="one size only"):
        plant_of(kind, 2.0)


def test_two_propellers_turn_it_without_way_and_creep_ahead() -> None:
    """Astern a propeller pulls 13.6 kgf where ahead it pulls 24.4, so the pair does not turn it quite on the spot."""
    state = sailed("twin_thruster", BoatState(), otter.FULL, 0.0, 5.0)
    assert state.rate > 0.3
    assert 0.0 < state.speed < 0.5 * otter.SERVICE_SPEED


def test_an_order_is_mixed_as_for_a_skid_steered_rover() -> None:
    """AP_MotorsUGV with MOT_STR_THR_MIX 0.5: left is throttle plus steering, both scaled where one is past full."""
    assert otter.mixed(0.5, 0.2) == pytest.approx((0.7, 0.3))
    assert otter.mixed(0.75, 0.5) == pytest.approx((1.0, 0.2))
    assert otter.mixed(0.0, -1.0) == pytest.approx((-1.0, 1.0))
    assert otter.mixed(-0.5, 0.25) == pytest.approx((-0.25, -0.75))
    assert otter.throttle_of(otter.TOP_SPEED) == pytest.approx(1.0)


def test_an_outboard_steers_by_its_thrust_and_not_by_the_speed() -> None:
    at_rest = sailed("outboard", BoatState(), 0.3, 1.5, 1.0)
    coasting = sailed("outboard", BoatState(speed=1.5), 0.3, 0.0, 5.0)
    assert at_rest.rate > 0.2
    assert coasting.rate == 0.0
    slow = sailed("outboard", BoatState(speed=0.5), 0.3, 1.5, 0.5)
    fast = sailed("outboard", BoatState(speed=1.5), 0.3, 1.5, 0.5)
    assert slow.rate == pytest.approx(fast.rate, rel=0.25)
