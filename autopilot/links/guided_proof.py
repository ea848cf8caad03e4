"""Whether a vehicle in GUIDED takes our headings, found out before the pilot may engage and without starting it. Pure.

Nothing acknowledges a heading target, and up to 4.7 ArduRover reports a bearing of 0 whatever it holds. What shows is
the rudder: the firmware's controller lays it to the side of the target, at rest too. So the target lies in turn to
starboard and to port of the present heading, and the steering servo of SERVO_OUTPUT_RAW must change sides with it, four
times over. Newer firmware repeats the heading in NAV_CONTROLLER_OUTPUT: then two sides are enough. Without a steering
servo (two motors) the rate of turn must change sides, which takes way on.

A target lets the boat go at its thrust's speed, or at the throttle stick's if that is more. So the proof asks for no
speed, and where the boat is not under way the stick must be neutral.
"""

from __future__ import annotations

import math
from enum import Enum
from itertools import pairwise
from typing import NamedTuple

from autopilot.angles import compass_deg, shortest_turn

ASIDE = math.radians(10.0)
"""From the present heading to a side. ArduRover's default gains make 7 % of the rudder of it at 4 m/s."""
STRAYS = math.radians(5.0)
"""The two sides stay where they are while the boat swings by less than this between them."""
SIDES = 5
"""A rudder that swings by itself goes with so many changes at no period longer than two sides."""
ECHOED_SIDES = 2
LEAST_SHARE = 0.02
"""Of full rudder, from side to side: three times what the gyro's noise and the seaway make of default gains."""
LEAST_RATE = math.radians(1.0)
SERVO_SIDE_S, RATE_SIDE_S = 0.8, 3.0
SETTLED = 0.65
"""From this share of a side on its reports count: what shows is as old as the link."""
LATE_S = 1.5
"""A report may be this late on a bad line."""
REPORT_TIMEOUT_S = 1.0
ECHO_WITHIN = math.radians(1.1)
"""The report is in whole degrees, cut off."""
RUN_S = 3.0
"""A boat that ran less than this ago, by a hand or by us, is under way."""
TOO_SELDOM = "the vehicle reports its steering servo too seldom (SERVO_OUTPUT_RAW) to be judged by; use a faster line"
STICK = (
    "a heading would start the boat: the throttle stick asks for way while the vehicle keeps its place in GUIDED; "
    "put the stick to neutral, and ahead when the pilot has engaged"
)
STICK_UNKNOWN = "a heading might start the boat: waiting to see the throttle stick (RC_CHANNELS)"
NO_SERVO = (
    "at rest nothing shows whether the vehicle takes headings: no servo output has the function 26 (GroundSteering); "
    "make way in MANUAL and switch to GUIDED then"
)
NO_REPORTS = "waiting for the vehicle to report its steering servo (SERVO_OUTPUT_RAW)"
OTHER = (
    "another companion or ground station guides the vehicle already: it makes way in GUIDED without a heading of ours; "
    "stop that one first"
)


class Verdict(Enum):
    """How the proof stands."""

    OPEN = 0
    PASSED = 1
    FAILED = 2


class Shown(NamedTuple):
    """What the vehicle shows; times in s, None or -inf where it has not come.

    has_servo: whether an output steers; servo_time: of its last report.  stick_asks: the throttle stick is out of
    neutral.  runs: the engine runs by heading and speed in GUIDED.  ran_time: when it last ran by a hand or by us.
    ours_time: of our last target.
    """

    has_servo: bool = False
    servo_time: float = -math.inf
    stick_asks: bool | None = None
    runs: bool = False
    ran_time: float = -math.inf
    ours_time: float = -math.inf

    def is_under_way(self, now: float) -> bool:
        """Return whether the boat makes way that a heading target only goes on with."""
        return now - self.ran_time <= RUN_S

    def obstacle(self, now: float) -> str:
        """Return why no proof may begin; empty where one may."""
        if self.runs and not self.is_under_way(now) and now - self.ours_time > RUN_S:
            return OTHER
        if not self.is_under_way(now):
            if self.stick_asks is None:
                return STICK_UNKNOWN
            if self.stick_asks:
                return STICK
        if not self.has_servo:
            return "" if self.is_under_way(now) else NO_SERVO
        return NO_REPORTS if now - self.servo_time > REPORT_TIMEOUT_S else ""


class GuidedProof:
    """One try, begun at `now` [s]; `by_servo`: the steering servo is judged, otherwise the rate of turn."""

    def __init__(self, now: float, by_servo: bool) -> None:
        self._by_servo = by_servo
        self._side_s = SERVO_SIDE_S if by_servo else RATE_SIDE_S
        self._reports: list[list[float]] = [[]]
        self._echoes: list[bool] = [False]
        self._began = now
        self._base: float | None = None

    def heading(self, heading: float) -> float:
        """Return the target [rad] for a boat that heads for `heading` [rad]."""
        strayed = 0.0 if self._base is None else shortest_turn(self._base, heading)
        self._base = heading - min(max(strayed, -STRAYS), STRAYS)
        return self._base + (ASIDE if len(self._reports) % 2 == 1 else -ASIDE)

    def take(self, now: float, value: float) -> None:
        """Take the servo's share of full rudder, or the rate of turn [rad/s], starboard positive."""
        if self._is_settled(now):
            self._reports[-1].append(value)

    def bearing(self, now: float, target: float, bearing: float) -> None:
        """Take the bearing [rad] reported while `target` [rad] is sent."""
        if self._is_settled(now):
            self._echoes[-1] = abs(shortest_turn(target, bearing)) < ECHO_WITHIN

    @property
    def echoes(self) -> bool:
        """Whether the vehicle repeats the headings that it is sent."""
        return len(self._echoes) >= ECHOED_SIDES and all(self._echoes[:ECHOED_SIDES])

    def verdict(self, now: float) -> Verdict:
        """Return how the proof stands at `now`; a side lasts until it has been reported of."""
        if self.echoes:
            return Verdict.PASSED
        if now - self._began < self._side_s:
            return Verdict.OPEN
        if not self._reports[-1]:
            return Verdict.OPEN if now - self._began < self._side_s + LATE_S else Verdict.FAILED
        if len(self._reports) == SIDES:
            return Verdict.PASSED if not self.refusal else Verdict.FAILED
        self._reports.append([])
        self._echoes.append(False)
        self._began = now
        return Verdict.OPEN

    @property
    def refusal(self) -> str:
        """Why the vehicle does not take our headings, as its reports tell after all sides; empty where it does."""
        if len(self._reports) < SIDES or not all(self._reports):
            return TOO_SELDOM
        levels = [sum(reports) / len(reports) for reports in self._reports]
        least = LEAST_SHARE if self._by_servo else LEAST_RATE
        steps = [before - after for before, after in pairwise(levels)]
        if all((step if number % 2 == 0 else -step) >= least for number, step in enumerate(steps)):
            return ""
        shows = "its steering servo does not move" if self._by_servo else "it does not turn"
        return (
            f"the vehicle does not take our heading targets: {shows} to their side, from port to starboard and back; "
            "stop what else guides it, and check its steering gains (ATC_STR_RAT_FF, ATC_STR_ANG_P)"
        )

    def _is_settled(self, now: float) -> bool:
        return now - self._began >= SETTLED * self._side_s


def stray_bearing(bearing: float, target_bearing: float, distance: float) -> str:
    """Return the sentence about a vehicle that steers to a point of its own; empty while it holds heading and speed.

    With a heading and a speed all three of NAV_CONTROLLER_OUTPUT are 0 [rad, rad, m], or the first is the heading.
    """
    if not target_bearing and not distance:
        return ""
    return (
        f"the vehicle has left our headings for a place of its own, {distance:.0f} m off in "
        f"{compass_deg(bearing):.0f} deg: our targets do not arrive, or another guides it"
    )
