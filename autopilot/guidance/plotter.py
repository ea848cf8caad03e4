"""Steering by a chart plotter: its track and cross-track error, or its heading to steer, to a course. Pure.

The course leads along the plotter's track by line of sight, with its bearing and its cross-track error:

    psi_d = chi - atan((y + sigma y_i) / Delta),   y_i' = Delta y / (Delta^2 + (y + sigma y_i)^2)

with the leg's bearing chi, the cross-track error y (positive with the boat to starboard of the leg) and the look-ahead
distance Delta. The integral takes out the drift of current and leeway, and cannot wind up far off the track. About the
leg it is y'' + (U/Delta) y' + DRIFT_SHARE (U/Delta)^2 y = 0, damping 0.9. Source: Borhaug, Pavlov and Pettersen 2008,
"Integral LOS control for path following of underactuated marine surface vessels in the presence of constant ocean
currents", eq. (7).

A plotter that switches to its next waypoint tells the new bearing and the new error in sentences of their own, and for
a moment the two do not belong together: the boat would turn to the wrong side. So a leg that differs from the one
steered is taken only when the next message says the same, and one that turns the boat further than `TURN_MOST` only
when the skipper confirms it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import compass_text, shortest_turn, wrap
from autopilot.guidance.track import STRONG_S, Set
from autopilot.signals import AlarmEvent

DRIFT_SHARE = 0.3
"""sigma [m/s] as a share of the speed U: how fast the integral works."""
LOOKAHEAD_LEAST = 15.0
LOOKAHEAD_S = 10.0
"""Delta is at least this far [m], and as far as the boat goes in this time [s]."""
SHARPEST = 4.0 / (3.0 * math.sqrt(3.0))
"""And this share of the boat's turning radius. Line of sight bends no sharper than a circle of 3 sqrt(3)/2 Delta, where
cos^2 sin of the angle to the leg is greatest; with less than half of the boat's turn left it weaves about the leg."""


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


PERIOD_LEAST, PERIOD_MOST = 1.0, 2.0
"""A plotter sends once a second or two [s]."""
STILL_SAID = 1.5
"""A leg said within so many periods of its plotter is still led along: what says another may be a second plotter."""
TIMEOUT_S = 8.0
"""Silent for this long a plotter leads nobody any more."""
STEPS_IN_LOOKAHEAD = 6.0
"""Delta is at least this many steps of the plotter's last digit (0.01 nm is 18.5 m), or each step would be a turn."""
SAME_BEARING = math.radians(3.0)
ALIKE_M = 30.0
"""So far [m] the errors of one leg by two lines may differ: two antennas, and what the boat has gone meanwhile."""
TURN_MOST = math.radians(100.0)
PASSED_S = 5.0
"""A waypoint passed for so long, without a new leg, was the last one."""
DT_MOST = 2.0
JUMP_M, JUMP_SPEED, JUMP_SPEEDS = 10.0, 5.0, 2.0
"""The error of one leg may have grown by so much [m] since it was said last, and by this for each second [m/s], or by
so many times the boat's speed: more is a position that has jumped. One that comes back is followed."""
PLOTTERS_KEPT = 8
CONTESTED = "two plotters lead different ways: end the route of one"
UNLIKE = "no two of its sentences in a row name the same leg"
NO_VARIATION = "its bearings count from the other north, and no variation is known: set sensors.variation_deg"


class PlotterLeg(NamedTuple):
    """A leg as one plotter sentence gave it at `time` [s].

    track [rad]: its true bearing.  cross_track [m]: positive with the boat to starboard of it.  step [m]: what the
    last digit of the error is worth.  waypoint: where it ends; name: of that, for people.
    passed: whether the plotter says that this lies abeam or astern.  source: what tells its plotter from others.
    """

    time: float
    track: float
    cross_track: float
    step: float = 0.0
    waypoint: str = ""
    name: str = ""
    passed: bool = False
    source: str = ""


class PlotterHeading(NamedTuple):
    """A true heading [rad] that the plotter wants steered (HTC, HTD)."""

    time: float
    heading: float
    source: str = ""


class PlotterInvalid(NamedTuple):
    """The plotter says of itself that it does not lead: status V, mode N, manual steering."""

    time: float
    reason: str
    source: str = ""


PlotterMessage = PlotterLeg | PlotterHeading | PlotterInvalid


class PlotterGuide:
    """What the plotter wants, as a course. Memory: the leg steered, one that waits, the integral.

    Attributes:
        alarm: what the skipper must know, None when all is well; only while `following`.
        cross_track: the error [m] of the leg steered, nan without one.
        stream: the current where positions have taught it; it takes the integral's place. None: it is not known.
        turn_radius: of the boat [m], 0 where it is not known.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget the plotter."""
        self.stream: Set | None = None
        self.turn_radius = 0.0
        self.following = False
        self.alarm: AlarmEvent | None = None
        self.cross_track = math.nan
        self._message: PlotterLeg | PlotterHeading | None = None
        self._candidate: PlotterLeg | PlotterHeading | None = None
        self._said: dict[str, PlotterLeg | PlotterHeading] = {}
        """What each plotter said last."""
        self._unread = (-math.inf, "")
        """When [s] something came that could not be led along, and why."""
        self._invalid: dict[str, float] = {}
        """Why it does not lead, each with when [s] that was said last: its sentences say it in turn."""
        self._held: float | None = None
        self._drift = 0.0
        self._period = PERIOD_LEAST
        self._now: float | None = None
        self._confirmed = False
        self._wants_far = 0.0
        self._led: PlotterLeg | PlotterHeading | None = None
        """What was led along last."""
        self._began: float | None = None
        """When it led last [s], or was first waited for."""
        self._passed: float | None = None
        self._jumped: tuple[float, float, float] | None = None
        """When [s] an error was said last that the boat cannot have got to, that error and the first such [m]."""
        self._other = (-math.inf, "")
        """When [s] another plotter than the one that is followed has said a way, and which."""
        self._speed = 0.0
        self._strong_since = math.inf
        self._strong = ""

    def follow(self) -> None:
        """Begin to follow, or confirm the turn that waits for it."""
        self._confirmed = True
        if not self.following:
            self.following = True
            self._held = self._led = self._began = None
            self._jumped, self._strong_since, self._strong = None, math.inf, ""
            self._drift = 0.0
            # the leg that was steered before is as new as any other
            self._message = None
        elif self._message is None:
            self._led = None  # another plotter may lead now

    def leave(self) -> None:
        """Follow no longer."""
        self.following = False
        self.alarm = None
        self._confirmed = False

    def take(self, message: PlotterMessage) -> None:
        """Take what a plotter says; what is another's than that of the one that is followed changes nothing."""
        if self._is_anothers(message):
            self._take_anothers(message)
            return
        if isinstance(message, PlotterInvalid):
            self._take_invalid(message)
            return
        self._invalid.clear()
        before, self._candidate = self._said.pop(message.source, None), message
        self._said[message.source] = message
        while len(self._said) > PLOTTERS_KEPT:
            del self._said[next(iter(self._said))]
        if before is None or message.time - before.time > TIMEOUT_S:
            self._began = message.time
        if self._jumped is not None and message.time - self._jumped[0] > TIMEOUT_S:
            self._jumped = None
        if isinstance(message, PlotterLeg) and self._jumps(message):
            first = self._jumped[2] if self._jumped is not None else abs(message.cross_track)
            self._jumped = message.time, message.cross_track, first
            return
        if self._message is not None and _is_same(self._message, message):
            self._period = min(max(message.time - self._message.time, PERIOD_LEAST), PERIOD_MOST)
            self._message = message
            self._confirmed = False  # no turn waits
        elif self._is_still_said(message.time) or self._is_contested(message):
            pass
        elif before is not None and _is_same(before, message) and self._may_turn(message):
            self._message = message
            self._period = PERIOD_LEAST
            self._drift = 0.0
            self._confirmed = False
        if self._message is message:
            self._led, self._jumped = message, None

    def _take_anothers(self, message: PlotterMessage) -> None:
        if not isinstance(message, PlotterInvalid):
            self._other = message.time, message.source
        elif message.source == self._other[1]:
            self._other = -math.inf, ""

    def _take_invalid(self, message: PlotterInvalid) -> None:
        newest, since = self._candidate, message.time - TIMEOUT_S
        self._said.pop(message.source, None)
        if newest is not None and newest.source != message.source and newest.time >= since:
            return  # it is of no use beside the one that leads, and why is no news
        self._invalid = {reason: time for reason, time in self._invalid.items() if time >= since}
        self._invalid[message.reason] = message.time
        if newest is None or newest.source == message.source:
            self._message = self._candidate = None

    def _jumps(self, message: PlotterLeg) -> bool:
        """Return whether it names the leg that is led along, and an error that the boat cannot have got to."""
        led, jumped = self._led, self._jumped
        if not self.following or self._confirmed or not isinstance(led, PlotterLeg) or not _is_same(led, message):
            return False
        grown, steps = abs(message.cross_track) - abs(led.cross_track), JUMP_M + message.step + led.step
        if jumped is not None:
            # at once it has come back where it is nearer to the error before the jump than to the first behind it
            leaps = abs(message.cross_track - jumped[1]) > JUMP_M + message.step + self._reach(message.time - jumped[0])
            return grown > (0.5 * (jumped[2] - abs(led.cross_track)) if leaps else steps)
        return grown > steps + self._reach(message.time - led.time)

    def _reach(self, seconds: float) -> float:
        """Return how far [m] a boat may have gone across its leg in this time."""
        return max(JUMP_SPEED, JUMP_SPEEDS * self._speed) * seconds

    def unread(self, now: float, reason: str) -> None:
        """Take that something came at `now` [s] which cannot be led along; where nothing else comes, `reason` is
        said."""
        self._unread = now, reason

    def _is_contested(self, message: PlotterLeg | PlotterHeading) -> bool:
        """Return whether none leads yet and another plotter leads elsewhere: nobody has said which is meant."""
        return self._led is None and any(
            message.time - each.time <= TIMEOUT_S and not _leads_alike(each, message)
            for source, each in self._said.items()
            if source != message.source
        )

    def _is_anothers(self, message: PlotterMessage) -> bool:
        """Return whether it is of another plotter than the one that is followed: nobody has asked for that one's way.

        One that leads alike, when the first has fallen silent, may be the same plotter by another line or address.
        """
        led = self._led
        if not self.following or led is None or message.source == led.source:
            return False
        is_alike = not isinstance(message, PlotterInvalid) and _leads_alike(led, message)
        return not is_alike or message.time - led.time < STILL_SAID * self._period

    def _is_still_said(self, now: float) -> bool:
        """Return whether the leg that is led along was said so lately that another may be of a second plotter."""
        return self._message is not None and now - self._message.time < STILL_SAID * self._period

    def _may_turn(self, message: PlotterLeg | PlotterHeading) -> bool:
        goal = _goal(message)
        # from leg to leg: the course steered leads back to the old track, and is no measure of the turn
        if self._led is None or self._confirmed or abs(shortest_turn(_goal(self._led), goal)) <= TURN_MOST:
            return True
        self._wants_far = goal
        return False

    def course(self, now: float, heading: float, speed: float) -> float:
        """Return the course [rad] to steer at `now` [s], with the boat on `heading` [rad] at `speed` [m/s].

        Without a plotter that leads, it is the course held last, or the present heading, and `alarm` says why.
        """
        dt = 0.0 if self._now is None else min(max(now - self._now, 0.0), DT_MOST)
        self._now, self._speed = now, abs(speed)
        if self._began is None:
            self._began = now
        message = self._fresh(now)
        if message is not None:
            self._began = message.time
        if isinstance(message, PlotterHeading):
            self._held = message.heading
        elif message is not None:
            self._held = self._line_of_sight(message, speed, dt)
        elif self._held is None:
            self._held = heading
        self.cross_track = message.cross_track if isinstance(message, PlotterLeg) else math.nan
        self.alarm = self._event(now, message)
        return self._held

    def _fresh(self, now: float) -> PlotterLeg | PlotterHeading | None:
        if self._message is not None and now - self._message.time > TIMEOUT_S:
            self._message = None
        return self._message

    def _event(self, now: float, message: PlotterLeg | PlotterHeading | None) -> AlarmEvent | None:
        held = f"holding {compass_text(self._held or 0.0, 1)} deg"
        newest = self._candidate
        is_fresh = newest is not None and now - newest.time <= TIMEOUT_S
        waits = is_fresh and newest is not None and message is not newest and not self._is_still_said(newest.time)
        if waits and newest is not None and not self._may_turn(newest):
            far = f"further than {math.degrees(TURN_MOST):.0f} deg from the leg before"
            to = f" to {newest.name}" if isinstance(newest, PlotterLeg) and newest.name else ""
            return AlarmEvent("plotter_turn", f"{compass_text(self._wants_far, 1)} deg{to}, {far}")
        if self._jumped is not None and now - self._jumped[0] <= TIMEOUT_S:
            far = f"its error has jumped to {self._jumped[2]:.0f} m: check its GPS, or type f to follow it"
            return AlarmEvent("plotter_invalid", f"({far}): {held}")
        is_passed = isinstance(message, PlotterLeg) and message.passed
        self._passed = (self._passed or now) if is_passed else None
        if self._passed is not None and isinstance(message, PlotterLeg) and now - self._passed >= PASSED_S:
            return AlarmEvent("plotter_arrived", f"{message.name or 'its waypoint'}: {held}")
        if strong := self._too_strong(now, message):
            return AlarmEvent("current_too_strong", strong)
        if message is not None or (not self._invalid and now - (self._began or 0.0) < TIMEOUT_S):
            return None
        if self._invalid or is_fresh:
            is_contested = newest is not None and self._is_contested(newest)
            reasons = ", ".join(self._invalid) or (CONTESTED if is_contested else UNLIKE)
            return AlarmEvent("plotter_invalid", f"({reasons}): {held}")
        if now - self._unread[0] <= TIMEOUT_S:
            return AlarmEvent("plotter_invalid", f"({self._unread[1]}): {held}")
        other = ", f follows another that leads elsewhere" if now - self._other[0] <= TIMEOUT_S else ""
        return AlarmEvent("plotter_silent", f"for {TIMEOUT_S:.0f} s or more: {held}{other}")

    def _too_strong(self, now: float, message: PlotterLeg | PlotterHeading | None) -> str:
        """Return why the leg cannot be held in the current that is known, "" where it can."""
        stream = self.stream
        if stream is None or not isinstance(message, PlotterLeg):
            self._strong_since, self._strong = math.inf, ""
            return ""
        if stream.judged(self._strong != "").holds(message.track):
            self._strong_since, self._strong = math.inf, ""
            return ""
        self._strong_since = min(self._strong_since, now)
        if now - self._strong_since >= STRONG_S and not self._strong:
            self._strong = f"the plotter's leg: {stream.in_words()}"
        return self._strong

    def _line_of_sight(self, leg: PlotterLeg, speed: float, dt: float) -> float:
        turns = SHARPEST * self.turn_radius
        ahead = max(LOOKAHEAD_LEAST, LOOKAHEAD_S * abs(speed), STEPS_IN_LOOKAHEAD * leg.step, turns)
        if self.stream is not None:
            # what the integral would come to, should the positions end
            self._drift = ahead * math.tan(self.stream.crab(leg.track))
            course = wrap(leg.track - math.atan2(leg.cross_track, ahead))
            return wrap(course - self.stream.crab(course))
        course, self._drift = line_of_sight(leg.track, leg.cross_track, self._drift, ahead, speed, dt)
        return course


def _goal(message: PlotterLeg | PlotterHeading) -> float:
    return message.track if isinstance(message, PlotterLeg) else message.heading


def _leads_alike(one: PlotterLeg | PlotterHeading, other: PlotterLeg | PlotterHeading) -> bool:
    """Return whether two plotters lead the same way, whatever they call it."""
    if isinstance(one, PlotterLeg) and isinstance(other, PlotterLeg):
        is_near = abs(one.cross_track - other.cross_track) <= one.step + other.step + ALIKE_M
        return is_near and abs(shortest_turn(one.track, other.track)) <= SAME_BEARING
    return _is_same(one, other)


def _is_same(one: PlotterLeg | PlotterHeading, other: PlotterLeg | PlotterHeading) -> bool:
    """Whether two messages lead along the same leg."""
    if isinstance(one, PlotterHeading) or isinstance(other, PlotterHeading):
        # a heading to steer changes all the time: only a jump has to be said twice
        return (
            isinstance(one, PlotterHeading)
            and isinstance(other, PlotterHeading)
            and abs(shortest_turn(one.heading, other.heading)) <= 10.0 * SAME_BEARING
        )
    return one.waypoint == other.waypoint and abs(shortest_turn(one.track, other.track)) <= SAME_BEARING
