"""The boat's place, as far as the positions that arrive are to be believed. Pure; the memory is the newest of them.

Where a place lies as seen from another, on the WGS 84 ellipsoid's Mercator chart. Pure.

On that chart a straight line is a line of constant true bearing, as charts and ground stations draw a leg, and angles
are true. Its scale is right at the origin and nearly so around it, so that distances [m] are exact where they matter:
at the boat. Snyder, Map Projections: A Working Manual (USGS 1987), equations 7-6 to 7-8 and 15-9.

`Overboard`, a man overboard: the place is kept until the skipper takes it back, and shown from where the boat is. Pure.

It moves no rudder: the boat goes on as ordered until the skipper orders something else.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.errors import InputError
from autopilot.signals import AlarmEvent, PositionSample

EQUATOR_RADIUS = 6378137.0
ECCENTRICITY = math.sqrt(0.00669437999014)
"""WGS 84: semi-major axis [m], first eccentricity."""
LATITUDE_MOST = math.radians(85.0)
"""Nearer to a pole the chart is of no use."""


class Place(NamedTuple):
    """Latitude, north positive, and longitude, east positive [rad]."""

    latitude: float
    longitude: float


def offset(origin: Place, place: Place) -> tuple[float, float]:
    """Return how far [m] north and east `place` lies of `origin`, on the chart with its scale right at the origin."""
    sine = ECCENTRICITY * math.sin(origin.latitude)
    scale = EQUATOR_RADIUS * math.cos(origin.latitude) / math.sqrt(1.0 - sine * sine)
    north = scale * (_isometric(place.latitude) - _isometric(origin.latitude))
    return north, scale * wrap(place.longitude - origin.longitude)


def bearing_and_distance(origin: Place, place: Place) -> tuple[float, float]:
    """Return the true bearing [rad] of `place` from `origin`, and how far [m] it is, as `offset` counts."""
    north, east = offset(origin, place)
    return math.atan2(east, north), math.hypot(north, east)


def _isometric(latitude: float) -> float:
    held = min(max(latitude, -LATITUDE_MOST), LATITUDE_MOST)
    sine = math.sin(held)
    return math.atanh(sine) - ECCENTRICITY * math.atanh(ECCENTRICITY * sine)


CARRIED_S = 3.0
"""A position is carried on by heading and speed for this long; older ones guide nobody."""
JUMP_LEAST = 30.0
JUMP_SPEED = 5.0
"""Further off than this [m], with what twice the speed or this much more [m/s] explains, is a jump."""
UNDER_WAY = 0.5
"""Above this speed [m/s] a position that stays the same to the last digit is an instrument that has stopped."""


class Fix:
    """Take every `PositionSample`; what to believe is in `newest`.

    A position that the boat cannot have reached is doubted, and with it all that go on from there. Which of the two
    places is wrong no position tells: the doubt ends with a position near the believed place, or with `accept`.
    """

    def __init__(self) -> None:
        self.newest: PositionSample | None = None
        self._doubted: PositionSample | None = None
        self.jump = 0.0
        """How far off [m] those lie that are doubted, once two of them have agreed; else 0."""

    def take(self, sample: PositionSample, speed: float) -> None:
        """Take a position, the boat going at `speed` [m/s]; a repeated one is no news."""
        newest, doubted = self.newest, self._doubted
        if not (math.isfinite(sample.latitude) and math.isfinite(sample.longitude) and math.isfinite(sample.time)):
            return
        if newest is not None:
            same = sample[1:3] == newest[1:3] or (doubted is not None and sample[1:3] == doubted[1:3])
            if sample.time <= newest.time or (same and abs(speed) > UNDER_WAY):
                return
            # the doubted first: with time a boat could have gone from one place to the other
            if doubted is not None and sample.time > doubted.time and not _jumps(doubted, sample, speed):
                self.jump = self.jump or bearing_and_distance(_place_of(newest), _place_of(sample))[1]
                self._doubted = sample
                return
            if _jumps(newest, sample, speed):
                self._doubted = sample
                return
        self.newest, self._doubted, self.jump = sample, None, 0.0

    def accept(self) -> None:
        """Believe the place that two positions have agreed on, however far off it is."""
        if self.jump > 0.0:
            self.newest, self._doubted, self.jump = self._doubted, None, 0.0

    def is_fresh(self, now: float) -> bool:
        """Return whether the place is known well enough to be guided by at `now` [s]."""
        return self.newest is not None and now - self.newest.time <= CARRIED_S

    @property
    def place(self) -> Place:
        """The newest place that is believed; ValueError before the first."""
        if self.newest is None:
            raise ValueError("fix: no position yet")
        return _place_of(self.newest)

    def age(self, now: float) -> float:
        """Return for how long [s] the newest position has to be carried on to `now` [s]; 0 before the first."""
        return min(max(now - self.newest.time, 0.0), CARRIED_S) if self.newest is not None else 0.0


def _jumps(before: PositionSample, sample: PositionSample, speed: float) -> bool:
    _, distance = bearing_and_distance(_place_of(before), _place_of(sample))
    quickest = max(2.0 * abs(speed), abs(speed) + JUMP_SPEED)
    return distance > JUMP_LEAST + quickest * (sample.time - before.time)


def _place_of(sample: PositionSample) -> Place:
    return Place(sample.latitude, sample.longitude)


OLDEST_S = 60.0
"""A position of so long ago [s] is still the best there is."""


class Overboard:
    """The place, None where nobody is overboard, and since when [s]."""

    def __init__(self) -> None:
        self.place: Place | None = None
        self.since = math.nan

    def mark(self, now: float, fix: Fix) -> None:
        """Keep where the boat is at `now` [s]; once more changes nothing: the first place is the nearest.

        Raises InputError where no position is known.
        """
        if self.place is not None:
            return
        if fix.newest is None or not abs(now - fix.newest.time) <= OLDEST_S:
            raise InputError("man overboard: no position is known; note the time and the heading")
        self.place, self.since = fix.place, now

    def clear(self) -> None:
        """Forget it."""
        self.place, self.since = None, math.nan

    def seen_from(self, fix: Fix) -> tuple[float, float] | None:
        """Return true bearing [rad] and distance [m] from the boat, None where either place is not known."""
        return None if self.place is None or fix.newest is None else bearing_and_distance(fix.place, self.place)

    @property
    def alarm(self) -> AlarmEvent | None:
        """What everybody aboard must know, None while nobody is overboard."""
        return None if self.place is None else AlarmEvent("man_overboard", _written(self.place))


def _written(place: Place) -> str:
    """Return a place in degrees and minutes, as charts have it."""
    parts = []
    for angle, digits, sides in ((place.latitude, 2, "NS"), (place.longitude, 3, "EW")):
        minutes = round(abs(math.degrees(angle)) * 60.0, 3)
        parts.append(f"{int(minutes // 60.0):0{digits}d} {minutes % 60.0:06.3f} {sides[angle < 0.0]}")
    return ", ".join(parts)
