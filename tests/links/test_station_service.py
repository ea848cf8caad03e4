"""The boat's answers to one ground station, message by message, and what it says of itself."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace
from typing import Any

import pytest
from alarm_texts import other, shown, text_of, words
from pymavlink.dialects.v20 import ardupilotmega as dialect
from station_doubles import Store

from autopilot.guidance.track import TrackGuide
from autopilot.guidance.wind_vane import WindGuide
from autopilot.links.alarm_outputs import StatusTexts
from autopilot.links.base import LastStop, LinkError
from autopilot.links.ground_station.access import AccessPolicy, AccessRules
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Instruments
from autopilot.links.ground_station.file_server import alarm_list
from autopilot.links.ground_station.mission import Mission, MissionItem
from autopilot.links.ground_station.orders import LongCommand, ProgressReports
from autopilot.links.ground_station.station_service import ParameterServer, StationService
from autopilot.links.ground_station.telemetry import Telemetry
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.frames import CommandCancel
from autopilot.links.transports import loopback_pair
from autopilot.signals import (
    AlarmEvent,
    AlarmSample,
    AlarmState,
    ConditionSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    Reference,
    RudderCommand,
    Tick,
)

ACCEPTED, REJECTED, DENIED, UNSUPPORTED, FAILED, IN_PROGRESS, CANCELLED = range(7)
ITEMS = tuple(MissionItem(3, 16, (0.0, 0.0, 0.0, 0.0), 10_000 * number, 10_000, 0.0) for number in range(1, 4))


def tick(now: float = 0.0, mode: Mode = Mode.STANDBY, alarms: tuple[str, ...] = ()) -> Tick:
    order = Order(OrderKind.HEADING, 0.5, serial=1) if mode is Mode.ENGAGED else Order()
    state = NavState(now, 1.0, 0.0, 4.0, 0.0, 0.0, 0.1, True)
    return Tick(1, now, (), order, state, Reference(0.7), 0.0, RudderCommand(now, 0.0, False), mode, alarms)


NUMBERS = {f"P{number}": float(number) for number in range(9)} | {"A_NAME_OF_16_CHR": 9.0}


class Carrier:
    """Writes down which commands it is given, and answers as it is ordered to."""

    def __init__(self, mission: Mission) -> None:
        self.mission, self.armed, self.tuner, self.wind = mission, False, None, WindGuide()
        self.tuning = SimpleNamespace(outcome=lambda: self.tuned)
        self.tuned = self.refusal = ""
        self.instruments, self.last_stop = Instruments(), LastStop()
        self.running: LongCommand | None = None
        self.result = ACCEPTED
        self.cancels = True
        self.given: list[tuple[Any, ...]] = []

    def execute(self, command: int, parameters: tuple[float, ...], at: Tick | None) -> int:
        self.given.append((command, parameters, at))
        return self.result

    def set_mode(self, mode: int, at: Tick | None) -> int:
        self.given.append(("mode", mode, at))
        return self.result

    def cancel(self, command: int) -> bool:
        self.given.append(("cancel", command))
        return self.cancels


def arrived(message: Any, system: int = 255, component: int = 190) -> Any:
    (received,) = MavlinkCodec().decode(MavlinkCodec(system, component).encode(message))
    return received


def fields(message: Any) -> tuple[Any, ...]:
    return (message.get_type(), *(getattr(message, name) for name in message.fieldnames))


class Service:
    """The service with a carrier of commands that writes down."""

    def __init__(self, files: dict[str, bytes] | None = None, ticked: bool = True) -> None:
        self.mission = Mission(TrackGuide(), ITEMS)
        self.carrier = Carrier(self.mission)
        self.telemetry, self.texts = Telemetry(self.mission), StatusTexts()
        if ticked:
            self.telemetry.take(tick())
        self.store = Store(dict(NUMBERS), positive=tuple(NUMBERS))
        self.service = StationService(
            self.carrier,  # type: ignore[arg-type]
            ParameterServer(self.store),
            self.telemetry,
            self.texts,
            files or {},
        )

    def send_text(self, message: Any, now: float = 0.0, system: int = 255) -> list[tuple[Any, ...]]:
        return [fields(answer) for answer in self.service.take(now, arrived(message, system))]

    def give(self, command: int, *values: float) -> list[tuple[Any, ...]]:
        return self.send_text(long(command, *values))

    def texts_said(self) -> list[tuple[int, str]]:
        return [(text.severity, text.text) for number in range(9) for text in self.texts.due(1000.0 + number)]


def long(command: int, *values: float, system: int = 1) -> Any:
    return dialect.MAVLink_command_long_message(system, 1, command, 0, *values, *[0.0] * (7 - len(values)))


def ack(command: int, result: int, percent: int = 0, system: int = 255) -> tuple[Any, ...]:
    return ("COMMAND_ACK", command, result, percent, 0, system, 190)


# commands


def test_a_command_is_carried_out_with_all_its_parameters_at_the_newest_tick() -> None:
    service = Service()
    assert service.give(31010, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0) == [ack(31010, ACCEPTED)]
    assert service.carrier.given == [(31010, (1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0), service.telemetry.tick)]
    service.carrier.result, service.carrier.refusal = REJECTED, "arm first"
    assert service.give(400, 1.0) == [ack(400, REJECTED)]
    assert service.texts_said() == [(4, "arm first")]


@pytest.mark.parametrize("frame", [0, 3, 5, 6, 10, 11])
def test_positions_in_command_int_are_scaled_and_other_numbers_are_not(frame: int) -> None:
    service = Service()

    def order(command: int, where: int) -> list[tuple[Any, ...]]:
        values = (1.0, 2.0, 3.0, 4.0, 595_000_000, -181_234_567, 7.5)
        return service.send_text(dialect.MAVLink_command_int_message(1, 1, where, command, 0, 0, *values))

    assert order(192, frame) == [ack(192, ACCEPTED)]
    assert order(31010, 1) == [ack(31010, ACCEPTED)]
    place, numbers = (given[1] for given in service.carrier.given)
    assert place == pytest.approx((1.0, 2.0, 3.0, 4.0, 59.5, -18.1234567, 7.5), abs=1e-9)
    assert numbers == (1.0, 2.0, 3.0, 4.0, 595_000_000.0, -181_234_567.0, 7.5)
    assert order(192, 1) == [ack(192, DENIED)]
    assert len(service.carrier.given) == 2
    assert service.texts_said() == [(4, "a place in frame 1: use a global one")]


def test_messages_are_made_when_they_are_asked_for() -> None:
    service = Service()
    for identity in (1, 2, 30, 42, 74, 148, 436):
        accepted, message = service.service.take(0.0, arrived(long(512, float(identity))))
        assert (fields(accepted), message.id) == (ack(512, ACCEPTED), identity)
    assert [message[0] for message in service.give(520, 1.0)] == ["COMMAND_ACK", "AUTOPILOT_VERSION"]
    for unknown in (0.0, 9999.0, 30.5, math.nan, math.inf, -1.0, 33.0, 395.0, 397.0):
        assert service.give(512, unknown) == [ack(512, UNSUPPORTED)]
    early = Service(ticked=False)
    assert early.give(512, 30.0) == [ack(512, UNSUPPORTED)]
    assert [message[0] for message in early.give(512, 148.0)] == ["COMMAND_ACK", "AUTOPILOT_VERSION"]


def test_the_modes_are_listed_all_or_one() -> None:
    service = Service()
    modes = [
        ("AVAILABLE_MODES", 5, 1, 0, 0, 0, b"Manual"),
        ("AVAILABLE_MODES", 5, 2, 0, 15, 0, b"Heading"),
        ("AVAILABLE_MODES", 5, 3, 6, 10, 0, b"Track"),
        ("AVAILABLE_MODES", 5, 4, 0, 3, 2, b"Trial"),
        ("AVAILABLE_MODES", 5, 5, 0, 1, 0, b"Wind"),
    ]
    assert service.give(512, 435.0, 0.0) == [ack(512, ACCEPTED), *modes]
    for index in (1, 2, 3, 4, 5):
        assert service.give(512, 435.0, float(index)) == [ack(512, ACCEPTED), modes[index - 1]]
    for none in (6.0, -1.0, 1.5, math.nan):
        assert service.give(512, 435.0, none) == [ack(512, UNSUPPORTED)]


def test_the_metadata_is_announced_where_there_is_some() -> None:
    service = Service({"/general.json": b"{}"})
    crc, where = sum_by_the_bit(b"{}"), b"mftp:///general.json"
    assert service.give(512, 397.0) == [ack(512, ACCEPTED), ("COMPONENT_METADATA", 0, crc, where)]
    assert service.give(512, 395.0) == [ack(512, ACCEPTED), ("COMPONENT_INFORMATION", 0, crc, where, 0, b"")]


def sum_by_the_bit(content: bytes) -> int:
    crc = 0
    for byte in content:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc


def test_an_interval_is_set_by_command() -> None:
    service = Service()
    assert service.give(511, 30.0, 100_000.0) == [ack(511, ACCEPTED)]
    assert service.give(511, 30.0, math.nan) == [ack(511, DENIED)]
    for unknown in (9999.0, 30.5, math.nan):
        assert service.give(511, unknown, 100_000.0) == [ack(511, UNSUPPORTED)]
    service.telemetry.due(0.0)
    assert [message.id for message in service.telemetry.due(0.1)] == [30]


def test_a_mode_is_set_by_its_old_message_too() -> None:
    service = Service()
    assert service.send_text(dialect.MAVLink_set_mode_message(1, 1, 15)) == [ack(11, ACCEPTED)]
    assert service.carrier.given == [("mode", 15, service.telemetry.tick)]
    service.carrier.result, service.carrier.refusal = REJECTED, "arm first"
    assert service.send_text(dialect.MAVLink_set_mode_message(1, 0x80, 15)) == [ack(11, UNSUPPORTED)], "no mode of ours"
    assert service.texts_said() == []
    assert service.send_text(dialect.MAVLink_set_mode_message(1, 0x81, 15)) == [ack(11, REJECTED)]
    assert service.texts_said() == [(4, "arm first")]


def test_a_clock_is_compared_once() -> None:
    service = Service()
    assert service.send_text(dialect.MAVLink_timesync_message(0, 77), 2.5) == [("TIMESYNC", 2_500_000_000, 77)]
    assert service.send_text(dialect.MAVLink_timesync_message(5, 77), 2.5) == [], "an answer is not answered"
    assert service.send_text(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)) == [], (
        "what asks nothing is not answered"
    )


# what takes a while


class Run:
    """Something that takes a while."""

    is_over = is_complete = False
    progress = 0.25


def test_progress_is_reported_once_a_second_and_the_end_at_once() -> None:
    run = Run()
    reports = ProgressReports()
    assert reports.due(0.0) == [] and not reports.is_for((0, 0))
    reports.begin(10.0, LongCommand(31010, (), run), (255, 190))
    assert reports.is_for((255, 190)) and not reports.is_for((254, 190)) and not reports.is_for((255, 191))
    when = [(n, fields(m)) for n in range(120) for m in reports.due(10.0 + n / 32.0)]
    assert when == [(n, ack(31010, IN_PROGRESS, 25)) for n in (32, 64, 96)]
    run.is_over, run.progress = True, 0.5
    assert [fields(message) for message in reports.due(13.76)] == [ack(31010, FAILED, 50)]
    assert reports.due(99.0) == [] and not reports.is_for((255, 190))


def test_a_long_command_is_answered_by_its_progress_and_cancelled() -> None:
    service, run = Service(), Run()
    service.carrier.result = IN_PROGRESS
    service.carrier.running = running = LongCommand(31010, (), run)
    assert service.give(31010) == [ack(31010, IN_PROGRESS, 25)]
    assert [fields(message) for message in service.service.due(1.0)] == [ack(31010, IN_PROGRESS, 25)]
    assert service.send_text(CommandCancel(1, 1, 31010), 1.5, system=254) == [ack(31010, CANCELLED, system=254)]
    run.is_over = running.is_cancelled = True
    assert service.send_text(CommandCancel(1, 1, 31010), 1.6) == [ack(31010, CANCELLED, 25)], (
        "who is reported to hears it once"
    )
    service.carrier.cancels = False
    assert service.send_text(CommandCancel(1, 1, 31010), 1.7) == []
    assert service.send_text(CommandCancel(1, 1, 31010), 1.7, system=254) == []
    service.carrier.running = None
    assert service.give(31014) == [ack(31014, IN_PROGRESS)]
    assert service.service.due(5.0) == [], "there is nothing to report"


# parameters


def value(index: int, number: float | None = None) -> tuple[Any, ...]:
    name = "A_NAME_OF_16_CHR" if index == 9 else f"P{index}"
    return ("PARAM_VALUE", name, float(index) if number is None else number, 9, 10, index)


def test_parameters_are_listed_four_a_turn() -> None:
    service = Service()
    assert service.send_text(dialect.MAVLink_param_request_list_message(1, 1)) == []
    turns = [[fields(message) for message in service.service.due(0.0)] for _ in range(4)]
    assert turns == [[value(n) for n in each] for each in ((0, 1, 2, 3), (4, 5, 6, 7), (8, 9), ())]


def test_parameters_are_read_by_name_or_index_and_written_by_name() -> None:
    service = Service()
    for name, index, answer in ((b"P3", -1, 3), (b"A_NAME_OF_16_CHR", -1, 9), (b"P3", 0, 0), (b"", 9, 9)):
        assert service.send_text(dialect.MAVLink_param_request_read_message(1, 1, name, index)) == [value(answer)]
    unknown = ("PARAM_ERROR", 255, 190)
    for name, index in ((b"P3", 10), (b"NONE", -1), (b"A_NAME_OF_16_CHS", -1)):
        assert service.send_text(dialect.MAVLink_param_request_read_message(1, 1, name, index)) == [
            (*unknown, name.decode(), index, 1)
        ]
    assert service.send_text(dialect.MAVLink_param_set_message(1, 1, b"P3", 7.5, 9)) == [value(3, 7.5)]
    refused = [value(3, 7.5), (*unknown, "P3", -1, dialect.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE)]
    assert service.send_text(dialect.MAVLink_param_set_message(1, 1, b"P3", -1.0, 9)) == refused
    assert service.send_text(dialect.MAVLink_param_set_message(1, 1, b"P3", 1.0, 6)) == refused
    assert service.send_text(dialect.MAVLink_param_set_message(1, 1, b"NONE", 1.0, 9)) == [(*unknown, "NONE", -1, 1)]
    said = service.texts_said()
    assert said[0] == (4, "P3 not changed: allowed: at least 0.")
    assert "".join(text for _, text in said[1:]) == "P3 not changed: it is REAL32 and was set as type 6"


# orders over a link that takes none


def test_orders_are_denied_in_their_own_way_and_nothing_is_done() -> None:
    service = Service()

    def denied(message: Any) -> list[tuple[Any, ...]]:
        return [fields(answer) for answer in service.service.answered(arrived(message), DENIED)]

    no_leave = ("PARAM_ERROR", 255, 190, "P3", -1, dialect.MAV_PARAM_ERROR_PERMISSION_DENIED)
    assert denied(dialect.MAVLink_param_set_message(1, 1, b"P3", 7.5, 9)) == [value(3), no_leave]
    assert denied(dialect.MAVLink_param_set_message(1, 1, b"NONE", 7.5, 9)) == [
        ("PARAM_ERROR", 255, 190, "NONE", -1, 1)
    ]
    current = ("MISSION_CURRENT", 0, 3, dialect.MISSION_STATE_NOT_STARTED, 2)
    assert denied(dialect.MAVLink_mission_set_current_message(1, 1, 2)) == [current]
    assert denied(dialect.MAVLink_mission_count_message(1, 1, 2, 1)) == [("MISSION_ACK", 255, 190, 14, 1)]
    assert denied(long(400, 1.0)) == [ack(400, DENIED)]
    assert denied(CommandCancel(1, 1, 31010)) == [ack(31010, DENIED)]
    assert denied(dialect.MAVLink_set_mode_message(1, 1, 15)) == [ack(11, DENIED)]
    assert service.carrier.given == [] and service.store.values["P3"] == 3.0 and service.mission.current == 0


# the mission, as people read it


def test_word_of_the_mission_and_of_tuning_is_a_notice_said_once() -> None:
    service = Service()
    assert service.send_text(dialect.MAVLink_mission_clear_all_message(1, 1))[0] == ("MISSION_ACK", 255, 190, 0, 0)
    assert service.texts_said() == [(5, "route cleared")]
    service.service.due(20.0)
    assert service.texts_said() == []
    service.send_text(dialect.MAVLink_mission_count_message(1, 1, 2), 30.0)
    for turn in range(1, 7):
        service.service.due(30.0 + turn)
    assert service.texts_said() == [
        (5, "upload of the route ended: item 0 did not come; th"),
        (5, "e old route is kept"),
    ]
    service.carrier.tuned = "the level is 7 now"
    service.service.due(40.0)
    assert service.texts_said() == [(5, "the level is 7 now")]


def test_a_waypoint_that_was_passed_is_reported_while_the_route_is_followed() -> None:
    service = Service()
    guide = service.mission.guide
    assert service.service.passed() == []
    guide.passed, guide.last_passed = 1, 4
    assert service.service.passed() == [], "going to a place"
    assert service.service.passed() == []
    service.mission.follow()
    guide.passed, guide.last_passed, guide.target = 2, 1, 2
    reached, current = (fields(message) for message in service.service.passed())
    assert reached == ("MISSION_ITEM_REACHED", 1)
    assert current[:5] == ("MISSION_CURRENT", 2, 3, dialect.MISSION_STATE_ACTIVE, 1)
    assert service.service.passed() == []


# the alarms as a file


def test_the_alarms_are_a_list_with_names_words_and_states() -> None:
    lost, said = AlarmEvent("heading_lost"), text_of("heading_lost")
    listed = alarm_list(
        (lost, lost._replace(is_escalated=True), other("in its own words: 5°")),
        (AlarmState.SOUNDING, AlarmState.ACKNOWLEDGED, AlarmState.NOTICE),
    )
    assert json.loads(listed) == [
        {"name": "heading_lost", "priority": "alarm", "words": said, "state": "sounding", "escalated": False},
        {"name": "heading_lost", "priority": "alarm", "words": said, "state": "acknowledged", "escalated": True},
        {"name": "", "priority": "warning", "words": "in its own words: 5°", "state": "notice", "escalated": False},
    ]
    assert "5°".encode() in listed and b", " not in listed.replace(said.encode(), b"")
    assert json.loads(alarm_list((lost, other("b")), (AlarmState.SOUNDING,)))[0]["state"] == "notice", "not known which"
    assert alarm_list((), ()) == b"[]"


# the link


class Linked:
    """The link over a loopback, with a carrier that writes down."""

    def __init__(self, policy: AccessPolicy | None = None, key: bool = True) -> None:
        self.near, self.far = loopback_pair()
        self.mission = Mission(TrackGuide(), ITEMS)
        self.carrier = Carrier(self.mission)
        if not key:
            self.near.is_local = False  # type: ignore[attr-defined]
        self.link = BoatLink(
            self.near,
            self.carrier,  # type: ignore[arg-type]
            ParameterServer(Store(dict(NUMBERS))),
            system=7,
            access=policy.link() if policy else None,
        )
        self.station = MavlinkCodec(255, 190)

    def heard(self) -> list[Any]:
        return [message for data in self.far.receive() for message in self.station.decode(data)]

    def kept(self, now: float, kind: str) -> list[Any]:
        self.link.poll(now)
        return [message for message in self.heard() if message.get_type() == kind]

    def send_text(self, now: float, message: Any, system: int = 255, component: int = 190) -> list[Any]:
        self.far.send(MavlinkCodec(system, component).encode(message))
        samples: list[Any] = self.link.receive(now)
        self.link._access.crowded = False  # as the next tick does, whose telemetry is not wanted here
        return samples


BEAT = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3)


@pytest.mark.parametrize(
    ("mode", "armed", "flags", "custom", "state"),
    [
        (None, False, 0x41, 0, 1),
        (None, True, 0xC1, 0, 1),
        (Mode.STANDBY, False, 0x41, 0, 3),
        (Mode.STANDBY, True, 0xC1, 0, 3),
        (Mode.ENGAGED, False, 0x85, 15, 4),
        (Mode.ENGAGED, True, 0x85, 15, 4),
        (Mode.OVERRIDE, True, 0xC1, 0, 3),
        (Mode.FAILSAFE, False, 0x41, 0, 5),
        (Mode.FAULT, False, 0x41, 0, 6),
    ],
)
def test_the_heartbeat_says_boat_and_state(mode: Mode | None, armed: bool, flags: int, custom: int, state: int) -> None:
    bench = Linked()
    bench.carrier.armed = armed
    if mode is not None:
        bench.link.publish_tick(tick(0.0, mode))
    (beat,) = bench.kept(0.0, "HEARTBEAT")
    assert (beat.get_srcSystem(), beat.get_srcComponent()) == (7, 1)
    assert fields(beat) == ("HEARTBEAT", 11, 0, flags, custom, state, 3)
    bench.link.release(0.5)
    (last,) = bench.heard()
    assert fields(last) == ("HEARTBEAT", 11, 0, flags, custom, 7, 3)


def test_the_heart_beats_once_a_second() -> None:
    bench = Linked()
    assert [n for n in range(100) if bench.kept(n / 32.0, "HEARTBEAT")] == [0, 32, 64, 96]


@pytest.mark.parametrize(
    ("mode", "severity"),
    [(Mode.STANDBY, 4), (Mode.ENGAGED, 4), (Mode.OVERRIDE, 4), (Mode.FAILSAFE, 2), (Mode.FAULT, 1)],
)
def test_an_alarm_is_said_when_it_is_new_by_how_bad_it_is(mode: Mode, severity: int) -> None:
    bench = Linked()
    said = []
    one, two = other("one"), other("two")
    for now, alarms in ((0.0, (one,)), (20.0, (one,)), (40.0, (two, one)), (60.0, ()), (80.0, (one,))):
        bench.link.publish_tick(shown(now, mode, alarms))
        said += [(now, text.severity, text.text) for text in bench.kept(now, "STATUSTEXT")]
    assert said == [(0.0, severity, "one"), (40.0, severity, "two"), (80.0, severity, "one")]


def test_a_stranger_is_refused_and_informed_once_a_minute() -> None:
    bench = Linked(AccessPolicy(AccessRules(systems=frozenset({255}))))
    texts = []
    for now in (0.0, 0.5, 59.9, 60.0, 60.5):
        bench.send_text(now, long(400, 1.0, system=7), system=254)
        texts += [(now, text.severity, text.text) for text in bench.kept(now, "STATUSTEXT")]
    words = "refused: a system id that is not allowed"
    assert texts == [(0.0, 4, words), (60.0, 4, words)]
    assert bench.carrier.given == []
    bench.send_text(61.0, long(400, 1.0, system=7))
    assert len(bench.carrier.given) == 1


def test_a_link_from_elsewhere_without_a_key_only_looks() -> None:
    bench = Linked(key=False)
    assert not bench.link.takes_orders
    bench.send_text(0.0, long(400, 1.0, system=7))
    denied, *texts = bench.heard() + bench.kept(1.0, "STATUSTEXT") + bench.kept(2.0, "STATUSTEXT")
    assert fields(denied) == ack(400, DENIED) and bench.carrier.given == []
    texts += bench.kept(3.0, "STATUSTEXT")
    assert "".join(text.text for text in texts if text.get_type() == "STATUSTEXT").startswith(
        "no orders without a signing key over this link"
    )
    bench.send_text(4.0, long(512, 148.0, system=7))
    assert [message.get_type() for message in bench.heard()] == ["COMMAND_ACK", "AUTOPILOT_VERSION"]


@pytest.mark.parametrize(
    ("system", "component", "is_ours"),
    [(7, 1, True), (0, 0, True), (7, 0, True), (0, 1, True), (8, 1, False), (7, 2, False), (1, 1, False)],
)
def test_what_is_for_us(system: int, component: int, is_ours: bool) -> None:
    bench = Linked()
    bench.send_text(0.0, dialect.MAVLink_command_long_message(system, component, 400, 0, 1.0, *[0.0] * 6))
    assert bool(bench.carrier.given) is is_ours


def test_a_station_that_falls_silent_is_reported_missing() -> None:
    bench = Linked()
    assert bench.send_text(0.0, BEAT) == []
    assert bench.link.receive(5.0) == []
    silent = ConditionSample(5.1, "station_silent", True, "loopback:a", "loopback:a")
    assert bench.link.receive(5.1) == [silent]
    assert bench.send_text(5.2, BEAT, 7, 1) == [], "that is our own name"
    over = ConditionSample(5.3, "station_silent", False, "", "loopback:a")
    assert bench.send_text(5.3, BEAT, 7, 2) == [over]
    other = Linked()
    other.send_text(0.0, long(512, 148.0, system=7))
    assert other.link.receive(9.0) == [], "who never beat is not missed"


def test_a_flood_is_reported_when_it_begins_and_five_seconds_after_it() -> None:
    bench = Linked()
    for _ in range(101):
        bench.far.send(bench.station.encode(BEAT))
    begun = ConditionSample(10.0, "link_flooded", True, "loopback:a", "loopback:a")
    assert bench.link.receive(10.0) == [begun]
    assert bench.link.dropped == 1
    assert bench.link.receive(14.9) == []
    assert bench.link.receive(15.0)[0] == ConditionSample(15.0, "link_flooded", False, "", "loopback:a")
    for _ in range(100):
        bench.far.send(bench.station.encode(BEAT))
    bench.link.receive(20.0)
    assert bench.link.dropped == 1, "a hundred in one turn are heeded"


def test_a_crowded_link_is_left_alone_until_the_command_has_left() -> None:
    bench = Linked()
    bench.link._access.crowded = True
    assert bench.link.fileno() == -1
    bench.far.send(bench.station.encode(long(400, 1.0, system=7)))
    assert bench.link.receive(1.0) == [] and bench.carrier.given == []
    bench.link.publish_tick(shown(1.0))
    assert [sample.name for sample in bench.link.receive(1.1) if isinstance(sample, ConditionSample)] == [
        "link_flooded"
    ]
    assert len(bench.carrier.given) == 1


def test_both_directions_are_recorded_once() -> None:
    bench = Linked()
    question = bench.station.encode(long(520, 1.0, system=7))
    bench.far.send(question)
    bench.link.receive(3.0)
    answers = bench.far.receive()
    assert bench.link.take_packets() == [(3.0, question), *((3.0, answer) for answer in answers)]
    assert len(answers) == 2 and bench.link.take_packets() == []
    for step in range(5001):
        bench.link.release(float(step))
        bench.far.receive()
    packets = bench.link.take_packets()
    assert len(packets) == 5000 and packets[0][0] == 1.0


def test_what_cannot_leave_is_counted_and_not_recorded() -> None:
    bench = Linked()
    bench.near.send = lambda data: False  # type: ignore[method-assign]
    bench.link.release(0.0)
    bench.link.release(0.0)
    assert bench.link.dropped == 2 and bench.link.take_packets() == []


def test_a_station_that_is_gone_is_reported_once_and_ends_nothing() -> None:
    bench = Linked()
    bench.send_text(0.0, BEAT)
    bench.link.receive(6.0)
    bench.far.close()
    bench.link.poll(6.5)
    assert bench.link.dropped == 1
    alarm, over = bench.link.receive(7.0)
    assert isinstance(alarm, AlarmSample) and (alarm.time, alarm.source) == (7.0, "loopback:a")
    lost = "loopback:a: the other end has closed; open a new pair"
    assert words(alarm.event) == f"ground station lost, steering goes on: {lost}"
    assert over == ConditionSample(7.0, "station_silent", False, "", "loopback:a")
    assert bench.link.lost == alarm.event and bench.link.fileno() == -1
    assert bench.link.receive(99.0) == []


def test_the_alarms_that_are_on_are_served_as_a_file() -> None:
    bench = Linked()
    asked = bytearray(251)
    asked[3:5] = bytes((4, 12))  # open for reading, twelve characters of a path
    asked[12:24] = b"/alarms.json"

    def length() -> int:
        asked[0] += 1
        bench.send_text(0.0, dialect.MAVLink_file_transfer_protocol_message(0, 7, 1, list(asked)))
        (answer,) = (message for message in bench.heard() if message.get_type() == "FILE_TRANSFER_PROTOCOL")
        assert answer.payload[3] == 128
        return int.from_bytes(bytes(answer.payload[12:16]), "little")

    assert length() == 2, "an empty list before the first tick"
    bench.link.publish_tick(tick(alarms=(other("one"),)))
    bench.heard()
    assert length() == len('[{"name":"","priority":"warning","words":"one","state":"notice","escalated":false}]')


def test_a_loopback_that_closed_does_not_stop_the_way_out() -> None:
    bench = Linked()
    bench.link.close()
    with pytest.raises(LinkError):
        bench.near.send(b"x")
    bench.link.release(0.0)


def test_every_station_is_given_what_another_has_changed() -> None:
    store = Store(dict(NUMBERS))
    one, other = ParameterServer(store), ParameterServer(store)
    message = dialect.MAVLink_param_set_message(1, 1, b"P3", 7.5, dialect.MAV_PARAM_TYPE_REAL32)
    assert [each.param_value for each in one.take(message)[0]] == [7.5]
    assert one.due() == [], "it has its answer"
    assert [(each.param_id, each.param_value, each.param_index) for each in other.due()] == [("P3", 7.5, 3)]
    store.set("P4", 1.0)  # not by a station: adopted, or designed
    for server in (one, other):
        assert [(each.param_id, each.param_value) for each in server.due()] == [("P4", 1.0)]
        assert server.due() == []
