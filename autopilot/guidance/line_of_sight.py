"""Line-of-sight guidance along a straight leg, with integral action against a current. Pure.

    psi_d = chi - atan((y + sigma y_i) / Delta),   y_i' = Delta y / (Delta^2 + (y + sigma y_i)^2)

with the leg's bearing chi, the cross-track error y (positive with the boat to starboard of the leg) and the look-ahead
distance Delta. The integral takes out the drift of current and leeway, and cannot wind up far off the track. About the
leg it is y'' + (U/Delta) y' + DRIFT_SHARE (U/Delta)^2 y = 0, damping 0.9. Source: Borhaug, Pavlov and Pettersen 2008,
"Integral LOS control for path following of underactuated marine surface vessels in the presence of constant ocean
currents", eq. (7).
"""

from __future__ import annotations

import math

from autopilot.angles import wrap

DRIFT_SHARE = 0.3
"""sigma [m/s] as a share of the speed U: how fast the integral works."""
LOOKAHEAD_LEAST = 15.0
LOOKAHEAD_S = 10.0
"""Delta is at least this far [m], and as far as the boat goes in this time [s]."""


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
