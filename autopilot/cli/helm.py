"""`autopilot helm`: the helm of a running pilot in a terminal, over SSH as well."""

from __future__ import annotations

import argparse
import select
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from autopilot.errors import ExitCode, InputError

if TYPE_CHECKING:
    import curses

    from autopilot.web.station import BoatLine, Station

DRAW_S = 0.2
ESCAPE = 27


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand."""
    from autopilot.cli.options import add_signing_option, add_waiting_option

    parser = subparsers.add_parser(
        "helm",
        help="the helm in a terminal, for SSH",
        description="Steer and watch a pilot that runs with `autopilot run --serve`, in a terminal. Leaving it changes "
        "nothing: the pilot goes on.",
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
    import curses
    import os

    from autopilot.cli.helm_keys import HelmKeys
    from autopilot.cli.options import patience_of, signing_of
    from autopilot.interruption import as_exceptions
    from autopilot.web.station import BoatLine, Station

    station = Station()
    line = patience_of(arguments)(lambda: BoatLine(arguments.link, station, signing_of(arguments)))
    keys = HelmKeys(station, may=not arguments.look)
    # without this, the release on Esc would wait a second for the rest of a longer key
    os.environ.setdefault("ESCDELAY", "25")
    try:
        with as_exceptions():  # the terminal is left as it was found
            curses.wrapper(lambda window: draw(window, station, line, keys, time.monotonic))
    finally:
        line.close()
    return int(ExitCode.OK)


def draw(
    window: curses.window, station: Station, line: BoatLine, keys: Any, clock: Callable[[], float], waits: bool = True
) -> None:
    """Keep the line, draw five times a second, obey the keys, until one of them quits."""
    from autopilot.files.printable import escaped
    from autopilot.web.screen import screen

    window.nodelay(True)
    window.keypad(True)
    styles = _styles()
    drawn = -1.0
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
            lines = screen(station, now, (columns - 1, rows), line.trouble, keys.said, keys.may)
            window.erase()
            for row, each in enumerate(lines):
                window.addstr(row, 0, escaped(each.text)[: columns - 1], styles.get(each.style, 0))
            window.refresh()
        if waits:
            watched = [0, line.fileno()] if line.fileno() >= 0 else [0]
            select.select(watched, [], [], 0.05)


def _styles() -> dict[str, int]:
    """Return the terminal's attribute of each look; words say the same, for terminals without colour."""
    import curses

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
