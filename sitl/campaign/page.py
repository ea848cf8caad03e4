"""A study's page: heading error against rudder travel, and the table of cases."""

from __future__ import annotations

import numpy as np

from autopilot import __version__
from autopilot.report.figures import Line, Panel, time_figure
from autopilot.report.page import Section, render
from sitl.campaign.cases import Case
from sitl.campaign.summary import CaseSummary, table

MOST_PANELS = 12
APART = ("boat", "sea", "side_deg", "speed_share", "mismatch", "instruments", "faults")


def campaign_page(name: str, description: str, summaries: list[CaseSummary], said: str, command: str) -> str:
    """Return the page of a study; `said` is how and how fast it was run."""
    lead = description or "Seeded runs of boat, sea, sensors and pilot."
    panels = pareto_panels(summaries)
    sections = [Section("Runs", text=(said,))]
    if panels:
        left = len({_apart(each.case) for each in summaries}) - len(panels)
        caption = "each mark a case, the median over its runs; further left and down is better" + (
            f"; {left} more in the table" if left > 0 else ""
        )
        figure = time_figure(panels, "rudder travel [deg/s]", logarithmic=True)
        sections.append(Section("Heading error against rudder travel", figure=figure, caption=caption))
    note = "Medians over the runs of a case, in brackets from 5 to 95 %; most: 95 %; engaged: 5 %."
    sections.append(Section("Cases", table(summaries), (note,)))
    return render(f"Campaign: {name}", lead, sections, command, __version__)


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
        title = ", ".join(str(part) for part, is_told in zip(key, differs, strict=True) if is_told)
        panels.append(Panel("rms [deg]" + (f"\n{title}" if title else ""), lines))
    return panels


def _apart(case: Case) -> tuple[object, ...]:
    return tuple(getattr(case, name) for name in APART)
