"""`autopilot log export`: a log of any kind as MCAP, Parquet or CSV, by the ending of the file."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from autopilot.errors import InputError

if TYPE_CHECKING:
    from autopilot.loop.logs.mcap_file import Entry
    from autopilot.loop.logs.series import Recording
    from autopilot.loop.recordings import LogOptions

ENDINGS = (".mcap", ".parquet", ".csv")


def export(text: str, recording: Recording, options: LogOptions, path: Path) -> str:
    """Write the recording of the log `text` to `path`; return what to say. Raises InputError."""
    ending = path.suffix.lower()
    if ending not in ENDINGS:
        raise InputError(f"--to {path}: its ending says what it becomes; allowed are {', '.join(ENDINGS)}.")
    if ending == ".mcap":
        from autopilot.loop.logs.mcap_file import write_mcap

        return f"Wrote {write_mcap(path, _entries(text, recording), text)} messages to {path}."
    from autopilot.loop.logs.columnar import write_csv, write_parquet
    from autopilot.loop.logs.table import table_of

    table = table_of(recording, options.rudder)
    if ending == ".csv":
        return f"Wrote {write_csv(path, table, text)} rows to {path}."
    return f"Wrote {write_parquet(path, table, text, recording.began)} rows to {path}."


def _entries(text: str, recording: Recording) -> Iterator[Entry]:
    """Return the series, and where the log is one .tlog also its messages and, of our own, its ticks."""
    from autopilot.loop.logs.mcap_file import message_entries, series_entries, tick_entries
    from autopilot.loop.logs.merge import sources_of
    from autopilot.loop.logs.own_log import began_of
    from autopilot.loop.logs.reading import Kind, bytes_of, kind_of
    from autopilot.loop.record import read_log

    entries = series_entries(recording)
    sources = sources_of(text)
    if len(sources) > 1:
        return entries
    path = sources[0].path
    data = bytes_of(path)
    kind = kind_of(path, data)
    if kind is Kind.OWN:
        log = read_log(Path(path))
        entries = chain(entries, tick_entries(log, began_of(path, log) or 0.0))
    return chain(entries, message_entries(data)) if kind in (Kind.OWN, Kind.TLOG) else entries
