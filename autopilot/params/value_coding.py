"""How a parameter's value travels in MAVLink's 32-bit float field, and what a firmware makes of it.

ArduPilot casts: the float holds the number itself, so integers beyond 2^24 lose their last bits. PX4 copies
bytes: the four bytes of the float are the integer. Source: MAVLink parameter protocol, "Parameter encoding".
"""

from __future__ import annotations

import math
import struct

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


TYPE_NAMES = tuple(_TYPE_NAMES.values())


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
        return struct.pack("<f", value)
    low, high = integer_range(kind)
    if value != int(value):
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
