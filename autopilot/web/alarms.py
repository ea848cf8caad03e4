"""The alarms that are on: the list is the boat's, fetched when the number it tells changes; who has seen them is ours.

Pure. Texts alone would not do: they tell when an alarm begins, never when it ends, and a display that comes later has
not heard them.
"""

from __future__ import annotations

import json
import math
from typing import Any

from autopilot.links.boat.alarm_list import ALARMS
from autopilot.web.ftp_client import FtpClient
from autopilot.web.view import BoatView

AGAIN = "NOT ACKNOWLEDGED: "
LOOK_S = 5.0
"""The list is fetched again after this [s] while alarms are on: one may have taken another's place."""


class AlarmBoard:
    """`shown` are the alarms that are on, the newest last, with whether they have been acknowledged here."""

    def __init__(self, files: FtpClient) -> None:
        self._files = files
        self._on: dict[str, bool] = {}
        self._count: float | None = None
        self._next = -math.inf

    @property
    def shown(self) -> list[dict[str, Any]]:
        """The alarms, each with its words and whether it was acknowledged."""
        return [{"words": words, "acknowledged": seen} for words, seen in self._on.items()]

    def look(self, now: float, view: BoatView) -> None:
        """Fetch the list where the boat tells of other alarms than we know."""
        count = view.value("alarm_count")
        if count is None:
            return
        if count == 0.0:
            self._on.clear()
        elif count != self._count or now >= self._next:
            self._next = now + LOOK_S
            self._files.fetch(ALARMS, self._take)
        self._count = count

    def acknowledge(self) -> None:
        """Note that somebody has seen all that is on; each alarm that comes later is new."""
        self._on = dict.fromkeys(self._on, True)

    def forget(self) -> None:
        """The boat has started again."""
        self._on.clear()
        self._count = None

    def _take(self, content: bytes | None) -> None:
        try:
            words = [str(entry) for entry in json.loads(content or b"null")]
        except (ValueError, TypeError):
            return
        # one that nobody has acknowledged for long is said again under another heading: it is the same alarm
        alarms = {each.removeprefix(AGAIN): each.startswith(AGAIN) for each in words}
        self._on = {each: self._on.get(each, False) and not again for each, again in alarms.items()}
