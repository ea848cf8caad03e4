"""Following a chart plotter: convergence to the track, waypoints, silence, and what it must never do."""

from __future__ import annotations

import math
import random

import pytest
from alarm_texts import words
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import shortest_turn, wrap
from autopilot.guidance.plotter import PlotterGuide, PlotterHeading, PlotterInvalid, PlotterLeg, PlotterMessage
from autopilot.guidance.track import Set

SPEED = 4.0


class Boat:
    """A boat that turns to its course at up to 10 deg/s, in a current, on a straight leg through the origin."""

    def __init__(self, track: float, off: float, heading: float, current: float = 0.0, step: float = 0.0) -> None:
        self.guide = PlotterGuide()
        self.track, self.step = track, step
        self.heading = heading
        self.north, self.east = -off * math.sin(track), off * math.cos(track)
        self.current = current
        self.now = 0.0
        self.waypoint = "WP1"

    @property
    def off(self) -> float:
        """Distance to starboard of the track."""
        return self.east * math.cos(self.track) - self.north * math.sin(self.track)

    def message(self) -> PlotterLeg:
        off = round(self.off / self.step) * self.step if self.step else self.off
        return PlotterLeg(self.now, self.track, off, self.step, self.waypoint)

    def sail(self, seconds: float, talking: bool = True) -> list[float]:
        offs = []
        for tick in range(round(seconds * 10)):
            self.now += 0.1
            if talking and tick % 10 == 0:
                self.guide.take(self.message())
            course = self.guide.course(self.now, self.heading, SPEED)
            turn = shortest_turn(self.heading, course)
            self.heading = wrap(self.heading + math.copysign(min(abs(turn), math.radians(1.0)), turn))
            # the current sets across the track, to starboard
            self.north += 0.1 * (SPEED * math.cos(self.heading) - self.current * math.sin(self.track))
            self.east += 0.1 * (SPEED * math.sin(self.heading) + self.current * math.cos(self.track))
            offs.append(self.off)
        return offs


@pytest.mark.parametrize("track", [0.0, math.radians(90), math.radians(179.9), math.radians(-135)])
@pytest.mark.parametrize("off", [-120.0, 0.0, 60.0])
def test_the_boat_comes_to_the_track_and_stays(track: float, off: float) -> None:
    boat = Boat(track, off, track)
    boat.guide.follow()
    boat.sail(200.0)
    offs = boat.sail(20.0)
    assert max(abs(value) for value in offs) < 3.0
    assert abs(shortest_turn(boat.heading, track)) < math.radians(3.0)
    assert boat.guide.alarm is None


@pytest.mark.parametrize("current", [-1.0, 1.0])
def test_a_current_across_is_taken_out(current: float) -> None:
    boat = Boat(0.0, 0.0, 0.0, current)
    boat.guide.follow()
    first = boat.sail(60.0)
    offs = boat.sail(500.0)[-200:]
    assert max(abs(value) for value in first) > 5.0, "before the integral has learnt it, the current sets the boat off"
    assert max(abs(value) for value in offs) < 2.0
    assert shortest_turn(0.0, boat.heading) == pytest.approx(-math.asin(current / SPEED), abs=0.05), "crabbing upstream"


def test_a_coarse_plotter_does_not_make_the_boat_swing() -> None:
    """Two decimals of a nautical mile are 18.5 m: each step of the display must not be a turn of its own."""
    boat = Boat(0.0, 12.0, 0.0, step=18.52)
    boat.guide.follow()
    boat.sail(150.0)
    headings = []
    for _ in range(100):
        boat.sail(1.0)
        headings.append(math.degrees(boat.heading))
    assert max(headings) - min(headings) < 15.0
    assert abs(boat.off) < 25.0


def test_the_turn_at_a_waypoint_is_not_begun_on_one_sentence() -> None:
    guide = PlotterGuide()
    guide.follow()
    for second in range(5):
        guide.take(PlotterLeg(float(second), 0.0, 0.0, 0.0, "WP1"))
    assert guide.course(5.0, 0.0, SPEED) == pytest.approx(0.0)
    # the new name with the old bearing, the old name with the new error: neither is steered
    guide.take(PlotterLeg(5.0, 0.0, 300.0, 0.0, "WP2"))
    assert guide.course(5.1, 0.0, SPEED) == pytest.approx(0.0)
    guide.take(PlotterLeg(6.0, math.radians(80.0), 300.0, 0.0, "WP2"))
    assert guide.course(6.1, 0.0, SPEED) == pytest.approx(0.0)
    guide.take(PlotterLeg(7.0, math.radians(80.0), 0.0, 0.0, "WP2"))
    assert guide.course(7.1, 0.0, SPEED) == pytest.approx(math.radians(80.0))
    assert guide.alarm is None


def test_a_turn_too_far_waits_for_the_skipper() -> None:
    guide = PlotterGuide()
    guide.follow()
    for second in range(3):
        guide.take(PlotterLeg(float(second), 0.0, 0.0, 0.0, "WP1"))
        guide.course(second + 0.5, 0.0, SPEED)
    for second in range(3, 20):
        guide.take(PlotterLeg(float(second), math.radians(170.0), 0.0, 0.0, "WP2"))
        assert guide.course(second + 0.5, 0.0, SPEED) == pytest.approx(0.0)
    assert "wants a turn to 170.0 deg" in words(guide.alarm)
    assert "type f to turn" in words(guide.alarm)
    guide.follow()
    guide.take(PlotterLeg(20.0, math.radians(170.0), 0.0, 0.0, "WP2"))
    assert guide.course(20.5, 0.0, SPEED) == pytest.approx(math.radians(170.0))
    assert guide.alarm is None


def test_silence_holds_the_course_and_says_so_after_eight_seconds() -> None:
    guide = PlotterGuide()
    guide.follow()
    for second in range(3):
        guide.take(PlotterLeg(float(second), 1.0, 0.0, 0.0, "WP1"))
    guide.course(2.0, 0.5, SPEED)
    assert guide.course(9.9, 0.5, SPEED) == pytest.approx(1.0)
    assert guide.alarm is None
    assert guide.course(10.1, 0.5, SPEED) == pytest.approx(1.0)
    assert "has been silent for 8 s or more: holding 057.3 deg" in words(guide.alarm)
    guide.take(PlotterLeg(11.0, 1.2, 0.0, 0.0, "WP1"))
    guide.take(PlotterLeg(12.0, 1.2, 0.0, 0.0, "WP1"))
    assert guide.course(12.1, 0.5, SPEED) == pytest.approx(1.2)
    assert guide.alarm is None


@pytest.mark.parametrize("led", [0, 5], ids=["from the first", "after a while"])
@pytest.mark.parametrize("what", ["two plotters", "a name with the range in it"])
def test_legs_that_never_agree_lead_nowhere_and_that_is_said(what: str, led: int) -> None:
    guide = PlotterGuide()
    guide.follow()
    said = []
    for second in range(40):
        leg = PlotterLeg(float(second), 1.0, 0.0, 0.0, "WP1")
        if led <= second < 30 and what == "two plotters":
            leg = leg._replace(track=1.2 if second % 2 else 0.8)
        elif led <= second < 30:
            leg = leg._replace(waypoint=f"WP1 {30 - second}.0 nm")
        guide.take(leg)
        guide.course(second + 0.5, 1.0, SPEED)
        said.append("" if guide.alarm is None else guide.alarm.name)
    since = 12 if led else 8  # 8 s after the last that agreed
    assert said == [""] * since + ["plotter_invalid"] * (31 - since) + [""] * 9
    guide.take(PlotterInvalid(40.0, "APB holds no valid data"))
    guide.course(55.0, 1.0, SPEED)
    assert guide.alarm is not None
    guide.take(PlotterLeg(56.0, 1.0, 0.0, 0.0, "WP1"))
    guide.course(56.1, 1.0, SPEED)
    assert guide.alarm is None, "the first of two that agree"


@pytest.mark.parametrize("drift", [0.98, 1.02])
def test_of_two_plotters_the_one_that_leads_goes_on_leading(drift: float) -> None:
    """Each once a second by a clock of its own: every minute one speaks twice between two words of the other."""
    guide = PlotterGuide()
    guide.follow()
    said = [PlotterLeg(float(second), 1.0, 0.0, 0.0, "WP1") for second in range(200)]
    said += [PlotterLeg(5.3 + drift * second, 0.6, 0.0, 0.0, "HOME") for second in range(190)]
    for leg in sorted(said):
        guide.take(leg)
        assert guide.course(leg.time, 1.0, SPEED) == pytest.approx(1.0), leg
    assert guide.alarm is None
    for second in range(200, 203):
        guide.take(PlotterLeg(float(second), 0.6, 0.0, 0.0, "HOME"))
    assert guide.course(203.0, 1.0, SPEED) == pytest.approx(0.6), "the other is silent"


def two_plotters(first_every: float, first: float, second: float) -> PlotterGuide:
    """Return the guide that one plotter leads for 10 s, and for 20 s more with another beside it; degrees."""
    guide = PlotterGuide()
    guide.follow()
    said = [(first_every * number, first, "A") for number in range(round(30.0 / first_every))]
    said += [(10.9 + number, second, "B") for number in range(20)]
    for now, track, name in sorted(said):
        guide.take(PlotterLeg(now, math.radians(track), 0.0, 0.0, name))
        course = guide.course(now, 0.0, SPEED)
        if now > 2.0 * first_every:
            assert math.degrees(course) == pytest.approx(first, abs=0.1)
            assert guide.alarm is None, "a turn that nobody waits for is not to be confirmed"
    return guide


@pytest.mark.parametrize("every", [0.2, 1.0, 2.0])
def test_who_leads_seldom_goes_on_leading_beside_one_who_speaks_more_often(every: float) -> None:
    two_plotters(every, 90.0, 150.0)


def test_a_second_plotter_that_leads_far_off_is_no_turn_to_confirm() -> None:
    two_plotters(1.0, 90.0, 270.0)


def test_to_follow_said_once_more_confirms_no_turn_to_come() -> None:
    guide = PlotterGuide()
    guide.follow()
    for second in range(20):
        guide.take(PlotterLeg(float(second), math.radians(90.0), 0.0, 0.0, "A"))
        guide.course(float(second), 0.0, SPEED)
        if second == 10:
            guide.follow()
    for second in range(20, 40):
        guide.take(PlotterLeg(float(second), math.radians(240.0), 0.0, 0.0, "B"))
        course = guide.course(float(second), 0.0, SPEED)
    assert math.degrees(course) == pytest.approx(90.0, abs=0.1)
    assert guide.alarm is not None and guide.alarm.name == "plotter_turn"


def test_the_turn_is_measured_from_leg_to_leg_and_said_once() -> None:
    """Far off to starboard the course leads back at -70 deg; the next leg at +90 deg is no turn of 160 deg."""
    guide = PlotterGuide()
    guide.follow()
    for second in range(5):
        guide.take(PlotterLeg(float(second), 0.0, 200.0, 0.0, "WP1"))
        guide.course(second + 0.1, 0.0, SPEED)
    assert guide.course(5.0, 0.0, SPEED) < math.radians(-70.0)
    for second in (5, 6):
        guide.take(PlotterLeg(float(second), math.radians(90.0), 0.0, 0.0, "WP2"))
    assert guide.course(6.1, 0.0, SPEED) == pytest.approx(math.radians(90.0))
    said = set()
    for step in range(70):
        guide.take(PlotterLeg(7.0 + step / 10.0, math.radians(-80.0), 0.0, 0.0, "WP3"))
        guide.course(7.05 + step / 10.0, 0.0, SPEED)
        if step >= 10:  # 1.5 s after the leg before was said last
            said.add(words(guide.alarm))
    assert len(said) == 1 and said != {""}, "an alarm that changes with every tick is a new alarm each time"


def test_nothing_is_said_of_silence_before_there_was_time_to_speak() -> None:
    guide = PlotterGuide()
    guide.follow()
    guide.course(100.0, 0.0, SPEED)
    assert guide.alarm is None
    guide.course(107.9, 0.0, SPEED)
    assert guide.alarm is None
    guide.course(108.1, 0.0, SPEED)
    assert "has been silent" in words(guide.alarm)


def test_a_plotter_that_does_not_lead_holds_the_present_heading() -> None:
    guide = PlotterGuide()
    guide.follow()
    guide.take(PlotterInvalid(0.0, "APB holds no valid data"))
    assert guide.course(0.1, 2.0, SPEED) == 2.0
    assert words(guide.alarm) == "the chart plotter does not lead (APB holds no valid data): holding 114.6 deg"
    guide.leave()
    assert guide.alarm is None


def test_what_a_plotter_that_does_not_lead_says_in_turn_is_one_alarm() -> None:
    guide = PlotterGuide()
    guide.follow()
    said = set()
    for second in range(10):
        for part, reason in ((0.0, "129284 holds no valid data"), (0.5, "its navigation has ended")):
            guide.take(PlotterInvalid(second + part, reason))
            guide.course(second + part + 0.1, 2.0, SPEED)
            said.add(guide.alarm)
    _, both = sorted(said, key=lambda alarm: len(words(alarm)))
    assert "(129284 holds no valid data, its navigation has ended)" in words(both)
    for second in range(10, 19):
        guide.take(PlotterInvalid(float(second), "its navigation has ended"))
        guide.course(second + 0.1, 2.0, SPEED)
    assert "(its navigation has ended)" in words(guide.alarm)
    guide.leave()
    assert guide.alarm is None


def test_a_heading_to_steer_is_followed_but_one_wild_value_is_not() -> None:
    guide = PlotterGuide()
    guide.follow()
    headings = [1.0, 1.02, 1.05, 3.0, 1.08, 1.1]
    courses = []
    for second, heading in enumerate(headings):
        guide.take(PlotterHeading(float(second), heading))
        courses.append(guide.course(second + 0.1, 0.9, SPEED))
    assert courses == pytest.approx([0.9, 1.02, 1.05, 1.05, 1.08, 1.1])


@given(
    messages=st.lists(
        st.one_of(
            st.builds(
                PlotterLeg,
                st.floats(0.0, 60.0),
                st.floats(-math.pi, math.pi),
                st.floats(-2.0e5, 2.0e5),
                st.floats(0.0, 2000.0),
                st.sampled_from(["", "A", "B"]),
            ),
            st.builds(PlotterHeading, st.floats(0.0, 60.0), st.floats(-math.pi, math.pi)),
            st.builds(PlotterInvalid, st.floats(0.0, 60.0), st.just("V")),
        ),
        max_size=30,
    ),
    speed=st.floats(-20.0, 60.0),
)
def test_whatever_is_said_the_course_is_a_course(messages: list[PlotterLeg], speed: float) -> None:
    guide = PlotterGuide()
    guide.follow()
    for step, message in enumerate(messages):
        guide.take(message)
        course = guide.course(step * 2.0, 0.3, speed)
        assert -math.pi <= course <= math.pi
        if isinstance(message, PlotterLeg) and guide.cross_track == guide.cross_track:
            assert abs(guide.cross_track) <= 2.0e5


@pytest.mark.parametrize("current", [-2.0, 2.0])
def test_a_current_that_positions_have_taught_sets_the_boat_off_no_track(current: float) -> None:
    """Half the boat's speed across; when the positions end, the integral goes on from what it would have come to."""
    boat = Boat(0.0, 0.0, -math.asin(current / SPEED), current)
    boat.guide.follow()
    boat.guide.stream = Set(0.0, current, SPEED)
    assert max(abs(value) for value in boat.sail(60.0)) < 3.0
    assert max(abs(value) for value in boat.sail(20.0)) < 0.3
    boat.guide.stream = None
    assert max(abs(value) for value in boat.sail(60.0)) < 1.5


def test_a_waypoint_that_is_passed_and_not_followed_by_a_leg_is_said_after_five_seconds() -> None:
    guide = PlotterGuide()
    guide.follow()
    said = []
    for tick in range(200):
        now = 0.1 * tick
        if tick % 10 == 0:
            guide.take(PlotterLeg(now, 1.0, 0.0, 1.0, "W1", "Harbour", passed=5.0 <= now < 13.0))
        guide.course(now, 1.0, SPEED)
        said.append(guide.alarm)
    alarms = [each.name if each is not None else "" for each in said]
    assert alarms == [""] * 100 + ["plotter_arrived"] * 30 + [""] * 70
    assert words(said[110]) == (
        "the chart plotter leads no further than Harbour: holding 057.3 deg; give a heading or take the helm"
    )
    guide.take(PlotterLeg(20.0, 1.0, 0.0, 1.0, "W1", "Harbour", passed=True))
    guide.take(PlotterLeg(21.0, 1.4, 0.0, 1.0, "W2", "Anchorage"))
    guide.take(PlotterLeg(22.0, 1.4, 0.0, 1.0, "W2", "Anchorage"))
    guide.course(26.0, 1.0, SPEED)
    assert guide.alarm is None, "the next leg has come"


class TwoPlotters:
    """One that is followed and another; each says its leg once a second while it has one."""

    def __init__(self) -> None:
        self.guide, self.now = PlotterGuide(), 0.0
        self.said: list[str] = []
        self.guide.follow()

    def sail(self, seconds: int, **tracks: PlotterMessage | float | None) -> float:
        for _ in range(seconds):
            self.now += 1.0
            for source, track in tracks.items():
                if isinstance(track, float):
                    self.guide.take(PlotterLeg(self.now, track, 0.0, 0.0, f"{source} {track}", source=source))
                elif track is not None:
                    self.guide.take(track._replace(time=self.now, source=source))
            course = self.guide.course(self.now + 0.5, 0.0, SPEED)
            self.said.append("" if self.guide.alarm is None else self.guide.alarm.name)
        return course


def test_a_second_plotter_that_disagrees_keeps_the_first_from_no_leg_of_its_own() -> None:
    two = TwoPlotters()
    two.sail(5, first=0.2)
    assert two.sail(10, first=0.2, second=1.0) == pytest.approx(0.2)
    assert two.sail(3, first=0.6, second=1.0) == pytest.approx(0.6), "its next leg"
    idle = PlotterInvalid(0.0, "APB holds no valid data")
    assert two.sail(20, first=0.6, second=idle) == pytest.approx(0.6)
    assert set(two.said) == {""}


def test_no_other_plotter_takes_over_from_one_that_falls_silent_unless_it_leads_alike() -> None:
    two = TwoPlotters()
    two.sail(2, first=0.2)
    two.sail(5, first=0.2, second=1.0)
    assert two.sail(30, second=1.0) == pytest.approx(0.2)
    assert two.said[-1] == "plotter_silent", "and that is said as long as it is so"
    two.guide.follow()
    assert two.sail(3, second=1.0) == pytest.approx(1.0), "the skipper has asked for it"
    two.sail(3, second=1.0, third=2.0)
    again = PlotterLeg(0.0, 1.02, 10.0, 0.0, "4@57.1,12.2")
    far = again._replace(cross_track=500.0)
    assert two.sail(20, fourth=again, fifth=far, third=2.0) == pytest.approx(1.0, abs=0.6), "by another line"
    assert two.said[-18:] == [""] * 18
    idle = PlotterInvalid(0.0, "its navigation has ended")
    assert two.sail(20, fourth=idle, third=2.0) == pytest.approx(1.0, abs=0.6)
    assert two.said[-1] == "plotter_invalid"


def test_an_error_that_no_boat_gets_to_turns_nothing_until_it_is_confirmed() -> None:
    boat = Boat(0.3, 0.0, 0.3)
    boat.guide.follow()
    boat.sail(20.0)
    for off in (200.0, -150.0):
        held = boat.heading
        for _ in range(60):
            boat.guide.take(boat.message()._replace(cross_track=off))
            boat.sail(1.0, talking=False)
            assert abs(shortest_turn(boat.heading, held)) < math.radians(2.0)
        said = words(boat.guide.alarm)
        assert f"its error has jumped to {abs(off):.0f} m" in said and "type f" in said
        boat.sail(20.0)
        assert boat.guide.alarm is None and abs(boat.off) < 1.0, "it came back"
    for _ in range(5):
        boat.guide.take(boat.message()._replace(cross_track=200.0))
        boat.sail(1.0, talking=False)
    boat.guide.follow()
    for _ in range(5):
        boat.guide.take(boat.message()._replace(cross_track=200.0))
        boat.sail(1.0, talking=False)
    assert boat.guide.alarm is None and shortest_turn(0.3, boat.heading) < -math.radians(30.0)


@pytest.mark.parametrize("step", [1.0, 5.0, 12.0])
def test_an_error_that_comes_back_by_and_by_is_followed_again(step: float) -> None:
    boat = Boat(0.3, 0.0, 0.3)
    boat.guide.follow()
    boat.sail(20.0)
    off = 200.0
    while off > 0.0:
        boat.guide.take(boat.message()._replace(cross_track=off))
        boat.sail(1.0, talking=False)
        off -= step
    boat.sail(60.0)
    assert boat.guide.alarm is None and abs(boat.off) < 3.0


@pytest.mark.parametrize("noise", [0.0, 5.0, 20.0])
def test_an_error_that_stays_jumped_is_not_followed_however_long(noise: float) -> None:
    boat, chance = Boat(0.3, 0.0, 0.3), random.Random(20261129)
    boat.guide.follow()
    boat.sail(20.0)
    held = boat.heading
    for second in range(600):
        off = (200.0 if second < 300 else 230.0) + noise * chance.gauss(0.0, 1.0)
        boat.guide.take(boat.message()._replace(cross_track=off))
        boat.sail(1.0, talking=False)
        assert "has jumped" in words(boat.guide.alarm) and abs(shortest_turn(boat.heading, held)) < math.radians(2.0)


def test_a_far_turn_is_asked_for_though_the_error_has_jumped_before() -> None:
    guide = PlotterGuide()
    guide.follow()
    for second in range(20):
        far = second > 14
        off = 0.0 if second < 10 or far else 200.0
        guide.take(PlotterLeg(float(second), 2.0 if far else 0.0, off, 0.0, "B" if far else "A"))
        guide.course(float(second), 0.0, SPEED)
    assert guide.alarm is not None and guide.alarm.name == "plotter_turn"


def test_an_error_that_grew_in_a_long_silence_is_followed() -> None:
    boat = Boat(0.3, 0.0, 0.3)
    boat.guide.follow()
    boat.sail(20.0)
    boat.sail(60.0, talking=False)
    for _ in range(4):
        boat.guide.take(boat.message()._replace(cross_track=150.0))
        boat.sail(1.0, talking=False)
    assert boat.guide.alarm is None and shortest_turn(0.3, boat.heading) < -math.radians(15.0)


@pytest.mark.parametrize("across", [1.0, -1.0])
def test_a_current_that_the_leg_cannot_be_held_in_is_said(across: float) -> None:
    boat = Boat(0.0, 0.0, 0.0)
    boat.guide.follow()
    boat.guide.stream = Set(0.0, across * 0.95 * SPEED, SPEED)
    boat.sail(10.0)
    assert boat.guide.alarm is None
    boat.sail(10.0)
    said = words(boat.guide.alarm)
    assert (
        said.startswith("the current is too strong for the route, the plotter's leg: 3.8 m/s of current")
        and "go faster" in said
    )
    boat.guide.stream = Set(0.0, across * 0.85 * SPEED, SPEED)
    boat.sail(2.0)
    assert boat.guide.alarm is not None, "it does not come and go"
    boat.guide.stream = Set(0.0, across * 0.5 * SPEED, SPEED)
    boat.sail(2.0)
    assert boat.guide.alarm is None


def test_a_plotter_that_is_followed_anew_is_judged_anew() -> None:
    boat = Boat(0.0, 0.0, 0.0)
    boat.guide.follow()
    boat.guide.stream = Set(0.0, 0.95 * SPEED, SPEED)
    boat.sail(20.0)
    assert boat.guide.alarm is not None
    boat.guide.leave()
    boat.guide.stream = Set(0.0, 0.85 * SPEED, SPEED)
    boat.guide.follow()
    boat.sail(5.0)
    assert boat.guide.alarm is None
    boat.guide.stream = None
    boat.guide.take(boat.message()._replace(cross_track=300.0))
    boat.guide.leave()
    boat.guide.follow()
    boat.sail(0.5, talking=False)
    assert boat.guide.alarm is None


@pytest.mark.parametrize("radius", [60.0, 700.0])
@pytest.mark.parametrize("speed", [2.0, 5.0])
def test_the_way_to_the_leg_bends_half_as_sharp_as_the_boat_turns(radius: float, speed: float) -> None:
    guide = PlotterGuide()
    guide.turn_radius, guide.stream = radius, Set(0.0, 0.0, speed)
    guide.follow()
    off, before, bends = 3.0 * radius, math.nan, []
    for tick in range(60000):
        now = 0.1 * tick
        if tick % 10 == 0:
            guide.take(PlotterLeg(now, 0.0, off, 0.0, "WP1"))
        heading = guide.course(now, 0.0, speed)
        if tick % 10 == 0:
            bends.append(abs(wrap(heading - before)) / speed)
            before = heading
        off += 0.1 * speed * math.sin(heading)
    assert max(bends[3:]) < 0.51 / radius
    assert abs(off) < 0.1


def test_skippers_tell_the_plotter_s_guide_how_the_boat_turns() -> None:
    from boat_at_sea import Sea

    sea = Sea()
    sea.sail(1.0)
    assert sea.skipper.plotter.turn_radius == sea.track.settings.turn_radius > 0.0


def of_two_plotters(guide: PlotterGuide, now: float) -> None:
    """Take what two plotters say at `now` [s]: the second comes after 5 s, the first goes after 10 s."""
    if now < 10.0:
        guide.take(PlotterLeg(now, 0.0, 0.0, 0.0, "A", source="one"))
    if now > 5.0:
        guide.take(PlotterLeg(now, 1.0, 0.0, 0.0, "B", source="two"))


def test_the_alarm_of_a_silent_plotter_names_the_other_that_may_be_followed() -> None:
    guide = PlotterGuide()
    guide.follow()
    for second in range(40):
        now = float(second)
        of_two_plotters(guide, now)
        course = guide.course(now, 0.0, SPEED)
    assert course == 0.0
    assert "silent for 8 s or more: holding 000.0 deg, f follows another that leads elsewhere" in words(guide.alarm)
    guide.follow()
    for second in range(40, 44):
        guide.take(PlotterLeg(float(second), 1.0, 0.0, 0.0, "B", source="two"))
        course = guide.course(float(second), 0.0, SPEED)
    assert course == pytest.approx(1.0) and guide.alarm is None


def test_an_idle_third_plotter_does_not_hide_the_one_that_may_be_followed() -> None:
    guide, said = PlotterGuide(), set()
    guide.follow()
    for second in range(40):
        now = float(second)
        of_two_plotters(guide, now)
        guide.course(now, 0.0, SPEED)
        if second > 20:
            said.add(words(guide.alarm))
        guide.take(PlotterInvalid(now, "its navigation has ended", source="three"))
        guide.course(now + 0.5, 0.0, SPEED)
        if second > 20:
            said.add(words(guide.alarm))
    assert len(said) == 1 and "f follows another" in said.pop()
    guide.take(PlotterInvalid(40.0, "its navigation has ended", source="two"))
    guide.course(40.0, 0.0, SPEED)
    assert "f follows" not in words(guide.alarm)
