"""The rudder between samples, and between its record and the water.

Corners: where the rudder turned round between two samples of a path that is straight on both sides.

A steering gear moves at its rate or stands still, so that a clean record of its angle is a chain of straight lines
whose corners fall between samples. Joining the samples cuts each corner off; what is cut off is small, but always of
the same kind, and biases gain and damping. Where the record is straight before and after an interval, the two lines
are carried on until they meet inside it.

Train: what lies between the recorded rudder and the turning of the boat. In series with Nomoto's first-order model
K/(1 + T s), a lag and a lead make his second-order model K (1 + T3 s)/((1 + T1 s)(1 + T2 s)) (Nomoto et al. 1957).

How fast the steering gear moves the rudder, from a recorded rudder angle with noise.

A gear that slews draws straight lines from one angle to another. The record is cut into the fewest straight pieces that
stay within its noise (Ramer-Douglas-Peucker), every long piece is fitted by least squares, and the fastest ones that
agree are averaged. What comes out is the fastest that was seen: orders that never asked for more show no more.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.linalg.blas import dtbsv

from autopilot.identification.runs import FloatArray, Run, Segment, running

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
    return following(train, time, rudder, moments)[0]


def following(
    train: RudderTrain, time: FloatArray, rudder: FloatArray, moments: FloatArray, behind: float | None = None
) -> tuple[FloatArray, float]:
    """Return what `behind_train` does, and what the lag [rad] has come to at the last of the moments; behind: at the
    first, where moments before them were asked for already."""
    taken = _play(train.dead_band, rudder) if train.dead_band > 0.0 else rudder
    direct = np.interp(moments - train.delay, time, taken)
    if train.lag < SHORTEST_LAG_S and train.lead == 0.0:
        return np.asarray(direct), float(direct[-1])
    lag = max(train.lag, SHORTEST_LAG_S)
    lagged = _lagged(lag, moments, direct, behind)
    return np.asarray(lagged + train.lead / lag * (direct - lagged)), float(lagged[-1])


def means_behind(
    train: RudderTrain, time: FloatArray, rudder: FloatArray, edges: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return mean and rise [rad] between increasing `edges` [s] of the rudder that turns the boat, and by how much its
    speed [rad/s] rises, one less than edges.

    time and rudder as for `behind_train`. Exact for straight lines between the path's points, of which there may be
    many more than edges: from lag x' + x = u the integral of x is that of u less lag times what x rises by.
    """
    taken = _play(train.dead_band, rudder) if train.dead_band > 0.0 else rudder
    area = running(time, taken)
    moments = edges - train.delay
    left = np.clip(np.searchsorted(time, moments, side="right") - 1, 0, time.size - 2)
    since, angle = moments - time[left], taken[left]
    slope = (taken[left + 1] - angle) / (time[left + 1] - time[left])
    slope[since < 0.0] = 0.0
    direct = angle + slope * since
    span, rise, bend = (values[1:] - values[:-1] for values in (edges, direct, slope))
    turned = area[left] + 0.5 * (angle + direct) * since
    mean = (turned[1:] - turned[:-1]) / span
    if train.lag < SHORTEST_LAG_S and train.lead == 0.0:
        return mean, rise, bend
    lag = max(train.lag, SHORTEST_LAG_S)
    behind = np.exp(-np.maximum(since, 0.0) / lag) * (_lagged(lag, time, taken)[left] - angle + slope * lag)
    lagged = direct - slope * lag + behind
    lagged_rise = lagged[1:] - lagged[:-1]
    lagged_bend = bend - (behind[1:] - behind[:-1]) / lag
    lagged_mean, ahead = mean - lag * lagged_rise / span, train.lead / lag
    return (
        lagged_mean + ahead * (mean - lagged_mean),
        lagged_rise + ahead * (rise - lagged_rise),
        lagged_bend + ahead * (bend - lagged_bend),
    )


def _play(dead_band: float, rudder: FloatArray) -> FloatArray:
    """Return what follows `rudder` only after the play is taken up, to either side."""
    rise = np.diff(rudder)
    # from where it turns round to where it does again the rudder moves to one side
    turns = np.concatenate([[0], np.flatnonzero(np.diff(rise > 0.0)) + 1])
    there, follows = float(rudder[0]), []
    for angle in rudder[turns].tolist():
        there = min(max(there, angle - dead_band), angle + dead_band)
        follows.append(there)
    begin = np.repeat(follows, np.diff(np.append(turns, rudder.size)))
    return np.asarray(np.minimum(np.maximum(begin, rudder - dead_band), rudder + dead_band))


def _lagged(lag: float, moments: FloatArray, driven: FloatArray, begin: float | None = None) -> FloatArray:
    """Return x with lag x' + x = `driven`, exactly for straight lines between `moments`, from `begin`, or from rest."""
    step = np.diff(moments)
    keep = np.exp(-step / lag)
    slope = np.diff(driven) / np.where(step > 0.0, step, 1.0)
    # behind a ramp x stays by lag times the slope, once the start is forgotten
    source = driven[1:] - slope * lag - keep * (driven[:-1] - slope * lag)
    band = np.zeros((2, moments.size), order="F")
    band[1, :-1] = -keep
    return np.asarray(dtbsv(1, band, np.append(driven[0] if begin is None else begin, source), lower=1, diag=1))


SMALLEST_TRAVEL = math.radians(2.0)
"""Pieces that move the rudder by less [rad] are corrections, not slewing."""
TRAVEL_NOISES = 8.0
"""Nor are pieces of fewer deviations of the noise."""
FEWEST_SAMPLES = 3
"""So many samples inside a piece, besides its corners, make a slope; fewer may as well be a jump."""
CORNER_NOISES = 3.5
"""A sample further from the line than so many deviations is a corner: one in 2000 by chance."""
ALIKE = 0.15
"""Slopes within this share of the fastest group's are one rate, seen several times."""
FASTEST_SHARE = 0.75
"""The fastest group stands at this quantile of all slopes, weighted by travel: a few flukes are not a rate."""
FEWEST_MOVEMENTS = 3
"""One straight line may be a hand on the wheel, or a gap in the record that was bridged."""
MEDIAN_DEVIATION = 0.6745
"""Of a normal distribution the median of absolute values, in its deviation; a second difference of white noise has the
variance 6."""
SLOWEST_SENSOR_S = 1.0
"""A rudder sensor with fewer samples than one in so long is taken to have no noise between them."""
GAP_GROWS = 1.25
"""Each gap over which noise is looked for is at most so many times the one before, or one sample wider."""
NOISE_STAYS = 1.15
"""White noise of 100 samples tells its deviation to a tenth; movement adds as much as the gap grows, or its square."""
WORST_ERROR = 0.1
"""A slope with a larger standard error, as a share of it, says nothing."""


class RudderRate(NamedTuple):
    """The rudder's rate [rad/s], its standard error [rad/s], and how many movements show it; by_turning: the boat's
    turning does, the rudder is known by its orders alone; is_sure: it is not that of the vessel file."""

    rate: float
    standard_error: float
    movements: int
    by_turning: bool = False
    is_sure: bool = True


class _Slope(NamedTuple):
    rate: float
    error: float
    travel: float


def measured_rate(records: Sequence[tuple[FloatArray, FloatArray]]) -> RudderRate | None:
    """Return the fastest rate at which the rudder slews in records of times [s] and angles [rad]; None where they
    cannot show one.

    A rudder that gets from one angle to another between two or three samples shows no rate: it moved at that rate or
    any faster one; fewer than FEWEST_MOVEMENTS are none either.
    """
    slopes = [slope for time, rudder in records for slope in _slopes(time, rudder)]
    group = _fastest_group(slopes) if slopes else []
    if len(group) < FEWEST_MOVEMENTS:
        return None
    rates = np.array([slope.rate for slope in group])
    weights = np.array([slope.error for slope in group]) ** -2.0
    rate = float(weights @ rates / weights.sum())
    # what the slopes scatter beyond their own errors, the mean carries too
    excess = float(weights @ (rates - rate) ** 2) / max(len(group) - 1, 1)
    error = math.sqrt(max(1.0, excess) / float(weights.sum()))
    return RudderRate(rate, error, len(group))


def rudder_rate_of(runs: Sequence[Run]) -> RudderRate | None:
    """Return the rate at which the rudder moved in the runs that have a sensor on it."""
    segments = (segment for run in runs if run.rudder == "measured" for segment in run.segments)
    return measured_rate([(segment.time, segment.rudder) for segment in segments])


def rate_sentence(rate: RudderRate) -> str:
    """Return a measured rudder rate in words."""
    how = ", as the boat turns: no sensor shows the rudder, and no delay and lag alone explain it"
    return (
        f"{math.degrees(rate.rate):.3g} +- {math.degrees(rate.standard_error):.1g} deg/s over {rate.movements} "
        f"movement{'s' if rate.movements > 1 else ''}"
        f"{how if rate.by_turning else ''}"
    )


def _fastest_group(slopes: Sequence[_Slope]) -> list[_Slope]:
    ordered = sorted(slopes, key=lambda slope: slope.rate)
    reach = np.cumsum([slope.travel for slope in ordered])
    middle = ordered[int(np.searchsorted(reach, FASTEST_SHARE * reach[-1]))].rate
    return [slope for slope in ordered if abs(slope.rate - middle) <= ALIKE * middle]


def _slopes(time: FloatArray, rudder: FloatArray) -> list[_Slope]:
    """Return the slope of every straight piece of a stretch that is long enough to be slewing.

    A value that stands is a slower sensor's that was written again, or a rudder at rest: its first sample says it all.
    """
    news = np.concatenate([[True], np.diff(rudder) != 0.0])
    time, rudder = time[news], rudder[news]
    if time.size < FEWEST_SAMPLES + 2:
        return []
    noise = _noise(time, rudder)
    least = max(SMALLEST_TRAVEL, TRAVEL_NOISES * noise)
    corners = _corners(time, rudder, max(CORNER_NOISES * noise, 0.05 * SMALLEST_TRAVEL))
    pieces = [
        _slope(time[first : last + 1], rudder[first : last + 1], noise)
        for first, last in itertools.pairwise(corners)
        if abs(rudder[last] - rudder[first]) >= least
    ]
    return [slope for slope in pieces if slope is not None]


def _slope(time: FloatArray, rudder: FloatArray, noise: float) -> _Slope | None:
    """Return the least-squares slope between two corners; both lie beside the straight part by up to one sample."""
    inside = slice(1, -1)
    if time[inside].size < FEWEST_SAMPLES:
        return None
    moments, angles = time[inside] - time[inside].mean(), rudder[inside]
    spread = float(moments @ moments)
    rate = float(moments @ angles) / spread
    residual = angles - angles.mean() - rate * moments
    scatter = math.sqrt(float(residual @ residual) / max(angles.size - 2, 1))
    error = max(scatter, noise, 1.0e-6) / math.sqrt(spread)
    travel = abs(float(rudder[-1] - rudder[0]))
    return None if error > WORST_ERROR * abs(rate) else _Slope(abs(rate), error, travel)


def small_swings(segments: Sequence[Segment]) -> float:
    """Return the share of the rudder's travel that is in swings much smaller than the largest of their segment: none in
    a zigzag, much of it where a hand or a pilot steers a course."""
    small = whole = 0.0
    for segment in segments:
        noise = _noise(segment.time, segment.rudder) if segment.rudder.size > FEWEST_SAMPLES else 0.0
        at = _corners(segment.time, segment.rudder, max(CORNER_NOISES * noise, 0.05 * SMALLEST_TRAVEL))
        moved = np.diff(segment.rudder[at])
        turns = np.flatnonzero(np.diff(np.sign(moved))) + 1
        swings = np.abs(np.add.reduceat(moved, np.concatenate([[0], turns])))
        small += float(np.sum(swings[swings < SMALL_SWING * np.max(swings)]))
        whole += float(np.sum(swings))
    return small / whole if whole > 0.0 else 0.0


def jumps_share(segments: Sequence[Segment]) -> float:
    """Return the share of the rudder's travel that it makes from one sample to the next between two angles at which it
    stands: all of it in orders, which no steering gear follows at once; 0 of fewer than FEWEST_MOVEMENTS such jumps.

    A sensor that is read less often than the table's rows stands and jumps too, but a rudder on its way goes on to the
    same side when it is read next: such steps are none of these jumps.
    """
    jumped, travel, count = 0.0, 0.0, 0
    for segment in segments:
        change = np.diff(segment.rudder)
        moved = np.abs(change)
        stands = np.concatenate([[True], moved == 0.0, [True]])
        jumps = (moved > SMALLEST_TRAVEL) & stands[:-2] & stands[2:] & ~_goes_on(segment.time[1:], change)
        count += int(np.count_nonzero(jumps))
        jumped += float(moved[jumps].sum())
        travel += float(moved.sum())
    return jumped / travel if count >= FEWEST_MOVEMENTS else 0.0


def _goes_on(time: FloatArray, change: FloatArray) -> npt.NDArray[np.bool_]:
    """Return which changes have one to the same side beside them, where a sensor is read next: after the shortest time
    between two changes, give or take the half of it, and SLOWEST_SENSOR_S at most."""
    goes_on = np.zeros(change.size, dtype=bool)
    at = np.flatnonzero(change)
    if at.size < 2:
        return goes_on
    between = np.diff(time[at])
    is_next = between <= 1.5 * min(float(between.min()), SLOWEST_SENSOR_S)
    is_next &= change[at[:-1]] * change[at[1:]] > 0.0
    goes_on[at[:-1][is_next]] = True
    goes_on[at[1:][is_next]] = True
    return goes_on


SMALL_SWING = 0.4
"""Share of the largest swing below which one is small: of zigzags with 10 and 20 deg in one record none is."""


def _noise(time: FloatArray, rudder: FloatArray) -> float:
    """Return the standard deviation of the noise [rad] from second differences, which straight lines do not have.

    Their median keeps corners out of it. Between the samples of a slower sensor a record is interpolated and straight,
    so that the differences of neighbours tell too little: over wider gaps they grow until each gap spans one of the
    sensor's, and stay where the noise is. What grows on is movement, and neighbours are what tells least of that.
    """
    if rudder.size < FEWEST_SAMPLES:
        return 0.0
    first = here = noise_over(rudder, 1)
    gap, widest = 2, min((rudder.size - 1) // 2, math.ceil(SLOWEST_SENSOR_S / float(np.median(np.diff(time)))))
    while gap <= widest:
        wider = noise_over(rudder, gap)
        if wider <= NOISE_STAYS * here:
            return here
        gap, here = max(gap + 1, int(GAP_GROWS * gap)), wider
    return first


def noise_over(values: FloatArray, gap: int) -> float:
    """Return the standard deviation of white noise, in the unit of `values`, from the median of their second
    differences over a `gap` of samples."""
    rises = values[gap:] - values[:-gap]
    return float(np.median(np.abs(rises[gap:] - rises[:-gap]))) / (MEDIAN_DEVIATION * math.sqrt(6.0))


def _corners(time: FloatArray, rudder: FloatArray, tolerance: float) -> list[int]:
    """Return the indices between which straight lines stay within `tolerance` [rad] of the record."""
    corners, stack = [0, time.size - 1], [(0, time.size - 1)]
    while stack:
        first, last = stack.pop()
        if last - first < 2:
            continue
        line = np.interp(time[first : last + 1], time[[first, last]], rudder[[first, last]])
        away = np.abs(rudder[first : last + 1] - line)
        at = int(np.argmax(away))
        if away[at] > tolerance:
            corners.append(first + at)
            stack += [(first, first + at), (first + at, last)]
    return sorted(set(corners))
