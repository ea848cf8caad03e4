"""The boat that ground stations see, over a loopback on a manual clock: identity, parameters, commands, loss."""

from __future__ import annotations

import math
import random
from random import Random
from typing import Any

import pytest
from alarm_texts import shown, words
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect
from station_doubles import Skipper, Store

from autopilot.guidance.track import TrackGuide
from autopilot.links.base import LinkError
from autopilot.links.ground_station.access import AccessPolicy
from autopilot.links.ground_station.boat_link import BoatLink
from autopilot.links.ground_station.commands import Commands
from autopilot.links.ground_station.mission import Mission
from autopilot.links.ground_station.station_service import ParameterServer
from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.frames import CommandCancel
from autopilot.links.transports import loopback_pair
from autopilot.operators.trial_script import TrialScript, turning, zigzag
from autopilot.signals import (
    AlarmSample,
    HeadingSample,
    Mode,
    NavState,
    Order,
    OrderKind,
    PositionSample,
    Reference,
    RudderCommand,
    Tick,
)


class Hand(Skipper):
    """Writes down what was ordered, trials too."""

    def hand_to_track(self) -> None:
        self.orders.append(("track", None))

    def pattern(self, number: int, side: float, sizes: tuple[float, ...]) -> None:
        self.orders.append(("pattern", float(number)))

    def zigzag(self, rudder: float, heading_change: float, duration: float) -> TrialScript:
        self.orders.append(("zigzag", rudder))
        self.trial = TrialScript([zigzag(rudder, heading_change, duration)])
        return self.trial

    def turning(self, rudder: float, duration: float) -> TrialScript:
        self.orders.append(("turning", rudder))
        self.trial = TrialScript([turning(rudder, duration)])
        return self.trial

    def end_trial(self) -> None:
        self.trial.stop()

    def acknowledge(self, name: str = "") -> None:
        self.orders.append(("acknowledge", None))


def tick(mode: Mode = Mode.STANDBY, now: float = 0.0, heading: float = 1.0) -> Tick:
    order = Order(OrderKind.HEADING, 0.5, serial=1) if mode is Mode.ENGAGED else Order()
    state = NavState(now, heading, 0.1, 4.0, 0.05, 0.01, 0.1, True)
    samples = (HeadingSample(now, heading), PositionSample(now, math.radians(-35.5), math.radians(18.25)))
    command = RudderCommand(now, 0.1, mode is Mode.ENGAGED)
    return Tick(1, now, samples, order, state, Reference(0.7), 0.1, command, mode, ())


class Bench:
    def __init__(self, armed: bool = False) -> None:
        near, self.far = loopback_pair()
        self.hand, self.store = Hand(), Store({"ONE": 1.0, "TWO": 2.0, "A_NAME_OF_16_CHR": 3.0}, positive=("TWO",))
        self.guide = TrackGuide()
        self.mission = Mission(self.guide)
        self.commands = Commands(self.hand, armed, self.mission)
        self.link = BoatLink(near, self.commands, ParameterServer(self.store), system=7)
        self.station = MavlinkCodec(255, 190)
        self.now = 0.0

    def run(self, seconds: float, mode: Mode = Mode.STANDBY) -> list[Any]:
        for _ in range(round(seconds * 20)):
            self.now += 0.05
            self.link.receive(self.now)
            self.link.poll(self.now)
            self.link.publish_tick(tick(mode, self.now))
        return [message for data in self.far.receive() for message in self.station.decode(data)]

    def ask(self, message: Any, mode: Mode = Mode.STANDBY) -> list[Any]:
        self.far.send(self.station.encode(message))
        return self.run(0.2, mode)

    def command(self, command: int, *values: float, mode: Mode = Mode.STANDBY, system: int = 7) -> int | None:
        parameters = [*values, *[0.0] * (7 - len(values))]
        answers = self.ask(dialect.MAVLink_command_long_message(system, 1, command, 0, *parameters), mode)
        acks = [message for message in answers if message.get_type() == "COMMAND_ACK"]
        assert len(acks) <= 1
        if not acks:
            return None
        assert (acks[0].command, acks[0].target_system, acks[0].target_component) == (command, 255, 190)
        return int(acks[0].result)


def test_it_is_a_surface_boat_with_an_honest_state() -> None:
    bench = Bench()
    for mode, state, custom in ((Mode.STANDBY, 3, 0), (Mode.ENGAGED, 4, 15), (Mode.FAILSAFE, 5, 0)):
        bench.run(1.0, mode)
        beats = [m for m in bench.run(3.0, mode) if m.get_type() == "HEARTBEAT"]
        assert len(beats) == 3
        beat = beats[-1]
        assert (beat.get_srcSystem(), beat.get_srcComponent()) == (7, 1)
        assert (beat.type, beat.autopilot) == (dialect.MAV_TYPE_SURFACE_BOAT, dialect.MAV_AUTOPILOT_GENERIC)
        assert (beat.system_status, beat.custom_mode) == (state, custom)
        assert bool(beat.base_mode & dialect.MAV_MODE_FLAG_SAFETY_ARMED) == (mode is Mode.ENGAGED)


def test_telemetry_says_what_the_pilot_knows_in_the_fields_own_units() -> None:
    last = {message.get_type(): message for message in Bench().run(3.0, Mode.ENGAGED)}
    assert last["ATTITUDE"].yaw == pytest.approx(1.0) and last["ATTITUDE"].yawspeed == pytest.approx(0.1)
    assert last["VFR_HUD"].heading == 57 and last["VFR_HUD"].groundspeed == 4.0
    assert (last["NAV_CONTROLLER_OUTPUT"].nav_bearing, last["NAV_CONTROLLER_OUTPUT"].target_bearing) == (40, 29)
    position = last["GLOBAL_POSITION_INT"]
    assert (position.lat, position.lon, position.hdg) == (-355000000, 182500000, 5730)
    assert (position.vx, position.vy) == (216, 337)
    status = last["SYS_STATUS"]
    assert status.onboard_control_sensors_health & dialect.MAV_SYS_STATUS_SENSOR_3D_MAG
    assert status.onboard_control_sensors_health == status.onboard_control_sensors_enabled, "nothing is ill"


def test_intervals_are_set_stopped_and_refused() -> None:
    bench = Bench()
    interval = dialect.MAV_CMD_SET_MESSAGE_INTERVAL
    assert bench.command(interval, dialect.MAVLINK_MSG_ID_ATTITUDE, 100_000.0) == dialect.MAV_RESULT_ACCEPTED
    bench.run(1.0)
    assert sum(m.get_type() == "ATTITUDE" for m in bench.run(5.0)) == pytest.approx(50, abs=1)
    assert bench.command(interval, dialect.MAVLINK_MSG_ID_ATTITUDE, -1.0) == dialect.MAV_RESULT_ACCEPTED
    bench.run(0.5)
    assert not [m for m in bench.run(2.0) if m.get_type() == "ATTITUDE"]
    assert bench.command(interval, dialect.MAVLINK_MSG_ID_ATTITUDE, math.nan) == dialect.MAV_RESULT_DENIED
    assert bench.command(interval, 9999.0, 100_000.0) == dialect.MAV_RESULT_UNSUPPORTED


def test_parameters_by_list_name_and_index() -> None:
    bench = Bench()
    listed = [m for m in bench.ask(dialect.MAVLink_param_request_list_message(0, 0)) if m.get_type() == "PARAM_VALUE"]
    assert [(m.param_id, m.param_value, m.param_index, m.param_count) for m in listed] == [
        ("ONE", 1.0, 0, 3), ("TWO", 2.0, 1, 3), ("A_NAME_OF_16_CHR", 3.0, 2, 3),
    ]  # fmt: skip
    for name, index in ((b"TWO", -1), (b"", 1)):
        answers = bench.ask(dialect.MAVLink_param_request_read_message(7, 1, name, index))
        assert [m.param_value for m in answers if m.get_type() == "PARAM_VALUE"] == [2.0]
    for name, index in ((b"NONE", -1), (b"", 3)):
        answers = bench.ask(dialect.MAVLink_param_request_read_message(7, 1, name, index))
        assert not [m for m in answers if m.get_type() == "PARAM_VALUE"]
        errors = [m for m in answers if m.get_type() == "PARAM_ERROR"]
        assert [(m.param_id, m.param_index, m.error) for m in errors] == [(name.decode(), index, 1)]


def test_a_parameter_that_does_not_exist_is_answered_by_an_error_to_whoever_asked_us() -> None:
    bench = Bench()
    answers = bench.ask(dialect.MAVLink_param_set_message(7, 1, b"NONE", 5.0, 9))
    error = next(m for m in answers if m.get_type() == "PARAM_ERROR")
    assert (error.param_id, error.param_index, error.error) == ("NONE", -1, dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST)
    assert (error.target_system, error.target_component) == (bench.station.system, bench.station.component)
    for target in ((0, 0), (7, 0), (0, 1)):
        answers = bench.ask(dialect.MAVLink_param_set_message(*target, b"NONE", 5.0, 9))
        assert not [m for m in answers if m.get_type() == "PARAM_ERROR"], "it may be another component's"


@pytest.mark.parametrize(
    ("value", "kind"),
    [(math.nan, 9), (math.inf, 9), (-math.inf, 9), (7.0, 6), (7.0, 1), (7.0, 10), (7.0, 0), (7.0, 255)],
)
def test_a_set_that_is_no_number_or_of_another_type_is_answered_by_the_old_value(value: float, kind: int) -> None:
    bench = Bench()
    answers = bench.ask(dialect.MAVLink_param_set_message(7, 1, b"TWO", value, kind))
    assert [m.param_value for m in answers if m.get_type() == "PARAM_VALUE"] == [2.0]
    assert any(m.text.startswith("TWO not changed: ") for m in answers if m.get_type() == "STATUSTEXT")
    assert bench.store.values["TWO"] == 2.0


def test_every_set_is_answered_by_the_old_value_where_it_is_refused() -> None:
    bench = Bench()
    for value, kept in ((5.0, 5.0), (-1.0, 5.0)):
        answers = bench.ask(dialect.MAVLink_param_set_message(7, 1, b"TWO", value, 9))
        assert [m.param_value for m in answers if m.get_type() == "PARAM_VALUE"] == [kept]
    assert any("TWO not changed" in m.text for m in answers if m.get_type() == "STATUSTEXT")
    assert not [
        m for m in bench.ask(dialect.MAVLink_param_set_message(8, 1, b"TWO", 9.0, 9)) if "PARAM" in m.get_type()
    ]
    assert bench.store.values["TWO"] == 5.0


def test_a_value_that_a_line_held_until_the_next_one_had_come_does_not_replace_it() -> None:
    bench = Bench()
    first, other, second = (
        bench.station.encode(dialect.MAVLink_param_set_message(7, 1, name, value, 9))
        for name, value in ((b"TWO", 5.0), (b"ONE", 8.0), (b"TWO", 6.0))
    )
    for data in (second, other, first, first):
        bench.far.send(data)
    answers = bench.run(0.2)
    assert bench.store.values == {"ONE": 8.0, "TWO": 6.0, "A_NAME_OF_16_CHR": 3.0}
    values = [(m.param_id, m.param_value) for m in answers if m.get_type() == "PARAM_VALUE"]
    assert values[:4] == [("TWO", 6.0), ("ONE", 8.0), ("TWO", 6.0), ("TWO", 6.0)]
    assert not [m for m in answers if m.get_type() == "PARAM_ERROR"], "its sender's newest value counts"
    said = "".join(m.text for m in answers + bench.run(2.0) if m.get_type() == "STATUSTEXT")
    assert "a value of TWO came behind the value that was set after it and is not set" in said
    bench.ask(dialect.MAVLink_param_set_message(7, 1, b"TWO", 5.0, 9))
    assert bench.store.values["TWO"] == 5.0, "set anew it counts"


def test_a_station_that_has_begun_to_count_anew_sets_values_again() -> None:
    """A script that is run once more: its numbers begin again below those of its first run."""
    bench = Bench()
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    five, six = (dialect.MAVLink_param_set_message(7, 1, b"TWO", value, 9) for value in (5.0, 6.0))
    for number, message in ((5, beat), (6, five), (0, beat), (1, beat), (2, beat), (3, beat), (4, six)):
        bench.station._mavlink.seq = number
        bench.ask(message)
        bench.run(0.6)
    assert bench.store.values["TWO"] == 6.0
    bench.station._mavlink.seq = 3
    bench.ask(five)
    assert bench.store.values["TWO"] == 6.0, "a late one of its new numbers is late all the same"


@pytest.mark.parametrize("magnetic", [False, True])
def test_stations_know_whether_courses_are_magnetic_and_no_place_leads_then(magnetic: bool) -> None:
    bench = Bench(armed=True)
    bench.guide.settings = bench.guide.settings._replace(magnetic=magnetic)
    named = [m for m in bench.run(2.0) if m.get_type() == "NAMED_VALUE_FLOAT" and m.name == "magnetic"]
    assert {m.value for m in named} == {float(magnetic)}
    there = dialect.MAVLink_command_int_message(
        7, 1, 6, dialect.MAV_CMD_DO_REPOSITION, 0, 0, -1.0, 1.0, 0.0, math.nan, 590000000, 180000000, 0.0
    )
    answers = bench.ask(there)
    said = any("courses are magnetic here" in m.text for m in answers if m.get_type() == "STATUSTEXT")
    assert said is magnetic
    assert ("courses are magnetic" in bench.mission.obstacle(bench.now)) is magnetic


def test_engaging_needs_arming_and_disarming_gives_the_rudder_back() -> None:
    bench = Bench()
    guided = (dialect.MAV_CMD_DO_SET_MODE, 1.0, 15.0)
    assert bench.command(*guided) == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    assert bench.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == dialect.MAV_RESULT_ACCEPTED
    assert bench.command(*guided) == dialect.MAV_RESULT_ACCEPTED
    assert bench.hand.orders == [("engage", None)]
    bench.run(0.1, Mode.ENGAGED)
    assert bench.command(*guided, mode=Mode.ENGAGED) == dialect.MAV_RESULT_ACCEPTED
    assert len(bench.hand.orders) == 1, "already there: the heading ordered is kept"
    assert bench.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0.0) == dialect.MAV_RESULT_ACCEPTED
    assert bench.hand.orders[-1] == ("stand by", None)


@pytest.mark.parametrize(
    ("command", "parameters", "heading"),
    [
        (dialect.MAV_CMD_CONDITION_YAW, (90.0, 0.0, 0.0, 0.0), math.pi / 2),
        (dialect.MAV_CMD_CONDITION_YAW, (10.0, 0.0, 1.0, 1.0), 0.5 + math.radians(10.0)),
        (dialect.MAV_CMD_CONDITION_YAW, (10.0, 0.0, -1.0, 1.0), 0.5 - math.radians(10.0)),
        (dialect.MAV_CMD_GUIDED_CHANGE_HEADING, (1.0, 270.0), -math.pi / 2),
    ],
)
def test_headings_are_changed_only_while_one_is_steered(
    command: int, parameters: tuple[float, ...], heading: float
) -> None:
    bench = Bench(armed=True)
    assert bench.command(command, *parameters) == dialect.MAV_RESULT_TEMPORARILY_REJECTED
    bench.run(0.1, Mode.ENGAGED)
    assert bench.command(command, *parameters, mode=Mode.ENGAGED) == dialect.MAV_RESULT_ACCEPTED
    assert bench.hand.orders == [("turn", pytest.approx(heading))]


def test_what_is_unknown_is_unsupported_and_what_is_for_others_is_theirs() -> None:
    bench = Bench(armed=True)
    for command in (dialect.MAV_CMD_DO_PARACHUTE, dialect.MAV_CMD_NAV_TAKEOFF, 65535):
        assert bench.command(command) == dialect.MAV_RESULT_UNSUPPORTED
    assert bench.command(dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0.0, system=9) is None
    assert bench.command(dialect.MAV_CMD_REQUEST_MESSAGE, dialect.MAVLINK_MSG_ID_AUTOPILOT_VERSION) == 0


@given(st.integers(0, 65535), st.lists(st.floats(width=32), min_size=7, max_size=7), st.sampled_from(list(Mode)))
def test_any_command_is_answered_and_none_raises(command: int, parameters: list[float], mode: Mode) -> None:
    bench = Bench(armed=True)
    bench.run(0.1, mode)
    assert bench.command(command, *parameters, mode=mode) is not None
    courses = [value for name, value in bench.hand.orders if name in ("engage", "turn")]
    assert all(heading is None or -math.pi < heading <= math.pi for heading in courses)


def test_whatever_a_ground_station_sends_is_survived() -> None:
    random, bench = Random(5), Bench(armed=True)
    asked = [kind for kind in dialect.mavlink_map.values() if "target_system" in kind.fieldnames]
    for number in range(4000):
        kind = random.choice(asked)
        message = dialect.MAVLink(None).decode(blank(kind, random))
        message.target_system = 7
        if hasattr(message, "target_component"):
            message.target_component = 1
        bench.far.send(bench.station.encode(message))
        if number % 20 == 0:
            bench.run(0.05, random.choice(list(Mode)))
    kinds = {m.get_type() for m in bench.run(1.0)}
    assert "HEARTBEAT" in kinds


def blank(kind: Any, random: Random) -> bytearray:
    """Return a frame of a kind with any content."""
    payload = random.randbytes(kind.unpacker.size)
    frame = bytes([0xFD, len(payload), 0, 0, 7, 255, 190]) + kind.id.to_bytes(3, "little") + payload
    return bytearray(frame + dialect.x25crc(frame[1:] + bytes([kind.crc_extra])).crc.to_bytes(2, "little"))


def test_a_flood_is_heeded_in_part_and_a_lost_station_ends_nothing() -> None:
    bench = Bench()
    request = bench.station.encode(dialect.MAVLink_param_request_read_message(7, 1, b"ONE", -1))

    def flood() -> None:
        for _ in range(1000):
            bench.far.send(request)

    flood()
    answers = bench.run(0.05)
    assert sum(m.get_type() == "PARAM_VALUE" for m in answers) == 100
    assert 100 < bench.link.dropped < 900  # the rest was not even looked at

    def gone() -> list[bytes]:
        raise LinkError("tcpin:x: the other side is gone")

    flood()
    bench.link.receive(8.8)
    bench.link._transport.receive = gone  # type: ignore[method-assign]
    assert bench.link.receive(8.9) == []  # crowded: not looked at before the next command has left
    bench.link.publish_tick(shown(8.9))
    (alarm,) = bench.link.receive(9.0)
    assert isinstance(alarm, AlarmSample) and "steering goes on" in words(alarm.event)
    assert bench.link.receive(9.1) == []
    bench.link.poll(20.0)
    bench.link.release(20.0)
    assert bench.link.fileno() == -1


def test_times_of_the_station_s_line_to_the_bit() -> None:
    """A heartbeat a second, the same refusal once a minute, word of who has stopped us for half a minute."""
    bench = Bench()
    bench.link.poll(-9.0)
    bench.far.receive()
    assert [bool(bench.far.receive()) for now in (-8.0001, -8.0) if bench.link.poll(now) is None] == [False, True]
    said: list[float] = []
    bench.link._texts.send_text = lambda now, *_: said.append(now)  # type: ignore[method-assign]
    for now in (0.0, 59.999, 60.0):
        bench.link._refuse(now, "no")
    assert said == [0.0, 60.0]
    notice = bench.link._stop_refused
    notice.happened(0.0, "")
    assert [len(notice.news(now, None)) for now in (0.0, 29.999, 30.0)] == [1, 0, 1]


def put(bench: Bench, number: int, command: int, *values: float, confirmation: int = 0) -> None:
    """Have a command arrive under a sequence number."""
    bench.station._mavlink.seq = number
    parameters = [*values, *[0.0] * (7 - len(values))]
    bench.far.send(bench.station.encode(dialect.MAVLink_command_long_message(7, 1, command, confirmation, *parameters)))


TURN = dialect.MAV_CMD_CONDITION_YAW, 10.0, 0.0, 1.0, 1.0
ENGAGE, STAND_BY = ((dialect.MAV_CMD_DO_SET_MODE, 1.0, float(mode)) for mode in (15, 0))


def acknowledged(answers: list[Any]) -> list[int]:
    return [int(message.result) for message in answers if message.get_type() == "COMMAND_ACK"]


@pytest.mark.parametrize(
    ("numbers", "confirmations", "turns"),
    [
        ((7, 8), (0, 1), 1),  # said again, as the answer was lost
        ((7, 7), (0, 0), 1),  # doubled by the line
        ((7, 8), (0, 0), 2),  # ordered twice
        ((7, 8), (1, 1), 2),  # by who gives every order with a confirmation
        ((8, 7), (1, 0), 1),  # the first comes behind what was said again for it
        ((7, 8), (1, 0), 2),  # the first was lost; ordered anew
    ],
)
def test_a_turn_that_comes_twice_is_sailed_once(
    numbers: tuple[int, int], confirmations: tuple[int, int], turns: int
) -> None:
    bench = Bench(armed=True)
    bench.station._mavlink.seq = 6
    bench.ask(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3), Mode.ENGAGED)
    answers = []
    for number, confirmation in zip(numbers, confirmations, strict=True):
        put(bench, number, *TURN, confirmation=confirmation)
        answers += bench.run(0.2, Mode.ENGAGED)
    assert len(bench.hand.orders) == turns
    assert acknowledged(answers) == [0, 0]


def test_a_sender_whose_numbers_stand_still_may_order_the_same_turn_again() -> None:
    bench = Bench(armed=True)
    bench.run(0.1, Mode.ENGAGED)
    for _ in range(2):
        put(bench, 0, *TURN)
        bench.run(0.2, Mode.ENGAGED)
    assert len(bench.hand.orders) == 2


BEAT = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)


@pytest.mark.parametrize(
    ("who", "are_two"),
    [
        ("one", False),
        ("two", True),
        ("one that begins anew", False),
        ("one that begins anew from far behind", False),
        ("one over two ways, of which one is slow", False),
        ("one on a line that loses most", False),
    ],
)
def test_two_stations_under_one_id_are_said(who: str, are_two: bool) -> None:
    """Each counts its messages by itself, one a second and nine others beside it."""
    bench = Bench()
    chance = random.Random(20261129)
    said: list[Any] = []
    for second in range(40):
        first, other = 10 * second, 10 * second + 77
        numbers = [first]
        if who == "two":
            numbers.append(other)
        elif who == "one that begins anew":
            numbers = [first if second < 20 else first - 150]
        elif who.endswith("behind"):
            numbers = [3 * (second % 20) + second // 20]
        elif who.startswith("one over"):
            numbers.append(first - 50)
        elif who.endswith("most") and chance.random() < 0.7:
            numbers = []
        for number in numbers:
            bench.station._mavlink.seq = number % 256
            bench.far.send(bench.station.encode(BEAT))
            said += bench.run(0.5)
    words_ = "".join(each.text for each in said if each.get_type() == "STATUSTEXT")
    assert ("two ground stations have the id" in words_) is are_two
    assert words_.count("two ground stations") <= 1, "once a minute"


def test_two_vehicles_under_one_id_are_no_ground_stations() -> None:
    bench = Bench()
    vehicle = dialect.MAVLink_heartbeat_message(11, 3, 0, 0, 4, 3)
    far, said = MavlinkCodec(9, 1), []
    for second in range(40):
        for number in (10 * second, 10 * second + 77):
            far._mavlink.seq = number % 256
            bench.far.send(far.encode(vehicle))
            said += bench.run(0.5)
    assert not [each for each in said if each.get_type() == "STATUSTEXT"]


def test_the_same_order_after_ten_seconds_or_after_a_refusal_is_a_new_one() -> None:
    bench = Bench(armed=True)
    put(bench, 7, *TURN)
    assert acknowledged(bench.run(0.2)) == [1], "nothing is steered yet"
    bench.run(0.1, Mode.ENGAGED)
    put(bench, 8, *TURN, confirmation=1)
    bench.run(10.3, Mode.ENGAGED)
    put(bench, 9, *TURN, confirmation=2)
    bench.run(0.2, Mode.ENGAGED)
    assert len(bench.hand.orders) == 2


def test_an_order_to_engage_that_a_line_held_does_not_end_the_standby_sent_after_it() -> None:
    bench = Bench(armed=True)
    put(bench, 255, *STAND_BY)
    bench.run(0.2, Mode.ENGAGED)
    put(bench, 250, *ENGAGE)
    answers = bench.run(3.0)
    assert bench.hand.orders == [("stand by", None)]
    assert acknowledged(answers) == [1]
    assert "came behind it" in "".join(each.text for each in answers if each.get_type() == "STATUSTEXT")
    put(bench, 1, *ENGAGE)
    bench.run(0.2)
    assert bench.hand.orders[1:] == [("engage", None)], "one that was given after it counts"


def test_a_standby_that_comes_twice_is_not_its_senders_last() -> None:
    bench = Bench(armed=True)
    for number, mode in ((5, Mode.ENGAGED), (20, Mode.ENGAGED), (5, Mode.STANDBY)):
        put(bench, number, *STAND_BY)
        bench.run(0.2, mode)
    assert [name for name, _ in bench.hand.orders] == ["stand by"] * 3, "it is obeyed each time"
    put(bench, 10, *ENGAGE)
    assert acknowledged(bench.run(0.2)) == [1]


def test_an_order_to_engage_said_again_after_somebody_else_stood_by_is_not_carried_out() -> None:
    bench = Bench(armed=True)
    bench.run(0.1)
    put(bench, 7, *ENGAGE)
    bench.run(0.2)
    bench.station, other = MavlinkCodec(254, 190), bench.station
    put(bench, 70, *STAND_BY)
    bench.run(0.2, Mode.ENGAGED)
    bench.run(0.1)
    bench.station = other
    put(bench, 8, *ENGAGE, confirmation=1)
    assert acknowledged(bench.run(0.2)) == [0]
    assert bench.hand.orders == [("engage", None), ("stand by", None)]


class TwoStations:
    """Stations A and B, each on a link of its own to one boat that A has engaged; lockstep, 20 ticks a second."""

    def __init__(self) -> None:
        hand = Hand()
        self.commands = Commands(hand, True, Mission(TrackGuide()))
        self.orders, self.now, self.mode = hand.orders, 0.0, Mode.ENGAGED
        policy, store = AccessPolicy(), Store()
        pairs = {name: loopback_pair() for name in "AB"}
        self.far = {name: far for name, (_, far) in pairs.items()}
        self.links = [
            BoatLink(near, self.commands, ParameterServer(store), system=7, access=policy.link())
            for near, _ in pairs.values()
        ]
        # both with the id that ground stations come with
        self.codecs = {name: MavlinkCodec(255, 190) for name in "AB"}
        self.run(0.5)

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 20)):
            self.now += 0.05
            for link in self.links:
                link.receive(self.now)
            if self.orders:
                self.mode = Mode.STANDBY if self.orders[-1][0] == "stand by" else Mode.ENGAGED
            for link in self.links:
                link.publish_tick(tick(self.mode, self.now))
                link.poll(self.now)

    def put(self, name: str, command: int, *values: float, confirmation: int = 0) -> None:
        values = (*values, *[0.0] * (7 - len(values)))
        order = dialect.MAVLink_command_long_message(7, 1, command, confirmation, *values)
        self.far[name].send(self.codecs[name].encode(order))

    def answers(self, name: str) -> tuple[list[int], str]:
        heard = [each for data in self.far[name].receive() for each in self.codecs[name].decode(data)]
        return acknowledged(heard), "".join(each.text for each in heard if each.get_type() == "STATUSTEXT")


def test_an_order_to_engage_whose_station_could_not_see_that_another_stood_by_is_refused() -> None:
    two = TwoStations()
    two.put("A", *STAND_BY)
    two.put("B", *ENGAGE)
    two.run(0.3)
    two.put("B", *ENGAGE)  # a third of a second later: still on its way when it could be seen
    two.run(1.0)
    assert two.orders == [("stand by", None)]
    results, words = two.answers("B")
    assert results == [1, 1] and "before you could see it" in words
    two.put("B", *ENGAGE)
    two.run(0.2)
    assert two.orders[1:] == [("engage", None)], "one that was given a second after it counts"


@pytest.mark.parametrize("ahead", [-100, -40, 4, 11, 25, 77, 127])
def test_another_station_of_the_same_id_behind_one_router_has_not_seen_the_standby(ahead: int) -> None:
    bench = Bench(armed=True)
    bench.commands.last_stop.on_tick(tick(Mode.ENGAGED, 0.0))
    put(bench, 6, *TURN)
    bench.run(0.2, Mode.ENGAGED)
    put(bench, 7, *STAND_BY)
    bench.run(0.1)
    put(bench, (7 + ahead) % 256, *ENGAGE)
    answers = bench.run(0.8)
    assert bench.hand.orders[-1] == ("stand by", None)
    assert acknowledged(answers)[-1] == 1
    assert "before you could see it" in "".join(each.text for each in answers if each.get_type() == "STATUSTEXT")
    put(bench, (8 + ahead) % 256, *ENGAGE)
    bench.run(0.2)
    assert bench.hand.orders[-1] == ("engage", None), "one that was given 0.8 s after it counts"


@pytest.mark.parametrize("lost", [0, 2])
def test_the_station_that_stood_by_engages_at_once_though_its_line_loses_some(lost: int) -> None:
    bench = Bench(armed=True)
    put(bench, 255, *STAND_BY)
    bench.run(0.1, Mode.ENGAGED)
    bench.run(0.1)
    put(bench, lost, *ENGAGE)
    bench.run(0.1)
    assert bench.hand.orders == [("stand by", None), ("engage", None)]


def test_what_was_said_again_since_before_another_stood_by_is_refused() -> None:
    """The first saying was lost; a station repeats by itself what nobody has acknowledged."""
    two = TwoStations()
    two.put("A", *STAND_BY)
    two.run(2.0)
    two.put("B", *ENGAGE, confirmation=1)
    two.run(0.2)
    assert two.orders == [("stand by", None)]
    two.put("B", *ENGAGE)
    two.run(0.2)
    assert two.orders[1:] == [("engage", None)]


def test_an_order_that_comes_as_if_said_ever_so_often_is_refused_no_longer_than_one_may_be_said_again() -> None:
    """A script that gives each command a `confirmation` of 255 was refused for a quarter of an hour."""
    two = TwoStations()
    two.put("A", *STAND_BY)
    two.run(9.5)
    two.put("B", *ENGAGE, confirmation=255)
    two.run(1.0)
    assert two.orders == [("stand by", None)]
    two.put("B", *ENGAGE, confirmation=255)
    two.run(0.2)
    assert two.orders[1:] == [("engage", None)]


def test_who_stood_by_may_engage_again_at_once_and_who_saw_nothing_may_stand_by() -> None:
    two = TwoStations()
    two.put("A", *STAND_BY)
    two.run(0.1)
    two.put("B", *STAND_BY)
    two.run(0.1)
    two.put("B", *ENGAGE)
    two.run(0.1)
    assert [name for name, _ in two.orders] == ["stand by", "stand by", "engage"]


def test_who_says_standby_again_and_again_keeps_nobody_from_engaging() -> None:
    two = TwoStations()
    for _ in range(4):
        two.put("A", *STAND_BY)
        two.run(0.6)
    two.put("B", *ENGAGE)
    two.run(0.2)
    assert two.orders[-1] == ("engage", None)


def test_an_order_to_engage_on_its_way_when_the_helm_is_taken_on_board_is_refused() -> None:
    two = TwoStations()
    two.mode = Mode.OVERRIDE
    two.run(0.1)
    two.put("A", *ENGAGE)
    two.run(0.2)
    assert two.orders == []
    two.run(1.0)
    two.put("A", *ENGAGE)
    two.run(0.1)
    assert two.orders == [("engage", None)]


def test_alarms_are_acknowledged_though_the_pilot_has_just_stood_by() -> None:
    two = TwoStations()
    two.put("A", *STAND_BY)
    two.put("B", int(dialect.MAV_CMD_SPATIAL_USER_5))
    two.run(0.2)
    assert two.answers("B")[0] == [0]


def test_a_turn_that_comes_twice_behind_another_one_is_sailed_once() -> None:
    bench = Bench(armed=True)
    bench.run(0.1, Mode.ENGAGED)
    port = (*TURN[:3], -1.0, 1.0)
    for number, order in ((7, TURN), (8, port), (7, TURN), (9, TURN)):
        put(bench, number, *order)
        bench.run(0.2, Mode.ENGAGED)
    assert len(bench.hand.orders) == 3


def test_a_turn_that_a_router_brings_over_two_links_is_sailed_once() -> None:
    bench = Bench(armed=True)
    policy = AccessPolicy()
    pairs = [loopback_pair() for _ in range(2)]
    links = [
        BoatLink(near, bench.commands, ParameterServer(bench.store), system=7, access=policy.link())
        for near, _ in pairs
    ]

    def passed_on(message: Any) -> list[int]:
        bench.now += 0.05
        packet, results = bench.station.encode(message), []
        for link, (_, far) in zip(links, pairs, strict=True):
            far.send(packet)
            link.publish_tick(tick(Mode.ENGAGED, bench.now))
            link.receive(bench.now)
            results += acknowledged([each for data in far.receive() for each in MavlinkCodec().decode(data)])
        return results

    # the second way is there from the order on
    pairs[0][1].send(bench.station.encode(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)))
    command, *values = TURN
    order = dialect.MAVLink_command_long_message(7, 1, command, 0, *values, 0.0, 0.0, 0.0)
    for turns in (1, 2):
        assert passed_on(order) == [0, 0]
        assert len(bench.hand.orders) == turns


def test_a_heading_ordered_back_counts_though_only_its_second_saying_comes() -> None:
    """What was said again is the last that was ordered: 50, 90, and 50 anew."""
    bench = Bench(armed=True)
    bench.run(0.1, Mode.ENGAGED)
    for number, (heading_deg, confirmation) in enumerate(((50.0, 0), (90.0, 0), (50.0, 1)), 7):
        put(bench, number, dialect.MAV_CMD_CONDITION_YAW, heading_deg, confirmation=confirmation)
        bench.run(0.2, Mode.ENGAGED)
    assert [round(math.degrees(order[1])) for order in bench.hand.orders] == [50, 90, 50]


@pytest.mark.parametrize("between", [230, 250, 500])
def test_a_busy_sender_s_order_to_engage_after_standby_counts(between: int) -> None:
    """A joystick sends 50 messages a second: the numbers have begun again when the next order comes."""
    bench = Bench(armed=True)
    put(bench, 0, *STAND_BY)
    bench.run(0.2, Mode.ENGAGED)
    beat = dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    for number in range(1, between):
        bench.station._mavlink.seq = number % 256
        bench.far.send(bench.station.encode(beat))
        if number % 10 == 0:
            bench.run(0.05)
    bench.run(0.1)
    put(bench, between % 256, *ENGAGE)
    assert acknowledged(bench.run(0.2)) == [0]
    assert bench.hand.orders[-1] == ("engage", None)


def test_an_order_to_engage_anew_after_standby_counts_though_only_its_second_saying_comes() -> None:
    bench = Bench(armed=True)
    bench.run(0.1)
    for number, (order, confirmation, mode) in enumerate(
        ((ENGAGE, 0, Mode.STANDBY), (STAND_BY, 0, Mode.ENGAGED), (ENGAGE, 1, Mode.STANDBY)), 7
    ):
        bench.run(0.1, mode)
        put(bench, number, *order, confirmation=confirmation)
        bench.run(0.1, mode)
    assert bench.hand.orders == [("engage", None), ("stand by", None), ("engage", None)]


def test_a_trial_that_was_cancelled_is_not_begun_again_by_what_comes_twice() -> None:
    bench = Bench(armed=True)
    bench.run(0.1, Mode.ENGAGED)
    trial = dialect.MAV_CMD_USER_1, 10.0, 20.0, 60.0
    put(bench, 7, *trial)
    assert acknowledged(bench.run(0.2, Mode.ENGAGED)) == [5]
    put(bench, 8, *trial, confirmation=1)
    assert acknowledged(bench.run(0.2, Mode.ENGAGED)) == [5], "under way"
    bench.ask(CommandCancel(7, 1, dialect.MAV_CMD_USER_1), Mode.ENGAGED)
    bench.run(1.0, Mode.ENGAGED)
    put(bench, 7, *trial)
    assert acknowledged(bench.run(0.2, Mode.ENGAGED)) == [6], "cancelled"
    assert [name for name, _ in bench.hand.orders] == ["zigzag"]


def test_who_ends_a_trial_orders_a_turn_at_once() -> None:
    bench = Bench(armed=True)
    bench.commands.last_stop.on_tick(tick(Mode.ENGAGED, 0.0))
    bench.run(0.1, Mode.ENGAGED)
    put(bench, 7, dialect.MAV_CMD_USER_1, 10.0, 20.0, 60.0)
    assert acknowledged(bench.run(0.2, Mode.ENGAGED)) == [5]
    bench.station._mavlink.seq = 8
    bench.ask(CommandCancel(7, 1, dialect.MAV_CMD_USER_1), Mode.ENGAGED)
    put(bench, 9, *TURN)
    assert acknowledged(bench.run(0.2, Mode.ENGAGED))[-1] == 0
    assert [name for name, _ in bench.hand.orders][-1] != "zigzag"


def test_whoever_is_refused_for_the_same_reason_soon_after_another_hears_it_too() -> None:
    bench = Bench(armed=True)
    turn = dialect.MAVLink_command_long_message(7, 1, dialect.MAV_CMD_CONDITION_YAW, 0, 90.0, 0, 0, 0, 0, 0, 0)
    for _ in range(2):
        answers = bench.ask(turn) + bench.run(1.0)
        assert acknowledged(answers) == [1]
        assert "not engaged" in "".join(each.text for each in answers if each.get_type() == "STATUSTEXT")
