"""The way back to a course that something carried the boat off from: when it is planned, and how the boat fares."""

from __future__ import annotations

import math

import pytest

from autopilot.angles import wrap
from autopilot.guidance.stop import TurnLimits, relaxed, stop_angle, turn_limits
from autopilot.guidance.turn import (
    AHEAD,
    RESET_BEYOND,
    RESET_BEYOND_EARLY,
    VirtualBoat,
    advance,
    reset_reference,
    reset_threshold,
)
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear

COASTER, UNSTABLE = Norrbin(0.1, 20.0, 50.0), Norrbin(0.2, 5.0, 20.0, n1=-1.0)
TARGET = math.radians(170.0)


def limits_of(model: Norrbin) -> TurnLimits:
    return relaxed(turn_limits(model, SteeringGear(math.radians(30.0), math.radians(2.5)), 0.7))


def on_the_way(left_deg: float, side: float = 1.0) -> VirtualBoat:
    """A virtual boat on its way to TARGET, turning with some rudder."""
    heading = wrap(TARGET - side * math.radians(left_deg))
    return VirtualBoat(heading, side * math.radians(0.8), side * math.radians(10.0))


def test_the_way_back_is_planned_only_after_a_saturated_rudder() -> None:
    limits = limits_of(COASTER)
    assert reset_threshold(COASTER, limits, is_late=True, stuck=23.9) == math.inf
    assert reset_threshold(COASTER, limits, is_late=True, stuck=24.1) == RESET_BEYOND_EARLY
    assert reset_threshold(COASTER, limits, is_late=False, stuck=0.0) == RESET_BEYOND
    assert reset_threshold(UNSTABLE, limits_of(UNSTABLE), is_late=True, stuck=0.0) == RESET_BEYOND_EARLY


def test_a_rudder_of_unlimited_rate_is_no_longer_on_its_way_from_stop_to_stop() -> None:
    limits = turn_limits(COASTER, SteeringGear(0.5, math.inf), 0.7)
    assert reset_threshold(COASTER, limits, is_late=True, stuck=0.1) == RESET_BEYOND_EARLY


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("ahead_deg", [-30.0, -2.0, 0.0, 3.9])
def test_a_boat_that_is_not_far_ahead_leaves_the_plan_alone(side: float, ahead_deg: float) -> None:
    boat = on_the_way(60.0, side)
    heading = wrap(boat.heading + side * math.radians(ahead_deg))
    assert advance(COASTER, limits_of(COASTER), boat, heading, TARGET) == boat


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_one_that_is_takes_it_along_at_its_own_rate(side: float) -> None:
    boat = on_the_way(60.0, side)
    heading = wrap(boat.heading + side * math.radians(9.0))
    taken = advance(COASTER, limits_of(COASTER), boat, heading, TARGET)
    assert wrap(heading - taken.heading) == pytest.approx(side * AHEAD)
    assert taken[1:] == boat[1:]


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("left_deg", [12.0, 25.0, 40.0])
def test_but_never_beyond_where_it_must_begin_to_stop(side: float, left_deg: float) -> None:
    limits, boat = limits_of(COASTER), on_the_way(left_deg, side)
    heading = wrap(TARGET + side * math.radians(6.0))
    taken = advance(COASTER, limits, boat, heading, TARGET)
    left, stops = side * wrap(TARGET - taken.heading), side * stop_angle(COASTER, limits, taken.rate, taken.rudder)
    before = side * wrap(TARGET - boat.heading)
    assert left == pytest.approx(max(stops, side * wrap(TARGET - heading) + AHEAD) if stops < before else before)


def test_a_plan_at_rest_is_no_way_back() -> None:
    at_rest = VirtualBoat(TARGET, 1.0e-9)
    assert advance(COASTER, limits_of(COASTER), at_rest, wrap(TARGET + 0.3), TARGET) == at_rest


def test_a_plan_that_goes_with_a_course_unstable_boat_anyway_is_left_to_that() -> None:
    limits = turn_limits(UNSTABLE, SteeringGear(math.radians(30.0), math.radians(5.0)), 0.7)
    boat = on_the_way(60.0)
    assert advance(UNSTABLE, limits, boat, wrap(boat.heading + 0.3), TARGET) == boat


def test_the_way_back_begins_with_the_rudder_as_it_is() -> None:
    limits = limits_of(COASTER)
    assert reset_reference(COASTER, limits, 0.3, 0.01, -0.2) == VirtualBoat(0.3, 0.01, -0.2)
    assert reset_reference(COASTER, limits, 0.3, -1.0, -0.9) == VirtualBoat(0.3, -limits.rate_max, -limits.rudder_max)
