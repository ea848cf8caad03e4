"""The identified model as a vessel file: a new one, or the model section of one that exists."""

from __future__ import annotations

import dataclasses
import datetime
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from autopilot.cli.identify_report import Result, undetermined
from autopilot.errors import InputError
from autopilot.identification.runs import Run, Segment
from autopilot.identification.steering import steering_errors, steering_model
from autopilot.params.editing import updated_vessel_text
from autopilot.params.saving import save_text
from autopilot.params.vessel import SCHEMA_VERSION, Model, Rudder, StandardErrors, Vessel
from autopilot.params.vessel_file import dump_vessel, load_vessel, rounded

ASSUMED_RATE_DEG_S = 10.0
"""Rudder rate written where the recordings cannot show it: slow for a small boat, so gains err to the safe side."""


def write_vessel(path: str, result: Result) -> None:
    """Write the model into the vessel file at `path`; everything else in an existing file is kept, its
    comments too.

    In a new file the rudder's angle and rate are the largest recorded, and say so. Raises InputError where K or T is
    not determined, the existing file cannot be read or the file cannot be written.
    """
    if unknown := undetermined(result.found):
        raise InputError(f"{path} is not written, for it needs K and T: {result.found.unidentifiable[unknown[0]]}")
    runs = [run for run, role, _ in result.predictions if role == "fit"]
    model = _model(result, runs)
    if Path(path).exists():
        vessel = dataclasses.replace(load_vessel(path), model=model)
        save_text(path, updated_vessel_text(Path(path).read_text(encoding="utf-8-sig"), vessel, path))
    else:
        name = Path(path).stem
        vessel = Vessel(SCHEMA_VERSION, name, model, _rudder(runs))
        save_text(path, dump_vessel(vessel))


def _model(result: Result, runs: list[Run]) -> Model:
    model, errors = steering_model(result.found), steering_errors(result.found)
    return Model(
        K_1_s=rounded(model.gain),
        T_s=rounded(model.time_constant),
        reference_speed_m_s=rounded(model.reference_speed),
        n1=model.n1,
        n2_s_rad=rounded(model.n2),
        n3_s2_rad2=rounded(model.n3),
        n0_rad_s=rounded(model.n0),
        standard_errors=StandardErrors(
            K_1_s=_rounded_or_none(errors["gain"]),
            T_s=_rounded_or_none(errors["time_constant"]),
            n3_s2_rad2=_rounded_or_none(errors["n3"]),
            n0_rad_s=_rounded_or_none(errors["n0"]),
        ),
        source="identified",
        date=datetime.date.today().isoformat(),
        log=tuple(Path(run.source).name for run in runs),
    )


def _rounded_or_none(value: float | None) -> float | None:
    return None if value is None else float(f"{value:.3g}")


def _rudder(runs: list[Run]) -> Rudder:
    """Return the rudder as far as the recordings show it: it may well reach further and move faster."""
    segments = [segment for run in runs for segment in run.segments]
    angle = max(float(np.max(np.abs(segment.rudder))) for segment in segments)
    rate = recorded_rudder_rate(segments)
    source = "largest angle and fastest movement in the recordings; the steering gear may do more"
    if rate is None:
        source = (
            f"largest angle in the recordings; the rate of {ASSUMED_RATE_DEG_S:g} deg/s is assumed, for the recorded "
            "rudder jumps from sample to sample: measure it before you trust the gains"
        )
    slewing = ASSUMED_RATE_DEG_S if rate is None else round(math.degrees(rate), 1)
    return Rudder(
        angle_max_deg=float(np.clip(round(math.degrees(angle), 1), 1.0, 90.0)),
        rate_max_deg_s=float(np.clip(slewing, 0.1, 1000.0)),
        source=source,
    )


def recorded_rudder_rate(segments: Sequence[Segment]) -> float | None:
    """Return the rudder's slewing rate [rad/s], None where the record cannot show it.

    A rudder that gets most of a movement done between two samples moved at that rate or any faster one: the
    largest step must have a neighbour of at least half its size to be a slope rather than a jump.
    """
    steepest, is_slope = 0.0, False
    for segment in segments:
        slopes = np.abs(np.diff(segment.rudder) / np.diff(segment.time))
        if slopes.size < 3 or slopes.max() <= steepest:
            continue
        at = int(np.argmax(slopes))
        neighbours = slopes[max(at - 1, 0) : at + 2]
        steepest, is_slope = float(slopes[at]), bool(np.sort(neighbours)[-2] >= 0.5 * slopes[at])
    return steepest if is_slope else None
