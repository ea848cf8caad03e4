"""What was ordered of the rudder, read from the angle recorded: where it stood, and when each move to there began.

The record is taken apart into straight pieces from the bottom up: pieces of two samples at first, and of two neighbours
that are each other's best the join is made as long as

    RSS(joined) - RSS(left) - RSS(right) < COST sigma^2

with least-squares lines and sigma the rudder's own noise (Keogh and others 2001, An online algorithm for segmenting
time series, section 2.2; sigma from second differences). So a hold and a move are parted by all of their samples,
at any sampling: a rudder of 1 deg/s that is sampled at 50 Hz does not stand still from one sample to the next. The
rudder stands where pieces stay within a narrow band for longer than it takes to cross the band at its own rate, and a
move begins where the lines of hold and move meet.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.identification.runs import FloatArray

COST = 30.0
"""Gain of a further piece in sigma^2: chi-square with three degrees of freedom goes beyond once in a million."""
LEAST_NOISE = math.radians(0.05)
FEW_ANGLES = 25
STILL_RAD = math.radians(0.5)
STILL_SHARE = 0.02
"""The rudder stands still within this, or within this share of the range it goes through."""
SLOW = 0.25
"""A move begins where the rudder has this share of the slope of its largest piece."""
SLOPE_DOUBT = 4.0 * math.sqrt(12.0)
"""The ends of a line through n samples are known to sigma sqrt(12/n) of each other: four standard deviations of it."""
CORNER_DOUBT = 6.0 * math.sqrt(COST)
"""One sample at an end that is off by as much as a join allows turns the line by so much over the samples."""
CREEP = 0.1
"""A hold creeps by less than this share of its angle."""
CORNER = 8.0
"""In sigma: where the rudder is called back at once, noise hides the corner over so much of its way."""
LEAST_CUT = 8
"""A piece of fewer samples is not parted again."""
SURE_SAMPLES = 5
"""So many samples give a line its slope."""
SHORTEST_S = 0.3
SHORTEST_SAMPLES = 3
LEAST_ANGLE = math.radians(2.0)
"""A rudder at smaller angles counts as amidships."""


class Hold(NamedTuple):
    """The rudder standing still: rows `first` to `last` of the record, at a median `angle` [rad]; `ordered` is the row,
    with its fraction, at which it had begun to move there. Where the rudder was called back before it stood, `first`
    and `last` are the row of its largest angle."""

    ordered: float
    first: int
    last: int
    angle: float


class Pieces(NamedTuple):
    """Straight pieces of M: rows `first` to `last`, angle `before` and `after` [rad] at these rows, slope [rad/s];
    `noise` [rad] of the rudder."""

    first: NDArray[np.intp]
    last: NDArray[np.intp]
    before: FloatArray
    after: FloatArray
    slope: FloatArray
    noise: float


class _Sums(NamedTuple):
    """Of each piece: first row, samples, means of time and angle, and second moments about these."""

    first: NDArray[np.intp]
    samples: FloatArray
    t: FloatArray
    x: FloatArray
    tt: FloatArray
    tx: FloatArray
    xx: FloatArray


def holds_of(time: FloatArray, rudder: FloatArray) -> list[Hold]:
    """Return where the rudder [rad] stood at `time` [s], and where it was called back before it did, in order."""
    if time.size < SHORTEST_SAMPLES:
        return []
    pieces = pieces_of(time, rudder)
    holds = _holds(pieces, time, rudder)
    holds = sorted([*holds, *_peaks(pieces, holds, rudder)], key=lambda hold: hold.first)
    for number in range(len(holds)):
        holds[number] = _ordered(pieces, holds, number, time)
    return holds


def noise_of(rudder: FloatArray) -> float:
    """Return the standard deviation [rad] of the rudder's noise: of its second differences, or of its resolution."""
    second = np.abs(np.diff(rudder, 2))
    angles = np.unique(rudder)
    # a few angles are orders, not the steps of a sensor
    resolution = float(np.diff(angles).min()) if angles.size > FEW_ANGLES else 0.0
    spread = 1.4826 * float(np.median(second)) / math.sqrt(6.0) if second.size else 0.0
    return max(spread, resolution / math.sqrt(12.0), LEAST_NOISE)


def pieces_of(time: FloatArray, rudder: FloatArray) -> Pieces:
    """Return the straight pieces of the record."""
    clean = rudder.copy()
    # one bad sample is no move
    clean[1:-1] = np.median(np.stack((rudder[:-2], rudder[1:-1], rudder[2:])), axis=0)
    noise = noise_of(rudder)
    sums, most = _sums_of(time, clean, np.arange(0, time.size - 1, 2)), COST * noise**2
    while sums.first.size > 1:
        cost = _left_over(_joined(sums, slice(None, -1), slice(1, None))) - _pairwise(_left_over(sums))
        # equal costs are distinguished by place, or nothing would be the best of its neighbours
        cost = cost + 1.0e-6 * most * ((0.6180339887 * np.arange(cost.size)) % 1.0)
        best = cost < most
        best[1:] &= cost[1:] < cost[:-1]
        best[:-1] &= cost[:-1] < cost[1:]
        at = np.flatnonzero(best)
        if not at.size:
            break
        joined = _joined(sums, at, at + 1)
        stays = np.delete(np.arange(sums.first.size), at + 1)
        sums = _Sums(*(_with(old, at, new)[stays] for old, new in zip(sums, joined, strict=True)))
    ends = np.append(sums.first[1:], time.size).tolist()
    bounds = [cut for part in zip(sums.first.tolist(), ends, strict=True) for cut in _cut(time, clean, part, most)]
    sums = _sums_of(time, clean, np.array(bounds))
    slope = np.divide(sums.tx, sums.tt, out=np.zeros_like(sums.tx), where=sums.tt > 0.0)
    last = np.append(sums.first[1:], time.size) - 1
    line = sums.x - slope * sums.t
    zero = time - time[0]
    return Pieces(sums.first, last, line + slope * zero[sums.first], line + slope * zero[last], slope, noise)


def _with(values: NDArray[Any], at: NDArray[np.intp], new: NDArray[Any]) -> NDArray[Any]:
    values = values.copy()
    values[at] = new
    return values


def _cut(time: FloatArray, rudder: FloatArray, part: tuple[int, int], most: float) -> list[int]:
    """Return the first rows of the pieces into which rows `part` fall: what was joined too early is parted again."""
    first, end = part
    if end - first < LEAST_CUT:
        return [first]
    t, x = time[first:end] - time[first], rudder[first:end] - rudder[first]
    count = np.arange(1.0, t.size + 1.0)
    sums = np.stack([np.cumsum(one) for one in (t, x, t * t, t * x, x * x)])
    left = _squares(count, sums)
    right = _squares(count[-1] - count[:-1], sums[:, -1:] - sums[:, :-1])
    gain = left[-1] - left[:-1] - right
    at = int(np.argmax(gain[1:-1])) + 1 if gain.size > 2 else 0
    if gain[at] <= most:
        return [first]
    middle = first + at + 1
    return _cut(time, rudder, (first, middle), most) + _cut(time, rudder, (middle, end), most)


def _squares(count: FloatArray, sums: FloatArray) -> FloatArray:
    """Return the sum of squares about the line, from the number of samples and their sums of t, x, t t, t x and x x."""
    t, x, tt, tx, xx = sums
    spread, both = tt - t * t / count, tx - t * x / count
    explained = np.divide(
        both * both, spread, out=np.zeros_like(both), where=spread > 1.0e-12 * np.maximum(tt, 1.0e-300)
    )
    left: FloatArray = np.maximum(xx - x * x / count - explained, 0.0)
    return left


def _sums_of(time: FloatArray, rudder: FloatArray, first: NDArray[np.intp]) -> _Sums:
    count = np.append(np.diff(first), time.size - first[-1]).astype(float)
    zero = time - time[0]
    t, x = np.add.reduceat(zero, first) / count, np.add.reduceat(rudder, first) / count
    off_t, off_x = zero - np.repeat(t, count.astype(int)), rudder - np.repeat(x, count.astype(int))
    moments = (np.add.reduceat(one, first) for one in (off_t * off_t, off_t * off_x, off_x * off_x))
    return _Sums(first, count, t, x, *moments)


def _joined(sums: _Sums, left: slice | NDArray[np.intp], right: slice | NDArray[np.intp]) -> _Sums:
    a, b = (_Sums._make(values[part] for values in sums) for part in (left, right))
    count = a.samples + b.samples
    dt, dx, share = b.t - a.t, b.x - a.x, b.samples / count
    weight = a.samples * share
    return _Sums(
        a.first,
        count,
        a.t + share * dt,
        a.x + share * dx,
        a.tt + b.tt + weight * dt * dt,
        a.tx + b.tx + weight * dt * dx,
        a.xx + b.xx + weight * dx * dx,
    )


def _left_over(sums: _Sums) -> FloatArray:
    """Return the sum of squares about each piece's line."""
    explained = np.divide(sums.tx * sums.tx, sums.tt, out=np.zeros_like(sums.tx), where=sums.tt > 0.0)
    return np.maximum(sums.xx - explained, 0.0)


def _pairwise(values: FloatArray) -> FloatArray:
    return values[:-1] + values[1:]


def still_within(rudder: FloatArray) -> float:
    """Return the band [rad] within which the rudder counts as standing still."""
    return max(STILL_RAD, STILL_SHARE * float(np.ptp(rudder)))


def moving_rate(pieces: Pieces, band: float, time: FloatArray) -> float:
    """Return the rate [rad/s] at which the rudder went through half of its way; infinite where it never moved."""
    ways = np.abs(pieces.after - pieces.before)
    rates = np.abs(pieces.slope)
    jumps = np.abs(pieces.before[1:] - pieces.after[:-1])
    spans = time[pieces.first[1:]] - time[pieces.last[:-1]]
    ways, rates = np.append(ways, jumps), np.append(rates, jumps / np.maximum(spans, 1.0e-9))
    ways, rates = ways[ways > band], rates[ways > band]
    if not ways.size:
        return math.inf
    order = np.argsort(rates)
    gone = np.cumsum(ways[order])
    return float(rates[order][np.searchsorted(gone, 0.5 * gone[-1])])


def _holds(pieces: Pieces, time: FloatArray, rudder: FloatArray) -> list[Hold]:
    band = still_within(rudder)
    rate = moving_rate(pieces, band, time)
    at_a_stop, at_a_turn = (max(SHORTEST_S, way / rate) for way in (2.0 * band, band + CORNER * pieces.noise))
    way = np.abs(pieces.after - pieces.before)
    middle = 0.5 * (pieces.before + pieces.after)
    creep = CREEP * np.abs(middle)
    samples = pieces.last - pieces.first + 1.0
    doubt = (SLOPE_DOUBT / np.sqrt(samples) + CORNER_DOUBT / samples) * pieces.noise
    still = way <= np.maximum(np.where(np.abs(pieces.slope) < 0.5 * rate, np.maximum(band, doubt), band), creep)
    found: list[Hold] = []
    begin = 0
    while begin < still.size:
        end = begin
        while end < still.size and still[end] and (end == begin or _goes_on(pieces, middle, begin, end, band)):
            end += 1
        first, last = int(pieces.first[begin]), int(pieces.last[max(end - 1, begin)])
        shortest = at_a_turn if _turns(pieces, begin, end) else at_a_stop
        if end > begin and last - first + 1 >= SHORTEST_SAMPLES and time[last] - time[first] >= shortest:
            _append(found, Hold(first, first, last, float(np.median(rudder[first : last + 1]))), band, rudder)
            begin = end
        else:
            begin += 1
    return found


def _turns(pieces: Pieces, begin: int, end: int) -> bool:
    """Return whether the rudder comes to the pieces `begin` to `end` from one side and leaves them to the same."""
    if begin == 0 or end >= pieces.first.size:
        return False
    here = 0.5 * (pieces.before[begin] + pieces.after[end - 1]) if end > begin else pieces.before[begin]
    return bool((pieces.before[begin - 1] - here) * (pieces.after[end] - here) > 0.0)


def _goes_on(pieces: Pieces, middle: FloatArray, begin: int, at: int, band: float) -> bool:
    """Return whether the piece `at` is of the hold that began with the piece `begin`."""
    levels = (pieces.before[at], pieces.after[at])
    allowed = max(band, CREEP * abs(float(middle[begin])))
    return bool(max(abs(level - middle[begin]) for level in levels) <= allowed) and bool(
        abs(pieces.before[at] - pieces.after[at - 1]) <= band
    )


def _append(found: list[Hold], hold: Hold, band: float, rudder: FloatArray) -> None:
    """Append a hold, or lengthen the last one where the rudder stood at the same angle and was not away between."""
    if found and abs(found[-1].angle - hold.angle) < band:
        between = rudder[found[-1].last + 1 : hold.first]
        if between.size < SHORTEST_SAMPLES or float(np.abs(between - hold.angle).max()) < 2.0 * band:
            before = found.pop()
            hold = hold._replace(ordered=before.ordered, first=before.first, angle=before.angle)
    found.append(hold)


def _peaks(pieces: Pieces, holds: list[Hold], rudder: FloatArray) -> list[Hold]:
    """Return the largest angle of each swing to one side in which the rudder stood at none."""
    rows = np.stack((pieces.first, pieces.last), axis=1).ravel()
    angles = np.stack((pieces.before, pieces.after), axis=1).ravel()
    over = np.flatnonzero(np.abs(angles) >= LEAST_ANGLE)
    if not over.size:
        return []
    begins = np.append(0, np.flatnonzero(np.diff(np.sign(angles[over]))) + 1)
    sides = [over[part] for part in np.split(np.arange(over.size), begins[1:])]
    stood = np.array([(hold.first, hold.last) for hold in holds if abs(hold.angle) >= LEAST_ANGLE]).reshape(-1, 2)
    found = []
    for side in sides:
        first, last = rows[side[0]], rows[side[-1]]
        if np.any((stood[:, 0] <= last) & (stood[:, 1] >= first)) or last >= rudder.size - 1:
            continue
        top = int(side[np.argmax(np.abs(angles[side]))])
        row, angle = int(rows[top]), float(angles[top])
        if pieces.last[top // 2] - pieces.first[top // 2] < SURE_SAMPLES:
            angle = float(np.median(rudder[max(row - 1, 0) : row + 2]))
        found.append(Hold(float(row), row, row, angle))
    return found


def _ordered(pieces: Pieces, holds: list[Hold], number: int, time: FloatArray) -> Hold:
    """Return the hold with the row at which the rudder began to move there, on the last way in one direction."""
    hold, before = holds[number], holds[number - 1] if number else None
    earliest = -1 if before is None else before.last
    earlier = int(np.searchsorted(pieces.last, earliest, side="right"))
    start = latest = int(np.searchsorted(pieces.first, hold.first)) - 1
    if start < earlier:
        return hold._replace(ordered=float(max(earliest, 0)))
    side = math.copysign(1.0, hold.angle - float(pieces.before[earlier] if before is None else before.angle))
    gone = side * (pieces.after[earlier : latest + 1] - pieces.before[earlier : latest + 1])
    while start > earlier and gone[start - 1 - earlier] > -CORNER * pieces.noise:
        start -= 1
    gone = gone[start - earlier :]
    if (jump := _jump(pieces, start, side, gone)) is not None:
        return hold._replace(ordered=float(jump))
    slow = SLOW * side * float(pieces.slope[start + int(np.argmax(gone))])
    while start < latest and side * pieces.slope[start] <= slow:
        start += 1
    if start == 0:
        return hold._replace(ordered=0.0)
    row = _meeting(pieces, start, time, None if before is None or start > earlier else before)
    return hold._replace(ordered=min(max(row, 0.0 if before is None else before.ordered), float(hold.first)))


def _jump(pieces: Pieces, start: int, side: float, gone: FloatArray) -> int | None:
    """Return the last row before the rudder went over from one sample to the next; None where it was seen on its way.

    gone: how far to the `side` it went within each of the pieces from `start` on.
    """
    first = max(start, 1)
    jumps = side * (pieces.before[first : start + gone.size] - pieces.after[first - 1 : start + gone.size - 1])
    if not jumps.size or jumps.max() <= gone.max():
        return None
    at = first + int(np.argmax(jumps))
    early = gone[: at - start].max(initial=0.0)
    return None if early > SLOW * jumps.max() else int(pieces.last[at - 1])


def _meeting(pieces: Pieces, start: int, time: FloatArray, before: Hold | None) -> float:
    """Return the row, with its fraction, at which the line of piece `start` meets that of the piece before, or the
    angle of the hold `before` where that piece has few samples.

    A piece that goes no further than noise does is passed over for the next: it is the corner between the two.
    """
    move, rest = start, start - 1
    side = math.copysign(1.0, float(pieces.slope[start]))
    while move + 1 < pieces.first.size and _is_corner(pieces, move) and side * pieces.slope[move + 1] > 0.0:
        move += 1
    row, slope = int(pieces.first[move]), float(pieces.slope[move])
    if before is not None and before.last > before.first:
        inside = slice(*np.searchsorted(pieces.first, (before.first, before.last + 1)))
        rest = inside.start + int(np.argmax(pieces.last[inside] - pieces.first[inside]))
    elif before is not None:
        hidden = CORNER * pieces.noise / max(abs(slope), 1.0e-9)
        while rest > 0 and float(time[pieces.last[rest]] - time[pieces.first[rest]]) <= hidden:
            rest -= 1
    at, slower, level = float(time[pieces.last[rest]]), float(pieces.slope[rest]), float(pieces.after[rest])
    if before is not None and before.last > before.first and pieces.last[rest] - pieces.first[rest] < SURE_SAMPLES:
        level, slower = before.angle, 0.0
    if slope == slower:
        return float(pieces.first[start])
    # level + slower (t - at) = pieces.before + slope (t - time[row])
    moment = (level - slower * at - float(pieces.before[move]) + slope * float(time[row])) / (slope - slower)
    doubt = min(4.0 * pieces.noise / abs(slope - slower), float(time[pieces.last[move]] - time[row]))
    low, high = at - doubt, float(time[row]) + doubt
    return _row_at(time, min(max(moment, low), high))


def _row_at(time: FloatArray, moment: float) -> float:
    """Return the row, with its fraction, at `moment` [s]."""
    after = int(np.searchsorted(time, moment))
    if after in (0, time.size):
        return float(min(after, time.size - 1))
    return after - float((time[after] - moment) / (time[after] - time[after - 1]))


def _is_corner(pieces: Pieces, at: int) -> bool:
    way = abs(float(pieces.after[at] - pieces.before[at]))
    return way < 6.0 * pieces.noise
