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


class Rest(NamedTuple):
    """What the dead band leaves: `told` [rad]; `allowed` [rad], what the law may take for its own, since the dead band
    is nothing to unwind from; whether the rudder is on its way."""

    told: float = 0.0
    allowed: float = 0.0
    is_moving: bool = False


def rested(limits: RudderLimits, band: float, before: Rest, demand: float, limited: float) -> Rest:
    """Return the order after the dead `band` [rad]: a rudder at rest stays until it is wrong by more, and then goes all
    the way. `limited` [rad] is what `limit` made of the `demand` [rad]; a band of 0 leaves it as it is."""
    wanted = clip(demand, -limits.angle_max, limits.angle_max)
    if not before.is_moving and abs(wanted - before.told) <= band:
        return Rest(before.told if band > 0.0 else limited, wanted, False)
    return Rest(limited, limited, limited != wanted)


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
