"""The path over the ground that a route asks for: straight legs, joined by arcs that the boat can turn. Pure.

An arc of radius R touches both legs, R tan(turn/2) before and after the waypoint. In a current w a boat that goes
through the water with U covers the ground at V = U cos(crab) + w_along, and to turn its track by a radian it must turn
its heading by V/(U cos(crab)): its yaw rate on an arc is V^2/(R U cos(crab)). R is the least with which this stays
within the rate that the identified model turns with, at every course of the corner. So a corner that is turned with the
stream is begun earlier than one against it.

Everything is in metres north and east of one origin; a course is over the ground.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import shortest_turn, wrap

CRAB_MOST = 0.95
"""More of the boat's speed than this is not set against a current across: beyond it hardly any is left along it."""
HELD = 0.9
"""A current across a leg that takes more than this share of the boat's speed is not to be held."""
WAY_LEAST = 0.1
"""Nor is one that leaves less way along the leg than this share of the boat's speed."""
COURSES = 8
"""A corner's radius is worked out at so many courses and one."""
SPEED_LEAST = 0.1
"""A boat slower than this [m/s] is led as if it went so fast."""
TANGENT_MOST = 1.5
"""Half a turn counts as no more than this [rad]: straight back no arc touches both legs."""


class Set(NamedTuple):
    """Current [m/s] to the north and east, and the speed [m/s] of the boat through the water."""

    north: float
    east: float
    speed: float

    def across(self, course: float) -> float:
        """Return what sets the boat to starboard of `course` [rad]."""
        return self.east * math.cos(course) - self.north * math.sin(course)

    def along(self, course: float) -> float:
        """Return what sets it along `course` [rad]."""
        return self.north * math.cos(course) + self.east * math.sin(course)

    def crab(self, course: float) -> float:
        """Return how far [rad] to port of `course` [rad] the boat has to head to make it good."""
        share = self.across(course) / max(self.speed, SPEED_LEAST)
        return math.asin(min(max(share, -CRAB_MOST), CRAB_MOST))

    def way(self, course: float) -> float:
        """Return the speed over the ground [m/s] on `course` [rad]."""
        return max(max(self.speed, SPEED_LEAST) * math.cos(self.crab(course)) + self.along(course), 0.0)

    def rate(self, course: float, curvature: float) -> float:
        """Return the yaw rate [rad/s] that keeps a boat on `course` [rad] to a path of `curvature` [1/m]."""
        through = max(self.speed, SPEED_LEAST) * math.cos(self.crab(course))
        return curvature * self.way(course) ** 2 / through

    def holds(self, course: float) -> bool:
        """Return whether the boat can make `course` [rad] good."""
        return abs(self.across(course)) <= HELD * self.speed and self.way(course) >= WAY_LEAST * self.speed


class Corner(NamedTuple):
    """An arc from course `begin` [rad] through `turn` [rad], to starboard positive, of `radius` [m] about a centre
    [m]; `tangent` [m] before and after the waypoint."""

    begin: float
    turn: float
    radius: float
    tangent: float
    north: float
    east: float

    @property
    def side(self) -> float:
        """1 to starboard, -1 to port."""
        return math.copysign(1.0, self.turn)


def radius_needed(set_: Set, begin: float, turn: float, rate: float) -> float:
    """Return the least radius [m] on which a boat that turns with `rate` [rad/s] keeps to the ground from course
    `begin` [rad] through `turn` [rad]."""
    if not rate < math.inf:
        return 0.0
    return max(set_.rate(begin + turn * place / COURSES, 1.0) for place in range(COURSES + 1)) / rate


def corner_at(
    waypoint: tuple[float, float], begin: float, end: float, radius: float, room: tuple[float, float]
) -> Corner:
    """Return the arc from course `begin` to course `end` [rad] at a `waypoint` [m north, m east].

    radius: [m] that the boat needs; room: least and most [m] that it may be begun before the waypoint. Where the legs
    are too short for the radius it is smaller, and the boat runs wide.
    """
    turn = shortest_turn(begin, end)
    share = math.tan(min(0.5 * abs(turn), TANGENT_MOST))
    least, most = room
    tangent = min(max(radius * share, least), most)
    fits = tangent / share if share > 0.0 else math.inf
    if not 0.0 < fits < STRAIGHT:
        return Corner(begin, 0.0, math.inf, tangent, *waypoint)
    side = math.copysign(1.0, turn)
    north = waypoint[0] - tangent * math.cos(begin) - side * fits * math.sin(begin)
    east = waypoint[1] - tangent * math.sin(begin) + side * fits * math.cos(begin)
    return Corner(begin, turn, fits, tangent, north, east)


STRAIGHT = 1.0e6
"""An arc of a radius like this [m] is straight."""


class Spot(NamedTuple):
    """A spot of the path: course [rad], curvature [1/m], the boat's cross-track error [m] from it, to starboard
    positive."""

    course: float
    curvature: float = 0.0
    cross_track: float = 0.0


def swept(corner: Corner, north: float, east: float) -> float:
    """Return through how much of a corner's turn [rad] a boat at this place [m] has gone; negative before it."""
    outwards = math.atan2(east - corner.east, north - corner.north)
    course = outwards + corner.side * 0.5 * math.pi
    return corner.side * wrap(course - corner.begin)


def on_arc(corner: Corner, north: float, east: float, gone: float) -> Spot:
    """Return the spot of a corner beside the boat at this place [m], `gone` [rad] through its turn."""
    off = corner.radius - math.hypot(north - corner.north, east - corner.east)
    course = wrap(corner.begin + corner.side * gone)
    return Spot(course, corner.side / corner.radius, corner.side * off)
