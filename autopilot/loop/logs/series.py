"""What every log becomes: series of quantities in SI units on one clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

HEADING, RATE, SPEED = "heading_rad", "yaw_rate_rad_s", "speed_m_s"
RUDDER = "rudder_rad"
"""The rudder's angle as measured, starboard positive."""
ORDER = "rudder_order_rad"
"""The rudder angle that was commanded."""
SHARE = "steering_share"
"""The share of full rudder, -1 to 1 and starboard positive, that went to the steering servo."""
LATITUDE, LONGITUDE = "latitude_rad", "longitude_rad"
PROPELLER, WIND_SPEED, WIND_DIRECTION = "propeller_rps", "wind_speed_m_s", "wind_direction_rad"

ANGLES = (HEADING, WIND_DIRECTION, LONGITUDE)
"""Quantities that go round the circle."""


FARTHEST_S = 3.0 * 86400.0
"""A sample whose time is further than this off the middle of the others' is damage: no run is so long."""


class Series(NamedTuple):
    """One quantity from one source: times [s] on the recording's clock, strictly increasing, and values."""

    quantity: str
    source: str
    time: FloatArray
    values: FloatArray

    @property
    def spacing(self) -> float:
        """Median spacing of the samples [s]; inf where there are fewer than two."""
        return float(np.median(np.diff(self.time))) if self.time.size > 1 else float("inf")

    @property
    def longest_gap(self) -> float:
        """Longest time [s] between neighbouring samples; 0 where there are fewer than two."""
        return float(np.max(np.diff(self.time))) if self.time.size > 1 else 0.0


class Recording(NamedTuple):
    """One log.

    source: the file. kind: what it is, in words. series: those of a quantity in the order in which they are
    preferred. began: Unix time [s] of the clock's zero, None where the log does not tell. notes: sentences about
    what was damaged, guessed or left out. vessel: text of the vessel file that the pilot had, in its own logs.
    """

    source: str
    kind: str
    series: tuple[Series, ...]
    began: float | None = None
    notes: tuple[str, ...] = ()
    vessel: str = ""

    def of(self, quantity: str) -> list[Series]:
        """Return the series of `quantity`, the preferred one first."""
        return [series for series in self.series if series.quantity == quantity]

    def best(self, quantity: str) -> Series | None:
        """Return the series of `quantity` to use: the first that covers half the time of the longest at least."""
        found = [series for series in self.of(quantity) if series.time.size > 1]
        if not found:
            return None
        longest = max(_span(series) for series in found)
        return next(series for series in found if _span(series) >= 0.5 * longest)


def series_of(
    quantity: str, source: str, times: Sequence[float] | FloatArray, values: Sequence[float] | FloatArray
) -> tuple[Series, ...]:
    """Return the series of finite samples in order of time, of samples at one time the last; none where empty."""
    time, value = np.asarray(times, dtype=np.float64), np.asarray(values, dtype=np.float64)
    known = np.isfinite(time) & np.isfinite(value)
    if not known.any():
        return ()
    known &= np.abs(time - np.median(time[known])) < FARTHEST_S
    time, value = time[known], value[known]
    if time.size == 0:
        return ()
    order = np.argsort(time, kind="stable")
    time, value = time[order], value[order]
    last = np.append(np.diff(time) > 0.0, True)
    return (Series(quantity, source, time[last], value[last]),)


def from_zero(recording: Recording) -> Recording:
    """Return the recording with its first sample at time 0."""
    starts = [float(series.time[0]) for series in recording.series]
    if not starts:
        return recording
    return shifted(recording, -min(starts))


def shifted(recording: Recording, seconds: float) -> Recording:
    """Return the recording on a clock that shows `seconds` more."""
    return recording._replace(
        series=tuple(series._replace(time=series.time + seconds) for series in recording.series),
        began=None if recording.began is None else recording.began - seconds,
    )


def duration(recording: Recording) -> float:
    """Return the time [s] from the first sample to the last; 0 where there is none."""
    if not recording.series:
        return 0.0
    return max(float(s.time[-1]) for s in recording.series) - min(float(s.time[0]) for s in recording.series)


def columns_to_series(
    names: Mapping[str, str], source: str, time: FloatArray, columns: Mapping[str, FloatArray]
) -> tuple[Series, ...]:
    """Return a series for each of `columns` that `names` maps to a quantity."""
    return tuple(
        series
        for column, quantity in names.items()
        if column in columns
        for series in series_of(quantity, source, time, columns[column])
    )


def _span(series: Series) -> float:
    return float(series.time[-1] - series.time[0])
