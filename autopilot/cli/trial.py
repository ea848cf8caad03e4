"""`autopilot trial`: manoeuvres to identify the boat from: zigzags, and turns one rudder angle after another."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING, Any

from autopilot.errors import InputError

if TYPE_CHECKING:
    from autopilot.cli.trial_script import TrialScript


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand with its two manoeuvres."""
    from autopilot.cli.steering import add_steering_options

    parser = subparsers.add_parser(
        "trial",
        help="zigzag and turning trials to identify the boat from",
        description="Sail a trial and log it. Take the helm, or press Ctrl-C, to end it: the rudder is released.",
    )
    kinds = parser.add_subparsers(dest="kind", metavar="TRIAL", required=True)
    zigzag = kinds.add_parser("zigzag", help="rudder over each time the heading has swung past the execute angle")
    add_steering_options(zigzag)
    zigzag.add_argument("--rudder-deg", type=float, default=15.0, metavar="DEG", help="rudder angle (15)")
    zigzag.add_argument("--heading-deg", type=float, default=15.0, metavar="DEG", help="execute angle (15)")
    zigzag.add_argument("--duration", type=float, default=60.0, metavar="S", help="seconds of zigzag (60)")
    turning = kinds.add_parser("turning", help="steady turns at one rudder angle after another")
    add_steering_options(turning)
    turning.add_argument("--rudder-deg", default="10,20,-10,-20", metavar="LIST", help="angles (10,20,-10,-20)")
    turning.add_argument("--each", type=float, default=20.0, metavar="S", help="seconds at each angle (20)")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Sail the trial and return the exit code."""
    from autopilot.build import TRIAL_LAW
    from autopilot.cli.steering import steer
    from autopilot.params.vessel_file import load_vessel

    vessel = load_vessel(arguments.vessel)
    if vessel.helm.method == "guided":
        raise InputError(f"{arguments.vessel}: helm.method guided moves no rudder; write rc_override for trials")
    script = _script(arguments, vessel.rudder.angle_max_deg)
    return steer(vessel, arguments, script, lambda tick: script.is_over, math.inf, law=TRIAL_LAW)


def _script(arguments: argparse.Namespace, angle_max_deg: float) -> TrialScript:
    from autopilot.cli.trial_script import TrialScript, turning, zigzag

    if arguments.kind == "zigzag":
        _check("--rudder-deg", arguments.rudder_deg, 1.0, angle_max_deg)
        _check("--heading-deg", arguments.heading_deg, 1.0, 90.0)
        _check("--duration", arguments.duration, 1.0, 36000.0)
        return TrialScript(
            [zigzag(math.radians(arguments.rudder_deg), math.radians(arguments.heading_deg), arguments.duration)]
        )
    try:
        angles = [float(part) for part in arguments.rudder_deg.split(",")]
    except ValueError:
        raise InputError(f"--rudder-deg {arguments.rudder_deg!r}: write angles like 10,20,-10,-20") from None
    for angle in angles:
        _check("--rudder-deg", angle, -angle_max_deg, angle_max_deg)
    _check("--each", arguments.each, 1.0, 36000.0)
    return TrialScript([turning(math.radians(angle), arguments.each) for angle in angles])


def _check(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise InputError(f"{name} {value:g}: allowed is {low:g} to {high:g}")
