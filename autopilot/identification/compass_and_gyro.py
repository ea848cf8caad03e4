"""Whether compass and gyro turn alike: where they do not, nobody knows which of them the boat turned by.

A compass that deviates shows a turn too large on some headings and too small on others; a gyro's scale is off on all of
them. Over stretches of some seconds

    turned by compass - turned by gyro
        = c t + integral of (s + p1 cos psi + q1 sin psi + p2 cos 2 psi + q2 sin 2 psi) r dt

with c the gyro's bias, s its scale, the rest the slope of the deviation (its semicircular and quadrantal parts). What
is usual of each is known before, so that a zigzag on one course, in which they cannot be parted, tells their sum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from autopilot.identification.interval import SURE_OF_IT
from autopilot.identification.marginal_likelihood import Rates
from autopilot.identification.runs import FloatArray, Run, Segment

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
