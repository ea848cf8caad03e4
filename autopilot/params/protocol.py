"""The MAVLink parameter protocol, client side: what to ask a vehicle, and what its answers mean.

No clock and no I/O: messages come in with the time, messages to send go out. Source: MAVLink parameter
protocol (mavlink.io/en/services/parameter.html) and ArduPilot's GCS_Param.cpp.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.params.requests import PATIENCE, LinkQuality, Patience, Requests
from autopilot.params.value_coding import Number, decode, encode

Message = Any

NO_INDEX = 65535
"""param_index of an answer that was not asked by index."""
HASH_NAME = "_HASH_CHECK"
"""PX4 adds it to every list; it is a checksum, not a parameter."""


class Target(NamedTuple):
    """The vehicle asked. `bytewise`: integers travel as bytes (PX4), else cast (ArduPilot)."""

    system: int
    component: int
    bytewise: bool = False


class ParameterValue(NamedTuple):
    """One PARAM_VALUE: `kind` is its MAV_PARAM_TYPE, `position` its place among `table_size`, or `NO_INDEX`."""

    name: str
    value: Number
    kind: int
    position: int = NO_INDEX
    table_size: int = 0


def parameter_value(message: Message, target: Target) -> ParameterValue | None:
    """Return what a PARAM_VALUE of the target says; None for every other message."""
    if message.get_type() != "PARAM_VALUE" or not is_from(message, target):
        return None
    value = decode(message.param_value, _value_bytes(message), message.param_type, target.bytewise)
    return ParameterValue(message.param_id, value, message.param_type, message.param_index, message.param_count)


def refused_name(message: Message, target: Target) -> str | None:
    """Return the name that a PARAM_ERROR of the target says does not exist; None for every other message."""
    if message.get_type() != "PARAM_ERROR" or not is_from(message, target):
        return None
    return str(message.param_id) if message.error == dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST else None


def is_from(message: Message, target: Target) -> bool:
    """Return whether the target itself sent the message."""
    return bool(message.get_srcSystem() == target.system and message.get_srcComponent() == target.component)


def _value_bytes(message: Message) -> bytes:
    """Return the four bytes of param_value as they came: the first of the payload in MAVLink's wire order."""
    packet = message.get_msgbuf()
    if not packet:
        return struct.pack("<f", message.param_value)
    start = 10 if packet[0] == 0xFD else 6
    return bytes(packet[start : start + 4]).ljust(4, b"\0")


def read_by_name(target: Target, name: str) -> Message:
    """Return the PARAM_REQUEST_READ for a name."""
    return dialect.MAVLink_param_request_read_message(target.system, target.component, name.encode("ascii"), -1)


def read_by_index(target: Target, index: int) -> Message:
    """Return the PARAM_REQUEST_READ for an index."""
    return dialect.MAVLink_param_request_read_message(target.system, target.component, b"", index)


class _ParamSet(dialect.MAVLink_param_set_message):
    """PARAM_SET whose param_value is given as its four bytes: as a float, a signalling nan would change on the way."""

    unpacker = struct.Struct("<4sBB16sB")


def set_value(target: Target, name: str, value: Number, kind: int) -> Message:
    """Return the PARAM_SET; ValueError with the reason where the vehicle's type cannot hold the value."""
    raw = encode(value, kind, target.bytewise)
    return _ParamSet(target.system, target.component, name.encode("ascii"), raw, kind)


class Download:
    """Fetches the whole table: the list first, then what was lost, by index and a few at a time.

    Give `receive` every message and send what `due` returns, until `finished`. `values` holds what came, by
    name; `missing` the indices that never came (empty, or the download has failed).
    """

    QUIET_S = 0.8
    """A list that has paused this long has ended, and what is missing is asked for."""
    LIST_TRIES = 8
    SMALLER_TO_BELIEVE = 20
    """So many packets in a row must tell of a smaller table before it counts."""
    RESTARTS_MAX = 3
    """A vehicle whose table changes under our hands is read again, this often."""

    def __init__(self, target: Target, patience: Patience = PATIENCE) -> None:
        self._target = target
        self._patience = patience
        self._by_index: dict[int, ParameterValue] = {}
        self._count = 0
        self._list_tries = 0
        self._last_news: float | None = None
        self._gaps: Requests[int] | None = None
        self._restarts = 0
        self._smaller_in_a_row = 0
        self.finished = False

    @property
    def values(self) -> dict[str, ParameterValue]:
        """What has come so far, by name, in the vehicle's order."""
        return {value.name: value for _, value in sorted(self._by_index.items())}

    @property
    def missing(self) -> list[int]:
        """Indices that have not come."""
        return [index for index in range(self._count) if index not in self._by_index]

    @property
    def progress(self) -> tuple[int, int]:
        """How many came, of how many (0 while not known)."""
        return len(self._by_index), self._count

    def receive(self, now: float, message: Message) -> None:
        """Take any message; those that are not the target's PARAM_VALUE are ignored."""
        value = parameter_value(message, self._target)
        if value is None or value.name == HASH_NAME or self.finished:
            return
        if value.position == NO_INDEX:
            self._update_by_name(value)
            return
        if not value.position < value.table_size:
            return
        if self._is_of_old_table(value):
            return
        if self._has_changed(value):
            self._restart()
        self._count = value.table_size
        if value.position not in self._by_index:
            self._last_news = now
        self._by_index[value.position] = value
        if self._gaps is not None:
            self._gaps.answered(value.position, now)
        self.finished = len(self._by_index) == self._count

    def _update_by_name(self, value: ParameterValue) -> None:
        """Somebody set a parameter meanwhile: the newer value counts."""
        for index, known in self._by_index.items():
            if known.name == value.name:
                self._by_index[index] = known._replace(value=value.value)
                return

    def _is_of_old_table(self, value: ParameterValue) -> bool:
        """Tables grow when a parameter enables others; packets of the smaller table may still be under way."""
        if value.table_size >= self._count:
            self._smaller_in_a_row = 0
            return False
        self._smaller_in_a_row += 1
        return self._smaller_in_a_row < self.SMALLER_TO_BELIEVE

    def _has_changed(self, value: ParameterValue) -> bool:
        known = self._by_index.get(value.position)
        changed = (self._count not in (0, value.table_size)) or (known is not None and known.name != value.name)
        return changed and self._restarts < self.RESTARTS_MAX

    def _restart(self) -> None:
        self._restarts += 1
        self._by_index.clear()
        self._gaps = None
        self._list_tries = 0
        self._last_news = None

    def due(self, now: float) -> list[Message]:
        """Return the messages to send now."""
        if self.finished:
            return []
        if self._gaps is None:
            return self._list_due(now)
        messages = [read_by_index(self._target, index) for index in self._gaps.due(now)]
        self.finished = self._gaps.done
        return messages

    def _list_due(self, now: float) -> list[Message]:
        if self._last_news is not None and now - self._last_news < self.QUIET_S:
            return []
        if self._count:
            self._gaps = Requests(self.missing, self._patience)
            return self.due(now)
        if self._list_tries >= self.LIST_TRIES:
            self.finished = True
            return []
        self._list_tries += 1
        self._last_news = now
        return [dialect.MAVLink_param_request_list_message(self._target.system, self._target.component)]


class NamedDownload:
    """Fetches the parameters named. `values` by name; `unknown` the names that stayed unanswered."""

    def __init__(self, target: Target, names: Sequence[str], patience: Patience = PATIENCE) -> None:
        self._target = target
        self._names = set(names)
        self._quality = LinkQuality()
        self._requests: Requests[str] = Requests(names, patience, self._quality)
        self.values: dict[str, ParameterValue] = {}

    @property
    def finished(self) -> bool:
        """Whether every name is answered or given up."""
        return self._requests.done

    @property
    def unknown(self) -> list[str]:
        """Names that the vehicle never answered, or said that it does not have."""
        return list(self._requests.given_up)

    @property
    def progress(self) -> tuple[int, int]:
        """How many names are settled, of how many."""
        return len(self.values) + len(self._requests.given_up), len(self._names)

    def receive(self, now: float, message: Message) -> None:
        """Take any message; those that are not the target's PARAM_VALUE of a name wanted are ignored."""
        if is_from(message, self._target):
            self._quality.heard(now)
        if (refused := refused_name(message, self._target)) is not None:
            self._requests.refused(refused)
        value = parameter_value(message, self._target)
        if value is not None and value.position == 0:
            self._quality.control_answered()
        if value is not None and value.name in self._names:
            self.values[value.name] = value
            self._requests.answered(value.name, now)

    def due(self, now: float) -> list[Message]:
        """Return the messages to send now."""
        names = self._requests.due(now)
        return [read_by_name(self._target, name) for name in names] + controls(
            self._target, self._quality, self._requests.repeats(names)
        )


def controls(target: Target, quality: LinkQuality, is_due: bool) -> list[Message]:
    """Return questions for the first parameter of the table, which every vehicle has, where they are due."""
    return [read_by_index(target, 0) for _ in range(quality.controls())] if is_due else []
