"""Steering by the wind: the heading that keeps the apparent wind at the angle it had when the hold began. Pure.

What is smoothed is where the apparent wind comes from over the compass, the boat's heading and the vane's angle added:
the boat's own yaw drops out of it, so that the slow filter is not in the heading loop. The heading ordered is that
bearing less the angle held. A wind that was lost leads nobody again by itself: the heading stays till the skipper asks.
"""

from __future__ import annotations

import math

from autopilot.angles import compass_deg, shortest_turn, wrap
from autopilot.signals import AlarmEvent, WindSample

FRESH_S = 5.0
"""A wind older than this leads nobody."""
SMOOTHING_S = 5.0
WIND_LEAST = 0.5
"""In less apparent wind [m/s] than this a vane points anywhere."""
SHIFT = math.radians(30.0)
"""A wind that leads the boat this far from where it went when the hold began is reported."""


class WindGuide:
    """What the wind wants, as a heading. Memory: the wind, the angle held, the heading ordered last.

    Attributes:
        following: whether it leads.  alarm: what the skipper must know, None while all is well.
    """

    def __init__(self) -> None:
        self._time = -math.inf
        self._north = self._east = 0.0
        self.alarm: AlarmEvent | None = None
        self.leave()

    def on_sample(self, sample: WindSample, heading: float) -> None:
        """Take a wind, heard with the boat on `heading` [rad]; calms and what is not finite are none."""
        bearing = heading + sample.angle
        if not (math.isfinite(sample.time) and math.isfinite(bearing) and sample.speed >= WIND_LEAST):
            return
        north, east = math.cos(bearing), math.sin(bearing)
        passed = sample.time - self._time
        if 0.0 <= passed <= FRESH_S:
            share = -math.expm1(-passed / SMOOTHING_S)
            north, east = self._north + share * (north - self._north), self._east + share * (east - self._east)
        self._time, self._north, self._east = sample.time, north, east

    def is_known(self, now: float) -> bool:
        """Return whether there is a wind at `now` [s]."""
        return abs(now - self._time) <= FRESH_S

    def follow(self) -> None:
        """Begin to hold the angle that the wind has when the next course is asked for."""
        self.leave()
        self.following = True

    def wait(self) -> None:
        """Say that the hold waits for a wind."""
        self.leave()
        self.alarm = AlarmEvent("wind_awaited")

    def leave(self) -> None:
        """Lead no longer."""
        self.following = False
        self.alarm = None
        self._angle: float | None = None
        self._began = self._held = 0.0
        self._is_lost = False

    def course(self, now: float, heading: float, speed: float) -> float:
        """Return the heading [rad] to steer at `now` [s], with the boat on `heading` [rad]; `speed` [m/s] is not asked.

        Without a wind it is the one ordered last, and `alarm` says so, until `follow` is called again.
        """
        bearing = math.atan2(self._east, self._north)
        if self._angle is None:
            self._began = self._held = heading
            self._angle = wrap(bearing - heading)
        self._is_lost = self._is_lost or not self.is_known(now)
        if self._is_lost:
            self.alarm = AlarmEvent("wind_lost", f"holding {compass_deg(self._held):05.1f} deg")
            return self._held
        self._held = wrap(bearing - self._angle)
        shifted = abs(shortest_turn(self._began, self._held)) > SHIFT
        self.alarm = AlarmEvent("wind_shifted", f"{math.degrees(SHIFT):.0f} deg") if shifted else None
        return self._held
