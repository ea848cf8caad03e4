"""A route with three corners in a current, on plants that are not the model's equation (`benchmarks/rails.py`)."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from front_peers import ArduRover, Rudder
from rails import sail
from rails_peers import L1, PositionControl, Route, Sight, begins, l1_step, off_route, planned, position_step

LIMITS = {0.3: 0.1, 0.6: 0.25}
"""rms of the cross-track error [lengths], by current [the boat's speeds]; corners included."""


@pytest.mark.parametrize("share", LIMITS)
@pytest.mark.parametrize("kind", ["outboard", "mmg_tanker", "roll_ship", "twin_thruster"])
def test_the_boat_keeps_to_legs_and_corners_in_a_current(kind: str, share: float) -> None:
    found = sail(kind, share, seed=5)
    assert found.is_complete
    assert found.rms < LIMITS[share]
    assert found.wide < 0.2


@pytest.mark.parametrize("share", LIMITS)
def test_without_a_log_it_keeps_to_them_too(share: float) -> None:
    found = sail("outboard", share, seed=5, has_log=False)
    assert found.is_complete
    assert found.rms < LIMITS[share]


STEERING = ArduRover(0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 10.0, 0.1, Rudder(1.0, 10.0))
"""Feed-forward alone, for a boat that turns at the rate that is its order."""
L1_PEER = L1(10.0, 0.8, 0.02, 5.0, 2.0, 1.0, STEERING)
POSITION_PEER = PositionControl(0.3, 0.5, 0.7, 0.05, 0.1, 1.0, 2.5, 2.0, 1.0, STEERING)


@pytest.mark.parametrize(("helm", "step"), [(L1_PEER, l1_step), (POSITION_PEER, position_step)])
def test_the_peers_come_to_their_path_in_a_current_and_end_the_route(helm: Any, step: Callable[..., Any]) -> None:
    """A boat of 2 m/s that turns at the rate of its order, in a current of 0.6 m/s across the first leg."""
    route = Route(np.array([0.0, 100.0, 100.0]), np.array([0.0, 0.0, 100.0]), 2.0, 5.0)
    memory, north, east, heading, rate, way = begins(2.0), 0.0, 0.0, 0.0, 0.0, planned(helm, route)
    offs = []
    for tick in range(3000):
        speeds = 2.0 * math.cos(heading), 2.0 * math.sin(heading) + 0.6
        fix = (north, east, *speeds) if tick % 4 == 0 else (math.nan,) * 4
        rate, memory = step(helm, memory, route, Sight(heading, rate, 2.0, *fix), 0.05)
        heading, north, east = heading + 0.05 * rate, north + 0.05 * speeds[0], east + 0.05 * speeds[1]
        offs.append(off_route(way, north, east))
        if memory.done:
            break
    assert memory.done and abs(offs[-1]) < 0.3
    assert max(offs[800:900]) < 0.3, "on the first leg"
    assert max(offs) < 5.0


def test_the_position_peer_rounds_its_corners_off_between_the_legs() -> None:
    route = Route(np.array([0.0, 100.0, 100.0]), np.array([0.0, 0.0, 100.0]), 2.0, 5.0)
    way = planned(POSITION_PEER, route)
    begin, end = (float(way.north[1]), float(way.east[1])), (float(way.north[-2]), float(way.east[-2]))
    assert begin == pytest.approx((87.5, 0.0)) and end == pytest.approx((100.0, 12.5))
    assert min(off_route(way, 100.0, 0.0), 5.0) == pytest.approx(
        12.5 * 2.0 * (0.25 - 0.5 / math.pi) * math.sqrt(2.0), rel=0.01
    )
    assert planned(L1_PEER, route) is route
