"""Where the boat has been, and its route, for the chart. Pure."""

from __future__ import annotations

import contextlib
import math
from collections import deque
from typing import Any

from autopilot.errors import InputError
from autopilot.files.outside import parse_json
from autopilot.firmware.metadata import FtpClient
from autopilot.links.ground_station.file_server import ROUTE
from autopilot.web.view import BoatView

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
