"""The wind as a guide: the triangle of the winds, the angle held, tack and gybe, shifts, and what is no wind."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import pytest
from alarm_texts import words
from hypothesis import assume, given
from hypothesis import strategies as st

from autopilot.angles import shortest_turn, wrap
from autopilot.errors import InputError
from autopilot.guidance.wind_vane import (
    CONFIRM_S,
    FRESH_S,
    RATE_MOST,
    Hold,
    Manoeuvre,
    Wind,
    WindGuide,
    WindSettings,
    hold_of,
    true_angle,
)
from autopilot.signals import SpeedSample, WindSample

ANGLES = st.floats(-math.pi, math.pi)
DEG = math.pi / 180.0


@dataclass
class Boat:
    """A boat that goes where it is ordered to at once, or stays on its heading, and a vane on it, twice a second."""

    wind_from: float = 1.0
    wind: float = 8.0
    heading: float = 0.2
    speed: float | None = 3.0
    water: bool = True
    guide: WindGuide = field(default_factory=WindGuide)
    now: float = 0.0
    quick: float = 0.0
    """How fast [rad/s] it turns to its order; 0: not at all."""
    order: float = math.nan
    count: int = 0

    def apparent(self) -> tuple[float, float]:
        true, u = self.wind_from - self.heading, self.speed or 0.0
        ahead, starboard = self.wind * math.cos(true) + u, self.wind * math.sin(true)
        return math.atan2(starboard, ahead), math.hypot(ahead, starboard)

    def sample(self) -> WindSample:
        self.count += 1
        angle, speed = self.apparent()
        # to the last digit no two are alike
        return WindSample(self.now, wrap(angle + 1.0e-6 * (self.count % 2)), speed)

    def sail(self, seconds: float, hears: bool = True, sample: WindSample | None = None) -> float:
        for _ in range(round(2.0 * seconds)):
            self.now += 0.5
            if self.speed is not None:
                self.guide.vane.on_speed(SpeedSample(self.now, self.speed, not self.water))
            if hears:
                given = self.sample() if sample is None else sample._replace(time=self.now)
                self.guide.vane.on_wind(given, self.heading)
            if self.guide.following:
                self.order = self.guide.course(self.now, self.heading, 0.0)
                most = 0.5 * self.quick
                turn = shortest_turn(self.heading, self.order)
                self.heading = wrap(self.heading + min(max(turn, -most), most))
        return self.order

    def hold(self, is_true: bool = False, angle: float | None = None) -> None:
        self.sail(10.0)
        self.guide.follow(self.now, is_true, angle)
        self.sail(0.5)

    def turn_over(self, manoeuvre: Manoeuvre, *given: int) -> None:
        self.guide.ask(self.now, manoeuvre, *given)
        self.guide.confirm(self.now)


@given(ANGLES, st.floats(1.0, 25.0), st.floats(0.0, 12.0))
def test_the_angle_that_is_held_is_had_on_the_heading_that_is_ordered(true: float, speed: float, way: float) -> None:
    wind = Wind(0.7, speed, way)
    ahead, starboard = speed * math.cos(true) + way, speed * math.sin(true)
    assume(math.hypot(ahead, starboard) > 0.1)
    # where the apparent wind has got as far aft as it gets, a whole range of headings has nearly the same
    assume(abs(way * way - speed * speed) > 0.05)
    hold = hold_of(0.7 - true, wind, False)
    assert abs(wrap(hold.angle - math.atan2(starboard, ahead))) < 1.0e-6
    found = true_angle(hold, wind)
    back = math.atan2(speed * math.sin(found), speed * math.cos(found) + way)
    assert abs(wrap(back - hold.angle)) < 1.0e-5


@given(ANGLES, st.floats(1.0, 25.0), st.floats(0.0, 15.0), st.booleans())
def test_no_apparent_angle_leads_to_the_other_side(angle: float, speed: float, way: float, outruns: bool) -> None:
    true = true_angle(Hold(angle, False, outruns), Wind(0.0, speed, way))
    assert true * angle >= 0.0 or abs(true) > math.pi - 1.0e-9


@given(st.floats(0.0, 1.0), st.floats(1.0, 10.0), st.floats(1.01, 4.0), st.booleans())
def test_an_angle_too_far_aft_is_held_as_far_aft_as_it_gets(
    beyond: float, speed: float, ratio: float, outruns: bool
) -> None:
    most = math.asin(1.0 / ratio)
    asked = most + beyond * (math.pi - most)
    true = true_angle(Hold(asked, False, outruns), Wind(0.0, speed, ratio * speed))
    assert math.atan2(math.sin(true), math.cos(true) + ratio) == pytest.approx(most, abs=1.0e-6)


@given(ANGLES, st.floats(1.0, 25.0), st.floats(0.0, 12.0), st.booleans(), st.booleans())
def test_port_and_starboard_are_mirror_images(
    angle: float, speed: float, way: float, is_true: bool, outruns: bool
) -> None:
    wind = Wind(0.0, speed, way)
    one = true_angle(Hold(angle, is_true, outruns), wind)
    other = true_angle(Hold(-angle, is_true, outruns), wind)
    assert abs(wrap(one + other)) < 1.0e-9


@given(ANGLES, ANGLES, st.sampled_from([None, 3.0]), st.booleans())
def test_a_hold_begins_without_a_bump(bearing: float, heading: float, speed: float | None, is_true: bool) -> None:
    boat = Boat(bearing, 8.0, heading, speed)
    if is_true and speed is None:
        with pytest.raises(InputError, match="no speed"):
            boat.hold(True)
        return
    boat.hold(is_true)
    assert abs(shortest_turn(heading, boat.order)) < 1.0e-5


@given(st.floats(-180.0, 180.0), st.sampled_from([True, False]), st.floats(-40.0, 40.0))
def test_a_given_angle_is_reached_and_a_shift_is_followed(degrees: float, is_true: bool, shift: float) -> None:
    boat = Boat(quick=10.0 * DEG)
    boat.hold(is_true, degrees * DEG)
    boat.sail(60.0)
    boat.wind_from += shift * DEG
    boat.sail(90.0)
    true = wrap(boat.wind_from - boat.heading)
    found = true if is_true else boat.apparent()[0]
    assert abs(wrap(found - degrees * DEG)) < 0.2 * DEG


def test_the_order_is_not_quicker_than_it_may_be_and_a_gust_from_the_same_side_is_none() -> None:
    boat = Boat()
    boat.hold(is_true=True)
    before = boat.order
    boat.wind = 14.0
    boat.sail(30.0)
    assert abs(boat.order - before) < 1.0e-5
    boat.wind_from += 50.0 * DEG
    was = boat.order
    for _ in range(30):
        boat.sail(0.5)
        assert abs(shortest_turn(was, boat.order)) <= 0.5 * RATE_MOST + 1.0e-9
        was = boat.order


def test_the_boats_own_yaw_does_not_move_the_heading_ordered() -> None:
    boat = Boat()
    boat.hold()
    for step in range(40):
        boat.heading = 0.2 + 0.3 * math.sin(step)
        assert boat.sail(0.5) == pytest.approx(0.2, abs=1.0e-5)


def test_a_lost_wind_leads_nobody_again_until_that_is_ordered() -> None:
    boat = Boat()
    boat.hold()
    boat.sail(FRESH_S, hears=False)
    assert boat.guide.alarm is None
    boat.sail(1.0, hears=False)
    assert words(boat.guide.alarm).startswith("wind lost: no wind is heard: holding 011.5 deg")
    boat.wind_from += 0.5
    assert boat.sail(20.0) == pytest.approx(0.2, abs=1.0e-5)
    assert "wind lost" in words(boat.guide.alarm)
    boat.guide.follow(boat.now)
    assert boat.sail(0.5) == pytest.approx(boat.heading, abs=1.0e-5)
    assert boat.guide.alarm is None


def test_a_vane_that_stands_still_leads_nobody_and_the_heading_from_before_it_did_is_held() -> None:
    boat = Boat(quick=2.0 * DEG)
    boat.hold()
    before = boat.order
    stuck = boat.sample()._replace(angle=boat.apparent()[0] + 20.0 * DEG)
    for _ in range(60):
        boat.sail(0.5, sample=stuck)
        if boat.guide.lost:
            break
    assert boat.now < 45.0 and "stands still" in words(boat.guide.alarm)
    boat.sail(20.0, sample=stuck)
    assert abs(shortest_turn(before, boat.heading)) < 3.0 * DEG
    with pytest.raises(InputError, match="stands still"):
        boat.guide.follow(boat.now)


def test_a_vane_that_stands_still_on_a_straight_course_is_found_in_half_a_minute() -> None:
    boat = Boat()
    boat.hold()
    stuck = boat.sample()
    boat.sail(29.0, sample=stuck)
    assert not boat.guide.lost
    boat.sail(3.0, sample=stuck)
    assert boat.guide.lost == "the wind vane stands still"


def test_a_true_wind_without_a_speed_is_lost_and_an_apparent_one_is_not() -> None:
    for is_true in (True, False):
        boat = Boat()
        boat.hold(is_true)
        boat.speed = None
        boat.sail(12.0)
        assert bool(boat.guide.lost) is is_true


@given(st.floats(61.0, 180.0), st.integers(1, 6))
def test_a_single_jump_is_no_wind(degrees: float, every: int) -> None:
    boat = Boat()
    boat.hold()
    for _ in range(20):
        boat.sail(0.5, sample=boat.sample()._replace(angle=wrap(boat.apparent()[0] + degrees * DEG)))
        boat.sail(0.5 * every)
        # the true wind's jump may be less than that of the apparent one
        assert abs(shortest_turn(0.2, boat.order)) < 12.0 * DEG


def test_a_jump_that_stays_is_believed_bounded_and_reported() -> None:
    boat = Boat()
    boat.hold(is_true=True)
    boat.sail(40.0)
    boat.wind_from += 90.0 * DEG
    boat.sail(2.0)
    assert abs(shortest_turn(0.2, boat.order)) <= 2.0 * RATE_MOST + 1.0e-9
    boat.sail(60.0)
    assert words(boat.guide.alarm) == ""
    for _ in range(240):
        boat.guide.watch(boat.now, "order")
        boat.sail(0.5)
    assert shortest_turn(0.2, boat.order) == pytest.approx(90.0 * DEG, abs=0.5 * DEG)


def test_of_two_vanes_the_first_is_gone_by_until_it_is_silent() -> None:
    boat = Boat()
    boat.hold()
    for _ in range(40):
        boat.sail(0.5)
        boat.guide.vane.on_wind(WindSample(boat.now, wrap(boat.apparent()[0] + 1.5), 8.0, "other"), boat.heading)
    assert boat.sail(0.5) == pytest.approx(0.2, abs=1.0e-5)
    guide = WindGuide()
    guide.vane.on_wind(WindSample(0.0, 1.0, 8.0, "first"), 0.0)
    guide.vane.on_wind(WindSample(FRESH_S + 0.1, 0.5, 8.0, "other"), 0.0)
    assert guide.vane.wind.bearing == pytest.approx(0.5)


def watched(boat: Boat, seconds: float, order: object = "order") -> str:
    for _ in range(round(2.0 * seconds)):
        boat.sail(0.5)
        boat.guide.watch(boat.now, order)
    return words(boat.guide.alarm)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_shift_is_reported_against_the_heading_held_and_ends_with_it_and_with_another_order(side: float) -> None:
    boat = Boat(guide=WindGuide(WindSettings(shift=20.0 * DEG)))
    assert watched(boat, 60.0) == ""
    boat.wind_from += side * 17.0 * DEG
    assert watched(boat, 90.0) == ""
    boat.wind_from += side * 6.0 * DEG
    assert watched(boat, 90.0) == "the wind has shifted by more than 20 deg: check the course"
    boat.wind_from -= side * 12.0 * DEG
    assert watched(boat, 90.0) == ""
    boat.wind_from += side * 12.0 * DEG
    assert watched(boat, 90.0) != ""
    assert watched(boat, 1.0, "another") == ""
    assert watched(boat, 90.0, "another") == ""


def test_a_light_air_that_goes_round_is_no_shift_and_a_wind_that_comes_from_elsewhere_is() -> None:
    boat = Boat(wind=1.0)
    for _ in range(12):
        boat.wind_from += 40.0 * DEG
        assert watched(boat, 20.0) == ""
    boat.wind, boat.wind_from = 6.0, 1.0
    assert watched(boat, 90.0) == ""
    boat.wind = 1.0
    assert watched(boat, 60.0) == ""
    boat.wind, boat.wind_from = 6.0, 1.0 + 60.0 * DEG
    assert "shifted" in watched(boat, 90.0)


@pytest.mark.parametrize("manoeuvre", list(Manoeuvre))
@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("is_true", [True, False])
@pytest.mark.parametrize("degrees", [25.0, 45.0, 89.0, 100.0, 140.0])
def test_a_turn_goes_its_way_round_to_the_mirrored_angle(
    manoeuvre: Manoeuvre, side: float, is_true: bool, degrees: float
) -> None:
    boat = Boat(quick=6.0 * DEG)
    boat.hold(is_true, side * degrees * DEG)
    boat.sail(60.0)
    before = wrap(boat.wind_from - boat.heading)
    asked = boat.guide.ask(boat.now, manoeuvre)
    boat.sail(CONFIRM_S - 1.0)
    assert wrap(boat.wind_from - boat.heading) == pytest.approx(before, abs=0.1 * DEG), "nothing turns before"
    boat.guide.confirm(boat.now)
    through = []
    for _ in range(240):
        was = boat.heading
        boat.sail(0.5)
        if abs(shortest_turn(was, boat.heading)) > 1.0 * DEG:
            assert shortest_turn(was, boat.heading) * asked.side > 0.0
        through.append(abs(wrap(boat.wind_from - boat.heading)))
    extreme = min(through) if manoeuvre is Manoeuvre.TACK else math.pi - max(through)
    assert extreme < 4.0 * DEG
    found = wrap(boat.wind_from - boat.heading) if is_true else boat.apparent()[0]
    assert found == pytest.approx(-side * degrees * DEG, abs=0.3 * DEG)


def test_a_tack_that_hangs_in_irons_is_said_until_the_boat_turns_on() -> None:
    boat = Boat(quick=6.0 * DEG)
    boat.hold(True, 45.0 * DEG)
    boat.sail(30.0)
    boat.turn_over(Manoeuvre.TACK)
    boat.sail(8.0)
    assert abs(wrap(boat.wind_from - boat.heading)) < 5.0 * DEG
    boat.quick = 1.0e-4
    boat.sail(11.0)
    assert boat.guide.alarm is None
    boat.sail(4.0)
    said = words(boat.guide.alarm)
    assert said.startswith("the tack or gybe has stalled, 4") and "back the jib" in said
    boat.quick = 6.0 * DEG
    boat.sail(2.0)
    assert boat.guide.alarm is None
    boat.sail(30.0)
    assert boat.guide.alarm is None and wrap(boat.wind_from - boat.heading) == pytest.approx(-45.0 * DEG, abs=0.02)


def test_a_boat_in_irons_is_said_for_as_long_and_may_be_turned_back() -> None:
    boat = Boat(quick=6.0 * DEG)
    boat.hold(True, 45.0 * DEG)
    boat.sail(30.0)
    boat.turn_over(Manoeuvre.TACK)
    boat.sail(8.0)
    boat.quick = 1.0e-4
    boat.sail(20.0)
    with pytest.raises(InputError, match="still turning"):
        boat.guide.ask(boat.now, Manoeuvre.TACK)
    for _ in range(240):
        boat.sail(0.5)
        assert "has stalled" in words(boat.guide.alarm)
    boat.wind_from += 20.0 * DEG
    boat.sail(60.0)
    assert words(boat.guide.alarm).startswith("the tack or gybe has stalled, 6"), "the wind has veered by 20 deg"
    boat.turn_over(Manoeuvre.TACK)
    boat.quick = 6.0 * DEG
    boat.sail(60.0)
    assert boat.guide.alarm is None and wrap(boat.wind_from - boat.heading) == pytest.approx(45.0 * DEG, abs=0.02)


@pytest.mark.parametrize(("order", "angle", "turned"), [("TACK", 45.0, 90.0), ("GYBE", 140.0, -80.0), ("", 60.0, 12.0)])
def test_a_vane_that_froze_before_an_order_does_not_take_it_back(order: str, angle: float, turned: float) -> None:
    boat = Boat(quick=6.0 * DEG)
    boat.hold(True, angle * DEG)
    boat.sail(30.0)
    before, frozen = boat.heading, boat.sample()
    boat.sail(2.0, sample=frozen)
    if order:
        boat.turn_over(Manoeuvre[order])
    else:
        boat.guide.turn_by(turned * DEG)
    boat.sail(60.0, sample=frozen)
    assert "stands still" in boat.guide.lost
    assert shortest_turn(before, boat.heading) == pytest.approx(turned * DEG, abs=0.05)


@pytest.mark.parametrize("back", [40.0, 70.0])
def test_a_boat_that_hangs_in_irons_may_be_ordered_back_to_its_side(back: float) -> None:
    boat = Boat(quick=6.0 * DEG)
    boat.hold(True, 45.0 * DEG)
    boat.sail(30.0)
    boat.turn_over(Manoeuvre.TACK)
    boat.sail(6.0)
    boat.quick = 1.0e-4
    boat.sail(70.0)
    assert boat.guide.hold is not None
    boat.guide.turn_by(boat.guide.hold.angle - back * DEG)
    boat.quick = 6.0 * DEG
    boat.sail(30.0)
    assert wrap(boat.wind_from - boat.heading) == pytest.approx(back * DEG, abs=0.02)
    with pytest.raises(InputError, match="that is a tack"):
        boat.guide.turn_by(2.0 * back * DEG)


def test_a_calm_is_named_and_is_no_silent_vane() -> None:
    boat = Boat(speed=0.0)
    boat.hold()
    boat.wind = 0.3
    boat.sail(FRESH_S + 2.0)
    assert words(boat.guide.alarm).startswith("wind lost: the wind is below 0.5 m/s: holding")


@pytest.mark.parametrize("rate", [0.5, 2.0, 6.0])
def test_a_slow_turn_is_no_stall(rate: float) -> None:
    boat = Boat(quick=rate * DEG)
    boat.hold(True, 25.0 * DEG)
    boat.sail(120.0)
    boat.turn_over(Manoeuvre.TACK)
    for _ in range(160):
        boat.sail(0.5)
        assert boat.guide.alarm is None


def test_a_turn_that_nobody_confirms_is_cancelled() -> None:
    boat = Boat()
    boat.hold()
    for manoeuvre in Manoeuvre:
        boat.guide.ask(boat.now, manoeuvre)
        assert "confirm it within 10 s" in words(boat.guide.alarm)
        boat.sail(CONFIRM_S + 0.5)
        assert boat.guide.asked is None and boat.guide.alarm is None
        with pytest.raises(InputError, match="waits"):
            boat.guide.confirm(boat.now)
    boat.guide.ask(boat.now, Manoeuvre.TACK)
    boat.guide.decline()
    with pytest.raises(InputError, match="waits"):
        boat.guide.confirm(boat.now)
    assert boat.sail(5.0) == pytest.approx(0.2, abs=1.0e-5)


def test_a_confirmation_that_is_repeated_turns_once() -> None:
    boat = Boat(quick=6.0 * DEG)
    boat.hold()
    boat.turn_over(Manoeuvre.TACK)
    angle = boat.guide.hold
    boat.sail(1.0)
    boat.guide.confirm(boat.now)
    assert boat.guide.hold == angle
    with pytest.raises(InputError, match="still turning"):
        boat.guide.ask(boat.now, Manoeuvre.TACK)


@pytest.mark.parametrize(("degrees", "says"), [(3.0, "ahead"), (-177.0, "astern")])
def test_there_is_no_other_side_head_to_wind_or_running_before_it(degrees: float, says: str) -> None:
    boat = Boat()
    boat.hold(True, degrees * DEG)
    for manoeuvre in Manoeuvre:
        with pytest.raises(InputError, match=says):
            boat.guide.ask(boat.now, manoeuvre)


def test_a_turn_to_the_wrong_side_or_without_a_speed_or_a_wind_is_refused() -> None:
    boat = Boat()
    with pytest.raises(InputError, match="no wind is being held"):
        boat.guide.ask(0.0, Manoeuvre.TACK)
    boat.hold()
    assert boat.guide.ask(boat.now, Manoeuvre.TACK, 1).side == 1
    with pytest.raises(InputError, match="from starboard a tack turns to starboard, not to port"):
        boat.guide.ask(boat.now, Manoeuvre.TACK, -1)
    with pytest.raises(InputError, match="from starboard a gybe turns to port"):
        boat.guide.ask(boat.now, Manoeuvre.GYBE, 1)
    boat = Boat(speed=None)
    boat.hold()
    with pytest.raises(InputError, match="no speed is heard"):
        boat.guide.ask(boat.now, Manoeuvre.TACK)


@given(st.floats(-40.0, 40.0))
def test_a_change_of_angle_turns_the_boat_to_its_side(degrees: float) -> None:
    boat = Boat(quick=10.0 * DEG)
    boat.hold(True)
    boat.guide.turn_by(degrees * DEG)
    boat.sail(20.0)
    assert shortest_turn(0.2, boat.heading) == pytest.approx(degrees * DEG, abs=1.0e-3)


@pytest.mark.parametrize(
    "sample",
    [
        WindSample(0.0, math.nan, 8.0),
        WindSample(0.0, 1.0, math.nan),
        WindSample(math.nan, 1.0, 8.0),
        WindSample(0.0, 1.0, 0.2),
        WindSample(0.0, math.inf, 8.0),
    ],
)
def test_a_calm_and_what_is_not_finite_are_no_wind(sample: WindSample) -> None:
    guide = WindGuide()
    guide.vane.on_wind(sample, 0.0)
    assert not guide.is_known(0.0)
    guide.vane.on_wind(WindSample(0.0, 1.0, 8.0), 0.0)
    assert guide.is_known(0.0)
    assert not guide.is_known(FRESH_S + 0.1)
