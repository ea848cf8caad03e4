"""Following a route of waypoints by line of sight: the course to steer, when the next leg begins, what is wrong. Pure.

A leg is the rhumb line between two waypoints; the first one begins where the boat is when following begins. A waypoint
is passed inside its circle, at the place where the turn into the next leg has to begin (R tan(turn/2) before it, R the
radius the boat turns with), or at the line through it across the leg. At the end of the route the last leg's course is
held, corrected for the drift that was learnt. Without a position, or after one that the boat cannot have reached, the
course steered last is held.

Line-of-sight guidance along a straight leg, with integral action against a current. Pure.

    psi_d = chi - atan((y + sigma y_i) / Delta),   y_i' = Delta y / (Delta^2 + (y + sigma y_i)^2)

with the leg's bearing chi, the cross-track error y (positive with the boat to starboard of the leg) and the look-ahead
distance Delta. The integral takes out the drift of current and leeway, and cannot wind up far off the track. About the
leg it is y'' + (U/Delta) y' + DRIFT_SHARE (U/Delta)^2 y = 0, damping 0.9. Source: Borhaug, Pavlov and Pettersen 2008,
"Integral LOS control for path following of underactuated marine surface vessels in the presence of constant ocean
currents", eq. (7).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from autopilot.angles import compass_deg, shortest_turn, wrap
from autopilot.guidance.fix import Fix, Place, bearing_and_distance, offset
from autopilot.signals import AlarmEvent, PositionSample

DRIFT_SHARE = 0.3
"""sigma [m/s] as a share of the speed U: how fast the integral works."""
LOOKAHEAD_LEAST = 15.0
LOOKAHEAD_S = 10.0
"""Delta is at least this far [m], and as far as the boat goes in this time [s]."""


def line_of_sight(
    track: float, cross_track: float, drift: float, ahead: float, speed: float, dt: float
) -> tuple[float, float]:
    """Return the course [rad] that leads along a leg, and the integral sigma y_i [m] after `dt` [s].

    Args:
        track: the leg's true bearing [rad].  cross_track: y [m].  drift: sigma y_i [m] so far.
        ahead: Delta [m].  speed: U [m/s], of any sign.
    """
    bent = cross_track + drift
    drift += DRIFT_SHARE * abs(speed) * dt * ahead * cross_track / (ahead * ahead + bent * bent)
    # beyond a look-ahead distance it would be a course across the track, not a correction for drift
    drift = min(max(drift, -ahead), ahead)
    return wrap(track - math.atan2(cross_track + drift, ahead)), drift


DT_MOST = 2.0
SHORTEST_LEG = 1.0
"""A leg shorter than this [m] has no bearing: its end counts as reached."""
WHEEL_OVER_MOST = 2.0
"""A turn is begun no further before its waypoint than this many turning radii."""
SET_KEPT_S = 1800.0
"""The current that was learnt counts for this long [s] when a route is begun anew."""
SET_MOST = 0.7
"""No more current is expected than this share of the boat's speed."""
SPEED_LEAST = 0.5
"""Below this speed [m/s] nothing is learnt of the current, nor expected."""
ALARM_OFF = 0.8
"""The cross-track alarm ends inside this share of its limit."""


class Waypoint(NamedTuple):
    """A place [rad] that is reached within `radius` [m]; nan: within the radius of the settings."""

    latitude: float
    longitude: float
    radius: float = math.nan

    @property
    def place(self) -> Place:
        """Where it lies."""
        return Place(self.latitude, self.longitude)


class TrackSettings(NamedTuple):
    """lookahead [s] of way; radius [m] within which a waypoint is reached; turn_radius [m] of the boat at work, and
    turn_reach [m] that it goes before it turns; alarm_distance [m] off the track; position_timeout [s] after which a
    lost position is an alarm; magnetic: the boat steers magnetic courses, and no route can lead it."""

    lookahead: float = LOOKAHEAD_S
    radius: float = 10.0
    turn_radius: float = 0.0
    turn_reach: float = 0.0
    alarm_distance: float = 50.0
    position_timeout: float = 5.0
    magnetic: bool = False


class Leg(NamedTuple):
    """The leg as seen from the boat: bearing [rad], cross_track [m] positive with the boat to starboard, remaining [m]
    to the line across its end, distance [m] and bearing `target` [rad] of its end, length [m]."""

    bearing: float
    cross_track: float
    remaining: float
    distance: float
    target: float
    length: float


class TrackGuide:
    """Leads along a route. Memory: the leg, the newest position, the integral.

    Attributes:
        following: whether it leads.  route: the waypoints.  target: the one the present leg ends at.
        is_complete: the last one has been passed.  passed: how many have been passed since `follow`, and
        last_passed which one was the last of them.  leg: as steered now, None without a position or after the end.
        alarm: what the skipper must know, None when all is well.
    """

    def __init__(self, settings: TrackSettings = TrackSettings()) -> None:  # noqa: B008 - a tuple, never changed
        self.settings = settings
        self.fix = Fix()
        self.route: tuple[Waypoint, ...] = ()
        self.target = 0
        self.passed = 0
        self.last_passed = 0
        self._ending = ""
        self._speed = 0.0
        self._now: float | None = None
        self._set = (0.0, 0.0)
        self._set_at = -math.inf
        self.leg: Leg | None = None
        self._drift = 0.0
        self.leave()

    def follow(self, route: Sequence[Waypoint], target: int = 0, ending: str = "route_ended") -> None:
        """Begin to lead along `route`, from where the boat is to the waypoint `target`; `ending` names the alarm at its
        end.

        ValueError where there is no such waypoint.
        """
        if not 0 <= target < len(route):
            raise ValueError(f"track: there is no waypoint {target} in a route of {len(route)}")
        self.leave()
        self.fix.accept()
        self.route, self.target = tuple(route), target
        self.following = True
        self._ending = ending

    def leave(self) -> None:
        """Lead no longer."""
        self._remember()
        self.following = self.is_complete = self._is_off = False
        self.alarm: AlarmEvent | None = None
        self.leg = None
        self._start: Place | None = None
        self._held: float | None = None
        self._drift = 0.0
        self._began: float | None = None

    def take(self, sample: PositionSample) -> None:
        """Take where the boat is; a jump counts where no route is followed, or when the next one is begun."""
        self.fix.take(sample, self._speed)
        if not self.following:
            self.fix.accept()

    def course(self, now: float, heading: float, speed: float) -> float:
        """Return the course [rad] to steer at `now` [s], with the boat on `heading` [rad] at `speed` [m/s]."""
        dt = 0.0 if self._now is None else min(max(now - self._now, 0.0), DT_MOST)
        self._now, self._speed = now, speed
        if self._began is None:
            self._began = now
        self.leg = None
        if self.following and not self.is_complete and self.fix.is_fresh(now) and self.fix.jump == 0.0:
            if self._start is None:
                self._begin(now)
            self._held = self._along(now, heading, speed, dt)
        elif self._held is None:
            self._held = heading
        self.alarm = self._event(now)
        return self._held

    def _begin(self, now: float) -> None:
        """Begin the first leg where the boat is, in the current as far as it is known from before."""
        self._start = self.fix.place
        if now - self._set_at > SET_KEPT_S:
            self._set = (0.0, 0.0)
        bearing, _ = bearing_and_distance(self._start, self.route[self.target].place)
        self._drift = self._expected(bearing)

    def _remember(self) -> None:
        """Keep what the leg has taught of the current: the part across it, beside what others taught of the rest."""
        if self.leg is None or self._now is None or abs(self._speed) < SPEED_LEAST:
            return
        north, east = -math.sin(self.leg.bearing), math.cos(self.leg.bearing)
        across = abs(self._speed) * self._drift / math.hypot(self.look_ahead(self._speed), self._drift)
        more = across - (self._set[0] * north + self._set[1] * east)
        self._set = (self._set[0] + more * north, self._set[1] + more * east)
        self._set_at = self._now

    def _expected(self, bearing: float) -> float:
        """Return the integral [m] that the current, as far as it is known, will need on a leg of `bearing` [rad]."""
        if abs(self._speed) < SPEED_LEAST:
            return 0.0
        across = self._set[1] * math.cos(bearing) - self._set[0] * math.sin(bearing)
        share = min(max(across / abs(self._speed), -SET_MOST), SET_MOST)
        return self.look_ahead(self._speed) * share / math.sqrt(1.0 - share * share)

    def look_ahead(self, speed: float) -> float:
        """Return Delta [m] at `speed` [m/s]."""
        settings = self.settings
        return max(LOOKAHEAD_LEAST, settings.lookahead * abs(speed), settings.turn_radius)

    def _along(self, now: float, heading: float, speed: float, dt: float) -> float:
        """Return the course along the leg, and go on to the next one where this one's end is reached."""
        before = self._held if self._held is not None else heading
        ahead = self.look_ahead(speed)
        age = self.fix.age(now)
        # since its position was measured the boat has gone by its heading, and across by the current that was learnt
        gone = (speed * age * math.cos(heading), speed * age * math.sin(heading))
        aside = speed * age * self._drift / math.hypot(ahead, self._drift)
        leg = self._leg_seen(gone, aside, before)
        if self._is_reached(leg):
            self.last_passed, self.passed = self.target, self.passed + 1
            if self.target + 1 == len(self.route):
                self.is_complete = True
                return wrap(leg.bearing - math.atan2(self._drift, ahead))
            self.leg = leg
            self._remember()
            self._start, self.target = self.route[self.target].place, self.target + 1
            leg = self._leg_seen(gone, aside, leg.bearing)
            self._drift = self._expected(leg.bearing)
        self.leg = leg
        course, self._drift = line_of_sight(leg.bearing, leg.cross_track, self._drift, ahead, speed, dt)
        return course

    def _leg_seen(self, gone: tuple[float, float], aside: float, bearing: float) -> Leg:
        """Return the leg from the boat, `gone` and `aside` [m] from its fix; `bearing` [rad] for a leg of no length."""
        origin = self.fix.place
        start_north, start_east = offset(origin, self._start or origin)
        end_north, end_east = offset(origin, self.route[self.target].place)
        length = math.hypot(end_north - start_north, end_east - start_east)
        if length >= SHORTEST_LEG:
            bearing = math.atan2(end_east - start_east, end_north - start_north)
        north, east = math.cos(bearing), math.sin(bearing)
        to_north, to_east = end_north - gone[0], end_east - gone[1]
        return Leg(
            bearing=bearing,
            cross_track=to_north * east - to_east * north + aside,
            remaining=to_north * north + to_east * east,
            distance=math.hypot(to_north, to_east),
            target=math.atan2(to_east, to_north),
            length=length,
        )

    def _is_reached(self, leg: Leg) -> bool:
        own = self.route[self.target].radius
        radius = own if own > 0.0 else self.settings.radius
        if leg.length < SHORTEST_LEG or leg.distance <= radius:
            return True
        return leg.remaining <= self._wheel_over(leg)

    def _wheel_over(self, leg: Leg) -> float:
        """Return how far [m] before the waypoint the turn into the next leg has to begin; 0 at the last one."""
        if self.target + 1 == len(self.route):
            return 0.0
        bearing, length = bearing_and_distance(self.route[self.target].place, self.route[self.target + 1].place)
        turn = abs(shortest_turn(leg.bearing, bearing))
        settings = self.settings
        tangent = math.tan(min(0.5 * turn, 1.5))
        way = settings.turn_radius * min(tangent, WHEEL_OVER_MOST) + settings.turn_reach * min(tangent, 1.0)
        return min(way, 0.5 * length, 0.5 * leg.length)

    def _event(self, now: float) -> AlarmEvent | None:
        held = f"holding {compass_deg(self._held or 0.0):05.1f} deg"
        if self.is_complete:
            return AlarmEvent(self._ending, held)
        if not self.following:
            return None
        if self.fix.jump > 0.0:
            return AlarmEvent("position_jumped", f"{self.fix.jump:.0f} m, the route is not followed: {held}")
        if self.leg is None:
            since = max(self._began or 0.0, self.fix.newest.time if self.fix.newest is not None else -math.inf)
            if now - since <= self.settings.position_timeout:
                return self.alarm
            return AlarmEvent("position_lost", held)
        limit = self.settings.alarm_distance
        self._is_off = abs(self.leg.cross_track) > (ALARM_OFF * limit if self._is_off else limit)
        if not self._is_off:
            return None
        side = "starboard" if self.leg.cross_track > 0.0 else "port"
        return AlarmEvent("off_track", f"{limit:g} m to {side}")
