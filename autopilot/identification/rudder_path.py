"""Where the rudder turned round between two samples: corners of a path that is straight on both sides.

A steering gear moves at its rate or stands still, so that a clean record of its angle is a chain of straight lines
whose corners fall between samples. Joining the samples cuts each corner off; what is cut off is small, but always of
the same kind, and biases gain and damping. Where the record is straight before and after an interval, the two lines
are carried on until they meet inside it.
"""

from __future__ import annotations

import numpy as np

from autopilot.identification.runs import FloatArray

STRAIGHT_RAD_S = np.radians(0.05)
"""Neighbouring slopes this close count as one line; noise on the record exceeds it, and nothing is carried on then."""
STRAIGHT_SHARE = 1.0e-3
"""Likewise, as a share of the steepest slope."""
NOT_AT_SAMPLES = 1.0e-3
"""A corner closer to a sample than this share of the spacing is that sample."""


def corners(time: FloatArray, rudder: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return times [s] and rudder angles [rad] of the corners between samples at `time` [s], both of shape (C,).

    A side counts as straight where its slope goes on for two intervals, or is one that the record shows as its
    steepest more than once: a gear at its rate limit, for less than two intervals.
    """
    if time.size < 4:
        return np.empty(0), np.empty(0)
    slope = np.diff(rudder) / np.diff(time)
    tolerance = STRAIGHT_RAD_S * 1.0e-2 + STRAIGHT_SHARE * float(np.max(np.abs(slope)))
    tolerance = min(tolerance, STRAIGHT_RAD_S)
    goes_on = np.abs(np.diff(slope)) <= tolerance
    at_limit = _at_rate_limit(slope, tolerance)
    middle = np.arange(1, slope.size - 1)
    straight_before = np.concatenate([[False], goes_on])[middle - 1] | at_limit[middle - 1]
    straight_after = np.concatenate([goes_on, [False]])[middle + 1] | at_limit[middle + 1]
    bent = np.abs(slope[middle + 1] - slope[middle - 1]) > 3.0 * tolerance
    chosen = middle[straight_before & straight_after & bent]
    before, after = slope[chosen - 1], slope[chosen + 1]
    spacing = time[chosen + 1] - time[chosen]
    # rudder[k] + before t = rudder[k+1] - after (spacing - t)
    t = (rudder[chosen + 1] - rudder[chosen] - after * spacing) / (before - after)
    inside = (t > NOT_AT_SAMPLES * spacing) & (t < (1.0 - NOT_AT_SAMPLES) * spacing)
    return (time[chosen] + t)[inside], (rudder[chosen] + before * t)[inside]


def _at_rate_limit(slope: FloatArray, tolerance: float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which slopes are the steepest of the record, where more than two in a hundred of all that move are."""
    steep = np.abs(slope)
    limit = float(np.max(steep))
    at_limit = steep >= limit - 2.0 * tolerance
    moving = max(int(np.count_nonzero(steep > tolerance)), 1)
    return np.asarray(at_limit & (np.count_nonzero(at_limit) > max(2, 0.02 * moving)) & (limit > 3.0 * tolerance))
