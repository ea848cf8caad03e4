"""The page of a sea trial: what was sailed, each manoeuvre measured beside its criterion, track and steady turns."""

from __future__ import annotations

import numpy as np

from autopilot import __version__
from autopilot.identification import manoeuvring_criteria as criteria
from autopilot.identification.trial_measures import Measures, Spiral
from autopilot.identification.trial_record import TrialRecord
from autopilot.report.figures import FloatArray, Line, Panel, plane_figure, time_figure
from autopilot.report.measure_rows import blocks_of
from autopilot.report.page import Section, render

POINTS_MOST = 4000
"""More samples than this draw no finer line and make the page heavy."""


def trials_page(source: str, record: TrialRecord, measures: Measures, length: float | None, command: str) -> str:
    """Return the page of one record; `length` [m] of the boat, None where it is not known."""
    lead = f"Manoeuvres found in {source}, measured by IMO MSC.137(76) and ITTC 7.5-04-02-01: "
    lead += f"{criteria.SHIPS}."
    sections = [Section("What was sailed", figure=_motion(record), caption="rudder and yaw rate: starboard positive")]
    for block in blocks_of(measures, length):
        table = [("measure", "value", "criterion"), *((name.strip(), *rest) for name, *rest in block.rows)]
        sections.append(Section(block.title, table))
    if len(sections) == 1:
        sections.append(Section("Measures", text=("No manoeuvre was found in this record.",)))
    if np.isfinite(record.north).all():
        sections.append(Section("Track", figure=_track(record), caption=f"by {measures.position}"))
    steady = _steady(measures)
    if steady is not None:
        sections.append(Section("Steady turns", figure=steady, caption="one branch to port, one back to starboard"))
    return render("Sea trial", lead, sections, command, __version__)


def _thinned(values: FloatArray) -> FloatArray:
    return values[:: max(1, values.size // POINTS_MOST)]


def _motion(record: TrialRecord) -> str:
    time = _thinned(record.time)
    heading = Line("heading", time, np.degrees(_thinned(record.heading)))
    rudder = Line("rudder", time, np.degrees(_thinned(record.rudder)))
    rate = Line("yaw rate", time, np.degrees(_thinned(record.rate)))
    panels = [Panel("heading [deg]", [heading]), Panel("rudder [deg]", [rudder]), Panel("yaw rate [deg/s]", [rate])]
    if np.isfinite(record.speed).any():
        panels.append(Panel("speed [m/s]", [Line("speed", time, _thinned(record.speed))]))
    return time_figure(panels)


def _track(record: TrialRecord) -> str:
    line = Line("track", _thinned(record.east), _thinned(record.north))
    begin = Line("begin", record.east[:1], record.north[:1], dots=True)
    return plane_figure(Panel("north [m]", [line, begin]), "east [m]", equal=True)


def _steady(measures: Measures) -> str | None:
    """Return the steady yaw rates over the rudder angles, from a spiral and from the circles; None without any."""
    lines = [] if measures.spiral is None else _branches(measures.spiral)
    if measures.circles:
        angles, rates = (np.degrees([getattr(one, name) for one in measures.circles]) for name in ("rudder", "rate"))
        lines.append(Line("turning circles", angles, rates, dots=True))
    return plane_figure(Panel("yaw rate [deg/s]", lines), "rudder [deg]") if lines else None


def _branches(spiral: Spiral) -> list[Line]:
    named = (("to port", spiral.down), ("back to starboard", spiral.up))
    return [Line(name, *np.degrees(np.array(branch)).T) for name, branch in named]
