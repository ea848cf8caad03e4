"""How long an order stands and how often a release is said, whatever is asked in whatever order."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from autopilot.links.rudder_order import StandingOrder
from autopilot.signals import RudderCommand

ORDER_AGE_S = 1.0
RELEASES = 5

ORDER_S, RELEASE_S = 1 / 16, 1 / 8
ANGLES = st.sampled_from([0.0, 0.2, -0.3, math.nan, math.inf])
WAITS = st.integers(0, 2048).map(lambda number: number / 1024)
"""Times and periods [s] that binary fractions hold: sums and differences are exact, so the periods hold to the bit."""
EVENTS = st.lists(
    st.tuples(
        WAITS,
        st.one_of(st.none(), st.builds(RudderCommand, ANGLES, st.just(0.0), st.booleans())),
        st.booleans(),
    ),
    max_size=60,
)


@given(EVENTS)
def test_only_a_fresh_order_is_said_and_a_release_until_it_is_passed_on(events) -> None:
    order = StandingOrder(ORDER_S, RELEASE_S)
    now, given_at, standing, owed = 0.0, -math.inf, None, 0
    last = {True: -math.inf, False: -math.inf}
    for wait, command, passes in events:
        now += wait
        if command is not None:
            standing = command.angle if command.engaged and math.isfinite(command.angle) else None
            assert order.take(now, command) == standing == order.angle
            if standing is not None:
                given_at, owed = now, RELEASES
        said: list[float | None] = []
        order.send(now, lambda angle, said=said, passes=passes: bool(said.append(angle)) or passes)
        assert len(said) <= 1
        for angle in said:
            assert angle == standing
            assert now - last[angle is None] >= (ORDER_S if angle is not None else RELEASE_S)
            assert angle is None or now - given_at <= ORDER_AGE_S
            assert angle is not None or owed > 0
            last[angle is None] = now
            owed -= angle is None and passes
    assert order.end() == (max(owed, 1) if owed or standing is not None else 0)
    assert order.end() == 0


def test_after_an_order_five_releases_are_said_and_no_more() -> None:
    order, said = StandingOrder(ORDER_S, RELEASE_S), []
    order.take(0.0, RudderCommand(0.1, 0.0, True))
    order.take(0.01, RudderCommand(0.1, 0.0, False))
    for tick in range(200):
        order.send(0.01 * tick, lambda angle: not said.append(angle))
    assert said == [None] * RELEASES
    assert order.end() == 0


def test_times_of_a_standing_order_to_the_bit() -> None:
    """An order is said anew after its period for one second, a release after its own."""
    order = StandingOrder(0.25, 0.5)
    said: list[float | None] = []

    def counts(*times: float) -> list[int]:
        found = []
        for now in times:
            before = len(said)
            order.send(now, lambda angle: not said.append(angle))
            found.append(len(said) - before)
        return found

    order.take(0.0, RudderCommand(0.1, 0.2, True))
    order.take(0.0, RudderCommand(0.0, 0.2, True))
    assert counts(0.0, 0.2499, 0.25, 1.0, 1.0001, 9.0) == [1, 0, 1, 1, 0, 0]
    order.take(10.0, RudderCommand(10.0, 0.2, False))
    assert counts(10.0, 10.4999, 10.5) == [1, 0, 1]
