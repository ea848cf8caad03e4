"""Signal K's messages: deltas made of what a helm display knows, PUT requests as orders for the boat. Pure.

Signal K's PUT requests as orders for the boat, and the answers to them. Pure.

A request is one line of JSON, as https://signalk.org/specification/1.7.0/doc/put.html has it, with the token:
{"requestId": "1", "token": "...", "put": {"path": "steering.autopilot.state", "value": "auto"}}
Without `put` it is a greeting, which orders nothing. The token is looked at before what is wanted. `beat` is the time
that the bridge has said last: an order that was held up on its way comes with an old one, and is not carried out, but
for standby and a man overboard.

What Signal K gets to know of the boat: deltas made of what a helm display knows. Pure.

Paths and units of the Signal K specification 1.7: radians, radians a second, metres, metres a second.
"""

from __future__ import annotations

import json
import math
import re
import zlib
from collections.abc import Mapping
from typing import Any, NamedTuple, TypeVar

from autopilot.errors import InputError
from autopilot.files.outside import ORDER_MOST, SHOWN, is_same_token, number_from, order_object
from autopilot.files.printable import printable
from autopilot.links.ground_station.orders import HEADING, TRACK, TRIAL, WIND
from autopilot.supervision.alarms import CATALOGUE
from autopilot.web.requests import came_late
from autopilot.web.station import Station

LABEL = "norrbin"
FRESH_S = 2.0
BEAT_FRESH_S = 3.0
KNOT_M_S = 1852.0 / 3600.0
RADIAN = math.pi / 180.0
STATES = {HEADING: "auto", TRACK: "route", TRIAL: "trial", WIND: "wind"}
"""Our modes by the names that Signal K programs know; each other one is standby."""
COMPASS, TRUE_WIND = "compass", "true wind"
MODES = {"auto": COMPASS, "route": "route", "trial": "trial", "wind": "wind"}
"""What is steered to, in the words of the autopilot API."""
OFF_LINE, STANDBY = "off-line", "standby"
MEASURED = (
    ("attitude", "heading", "navigation.headingTrue", RADIAN),
    ("attitude", "rate", "navigation.rateOfTurn", RADIAN),
    ("rudder", "rudder", "steering.rudderAngle", RADIAN),
    ("rudder", "order", "steering.autopilot.target.headingTrue", RADIAN),
    ("speed", "speed", "navigation.speedOverGround", KNOT_M_S),
    ("navigation", "xte", "navigation.courseRhumbline.crossTrackError", 1.0),
    ("wind", "awa", "environment.wind.angleApparent", RADIAN),
    ("wind", "aws", "environment.wind.speedApparent", KNOT_M_S),
    ("wind", "twa", "environment.wind.angleTrueWater", RADIAN),
    ("wind", "tws", "environment.wind.speedTrue", KNOT_M_S),
    ("wind", "wind_angle", "steering.autopilot.target.windAngleApparent", RADIAN),
    ("wind", "wind_angle", "steering.autopilot.target.windAngleTrueWater", RADIAN),
)
"""Group that ages together, our value, path, and factor to Signal K's unit."""
WEATHER = "environment."
"""What others have, too: where we have none we say nothing, or it would hide theirs."""
PRIORITIES = {"emergency": "emergency", "alarm": "alarm", "warning": "warn", "caution": "alert"}
"""Our alarms' priorities in the words of Signal K."""
NOTIFICATIONS = "notifications.steering.autopilot.norrbin."
"""Before the name of an alarm: each has a notification of its own."""
MOB, OVERBOARD = "notifications.mob", "man_overboard"
"""A man overboard stands where Signal K has it for every vessel, so that charts and relays know what it is."""
OURS_ALONE = {"acknowledgeSupport": "No", "temporarySilenceSupport": "No"}
"""signalk-server lets everybody who reaches it acknowledge by its notifications API, and would show an alarm that comes
again as acknowledged: with this it leaves both to the boat."""
OVER = {"state": "normal", "method": [], "message": "", **OURS_ALONE}


def state_of(station: Station, now: float) -> str:
    """Return what the pilot does, in Signal K's words."""
    age = station.view.age("beat", now)
    if station.target is None or age is None or age > BEAT_FRESH_S:
        return OFF_LINE
    return STATES.get(station.view.mode, STANDBY)


def values_of(station: Station, now: float) -> dict[str, Any]:
    """Return what is known at `now` [s], by path; what is stale is None, which Signal K takes for unknown."""
    view = station.view
    state = state_of(station, now)
    values: dict[str, Any] = {"steering.autopilot.state": state}
    values["steering.autopilot.engaged"] = state not in (OFF_LINE, STANDBY)
    is_true = bool(view.value("wind_true"))
    mode = TRUE_WIND if state == "wind" and is_true else MODES.get(state)
    values["steering.autopilot.mode"] = mode
    is_magnetic = bool(view.value("magnetic"))
    for group, name, true_path, factor in MEASURED:
        path = true_path.replace("headingTrue", "headingMagnetic") if is_magnetic else true_path
        age, value = view.age(group, now), view.value(name)
        is_known = state != OFF_LINE and age is not None and age < FRESH_S and value is not None
        if is_known or not path.startswith(WEATHER):
            values[path] = value * factor if is_known and value is not None else None
    targets = {COMPASS: HEADINGS[is_magnetic], "wind": TARGET_WIND, TRUE_WIND: TARGET_TRUE_WIND}
    for path in (HEADINGS[is_magnetic], TARGET_WIND, TARGET_TRUE_WIND):
        # the course to which wind and route lead is a heading that is ordered, too
        if mode is None or (path is not HEADINGS[is_magnetic] and path != targets.get(mode)):
            values[path] = None
    values["steering.autopilot.target"] = values.get(targets.get(mode or "", HEADINGS[is_magnetic]))
    if state != "route":
        values["navigation.courseRhumbline.crossTrackError"] = None
    return values


def notifications_of(station: Station) -> dict[str, Any]:
    """Return the notification of each alarm that is on, by path: it sounds until somebody has acknowledged it."""
    notifications: dict[str, Any] = {}
    for alarm in station.alarms.active:
        path = path_of(alarm)
        alike = sum(each.startswith(path) for each in notifications)
        # two lines may be lost at a time
        notifications[f"{path}{alike + 1}" if path in notifications else path] = {
            "state": PRIORITIES[alarm["priority"]],
            "method": ["visual", "sound"] if alarm["sounds"] else ["visual"],
            "message": alarm["words"],
            **OURS_ALONE,
        }
    return notifications


def path_of(alarm: dict[str, Any]) -> str:
    """Return the path of an alarm's notification; what is of no kind, as older boats say it, has none but its words."""
    if alarm["name"] == OVERBOARD:
        return MOB
    first, *rest = (alarm["name"] or f"other_{zlib.crc32(alarm['words'].encode()):08x}").split("_")
    return NOTIFICATIONS + first + "".join(word.capitalize() for word in rest)


def name_of(path: Any) -> str:
    """Return the name of the alarm that a notification is of, "" where there is none of it."""
    if path == MOB:
        return OVERBOARD
    if not isinstance(path, str) or not path.startswith(NOTIFICATIONS):
        return ""
    name = re.sub("[A-Z]", lambda capital: f"_{capital[0].lower()}", path.removeprefix(NOTIFICATIONS)).rstrip(
        "0123456789"
    )
    return name if name in CATALOGUE else ""


class Deltas:
    """Makes deltas: all values at first and every so often, in between what has changed."""

    ALL_S = 5.0
    OVER_S = 60.0
    """How long it is repeated that an alarm is over."""

    def __init__(self) -> None:
        self._sent: dict[str, Any] = {}
        self._over: dict[str, float] = {}
        self._next = -math.inf

    def due(self, station: Station, now: float) -> dict[str, Any] | None:
        """Return what to tell at `now` [s], None where nothing has changed."""
        values = values_of(station, now) | self._notifications(station, now)
        if now >= self._next:
            self._next, self._sent = now + self.ALL_S, {}
        changed = {path: value for path, value in values.items() if path not in self._sent or self._sent[path] != value}
        self._sent = values
        return delta_of(changed) if changed else None

    def _notifications(self, station: Station, now: float) -> dict[str, Any]:
        """Return the alarms that are on, and for a while those that were."""
        on = notifications_of(station)
        self._over = {path: until for path, until in self._over.items() if now < until}
        self._over.update(dict.fromkeys(on, now + self.OVER_S))
        return {path: on.get(path, OVER) for path in self._over}


def delta_of(values: dict[str, Any]) -> dict[str, Any]:
    """Return the delta of values by path, without a time: the server gives it its own, and so is not misled by ours.

    Notifications are an update of their own: signalk-server 2.23 gives all of an update that has one another source.
    """
    changes = [{"path": path, "value": value} for path, value in values.items()]
    groups = [
        [each for each in changes if not str(each["path"]).startswith("notifications.")],
        [each for each in changes if str(each["path"]).startswith("notifications.")],
    ]
    source = {"label": LABEL, "type": "MAVLink"}
    return {
        "context": "vessels.self",
        "updates": [{"source": source, "values": group} for group in groups if group],
    }


BEAT_S = 1.0
LINE_MOST = ORDER_MOST
ID_MOST = 64
STATE, MODE = "steering.autopilot.state", "steering.autopilot.mode"
HEADINGS = ("steering.autopilot.target.headingTrue", "steering.autopilot.target.headingMagnetic")
TARGET_WIND = "steering.autopilot.target.windAngleApparent"
TARGET_TRUE_WIND = "steering.autopilot.target.windAngleTrueWater"
ACTIONS = "steering.autopilot.actions."
ADJUST, DODGE, ACKNOWLEDGE = ACTIONS + "adjustHeading", ACTIONS + "dodge", ACTIONS + "acknowledge"
TACK, GYBE, ADVANCE = ACTIONS + "tack", ACTIONS + "gybe", ACTIONS + "advanceWaypoint"
PATHS = (STATE, MODE, *HEADINGS, TARGET_WIND, TARGET_TRUE_WIND, ADJUST, DODGE, ACKNOWLEDGE, TACK, GYBE, ADVANCE)
PATHS_SHOWN = (
    f"{MOB}, and steering.autopilot. and {', '.join(path.removeprefix('steering.autopilot.') for path in PATHS)}"
)
STATE_ORDERS: dict[str, dict[str, Any]] = {
    "auto": {"do": "engage"},
    "wind": {"do": "wind"},
    "route": {"do": "route"},
    "standby": {"do": "standby"},
}
MODE_ORDERS = {
    COMPASS: STATE_ORDERS["auto"],
    "wind": STATE_ORDERS["wind"],
    TRUE_WIND: {"do": "wind", "true": True},
    "route": STATE_ORDERS["route"],
}
SIDES = {"port": -1, "starboard": 1}
TURN_MOST_DEG = 180.0
DODGE_MOST_DEG = 90.0
NOT_ALLOWED = "the request carries no valid token; give the plugin the token that `autopilot signalk` keeps in its file"


class Request(NamedTuple):
    """A request: its id, what is wanted as a helm display would say it; None: nothing, it is a greeting; where; and the
    beat [s] that its sender has heard last, inf where it says none."""

    id: str
    order: dict[str, Any] | None
    path: str = ""
    beat: float = math.inf

    def why_late(self, now: float, stood_by: float) -> str:
        """Return why the order is too late at `now` [s], '' where it is not (`came_late`)."""
        seen = {} if math.isinf(self.beat) else {"seen": self.beat}
        return came_late({**(self.order or {}), **seen}, now, stood_by)


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
    beat = _number(id, "beat", found["beat"], 0.0, math.inf) if "beat" in found else math.inf
    return Request(id, order_of(id, put.get("path"), put.get("value")), put["path"], beat)


def order_of(id: str, path: Any, value: Any) -> dict[str, Any]:
    """Return what a path and its value ask for. Raises BadRequestError."""
    if path in (STATE, MODE):
        return dict(_one_of(id, path, value, STATE_ORDERS if path == STATE else MODE_ORDERS))
    if path in (TACK, GYBE):
        # who asks has asked the skipper: there is no way to ask back
        side = _one_of(id, path, value, SIDES)
        return {"do": "tack" if path == TACK else "gybe", "side": side, "confirmed": True}
    if path == ADVANCE:
        return {"do": "next"}
    if path in HEADINGS:
        return {"do": "heading", "degrees": math.degrees(_number(id, path, value, -2 * math.pi, 2 * math.pi)) % 360.0}
    if path in (TARGET_WIND, TARGET_TRUE_WIND):
        angle = math.remainder(math.degrees(_number(id, path, value, -2 * math.pi, 2 * math.pi)), 360.0)
        return {"do": "wind", "true": path == TARGET_TRUE_WIND, "degrees": angle}
    if path == ADJUST:
        return {"do": "turn", "degrees": _number(id, path, value, -TURN_MOST_DEG, TURN_MOST_DEG)}
    if path == DODGE:
        if value is None:
            return {"do": "back"}
        return {"do": "dodge", "degrees": _number(id, path, value, -DODGE_MOST_DEG, DODGE_MOST_DEG)}
    if path == ACKNOWLEDGE:
        return _acknowledged(id, value)
    if path == MOB:
        # somebody else's, said again and again while it lasts: over is it on board
        place = {"latitude": 0.0, "longitude": 0.0} if value is None else value
        if not isinstance(place, dict):
            raise BadRequestError(id, 400, f"{path}: a position, or null where none is known, is allowed")
        latitude = _number(id, f"{path}: latitude", place.get("latitude"), -90.0, 90.0)
        longitude = _number(id, f"{path}: longitude", place.get("longitude"), -180.0, 180.0)
        return {"do": "mob_at", "latitude": latitude, "longitude": longitude}
    raise BadRequestError(id, 405, f"{printable(repr(path), SHOWN)}: allowed are {PATHS_SHOWN}")


def _acknowledged(id: str, value: Any) -> dict[str, Any]:
    """Return the order to acknowledge the alarm of a notification, or all; another's notification is none."""
    name = name_of(value)
    if not name and isinstance(value, str) and value.startswith("notifications."):
        raise BadRequestError(id, 400, f"{ACKNOWLEDGE}: {printable(repr(value), SHOWN)} is no alarm of this pilot")
    return {"do": "acknowledge", **({"name": name} if name else {})}


def answer(id: str, status: int, message: str = "") -> bytes:
    """Return the line that answers a request: Signal K's states, and a sentence where it was refused."""
    state = "COMPLETED" if status == 200 else "FAILED"
    return line_of({"requestId": id, "state": state, "statusCode": status, **({"message": message} if message else {})})


def beat_of(now: float) -> bytes:
    """Return the line that says the time [s] of the bridge, by which it knows later how old an order is."""
    return line_of({"beat": now})


def line_of(content: dict[str, Any]) -> bytes:
    """Return an object as a line."""
    return json.dumps(content, separators=(",", ":"), allow_nan=False).encode() + b"\n"


Meaning = TypeVar("Meaning")


def _one_of(id: str, path: str, value: Any, meanings: Mapping[str, Meaning]) -> Meaning:
    if not isinstance(value, str) or value not in meanings:
        raise BadRequestError(id, 400, f"{path}: {', '.join(meanings)} are allowed")
    return meanings[value]


def _number(id: str, path: str, value: Any, low: float, high: float) -> float:
    try:
        return number_from(value, path, low, high)
    except InputError as error:
        raise BadRequestError(id, 400, str(error)) from None
