"""The alarms that are on, as a file for ground stations: STATUSTEXT tells when an alarm begins, never when it ends."""

from __future__ import annotations

import json
from collections.abc import Sequence

from autopilot.alarm_panel import UNHEARD
from autopilot.alarms import kind_of
from autopilot.signals import AlarmState

ALARMS = "/alarms.json"
"""A list over MAVLink FTP; to be read again when the value `alarms`, how many are on, or `alarms_new`, how many of them
nobody has acknowledged, changes."""


def alarm_list(alarms: Sequence[str], heard: Sequence[AlarmState]) -> bytes:
    """Return the file: of each alarm its name ("" for what a link says in its own words), its words and its state
    (`notice`, `sounding`, `acknowledged`). heard: the states; those that are not known count as notices."""
    states = heard if len(heard) == len(alarms) else [AlarmState.NOTICE] * len(alarms)
    entries = [
        {"name": _name(words), "words": words, "state": state.name.lower()}
        for words, state in zip(alarms, states, strict=True)
    ]
    return json.dumps(entries, ensure_ascii=False, separators=(",", ":")).encode()


def _name(words: str) -> str:
    kind = kind_of(words.removeprefix(UNHEARD))
    return kind.name if kind is not None else ""
