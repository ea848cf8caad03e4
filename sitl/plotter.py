"""A simulated chart plotter: a route, and APB, RMB, XTE and HTD about the leg being sailed.

It knows the boat's position from the GPS, as a plotter does, and switches to the next leg within `ARRIVAL_M` of the
waypoint or once abeam of it. Field layouts: IEC 61162-1 as tabulated in E. S. Raymond, "NMEA Revealed".
"""

from __future__ import annotations

import math

from autopilot.links.nmea.sentences import format_sentence
from sitl.boat import EARTH_RADIUS
from sitl.scenario import Scenario
from sitl.sensors import Reading

ARRIVAL_M = 20.0
MILE = 1852.0
TALKER = "EC"
DECIMALS = 3
"""Of the cross-track error in nautical miles: 1.85 m."""


class ChartPlotter:
    """Follows the scenario's route; leg n leads from waypoint n to waypoint n + 1."""

    def __init__(self, scenario: Scenario) -> None:
        self._start = scenario.start
        # a route of one waypoint leads there from the start
        self._route = scenario.route if len(scenario.route) > 1 else ((0.0, 0.0), *scenario.route)
        self._leg = 0

    @property
    def is_over(self) -> bool:
        """Whether the last waypoint has been passed."""
        return self._leg + 1 >= len(self._route)

    def update(self, reading: Reading) -> None:
        """Take the newest position and switch legs."""
        north, east = self._position(reading)
        while not self.is_over:
            along, _, length = self._along(north, east)
            end_north, end_east = self._route[self._leg + 1]
            if along < length and math.hypot(north - end_north, east - end_east) > ARRIVAL_M:
                return
            self._leg += 1

    def sentence(self, kind: str, reading: Reading) -> bytes:
        """Return the sentence of `kind`; status V where the route is over."""
        if self.is_over:
            return format_sentence(TALKER, kind, ["V"] * (2 if kind != "HTD" else 1))
        fields = {"APB": self._apb, "RMB": self._rmb, "XTE": self._xte, "HTD": self._htd}[kind](reading)
        return format_sentence(TALKER, kind, fields)

    def _position(self, reading: Reading) -> tuple[float, float]:
        north = math.radians(reading.latitude - self._start.latitude_deg) * EARTH_RADIUS
        parallel = EARTH_RADIUS * math.cos(math.radians(self._start.latitude_deg))
        return north, math.radians(reading.longitude - self._start.longitude_deg) * parallel

    def _along(self, north: float, east: float) -> tuple[float, float, float]:
        """Distance along the leg, to starboard of it, and its length [m]."""
        (from_north, from_east), (to_north, to_east) = self._route[self._leg], self._route[self._leg + 1]
        d_north, d_east = to_north - from_north, to_east - from_east
        length = math.hypot(d_north, d_east)
        a, b = north - from_north, east - from_east
        return (a * d_north + b * d_east) / length, (b * d_north - a * d_east) / length, length

    def _bearings(self, reading: Reading) -> tuple[float, float, float, float]:
        """Bearing of the leg and of the waypoint [deg], its distance and the error to starboard [m]."""
        north, east = self._position(reading)
        (from_north, from_east), (to_north, to_east) = self._route[self._leg], self._route[self._leg + 1]
        track = math.degrees(math.atan2(to_east - from_east, to_north - from_north)) % 360.0
        bearing = math.degrees(math.atan2(to_east - east, to_north - north)) % 360.0
        return track, bearing, math.hypot(to_north - north, to_east - east), self._along(north, east)[1]

    def _error(self, starboard: float) -> list[str]:
        return [f"{abs(starboard) / MILE:.{DECIMALS}f}", "L" if starboard > 0.0 else "R"]

    def _apb(self, reading: Reading) -> list[str]:
        track, bearing, _, error = self._bearings(reading)
        to = f"WP{self._leg + 1}"
        ahead = [f"{bearing:.1f}", "T"]
        return ["A", "A", *self._error(error), "N", "V", "V", f"{track:.1f}", "T", to, *ahead, *ahead, "A"]

    def _xte(self, reading: Reading) -> list[str]:
        return ["A", "A", *self._error(self._bearings(reading)[3]), "N", "A"]

    def _rmb(self, reading: Reading) -> list[str]:
        _, bearing, distance, error = self._bearings(reading)
        names = [f"WP{self._leg}", f"WP{self._leg + 1}"]
        return [
            "A",
            *self._error(error),
            *names,
            "",
            "",
            "",
            "",
            f"{distance / MILE:.3f}",
            f"{bearing:.1f}",
            "",
            "V",
            "A",
        ]

    def _htd(self, reading: Reading) -> list[str]:
        bearing = self._bearings(reading)[1]
        return ["V", "", "", "H", "N", "", "", "", "", f"{bearing:.1f}", "", "", "T", "A", "A", "A", ""]
