"""The boat's parameters on a helm display: the table with ranges and meaning, read when asked for, and set. Pure."""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.files.outside import SHOWN, parse_json
from autopilot.files.printable import printable
from autopilot.firmware.download import Download
from autopilot.firmware.metadata import FtpClient, expanded
from autopilot.firmware.protocol import Target, parameter_value, set_value
from autopilot.links.ground_station.file_server import PARAMETERS
from autopilot.links.mavlink.codec import Message
from autopilot.web.orders import NO_ANSWER, Answer, OnDone

AGAIN_S, TRIES = 0.5, 4
EXPANDED_MOST = 1_000_000
"""Bytes of the descriptions; ours have 16 kB."""
UNPACKING_MOST = 64 << 20
"""Bytes of memory that unpacking may take; ours takes 9 MB. What is packed may ask for gigabytes."""


class _Setting(NamedTuple):
    name: str
    value: float
    on_done: OnDone


class ParameterService:
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

    def set(self, name: str, value: float, on_done: OnDone) -> None:
        """Set a parameter; `on_done` hears whether the boat took it."""
        self._settings.append(_Setting(name, value, on_done))

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
        setting.on_done(Answer.TAKEN if taken else Answer.REFUSED, "" if taken else "refused; the old value stays")

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
            setting.on_done(Answer.SILENT, NO_ANSWER)
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
        self._described = {}
        with contextlib.suppress(InputError):  # a boat without descriptions: the table shows names and values alone
            self._described = descriptions_from(content or b"")


def descriptions_from(content: bytes) -> dict[str, dict[str, Any]]:
    """Return what a boat's packed component metadata says of each parameter, by name. Raises InputError."""
    origin = "the boat's description of parameters"
    text = expanded(content, origin, EXPANDED_MOST, UNPACKING_MOST)
    found = parse_json(text, origin, EXPANDED_MOST)
    entries = found.get("parameters") if isinstance(found, dict) else None
    if not isinstance(entries, list):
        raise InputError(f"{origin}: a list `parameters` is needed")
    return dict(_description_from(entry, f"{origin}: entry {number}") for number, entry in enumerate(entries, 1))


def _description_from(entry: Any, origin: str) -> tuple[str, dict[str, Any]]:
    if not (isinstance(entry, dict) and isinstance(entry.get("name"), str)):
        raise InputError(f"{origin}: an object with a name is needed")
    for key, is_fit in DESCRIBED.items():
        if key in entry and not is_fit(entry[key]):
            raise InputError(f"{origin}: {key} {printable(repr(entry[key]), SHOWN)} is not of its kind")
    return entry["name"], {key: entry[key] for key in DESCRIBED if key in entry}


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _are_choices(value: Any) -> bool:
    return isinstance(value, list) and all(
        isinstance(each, dict) and _is_number(each.get("value")) and _is_text(each.get("description")) for each in value
    )


DESCRIBED: dict[str, Callable[[Any], bool]] = {
    **dict.fromkeys(("shortDesc", "group", "units"), _is_text),
    **dict.fromkeys(("min", "max"), _is_number),
    "values": _are_choices,
    "rebootRequired": lambda value: isinstance(value, bool),
}
"""What is shown of a parameter, and whether a value of it is of the right kind."""


def _plain(value: float) -> float | None:
    """The fewest digits that give the 32-bit float that travelled."""
    return float(f"{value:.7g}") if math.isfinite(value) else None
