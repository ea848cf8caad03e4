"""What instruments write that was never so: spikes, a compass that froze, a rudder in another unit.

A bad sample becomes a blank, never another number; whoever reads the recording is told how many there were.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from autopilot.errors import InputError

FloatArray = NDArray[np.float64]

WINDOW = 7
"""Samples a value is compared with, itself in the middle: a spike of up to three leaves their median alone."""

LOCAL_SPREAD = 8.0
"""A spike lies this many median deviations of its neighbours off their median ..."""

USUAL_SPREAD, USUAL_SHARE = 3.0, 0.97
"""... and this many times as far as this share of all samples lie off theirs; noise and manoeuvres stay inside."""

RANGE_SHARE, LEAST_HEADING_SPIKE_RAD = 0.5, math.radians(20.0)
"""It also takes this share of the range between the 2.5 and 97.5 per cent quantiles, or for a heading this angle: real
instruments have heavy tails, and a blank for each of them would lose what was measured."""

LARGEST_RUDDER_RAD = math.pi / 2.0
FROZEN_SHORTEST_S = 10.0
FROZEN_SAMPLES = 20
FROZEN_TURN_RAD = math.radians(10.0)
"""A heading is frozen where it stays the very same number while the yaw rate adds up to this turn."""

FROZEN_RUDDER_RAD, FROZEN_UNUSUAL = math.radians(4.0), 10
"""Without a yaw rate it is frozen where it stays the same while the rudder moves this far, and that for this many times
as many samples as it ever does elsewhere: a coarse compass stands for a while on every number."""

FROZEN_SHARE = 0.3
"""Without a yaw rate: the share of the recording through which a heading that stands says too little to go on."""


def without_spikes(values: FloatArray, *, angle: bool = False) -> tuple[FloatArray, int]:
    """Return `values` with isolated outliers blanked (nan), and how many those are.

    A sample is one where it is further off the median of the seven around it than all three limits above (after Hampel
    1974). angle: the values are angles [rad], compared round the circle.
    """
    measured = np.flatnonzero(np.isfinite(values))
    if measured.size < 3 * WINDOW:
        return values, 0
    known = values[measured]
    if angle:
        # how far the neighbours lie from each sample, the shorter way round, knows no seam at north
        turned = _windows(known) - known[:, np.newaxis]
        off = np.median(np.arctan2(np.sin(turned), np.cos(turned)), axis=1)
        least = LEAST_HEADING_SPIKE_RAD
    else:
        low, high = np.quantile(known, (0.025, 0.975))
        off, least = known - _medians(known), RANGE_SHARE * float(high - low)
    size = np.abs(off)
    limit = np.maximum(LOCAL_SPREAD * _medians(size), USUAL_SPREAD * float(np.quantile(size, USUAL_SHARE)))
    # differences below the last digits of the numbers are rounding
    least = max(least, 1.0e-9 * max(1.0, float(np.max(np.abs(known)))))
    spikes = size > np.maximum(limit, least)
    if not spikes.any():
        return values, 0
    cleaned = values.copy()
    cleaned[measured[spikes]] = np.nan
    return cleaned, int(np.count_nonzero(spikes))


def _medians(values: FloatArray) -> FloatArray:
    medians: FloatArray = np.median(_windows(values), axis=1)
    return medians


def _windows(values: FloatArray) -> FloatArray:
    return np.lib.stride_tricks.sliding_window_view(np.pad(values, WINDOW // 2, mode="reflect"), WINDOW)


def check_rudder(source: str, rudder: FloatArray) -> None:
    """Raise InputError where the rudder angles [rad] are so large that they must be in another unit."""
    known = rudder[np.isfinite(rudder)]
    if known.size == 0:
        return
    usual = float(np.quantile(np.abs(known), 0.95))
    if usual > LARGEST_RUDDER_RAD:
        raise InputError(
            f"{source}: the rudder lies at {usual:.4g} rad, and none goes beyond {LARGEST_RUDDER_RAD:.2f} rad "
            "(90 degrees); for a column in degrees name it rudder_deg; turn pulse widths into angles first."
        )


def without_freezes(
    source: str, time: FloatArray, heading: FloatArray, rate: FloatArray, rudder: FloatArray
) -> tuple[FloatArray, int]:
    """Return `heading` blanked where it stands still to the last digit although the yaw rate, or where there is none
    the rudder, says that the boat turns, and how many samples those are. time [s], heading [rad], rate [rad/s], rudder
    [rad]: one length, nan where missing.

    Raises InputError, naming `source`, where there is no yaw rate and a heading stands still for so much of the
    recording that nothing could be identified from it.
    """
    cleaned, blanked = heading, 0
    standing, usual = _standing(time, heading)
    for part in standing:
        known = part[np.isfinite(rate[part])]
        if known.size:
            is_frozen = _has_turned(time[known], rate[known])
        else:
            _check_share(source, time, heading, part)
            moved = rudder[part][np.isfinite(rudder[part])]
            is_moved = moved.size > 0 and float(np.ptp(moved)) > FROZEN_RUDDER_RAD
            is_frozen = is_moved and part.size >= FROZEN_UNUSUAL * usual
        if is_frozen:
            cleaned = heading.copy() if cleaned is heading else cleaned
            cleaned[part] = np.nan
            blanked += part.size
    return cleaned, blanked


def _check_share(source: str, time: FloatArray, heading: FloatArray, part: NDArray[np.intp]) -> None:
    if time[part[-1]] - time[part[0]] > FROZEN_SHARE * (time[-1] - time[0]):
        raise InputError(
            f"{source}: the heading stands at {math.degrees(heading[part[0]]) % 360.0:.1f} degrees from "
            f"{time[part[0]]:g} s to {time[part[-1]]:g} s without changing a digit: the compass froze or the "
            "stream stopped; keep only the part before or after."
        )


def _standing(time: FloatArray, heading: FloatArray) -> tuple[list[NDArray[np.intp]], int]:
    """Return the rows of each long stretch in which the heading stays the same number, and how many samples it stays so
    elsewhere at most."""
    rows = np.flatnonzero(np.isfinite(heading))
    parts = np.split(rows, np.flatnonzero(np.diff(heading[rows]) != 0.0) + 1)
    long = [p.size >= FROZEN_SAMPLES and time[p[-1]] - time[p[0]] >= FROZEN_SHORTEST_S for p in parts]
    usual = max((part.size for part, is_long in zip(parts, long, strict=True) if not is_long), default=0)
    return [part for part, is_long in zip(parts, long, strict=True) if is_long], usual


def _has_turned(time: FloatArray, rate: FloatArray) -> bool:
    turned = abs(float(np.trapezoid(rate, time)))
    return max(turned, float(np.ptp(_turned(time, rate)))) > FROZEN_TURN_RAD


def _turned(time: FloatArray, rate: FloatArray) -> FloatArray:
    steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)
    return np.concatenate(([0.0], np.cumsum(steps)))
