"""Logs of any kind as runs for the identification, several of one run merged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from autopilot.errors import InputError
from autopilot.identification.runs import Run, run_from_columns
from autopilot.loop.csv_log import RUN_NEEDS, read_csv
from autopilot.loop.logs.merge import merged, sources_of
from autopilot.loop.logs.reading import Kind, ReadOptions, bytes_of, kind_of, read_recording
from autopilot.loop.logs.rudder import RudderSettings
from autopilot.loop.logs.series import FloatArray, Recording
from autopilot.loop.logs.table import Table, table_of


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
    if len(sources) == 1 and kind_of(text, bytes_of(text)) is Kind.TABLE:
        columns, notes = read_csv(text, reading.columns, RUN_NEEDS)
        run = run_from_columns(text, _turned(columns, reverse_rudder))
        return run._replace(notes=(*notes, *run.notes))
    recording = load_recording(text, reading)
    table = _table(text, recording, options.rudder)
    notes = recording.notes
    if table.rudder == "ordered":
        notes = (*notes, f"{text}: the rudder is {table.uses['rudder_rad']}.")
    run = run_from_columns(text, _turned(table.columns, reverse_rudder))
    return run._replace(notes=(*notes, *run.notes), rudder=table.rudder, vessel=recording.vessel)


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
