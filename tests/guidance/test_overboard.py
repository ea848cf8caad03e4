"""Man overboard: the place kept, seen from a boat that sails on as ordered, on every display, until it is over."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
from boat_at_sea import Sea, place
from monitored_boat import BothAlarms, Watched

from autopilot.errors import InputError
from autopilot.guidance.current import OLDEST_S, Fix, Overboard
from autopilot.links.base import GuideAlarms
from autopilot.signals import Mode, PositionSample
from autopilot.web.screen import screen


def at(fix: Fix, time: float, north: float, east: float) -> None:
    fix.take(PositionSample(time, *place(north, east).place), 3.0)


def test_the_place_stays_and_is_seen_from_where_the_boat_is() -> None:
    fix, overboard = Fix(), Overboard()
    with pytest.raises(InputError, match="no position"):
        overboard.mark(0.0, fix)
    at(fix, 0.0, 0.0, 0.0)
    overboard.mark(1.0, fix)
    assert overboard.seen_from(fix) == pytest.approx((0.0, 0.0))
    for second in range(1, 41):
        at(fix, float(second), 3.0 * second, 0.0)
    overboard.mark(41.0, fix)
    seen = overboard.seen_from(fix)
    assert seen is not None and overboard.since == 1.0, "a second touch keeps the first place"
    assert abs(seen[0]) == pytest.approx(math.pi) and seen[1] == pytest.approx(120.0, rel=0.01)
    alarm = overboard.alarm
    assert alarm is not None and alarm.detail == "28 38.873 N, 011 27.549 E"
    overboard.clear()
    assert (overboard.place, overboard.alarm, overboard.seen_from(fix)) == (None, None, None)
    with pytest.raises(InputError, match="no position"):
        overboard.mark(41.0 + OLDEST_S + 1.0, fix)


def test_a_system_that_knows_no_place_means_where_the_boat_is_when_it_is_first_heard() -> None:
    fix, overboard = Fix(), Overboard()
    with pytest.raises(InputError, match="no position"):
        overboard.report_here(0.0, fix, "chart")
    for second in range(0, 100, 10):
        at(fix, float(second), 3.0 * second, 0.0)
        overboard.report_here(float(second), fix, "chart")
    seen = overboard.seen_from(fix)
    assert seen is not None and overboard.since == 0.0 and seen[1] == pytest.approx(270.0, rel=0.01)
    overboard.clear()
    overboard.report_here(100.0, fix, "chart")
    assert overboard.place is None, "ended on board, and still said by the other: it is over"


def test_a_place_that_another_system_says_is_kept_and_one_that_is_none_refused(tmp_path: Path) -> None:
    sea = Watched(tmp_path)
    sea.watch(2.0)
    assert sea.order(do="mob_at", latitude=57.5, longitude=-11.25) == (True, "")
    place = sea.mission.overboard.place
    assert place is not None and sea.mission.overboard.beacon == "a system aboard"
    assert math.degrees(place.latitude) == 57.5 and math.degrees(place.longitude) == -11.25
    with pytest.raises(InputError, match="latitude"):
        sea.order(do="mob_at", latitude=91.0, longitude=0.0)


def test_the_boat_goes_on_as_ordered_and_every_display_has_it(tmp_path: Path) -> None:
    sea = Watched(tmp_path)
    sea.alarms = BothAlarms(GuideAlarms(sea.mission.overboard, "skipper"), sea.alarms)
    assert sea.order(do="engage") == (True, "")
    sea.watch(5.0)
    before = sea.tick.order if sea.tick else None
    assert sea.order(do="mob") == (True, "")
    sea.watch(20.0)
    assert sea.tick is not None and sea.tick.mode is Mode.ENGAGED and sea.tick.order == before
    view = sea.station.view
    assert view.value("mob_distance") == pytest.approx(20.0 * 4.63, rel=0.1)
    back = math.degrees(sea.tick.state.heading) + 180.0
    assert math.remainder((view.value("mob_bearing") or 0.0) - back, 360.0) == pytest.approx(0.0, abs=3.0)
    (alarm,) = [each for each in sea.station.alarms.active if each["name"] == "man_overboard"]
    assert (alarm["priority"], alarm["sounds"]) == ("emergency", True)
    assert any(line.text.startswith(" MAN OVERBOARD") for line in screen(sea.station, sea.now, (80, 24)))
    assert sea.order(do="mob_off") == (True, "")
    sea.watch(5.0)
    assert not any(line.text.startswith(" MAN OVERBOARD") for line in screen(sea.station, sea.now, (80, 24)))
    assert not any(each["name"] == "man_overboard" for each in sea.station.alarms.active)


def test_the_terminal_says_bearing_and_distance() -> None:
    sea = Sea()
    sea.skipper.type_line("e 0")
    sea.sail(5.0)
    assert sea.skipper.type_line("mob").startswith("MAN OVERBOARD: bearing ")
    sea.sail(20.0)
    assert sea.skipper.type_line("mob").startswith("MAN OVERBOARD: bearing 180")
    assert sea.skipper.type_line("mob off") == "nobody is overboard any more"
