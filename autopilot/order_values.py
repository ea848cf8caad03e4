"""What an order from outside may hold, read strictly: one object of JSON, numbers in their range, the right token.

For the helm page, the terminal's helm and skipper, and Signal K. Nothing here raises anything but InputError. Pure.
"""

from __future__ import annotations

import hmac
import json
import math
import re
from typing import Any

from autopilot.errors import InputError
from autopilot.printable import printable

SHOWN = 40
"""Characters of a wrong value that a refusal quotes."""
DIGITS_MOST = 18
"""A whole number of more digits is read as a float, which may be infinite."""
TYPED = re.compile(r"[+-]?([0-9]{1,20}\.?[0-9]{0,20}|\.[0-9]{1,20})([eE][+-]?[0-9]{1,3})?")


def order_object(data: bytes) -> dict[str, Any]:
    """Return the JSON object that `data` is. Raises InputError; NaN and Infinity are no JSON."""
    try:
        found = json.loads(data.decode(), parse_int=_whole, parse_constant=_no_json)
    except (ValueError, RecursionError):
        raise InputError("an order is one object of JSON") from None
    if not isinstance(found, dict):
        raise InputError("an order is one object of JSON: {...}")
    return found


def number_from(value: object, what: str, low: float, high: float) -> float:
    """Return a value as a number from `low` to `high`. Raises InputError, which names `what` it is."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if low <= number <= high and math.isfinite(number):
            return number
    raise InputError(f"{what} {printable(repr(value), SHOWN)}: a number from {low:g} to {high:g} is allowed")


def typed_number(text: str) -> float:
    """Return the finite number that a person has typed, such as 90, -1.5, 1e-3. Raises InputError."""
    number = float(text) if TYPED.fullmatch(text) else math.nan
    if not math.isfinite(number):
        raise InputError(f"{printable(repr(text), SHOWN)} is not a number")
    return number


def is_same_token(given: object, token: str) -> bool:
    """Return whether `given` is the token, which is not empty, in a time that says nothing of how far it is right."""
    if not isinstance(given, str) or not token:
        return False
    return hmac.compare_digest(given.encode("utf-8", "surrogatepass"), token.encode())


def _whole(digits: str) -> float:
    return int(digits) if len(digits) <= DIGITS_MOST else float(digits)


def _no_json(name: str) -> float:
    raise ValueError(f"{name} is no JSON")
