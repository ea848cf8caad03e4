"""The pilot's alarms as alerts on an NMEA 2000 network, tick by tick."""

from __future__ import annotations

import math
import struct

import pytest
from station_doubles import Skipper

from autopilot.guidance.current import Overboard, Place
from autopilot.links.n2k.node import Alerts, Device, number_of
from autopilot.links.n2k.packets import Message, text_of
from autopilot.links.n2k.session import N2kSession, N2kSettings
from autopilot.signals import AlarmEvent, AlarmState, Mode, NavState, Order, Reference, RudderCommand, Tick
from autopilot.supervision.alarms import CATALOGUE
from autopilot.supervision.panel import sentence_of

STATE = NavState(0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.1, True)
NAME = 0xC0509600FFC12345


def tick(now: float, *alarms: AlarmEvent, state: AlarmState = AlarmState.SOUNDING) -> Tick:
    command = RudderCommand(now, 0.0, True)
    states = (state,) * len(alarms)
    return Tick(0, now, (), Order(), STATE, Reference(0.0), 0.0, command, Mode.ENGAGED, alarms, alarm_states=states)


def states(said: list[tuple[int, bytes]]) -> list[tuple[int, int, int]]:
    """Return number, occurrence and state of each alert."""
    return [(int.from_bytes(data[3:5], "little"), data[15], data[27]) for group, data in said if group == 126983]


def test_an_alarm_is_said_with_its_text_again_while_it_lasts_and_when_it_is_over() -> None:
    alerts, event = Alerts(NAME), AlarmEvent("off_course", "12 deg")
    number = number_of("off_course")
    first = alerts.due(tick(0.0, event))
    assert [group for group, _ in first] == [126983, 126985]
    assert states(first) == [(number, 1, 2)]
    assert text_of(first[1][1], 17)[0] == sentence_of(event)[:120]
    assert [len(alerts.due(tick(now, event))) for now in (0.1, 4.9, 5.0, 5.1, 10.0)] == [0, 0, 1, 0, 1]
    assert states(alerts.due(tick(10.1, event, state=AlarmState.ACKNOWLEDGED))) == [(number, 1, 4)]
    assert states(alerts.due(tick(11.0))) == [(number, 1, 1)]
    assert alerts.due(tick(20.0)) == []
    again = alerts.due(tick(21.0, event))
    assert states(again) == [(number, 2, 2)] and len(again) == 2, "another occurrence, with its text"
    assert states(alerts.due(tick(22.0, event._replace(is_past=True)))) == [(number, 2, 5)]


def test_every_alarm_has_a_number_and_a_kind_of_its_own_and_fits_a_packet() -> None:
    assert len({number_of(name) for name in CATALOGUE}) == len(CATALOGUE)
    for name in CATALOGUE:
        said = Alerts(NAME).due(tick(0.0, AlarmEvent(name, "x" * 500, because=None)))
        assert next(len(data) for _, data in said) == 28
        assert all(len(data) <= 223 for _, data in said)
        assert said[0][1][0] & 15 in (1, 2, 5, 8)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({}, "off_course"),
        ({24: b"\x01"}, "off_course"),
        ({24: b"\x02"}, ""),
        ({5: b"\x00"}, ""),
        ({3: b"\x00\x00"}, ""),
    ],
)
def test_only_an_answer_to_ours_acknowledges(change: dict[int, bytes], name: str) -> None:
    alerts = Alerts(NAME)
    alert = alerts.due(tick(0.0, AlarmEvent("off_course")))[0][1]
    answer = bytearray(alert[:16] + bytes(8) + b"\x00")
    for at, value in change.items():
        answer[at : at + len(value)] = value
    assert alerts.acknowledged(bytes(answer)) == name
    assert all(alerts.acknowledged(bytes(answer[:size])) == "" for size in range(25))


PLACE = Place(math.radians(59.34), math.radians(-18.07))
BEACON = b"\xff" + (77).to_bytes(4, "little") + b"\xf8" + 4 * b"\xff" + b"\xf9" + 6 * b"\xff"
"""Of 127233 up to the position: whose, an activated beacon, its own position."""
HERE = struct.pack("<ii", 593400000, -180700000)


def network(overboard: Overboard | None) -> N2kSession:
    skipper = Skipper()
    skipper.overboard = overboard
    made = N2kSession("bus", N2kSettings(device=Device(0x12345)), helm=skipper)
    for now in (-0.6, -0.3):
        made.poll(now)
    made.due(0.0)
    return made


def said(made: N2kSession, now: float) -> list[bytes]:
    made.on_tick(tick(now))
    return [each.data for each in made.due(now) if each.group == 127233]


def test_a_man_overboard_is_said_at_once_and_ever_again_until_it_is_over() -> None:
    overboard = Overboard()
    made = network(overboard)
    assert said(made, 1.0) == []
    overboard.place, overboard.since = PLACE, 1.5
    (data,) = said(made, 2.0)
    assert len(data) == 35
    assert data[:6] == b"\xff\x45\x23\x01\x00\xf9", "our own number, by a button on board"
    assert data[6:17] == b"\xff\xff\xff\xff\xf8" + 6 * b"\xff", "no time is known; a position of the vessel"
    assert data[17:25] == HERE
    assert data[25:] == 10 * b"\xff"
    assert [len(said(made, now)) for now in (2.1, 6.9, 7.0)] == [0, 0, 1]
    made.receive(8.0, [Message(59904, (127233).to_bytes(3, "little"), 35, 204)])
    assert [(each.group, each.data) for each in made.due(8.0)] == [(127233, data)]
    overboard.clear()
    assert said(made, 20.0) == []


@pytest.mark.parametrize(
    ("data", "is_taken"),
    [
        (BEACON + HERE + 10 * b"\xff", True),
        (BEACON[:5] + b"\xf9" + BEACON[6:] + HERE + 10 * b"\xff", True),
        (BEACON[:5] + b"\xfa" + BEACON[6:] + HERE + 10 * b"\xff", False),
        (BEACON + b"\xff\xff\xff\x7f\xff\xff\xff\x7f" + 10 * b"\xff", False),
        (BEACON + HERE[:7], False),
    ],
)
def test_a_man_overboard_on_the_network_is_one_and_a_test_is_none(data: bytes, is_taken: bool) -> None:
    overboard = Overboard()
    made = network(overboard)
    made.receive(3.0, [Message(127233, data, 9)])
    assert (overboard.place is not None) is is_taken
    if overboard.place is not None:
        assert overboard.place == pytest.approx(PLACE)
        assert overboard.since == 3.0
        assert said(made, 4.0) == [], "whose beacon it is says so"


def test_a_beacon_that_drifts_is_followed_and_one_taken_back_stays_so_until_it_begins_anew() -> None:
    overboard = Overboard()
    made = network(overboard)
    drifted = struct.pack("<ii", 593410000, -180700000)
    for now, place in ((1.0, HERE), (30.0, drifted)):
        made.receive(now, [Message(127233, BEACON + place + 10 * b"\xff", 9)])
    assert overboard.place is not None and overboard.place.latitude == pytest.approx(math.radians(59.341))
    assert overboard.since == 1.0
    overboard.clear()
    made.receive(60.0, [Message(127233, BEACON + HERE + 10 * b"\xff", 9)])
    assert overboard.place is None
    made.receive(121.0, [Message(127233, BEACON + HERE + 10 * b"\xff", 9)])
    assert overboard.place is not None
