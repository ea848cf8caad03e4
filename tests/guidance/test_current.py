"""The filter of position and current, and the path over the ground: against a boat whose truth is written out here."""

from __future__ import annotations

import math
from random import Random

import pytest

from autopilot.angles import wrap
from autopilot.guidance import current
from autopilot.guidance.current import CurrentFilter, CurrentSettings, Place, offset
from autopilot.guidance.track import Set, corner_at, on_arc, radius_needed, swept

START = Place(math.radians(57.7), math.radians(11.9))
M_PER_RAD = 6.3781e6
SPEED, SWAY_TIME, LEVER = 4.0, 2.0, 3.0
SETTINGS = CurrentSettings(SPEED, SWAY_TIME)
RATE = math.radians(4.0)


def at(north: float, east: float) -> Place:
    return Place(START.latitude + north / M_PER_RAD, START.longitude + east / M_PER_RAD / math.cos(START.latitude))


class Sailed:
    """A boat that slips in its turns, in a current, with a noisy receiver; `log`: how wrong the speed is [m/s]."""

    def __init__(self, stream: tuple[float, float], *, has_velocity: bool = True, has_log: bool = True) -> None:
        self.stream, self.has_velocity, self.has_log = stream, has_velocity, has_log
        self.dice = Random(7)
        self.now = self.north = self.east = self.heading = self.rate = 0.0
        self.speed = SPEED
        self.known: CurrentFilter = current.first_filter(SETTINGS, START)

    def sail(self, seconds: float, turn: float = 0.0) -> None:
        for step in range(round(seconds * 10)):
            self.now += 0.1
            self.heading = wrap(self.heading + 0.1 * turn)
            self.rate += 0.1 * (turn - self.rate) / SWAY_TIME
            sway = -LEVER * self.rate
            north_speed = self.speed * math.cos(self.heading) - sway * math.sin(self.heading) + self.stream[0]
            east_speed = self.speed * math.sin(self.heading) + sway * math.cos(self.heading) + self.stream[1]
            self.north, self.east = self.north + 0.1 * north_speed, self.east + 0.1 * east_speed
            shown = self.speed if self.has_log else SPEED
            self.known = current.moved(SETTINGS, self.known, self.now, self.heading, shown, has_log=self.has_log)
            if step % 5 == 0:
                north, east = (value + self.dice.gauss(0.0, 0.5) for value in (self.north, self.east))
                self.known = current.fixed(SETTINGS, self.known, at(north, east), 0.0)
                if self.has_velocity:
                    n, e = north_speed + self.dice.gauss(0.0, 0.05), east_speed + self.dice.gauss(0.0, 0.05)
                    self.known = current.with_velocity(SETTINGS, self.known, math.atan2(e, n), math.hypot(n, e))

    @property
    def off(self) -> float:
        north, east = self.known.position
        start = offset(self.known.origin, START)
        return math.hypot(north - start[0] - self.north, east - start[1] - self.east)


@pytest.mark.parametrize(("has_velocity", "within"), [(True, 0.12), (False, 0.35)])
def test_current_and_position_are_found_on_a_straight_course(has_velocity: bool, within: float) -> None:
    boat = Sailed((0.5, -1.2), has_velocity=has_velocity)
    boat.sail(120.0)
    assert boat.known.set == pytest.approx((0.5, -1.2), abs=within)
    assert boat.known.set_doubt < 0.2
    assert boat.off < (0.6 if has_velocity else 1.0)


def test_turns_teach_the_slip_and_leave_the_current_as_it_was() -> None:
    boat = Sailed((0.5, -1.2))
    boat.sail(60.0)
    for turn in (RATE, -RATE, RATE):
        boat.sail(20.0, turn)
        assert boat.known.set == pytest.approx((0.5, -1.2), abs=0.25)
        boat.sail(20.0)
    assert boat.known.lever == pytest.approx(LEVER, rel=0.2)
    assert boat.off < 0.6


def test_without_a_log_a_turn_tells_the_speed_from_the_current() -> None:
    boat = Sailed((0.0, 1.5), has_log=False)
    boat.speed = 3.0
    boat.sail(60.0)
    boat.sail(22.5, RATE)
    boat.sail(60.0)
    assert boat.known.set == pytest.approx((0.0, 1.5), abs=0.3)
    assert boat.known.through_water == pytest.approx(3.0, abs=0.3)


def test_the_doubt_covers_the_error() -> None:
    offs = []
    for seed in range(20):
        boat = Sailed((0.3, 0.9))
        boat.dice = Random(seed)
        boat.sail(40.0)
        offs.append(abs(boat.known.set[1] - 0.9) / boat.known.set_doubt)
    assert sum(off < 2.0 for off in offs) >= 17


def test_a_receiver_that_goes_on_elsewhere_moves_the_boat_and_not_the_current() -> None:
    boat = Sailed((0.0, 1.0))
    boat.sail(60.0)
    boat.north += 25.0
    boat.sail(1.0)
    assert boat.off < 1.5
    assert boat.known.set == pytest.approx((0.0, 1.0), abs=0.15)


def test_far_from_where_it_began_the_chart_begins_anew() -> None:
    boat = Sailed((0.0, 0.0))
    boat.sail(700.0)
    assert boat.known.origin != START
    assert boat.off < 1.0


@pytest.mark.parametrize("begin", [0.0, 1.0, -2.5])
@pytest.mark.parametrize("turn", [0.6, -1.4, 2.0])
def test_an_arc_touches_both_legs_and_turns_to_its_side(begin: float, turn: float) -> None:
    corner = corner_at((10.0, -20.0), begin, wrap(begin + turn), 50.0, (0.0, 1000.0))
    for course, way, gone in ((begin, -corner.tangent, 0.0), (begin + turn, corner.tangent, abs(turn))):
        touch = 10.0 + way * math.cos(course), -20.0 + way * math.sin(course)
        assert swept(corner, *touch) == pytest.approx(gone, abs=1e-6)
        spot = on_arc(corner, *touch, gone)
        assert spot.cross_track == pytest.approx(0.0, abs=1e-6)
        assert wrap(spot.course - course) == pytest.approx(0.0, abs=1e-6)
        starboard = touch[0] - math.sin(course), touch[1] + math.cos(course)
        assert on_arc(corner, *starboard, gone).cross_track == pytest.approx(1.0, abs=0.02)


def test_a_corner_with_the_stream_is_wider_than_one_against_it() -> None:
    still, stream = Set(0.0, 0.0, 4.0), Set(2.4, 0.0, 4.0)
    rate = 0.1
    assert radius_needed(still, 0.0, 1.0, rate) == pytest.approx(40.0)
    assert radius_needed(stream, 1.5, -1.5, rate) == pytest.approx(6.4**2 / 4.0 / rate)
    assert radius_needed(stream, math.pi, -0.3, rate) < 40.0
    assert radius_needed(still, 0.0, 1.0, math.inf) == 0.0


def test_the_heading_makes_the_course_good_and_what_cannot_be_held_is_known() -> None:
    stream = Set(0.0, 2.4, 4.0)
    heading = -stream.crab(0.0)
    assert 4.0 * math.sin(heading) + 2.4 == pytest.approx(0.0)
    assert stream.way(0.0) == pytest.approx(3.2)
    assert stream.holds(0.0) and stream.holds(math.pi)
    assert not Set(0.0, 3.9, 4.0).holds(0.0)
    assert not Set(-3.8, 0.0, 4.0).holds(0.0) and Set(-3.8, 0.0, 4.0).holds(math.pi)
