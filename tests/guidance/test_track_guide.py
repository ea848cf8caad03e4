"""Following a route: waypoints, the end, lost and wild positions, alarms; and what it must never do."""

from __future__ import annotations

import itertools
import math

import pytest
from alarm_texts import words
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import shortest_turn, wrap
from autopilot.guidance.current import Place, bearing_and_distance
from autopilot.guidance.track import TrackGuide, TrackSettings, Waypoint
from autopilot.signals import PositionSample

SPEED = 4.0
START = Place(math.radians(54.3), math.radians(10.2))
M_PER_RAD = 6.3781e6


def at(north: float, east: float) -> Place:
    """A place so many metres from START, as a ball would have it: the test needs no more."""
    return Place(START.latitude + north / M_PER_RAD, START.longitude + east / M_PER_RAD / math.cos(START.latitude))


def waypoint(north: float, east: float, radius: float = math.nan) -> Waypoint:
    return Waypoint(*at(north, east), radius)


class Boat:
    """A boat that turns to its course at up to 10 deg/s, in a current, with a GPS of 1 Hz."""

    def __init__(self, guide: TrackGuide, heading: float = 0.0, current: tuple[float, float] = (0.0, 0.0)) -> None:
        self.guide, self.heading, self.current = guide, heading, current
        self.north = self.east = self.now = 0.0

    def sail(self, seconds: float, gps: bool = True) -> list[float]:
        offs = []
        for tick in range(round(seconds * 10)):
            if gps and tick % 10 == 0:
                self.guide.take(PositionSample(self.now, *at(self.north, self.east)))
            self.now += 0.1
            turn = shortest_turn(self.heading, self.guide.course(self.now, self.heading, SPEED))
            self.heading = wrap(self.heading + math.copysign(min(abs(turn), math.radians(1.0)), turn))
            self.north += 0.1 * (SPEED * math.cos(self.heading) + self.current[0])
            self.east += 0.1 * (SPEED * math.sin(self.heading) + self.current[1])
            offs.append(self.guide.leg.cross_track if self.guide.leg is not None else math.nan)
        return offs


def following(*route: Waypoint, **settings: float) -> TrackGuide:
    guide = TrackGuide(TrackSettings(speed=SPEED, **settings))
    guide.follow(route)
    return guide


def test_a_square_is_sailed_round_and_its_last_course_is_held() -> None:
    guide = following(waypoint(400, 0), waypoint(400, 400), waypoint(0, 400), waypoint(0, 0), turn_radius=25.0)
    boat = Boat(guide)
    seen = [guide.target]
    for _ in range(600):
        boat.sail(1.0)
        if guide.target != seen[-1]:
            seen.append(guide.target)
        if guide.is_complete:
            break
    assert seen == [0, 1, 2, 3]
    assert (guide.passed, guide.last_passed) == (4, 3)
    assert bearing_and_distance(START, at(boat.north, boat.east))[1] < 15.0
    boat.sail(20.0)
    assert abs(shortest_turn(boat.heading, math.radians(-90.0))) < math.radians(3.0)
    assert words(guide.alarm).startswith("the route has ended: holding 2")
    assert guide.leg is None


@pytest.mark.parametrize("current", [(0.0, 1.0), (0.0, -1.5), (0.7, 0.7)])
def test_a_current_is_taken_out_and_what_is_known_of_it_serves_the_next_leg(current: tuple[float, float]) -> None:
    boat = Boat(following(waypoint(3000, 0), waypoint(5000, 1200)), current=current)
    first = boat.sail(60.0)
    offs = boat.sail(300.0)
    assert max(abs(value) for value in first) > 1.0, "before the filter has learnt it, the current sets the boat off"
    assert max(abs(value) for value in offs) < 0.3
    while boat.guide.target == 0:
        boat.sail(1.0)
    offs = boat.sail(300.0)
    assert max(abs(value) for value in offs) < 6.0, "the boat turns at once, where the arc begins"
    assert max(abs(value) for value in offs[600:]) < 0.3


def test_a_wide_turn_is_begun_before_the_waypoint_and_a_wide_circle_counts() -> None:
    for radius, turn_radius, least, most in (
        (math.nan, 25.0, 24.0, 34.0),
        (5.0, 0.0, 4.0, 5.1),
        (60.0, 25.0, 59.0, 61.0),
    ):
        boat = Boat(following(waypoint(300, 0, radius), waypoint(300, 300), turn_radius=turn_radius))
        while boat.guide.target == 0:
            boat.sail(0.1)
        assert least <= 300.0 - boat.north <= most


def test_a_missed_circle_ends_at_the_line_across_the_leg() -> None:
    boat = Boat(following(waypoint(200, 0), waypoint(200, 400)), heading=0.0)
    boat.sail(20.0)
    boat.east += 25.0
    boat.sail(40.0)
    assert boat.guide.target == 1


def test_lost_positions_hold_the_course_are_reported_and_found_again() -> None:
    guide = following(waypoint(2000, 0))
    boat = Boat(guide, current=(0.0, 0.8))
    boat.sail(200.0)
    held = guide.course(boat.now, boat.heading, SPEED)
    assert abs(held) > math.radians(5.0), "a course that leaves room for the current"
    boat.sail(4.0, gps=False)
    assert guide.alarm is None and guide.leg is None
    boat.sail(4.0, gps=False)
    assert guide.course(boat.now, boat.heading, SPEED) == pytest.approx(held, abs=0.02)
    assert words(guide.alarm).startswith("position lost, the route is not followed: holding 3")
    said = guide.alarm
    boat.sail(30.0, gps=False)
    assert guide.alarm == said, "an alarm that changes is a new alarm each time"
    boat.sail(60.0)
    assert guide.alarm is None
    assert abs(boat.sail(10.0)[-1]) < 3.0


def test_without_any_position_the_present_heading_is_held_and_reported() -> None:
    guide = following(waypoint(2000, 0))
    assert guide.course(100.0, 1.0, SPEED) == 1.0
    assert guide.alarm is None
    assert guide.course(104.0, 1.3, SPEED) == 1.0
    guide.course(105.1, 1.3, SPEED)
    assert "position lost" in words(guide.alarm)


def test_a_wild_position_moves_nothing() -> None:
    guide = following(waypoint(2000, 0))
    boat = Boat(guide)
    boat.sail(20.0)
    before = guide.fix.place
    guide.take(PositionSample(boat.now + 0.5, *at(5000, 5000)))
    assert guide.fix.place == before
    boat.sail(1.0)
    assert guide.fix.place == at(boat.north - 4.0, boat.east) or guide.fix.place != before
    assert abs(boat.sail(5.0)[-1]) < 1.0


def jumped(east: float) -> tuple[Boat, TrackGuide]:
    """A boat on a track to the north whose positions have jumped by `east` [m] 30 s ago and go on from there."""
    guide = following(waypoint(2000, 0))
    boat = Boat(guide)
    boat.sail(20.0)
    for second in range(1, 31):
        guide.take(PositionSample(boat.now + second, *at(boat.north + SPEED * second, east)))
        course = guide.course(boat.now + second, 0.0, SPEED)
        assert abs(math.degrees(course)) < 1.0
    return boat, guide


def test_a_route_does_not_follow_positions_that_have_jumped() -> None:
    _, guide = jumped(500.0)
    assert "position jumped by 50" in words(guide.alarm)


def test_positions_that_jump_back_lead_the_route_again() -> None:
    boat, guide = jumped(200.0)
    guide.take(PositionSample(boat.now + 31, *at(boat.north + 31 * SPEED, 0.0)))
    guide.course(boat.now + 31, 0.0, SPEED)
    assert guide.leg is not None
    assert guide.alarm is None


def test_positions_that_have_jumped_count_when_the_route_is_begun_again() -> None:
    boat, guide = jumped(500.0)
    guide.follow(guide.route)
    guide.course(boat.now + 30, 0.0, SPEED)
    assert guide.fix.place == at(boat.north + 30 * SPEED, 500.0)
    assert guide.leg is not None
    assert guide.alarm is None


def test_a_gps_that_repeats_itself_under_way_is_lost() -> None:
    guide = following(waypoint(2000, 0))
    boat = Boat(guide)
    boat.sail(20.0)
    for second in range(10):
        guide.take(PositionSample(boat.now + second, *at(80.0, 0.0)))
        guide.course(boat.now + second, 0.0, SPEED)
    assert "position lost" in words(guide.alarm)


def test_far_off_the_track_is_reported_once_and_not_with_every_metre() -> None:
    boat = Boat(following(waypoint(5000, 0)))
    boat.sail(30.0)
    for _ in range(3):
        boat.east += 30.0
        boat.sail(1.0)
    said = []
    for _ in range(100):
        boat.sail(0.1)
        if boat.guide.alarm and words(boat.guide.alarm) not in said:
            said.append(words(boat.guide.alarm))
    assert said == ["more than 50 m to starboard of the track: check the current, the rudder and the speed"]


def test_a_place_already_reached_holds_the_present_heading() -> None:
    guide = following(waypoint(0, 0))
    guide.take(PositionSample(0.0, *START))
    assert guide.course(0.1, 2.0, SPEED) == 2.0
    assert guide.is_complete and guide.passed == 1
    assert guide.course(9.0, 2.5, SPEED) == 2.0


def test_leaving_forgets_the_leg_and_following_again_begins_where_the_boat_is() -> None:
    boat = Boat(following(waypoint(2000, 0)))
    boat.sail(30.0)
    boat.guide.leave()
    assert not boat.guide.following and boat.guide.alarm is None
    boat.east += 20.0
    boat.guide.follow([waypoint(2000, 0)])
    assert abs(boat.sail(2.0)[-1]) < 2.0, "the leg leads from here, not from where the first one began"


@pytest.mark.parametrize("target", [-1, 2])
def test_a_waypoint_that_is_not_there_is_refused(target: int) -> None:
    with pytest.raises(ValueError, match="there is no waypoint"):
        TrackGuide().follow([waypoint(0, 0), waypoint(1, 1)], target)


PLACES = st.builds(lambda n, e: Waypoint(*at(n, e)), st.floats(-3e3, 3e3), st.floats(-3e3, 3e3))
ANYWHERE = st.builds(
    PositionSample, st.floats(0.0, 200.0), st.floats(-1.6, 1.6), st.floats(-math.pi, math.pi) | st.just(math.nan)
)


@given(
    route=st.lists(PLACES, min_size=1, max_size=6),
    positions=st.lists(ANYWHERE | st.builds(lambda t, w: PositionSample(t, *w.place), st.floats(0, 200), PLACES)),
    speed=st.floats(-20.0, 60.0),
)
def test_whatever_arrives_the_course_is_a_course(
    route: list[Waypoint], positions: list[PositionSample], speed: float
) -> None:
    guide = following(*route, turn_radius=30.0)
    for step, position in enumerate(positions):
        guide.take(position)
        target = guide.target
        course = guide.course(step * 2.0, 0.3, speed)
        assert -math.pi <= course <= math.pi
        assert guide.target in (target, target + 1)
        assert 0 <= guide.target < len(route)


@given(PLACES, st.floats(0.0, 1.4), st.floats(0.5, 8.0))
def test_from_anywhere_it_heads_for_the_waypoint(goal: Waypoint, latitude: float, speed: float) -> None:
    """In slack water the first leg leads from the boat straight to its end, wherever on earth."""
    origin = Place(latitude, 3.0)
    there = Waypoint(origin.latitude + goal.latitude - START.latitude, wrap(3.0 + goal.longitude - START.longitude))
    bearing, distance = bearing_and_distance(origin, there.place)
    guide = following(there)
    guide.take(PositionSample(0.0, *origin))
    if distance > 20.0:
        assert abs(shortest_turn(guide.course(0.0, 0.3, speed), bearing)) < 1.0e-6


def test_the_current_learnt_on_a_leg_is_kept_for_later_legs() -> None:
    """North in an east-going current, a leg east along it, then south: the same current, on the other side."""
    route = (waypoint(1500, 0), waypoint(1500, 500), waypoint(-2000, 500))
    boat = Boat(following(*route, turn_radius=23.0, lead=1.0), current=(0.0, 1.2))
    first = boat.sail(100.0)
    while boat.guide.target < 2:
        boat.sail(1.0)
    boat.sail(25.0)
    third = boat.sail(100.0)
    assert max(abs(value) for value in first) > 1.5
    assert max(abs(value) for value in third) < 0.5
    boat.guide.leave()
    boat.guide.follow([waypoint(-2000, 500)])
    assert max(abs(value) for value in boat.sail(100.0)) < 1.0
    boat.guide.leave()
    boat.current = (0.5, -0.8)
    boat.sail(600.0)
    boat.guide.follow([waypoint(-9000, 500)])
    boat.sail(20.0)
    assert max(abs(value) for value in boat.sail(100.0)) < 1.0, "it learns while nothing is followed, too"


def test_a_current_that_a_later_leg_cannot_stand_is_reported_on_the_leg_before() -> None:
    """With the stream, then back against it: 1.3 of the boat's speed is known before the first leg has ended."""
    guide = following(waypoint(3000, 0), waypoint(3000, 300), waypoint(0, 300), turn_radius=20.0)
    boat = Boat(guide, current=(1.3 * SPEED, 0.0))
    boat.sail(60.0)
    assert guide.target == 0
    said = words(guide.alarm)
    assert said.startswith("the current is too strong for the route, the leg to waypoint 1: 5.2 m/s of current")
    assert said.endswith("go faster, wait for slack water or choose another route")
    boat.current = (0.0, 0.0)
    boat.sail(120.0)
    assert guide.alarm is None


@pytest.mark.parametrize("turn", [60.0, -60.0])
@pytest.mark.parametrize("current", [(0.0, 0.0), (0.0, 2.0), (1.0, -2.0)])
def test_a_waypoint_that_is_passed_swings_the_order_to_no_wrong_side(turn: float, current: tuple[float, float]) -> None:
    course = math.radians(turn)
    guide = following(
        waypoint(800, 0), waypoint(800 + 600 * math.cos(course), 600 * math.sin(course)), turn_radius=40.0, lead=1.0
    )
    boat = Boat(guide, current=current)
    boat.sail(60.0)
    orders = []
    while guide.target == 0:
        boat.sail(0.1)
        orders.append(guide.course(boat.now, boat.heading, SPEED))
    for _ in range(300):
        boat.sail(0.1)
        orders.append(guide.course(boat.now, boat.heading, SPEED))
    steps = [shortest_turn(one, other) * math.copysign(1.0, turn) for one, other in itertools.pairwise(orders)]
    begun = next(place for place in range(len(orders)) if abs(shortest_turn(orders[0], orders[place])) > 0.2)
    assert max(steps) < math.radians(3.0), "no jump"
    before = [shortest_turn(orders[0], order) * math.copysign(1.0, turn) for order in orders[:begun]]
    assert min(before) > -math.radians(2.0), "not to the other side first"
