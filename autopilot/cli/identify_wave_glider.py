"""`autopilot identify --wave-glider`: float and glider from the same recordings, side by side."""

from __future__ import annotations

import argparse
import json
import math

from autopilot.cli import identify_report as report
from autopilot.cli.progress import ProgressBar
from autopilot.errors import InputError
from autopilot.identification.identified import Identified
from autopilot.identification.methods import Question
from autopilot.identification.registry import method_named
from autopilot.identification.runs import Run
from autopilot.identification.two_stage import nomoto_stage
from autopilot.identification.wave_glider import BodyRuns, body_runs, identify_bodies
from autopilot.loop.csv_log import WAVE_GLIDER_NEEDS, load_column_map, read_csv

NOT_HERE = ("out", "report", "steady_turns", "vessel")
"""Options that have no meaning for a craft of two bodies."""


def identify_wave_glider(arguments: argparse.Namespace) -> str:
    """Return what is found of both bodies, as text or JSON. Raises InputError."""
    for name in NOT_HERE:
        if getattr(arguments, name):
            raise InputError(f"--{name.replace('_', '-')} does not go with --wave-glider; leave one of them out.")
    if not arguments.logs:
        raise InputError("identify --wave-glider needs a LOG, a CSV table with the headings of both bodies.")
    method = method_named(arguments.method, arguments.gain)
    fitted, held_out = _load(arguments.logs, arguments), _load(arguments.holdout, arguments)
    question = Question(arguments.model, arguments.reference_speed_m_s, forgetting=arguments.forgetting)
    with ProgressBar("identifying") as bar:
        found = identify_bodies(fitted, method, question._replace(progress=bar.show))
    results = {
        name: _result(arguments.model, body, [r[place] for r in fitted], [r[place] for r in held_out])
        for place, (name, body) in enumerate((("float", found.surface), ("glider", found.glider)))
    }
    if arguments.json:
        bodies = {name: json.loads(report.as_json(result)) for name, result in results.items()}
        return json.dumps({"fixed_angle_deg": arguments.fixed_angle_deg, **bodies}, indent=2, allow_nan=False)
    text = [f"{name.upper()}\n\n{report.as_text(result)}" for name, result in results.items()]
    return "\n\n\n".join(text) + f"\n\nK of the float holds for delta_0 = {arguments.fixed_angle_deg:g} deg."


def _load(paths: list[str], arguments: argparse.Namespace) -> list[BodyRuns]:
    column_map = load_column_map(arguments.columns) if arguments.columns else None
    records = []
    for path in paths:
        table, notes = read_csv(path, column_map, WAVE_GLIDER_NEEDS)
        if arguments.reverse_rudder:
            table["rudder_rad"] = -table["rudder_rad"]
        found = body_runs(path, table, math.radians(arguments.fixed_angle_deg))
        records.append(BodyRuns(*(run._replace(notes=(*notes, *run.notes)) for run in found)))
    return records


def _result(kind: str, found: Identified, fitted: list[Run], held_out: list[Run]) -> report.Result:
    predictions = [(run, "fit", found.foretell(run)) for run in fitted]
    predictions += [(run, "holdout", found.foretell(run)) for run in held_out]
    return report.Result(kind, found, nomoto_stage(fitted, found.model.reference_speed), predictions)
