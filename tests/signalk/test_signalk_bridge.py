"""The bridge to Signal K: deltas from what the pilot tells, orders only with the token, malformed lines."""

from __future__ import annotations

import contextlib
import json
import math
import socket
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.base import UNSEEN
from autopilot.links.ground_station.orders import HEADING, MANUAL
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.transports import LoopbackTransport, loopback_pair
from autopilot.signalk.bridge import BEHIND_MOST, CLIENTS_MOST, Bridge, LineClients
from autopilot.signalk.messages import (
    LINE_MOST,
    NOTIFICATIONS,
    OURS_ALONE,
    OVER,
    BadRequestError,
    Deltas,
    answer,
    name_of,
    parse,
    path_of,
    state_of,
    values_of,
)
from autopilot.web.station import BoatLine, Station

TOKEN = "a-token-of-enough-letters"


class Boat:
    """As much of a served pilot as the bridge talks to."""

    def __init__(self, line: LoopbackTransport) -> None:
        self._line, self._codec = line, MavlinkCodec(1, 1)
        self.mode, self.commands, self.result = HEADING, [], dialect.MAV_RESULT_ACCEPTED
        self.order_deg = 90.0
        self.magnetic = 0.0
        self.place = (0.0, 0.0)

    def tell(self) -> None:
        messages = [
            dialect.MAVLink_heartbeat_message(
                dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_GENERIC, 129, self.mode, 4, 3
            ),
            dialect.MAVLink_attitude_message(1000, 0.0, 0.0, 1.5, 0.0, 0.0, -0.02),
            dialect.MAVLink_named_value_float_message(1000, b"rud_deg", 7.0),
            dialect.MAVLink_named_value_float_message(1000, b"ord_deg", self.order_deg),
            dialect.MAVLink_named_value_float_message(1000, b"magnetic", self.magnetic),
        ]
        for message in messages:
            self._line.send(self._codec.encode(message))

    def answer(self) -> None:
        for data in self._line.receive():
            for message in MavlinkCodec().decode(data):
                if message.get_type() == "COMMAND_LONG":
                    if message.command != dialect.MAV_CMD_SET_MESSAGE_INTERVAL:
                        self.commands.append((message.command, message.param1, message.param2))
                        self.place = (message.param5, message.param6)
                    reply = dialect.MAVLink_command_ack_message(message.command, self.result)
                    self._line.send(self._codec.encode(reply))


class Rig:
    def __init__(self, token: str = TOKEN) -> None:
        near, far = loopback_pair()
        self.boat, self.station, self.said = Boat(far), Station(), []
        line = BoatLine("udpin:127.0.0.1:1", self.station, opens=lambda _: near)
        self.clients = LineClients("127.0.0.1", 0, LINE_MOST)
        self.bridge = Bridge(self.station, line, self.clients, token, self.said.append)
        self.now = 0.0

    def connect(self) -> socket.socket:
        line = socket.create_connection(("127.0.0.1", self.clients.port), timeout=10.0)
        self.turn()
        return line

    def turn(self, count: int = 1) -> None:
        for _ in range(count):
            self.now += 0.05
            self.boat.tell()
            self.bridge.turn(self.now)
            self.boat.answer()

    def ask(self, line: socket.socket, path: str, value: Any, token: str | None = TOKEN) -> dict[str, Any]:
        carried = {} if token is None else {"token": token}
        line.sendall(json.dumps({"requestId": "7", **carried, "put": {"path": path, "value": value}}).encode() + b"\n")
        return self.reply(line)

    def reply(self, line: socket.socket) -> dict[str, Any]:
        line.settimeout(0.01)
        received = b""
        for _ in range(400):
            self.turn()
            try:
                received += line.recv(65536)
            except TimeoutError:
                continue
            answers = [json.loads(each) for each in received.split(b"\n")[:-1] if b"statusCode" in each]
            if answers:
                return answers[0]
        raise AssertionError(f"no answer in {received!r}")


@pytest.fixture
def rig() -> Any:
    made = Rig()
    yield made
    made.bridge.close()


class Crowd:
    """A listener at which another always waits."""

    def __init__(self, inside: socket.socket) -> None:
        self._inside, self.come, self._ends = inside, 0, list[socket.socket]()

    def accept(self) -> tuple[socket.socket, tuple[str, int]]:
        self.come += 1
        assert self.come < 3000, "no turn ends"
        near, far = socket.socketpair()
        far.close()
        return near, ("192.0.2.1", self.come)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inside, name)


def test_clients_that_connect_without_end_keep_no_order_waiting_and_are_not_all_said(rig: Rig) -> None:
    with rig.connect() as skipper:
        crowd = rig.clients._listener = Crowd(rig.clients._listener)  # type: ignore[assignment]
        rig.boat.mode = HEADING
        rig.turn(20)
        assert rig.ask(skipper, "steering.autopilot.state", "standby")["statusCode"] == 200
    assert crowd.come > 20 and len(rig.said) < 20.0 * 0.05 * 20 + 60.0


def test_what_the_pilot_tells_comes_in_signal_k_units(rig: Rig) -> None:
    rig.turn(3)
    values = values_of(rig.station, rig.now)
    assert values["navigation.headingTrue"] == pytest.approx(1.5, abs=1e-3)
    assert values["navigation.rateOfTurn"] == pytest.approx(-0.02, abs=1e-3)
    assert values["steering.rudderAngle"] == pytest.approx(math.radians(7.0), abs=1e-3)
    assert values["steering.autopilot.target.headingTrue"] == pytest.approx(math.pi / 2)
    assert (values["steering.autopilot.state"], values["steering.autopilot.engaged"]) == ("auto", True)
    rig.boat.mode = MANUAL
    rig.turn()
    standing = values_of(rig.station, rig.now)
    assert standing["steering.autopilot.state"] == "standby"
    assert standing["steering.autopilot.target.headingTrue"] is None


def test_magnetic_courses_are_no_true_ones(rig: Rig) -> None:
    rig.boat.magnetic = 1.0
    rig.turn(3)
    values = values_of(rig.station, rig.now)
    assert values["navigation.headingMagnetic"] == pytest.approx(1.5, abs=1e-3)
    assert values["steering.autopilot.target.headingMagnetic"] == pytest.approx(math.pi / 2)
    assert "navigation.headingTrue" not in values
    with rig.connect() as line:
        refused = rig.ask(line, "steering.autopilot.target.headingTrue", 1.0)
        assert refused["statusCode"] == 409 and "magnetic courses" in refused["message"]
        assert rig.ask(line, "steering.autopilot.actions.adjustHeading", 10.0)["statusCode"] == 200


def test_a_pilot_that_falls_silent_is_off_line_and_nothing_stale_is_reported(rig: Rig) -> None:
    assert state_of(rig.station, 0.0) == "off-line"
    rig.turn(3)
    values = values_of(rig.station, rig.now + 10.0)
    assert values.pop("steering.autopilot.state") == "off-line"
    assert values.pop("steering.autopilot.engaged") is False
    assert set(values.values()) == {None}


def test_only_what_changes_is_reported_between_whole_deltas(rig: Rig) -> None:
    rig.turn(3)
    deltas = Deltas()
    first = deltas.due(rig.station, rig.now)
    assert first is not None and [len(update["values"]) for update in first["updates"]] == [12]
    assert deltas.due(rig.station, rig.now) is None
    rig.boat.order_deg = 95.0
    rig.turn()
    changed = deltas.due(rig.station, rig.now)
    assert changed is not None
    target = "steering.autopilot.target"
    assert {each["path"] for each in changed["updates"][0]["values"]} == {target, f"{target}.headingTrue"}
    again = deltas.due(rig.station, rig.now + 0.5 + Deltas.ALL_S)
    assert again is not None and [len(update["values"]) for update in again["updates"]] == [12]


def test_each_alarm_has_a_notification_that_sounds_until_it_is_acknowledged_and_ends_with_it(rig: Rig) -> None:
    rig.turn(3)
    deltas, board = Deltas(), rig.station.alarms
    deltas.due(rig.station, rig.now)

    def notified(*alarms: tuple[str, str, str]) -> dict[str, Any]:
        named = ({"priority": "warning"} | dict(zip(("name", "words", "state"), each, strict=True)) for each in alarms)
        board._take(json.dumps(list(named)).encode())
        rig.now += 0.1
        delta = deltas.due(rig.station, rig.now)
        return {each["path"]: each["value"] for each in delta["updates"][0]["values"]} if delta else {}

    gear = path_of({"name": "", "words": "gear hot"})
    found = notified(("roll", "heeled too far", "sounding"), ("", "gear hot", "notice"))
    assert found[NOTIFICATIONS + "roll"] == {
        "state": "warn",
        "method": ["visual", "sound"],
        "message": "heeled too far",
        **OURS_ALONE,
    }
    assert found[gear]["method"] == ["visual"]
    seen = notified(("roll", "heeled too far", "acknowledged"), ("", "gear hot", "notice"))
    assert list(seen) == [NOTIFICATIONS + "roll"] and seen[NOTIFICATIONS + "roll"]["method"] == ["visual"]
    assert notified() == {NOTIFICATIONS + "roll": OVER, gear: OVER}
    rig.now += Deltas.OVER_S + 1.0
    later = deltas.due(rig.station, rig.now)
    assert later is not None and not any(
        each["path"].startswith("notifications.") for update in later["updates"] for each in update["values"]
    )


def test_a_man_overboard_stands_where_signal_k_has_it_for_every_vessel(rig: Rig) -> None:
    rig.turn(3)
    deltas, board = Deltas(), rig.station.alarms
    deltas.due(rig.station, rig.now)
    words = "man overboard (59 20.400 N, 018 04.200 E)"
    for state, method in (("sounding", ["visual", "sound"]), ("acknowledged", ["visual"])):
        alarm = {"name": "man_overboard", "words": words, "state": state, "priority": "emergency"}
        board._take(json.dumps([alarm]).encode())
        rig.now += 0.1
        delta = deltas.due(rig.station, rig.now)
        assert delta is not None
        (update,) = delta["updates"]
        value = {"state": "emergency", "method": method, "message": words, **OURS_ALONE}
        assert update["values"] == [{"path": "notifications.mob", "value": value}]
    assert name_of("notifications.mob") == "man_overboard"
    board._take(b"[]")
    over = deltas.due(rig.station, rig.now + 0.1)
    assert over is not None
    assert over["updates"][0]["values"] == [{"path": "notifications.mob", "value": OVER}]


def test_orders_reach_the_boat_with_the_token_and_not_without(rig: Rig) -> None:
    rig.turn(5)
    line = rig.connect()
    for token in (None, "", "another-token-of-letters"):
        refused = rig.ask(line, "steering.autopilot.actions.adjustHeading", 10, token)
        assert (refused["statusCode"], refused["state"]) == (401, "FAILED")
    assert rig.boat.commands == []
    assert rig.ask(line, "steering.autopilot.actions.adjustHeading", 10)["statusCode"] == 200
    assert rig.boat.commands == [(dialect.MAV_CMD_CONDITION_YAW, 100.0, 0.0)]
    assert rig.ask(line, "steering.autopilot.target.headingTrue", math.pi)["statusCode"] == 200
    assert rig.boat.commands[-1][:2] == (dialect.MAV_CMD_CONDITION_YAW, pytest.approx(180.0))
    assert rig.ask(line, "steering.autopilot.state", "standby")["statusCode"] == 200
    assert rig.boat.commands[-1] == (dialect.MAV_CMD_DO_SET_MODE, 1.0, MANUAL)
    line.close()


def test_an_order_that_was_held_up_on_its_way_is_not_carried_out(rig: Rig) -> None:
    rig.turn(5)
    line = rig.connect()
    (beat,) = [json.loads(each)["beat"] for each in line.recv(65536).split(b"\n") if b"beat" in each]
    assert beat == pytest.approx(rig.now)

    def order(beat: float, path: str, value: Any) -> int:
        put = {"path": path, "value": value}
        line.sendall(json.dumps({"requestId": "7", "token": TOKEN, "beat": beat, "put": put}).encode() + b"\n")
        return int(rig.reply(line)["statusCode"])

    adjust = "steering.autopilot.actions.adjustHeading"
    assert order(beat, adjust, 10) == 200
    rig.now += 5.0  # the bridge stood still, or the line did
    assert order(beat, adjust, 10) == 504
    assert order(beat, "notifications.mob", {"latitude": 1.0, "longitude": 2.0}) == 200, "whoever is overboard still is"
    assert order(beat, "steering.autopilot.state", "standby") == 200, "who lets go has let go"
    assert rig.boat.commands[-1] == (dialect.MAV_CMD_DO_SET_MODE, 1.0, MANUAL)
    rig.turn(60)
    assert order(rig.now, adjust, 10) == 200
    assert [each[0] for each in rig.boat.commands].count(dialect.MAV_CMD_CONDITION_YAW) == 2
    assert order(-1.0, adjust, 10) == 400
    line.close()


def test_whose_dashboard_could_not_show_a_stand_by_engages_nothing(rig: Rig) -> None:
    line = rig.connect()

    def heard() -> list[dict[str, Any]]:
        line.settimeout(10.0)
        return [json.loads(each) for each in line.recv(65536).split(b"\n") if each]

    def order(beat: float, value: str) -> tuple[int, str]:
        put = {"path": "steering.autopilot.state", "value": value}
        line.sendall(json.dumps({"requestId": "7", "token": TOKEN, "beat": beat, "put": put}).encode() + b"\n")
        reply = rig.reply(line)
        return reply["statusCode"], reply.get("message", "")

    rig.turn(30)
    assert order(rig.now, "standby")[0] == 200
    assert order(rig.now, "auto") == (409, UNSEEN), "another dashboard, before the boat has said so"
    rig.boat.mode = MANUAL
    rig.turn(2)
    said = heard()
    beats = [place for place, each in enumerate(said) if each.get("beat", 0.0) >= rig.now - 0.1]
    states = [place for place, each in enumerate(said) if '"standby"' in json.dumps(each)]
    assert states and beats and states[0] < beats[-1], "the newest beat comes behind what it stands for"
    assert order(rig.now, "route") == (409, UNSEEN), "so soon no dashboard has shown it"
    rig.turn(20)
    assert order(rig.now, "auto")[0] == 200
    rig.boat.mode = HEADING
    rig.turn(40)
    seen = rig.now
    rig.boat.mode = MANUAL  # by another station
    rig.turn(40)
    assert order(seen, "auto") == (409, UNSEEN), "an order that the line held"
    assert order(seen, "standby")[0] == 200
    line.close()
    engaged = (dialect.MAV_CMD_DO_SET_MODE, 1.0, HEADING)
    assert rig.boat.commands.count(engaged) == 1


@pytest.mark.parametrize("off", [0.0003, 0.0006])
def test_the_beat_that_comes_with_a_stand_by_stands_for_having_seen_it(rig: Rig, off: float) -> None:
    """Rounded to a millisecond, every other one was from before it: who engaged was refused until the next."""
    line = rig.connect()
    rig.turn(30)
    rig.now += off
    rig.boat.mode = MANUAL  # by another station
    rig.turn(2)
    line.settimeout(10.0)
    *_, beat = [json.loads(each)["beat"] for each in line.recv(65536).split(b"\n") if b"beat" in each]
    rig.turn(17)
    put = {"path": "steering.autopilot.state", "value": "auto"}
    line.sendall(json.dumps({"requestId": "7", "token": TOKEN, "beat": beat, "put": put}).encode() + b"\n")
    assert rig.reply(line)["statusCode"] == 200
    line.close()


def test_without_a_token_nothing_is_obeyed() -> None:
    rig = Rig(token="")
    rig.turn(5)
    line = rig.connect()
    for token in (None, "", TOKEN):
        assert rig.ask(line, "steering.autopilot.state", "standby", token)["statusCode"] == 401
    assert rig.boat.commands == []
    line.close()
    rig.bridge.close()


def test_a_refusal_comes_with_the_boats_own_words(rig: Rig) -> None:
    rig.turn(5)
    line = rig.connect()
    rig.boat.result = dialect.MAV_RESULT_TEMPORARILY_REJECTED
    refused = rig.ask(line, "steering.autopilot.state", "auto")
    assert (refused["statusCode"], refused["message"]) == (409, "refused for now")
    line.close()


def test_clients_that_go_come_back_and_flood_trouble_nobody(rig: Rig) -> None:
    rig.turn(5)
    first, second = rig.connect(), rig.connect()
    first.close()
    rig.turn(3)
    assert any("has gone" in said for said in rig.said)
    second.sendall(b"x" * (LINE_MOST + 10000))
    for _ in range(200):
        rig.turn()
        if any("sent too much" in said for said in rig.said):
            break
    assert any("sent too much" in said for said in rig.said)
    third = rig.connect()
    for _ in range(3000):  # reads nothing
        rig.clients.send(b"y" * 10000 + b"\n")
    rig.turn()
    assert any("does not keep up" in said for said in rig.said), BEHIND_MOST
    again = rig.connect()
    assert rig.ask(again, "steering.autopilot.actions.adjustHeading", -1)["statusCode"] == 200
    for line in (second, third, again):
        line.close()


NINES = b"9" * 400


@pytest.mark.parametrize(
    ("line", "status", "words"),
    [
        (b"GET / HTTP/1.1", 400, "one object of JSON"),
        (b"[1]", 400, "one object of JSON"),
        (b'{"put":{}}', 400, "requestId"),
        (b'{"requestId":"1"}', 401, "no valid token"),
        (b'{"requestId":"1","put":{"path":"~state","value":"wind"}}', 401, "no valid token"),
        (b'{"requestId":"1","token":"\\ud800","put":{"path":"x"}}', 400, "half of a character"),
        (b'{"requestId":"1","token":["x"],"put":{"path":"x"}}', 401, "no valid token"),
        (b'{"requestId":"1","put":{"path":"~actions.dodge","value":' + NINES + b"}}", 400, "a number"),
        (b'{"requestId":"1",TOKEN,"put":3}', 400, "put: an object"),
        (
            b'{"requestId":"1",TOKEN,"put":{"path":"~state","value":"sail"}}',
            400,
            "auto, wind, route, standby",
        ),
        (b'{"requestId":"1",TOKEN,"put":{"path":"~state","value":"\\ud800"}}', 400, "half of a character"),
        (
            b'{"requestId":"1",TOKEN,"put":{"path":"~target.headingTrue","value":"90"}}',
            400,
            "a number",
        ),
        (
            b'{"requestId":"1",TOKEN,"put":{"path":"~target.headingTrue","value":1e999}}',
            400,
            "a number",
        ),
        (
            b'{"requestId":"1",TOKEN,"put":{"path":"~actions.dodge","value":' + NINES + b"}}",
            400,
            "a number",
        ),
        (b'{"requestId":"1",TOKEN,"put":{"path":"~target.headingTrue","value":NaN}}', 400, "of JSON"),
        (
            b'{"requestId":"1",TOKEN,"put":{"path":"~actions.adjustHeading","value":true}}',
            400,
            "a number",
        ),
        (b'{"requestId":"1",TOKEN,"put":{"path":"~actions.tack","value":1}}', 400, "port, starboard are"),
        (b'{"requestId":"1",TOKEN,"put":{"path":"notifications.mob","value":true}}', 400, "a position, or null"),
        (b'{"requestId":"1",TOKEN,"put":{"path":"notifications.mob","value":{"latitude":1}}}', 400, "longitude"),
        (b'{"requestId":"1",TOKEN,"put":{"path":"~mode","value":"gps"}}', 400, "compass, wind, true wind, route"),
        (b'{"requestId":"1",TOKEN,"put":{"path":"~actions.sail","value":1}}', 405, "allowed are"),
        (b'{"requestId":"1",TOKEN,"put":{"path":["x"],"value":1}}', 405, "allowed are"),
        (
            b'{"requestId":"1",TOKEN,"put":{"path":"\\u001b[31m' + b"x" * 3000 + b'","value":1}}',
            405,
            "allowed are",
        ),
        (b"[" * 100000, 400, "one object of JSON"),
        (b'{"requestId":' + b"[" * 4000, 400, "one object of JSON"),
        (b"\xed\xa0\x80", 400, "one object of JSON"),
    ],
)
def test_malformed_requests_are_one_sentence(line: bytes, status: int, words: str) -> None:
    with pytest.raises(BadRequestError) as caught:
        parse(line.replace(b"TOKEN", b'"token":"%b"' % TOKEN.encode()).replace(b"~", b"steering.autopilot."), TOKEN)
    assert caught.value.status == status and words in str(caught.value)
    assert len(str(caught.value)) < 400 and str(caught.value).isprintable()
    assert json.loads(answer(caught.value.id, status, str(caught.value)))["statusCode"] == status


def test_an_alarm_of_somebody_else_acknowledged_here_silences_none_of_ours() -> None:
    def asked(value: Any) -> bytes:
        put = {"path": "steering.autopilot.actions.acknowledge", "value": value}
        return json.dumps({"requestId": "1", "token": TOKEN, "put": put}).encode()

    for path in ("notifications.navigation.anchor", NOTIFICATIONS + "nonsense"):
        with pytest.raises(BadRequestError, match="no alarm of this pilot") as caught:
            parse(asked(path), TOKEN)
        assert caught.value.status == 400
    assert parse(asked(NOTIFICATIONS + "roll"), TOKEN).order == {"do": "acknowledge", "name": "roll"}
    assert parse(asked(None), TOKEN).order == {"do": "acknowledge"}


@given(st.binary(max_size=200))
def test_any_bytes_are_a_request_or_refused(line: bytes) -> None:
    with contextlib.suppress(BadRequestError):
        assert parse(line, TOKEN).id


json_values = st.recursive(st.none() | st.booleans() | st.floats() | st.text(max_size=5), st.lists, max_leaves=4)


@given(st.sampled_from(["steering.autopilot.state", "steering.autopilot.actions.dodge", "x"]), json_values)
def test_any_value_is_an_order_in_range_or_refused(path: str, value: Any) -> None:
    line = json.dumps({"requestId": "1", "token": TOKEN, "put": {"path": path, "value": value}}).encode()
    try:
        request = parse(line, TOKEN)
    except BadRequestError:
        return
    assert request.order is not None and abs(request.order.get("degrees", 0.0)) <= 360.0


MISFIT = [
    b"9" * 400,
    b"-" + b"9" * 5000,
    b"1e999",
    b"1e-999",
    b'"\\ud800"',
    b"[" * 2000,
    b'{"a":' * 900,
    b"NaN",
    b"-0",
]


@pytest.mark.parametrize("misfit", MISFIT, ids=range(len(MISFIT)))
@pytest.mark.parametrize("place", ["requestId", "token", "put", "path", "value"])
def test_a_line_of_a_stranger_ends_nothing_and_is_answered(rig: Rig, place: str, misfit: bytes) -> None:
    rig.turn(5)
    line, friend = rig.connect(), rig.connect()
    parts = {"requestId": b'"7"', "token": b'"wrong"', "path": b'"steering.autopilot.actions.dodge"', "value": b"1"}
    parts["put"] = b'{"path":%b,"value":%b}' % (parts["path"], parts["value"])
    if place in ("path", "value"):
        parts[place] = misfit
        parts["put"] = b'{"path":%b,"value":%b}' % (parts["path"], parts["value"])
    parts[place] = misfit
    line.sendall(b'{"requestId":%b,"token":%b,"put":%b}\n' % (parts["requestId"], parts["token"], parts["put"]))
    with contextlib.suppress(AssertionError):  # a line longer than LINE_MOST is hung up on
        assert rig.reply(line)["statusCode"] in (400, 401)
    assert rig.boat.commands == []
    assert rig.ask(friend, "steering.autopilot.actions.adjustHeading", 10)["statusCode"] == 200
    line.close(), friend.close()


@pytest.mark.parametrize(
    ("value", "place"), [({"latitude": 57.5, "longitude": -11.25}, (57.5, -11.25)), (None, (0.0, 0.0))]
)
def test_a_man_overboard_whom_signal_k_knows_of_is_said_to_the_pilot(
    rig: Rig, value: dict[str, float] | None, place: tuple[float, float]
) -> None:
    rig.turn(5)
    line = rig.connect()
    assert rig.ask(line, "notifications.mob", value)["statusCode"] == 200
    assert rig.boat.commands == [(dialect.MAV_CMD_SPATIAL_USER_3, 1.0, 1.0)] and rig.boat.place == place
    line.close()


def test_a_boat_that_does_not_answer_is_a_time_out(rig: Rig) -> None:
    rig.turn(5)
    line = rig.connect()
    rig.boat.answer = lambda: rig.boat._line.receive()  # type: ignore[method-assign,func-returns-value]
    refused = rig.ask(line, "steering.autopilot.state", "auto")
    assert (refused["statusCode"], refused["message"]) == (504, "the boat does not answer")
    line.close()


def test_idle_clients_keep_nobody_out_and_who_has_the_token_keeps_its_place(rig: Rig) -> None:
    rig.turn(5)
    plugin = rig.connect()
    plugin.sendall(json.dumps({"requestId": "greeting", "token": TOKEN}).encode() + b"\n")
    assert rig.reply(plugin)["statusCode"] == 200
    idle = [rig.connect() for _ in range(3 * CLIENTS_MOST)]
    newcomer = rig.connect()
    assert rig.ask(newcomer, "steering.autopilot.actions.adjustHeading", 10)["statusCode"] == 200
    assert rig.ask(plugin, "steering.autopilot.actions.adjustHeading", 10)["statusCode"] == 200
    assert len(rig.clients.descriptors) == CLIENTS_MOST + 1
    for line in (plugin, newcomer, *idle):
        line.close()
