"""Wave feedforward: which share of the waves' moment the rudder cancels, and with what angle.

The filter holds the waves for a motion h of their own on top of the boat's heading. What makes it is the push

    a = h'' + n h',   n = n1/T,   worth the rudder angle a T/K.

For a push of frequency w that is known, the rudder u that makes the mean of e^2 + weight^2 u'^2 least cancels a share
of it, neither early nor late:

    u = -share a T/K,   share = 1/(1 + w^4 (w^2 + n^2)/corner^6),   corner^3 = K/(T weight)

so that slow waves are cancelled and quick ones filtered out, which the loop of a boat does not see any more than
before: of the heading the law is shown the rest without (1 - share) h, of an h that is too much for waves without as
much as waves may have. A gear that is too slow or a rudder too small for the whole push cancels what it can. u leads by
the gear's lag and delay.

Derived here, from e'' + n e' = (K/T) u + a.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.control.limits import RudderLimits
from autopilot.estimation.disturbance import filtered_share, plausible_share
from autopilot.estimation.tuning import WAVE_CORNER, WAVE_DAMPING, WAVE_STIFFENING
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear

REACHED = math.sqrt(2.0)
"""A swing reaches so many times its deviation."""
LEAST_SHARE = 0.02
"""To cancel less is not worth a movement of the gear."""
SLOWING = 2.0 * WAVE_DAMPING + WAVE_CORNER * (1.0 - 1.0 / WAVE_STIFFENING)
"""Damping of h'' = -stiffness h - slowing w0 h', the best guess of h'' that goes by h and h' alone."""


class CornerFrequencies(NamedTuple):
    """Frequencies [rad/s]: waves quicker than `seen` the law is not shown, inf: it goes by the whole heading; those
    slower than `feedforward` are cancelled, 0: none are, and `seen` counts."""

    seen: float
    feedforward: float = 0.0


class Waves(NamedTuple):
    """What the filter says: their heading h [rad] and rate h' [rad/s] now, deviation [rad] and frequency [rad/s]."""

    heading: float
    rate: float
    deviation: float
    frequency: float


class WaveFeedforward(NamedTuple):
    """filtered: the share of the waves that the law is not shown; rudder [rad]: what cancels the rest."""

    filtered: float
    rudder: float


NO_FEEDFORWARD = WaveFeedforward(0.0, 0.0)


def wave_feedforward(
    model: Norrbin, gear: SteeringGear, limits: RudderLimits, corners: CornerFrequencies, quickness: float, waves: Waves
) -> WaveFeedforward:
    """Return the wave feedforward. Both corners go with the speed, `quickness` times that at which they hold."""
    if waves.deviation == 0.0:
        return NO_FEEDFORWARD
    share = plausible_share(waves.deviation, waves.heading)
    if corners.feedforward == 0.0:
        return WaveFeedforward(share * filtered_share(waves.frequency, corners.seen * quickness), 0.0)
    found = feedforward(model, gear, limits, corners.feedforward * quickness, waves)
    return WaveFeedforward(share * found.filtered, found.rudder)


def feedforward(
    model: Norrbin, gear: SteeringGear, limits: RudderLimits, corner: float, waves: Waves
) -> WaveFeedforward:
    """Return what is cancelled of the waves, by the module's equations; `corner` [rad/s] is positive."""
    n, stiffness = model.n1 / model.time_constant, waves.frequency * waves.frequency * WAVE_STIFFENING
    swing, slowing = math.sqrt(stiffness), SLOWING * waves.frequency
    worth = model.time_constant / model.gain
    share = 1.0 / (1.0 + stiffness * stiffness * (stiffness + n * n) / corner**6)
    most = REACHED * waves.deviation * worth * swing * math.sqrt(stiffness + n * n)
    share = min(share, min(gear.angle_max, limits.angle_max) / most)
    share = min(share, min(gear.rate_max, limits.rate_max) / (most * swing))
    if share < LEAST_SHARE:
        return WaveFeedforward(1.0, 0.0)
    ahead = gear.lag + gear.delay
    cosine, sine = math.cos(swing * ahead), math.sin(swing * ahead)
    heading = cosine * waves.heading + sine / swing * waves.rate
    rate = cosine * waves.rate - swing * sine * waves.heading
    return WaveFeedforward(1.0 - share, -share * worth * ((n - slowing) * rate - stiffness * heading))
