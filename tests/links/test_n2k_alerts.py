"""The pilot's alarms as alerts on an NMEA 2000 network, tick by tick."""

from __future__ import annotations

import pytest

from autopilot.links.n2k.packets import text_of
from autopilot.links.n2k.session import Alerts, number_of
from autopilot.signals import (
    AlarmEvent,
    AlarmState,
    Mode,
    NavState,
    Order,
    Reference,
    RudderCommand,
    Tick,
)
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
