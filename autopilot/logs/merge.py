"""Several logs of one run on one clock: by a given offset, by how the boat turned in both, or by the date.

The offset is where the yaw rates of both fit best. With a of the longer and b of the shorter record on a grid,

    s(L) = sum a(t) b(t - L) / sqrt( sum of b^2  *  sum of a^2 where they overlap ),

1 where b lies wholly inside a and is the same. A zigzag looks much the same a period later: where a second maximum
comes within SECOND_BEST of the first, nothing is guessed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.files.outside import typed_number
from autopilot.logs.series import HEADING, RATE, FloatArray, Recording, Series, from_zero, shifted

GRID_S = (0.05, 1.0)
SMOOTH_S = 1.0
LEAST_MATCH = 0.6
SECOND_BEST = 0.9
LEAST_LIKENESS = 0.93
LEAST_OVERLAP = 0.5
"""The share of the shorter record that both must have."""
NEAR_S = 2.0
LONGEST_S = 24.0 * 3600.0
DATE_TRUST_S = 30.0
"""Where both logs know the date, the match is looked for this far [s] either side."""


Begun = tuple[float, FloatArray]
"""When [s] the samples on the grid begin, and those."""


class Source(NamedTuple):
    """A file, and how long [s] after the first file it begins, None where that has to be found."""

    path: str
    offset: float | None = None


class Match(NamedTuple):
    """How long [s] after the other the second record begins, and how well they fit there, 0 to 1."""

    offset: float
    quality: float


def sources_of(text: str) -> list[Source]:
    """Return the files of one run: `a.BIN+b.nmea@-3.5` is two, the second begun 3.5 s before the first.

    Raises InputError.
    """
    if Path(text).exists() or ("+" not in text and "@" not in text):
        return [Source(text)]
    sources = [_source(part, text) for part in text.split("+")]
    if sources[0].offset is not None:
        raise InputError(f"{text}: the first file sets the clock, so its offset is 0; give the others' with @.")
    return sources


def _source(part: str, text: str) -> Source:
    if not part:
        raise InputError(f"{text}: write FILE+FILE, or FILE+FILE@SECONDS where the second begins so much later.")
    path, at, seconds = part.rpartition("@")
    if not at or Path(part).exists():
        return Source(part)
    try:
        offset = typed_number(seconds)
    except ValueError:
        offset = float("nan")
    if not abs(offset) <= LONGEST_S:
        raise InputError(f"{part}: {seconds!r} is no offset; write seconds behind the @, up to a day.")
    return Source(path, offset)


def merged(recordings: Sequence[Recording], offsets: Sequence[float | None]) -> Recording:
    """Return the recordings as one, on the first one's clock; what several have comes from the first that has it.

    offsets [s]: how long after the first each begins (the first one's is not looked at), None to find it. Raises
    InputError where one cannot be found.
    """
    first = recordings[0]
    if len(recordings) == 1:
        return first
    series, notes = list(_named(first)), list(first.notes)
    for other, given in zip(recordings[1:], offsets[1:], strict=True):
        offset, how = (given, "as given") if given is not None else _offset(first, other)
        series.extend(_named(shifted(other, offset)))
        notes.extend((*other.notes, f"{other.source}: begins {offset:+.2f} s after {first.source}, {how}."))
    source = "+".join(recording.source for recording in recordings)
    kinds = " and ".join(dict.fromkeys(recording.kind for recording in recordings))
    vessel = next((recording.vessel for recording in recordings if recording.vessel), "")
    late = next((recording.late for recording in recordings if recording.vessel), math.nan)
    return from_zero(Recording(source, kinds, tuple(series), first.began, tuple(notes), vessel, late))


def _named(recording: Recording) -> list[Series]:
    name = Path(recording.source).name
    return [series._replace(source=f"{name}: {series.source}") for series in recording.series]


def _offset(first: Recording, other: Recording) -> tuple[float, str]:
    by_date = None if first.began is None or other.began is None else other.began - first.began
    ours, theirs = yaw_rate_of(first), yaw_rate_of(other)
    match = best_match(ours, theirs, by_date) if ours is not None and theirs is not None else None
    if match is not None:
        return match.offset, f"where the yaw rates fit best ({match.quality:.2f} of 1)"
    if by_date is not None:
        return by_date, "by the dates in both"
    reason = "their yaw rates fit nowhere, or in several places"
    if ours is None or theirs is None:
        reason = "one of them has neither heading nor yaw rate"
    raise InputError(
        f"{other.source}: when it begins against {first.source} cannot be determined ({reason}); give it as "
        f"{Path(other.source).name}@SECONDS."
    )


def yaw_rate_of(recording: Recording) -> tuple[FloatArray, FloatArray] | None:
    """Return times [s] and yaw rates [rad/s], measured or from the heading; None where there is neither."""
    rate, heading = recording.best(RATE), recording.best(HEADING)
    if rate is not None:
        return rate.time, rate.values
    if heading is None or heading.time.size < 3:
        return None
    return heading.time, np.gradient(np.unwrap(heading.values), heading.time)


def best_match(
    first: tuple[FloatArray, FloatArray], other: tuple[FloatArray, FloatArray], around: float | None = None
) -> Match | None:
    """Return where `other` (times [s], yaw rates) fits `first` best, each on its own clock; None: nowhere clearly.

    around [s]: where to look, DATE_TRUST_S either side; None: everywhere.
    """
    spacing = max(float(np.median(np.diff(time))) for time, _ in (first, other))
    dt = min(max(spacing, GRID_S[0]), GRID_S[1])
    a, b = _on_grid(*first, dt), _on_grid(*other, dt)
    lags, score = _scores(a, b) if b.size <= a.size else _swapped(_scores(b, a))
    offsets = lags * dt + first[0][0] - other[0][0]
    if around is not None:
        near = np.abs(offsets - around) <= DATE_TRUST_S
        offsets, score = offsets[near], score[near]
    if a.size < 2 or b.size < 2 or score.size < 3 or not np.isfinite(score).all():
        return None
    peak = int(np.argmax(score))
    if score[peak] < LEAST_MATCH or _second(score, peak) > SECOND_BEST * score[peak]:
        return None
    return _refined((first[0][0], a), (other[0][0], b), dt, float(offsets[peak]))


def _refined(
    first: tuple[float, FloatArray], other: tuple[float, FloatArray], dt: float, offset: float
) -> Match | None:
    """Return the match near `offset` [s] where the rates agree best over what both have, None if too little.

    s(L) leans towards more overlap; the likeness sum of a b / sqrt(sum of a^2 * sum of b^2) of the overlap does not.
    """
    near = offset + np.arange(-NEAR_S, NEAR_S + 0.25 * dt, 0.5 * dt)
    likeness = np.array([_likeness(first, other, dt, candidate) for candidate in near])
    peak = int(np.argmax(likeness))
    if likeness[peak] < LEAST_LIKENESS:
        return None
    return Match(float(near[peak] + _vertex(likeness, peak) * 0.5 * dt), float(likeness[peak]))


def _likeness(first: Begun, other: Begun, dt: float, offset: float) -> float:
    """Return the likeness of the rates where they overlap, 0 where that is less than half of the shorter."""
    (start, a), (begin, b) = first, other
    times = begin + offset + dt * np.arange(b.size)
    inside = (times >= start) & (times <= start + dt * (a.size - 1))
    if np.count_nonzero(inside) < LEAST_OVERLAP * min(a.size, b.size):
        return 0.0
    ours, theirs = np.interp(times[inside], start + dt * np.arange(a.size), a), b[inside]
    energy = float(np.sum(ours**2) * np.sum(theirs**2))
    return float(np.sum(ours * theirs)) / energy**0.5 if energy > 0.0 else 0.0


def _on_grid(time: FloatArray, rate: FloatArray, dt: float) -> FloatArray:
    """Return means over SMOOTH_S at spacing dt; what both lose at their beginnings is the same."""
    grid = np.arange(time[0], time[-1] + 0.5 * dt, dt)
    width = max(1, round(SMOOTH_S / dt))
    return np.convolve(np.interp(grid, time, rate), np.full(width, 1.0 / width), mode="valid")


def _scores(long: FloatArray, short: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return lags [samples of grid] of `short` behind `long`, and s(L)."""
    from scipy.signal import fftconvolve  # slow to load, and most logs come alone

    lags = np.arange(-(short.size - 1), long.size, dtype=np.float64)
    products = fftconvolve(long, short[::-1])
    energy = np.maximum(fftconvolve(long**2, np.ones(short.size)), 0.0)
    least = 1.0e-3 * float(np.max(energy, initial=0.0))
    return lags, products / np.sqrt(max(float(np.sum(short**2)), 1.0e-30) * np.maximum(energy, max(least, 1.0e-30)))


def _swapped(found: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    lags, score = found
    return -lags[::-1], score[::-1]


def _second(score: FloatArray, peak: int) -> float:
    """Return the largest value beyond the valleys on both sides of the peak."""
    left, right = peak, peak
    while left > 0 and score[left - 1] <= score[left]:
        left -= 1
    while right < score.size - 1 and score[right + 1] <= score[right]:
        right += 1
    return max(float(np.max(score[:left], initial=0.0)), float(np.max(score[right + 1 :], initial=0.0)))


def _vertex(score: FloatArray, peak: int) -> float:
    """Return where between -0.5 and 0.5 the parabola through the peak and its neighbours is highest."""
    if not 0 < peak < score.size - 1:
        return 0.0
    before, at, after = score[peak - 1 : peak + 2]
    bend = before - 2.0 * at + after
    return float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0
