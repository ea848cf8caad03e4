"""Places on the ellipsoid's Mercator chart, against figures of other sources and another way of working them out."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import wrap
from autopilot.guidance.current import Fix, Place, bearing_and_distance, offset
from autopilot.signals import PositionSample

A, F = 6378137.0, 1.0 / 298.257223563


def place(latitude_deg: float, longitude_deg: float) -> Place:
    return Place(math.radians(latitude_deg), math.radians(longitude_deg))


def earth_centred(where: Place) -> tuple[float, float, float]:
    e2 = F * (2.0 - F)
    n = A / math.sqrt(1.0 - e2 * math.sin(where.latitude) ** 2)
    across = n * math.cos(where.latitude)
    return across * math.cos(where.longitude), across * math.sin(where.longitude), n * (1.0 - e2) * math.sin(where[0])


def tangent_plane(origin: Place, where: Place) -> tuple[float, float]:
    """North and east in the plane that touches the ellipsoid at `origin`."""
    dx, dy, dz = (b - a for a, b in zip(earth_centred(origin), earth_centred(where), strict=True))
    sin_lat, cos_lat = math.sin(origin.latitude), math.cos(origin.latitude)
    sin_lon, cos_lon = math.sin(origin.longitude), math.cos(origin.longitude)
    return -sin_lat * (cos_lon * dx + sin_lon * dy) + cos_lat * dz, cos_lon * dy - sin_lon * dx


@given(st.floats(-70.0, 70.0), st.floats(-180.0, 180.0), st.floats(-0.02, 0.02), st.floats(-0.02, 0.02))
def test_near_by_it_agrees_with_the_plane_that_touches_the_earth(
    latitude: float, longitude: float, north: float, east: float
) -> None:
    origin, there = place(latitude, longitude), place(latitude + north, longitude + east)
    ours, theirs = offset(origin, there), tangent_plane(origin, there)
    distance = math.hypot(*theirs)
    # the chart's scale grows by tan(latitude) for each earth radius northward
    assert math.dist(ours, theirs) <= 0.001 + 3.0 * distance * distance / A


def test_a_minute_of_latitude_is_as_long_as_the_tables_say() -> None:
    """1842.9 m at the equator, 1861.6 m at the poles: Bowditch, American Practical Navigator, length of a minute."""
    assert offset(place(0.0, 0.0), place(1.0 / 60.0, 0.0))[0] == pytest.approx(1842.9, abs=0.1)
    assert offset(place(80.0, 0.0), place(80.0 + 1.0 / 6000.0, 0.0))[0] * 100.0 == pytest.approx(1861.0, abs=0.5)


def test_a_leg_across_the_date_line_is_short() -> None:
    bearing, distance = bearing_and_distance(place(-17.0, 179.99), place(-17.0, -179.99))
    assert math.degrees(bearing) == pytest.approx(90.0)
    assert distance == pytest.approx(2130.0, abs=2.0)


@given(st.floats(-60.0, 60.0), st.floats(-60.0, 60.0), st.floats(-2.0, 2.0), st.floats(-2.0, 2.0))
def test_the_bearing_is_the_same_from_both_ends_however_long_the_leg(
    latitude: float, longitude: float, north: float, east: float
) -> None:
    one, other = place(latitude, longitude), place(latitude + north, longitude + east)
    forth, distance = bearing_and_distance(one, other)
    back, _ = bearing_and_distance(other, one)
    if distance > 1.0:
        assert abs(wrap(forth - back - math.pi)) < 1.0e-6


@pytest.mark.parametrize("latitude", [86.0, 89.0, -89.0])
def test_a_boat_near_a_pole_moves_on_the_chart_as_on_the_earth(latitude: float) -> None:
    origin, there = place(latitude, 179.999), place(latitude + 0.001, -179.999)
    ours, theirs = offset(origin, there), tangent_plane(origin, there)
    assert ours == pytest.approx(theirs, rel=2.0e-3, abs=0.2)


def test_a_position_at_a_pole_leads_nobody() -> None:
    fix = Fix()
    for latitude in (90.0, -89.95, math.nan, math.inf):
        fix.take(PositionSample(1.0, math.radians(latitude), 0.0), 3.0)
    assert fix.newest is None
