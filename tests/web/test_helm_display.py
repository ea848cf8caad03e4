"""What a helm display knows and orders, on a simulated boat and clock: every order, loss, silence, another start."""

from __future__ import annotations

import lzma
import math
import struct
import zlib
from typing import Any

import pytest
from alarm_texts import other
from boat_at_sea import place
from hypothesis import given
from hypothesis import strategies as st
from monitored_boat import Watched, noted
from pymavlink.dialects.v20 import ardupilotmega as dialect
from starlette.responses import JSONResponse

from autopilot.errors import InputError
from autopilot.firmware.protocol import Target
from autopilot.firmware.session import FtpClient
from autopilot.links.alarm_outputs import StatusTexts
from autopilot.links.base import LinkError
from autopilot.links.ground_station.file_server import ALARMS, PARAMETERS
from autopilot.links.ground_station.mission import MissionItem
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.signalk.messages import Deltas, line_of
from autopilot.signals import AlarmEvent, AlarmSample, HelmSample, Siren
from autopilot.web.journal import LIST_MOST, AlarmBoard, Track, alarms_from, route_from
from autopilot.web.orders import ENGAGE, Answer, Command, Orders, turn_to
from autopilot.web.requests import asked_of
from autopilot.web.screen import screen
from autopilot.web.station import COMPONENT, ParameterService, Station, descriptions_from, own_component
from autopilot.web.view import BoatView, TextPieces


def test_engage_turn_and_release_reach_the_pilot_and_are_seen(sea: Watched) -> None:
    assert sea.order(do="turn", degrees=10) == (False, "engage first: no course is being steered")
    assert sea.order(do="engage") == (True, "")
    sea.watch(2.0)
    shown = sea.station.view.snapshot(sea.now)
    assert (shown["mode"], shown["armed"], shown["ours"]) == ("heading", True, True)
    before = shown["order"]
    assert sea.order(do="turn", degrees=10) == (True, "")
    sea.watch(20.0)
    shown = sea.station.view.snapshot(sea.now)
    assert shown["order"] == pytest.approx((before + 10.0) % 360.0, abs=0.02)
    assert shown["heading"] == pytest.approx(shown["order"], abs=1.5)
    assert shown["heading"] == pytest.approx(math.degrees(sea.box.heading) % 360.0, abs=1.0)
    assert sea.order(do="release") == (True, "")
    sea.watch(2.0)
    shown = sea.station.view.snapshot(sea.now)
    assert (shown["mode"], shown["armed"], shown["rudder_order"]) == ("standby", False, None)
    assert not sea.commands.armed


def test_a_step_right_behind_engaging_counts_from_where_the_pilot_engaged(sea: Watched) -> None:
    assert sea.order(do="engage") == (True, "")
    assert sea.order(do="turn", degrees=10) == (True, "")
    assert sea.order(do="turn", degrees=5) == (True, "")
    held = math.degrees(sea.skipper(sea.now, sea.tick).heading)
    assert held == pytest.approx(math.degrees(sea.box.heading) + 15.0, abs=3.0)


def test_a_step_behind_engaging_anew_does_not_count_from_a_heading_ordered_before(sea: Watched) -> None:
    sea.order(do="engage")
    sea.watch(2.0)
    turned = (math.degrees(sea.box.heading) + 90.0) % 360.0
    assert sea.order(do="heading", degrees=turned) == (True, "")
    assert sea.order(do="standby") == (True, "")
    assert sea.order(do="engage") == (True, "")
    assert sea.order(do="turn", degrees=10) == (True, "")
    held = math.degrees(sea.skipper(sea.now, sea.tick).heading)
    assert held == pytest.approx(math.degrees(sea.box.heading) + 10.0, abs=5.0)


def test_a_step_that_waits_is_not_added_to_a_heading_ordered_behind_it(sea: Watched) -> None:
    ends: list[tuple[Answer, str]] = []
    wanted = (math.degrees(sea.box.heading) + 40.0) % 360.0
    for asked in ({"do": "engage"}, {"do": "turn", "degrees": 10}, {"do": "heading", "degrees": wanted}):
        sea.station.ask(sea.now, asked_of(sea.station, asked), lambda *end: ends.append(end))
    sea.watch(5.0)
    assert math.degrees(sea.skipper(sea.now, sea.tick).heading) % 360.0 == pytest.approx(wanted, abs=0.1)
    assert ends == [
        (Answer.FAILED, "dropped: another course is ordered"),
        (Answer.TAKEN, ""),
        (Answer.TAKEN, ""),
    ]


@pytest.mark.parametrize("kind", ["route", "pattern", "zigzag"])
def test_a_step_that_waits_is_not_added_to_the_course_of_what_leads_from_now_on(sea: Watched, kind: str) -> None:
    ends: list[tuple[Answer, str]] = []
    sizes = {"pattern": {"number": 1, "side": 1}, "zigzag": {"rudder": 10, "change": 10, "duration": 60}}
    for asked in ({"do": "engage"}, {"do": "turn", "degrees": 10}, {"do": kind, **sizes.get(kind, {})}):
        sea.station.ask(sea.now, asked_of(sea.station, asked), lambda *end: ends.append(end))
    assert ends == [(Answer.FAILED, "dropped: another course is ordered")]


def test_a_step_behind_engaging_ends_where_nothing_is_engaged_or_the_line_goes(sea: Watched) -> None:
    sea.order(do="engage")
    ends: list[tuple[Answer, str]] = []
    sea.station.ask(sea.now, asked_of(sea.station, {"do": "turn", "degrees": 10}), lambda *end: ends.append(end))
    sea.station.give_up()
    assert [answer for answer, _ in ends] == [Answer.SILENT]
    assert sea.order(do="standby") == (True, "")
    sea.watch(2.0)
    assert sea.order(do="turn", degrees=10) == (False, "engage first: no course is being steered")


def test_ten_quick_steps_turn_ten_degrees_and_a_lost_answer_turns_no_further(sea: Watched) -> None:
    sea.order(do="engage")
    sea.watch(2.0)
    before = sea.station.view.value("order")
    assert before is not None
    ends: list[bool] = []
    for _ in range(6):
        asked_of(sea.station, {"do": "turn", "degrees": 1})(sea.now, lambda taken, _: ends.append(bool(taken)))
    lost = sea.far.receive
    sea.far.receive = lambda: [data for data in lost() if data[7] != dialect.MAVLINK_MSG_ID_COMMAND_ACK]  # type: ignore[method-assign]
    sea.watch(1.2)
    assert ends == []
    sea.far.receive = lost  # type: ignore[method-assign]
    sea.until(lambda: len(ends) == 6)
    sea.watch(1.0)
    assert ends == [True] * 6
    assert sea.station.view.value("order") == pytest.approx((before + 6.0) % 360.0, abs=0.02)


@pytest.mark.parametrize("times", [(0.0, 1.6), (0.0, 0.2, 1.9, 3.0), (*[0.05 * press for press in range(9)], 2.5)])
def test_each_step_turns_though_the_answers_to_those_before_are_on_their_way(
    sea: Watched, times: tuple[float, ...]
) -> None:
    sea.order(do="engage")
    sea.watch(2.0)
    before, began = sea.station.view.value("order"), sea.now
    assert before is not None
    ends: list[bool] = []
    arrived, on_its_way = sea.far.receive, list[tuple[float, bytes]]()

    def late() -> list[bytes]:
        on_its_way.extend((sea.now + 1.7, data) for data in arrived())
        count = sum(time <= sea.now for time, _ in on_its_way)
        due, on_its_way[:] = [data for _, data in on_its_way[:count]], on_its_way[count:]
        return due

    sea.far.receive = late  # type: ignore[method-assign]
    for time in times:
        while sea.now < began + time:
            sea.watch(0.05)
        asked_of(sea.station, {"do": "turn", "degrees": 5})(sea.now, lambda taken, _: ends.append(bool(taken)))
    sea.until(lambda: len(ends) == len(times))
    sea.watch(1.0)
    assert ends.count(False) == (len(times) > 8), "where too many wait, the ninth is refused, and said to be"
    assert sea.skipper(sea.now, sea.tick).heading == pytest.approx(
        math.remainder(math.radians(before + 5.0 * ends.count(True)), math.tau), abs=1.0e-3
    )


def test_dodging_keeps_the_way_back(sea: Watched) -> None:
    sea.order(do="engage")
    sea.watch(2.0)
    before = sea.station.view.value("order")
    assert sea.order(do="back") == (False, "nothing to go back to")
    sea.order(do="dodge", degrees=-20)
    sea.order(do="dodge", degrees=-20)
    sea.watch(1.0)
    assert sea.station.view.value("order") == pytest.approx((before or 0.0) - 40.0 + 360.0, abs=0.05)
    assert sea.station.course.before == before
    assert sea.order(do="back") == (True, "")
    sea.watch(1.0)
    assert sea.station.view.value("order") == before and sea.station.course.before is None
    sea.order(do="dodge", degrees=20)
    sea.order(do="standby")
    sea.watch(2.0)
    assert sea.station.course.before is None


def test_a_trial_shows_its_progress_and_can_be_ended(sea: Watched) -> None:
    assert sea.order(do="zigzag", rudder=10, change=10, duration=30) == (True, "")
    sea.watch(8.0)
    trial = sea.station.view.trial
    assert trial is not None and trial.result == dialect.MAV_RESULT_IN_PROGRESS and 15 <= trial.percent <= 30
    assert sea.station.view.snapshot(sea.now)["mode"] == "trial"
    assert sea.order(do="turn", degrees=10) == (False, "a trial is being sailed: end it first")
    assert sea.order(do="cancel") == (True, "")
    sea.watch(2.0)
    trial = sea.station.view.trial
    assert trial is not None and trial.result == 6
    assert sea.order(do="zigzag", rudder=80, change=10, duration=30)[0] is False


def test_a_pattern_and_a_refusal_in_the_boats_own_words(sea: Watched) -> None:
    assert sea.order(do="pattern", number=1, side=1, sizes=[60])[0]
    sea.watch(5.0)
    assert sea.station.view.snapshot(sea.now)["rudder"] > 1.0
    said = sea.station.view.texts.count
    taken, words = sea.order(do="route")
    assert not taken and "route" in words
    sea.watch(2.0)
    assert any(
        "route" in text.words or "mission" in text.words for text in sea.station.view.texts.kept if text.number > said
    )


def test_alarms_come_go_and_are_acknowledged_here(sea: Watched) -> None:
    long = (
        "the gear is hot: look at the pump, and if it is dry stop the engine, then steer by hand until it is cool again"
    )
    noted(sea.pilot, AlarmSample(sea.now, other(long), "gear"))
    sea.watch(2.0)
    (alarm,) = sea.station.alarms.active
    assert alarm == {
        "name": "",
        "words": long,
        "priority": "warning",
        "sounds": True,
        "acknowledged": False,
        "escalated": False,
        "since": alarm["since"],
    }
    assert sea.station.view.texts.kept[-1].words == long
    assert sea.order(do="acknowledge") == (True, "")
    noted(sea.pilot, AlarmSample(sea.now, other("bilge: pump"), "bilge"))
    sea.watch(2.0)
    assert [(each["words"], each["acknowledged"], each["sounds"]) for each in sea.station.alarms.active] == [
        ("bilge: pump", False, True),
        (long, True, False),
    ]
    noted(sea.pilot, AlarmSample(sea.now, None, "gear"))
    sea.watch(2.0)
    assert [each["words"] for each in sea.station.alarms.active] == ["bilge: pump"]
    noted(sea.pilot, AlarmSample(sea.now, None, "bilge"))
    sea.watch(2.0)
    assert sea.station.alarms.active == []


def test_acknowledging_on_a_display_silences_the_boat(sea: Watched) -> None:
    noted(sea.pilot, AlarmSample(sea.now, other("gear hot: stop the engine"), "gear"))
    sea.watch(35.0)
    assert sea.tick is not None and sea.tick.siren is Siren.ESCALATED
    (gear,) = sea.station.alarms.active
    assert gear["sounds"] and gear["escalated"] and not gear["acknowledged"]
    assert sea.order(do="acknowledge") == (True, "")
    sea.watch(6.0)
    assert sea.tick.siren is Siren.QUIET
    assert sea.station.alarms.active == [{**gear, "sounds": False, "acknowledged": True, "escalated": False}]


def test_alarms_are_acknowledged_one_by_one_and_their_times_are_kept(sea: Watched) -> None:
    noted(sea.pilot, AlarmSample(sea.now, AlarmEvent("motor_current", "12 A"), "gear"))
    raised = sea.now
    sea.watch(2.0)
    noted(sea.pilot, AlarmSample(sea.now, AlarmEvent("wind_lost"), "wind"))
    sea.watch(2.0)
    assert sea.order(do="acknowledge", name="motor_current") == (True, "")
    seen = sea.now
    sea.watch(2.0)
    state = {each["name"]: (each["sounds"], each["acknowledged"]) for each in sea.station.alarms.active}
    assert state == {"motor_current": (False, True), "wind_lost": (True, False)}
    assert sea.tick is not None and sea.tick.siren is Siren.SOUNDING
    noted(sea.pilot, AlarmSample(sea.now, AlarmEvent("motor_current", "14 A"), "gear"))
    sea.watch(6.0)
    assert "14 A" in sea.station.alarms.history[0].words and len(sea.station.alarms.history) == 2
    noted(sea.pilot, AlarmSample(sea.now, None, "gear"))
    cleared = sea.now
    sea.watch(2.0)
    gear, wind = sea.station.alarms.history
    times = (gear.raised, gear.acknowledged, gear.cleared)
    assert times == (pytest.approx(raised, abs=1.5), pytest.approx(seen, abs=1.5), pytest.approx(cleared, abs=1.5))
    assert (wind.name, wind.acknowledged, wind.cleared) == ("wind_lost", None, None)
    with pytest.raises(InputError, match="no alarm of the name 'x'"):
        sea.order(do="acknowledge", name="x")


def test_it_is_written_down_who_ordered_what(sea: Watched) -> None:
    def words() -> list[tuple[str, str, bool | None]]:
        return [(each.who, each.what, each.taken) for each in sea.station.journal.entries]

    sea.order(do="engage")
    sea.watch(6.0)
    sea.order(do="turn", degrees=20.0)
    sea.watch(6.0)
    assert words() == [("here", "hold the heading", True), ("here", "20° to starboard", True)]
    sea.skipper.type_line("+10")
    sea.watch(8.0)
    assert words()[2:] == [("elsewhere", f"course {round(sea.station.view.value('order') or 0.0):03d}°", True)]
    sea.skipper.type_line("s")
    sea.watch(3.0)
    assert words()[3:] == [("elsewhere", "standby", True)]
    sea.order(do="route")
    assert words()[4:] == [("here", "follow the route", False)]


def test_the_chart_has_the_route_and_where_the_boat_has_been(sea: Watched) -> None:
    track = Track()
    for _ in range(40):
        sea.watch(0.5)
        track.update(sea.now, sea.station.view)
    assert sea.station.route.entries == () and len(track.points) >= 8
    where, truth = track.points[-1][1:], place(sea.north, sea.east)
    assert where == pytest.approx((math.degrees(truth.latitude), math.degrees(truth.longitude)), abs=1.0e-4)
    sea.mission._put([MissionItem(6, 16, (0.0, 0.0, 0.0, 0.0), 593000000, longitude, 0.0) for longitude in (1, 2)])
    sea.watch(3.0)
    assert sea.station.route.entries == ((59.3, 1.0e-7), (59.3, 2.0e-7))


@pytest.mark.parametrize("content", [b"{}", b"[[1]]", b'[[1,"x"]]', b"[[91,0]]", b"[[true,0]]", b"[" * 20_000])
def test_a_route_that_is_none_is_left_alone(content: bytes) -> None:
    with pytest.raises(InputError, match="the boat's route"):
        route_from(content)


def test_what_one_display_acknowledges_is_acknowledged_on_the_others(sea: Watched) -> None:
    noted(sea.pilot, AlarmSample(sea.now, other("gear hot: stop the engine"), "gear"))
    sea.watch(2.0)
    here = sea.station
    sea.station = sea.line._station = Station()
    sea.watch(2.0)
    there = sea.station
    assert [each["sounds"] for each in (*here.alarms.active, *there.alarms.active)] == [True, True]
    assert sea.order(do="acknowledge") == (True, "")
    sea.station = sea.line._station = here
    sea.watch(2.0)
    assert [each["acknowledged"] for each in (*here.alarms.active, *there.alarms.active)] == [True, True]
    assert any("(acknowledged)" in line.text for line in screen(here, sea.now, (80, 24)))


def test_a_list_whose_file_was_abandoned_is_asked_for_again() -> None:
    files, view = FtpClient(), BoatView()
    board = AlarmBoard(files)
    view.value = lambda name: 1.0  # type: ignore[method-assign]
    board.update(0.0, view)
    assert not files.is_idle
    files.abandon()
    assert files.is_idle
    board.update(10.0, view)
    assert not files.is_idle and [path for path, _ in files._waiting] == [ALARMS]


def test_a_list_of_alarms_that_is_none_is_left_alone() -> None:
    board = AlarmBoard(FtpClient())
    board._take(b'[{"name":"roll","words":"heeled","state":"sounding","priority":"warning"}]')
    for bad in (
        None,
        b"",
        b"{",
        b"[1]",
        b'[{"name":"roll","words":"heeled","state":"loud","priority":"warning"}]',
        b'[{"name":"roll","words":"heeled","state":"sounding"}]',
        b'["heeled"]',
        b'{"a":1}',
    ):
        board._take(bad)
        (alarm,) = board.active
        assert (alarm["name"], alarm["words"], alarm["sounds"], alarm["priority"]) == (
            "roll",
            "heeled",
            True,
            "warning",
        )
    board.acknowledge(is_known_aboard=False)
    assert board.active[0]["acknowledged"] and not board.active[0]["sounds"]
    board._take(b"[]")
    board._take(b'[{"name":"roll","words":"heeled","state":"sounding","priority":"warning"}]')
    assert board.active[0]["sounds"], "it was over: it is another one"


DEEP = b"[" * 20_000
HOSTILE_LISTS = [
    DEEP,
    b'[{"words":"\\ud800","name":"","state":"sounding"}]',
    b'[{"words":["gear hot"],"name":"","state":"sounding"}]',
    b'[{"words":"gear hot","name":"a.b","state":"sounding"}]',
    b'[{"words":"gear hot","name":"' + b"a" * 65 + b'","state":"sounding"}]',
    b'[{"words":"gear hot","name":"","state":[]}]',
    b'[{"words":"gear hot","name":"","state":"notice","priority":"warning","since":1e999}]',
    b'[{"words":"' + b"x" * LIST_MOST + b'","name":"","state":"notice"}]',
]


@pytest.mark.parametrize("content", HOSTILE_LISTS, ids=range(len(HOSTILE_LISTS)))
def test_a_hostile_list_of_alarms_ends_no_display(
    sea: Watched, content: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    noted(sea.pilot, AlarmSample(sea.now, other("gear hot: stop the engine"), "gear"))
    sea.watch(2.0)
    monkeypatch.setattr("autopilot.links.ground_station.boat_link.alarm_list", lambda alarms, heard: content)
    asked = []
    monkeypatch.setattr(sea.station.files, "fetch", lambda path, got: asked.append(path) or got(content))
    sea.watch(8.0)
    assert asked == [ALARMS] * len(asked) and asked
    (alarm,) = sea.station.alarms.active
    assert alarm["words"] == "gear hot: stop the engine", "what was known stays"
    assert any("gear hot" in line.text for line in screen(sea.station, sea.now, (80, 24)))
    printed = Deltas().due(sea.station, sea.now)
    assert printed is not None and b"gear hot" in line_of(printed)
    with pytest.raises(InputError, match="the boat's list of alarms") as caught:
        alarms_from(content)
    assert len(str(caught.value)) < 200


def test_a_display_that_comes_later_sees_the_alarms_that_are_on(sea: Watched) -> None:
    sea.order(do="engage")
    sea.watch(1.0, helm=HelmSample(sea.now, False, "the skipper has taken the helm"))
    sea.station = Station()
    sea.line._station = sea.station
    sea.watch(3.0)
    (alarm,) = sea.station.alarms.active
    assert "the skipper has taken the helm" in alarm["words"]


def test_parameters_come_with_range_and_meaning_and_are_set_or_refused(sea: Watched) -> None:
    service = sea.station.parameters
    assert service.table()["rows"] == []
    service.read()
    sea.until(lambda: bool(service.table()["complete"]) and "shortDesc" in service.table()["rows"][0])
    rows = {row["name"]: row for row in service.table()["rows"]}
    assert set(rows) == set(sea.store.names)
    lookahead = rows["GUI_LOOKAHEAD"]
    assert lookahead["value"] == sea.store.running.guidance.lookahead_s and lookahead["units"] == "s"
    assert sea.order(do="set", name="GUI_LOOKAHEAD", value=12.5) == (True, "")
    assert sea.store.running.guidance.lookahead_s == 12.5
    assert {row["name"]: row for row in service.table()["rows"]}["GUI_LOOKAHEAD"]["value"] == 12.5
    taken, words = sea.order(do="set", name="GUI_LOOKAHEAD", value=-1)
    assert not taken and "allowed: 2 to 120 s" in words
    assert sea.store.running.guidance.lookahead_s == 12.5


class Setter:
    """The display's side of the parameter protocol, and what it hears of a boat on a line that holds things up."""

    def __init__(self) -> None:
        self.service, self.now, self.ends = ParameterService(FtpClient()), 0.0, list[Answer]()

    def set(self, value: float) -> None:
        self.service.set("GAIN", value, lambda answer, _: self.ends.append(answer))
        self.wait(0.0)

    def wait(self, seconds: float) -> int:
        """Return how often the value was sent in that time."""
        sent = 0
        for _ in range(round(seconds / 0.1) + 1):
            sent += len(self.service.due(self.now, Target(1, 1)))
            self.now += 0.1
        return sent

    def hear(self, value: float) -> list[Answer]:
        return self._hear(dialect.MAVLink_param_value_message(b"GAIN", value, 9, 1, 0))

    def hear_refusal(self) -> list[Answer]:
        error = dialect.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE
        return self._hear(dialect.MAVLink_param_error_message(255, 190, b"GAIN", -1, error))

    def _hear(self, message: Any) -> list[Answer]:
        (arrived,) = MavlinkCodec(255, 190).decode(MavlinkCodec(1, 1).encode(message))
        self.service.receive(self.now, arrived, Target(1, 1))
        ends, self.ends = self.ends, []
        return ends


def test_a_value_that_was_on_its_way_before_ours_is_no_refusal() -> None:
    line = Setter()
    line.set(5.0)
    assert line.hear(1.0) == [] and line.hear(5.0) == [Answer.TAKEN]
    line.set(-5.0)
    assert line.hear(5.0) == [] and line.hear_refusal() == [Answer.REFUSED]


def test_an_answer_to_a_value_that_was_set_before_is_none_to_this_one() -> None:
    line = Setter()
    line.set(-1.0)
    assert line.wait(0.6) == 1, "said again"
    assert line.hear_refusal() == [Answer.REFUSED]
    line.set(5.0)
    assert line.hear_refusal() == [], "the second answer to the first value"
    assert line.hear(5.0) == [Answer.TAKEN]
    line.set(6.0)
    line.wait(0.6)
    assert line.hear(6.0) == [Answer.TAKEN]
    line.set(7.0)
    assert line.hear(7.0) == [Answer.TAKEN]
    line.set(6.0)
    assert line.hear(6.0) == [], "the second answer to the first 6"
    assert line.hear(6.0) == [Answer.TAKEN]


def test_a_boat_that_only_says_another_value_leaves_it_open_what_counts() -> None:
    line = Setter()
    line.set(5.0)
    for _ in range(4):
        line.wait(0.4)
        assert line.hear(1.0) == []
    line.wait(0.6)
    assert line.hear(1.0) == [Answer.FAILED]


def packed(text: bytes) -> bytes:
    return lzma.compress(text, check=lzma.CHECK_CRC32)


def with_dictionary_of_4_gb(packed: bytes) -> bytes:
    """What is packed, saying in its block's header (The .xz File Format, 3.1) that unpacking takes 4 GB."""
    size = 4 * (packed[12] + 1)
    header = packed[12 : 12 + size - 4].replace(b"\x21\x01\x16", b"\x21\x01\x28")
    return packed[:12] + header + struct.pack("<I", zlib.crc32(header)) + packed[12 + size :]


def of_one(described: bytes) -> bytes:
    return packed(b'{"version":1,"parameters":[{"name":"CTL_RATE",' + described + b"}]}")


HOSTILE_METADATA = [
    packed(DEEP),
    of_one(b'"min":NaN'),
    of_one(b'"max":1e999'),
    of_one(b'"min":' + b"9" * 400),
    of_one(b'"min":true'),
    of_one(b'"shortDesc":"\\ud800"'),
    of_one(b'"shortDesc":["x"]'),
    of_one(b'"values":[1]'),
    of_one(b'"values":{"value":1,"description":"x"}'),
    of_one(b'"values":[{"value":1,"description":' + b"[" * 100 + b"]" * 100 + b"}]"),
    of_one(b'"rebootRequired":"yes"'),
    packed(b'{"parameters":[1]}'),
    packed(b'{"parameters":{}}'),
    packed(b" " * 5_000_000),
    with_dictionary_of_4_gb(of_one(b'"min":0')),
    of_one(b'"min":0')[:-20],
    b"",
]


@pytest.mark.parametrize("content", HOSTILE_METADATA, ids=range(len(HOSTILE_METADATA)))
def test_hostile_descriptions_of_parameters_leave_names_and_values(sea: Watched, content: bytes) -> None:
    sea.files = {**sea.files, PARAMETERS: content}
    sea.line.close()
    sea.watch(2.0)
    service = sea.station.parameters
    service.read()
    sea.until(lambda: bool(service.table()["complete"]) and not sea.station.files._waiting)
    assert len(service.table()["rows"]) == len(sea.store.names)
    assert {key for row in service.table()["rows"] for key in row} == {"name", "value"}
    assert JSONResponse(service.table()).status_code == 200
    with pytest.raises(InputError, match="the boat's description of parameters") as caught:
        descriptions_from(content)
    assert len(str(caught.value)) < 200


def test_sound_descriptions_are_taken_as_they_are() -> None:
    text = b'"min":0,"values":[{"value":0,"description":"off"}],"rebootRequired":true,"longDesc":"none of ours"'
    assert descriptions_from(of_one(text)) == {
        "CTL_RATE": {"min": 0, "values": [{"value": 0, "description": "off"}], "rebootRequired": True}
    }


@pytest.mark.parametrize("state", [-5.0, 0.5, 3.0, 1e30, math.nan, math.inf])
def test_a_state_of_learning_that_is_none_ends_no_terminal(sea: Watched, state: float) -> None:
    sea.station.receive(sea.now, said_by_the_boat(dialect.MAVLink_named_value_float_message(1, b"lrn_state", state)))
    assert any("model: learning" in line.text for line in screen(sea.station, sea.now, (80, 30)))


def said_by_the_boat(message: Any) -> Any:
    (heard,) = MavlinkCodec().decode(MavlinkCodec(1, 1).encode(message))
    return heard


def test_silence_ages_every_value_and_leaves_a_gap_in_the_plots(sea: Watched) -> None:
    sea.links = []
    sea.watch(6.0)
    ages = sea.station.view.snapshot(sea.now)["ages"]
    assert min(ages["beat"], ages["attitude"], ages["rudder"]) > 4.9
    rows = list(sea.station.view.history)
    assert rows[-1][1] is None and rows[3][1] is not None


def test_orders_to_a_silent_boat_end_with_a_word(sea: Watched) -> None:
    sea.links = []
    assert sea.order(do="engage") == (False, "the boat does not answer")


def test_a_lost_line_is_opened_again_by_itself(sea: Watched) -> None:
    def broken() -> list[bytes]:
        raise LinkError("link 'boat': the adapter is gone")

    sea.far.receive = broken  # type: ignore[method-assign]
    sea.is_cut = True
    sea.watch(3.0)
    assert sea.line.trouble == "link 'udpin:127.0.0.1:14550': cannot be opened" and sea.line.fileno() == -1
    sea.is_cut = False
    sea.watch(4.0)
    assert sea.line.trouble == ""
    assert sea.station.view.snapshot(sea.now)["ages"]["attitude"] < 0.2


@pytest.mark.parametrize("do", ["turn", "set"])
def test_what_is_ordered_while_the_line_is_down_is_not_carried_out_when_it_is_back(sea: Watched, do: str) -> None:
    def broken() -> list[bytes]:
        raise LinkError("link 'boat': the adapter is gone")

    sea.order(do="engage")
    sea.watch(2.0)
    before = sea.skipper(sea.now, sea.tick).heading, sea.store.get("GUI_LOOKAHEAD")
    sea.far.receive = broken  # type: ignore[method-assign]
    sea.is_cut = True
    sea.watch(0.5)
    wanted = {"do": "turn", "degrees": 20} if do == "turn" else {"do": "set", "name": "GUI_LOOKAHEAD", "value": 12.5}
    assert sea.order(**wanted) == (False, "the boat does not answer")
    sea.is_cut = False
    sea.watch(10.0)
    assert sea.line.trouble == ""
    assert (sea.skipper(sea.now, sea.tick).heading, sea.store.get("GUI_LOOKAHEAD")) == before
    assert sea.order(do="turn", degrees=20) == (True, ""), "the line is there again"


def test_headings_come_ten_times_a_second_once_asked_for(sea: Watched) -> None:
    before = sea.station.view.history[-1]
    count = 0
    taker = sea.station.view._takers["ATTITUDE"]

    def counted(now: float, message: Any) -> None:
        nonlocal count
        count += 1
        taker(now, message)

    sea.station.view._takers["ATTITUDE"] = counted
    sea.watch(4.0)
    assert count == pytest.approx(40, abs=3) and before is not None


def test_another_autopilot_is_only_looked_at() -> None:
    station, codec = Station(), MavlinkCodec(1, 1)
    rover = dialect.MAVLink_heartbeat_message(
        dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_ARDUPILOTMEGA, 0, 0, 4, 3
    )
    (message,) = codec.decode(codec.encode(rover))
    station.receive(1.0, message)
    assert station.target is None and station.view.snapshot(1.0)["ours"] is False
    assert [each.get_type() for each in station.due(2.0)] == ["HEARTBEAT"]


@pytest.mark.parametrize(
    "wanted",
    [
        None, [], "engage", {}, {"do": "sink"}, {"do": ["engage"]}, {"do": "turn"}, {"do": "turn", "degrees": "10"},
        {"do": "turn", "degrees": math.nan}, {"do": "turn", "degrees": True}, {"do": "heading", "degrees": 361},
        {"do": "pattern", "number": 1, "side": 1, "sizes": [1, 2, 3]}, {"do": "level", "level": 10},
        {"do": "pattern", "number": 1, "side": 1, "sizes": 5}, {"do": "set", "name": "", "value": 1},
        {"do": "set", "name": "A" * 17, "value": 1}, {"do": "set", "name": "ONE"},
        {"do": "zigzag", "rudder": 10, "change": 10},
    ],
)  # fmt: skip
def test_wishes_that_make_no_sense_are_refused_in_words(wanted: Any) -> None:
    with pytest.raises(InputError, match=r"allowed|at most"):
        asked_of(Station(), wanted)


@pytest.mark.parametrize("lost", range(3))
def test_a_place_overboard_and_a_wind_are_shown_though_a_part_of_them_is_lost(lost: int) -> None:
    station, boat = Station(), MavlinkCodec(1, 1)

    def heard(message: Any) -> None:
        (read,) = MavlinkCodec().decode(boat.encode(message))
        station.receive(1.0, read)

    heard(dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_GENERIC, 0, 0, 4, 3))
    for names, value in ((("mob_brg", "mob_dist", "mob_s"), 200.0), (("AppWndDir", "AppWndSpd", "TruWndSpd"), 8.0)):
        for place_, name in enumerate(names):
            heard(dialect.MAVLink_named_value_float_message(0, name.encode(), math.nan if place_ == lost else value))
            assert screen(station, 1.0, (80, 24))
    words = [line.text for line in screen(station, 1.0, (80, 24)) if "OVERBOARD" in line.text]
    assert len(words) == 1 and "--" in words[0] and "200" in words[0]


def test_a_place_overboard_is_kept_in_a_silence_and_not_once_the_boat_speaks_without_it() -> None:
    station, boat = Station(), MavlinkCodec(1, 1)

    def heard(now: float, message: Any) -> None:
        (read,) = MavlinkCodec().decode(boat.encode(message))
        station.receive(now, read)

    def shown(now: float) -> list[str]:
        return [line.text for line in screen(station, now, (80, 24)) if "OVERBOARD" in line.text]

    beat = dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_GENERIC, 0, 0, 4, 3)
    heard(1.0, beat)
    for name in ("mob_brg", "mob_dist", "mob_s"):
        heard(1.0, dialect.MAVLink_named_value_float_message(0, name.encode(), 200.0))
    assert "(old)" not in shown(1.5)[0] and "(old)" in shown(60.0)[0]
    for now in (2.0, 3.0, 4.0, 5.0):
        heard(now, beat)
    assert shown(5.0) == shown(60.0) == [], "somebody who is back on board stays there"


@pytest.mark.parametrize(
    ("times_ms", "starts"),
    [
        ((5000, 5050, 4900, 5100, 4101), 0),
        ((5500, 3), 1),
        ((5000, 3), 0),
        ((5000, 3, 13, 23, 33, 43), 1),
        ((2**32 - 20, 30, 2**32 - 70, 80), 0),
        ((2**31 + 5000, 3, 50), 1),
        ((4_000_000_000, 100, 150, 90), 1),
    ],
)
def test_only_a_boat_that_starts_again_is_forgotten(times_ms: tuple[int, ...], starts: int) -> None:
    station, boat, forgotten = Station(), MavlinkCodec(1, 1), []
    station.parameters.forget = lambda: forgotten.append(1)  # type: ignore[method-assign]
    boat_ = dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_GENERIC, 0, 0, 4, 3)
    for message in (boat_, *(dialect.MAVLink_attitude_message(ms, 0, 0, 1, 0, 0, 0) for ms in times_ms)):
        (read,) = MavlinkCodec().decode(boat.encode(message))
        station.receive(1.0, read)
    assert len(forgotten) == starts


def test_of_a_boat_that_starts_again_no_list_of_before_is_shown() -> None:
    station, boat = Station(), MavlinkCodec(1, 1)

    def heard(now: float, message: Any) -> None:
        (read,) = MavlinkCodec().decode(boat.encode(message))
        station.receive(now, read)

    heard(
        0.0, dialect.MAVLink_heartbeat_message(dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_GENERIC, 0, 0, 4, 3)
    )
    heard(1.0, dialect.MAVLink_attitude_message(500_000, 0, 0, 1, 0, 0, 0))
    contents = {
        station.alarms: b'[{"name":"roll","words":"heeled","state":"sounding","priority":"warning"}]',
        station.route: b"[[59.3,18.0]]",
        station.compasses: b'[{"name":"a","link":"b","magnetic":true}]',
    }
    for board, content in contents.items():
        board._take(content)
    assert all(board.entries for board in contents)
    heard(2.0, dialect.MAVLink_attitude_message(3, 0, 0, 1, 0, 0, 0))
    assert not any(board.entries for board in contents)


@pytest.mark.parametrize("word", ["release", "standby"])
def test_what_takes_the_pilot_from_the_helm_goes_before_all_that_waits(word: str) -> None:
    station, ends = Station(), list[tuple[str, bool]]()
    orders, target = station.orders, Target(1, 1)
    for name in ("first", "second"):
        orders.give((Command(400, (1.0,)),), lambda taken, _, name=name: ends.append((name, bool(taken))))  # type: ignore[misc]
    assert orders.due(0.0, target)[0].param1 == 1.0
    asked_of(station, {"do": word})(0.0, lambda taken, _: ends.append((word, bool(taken))))
    assert ends == [("first", False), ("second", False)]
    (message,) = orders.due(0.05, target)
    assert (message.command, message.param2) == (dialect.MAV_CMD_DO_SET_MODE, 0.0)


@pytest.mark.parametrize("words", [("standby", "standby"), ("release", "standby"), ("standby", "release")])
def test_two_hands_that_take_the_helm_at_once_are_both_obeyed(words: tuple[str, str]) -> None:
    station, ends, sent = Station(), list[bool](), list[int]()
    orders, target = station.orders, Target(1, 1)
    for word in words:
        asked_of(station, {"do": word})(0.0, lambda taken, _: ends.append(bool(taken)))
        sent += [message.command for message in orders.due(0.0, target)]
    assert ends == []
    for step in range(20):
        for number in sent[-2:]:
            orders.receive(0.1 * step, dialect.MAVLink_command_ack_message(number, 0))
        sent += [message.command for message in orders.due(0.1 * step, target)]
    assert ends == [True, True]
    assert (dialect.MAV_CMD_COMPONENT_ARM_DISARM in sent) is ("release" in words)


@pytest.mark.parametrize("answered", [0, 1, 2, 3, 4])
def test_however_often_an_order_to_engage_was_sent_its_answers_are_none_to_who_stands_by(answered: int) -> None:
    station, ends = Station(), list[bool]()
    orders, target = station.orders, Target(1, 1)
    acknowledged = dialect.MAVLink_command_ack_message(int(dialect.MAV_CMD_DO_SET_MODE), 0)
    orders.give((ENGAGE[1],), lambda taken, words: None)
    for now in (0.0, 0.5, 1.0, 1.5):
        assert orders.due(now, target)
    asked_of(station, {"do": "standby"})(1.6, lambda taken, _: ends.append(bool(taken)))
    assert orders.due(1.6, target)  # lost on the way
    for _ in range(answered):
        orders.receive(1.7, acknowledged)
    assert ends == [], "what was asked to engage has answered, and is believed to stand by"
    for step in range(9):
        for _ in orders.due(2.1 + 0.5 * step, target):
            orders.receive(2.2 + 0.5 * step, acknowledged)
    assert ends == [True], "heard at the latest when more has been answered than was asked before"


@pytest.mark.parametrize("to", [(255, 190), (254, COMPONENT), (1, 191)])
def test_what_the_boat_answers_to_another_station_is_no_answer_to_us(sea: Watched, to: tuple[int, int]) -> None:
    """Behind a router everybody hears all: who stands by must not take another's order to engage for it."""
    ends = list[bool]()
    sea.order(do="engage")
    station, sea.links = sea.station, []
    station.ask(sea.now, asked_of(station, {"do": "standby"}), lambda taken, _: ends.append(bool(taken)))

    def answered(system: int, component: int) -> None:
        station.due(sea.now)
        mode = int(dialect.MAV_CMD_DO_SET_MODE)
        acknowledged = dialect.MAVLink_command_ack_message(mode, 0, 0, 0, system, component)
        (message,) = MavlinkCodec().decode(MavlinkCodec(1, 1).encode(acknowledged))
        station.receive(sea.now, message)

    answered(*to)
    assert ends == []
    answered(255, COMPONENT)
    assert ends == [True]


def test_each_display_has_an_address_of_its_own() -> None:
    """With that of a ground station, or of another display, its orders and answers would be taken for theirs."""
    drawn = {own_component() for _ in range(30)}
    assert len(drawn) > 1
    assert all(dialect.MAV_COMP_ID_USER1 <= each <= dialect.MAV_COMP_ID_USER75 for each in drawn)


@pytest.mark.parametrize("sent_at", [(0.0, 0.5), (0.0, 0.5, 1.0, 1.5)])
def test_the_second_answer_to_an_order_that_has_ended_is_none_to_who_stands_by(sent_at: tuple[float, ...]) -> None:
    """One answered at its first asking, or given up as not answered at all."""
    station, ends = Station(), list[bool]()
    orders, target = station.orders, Target(1, 1)
    acknowledged = dialect.MAVLink_command_ack_message(int(dialect.MAV_CMD_DO_SET_MODE), 0)
    engaged = list[bool]()
    orders.give((ENGAGE[1],), lambda taken, words: engaged.append(bool(taken)))
    for now in sent_at:
        assert orders.due(now, target)
    if is_answered := len(sent_at) == 2:
        orders.receive(0.6, acknowledged)
    orders.due(2.0, target)
    assert engaged == [is_answered]
    asked_of(station, {"do": "standby"})(2.1, lambda taken, _: ends.append(bool(taken)))
    assert orders.due(2.1, target)  # lost on the way
    orders.receive(2.2, acknowledged)
    assert ends == [], "what was asked to engage has answered, and is believed to stand by"
    for step in range(9):
        for _ in orders.due(2.6 + 0.5 * step, target):
            orders.receive(2.7 + 0.5 * step, acknowledged)
    assert ends == [True]


@pytest.mark.parametrize("words", [("release", "standby"), ("standby", "release")])
@pytest.mark.parametrize("result", [dialect.MAV_RESULT_DENIED, None])
def test_who_stood_by_hears_so_though_the_release_that_it_went_with_fails(
    words: tuple[str, str], result: int | None
) -> None:
    station, ends = Station(), list[tuple[str, bool]]()
    orders, target = station.orders, Target(1, 1)
    for word in words:
        asked_of(station, {"do": word})(0.0, lambda taken, _, word=word: ends.append((word, bool(taken))))  # type: ignore[misc]
    for step in range(40):
        for message in orders.due(0.1 * step, target):
            if message.command == dialect.MAV_CMD_DO_SET_MODE:
                orders.receive(0.1 * step, dialect.MAVLink_command_ack_message(message.command, 0))
            elif result is not None:
                orders.receive(0.1 * step, dialect.MAVLink_command_ack_message(message.command, result))
    assert ends == [("standby", True), ("release", False)]


def test_answers_to_an_order_to_engage_are_none_to_two_hands_that_stand_by() -> None:
    station, ends = Station(), list[bool]()
    orders, target = station.orders, Target(1, 1)
    mode = int(dialect.MAV_CMD_DO_SET_MODE)
    orders.give((ENGAGE[1],), lambda taken, words: None)
    orders.due(0.0, target)
    orders.due(0.5, target)
    for now in (0.6, 0.7):
        asked_of(station, {"do": "standby"})(now, lambda taken, _: ends.append(bool(taken)))
        orders.due(now, target)  # lost on the way, both
    for now in (0.8, 0.9):
        orders.receive(now, dialect.MAVLink_command_ack_message(mode, 0))
    assert ends == [], "what was asked to engage has answered, and is believed to stand by"
    orders.due(1.3, target)
    orders.receive(1.4, dialect.MAVLink_command_ack_message(mode, 0))
    assert ends == [True, True]


def test_an_answer_to_an_order_to_engage_is_none_to_the_one_to_stand_by() -> None:
    station, ends = Station(), list[bool]()
    orders, target = station.orders, Target(1, 1)
    arm, mode = int(dialect.MAV_CMD_COMPONENT_ARM_DISARM), int(dialect.MAV_CMD_DO_SET_MODE)
    orders.give(ENGAGE, lambda taken, words: None)
    orders.due(0.0, target)
    orders.receive(0.1, dialect.MAVLink_command_ack_message(arm, 0))
    assert orders.due(0.1, target)[0].param2 == 15.0
    asked_of(station, {"do": "standby"})(0.2, lambda taken, _: ends.append(bool(taken)))
    assert orders.due(0.2, target)[0].param2 == 0.0, "and is lost"
    orders.receive(0.3, dialect.MAVLink_command_ack_message(mode, 0))
    assert orders.due(0.8, target)[0].param2 == 0.0 and ends == []
    orders.receive(0.9, dialect.MAVLink_command_ack_message(mode, 0))
    assert ends == [True] and orders.due(9.0, target) == []


def test_nothing_is_kept_for_a_boat_that_does_not_answer() -> None:
    """A course that was meant a while ago may lead anywhere when the line is back."""
    orders, ends, sent = Orders(), list[str](), list[float]()
    for heading in (10.0, 20.0, 30.0):
        orders.give((turn_to(heading),), lambda _, words: ends.append(words))
    for step in range(100):
        sent += [message.param1 for message in orders.due(0.1 * step, Target(1, 1))]
    assert set(sent) == {10.0} and ends == ["the boat does not answer"] * 3


class FarBoat:
    """A boat that `refuses` a heading, behind a line that takes `delay` [s] and loses what is sent `lost`-th."""

    def __init__(self, delay: float, lost: int = 0, refuses: float = math.nan) -> None:
        self.orders, self.now, self.ends, self.steered = Orders(), 0.0, list[bool](), list[float]()
        self._delay, self._lost, self._refuses = delay, lost, refuses
        self.sent, self._answers = list[float](), list[tuple[float, Any]]()

    def turn(self, *headings: float) -> None:
        for heading in headings:
            self.orders.give((turn_to(heading),), lambda taken, _: self.ends.append(bool(taken)))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            self.now += 0.05
            while self._answers and self._answers[0][0] <= self.now:
                self.orders.receive(self.now, self._answers.pop(0)[1])
            for message in self.orders.due(self.now, Target(1, 1)):
                self.sent.append(message.param1)
                if len(self.sent) == self._lost:
                    continue
                is_refused = message.param1 == self._refuses
                if not is_refused and self.steered[-1:] != [message.param1]:
                    self.steered.append(message.param1)
                answer = dialect.MAVLink_command_ack_message(message.command, 1 if is_refused else 0)
                self._answers.append((self.now + self._delay, answer))


@pytest.mark.parametrize("delay", [0.8, 1.3, 1.7])
@pytest.mark.parametrize("was_quick", [False, True])
def test_an_answer_that_may_be_to_the_heading_before_is_none_to_this_one(delay: float, was_quick: bool) -> None:
    for lost, refuses, ends in ((True, math.nan, [True, True]), (False, 20.0, [True, False])):
        boat = FarBoat(0.1, refuses=refuses)
        if was_quick:
            boat.turn(5.0)
            boat.run(1.0)
            boat.ends.clear()
        boat._delay = delay
        if lost:
            boat._lost = len(boat.sent) + 1 + math.ceil(delay / 0.5)
        boat.turn(10.0, 20.0)
        boat.run(9.0)
        assert boat.ends == ends
        assert boat.steered[-1] == (20.0 if ends[-1] else 10.0)


def test_what_a_quick_line_lost_once_makes_the_orders_behind_it_no_slower() -> None:
    boat = FarBoat(0.1, lost=3)
    boat.turn(*range(1, 9))
    boat.run(0.1 * 8 + 0.5 + 0.5)
    assert boat.ends == [True] * 8 and len(boat.sent) == 9


@given(st.lists(st.text(st.characters(exclude_characters="\0"), min_size=1, max_size=220), min_size=1, max_size=6))
def test_texts_are_put_together_whatever_their_length(words: list[str]) -> None:
    boat, heard, now = StatusTexts(), TextPieces(), 0.0
    kept = []
    for each in words:
        if not kept or kept[-1] != each:
            boat.send_text(now, 4, each)
            kept.append(each)
        for _ in range(20):
            now += 0.25
            for message in boat.due(now):
                heard.take(now, message)
            heard.update(now)
    assert [text.words for text in heard.kept] == [each.encode("ascii", "replace").decode() for each in kept]
