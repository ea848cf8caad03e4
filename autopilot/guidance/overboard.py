"""Man overboard: the place is kept until the skipper takes it back, and shown from where the boat is. Pure.

It moves no rudder: the boat goes on as ordered until the skipper orders something else.
"""

from __future__ import annotations

import math

from autopilot.errors import InputError
from autopilot.guidance.fix import Fix, Place, bearing_and_distance
from autopilot.signals import AlarmEvent

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
