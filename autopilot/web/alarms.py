"""The alarms that are on, and who has seen them: both are the boat's, fetched when the numbers it tells change. Pure.

Texts alone would not do: they tell when an alarm begins, never when it ends or was acknowledged, and a display that
comes later has not heard them.
"""

from __future__ import annotations

import json
import math
from typing import Any

from autopilot.links.boat.alarm_list import ALARMS
from autopilot.signals import AlarmState
from autopilot.web.ftp_client import FtpClient
from autopilot.web.view import BoatView

LOOK_S = 5.0
"""The list is fetched again after this [s] while alarms are on: one may have taken another's place."""
STATES = {state.name.lower(): state for state in AlarmState}


class AlarmBoard:
    """`shown` are the alarms that are on, the newest last, with what the boat knows of who has seen them."""

    def __init__(self, files: FtpClient) -> None:
        self._files = files
        self._on: dict[str, tuple[str, AlarmState]] = {}
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
        try:
            entries = json.loads(content or b"null")
            self._on = {str(entry["words"]): (str(entry["name"]), STATES[entry["state"]]) for entry in entries}
        except (ValueError, TypeError, KeyError):
            return
        self._seen &= self._on.keys()
