"""Boats, gears and instruments that are not what the file says: a table with limits that a skipper would set."""

from __future__ import annotations

import math

import pytest
from boats import Boat, vessel_of
from plant import Plant, sail

from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.signals import Order, OrderKind

STRAIGHT = Order(OrderKind.HEADING, 0.0, serial=1)
NEUTRAL = [
    Boat(0.3, 200.0, 60.0, 1.0, 7.0, 3.0),
    Boat(0.1, 200.0, 60.0, 1.0, 7.0, 3.0),
    Boat(1.65, 1100.0, 60.0, 1.0, 7.0, 3.0),
]
"""A zigzag tells K/T of these, and hardly T."""


@pytest.mark.parametrize("boat", NEUTRAL)
def test_a_nearly_neutral_ship_learns_a_wind_as_quickly_as_its_heading_shows_it(boat: Boat) -> None:
    """3 deg of rudder from one moment to the next; a filter that waits for two time constants is off for minutes."""
    vessel = vessel_of(boat)
    ship = Plant(
        model_of(vessel),
        gear_of(vessel),
        heading_noise=math.radians(0.3),
        rate_noise=math.radians(0.2),
        disturbance=lambda now: math.radians(3.0) if now > 300.0 else 0.0,
        seed=3,
    )
    ticks = sail(build_pilot(vessel), ship, STRAIGHT, 600.0, 0.2)
    late = [math.degrees(tick.state.heading) for tick in ticks if tick.now > 400.0]
    soon = [math.degrees(tick.state.heading) for tick in ticks if 300.0 < tick.now < 400.0]
    assert abs(sum(late) / len(late)) < 0.1
    assert abs(sum(soon) / len(soon)) < 0.6
    assert max(map(abs, soon)) < 2.0
