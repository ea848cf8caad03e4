"""A table of a log as a file that others read: CSV and Parquet, positions in degrees, each column with its source."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from autopilot.errors import InputError
from autopilot.loop.logs.series import FloatArray
from autopilot.loop.logs.table import Table
from autopilot.params.saving import write_new

EXTRA = "pip install '.[export]'"


def shown_columns(table: Table) -> dict[str, FloatArray]:
    """Return the columns under the names and in the units in which they are written: SI, positions in degrees."""
    shown = {}
    for name, values in table.columns.items():
        other = name.replace("tude_rad", "tude_deg")
        shown[other] = values if other == name else values * (180.0 / math.pi)
    return shown


def write_csv(path: Path, table: Table, source: str) -> int:
    """Write a table with where its columns come from as comments; return the rows. Raises InputError."""
    lines = [f"# from {source}"] + [f"# {name}: {table.uses[name]}" for name in table.columns if name in table.uses]
    comments = len(lines)
    shown = shown_columns(table)
    lines.append(",".join(shown))
    for row in zip(*(column.tolist() for column in shown.values()), strict=True):
        lines.append(",".join("" if value != value else f"{value:.10g}" for value in row))  # noqa: PERF401
    save(path, lambda new: new.write_text("\n".join(lines) + "\n", encoding="utf-8"))
    return len(lines) - comments - 1


def write_parquet(path: Path, table: Table, source: str, began: float | None) -> int:
    """Write a table as Parquet: blanks are null, each column's source is in its metadata; return the rows.

    began: Unix time [s] of the clock's zero, kept in the file's metadata. Raises InputError, also without the extra.
    """
    try:
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    except ModuleNotFoundError:
        raise InputError(f"{path}: writing Parquet needs pyarrow; install it with {EXTRA}.") from None
    shown = shown_columns(table)
    fields, columns = [], []
    for (name, values), original in zip(shown.items(), table.columns, strict=True):
        uses = table.uses.get(original)
        fields.append(arrow.field(name, arrow.float64(), metadata={"source": uses} if uses else None))
        columns.append(arrow.array(values, mask=np.isnan(values)))
    metadata = {"source": source, **({} if began is None else {"began_unix_s": repr(began)})}
    whole: Any = arrow.Table.from_arrays(columns, schema=arrow.schema(fields, metadata=metadata))
    save(path, lambda new: parquet.write_table(whole, new, compression="zstd"))
    return int(whole.num_rows)


def save(path: Path, write: Callable[[Path], object]) -> None:
    """Let `write` fill a file, which has the name `path` once it is whole. Raises InputError where that fails."""
    try:
        write_new(path, write)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}; give another place.") from error
