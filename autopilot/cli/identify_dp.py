"""`autopilot identify-dp`: a ship's thrust and damping coefficients from a log under its thrusters."""

from __future__ import annotations

import argparse
import json
import math
from typing import TYPE_CHECKING, Any

from autopilot.errors import ExitCode

if TYPE_CHECKING:
    from autopilot.identification.dynamic_positioning import Belief, DpFit, Hull

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


def add_parser(subparsers: Any) -> None:
    """Add the `identify-dp` subcommand."""
    parser = subparsers.add_parser(
        "identify-dp",
        help="identify a ship's thrust and damping from trials under its thrusters",
        description=DESCRIPTION,
        epilog=COLUMNS_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("trial", metavar="LOG.csv", help="recorded trial")
    parser.add_argument("--ship", metavar="SHIP.yaml", required=True, help="the ship and its thrusters")
    parser.add_argument("--out", metavar="SHIP.yaml", help="write the ship with what was found, for the next log")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Identify and print; return the exit code."""
    from autopilot.cli.identify_dp_files import beliefs_with, hull_of, load_ship, load_trial, with_found
    from autopilot.cli.terminal import ProgressBar
    from autopilot.files.saving import save_text
    from autopilot.identification.dynamic_positioning import identify_dp, usual_beliefs

    ship = load_ship(arguments.ship)
    trial, hull = load_trial(arguments.trial, ship), hull_of(ship)
    beliefs = beliefs_with(ship, usual_beliefs(hull, trial, ship.thrust_lag_s))
    with ProgressBar("identifying") as bar:
        fit = identify_dp(hull, trial, beliefs, ship.thrust_lag_s or 0.0, bar.update)
    if arguments.out:
        save_text(arguments.out, with_found(ship, fit))
    document = document_of(arguments.trial, hull, fit)
    print(json.dumps(document, indent=2, allow_nan=False) if arguments.json else as_text(document))
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
