"""The fields of NMEA 0183 sentences, read strictly. Pure.

Source: IEC 61162-1 field layouts as tabulated in E. S. Raymond, "NMEA Revealed", https://gpsd.gitlab.io/gpsd/NMEA.html.
"""

from __future__ import annotations

import math

from autopilot.links.nmea_encoders import KMH_M_S, KNOT_M_S

SPEED_LIMIT = 200.0
NO_DATA_MODES = ("N", "V")
"""Mode indicators (NMEA 2.3 and later) that say: not valid. E, M and S, estimated or simulated, are accepted."""


class NoDataError(Exception):
    """The sentence says of itself that it holds no data."""


def field(fields: tuple[str, ...], index: int) -> str:
    """Return the field, empty where the sentence has none there."""
    return fields[index] if index < len(fields) else ""


def number(fields: tuple[str, ...], index: int, low: float, high: float) -> float:
    """Return the number in a field; NoDataError where it is empty, ValueError where it is none or out of range."""
    text = field(fields, index)
    if not text:
        raise NoDataError
    # float() would also take "nan", "1_0", " 1" and "1e3".
    if text.strip("0123456789.+-"):
        raise ValueError(text)
    value = float(text)
    if not low <= value <= high:
        raise ValueError(text)
    return value


def angle(fields: tuple[str, ...], index: int) -> float:
    """Return the angle [rad] in a field of 0 to 360 degrees."""
    return math.radians(number(fields, index, 0.0, 360.0))


def east_west(fields: tuple[str, ...], index: int, limit_deg: float) -> float | None:
    """Return the angle [rad] of a number and its E or W, east positive; None where the field is empty."""
    if not field(fields, index):
        return None
    side = field(fields, index + 1)
    if side not in ("E", "W"):
        raise ValueError(side)
    value = math.radians(number(fields, index, 0.0, limit_deg))
    return value if side == "E" else -value


def degrees_minutes(fields: tuple[str, ...], index: int, positive: str, negative: str, limit_deg: int) -> float:
    """Return the angle [rad] of a field of degrees and minutes (ddmm.mm or dddmm.mm) and its side in the next.

    ValueError where it is none, or beyond `limit_deg`.
    """
    text, side = field(fields, index), field(fields, index + 1)
    if side not in (positive, negative):
        raise ValueError(side)
    width = len(str(limit_deg))
    whole, minutes = text[:width], text[width:]
    if not whole.isdecimal() or len(whole) != width or not minutes[:2].isdecimal() or minutes.strip("0123456789."):
        raise ValueError(text)
    minute = float(minutes)
    degrees = int(whole) + minute / 60.0
    if not minute < 60.0 or degrees > limit_deg:
        raise ValueError(text)
    return math.radians(degrees if side == positive else -degrees)


def letter(fields: tuple[str, ...], index: int, expected: str) -> None:
    """Raise ValueError unless the field holds just that."""
    if field(fields, index) != expected:
        raise ValueError(field(fields, index))


def status(fields: tuple[str, ...], index: int) -> None:
    """Raise NoDataError at status V, ValueError unless it is A."""
    if field(fields, index) == "V":
        raise NoDataError
    letter(fields, index, "A")


def mode_indicator(fields: tuple[str, ...], index: int, required: bool = False) -> None:
    """Raise NoDataError at a mode that says not valid, ValueError at one that is unknown."""
    mode = field(fields, index)
    if mode in NO_DATA_MODES:
        raise NoDataError
    if (required or mode) and mode not in ("A", "D", "E", "F", "M", "P", "R", "S"):
        raise ValueError(mode)


def speed_of(fields: tuple[str, ...], index: int, low: float) -> float:
    """Speed [m/s] from a pair of fields: knots with N, or else km/h with K."""
    if field(fields, index):
        letter(fields, index + 1, "N")
        return number(fields, index, low, SPEED_LIMIT) * KNOT_M_S
    if field(fields, index + 2):
        letter(fields, index + 3, "K")
    return number(fields, index + 2, low, SPEED_LIMIT) * KMH_M_S
