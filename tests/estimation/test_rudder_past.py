"""The rudder's past in rings: the time it stood at each angle, against a plain sum over all ticks."""

from __future__ import annotations

import math

import pytest
from estimating import OutputFeedbackLoop, held
from hypothesis import given
from hypothesis import strategies as st

from autopilot.estimation.rudder_observer import ORDERS_KEPT, RudderPast, angle_at, tick_at
from autopilot.models.steering_gear import SteeringGear

FEEDBACK_FRESH = 2.0

RING = 16
Past = tuple[RudderPast, list[float], list[float]]


@st.composite
def pasts(draw: st.DrawFn) -> Past:
    """A ring, and the times and angles of all its ticks, those that are forgotten too."""
    count = draw(st.integers(1, 40))
    steps = draw(st.lists(st.floats(0.01, 0.5), min_size=count, max_size=count))
    angles = draw(st.lists(st.floats(-0.5, 0.5), min_size=count, max_size=count))
    times, now = [], 0.0
    for step in steps:
        now += step
        times.append(now)
    ring_times, ring_angles = [0.0] * RING, [0.0] * RING
    for tick, (time, angle) in enumerate(zip(times, angles, strict=True)):
        ring_times[tick % RING], ring_angles[tick % RING] = time, angle
    return (ring_times, ring_angles, count), times, angles


@given(pasts(), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.sampled_from([0.0, 0.05, 0.4, 10.0]))
def test_the_stretches_hold_each_angle_for_as_long_as_the_rudder_did(
    kept: Past, first: float, second: float, grain: float
) -> None:
    past, times, angles = kept
    known = times[max(0, len(times) - RING)]
    last = times[-1] + 1.0
    start, end = sorted((known + first * (last - known), known + second * (last - known)))
    at, total = start, 0.0
    for until, angle in held(past, start, end, grain):
        assert until > at
        total += (until - at) * angle
        at = until
    assert at == end
    edges = [*times[1:], float("inf")]
    wanted = sum(
        max(0.0, min(end, after) - max(start, before)) * angle
        for before, after, angle in zip(times, edges, angles, strict=True)
    )
    assert total == pytest.approx(wanted, abs=1e-9)


@given(pasts(), st.floats(-1.0, 25.0))
def test_the_tick_at_a_time_is_the_newest_not_after_it(kept: Past, time: float) -> None:
    past, times, _ = kept
    oldest = max(0, len(times) - RING)
    found = tick_at(past, time)
    assert oldest <= found < len(times)
    assert found == oldest or times[found] <= time
    assert found + 1 == len(times) or times[found + 1] > time


def test_an_empty_past_is_a_rudder_amidships() -> None:
    empty = ([0.0] * RING, [0.0] * RING, 0)
    assert list(held(empty, 1.0, 2.0, 0.1)) == [(2.0, 0.0)]
    for time in (-1.0, 0.0, 3.0):
        assert angle_at(empty, time) == 0.0
    track = OutputFeedbackLoop(SteeringGear(0.5, 0.1, 0.1))
    assert (track.angle, angle_at(track.past, 1.0)) == (0.0, 0.0)


@given(pasts(), st.floats(-1.0, 25.0))
def test_the_angle_at_a_time_is_that_of_its_tick(kept: Past, time: float) -> None:
    past, times, angles = kept
    known = list(zip(times, angles, strict=True))[-RING:]
    assert angle_at(past, time) == next((angle for at, angle in reversed(known) if at <= time), known[0][1])


def test_feedback_counts_until_it_is_stale_and_the_newest_counts() -> None:
    track = OutputFeedbackLoop(SteeringGear(0.5, 0.1, 0.0))
    assert not track.is_known(0.0)
    track.advance(0.0)
    track.feed_back(1.0, 0.2)
    track.feed_back(0.9, 0.4)
    assert track.advance(1.0) == pytest.approx(0.2), "an older one that comes later is ignored"
    track.feed_back(1.0, 0.3)
    assert track.advance(1.1) == pytest.approx(0.3), "of one time the last counts"
    assert track.is_known(1.0 + 0.99 * FEEDBACK_FRESH) and not track.is_known(1.0 + FEEDBACK_FRESH)
    assert track.advance(1.0 + FEEDBACK_FRESH) == pytest.approx(0.0), "the model alone"
    assert track.advance(0.5) == track.angle == pytest.approx(0.0), "time does not go back"


def test_with_another_dead_time_the_orders_on_their_way_count_at_once() -> None:
    track = OutputFeedbackLoop(SteeringGear(0.5, 10.0, 0.0, 0.0, 0.5))
    track.advance(0.0)
    track.order(0.0, 0.3)
    track.change(SteeringGear(0.5, 10.0, 0.0, 0.0, 0.4))
    assert track.advance(0.1) == pytest.approx(0.3)
    assert track.advance(0.6) == pytest.approx(0.3)


@pytest.mark.parametrize("delay", [0.0, 0.25, 1.0])
def test_the_order_in_effect_is_the_newest_that_was_given_the_dead_time_ago(delay: float) -> None:
    track, orders = OutputFeedbackLoop(SteeringGear(1.0, math.inf, 0.0, 0.0, delay)), {}
    for tick in range(1, 3000):
        now = 0.01 * tick
        passed = [angle for at, angle in orders.items() if at + delay <= now]
        assert track.advance(now) == pytest.approx(passed[-1] if passed else 0.0, abs=1.0e-12)
        orders = dict([*orders.items()][-200:])
        orders[now] = math.sin(now)
        track.order(now, orders[now])


def test_where_more_orders_are_on_their_way_than_are_kept_the_oldest_counts_early() -> None:
    track = OutputFeedbackLoop(SteeringGear(1.0, math.inf, 0.0, 0.0, 10.0))
    track.advance(0.0)
    for place in range(ORDERS_KEPT):
        track.order(0.0, 0.1 + 1.0e-6 * place)
    assert track.advance(1.0) == 0.0
    track.order(1.0, 0.5)
    assert track.advance(2.0) == 0.1


def test_at_a_tick_s_own_time_its_angle_counts() -> None:
    past = ([0.0, 1.0, 2.0, 3.0], [0.1, 0.2, 0.3, 0.4], 4)
    assert [tick_at(past, time) for time in (0.0, 0.5, 1.0, 2.0, 3.0)] == [0, 0, 1, 2, 3]
    assert list(held(past, 1.0, 3.0, 0.0)) == [(2.0, 0.2), (3.0, 0.3)]
    assert list(held(past, 3.0, 4.0, 0.0)) == [(4.0, 0.4)]
    assert list(held(past, 1.0, 3.0, 2.0)) == [(3.0, pytest.approx(0.25))], "so long a grain is one"
