"""Missions over MAVLink: upload, download and refusals, on a good link and on a bad one, and by another's program."""

from __future__ import annotations

import math
from pathlib import Path
from random import Random
from typing import Any

import pytest
from boat_at_sea import ServedBoat, item, only, place
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import mavutil, mavwp
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.guidance.track import TrackGuide, Waypoint
from autopilot.links.ground_station.mission import (
    Mission,
    MissionItem,
    MissionServer,
    dump_items,
    from_message,
    parse_items,
    problem,
)
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.url import open_transport
from autopilot.signals import PositionSample

AGAIN_S = 0.8
TRIES = 6

ROUTE = [place(0.0, 200.0), place(400.0, 200.0), Waypoint(*place(400.0, 0.0).place, 25.0)]


class Peers:
    """The server alone, and a ground station's codec; what is said is decoded from real bytes."""

    def __init__(self) -> None:
        self.mission = Mission(TrackGuide())
        self.server = MissionServer(self.mission)
        self.now = 0.0

    def send_text(self, message: Any, system: int = 255) -> list[Any]:
        (received,) = MavlinkCodec().decode(MavlinkCodec(system, 190).encode(message))
        return self.server.take(self.now, received)

    def upload(self, items: list[Any], system: int = 255) -> Any:
        answers = self.send_text(dialect.MAVLink_mission_count_message(1, 1, len(items)), system)
        for message in items:
            (wanted,) = answers
            assert (wanted.get_type(), wanted.seq) == ("MISSION_REQUEST_INT", message.seq)
            assert (wanted.target_system, wanted.target_component) == (system, 190)
            answers = self.send_text(message, system)
            if answers[0].get_type() == "MISSION_ACK":
                break
        return answers[0]


def items_of(route: list[Waypoint]) -> list[Any]:
    return [item(number, waypoint) for number, waypoint in enumerate(route)]


def test_what_is_uploaded_is_downloaded_item_by_item() -> None:
    peers = Peers()
    assert peers.upload(items_of(ROUTE)).type == dialect.MAV_MISSION_ACCEPTED
    assert peers.server.said == "route of 3 waypoints taken"
    (count,) = peers.send_text(dialect.MAVLink_mission_request_list_message(1, 1))
    assert count.count == 3
    for number, sent in enumerate(items_of(ROUTE)):
        (got,) = peers.send_text(dialect.MAVLink_mission_request_int_message(1, 1, number))
        for name in ("seq", "frame", "command", "param1", "param2", "x", "y", "z", "autocontinue"):
            assert getattr(got, name) == getattr(sent, name)
        assert got.current == (number == 0)
        (old,) = peers.send_text(dialect.MAVLink_mission_request_message(1, 1, number))
        assert old.get_type() == "MISSION_ITEM" and old.x == pytest.approx(sent.x * 1e-7, abs=1e-5)
    (ack,) = peers.send_text(dialect.MAVLink_mission_request_int_message(1, 1, 3))
    assert ack.type == dialect.MAV_MISSION_INVALID_SEQUENCE
    radius = [waypoint.radius for waypoint in peers.mission.route]
    assert math.isnan(radius[0]) and radius[2] == 25.0


@pytest.mark.parametrize(
    ("bad", "result", "says"),
    [
        (item(1, ROUTE[0], command=21), dialect.MAV_MISSION_UNSUPPORTED, "item 1 is NAV_LAND: only NAV_WAYPOINT"),
        (item(1, ROUTE[0], command=177), dialect.MAV_MISSION_UNSUPPORTED, "item 1 is DO_JUMP"),
        (item(1, ROUTE[0], command=64999), dialect.MAV_MISSION_UNSUPPORTED, "item 1 is 64999"),
        (item(1, ROUTE[0], frame=1), dialect.MAV_MISSION_UNSUPPORTED_FRAME, "item 1 is in frame 1"),
        (item(1, ROUTE[0], hold=10.0), dialect.MAV_MISSION_INVALID_PARAM1, "item 1 waits 10 s"),
        (item(1, Waypoint(1.56, 0.0)), dialect.MAV_MISSION_INVALID_PARAM5_X, "item 1: latitude 89.3814"),
        (item(1, Waypoint(0.0, 3.2)), dialect.MAV_MISSION_INVALID_PARAM6_Y, "item 1: longitude 183.346"),
        (item(1, Waypoint(0.0, 0.0)), dialect.MAV_MISSION_INVALID_PARAM5_X, "item 1 lies at 0 N 0 E"),
    ],
)
def test_a_route_that_cannot_be_followed_is_refused_whole_and_named(bad: Any, result: int, says: str) -> None:
    peers = Peers()
    peers.upload(items_of(ROUTE[:1]))
    before = peers.mission.items
    assert peers.upload([item(0, ROUTE[1]), bad, item(2, ROUTE[2])]).type == result
    assert peers.server.said.startswith(f"route refused: {says}") and peers.server.said.endswith(
        "the old route is kept"
    )
    assert peers.mission.items == before
    assert peers.server.due(100.0) == []


def test_an_item_that_does_not_come_is_asked_for_again_and_then_given_up() -> None:
    peers = Peers()
    peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 2))
    peers.send_text(item(0, ROUTE[0]))
    asked = []
    for _ in range(1000):
        peers.now += 0.05
        asked.extend((peers.now, message) for message in peers.server.due(peers.now))
    assert [message.get_type() for _, message in asked] == ["MISSION_REQUEST_INT"] * (TRIES - 1) + ["MISSION_ACK"]
    assert asked[-1][0] == pytest.approx(TRIES * AGAIN_S, abs=0.5)
    assert asked[-1][1].type == dialect.MAV_MISSION_OPERATION_CANCELLED
    assert peers.mission.items == () and peers.mission.uploader is None


def test_one_uploads_at_a_time_and_its_last_item_may_be_repeated() -> None:
    peers = Peers()
    other = MissionServer(peers.mission)
    peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 2))
    (ack,) = peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 1), system=254)
    assert ack.type == dialect.MAV_MISSION_DENIED
    (count,) = MavlinkCodec().decode(MavlinkCodec(253, 190).encode(dialect.MAVLink_mission_count_message(1, 1, 1)))
    assert other.take(0.0, count)[0].type == dialect.MAV_MISSION_DENIED
    assert peers.send_text(item(0, ROUTE[0]), system=254) == []
    assert peers.send_text(item(1, ROUTE[1]))[0].seq == 0, "the one that is missing is asked for again"
    peers.send_text(item(0, ROUTE[0]))
    assert peers.send_text(item(0, ROUTE[0])) == []
    for _ in range(3):
        assert peers.send_text(item(1, ROUTE[1]))[0].type == dialect.MAV_MISSION_ACCEPTED
    assert other.take(0.0, count)[0].get_type() == "MISSION_REQUEST_INT"


def test_other_lists_are_empty_parts_are_refused_and_clearing_clears() -> None:
    peers = Peers()
    peers.upload(items_of(ROUTE))
    fence = dialect.MAV_MISSION_TYPE_FENCE
    assert peers.send_text(dialect.MAVLink_mission_request_list_message(1, 1, fence))[0].count == 0
    assert (
        peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 2, fence))[0].type
        == dialect.MAV_MISSION_UNSUPPORTED
    )
    (part,) = peers.send_text(dialect.MAVLink_mission_write_partial_list_message(1, 1, 0, 1))
    assert part.type == dialect.MAV_MISSION_UNSUPPORTED
    assert peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 501))[0].type == dialect.MAV_MISSION_NO_SPACE
    assert peers.send_text(dialect.MAVLink_mission_clear_all_message(1, 1, fence))[0].mission_type == fence
    assert len(peers.mission.items) == 3
    assert peers.send_text(dialect.MAVLink_mission_clear_all_message(1, 1))[0].type == dialect.MAV_MISSION_ACCEPTED
    assert peers.mission.items == () and peers.mission.message().mission_state == dialect.MISSION_STATE_NO_MISSION


def fields(message: Any) -> tuple[Any, ...]:
    return (message.get_type(), *(getattr(message, name) for name in message.fieldnames))


def test_a_missing_item_is_asked_for_six_times_eight_tenths_of_a_second_apart() -> None:
    peers = Peers()
    peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 2))
    peers.now = 5.0
    (wanted,) = peers.send_text(item(0, ROUTE[0]))
    assert fields(wanted) == ("MISSION_REQUEST_INT", 255, 190, 1, 0)
    asked = []
    for turn in range(1, 512):
        now = 5.0 + turn / 64.0
        asked += [(turn, fields(message)[0]) for message in peers.server.due(now)]
    # 0.8 s is 51.2 of them
    assert asked == [(52 * number, "MISSION_REQUEST_INT") for number in range(1, 6)] + [(52 * 6, "MISSION_ACK")]
    peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 1))
    peers.now += 0.75
    assert peers.server.due(peers.now) == []
    peers.now += 0.0625
    assert fields(peers.server.due(peers.now)[0]) == ("MISSION_REQUEST_INT", 255, 190, 0, 0)
    assert peers.server.said == ""


def test_eight_tenths_of_a_second_to_the_bit_are_waited_for_an_item() -> None:
    peers = Peers()
    peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 2))
    assert [len(peers.server.due(now)) for now in (0.7999, 0.8)] == [0, 1]


def test_the_end_of_an_upload_that_stands_still_is_reported_to_its_sender() -> None:
    peers = Peers()
    peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 1), system=254)
    answers = [answer for second in range(1, 9) for answer in peers.server.due(float(second))]
    assert fields(answers[-1]) == ("MISSION_ACK", 254, 190, dialect.MAV_MISSION_OPERATION_CANCELLED, 0)
    assert len(answers) == 6


def test_the_last_item_sent_again_is_answered_for_ten_seconds_to_its_sender() -> None:
    peers = Peers()
    assert peers.send_text(item(0, ROUTE[0])) == [], "nothing was ever uploaded"
    peers.now = 100.0
    peers.upload(items_of(ROUTE[:2]))
    for now, system, number, count in ((110.0, 255, 1, 1), (110.1, 255, 1, 0), (105.0, 254, 1, 0), (105.0, 255, 0, 0)):
        peers.now = now
        answers = peers.send_text(item(number, ROUTE[1]), system)
        assert [fields(answer) for answer in answers] == [("MISSION_ACK", 255, 190, 0, 0)] * count


def test_an_upload_that_was_given_up_is_not_accepted_by_a_late_item_of_the_one_before() -> None:
    peers = Peers()
    peers.upload(items_of(ROUTE[:2]))
    kept = peers.mission.items
    peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 2))
    peers.send_text(dialect.MAVLink_mission_ack_message(1, 1, dialect.MAV_MISSION_OPERATION_CANCELLED))
    assert peers.send_text(item(1, ROUTE[1])) == []
    assert peers.mission.items == kept


def test_an_upload_is_given_up_by_its_sender_alone() -> None:
    peers = Peers()
    assert peers.send_text(dialect.MAVLink_mission_ack_message(1, 1, 15)) == [] and peers.server.said == ""
    peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 2))
    for system, result in ((254, 15), (255, 0)):
        assert peers.send_text(dialect.MAVLink_mission_ack_message(1, 1, result), system) == []
        assert peers.mission.uploader is peers.server
    assert peers.send_text(dialect.MAVLink_mission_ack_message(1, 1, 15)) == []
    assert peers.mission.uploader is None
    assert peers.server.said == "upload of the route given up; the old route is kept"


@pytest.mark.parametrize("kind", [1, 2])
def test_of_other_lists_there_is_nothing(kind: int) -> None:
    peers = Peers()
    peers.upload(items_of(ROUTE))
    ack = ("MISSION_ACK", 255, 190)
    (count,) = peers.send_text(dialect.MAVLink_mission_request_list_message(1, 1, kind))
    assert fields(count)[:5] == ("MISSION_COUNT", 255, 190, 0, kind)
    for number, result in ((0, 0), (1, dialect.MAV_MISSION_UNSUPPORTED)):
        (answer,) = peers.send_text(dialect.MAVLink_mission_count_message(1, 1, number, kind))
        assert fields(answer) == (*ack, result, kind)
    (answer,) = peers.send_text(dialect.MAVLink_mission_request_int_message(1, 1, 0, kind))
    assert fields(answer) == (*ack, dialect.MAV_MISSION_INVALID_SEQUENCE, kind)
    answer, current = peers.send_text(dialect.MAVLink_mission_clear_all_message(1, 1, kind))
    assert (fields(answer), fields(current)[:3]) == ((*ack, 0, kind), ("MISSION_CURRENT", 0, 3))
    (answer,) = peers.send_text(dialect.MAVLink_mission_write_partial_list_message(1, 1, 0, 1, kind))
    assert fields(answer) == (*ack, dialect.MAV_MISSION_UNSUPPORTED, kind)
    assert peers.server.said == "a part of a route cannot be changed: upload the whole route"
    peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 1))
    other = item(0, ROUTE[0])
    other.mission_type = kind
    assert peers.send_text(other) == [] and peers.mission.uploader is peers.server


def test_all_lists_are_cleared_at_once_and_not_while_another_uploads() -> None:
    peers = Peers()
    peers.upload(items_of(ROUTE))
    peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 1), system=254)
    for kind in (0, 255):
        (answer,) = peers.send_text(dialect.MAVLink_mission_clear_all_message(1, 1, kind))
        assert fields(answer) == ("MISSION_ACK", 255, 190, dialect.MAV_MISSION_DENIED, kind)
    answer, current = peers.send_text(dialect.MAVLink_mission_clear_all_message(1, 1, 255), system=254)
    assert fields(answer) == ("MISSION_ACK", 254, 190, 0, 255)
    assert fields(current)[:4] == ("MISSION_CURRENT", 0, 0, dialect.MISSION_STATE_NO_MISSION)
    assert peers.mission.items == () and peers.mission.uploader is None


def test_an_empty_count_clears_and_five_hundred_items_are_taken() -> None:
    peers = Peers()
    peers.upload(items_of(ROUTE))
    assert fields(peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 0))[0]) == ("MISSION_ACK", 255, 190, 0, 0)
    assert peers.mission.items == () and peers.server.said == "route cleared"
    (answer,) = peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 501))
    assert fields(answer) == ("MISSION_ACK", 255, 190, dialect.MAV_MISSION_NO_SPACE, 0)
    assert peers.server.said == "a route of 501 items: up to 500 are taken"
    assert peers.send_text(dialect.MAVLink_mission_count_message(1, 1, 500))[0].get_type() == "MISSION_REQUEST_INT"


def test_the_current_item_is_chosen_by_its_message() -> None:
    peers = Peers()
    peers.upload(items_of(ROUTE))
    for number, current, said in ((2, 2, ""), (3, 2, "there is no waypoint 3 in a route of 3")):
        (answer,) = peers.send_text(dialect.MAVLink_mission_set_current_message(1, 1, number))
        assert fields(answer)[:3] == ("MISSION_CURRENT", current, 3) and peers.server.said == said
    assert [
        peers.send_text(dialect.MAVLink_mission_request_int_message(1, 1, number))[0].current for number in range(3)
    ] == [
        0,
        0,
        1,
    ]
    assert not peers.mission.set_current(-1)


def test_the_state_of_a_mission_from_its_beginning_to_its_end() -> None:
    mission = Mission(TrackGuide())
    states = dialect.enums["MISSION_STATE"]

    def state() -> str:
        return str(states[mission.state].name.removeprefix("MISSION_STATE_"))

    assert state() == "NO_MISSION" and not mission.is_followed
    assert mission.obstacle(0.0) == "there is no route: upload one first"
    kept: list[Any] = []
    mission.save_route = kept.append
    items = tuple(MissionItem(3, 16, (0.0, 0.0, 0.0, 0.0), 1000 * number, 1000, 0.0) for number in (1, 2, 3))
    assert mission.replace(items) is False and kept == [items]
    assert state() == "NOT_STARTED"
    assert mission.obstacle(0.0) == "no position: check the GPS and its link"
    for number in (-1, 3):
        assert mission.obstacle(0.0, number) == f"there is no waypoint {number} in a route of 3"
    mission.guide.take(PositionSample(0.0, 0.0, 0.0))
    assert mission.obstacle(0.0) == mission.obstacle(0.0, 0) == mission.obstacle(0.0, 2) == ""
    assert mission.set_current(1) and not mission.guide.following
    mission.follow()
    assert (state(), mission.guide.target, mission.current) == ("ACTIVE", 1, 1)
    assert mission.set_current(2) and mission.guide.target == 2
    mission.guide.leave()
    assert (state(), mission.current) == ("PAUSED", 2)
    mission.follow()
    mission.guide.is_complete = True
    assert state() == "COMPLETE"
    mission.guide.leave()
    assert state() == "COMPLETE"
    end = "the route has been followed to its end: choose a waypoint to go on with"
    assert (mission.obstacle(0.0), mission.obstacle(0.0, 0)) == (end, "")
    assert mission.set_current(0) and state() == "PAUSED"
    mission.follow()
    assert mission.replace(items) is True, "the old one was being followed"
    assert not mission.guide.following and (state(), mission.current) == ("NOT_STARTED", 0)


@pytest.mark.parametrize(
    ("changes", "result"),
    [
        ({}, 0),
        *(({"frame": frame}, 0) for frame in (0, 3, 5, 6, 10, 11)),
        *(({"frame": frame}, 2) for frame in (1, 2, 4, 7, 8, 9, 12)),
        *(({"command": command}, 3) for command in (15, 17, 0)),
        ({"parameters": (1.0, 5000.0, 0.0, 0.0)}, 0),
        ({"parameters": (1.01, 0.0, 0.0, 0.0)}, 6),
        ({"parameters": (math.inf, 0.0, 0.0, 0.0)}, 6),
        ({"parameters": (0.0, 5000.5, 0.0, 0.0)}, 7),
        ({"x": 890_000_000}, 0),
        ({"x": -890_000_000}, 0),
        ({"x": 890_000_001}, 10),
        ({"x": -890_000_001}, 10),
        ({"y": 1_800_000_000}, 0),
        ({"y": -1_800_000_000}, 0),
        ({"y": 1_800_000_001}, 11),
        ({"y": -1_800_000_001}, 11),
        ({"x": 0, "y": 0}, 10),
        ({"x": 0}, 0),
        ({"y": 0}, 0),
    ],
)
def test_which_items_can_be_followed(changes: dict[str, Any], result: int) -> None:
    number, sentence = problem(4, MissionItem(3, 16, (0.0, 0.0, 0.0, 0.0), 10, 10, 0.0)._replace(**changes))
    assert number == result
    assert sentence.startswith("item 4") is (result != 0) and bool(sentence) is (result != 0)


def test_refusals_name_numbers_and_what_is_allowed() -> None:
    sound = MissionItem(3, 16, (0.0, 0.0, 0.0, 0.0), 10, 10, 0.0)
    for changes, words in (
        ({"parameters": (0.0, 6000.0, 0.0, 0.0)}, "item 4: radius 6000 m, allowed is 5000"),
        ({"x": 900_000_000}, "item 4: latitude 90, up to 89 is allowed"),
        ({"y": 1_900_000_000}, "item 4: longitude 190, allowed is up to 180"),
        ({"frame": 1}, "item 4 is in frame 1: use a global one"),
    ):
        assert problem(4, sound._replace(**changes))[1] == words


@pytest.mark.parametrize(("radius", "within"), [(25.0, 25.0), (0.5, 0.5), (0.0, None), (-3.0, None), (math.inf, None)])
def test_the_waypoint_of_an_item(radius: float, within: float | None) -> None:
    point = MissionItem(3, 16, (7.0, radius, 8.0, 9.0), 450_000_000, -900_000_000, 0.0).waypoint
    assert point[:2] == (pytest.approx(math.pi / 4.0), pytest.approx(-math.pi / 2.0))
    assert point.radius == within if within else math.isnan(point.radius)


@pytest.mark.parametrize(
    ("degrees", "e7"),
    [(12.5, 125_000_000), (-200.0, -2_000_000_000), (200.1, 1_800_000_001), (math.nan, 1_800_000_001)],
)
def test_an_item_of_floats_is_one_of_whole_numbers(degrees: float, e7: int) -> None:
    message = dialect.MAVLink_mission_item_message(1, 1, 0, 3, 16, 0, 1, 1.0, 2.0, 3.0, 4.0, degrees, degrees, 5.0)
    assert from_message(message) == MissionItem(3, 16, (1.0, 2.0, 3.0, 4.0), e7, e7, 5.0, 1)


def test_a_kept_route_is_a_waypoint_file_to_the_letter() -> None:
    items = (
        MissionItem(3, 16, (0.0, 25.5, 0.0, 0.0), 595_000_000, -180_000_001, 0.0),
        MissionItem(6, 16, (0.5, 0.0, 0.0, 90.0), -1, 5, 2.0, 0),
    )
    text = (
        "QGC WPL 110\n"
        "0\t0\t3\t16\t0.0\t25.5\t0.0\t0.0\t59.5000000\t-18.0000001\t0.0\t1\n"
        "1\t0\t6\t16\t0.5\t0.0\t0.0\t90.0\t-0.0000001\t0.0000005\t2.0\t0\n"
    )
    assert dump_items(items) == text
    assert parse_items(text + "# a comment\n\n", "boat") == items
    line = "0\t0\t3\t16\t0\t0\t0\t0\t1\t2\t0\t1\n"
    assert len(parse_items("QGC WPL 110\n" + 500 * line, "boat")) == 500
    with pytest.raises(InputError, match="boat: holds 501 items, up to 500 are allowed"):
        parse_items("QGC WPL 110\n" + 501 * line, "boat")
    with pytest.raises(InputError, match="boat, line 4: item 1 is NAV_LAND"):
        parse_items(f"QGC WPL 110\n{line}\n{line.replace('16', '21')}", "boat")


class BadLink:
    """One direction of a link on which packets are lost, doubled and overtake each other."""

    def __init__(self, random: Random, loss: float) -> None:
        self.random, self.loss = random, loss
        self.held: list[Any] = []

    def carry(self, messages: list[Any]) -> list[Any]:
        out, random = [], self.random
        for message in [*self.held, *messages]:
            if random.random() >= self.loss:
                out.extend([message] * (2 if random.random() < 0.1 else 1))
        self.held = [out.pop()] if out and random.random() < 0.1 else []
        random.shuffle(out)
        return out


def sent_over(peers: Peers, up: BadLink, down: BadLink, items: list[Any]) -> int | None:
    """Upload as the protocol's text says a station does; return the result it got, None for none."""
    newest: Any = dialect.MAVLink_mission_count_message(1, 1, len(items))
    saying, since, tries = [newest], 0.0, 0
    while tries < 12:
        peers.now += 0.1
        answers = [answer for message in up.carry(saying) for answer in peers.send_text(message)]
        saying = []
        for answer in down.carry(answers + peers.server.due(peers.now)):
            if answer.get_type() == "MISSION_ACK":
                return int(answer.type)
            if answer.get_type() == "MISSION_REQUEST_INT":
                newest, since, tries = items[answer.seq], peers.now, 0
                saying.append(newest)
        if not saying and peers.now - since > 1.5:
            since, tries = peers.now, tries + 1
            saying.append(newest)
    return None


@given(st.integers(0, 2**32), st.sampled_from([0.05, 0.3]), st.integers(1, 8))
@settings(max_examples=60, deadline=None)
def test_an_upload_over_a_bad_link_leaves_the_old_or_the_new_route(seed: int, loss: float, count: int) -> None:
    random, peers = Random(seed), Peers()
    peers.upload(items_of(ROUTE[:1]))
    old = peers.mission.items
    new = items_of([place(random.uniform(-900, 900), 50.0 * number) for number in range(count)])
    result = sent_over(peers, BadLink(random, loss), BadLink(random, loss), new)
    taken = peers.mission.items != old
    if taken:
        assert [(kept.x, kept.y) for kept in peers.mission.items] == [(sent.x, sent.y) for sent in new]
    if result is not None:
        assert taken == (result == dialect.MAV_MISSION_ACCEPTED)
    if loss < 0.1:
        assert result == dialect.MAV_MISSION_ACCEPTED


@given(st.lists(st.builds(Waypoint, st.floats(-1.4, 1.4), st.floats(-3.1, 3.1), st.floats(0.0, 5000.0)), max_size=9))
def test_a_kept_route_reads_back_and_pymavlink_reads_it_too(tmp_path_factory: Any, route: list[Waypoint]) -> None:
    items = tuple(
        MissionItem(3, 16, (0.0, point.radius, 0.0, math.nan), round(math.degrees(point[0]) * 1e7) or 1,
                    round(math.degrees(point[1]) * 1e7), 0.0)
        for point in route
    )  # fmt: skip
    text = dump_items(items)
    assert repr(parse_items(text, "boat")) == repr(items)
    path: Path = tmp_path_factory.mktemp("route") / "way.txt"
    path.write_text(text)
    loader = mavwp.MAVWPLoader()
    assert loader.load(str(path)) == len(items)
    for number, kept in enumerate(items):
        assert loader.wp(number).x == pytest.approx(kept.x * 1e-7, abs=1e-7)
        assert loader.wp(number).param2 == pytest.approx(kept.parameters[1])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1 must be"),
        ("QGC WPL 110\n0 0 3 16 0 0 0 0 1 2 0", "line 2: holds 11 values, 12 are needed"),
        ("QGC WPL 110\n0 0 3 16 0 0 0 0 x 2 0 1", "line 2: holds a value that is not a number"),
        ("QGC WPL 110\n0 0 3 21 0 0 0 0 1 2 0 1", "line 2: item 0 is NAV_LAND"),
        ("QGC WPL 110\n0 0 3 16 0 0 0 0 nan 2 0 1", "line 2: item 0: latitude 180"),
        ("QGC WPL 110\n0 0 3 16 inf 0 0 0 1 2 0 1", "line 2: item 0 waits inf s"),
    ],
)
def test_a_damaged_file_is_named_with_its_line(text: str, says: str) -> None:
    with pytest.raises(InputError, match=says):
        parse_items(text, "boat.mission.waypoints")


def test_pymavlink_uploads_and_downloads_a_route_over_udp() -> None:
    """An independent station: mavutil's connection and mavwp's waypoints, with real datagrams."""
    station = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=250, source_component=190)
    port = station.port.getsockname()[1]
    boat = ServedBoat(open_transport(f"udpout:127.0.0.1:{port}"))

    def hear(*kinds: str) -> Any:
        for _ in range(200):
            boat.sail(0.05)
            message = station.recv_match(type=list(kinds))
            if message is not None:
                return message
        raise AssertionError(f"no {kinds}")

    try:
        beat = hear("HEARTBEAT")
        assert (beat.type, beat.get_srcSystem()) == (mavutil.mavlink.MAV_TYPE_SURFACE_BOAT, 1)
        loader = mavwp.MAVWPLoader(1, 1)
        for waypoint in ROUTE:
            loader.add_latlonalt(math.degrees(waypoint.latitude), math.degrees(waypoint.longitude), 0.0)
        station.target_system, station.target_component = 1, 1
        station.waypoint_count_send(loader.count())
        for _ in range(loader.count()):
            wanted = hear("MISSION_REQUEST", "MISSION_REQUEST_INT")
            station.mav.send(loader.wp(wanted.seq))
        assert hear("MISSION_ACK").type == mavutil.mavlink.MAV_MISSION_ACCEPTED
        station.waypoint_request_list_send()
        assert hear("MISSION_COUNT").count == 3
        for number in range(3):
            station.waypoint_request_send(number)
            got = hear("MISSION_ITEM", "MISSION_ITEM_INT")
            sent = loader.wp(number)
            assert got.seq == number and got.x == pytest.approx(sent.x, abs=2e-5 if isinstance(got.x, float) else 200)
        station.waypoint_clear_all_send()
        assert hear("MISSION_ACK").type == mavutil.mavlink.MAV_MISSION_ACCEPTED
        assert boat.mission.items == ()
    finally:
        station.close()
        boat.links[0].close()
    assert not only(boat.heard, "BAD_DATA")
