"""The alarms that are on, and who has seen them: both are the boat's, fetched when the numbers it tells change. Pure.

Texts alone would not do: they tell when an alarm begins, never when it ends or was acknowledged, and a display that
comes later has not heard them.
"""

from __future__ import annotations

import contextlib
import math
import re
from typing import Any

from autopilot.errors import InputError
from autopilot.links.boat.alarm_list import ALARMS
from autopilot.order_values import SHOWN
from autopilot.params.ftp_client import FtpClient
from autopilot.printable import printable
from autopilot.signals import AlarmState
from autopilot.strict_json import parse_json
from autopilot.web.view import BoatView

LOOK_S = 5.0
"""The list is fetched again after this [s] while alarms are on: one may have taken another's place."""
STATES = {state.name.lower(): state for state in AlarmState}
LIST_MOST = 65536
"""Bytes of a list: three hundred alarms, or thirty of the longest sentences."""
NAME = re.compile(r"([a-z][a-z0-9_]{0,63})?")
"""A name, "" where an alarm is of no kind."""

Alarms = dict[str, tuple[str, AlarmState]]
"""Name and state of each alarm by its words."""


class AlarmBoard:
    """`shown` are the alarms that are on, the newest last, with what the boat knows of who has seen them."""

    def __init__(self, files: FtpClient) -> None:
        self._files = files
        self._on: Alarms = {}
        self._seen: set[str] = set()
        self._told: tuple[float, float | None] | None = None
        self._next = -math.inf
        self._is_asked = self._is_old = False

    @property
    def shown(self) -> list[dict[str, Any]]:
        """The alarms, each with its name, its words, whether it sounds, and whether somebody has acknowledged it."""
        return [
            {
                "name": name,
                "words": words,
                "sounds": state is AlarmState.SOUNDING and words not in self._seen,
                "acknowledged": state is AlarmState.ACKNOWLEDGED or words in self._seen,
            }
            for words, (name, state) in self._on.items()
        ]

    def look(self, now: float, view: BoatView) -> None:
        """Fetch the list where the boat tells of other alarms than we know, or of others that were acknowledged."""
        count = view.value("alarm_count")
        if count is None:
            return
        told = (count, view.value("alarm_new"))
        if count == 0.0:
            self._on.clear()
        elif told != self._told or now >= self._next:
            self._next, self._is_old = now + LOOK_S, True
        self._told = told
        if self._is_old and not self._is_asked:
            self._is_asked, self._is_old = True, False
            self._files.fetch(ALARMS, self._take)

    def acknowledge(self, is_known_aboard: bool) -> None:
        """Note that all that sounds has been seen; where the boat does not know, it counts here alone."""
        sounding = [words for words, (_, state) in self._on.items() if state is AlarmState.SOUNDING]
        if is_known_aboard:
            self._on.update({words: (self._on[words][0], AlarmState.ACKNOWLEDGED) for words in sounding})
        else:
            self._seen.update(sounding)

    def forget(self) -> None:
        """The boat has started again."""
        self._on.clear()
        self._told = None

    def _take(self, content: bytes | None) -> None:
        self._is_asked = False
        if content is None:
            return
        with contextlib.suppress(InputError):  # the alarms known stay, until a list comes that is one
            self._on = alarms_from(content)
            self._seen &= self._on.keys()


def alarms_from(content: bytes) -> Alarms:
    """Return the alarms of a boat's list. Raises InputError."""
    origin = "the boat's list of alarms"
    entries = parse_json(content, origin, LIST_MOST)
    if not isinstance(entries, list):
        raise InputError(f"{origin}: a list [...] is needed")
    return dict(_alarm_from(entry, f"{origin}: alarm {number}") for number, entry in enumerate(entries, 1))


def _alarm_from(entry: Any, origin: str) -> tuple[str, tuple[str, AlarmState]]:
    fields = entry if isinstance(entry, dict) else {}
    words, name, state = (fields.get(key) for key in ("words", "name", "state"))
    if not isinstance(words, str):
        raise InputError(f"{origin}: words {printable(repr(words), SHOWN)}: a text is needed")
    if not (isinstance(name, str) and NAME.fullmatch(name)):
        raise InputError(f"{origin}: name {printable(repr(name), SHOWN)}: up to 64 of a-z, 0-9 and _ are allowed")
    if not (isinstance(state, str) and state in STATES):
        raise InputError(f"{origin}: state {printable(repr(state), SHOWN)}: allowed are {', '.join(STATES)}")
    return words, (name, STATES[state])
