"""Recordings of any kind as runs for the identification: our own .tlog files, and CSV tables."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from autopilot.identification.runs import Run, run_from_columns
from autopilot.loop.csv_log import RUN_NEEDS, read_csv

TLOG_SUFFIXES = (".tlog",)


def load_run(path: str, column_map: Mapping[str, str] | None = None, reverse_rudder: bool = False) -> Run:
    """Return the recording at `path`, a MAVLink .tlog or a CSV table with the columns of `column_map`.

    reverse_rudder: the recorded rudder is positive to port. Raises InputError where the file cannot be used.
    """
    table = _table(path, column_map)
    if reverse_rudder:
        table = {**table, "rudder_rad": -table["rudder_rad"]}
    return run_from_columns(path, table)


def _table(path: str, column_map: Mapping[str, str] | None) -> Mapping[str, NDArray[np.float64]]:
    if Path(path).suffix.lower() in TLOG_SUFFIXES:
        from autopilot.loop.record import read_table

        return {name: np.asarray(values, dtype=np.float64) for name, values in read_table(Path(path)).items()}
    return read_csv(path, column_map, RUN_NEEDS)
