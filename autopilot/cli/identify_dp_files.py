"""Files of `autopilot identify-dp`: the ship with what is believed of it, and the trial.

What `autopilot identify-dp` found, as JSON and as a table for people.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.files.saving import save_unused
from autopilot.files.strict_yaml import Node, read_document
from autopilot.filters.kalman import FloatArray
from autopilot.identification.augmented_state import UNIDENTIFIED, BatchFit, Case, Found, Steps
from autopilot.identification.dynamic_positioning import Noise, Trial, surge_case, sway_yaw_case
from autopilot.logs.csv_log import read_csv
from autopilot.models.dynamic_positioning import DREDGER, REALISTIC, TABLE_1_SURGE, Hull, SurgeParameters
from autopilot.models.dynamic_positioning import SwayYawParameters as SwayYaw

HULL_KEYS = ("length_m", "mass_kg", "surge_mass", "sway_mass", "coupling_mass", "yaw_mass", "lever_m")
NOISE_KEYS = ("position_noise_m", "heading_noise_deg", "surge_noise", "sway_noise", "yaw_noise")
PARAMETERS = (*SurgeParameters._fields, *SwayYaw._fields)
DEVIATION_KEYS = tuple(f"{name}_deviation" for name in PARAMETERS)
KNOWN_KEYS = (*HULL_KEYS, *NOISE_KEYS, *PARAMETERS, *DEVIATION_KEYS)
MAY_BE_NEGATIVE = ("coupling_mass", "lever_m", *PARAMETERS)
DEFAULT_SHARE = 0.5
"""Standard deviation of a prior that gives none, as a share of its value."""

SHORTEST_TRIAL = 20


class Ship(NamedTuple):
    """A ship, its noise, and for each parameter what is believed of it and how firmly."""

    hull: Hull
    noise: Noise
    prior: dict[str, float]
    deviation: dict[str, float]


class ShipTrial(NamedTuple):
    """A trial to identify from: where it is from, the ship, the case, the record, and the truth where it is known."""

    source: str
    hull: Hull
    case: Case
    trial: Trial
    truth: tuple[float, ...] | None = None


def default_ship() -> Ship:
    """Return Zheng's dredger, table 1 and a realistic damping as the prior."""
    prior = {**TABLE_1_SURGE._asdict(), **REALISTIC._asdict()}
    return Ship(DREDGER, Noise(), prior, {name: DEFAULT_SHARE * abs(value) for name, value in prior.items()})


def load_ship(path: str) -> Ship:
    """Return the ship in a YAML file of numbers. Raises InputError, naming file, line and key, where it is not one."""
    root = read_document(path)
    if not isinstance(root.value, dict):
        raise root.fault("a ship is lines such as 'length_m: 128'; this is not one.")
    values = {key: _number(key, node) for key, node in root.value.items()}
    for key in HULL_KEYS:
        if key not in values:
            raise InputError(f"{path}: has no {key}; a ship needs {', '.join(HULL_KEYS)}.")
    hull = Hull(*(values[key] for key in HULL_KEYS))
    if hull.coupling_mass**2 >= hull.sway_mass * hull.yaw_mass:
        raise InputError(f"{path}: coupling_mass is too large: its square must stay below sway_mass times yaw_mass.")
    known = default_ship()
    noise = [values.get(key, default) for key, default in zip(NOISE_KEYS, known.noise, strict=True)]
    if "heading_noise_deg" in values:
        noise[1] = math.radians(values["heading_noise_deg"])
    prior = {name: values.get(name, known.prior[name]) for name in PARAMETERS}
    deviation = {name: values.get(f"{name}_deviation", DEFAULT_SHARE * abs(prior[name])) for name in PARAMETERS}
    for name, value in deviation.items():
        if not value > 0.0:
            raise InputError(f"{path}: {name} is {prior[name]:g}, so {name}_deviation must say how firmly, above 0.")
    return Ship(hull, Noise(*noise), prior, deviation)


def _number(key: str, node: Node) -> float:
    if key not in KNOWN_KEYS:
        raise node.key_fault(f"{key} is not known; known are {', '.join(KNOWN_KEYS)}.")
    if isinstance(node.value, bool) or not isinstance(node.value, int | float) or not math.isfinite(node.value):
        raise node.fault(f"{key} must be a number.")
    if node.value <= 0.0 and key not in MAY_BE_NEGATIVE:
        raise node.fault(f"{key} must be above 0, got {node.value:g}.")
    return float(node.value)


def load_trial(path: str, ship: Ship) -> ShipTrial:
    """Return the trial in a CSV table, of surge or of sway and yaw by its columns. Raises InputError."""
    table, notes = read_csv(path, None, (("time_s",), ("thrust_1_n", "thrust_3_n")))
    if notes:
        raise InputError(f"{notes[0]} A trial under thrusters must go on: cut out one part.")
    is_surge = "thrust_1_n" in table
    if is_surge and "thrust_3_n" in table and bool(np.any(table["thrust_3_n"] != 0.0)):
        raise InputError(
            f"{path}: has thrust_1_n and thrust_3_n; a trial is of the main thrusters or of the side thruster alone."
        )
    thrusts = ("thrust_1_n", "thrust_2_n") if is_surge else ("thrust_3_n",)
    seen = ("position_x_m",) if is_surge else ("position_y_m", "heading_rad")
    for name in (*thrusts, *seen):
        if name not in table:
            others = ", ".join(other for other in (*thrusts, *seen) if other != name)
            raise InputError(f"{path}: has no {name}, which goes with {others}; see autopilot identify-dp --help.")
    _check_rows(path, {name: table[name] for name in ("time_s", *thrusts)})
    thrust = np.stack([table[name] for name in thrusts], axis=1)
    measured = np.stack([_from_the_first(path, name, table[name]) for name in seen], axis=1)
    trial = Trial(np.diff(table["time_s"]), thrust[:-1], measured[1:])
    if is_surge:
        parameters = SurgeParameters(*(ship.prior[name] for name in SurgeParameters._fields))
        case = surge_case(ship.hull, parameters, [ship.deviation[n] for n in parameters._fields], ship.noise)
    else:
        damping = SwayYaw(*(ship.prior[name] for name in SwayYaw._fields))
        case = sway_yaw_case(ship.hull, damping, [ship.deviation[n] for n in damping._fields], ship.noise)
    return ShipTrial(path, ship.hull, case, trial)


def _check_rows(path: str, columns: dict[str, np.ndarray]) -> None:
    for name, values in columns.items():
        blank = np.flatnonzero(~np.isfinite(values))
        if blank.size:
            raise InputError(f"{path}: {name} is blank in row {blank[0] + 1}; it must be known throughout.")
    if columns["time_s"].size < SHORTEST_TRIAL:
        raise InputError(f"{path}: has {columns['time_s'].size} rows; at least {SHORTEST_TRIAL} are needed.")
    thrust = [values for name, values in columns.items() if name != "time_s"]
    if all(np.ptp(values) == 0.0 for values in thrust) and not any(values.any() for values in thrust):
        raise InputError(f"{path}: no thruster ever pushes, so there is nothing to identify from.")


def _from_the_first(path: str, name: str, values: np.ndarray) -> np.ndarray:
    """Return what was measured relative to the first row, headings without jumps by a full turn."""
    if not np.isfinite(values[0]):
        raise InputError(f"{path}: {name} is blank in the first row, from which it is counted.")
    values = values - values[0]
    if name == "heading_rad":
        known = np.isfinite(values)
        values[known] = np.unwrap(values[known])
    return values


def write_trial(path: str, trial: Trial, title: str) -> Path:
    """Write a trial as a CSV table that `load_trial` reads; its first row is at rest where the ship began.

    Return where it is: `path`, or its next free name. Raises InputError.
    """
    time = np.concatenate([[0.0], np.cumsum(trial.dt)])
    thrust = np.vstack([trial.thrust, trial.thrust[-1:]])
    measured = np.vstack([np.zeros((1, trial.measured.shape[1])), trial.measured])
    if measured.shape[1] == 1:
        names = ("time_s", "thrust_1_n", "thrust_2_n", "position_x_m")
    else:
        names = ("time_s", "thrust_3_n", "position_y_m", "heading_rad")
    rows = np.column_stack([time, thrust, measured])
    lines = [f"# {title}", ",".join(names), *(",".join(f"{value:.9g}" for value in row) for row in rows)]
    return save_unused(Path(path), "\n".join(lines) + "\n")


MISFIT = (0.5, 2.0)
"""Mean squares of whitened prediction errors between these are what the assumed noise explains."""


class Answers(NamedTuple):
    """The three answers to one trial, and the truth where it is known."""

    source: str
    case: Case
    steps: Steps
    kalman: Found
    particles: Found
    batch: BatchFit
    gain: str
    truth: tuple[float, ...] | None


def deviations(answers: Answers) -> dict[str, FloatArray]:
    """Return the standard deviations of every method at the end of the trial."""
    return {
        "EKF": answers.kalman.deviation[-1],
        "FPF": answers.particles.deviation[-1],
        "batch": np.sqrt(np.diag(answers.batch.covariance)),
    }


def left(answers: Answers) -> FloatArray:
    """Return which share of the prior's standard deviation the trial has left, by the Kalman filter and the batch
    fit, whichever leaves more, shape (p,)."""
    known = deviations(answers)
    return np.asarray(np.maximum(known["EKF"], known["batch"]) / answers.case.prior_deviation)


def warnings(answers: Answers) -> list[str]:
    """Return what the user should know beside the numbers, a sentence each."""
    sentences = [
        f"{name} cannot be identified from this trial: {share:.0%} of what was unknown of it still is; make the trial "
        "longer, or its thrusts larger."
        for name, share in zip(answers.case.names, left(answers), strict=True)
        if share > UNIDENTIFIED
    ]
    misfit = answers.batch.misfit
    if not MISFIT[0] <= misfit <= MISFIT[1]:
        sentences.append(
            f"The prediction errors have {misfit:.2g} times the variance that the assumed noise explains: correct the "
            f"noise in the ship's file; until then every deviation is about {misfit**-0.5:.2g} of what it should be."
        )
    return sentences


def as_json(answers: Answers) -> str:
    """Return the answers as JSON text; null in place of what cannot be identified."""
    document = {
        "source": answers.source,
        "samples": len(answers.steps.dt),
        "gain": answers.gain,
        "parameters": {name: _parameter(answers, i) for i, name in enumerate(answers.case.names)},
        "mean_square_prediction_error": answers.batch.misfit,
        "warnings": warnings(answers),
    }
    return json.dumps(document, indent=2, allow_nan=False)


def _parameter(answers: Answers, i: int) -> dict[str, Any]:
    share = float(left(answers)[i])
    values: dict[str, Any] = {
        "prior": _pair(answers.case.prior.mean[answers.case.states + i], answers.case.prior_deviation[i]),
        "left_of_prior_deviation": share,
        "is_identified": share <= UNIDENTIFIED,
    }
    for name, estimate, deviation in _methods(answers):
        values[name.lower()] = _pair(estimate[i], deviation[i]) if values["is_identified"] else None
    if answers.truth is not None:
        values["truth"] = answers.truth[i]
    return values


def _pair(value: float, deviation: float) -> dict[str, float]:
    return {"value": float(value), "std": float(deviation)}


def _methods(answers: Answers) -> list[tuple[str, FloatArray, FloatArray]]:
    known = deviations(answers)
    return [
        ("EKF", answers.kalman.estimate[-1], known["EKF"]),
        ("FPF", answers.particles.estimate[-1], known["FPF"]),
        ("batch", answers.batch.estimate, known["batch"]),
    ]


def as_text(answers: Answers) -> str:
    """Return the answers as a table with a sentence for each warning."""
    case, is_known = answers.case, answers.truth is not None
    heads = ["prior", "EKF", f"FPF, {answers.gain}", "batch fit", *(["truth"] if is_known else [])]
    lines = [answers.source, "", f"{'':4}" + "".join(f"{head:>24}" for head in heads)]
    for i, name in enumerate(case.names):
        cells = [_cell(case.prior.mean[case.states + i], case.prior_deviation[i])]
        if left(answers)[i] > UNIDENTIFIED:
            cells += [f"{'cannot be identified':>24}", f"{'-':>24}", f"{'-':>24}"]
        else:
            cells += [_cell(estimate[i], deviation[i]) for _, estimate, deviation in _methods(answers)]
        if answers.truth is not None:
            cells.append(f"{answers.truth[i]:>24.5g}")
        lines.append(f"{name:4}" + "".join(cells))
    lines.append("\nDimensionless in the bis system; deviations are standard deviations of the method's own belief.")
    lines += [f"\n{sentence}" for sentence in warnings(answers)]
    return "\n".join(lines)


def _cell(value: float, deviation: float) -> str:
    return f"{f'{value:.5g} ± {deviation:.2g}':>24}"
