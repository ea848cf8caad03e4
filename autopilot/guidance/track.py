"""Following a route of waypoints on rails: the heading to steer, when the next leg begins, what is wrong. Pure.

A leg is the rhumb line between two waypoints; the first one begins where the boat is when following begins. Legs are
joined by arcs over the ground that the identified model can turn in the current that is, and the boat is led
along legs and arcs alike:

    psi = chi(s + V lead) - atan(y/Delta) - crab + d r_/U

with the path's course chi as far ahead as the planned turn runs behind an order, the cross-track error y (positive with
the boat to starboard), the look-ahead distance Delta, the crab angle against the current and the drift of a turn, both
from the filter of `current`. The order moves smoothly through a corner: a waypoint that is passed moves no heading.
At the end of the route the last leg's course is held, corrected for the current. Without a position, or after one that
the boat cannot have reached, the heading steered last is held. Where the current is more than the boat can hold on this
leg or a later one, an alarm says so as soon as it is known.

Line of sight with Delta: Borhaug, Pavlov and Pettersen 2008; the estimated current takes the place of their integral.

An arc of radius R touches both legs, R tan(turn/2) before and after the waypoint. In a current w a boat that goes
through the water with U covers the ground at V = U cos(crab) + w_along, and to turn its track by a radian it must turn
its heading by V/(U cos(crab)): its yaw rate on an arc is V^2/(R U cos(crab)). R is the least with which this stays
within the rate that the identified model turns with, at every course of the corner. So a corner that is turned with the
stream is begun earlier than one against it.

Everything is in metres north and east of one origin; a course is over the ground.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from autopilot.angles import compass_text, shortest_turn, wrap
from autopilot.guidance import current
from autopilot.guidance.current import CurrentFilter, CurrentSettings, Fix, Place, bearing_and_distance, offset
from autopilot.models.steering_gear import clip
from autopilot.signals import AlarmEvent, CourseSample, PositionSample, SpeedSample

CRAB_MOST = 0.95
"""More of the boat's speed than this is not set against a current across: beyond it hardly any is left along it."""
HELD = 0.9
"""A current across a leg that takes more than this share of the boat's speed is not to be held."""
WAY_LEAST = 0.1
"""Nor is one that leaves less way along the leg than this share of the boat's speed."""
COURSES = 8
"""A corner's radius is worked out at so many courses and one."""
TANGENT_MOST = 1.5
"""Half a turn counts as no more than this [rad]: straight back no arc touches both legs."""


class Set(NamedTuple):
    """Current [m/s] to the north and east, and the speed [m/s] of the boat through the water."""

    north: float
    east: float
    speed: float

    def judged(self, stands: bool) -> Set:
        """Return the set by which an alarm begins, and one that `stands` already ends: with as much to spare."""
        return Set(self.north / ALARM_OFF, self.east / ALARM_OFF, self.speed) if stands else self

    def in_words(self) -> str:
        """Return how strong the current is, and the boat beside it."""
        return f"{math.hypot(self.north, self.east):.1f} m/s of current, the boat does {self.speed:.1f} m/s"

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


LOOKAHEAD_S = 4.0
"""Delta is as far as the boat goes in this time [s] where the vessel file names none."""
LEADS_AHEAD = 3.0
"""And no less than the way over the ground in so many `lead`s: the loop about the leg is damped by 0.87 then."""
LEADS_AHEAD_SLUGGISH = 6.0
"""The same of a boat that is not course-stable, or whose T is more than SLUGGISH leads: a turn of such a boat that is
reversed runs two to four leads behind its order. At 3 the loop swings."""
SLUGGISH = 3.0
LOOKAHEAD_LEAST = 1.0
"""Delta is never less than this [m]."""
SHORTEST_LEG = 1.0
"""A leg shorter than this [m] has no bearing: its end counts as reached."""
WHEEL_OVER_MOST = 2.0
"""A turn is begun no further before its waypoint than this many radii; sharper ones run wide."""
SETTLED_S = 2.0
"""A corner's arc stands fast from so long [s] before its turn is ordered."""
SET_SURE = 0.15
"""The current is known well enough to warn where its standard deviation is below this share of the boat's speed."""
STRONG_S = 15.0
"""For so long [s] the current must have been too strong: a boat that comes out of a turn goes slowly."""
SLIP_MOST = 0.5
"""No turn is taken to drift by more than this [rad]."""
SPEED_LEAST = 0.1
"""A boat slower than this [m/s] is led as if it went so fast."""
LOG_FRESH_S = 3.0
"""A speed through the water counts for so long [s]."""
TOGETHER_S = 0.3
"""Course and speed over the ground no further apart than this [s] belong together."""
DT_MOST = 2.0
"""A longer silence between two calls [s] counts as this much."""
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
    """lookahead [s] of way; radius [m] within which a waypoint is reached; turn_radius [m] of the boat at work, through
    the water, and the `lead` [s] by which an ordered heading has to run ahead of it in a turn; speed [m/s] at work,
    and sway_time [s] in which drift follows a turn; alarm_distance [m] off the track; position_timeout [s] after which
    a lost position is an alarm; magnetic: the boat steers magnetic courses, and no route can lead it; variation [rad],
    east positive, not a number where the file has none; leads_ahead: the look-ahead in leads, at least."""

    lookahead: float = LOOKAHEAD_S
    radius: float = 10.0
    turn_radius: float = 0.0
    lead: float = 0.0
    speed: float = 3.0
    sway_time: float = 1.0
    alarm_distance: float = 50.0
    position_timeout: float = 5.0
    magnetic: bool = False
    leads_ahead: float = LEADS_AHEAD


class Leg(NamedTuple):
    """The leg as seen from the boat: bearing [rad], cross_track [m] from the path, arcs included, positive with the
    boat to starboard, remaining [m] to the line across its end, distance [m] and bearing `target` [rad] of its end,
    length [m]."""

    bearing: float
    cross_track: float
    remaining: float
    distance: float
    target: float
    length: float


class TrackGuide:
    """Leads along a route. Memory: the leg, the corners before and behind, the filter of position and current.

    Attributes:
        following: whether it leads.  route: the waypoints.  target: the one the present leg ends at.
        is_complete: the last one has been passed.  passed: how many have been passed since `follow`, and
        last_passed which one was the last of them.  leg: as steered now, None without a position or after the end.
        alarm: what the skipper must know, None when all is well.  known: what is known of position and current.
        start: where the present leg begins.  behind: the arc that leads onto it, None once it has been sailed.
    """

    def __init__(self, settings: TrackSettings = TrackSettings()) -> None:  # noqa: B008 - a tuple, never changed
        self.settings = settings
        self.fix = Fix()
        self.route: tuple[Waypoint, ...] = ()
        self.target = 0
        self.passed = 0
        self.last_passed = 0
        self.known: CurrentFilter | None = None
        self._ending = ""
        self._speed = 0.0
        self._now: float | None = None
        self._fused: PositionSample | None = None
        self._over_ground: SpeedSample | None = None
        self._velocity: tuple[float, float] | None = None
        self._log_time = self._ground_time = -math.inf
        self.leg: Leg | None = None
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
        if self.known is not None and self.fix.newest is not None:
            self.known = current.placed_anew(self.known, self.fix.place)
        self.route, self.target = tuple(route), target
        self.following = True
        self._ending = ending

    def leave(self) -> None:
        """Lead no longer."""
        self.following = self.is_complete = self._is_off = False
        self.alarm: AlarmEvent | None = None
        self.leg = None
        self.start: Place | None = None
        self._held: float | None = None
        self._began: float | None = None
        self._led_at = 0.0
        self._strong_since = math.inf if self._now is None else self._now
        self.behind: Corner | None = None
        self._ahead: Corner | None = None
        self._charted: Place | None = None
        self._drift_rate = 0.0
        self._cannot: tuple[int, str] | None = None

    def take(self, sample: PositionSample | SpeedSample | CourseSample) -> None:
        """Take where the boat is, or how it goes; a position that has jumped counts where no route is followed, or
        when the next one is begun."""
        if isinstance(sample, PositionSample):
            self.fix.take(sample, self._speed)
            if not self.following:
                self.fix.accept()
        elif isinstance(sample, CourseSample):
            speed = self._over_ground
            if speed is not None and abs(sample.time - speed.time) <= TOGETHER_S:
                self._velocity = sample.course, speed.speed
        elif sample.over_ground:
            self._over_ground, self._ground_time = sample, sample.time
        else:
            self._log_time = sample.time

    def move(self, now: float, heading: float, speed: float) -> None:
        """Go on to `now` [s], with the boat on `heading` [rad] at `speed` [m/s]: through the water, unless nothing but
        speeds over the ground have come of late."""
        if self._now == now and self.fix.newest is self._fused:
            return
        settings = CurrentSettings(max(self.settings.speed, SPEED_LEAST), max(self.settings.sway_time, 1.0e-3))
        self._now, self._speed = now, speed
        newest = self.fix.newest
        if newest is None:
            return
        if self.known is None:
            self.known, self._fused = current.first_filter(settings, self.fix.place), newest
        has_log = now - self._log_time <= LOG_FRESH_S or not now - self._ground_time <= LOG_FRESH_S
        through = speed if has_log else settings.speed
        self.known = current.moved(settings, self.known, now, heading, through, has_log=has_log)
        if newest is not self._fused:
            self.known, self._fused = current.fixed(settings, self.known, self.fix.place, self.fix.age(now)), newest
        if self._velocity is not None:
            self.known = current.with_velocity(settings, self.known, *self._velocity)
            self._velocity = None

    def stream(self, now: float) -> Set | None:
        """Return the current, and the speed through it, as far as it is known well enough at `now` [s]; of a boat that
        steers by magnetic headings nothing is."""
        known = self.known
        if known is None or not self.fix.is_fresh(now) or self.settings.magnetic:
            return None
        through = abs(known.through_water)
        return Set(*known.set, through) if known.set_doubt <= SET_SURE * through else None

    def course(self, now: float, heading: float, speed: float) -> float:
        """Return the heading [rad] to steer at `now` [s], with the boat on `heading` [rad] at `speed` [m/s]."""
        self.move(now, heading, speed)
        if self._began is None:
            self._began = self._led_at = now
        dt, self._led_at = min(max(now - self._led_at, 0.0), DT_MOST), now
        self.leg = None
        known = self.known
        if self.following and not self.is_complete and self.fix.is_fresh(now) and self.fix.jump == 0.0 and known:
            if self.start is None:
                self.start = self.fix.place
            self._held = self._along(known, heading, dt)
        elif self._held is None:
            self._held = heading
        self.alarm = self._event(now)
        return self._held

    def look_ahead(self, way: float) -> float:
        """Return Delta [m] at `way` [m/s] over the ground."""
        settings = self.settings
        return max(LOOKAHEAD_LEAST, settings.lookahead * settings.speed, settings.leads_ahead * settings.lead * way)

    def _along(self, known: CurrentFilter, heading: float, dt: float) -> float:
        """Return the heading along the path, and go on to the next leg where this one's end is reached."""
        set_ = Set(*known.set, max(abs(known.through_water), SPEED_LEAST))
        self._keep_charted(known)
        leg = self._leg_seen(known, self._held if self._held is not None else heading)
        if self._is_reached(leg):
            self.last_passed, self.passed = self.target, self.passed + 1
            if self.target + 1 == len(self.route):
                self.is_complete = True
                return wrap(leg.bearing - set_.crab(leg.bearing))
            self.start, self.target = self.route[self.target].place, self.target + 1
            self.behind, self._ahead = self._ahead, None
            leg = self._leg_seen(known, leg.bearing)
        here, there = self._spots(known, leg, set_)
        self.leg = leg._replace(cross_track=here.cross_track)
        self._warn(leg, set_, known)
        ahead = self.look_ahead(set_.way(here.course))
        course = there.course - math.atan2(here.cross_track, ahead)
        turning = set_.rate(there.course, there.curvature)
        self._drift_rate -= (turning - self._drift_rate) * math.expm1(-dt / max(self.settings.sway_time, 1.0e-3))
        slip = clip(known.lever * self._drift_rate / set_.speed, -SLIP_MOST, SLIP_MOST)
        # where the boat does not turn as was planned, the order makes up for it
        return wrap(course - set_.crab(course) + slip)

    def _keep_charted(self, known: CurrentFilter) -> None:
        """Move the corners to the filter's origin, where that has a new one."""
        if self._charted is not None and self._charted != known.origin:
            north, east = offset(known.origin, self._charted)
            self.behind, self._ahead = (
                each and each._replace(north=each.north + north, east=each.east + east)
                for each in (self.behind, self._ahead)
            )
        self._charted = known.origin

    def _spots(self, known: CurrentFilter, leg: Leg, set_: Set) -> tuple[Spot, Spot]:
        """Return the path's spot beside the boat, and that on which it will be when an order of now has its effect."""
        north, east = known.position
        here, left = Spot(leg.bearing, 0.0, leg.cross_track), 0.0
        straight = leg.remaining
        if (arc := self.behind) is not None:
            gone = swept(arc, north, east)
            if arc.turn == 0.0 or not gone < abs(arc.turn):
                self.behind = None
            else:
                here, left = on_arc(arc, north, east, max(gone, 0.0)), arc.radius * (abs(arc.turn) - max(gone, 0.0))
                straight = leg.length - arc.tangent
        preview = self.settings.lead * set_.way(here.course)
        corner = self._corner_ahead(known, leg, set_, straight + left - preview)
        if left > preview:
            assert arc is not None
            return here, Spot(here.course + arc.side * preview / arc.radius, here.curvature)
        beyond = preview - left - (straight - (corner.tangent if corner is not None else 0.0))
        if corner is None or beyond <= 0.0 or corner.turn == 0.0:
            return here, Spot(leg.bearing)
        turned = beyond / corner.radius
        if turned >= abs(corner.turn):
            return here, Spot(corner.begin + corner.turn)
        return here, Spot(corner.begin + corner.side * turned, corner.side / corner.radius)

    def _corner_ahead(self, known: CurrentFilter, leg: Leg, set_: Set, room: float) -> Corner | None:
        """Return the arc at the end of the leg, None at the last waypoint; `room` [m] is left until it is ordered."""
        if self.target + 1 == len(self.route):
            return None
        stands = self._ahead
        if stands is not None and room - stands.tangent < SETTLED_S * set_.way(leg.bearing):
            return stands
        waypoint, after = self.route[self.target], self.route[self.target + 1]
        end, length = bearing_and_distance(waypoint.place, after.place)
        turn = wrap(end - leg.bearing)
        settings = self.settings
        rate = set_.speed / settings.turn_radius if settings.turn_radius > 0.0 else math.inf
        # while the boat begins to slip the heading turns quicker than the track
        rate /= 1.0 + clip(known.lever / (set_.speed * settings.sway_time), 0.0, 1.0)
        radius = radius_needed(set_, leg.bearing, turn, rate)
        # the first half of a leg is that of the corner behind it, but for the first leg, which has none
        most = max(min(0.5 * leg.length, 0.5 * length), 0.0)
        if radius > 0.0:
            most = min(most, max(WHEEL_OVER_MOST * radius, self._reach_of(waypoint)))
        least = min(self._reach_of(waypoint), most)
        self._ahead = corner_at(offset(known.origin, waypoint.place), leg.bearing, end, radius, (least, most))
        return self._ahead

    def _reach_of(self, waypoint: Waypoint) -> float:
        return waypoint.radius if waypoint.radius > 0.0 else self.settings.radius

    def _leg_seen(self, known: CurrentFilter, bearing: float) -> Leg:
        """Return the straight leg as seen from the boat; `bearing` [rad] for a leg of no length."""
        north_of, east_of = known.position
        start_north, start_east = offset(known.origin, self.start or known.origin)
        end_north, end_east = offset(known.origin, self.route[self.target].place)
        length = math.hypot(end_north - start_north, end_east - start_east)
        if length >= SHORTEST_LEG:
            bearing = math.atan2(end_east - start_east, end_north - start_north)
        north, east = math.cos(bearing), math.sin(bearing)
        to_north, to_east = end_north - north_of, end_east - east_of
        return Leg(
            bearing=bearing,
            cross_track=to_north * east - to_east * north,
            remaining=to_north * north + to_east * east,
            distance=math.hypot(to_north, to_east),
            target=math.atan2(to_east, to_north),
            length=length,
        )

    def _is_reached(self, leg: Leg) -> bool:
        if leg.length < SHORTEST_LEG:
            return True
        if self.target + 1 == len(self.route):
            return leg.distance <= self._reach_of(self.route[self.target]) or leg.remaining <= 0.0
        return leg.remaining <= (self._ahead.tangent if self._ahead is not None else 0.0)

    def _warn(self, leg: Leg, set_: Set, known: CurrentFilter) -> None:
        """Say which leg the current is too strong for, this one or a later; it stands until all can be held."""
        if known.set_doubt > SET_SURE * set_.speed or self.behind is not None:
            return
        judged = set_.judged(self._cannot is not None)
        courses = [leg.bearing]
        for one, other in zip(self.route[self.target :], self.route[self.target + 1 :], strict=False):
            courses.append(bearing_and_distance(one.place, other.place)[0])
        places = [self.target + step for step, course in enumerate(courses) if not judged.holds(course)]
        if not places:
            self._cannot, self._strong_since = None, known.time
        elif not known.time - self._strong_since >= STRONG_S:
            self._strong_since = min(self._strong_since, known.time)
        elif self._cannot is None or self._cannot[0] != places[0]:
            self._cannot = places[0], f"the leg to waypoint {places[0]}: {set_.in_words()}"

    def _event(self, now: float) -> AlarmEvent | None:
        held = f"holding {compass_text(self._held or 0.0, 1)} deg"
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
        if self._cannot is not None:
            return AlarmEvent("current_too_strong", self._cannot[1])
        limit = self.settings.alarm_distance
        self._is_off = abs(self.leg.cross_track) > (ALARM_OFF * limit if self._is_off else limit)
        if not self._is_off:
            return None
        side = "starboard" if self.leg.cross_track > 0.0 else "port"
        return AlarmEvent("off_track", f"{limit:g} m to {side}")
