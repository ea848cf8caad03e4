"""`autopilot helm`: the helm of a running pilot in a terminal, over SSH as well.

One key or one typed line becomes one order, given as the page gives it.
"""

from __future__ import annotations

import argparse
import curses
import select
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from autopilot.errors import ExitCode, InputError
from autopilot.files.outside import typed_number
from autopilot.files.printable import escaped

if TYPE_CHECKING:
    from autopilot.web.orders import Answer
    from autopilot.web.station import BoatLine, Station

DRAW_S = 0.2
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
    ord("M"): {"do": "mob"},
    ord("w"): {"do": "wind"},
    ord("W"): {"do": "wind", "true": True},
    ord("k"): {"do": "tack"},
    ord("g"): {"do": "gybe"},
    ord("y"): {"do": "confirm"},
    ord("n"): {"do": "decline"},
    ord("d"): {"do": "dodge", "degrees": -20},
    ord("D"): {"do": "dodge", "degrees": 20},
    ord("b"): {"do": "back"},
    ord("a"): {"do": "acknowledge"},
    **{ord(str(level)): {"do": "level", "level": level} for level in range(1, 10)},
}
LINE_HELP = (
    "h DEG  wind DEG  true DEG  zigzag DEG DEG S  turn DEG S  p ...  level N  adopt  revert  cancel  set NAME VALUE"
)
NUMBERS = {"h": ("heading", ("degrees",)), "zigzag": ("zigzag", ("rudder", "change", "duration"))}
NUMBERS |= {"wind": ("wind", ("degrees",)), "true": ("wind", ("degrees",))}
NUMBERS |= {"turn": ("turning", ("rudder", "duration")), "level": ("level", ("level",))}
PLAIN = ("adopt", "revert", "cancel", "engage", "standby", "release", "route", "next", "back", "mob", "mob_off")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the subcommand."""
    from autopilot.cli.options import add_signing_option, add_waiting_option

    parser.description = (
        "Steer and watch a pilot that runs with `autopilot run --serve`, in a terminal. Leaving it changes "
        "nothing: the pilot goes on."
    )
    parser.add_argument(
        "--link", required=True, metavar="URL", help="where the pilot serves: udpin:127.0.0.1:14550, tcp:HOST:PORT"
    )
    parser.add_argument("--look", action="store_true", help="only look: no key gives an order")
    add_signing_option(parser)
    add_waiting_option(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Show the helm until it is left with `q`."""
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise InputError("autopilot helm needs a terminal: run it in one, or over `ssh -t`")
    import os

    from autopilot.cli.options import patience_of, signing_of
    from autopilot.interruption import as_exceptions
    from autopilot.runtime.machine import running_time
    from autopilot.web.station import BoatLine, Station

    station = Station()
    line = patience_of(arguments)(lambda: BoatLine(arguments.link, station, signing_of(arguments)))
    keys = HelmKeys(station, may=not arguments.look)
    # without this, the release on Esc would wait a second for the rest of a longer key
    os.environ.setdefault("ESCDELAY", "25")
    try:
        with as_exceptions():  # the terminal is left as it was found
            curses.wrapper(lambda window: draw(window, station, line, keys, running_time))
    finally:
        line.close()
    return int(ExitCode.OK)


def draw(
    window: curses.window,
    station: Station,
    line: BoatLine,
    keys: HelmKeys,
    clock: Callable[[], float],
    waits: bool = True,
) -> None:
    """Keep the line, draw five times a second, obey the keys, until one of them quits."""
    from autopilot.web.screen import history, screen

    window.nodelay(True)
    window.keypad(True)
    styles = _styles()
    drawn = rung = -1.0
    while not keys.quit:
        now = clock()
        line.turn(now)
        station.view.keep_history(now)
        while (key := window.getch()) != -1:
            keys.press(now, key)
            drawn = -1.0
        if now - drawn >= DRAW_S:
            drawn = now
            rows, columns = window.getmaxyx()
            size = columns - 1, rows
            if keys.shows_history:
                lines = history(station, now, size)
            else:
                lines = screen(station, now, size, line.trouble, keys.said, keys.may)
            sound = station.alarms.sound
            if sound is not None and now - rung >= sound.every:
                rung = now
                curses.beep()
            window.erase()
            for row, each in enumerate(lines):
                window.addstr(row, 0, escaped(each.text)[: columns - 1], styles.get(each.style, 0))
            window.refresh()
        if waits:
            watched = [0, line.fileno()] if line.fileno() >= 0 else [0]
            select.select(watched, [], [], 0.05)


def _styles() -> dict[str, int]:
    """Return the terminal's attribute of each look; words say the same, for terminals without colour."""
    styles = {"dim": curses.A_DIM, "strong": curses.A_BOLD, "on": curses.A_REVERSE | curses.A_BOLD}
    styles |= {"alarm": curses.A_REVERSE, "bad": curses.A_REVERSE | curses.A_BOLD}
    try:
        curses.curs_set(0)
        curses.use_default_colors()
        colours = {"on": curses.COLOR_GREEN, "alarm": curses.COLOR_YELLOW, "bad": curses.COLOR_RED}
        for number, (style, colour) in enumerate(colours.items(), 1):
            curses.init_pair(number, colour, -1)
            styles[style] |= curses.color_pair(number)
    except curses.error:
        pass
    return styles


class HelmKeys:
    """Takes keys; `said` is what to show: the line typed, or what was answered. `may`: orders are given at all;
    `shows_history`: alarms and orders with their times are looked at."""

    def __init__(self, station: Station, may: bool = True) -> None:
        self._station = station
        self._typed: str | None = None
        self.may = may
        self.shows_history = False
        self.said = ""
        self.quit = False

    def press(self, now: float, key: int) -> None:
        """Take a key, as curses numbers it."""
        if self._typed is not None and key != ESCAPE:
            self._type(now, key)
        elif key == ord("q"):
            self.quit = True
        elif key == ord("l"):
            self.shows_history = not self.shows_history
        elif key == ord("A"):
            self._typed = None
            sounding = [each["name"] for each in self._station.alarms.active if each["sounds"]]
            self._ask(now, {"do": "acknowledge", **({"name": sounding[0]} if sounding else {})})
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
            self.said = "view only: start without --look to steer"
            return
        if self._station.target is None:
            self.said = "no boat that runs this pilot is heard"
            return
        from autopilot.web.journal import words_of
        from autopilot.web.requests import asked_of

        name = " ".join(str(value) for value in request.values())

        def on_done(taken: Answer, words: str) -> None:
            self.said = f"{name}: {'done' if taken else words}"

        self.said = f"{name} ..."
        try:
            asked = asked_of(self._station, request)
            self._station.ask(now, asked, on_done, ("terminal helm", words_of(request)))
        except InputError as error:
            self.said = str(error)


def request_of(line: str) -> dict[str, Any]:
    """Return the request of a typed line. Raises InputError."""
    from autopilot.operators.trial_script import KINDS, PATTERN_HELP

    word, *rest = line.split() or [""]
    if word in PLAIN and not rest:
        return {"do": word}
    if word in NUMBERS and len(rest) == len(NUMBERS[word][1]):
        do, keys = NUMBERS[word]
        given: dict[str, Any] = {"do": do, **dict(zip(keys, map(_number, rest), strict=True))}
        return given | ({"true": True} if word == "true" else {})
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
