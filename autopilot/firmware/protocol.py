"""The MAVLink parameter protocol, client side: what to ask a vehicle, and what its answers mean.

No clock and no I/O: messages come in with the time, messages to send go out. Source: MAVLink parameter
protocol (mavlink.io/en/services/parameter.html) and ArduPilot's GCS_Param.cpp.

How a parameter's value travels in MAVLink's 32-bit float field, and what a firmware makes of it.

ArduPilot casts: the float holds the number itself, so integers beyond 2^24 lose their last bits. PX4 copies
bytes: the four bytes of the float are the integer. Source: MAVLink parameter protocol, "Parameter encoding".

Requests that may be lost: a window of them under way, each repeated until it is answered or given up.

No clock and no I/O: time is an argument, what is to be sent is a return value.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Iterable
from typing import Any, Generic, NamedTuple, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

Number = int | float

BYTEWISE_AUTOPILOTS = frozenset({dialect.MAV_AUTOPILOT_PX4})

_FORMATS = {
    dialect.MAV_PARAM_TYPE_UINT8: "<B",
    dialect.MAV_PARAM_TYPE_INT8: "<b",
    dialect.MAV_PARAM_TYPE_UINT16: "<H",
    dialect.MAV_PARAM_TYPE_INT16: "<h",
    dialect.MAV_PARAM_TYPE_UINT32: "<I",
    dialect.MAV_PARAM_TYPE_INT32: "<i",
}
_TYPE_NAMES = {
    dialect.MAV_PARAM_TYPE_UINT8: "UINT8",
    dialect.MAV_PARAM_TYPE_INT8: "INT8",
    dialect.MAV_PARAM_TYPE_UINT16: "UINT16",
    dialect.MAV_PARAM_TYPE_INT16: "INT16",
    dialect.MAV_PARAM_TYPE_UINT32: "UINT32",
    dialect.MAV_PARAM_TYPE_INT32: "INT32",
    dialect.MAV_PARAM_TYPE_REAL32: "REAL32",
}


def kind_named(name: str) -> int:
    """Return the MAV_PARAM_TYPE of that name, as INT16; KeyError where there is none."""
    return next(int(kind) for kind, known in _TYPE_NAMES.items() if known == name)


def is_integer_type(kind: int) -> bool:
    """Return whether MAV_PARAM_TYPE `kind` is one of the integers of at most 32 bits."""
    return kind in _FORMATS


def type_name(kind: int) -> str:
    """Return the name of MAV_PARAM_TYPE `kind`, as INT16."""
    return _TYPE_NAMES.get(kind, f"type {kind}")


def as_float32(value: float) -> float:
    """Return `value` as a 32-bit float holds it; infinite where it is too large."""
    try:
        return float(struct.unpack("<f", struct.pack("<f", value))[0])
    except OverflowError:
        return math.copysign(math.inf, value)


def decode(field: float, raw: bytes, kind: int, bytewise: bool) -> Number:
    """Return the value of a PARAM_VALUE from its float `field` and the 4 bytes `raw` that it was read from.

    The bytes are needed where integers travel bytewise: reading a signalling nan as a float changes it.
    """
    if kind not in _FORMATS:
        return field
    if bytewise:
        size = struct.calcsize(_FORMATS[kind])
        return int(struct.unpack(_FORMATS[kind], raw[:size])[0])
    return int(field) if math.isfinite(field) else field


def encode(value: Number, kind: int, bytewise: bool) -> bytes:
    """Return the 4 bytes that carry `value` as MAV_PARAM_TYPE `kind`; ValueError with the reason where none do."""
    if kind not in _FORMATS:
        if math.isinf(as_float32(value)) and not math.isinf(value):
            raise ValueError(f"the vehicle holds it as {type_name(kind)}, which goes to 3.4e+38")
        return struct.pack("<f", value)
    low, high = integer_range(kind)
    if not math.isfinite(value) or value != int(value):
        raise ValueError(f"the vehicle holds it as {type_name(kind)}, a whole number is needed")
    if not low <= value <= high:
        raise ValueError(f"the vehicle holds it as {type_name(kind)}, allowed are {low} to {high}")
    if bytewise:
        return struct.pack(_FORMATS[kind], int(value)).ljust(4, b"\0")
    if as_float32(value) != value:
        raise ValueError(f"integers travel to it as 32-bit floats, which hold {as_float32(value):.0f} but not {value}")
    return struct.pack("<f", value)


def integer_range(kind: int) -> tuple[int, int]:
    """Return the least and the largest value of the integer MAV_PARAM_TYPE `kind`."""
    bits = 8 * struct.calcsize(_FORMATS[kind])
    signed = _FORMATS[kind][1].islower()
    return (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)


def same_value(held: Number, wanted: Number, kind: int) -> bool:
    """Return whether the vehicle holds what was wanted: integers exactly, floats as 32 bits hold them."""
    if kind in _FORMATS:
        return held == wanted
    return as_float32(held) == as_float32(wanted) or (math.isnan(held) and math.isnan(wanted))


Key = TypeVar("Key", int, str)

RESIDUAL = 1.0e-6
"""A key counts as unknown to the vehicle when so small a probability is left that its answers all got lost."""
TRIES_MIN = 3
CONTROLS = 3
"""So many questions that surely have an answer go with those that are repeated, to tell a bad link from a name
that the vehicle does not have."""
HURRY_S = 0.1
"""The least wait before a question is repeated, on a link that has shown that it answers faster."""
TIMED_MIN = 4
"""So many round trips must be timed before a link is taken for a fast one."""


class Patience(NamedTuple):
    """How long to wait for an answer, how often to ask at most, and how many questions at once.

    20 tries lose one of a million answers where 30 % of the packets get lost each way (0.51^20). ArduPilot
    queues 20 parameter requests and drops the rest, so the window stays well below.
    """

    interval_s: float = 0.4
    tries: int = 20
    window: int = 8


PATIENCE = Patience()


class LinkQuality:
    """How often a question stays unanswered on this link, as learnt from those that were answered.

    A name that the vehicle does not have stays unanswered as a lost one does: on a link that answers all the
    others at once it is given up after a few tries, on a bad one after many. Only tries count during which the
    vehicle was heard at all, so that a link that is down for a while tells nothing about names.
    """

    def __init__(self) -> None:
        self._asked = 0
        self._answered = 0
        self.round_trip_s = 0.0
        self._timed = 0
        self.last_packet = -math.inf

    def on_packet(self, now: float) -> None:
        """Note that the vehicle has just sent something, whatever it was."""
        self.last_packet = now

    def controls(self) -> int:
        """Return how many questions with a sure answer to send along with repeated ones, and count them."""
        self._asked += CONTROLS
        return CONTROLS

    def control_answered(self) -> None:
        """Count the answer to one of them."""
        self._answered += self._answered < self._asked

    def answered(self, tries: int, delay_s: float) -> None:
        """Count a question that took `tries`; the delay of an answer to a first try times the round trip."""
        self._asked += tries
        self._answered += 1
        if tries == 1:
            self._timed += 1
            self.round_trip_s = delay_s if self.round_trip_s == 0.0 else 0.8 * self.round_trip_s + 0.2 * delay_s

    def wait_s(self, tries: int, patience_s: float) -> float:
        """Return how long to wait for an answer: on a fast link a few round trips, twice as long at each try."""
        longest = max(patience_s, 2.0 * self.round_trip_s)
        if self._timed < TIMED_MIN:
            return longest
        return float(min(longest, max(HURRY_S, 4.0 * self.round_trip_s) * 2 ** (tries - 1)))

    @property
    def tries_needed(self) -> int:
        """After how many tries silence means no: (share of tries unanswered)^tries < `RESIDUAL`."""
        unanswered = (self._asked - self._answered + 1) / (self._asked + 2)  # Laplace's rule of succession
        return max(TRIES_MIN, math.ceil(math.log(RESIDUAL) / math.log(unanswered)))


class _Question(NamedTuple):
    """How often a key was asked, how often of these in vain though the vehicle was heard, and when last."""

    tries: int
    in_vain: int
    last: float


class Requests(Generic[Key]):
    """Open questions, by key. `given_up` holds the keys that were asked in vain often enough."""

    def __init__(self, keys: Iterable[Key], patience: Patience, quality: LinkQuality | None = None) -> None:
        self._patience = patience
        self._quality = quality or LinkQuality()
        self._waiting: deque[Key] = deque(keys)
        self._asked: dict[Key, _Question] = {}
        self._doubted: set[Key] = set()
        self.given_up: list[Key] = []

    @property
    def done(self) -> bool:
        """Whether every key is answered or given up."""
        return not self._waiting and not self._asked

    def answered(self, key: Key, now: float) -> None:
        """Close the question; answers to others are ignored."""
        asked = self._asked.pop(key, None)
        self._doubted.discard(key)
        if asked is None:
            if key in self._waiting:
                self._waiting.remove(key)
            return
        self._quality.answered(asked.tries, now - asked.last)

    def doubt(self, key: Key) -> None:
        """Ask again soon, as an answer came that may not be the last word."""
        self._doubted.add(key)

    def repeats(self, keys: Iterable[Key]) -> bool:
        """Return whether any of the `keys` just asked got no answer before."""
        return any(self.tries(key) > 1 and key not in self._doubted for key in keys)

    def refused(self, key: Key) -> None:
        """Close the question as the vehicle says that it knows no such key; others are ignored."""
        if self._asked.pop(key, None) is not None:
            self.given_up.append(key)

    def tries(self, key: Key) -> int:
        """Return how often the key has been asked so far."""
        return self._asked[key].tries if key in self._asked else 0

    def due(self, now: float) -> list[Key]:
        """Return the keys to ask now: those whose answer is overdue, then new ones up to the window."""
        due: list[Key] = []
        for key, (tries, in_vain, last) in list(self._asked.items()):
            wait_s = self._quality.wait_s(1 if key in self._doubted else tries, self._patience.interval_s)
            if now - last < wait_s:
                continue
            in_vain += self._quality.last_packet > last
            if tries >= self._patience.tries or in_vain >= self._quality.tries_needed:
                del self._asked[key]
                self.given_up.append(key)
            else:
                self._asked[key] = _Question(tries + 1, in_vain, now)
                due.append(key)
        while self._waiting and len(self._asked) < self._patience.window:
            key = self._waiting.popleft()
            self._asked[key] = _Question(1, 0, now)
            due.append(key)
        return due


Message = Any

NO_INDEX = 65535
"""param_index of an answer that was not asked by index."""


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


ERROR_WORDS = {
    dialect.MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE: "value out of range",
    dialect.MAV_PARAM_ERROR_PERMISSION_DENIED: "permission denied",
    dialect.MAV_PARAM_ERROR_READ_ONLY: "read only",
}


def refused_value(message: Message, target: Target) -> tuple[str, str] | None:
    """Return name and reason where a PARAM_ERROR of the target refuses to set a value; None for other messages."""
    if message.get_type() != "PARAM_ERROR" or not is_from(message, target) or message.error not in ERROR_WORDS:
        return None
    return str(message.param_id), ERROR_WORDS[message.error]


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


def request_list(target: Target) -> Message:
    """Return the PARAM_REQUEST_LIST."""
    return dialect.MAVLink_param_request_list_message(target.system, target.component)


class _ParamSet(dialect.MAVLink_param_set_message):
    """PARAM_SET whose param_value is given as its four bytes: as a float, a signalling nan would change on the way."""

    unpacker = struct.Struct("<4sBB16sB")


def set_value(target: Target, name: str, value: Number, kind: int) -> Message:
    """Return the PARAM_SET; ValueError with the reason where the vehicle's type cannot hold the value."""
    raw = encode(value, kind, target.bytewise)
    return _ParamSet(target.system, target.component, name.encode("ascii"), raw, kind)


def controls(target: Target, quality: LinkQuality, is_due: bool) -> list[Message]:
    """Return questions for the first parameter of the table, which every vehicle has, where they are due."""
    return [read_by_index(target, 0) for _ in range(quality.controls())] if is_due else []
