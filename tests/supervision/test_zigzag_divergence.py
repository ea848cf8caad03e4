"""A zigzag that turns against its rudder is ended; one that overshoots is not."""

from __future__ import annotations

import math

import pytest

from autopilot.guidance.stop import turn_limits
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.signals import NavState, Order, OrderKind
from autopilot.steering import Guide, heading_ordered, zigzag, zigzag_divergence
from autopilot.supervision.monitor_input import MonitorInput
from autopilot.supervision.rudder_watch import NO_RUNAWAY, ZIGZAG_DIVERGED, runaway_step

MODEL = Norrbin(0.3, 2.0, reference_speed=4.0)
SWING = math.radians(10.0)
ZIGZAG = Order(OrderKind.ZIGZAG, rudder=SWING, heading_change=SWING, serial=1, heading=math.nan)


def state(heading: float, rate: float = 0.0) -> NavState:
    return NavState(time=0.0, heading=heading, rate=rate, speed=4.0, rudder=0.0, bias=0.0, heading_age=0.0, valid=True)


def sailing(base: float) -> Guide:
    return heading_ordered(
        Guide(), MODEL, turn_limits(MODEL, SteeringGear(0.5, 0.2), 0.7, math.inf), state(base), ZIGZAG.heading
    )


@pytest.mark.parametrize("base", [0.0, math.pi, -3.0])
def test_how_far_is_counted_from_the_swing_on_the_side_that_the_rudder_turns_from(base: float) -> None:
    guide = zigzag(sailing(base), ZIGZAG, base)
    assert guide.side > 0
    assert zigzag_divergence(guide, ZIGZAG, base + 1.0) < 0.0, "to starboard, as ordered"
    assert zigzag_divergence(guide, ZIGZAG, base - 1.0) == pytest.approx(1.0 - SWING)
    guide = zigzag(guide, ZIGZAG, base + 1.01 * SWING)
    assert guide.side < 0
    assert zigzag_divergence(guide, ZIGZAG, base + 1.0) == pytest.approx(1.0 - SWING)


def test_without_a_zigzag_nothing_has_diverged() -> None:
    assert zigzag_divergence(Guide(), Order(), 2.0) == 0.0


@pytest.mark.parametrize(
    ("divergence", "rate", "runs"),
    [
        (ZIGZAG_DIVERGED + 0.01, -0.1, True),
        (ZIGZAG_DIVERGED + 0.01, 0.1, False),  # far off, and on the way back
        (ZIGZAG_DIVERGED - 0.01, -0.1, False),  # an overshoot
    ],
)
def test_only_a_boat_that_goes_on_turning_against_its_rudder_has_run_away(
    divergence: float, rate: float, runs: bool
) -> None:
    seen = MonitorInput(0.0, MODEL, state(0.0, rate), True, False, 0.0, SWING, 0.5, True, zigzag_divergence=divergence)
    assert runaway_step(NO_RUNAWAY, seen).has_run is runs


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("kept", "runs"), [(1.0, True), (0.95, True), (0.7, False)])
def test_a_boat_that_slows_down_beyond_45_degrees_is_coming_round(side: float, kept: float, runs: bool) -> None:
    """A course-unstable boat overshoots by more than IMO allows, and its rudder stops it all the same. kept: the share
    of its rate that is left after each second with the rudder over."""
    before, heading, rate = NO_RUNAWAY, 0.0, 0.2
    for tick in range(101):
        now = 0.05 * tick
        rate *= kept**0.05 if now > 1.0 else 1.0
        heading += 0.05 * rate
        seen = MonitorInput(
            now, MODEL, state(side * heading, side * rate), True, False, 0.0, -side * SWING, 0.5, True,
            zigzag_divergence=heading - SWING + math.radians(40.0),
        )  # fmt: skip
        before = runaway_step(before, seen)
    assert heading > SWING + math.radians(5.0)
    assert before.has_run is runs
