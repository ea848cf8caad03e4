"""What a browser may ask for, checked: JSON in, an order for the boat out. Pure."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from autopilot.errors import InputError
from autopilot.files.outside import SHOWN, number_from
from autopilot.files.printable import printable
from autopilot.web import orders
from autopilot.web.hub import Asked
from autopilot.web.station import Station

TURN_MOST_DEG = 180.0
SIZES_MOST = 2


def asked_of(station: Station, wish: Any) -> Asked:
    """Return what carries out a wish like {"do": "turn", "degrees": -10}. Raises InputError."""
    kind = wish.get("do") if isinstance(wish, dict) else None
    make = _WISHES.get(kind) if isinstance(kind, str) else None
    if make is None:
        raise InputError(f"order {printable(repr(kind), SHOWN)}: allowed are {', '.join(_WISHES)}")
    return make(station, wish)


def _commands(
    make: Callable[[dict[str, Any]], tuple[orders.Command, ...]],
) -> Callable[[Station, dict[str, Any]], Asked]:
    def asked(station: Station, wish: dict[str, Any]) -> Asked:
        commands = make(wish)
        return lambda _, told: station.orders.give(commands, told)

    return asked


def _release(station: Station, wish: dict[str, Any]) -> Asked:
    return lambda _, told: station.orders.release(told)


def _turn(station: Station, wish: dict[str, Any]) -> Asked:
    degrees = _number(wish, "degrees", -TURN_MOST_DEG, TURN_MOST_DEG)
    return lambda now, told: station.course.turn_by(now, degrees, told)


def _heading(station: Station, wish: dict[str, Any]) -> Asked:
    degrees = _number(wish, "degrees", 0.0, 360.0)
    return lambda now, told: station.course.turn_to(now, degrees, told)


def _dodge(station: Station, wish: dict[str, Any]) -> Asked:
    degrees = _number(wish, "degrees", -90.0, 90.0)
    return lambda now, told: station.course.dodge(now, degrees, told)


def _back(station: Station, wish: dict[str, Any]) -> Asked:
    return lambda now, told: station.course.back(now, told)


def _acknowledge(station: Station, wish: dict[str, Any]) -> Asked:
    def noted(answer: orders.Answer, words: str, told: orders.Told) -> None:
        if answer is orders.Answer.SILENT:
            told(answer, words)
            return
        # a recording refuses every order: then it counts here alone
        station.alarms.acknowledge(is_known_aboard=bool(answer))
        told(orders.Answer.TAKEN, "")

    def asked(_: float, told: orders.Told) -> None:
        station.orders.give((orders.ACKNOWLEDGE,), lambda taken, words: noted(taken, words, told))

    return asked


def _cancel(station: Station, wish: dict[str, Any]) -> Asked:
    def asked(_: float, told: orders.Told) -> None:
        trial = station.view.trial
        if trial is not None:
            station.orders.cancel(trial.command)
        if trial is not None:
            told(orders.Answer.TAKEN, "")
        else:
            told(orders.Answer.FAILED, "no trial is being sailed")

    return asked


def _set(station: Station, wish: dict[str, Any]) -> Asked:
    name = wish.get("name")
    if not isinstance(name, str) or not 0 < len(name) <= 16 or not name.isascii():
        raise InputError("set: give the name of a parameter, at most 16 characters")
    value = _number(wish, "value", -1.0e30, 1.0e30)
    return lambda _, told: station.parameters.set(name, value, told)


def _pattern(wish: dict[str, Any]) -> tuple[orders.Command, ...]:
    number, side = _number(wish, "number", 0.0, 63.0), _number(wish, "side", -1.0, 1.0)
    sizes = wish.get("sizes", [])
    if not isinstance(sizes, list) or len(sizes) > SIZES_MOST:
        raise InputError(f"pattern: sizes is a list of at most {SIZES_MOST} numbers")
    return orders.pattern(int(number), side, [number_from(size, "size", -1.0e6, 1.0e6) for size in sizes])


_WISHES: dict[str, Callable[[Station, dict[str, Any]], Asked]] = {
    "engage": _commands(lambda _: orders.ENGAGE),
    "standby": _commands(lambda _: (orders.STANDBY,)),
    "release": _release,
    "route": _commands(lambda _: orders.FOLLOW),
    "turn": _turn,
    "heading": _heading,
    "dodge": _dodge,
    "back": _back,
    "pattern": _commands(_pattern),
    "zigzag": _commands(
        lambda wish: orders.zigzag(
            _number(wish, "rudder", 1.0, 90.0),
            _number(wish, "change", 1.0, 90.0),
            _number(wish, "duration", 1.0, 3600.0),
        )
    ),
    "turning": _commands(
        lambda wish: orders.turning(_number(wish, "rudder", -90.0, 90.0), _number(wish, "duration", 1.0, 3600.0))
    ),
    "cancel": _cancel,
    "level": _commands(lambda wish: (orders.level(int(_number(wish, "level", 1.0, 9.0))),)),
    "adopt": _commands(lambda _: (orders.ADOPT,)),
    "revert": _commands(lambda _: (orders.REVERT,)),
    "acknowledge": _acknowledge,
    "set": _set,
}


def _number(wish: dict[str, Any], key: str, low: float, high: float) -> float:
    return number_from(wish.get(key), f"{wish['do']}: {key}", low, high)
