"""The last look at a command before it leaves: angle, rate, finite, age, and whether its side makes sense.

A second implementation: it shares no code with `autopilot.control.limits` and the law, so that a mistake there cannot
hide itself here. Every comparison is written so that what is not a number fails it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

SLACK = 1.0e-9
OLDEST = 0.5
"""A state reckoned for a time further than this [s] from the command's own belongs to another tick."""
WRONG_ERROR = math.radians(15.0)
WRONG_ERROR_MOST = math.radians(150.0)
"""Between these errors [rad] from the heading to be steered there is a right side and a wrong one."""
WRONG_SHARE = 0.5
"""So much of the rudder [1], beyond what holds wind and trim, pushes the boat away for certain. What wind and trim are
worth is an estimate: it may excuse a rudder, and never accuse one."""
WRONG_TIME = 3.0
"""And for this long [s]: a law that brakes a turn, or meets a wave, does so for less."""

NOT_FINITE = "not_finite"
OUTSIDE = "envelope"


class Envelope(NamedTuple):
    """What no command may exceed: angle_max [rad], rate_max [rad/s], heading_age_max [s]."""

    angle_max: float
    rate_max: float
    heading_age_max: float = math.inf


class Picture(NamedTuple):
    """What a command was worked out from: the time [s] it holds for, the heading's age [s], the heading to be steered
    minus the boat's [rad] (nan: the rudder is ordered, not a heading), its rate [rad/s], and the bias [rad]."""

    time: float
    heading_age: float
    error: float
    rate: float
    bias: float


class CommandCheck:
    """Judges commands one by one; the only memory is since when [s] the rudder has been pushing the boat away."""

    def __init__(self, envelope: Envelope, wrong_since: float | None = None) -> None:
        self.envelope = envelope
        self.wrong_since = wrong_since

    def reset(self) -> None:
        """Forget everything."""
        self.wrong_since = None

    def fault(
        self, now: float, previous: float, demand: float, command: float, dt: float, picture: Picture | None = None
    ) -> tuple[str, str]:
        """Return the name of the alarm and what is wrong with `command` [rad]; ("", "") where it may leave.

        `previous` [rad] is the rudder command `dt` [s] before, `demand` [rad] what the law wanted.
        """
        if not (demand - demand == 0.0 and command - command == 0.0):
            return NOT_FINITE, "the law's demand" if command - command == 0.0 else "the command"
        angle_max, rate_max, heading_age_max = self.envelope
        most = angle_max + SLACK
        if not -most <= command <= most:
            return OUTSIDE, f"rudder {math.degrees(command):.1f} deg"
        step = command - previous
        # a rudder of unlimited rate gets anywhere in no time
        reach = math.inf if rate_max == math.inf else rate_max * dt + SLACK
        if not -reach <= step <= reach:
            return OUTSIDE, f"rudder moved by {math.degrees(step):.1f} deg in {dt:.2f} s"
        if picture is None:
            return "", ""
        if not -OLDEST <= now - picture.time <= OLDEST:
            return OUTSIDE, f"worked out for {now - picture.time:+.1f} s ago"
        if not picture.heading_age <= heading_age_max:
            return OUTSIDE, f"from a heading {picture.heading_age:.1f} s old"
        if self._pushes_away(now, command, picture):
            return OUTSIDE, "the rudder turns the boat away from the heading to be steered"
        return "", ""

    def _pushes_away(self, now: float, command: float, picture: Picture) -> bool:
        if not WRONG_ERROR < abs(picture.error) < WRONG_ERROR_MOST:
            self.wrong_since = None
            return False
        side = 1.0 if picture.error > 0.0 else -1.0
        # a bias towards the heading to be steered is what a rudder on the other side holds
        excused = side * picture.bias if side * picture.bias > 0.0 else 0.0
        pushes = side * command + excused < -WRONG_SHARE * self.envelope.angle_max
        if not (pushes and side * picture.rate <= 0.0):
            self.wrong_since = None
            return False
        if self.wrong_since is None:
            self.wrong_since = now
        return now - self.wrong_since >= WRONG_TIME
