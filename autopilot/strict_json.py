"""JSON from outside, read strictly: of a limited size and depth, its numbers finite, its characters whole. Pure.

For orders, for the files that a boat sends, and for the headers of logs, which anybody may have written. Python's own
reader takes NaN and halves of characters, with which no answer can be written, and fails with a RecursionError.
"""

from __future__ import annotations

import json
import math
from typing import Any

from autopilot.errors import InputError

DEEPEST = 32
"""Lists and objects in one another; what we read and write has at most five."""
DIGITS_MOST = 18
"""A whole number of more digits is read as a float, which may be infinite."""


def parse_json(data: bytes, origin: str, most: int) -> Any:
    """Return what `data`, of at most `most` bytes, says; `origin` begins the sentence of refusal. Raises InputError."""
    if len(data) > most:
        raise InputError(f"{origin}: {len(data)} bytes, at most {most} are allowed")
    try:
        found = json.loads(data.decode(), parse_int=_whole, parse_constant=_no_json)
    except ValueError as error:
        raise InputError(f"{origin}: no JSON in UTF-8 ({error})") from None
    except RecursionError:
        raise _too_deep(origin) from None
    _check(found, origin)
    return found


def _check(found: Any, origin: str) -> None:
    """Raise InputError where `found` holds what cannot be written again, or is too deep; level by level."""
    level = [found]
    for _ in range(DEEPEST + 1):
        for each in level:
            if isinstance(each, str) and not _is_whole(each):
                raise InputError(f"{origin}: half of a character in it, which no text may have")
            if isinstance(each, float) and not math.isfinite(each):
                raise InputError(f"{origin}: a number in it is too large; write finite numbers")
        inside = [each for each in level if isinstance(each, dict | list)]
        if not inside:
            return
        level = [each for holder in inside for each in holder]
        level += [each for holder in inside if isinstance(holder, dict) for each in holder.values()]
    raise _too_deep(origin)


def _is_whole(text: str) -> bool:
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def _too_deep(origin: str) -> InputError:
    return InputError(f"{origin}: nested deeper than {DEEPEST}")


def _whole(digits: str) -> float:
    return int(digits) if len(digits) <= DIGITS_MOST else float(digits)


def _no_json(name: str) -> float:
    raise ValueError(f"{name} is no number")
