"""Files of `autopilot identify-dp`: the ship with what is known of it, and the log of its thrusters and its motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
import yaml

from autopilot.errors import InputError
from autopilot.files import typed
from autopilot.files.strict_yaml import Node, read_document
from autopilot.files.typed import Bounds, Positive
from autopilot.identification.dynamic_positioning import (
    DAMPING,
    LAG,
    Belief,
    DpFit,
    Floats,
    Hull,
    Thruster,
    Trial,
)
from autopilot.logs.csv_log import MOST_THRUSTERS, read_csv

EARTH_RADIUS_M = 6371008.8
SCHEMA_VERSION = 1
SHORTEST_TRIAL = 20
PLANES = (
    ("north_m", "east_m"),
    ("latitude_rad", "longitude_rad"),
    ("position_x_m", "position_y_m"),
)
"""Pairs of columns that a place is in; the first one that the log has is taken."""


@dataclass(frozen=True)
class ThrusterSection:
    """Where a thruster is, which way it pushes, and what it gives at 100 %."""

    angle_deg: Annotated[float, Bounds(-180.0, 180.0, "direction of its push off the bow, 90 to starboard")] = 0.0
    x_m: Annotated[float, Bounds(-500.0, 500.0, "place ahead of midships")] = 0.0
    y_m: Annotated[float, Bounds(-100.0, 100.0, "place to starboard of the centre line")] = 0.0
    full_n: Annotated[float, Bounds(Positive, 1.0e8, "thrust at 100 %, of a log in per cent")] | None = None
    is_square: bool = False
    """Whether the thrust goes with the square of the percentage, as with revolutions."""


@dataclass(frozen=True)
class KnownSection:
    """A coefficient in the bis system, or the lag's logarithm [s], with its standard deviation."""

    value: Annotated[float, Bounds(-1.0e3, 1.0e3, "what it is believed to be")]
    std: Annotated[float, Bounds(Positive, 1.0e3, "standard deviation of that")]


@dataclass(frozen=True)
class ShipFile:
    """A ship under its thrusters. Masses carry what moves of the water with them and are shares of mass_kg, that of yaw
    also of the length squared; the defaults are those of a ship five times as long as it is broad."""

    schema_version: int
    length_m: Annotated[float, Bounds(0.2, 500.0, "length")]
    mass_kg: Annotated[float, Bounds(0.1, 1.0e9, "mass")]
    thrusters: tuple[ThrusterSection, ...]
    name: str = "ship"
    surge_mass: Annotated[float, Bounds(1.0, 5.0, "mass and added mass ahead")] = 1.05
    sway_mass: Annotated[float, Bounds(1.0, 5.0, "mass and added mass across")] = 1.64
    coupling_mass: Annotated[float, Bounds(-1.0, 1.0, "what couples sway and yaw")] = 0.0375
    yaw_mass: Annotated[float, Bounds(0.01, 1.0, "moment of inertia, with the water's")] = 0.0977
    thrust_lag_s: Annotated[float, Bounds(0.0, 100.0, "lag of the thrusters; null: found from the log")] | None = None
    known: dict[str, KnownSection] = field(default_factory=dict)
    """What is known of coefficients: Xu Yv Yr Nv Nr, k1 ... of the thrusters, lag."""


def load_ship(path: str) -> ShipFile:
    """Return the ship in a YAML file. Raises InputError, naming file, line and key, where it is not one."""
    root = read_document(path)
    ship = typed.read(root, ShipFile)
    if ship.schema_version != SCHEMA_VERSION:
        raise root.at("schema_version").fault(f"schema_version is {ship.schema_version}, it must be {SCHEMA_VERSION}.")
    if not 1 <= len(ship.thrusters) <= MOST_THRUSTERS:
        raise root.at("thrusters").fault(f"{len(ship.thrusters)} thrusters; allowed are 1 to {MOST_THRUSTERS}.")
    if ship.coupling_mass**2 >= ship.sway_mass * ship.yaw_mass:
        raise root.at("coupling_mass").fault("coupling_mass squared must stay below sway_mass times yaw_mass.")
    _check_known(root, ship)
    return ship


def _check_known(root: Node, ship: ShipFile) -> None:
    names = (*DAMPING, *(f"k{i + 1}" for i in range(len(ship.thrusters))), LAG)
    for name in ship.known:
        if name not in names:
            raise root.at("known").fault(f"known.{name} is no coefficient of this ship; it has {', '.join(names)}.")
    if LAG in ship.known and ship.thrust_lag_s is not None:
        raise root.at("known").fault("known.lag does not go with thrust_lag_s, which gives the lag; leave one out.")


def hull_of(ship: ShipFile) -> Hull:
    """Return the ship as the identification takes it."""
    thrusters = []
    for each in ship.thrusters:
        ahead, side = math.cos(math.radians(each.angle_deg)), math.sin(math.radians(each.angle_deg))
        thrusters.append(Thruster(ahead, side, (each.x_m * side - each.y_m * ahead) / ship.length_m))
    masses = ship.surge_mass, ship.sway_mass, ship.coupling_mass, ship.yaw_mass
    return Hull(ship.length_m, ship.mass_kg, *masses, tuple(thrusters))


def with_found(ship: ShipFile, fit: DpFit) -> str:
    """Return the ship as YAML text, with what a log says of it in the place of what was known."""
    known = {name: {"value": each.value, "std": each.std} for name, each in ship.known.items()}
    known |= {name: {"value": b.value, "std": b.deviation} for name, b in zip(fit.names, fit.found, strict=True)}
    sections = [{key: value for key, value in vars(each).items() if value is not None} for each in ship.thrusters]
    document = {**vars(ship), "thrusters": sections, "known": known}
    if ship.thrust_lag_s is None:
        del document["thrust_lag_s"]
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None)


def load_trial(path: str, ship: ShipFile) -> Trial:
    """Return the log in a CSV table. Raises InputError, naming file and column."""
    table, notes = read_csv(path, None, (("time_s",),))
    if notes:
        raise InputError(f"{notes[0]} A trial under thrusters must go on: cut out one part.")
    orders = np.stack([_order(path, table, ship, index) for index in range(len(ship.thrusters))], axis=1)
    surplus = [name for name in table if name.startswith("thrust_") and _number_of(name) > len(ship.thrusters)]
    if surplus:
        raise InputError(f"{path}: has {surplus[0]}, and the ship's file has {len(ship.thrusters)} thrusters.")
    known_throughout = {"time_s": table["time_s"], **{f"thrust_{i + 1}": order for i, order in enumerate(orders.T)}}
    for name, values in known_throughout.items():
        blank = np.flatnonzero(~np.isfinite(values))
        if blank.size:
            raise InputError(f"{path}: {name} is blank in row {blank[0] + 1}; it must be known throughout.")
    rows = table["time_s"].size
    if rows < SHORTEST_TRIAL:
        raise InputError(f"{path}: has {rows} rows; at least {SHORTEST_TRIAL} are needed.")
    if not orders.any():
        raise InputError(f"{path}: no thruster ever pushes, so there is nothing to identify from.")
    return Trial(table["time_s"], orders, _measured(path, table))


def _number_of(name: str) -> int:
    return int(name.split("_")[1])


def _order(path: str, table: Mapping[str, Floats], ship: ShipFile, index: int) -> Floats:
    """Return what thruster number `index` was ordered [N]."""
    section, newton, share = ship.thrusters[index], f"thrust_{index + 1}_n", f"thrust_{index + 1}_share"
    if newton in table:
        return table[newton]
    if share not in table:
        raise InputError(
            f"{path}: has no {newton} and no thrust_{index + 1}_percent; the ship has {len(ship.thrusters)} thrusters, "
            "and one that stands still has a column of zeros."
        )
    if section.full_n is None:
        raise InputError(f"{path}: thrust_{index + 1}_percent needs full_n of that thruster in the ship's file.")
    run = table[share]
    return section.full_n * (run * np.abs(run) if section.is_square else run)


def _measured(path: str, table: Mapping[str, Floats]) -> Floats:
    """Return north, east [m] of the first place and heading [rad], nan where the log has none."""
    measured = np.full((table["time_s"].size, 3), np.nan)
    plane = next((pair for pair in PLANES if any(name in table for name in pair)), None)
    if plane is None:
        raise InputError(f"{path}: has no position: north_m, east_m; latitude_deg, longitude_deg; or position_x_m.")
    is_ship_frame = plane == PLANES[-1]
    for name in plane:
        if name not in table and not is_ship_frame:
            raise InputError(f"{path}: has no {name}, which goes with {' and '.join(plane)}.")
    if "heading_rad" in table:
        heading = _known_first(path, "heading_rad", table["heading_rad"])
        known = np.isfinite(heading)
        measured[known, 2] = np.unwrap(heading[known])
        measured[:, 2] -= measured[0, 2] if is_ship_frame else 0.0
    elif plane != PLANES[-1] or plane[1] in table:
        raise InputError(f"{path}: has no heading_deg; only position_x_m, along a heading that is held, goes without.")
    for column, name in enumerate(plane):
        if name in table:
            place = _known_first(path, name, table[name])
            measured[:, column] = place - place[0]
    if plane == PLANES[1]:
        latitude = table["latitude_rad"][0]
        measured[:, :2] *= np.array([EARTH_RADIUS_M, EARTH_RADIUS_M * math.cos(latitude)])
    return measured


def _known_first(path: str, name: str, values: Floats) -> Floats:
    if not np.isfinite(values[0]):
        raise InputError(f"{path}: {name} is blank in the first row; cut the log so that it begins with one.")
    return values


def beliefs_with(ship: ShipFile, usual: Mapping[str, Belief]) -> dict[str, Belief]:
    """Return the beliefs with what the ship's file knows in their place."""
    known = {name: Belief(each.value, each.std) for name, each in ship.known.items()}
    return {name: known.get(name, belief) for name, belief in usual.items()}
