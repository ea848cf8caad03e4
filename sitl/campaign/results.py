"""Results as they come in: rows in CSV or Parquet, one a run, with case and seed so that any one can be run again.

What a study says, case by case: medians and quantiles over its runs.

A study's page: heading error against rudder travel, and the table of cases.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple, Protocol

import numpy as np

from autopilot.errors import InputError
from autopilot.files.saving import Over, why_not
from autopilot.report.page import Line, Opening, Panel, Section, render, time_figure
from sitl.campaign.compiled_run import Figures
from sitl.campaign.study import Case, Job, case_and_seed, cases_of, number_of_runs
from sitl.campaign.work import COMPILED, FULL, REFUSED, Row

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
        raise InputError(f"{path}: cannot be written: {why_not(error)}") from error


def values_of(job: Job, row: Row) -> tuple[Any, ...]:
    """Return a row's values by COLUMNS."""
    case, _ = case_and_seed(job, row.run)
    return (row.run, row.seed, *case, row.done_by, *row.figures)


class CsvResults:
    """One line a run; numbers with all their digits. What was there stays until the first."""

    def __init__(self, path: Path, job: Job) -> None:
        self._job, self._over = job, Over(path)
        self._file: IO[str] | None = None

    def write(self, rows: list[Row]) -> None:
        """Add rows."""
        lines: list[Sequence[Any]] = [values_of(self._job, row) for row in rows]
        if self._file is None:
            self._over.begin()
            self._file = open(  # noqa: SIM115
                self._over.descriptor, "w", newline="", encoding="utf-8", closefd=False
            )
            lines.insert(0, COLUMNS)
        csv.writer(self._file, lineterminator="\n").writerows(lines)
        self._file.flush()

    def close(self) -> None:
        """End the file."""
        if self._file is not None:
            self._file.close()
        self._over.close()


class ParquetResults:
    """One row group for each batch. What was there stays until the first."""

    def __init__(self, path: Path, job: Job) -> None:
        try:
            import pyarrow
            from pyarrow import parquet
        except ImportError as exc:
            raise InputError("Parquet needs pyarrow: pip install '.[export]', or let --out end in .csv") from exc
        self._job, self._arrow, self._parquet = job, pyarrow, parquet
        kinds = {int: pyarrow.int64(), float: pyarrow.float64(), str: pyarrow.string()}
        first = (0, 0, *Case("", "", 0.0, 0.0, "", 0.0, "", "", ""), "", *[0.0] * len(Figures._fields))
        self._schema = pyarrow.schema([(name, kinds[type(value)]) for name, value in zip(COLUMNS, first, strict=True)])
        self._over = Over(path)
        self._file: IO[bytes] | None = None
        self._writer: Any = None

    def write(self, rows: list[Row]) -> None:
        """Add rows."""
        if self._file is None:
            self._over.begin()
            self._file = open(self._over.descriptor, "wb", closefd=False)  # noqa: SIM115
            self._writer = self._parquet.ParquetWriter(self._file, self._schema)
        columns = zip(*(values_of(self._job, row) for row in rows), strict=True)
        arrays = [self._arrow.array(column, kind.type) for column, kind in zip(columns, self._schema, strict=True)]
        self._writer.write_table(self._arrow.Table.from_arrays(arrays, schema=self._schema))

    def close(self) -> None:
        """End the file."""
        if self._file is not None:
            self._writer.close()
            self._file.close()
        self._over.close()


QUANTILES = (0.05, 0.5, 0.95)


class CaseSummary(NamedTuple):
    """A case with its number of runs, how many of them were refused, and by figure its quantiles of 5, 50, 95 %."""

    case: Case
    runs: int
    refused: int
    quantiles: dict[str, tuple[float, float, float]]


class Tally:
    """Collects the figures of all runs."""

    def __init__(self, job: Job) -> None:
        self._job = job
        self._figures = np.full((number_of_runs(job), len(Figures._fields)), math.nan)
        self.done = {COMPILED: 0, FULL: 0, REFUSED: 0}

    def add(self, rows: list[Row]) -> None:
        """Take rows in."""
        for row in rows:
            self._figures[row.run] = row.figures
            self.done[row.done_by] += 1

    def cases(self) -> list[CaseSummary]:
        """Return the summary of every case."""
        runs = self._job.study.runs
        found = []
        for place, case in enumerate(cases_of(self._job)):
            figures = self._figures[place * runs : (place + 1) * runs]
            sailed = figures[~np.isnan(figures[:, 0])]
            found.append(CaseSummary(case, runs, runs - len(sailed), _quantiles(sailed)))
        return found


def _quantiles(figures: Any) -> dict[str, tuple[float, float, float]]:
    if not len(figures):
        return dict.fromkeys(Figures._fields, (math.nan, math.nan, math.nan))
    found = np.quantile(figures, QUANTILES, axis=0)
    return {
        name: (float(found[0, place]), float(found[1, place]), float(found[2, place]))
        for place, name in enumerate(Figures._fields)
    }


def as_json(summaries: list[CaseSummary]) -> list[dict[str, Any]]:
    """Return the summaries for JSON; null where a case was refused."""
    return [
        {
            **each.case._asdict(),
            "runs": each.runs,
            "refused": each.refused,
            **{
                name: None if math.isnan(values[1]) else dict(zip(("q05", "median", "q95"), values, strict=True))
                for name, values in each.quantiles.items()
            },
        }
        for each in summaries
    ]


def varied(summaries: list[CaseSummary]) -> list[str]:
    """Return the names of what differs between cases; a single case is named by its boat and law."""
    names = [name for name in Case._fields if len({getattr(each.case, name) for each in summaries}) > 1]
    return names or ["boat", "law"]


def table(summaries: list[CaseSummary]) -> list[list[str]]:
    """Return heads and rows: what varies, then medians with the range from 5 to 95 %."""
    names = varied(summaries)
    rows = [
        [
            *(name.replace("_", " ") for name in names),
            "heading rms [deg]",
            "rudder travel [deg/s]",
            "most [deg]",
            "overshoot [deg]",
            "engaged [%]",
        ]
    ]
    for each in summaries:
        cells = [_text(getattr(each.case, name)) for name in names]
        if each.refused == each.runs:
            rows.append([*cells, "refused: no margins", "", "", "", ""])
            continue
        found = each.quantiles
        rows.append(
            [
                *cells,
                _range(found["heading_rms_deg"]),
                _range(found["travel_deg_s"]),
                f"{found['heading_most_deg'][2]:.2f}",
                f"{found['overshoot_deg'][1]:.2f}",
                f"{100.0 * found['engaged'][0]:.0f}",
            ]
        )
    return rows


def _range(values: tuple[float, float, float]) -> str:
    low, middle, high = values
    return f"{middle:.3f} ({low:.3f} to {high:.3f})"


def _text(value: str | float) -> str:
    return value if isinstance(value, str) else f"{value:g}"


MOST_PANELS = 12
FIRST_PANELS = 3
"""Before the verdict; the others follow it."""
SPAN = 0.5
"""A panel shows at least this share of its largest heading error."""
WORDS = {"side_deg": "from {:g}°", "speed_share": "at {:.0%} of the speed"}
APART = ("boat", "sea", "side_deg", "speed_share", "mismatch", "instruments", "faults")


def campaign_page(name: str, description: str, summaries: list[CaseSummary], said: str, command: str) -> str:
    """Return the page of a study; `said` is how and how fast it was run."""
    lead = description or "Seeded runs of boat, sea, sensors and pilot."
    panels = pareto_panels(summaries)
    hero, more = None, []
    if panels:
        left = len({_apart(each.case) for each in summaries}) - len(panels)
        caption = "each dot a case, the median over its runs; further left and down is better" + (
            f"; {left} more in the table" if left > 0 else ""
        )
        first, others = panels[:FIRST_PANELS], panels[FIRST_PANELS:]
        axis = "rudder travel [deg/s]"
        figure = time_figure(first, axis, logarithmic=True)
        hero = Section("", figure=figure, caption=f"heading error against rudder travel: {caption}")
        if others:
            more = [
                Section("Further seas and boats", figure=time_figure(others, axis, logarithmic=True), caption=caption)
            ]
    note = "Medians over the runs of a case, in brackets from 5 to 95 %; most: 95 %; engaged: 5 %."
    sections = [Section("Cases", table(summaries), (note, said)), *more]
    return render(Opening(f"Campaign: {name}", lead, hero, _verdict(summaries)), sections, command)


def _verdict(summaries: list[CaseSummary]) -> tuple[str, str]:
    sailed = [each for each in summaries if each.refused < each.runs]
    lost = sum(each.quantiles["engaged"][0] < 1.0 for each in sailed)
    refused = len(summaries) - len(sailed)
    grade = "fair" if lost else "good"
    said = f"in {len(sailed) - lost} of {len(sailed)} cases 95 % of the runs were steered to their end"
    return grade, f"{grade}: {said}" + (f"; {refused} refused for their margins" if refused else "")


def pareto_panels(summaries: list[CaseSummary]) -> list[Panel]:
    """Return a panel for each boat, sea and the rest, in it a line for each law through its gain factors."""
    groups: dict[tuple[object, ...], dict[str, list[tuple[float, float]]]] = {}
    for each in summaries:
        if each.refused < each.runs:
            point = each.quantiles["travel_deg_s"][1], each.quantiles["heading_rms_deg"][1]
            groups.setdefault(_apart(each.case), {}).setdefault(each.case.law, []).append(point)
    differs = [len({key[place] for key in groups}) > 1 for place in range(len(APART))]
    panels = []
    for key, laws in list(groups.items())[:MOST_PANELS]:
        lines = []
        for law, points in laws.items():
            travel, rms = np.array(sorted(points)).T
            lines.append(Line(law, np.maximum(travel, 1.0e-6), rms, dots=len(points) == 1))
        named = {name: part for name, part, is_named in zip(APART, key, differs, strict=True) if is_named}
        sea, side = APART.index("sea"), APART.index("side_deg")
        if len({each[side] for each in groups if each[sea] == key[sea]}) == 1:
            named.pop("side_deg", None)  # a calm has none, and one alone is no news
        title = ", ".join(WORDS[name].format(part) if name in WORDS else str(part) for name, part in named.items())
        least = SPAN * max(float(line.values.max()) for line in lines)
        panels.append(Panel("rms [deg]" + (f"\n{title}" if title else ""), lines, least))
    return panels


def _apart(case: Case) -> tuple[object, ...]:
    return tuple(getattr(case, name) for name in APART)
