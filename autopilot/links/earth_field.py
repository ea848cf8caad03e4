"""The magnetic variation by a model of the earth's field, the World Magnetic Model, at a place and a date.

Needs the extra `field`: the package pygeomag has the model's equations and coefficients. Source: NOAA and BGS, "The
US/UK World Magnetic Model for 2025-2030"; each edition serves five years. What is local, iron in the ground and on
board, is not in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from datetime import date
from typing import Any

from autopilot.errors import InputError

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
