"""The skipper with a route and with trials, on the whole pilot and a boat: who has the helm, and who gets it back."""

from __future__ import annotations

import math

import pytest
from alarm_texts import words, words_of
from boat_at_sea import SPEED, Sea, item

from autopilot.angles import shortest_turn
from autopilot.errors import InputError
from autopilot.links.ground_station.mission import from_message
from autopilot.signals import HelmSample, Mode, OrderKind

TAKEN = HelmSample(0.0, False, "stick moved", "rc")
FREE = HelmSample(0.0, True, "", "rc")


def test_a_route_that_is_there_engages_nothing() -> None:
    sea = Sea()
    sea.track.follow(sea.route)
    assert sea.sail(5.0).mode is Mode.STANDBY


def test_it_engages_on_the_present_heading_and_sails_the_route_to_its_end() -> None:
    sea = Sea()
    sea.sail(1.0)
    sea.follow()
    first = sea.sail(0.1)
    assert first.mode is Mode.ENGAGED and abs(first.command.angle) < 0.1
    tick = sea.sail(170.0)
    assert sea.track.is_complete and sea.track.passed == 2
    assert tick.order.serial == 1 and abs(shortest_turn(0.0, tick.state.heading)) < math.radians(3.0)
    assert abs(sea.east - 200.0) < 3.0


def test_who_takes_the_helm_keeps_it_and_the_route_is_over() -> None:
    sea = Sea()
    sea.follow()
    sea.sail(5.0)
    assert sea.sail(2.0, helm=TAKEN).mode is Mode.OVERRIDE
    assert not sea.track.following
    assert sea.sail(20.0, helm=FREE).mode is Mode.OVERRIDE
    sea.skipper.engage(None)
    heading = sea.box.heading
    assert sea.sail(20.0).mode is Mode.ENGAGED
    assert abs(shortest_turn(heading, sea.box.heading)) < math.radians(1.0), "engaged again, it is the heading held"
    sea.follow()
    sea.sail(20.0)
    assert sea.track.following and abs(shortest_turn(heading, sea.box.heading)) > math.radians(20.0)


def test_a_lost_position_does_not_lose_the_heading() -> None:
    sea = Sea()
    sea.follow()
    course = sea.sail(20.0).order.heading
    tick = sea.sail(60.0, gps=False)
    assert tick.mode is Mode.ENGAGED
    assert abs(shortest_turn(course, tick.state.heading)) < math.radians(2.0)
    assert "position lost" in words(sea.track.alarm)


@pytest.mark.parametrize("line", ["+10", "e 90", "r 5", "s"])
def test_what_the_skipper_types_ends_the_route(line: str) -> None:
    sea = Sea()
    sea.follow()
    sea.sail(10.0)
    before = sea.sail(0.1).order.heading
    sea.skipper.type_line(line)
    tick = sea.sail(5.0)
    assert not sea.track.following
    if line == "+10":
        assert tick.order.heading == pytest.approx(before + math.radians(10.0))
    else:
        assert tick.mode is (Mode.STANDBY if line == "s" else Mode.ENGAGED)


def test_a_trial_goes_back_to_the_heading_that_was_steered() -> None:
    sea = Sea()
    sea.skipper.engage(0.5)
    sea.sail(10.0)
    trial = sea.skipper.zigzag(math.radians(10.0), math.radians(10.0), 20.0)
    assert sea.sail(10.0).order.kind is OrderKind.ZIGZAG
    assert 0.4 < trial.progress < 0.6
    tick = sea.sail(30.0)
    assert trial.is_over and trial.is_complete
    assert (tick.mode, tick.order.kind) == (Mode.ENGAGED, OrderKind.HEADING)
    assert abs(tick.state.heading - 0.5) < math.radians(1.0)


def test_a_trial_from_standby_gives_the_rudder_back_and_one_that_cannot_begin_is_over() -> None:
    sea = Sea()
    sea.sail(1.0)
    trial = sea.skipper.turning(math.radians(-10.0), 5.0)
    assert sea.sail(3.0).command.angle < -0.1
    assert sea.sail(5.0).mode is Mode.STANDBY and trial.is_complete
    sea.sail(1.0, helm=TAKEN)
    trial = sea.skipper.turning(math.radians(-10.0), 5.0)
    tick = sea.sail(10.0)
    assert trial.is_over and not trial.is_complete and tick.mode is not Mode.ENGAGED
    assert sea.sail(10.0, helm=FREE).mode is not Mode.ENGAGED, "the helm is free again: too late"


def test_an_override_ends_a_trial_and_stays() -> None:
    sea = Sea()
    sea.sail(1.0)
    trial = sea.skipper.turning(math.radians(10.0), 50.0)
    sea.sail(3.0)
    sea.sail(1.0, helm=TAKEN)
    assert trial.is_over and not trial.is_complete
    tick = sea.sail(10.0, helm=FREE)
    assert tick.mode is Mode.OVERRIDE and "stick moved" in words_of(tick)[0]


def test_a_trial_that_is_ended_or_turned_away_from_holds_no_rudder() -> None:
    sea = Sea()
    sea.skipper.engage(0.0)
    sea.sail(2.0)
    for ends in (sea.skipper.end_trial, lambda: sea.skipper.turn_to(0.0), lambda: sea.skipper.engage(0.0)):
        trial = sea.skipper.turning(math.radians(10.0), 50.0)
        sea.sail(2.0)
        ends()
        tick = sea.sail(20.0)
        assert trial.is_over and not trial.is_complete
        assert (tick.order.kind, tick.mode) == (OrderKind.HEADING, Mode.ENGAGED)
        assert abs(tick.state.heading) < math.radians(1.0)


@pytest.mark.parametrize(
    ("rudder_deg", "change_deg", "seconds"), [(90, 10, 20), (10, 95, 20), (10, 10, 0), (0, 10, 20)]
)
def test_trials_outside_their_limits_are_refused(rudder_deg: float, change_deg: float, seconds: float) -> None:
    sea = Sea()
    with pytest.raises(InputError, match="allowed"):
        sea.skipper.zigzag(math.radians(rudder_deg), math.radians(change_deg), seconds)
    assert sea.sail(1.0).mode is Mode.STANDBY


@pytest.mark.parametrize(
    ("line", "seconds", "turned_deg"),
    [("p u -", 40.0, -180.0), ("p circle + 60", 2.0 * math.pi * 60.0 / SPEED, 360.0), ("p square + 100", 100.0, 360.0)],
)
def test_patterns_are_sailed_by_the_whole_pilot(line: str, seconds: float, turned_deg: float) -> None:
    sea = Sea()
    sea.sail(2.0)
    sea.skipper.type_line(line)
    heading, turned = sea.box.heading, 0.0
    for _ in range(round(seconds * 10)):
        sea.sail(0.1)
        turned += shortest_turn(heading, sea.box.heading)
        heading = sea.box.heading
    assert math.degrees(turned) == pytest.approx(turned_deg, abs=15.0)
    tick = sea.ticks[-1]
    assert (tick.mode, tick.order.serial) == (Mode.ENGAGED, 1)
    sea.skipper.type_line("+10")
    order = sea.sail(0.1).order.heading
    assert sea.sail(20.0).order.heading == order, "any other order ends a pattern"
    sea.skipper.type_line(line)
    sea.sail(3.0)
    sea.sail(3.0, helm=TAKEN)
    assert sea.sail(10.0, helm=FREE).mode is Mode.OVERRIDE and not sea.skipper.patterns.following


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("p", "allowed are u, circle, spiral, zigzag, square, s"),
        ("p loop +", "pattern 'loop'"),
        ("p circle 60", "the side is"),
        ("p circle +", r"give radius \[m\]"),
        ("p circle + x", "p circle \\+ M"),
        ("p circle + 60 5", "p circle \\+ M"),
        ("p circle + nan", "'nan' is not a number"),
        ("p circle + 1_0", "'1_0' is not a number"),
        ("p circle + 20000", "radius 20000, allowed is 1 to 10000 m"),
        ("t " + "9" * 5000, "give the number of a waypoint"),
        ("t \u0663", "give the number of a waypoint"),
        ("p zigzag + 120 100", "angle 120, allowed is 1 to 90 deg"),
    ],
)
def test_patterns_that_are_none_are_refused(line: str, says: str) -> None:
    sea = Sea()
    with pytest.raises(InputError, match=says):
        sea.skipper.type_line(line)
    assert sea.sail(1.0).mode is Mode.STANDBY


def test_a_route_is_followed_by_a_typed_line() -> None:
    sea = Sea()
    sea.sail(1.0)
    with pytest.raises(InputError, match="there is no route"):
        sea.skipper.type_line("t")
    sea.mission.replace([from_message(item(number, waypoint)) for number, waypoint in enumerate(sea.route)])
    assert sea.skipper.type_line("t 1") == "following the route to waypoint 1 of 0 to 1"
    assert sea.sail(10.0).mode is Mode.ENGAGED and sea.mission.is_followed and sea.track.target == 1
    tick = sea.sail(20.0, gps=False)
    assert "position lost" in words_of(tick)[0]
    with pytest.raises(InputError, match="no position"):
        sea.skipper.type_line("t 0")
    assert sea.mission.is_followed and sea.track.target == 1, "a refused line changes nothing"
