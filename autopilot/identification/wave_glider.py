"""Both bodies of a wave glider identified side by side, by any method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.identified import Identified, Question
from autopilot.identification.methods import Method
from autopilot.identification.runs import FloatArray, Run, run_from_columns


class BodyRuns(NamedTuple):
    """One recording as the runs of its two bodies, each under its own rudder."""

    surface: Run
    glider: Run


def body_runs(source: str, columns: Mapping[str, FloatArray], fixed_angle: float) -> BodyRuns:
    """Return the runs of float and glider in a recording.

    columns: as for `run_from_columns`; `heading_rad` and `yaw_rate_rad_s` are the float's, `glider_heading_rad` and
    `glider_yaw_rate_rad_s` the glider's, and `rudder_rad` is the glider's rudder. fixed_angle: delta_0 [rad]. Raises
    InputError where a heading is missing or a run tells nothing.
    """
    for name in ("heading_rad", "glider_heading_rad"):
        if name not in columns:
            raise InputError(f"{source}: a wave glider's recording needs {name}: the headings of both bodies pull it.")
    common = {name: columns[name] for name in ("time_s", "speed_m_s")}
    pull = fixed_angle * np.sin(columns["glider_heading_rad"] - columns["heading_rad"])
    surface = {**common, "rudder_rad": pull, "heading_rad": columns["heading_rad"]}
    glider = {**common, "rudder_rad": columns["rudder_rad"], "heading_rad": columns["glider_heading_rad"]}
    for body, name in ((surface, "yaw_rate_rad_s"), (glider, "glider_yaw_rate_rad_s")):
        if name in columns:
            body["yaw_rate_rad_s"] = columns[name]
    return BodyRuns(
        run_from_columns(f"{source} (float)", surface),
        run_from_columns(f"{source} (glider)", glider),
    )


class IdentifiedBodies(NamedTuple):
    """What was found of each body."""

    surface: Identified
    glider: Identified


def identify_bodies(records: list[BodyRuns], method: Method, question: Question) -> IdentifiedBodies:
    """Return both bodies' models by `method`. Raises InputError, naming the body, as the method does."""
    return IdentifiedBodies(
        method.identify([record.surface for record in records], question),
        method.identify([record.glider for record in records], question),
    )
