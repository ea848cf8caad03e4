"""Whether compass and gyro turn alike: where they do not, nobody knows which of them the boat turned by.

A compass that deviates shows a turn too large on some headings and too small on others; a gyro's scale is off on all of
them. Over stretches of some seconds

    turned by compass - turned by gyro
        = c t + integral of (s + p1 cos psi + q1 sin psi + p2 cos 2 psi + q2 sin 2 psi) r dt

with c the gyro's bias, s its scale, the rest the slope of the deviation (its semicircular and quadrantal parts). What
is usual of each is known before, so that a zigzag on one course, in which they cannot be parted, tells their sum.

And by how much one of them is late: a compass that shows what the boat headed L ago stands by L r beside the turned
angle of the gyro. No boat is needed to tell that. What else parts them walks (the gyro's noise, summed up) and is white
(the compass's): innovations of a local level (Muth 1960), whose gain the likelihood tells, are white, and by them the
terms above and L are found by least squares.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.identification.interval import SURE_OF_IT
from autopilot.identification.likelihood_record import level_of, without_noise
from autopilot.identification.marginal_likelihood import Rates
from autopilot.identification.runs import FloatArray, Run, Segment, running

STRETCH_S, FEWEST = 5.0, 12
"""Turns are compared over so long a time [s], or over less where that would be fewer stretches than this."""
USUAL = (math.radians(1.0), 0.05, 0.15, 0.15, 0.15, 0.15)
"""Standard deviations of c [rad/s], s and the slopes: 0.15 is a deviation of 8.6 deg, once round the compass."""
SURELY, LEAST = 4.0, 0.03
"""They differ where that exceeds so many standard errors, and this share."""
LEAST_NOISE = math.radians(0.05)
"""No compass is better [rad]."""


class TurnedApart(NamedTuple):
    """Of a run: by how much of each turn of the gyro the compass shows more, as a share."""

    source: str
    share: float

    @property
    def doubt_of_gain(self) -> float:
        """By what share K's standard error is larger for it: so that its interval, which is that of 1/K, and that of
        K/T hold both boats, that of the gyro and that of the compass, whichever of them was found."""
        return math.expm1(abs(math.log1p(self.share))) / SURE_OF_IT

    def doubt(self, rates: Rates) -> FloatArray:
        """Return the covariance of K/T, n1/T, n3/T and n0/T that this is worth, shape (4, 4): of a boat that turns by a
        share x more, K/T and n0/T are larger by x, and n3/T is smaller by 2 x."""
        a, _, d, e = rates
        way = self.doubt_of_gain * np.array([a, 0.0, -2.0 * d, e])
        return np.outer(way, way)

    def sentence(self) -> str:
        """Return what this means for whoever uses the model."""
        return (
            f"Compass and gyro disagree: where the gyro turns 10 deg the compass turns {10.0 * (1.0 + self.share):.1f} "
            f"({self.source}): the compass deviates, or the gyro's scale is off. K may be wrong by as much, and its "
            "interval holds that; swing the compass, or sail the zigzag on opposite courses too."
        )


def turned_apart(runs: Sequence[Run]) -> TurnedApart | None:
    """Return the run in which compass and gyro disagree most, None where they agree or are not both there."""
    found = []
    for run in runs:
        rows = [row for segment in run.segments for row in _stretches(segment)]
        if len(rows) < FEWEST:
            continue
        table = np.array(rows)
        terms, apart = table[:, :-1], table[:, -1]
        noise = max(math.sqrt(2.0) * 1.4826 * float(np.median(np.abs(apart - np.median(apart)))) / 2.0, LEAST_NOISE)
        for _ in range(ROUNDS):
            spread = np.linalg.inv(terms.T @ terms / noise**2 + np.diag(np.array(USUAL) ** -2.0))
            best = spread @ (terms.T @ apart) / noise**2
            noise = max(float(np.sqrt(np.mean((apart - terms @ best) ** 2))), LEAST_NOISE)
        by_gyro = terms[:, 1]
        mean = by_gyro @ terms[:, 1:] / max(float(by_gyro @ by_gyro), 1.0e-12)
        share, error = float(mean @ best[1:]), math.sqrt(float(mean @ spread[1:, 1:] @ mean))
        if abs(share) > max(SURELY * error, LEAST):
            found.append(TurnedApart(run.source, share))
    return max(found, key=lambda each: abs(each.share), default=None)


ROUNDS = 4


class Late(NamedTuple):
    """By how much later [s] than the gyro a compass shows the boat, below 0 where the gyro is later; its standard
    error [s]."""

    by: float
    error: float


def compass_late(segments: Sequence[Segment]) -> Late | None:
    """Return by how much the compass is later than the gyro; None where that is not surely anything, or not known."""
    by, gains, pieces = 0.0, list(GAINS), _liveliest(segments)
    for _ in range(ROUNDS):
        parts = [part for segment in pieces if (part := _apart(segment, by)) is not None]
        if not parts:
            return None
        (_, more, error), gain = min((_behind(parts, gain), gain) for gain in gains)
        by, gains = min(max(by + more, -MOST_LATE_S), MOST_LATE_S), [gain]
        if abs(more) < 0.1 * error:
            break
    is_sure = abs(by) > max(SURELY * error, LEAST_LATE_S) and abs(by) < MOST_LATE_S
    return Late(by, error) if is_sure else None


def in_time(run: Run) -> Run:
    """Return the run with its headings as late as its gyro, where the one is surely later than the other: to each
    heading is added what the gyro turned since. What both are late by shows in how late the boat follows its rudder."""
    late = compass_late(run.segments)
    if late is None:
        return run
    segments = []
    for segment in run.segments:
        known = np.isfinite(segment.rate)
        if np.count_nonzero(known) > 1:
            turned = _turned(segment.time[known], segment.rate[known], segment.time)
            before = _turned(segment.time[known], segment.rate[known], segment.time - late.by)
            segment = segment._replace(heading=segment.heading + turned - before)
        segments.append(segment)
    which, other = ("compass", "gyro") if late.by > 0.0 else ("gyro", "compass")
    note = (
        f"{run.source}: the {which} shows the boat {abs(late.by):.2g} +- {SURE_OF_IT * late.error:.1g} s later than "
        f"the {other}; the headings are taken at the gyro's time."
    )
    return run._replace(segments=tuple(segments), notes=(*run.notes, note), compass_late=late.by)


MOST_LATE_S, LEAST_LATE_S = 3.0, 0.02
"""No compass is later [s], and less is no matter."""
GAINS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 0.6, 1.0)
"""Of the local level, that are tried: 0 of a compass with noise and a gyro without, 1 the other way round."""
BLOCK_S, FEWEST_ROWS = 5.0, 50
"""Errors go together over so long [s], and of fewer rows nothing is found."""


PIECE, PIECES = 2000, 5
"""A recording is looked at in pieces of so many rows, in so many at most: a minute of zigzag tells enough."""


def _liveliest(segments: Sequence[Segment]) -> list[Segment]:
    """Return the pieces of the segments in which the boat's rate changes most, in order."""
    pieces = []
    for segment in segments:
        for first in range(0, segment.time.size, PIECE):
            rows = slice(first, first + PIECE)
            pieces.append(Segment(*(values[rows] if values.size else values for values in segment)))
    if len(pieces) <= PIECES:
        return pieces
    known = [piece.rate[np.isfinite(piece.rate)] for piece in pieces]
    turning = [float(np.std(rate)) if rate.size else 0.0 for rate in known]
    return [pieces[k] for k in sorted(np.argsort(turning)[-PIECES:].tolist())]


def _apart(segment: Segment, late: float) -> FloatArray | None:
    """Return of each heading: its time, what goes with the terms of `USUAL` and with the lateness, and by how much the
    heading is off the gyro's turned angle so `late` [s], shape (9, N); None of a segment with too few."""
    rated, headed = np.isfinite(segment.rate), np.isfinite(segment.heading)
    if min(np.count_nonzero(rated), np.count_nonzero(headed)) < FEWEST_ROWS:
        return None
    time, rate = segment.time[rated], segment.rate[rated]
    at, heading = segment.time[headed], segment.heading[headed]
    then, course = at - late, np.interp(time, at, heading)
    # noise in what L goes with would draw it towards 0, and goes with that of the turned angle
    turning = np.interp(then, time, without_noise(rate))
    waves = [rate * wave(k * course) for k in (1, 2) for wave in (np.cos, np.sin)]
    turned = [_turned(time, values, then) for values in (rate, *waves)]
    return np.stack([at, at - at[0], *turned, -turning, heading - turned[0]])


def _turned(time: FloatArray, rate: FloatArray, moments: FloatArray) -> FloatArray:
    """Return the integral of a `rate` from its first `time` on to other moments, straight lines between, level
    beyond."""
    whole = running(time, rate)
    left = np.clip(np.searchsorted(time, moments, side="right") - 1, 0, time.size - 2)
    since, there = moments - time[left], np.interp(moments, time, rate)
    begun = np.where(since < 0.0, there, rate[left])
    ended = np.maximum(moments - time[-1], 0.0)
    return np.asarray(whole[left] + 0.5 * (begun + there) * (since - ended) + ended * there)


def _behind(parts: Sequence[FloatArray], gain: float) -> tuple[float, float, float]:
    """Return the variance [rad^2] of the innovations with such a gain, what the lateness is more than supposed, and its
    standard error [s]: by how the scores of blocks scatter (White 1980), or by the residuals, whichever is larger."""
    rows = np.concatenate([_innovations(part[1:], gain) for part in parts], axis=1)
    blocks = np.concatenate([k * 1.0e6 + part[0, 1:] // BLOCK_S for k, part in enumerate(parts)])
    terms, off = rows[:-1].T, rows[-1]
    usual = np.diag(np.array([*USUAL, MOST_LATE_S]) ** -2.0)
    variance, best = float(np.mean(off**2)), np.zeros(terms.shape[1])
    for _ in range(2):
        known = terms.T @ terms + max(variance, LEAST_NOISE**2) * usual
        best = np.linalg.solve(known, terms.T @ off)
        variance = float(np.mean((off - terms @ best) ** 2))
    spread = np.linalg.inv(known)
    ends = np.flatnonzero(np.diff(blocks)) + 1
    scores = np.add.reduceat(terms * (off - terms @ best)[:, None], np.concatenate([[0], ends]), axis=0)
    by_blocks = spread @ (scores.T @ scores) @ spread
    error = math.sqrt(max(float(by_blocks[-1, -1]), max(variance, LEAST_NOISE**2) * float(spread[-1, -1])))
    return variance, float(best[-1]), error


def _innovations(values: FloatArray, gain: float) -> FloatArray:
    """Return what is new in each of the rows of `values` but their first, beside a level that follows them."""
    return np.asarray(values[:, 1:] - level_of(values.T, gain).T[:, :-1])


def on_one_course(runs: Sequence[Run]) -> str:
    """Return what a compass alone cannot show where all runs lie about one course; "" where a gyro or courses do."""
    segments = [segment for run in runs for segment in run.segments]
    if any(np.isfinite(segment.rate).any() for segment in segments):
        return ""
    headings = [segment.heading[np.isfinite(segment.heading)] for segment in segments]
    middles = np.array([np.exp(1j * float(np.median(each))) for each in headings if each.size])
    off = np.angle(middles / middles[0]) if middles.size else np.zeros(1)
    if float(np.ptp(off)) > APART or max(float(np.ptp(each)) for each in headings if each.size) > TURNS:
        return ""
    return (
        "No gyro was recorded, and all runs lie about one course: they do not show a compass that deviates, which "
        "makes K 10 % wrong for each degree that its deviation changes by over 10 deg of heading; sail the zigzag on "
        "the opposite course too."
    )


APART, TURNS = math.radians(60.0), math.pi
"""Courses so far apart [rad], or so large a turn, show a deviation in how the runs, or their halves, differ."""


def _stretches(segment: Segment) -> list[FloatArray]:
    """Return of each stretch its time, what the gyro's turn is worth for s and the slopes, and how turns differ."""
    known = np.isfinite(segment.heading) & np.isfinite(segment.rate)
    if np.count_nonzero(known) < 2 * FEWEST:
        return []
    time, heading, rate = segment.time[known], segment.heading[known], segment.rate[known]
    middle, steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time), 0.5 * (heading[1:] + heading[:-1])
    worth = np.stack(
        [
            np.diff(time),
            middle,
            *(middle * wave(k * steps) for k in (1, 2) for wave in (np.cos, np.sin)),
        ]
    )
    total = np.concatenate([np.zeros((worth.shape[0], 1)), np.cumsum(worth, axis=1)], axis=1)
    lasts = float(time[-1] - time[0])
    apart = min(STRETCH_S, lasts / (FEWEST + 1.5))
    edges = np.unique(np.searchsorted(time, np.arange(time[0], time[-1], apart)))
    # the compass is averaged round each edge, as far as neighbours are not reached
    reach = max(int(np.min(np.diff(edges), initial=1) // 4), 0) if edges.size > 1 else 0

    def smooth(values: FloatArray) -> FloatArray:
        return np.array([np.mean(values[max(at - reach, 0) : at + reach + 1]) for at in edges])

    turned = smooth(heading - total[1])
    moved = np.stack([smooth(row) for row in total])
    return [*np.concatenate([np.diff(moved, axis=1), np.diff(turned)[None]]).T]
