"""Steering by the wind: an apparent or a true angle held, tack and gybe, and word of a wind that shifts. Pure.

What is smoothed is where the true wind comes from over the compass: bow and boat's way drop out of it, so that neither
yaw nor a gust, which changes the apparent wind's angle, is in the heading loop. With the boat's way U and the apparent
wind V at the angle a, ahead and to starboard,

    W cos t = V cos a - U,   W sin t = V sin a,   D = psi + t

and D and the speed W, more slowly, are what is gone by. The heading that brings a true angle is D - t; that for an
apparent angle follows from the triangle of the two winds, sin(t - a) = U/W sin a. Where no speed is heard U is 0: the
apparent wind's own bearing leads. U is the speed through the water, where there is one, or else over the ground.

The order moves no faster than `RATE_MOST`, but at the skipper's word. A vane that repeats itself to the last digit, or
is silent, leads nobody: the heading from before stays till the wind hold is ordered again. A single jump is no wind;
two in a row that agree are.

A tack turns through the wind to the mirrored angle, a gybe through the stern; both are asked first, and nothing turns
unless that is confirmed within `CONFIRM_S`. No other order of an angle takes the boat to the other side of the wind.
The wind that was before the turn is gone by until the boat has settled. A boat that comes no nearer to the other side
lies in irons, or cannot bear away: that is said.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

from autopilot.angles import compass_text, shortest_turn, wrap
from autopilot.errors import InputError
from autopilot.models.steering_gear import clip
from autopilot.signals import AlarmEvent, SpeedSample, WindSample

FRESH_S = 5.0
"""A wind, or a speed, older than this leads nobody."""
WIND_LEAST = 0.5
"""In less wind [m/s], apparent or true, a vane points anywhere."""
JUMP = math.radians(60.0)
"""A wind so far off the smoothed one counts when the next says the same."""
FROZEN_S = 30.0
"""A vane that has repeated itself to the last digit for so long stands still."""
FROZEN_TURNED, FROZEN_LEAST_S = math.radians(10.0), 3.0
"""So does one that has done so through such a turn of the boat, for no less than this."""
SLOWLY, GUSTS = 4.0, 12.0
"""The boat's way, and the bearing that shifts are measured from, are smoothed for so many times as long, and the wind's
speed: less and a gust would swing a boat that holds an apparent angle."""
RATE_MOST = math.radians(2.0)
"""The order moves no faster [rad/s] after the wind."""
CONFIRM_S = 10.0
"""A tack or gybe that is not confirmed within this is cancelled."""
MIRROR_LEAST = math.radians(10.0)
"""Nearer to head to wind, or to running before it, there is no other side to turn to."""
ASTERN = math.radians(0.5)
"""So near to running dead before the wind either side may be ordered: the skipper alone knows where the boom is."""
LEAD = math.radians(90.0)
"""The order of a turn is never further ahead of the boat than this: the short way round stays the way of the turn."""
ARRIVED = math.radians(10.0)
TURN_PATIENCE_S = 60.0
"""A turn that has not arrived by then goes on to where the present wind has the boat, and another may be ordered."""
STALLED_S, STALL_LEAST = 12.0, math.radians(5.0)
"""A turn that has brought the boat no nearer by this for so long does not go on."""
SETTLE = 2.0
"""After a turn the wind leads again when so many smoothing times have passed."""
WATCH_AFTER = 6.0
"""The wind that shifts are measured from is that so many smoothing times after the order."""
SHIFT_WIND_LEAST = 1.6
"""In less wind [m/s] than that of Beaufort 2, the least that moves a vane, a bearing is chance and no shift."""
SHIFT_OVER = 0.8
"""The alarm ends inside this share of its limit."""


class WindSettings(NamedTuple):
    """time [s]: a shift is followed in about so long; gybe_most [m/s]: in more true wind no gybe begins that was not
    confirmed aboard; shift [rad]: a wind that has shifted by more is reported, inf: never."""

    time: float = 5.0
    gybe_most: float = 12.0
    shift: float = math.radians(30.0)


class Wind(NamedTuple):
    """The wind, smoothed: where it comes from over the compass [rad], its speed [m/s], and the boat's way [m/s] that
    was taken out of it; nan: none is known, and this is the apparent wind."""

    bearing: float
    speed: float
    way: float

    @property
    def u(self) -> float:
        """The way, 0 where it is not known."""
        return 0.0 if math.isnan(self.way) else self.way


class _Mean(NamedTuple):
    """A bearing, smoothed as a unit vector."""

    north: float = 0.0
    east: float = 0.0

    def after(self, bearing: float, share: float) -> _Mean:
        north, east = math.cos(bearing), math.sin(bearing)
        return _Mean(self.north + share * (north - self.north), self.east + share * (east - self.east))

    @property
    def bearing(self) -> float:
        return math.atan2(self.east, self.north)


NEVER = SpeedSample(-math.inf, math.nan)


class Vane:
    """What vane and log say. Memory: the smoothed wind, a jump that waits, since when nothing has changed.

    Attributes:
        newest: the newest wind as it was measured.  changed: when [s] it last was another than before.
        smoothing [s]: of the bearing.
    """

    def __init__(self) -> None:
        self.smoothing = WindSettings().time
        self.newest: WindSample | None = None
        self.changed = -math.inf
        self._time = self._calm = -math.inf
        self._bearing = self._slow = _Mean()
        self._speed = self._since = 0.0
        self._way = math.nan
        self._water = self._ground = NEVER
        self._doubted: float | None = None
        self._looked = 0.0
        self._is_frozen = False

    def on_speed(self, sample: SpeedSample) -> None:
        """Take a speed of the boat."""
        if not (math.isfinite(sample.time) and math.isfinite(sample.speed)):
            return
        if sample.over_ground:
            self._ground = sample
        else:
            self._water = sample

    def on_wind(self, sample: WindSample, heading: float) -> None:
        """Take a wind, heard with the boat on `heading` [rad]; calms and what is not finite are none."""
        if not math.isfinite(sample.time + sample.angle + sample.speed + heading):
            return
        if not sample.speed >= WIND_LEAST:
            self._calm = sample.time
            return
        last = self.newest
        if last is not None and sample.source != last.source and abs(sample.time - last.time) <= FRESH_S:
            return  # of two vanes the first is gone by, as long as it is heard
        passed = sample.time - self._time
        is_first = not 0.0 <= passed <= FRESH_S
        self._look_for_change(sample, heading, is_first)
        way = self._way_at(sample.time)
        u = 0.0 if math.isnan(way) else way
        ahead, starboard = sample.speed * math.cos(sample.angle) - u, sample.speed * math.sin(sample.angle)
        speed, bearing = math.hypot(ahead, starboard), heading + math.atan2(starboard, ahead)
        self.newest = sample
        if speed < WIND_LEAST:
            self._calm = sample.time
            return
        if is_first or math.isnan(way) is not math.isnan(self._way):
            self._bearing = self._slow = _Mean(math.cos(bearing), math.sin(bearing))
            self._speed, self._way, self._time, self._doubted = speed, way, sample.time, None
            self._since = sample.time
            return
        if abs(shortest_turn(self._bearing.bearing, wrap(bearing))) > JUMP:
            before, self._doubted = self._doubted, bearing
            if before is None or abs(wrap(bearing - before)) > JUMP:
                return
        else:
            self._doubted = None
        share, slowly, gusts = (self._share(sample.time, passed, times) for times in (1.0, SLOWLY, GUSTS))
        self._bearing, self._slow = self._bearing.after(bearing, share), self._slow.after(bearing, slowly)
        self._speed += gusts * (speed - self._speed)
        self._way += slowly * (way - self._way)
        self._time = sample.time

    @property
    def wind(self) -> Wind:
        """The wind as known last; ask `trouble` first."""
        return Wind(self._bearing.bearing, self._speed, self._way)

    @property
    def slow_bearing(self) -> float:
        """Where it comes from, smoothed for longer [rad]."""
        return self._slow.bearing

    def trouble(self, now: float) -> str:
        """Return why the wind cannot be gone by at `now` [s], "" where it can."""
        if not abs(now - self._time) <= FRESH_S:
            is_calm = abs(now - self._calm) <= FRESH_S
            return f"the wind is below {WIND_LEAST:g} m/s" if is_calm else "no wind is heard"
        return "the wind vane stands still" if self._is_frozen else ""

    def _share(self, now: float, passed: float, times: float) -> float:
        """Return the weight of a new sample; at first it is that of a mean of all."""
        return max(-math.expm1(-passed / (times * self.smoothing)), passed / (now - self._since + passed or 1.0))

    def _way_at(self, time: float) -> float:
        fresh = [each.speed for each in (self._water, self._ground) if abs(time - each.time) <= FRESH_S]
        return fresh[0] if fresh else math.nan

    def _look_for_change(self, sample: WindSample, heading: float, is_first: bool) -> None:
        before = self.newest
        if is_first or before is None or (sample.angle, sample.speed) != (before.angle, before.speed):
            self.changed, self._looked, self._is_frozen = sample.time, heading, False
            return
        lasted, turned = sample.time - self.changed, abs(shortest_turn(self._looked, heading))
        self._is_frozen |= lasted >= FROZEN_S or (lasted >= FROZEN_LEAST_S and turned > FROZEN_TURNED)


class Hold(NamedTuple):
    """The angle [rad] of the wind that is held, positive with the wind from starboard; of the true wind, or of the
    apparent one. outruns: the boat runs from a wind that it outruns, and feels it from ahead of its beam."""

    angle: float
    is_true: bool
    outruns: bool = False


def hold_of(heading: float, wind: Wind, is_true: bool) -> Hold:
    """Return the angle that the boat has to the wind on `heading` [rad]."""
    true = wrap(wind.bearing - heading)
    if is_true:
        return Hold(true, True)
    apparent = math.atan2(wind.speed * math.sin(true), wind.speed * math.cos(true) + wind.u)
    return Hold(apparent, False, abs(wrap(true - apparent)) > 0.5 * math.pi)


def true_angle(hold: Hold, wind: Wind) -> float:
    """Return the angle to the true wind [rad] at which the hold's is had: sin(t - a) = U/W sin a; on the hold's side.

    Where the boat is so fast that the apparent wind never gets so far aft, it is that at which it gets furthest; where
    it outruns the wind no more, dead before it.
    """
    if hold.is_true:
        return hold.angle
    ratio, apparent = wind.u / wind.speed, abs(hold.angle)
    if ratio > 1.0:
        apparent = min(apparent, math.asin(1.0 / ratio))
    between = math.asin(clip(ratio * math.sin(apparent), -1.0, 1.0))
    true = apparent + (math.pi - between if hold.outruns else between)
    return wrap(math.copysign(min(true, math.pi), hold.angle))


class Manoeuvre(IntEnum):
    """A turn to the mirrored angle."""

    TACK = 1
    GYBE = 2


class Asked(NamedTuple):
    """A turn that waits to be confirmed: which, to which side (1 starboard, -1 port), till when [s]."""

    manoeuvre: Manoeuvre
    side: int
    until: float

    @property
    def words(self) -> str:
        """For people."""
        return f"{self.manoeuvre.name.lower()} to {'starboard' if self.side > 0 else 'port'}"


class _Turn(NamedTuple):
    """A turn under way: side, goal [rad], when it began, the heading last seen [rad], nan: none yet, how far [rad] it
    is still to go and, once there, till when [s] it settles; the least [rad] that was to go, and since when [s]."""

    side: int
    goal: float
    began: float
    heading: float = math.nan
    remaining: float = 0.0
    until: float = math.inf
    least: float = math.inf
    least_at: float = math.inf

    def is_late(self, now: float) -> bool:
        """Return whether it should have arrived by now."""
        return math.isinf(self.until) and now - self.began > TURN_PATIENCE_S

    def towards(self, goal: float) -> _Turn:
        """Return the turn to another `goal` [rad], that the wind has shifted to."""
        return self._replace(goal=goal, remaining=self.remaining + self.side * shortest_turn(self.goal, goal))

    def is_stalled(self, now: float) -> bool:
        """Return whether it does not go on."""
        return math.isinf(self.until) and now - self.least_at > STALLED_S


NO_WAY_BACK = (-math.inf, math.nan)
"""Of a vane that stood still before an order: the heading from before is not gone back to, the order counts."""


class WindGuide:
    """What the wind wants, as a heading. `vane` takes what is heard.

    Attributes:
        following: whether it leads.  hold: the angle held, None before the first heading.
        lost: why it leads nobody though it follows, "" while it does.
        asked: a turn that waits to be confirmed.  alarm: what the skipper must know, None while all is well.
    """

    def __init__(self, settings: WindSettings = WindSettings()) -> None:  # noqa: B008 - a tuple, never changed
        self.vane = Vane()
        self.settings = settings
        self._waits = False
        self._watched: object = None
        self._watch_from = math.inf
        self._reference: float | None = None
        self._shifted = False
        self.leave()

    @property
    def settings(self) -> WindSettings:
        """How the vessel goes by the wind."""
        return self._settings

    @settings.setter
    def settings(self, settings: WindSettings) -> None:
        self._settings = settings
        self.vane.smoothing = settings.time

    def is_known(self, now: float) -> bool:
        """Return whether there is a wind at `now` [s]."""
        return not self.vane.trouble(now)

    def leave(self) -> None:
        """Lead no longer."""
        self.following = self._waits = False
        self.hold: Hold | None = None
        self.asked: Asked | None = None
        self._is_true = False
        self._wanted_angle: float | None = None
        self._turn: _Turn | None = None
        self.lost = ""
        self._held = math.nan
        self._held_at_change = NO_WAY_BACK
        self._now = math.nan

    def follow(self, now: float, is_true: bool = False, angle: float | None = None, heading: float = math.nan) -> None:
        """Begin to hold an angle [rad] of the wind, None: the present one. Raises InputError where there is none, and
        where the boat would tack or gybe to get there from its `heading` [rad], not a number where none is known."""
        if trouble := self.vane.trouble(now):
            raise InputError(f"{trouble}, none that could be held: check the wind vane and its link (MWV, 130306)")
        if is_true and math.isnan(self.vane.wind.way):
            raise InputError("no speed is heard, which the true wind is worked out with: check the log (VHW, VTG)")
        if angle is not None and math.isfinite(heading):
            wind = self.vane.wind
            wanted = hold_of(heading, wind, is_true)._replace(angle=angle)
            self._refuse_other_side(wrap(wind.bearing - heading), wanted)
        self.leave()
        self.following, self._is_true, self._wanted_angle = True, is_true, angle

    def wait(self) -> None:
        """Say that the hold waits for a wind."""
        self.leave()
        self._waits = True

    def turn_by(self, turn: float) -> None:
        """Turn by so much [rad] to starboard: the angle held gets smaller where the wind is from starboard."""
        if self.hold is None or self.lost:
            raise InputError("no wind is being held: order it first")
        under_way = self._turn if self._turn is not None and math.isinf(self._turn.until) else None
        if under_way is not None and not under_way.is_late(self._now):
            raise InputError("the boat is still turning to the other side of the wind")
        wanted = self.hold._replace(angle=wrap(self.hold.angle - turn))
        if under_way is None:  # a boat that hangs between the sides may go on or back
            self._refuse_other_side(true_angle(self.hold, self.vane.wind), wanted)
        self.hold = wanted
        self.asked, self._turn, self._held = None, None, math.nan
        self._held_at_change = NO_WAY_BACK

    def _refuse_other_side(self, before: float, wanted: Hold) -> None:
        """Raise InputError where the boat would tack or gybe from the true angle `before` [rad] to get to `wanted`."""
        after = true_angle(wanted, self.vane.wind)
        turns = abs(before) + abs(after)
        is_gybe = turns > math.pi
        is_free = abs(before) >= math.pi - ASTERN if is_gybe else abs(before) < MIRROR_LEAST
        if before * after >= 0.0 or is_free or abs(after) >= math.pi - ASTERN:
            return
        word, side = "gybe" if is_gybe else "tack", "starboard" if before > 0.0 else "port"
        angle = f"wind angle {math.degrees(wanted.angle):.0f} deg"
        raise InputError(
            f"{angle}: with the wind from {side} that is a {word}: hold the wind on this side, then order {word}"
        )

    def ask(self, now: float, manoeuvre: Manoeuvre, side: int = 0) -> Asked:
        """Ask for a turn, to the `side` that it goes to or 0; `confirm` begins it. Raises InputError."""
        hold, wind, word = self.hold, self.vane.wind, manoeuvre.name.lower()
        if hold is None or self.lost or self.vane.trouble(now):
            raise InputError(f"{word}: no wind is being held: order it first")
        if math.isnan(wind.way):
            raise InputError(f"{word}: no speed is heard, and so the angle on the other side is not known")
        if self._turn is not None and not self._turn.is_late(now):
            raise InputError(f"{word}: the boat is still turning")
        true = true_angle(hold, wind)
        if not MIRROR_LEAST <= abs(true) <= math.pi - MIRROR_LEAST:
            raise InputError(f"{word}: the wind is {'ahead' if abs(true) < 1.0 else 'astern'}: there is no other side")
        goes = (1 if true > 0.0 else -1) * (1 if manoeuvre is Manoeuvre.TACK else -1)
        if side not in (0, goes):
            sides = "starboard", "port"
            wind_from, to = sides if true > 0.0 else sides[::-1], sides if goes > 0 else sides[::-1]
            raise InputError(f"{word}: with the wind from {wind_from[0]} a {word} turns to {to[0]}, not to {to[1]}")
        self.asked = Asked(manoeuvre, goes, now + CONFIRM_S)
        return self.asked

    def is_strong(self, asked: Asked) -> bool:
        """Return whether the wind is too strong for a turn that nobody confirms aboard."""
        return asked.manoeuvre is Manoeuvre.GYBE and self.vane.wind.speed > self.settings.gybe_most

    def confirm(self, now: float) -> None:
        """Begin the turn that waits; once more is no harm. Raises InputError where none waits."""
        asked, hold = self.asked, self.hold
        self.asked = None
        if asked is None or hold is None or now > asked.until or self.lost:
            if self._turn is not None and now - self._turn.began <= CONFIRM_S:
                return
            raise InputError("no tack or gybe waits to be confirmed")
        self.hold, self._held_at_change = hold._replace(angle=-hold.angle), NO_WAY_BACK
        wind = self.vane.wind
        self._turn = _Turn(asked.side, wrap(wind.bearing - true_angle(self.hold, wind)), now)

    def decline(self) -> None:
        """Drop the turn that waits."""
        self.asked = None

    def course(self, now: float, heading: float, speed: float) -> float:
        """Return the heading [rad] to steer at `now` [s], with the boat on `heading` [rad]; `speed` [m/s] is not asked.

        Without a wind it is the one ordered before, and `alarm` says so, until `follow` is called again.
        """
        dt, self._now = (0.0 if math.isnan(self._now) else max(now - self._now, 0.0)), now
        wind, trouble = self.vane.wind, self.vane.trouble(now)
        if not trouble and self._is_true and math.isnan(wind.way):
            trouble = "no speed is heard, the true wind is not known"
        if self.asked is not None and now > self.asked.until:
            self.asked = None
        if trouble and not self.lost and self._turn is None:
            self.lost, self.asked = trouble, None
            frozen_at, before = self._held_at_change
            self._held = before if frozen_at == self.vane.changed else self._held
        if math.isnan(self._held) and (self.lost or self._turn):
            self._held = heading
        if self._turn is not None:
            self._held = self._turned(now, heading, self._turn)
        elif not self.lost:
            self._held = self._wanted(heading, wind, dt)
            if self.vane.changed != self._held_at_change[0]:
                self._held_at_change = self.vane.changed, self._held
        return self._held

    def _wanted(self, heading: float, wind: Wind, dt: float) -> float:
        if self.hold is None:
            self.hold = hold_of(heading, wind, self._is_true)
            if self._wanted_angle is not None:
                self.hold = self.hold._replace(angle=wrap(self._wanted_angle))
        wanted = wrap(wind.bearing - true_angle(self.hold, wind))
        if math.isnan(self._held):
            return wanted
        most = RATE_MOST * dt
        return wrap(self._held + clip(shortest_turn(self._held, wanted), -most, most))

    def _turned(self, now: float, heading: float, turn: _Turn) -> float:
        """Return the order of a turn, round the way that it goes."""
        is_late = turn.is_late(now)
        if now >= turn.until or (is_late and self.vane.trouble(now)):
            self._turn = None
            return turn.goal
        if is_late and self.hold is not None:
            wind = self.vane.wind
            turn = turn.towards(wrap(wind.bearing - true_angle(self.hold, wind)))
        if math.isnan(turn.heading):
            remaining = (turn.side * (turn.goal - heading)) % math.tau
        else:
            remaining = turn.remaining - turn.side * shortest_turn(turn.heading, heading)
        until = turn.until
        if math.isinf(until) and remaining <= ARRIVED:
            until = now + SETTLE * self.settings.time
        least, least_at = turn.least, turn.least_at
        if remaining < least - STALL_LEAST:
            least, least_at = remaining, now
        self._turn = _Turn(turn.side, turn.goal, turn.began, heading, remaining, until, least, least_at)
        return turn.goal if remaining <= LEAD else wrap(heading + turn.side * LEAD)

    def watch(self, now: float, order: object) -> None:
        """Look for a shift: the bearing against that of a while after the `order` that is held now; None: none is."""
        key = None if order is None else (order, self.hold, math.isnan(self.vane.wind.way))
        if key != self._watched:
            self._watched, self._reference, self._shifted = key, None, False
            self._watch_from = now + WATCH_AFTER * self.settings.time
        if key is None or now < self._watch_from or self.lost or self.vane.trouble(now):
            return
        if self.vane.wind.speed < SHIFT_WIND_LEAST:
            self._shifted, self._watch_from = False, now + WATCH_AFTER * self.settings.time
            return
        if self._reference is None:
            self._reference = self.vane.slow_bearing
        limit = self.settings.shift * (SHIFT_OVER if self._shifted else 1.0)
        self._shifted = abs(shortest_turn(self._reference, self.vane.slow_bearing)) > limit

    @property
    def alarm(self) -> AlarmEvent | None:
        """What the skipper must know, None while all is well."""
        if self.lost:
            return AlarmEvent("wind_lost", f"{self.lost}: holding {compass_text(self._held, 1)} deg")
        if self.asked is not None:
            wind = f" in {self.vane.wind.speed:.0f} m/s of wind" if self.is_strong(self.asked) else ""
            return AlarmEvent("wind_turn_asked", f"{self.asked.words}{wind}")
        if self._turn is not None and self._turn.is_stalled(self._now):
            return AlarmEvent("wind_turn_stalled", f"{math.degrees(self._turn.remaining):.0f} deg")
        if self._waits:
            return AlarmEvent("wind_awaited")
        return AlarmEvent("wind_shifted", f"{math.degrees(self.settings.shift):.0f} deg") if self._shifted else None
