"""`autopilot trial`: sail manoeuvres to identify and measure the boat."""

from __future__ import annotations

import argparse
import math
from typing import TYPE_CHECKING, Any

from autopilot.cli.options import SECONDS, SEED, NumberOption, number
from autopilot.errors import ExitCode, InputError, RefusedError
from autopilot.operators.trial_script import HOLDS, LASTING, SPEEDS

if TYPE_CHECKING:
    from autopilot.guidance.trials import TrialLimits
    from autopilot.operators.trial_script import TrialScript
    from autopilot.vessel.schema import Vessel

DESCRIPTION = """\
Sail a trial and log it. Take the helm, or press Ctrl-C, to end it: the rudder is released. It also ends when the pilot
loses the helm or the heading, at an alarm, and outside the limits given.
"""


def add_parser(subparsers: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommand with its manoeuvres."""
    from autopilot.cli.trial_design import add_options
    from autopilot.cli.trial_design import run as run_design

    parser = subparsers.add_parser(
        "trial", help="sail manoeuvres to identify and measure the boat", description=DESCRIPTION
    )
    kinds = parser.add_subparsers(dest="kind", metavar="TRIAL", required=True)
    zigzag = _kind(kinds, "zigzag", "rudder over each time the heading has swung past the execute angle")
    _number(zigzag, "--rudder-deg", 15.0, "DEG", "rudder angle")
    _number(zigzag, "--heading-deg", 15.0, "DEG", "execute angle", number(1.0, 90.0))
    _number(zigzag, "--duration", 60.0, "S", "seconds of zigzag", number(*LASTING))
    turning = _kind(kinds, "turning", "one rudder angle after another, each for the same time")
    turning.add_argument("--rudder-deg", default="10,20,-10,-20", metavar="LIST", help="angles (10,20,-10,-20)")
    _number(turning, "--each", 20.0, "S", "seconds at each angle", number(*LASTING))
    circle = _kind(kinds, "turning-circle", "a turn of 540 deg at full rudder, to both sides", approach=5.0)
    circle.add_argument(
        "--rudder-deg", action=NumberOption, metavar="DEG", help="rudder angle (the vessel file's largest)"
    )
    _number(circle, "--turn-deg", 540.0, "DEG", "how far to turn", number(90.0, 3600.0))
    spiral = _kind(kinds, "spiral", "rudder angle after angle, each until the turn is steady")
    _number(spiral, "--rudder-deg", 15.0, "DEG", "largest angle")
    _number(spiral, "--step-deg", 5.0, "DEG", "steps at large angles")
    _number(spiral, "--fine-step-deg", 2.0, "DEG", "steps near amidships")
    pull = _kind(kinds, "pull-out", "a steady turn, then the rudder amidships until the rate is steady, to both sides")
    _number(pull, "--rudder-deg", 20.0, "DEG", "rudder angle of the turn")
    for kind in (circle, pull):
        kind.add_argument("--side", choices=("starboard", "port", "both"), default="both", help="(both)")
    for kind in (circle, spiral, pull):
        _number(kind, "--each", 120.0, "S", "at most this many seconds at each angle", number(*LASTING))
    prbs = _kind(kinds, "prbs", "the rudder to either side in a pseudo-random binary sequence")
    _number(prbs, "--rudder-deg", 10.0, "DEG", "rudder angle")
    prbs.add_argument(
        "--hold", action=number(*HOLDS), metavar="S", help="seconds of one step (the model's time constant)"
    )
    _number(prbs, "--swing-deg", 45.0, "DEG", "beyond this change of heading the rudder leads back", number(5.0, 120.0))
    _number(prbs, "--duration", 120.0, "S", "duration", number(*LASTING))
    prbs.add_argument("--seed", action=SEED, default=1, metavar="N", help="where the sequence begins (1)")
    parser.set_defaults(run=run)
    design = kinds.add_parser("design", help="which trial tells most in the water and the time there is")
    add_options(design)
    design.set_defaults(run=run_design)


def _kind(kinds: Any, name: str, text: str, approach: float = 0.0) -> argparse.ArgumentParser:
    from autopilot.cli.steering import add_steering_options

    parser: argparse.ArgumentParser = kinds.add_parser(name, help=text, description=text)
    add_steering_options(parser, needs_link=False)
    parser.add_argument(
        "--predict", action="store_true", help="print how well it could identify K, T and n3 at best, without sailing"
    )
    parser.add_argument(
        "--unidentified",
        action="store_true",
        help="the model in the file is a guess: the alarms that rest on it (alarms.reversed_rudder) are off",
    )
    _number(
        parser,
        "--approach",
        approach,
        "S",
        "seconds with the rudder amidships before the trial",
        number(0.0, LASTING[1]),
    )
    limits = parser.add_argument_group("limits that end the trial")
    limits.add_argument("--time-limit", action=SECONDS, metavar="S", help="seconds from the start")
    limits.add_argument("--speed-min-m-s", action=number(*SPEEDS), metavar="U", help="lowest speed")
    limits.add_argument("--speed-max-m-s", action=number(*SPEEDS), metavar="U", help="highest speed")
    limits.add_argument(
        "--corridor-deg", action=number(1.0, 180.0), metavar="DEG", help="largest change of heading to either side"
    )
    limits.add_argument("--radius-m", action=number(0.1, 1.0e6), metavar="M", help="largest distance from the start")
    return parser


def _number(
    parser: argparse.ArgumentParser,
    name: str,
    default: float,
    unit: str,
    text: str,
    action: type[NumberOption] = NumberOption,
) -> None:
    parser.add_argument(name, action=action, default=default, metavar=unit, help=f"{text} ({default:g})")


def run(arguments: argparse.Namespace) -> int:
    """Sail the trial and return the exit code. Raises RefusedError where it ended before its time."""
    from dataclasses import replace

    from autopilot.cli.options import named_vessel
    from autopilot.cli.steering import Voyage, plan_of, steer
    from autopilot.control.registry import TRIAL_LAW
    from autopilot.report.steered import trial_verdict

    vessel = named_vessel(arguments.vessel)
    if vessel.helm.method == "guided":
        raise InputError(f"{arguments.vessel}: helm.method guided moves no rudder; write rc_override for trials")
    if arguments.unidentified:
        vessel = replace(vessel, alarms=replace(vessel.alarms, reversed_rudder=False))
    script = _script(arguments, vessel)
    if arguments.predict:
        from autopilot.cli.trial_design import predicted_accuracy

        print(predicted_accuracy(script, vessel))
        return int(ExitCode.OK)
    if not arguments.link:
        raise InputError("a trial needs --link URL, the way to the boat; with --predict nothing is sailed")
    plan = plan_of(vessel, arguments, script)._replace(law=TRIAL_LAW)
    voyage = Voyage(
        lambda app, tick: script.is_over,
        math.inf,
        describe=script.describe,
        verdict=lambda steered: trial_verdict(steered, script.reason or ("" if script.is_over else "stopped")),
    )
    code = steer(arguments, plan, voyage)
    if script.reason and code == ExitCode.OK:
        raise RefusedError(f"the trial ended before its time: {script.reason}")
    return code


def _script(arguments: argparse.Namespace, vessel: Vessel) -> TrialScript:
    from autopilot.operators.trial_script import TrialScript, steps_of
    from autopilot.runtime.build import limits_of, model_of

    angle_max_deg = math.degrees(limits_of(vessel).angle_max)
    return TrialScript(steps_of(arguments, round(angle_max_deg, 9), model_of(vessel)), _limits(arguments))


def _limits(arguments: argparse.Namespace) -> TrialLimits:
    from autopilot.guidance.trials import TrialLimits

    least, most = arguments.speed_min_m_s or -math.inf, arguments.speed_max_m_s or math.inf
    if least >= most:
        raise InputError(f"--speed-min-m-s {least:g} must be below --speed-max-m-s {most:g}")
    corridor = math.inf if arguments.corridor_deg is None else math.radians(arguments.corridor_deg)
    return TrialLimits(least, most, corridor, arguments.radius_m or math.inf, arguments.time_limit or math.inf)
