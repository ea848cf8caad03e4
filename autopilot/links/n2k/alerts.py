"""The pilot's alarms on the displays of an NMEA 2000 network: alert, its text, and a display's acknowledgement. Pure.

    126983 alert: kind, priority, state, who has it        126985 its text        126984 the answer of a display

The kinds are those of IEC 62923: emergency alarm, alarm, warning, caution. An alarm has a number by its name, always
the same; every time that it comes anew counts as one more occurrence.

Source: fields and words as in canboat's canboat.json.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

from autopilot.links.n2k.fields import ALERT, ALERT_TEXT, text
from autopilot.signals import AlarmState, Tick
from autopilot.supervision.alarms import CATALOGUE, Priority, kind_of
from autopilot.supervision.panel import sentence_of

KINDS = {Priority.EMERGENCY: 1, Priority.ALARM: 2, Priority.WARNING: 5, Priority.CAUTION: 8}
NAVIGATIONAL = 0
NORMAL, ACTIVE, ACKNOWLEDGED, AWAITING = 1, 2, 4, 5
"""States of an alert; the last: it is over, and nobody has acknowledged it."""
CAN_BE_ACKNOWLEDGED, IS_ACKNOWLEDGED = 1 << 4, 1 << 1
AUTOMATIC, EXCEEDED, WITHIN = 1, 1, 0
ENGLISH = 1
NOBODY = 0xFFFFFFFFFFFFFFFF
HEAD = struct.Struct("<BBBHQBBB")
REPEATED_S = 5.0
OCCURRENCES = 250
TEXT_MOST = 120


class _Alert(NamedTuple):
    """One alarm as it was sent last: its kind and words, occurrence, state, and when [s]."""

    kind: int
    words: str
    occurrence: int
    state: int
    sent: float


class Alerts:
    """What is said of the alarms, under the NAME of our node."""

    def __init__(self, name: int) -> None:
        self._name = name
        self._alerts: dict[str, _Alert] = {}

    def due(self, tick: Tick) -> list[tuple[int, bytes]]:
        """Return groups and data that fall due with `tick`: at every change at once, and again while an alarm lasts."""
        said: list[tuple[int, bytes]] = []
        states = dict(zip((each.name for each in tick.alarms), tick.alarm_states, strict=False))
        present = {each.name: each for each in tick.alarms}
        for name, event in present.items():
            before = self._alerts.get(name)
            is_new = before is None or before.state == NORMAL
            is_heard = states.get(name) is AlarmState.ACKNOWLEDGED
            state = ACKNOWLEDGED if is_heard else AWAITING if event.is_past else ACTIVE
            if before is not None and before.state == state and tick.now - before.sent < REPEATED_S:
                continue
            occurrence = 1 if before is None else before.occurrence % OCCURRENCES + is_new
            alert = _Alert(KINDS[kind_of(event).priority], sentence_of(event), occurrence, state, tick.now)
            self._alerts[name] = alert
            said.append((ALERT, self._alert(name, alert)))
            if is_new:
                words = text(alert.words[:TEXT_MOST]) + text("")
                said.append((ALERT_TEXT, self._head(name, alert) + bytes((ENGLISH,)) + words))
        for name, alert in self._alerts.items():
            if name not in present and alert.state != NORMAL:
                self._alerts[name] = over = alert._replace(state=NORMAL, sent=tick.now)
                said.append((ALERT, self._alert(name, over)))
        return said

    def acknowledged(self, data: bytes) -> str:
        """Return the name of the alarm that a response acknowledges or silences; "" where it is none of ours."""
        if len(data) < HEAD.size + 9 or data[HEAD.size + 8] & 3 > 1:
            return ""
        number, owner = HEAD.unpack_from(data)[3:5]
        return next((each for each in self._alerts if owner == self._name and number_of(each) == number), "")

    def _head(self, name: str, alert: _Alert) -> bytes:
        return HEAD.pack(alert.kind | NAVIGATIONAL << 4, 0, 0, number_of(name), self._name, 0, 0, alert.occurrence)

    def _alert(self, name: str, alert: _Alert) -> bytes:
        flags = 0xC0 | CAN_BE_ACKNOWLEDGED | (IS_ACKNOWLEDGED if alert.state == ACKNOWLEDGED else 0)
        threshold = WITHIN if alert.state in (NORMAL, AWAITING) else EXCEEDED
        tail = struct.pack("<BQBBB", flags, NOBODY, AUTOMATIC | threshold << 4, 100, alert.state)
        return self._head(name, alert) + tail


def number_of(name: str) -> int:
    """Return the number of an alarm in 16 bits, from 1 to 65000."""
    return CATALOGUE[name].number % 65000 + 1
