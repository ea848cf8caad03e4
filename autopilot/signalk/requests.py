"""Signal K's PUT requests as orders for the boat, and the answers to them. Pure.

A request is one line of JSON, as https://signalk.org/specification/1.7.0/doc/put.html has it, with the token:
{"requestId": "1", "token": "...", "put": {"path": "steering.autopilot.state", "value": "auto"}}
Without `put` it is a greeting, which orders nothing. The token is looked at before what is wanted.
"""

from __future__ import annotations

import json
import math
from typing import Any, NamedTuple

from autopilot.errors import InputError
from autopilot.order_values import ORDER_MOST, SHOWN, is_same_token, number_from, order_object
from autopilot.printable import printable

LINE_MOST = ORDER_MOST
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
NOT_ALLOWED = "the request carries no valid token; give the plugin the token that `autopilot signalk` keeps in its file"


class Request(NamedTuple):
    """A request: its id, and what is wanted as a helm display would say it; None: nothing, it is a greeting."""

    id: str
    wish: dict[str, Any] | None


class BadRequestError(InputError):
    """A request that is none: status code and sentence, and the id where it had one."""

    def __init__(self, id: str, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.id, self.status = id, status


def parse(line: bytes, token: str) -> Request:
    """Return the request on a line that carries the token. Raises BadRequestError: 401 without it, 400, 405."""
    try:
        found = order_object(line)
    except InputError as error:
        raise BadRequestError("", 400, str(error)) from None
    id = found.get("requestId")
    if not isinstance(id, str) or not 0 < len(id) <= ID_MOST:
        raise BadRequestError("", 400, f"requestId: a text of 1 to {ID_MOST} characters is needed")
    if not is_same_token(found.get("token"), token):
        raise BadRequestError(id, 401, NOT_ALLOWED)
    if "put" not in found:
        return Request(id, None)
    put = found["put"]
    if not isinstance(put, dict):
        raise BadRequestError(id, 400, "put: an object with path and value is needed")
    return Request(id, wish_of(id, put.get("path"), put.get("value")))


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
    raise BadRequestError(id, 405, f"{printable(repr(path), SHOWN)}: allowed are {', '.join(PATHS)}")


def answer(id: str, status: int, message: str = "") -> bytes:
    """Return the line that answers a request: Signal K's states, and a sentence where it was refused."""
    state = "COMPLETED" if status == 200 else "FAILED"
    return line_of({"requestId": id, "state": state, "statusCode": status, **({"message": message} if message else {})})


def line_of(content: dict[str, Any]) -> bytes:
    """Return an object as a line."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False).encode() + b"\n"


def _number(id: str, path: str, value: Any, low: float, high: float) -> float:
    try:
        return number_from(value, path, low, high)
    except InputError as error:
        raise BadRequestError(id, 400, str(error)) from None
