"""The wind hold on the whole pilot and a boat that sails by an apparent wind: held, shifted, lost, refused."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from alarm_texts import words_of
from boat_at_sea import Sea, ServedBoat, Vane, only, place

from autopilot.angles import shortest_turn, wrap
from autopilot.cli.main import main
from autopilot.errors import InputError
from autopilot.guidance.wind_vane import Manoeuvre, WindSettings
from autopilot.links.ground_station.commands import ACCEPTED, DENIED, REJECTED, WINDWARD, Commands
from autopilot.links.ground_station.orders import WIND
from autopilot.signals import HeadingSample, HelmSample, Mode, WindSample


@pytest.fixture
def sea() -> Sea:
    sea = Sea()
    sea.alarms = Vane(sea)
    return sea


def test_the_angle_is_held_through_a_shift_and_nothing_jumps(sea: Sea) -> None:
    sea.sail(10.0)
    before, heading = sea.alarms.angle(), sea.box.heading
    assert sea.skipper.type_line("w") == "holding the apparent wind's angle"
    assert sea.sail(30.0).mode is Mode.ENGAGED
    assert abs(math.degrees(shortest_turn(heading, sea.box.heading))) < 3.0
    for _ in range(40):
        sea.alarms.wind_from += math.radians(0.5)
        sea.sail(1.0)
    tick = sea.sail(30.0)
    assert math.degrees(sea.alarms.angle()) == pytest.approx(math.degrees(before), abs=3.0)
    assert math.degrees(sea.box.heading) == pytest.approx(math.degrees(heading) + 20.0, abs=5.0)
    assert words_of(tick) == ()
    assert tick.order.serial == 1, "following the wind is no new action"
    steps = [abs(b.command.angle - a.command.angle) for a, b in itertools.pairwise(sea.ticks)]
    assert max(steps) <= math.radians(20.0) * 0.05 + 1.0e-9


def test_a_wind_that_is_lost_leaves_the_heading_and_is_reported(sea: Sea) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w")
    ordered = sea.sail(20.0).order.heading
    sea.alarms.is_acknowledged = False
    tick = sea.sail(10.0)
    assert tick.mode is Mode.ENGAGED
    assert any("wind lost" in alarm for alarm in words_of(tick))
    sea.alarms.is_acknowledged, sea.alarms.wind_from = True, math.radians(100.0)
    held = sea.sail(20.0).order.heading
    assert held == sea.sail(5.0).order.heading
    assert abs(math.degrees(shortest_turn(ordered, held))) < 3.0
    sea.skipper.type_line("w")
    tick = sea.sail(1.0)
    assert not words_of(tick)
    assert abs(math.degrees(shortest_turn(sea.box.heading, tick.order.heading))) < 3.0


@pytest.mark.parametrize("jump", [12.0, -20.0])
@pytest.mark.parametrize("leader", ["w", "w true", "route"])
def test_a_compass_that_jumps_moves_no_boat_off_its_wind_or_route(sea: Sea, leader: str, jump: float) -> None:
    """The jump is held for 30 s; then the compass is followed, and wind and route lead all the same."""
    sense, by, jumps = sea.box.sense, math.radians(jump), 40.0

    def off_by() -> list[HeadingSample]:
        is_off = sea.box.time >= jumps
        return [each._replace(heading=wrap(each.heading + by)) if is_off else each for each in sense()]

    sea.box.sense = off_by  # type: ignore[method-assign]
    sea.sail(5.0)
    if leader == "route":
        sea.route = [place(2000.0, 0.0)]
        sea.follow()
    else:
        sea.skipper.type_line(leader)
    sea.sail(jumps - 5.0)
    wind, turned, across = sea.alarms.angle(), [], []
    for _ in range(180):
        tick = sea.sail(0.5)
        assert tick.mode is Mode.ENGAGED
        turned.append(abs(math.degrees(shortest_turn(wind, sea.alarms.angle()))))
        across.append(abs(sea.east))
    assert max(turned) < 6.0
    if leader == "route":
        assert max(across) < 2.0


@pytest.mark.parametrize("line", ["e 10", "r 5", "s", "e"])
def test_any_other_order_ends_the_hold(sea: Sea, line: str) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w")
    sea.sail(5.0)
    sea.skipper.type_line(line)
    order = sea.sail(1.0).order
    sea.alarms.wind_from += 1.0
    assert not sea.skipper.wind.following
    assert sea.sail(20.0).order == order


def test_who_takes_the_helm_keeps_it(sea: Sea) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w")
    sea.sail(5.0)
    assert sea.sail(2.0, helm=HelmSample(0.0, False, "stick moved", "rc")).mode is Mode.OVERRIDE
    assert not sea.skipper.wind.following


def test_without_a_wind_it_is_refused_and_the_order_stays(sea: Sea) -> None:
    sea.alarms.is_acknowledged = False
    sea.skipper.type_line("e 10")
    order = sea.sail(10.0).order
    with pytest.raises(InputError, match="no wind"):
        sea.skipper.type_line("w")
    assert sea.sail(1.0).order == order


def test_ordered_from_the_start_it_waits_for_the_wind_and_says_so(sea: Sea) -> None:
    sea.alarms.is_acknowledged = False
    sea.skipper.await_wind()
    tick = sea.sail(10.0)
    assert tick.mode is Mode.STANDBY
    assert any("no wind is heard" in alarm for alarm in words_of(tick))
    sea.alarms.is_acknowledged = True
    tick = sea.sail(2.0)
    assert tick.mode is Mode.ENGAGED
    assert words_of(tick) == ()
    assert sea.skipper.wind.following


def test_another_order_ends_the_waiting(sea: Sea) -> None:
    sea.alarms.is_acknowledged = False
    sea.skipper.await_wind()
    sea.sail(1.0)
    sea.skipper.type_line("s")
    sea.alarms.is_acknowledged = True
    tick = sea.sail(5.0)
    assert (tick.mode, words_of(tick)) == (Mode.STANDBY, ())


def off(angle: float, degrees: float) -> float:
    return abs(math.degrees(wrap(angle - math.radians(degrees))))


@pytest.mark.parametrize("degrees", [0.0, 40.0, -120.0, 179.0, -179.0])
@pytest.mark.parametrize("kind", ["w", "w true"])
def test_a_given_angle_is_steered_on_either_side_of_bow_and_stern(sea: Sea, kind: str, degrees: float) -> None:
    sea.alarms.wind_from = math.copysign(sea.alarms.wind_from, degrees)
    sea.sail(10.0)
    sea.skipper.type_line(f"{kind} {degrees:g}")
    sea.sail(60.0)
    found = []
    for _ in range(60):
        sea.sail(0.5)
        found.append(sea.alarms.true() if kind == "w true" else sea.alarms.angle())
    mean = math.atan2(np.mean(np.sin(found)), np.mean(np.cos(found)))
    assert off(mean, degrees) < 2.0
    assert max(off(each, degrees) for each in found) < 5.0


@pytest.mark.parametrize(("line", "most"), [("w 40", 3.0), ("w true 40", 1.5)])
def test_gusts_swing_the_boat_little(sea: Sea, line: str, most: float) -> None:
    """2.5 m/s of gusts on 8 m/s of wind move the apparent wind by some 6 deg; nobody wants to feel them at the helm."""
    sea.sail(10.0)
    sea.skipper.type_line(line)
    sea.sail(60.0)
    sea.alarms.gust = 2.5
    headings, winds = [], []
    for _ in range(400):
        tick = sea.sail(0.5)
        headings.append(math.degrees(sea.box.heading))
        winds.append(math.degrees(wrap(sea.box.heading + sea.alarms.angle())))
    assert tick.mode is Mode.ENGAGED and words_of(tick) == ()
    assert np.std(headings) < most and np.std(headings) < 0.5 * np.std(winds)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("order", "angle"), [("tack", 45.0), ("gybe", 140.0)])
def test_a_tack_and_a_gybe_go_to_the_mirrored_angle(sea: Sea, side: float, order: str, angle: float) -> None:
    sea.alarms.wind_from *= side
    sea.sail(10.0)
    sea.skipper.type_line(f"w true {side * angle:g}")
    sea.sail(60.0)
    assert off(sea.alarms.true(), side * angle) < 3.0
    goes = side if order == "tack" else -side
    assert (
        sea.skipper.type_line(order) == f"{order} to {'starboard' if goes > 0 else 'port'}: confirm with y within 10 s"
    )
    tick = sea.sail(5.0)
    assert any(words.endswith("confirm it within 10 s, or it is cancelled") for words in words_of(tick))
    assert off(sea.alarms.true(), side * angle) < 4.0
    assert sea.skipper.type_line("y") == "turning"
    first, before = len(sea.ticks), sea.box.heading
    tick = sea.sail(60.0)
    assert off(sea.alarms.true(), -side * angle) < 3.0
    turned = math.degrees(
        sum(shortest_turn(a.state.heading, b.state.heading) for a, b in itertools.pairwise(sea.ticks[first:]))
    )
    most = 2.0 * angle if order == "tack" else 360.0 - 2.0 * angle
    assert turned == pytest.approx(goes * most, abs=8.0)
    beyond = [goes * math.degrees(shortest_turn(before, each.state.heading)) for each in sea.ticks[first:]]
    assert max(beyond) < most + 6.0, "no swing past the other side"
    assert tick.mode is Mode.ENGAGED and words_of(tick) == () and tick.order.serial == 1


def test_a_tack_that_nobody_confirms_turns_nothing(sea: Sea) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w true 45")
    sea.sail(60.0)
    sea.skipper.type_line("tack")
    tick = sea.sail(11.0)
    assert words_of(tick) == ()
    with pytest.raises(InputError, match="no tack or gybe waits"):
        sea.skipper.type_line("y")
    sea.skipper.type_line("tack")
    assert sea.skipper.type_line("n") == "no turn"
    sea.sail(20.0)
    assert off(sea.alarms.true(), 45.0) < 3.0


def test_a_gybe_in_more_wind_than_the_vessel_file_names_is_only_begun_by_our_own_confirmation(sea: Sea) -> None:
    sea.skipper.wind.settings = WindSettings(gybe_most=6.0)
    sea.sail(10.0)
    sea.skipper.type_line("w true 140")
    sea.sail(60.0)
    with pytest.raises(InputError, match=r"gybe to port in 8 m/s of wind, more than guidance.gybe_wind_max_m_s \(6\)"):
        sea.skipper.ask_turn(Manoeuvre.GYBE, confirmed=True)
    tick = sea.sail(1.0)
    assert any("gybe to port in 8 m/s of wind: confirm it" in words for words in words_of(tick))
    sea.skipper.type_line("y")
    sea.sail(60.0)
    assert off(sea.alarms.true(), -140.0) < 3.0


def test_steps_of_degrees_turn_the_boat_to_their_side_and_the_hold_goes_on(sea: Sea) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w true 50")
    sea.sail(40.0)
    assert sea.skipper.type_line("+10") == "wind angle 40 deg"
    sea.sail(40.0)
    assert off(sea.alarms.true(), 40.0) < 3.0
    assert sea.skipper.type_line("-1") == "wind angle 41 deg"
    assert sea.skipper.wind.following


@pytest.mark.parametrize(
    ("held", "line", "word"),
    [
        ("w true 45", "w true -45", "tack"),
        ("w 45", "w true -45", "tack"),
        ("w true 172", "-10", "gybe"),
        ("w true 172", "w true -172", "gybe"),
        ("e 10", "w true -140", "gybe"),
        ("e 10", "w -30", "tack"),
    ],
)
def test_no_angle_takes_the_boat_to_the_other_side_unasked(sea: Sea, held: str, line: str, word: str) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w")
    sea.skipper.type_line(held)
    order = sea.sail(60.0).order
    with pytest.raises(InputError, match=f"with the wind from starboard that is a {word}"):
        sea.skipper.type_line(line)
    assert abs(math.degrees(shortest_turn(order.heading, sea.sail(10.0).order.heading))) < 5.0
    assert sea.skipper.wind.following is held.startswith("w")


def test_dead_before_the_wind_and_close_to_it_either_side_may_be_ordered(sea: Sea) -> None:
    sea.sail(10.0)
    for line, wanted in (("w true 180", 180.0), ("w true -170", -170.0), ("w true -60", -60.0)):
        sea.skipper.type_line(line)
        sea.sail(90.0)
        assert off(sea.alarms.true(), wanted) < 3.0
    sea.skipper.type_line("w true 0")
    sea.sail(60.0)
    sea.skipper.type_line("w true 5")


def test_no_turn_is_promised_while_nothing_is_steered(sea: Sea) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w true 45")
    sea.sail(30.0)
    sea.skipper.type_line("tack")
    assert sea.sail(2.0, helm=HelmSample(0.0, False, "no way", "rudder")).mode is not Mode.ENGAGED
    for line in ("y", "tack"):
        with pytest.raises(InputError, match="nothing is steered"):
            sea.skipper.type_line(line)


def test_an_angle_ordered_in_fail_safe_engages_and_a_step_says_that_nothing_is_steered(sea: Sea) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w true 45")
    sea.sail(30.0)
    sense, sea.box.sense = sea.box.sense, list  # type: ignore[method-assign]
    assert sea.sail(4.0).mode is Mode.FAILSAFE
    sea.box.sense = sense  # type: ignore[method-assign]
    assert sea.sail(4.0).mode is Mode.FAILSAFE
    assert sea.skipper.type_line("+5") == "wind angle 40 deg once the pilot is engaged again; nothing is steered now"
    assert sea.skipper.type_line("w true 50") == "holding the true wind's angle of 50 deg"
    assert sea.sail(1.0).mode is Mode.ENGAGED
    sea.sail(60.0)
    assert off(sea.alarms.true(), 50.0) < 3.0


@pytest.mark.parametrize("order", ["mode", "command"])
def test_the_same_hold_asked_for_in_fail_safe_by_a_station_engages(sea: Sea, order: str) -> None:
    commands = Commands(sea.skipper, True, sea.skipper.mission, wind=sea.skipper.wind)
    sea.sail(10.0)
    sea.skipper.type_line("w")
    sea.sail(30.0)
    sense, sea.box.sense = sea.box.sense, list  # type: ignore[method-assign]
    assert sea.sail(4.0).mode is Mode.FAILSAFE
    sea.box.sense = sense  # type: ignore[method-assign]
    tick = sea.sail(4.0)
    assert tick.mode is Mode.FAILSAFE
    if order == "mode":
        assert commands.set_mode(WIND, tick) == ACCEPTED
    else:
        assert commands.execute(WINDWARD, (0.0, math.nan, 0.0, 0.0, 0.0, 0.0, 0.0), tick) == ACCEPTED
    assert sea.sail(1.0).mode is Mode.ENGAGED


def test_a_frozen_vane_leaves_the_heading_from_before_and_says_so(sea: Sea) -> None:
    sea.sail(10.0)
    sea.skipper.type_line("w")
    ordered = sea.sail(30.0).order.heading
    sea.alarms.stuck = WindSample(0.0, wrap(sea.alarms.angle() + math.radians(15.0)), 8.0)
    tick = sea.sail(40.0)
    assert tick.mode is Mode.ENGAGED
    assert any("wind lost: the wind vane stands still: holding" in words for words in words_of(tick))
    assert abs(math.degrees(shortest_turn(ordered, tick.order.heading))) < 4.0
    # and far off it was not at any time: a vane that turns with the boat would have had it circle
    assert max(abs(math.degrees(shortest_turn(ordered, each.state.heading))) for each in sea.ticks[-800:]) < 18.0


def test_a_shift_is_reported_in_heading_mode(sea: Sea) -> None:
    sea.skipper.type_line("e 10")
    assert words_of(sea.sail(60.0)) == ()
    sea.alarms.wind_from += math.radians(40.0)
    assert any("the wind has shifted by more than 30 deg" in words for words in words_of(sea.sail(90.0)))
    sea.skipper.type_line("+5")
    assert words_of(sea.sail(60.0)) == ()


def test_recorded_ticks_lead_another_skipper_the_same_way_and_the_pilot_too(sea: Sea) -> None:
    typed = {200: "w true 45", 1200: "tack", 1250: "y", 2400: "-10", 3000: "w"}
    for step in range(80):
        if 50 * step in typed:
            sea.skipper.type_line(typed[50 * step])
        sea.sail(2.5)
    ticks = sea.ticks
    again = Sea()
    before, number = None, 0
    for number, tick in enumerate(ticks):
        if number in typed:
            again.skipper.type_line(typed[number])
        assert again.skipper(tick.now, before) == tick.order, number
        found = again.pilot.step(tick.now, tick.samples, tick.order)
        again.pilot.learn(found)
        assert (found.command, found.state, found.reference) == (tick.command, tick.state, tick.reference), number
        before = tick
    assert number == len(ticks) - 1 and any(tick.order.is_led for tick in ticks)


def test_over_mavlink_a_ground_station_holds_the_wind_tacks_and_sees_it() -> None:
    boat = ServedBoat(armed=True)
    vane = Vane(boat)
    boat.alarms = vane
    boat.sail(10.0)
    assert boat.command(WINDWARD, 0.0, math.nan) == ACCEPTED
    boat.listen(5.0)
    beat = only(boat.heard, "HEARTBEAT")[-1]
    assert beat.custom_mode == 1
    assert boat.command(WINDWARD, 1.0, 45.0) == ACCEPTED
    boat.listen(60.0)
    named = {message.name: message.value for message in only(boat.heard, "NAMED_VALUE_FLOAT")}
    assert named["wnd_hold"] == pytest.approx(45.0) and named["wnd_true"] == 1.0 and named["wnd_ask"] == 0.0
    assert named["AppWndDir"] == pytest.approx(math.degrees(vane.angle()), abs=12.0)
    assert named["TruWndDir"] == pytest.approx(45.0, abs=8.0)
    assert boat.command(WINDWARD, 4.0) == REJECTED, "nothing waits"
    assert boat.command(WINDWARD, 2.0, -1.0) == REJECTED, "not to that side"
    assert boat.command(WINDWARD, 2.0, 0.0) == ACCEPTED
    named = {message.name: message.value for message in only(boat.listen(1.0), "NAMED_VALUE_FLOAT")}
    assert named["wnd_ask"] == 1.0
    assert boat.command(WINDWARD, 4.0) == ACCEPTED
    boat.listen(60.0)
    assert off(vane.true(), -45.0) < 3.0
    assert boat.command(WINDWARD, 2.0, 1.0, 1.0) == REJECTED
    assert boat.command(WINDWARD, 2.0, -1.0, 1.0) == ACCEPTED, "confirmed already"
    boat.listen(60.0)
    assert off(vane.true(), 45.0) < 3.0
    for values in ((9.0,), (2.0, 0.5), (math.nan,)):
        assert boat.command(WINDWARD, *values) == DENIED
    assert boat.command(176, 1.0, 15.0) == ACCEPTED
    boat.listen(3.0)
    assert only(boat.heard, "HEARTBEAT")[-1].custom_mode == 15
    assert boat.command(176, 1.0, 1.0) == ACCEPTED
    boat.listen(3.0)
    assert only(boat.heard, "HEARTBEAT")[-1].custom_mode == 1


def test_a_boat_whose_links_bring_no_wind_is_refused_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "lanxin", "--link", "pypilot:/dev/ttyUSB9:38400", "--engage", "wind"]) == 4
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "wind vane" in lines[0]
