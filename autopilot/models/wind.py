"""Wind: what a boat feels of it, gusts, and the rudder angle its yaw moment is worth."""

from __future__ import annotations

import math
from typing import NamedTuple


class ApparentWind(NamedTuple):
    """How much of the wind over the boat comes from ahead and from starboard [m/s]: V cos(gamma) and V sin(gamma)."""

    ahead: float
    starboard: float

    @property
    def speed(self) -> float:
        """V [m/s]."""
        return math.hypot(self.ahead, self.starboard)

    @property
    def angle(self) -> float:
        """gamma [rad] from the bow to where the wind comes from, positive to starboard."""
        return math.atan2(self.starboard, self.ahead)


class WindLoad(NamedTuple):
    """How the boat answers: rudder equivalent [rad/(m/s)^2] and leeway [-], drift speed per wind speed abeam."""

    rudder_per_speed_squared: float = 0.0
    leeway: float = 0.0


class Gust(NamedTuple):
    """First-order Gauss-Markov gust on the wind speed: standard deviation [m/s] and correlation time [s]."""

    deviation: float = 0.0
    time: float = 10.0


def apparent_wind(
    wind_speed: float, wind_from: float, heading: float, north_speed: float, east_speed: float
) -> ApparentWind:
    """Return the wind felt by a boat that moves with `north_speed` and `east_speed` [m/s] at `heading` [rad].

    `wind_speed` [m/s] is over the ground, `wind_from` [rad] the direction it comes from, clockwise from north.
    """
    north = -wind_speed * math.cos(wind_from) - north_speed
    east = -wind_speed * math.sin(wind_from) - east_speed
    cosine, sine = math.cos(heading), math.sin(heading)
    return ApparentWind(-(north * cosine + east * sine), north * sine - east * cosine)


def rudder_equivalent(load: WindLoad, wind: ApparentWind) -> float:
    """Return the rudder angle [rad] that yaws the boat as the wind does: c V^2 sin(2 gamma).

    The yaw moment of a hull and its superstructure is zero head to wind, abeam and astern and changes sign
    abeam; sin(2 gamma) is its first harmonic (Isherwood 1973 tabulates the rest). c > 0 turns the bow away
    from a wind on the bow, as it does on most power boats.
    """
    return -load.rudder_per_speed_squared * 2.0 * wind.ahead * wind.starboard


def leeway_speed(load: WindLoad, wind: ApparentWind) -> float:
    """Return the sideways drift [m/s], positive to starboard: away from the wind."""
    return -load.leeway * wind.starboard


def gust_step(gust: Gust, value: float, dt: float, deviate: float) -> float:
    """Return the gust [m/s] `dt` [s] later, driven by a standard normal deviate; exact for any dt >= 0."""
    keep = math.exp(-dt / gust.time)
    return keep * value + gust.deviation * math.sqrt(1.0 - keep * keep) * deviate
