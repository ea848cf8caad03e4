"""`autopilot identify-dp`: a ship's thrust and damping coefficients from a log under its thrusters.

Its files are the ship with what is known of it, and the log of its thrusters and its motion.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

import numpy as np
import yaml

from autopilot.errors import ExitCode, InputError
from autopilot.files import typed
from autopilot.files.printable import json_text
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
    identify_dp,
    usual_beliefs,
)
from autopilot.logs.csv_log import MOST_THRUSTERS, read_csv

DESCRIPTION = """\
Identifies what thrusters give, their lag, and the damping of a ship at low speed from a LOG of a trial under its
thrusters. Current, wind and noise are unknown and are found with them; intervals count that in.
"""

COLUMNS_HELP = """\
columns of LOG.csv; an order holds from its row to the next:
  time_s
  thrust_1_n or thrust_1_percent, and so on for each thruster in SHIP.yaml
  north_m east_m heading_deg  |  latitude_deg longitude_deg heading_deg  |  position_x_m [position_y_m heading_deg]
x is along, y to starboard of the ship's heading in the first row. SHIP.yaml: see docs/dynamic_positioning.md.
"""

WIDE, GOOD, FAIR = 1.96, 0.2, 0.5
"""A 95 % interval in standard deviations; how wide it may be, each side, as a share of the value, for a good one, and
for one that is given at all."""
CORRELATED = 4.0
"""Successive prediction errors correlated by so many standard deviations are more than noise."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the `identify-dp` subcommand."""
    parser.description = DESCRIPTION
    parser.epilog = COLUMNS_HELP
    parser.add_argument("trial", metavar="LOG.csv", help="recorded trial")
    parser.add_argument("--ship", metavar="SHIP.yaml", required=True, help="the ship and its thrusters")
    parser.add_argument("--out", metavar="SHIP.yaml", help="write the ship with what was found, for the next log")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Identify and print; return the exit code."""
    from autopilot.cli.terminal import ProgressBar
    from autopilot.files.saving import save_text

    ship = load_ship(arguments.ship)
    trial, hull = load_trial(arguments.trial, ship), hull_of(ship)
    beliefs = beliefs_with(ship, usual_beliefs(hull, trial, ship.thrust_lag_s))
    with ProgressBar("identifying") as bar:
        fit = identify_dp(hull, trial, beliefs, ship.thrust_lag_s or 0.0, bar.update)
    if arguments.out:
        save_text(arguments.out, with_found(ship, fit))
    document = document_of(arguments.trial, hull, fit)
    print(json_text(document) if arguments.json else as_text(document))
    return int(ExitCode.OK)


def _units(hull: Hull) -> dict[str, tuple[float, str]]:
    """Return what a damping coefficient is multiplied by, and its unit then."""
    force, length = hull.mass * math.sqrt(9.81 / hull.length), hull.length
    return {
        "Xu": (force, "N s/m"),
        "Yv": (force, "N s/m"),
        "Yr": (force * length, "N s/rad"),
        "Nv": (force * length, "N s"),
        "Nr": (force * length**2, "N m s/rad"),
    }


def document_of(source: str, hull: Hull, fit: DpFit) -> dict[str, Any]:
    """Return all that is said of a log, the verdict first."""
    known = dict(zip(fit.names, fit.found, strict=True))
    units = _units(hull)
    parameters: dict[str, Any] = {}
    for name, found in known.items():
        half, share = WIDE * found.deviation, _share(name, known)
        unit, word = units.get(name, (1.0, ""))
        ends = found.value - half, found.value, found.value + half
        if name == "lag":
            low, value, high = (math.exp(end) for end in ends)
            word = "s"
        else:
            low, value, high = (end * unit for end in ends)
        parameters[name] = {
            "is_identified": share <= FAIR,
            "value": found.value,
            "std": found.deviation,
            "half_width_share": share,
            "si": value,
            "interval": [low, high],
            "unit": word,
        }
    names = ("current_north_m_s", "current_east_m_s", "wind_north_n", "wind_east_n", "wind_moment_n_m")
    verdict, level = _verdict(parameters)
    return {
        "verdict": verdict,
        "level": level,
        "source": source,
        "parameters": parameters,
        "drift": {
            name: {"value": each.value, "std": each.deviation} for name, each in zip(names, fit.drift, strict=True)
        },
        "noise": {
            "position_m": fit.noises["position"] * hull.length,
            "heading_deg": math.degrees(fit.noises["heading"]),
        },
        "warnings": _warnings(fit),
    }


def _share(name: str, known: dict[str, Belief]) -> float:
    """Return half of the 95 % interval as a share of the value; of a coupling, of the two damping numbers beside it; of
    a lag, of its logarithm."""
    size = 1.0 if name == "lag" else abs(known[name].value)
    if name in ("Yr", "Nv"):
        size = math.sqrt(abs(known["Yv"].value * known["Nr"].value))
    return WIDE * known[name].deviation / max(size, 1.0e-12)


def _verdict(parameters: dict[str, Any]) -> tuple[str, str]:
    share = {name: each["half_width_share"] for name, each in parameters.items() if name != "lag"}
    lost = tuple(name for name, each in share.items() if each > FAIR)
    vague = tuple(name for name, each in share.items() if GOOD < each <= FAIR)
    if lost:
        return f"Not enough: {', '.join(lost)} cannot be identified. {_advice(lost)}", "not enough"
    if vague:
        return f"Good for a start: {', '.join(vague)} within {FAIR:.0%} only. {_advice(vague)}", "start"
    return f"Good: every coefficient is known within {GOOD:.0%}.", "good"


def _advice(names: tuple[str, ...]) -> str:
    if any(name.startswith("k") for name in names):
        return "Move each thruster by itself, ahead and astern, each time for as long as the ship needs to follow."
    return "Make the log longer: hold each order until the ship moves steadily, then reverse it."


def _warnings(fit: DpFit) -> list[str]:
    found = []
    if fit.correlation > CORRELATED:
        found.append(
            "Prediction errors follow one another: the ship does what this model does not have, such as drag that "
            "grows with the square of the speed. Intervals are too narrow; sail slower."
        )
    if not fit.converged:
        found.append("The search did not come to its end; the numbers may change with a longer log.")
    return found


def as_text(document: dict[str, Any]) -> str:
    """Return the document for people."""
    lines = [document["verdict"], "", f"{document['source']}", "", f"{'':5}{'value':>13}{'95 % interval':>29}  unit"]
    for name, each in document["parameters"].items():
        if not each["is_identified"]:
            lines.append(f"{name:5}{'cannot be identified from this log':>42}")
            continue
        low, high = each["interval"]
        lines.append(f"{name:5}{each['si']:>13.5g}{f'{low:.5g} to {high:.5g}':>29}  {each['unit']}".rstrip())
    drift, noise = document["drift"], document["noise"]
    lines.append("\nFound with them, with their 95 % intervals:")
    lines += [f"  {key}: {each['value']:.3g} ± {WIDE * each['std']:.2g}" for key, each in drift.items()]
    lines.append(f"  noise: position {noise['position_m']:.2g} m, heading {noise['heading_deg']:.2g} deg")
    lines += [f"\n{sentence}" for sentence in document["warnings"]]
    return "\n".join(lines)


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
    surplus = [name for name in table if name.startswith("thrust_") and int(name.split("_")[1]) > len(ship.thrusters)]
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
        latitude, known = table["latitude_rad"][0], np.isfinite(measured[:, 1])
        measured[known, 1] = np.unwrap(measured[known, 1])  # across the date line
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
