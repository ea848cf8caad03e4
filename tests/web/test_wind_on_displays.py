"""The wind on the displays of a served boat: shown, held, changed by steps, dodged in, tacked and declined."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from boat_at_sea import Vane
from monitored_boat import BothAlarms, Watched
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.web.requests import asked_of
from autopilot.web.screen import screen


@pytest.fixture
def sea(tmp_path: Path) -> Watched:
    return Watched(tmp_path)


@pytest.fixture
def vane(sea: Watched) -> Vane:
    """The wind of that sea, which the boat has measured for 10 s."""
    vane = Vane(sea)
    sea.alarms = BothAlarms(vane, sea.alarms)
    sea.watch(10.0)
    return vane


APPARENT, TRUE = {"do": "wind", "true": False, "degrees": 60}, {"do": "wind", "true": True, "degrees": 45}


@pytest.mark.parametrize(
    ("held", "ordered", "then"),
    [
        (TRUE, APPARENT, ("wind", "wind_angle", 59.0, 0.0)),
        ({"do": "engage"}, TRUE, ("wind", "wind_angle", 44.0, 1.0)),
        (TRUE, {"do": "heading", "degrees": 90}, ("heading", "order", 91.0, 0.0)),
    ],
)
@pytest.mark.parametrize("delay", [0.0, 0.4])
@pytest.mark.usefixtures("vane")
def test_a_step_counts_from_what_was_ordered_just_now_though_the_boat_still_tells_another_mode(
    sea: Watched, held: dict[str, Any], ordered: dict[str, Any], then: tuple[str, str, float, float], delay: float
) -> None:
    assert sea.order(**held) == (True, "")
    sea.watch(5.0)
    arrived, on_its_way, ends = sea.far.receive, list[tuple[float, bytes]](), list[bool]()

    def late() -> list[bytes]:
        on_its_way.extend((sea.now + delay, data) for data in arrived())
        count = sum(time <= sea.now for time, _ in on_its_way)
        due, on_its_way[:] = [data for _, data in on_its_way[:count]], on_its_way[count:]
        return due

    sea.far.receive = late  # type: ignore[method-assign]
    for wanted in (ordered, {"do": "turn", "degrees": 1}):
        asked_of(sea.station, wanted)(sea.now, lambda taken, _: ends.append(bool(taken)))
        sea.watch(0.1)
    sea.watch(4.0)
    view = sea.station.view
    mode, name, value, is_true = then
    assert ends == [True, True]
    assert (view.mode_name, view.value(name), view.value("wind_true")) == (mode, pytest.approx(value), is_true)


@pytest.mark.usefixtures("vane")
def test_a_step_waits_until_the_boat_has_said_which_angle_of_the_wind_it_holds(sea: Watched) -> None:
    assert sea.order(do="engage") == (True, "")
    sea.watch(2.0)
    assert sea.order(do="wind", true=False) == (True, "")
    held = sea.skipper.wind.hold
    assert held is not None
    for _ in range(2):
        assert sea.order(do="turn", degrees=1) == (True, "")
    sea.watch(1.0)
    assert sea.station.view.mode_name == "wind"
    assert sea.station.view.value("wind_angle") == pytest.approx(math.degrees(held.angle) - 2.0, abs=0.01)


def test_the_wind_is_shown_held_turned_by_and_tacked(sea: Watched, vane: Vane) -> None:
    assert sea.station.view.value("awa") == pytest.approx(math.degrees(vane.angle()), abs=12.0)
    assert sea.station.view.value("tws") == pytest.approx(8.0 * 3600.0 / 1852.0, rel=0.2)
    assert sea.order(do="tack") == (False, "tack: nothing is steered: order the wind hold first")
    assert sea.order(do="wind", true=True, degrees=45) == (True, "")
    sea.watch(40.0)
    view = sea.station.view
    assert (view.mode_name, view.value("wind_angle"), view.value("wind_true")) == ("wind", 45.0, 1.0)
    (shown,) = [line.text for line in screen(sea.station, sea.now, (80, 24)) if line.text.startswith(" wind")]
    assert "kn  true" in shown and shown.endswith("held 45.0S true")
    # quick steps count from what is meant, and a dodge goes back to the angle
    for _ in range(3):
        assert sea.order(do="turn", degrees=1) == (True, "")
    sea.watch(2.0)
    assert view.value("wind_angle") == pytest.approx(42.0)
    # and so does one behind an angle that has just been given
    for wanted in ({"do": "wind", "true": True, "degrees": 52}, {"do": "turn", "degrees": 10}):
        assert sea.order(**wanted) == (True, "")
    sea.watch(2.0)
    assert view.value("wind_angle") == pytest.approx(42.0)
    assert sea.order(do="dodge", degrees=-20) == (True, "")
    sea.watch(2.0)
    assert view.value("wind_angle") == pytest.approx(62.0) and sea.station.course.before == pytest.approx(42.0)
    assert sea.order(do="back") == (True, "")
    sea.watch(2.0)
    assert view.value("wind_angle") == pytest.approx(42.0) and sea.station.course.before is None
    assert sea.order(do="tack") == (True, "")
    sea.watch(1.0)
    assert view.value("wind_ask") == 1.0
    assert any("tack to starboard: confirm" in alarm["words"] for alarm in sea.station.alarms.active)
    assert sea.order(do="decline") == (True, "")
    sea.watch(1.0)
    assert view.value("wind_ask") == 0.0 and sea.order(do="confirm")[0] is False
    sea.order(do="tack")
    # an answer that is lost, so that the confirmation is given twice, turns once
    lost = sea.far.receive
    sea.far.receive = lambda: [data for data in lost() if data[7] != dialect.MAVLINK_MSG_ID_COMMAND_ACK]  # type: ignore[method-assign]
    ends: list[bool] = []
    asked_of(sea.station, {"do": "confirm"})(sea.now, lambda taken, _: ends.append(bool(taken)))
    sea.watch(1.2)
    sea.far.receive = lost  # type: ignore[method-assign]
    sea.until(lambda: ends == [True])
    sea.watch(60.0)
    assert math.degrees(vane.true()) == pytest.approx(-42.0, abs=4.0)
    assert sea.order(do="engage") == (True, "")
    sea.watch(2.0)
    assert view.mode_name == "heading" and view.value("wind_angle") is None


def test_a_wind_that_is_lost_is_no_more_shown_and_nothing_waits(sea: Watched, vane: Vane) -> None:
    assert sea.order(do="wind") == (True, "")
    sea.watch(2.0)
    assert sea.order(do="tack") == (True, "")
    vane.is_acknowledged = False
    sea.watch(8.0)
    view = sea.station.view
    assert (view.value("awa"), view.value("twa"), view.value("wind_ask")) == (None, None, 0.0)
    assert any("wind lost: no wind is heard" in alarm["words"] for alarm in sea.station.alarms.active)
    assert not [line for line in screen(sea.station, sea.now, (80, 24)) if line.text.startswith(" wind")]
