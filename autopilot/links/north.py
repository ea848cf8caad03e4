"""Which north headings and courses count from: true north, or magnetic where the vessel file says so.

`EarthField`: the variation by a model of the earth's field, the World Magnetic Model, at a place and a date.

Needs the extra `field`: the package pygeomag has the model's equations and coefficients. Source: NOAA and BGS, "The
US/UK World Magnetic Model for 2025-2030"; each edition serves five years. What is local, iron in the ground and on
board, is not in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from datetime import date
from enum import IntEnum
from typing import Any, NamedTuple

from autopilot.angles import wrap
from autopilot.errors import InputError
from autopilot.links.base import AlarmNews
from autopilot.signals import AlarmEvent, HeadingSample, Sample

UNUSABLE_FOR_S = 3.0
"""Headings that take an unknown variation are reported after this long without others on the same link."""

MAGNETIC_LEADS = (
    "courses are magnetic here (sensors.magnetic) and positions lead by true ones: set sensors.variation_deg instead"
)
"""Why nothing that goes by positions is followed."""


SILENT_S = 30.0
"""A source of the variation that has said nothing for so long gives its place to another."""
MOVED = 2.0e-3
"""The field is reckoned anew where the boat has moved by this [rad], about 7 nm."""


JUMP = math.radians(2.0)
"""No boat is soon where the variation is so much another: an instrument that says so has lost its place, its date or
the sign, or had not found them before."""
SETTLED_S = 10.0
"""What an instrument says for so long while nothing is steered by it is taken."""


class NeedsVariationError(Exception):
    """A bearing from the north that is not steered by, and no variation is known."""


class Jump(NamedTuple):
    """What a variation was and what is said now [rad], since when while nothing is steered, and when last [s]."""

    before: float
    said: float
    since: float
    last: float


class Origin(IntEnum):
    """Who says what the variation is."""

    NOBODY = 0
    FILE = 1
    INSTRUMENT = 2
    MODEL = 3


class Variation:
    """The magnetic variation as all links of a run know it: the one that is set, else the one that an instrument sends,
    else that of a model of the earth's field where the boat is.

    Of several instruments the first counts as long as it sends one: two that differ would swing the heading to and fro.
    One whose own jumps is held to what it said before while the boat is steered: no boat turns for it, and what was
    wrong at first is not kept for the whole run. 0 is what some say before they know.

    field: returns the variation [rad] at a latitude and longitude [rad].
    """

    def __init__(self, configured: float | None = None, field: Callable[[float, float], float] | None = None) -> None:
        self._configured, self._field = configured, field
        self._received: float | None = None
        self._source: tuple[object, ...] = ()
        self._received_time = -math.inf
        self._accepted: dict[tuple[object, ...], float] = {}
        self._jumps: dict[tuple[object, ...], Jump] = {}
        self._steers: bool | None = None
        self._reckoned: float | None = None
        self._place: tuple[float, float] | None = None

    @property
    def value(self) -> float | None:
        """The variation [rad], east positive; None where nobody knows it."""
        if self._configured is not None:
            return self._configured
        return self._reckoned if self._received is None else self._received

    @property
    def origin(self) -> Origin:
        """Who says so."""
        if self._configured is not None:
            return Origin.FILE
        if self._received is not None:
            return Origin.INSTRUMENT
        return Origin.NOBODY if self._reckoned is None else Origin.MODEL

    @property
    def year(self) -> float:
        """The date of the model as a year, such as 2026.9; nan: none is gone by."""
        return float(getattr(self._field, "year", math.nan)) if self.origin is Origin.MODEL else math.nan

    def receive(self, time: float, variation: float, *source: object) -> float:
        """Take what an instrument says [rad] at `time` [s]; return what is believed of it.

        source: what tells it from others; the first of these is who asks for the `alarm`.
        """
        if source and self._jumps_to(time, variation, source):
            variation = self._accepted[source]
        else:
            self._accepted[source] = variation
            self._jumps.pop(source, None)
        if source == self._source or time - self._received_time > SILENT_S:
            self._received, self._source, self._received_time = variation, source, time
        return variation

    def _jumps_to(self, time: float, variation: float, source: tuple[object, ...]) -> bool:
        """Return whether what an instrument says is not to be taken."""
        before = self._accepted.get(source, variation)
        if not abs(wrap(variation - before)) > JUMP or (before == 0.0 and not self._steers):
            return False
        jump = self._jumps.get(source)
        lasts = jump is not None and self._steers is False and abs(wrap(variation - jump.said)) <= JUMP
        since = jump.since if jump is not None and lasts else time
        self._jumps[source] = Jump(before, variation, since, time)
        return variation == 0.0 or time - since < SETTLED_S

    def on_tick(self, now: float, steers: bool) -> None:
        """Take at `now` [s] whether the boat is steered, and forget the jumps of instruments that are silent."""
        self._steers = steers
        for source in [each for each, jump in self._jumps.items() if now - jump.last > SILENT_S]:
            del self._jumps[source]

    def alarm(self, owner: object) -> AlarmEvent | None:
        """Return the alarm of an instrument of `owner`, as `receive` was given it, whose variation has jumped."""
        for source, jump in self._jumps.items():
            if source[0] is owner:
                both = jump.before, jump.said
                said = " to ".join(f"{abs(math.degrees(each)):.1f} {'W' if each < 0.0 else 'E'}" for each in both)
                return AlarmEvent("variation_jumped", said)
        return None

    def steered(self, bearing: float, *, is_magnetic: bool, by_compass: bool) -> float:
        """Return a bearing [rad] as it is steered by, see `steered`; NeedsVariationError where nobody knows it."""
        found = steered(bearing, is_magnetic=is_magnetic, by_compass=by_compass, variation=self.value)
        if found is None:
            raise NeedsVariationError
        return found

    def move(self, latitude: float, longitude: float) -> None:
        """Take where the boat is [rad]."""
        place = self._place
        if self._field is None or (
            place is not None and abs(place[0] - latitude) <= MOVED and abs(wrap(place[1] - longitude)) <= MOVED
        ):
            return
        self._place, self._reckoned = (latitude, longitude), self._field(latitude, longitude)


def known_as(variation: Variation | float | None) -> Variation:
    """Return a variation as it is shared, or one of its own for a number [rad] or None."""
    return variation if isinstance(variation, Variation) else Variation(variation)


def steered(bearing: float, *, is_magnetic: bool, by_compass: bool, variation: float | None) -> float | None:
    """Return a bearing [rad] as it is steered by, None where that takes a variation that nobody knows.

    Args:
        is_magnetic: whether it counts from magnetic north.  by_compass: whether the boat steers magnetic courses.
        variation [rad], east positive: true = magnetic + variation.
    """
    if is_magnetic == by_compass:
        return wrap(bearing)
    if variation is None:
        return None
    return wrap(bearing - variation if by_compass else bearing + variation)


class UnusableHeadings:
    """Notices that a link brings headings, and none that can be steered by. `name`: the link's."""

    def __init__(self, name: str) -> None:
        self._news = AlarmNews(f"{name}, variation")
        self._count = 0
        self._since: float | None = None

    def news(self, now: float, samples: Iterable[Sample], count: int) -> list[Sample]:
        """Return what is to be said at `now` [s]. count: how many headings have been unusable so far."""
        if any(isinstance(sample, HeadingSample) for sample in samples):
            self._since = None
        elif count > self._count and self._since is None:
            self._since = now
        self._count = count
        is_due = self._since is not None and now - self._since >= UNUSABLE_FOR_S
        return self._news.of(now, AlarmEvent("variation_unknown") if is_due else None)


EXTRA = "install Norrbin with its extra field: pip install '.[field]'"
FIRST_YEAR = 2010
DAYS_IN_YEAR = 365.25


@dataclass(frozen=True)
class EarthField:
    """The field at the time `year`, such as 2026.9."""

    year: float
    model: Any = field(compare=False)

    def __call__(self, latitude: float, longitude: float) -> float:
        """Return the variation [rad], east positive, at a latitude and longitude [rad], at sea level."""
        found = self.model.calculate(math.degrees(latitude), math.degrees(longitude), 0.0, self.year)
        return math.radians(found.d)


def earth_field(today: date) -> EarthField:
    """Return the field of the edition that serves `today`. InputError without the package or an edition."""
    try:
        from pygeomag import GeoMag
    except ImportError as error:
        raise InputError(
            f"sensors.earth_field: a model of the earth's field needs the package pygeomag; {EXTRA}"
        ) from error
    year = today.year + (today.timetuple().tm_yday - 1) / DAYS_IN_YEAR
    try:
        if today.year < FIRST_YEAR:
            raise ValueError("no edition")
        model = GeoMag(base_year=year)
        model.calculate(0.0, 0.0, 0.0, year)
    except (ValueError, OSError) as error:
        raise InputError(
            f"sensors.earth_field: no edition of the model serves {today.isoformat()}, this machine's date; set its "
            "clock, update the package pygeomag, or set sensors.variation_deg"
        ) from error
    return EarthField(year, model)
