"""A bow thruster's order: symmetry, duty, no chatter, off where it must be; on a boat that is not its equation."""

from __future__ import annotations

import math
from itertools import pairwise

from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.control.bow_thruster import AT_REST, Bow, BowLook, BowState, BowThruster, bow_step, turns_boat

DT = 0.05
DEGREE = math.pi / 180.0
angles = st.floats(-math.pi, math.pi)
rates = st.floats(-0.3, 0.3)
thrusters = st.builds(
    BowThruster,
    rate=st.floats(0.01, 0.3),
    time=st.floats(0.5, 20.0),
    useless_above=st.floats(0.3, 3.0),
    delay=st.floats(0.0, 1.0),
    proportional=st.booleans(),
    least=st.floats(0.05, 0.5),
    run=st.floats(2.0, 60.0),
    rest=st.floats(10.0, 600.0),
    least_on=st.floats(0.1, 1.0),
    least_off=st.floats(0.1, 3.0),
    dead_band=st.floats(0.01, 0.2),
)
looks = st.lists(st.tuples(angles, rates, st.floats(0.0, 2.0), st.booleans()), min_size=1, max_size=300)


def ran(thruster: BowThruster, given: list[tuple[float, float, float, bool]], hold: int = 5) -> list[BowState]:
    """Each look holds for some ticks; False: the thruster must not run."""
    state, states = AT_REST, []
    for error, rate, speed, may in given:
        for _ in range(hold):
            state = bow_step(thruster, state, BowLook(error, rate, speed) if may else None, DT)
            states.append(state)
    return states


@given(thrusters, looks)
@settings(max_examples=100, deadline=None)
def test_to_port_it_does_what_it_does_to_starboard(thruster: BowThruster, course: list) -> None:
    mirrored = [(-error, -rate, speed, may) for error, rate, speed, may in course]
    for one, other in zip(ran(thruster, course), ran(thruster, mirrored), strict=True):
        assert one.share == -other.share


@given(thrusters, looks)
@settings(max_examples=100, deadline=None)
def test_it_runs_no_longer_than_its_duty_allows(thruster: BowThruster, course: list) -> None:
    used = rested = 0.0
    for state in ran(thruster, course, hold=40):
        used += abs(state.share) * DT
        rested += DT if not state.share else 0.0
        assert abs(state.share) <= 1.0
        assert used <= thruster.run + rested * thruster.run / thruster.rest + 2.0 * DT


@given(thrusters, looks)
@settings(max_examples=100, deadline=None)
def test_it_never_chatters(thruster: BowThruster, course: list) -> None:
    states = ran(thruster, course)
    since, before = math.inf, 0.0
    for state, (_, _, _, may) in zip(states, [each for each in course for _ in range(5)], strict=True):
        since += DT
        if bool(state.share) == bool(before):
            assert state.share * before >= 0.0, "never from one side to the other without a rest"
        elif state.share:
            assert since >= thruster.least_off - 1.0e-6
            since = 0.0
        else:
            cut_short = not may or state.is_hot or state.is_weak or since >= thruster.least_on - 1.0e-6
            assert cut_short or looked_useless(thruster, course), "a run is no shorter than the shortest"
            since = 0.0
        before = state.share


def looked_useless(thruster: BowThruster, course: list) -> bool:
    return any(speed >= 0.9 * thruster.useless_above for _, _, speed, _ in course)


@given(thrusters, angles, rates)
def test_it_is_off_at_once_where_it_must_not_run(thruster: BowThruster, error: float, rate: float) -> None:
    running = BowState(1.0, 0.0)
    assert bow_step(thruster, running, None, DT).share == 0.0
    assert bow_step(thruster, running, BowLook(math.nan, rate, 0.0), DT).share == 0.0
    assert bow_step(thruster, running, BowLook(error, rate, thruster.useless_above), DT).share == 0.0
    assert bow_step(thruster, running._replace(heat=1.0), BowLook(error, rate, 0.0), DT).share == 0.0


def sailed(thruster: BowThruster, *, strength: float = 1.0, push: float = 0.0, seconds: float = 120.0) -> list:
    """Turn a boat by 90 deg whose drag goes with the square of its rate and whose thruster has a lag of its own."""
    heading, rate, thrust, state, course = 0.0, 0.0, 0.0, AT_REST, 90.0 * DEGREE
    orders = [0.0] * 6
    seen = []
    for _ in range(round(seconds / DT)):
        state = bow_step(thruster, state, BowLook(course - heading, rate, 0.0), DT)
        orders.append(state.share)
        thrust += (orders.pop(0) - thrust) * DT / 0.2
        drag = rate * abs(rate) / thruster.rate + 0.3 * rate
        rate += DT * (strength * thrust * thruster.rate + push - drag) / thruster.time
        heading += DT * rate
        seen.append((heading - course, state))
    return seen


BOAT = BowThruster(rate=6.0 * DEGREE, time=3.0, useless_above=1.5, delay=0.4, rest=120.0)


def test_the_boat_comes_to_its_course_and_stays_there() -> None:
    for thruster in (BOAT, BOAT._replace(proportional=True)):
        for strength in (0.7, 1.0, 1.3):
            seen = sailed(thruster, strength=strength)
            assert max(error for error, _ in seen) < 6.0 * DEGREE, "past the course"
            assert all(abs(error) < 8.0 * DEGREE for error, _ in seen[-1200:])
            assert not seen[-1][1].is_weak


def test_a_dead_thruster_is_found_and_left_alone() -> None:
    seen = sailed(BOAT, strength=0.0)
    ran_for = DT * sum(1 for _, state in seen if state.share)
    assert seen[-1][1].is_weak
    assert ran_for < 4.0
    forgiven = bow_step(BOAT, seen[-1][1], None, DT, engaged=False)
    assert not forgiven.is_weak


def test_a_thruster_that_just_holds_the_boat_against_the_wind_is_no_dead_one() -> None:
    for side in (1.0, -1.0):
        seen = sailed(BOAT, push=side * -1.02 * BOAT.rate, seconds=40.0)
        assert not any(state.is_weak for _, state in seen)
    assert any(state.doubt for _, state in sailed(BOAT, push=-1.02 * BOAT.rate, seconds=40.0))


def helped(thruster: BowThruster, *, push: float, seconds: float = 60.0) -> list[tuple[float, BowState]]:
    """Hold a course against a `push` [rad/s^2] with a rudder of half the thruster's strength."""
    heading, rate, thrust, state, learnt = 0.0, 0.0, 0.0, AT_REST, 0.0
    full = thruster.rate / thruster.time
    orders, seen = [0.0] * 6, []
    for _ in range(round(seconds / DT)):
        wanted = -0.3 * heading - 1.0 * rate - learnt
        rudder = min(max(wanted, -0.5 * full), 0.5 * full)
        state = bow_step(thruster, state, BowLook(-heading, rate, 0.0, wanted, 0.5 * full), DT)
        orders.append(state.share)
        thrust += (orders.pop(0) - thrust) * DT / 0.2
        acting = thrust * abs(thrust) * full + push - rate / thruster.time
        learnt += DT / 4.0 * (acting + rate / thruster.time - learnt)
        rate += DT * (rudder + acting)
        heading += DT * rate
        seen.append((heading, state))
    return seen


def test_it_takes_what_a_rudder_at_its_stop_cannot_and_no_more() -> None:
    full = BOAT.rate / BOAT.time
    for thruster in (BOAT, BOAT._replace(proportional=True)):
        for side in (1.0, -1.0):
            enough = helped(thruster, push=side * 0.4 * full)
            assert not any(state.share for _, state in enough), "the rudder can"
            short = helped(thruster, push=side * 0.9 * full)
            assert all(state.share * side <= 0.0 for _, state in short), "against the push alone"
            assert max(abs(heading) for heading, _ in short[-400:]) < 10.0 * DEGREE
            starts = sum(1 for (_, a), (_, b) in pairwise(short) if b.share and not a.share)
            assert starts < 20, "in a minute"


def test_a_turn_that_is_short_of_rudder_for_a_moment_starts_nothing() -> None:
    state, most = AT_REST, 0.5 * BOAT.rate / BOAT.time
    for step in range(200):
        state = bow_step(BOAT, state, BowLook(0.5, 0.0, 0.0, (3.0 if step < 20 else 0.5) * most, most), DT)
        assert not state.share


def test_it_may_turn_the_boat_until_its_thrust_and_that_which_it_caused_are_gone() -> None:
    thruster = BowThruster(rate=0.1, time=4.0, useless_above=1.5, delay=0.3)
    found = [
        turns_boat(fitted, Bow(BowState(share=share, since=since)))
        for fitted, share, since in [
            (thruster, 1.0, 60.0),
            (thruster, 0.0, 4.2),
            (thruster, 0.0, 4.4),
            (thruster, 0.0, math.inf),
            (None, 0.0, 0.0),
        ]
    ]
    assert found == [True, True, False, False, False]
