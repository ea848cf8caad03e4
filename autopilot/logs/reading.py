"""A log of any kind, known by its content, as a recording.

What a log holds and what identification can use of it.

Logs of any kind as runs for the identification, several of one run merged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.files.outside import read_regular
from autopilot.identification.runs import Run, gap_limit, run_from_columns, seconds
from autopilot.links.mavlink.frames import MAGIC_V1, MAGIC_V2
from autopilot.logs.format import LogFormat
from autopilot.logs.format import ReadOptions as ReadOptions
from autopilot.logs.merge import merged, sources_of
from autopilot.logs.series import ANGLES, THROTTLE, FloatArray, Recording, Series, duration
from autopilot.logs.table import RudderSettings, Table, orders_of, table_of
from autopilot.logs.unread import LOOK_AT, named, named_by_ending

MODULES = (
    "own_log",
    "tlog",
    "dataflash",
    "ulog",
    "mcap_log",
    "n2k_json",
    "n2k_text",
    "nmea_text",
    "csv_log",
)
"""Modules of this room with a constant FORMAT, in the order in which a file is asked whether it is of one."""
FORMATS: tuple[LogFormat, ...] = tuple(import_module(f"autopilot.logs.{module}").FORMAT for module in MODULES)


def examples() -> str:
    """Return what can be read, in words."""
    return ", ".join(each.example for each in FORMATS if each.example)


def read_recording(path: str, options: ReadOptions = ReadOptions()) -> Recording:  # noqa: B008 - immutable
    """Return the recording in a log of any kind. Raises InputError where the file cannot be used."""
    data = bytes_of(path)
    return format_of(path, data).read(path, data, options)


def format_of(path: str, data: bytes) -> LogFormat:
    """Return of what format a file is, by its content. Raises InputError where that is none known here."""
    if (found := next((each for each in FORMATS if not each.is_text and each.is_it(data)), None)) is not None:
        return found
    if (refusal := named(path, data)) is not None:
        raise InputError(refusal)
    for each in FORMATS:
        if each.ending and Path(path).suffix.lower() == each.ending:
            raise InputError(f"{path}: {each.broken}")
    if data[:1] in (bytes([MAGIC_V1]), bytes([MAGIC_V2])):
        raise InputError(f"{path}: is a MAVLink stream without time stamps; record it as .tlog.")
    if b"\0" in data[:LOOK_AT]:
        raise InputError(
            named_by_ending(path)
            or f"{path}: is no log of a kind known here, or its beginning is lost; readable are {examples()}."
        )
    return next(each for each in FORMATS if each.is_text and each.is_it(data))


def bytes_of(path: str) -> bytes:
    try:
        data = read_regular(path)
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}; give a log that exists and can be read") from error
    if not data:
        raise InputError(f"{path}: is empty; a log is needed: {examples()}.")
    return data


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


class LogOptions(NamedTuple):
    """How to read logs, and where the rudder comes from."""

    reading: ReadOptions = ReadOptions()
    rudder: RudderSettings = RudderSettings()


def load_recording(text: str, options: ReadOptions = ReadOptions()) -> Recording:  # noqa: B008 - immutable
    """Return the log `text`, or the logs of one run merged: FILE+FILE@SECONDS. Raises InputError."""
    sources = sources_of(text)
    return merged([read_recording(source.path, options) for source in sources], [source.offset for source in sources])


def load_run(
    text: str,
    column_map: Mapping[str, str] | None = None,
    reverse_rudder: bool = False,
    options: LogOptions = LogOptions(),  # noqa: B008 - immutable
) -> Run:
    """Return the run in the log `text`, or in several logs of it: FILE+FILE@SECONDS.

    column_map: what CSV tables call their columns. reverse_rudder: the recorded rudder is positive to port. Raises
    InputError where a file cannot be used.
    """
    reading = options.reading._replace(columns=column_map or options.reading.columns)
    sources = sources_of(text)
    as_it_is = format_of(text, bytes_of(text)).run if len(sources) == 1 else None
    if as_it_is is not None:
        columns, notes = as_it_is(text, reading)
        run = run_from_columns(text, _turned(columns, reverse_rudder))
        return run._replace(notes=(*notes, *run.notes))
    recording = load_recording(text, reading)
    table = _table(text, recording, options.rudder)
    notes = recording.notes
    if table.rudder == "ordered":
        notes = (*notes, f"{text}: the rudder is {table.uses['rudder_rad']}.")
    run = run_from_columns(text, _turned(table.columns, reverse_rudder))
    throttle = table.columns.get(THROTTLE)
    known = throttle is not None and bool(np.any(np.isfinite(throttle)))
    mean = float(np.nanmean(throttle)) if throttle is not None and known else math.nan
    orders = None if reverse_rudder else orders_of(recording)
    run = run._replace(notes=(*notes, *run.notes), rudder=table.rudder, orders=orders)
    return run._replace(vessel=recording.vessel, throttle=mean)


def _turned(columns: Mapping[str, FloatArray], reverse_rudder: bool) -> Mapping[str, FloatArray]:
    return {**columns, "rudder_rad": -columns["rudder_rad"]} if reverse_rudder else columns


def _table(text: str, recording: Recording, rudder: RudderSettings) -> Table:
    table = table_of(recording, rudder)
    if "rudder_rad" not in table.columns:
        hint = next((note for note in recording.notes if "servo" in note), "")
        raise InputError(hint or f"{text}: holds no rudder; the rudder's angle, its servo or its orders are needed.")
    if "speed_m_s" not in table.columns:
        raise InputError(f"{text}: holds no two speeds; merge them in from another log of the run with +FILE.")
    return table
