"""The parameter protocol's server side: a fixed table, every request answered, lists at a pace a radio can bear. Pure.

Source: https://mavlink.io/en/services/parameter.html, as QGroundControl, MAVProxy and MAVSDK use it: real values,
old value on refusal, requests by name (index -1) or by index.
"""

from __future__ import annotations

from collections import deque
from typing import Protocol

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink_codec import Message

PER_TURN = 4
"""Parameters of a list that leave in one turn of the loop."""
NO_INDEX = 65535


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
        if kind == "PARAM_REQUEST_READ":
            if message.param_index >= 0:
                name = self._names[message.param_index] if message.param_index < len(self._names) else ""
            return ([self._value(name)], "") if name in self._index else ([], "")
        if name not in self._index:
            return [], ""
        refusal = self._store.set(name, message.param_value)
        return [self._value(name)], refusal

    def unchanged(self, message: Message) -> list[Message]:
        """Return the answer to a PARAM_SET that is not carried out: the value in force."""
        name = message.param_id.rstrip("\0")
        return [self._value(name)] if name in self._index else []

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
