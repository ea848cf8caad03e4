"""The keys of the terminal helm: one key or one typed line becomes one order, given as the page gives it."""

from __future__ import annotations

import curses
from typing import Any

from autopilot.errors import InputError
from autopilot.files.outside import typed_number
from autopilot.operators.skipper import KINDS, PATTERN_HELP
from autopilot.web.orders import Answer
from autopilot.web.requests import asked_of
from autopilot.web.station import Station

ESCAPE = 27
ENTER = (10, 13, curses.KEY_ENTER)
ERASE = (8, 127, curses.KEY_BACKSPACE)
TYPED_MOST = 120
REQUESTS: dict[int, dict[str, Any]] = {
    ESCAPE: {"do": "release"},
    curses.KEY_LEFT: {"do": "turn", "degrees": -1},
    curses.KEY_RIGHT: {"do": "turn", "degrees": 1},
    curses.KEY_SLEFT: {"do": "turn", "degrees": -10},
    curses.KEY_SRIGHT: {"do": "turn", "degrees": 10},
    ord("e"): {"do": "engage"},
    ord("t"): {"do": "route"},
    ord("s"): {"do": "standby"},
    ord("d"): {"do": "dodge", "degrees": -20},
    ord("D"): {"do": "dodge", "degrees": 20},
    ord("b"): {"do": "back"},
    ord("a"): {"do": "acknowledge"},
    **{ord(str(level)): {"do": "level", "level": level} for level in range(1, 10)},
}
LINE_HELP = "h DEG  zigzag DEG DEG S  turn DEG S  p ...  level N  adopt  revert  cancel  set NAME VALUE"
NUMBERS = {"h": ("heading", ("degrees",)), "zigzag": ("zigzag", ("rudder", "change", "duration"))}
NUMBERS |= {"turn": ("turning", ("rudder", "duration")), "level": ("level", ("level",))}
PLAIN = ("adopt", "revert", "cancel", "engage", "standby", "release", "route", "back")


class HelmKeys:
    """Takes keys; `said` is what to show: the line typed, or what was answered. `may`: orders are given at all."""

    def __init__(self, station: Station, may: bool = True) -> None:
        self._station = station
        self._typed: str | None = None
        self.may = may
        self.said = ""
        self.quit = False

    def press(self, now: float, key: int) -> None:
        """Take a key, as curses numbers it."""
        if self._typed is not None and key != ESCAPE:
            self._type(now, key)
        elif key == ord("q"):
            self.quit = True
        elif key == ord(":") and self.may:
            self._typed, self.said = "", ":"
        elif key in REQUESTS:
            self._typed = None
            self._ask(now, REQUESTS[key])

    def _type(self, now: float, key: int) -> None:
        typed = self._typed or ""
        if key in ENTER:
            self._typed = None
            try:
                self._ask(now, request_of(typed))
            except InputError as error:
                self.said = str(error)
            return
        if key in ERASE:
            typed = typed[:-1]
        elif 32 <= key < 127 and len(typed) < TYPED_MOST:
            typed += chr(key)
        self._typed, self.said = typed, f":{typed}"

    def _ask(self, now: float, request: dict[str, Any]) -> None:
        if not self.may:
            self.said = "only looking: start without --look to steer"
            return
        if self._station.target is None:
            self.said = "no boat that runs this pilot is heard"
            return
        name = " ".join(str(value) for value in request.values())

        def on_done(taken: Answer, words: str) -> None:
            self.said = f"{name}: {'done' if taken else words}"

        self.said = f"{name} ..."
        try:
            asked_of(self._station, request)(now, on_done)
        except InputError as error:
            self.said = str(error)


def request_of(line: str) -> dict[str, Any]:
    """Return the request of a typed line. Raises InputError."""
    word, *rest = line.split() or [""]
    if word in PLAIN and not rest:
        return {"do": word}
    if word in NUMBERS and len(rest) == len(NUMBERS[word][1]):
        do, keys = NUMBERS[word]
        return {"do": do, **dict(zip(keys, map(_number, rest), strict=True))}
    if word == "set" and len(rest) == 2:
        return {"do": "set", "name": rest[0].upper(), "value": _number(rest[1])}
    if word == "p" and len(rest) >= 2 and rest[0] in KINDS and rest[1] in ("+", "-"):
        sizes = [_number(each) for each in rest[2:]]
        return {
            "do": "pattern",
            "number": list(KINDS).index(rest[0]),
            "side": 1 if rest[1] == "+" else -1,
            "sizes": sizes,
        }
    raise InputError(PATTERN_HELP if word == "p" else LINE_HELP)


def _number(text: str) -> float:
    try:
        return typed_number(text)
    except InputError as error:
        raise InputError(f"{error}; {LINE_HELP}") from None
