"""What instruments on NMEA 2000 say, as samples: heading, rate, roll, rudder, speed, course, position, wind.

And what a chart plotter says, as legs and headings to steer: 129283, 129284, 129285, 127237. Pure.

    129284: the leg's bearing chi, the range R and bearing b to its end:  y = R sin(chi - b), positive to starboard
    129283: a better error y for that leg, positive with the boat to starboard of it
    129285: the names of the waypoints           127237: a heading to steer, where no leg is named

At a waypoint 129283 may still, or already, speak of another leg, and the boat would turn to the wrong side. So a leg
begins with the error of its own message, which is exact there, and an error that came between two messages that named
the same leg is used from then on: in the first seconds of a leg only if it agrees. On a long great circle the two
bearings belong to different norths, and 129283 is the better one.

Source: fields as in canboat's canboat.json; the sign as Signal K's n2k-signalk takes it (crossTrackError).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import shortest_turn, wrap
from autopilot.estimation.sensor_selection import MAGNETIC_TOO
from autopilot.guidance.plotter import (
    SAME_BEARING,
    TIMEOUT_S,
    PlotterHeading,
    PlotterInvalid,
    PlotterLeg,
    PlotterMessage,
)
from autopilot.links.n2k.packets import (
    ANGLE,
    ATTITUDE,
    CONTROL,
    CROSS_TRACK,
    DAY_S,
    GNSS,
    GROUND_SPEED,
    HEADING,
    NAVIGATION,
    NORTHS,
    POSITION,
    RATE_OF_TURN,
    ROUTE,
    RUDDER,
    STEERING,
    SYSTEM_TIME,
    VARIATION,
    WATER_SPEED,
    WIND,
    Fields,
    Message,
    decoded,
    number,
    text_of,
)
from autopilot.links.north import Variation, steered
from autopilot.signals import (
    CourseSample,
    HeadingSample,
    PositionSample,
    RateSample,
    RollSample,
    RudderSample,
    Sample,
    SpeedSample,
    WindSample,
)

INSTRUMENTS = (
    *(HEADING, RATE_OF_TURN, RUDDER, ATTITUDE, VARIATION, WATER_SPEED, POSITION, GROUND_SPEED, GNSS, WIND),
    SYSTEM_TIME,
)
"""The groups that are read of instruments."""
RUDDER_MOST = 0.5 * math.pi
RATE_MOST = 10.0
ROLL_MOST = math.pi
SPEED_MOST = 100.0
CLOCKS_FROM_S = 10957 * DAY_S
"""The year 2000: an earlier date is that of a receiver that has heard no satellite yet."""


class Compass(NamedTuple):
    """variation [rad], east positive, where a heading brings none of its own; magnetic: whether such are steered."""

    variation: float | None = None
    magnetic: bool = False


def sample_of(group: int, now: float, fields: Fields, compass: Compass, source: str) -> Sample | None:
    """Return the sample in the decoded `fields` of `group`; None where it holds none or what cannot be."""
    if group == HEADING:
        return _heading(now, fields, compass, source)
    if group == RATE_OF_TURN:
        rate = number(fields, "rate", RATE_MOST)
        return None if rate is None else RateSample(now, rate, source)
    if group == RUDDER:
        position = number(fields, "position", RUDDER_MOST)
        return None if position is None else RudderSample(now, position, False, source)
    if group == ATTITUDE:
        roll = number(fields, "roll", ROLL_MOST)
        return None if roll is None else RollSample(now, roll, None, source)
    if group in (WATER_SPEED, GROUND_SPEED):
        speed = number(fields, "speedWaterReferenced" if group == WATER_SPEED else "sog", SPEED_MOST)
        return None if speed is None else SpeedSample(now, speed, group == GROUND_SPEED, source)
    if group in (POSITION, GNSS):
        latitude, longitude = number(fields, "latitude", 0.5 * math.pi), number(fields, "longitude", math.pi)
        if latitude is None or longitude is None or fields.get("method") == "no GNSS":
            return None
        return PositionSample(now, latitude, longitude, source)
    if group == WIND and (wind := apparent_wind(fields)) is not None:
        return WindSample(now, wind[1], wind[0], source)
    return None


def course_of(now: float, fields: Fields, variation: float | None, source: str) -> CourseSample | None:
    """Return the true course over the ground in the `fields` of 129026; None where it holds none."""
    course, reference = number(fields, "cog", math.tau), fields.get("cogReference")
    if course is None or course < 0.0 or reference not in NORTHS:
        return None
    true = steered(course, is_magnetic=reference == "Magnetic", by_compass=False, variation=variation)
    return None if true is None else CourseSample(now, true, source)


def source_name(group: int, address: int, fields: Fields) -> str:
    """Return the name by which a source is chosen: group and address, of a further rudder its instance too, and
    of magnetic headings that they are."""
    instance = number(fields, "instance", 252.0) if group == RUDDER else None
    magnetic = MAGNETIC_TOO if group == HEADING and fields.get("reference") == "Magnetic" else ""
    return f"N2K{group}.{address}" + (f":{instance:g}" if instance else magnetic)


def rudder_order(fields: Fields) -> float | None:
    """Return the ordered rudder [rad], starboard positive, in a rudder message; None where it orders none.

    The direction decides the side where there is one: some give the angle without a sign.
    """
    angle = number(fields, "angleOrder", RUDDER_MOST)
    direction = fields.get("directionOrder")
    if angle is None or direction == "No Order":
        return None
    return angle if direction is None else math.copysign(angle, -1.0 if direction == "Move to port" else 1.0)


def apparent_wind(fields: Fields) -> tuple[float, float] | None:
    """Return speed [m/s] and direction off the bow [rad] of the apparent wind; None where it is another or none."""
    speed, angle = number(fields, "windSpeed", SPEED_MOST), number(fields, "windAngle", math.tau)
    if speed is None or angle is None or fields.get("reference") != "Apparent":
        return None
    return speed, wrap(angle)


def moment(fields: Fields) -> float | None:
    """Return the Unix time [s] in a message that has date and time; None where it has not both, or they are not set."""
    date, time = number(fields, "date", 65532.0 * DAY_S), number(fields, "time", DAY_S + 1.0)
    return None if date is None or time is None or date < CLOCKS_FROM_S else date + time


def own_variation(fields: Fields) -> float | None:
    """Return the variation [rad] in a message; None where it has none."""
    return number(fields, "variation", math.pi)


def is_heading(group: int, fields: Fields) -> bool:
    """Return whether a message holds a heading, usable or not."""
    heading = number(fields, "heading", math.tau)
    return group == HEADING and heading is not None and heading >= 0.0 and fields.get("reference") in NORTHS


def _heading(now: float, fields: Fields, compass: Compass, source: str) -> Sample | None:
    heading = number(fields, "heading", math.tau)
    reference = fields.get("reference")
    if heading is None or heading < 0.0 or reference not in NORTHS:
        return None
    own = own_variation(fields)
    east = compass.variation if own is None else own
    is_magnetic = reference == "Magnetic"
    if is_magnetic:
        heading += number(fields, "deviation", 0.5 * math.pi) or 0.0
    found = steered(heading, is_magnetic=is_magnetic, by_compass=compass.magnetic, variation=east)
    return None if found is None else HeadingSample(now, found, None, source)


PLOTTER_GROUPS = (CONTROL, CROSS_TRACK, NAVIGATION, ROUTE)
LEADING_MODES = ("Autonomous", "Differential enhanced")
MANUAL = STEERING[:3]
RANGE_MOST = 2.0e7
ERROR_MOST = 2.0e5
ERROR_STEP = 0.01
ERROR_AGE_S = 3.0
SETTLING_S, SETTLING_M = 3.0, 5.0
"""So long after its beginning an error further from that of the leg's own message than this [m] is another leg's."""
NAMES_MOST = 64


class PlotterReader:
    """Turns the messages of one plotter into messages for the guide.

    variation: what is known of it [rad].  magnetic: whether the boat steers magnetic courses.
    """

    def __init__(self, variation: Variation, magnetic: bool = False) -> None:
        self._variation, self._magnetic = variation, magnetic
        self._leg: PlotterLeg | None = None
        self._error: tuple[float, float] | None = None
        self._error_time = self._began = self._navigated = -math.inf
        self._names: dict[int, str] = {}

    def leads(self, now: float) -> bool:
        """Return whether it has named a leg of late."""
        return self._leg is not None and now - self._leg.time <= TIMEOUT_S

    def names_none(self, now: float) -> bool:
        """Return whether it has sent no 129284 of late, which names the leg."""
        return now - self._navigated > TIMEOUT_S

    def take(self, now: float, message: Message) -> PlotterMessage | None:
        """Return what the guide must know of a message that came at `now` [s]; None where it adds nothing.
        NeedsVariationError where no variation is known for its bearings."""
        group, fields = message.group, decoded(message.group, message.data)
        if group == ROUTE:
            self._names.update(waypoint_names(message.data))
            while len(self._names) > NAMES_MOST:
                del self._names[next(iter(self._names))]
            return None
        return {CONTROL: self._control, CROSS_TRACK: self._cross_track, NAVIGATION: self._navigation}[group](
            now, fields
        )

    def _steered(self, bearing: float, reference: object) -> float:
        return self._variation.steered(bearing, is_magnetic=reference == "Magnetic", by_compass=self._magnetic)

    def _navigation(self, now: float, fields: Fields) -> PlotterMessage | None:
        self._navigated = now
        reference = fields.get("courseBearingReference")
        distance = number(fields, "distanceToWaypoint", RANGE_MOST)
        track = number(fields, "bearingOriginToDestinationWaypoint", math.tau)
        bearing = number(fields, "bearingPositionToDestinationWaypoint", math.tau)
        if reference not in NORTHS or (track is None and bearing is None) or distance is None:
            self._leg = None
            return PlotterInvalid(now, "129284 holds no valid data")
        if track is None or bearing is None:
            # without the leg's own bearing the way leads straight to the waypoint
            track = bearing = bearing if track is None else track
        assert track is not None and bearing is not None
        waypoint, name = self._waypoint(fields)
        leg = PlotterLeg(
            now,
            self._steered(track, reference),
            distance * math.sin(track - bearing),
            ANGLE * distance + ERROR_STEP,
            waypoint,
            name,
            _is_passed(fields),
        )
        before, error, self._error = self._leg, self._error, None
        if before is None:
            is_known, self._began = error is not None and now - error[0] <= ERROR_AGE_S, now
        elif not is_same_leg(before, leg):
            is_known, self._began = False, now
        else:
            is_known = error is not None and error[0] > before.time
            if is_known and error is not None and now - self._began <= SETTLING_S:
                is_known = abs(error[1] - leg.cross_track) <= 3.0 * leg.step + SETTLING_M
        if is_known and error is not None:
            leg, self._error_time = leg._replace(cross_track=error[1], step=ERROR_STEP), now
        elif before is not None and is_same_leg(before, leg) and now - self._error_time <= ERROR_AGE_S:
            leg = leg._replace(cross_track=before.cross_track, step=before.step)
        self._leg = leg
        return leg

    def _waypoint(self, fields: Fields) -> tuple[str, str]:
        """Return what tells the waypoint from others, some plotters number them all alike, and its name."""
        named = number(fields, "destinationWaypointNumber", 2.0**32)
        place = [number(fields, name, math.pi) for name in ("destinationLatitude", "destinationLongitude")]
        where = ",".join("" if each is None else f"{math.degrees(each):.4f}" for each in place)
        return f"{named}@{where}", "" if named is None else self._names.get(int(named), "")

    def _cross_track(self, now: float, fields: Fields) -> PlotterMessage | None:
        if fields.get("navigationTerminated") == "Yes":
            self._leg = None
            return PlotterInvalid(now, "its navigation has ended")
        if fields.get("xteMode", LEADING_MODES[0]) not in LEADING_MODES:
            return PlotterInvalid(now, f"its position is {str(fields['xteMode']).lower()}")
        error = number(fields, "xte", ERROR_MOST)
        self._error = None if error is None else (now, error)
        return None

    def _control(self, now: float, fields: Fields) -> PlotterMessage | None:
        mode, course = fields.get("steeringMode"), number(fields, "headingToSteerCourse", math.tau)
        if mode in MANUAL:
            return PlotterInvalid(now, "its steering mode is manual or rudder control")
        if mode is None or course is None or fields.get("headingReference") not in NORTHS:
            return None
        return PlotterHeading(now, self._steered(course, fields["headingReference"]))


def _is_passed(fields: Fields) -> bool:
    closing = number(fields, "waypointClosingVelocity", 100.0)
    is_leaving = fields.get("arrivalCircleEntered") == "Yes" and closing is not None and closing < 0.0
    return is_leaving or fields.get("perpendicularCrossed") == "Yes"


def is_same_leg(one: PlotterLeg, other: PlotterLeg) -> bool:
    """Return whether two messages name the same leg."""
    return one.waypoint == other.waypoint and abs(shortest_turn(one.track, other.track)) <= SAME_BEARING


def waypoint_names(data: bytes) -> dict[int, str]:
    """Return the names of the waypoints in 129285, by their numbers."""
    names: dict[int, str] = {}
    if len(data) < 11:
        return names
    _, at = text_of(data, 9)
    at += 1
    while at + 4 <= len(data):
        number_of = int.from_bytes(data[at : at + 2], "little")
        name, at = text_of(data, at + 2)
        at += 8
        if name:
            names[number_of] = name
    return names
