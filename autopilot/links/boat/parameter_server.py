"""The parameter protocol's server side: a fixed table, every request answered, lists at a pace a radio can bear. Pure.

Source: https://mavlink.io/en/services/parameter.html, as QGroundControl, MAVProxy and MAVSDK use it: real values,
old value on refusal, requests by name (index -1) or by index. What does not exist is answered by PARAM_ERROR, as
ArduPilot's GCS_Param.cpp does from 4.7 on; stations that do not know it see the silence that they expect.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink_codec import Message

PER_TURN = 4
"""Parameters of a list that leave in one turn of the loop."""
NAME_LENGTH_MAX = 16


class ParameterStore(Protocol):
    """What the server serves. The names, their order and their count do not change while it runs."""

    @property
    def names(self) -> tuple[str, ...]:
        """All names, each of at most 16 characters."""

    def get(self, name: str) -> float:
        """Return the value in force."""

    def set(self, name: str, value: float) -> str:
        """Put a value in force; return '' or, where it is refused, the sentence why."""


class ParameterServer:
    """Answers for one identity; `say` takes the reason of a refusal to people's eyes."""

    def __init__(self, store: ParameterStore) -> None:
        self._store = store
        self._names = store.names
        self._index = {name: index for index, name in enumerate(self._names)}
        self._listing: deque[int] = deque()

    def take(self, message: Message) -> tuple[list[Message], str]:
        """Return the answers to a PARAM_ message, and what people should read."""
        kind = message.get_type()
        if kind == "PARAM_REQUEST_LIST":
            self._listing = deque(range(len(self._names)))
            return [], ""
        name = message.param_id.rstrip("\0")
        by_index = kind == "PARAM_REQUEST_READ" and message.param_index >= 0
        if by_index:
            name = self._names[message.param_index] if message.param_index < len(self._names) else ""
        if name not in self._index:
            return _unknown(message, message.param_index if by_index else -1), ""
        if kind == "PARAM_REQUEST_READ":
            return [self._value(name)], ""
        if message.param_type != dialect.MAV_PARAM_TYPE_REAL32:
            return [self._value(name)], f"{name} not changed: it is REAL32 and was set as type {message.param_type}"
        if not math.isfinite(message.param_value):
            return [self._value(name)], f"{name} not changed: {message.param_value} is not a number"
        refusal = self._store.set(name, message.param_value)
        return [self._value(name)], refusal

    def unchanged(self, message: Message) -> list[Message]:
        """Return the answer to a PARAM_SET that is not carried out: the value in force."""
        name = message.param_id.rstrip("\0")
        return [self._value(name)] if name in self._index else _unknown(message, -1)

    def due(self) -> list[Message]:
        """Return the next few of a list that was asked for."""
        count = min(PER_TURN, len(self._listing))
        return [self._value(self._names[self._listing.popleft()]) for _ in range(count)]

    def _value(self, name: str) -> Message:
        return dialect.MAVLink_param_value_message(
            name.encode(),
            self._store.get(name),
            dialect.MAV_PARAM_TYPE_REAL32,
            len(self._names),
            self._index[name],
        )


def _unknown(message: Message, index: int) -> list[Message]:
    """Return the answer to whoever asked us for what does not exist; by name where `index` is -1.

    Who asked everybody at once may mean another component's parameter, and gets none.
    """
    if not message.target_system or not message.target_component:
        return []
    asker = message.get_srcSystem(), message.get_srcComponent()
    name = message.param_id.encode("ascii", "replace")[:NAME_LENGTH_MAX]
    return [dialect.MAVLink_param_error_message(*asker, name, index, dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST)]
