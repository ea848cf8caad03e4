"""The identified model as a vessel file: a new one, or the model section of one that exists."""

from __future__ import annotations

import dataclasses
import datetime
import math
from pathlib import Path

import numpy as np

from autopilot.cli.identify_report import Result
from autopilot.identification.runs import Run
from autopilot.params.saving import save_text
from autopilot.params.vessel import SCHEMA_VERSION, Model, Rudder, StandardErrors, Vessel
from autopilot.params.vessel_file import dump_vessel, load_vessel

STEEPEST_SHARE = 0.99
"""Quantile of the rudder's recorded slewing that counts as its rate: the fastest sample may be an outlier."""


def write_vessel(path: str, result: Result) -> None:
    """Write the model into the vessel file at `path`; everything else in an existing file is kept.

    In a new file the rudder's angle and rate are the largest recorded, and say so. Raises InputError where the
    existing file cannot be read or the file cannot be written.
    """
    runs = [run for run, role, _ in result.predictions if role == "fit"]
    model = _model(result, runs)
    if Path(path).exists():
        vessel = dataclasses.replace(load_vessel(path), model=model)
    else:
        name = Path(path).stem
        vessel = Vessel(SCHEMA_VERSION, name, model, _rudder(runs))
    save_text(path, dump_vessel(vessel))


def _model(result: Result, runs: list[Run]) -> Model:
    model, errors = result.found.model, result.found.standard_errors
    return Model(
        K_1_s=_rounded(model.gain),
        T_s=_rounded(model.time_constant),
        reference_speed_m_s=_rounded(model.reference_speed),
        n1=model.n1,
        n3_s2_rad2=_rounded(model.n3),
        n0_rad_s=_rounded(model.n0),
        standard_errors=StandardErrors(
            K_1_s=_rounded_or_none(errors["gain"]),
            T_s=_rounded_or_none(errors["time_constant"]),
            n3_s2_rad2=_rounded_or_none(errors["n3"]),
            n0_rad_s=_rounded_or_none(errors["n0"]),
        ),
        source="identified from " + ", ".join(Path(run.source).name for run in runs),
        date=datetime.date.today().isoformat(),
    )


def _rounded(value: float) -> float:
    return float(f"{value:.6g}")


def _rounded_or_none(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.3g}")


def _rudder(runs: list[Run]) -> Rudder:
    """Return the rudder as far as the recordings show it: it may well reach further and move faster."""
    segments = [segment for run in runs for segment in run.segments]
    angle = max(float(np.max(np.abs(segment.rudder))) for segment in segments)
    slopes = np.concatenate([np.abs(np.diff(s.rudder) / np.diff(s.time)) for s in segments])
    moving = slopes[slopes > 0.1 * np.max(slopes)]
    rate = float(np.quantile(moving, STEEPEST_SHARE))
    return Rudder(
        angle_max_deg=float(np.clip(round(math.degrees(angle), 1), 1.0, 90.0)),
        rate_max_deg_s=float(np.clip(round(math.degrees(rate), 1), 0.1, 1000.0)),
        source="largest angle and fastest movement in the recordings; the steering gear may do more",
    )
