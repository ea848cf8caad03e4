"""Both bodies of a wave glider identified side by side, offline by any method and live by the integral method."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.identified import Identified, Question
from autopilot.identification.integral_fit import FitSettings, IntegralFit
from autopilot.identification.methods import Method
from autopilot.identification.runs import FloatArray, Run, run_from_columns
from autopilot.models.norrbin import Norrbin
from autopilot.models.wave_glider import WaveGlider, equivalent_rudder


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


class WaveGliderFit:
    """The integral method for both bodies at once, live and in constant memory; see `integral_fit`.

    `first` is the craft it begins with.
    """

    def __init__(self, first: WaveGlider, settings: FitSettings = FitSettings()) -> None:  # noqa: B008 - immutable
        self._fixed_angle = first.fixed_angle
        self.surface = IntegralFit(first.surface, settings)
        self.glider = IntegralFit(first.glider, settings)

    @property
    def craft(self) -> WaveGlider:
        """The craft as it is known now."""
        return WaveGlider(self.surface.model, self.glider.model, self._fixed_angle)

    def update(
        self,
        time: float,
        rudder: float,
        speed: float,
        surface: tuple[float, float | None],
        glider: tuple[float, float | None],
    ) -> None:
        """Take what is known at `time` [s]: the glider's rudder [rad], speed [m/s], and each body's heading [rad] and
        rate [rad/s] (None where there is none)."""
        pull = equivalent_rudder(self._fixed_angle, glider[0], surface[0])
        for fit, angle, (heading, rate) in ((self.surface, pull, surface), (self.glider, rudder, glider)):
            fit.update(time, angle, _ratio(fit.first, speed), heading, rate)


def _ratio(model: Norrbin, speed: float) -> float:
    return abs(speed) / model.reference_speed
