"""What a log holds and what identification can use of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.runs import gap_limit, run_from_columns, seconds
from autopilot.loop.logs.rudder import RudderSettings
from autopilot.loop.logs.series import ANGLES, Recording, Series, duration
from autopilot.loop.logs.table import table_of

NEEDED = {"rudder_rad": "rudder", "speed_m_s": "speed"}


class SeriesInfo(NamedTuple):
    """One series: median rate [Hz], times [s] of first and last sample, gaps that break the record, range."""

    quantity: str
    source: str
    samples: int
    rate_hz: float
    begins: float
    ends: float
    gaps: int
    longest_gap: float
    low: float
    high: float


class LogInfo(NamedTuple):
    """What a log is, holds, and gives the identification.

    duration [s]; began: Unix time [s] or None; uses: where each column would come from; usable: seconds in runs
    without gaps, and segments how many those are; missing: why it cannot be used, '' where it can.
    """

    source: str
    kind: str
    duration: float
    began: float | None
    series: tuple[SeriesInfo, ...]
    uses: dict[str, str]
    usable: float
    segments: int
    missing: str
    notes: tuple[str, ...]


def info_of(recording: Recording, settings: RudderSettings) -> LogInfo:
    """Return what there is to know of a recording; never raises for what is only missing."""
    uses, usable, segments, missing, left_out = _use(recording, settings)
    return LogInfo(
        recording.source,
        recording.kind,
        duration(recording),
        recording.began,
        tuple(_info(series) for series in recording.series),
        uses,
        usable,
        segments,
        missing,
        (*recording.notes, *left_out),
    )


def _use(recording: Recording, settings: RudderSettings) -> tuple[dict[str, str], float, int, str, tuple[str, ...]]:
    uses: dict[str, str] = {}
    try:
        table, uses, _ = table_of(recording, settings)
        for column, name in NEEDED.items():
            if column not in table:
                raise InputError(f"{recording.source}: holds no {name}; merge it in from another log with +FILE.")
        run = run_from_columns(recording.source, table)
    except InputError as error:
        return uses, 0.0, 0, str(error), ()
    return uses, seconds(run), len(run.segments), "", run.notes


def _info(series: Series) -> SeriesInfo:
    values = np.unwrap(series.values) if series.quantity in ANGLES else series.values
    apart = np.diff(series.time)
    limit = gap_limit(series.time) if apart.size else 0.0
    return SeriesInfo(
        series.quantity,
        series.source,
        int(series.time.size),
        1.0 / series.spacing,
        float(series.time[0]),
        float(series.time[-1]),
        int(np.count_nonzero(apart > limit)),
        series.longest_gap,
        float(np.min(values)),
        float(np.max(values)),
    )
