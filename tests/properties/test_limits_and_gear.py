"""No command outside angle or rate, whatever comes in; no rudder outside its stops, whatever the step."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.control.limits import RudderLimits, limit
from autopilot.models.steering_gear import KNOWN_RAD, DelayLine, RudderBounds, SteeringGear, gear_step

anything = st.floats(allow_nan=True, allow_infinity=True)
LIMITS = RudderLimits(math.radians(30.0), math.radians(20.0))


@given(st.floats(-LIMITS.angle_max, LIMITS.angle_max), anything, st.floats(-10.0, 1.0e6))
def test_a_command_is_inside_angle_and_rate(previous: float, demand: float, dt: float) -> None:
    command = limit(LIMITS, previous, demand, dt)
    assert math.isfinite(command)
    assert abs(command) <= LIMITS.angle_max
    assert abs(command - previous) <= LIMITS.rate_max * max(dt, 0.0) + 1e-12


@pytest.mark.parametrize(("demand", "command"), [(0.5, 0.03), (-0.5, -0.01)])
def test_a_rudder_that_moves_quicker_to_one_side_is_held_to_each_side_s_rate(demand: float, command: float) -> None:
    assert limit(RudderLimits(0.5, 0.2, to_port=0.5, to_starboard=1.5), 0.0, demand, 0.1) == pytest.approx(command)


@given(st.floats(-LIMITS.angle_max, LIMITS.angle_max))
def test_a_demand_inside_the_limits_passes_unchanged(demand: float) -> None:
    assert limit(LIMITS, demand, demand, 0.05) == demand


@given(st.floats(-0.5, 0.5), anything.filter(lambda x: not math.isnan(x)), st.floats(0.0, 1.0e4), st.floats(0.0, 2.0))
def test_the_rudder_stays_between_its_stops_and_slews_no_faster(
    angle: float, order: float, dt: float, lag: float
) -> None:
    gear = SteeringGear(0.5, 0.3, lag)
    moved = gear_step(gear, angle, order, dt)
    assert abs(moved) <= gear.angle_max
    assert abs(moved - angle) <= gear.rate_max * dt + 1e-12


def test_the_lag_is_solved_exactly() -> None:
    gear = SteeringGear(1.0, math.inf, lag=0.5)
    assert gear_step(gear, 0.0, 0.1, 0.5) == pytest.approx(0.1 * (1.0 - math.exp(-1.0)))
    halves = gear_step(gear, gear_step(gear, 0.0, 0.1, 0.25), 0.1, 0.25)
    assert halves == pytest.approx(gear_step(gear, 0.0, 0.1, 0.5), abs=1e-15)


def test_the_dead_band_holds_the_rudder() -> None:
    gear = SteeringGear(1.0, 1.0, dead_band=0.01)
    assert gear_step(gear, 0.0, 0.0099, 1.0) == 0.0
    assert gear_step(gear, 0.0, 0.02, 1.0) == pytest.approx(0.02)


def test_with_play_the_rudder_is_dragged_at_either_end_and_rests_between() -> None:
    gear, rudder, path = SteeringGear(0.5, math.inf, play=0.02), 0.0, []
    for order in (0.1, 0.07, 0.05, -0.01, 0.01, 0.6):
        rudder = gear_step(gear, rudder, order, 1.0)
        path.append(rudder)
    assert path == pytest.approx([0.08, 0.08, 0.07, 0.01, 0.01, 0.5])
    assert gear_step(gear._replace(play=0.0), 0.3, 0.1, 1.0) == pytest.approx(0.1)


def test_the_delay_line_gives_each_order_its_time() -> None:
    line = DelayLine(0.5)
    line.give(0.0, 1.0)
    line.give(0.2, 2.0)
    assert [line.effective(t) for t in (0.0, 0.49, 0.5, 0.69, 0.71)] == [0.0, 0.0, 1.0, 1.0, 2.0]
    line.reset()
    assert line.effective(10.0) == 0.0
    with pytest.raises(ValueError, match="finite"):
        DelayLine(math.inf)


@given(
    st.tuples(*[st.floats(-0.5, 0.5)] * 2),
    st.floats(-0.5, 0.5),
    st.lists(st.floats(-1.0, 1.0), max_size=40),
    st.builds(
        SteeringGear,
        st.just(0.5),
        st.sampled_from([0.2, 1.0, math.inf]),
        st.sampled_from([0.0, 0.3]),
        st.sampled_from([0.0, 0.01]),
        st.sampled_from([0.0, 0.35]),
        to_port=st.sampled_from([1.0, 1.3]),
        to_starboard=st.just(1.0),
        play=st.sampled_from([0.0, 0.02]),
    ),
)
def test_a_rudder_is_known_when_orders_have_brought_all_together(
    begins: tuple[float, float], others: float, orders: list[float], gear: SteeringGear
) -> None:
    """Wherever it lay when the helm was taken, and whatever its last helmsman's order on the way was."""
    bounds, rudders, last = RudderBounds(gear), list(begins), others
    line = DelayLine(gear.delay, others)
    held = 2.0 * gear.angle_max / gear.rate_max + 5.0 * gear.lag + gear.delay + 0.3
    for number, order in enumerate([*orders, *[0.1] * round(held / 0.1)]):
        now = 0.1 * number
        rudders = [gear_step(gear, rudder, last, 0.1) for rudder in rudders] if number else rudders
        bounds.order(now, order)
        line.give(now, order)
        last = line.effective(now)
        if bounds.is_known:
            assert abs(rudders[0] - rudders[1]) <= KNOWN_RAD + 2.0 * (gear.dead_band + gear.play) + 1e-12
    assert bounds.is_known, "an order that is held brings any rudder to it"
    bounds.forget()
    assert not bounds.is_known


@pytest.mark.parametrize(
    ("previous", "demand", "dt", "command"),
    [
        (0.0, 1.0, 0.5, 0.125),
        (0.0, -1.0, 0.5, -0.125),
        (0.25, 0.3, 0.5, 0.3),
        (0.5, 2.0, 9.0, 0.5),
        (-0.5, -2.0, 9.0, -0.5),
        (0.25, 1.0, 0.0, 0.25),
        (0.25, 1.0, -1.0, 0.25),
        (0.25, math.nan, 1.0, 0.25),
        (0.25, math.inf, 1.0, 0.25),
        (0.25, -math.inf, 1.0, 0.25),
        (2.0, 2.0, 0.1, 0.5),
        (-2.0, 0.0, 0.1, -0.5),
    ],
)
def test_a_demand_is_held_to_angle_and_rate_in_numbers(
    previous: float, demand: float, dt: float, command: float
) -> None:
    """0.5 rad each side, a quarter rad/s; what is not finite keeps the rudder at its last command."""
    assert limit(RudderLimits(0.5, 0.25), previous, demand, dt) == pytest.approx(command, abs=1e-15)


def test_a_rudder_of_unlimited_rate_is_anywhere_at_once() -> None:
    for dt in (0.0, 0.1):
        assert limit(RudderLimits(0.5, math.inf), -0.5, 0.4, dt) == 0.4
        assert limit(RudderLimits(0.5, math.inf), -0.5, 4.0, dt) == 0.5
