"""Where the boat is and what current sets it: a Kalman filter of positions and of the velocity over the ground. Pure.

    N' = (U + s) cos psi - v sin psi + w_N,   E' = (U + s) sin psi + v cos psi + w_E,   v = -d r_

with the speed U that is known, its error s, the current w, and the sway v of a turn: r_ is the yaw rate behind a lag
and d [m] a lever that turns teach. Heading is known, so that all of it is linear in the six states N, E, w_N, w_E, s
and d. What moves the boat is summed from fix to fix, and the covariance moves with each fix. Whatever else sets the
boat, leeway or a compass that is wrong, counts as current, and serves as long as the boat keeps its course.

Along a straight course s and the current along it are one; a change of course tells them apart. Across the course the
current is known at once, and that is what a track needs.

A fix is the boat's place, as far as the positions that arrive are to be believed.

Where a place lies as seen from another is reckoned on the WGS 84 ellipsoid's Mercator chart. On that chart a straight
line is a line of constant true bearing, as charts and ground stations draw a leg, and angles are true. Its scale is
right at the origin and nearly so around it, so that distances [m] are exact where they matter: at the boat. Snyder, Map
Projections: A Working Manual (USGS 1987), equations 7-6 to 7-8 and 15-9.

`Overboard`, a man overboard: the place is kept until the skipper takes it back, and shown from where the boat is. It
moves no rudder: the boat goes on as ordered until the skipper orders something else.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import shortest_turn, wrap
from autopilot.errors import InputError
from autopilot.signals import AlarmEvent, PositionSample

EQUATOR_RADIUS = 6378137.0
ECCENTRICITY = math.sqrt(0.00669437999014)
"""WGS 84: semi-major axis [m], first eccentricity."""
LATITUDE_MOST = math.radians(89.9)
"""Nearer to a pole the chart is of no use, and no position counts."""
ROUTE_LATITUDE_MOST_DEG = 89.0
"""Nor may a boat be sent nearer: a nautical mile from here the chart's scale is 2 % another."""


class Place(NamedTuple):
    """Latitude, north positive, and longitude, east positive [rad]."""

    latitude: float
    longitude: float


def offset(origin: Place, place: Place) -> tuple[float, float]:
    """Return how far [m] north and east `place` lies of `origin`, on the chart with its scale right at the origin."""
    sine = ECCENTRICITY * math.sin(origin.latitude)
    scale = EQUATOR_RADIUS * math.cos(origin.latitude) / math.sqrt(1.0 - sine * sine)
    north = scale * (_isometric(place.latitude) - _isometric(origin.latitude))
    return north, scale * wrap(place.longitude - origin.longitude)


def bearing_and_distance(origin: Place, place: Place) -> tuple[float, float]:
    """Return the true bearing [rad] of `place` from `origin`, and how far [m] it is, as `offset` counts."""
    north, east = offset(origin, place)
    return math.atan2(east, north), math.hypot(north, east)


def _isometric(latitude: float) -> float:
    held = min(max(latitude, -LATITUDE_MOST), LATITUDE_MOST)
    sine = math.sin(held)
    return math.atanh(sine) - ECCENTRICITY * math.atanh(ECCENTRICITY * sine)


CARRIED_S = 3.0
"""A position is carried on by heading and speed for this long; older ones guide nobody."""
JUMP_LEAST = 30.0
JUMP_SPEED = 5.0
"""Further off than this [m], with what twice the speed or this much more [m/s] explains, is a jump."""
UNDER_WAY = 0.5
"""Above this speed [m/s] a position that stays the same to the last digit is an instrument that has stopped."""


class Fix:
    """Take every `PositionSample`; what to believe is in `newest`.

    A position that the boat cannot have reached is doubted, and with it all that go on from there. Which of the two
    places is wrong no position tells: the doubt ends with a position near the believed place, or with `accept`.
    """

    def __init__(self) -> None:
        self.newest: PositionSample | None = None
        self._doubted: PositionSample | None = None
        self.jump = 0.0
        """How far off [m] those lie that are doubted, once two of them have agreed; else 0."""

    def take(self, sample: PositionSample, speed: float) -> None:
        """Take a position, the boat going at `speed` [m/s]; a repeated one is no news."""
        newest, doubted = self.newest, self._doubted
        if not (abs(sample.latitude) <= LATITUDE_MOST and math.isfinite(sample.longitude + sample.time)):
            return
        if newest is not None:
            same = sample[1:3] == newest[1:3] or (doubted is not None and sample[1:3] == doubted[1:3])
            if sample.time <= newest.time or (same and abs(speed) > UNDER_WAY):
                return
            # the doubted first: with time a boat could have gone from one place to the other
            if doubted is not None and sample.time > doubted.time and not _jumps(doubted, sample, speed):
                self.jump = self.jump or bearing_and_distance(_place_of(newest), _place_of(sample))[1]
                self._doubted = sample
                return
            if _jumps(newest, sample, speed):
                self._doubted = sample
                return
        self.newest, self._doubted, self.jump = sample, None, 0.0

    def accept(self) -> None:
        """Believe the place that two positions have agreed on, however far off it is."""
        if self.jump > 0.0:
            self.newest, self._doubted, self.jump = self._doubted, None, 0.0

    def is_fresh(self, now: float) -> bool:
        """Return whether the place is known well enough to be guided by at `now` [s]."""
        return self.newest is not None and now - self.newest.time <= CARRIED_S

    @property
    def place(self) -> Place:
        """The newest place that is believed; ValueError before the first."""
        if self.newest is None:
            raise ValueError("fix: no position yet")
        return _place_of(self.newest)

    def age(self, now: float) -> float:
        """Return for how long [s] the newest position has to be carried on to `now` [s]; 0 before the first."""
        return min(max(now - self.newest.time, 0.0), CARRIED_S) if self.newest is not None else 0.0


def _jumps(before: PositionSample, sample: PositionSample, speed: float) -> bool:
    _, distance = bearing_and_distance(_place_of(before), _place_of(sample))
    quickest = max(2.0 * abs(speed), abs(speed) + JUMP_SPEED)
    return distance > JUMP_LEAST + quickest * (sample.time - before.time)


def _place_of(sample: PositionSample) -> Place:
    return Place(sample.latitude, sample.longitude)


OLDEST_S = 60.0
"""A position of so long ago [s] is still the best there is."""


SILENT_S = 60.0
"""A beacon that was silent for so long [s] and is heard again is of somebody else."""
MOVED_M = 30.0
"""A beacon's place is taken anew where it has moved by so much: each new place is said again."""


class Overboard:
    """The place, None where nobody is overboard, and since when [s]; whose beacon has said so, "": we have."""

    def __init__(self) -> None:
        self.place: Place | None = None
        self.since = math.nan
        self.beacon = ""
        self._heard: dict[str, float] = {}

    def mark(self, now: float, fix: Fix) -> None:
        """Keep where the boat is at `now` [s]; once more changes nothing: the first place is the nearest.

        Raises InputError where no position is known.
        """
        if self.place is None:
            self.place, self.since = _here(now, fix), now

    def report(self, now: float, place: Place, beacon: str) -> None:
        """Take the place that a `beacon` says at `now` [s]; one that has been taken back counts when it begins anew."""
        begins = not now - self._heard.get(beacon, -math.inf) <= SILENT_S
        self._heard[beacon] = now
        if self.place is None and begins:
            self.place, self.since, self.beacon = place, now, beacon
        is_its = self.place is not None and self.beacon == beacon
        if is_its and bearing_and_distance(self.place or place, place)[1] > MOVED_M:
            self.place = place

    def report_here(self, now: float, fix: Fix, beacon: str) -> None:
        """Take it that a `beacon` says no place: where the boat is when it is first said. Raises as `mark`."""
        said = self.place if self.beacon == beacon else None
        self.report(now, said or _here(now, fix), beacon)

    def clear(self) -> None:
        """Forget it."""
        self.place, self.since, self.beacon = None, math.nan, ""

    def seen_from(self, fix: Fix) -> tuple[float, float] | None:
        """Return true bearing [rad] and distance [m] from the boat, None where either place is not known."""
        return None if self.place is None or fix.newest is None else bearing_and_distance(fix.place, self.place)

    @property
    def alarm(self) -> AlarmEvent | None:
        """What everybody aboard must know, None while nobody is overboard."""
        return None if self.place is None else AlarmEvent("man_overboard", _written(self.place))


def _here(now: float, fix: Fix) -> Place:
    if fix.newest is None or not abs(now - fix.newest.time) <= OLDEST_S:
        raise InputError("man overboard: no position is known; note the time and the heading")
    return fix.place


def _written(place: Place) -> str:
    """Return a place in degrees and minutes, as charts have it."""
    parts = []
    for angle, digits, sides in ((place.latitude, 2, "NS"), (place.longitude, 3, "EW")):
        minutes = round(abs(math.degrees(angle)) * 60.0, 3)
        parts.append(f"{int(minutes // 60.0):0{digits}d} {minutes % 60.0:06.3f} {sides[angle < 0.0]}")
    return ", ".join(parts)


POSITION_NOISE = 0.5
"""Standard deviation [m] of a position against the one a second earlier: what a receiver drifts by more slowly nobody
on board can tell."""
VELOCITY_NOISE = 0.1
"""Standard deviation [m/s] of course and speed over the ground, along and across."""
SET_KNOWN = 0.5
"""Standard deviation of the current at first, in units of the boat's speed."""
SET_CHANGE = 0.003
"""How the current changes: standard deviation after a second, in units of the boat's speed."""
LOG_KNOWN, LOG_CHANGE = 0.03, 0.001
"""The error of a log at first, and after a second, in the same units."""
SPEED_KNOWN, SPEED_CHANGE = 0.5, 0.02
"""The same where no log says how fast the boat goes through the water."""
SLIP_KNOWN = 0.6
"""d at first: this share of the way in a time constant, as much to either side of half of it."""
SLIP_DOUBT = 0.3
"""The sway of a turn is wrong by this share of itself: it follows the yaw rate only roughly."""
SWAY_MOVES = 0.02
"""What waves and turns move the boat besides: standard deviation [m] after a second, in units of the boat's speed."""
STATES = 6
NORTH, EAST, SET_NORTH, SET_EAST, ERROR, LEVER = range(STATES)
LONGEST = 5.0
"""After a longer silence [s] nothing is known of where the boat has gone."""

Matrix = tuple[tuple[float, ...], ...]


class CurrentSettings(NamedTuple):
    """speed [m/s] of the boat at work, and the time [s] in which its sway follows a turn."""

    speed: float = 1.0
    sway_time: float = 1.0


class Motion(NamedTuple):
    """What has moved the boat since the newest fix: time [s], way by the speed that is known [m] north and east, and
    what a unit of s and of d is worth: sums of cos psi and sin psi [s], of r_ cos psi, r_ sin psi [rad] and r_^2
    [rad^2/s]."""

    time: float = 0.0
    north: float = 0.0
    east: float = 0.0
    cosine: float = 0.0
    sine: float = 0.0
    turned_cosine: float = 0.0
    turned_sine: float = 0.0
    turned: float = 0.0


STILL = Motion()


class CurrentFilter(NamedTuple):
    """The state at the newest fix: origin on the chart, mean and covariance, and the motion since. heading [rad], speed
    [m/s], yaw rate behind its lag [rad/s] and time [s] are those of the last move; has_log: the speed is a log's."""

    origin: Place
    mean: tuple[float, ...]
    covariance: Matrix
    motion: Motion = STILL
    heading: float = math.nan
    speed: float = 0.0
    rate: float = 0.0
    time: float = math.nan
    has_log: bool = True

    @property
    def set(self) -> tuple[float, float]:
        """The current [m/s] to the north and to the east."""
        return self.mean[SET_NORTH], self.mean[SET_EAST]

    @property
    def through_water(self) -> float:
        """The speed through the water [m/s]."""
        return self.speed + self.mean[ERROR]

    @property
    def lever(self) -> float:
        """d [m]: sway to the outside of a turn for each unit of yaw rate."""
        return self.mean[LEVER]

    @property
    def set_doubt(self) -> float:
        """Standard deviation [m/s] of the current, the larger of both directions."""
        worst = max(self.covariance[SET_NORTH][SET_NORTH], self.covariance[SET_EAST][SET_EAST])
        return math.sqrt(max(worst, 0.0))

    @property
    def position(self) -> tuple[float, float]:
        """Metres north and east of the origin at the time of the last move."""
        n, e, w_n, w_e, error, lever = self.mean
        time, north, east, cosine, sine, turned_cosine, turned_sine, _ = self.motion
        return (
            n + north + time * w_n + cosine * error + turned_sine * lever,
            e + east + time * w_e + sine * error - turned_cosine * lever,
        )

    @property
    def velocity(self) -> tuple[float, float]:
        """Velocity over the ground [m/s] north and east."""
        _, _, w_n, w_e, error, lever = self.mean
        cosine, sine, along, sway = *_direction(self.heading), self.speed + error, -lever * self.rate
        return along * cosine - sway * sine + w_n, along * sine + sway * cosine + w_e


def _direction(heading: float) -> tuple[float, float]:
    return math.cos(heading), math.sin(heading)


def first_filter(settings: CurrentSettings, place: Place) -> CurrentFilter:
    """Return the filter of a boat at `place`, in a current that nobody knows."""
    lever = 0.5 * SLIP_KNOWN * settings.speed * settings.sway_time
    unit = settings.speed
    deviations = (POSITION_NOISE, POSITION_NOISE, SET_KNOWN * unit, SET_KNOWN * unit, LOG_KNOWN * unit, lever)
    covariance = tuple(
        tuple(deviation**2 if row == column else 0.0 for column in range(STATES))
        for row, deviation in enumerate(deviations)
    )
    return CurrentFilter(place, (0.0, 0.0, 0.0, 0.0, 0.0, lever), covariance)


def moved(
    settings: CurrentSettings, known: CurrentFilter, now: float, heading: float, speed: float, *, has_log: bool
) -> CurrentFilter:
    """Return the filter at `now` [s], the boat on `heading` [rad] at `speed` [m/s]: through the water by a log, or as
    fast as the boat is at work, give or take what SPEED_KNOWN says."""
    dt = now - known.time
    if known.has_log != has_log:
        known = _with_doubt(known, ERROR, (LOG_KNOWN if has_log else SPEED_KNOWN) * settings.speed)
        known = known._replace(has_log=has_log)
    if not 0.0 < dt <= LONGEST or math.isnan(known.heading):
        return known._replace(heading=heading, speed=speed, time=now if not dt <= 0.0 else known.time)
    turn = shortest_turn(known.heading, heading)
    rate = known.rate + (turn / dt - known.rate) * -math.expm1(-dt / settings.sway_time)
    middle, pace, turned = known.heading + 0.5 * turn, 0.5 * (known.speed + speed), 0.5 * (known.rate + rate)
    cosine, sine = dt * math.cos(middle), dt * math.sin(middle)
    one = known.motion
    motion = Motion(
        one.time + dt,
        one.north + pace * cosine,
        one.east + pace * sine,
        one.cosine + cosine,
        one.sine + sine,
        one.turned_cosine + turned * cosine,
        one.turned_sine + turned * sine,
        one.turned + turned * turned * dt,
    )
    return known._replace(motion=motion, heading=heading, speed=speed, rate=rate, time=now)


def _with_doubt(known: CurrentFilter, state: int, deviation: float) -> CurrentFilter:
    rows = [list(row) for row in known.covariance]
    for other in range(STATES):
        rows[state][other] = rows[other][state] = 0.0
    rows[state][state] = deviation**2
    mean = list(known.mean)
    mean[state] = 0.0
    return known._replace(mean=tuple(mean), covariance=tuple(tuple(row) for row in rows))


def fixed(settings: CurrentSettings, known: CurrentFilter, place: Place, age: float) -> CurrentFilter:
    """Return the filter after a fix that was measured `age` [s] ago; one that is far off begins the position anew."""
    known = _predicted(settings, known)
    if math.hypot(*offset(known.origin, place)) > FAR:
        known = _rebased(known)
    north, east = offset(known.origin, place)
    v_n, v_e = known.velocity if math.isfinite(known.heading) else (0.0, 0.0)
    north, east = north + age * v_n, east + age * v_e
    variance = POSITION_NOISE**2
    if math.hypot(north - known.mean[NORTH], east - known.mean[EAST]) > BEYOND * settings.speed + BEYOND_LEAST:
        return _placed(known, north, east)
    known = _fused(known, {NORTH: 1.0}, north, variance)
    return _fused(known, {EAST: 1.0}, east, variance)


def _placed(known: CurrentFilter, north: float, east: float) -> CurrentFilter:
    known = _with_doubt(_with_doubt(known, NORTH, POSITION_NOISE), EAST, POSITION_NOISE)
    return known._replace(mean=(north, east, *known.mean[SET_NORTH:]), motion=STILL)


def placed_anew(known: CurrentFilter, place: Place) -> CurrentFilter:
    """Return the filter with the boat at `place`, whatever was believed before."""
    return _placed(known._replace(origin=place), 0.0, 0.0)


FAR = 2000.0
"""The chart's scale is right at its origin; further off than this [m] it gets a new one."""
BEYOND, BEYOND_LEAST = 1.0, 8.0
"""A fix further off than this many seconds of way and so many metres, which `Fix` believed, is another place."""


def with_velocity(settings: CurrentSettings, known: CurrentFilter, course: float, speed: float) -> CurrentFilter:
    """Return the filter after a course [rad] and speed [m/s] over the ground."""
    if math.isnan(known.heading):
        return known
    known = _predicted(settings, known)
    cosine, sine = _direction(known.heading)
    variance = VELOCITY_NOISE**2 + (SLIP_DOUBT * known.lever * known.rate) ** 2
    north = {SET_NORTH: 1.0, ERROR: cosine, LEVER: known.rate * sine}
    east = {SET_EAST: 1.0, ERROR: sine, LEVER: -known.rate * cosine}
    known = _fused(known, north, speed * math.cos(course) - known.speed * cosine, variance)
    return _fused(known, east, speed * math.sin(course) - known.speed * sine, variance)


def _rebased(known: CurrentFilter) -> CurrentFilter:
    north, east = known.mean[NORTH], known.mean[EAST]
    latitude, longitude = known.origin
    # near enough to begin with: the chart itself places the next fix about the new origin
    here = Place(latitude + north / RADIUS, longitude + east / (RADIUS * math.cos(latitude)))
    off_north, off_east = offset(here, known.origin)
    return known._replace(origin=here, mean=(north + off_north, east + off_east, *known.mean[SET_NORTH:]))


RADIUS = 6371008.8
"""Mean radius of the earth [m]."""


def _predicted(settings: CurrentSettings, known: CurrentFilter) -> CurrentFilter:
    """Return the filter with its state at the last move."""
    motion, rows = known.motion, [list(row) for row in known.covariance]
    if motion.time <= 0.0:
        return known
    way_north = ((SET_NORTH, motion.time), (ERROR, motion.cosine), (LEVER, motion.turned_sine))
    way_east = ((SET_EAST, motion.time), (ERROR, motion.sine), (LEVER, -motion.turned_cosine))
    for column in range(STATES):
        rows[NORTH][column] += sum(share * rows[state][column] for state, share in way_north)
        rows[EAST][column] += sum(share * rows[state][column] for state, share in way_east)
    for row in rows:
        row[NORTH] += sum(share * row[state] for state, share in way_north)
        row[EAST] += sum(share * row[state] for state, share in way_east)
    unit = settings.speed * settings.speed * motion.time
    slipped = 2.0 * settings.sway_time * (SLIP_DOUBT * known.lever) ** 2 * motion.turned
    change = (LOG_CHANGE if known.has_log else SPEED_CHANGE) ** 2
    for state, variance in enumerate((SWAY_MOVES**2, SWAY_MOVES**2, SET_CHANGE**2, SET_CHANGE**2, change, 0.0)):
        rows[state][state] += unit * variance + (slipped if state in (NORTH, EAST) else 0.0)
    mean = (*known.position, *known.mean[SET_NORTH:])
    return known._replace(mean=mean, covariance=tuple(tuple(row) for row in rows), motion=STILL)


def _fused(known: CurrentFilter, what: dict[int, float], value: float, variance: float) -> CurrentFilter:
    """Return the filter after a measurement of the sum of states times `what`."""
    mean, rows = known.mean, known.covariance
    across = tuple(sum(row[state] * share for state, share in what.items()) for row in rows)
    total = sum(across[state] * share for state, share in what.items()) + variance
    off = value - sum(mean[state] * share for state, share in what.items())
    gain = tuple(entry / total for entry in across)
    return known._replace(
        mean=tuple(entry + share * off for entry, share in zip(mean, gain, strict=True)),
        covariance=tuple(
            tuple(entry - share * other for entry, other in zip(row, across, strict=True))
            for row, share in zip(rows, gain, strict=True)
        ),
    )
