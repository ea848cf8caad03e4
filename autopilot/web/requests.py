"""What a browser may ask for, checked: JSON in, an order for the boat out. Pure."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.errors import InputError
from autopilot.files.outside import SHOWN, number_from
from autopilot.files.printable import printable
from autopilot.links.base import UNSEEN
from autopilot.links.ground_station.commands import (
    COMPASS,
    CONFIRM,
    DECLINE,
    GYBE,
    OVERBOARD,
    PATTERN,
    TACK,
    TURNING,
    WINDWARD,
    ZIGZAG,
)
from autopilot.links.ground_station.orders import ACKNOWLEDGE, ADOPT, LEARNING, LEVEL, MANUAL, REVERT, TRACK
from autopilot.supervision.alarms import CATALOGUE, OTHER
from autopilot.web import orders
from autopilot.web.orders import ARM, Asked, Command
from autopilot.web.station import Station
from autopilot.web.view import BoatView

TURN_MOST_DEG = 180.0
SIZES_MOST = 2


LATE_S = 5.0
"""An order whose giver has heard nothing for so long [s] was held up on its way: nobody waits for it any more. So was
one that names a state so far ahead: this computer has started anew since, and its clock with it."""
STOPS = ("standby", "release")
NEVER_LATE = (*STOPS, "cancel", "mob", "mob_at")
CAME_LATE = "the order was held up on its way and is not carried out: order again"
SHOWN_WITHIN_S = 2.0
"""So long [s] after an order to stand by a display may still show that the pilot has the helm."""


class GivenStops:
    """Since when displays can see that the pilot stands by, whoever let it; `view`: what they show of the boat."""

    def __init__(self, view: BoatView) -> None:
        self._view = view
        self._under_way, self._began, self._ended = 0, -math.inf, -math.inf

    def begin(self, now: float) -> None:
        """Take that a display orders to stand by at `now` [s]."""
        self._under_way += 1
        self._began = now if self._view.mode != MANUAL else -math.inf

    def end(self, now: float) -> None:
        """Take that the order has ended at `now` [s], carried out or not."""
        self._under_way, self._ended = self._under_way - 1, now

    def seen_since(self, now: float) -> float:
        """Return the time [s]; inf: at `now` they cannot see it yet."""
        view = self._view
        is_shown = view.mode == MANUAL or view.stood_by >= self._began or now - self._ended > SHOWN_WITHIN_S
        return max(self._ended, view.stood_by) if is_shown and not self._under_way else math.inf


def came_late(request: dict[str, Any], now: float, stood_by: float) -> str:
    """Take out of a request the time [s] of the newest state that its giver saw, where one is in it; return why the
    order is too late to be carried out at `now` [s], '' where it is not. Raises InputError.

    stood_by [s]: when it could be seen that the pilot stands by; inf: not yet.
    """
    seen = number_from(request.pop("seen"), "seen", 0.0, math.inf) if "seen" in request else now
    if request.get("do") in NEVER_LATE:
        return ""
    if abs(now - seen) > LATE_S:
        return CAME_LATE
    return UNSEEN if seen < stood_by and request.get("do") != "acknowledge" else ""


def asked_of(station: Station, request: Any) -> Asked:
    """Return what carries out a request like {"do": "turn", "degrees": -10}. Raises InputError."""
    kind = request.get("do") if isinstance(request, dict) else None
    make = _REQUESTS.get(kind) if isinstance(kind, str) else None
    if make is None:
        raise InputError(f"order {printable(repr(kind), SHOWN)}: allowed are {', '.join(_REQUESTS)}")
    return make(station, request)


def _commands(
    make: Callable[[dict[str, Any]], tuple[Command, ...]],
) -> Callable[[Station, dict[str, Any]], Asked]:
    def asked(station: Station, request: dict[str, Any]) -> Asked:
        commands = make(request)

        def give(_: float, on_done: orders.OnDone) -> None:
            if commands[0] == ARM:  # a route, a pattern, a trial: no step is to be added to its course
                station.course.drop_steps()
            station.orders.give(commands, on_done)

        return give

    return asked


def _first(commands: tuple[Command, ...]) -> Callable[[Station, dict[str, Any]], Asked]:
    return lambda station, request: lambda _, on_done: station.orders.first(commands, on_done)


def _course(
    do: Callable[[orders.Course, float, float, orders.OnDone], None], low: float, high: float
) -> Callable[[Station, dict[str, Any]], Asked]:
    def asked(station: Station, request: dict[str, Any]) -> Asked:
        degrees = _number(request, "degrees", low, high)
        return lambda now, on_done: do(station.course, now, degrees, on_done)

    return asked


def _numbers(number: int, *parameters: float) -> Callable[[Station, dict[str, Any]], Asked]:
    """Return what gives a command that is the same whatever else the request holds."""
    return _commands(lambda _: (Command(number, parameters),))


def _sized(
    number: int, *fields: tuple[str, float, float], begins: bool = False
) -> Callable[[Station, dict[str, Any]], Asked]:
    """Return what gives a command whose parameters are fields of the request, each within its bounds; begins: armed
    before, with sizes of a manoeuvre; else whole numbers."""

    def made(request: dict[str, Any]) -> tuple[Command, ...]:
        values = [_number(request, *field) for field in fields]
        return (ARM, Command(number, tuple(values))) if begins else (Command(number, tuple(map(math.trunc, values))),)

    return _commands(made)


def _next(station: Station, request: dict[str, Any]) -> Asked:
    def asked(_: float, on_done: orders.OnDone) -> None:
        waypoint = station.view.value("waypoint")
        if station.view.mode != TRACK or waypoint is None:
            on_done(orders.Answer.FAILED, "no route is followed")
        else:
            station.orders.give(
                (Command(int(dialect.MAV_CMD_DO_SET_MISSION_CURRENT), (int(waypoint) + 1.0,)),), on_done
            )

    return asked


def _wind(station: Station, request: dict[str, Any]) -> Asked:
    is_true, given = request.get("true", False), request.get("degrees")
    if not isinstance(is_true, bool):
        raise InputError("wind: true: true (the true wind) or false (the apparent one) is allowed")
    degrees = None if given is None else _number(request, "degrees", -180.0, 180.0)
    return lambda _, on_done: station.course.hold_wind(is_true, degrees, on_done)


def _turn_of_the_wind(request: dict[str, Any]) -> tuple[Command, ...]:
    side, confirmed = request.get("side", 0), request.get("confirmed", False)
    if side not in (-1, 0, 1) or not isinstance(confirmed, bool):
        raise InputError(f"{request['do']}: side is 1 (starboard), -1 (port) or 0, confirmed is true or false")
    # asked for, or, confirmed, begun
    return (Command(WINDWARD, (float(GYBE if request["do"] == "gybe" else TACK), float(side), float(confirmed))),)


def _acknowledge(station: Station, request: dict[str, Any]) -> Asked:
    name = request.get("name")
    if name is not None and not (isinstance(name, str) and (name or OTHER) in CATALOGUE):
        raise InputError(f"acknowledge: there is no alarm of the name {printable(repr(name), SHOWN)}")
    name = name if name is None else name or OTHER

    def noted(answer: orders.Answer, words: str, on_done: orders.OnDone) -> None:
        if answer is orders.Answer.SILENT:
            on_done(answer, words)
            return
        # a recording refuses every order: then it counts here alone
        station.alarms.acknowledge(bool(answer), name)
        on_done(orders.Answer.TAKEN, "")

    seen = Command(ACKNOWLEDGE, () if name is None else (float(CATALOGUE[name].number),))

    def asked(_: float, on_done: orders.OnDone) -> None:
        station.orders.give((seen,), lambda taken, words: noted(taken, words, on_done))

    return asked


def _cancel(station: Station, request: dict[str, Any]) -> Asked:
    def asked(_: float, on_done: orders.OnDone) -> None:
        trial = station.view.trial
        if trial is not None:
            station.orders.cancel(trial.command)
            on_done(orders.Answer.TAKEN, "")
        else:
            on_done(orders.Answer.FAILED, "no trial is being sailed")

    return asked


def _set(station: Station, request: dict[str, Any]) -> Asked:
    name = request.get("name")
    if not isinstance(name, str) or not 0 < len(name) <= 16 or not name.isascii():
        raise InputError("set: give the name of a parameter, at most 16 characters")
    value = _number(request, "value", -1.0e30, 1.0e30)
    return lambda _, on_done: station.parameters.set(name, value, on_done)


def _overboard_at(request: dict[str, Any]) -> tuple[Command, ...]:
    latitude, longitude = _number(request, "latitude", -90.0, 90.0), _number(request, "longitude", -180.0, 180.0)
    # on behalf of another system aboard; both 0: it knows no place
    return (Command(OVERBOARD, (1.0, 1.0, 0.0, 0.0, latitude, longitude)),)


def _pattern(request: dict[str, Any]) -> tuple[Command, ...]:
    number, side = _number(request, "number", 0.0, 63.0), _number(request, "side", -1.0, 1.0)
    sizes = request.get("sizes", [])
    if not isinstance(sizes, list) or len(sizes) > SIZES_MOST:
        raise InputError(f"pattern: sizes is a list of at most {SIZES_MOST} numbers")
    given = (number_from(size, "size", -1.0e6, 1.0e6) for size in sizes)
    return ARM, Command(PATTERN, (float(int(number)), side, *given))


_REQUESTS: dict[str, Callable[[Station, dict[str, Any]], Asked]] = {
    "engage": lambda station, _: station.course.engage,
    "standby": _first((orders.STANDBY,)),
    "release": _first(orders.RELEASE),
    "route": _commands(lambda _: orders.FOLLOW),
    "next": _next,
    "mob": _numbers(OVERBOARD, 1.0),
    "mob_at": _commands(_overboard_at),
    "mob_off": _numbers(OVERBOARD, 0.0),
    "wind": _wind,
    "tack": _commands(_turn_of_the_wind),
    "gybe": _commands(_turn_of_the_wind),
    "confirm": _numbers(WINDWARD, float(CONFIRM)),
    "decline": _numbers(WINDWARD, float(DECLINE)),
    "turn": _course(orders.Course.turn_by, -TURN_MOST_DEG, TURN_MOST_DEG),
    "heading": _course(orders.Course.turn_to, 0.0, 360.0),
    "dodge": _course(orders.Course.dodge, -90.0, 90.0),
    "back": lambda station, _: station.course.back,
    "pattern": _commands(_pattern),
    "zigzag": _sized(ZIGZAG, ("rudder", 1.0, 90.0), ("change", 1.0, 90.0), ("duration", 1.0, 3600.0), begins=True),
    "turning": _sized(TURNING, ("rudder", -90.0, 90.0), ("duration", 1.0, 3600.0), begins=True),
    "cancel": _cancel,
    "level": _sized(LEVEL, ("level", 1.0, 9.0)),
    "compass": _sized(COMPASS, ("number", 0.0, 32.0)),
    "adopt": _numbers(LEARNING, ADOPT),
    "revert": _numbers(LEARNING, REVERT),
    "acknowledge": _acknowledge,
    "set": _set,
}


def _number(request: dict[str, Any], key: str, low: float, high: float) -> float:
    return number_from(request.get(key), f"{request['do']}: {key}", low, high)
