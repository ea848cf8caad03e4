"""Whether one of two thrusters gives less than it is asked for: weed, a rope, a motor that stands still.

The push that the model does not explain, as an angle of rudder, through a first-order filter of the time TAU,

    p = T/K [(r - r_f)/TAU - (K delta/T)_f + (d(r)/T)_f],   d(r) = n3 r^3 + n2 r^2 + n1 r + n0,

where _f is filtered, is compared with its own average of late. A thruster that fails pushes the boat to its side by
half its thrust, and takes the boat's speed although the throttle stays: both must show, for a gust does the one and a
stream the other. A turn takes speed, too: nothing is judged in it and for some seconds behind it. The alarm stays while
the push does. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.models.norrbin import Norrbin, damping
from autopilot.signals import AlarmEvent

TAU = 0.7
"""[s]: shorter than the time in which a boat is lost, longer than waves of small boats and a gyro's noise."""
LATE = 20.0
"""[s]: what pushes for longer is wind or trim."""
LASTS = 0.6
"""[s] for which both must show."""
SHARE = 0.3
"""Of the moment that one thruster makes at this throttle, taken to go with its square."""
LEAST = math.radians(1.5)
SLOWED = 0.9
"""Of the speed of late: a third of one thruster's thrust is so much of a boat's speed."""
STEADY = 0.93
"""Of the throttle of late: with less of it no boat keeps its speed."""
LEAST_THROTTLE = 0.15
QUIET = 6.0
"""[s] behind a turn: the boat gathers way again, and its drift dies out."""


class ThrusterMemory(NamedTuple):
    """Filtered rate [rad/s], rudder's and damping's acceleration [rad/s^2]; of late: push [rad], speed [m/s] and
    throttle, nan before the first look; for how long [s] both show, and the push [rad] that there was before; for how
    long [s] nothing is judged yet."""

    rate: float = math.nan
    driven: float = 0.0
    damped: float = 0.0
    push: float = math.nan
    speed: float = math.nan
    throttle: float = math.nan
    lasted: float = 0.0
    before: float = math.nan
    quiet: float = 0.0


NOTHING_SEEN = ThrusterMemory()


class ThrusterLook(NamedTuple):
    """What is looked at: the model, rate [rad/s], rudder [rad] as ordered, speed [m/s], throttle [share of full], the
    angle [rad] that full steering stands for, whether a course is held rather than a turn made, and the time [s] since
    the last look."""

    model: Norrbin
    rate: float
    rudder: float
    speed: float
    throttle: float
    full: float
    holds_course: bool
    dt: float


def thruster_step(memory: ThrusterMemory, look: ThrusterLook) -> tuple[ThrusterMemory, AlarmEvent | None]:
    """Return the memory after a look, and the alarm where a thruster fails."""
    model, dt = look.model, look.dt
    if math.isnan(look.throttle) or not math.isfinite(look.rate):
        return NOTHING_SEEN, None
    unit = model.gain / model.time_constant
    driven, damped = unit * look.rudder, damping(model, look.rate) / model.time_constant
    if math.isnan(memory.rate):
        return ThrusterMemory(look.rate, driven, damped, math.nan, look.speed, look.throttle), None
    share, slow = -math.expm1(-dt / TAU), -math.expm1(-dt / LATE)
    rate = memory.rate + share * (look.rate - memory.rate)
    driven = memory.driven + share * (driven - memory.driven)
    damped = memory.damped + share * (damped - memory.damped)
    push = ((look.rate - rate) / TAU - driven + damped) / unit
    late = push if math.isnan(memory.push) else memory.push + slow * (push - memory.push)
    found = memory._replace(
        rate=rate,
        driven=driven,
        damped=damped,
        push=late,
        speed=memory.speed + slow * (look.speed - memory.speed),
        throttle=memory.throttle + slow * (look.throttle - memory.throttle),
    )
    limit = max(SHARE * 0.5 * look.throttle * abs(look.throttle) * look.full, LEAST)
    if not math.isnan(memory.before):
        if abs(push - memory.before) < 0.5 * limit:
            return found._replace(before=math.nan, lasted=0.0), None
        return found, _alarm(push - memory.before)
    if not look.holds_course or memory.quiet > 0.0:
        quiet = QUIET if not look.holds_course else memory.quiet - dt
        return found._replace(speed=look.speed, throttle=look.throttle, quiet=quiet, lasted=0.0), None
    pushed = look.throttle > LEAST_THROTTLE and abs(push - late) > limit
    slowed = look.speed < SLOWED * found.speed and look.throttle > STEADY * found.throttle
    if not (pushed and slowed):
        return found._replace(lasted=0.0), None
    if memory.lasted + dt < LASTS:
        return found._replace(lasted=memory.lasted + dt), None
    return found._replace(before=memory.push), _alarm(push - late)


def _alarm(push: float) -> AlarmEvent:
    return AlarmEvent("thruster_weak", "port" if push < 0.0 else "starboard")
