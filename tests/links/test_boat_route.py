"""A ground station sends the boat along a route, to a place and through trials: modes, messages, and who wins."""

from __future__ import annotations

import importlib
import math
from pathlib import Path
from typing import Any

import pytest
from alarm_texts import words, words_of
from boat_at_sea import ServedBoat, item, only, place
from boats import BOATS, vessel_of
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.ground_station.commands import OVERBOARD
from autopilot.links.ground_station.mission import from_message
from autopilot.links.mavlink.frames import CommandCancel
from autopilot.runtime.record import Recorder, replay
from autopilot.signals import AlarmSample, HelmSample, Mode, OrderKind
from autopilot.vessel.file import dump_vessel

AUTO, GUIDED, MANUAL, STEERING = 10, 15, 0, 3
SET_MODE, ARM, YAW = dialect.MAV_CMD_DO_SET_MODE, dialect.MAV_CMD_COMPONENT_ARM_DISARM, dialect.MAV_CMD_CONDITION_YAW
CANCELLED = 6
ACCEPTED, REJECTED = dialect.MAV_RESULT_ACCEPTED, dialect.MAV_RESULT_TEMPORARILY_REJECTED
TAKEN = HelmSample(0.0, False, "stick moved", "rc")
FREE = HelmSample(0.0, True, "", "rc")
ROUTE = [place(0.0, 150.0), place(150.0, 150.0)]


def upload(boat: ServedBoat, route: list[Any]) -> None:
    boat.ask(dialect.MAVLink_mission_count_message(1, 1, len(route)))
    for number, waypoint in enumerate(route):
        answers = boat.ask(item(number, waypoint))
    (ack,) = only(answers, "MISSION_ACK")
    assert ack.type == dialect.MAV_MISSION_ACCEPTED


def under_way() -> ServedBoat:
    boat = ServedBoat(armed=True)
    boat.listen(1.0)
    upload(boat, ROUTE)
    assert boat.command(SET_MODE, 1, AUTO) == ACCEPTED
    boat.listen(3.0)
    return boat


def mode_of(boat: ServedBoat) -> int:
    boat.listen(1.1)
    return int(only(boat.heard, "HEARTBEAT")[-1].custom_mode)


def texts(boat: ServedBoat) -> list[str]:
    return [message.text for message in only(boat.heard, "STATUSTEXT")]


def test_a_route_is_followed_only_when_armed_with_a_position_and_asked_to() -> None:
    boat = ServedBoat()
    boat.listen(1.0)
    assert boat.command(SET_MODE, 1, AUTO) == REJECTED
    boat.command(ARM, 1)
    assert boat.command(SET_MODE, 1, AUTO) == REJECTED
    upload(boat, ROUTE)
    assert boat.sail(5.0).mode is Mode.STANDBY
    assert boat.command(dialect.MAV_CMD_MISSION_START, 5) == dialect.MAV_RESULT_DENIED
    assert boat.command(dialect.MAV_CMD_MISSION_START, 1) == ACCEPTED
    assert mode_of(boat) == AUTO and boat.track.target == 1
    assert {"arm first", "there is no route: upload one first"} <= set(texts(boat))


def test_without_a_position_no_route_is_begun() -> None:
    boat = ServedBoat(armed=True)
    boat.sail(1.0, gps=False)
    upload_silently(boat)
    boat.sail(1.0, gps=False)
    for command, values in ((SET_MODE, (1, AUTO)), (dialect.MAV_CMD_MISSION_START, ())):
        parameters = [*values, *[0.0] * (7 - len(values))]
        boat.far.send(boat.station.encode(dialect.MAVLink_command_long_message(1, 1, command, 0, *parameters)))
        (ack,) = only(boat.listen(0.3, gps=False), "COMMAND_ACK")
        assert ack.result == REJECTED
    assert "no position: check the GPS and its link" in texts(boat)
    assert boat.sail(5.0).mode is Mode.STANDBY


def upload_silently(boat: ServedBoat) -> None:
    boat.mission.replace([from_message(item(number, waypoint)) for number, waypoint in enumerate(ROUTE)])


def test_a_station_sees_the_route_being_followed_to_its_end() -> None:
    boat = under_way()
    assert mode_of(boat) == AUTO
    current = only(boat.heard, "MISSION_CURRENT")[-1]
    assert (current.seq, current.total, current.mission_state) == (0, 2, dialect.MISSION_STATE_ACTIVE)
    for east in (20.0, 40.0, 60.0):
        # no further at a time than a position is believed
        boat.east, boat.north = east, 20.0
        boat.listen(0.6)
    navigation = only(boat.listen(0.6), "NAV_CONTROLLER_OUTPUT")[-1]
    assert navigation.xtrack_error == pytest.approx(-17.0, abs=4.0), "north of a leg that leads east is to port of it"
    assert navigation.wp_dist == pytest.approx(90, abs=6)
    assert navigation.target_bearing == pytest.approx(102, abs=4)
    boat.listen(70.0)
    assert [message.seq for message in only(boat.heard, "MISSION_ITEM_REACHED")] == [0, 1]
    current = only(boat.heard, "MISSION_CURRENT")[-1]
    assert (current.seq, current.mission_state) == (1, dialect.MISSION_STATE_COMPLETE)
    assert any(text.startswith("the route has ended: holding ") for text in texts(boat))
    assert boat.tick is not None and boat.tick.mode is Mode.ENGAGED
    assert "the route has ended" in words_of(boat.tick)[0]
    assert boat.command(YAW, 90) == ACCEPTED
    assert mode_of(boat) == GUIDED and words_of(boat.tick) == ()
    assert boat.command(SET_MODE, 1, AUTO) == REJECTED
    assert texts(boat)[-1].startswith("the route has been followed to its end")
    assert boat.command(dialect.MAV_CMD_DO_SET_MISSION_CURRENT, 0) == ACCEPTED
    assert boat.command(SET_MODE, 1, AUTO) == ACCEPTED


def test_other_orders_end_the_following_and_auto_goes_on_with_the_same_waypoint() -> None:
    boat = under_way()
    boat.sail(25.0)
    boat.ask(dialect.MAVLink_mission_set_current_message(1, 1, 1))
    assert only(boat.heard, "MISSION_CURRENT")[-1].seq == 1 and boat.track.leg is not None
    heading = boat.ticks[-1].order.heading
    assert boat.command(SET_MODE, 1, GUIDED) == ACCEPTED
    assert boat.sail(1.0).order.heading == pytest.approx(heading, abs=0.1)
    assert mode_of(boat) == GUIDED
    assert only(boat.heard, "MISSION_CURRENT")[-1].mission_state == dialect.MISSION_STATE_PAUSED
    assert boat.command(SET_MODE, 1, AUTO) == ACCEPTED
    assert mode_of(boat) == AUTO and boat.track.target == 1
    assert boat.command(SET_MODE, 1, MANUAL) == ACCEPTED
    assert boat.sail(1.0).mode is Mode.STANDBY and not boat.track.following


def test_an_override_wins_and_stays() -> None:
    boat = under_way()
    boat.sail(1.0, helm=TAKEN)
    assert mode_of(boat) == MANUAL
    boat.sail(10.0, helm=FREE)
    boat.ask(dialect.MAVLink_mission_set_current_message(1, 1, 0))
    upload(boat, ROUTE[:1])
    boat.command(YAW, 90)
    assert boat.sail(10.0).mode is Mode.OVERRIDE
    assert boat.command(SET_MODE, 1, AUTO) == ACCEPTED
    assert boat.sail(1.0).mode is Mode.ENGAGED


def test_a_new_route_under_way_holds_the_course_until_it_is_asked_for() -> None:
    boat = under_way()
    boat.sail(20.0)
    upload(boat, [place(-500.0, 0.0)])
    heading = boat.ticks[-1].order.heading
    assert mode_of(boat) == GUIDED
    assert boat.sail(10.0).order.heading == pytest.approx(heading, abs=0.05)
    assert "route of 1 waypoints taken: the old one is no longer fol" in texts(boat)[-2:][0] + texts(boat)[-1]
    boat.ask(dialect.MAVLink_mission_clear_all_message(1, 1))
    assert boat.sail(1.0).mode is Mode.ENGAGED


def test_a_change_of_the_route_that_a_line_held_until_the_next_had_come_is_not_made() -> None:
    boat = ServedBoat(armed=True)
    boat.listen(1.0)
    late = [
        boat.station.encode(message)
        for message in (
            dialect.MAVLink_mission_clear_all_message(1, 1),
            dialect.MAVLink_mission_count_message(1, 1, 1),
            dialect.MAVLink_mission_set_current_message(1, 1, 0),
        )
    ]
    upload(boat, ROUTE)
    boat.ask(dialect.MAVLink_mission_set_current_message(1, 1, 1))
    assert boat.command(SET_MODE, 1, AUTO) == ACCEPTED
    boat.sail(1.0)
    before, heard = boat.mission.items, len(boat.heard)
    for data in late:
        boat.far.send(data)
    boat.listen(8.0)
    assert boat.mission.items == before and mode_of(boat) == AUTO and boat.track.target == 1
    assert not only(boat.heard[heard:], "MISSION_ACK"), "none that would be taken for another's"
    said = [message.text for message in only(boat.heard[heard:], "STATUSTEXT")]
    assert any(text.startswith("a change of the route came behind the one") for text in said)
    boat.ask(dialect.MAVLink_mission_clear_all_message(1, 1))
    assert boat.mission.items == ()


def test_a_lost_position_is_reported_to_everybody_and_the_heading_stays() -> None:
    boat = under_way()
    boat.sail(10.0)
    tick = boat.sail(20.0, gps=False)
    assert tick.mode is Mode.ENGAGED and "position lost" in words_of(tick)[0]
    boat.listen(1.0, gps=False)
    assert any("position lost" in text for text in texts(boat))
    assert only(boat.listen(3.0), "NAV_CONTROLLER_OUTPUT")[-1].wp_dist > 0
    assert words_of(boat.sail(1.0)) == ()


def test_a_place_is_gone_to_and_its_course_held() -> None:
    boat = ServedBoat(armed=True)
    boat.listen(1.0)
    go = dialect.MAV_CMD_DO_REPOSITION
    assert boat.command(go, -1, 0, place_of=place(100.0, 100.0)) == REJECTED
    assert boat.command(go, 5, 1, place_of=place(100.0, 100.0)) == dialect.MAV_RESULT_UNSUPPORTED
    for where in ((91.0, 0.0), (0.0, 0.0), (math.nan, 10.0)):
        assert boat.command(go, -1, 1, 0, 0, *where) == dialect.MAV_RESULT_DENIED
    local = dialect.MAVLink_command_int_message(1, 1, 1, go, 0, 0, -1, 1, 0, 0, 1000, 1000, 0.0)
    assert only(boat.ask(local), "COMMAND_ACK")[0].result == dialect.MAV_RESULT_DENIED
    assert boat.command(go, math.nan, 1, place_of=place(100.0, 100.0)) == ACCEPTED
    assert mode_of(boat) == GUIDED
    assert boat.command(SET_MODE, 1, GUIDED) == ACCEPTED and boat.track.following
    tick = boat.sail(60.0)
    assert "the place has been reached: holding 0" in words_of(tick)[0]
    assert math.hypot(boat.north, boat.east) > 200.0 and abs(boat.north - boat.east) < 25.0
    assert tick.order.heading == pytest.approx(math.radians(45.0), abs=0.1)


def test_a_place_ends_a_route_only_with_the_flag_that_changes_the_mode() -> None:
    boat = under_way()
    go = dialect.MAV_CMD_DO_REPOSITION
    assert boat.command(go, -1, 0, place_of=place(500.0, 0.0)) == REJECTED
    assert mode_of(boat) == AUTO
    assert boat.command(go, -1, 1, place_of=place(500.0, 0.0)) == ACCEPTED
    assert mode_of(boat) == GUIDED


def test_a_trial_tells_its_progress_and_goes_back_to_the_heading() -> None:
    boat = ServedBoat(armed=True)
    boat.listen(1.0)
    boat.command(SET_MODE, 1, GUIDED)
    heading = boat.sail(1.0).order.heading
    zigzag = dialect.MAV_CMD_USER_1
    assert boat.command(zigzag, 10, 10, 10) == dialect.MAV_RESULT_IN_PROGRESS
    assert boat.command(zigzag, 10, 10, 10) == dialect.MAV_RESULT_IN_PROGRESS, "said again, not begun again"
    assert boat.command(dialect.MAV_CMD_USER_2, 10, 10) == REJECTED
    assert mode_of(boat) == STEERING
    acks = only(boat.listen(12.0), "COMMAND_ACK")
    progress = [ack.progress for ack in acks if ack.result == dialect.MAV_RESULT_IN_PROGRESS]
    assert progress == sorted(progress) and len(progress) >= 7 and progress[-1] > 80
    assert [ack.result for ack in acks][-1] == ACCEPTED
    tick = boat.sail(10.0)
    assert (tick.order.kind, tick.order.heading) == (OrderKind.HEADING, heading)


def test_a_trial_is_cancelled_refused_and_overridden() -> None:
    boat = ServedBoat(armed=True)
    boat.listen(1.0)
    turn = dialect.MAV_CMD_USER_2
    assert boat.command(turn, -10, 60) == dialect.MAV_RESULT_IN_PROGRESS
    assert boat.sail(2.0).command.angle == pytest.approx(-math.radians(10.0))
    acks = only(boat.ask(CommandCancel(1, 1, turn)), "COMMAND_ACK")
    assert (acks[-1].command, acks[-1].result) == (turn, CANCELLED)
    assert boat.sail(0.2).mode is Mode.STANDBY, "nothing was steered before"
    assert only(boat.ask(CommandCancel(1, 1, turn)), "COMMAND_ACK") == []
    assert boat.command(turn, 80, 60) == dialect.MAV_RESULT_DENIED
    assert texts(boat)[-1].startswith("rudder 80 deg: -30 to 30 are allowed")
    assert boat.command(SET_MODE, 1, STEERING) == dialect.MAV_RESULT_DENIED
    assert boat.command(turn, 10, 60) == dialect.MAV_RESULT_IN_PROGRESS
    boat.sail(2.0)
    acks = only(boat.listen(1.0, helm=TAKEN), "COMMAND_ACK")
    assert acks[-1].result == dialect.MAV_RESULT_FAILED
    assert boat.sail(5.0, helm=FREE).mode is Mode.OVERRIDE
    boat.command(ARM, 0)
    assert boat.command(turn, 10, 60) == REJECTED


def test_a_log_of_a_route_replays_bit_for_bit_with_its_alarms(tmp_path: Path) -> None:
    boat = under_way()
    boat.sail(10.0, gps=False)
    boat.sail(5.0)
    vessel = vessel_of(BOATS["lanxin"])
    log = tmp_path / "route.tlog"
    recorder = Recorder(log, {"norrbin": "test", "vessel": dump_vessel(vessel), "law": None}, 0.0)
    for tick in boat.ticks:
        recorder.record(tick, [])
    recorder.close()
    assert replay(log).identical
    said = [words(sample.event) for tick in boat.ticks for sample in tick.samples if isinstance(sample, AlarmSample)]
    assert len(said) == 2 and said[0].startswith("position lost") and said[1] == ""


def test_the_modes_are_listed_with_names_of_our_own_and_followed() -> None:
    boat = ServedBoat(armed=True)
    boat.listen(1.0)
    development = importlib.import_module("pymavlink.dialects.v20.development")
    reader = development.MAVLink(None)

    def read() -> list[Any]:
        boat.sail(0.1)
        frames = [data for data in boat.far.receive() if int.from_bytes(data[7:10], "little") in (435, 436)]
        return [reader.decode(bytearray(frame)) for frame in frames]

    ask = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_REQUEST_MESSAGE, 0, 435, 0, 0, 0, 0, 0, 0)
    boat.far.send(boat.station.encode(ask))
    listed = {mode.mode_name: mode for mode in read()}
    assert {name: mode.custom_mode for name, mode in listed.items()} == {
        "Manual": 0, "Heading": 15, "Track": 10, "Trial": 3, "Wind": 1,
    }  # fmt: skip
    assert [mode.mode_index for mode in listed.values()] == [1, 2, 3, 4, 5]
    assert listed["Track"].standard_mode == development.MAV_STANDARD_MODE_MISSION
    assert listed["Trial"].properties == development.MAV_MODE_PROPERTY_NOT_USER_SELECTABLE
    upload(boat, ROUTE)
    assert boat.command(262, development.MAV_STANDARD_MODE_MISSION) == ACCEPTED
    boat.sail(0.5)
    boat.command(dialect.MAV_CMD_SET_MESSAGE_INTERVAL, 436, 100000)
    boat.sail(0.2)
    (now, *_) = [mode for mode in read() if mode.id == 436]
    assert (now.custom_mode, now.intended_custom_mode, now.standard_mode) == (AUTO, AUTO, 6)
    assert boat.command(262, 7) == dialect.MAV_RESULT_UNSUPPORTED


def test_a_turn_pattern_is_ordered_by_number() -> None:
    boat = ServedBoat()
    boat.listen(1.0)
    pattern = dialect.MAV_CMD_USER_3
    assert boat.command(pattern, 0, 1) == REJECTED
    boat.command(ARM, 1)
    assert boat.command(pattern, 7, 1) == dialect.MAV_RESULT_DENIED
    assert boat.command(pattern, 1, 0, 50) == dialect.MAV_RESULT_DENIED
    assert boat.command(pattern, math.nan, 1) == dialect.MAV_RESULT_DENIED
    assert boat.command(pattern, 0, -1) == ACCEPTED
    assert mode_of(boat) == GUIDED
    assert abs(boat.sail(40.0).state.heading) == pytest.approx(math.pi, abs=0.05)
    boat.listen(0.1)
    assert {"arm first", "pattern 7: allowed is 0 to 6"} <= set(texts(boat))
    assert boat.command(pattern, 1, 1, 50) == ACCEPTED
    assert boat.sail(5.0).order.is_led
    assert boat.command(dialect.MAV_CMD_DO_SET_MODE, 1, GUIDED) == ACCEPTED
    held = boat.sail(0.1).order
    assert not held.is_led and boat.sail(10.0).order.heading == held.heading, "the mode that holds ends the pattern"


def test_orders_from_while_the_pilot_stood_still_are_not_carried_out_but_a_release_is() -> None:
    """Who sent them has been without an answer since, and may have the helm."""
    boat = under_way()
    boat.skipper.engage(0.0)
    assert boat.sail(1.0).mode is Mode.ENGAGED

    def order(command: int, value: float) -> Any:
        return dialect.MAVLink_command_long_message(1, 1, command, 0, value, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    for message in (order(YAW, 90.0), order(OVERBOARD, 1.0)):
        boat.far.send(boat.station.encode(message))
    boat.box.time += 8.0  # the process was stopped
    acks = only(boat.listen(0.2), "COMMAND_ACK")
    assert [ack.result for ack in acks] == [REJECTED, ACCEPTED]
    assert boat.sail(0.5).order.heading == 0.0
    assert boat.command(YAW, 90.0) == ACCEPTED
    assert boat.sail(0.1).order.heading == pytest.approx(math.radians(90.0))
    boat.far.send(boat.station.encode(order(ARM, 0.0)))
    boat.box.time += 8.0
    boat.listen(0.2)
    assert not boat.commands.armed
