"""What the rudder may be commanded: angle and rate, in this order, whatever comes in.

The law sees the command that was really given through `last_command`, which is its anti-windup: no integrator and no
observer here believes a demand that the limits have cut.

The rate of the rudder as it is seen to slew, where the file's is not true of the boat.

Over windows of WINDOW the steering gear of the file, set off from where the rudder stood, is given the same orders:

    travel = delta(t) - delta(t - WINDOW),     |travel of the file's gear| - |travel| > BEHIND   =>   it slews

and then rate += SHARE (|travel|/WINDOW - rate), from that of the file on. A faster one counts always. Without feedback
the rudder is that of the gear itself, which is never behind, so that the file's rate stands.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.models.steering_gear import SteeringGear, gear_step


class RudderLimits(NamedTuple):
    """angle_max [rad] each side; rate_max [rad/s], inf where unlimited; to_port, to_starboard: how many times that it
    may move to each side, as in `autopilot.models.steering_gear`."""

    angle_max: float
    rate_max: float
    to_port: float = 1.0
    to_starboard: float = 1.0


class Rest(NamedTuple):
    """What the dead band leaves: `command` [rad]; `allowed` [rad], what the law may take for its own, since the dead
    band is nothing to unwind from; whether the rudder is on its way."""

    command: float = 0.0
    allowed: float = 0.0
    is_moving: bool = False


def limit(limits: RudderLimits, previous: float, demand: float, dt: float) -> float:
    """Return `demand` [rad] held to the angle, and to what the rate allows `dt` [s] after `previous` [rad].

    A demand that is not finite keeps the previous command: the supervisor ends the engagement, the limiter
    only makes sure that nothing worse leaves in this tick. Never outside +-angle_max.
    """
    if not -math.inf < demand < math.inf:
        demand = previous
    # inf * 0 is nan: a rudder of unlimited rate gets anywhere in no time
    angle_max, rate_max, to_port, to_starboard = limits
    reach = rate_max * (0.0 if dt < 0.0 else dt) if rate_max < math.inf else math.inf
    target = -angle_max if demand < -angle_max else angle_max if demand > angle_max else demand
    low, high = previous - reach * to_port, previous + reach * to_starboard
    command = low if target < low else high if target > high else target
    return -angle_max if command < -angle_max else angle_max if command > angle_max else command


def limited(limits: RudderLimits, band: float, before: Rest, moved: tuple[float, float], demand: float) -> Rest:
    """Return what is left of a `demand` [rad] within the limits and the dead `band` [rad]: a rudder at rest stays until
    it is wrong by more, and then goes all the way. before: what was left at the last tick; moved: the rudder [rad] that
    was commanded then, and the time [s] since."""
    (previous, dt), (command, _, is_moving), most = moved, before, limits.angle_max
    within = limit(limits, previous, demand, dt)
    wanted = -most if demand < -most else most if demand > most else demand
    if not is_moving and -band <= wanted - command <= band:
        return Rest(command if band > 0.0 else within, wanted, False)
    return Rest(within, within, within != wanted)


def limited_at_once(limits: RudderLimits, moved: tuple[float, float], demand: float) -> Rest:
    """Return the same without a dead band, which only a course that is held has."""
    previous, dt = moved
    allowed = limit(limits, previous, demand, dt)
    return Rest(allowed, allowed)


WINDOW = 0.6
"""Time [s] of a window: the noise of two angles is small against what a rudder travels in it. The look that begins it
counts with its dt, so that at 10 Hz a rate is found a sixth too low, which is the careful side."""
BEHIND = math.radians(5.0)
"""Further behind the file's gear than this [rad] at the end of a window is slower; noise and a sensor that is a quarter
of a second late make up less."""
SHARE = 0.1
"""Share of a new window in the rate."""
LEAST = math.radians(0.5)
"""No rudder is taken to be slower [rad/s]; one that stands still is another matter."""


class ShownRate(NamedTuple):
    """The rate [rad/s], inf until one was seen; the window: its time [s], the rudder at its beginning, the rudder that
    the gear of the file would have by now [rad]."""

    rate: float = math.inf
    since: float = 0.0
    begin: float = 0.0
    filed: float = 0.0


RATE_UNSEEN = ShownRate()


def seen(shown: ShownRate, gear: SteeringGear, rudder: float, order: float, dt: float) -> ShownRate:
    """Return the rate after `dt` [s] more: `rudder` [rad] as it stands, `order` [rad] that it was given until now.

    A `since` of 0 begins a window. The rate never exceeds that of the file's `gear`.
    """
    if shown.since <= 0.0:
        return ShownRate(shown.rate, dt, rudder, rudder)
    since, filed = shown.since + dt, gear_step(gear, shown.filed, order, dt)
    if since < WINDOW:
        return ShownRate(shown.rate, since, shown.begin, filed)
    travel, due = rudder - shown.begin, filed - shown.begin
    speed, known = max(abs(travel) / since, LEAST), min(shown.rate, gear.rate_max)
    is_behind = travel * due > 0.0 and abs(due) - abs(travel) > BEHIND
    if is_behind or speed > known:
        known = speed if math.isinf(known) else min(known + SHARE * (speed - known), gear.rate_max)
        return ShownRate(known, dt, rudder, rudder)
    return ShownRate(shown.rate, dt, rudder, rudder)
