"""What a helm display remembers: who ordered what and when, where the boat has been, and its route. Pure."""

from __future__ import annotations

import contextlib
import math
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from autopilot.errors import InputError
from autopilot.files.outside import parse_json
from autopilot.firmware.metadata import FtpClient
from autopilot.links.ground_station.file_server import ROUTE
from autopilot.web.view import BoatView

KEPT = 100
ECHO_S = 4.0
"""So long after an order of ours [s] a change of mode or course is its own."""
SETTLED_S = 2.0
"""A course that has stood for this long was ordered; one that changes all the time is led by a route or the wind."""
CHANGED_DEG = 0.5
ELSEWHERE = "elsewhere"
"""At the pilot's own terminal, from a ground station, or over Signal K."""


class Given(NamedTuple):
    """An order: when [s], who gave it, what it was, whether it was taken, None while it is not known; and why not."""

    number: int
    time: float
    who: str
    what: str
    taken: bool | None = None
    words: str = ""


class Journal:
    """`entries` are the orders of this session, the newest last."""

    def __init__(self) -> None:
        self.entries: deque[Given] = deque(maxlen=KEPT)
        self._count = 0
        self._ours = -math.inf
        self._mode: int | None = None
        self._course = self._stands = math.nan
        self._since = -math.inf

    def begin(self, now: float, who: str, what: str) -> int:
        """Note an order that is given; return its number, for `end`."""
        self._ours = now
        return self._note(now, who, what, None)

    def end(self, number: int, taken: bool, words: str) -> None:
        """Note how it ended."""
        for place, entry in enumerate(self.entries):
            if entry.number == number:
                self.entries[place] = entry._replace(taken=taken, words="" if taken else words)

    def update(self, now: float, view: BoatView) -> None:
        """Note what was ordered elsewhere: another mode, or another course that stands."""
        if not view.is_ours:
            return
        mode, course = view.mode, view.value("order")
        is_ours = now - self._ours < ECHO_S
        if self._mode not in (None, mode) and not is_ours:
            self._note(now, ELSEWHERE, view.mode_name, True)
            self._stands = math.nan
        self._mode = mode
        if course is None:
            self._course = self._stands = math.nan
            return
        if not abs(math.remainder(course - self._course, 360.0)) < CHANGED_DEG:
            self._course, self._since = course, now
        if now - self._since < SETTLED_S or view.mode_name != "heading":
            return
        if abs(math.remainder(course - self._stands, 360.0)) >= CHANGED_DEG and not is_ours:
            self._note(now, ELSEWHERE, f"course {round(course) % 360:03d}°", True)
        self._stands = course

    def _note(self, now: float, who: str, what: str, taken: bool | None) -> int:
        self._count += 1
        self.entries.append(Given(self._count, round(now, 1), who, what, taken))
        return self._count


def words_of(request: dict[str, Any]) -> str:
    """Return what a checked request asks for, in words."""
    kind = str(request["do"])
    return WORDS[kind](request) if kind in WORDS else " ".join(str(value) for value in request.values())


def _side(degrees: float) -> str:
    return f"{abs(degrees):g}° to {'port' if degrees < 0.0 else 'starboard'}"


WORDS: dict[str, Callable[[dict[str, Any]], str]] = {
    "engage": lambda _: "hold the heading",
    "standby": lambda _: "standby",
    "release": lambda _: "release the rudder",
    "route": lambda _: "follow the route",
    "turn": lambda request: _side(request["degrees"]),
    "heading": lambda request: f"course {round(request['degrees']) % 360:03d}°",
    "dodge": lambda request: f"dodge {_side(request['degrees'])}",
    "back": lambda _: "back to the course before",
    "mob": lambda _: "MAN OVERBOARD",
    "mob_off": lambda _: "nobody is overboard",
    "next": lambda _: "on to the next waypoint",
    "wind": lambda request: f"hold the {'true' if request.get('true') else 'apparent'} wind",
    "confirm": lambda _: "turn to the other side of the wind",
    "decline": lambda _: "no turn",
    "zigzag": lambda request: "zigzag {rudder:g}/{change:g}, {duration:g} s".format(**request),
    "turning": lambda request: "turn at {rudder:g}° of rudder, {duration:g} s".format(**request),
    "cancel": lambda _: "end the trial",
    "level": lambda request: f"response {request['level']:g}",
    "adopt": lambda _: "adopt the learnt model",
    "revert": lambda _: "revert to the model before",
    "acknowledge": lambda request: f"acknowledge {request.get('name') or 'all'}".replace("_", " "),
    "set": lambda request: "{name} = {value:g}".format(**request),
}


EVERY_S = 2.0
POINTS = 1800
"""An hour."""
LEAST_M = 1.0
"""A boat that lies still adds no points."""
METRES_PER_DEG = 111_195.0
ROUTE_MOST = 65_536
ROUTE_AGAIN_S = 20.0

Place = tuple[float, float]
"""Latitude and longitude [deg]."""


class Track:
    """`points` are [time s, latitude deg, longitude deg], the oldest first."""

    def __init__(self) -> None:
        self.points: deque[tuple[float, float, float]] = deque(maxlen=POINTS)

    def update(self, now: float, view: BoatView) -> tuple[float, float, float] | None:
        """Add where the boat is, where it is time to and it has moved; return the new point."""
        latitude, longitude, age = view.value("lat"), view.value("lon"), view.age("position", now)
        if latitude is None or longitude is None or age is None or age > EVERY_S:
            return None
        if self.points:
            last = self.points[-1]
            north = (latitude - last[1]) * METRES_PER_DEG
            east = (longitude - last[2]) * METRES_PER_DEG * math.cos(math.radians(latitude))
            if now - last[0] < EVERY_S or math.hypot(north, east) < LEAST_M:
                return None
        point = (round(now, 1), latitude, longitude)
        self.points.append(point)
        return point


class RouteBoard:
    """`places` are the boat's waypoints, fetched anew where their number changes and now and then."""

    def __init__(self, files: FtpClient) -> None:
        self._files = files
        self.places: tuple[Place, ...] = ()
        self._count = math.nan
        self._next = -math.inf

    def update(self, now: float, view: BoatView) -> None:
        """Ask for the route where it may be another."""
        count = view.value("waypoints")
        if count is None:
            return
        if count == 0.0:
            self.places = ()
        elif count != self._count or now >= self._next:
            self._next = now + ROUTE_AGAIN_S
            self._files.fetch(ROUTE, self._take)
        self._count = count

    def _take(self, content: bytes | None) -> None:
        if content is not None:
            with contextlib.suppress(InputError):  # the route known stays
                self.places = route_from(content)


def route_from(content: bytes) -> tuple[Place, ...]:
    """Return the places of a boat's route. Raises InputError."""
    origin = "the boat's route"
    entries = parse_json(content, origin, ROUTE_MOST)
    if not (isinstance(entries, list) and all(map(_is_place, entries))):
        raise InputError(f"{origin}: a list of [latitude, longitude] in degrees is needed")
    return tuple((float(latitude), float(longitude)) for latitude, longitude in entries)


def _is_place(entry: Any) -> bool:
    return (
        isinstance(entry, list)
        and len(entry) == 2
        and all(isinstance(each, int | float) and not isinstance(each, bool) for each in entry)
        and abs(entry[0]) <= 90.0
        and abs(entry[1]) <= 180.0
    )
