"""Where a place lies as seen from another, on the WGS 84 ellipsoid's Mercator chart. Pure.

On that chart a straight line is a line of constant true bearing, as charts and ground stations draw a leg, and angles
are true. Its scale is right at the origin and nearly so around it, so that distances [m] are exact where they matter:
at the boat. Snyder, Map Projections: A Working Manual (USGS 1987), equations 7-6 to 7-8 and 15-9.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap

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
