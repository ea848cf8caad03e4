"""Results as they come in: rows in CSV or Parquet, one a run, with case and seed so that any one can be run again."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any, Protocol

from autopilot.errors import InputError
from autopilot.params.saving import open_over
from sitl.campaign.cases import Case, Job, case_and_seed
from sitl.campaign.score import Figures
from sitl.campaign.work import Row

COLUMNS = ("run", "seed", *Case._fields, "done_by", *Figures._fields)


class Results(Protocol):
    """A file of results, open for writing."""

    def write(self, rows: list[Row]) -> None:
        """Add rows; they are on disk when this returns, or soon after."""

    def close(self) -> None:
        """End the file."""


def open_results(path: Path, job: Job) -> Results:
    """Return the results file, by its ending .csv or .parquet. Raises InputError."""
    if path.suffix not in (".csv", ".parquet"):
        raise InputError(f"--out {path}: the ending must be .csv or .parquet")
    try:
        return CsvResults(path, job) if path.suffix == ".csv" else ParquetResults(path, job)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error


def values_of(job: Job, row: Row) -> tuple[Any, ...]:
    """Return a row's values by COLUMNS."""
    case, _ = case_and_seed(job, row.run)
    return (row.run, row.seed, *case, row.done_by, *row.figures)


class CsvResults:
    """One line a run; numbers with all their digits."""

    def __init__(self, path: Path, job: Job) -> None:
        self._job = job
        self._file = open(open_over(path), "w", newline="", encoding="utf-8")  # noqa: PTH123, SIM115
        self._writer = csv.writer(self._file, lineterminator="\n")
        self._writer.writerow(COLUMNS)

    def write(self, rows: list[Row]) -> None:
        """Add rows."""
        self._writer.writerows(values_of(self._job, row) for row in rows)
        self._file.flush()

    def close(self) -> None:
        """End the file."""
        self._file.close()


class ParquetResults:
    """One row group for each batch."""

    def __init__(self, path: Path, job: Job) -> None:
        try:
            import pyarrow
            from pyarrow import parquet
        except ImportError as exc:
            raise InputError("Parquet needs pyarrow: pip install '.[export]', or let --out end in .csv") from exc
        self._job, self._arrow = job, pyarrow
        kinds = {int: pyarrow.int64(), float: pyarrow.float64(), str: pyarrow.string()}
        first = (0, 0, *Case("", "", 0.0, 0.0, "", 0.0, "", "", ""), "", *[0.0] * len(Figures._fields))
        self._schema = pyarrow.schema([(name, kinds[type(value)]) for name, value in zip(COLUMNS, first, strict=True)])
        self._file = open(open_over(path), "wb")  # noqa: PTH123, SIM115
        self._writer = parquet.ParquetWriter(self._file, self._schema)

    def write(self, rows: list[Row]) -> None:
        """Add rows."""
        columns = zip(*(values_of(self._job, row) for row in rows), strict=True)
        arrays = [self._arrow.array(column, kind.type) for column, kind in zip(columns, self._schema, strict=True)]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))

    def close(self) -> None:
        """End the file."""
        self._writer.close()
        self._file.close()
