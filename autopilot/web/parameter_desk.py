"""The boat's parameters on a helm display: the table with ranges and meaning, read when asked for, and set. Pure."""

from __future__ import annotations

import json
import lzma
import math
from collections import deque
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink_codec import Message
from autopilot.params.component_metadata import PARAMETERS
from autopilot.params.download import Download
from autopilot.params.protocol import Target, parameter_value, set_value
from autopilot.web.ftp_client import FtpClient
from autopilot.web.orders import NO_ANSWER, Answer, Told

AGAIN_S, TRIES = 0.5, 4
DESCRIBED = ("shortDesc", "group", "units", "min", "max", "values", "rebootRequired")
EXPANDED_MOST = 4_000_000


class _Setting(NamedTuple):
    name: str
    value: float
    told: Told


class ParameterDesk:
    """`read` begins to fetch; `table` is what is there so far."""

    def __init__(self, files: FtpClient) -> None:
        self._files = files
        self._download: Download | None = None
        self._wanted = False
        self._described: dict[str, dict[str, Any]] = {}
        self._settings: deque[_Setting] = deque()
        self._tries = 0
        self._next = -math.inf

    def read(self) -> None:
        """Fetch table and description, unless they are here or on their way."""
        if self._download is not None and self._download.finished and not self._download.values:
            self._download = None
        if self._download is None and not self._wanted:
            self._wanted = True
        if not self._described:
            self._files.fetch(PARAMETERS, self._describe)

    def forget(self) -> None:
        """Forget the table: the boat may have started again with another file."""
        self._download, self._described, self._wanted = None, {}, False

    def table(self) -> dict[str, Any]:
        """Return the rows that have come, whether that is all, and how far it is."""
        download = self._download
        if download is None:
            return {"complete": False, "done": 0, "total": 0, "rows": []}
        done, total = download.progress
        rows = [
            {"name": name, "value": _plain(float(each.value)), **self._described.get(name, {})}
            for name, each in download.values.items()
        ]
        return {"complete": download.finished and done == total > 0, "done": done, "total": total, "rows": rows}

    def set(self, name: str, value: float, told: Told) -> None:
        """Set a parameter; `told` hears whether the boat took it."""
        self._settings.append(_Setting(name, value, told))

    def receive(self, now: float, message: Message, target: Target) -> None:
        """Take a message of the boat."""
        if self._download is not None:
            if self._download.finished:
                self._refresh(message, target)
            else:
                self._download.receive(now, message)
        answer = parameter_value(message, target)
        if answer is None or not self._settings or self._tries == 0 or answer.name != self._settings[0].name:
            return
        setting = self._settings.popleft()
        self._tries, self._next = 0, -math.inf
        taken = math.isclose(float(answer.value), setting.value, rel_tol=1.0e-6, abs_tol=1.0e-9)
        setting.told(Answer.TAKEN if taken else Answer.REFUSED, "" if taken else "refused; the old value stays")

    def due(self, now: float, target: Target) -> list[Message]:
        """Return what to send at `now` [s]."""
        if self._wanted:
            self._download, self._wanted = Download(target), False
        messages = list(self._download.due(now)) if self._download is not None else []
        if not self._settings or now < self._next:
            return messages
        setting = self._settings[0]
        if self._tries >= TRIES:
            self._settings.popleft()
            self._tries, self._next = 0, -math.inf
            setting.told(Answer.SILENT, NO_ANSWER)
            return messages
        self._tries += 1
        self._next = now + AGAIN_S
        messages.append(set_value(target, setting.name, setting.value, dialect.MAV_PARAM_TYPE_REAL32))
        return messages

    def _refresh(self, message: Message, target: Target) -> None:
        value = parameter_value(message, target)
        if value is not None and self._download is not None:
            # Download takes nothing more once it is finished; a value by name is kept all the same
            self._download.update(value)

    def _describe(self, content: bytes | None) -> None:
        try:
            text = lzma.LZMADecompressor().decompress(content or b"", EXPANDED_MOST)
            entries = json.loads(text)["parameters"]
            self._described = {
                str(entry["name"]): {key: entry[key] for key in DESCRIBED if key in entry} for entry in entries
            }
        except (lzma.LZMAError, ValueError, KeyError, TypeError, EOFError):
            # a boat without descriptions: the table shows names and values alone
            self._described = {}


def _plain(value: float) -> float | None:
    """The fewest digits that give the 32-bit float that travelled."""
    return float(f"{value:.7g}") if math.isfinite(value) else None
