"""A recording laid out as columns of one length, as identification and measures take it.

Rows are the moments at which heading or yaw rate was measured, whichever comes oftener: those values stay as they were
recorded. The rarer of the two goes to the row nearest each of its samples. Rudder, speed, position, propeller and wind
are taken between their samples in straight lines, and are blank where those lie apart by more than a gap.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.runs import RudderOrigin, gap_limit
from autopilot.loop.logs.rudder import RudderSettings, rudder_of
from autopilot.loop.logs.series import (
    ANGLES,
    HEADING,
    LATITUDE,
    LONGITUDE,
    PROPELLER,
    RATE,
    RUDDER,
    SPEED,
    WIND_DIRECTION,
    WIND_SPEED,
    FloatArray,
    Recording,
    Series,
)

BESIDE = (SPEED, LATITUDE, LONGITUDE, PROPELLER, WIND_SPEED, WIND_DIRECTION)
ALIKE = 1.5
"""Two series whose spacings differ by less than this factor are sampled alike: one is taken between its samples."""


class Table(NamedTuple):
    """columns: arrays of one length under SI names, nan where blank; uses: where each column comes from, in words;
    rudder: what the rudder is."""

    columns: dict[str, FloatArray]
    uses: dict[str, str]
    rudder: RudderOrigin = "measured"


def table_of(recording: Recording, settings: RudderSettings) -> Table:
    """Return the recording as a table. Raises InputError where it has neither heading nor yaw rate."""
    heading, rate = recording.best(HEADING), recording.best(RATE)
    motions = [series for series in (heading, rate) if series is not None]
    if not motions:
        raise InputError(f"{recording.source}: holds no two headings or yaw rates; nothing can be made of it.")
    often = min(motions, key=lambda series: series.spacing)
    rows = often.time
    columns, uses = {"time_s": rows}, {}
    for series in motions:
        columns[series.quantity] = series.values if series is often else _beside(series, often)
        uses[series.quantity] = series.source
    rudder = rudder_of(recording, settings)
    if rudder is not None:
        columns[RUDDER], uses[RUDDER] = between(rudder.series, rows), rudder.words
    for quantity in BESIDE:
        known = recording.best(quantity)
        if known is not None:
            columns[quantity], uses[quantity] = between(known, rows), known.source
    return Table(columns, uses, "measured" if rudder is None else rudder.origin)


def between(series: Series, rows: FloatArray) -> FloatArray:
    """Return the series at the times `rows` [s], in straight lines between samples; nan in gaps and outside."""
    time, values = series.time, series.values
    if time.size < 2:
        return np.full(rows.size, np.nan)
    unwrapped = np.unwrap(values) if series.quantity in ANGLES else values
    found = np.interp(rows, time, unwrapped)
    right = np.clip(np.searchsorted(time, rows), 1, time.size - 1)
    inside = (rows >= time[0]) & (rows <= time[-1]) & (time[right] - time[right - 1] <= gap_limit(time))
    inside |= np.isin(rows, time)
    found = np.where(inside, found, np.nan)
    return np.angle(np.exp(1j * found)) if series.quantity in ANGLES else found


def _beside(series: Series, often: Series) -> FloatArray:
    """Return the rarer series at the rows of the other: between samples, or only at the row nearest each sample."""
    values = between(series, often.time)
    if series.spacing < ALIKE * often.spacing:
        return values
    rows = often.time
    right = np.clip(np.searchsorted(rows, series.time), 1, rows.size - 1)
    nearest = np.where(series.time - rows[right - 1] < rows[right] - series.time, right - 1, right)
    kept = np.zeros(rows.size, dtype=bool)
    kept[nearest] = True
    return np.where(kept, values, np.nan)
