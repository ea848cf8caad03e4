"""What the rudder may be told: angle and rate, in this order, whatever comes in.

The law sees what was really told through `last_command`, which is its anti-windup: no integrator and no
observer here believes a demand that the limits have cut.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.models.steering_gear import clip


class RudderLimits(NamedTuple):
    """angle_max [rad] each side; rate_max [rad/s], inf where unlimited."""

    angle_max: float
    rate_max: float


def limit(limits: RudderLimits, previous: float, demand: float, dt: float) -> float:
    """Return `demand` [rad] held to the angle, and to what the rate allows `dt` [s] after `previous` [rad].

    A demand that is not finite keeps the previous command: the supervisor ends the engagement, the limiter
    only makes sure that nothing worse leaves in this tick. Never outside +-angle_max.
    """
    if not math.isfinite(demand):
        demand = previous
    # inf * 0 is nan: a rudder of unlimited rate gets anywhere in no time
    reach = limits.rate_max * max(dt, 0.0) if math.isfinite(limits.rate_max) else math.inf
    target = clip(demand, -limits.angle_max, limits.angle_max)
    return clip(clip(target, previous - reach, previous + reach), -limits.angle_max, limits.angle_max)
