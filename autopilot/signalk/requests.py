"""Signal K's PUT requests as orders for the boat, and the answers to them. Pure.

A request is one line of JSON, as https://signalk.org/specification/1.7.0/doc/put.html has it, with the token:
{"requestId": "1", "token": "...", "put": {"path": "steering.autopilot.state", "value": "auto"}}
"""

from __future__ import annotations

import hmac
import json
import math
from typing import Any, NamedTuple

from autopilot.errors import InputError

LINE_MOST = 4096
ID_MOST = 64
STATE = "steering.autopilot.state"
HEADING = "steering.autopilot.target.headingTrue"
ADJUST = "steering.autopilot.actions.adjustHeading"
DODGE = "steering.autopilot.actions.dodge"
ACKNOWLEDGE = "steering.autopilot.actions.acknowledge"
PATHS = (STATE, HEADING, ADJUST, DODGE, ACKNOWLEDGE)
STATES = {"auto": "engage", "standby": "standby", "route": "route"}
TURN_MOST_DEG = 180.0
DODGE_MOST_DEG = 90.0


class Request(NamedTuple):
    """A request: its id, whether it carried the right token, and what is wanted as a helm display would say it."""

    id: str
    is_allowed: bool
    wish: dict[str, Any]


class BadRequestError(InputError):
    """A request that is none: status code and sentence, and the id where it had one."""

    def __init__(self, id: str, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.id, self.status = id, status


def parse(line: bytes, token: str) -> Request:
    """Return the request on a line. Raises BadRequestError; never for a wrong token, which the caller must look at."""
    try:
        found = json.loads(line)
    except (ValueError, RecursionError):
        raise BadRequestError("", 400, "not a line of JSON") from None
    if not isinstance(found, dict):
        raise BadRequestError("", 400, "not a JSON object")
    id = found.get("requestId")
    if not isinstance(id, str) or not 0 < len(id) <= ID_MOST:
        raise BadRequestError("", 400, f"requestId: a text of 1 to {ID_MOST} characters is needed")
    put, given = found.get("put"), found.get("token")
    if not isinstance(put, dict):
        raise BadRequestError(id, 400, "put: an object with path and value is needed")
    is_allowed = isinstance(given, str) and bool(token) and hmac.compare_digest(given.encode(), token.encode())
    return Request(id, is_allowed, wish_of(id, put.get("path"), put.get("value")))


def wish_of(id: str, path: Any, value: Any) -> dict[str, Any]:
    """Return what a path and its value ask for. Raises BadRequestError."""
    if path == STATE:
        if not isinstance(value, str) or value not in STATES:
            raise BadRequestError(id, 400, f"{path}: {', '.join(STATES)} are allowed")
        return {"do": STATES[value]}
    if path == HEADING:
        return {"do": "heading", "degrees": math.degrees(_number(id, path, value, -2 * math.pi, 2 * math.pi)) % 360.0}
    if path == ADJUST:
        return {"do": "turn", "degrees": _number(id, path, value, -TURN_MOST_DEG, TURN_MOST_DEG)}
    if path == DODGE:
        if value is None:
            return {"do": "back"}
        return {"do": "dodge", "degrees": _number(id, path, value, -DODGE_MOST_DEG, DODGE_MOST_DEG)}
    if path == ACKNOWLEDGE:
        return {"do": "acknowledge"}
    raise BadRequestError(id, 405, f"{path!r}: allowed are {', '.join(PATHS)}")


def answer(id: str, status: int, message: str = "") -> bytes:
    """Return the line that answers a request: Signal K's states, and a sentence where it was refused."""
    state = "COMPLETED" if status == 200 else "FAILED"
    return line_of({"requestId": id, "state": state, "statusCode": status, **({"message": message} if message else {})})


def line_of(content: dict[str, Any]) -> bytes:
    """Return an object as a line."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def _number(id: str, path: str, value: Any, low: float, high: float) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not math.isfinite(value) or not low <= value <= high:
        raise BadRequestError(id, 400, f"{path}: a number from {low:g} to {high:g} is allowed")
    return float(value)
