"""Files of `autopilot identify-dp`: the ship with what is believed of it, and the trial."""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np

from autopilot.errors import InputError
from autopilot.identification.dynamic_positioning import Noise, Trial, surge_case, sway_yaw_case
from autopilot.identification.recursive import Case
from autopilot.loop.csv_log import read_csv
from autopilot.models.dynamic_positioning import DREDGER, REALISTIC, TABLE_1_SURGE, Hull, SurgeParameters
from autopilot.models.dynamic_positioning import SwayYawParameters as SwayYaw
from autopilot.params.saving import save_unused
from autopilot.params.strict_yaml import Node, read_document

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
