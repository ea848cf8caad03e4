"""The MAVLink parameter protocol, client side: what to ask a vehicle, and what its answers mean.

No clock and no I/O: messages come in with the time, messages to send go out. Source: MAVLink parameter
protocol (mavlink.io/en/services/parameter.html) and ArduPilot's GCS_Param.cpp.
"""

from __future__ import annotations

import struct
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.params.requests import LinkQuality
from autopilot.params.value_coding import Number, decode, encode

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
