"""The alarms that are on, as a file for ground stations: STATUSTEXT tells when an alarm begins, never when it ends."""

from __future__ import annotations

import json
from collections.abc import Sequence

from autopilot.alarm_words import sentence_of
from autopilot.alarms import OTHER
from autopilot.signals import AlarmEvent, AlarmState

ALARMS = "/alarms.json"
"""A list over MAVLink FTP; to be read again when the value `alarms`, how many are on, or `alarms_new`, how many of them
nobody has acknowledged, changes."""


def alarm_list(alarms: Sequence[AlarmEvent], heard: Sequence[AlarmState]) -> bytes:
    """Return the file: of each alarm its name ("" where it has no kind), its words, its state (`notice`, `sounding`,
    `acknowledged`), and whether it is said again because nobody acknowledges it. heard: the states; those that are not
    known count as notices."""
    states = heard if len(heard) == len(alarms) else [AlarmState.NOTICE] * len(alarms)
    entries = [
        {
            "name": "" if event.name == OTHER else event.name,
            "words": sentence_of(event._replace(is_escalated=False)),
            "state": state.name.lower(),
            "escalated": event.is_escalated,
        }
        for event, state in zip(alarms, states, strict=True)
    ]
    return json.dumps(entries, ensure_ascii=False, separators=(",", ":")).encode()
