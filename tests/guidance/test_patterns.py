"""Turn patterns: the tracks they make, and that an order never leads the boat the wrong way round."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import shortest_turn, wrap
from autopilot.guidance import manoeuvres
from autopilot.guidance.manoeuvres import LEAD, Pattern, PatternGuide, Progress

SPEED = 4.0


class Boat:
    """Turns to its order at up to 20 deg/s; remembers where it has been and how far it has turned."""

    def __init__(self, pattern: Pattern, heading: float = 0.0, rate_deg_s: float = 20.0) -> None:
        self.guide = PatternGuide()
        self.guide.follow(pattern)
        self.heading, self.rate = heading, math.radians(rate_deg_s)
        self.turned = 0.0
        self.places = [(0.0, 0.0)]
        self.now = 0.0

    def sail(self, seconds: float) -> None:
        for _ in range(round(seconds * 10)):
            self.now += 0.1
            turn = shortest_turn(self.heading, self.guide.course(self.now, self.heading, SPEED))
            turn = math.copysign(min(abs(turn), 0.1 * self.rate), turn)
            self.heading, self.turned = wrap(self.heading + turn), self.turned + turn
            north, east = self.places[-1]
            self.places.append(
                (north + 0.1 * SPEED * math.cos(self.heading), east + 0.1 * SPEED * math.sin(self.heading))
            )


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("heading", [0.0, 3.0, -2.0])
def test_a_u_turn_goes_to_its_side_and_ends_on_the_opposite_heading(side: int, heading: float) -> None:
    boat = Boat(manoeuvres.u_turn(side), heading)
    boat.sail(30.0)
    assert boat.turned == pytest.approx(side * math.pi)
    assert abs(shortest_turn(boat.heading, heading + math.pi)) < 1.0e-9


@pytest.mark.parametrize("side", [1, -1])
def test_a_circle_has_its_radius_and_does_not_end(side: int) -> None:
    boat = Boat(manoeuvres.circle(side, 60.0))
    boat.sail(5.0 * 2.0 * math.pi * 60.0 / SPEED)
    assert boat.turned == pytest.approx(side * 10.0 * math.pi, rel=0.02)
    once = boat.places[-round(2.0 * math.pi * 60.0 / SPEED * 10) :]
    easts = [east for _, east in once]
    assert max(easts) - min(easts) == pytest.approx(120.0, rel=0.02)


def test_a_circle_too_tight_for_the_boat_is_turned_as_tightly_as_it_can() -> None:
    boat = Boat(manoeuvres.circle(1, 2.0), rate_deg_s=5.0)
    boat.sail(100.0)
    assert boat.turned == pytest.approx(math.radians(500.0), rel=0.02)


@pytest.mark.parametrize(("growth", "faster"), [(20.0, False), (-20.0, True)])
def test_a_spiral_changes_its_radius_with_each_turn(growth: float, faster: bool) -> None:
    boat = Boat(manoeuvres.spiral(1, 100.0, growth))
    times = []
    while len(times) < 3:
        boat.sail(0.1)
        if boat.turned >= 2.0 * math.pi * (len(times) + 1):
            times.append(boat.now)
    turns = [times[0], times[1] - times[0], times[2] - times[1]]
    expected = [2.0 * math.pi * (100.0 + growth * (number + 0.5)) / SPEED for number in range(3)]
    assert turns == pytest.approx(expected, rel=0.03)
    assert (turns[2] < turns[0]) == faster


def test_a_spiral_inwards_ends_straight() -> None:
    boat = Boat(manoeuvres.spiral(1, 50.0, -20.0))
    boat.sail(300.0)
    heading = boat.heading
    boat.sail(20.0)
    assert boat.heading == heading and boat.turned == pytest.approx(5.0 * math.pi, rel=0.01)


def test_a_zigzag_swings_about_where_it_began_and_a_square_comes_round() -> None:
    boat = Boat(manoeuvres.zigzag(-1, math.radians(30.0), 100.0), heading=1.0)
    boat.sail(24.0)
    assert boat.heading == pytest.approx(1.0 - math.radians(30.0))
    boat.sail(25.0)
    assert boat.heading == pytest.approx(1.0 + math.radians(30.0))
    boat = Boat(manoeuvres.square(1, 100.0))
    boat.sail(24.0)
    assert boat.heading == pytest.approx(0.0)
    boat.sail(100.0)
    assert boat.turned == pytest.approx(2.0 * math.pi)
    assert math.hypot(*boat.places[-1]) < 120.0


def test_an_s_swings_to_both_sides_and_back() -> None:
    angle, radius = math.radians(40.0), 60.0
    boat = Boat(manoeuvres.s_curve(1, angle, radius))
    headings = []
    for _ in range(round(4.0 * angle * radius / SPEED * 10)):
        boat.sail(0.1)
        headings.append(boat.heading)
    assert max(headings) == pytest.approx(angle, abs=0.02) and min(headings) == pytest.approx(-angle, abs=0.02)
    assert abs(headings[-1]) < 0.03
    assert headings[10] > 0.0


SIDES = st.sampled_from([1, -1])
ANY = st.one_of(
    st.builds(manoeuvres.u_turn, SIDES),
    st.builds(manoeuvres.circle, SIDES, st.floats(1.0, 500.0)),
    st.builds(manoeuvres.spiral, SIDES, st.floats(1.0, 500.0), st.floats(-50.0, 50.0)),
    st.builds(manoeuvres.zigzag, SIDES, st.floats(0.01, 1.5), st.floats(1.0, 500.0)),
    st.builds(manoeuvres.square, SIDES, st.floats(1.0, 500.0)),
    st.builds(manoeuvres.s_curve, SIDES, st.floats(0.01, 1.5), st.floats(1.0, 500.0)),
)


@given(ANY, st.lists(st.tuples(st.floats(0.0, 5.0), st.floats(-math.pi, math.pi), st.floats(-20.0, 30.0))))
def test_a_pattern_orders_headings_less_than_half_a_turn_away(
    pattern: Pattern, moves: list[tuple[float, float, float]]
) -> None:
    guide, now = PatternGuide(), 0.0
    guide.follow(pattern)
    for dt, heading, speed in moves:
        now += dt
        course = guide.course(now, heading, speed)
        assert -math.pi < course <= math.pi
        assert abs(shortest_turn(heading, course)) <= LEAD + 1.0e-9


@given(ANY)
def test_every_pattern_begins_where_the_boat_is_or_turns_to_its_side(pattern: Pattern) -> None:
    assert abs(pattern(Progress(0.0, 0.0))) <= LEAD + 1.0e-9
