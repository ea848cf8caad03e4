"""The rudder between samples, and between its record and the water.

Corners: where the rudder turned round between two samples of a path that is straight on both sides.

A steering gear moves at its rate or stands still, so that a clean record of its angle is a chain of straight lines
whose corners fall between samples. Joining the samples cuts each corner off; what is cut off is small, but always of
the same kind, and biases gain and damping. Where the record is straight before and after an interval, the two lines
are carried on until they meet inside it.

Train: what lies between the recorded rudder and the turning of the boat. In series with Nomoto's first-order model
K/(1 + T s), a lag and a lead make his second-order model K (1 + T3 s)/((1 + T1 s)(1 + T2 s)) (Nomoto et al. 1957).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.blas import dtbsv

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


def with_corners(
    time: FloatArray, rudder: FloatArray, turns: tuple[FloatArray, FloatArray] | None = None
) -> tuple[FloatArray, FloatArray]:
    """Return the rudder's path, times [s] and angles [rad]: the samples and the corners between them, in order of
    time; turns: the `corners` where they are known already."""
    turns = corners(time, rudder) if turns is None else turns
    moments = np.concatenate([time, turns[0]])
    order = np.argsort(moments)
    return moments[order], np.concatenate([rudder, turns[1]])[order]


def _at_rate_limit(slope: FloatArray, tolerance: float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which slopes are the steepest of the record, where more than two in a hundred of all that move are."""
    steep = np.abs(slope)
    limit = float(np.max(steep))
    at_limit = steep >= limit - 2.0 * tolerance
    moving = max(int(np.count_nonzero(steep > tolerance)), 1)
    return np.asarray(at_limit & (np.count_nonzero(at_limit) > max(2, 0.02 * moving)) & (limit > 3.0 * tolerance))


class RudderTrain(NamedTuple):
    """What the recorded rudder goes through before it turns the boat, in this order.

    dead_band [rad]: half the play that is taken up before anything moves; delay [s]; lag T2 [s] and lead T3 [s].
    """

    dead_band: float = 0.0
    delay: float = 0.0
    lag: float = 0.0
    lead: float = 0.0


DIRECT = RudderTrain()
"""The recorded rudder is the one in the water."""

SHORTEST_LAG_S = 1.0e-6


def behind_train(train: RudderTrain, time: FloatArray, rudder: FloatArray, moments: FloatArray) -> FloatArray:
    """Return the rudder [rad] that turns the boat at increasing `moments` [s].

    time [s] and rudder [rad]: the recorded path, straight between its points. Before the record the rudder stood where
    it begins.
    """
    taken = _play(train.dead_band, rudder) if train.dead_band > 0.0 else rudder
    direct = np.interp(moments - train.delay, time, taken)
    if train.lag < SHORTEST_LAG_S and train.lead == 0.0:
        return np.asarray(direct)
    lag = max(train.lag, SHORTEST_LAG_S)
    lagged = _lagged(lag, moments, direct)
    return np.asarray(lagged + train.lead / lag * (direct - lagged))


def _play(dead_band: float, rudder: FloatArray) -> FloatArray:
    """Return what follows `rudder` only after the play is taken up, to either side."""
    there, result = float(rudder[0]), []
    for angle in rudder.tolist():
        there = min(max(there, angle - dead_band), angle + dead_band)
        result.append(there)
    return np.array(result)


def _lagged(lag: float, moments: FloatArray, driven: FloatArray) -> FloatArray:
    """Return x with lag x' + x = `driven`, exactly for straight lines between `moments`, from rest."""
    step = np.diff(moments)
    keep = np.exp(-step / lag)
    slope = np.diff(driven) / np.where(step > 0.0, step, 1.0)
    # behind a ramp x stays by lag times the slope, once the start is forgotten
    source = driven[1:] - slope * lag - keep * (driven[:-1] - slope * lag)
    band = np.zeros((2, moments.size), order="F")
    band[1, :-1] = -keep
    return np.asarray(dtbsv(1, band, np.concatenate([driven[:1], source]), lower=1, diag=1))
