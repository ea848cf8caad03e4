"""What an order from outside may hold, read strictly: one object of JSON, numbers in their range, the right token.

For the helm page, the terminal's helm and skipper, and Signal K. Nothing here raises anything but InputError. Pure.
"""

from __future__ import annotations

import hmac
import math
import re
from typing import Any

from autopilot.errors import InputError
from autopilot.printable import printable
from autopilot.strict_json import parse_json

SHOWN = 40
"""Characters of a wrong value that a refusal quotes."""
ORDER_MOST = 4096
"""Bytes of an order."""
TYPED = re.compile(r"[+-]?([0-9]{1,20}\.?[0-9]{0,20}|\.[0-9]{1,20})([eE][+-]?[0-9]{1,3})?")


def order_object(data: bytes) -> dict[str, Any]:
    """Return the JSON object that `data` is. Raises InputError."""
    found = parse_json(data, "an order is one object of JSON", ORDER_MOST)
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
