"""What instruments on NMEA 2000 say, as samples: heading, rate, roll, rudder, speed, course, position, wind. Pure."""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.links.n2k.fields import (
    ATTITUDE,
    DAY_S,
    GNSS,
    GROUND_SPEED,
    HEADING,
    NORTHS,
    POSITION,
    RATE_OF_TURN,
    RUDDER,
    SYSTEM_TIME,
    VARIATION,
    WATER_SPEED,
    WIND,
    Fields,
    number,
)
from autopilot.links.north import steered
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
    """Return the name by which a source is chosen: group and address, of a further rudder its instance too."""
    instance = number(fields, "instance", 252.0) if group == RUDDER else None
    return f"N2K{group}.{address}" + (f":{instance:g}" if instance else "")


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
