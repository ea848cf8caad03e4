"""What a study says, case by case: medians and quantiles over its runs."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from sitl.campaign.cases import Case, Job, cases_of, number_of_runs
from sitl.campaign.score import Figures
from sitl.campaign.work import COMPILED, FULL, REFUSED, Row

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
    """Return the names of what differs between cases; a single case is told by its boat and law."""
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
