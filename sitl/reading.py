"""One set of measured values, as it leaves the sensors."""

from __future__ import annotations

from typing import NamedTuple

EARTH_RADIUS = 6371008.8
"""Mean radius [m], IUGG."""


class Reading(NamedTuple):
    """One set of measured values and when they were measured, `time` [s] since the start.

    heading [rad] in [0, 2 pi), true; rate [rad/s]; roll [rad]; roll_rate [rad/s]; rudder [rad]; water_speed,
    ground_speed [m/s]; course [rad] over the ground; latitude, longitude [deg]; north_speed, east_speed [m/s].
    """

    time: float
    heading: float
    rate: float
    roll: float
    roll_rate: float
    rudder: float
    water_speed: float
    ground_speed: float
    course: float
    latitude: float
    longitude: float
    north_speed: float
    east_speed: float
