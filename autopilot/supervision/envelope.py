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
    minus the boat's [rad] (nan: the rudder is ordered, not a heading), its rate [rad/s], the bias [rad], and the rate
    at which the heading to be steered goes round [rad/s]: a boat that is ahead of it in a turn, and that it catches up
    with, has its rudder over for good reason."""

    time: float
    heading_age: float
    error: float
    rate: float
    bias: float
    reference_rate: float = 0.0


Move = tuple[float, float, float, float, float]
"""A command to be judged: now [s], the rudder command before [rad], what the law wanted [rad], the command [rad], and
the time [s] since the one before."""


def fault(
    envelope: Envelope, wrong_since: float | None, move: Move, picture: Picture | None = None
) -> tuple[str, str, float | None]:
    """Return the name of the alarm and what is wrong with a command, "" and "" where it may leave; and since when [s]
    the rudder has been pushing the boat away, None: it does not, which is all that is remembered."""
    now, previous, demand, command, dt = move
    if not (demand - demand == 0.0 and command - command == 0.0):
        return NOT_FINITE, "the law's demand" if command - command == 0.0 else "the command", wrong_since
    angle_max, rate_max, heading_age_max = envelope
    most = angle_max + SLACK
    if not -most <= command <= most:
        return OUTSIDE, f"rudder {math.degrees(command):.1f} deg", wrong_since
    step = command - previous
    # a rudder of unlimited rate gets anywhere in no time
    reach = math.inf if rate_max == math.inf else rate_max * dt + SLACK
    if not -reach <= step <= reach:
        return OUTSIDE, f"rudder moved by {math.degrees(step):.1f} deg in {dt:.2f} s", wrong_since
    if picture is None:
        return "", "", wrong_since
    time, heading_age, error, rate, bias, reference_rate = picture
    if not -OLDEST <= now - time <= OLDEST:
        return OUTSIDE, f"worked out for {now - time:+.1f} s ago", wrong_since
    if not heading_age <= heading_age_max:
        return OUTSIDE, f"from a heading {heading_age:.1f} s old", wrong_since
    side = 1.0 if error > 0.0 else -1.0
    if not WRONG_ERROR < side * error < WRONG_ERROR_MOST:
        return "", "", None
    # a bias towards the heading to be steered is what a rudder on the other side holds
    excused = side * bias if side * bias > 0.0 else 0.0
    pushes = side * command + excused < -WRONG_SHARE * angle_max
    if not (pushes and side * rate <= 0.0 and side * (rate - reference_rate) <= 0.0):
        return "", "", None
    since = now if wrong_since is None else wrong_since
    if now - since < WRONG_TIME:
        return "", "", since
    return OUTSIDE, "the rudder turns the boat away from the heading to be steered", since
