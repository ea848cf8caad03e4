"""`autopilot trial`: sail manoeuvres to identify and measure the boat.

`autopilot trial design`: the trial that tells most about the boat in the water and the time there is.
`autopilot trial KIND --predict`: how nearly a trial would tell the boat at best, before it is sailed.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from autopilot.angles import wrap
from autopilot.cli.options import SECONDS, SEED, NumberOption, named_vessel, number
from autopilot.errors import ExitCode, InputError, RefusedError
from autopilot.files.outside import typed_number
from autopilot.files.printable import json_text
from autopilot.guidance.manoeuvres import TrialLimits
from autopilot.models.norrbin import Norrbin
from autopilot.operators.trial_script import HOLDS, LASTING, SPEEDS, TrialScript, steps_of
from autopilot.signals import Mode, NavState, Order, OrderKind, Reference, RudderCommand, Tick

if TYPE_CHECKING:
    from autopilot.identification.runs import Run
    from autopilot.identification.trial_design import Berth, Boat, Candidate, Design, Helm, InstrumentNoise, Water
    from autopilot.report.steered import Steered, Verdict
    from autopilot.vessel.schema import Sensors, Vessel

DESCRIPTION = """\
Sail a trial and log it. Take the helm, or press Ctrl-C, to end it: the rudder is released. It also ends when the pilot
loses the helm or the heading, at an alarm, and outside the limits given.
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the subcommand with its manoeuvres."""
    parser.description = DESCRIPTION
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
    add_design_options(design)
    design.set_defaults(run=design_trial)


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
    parser.add_argument(
        "--at-dock",
        action="store_true",
        help="tied up, propeller stopped: the rudder alone is proved, no boat identified",
    )
    parser.add_argument(
        "--at-least",
        choices=("start", "good"),
        help="end with exit code 4 where the trial is not good for a start, or not good, to identify the boat by",
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

    from autopilot.cli.steering import Voyage, plan_of, steer
    from autopilot.control.registry import TRIAL_LAW
    from autopilot.identification.interval import serves
    from autopilot.models.drives import DRIVES
    from autopilot.report.steered import trial_verdict

    vessel = named_vessel(arguments.vessel)
    if vessel.helm.firmware_steers:
        method = vessel.helm.method
        raise InputError(f"{arguments.vessel}: helm.method {method} moves no rudder; write rc_override for trials")
    if arguments.unidentified:
        vessel = replace(vessel, alarms=replace(vessel.alarms, reversed_rudder=False))
    script = _script(arguments, vessel)
    if arguments.predict:
        print(predicted_accuracy(script, vessel))
        return int(ExitCode.OK)
    if not arguments.link:
        raise InputError("a trial needs --link URL, the way to the boat; with --predict nothing is sailed")
    plan = plan_of(vessel, arguments, script)._replace(law=TRIAL_LAW)
    # thrust turns a boat that makes no way
    by_rudder = DRIVES[vessel.drive.kind].usual.is_rudder
    least_way = WAY_LEAST * vessel.model.reference_speed_m_s if by_rudder else 0.0
    verdicts: list[Verdict] = []

    def judged(steered: Steered) -> Verdict:
        reason = script.reason or ("" if script.is_over else "stopped")
        verdicts.append(trial_verdict(steered, reason, at_dock=arguments.at_dock, least_way=least_way))
        return verdicts[-1]

    voyage = Voyage(lambda app, tick: script.is_over, math.inf, describe=script.describe, verdict=judged)
    code = steer(arguments, plan, voyage)
    if script.reason and code == ExitCode.OK:
        raise RefusedError(f"the trial ended before its time: {script.reason}")
    if code == ExitCode.OK and arguments.at_least and not serves(verdicts[-1].grade, arguments.at_least):
        raise RefusedError(f"the trial is not as good as --at-least {arguments.at_least} asks")
    return code


WAY_LEAST = 0.2
"""Of the speed that the model is for: slower, a boat made no way."""


def _script(arguments: argparse.Namespace, vessel: Vessel) -> TrialScript:
    from autopilot.runtime.build import limits_of, model_of

    angle_max_deg = math.degrees(limits_of(vessel).angle_max)
    return TrialScript(steps_of(arguments, round(angle_max_deg, 9), model_of(vessel)), _limits(arguments))


def _limits(arguments: argparse.Namespace) -> TrialLimits:
    least, most = arguments.speed_min_m_s or -math.inf, arguments.speed_max_m_s or math.inf
    if least >= most:
        raise InputError(f"--speed-min-m-s {least:g} must be below --speed-max-m-s {most:g}")
    corridor = math.inf if arguments.corridor_deg is None else math.radians(arguments.corridor_deg)
    return TrialLimits(least, most, corridor, arguments.radius_m or math.inf, arguments.time_limit or math.inf)


SYMBOLS = {"gain": "K", "time_constant": "T", "n3": "n3"}


def add_design_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the design."""
    parser.add_argument("vessel", metavar="VESSEL.yaml", help="vessel file with a first guess of the model")
    parser.add_argument("--water", required=True, metavar="LxW", help="available water, in metres: 300x200")
    parser.add_argument(
        "--time", action=number(10.0, 36000.0), required=True, metavar="S", help="available time, in seconds"
    )
    parser.add_argument(
        "--margin-m", action=NumberOption, metavar="M", help="room to keep on every side (a tenth of the width)"
    )
    parser.add_argument(
        "--speed-m-s", action=number(0.05, 100.0), metavar="U", help="speed (the model's reference speed)"
    )
    parser.add_argument(
        "--rate-hz", action=number(0.05, 100.0), default=10.0, metavar="HZ", help="samples a second (10)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def design_trial(arguments: argparse.Namespace) -> int:
    """Find the designs and print them; return the exit code."""
    from autopilot.cli.terminal import ProgressBar
    from autopilot.identification.trial_design import KINDS, designs

    vessel = named_vessel(arguments.vessel)
    boat, water = _boat(vessel, arguments), _water(arguments)
    with ProgressBar("designing") as bar:
        found = designs(boat, water, KINDS, bar.update)
    if not found:
        raise RefusedError(
            f"--water {arguments.water} does not hold ten seconds of any trial at {boat.speed:.1f} m/s: it needs more "
            "water or less speed (--speed-m-s)"
        )
    print(_as_json(found, boat) if arguments.json else _as_text(found, boat, arguments.vessel))
    return int(ExitCode.OK)


def _noise(sensors: Sensors) -> InstrumentNoise:
    from autopilot.identification.trial_design import InstrumentNoise

    rate = math.radians(sensors.rate_noise_deg_s) if sensors.gyro else math.inf
    return InstrumentNoise(rate, math.radians(sensors.heading_noise_deg))


def _boat(vessel: Vessel, arguments: argparse.Namespace) -> Boat:
    from autopilot.identification.trial_design import Boat
    from autopilot.runtime.build import gear_of, limits_of, model_of

    if vessel.model.n1 < 0.0:
        raise InputError(f"{arguments.vessel}: model.n1 is -1: trials are designed for course-stable boats only")
    sensors, model = vessel.sensors, model_of(vessel)
    noise = _noise(sensors)
    speed = arguments.speed_m_s or model.reference_speed
    # n0 costs information, but its guess is no part of the plan
    plan = model._replace(n0=0.0)
    return Boat(plan, gear_of(vessel), noise, limits_of(vessel).angle_max, speed, 1.0 / arguments.rate_hz)


def _water(arguments: argparse.Namespace) -> Water:
    from autopilot.identification.trial_design import Water

    parts = arguments.water.lower().split("x")
    try:
        sides = sorted((typed_number(part) for part in parts), reverse=True)
    except InputError:
        sides = []
    if len(sides) != 2 or not all(5.0 <= side <= 100_000.0 for side in sides):
        raise InputError(f"--water {arguments.water!r}: write length and width in metres, 5 to 100000, such as 300x200")
    margin = 0.1 * sides[1] if arguments.margin_m is None else arguments.margin_m
    if not 0.0 <= margin < 0.5 * sides[1]:
        raise InputError(f"--margin-m {margin:g}: allowed is 0 to less than half the width, {0.5 * sides[1]:g}")
    return Water(sides[0], sides[1], arguments.time, margin)


def _as_json(found: list[Design], boat: Boat) -> str:
    shown = [
        {
            **design.candidate._asdict(),
            "duration": design.duration,
            "berth": design.berth._asdict(),
            "standard_errors": design.errors,
            "score": design.score,
        }
        for design in found
    ]
    return json_text({"speed_m_s": boat.speed, "designs": shown})


def _as_text(found: list[Design], boat: Boat, vessel: str) -> str:
    lines = ["Least standard errors that any estimate can reach (Cramer and Rao), best trial first:", ""]
    for design in found:
        accuracy = accuracy_in_words(design.errors, boat.model)
        lines.append(f"{_words(design.candidate)}, {design.duration:.0f} s: {accuracy}")
        lines += [f"  {_place(design.berth)}", f"  autopilot trial {_command(design, vessel)}", ""]
    lines.append("The plan stands on the vessel file's model, without wind and current: keep a lookout and a margin.")
    return "\n".join(lines)


def _place(berth: Berth) -> str:
    side = "starboard" if berth.course >= 0.0 else "port"
    return (
        f"takes {berth.length:.0f} x {berth.width:.0f} m; begin {berth.behind:.0f} m from the short side behind and "
        f"{berth.to_port:.0f} m from the long side to port, {abs(math.degrees(berth.course)):.0f} deg to {side} of it"
    )


def accuracy_in_words(errors: Mapping[str, float], model: Norrbin) -> str:
    """Return how nearly K, T and n3 are determined, from their standard errors [SI units], in words."""
    return ", ".join(
        f"{symbol} to {100.0 * errors[name] / getattr(model, name):.2g} %"
        if errors[name] < getattr(model, name)
        else f"{symbol} not determined"
        for name, symbol in SYMBOLS.items()
        if name in errors
    )


def _words(candidate: Candidate) -> str:
    kind, rudder, second = candidate
    degrees = math.degrees(rudder)
    if kind == "zigzag":
        return f"Zigzag {degrees:.0f}/{math.degrees(second):.0f} deg"
    if kind == "turning":
        return f"Turns at {degrees:.0f} and {0.5 * degrees:.0f} deg, {second:.1f} s each"
    return f"Binary sequence of {degrees:.0f} deg, {second:.1f} s a step"


def _command(design: Design, vessel: str) -> str:
    from autopilot.identification import trial_design

    kind, rudder, second = design.candidate
    degrees = math.floor(10.0 * math.degrees(rudder) + 1.0e-6) / 10.0
    if kind == "zigzag":
        rest = f"--rudder-deg {degrees:g} --heading-deg {math.degrees(second):.1f} --duration {design.duration:.0f}"
    elif kind == "turning":
        count = max(1, round(design.duration / second))
        angles = trial_design.turning_angles(math.radians(degrees))
        listed = ",".join(f"{math.degrees(angles[k % len(angles)]):g}" for k in range(count))
        rest = f"--rudder-deg={listed} --each {second:.1f}"
    else:
        rest = f"--rudder-deg {degrees:g} --hold {second:.2f} --swing-deg {math.degrees(trial_design.SWING):g} "
        rest += f"--seed {trial_design.SEED} --duration {design.duration:.0f}"
    return f"{kind} {vessel} --link URL {rest}"


SPACING_S = 0.1


def predicted_accuracy(script: TrialScript, vessel: Vessel) -> str:
    """Return, in words, the least standard errors of K, T and n3 that any estimate from the trial can have, and the
    time and water that it takes: sailed in thought by the vessel file's model, gear and sensor noise, ten samples a
    second, at the model's reference speed, without wind and current. The script is used up."""
    import numpy as np

    from autopilot.identification.trial_design import cramer_rao, track_of
    from autopilot.runtime.build import model_of

    model, sensors = model_of(vessel)._replace(n0=0.0), vessel.sensors
    run = sailed(script, vessel)
    free = ("gain", "time_constant", *(("n3",) if model.n3 > 0.0 else ()), "n0")
    noise = _noise(sensors)
    accuracy = accuracy_in_words(cramer_rao([run], model, free, noise), model)
    segment = run.segments[0]
    ahead, abeam = (float(np.ptp(axis)) for axis in track_of(segment))
    return (
        f"At best (Cramer and Rao) this trial tells {accuracy}: one standard error, with the vessel file's model, gear "
        f"and sensor noise.\nIt takes {segment.time[-1]:.0f} s and {ahead:.0f} x {abeam:.0f} m, along the course at "
        "the beginning and across it, without wind and current."
        + (f"\nIt would end before its time: {script.reason}." if script.reason else "")
    )


def sailed(script: TrialScript, vessel: Vessel) -> Run:
    """Return the run that a script would be, from rest in yaw to its end."""
    from autopilot.identification.runs import Run, Segment
    from autopilot.identification.trial_design import planned
    from autopilot.runtime.build import gear_of, model_of

    model = model_of(vessel)._replace(n0=0.0)
    helm = _Helmsman(script, model.reference_speed)
    run = planned(model, gear_of(vessel), helm, script.left, SPACING_S, model.reference_speed)
    segment = run.segments[0]
    rows = max(int(segment.time.searchsorted(helm.ended, side="right")), 2)
    return Run(run.source, (Segment(*(array[:rows] if array.size else array for array in segment)),))


class _Helmsman:
    """Turns a script's orders into rudder angles for `planned`. Attributes: ended [s], when the script was over."""

    def __init__(self, script: TrialScript, speed: float) -> None:
        self._script, self._speed, self._before = script, speed, (-SPACING_S, 0.0)
        self._zigzag: tuple[Order, Helm] | None = None
        self.ended = math.inf

    def __call__(self, time: float, heading: float) -> float:
        """Return the order [rad] at a time [s] and heading [rad, unwrapped]."""
        since, last = self._before
        rate, self._before = (heading - last) / (time - since), (time, heading)
        from autopilot.identification.trial_design import zigzag_helm

        order = self._script(time, _tick(time, heading, rate, self._speed))
        if self._script.is_over:
            self.ended = min(self.ended, time)
            return 0.0
        if order.kind is not OrderKind.ZIGZAG:
            return order.rudder
        if self._zigzag is None or not self._zigzag[0].is_same(order):
            # a zigzag swings about the heading that it begins on
            swing, begun = zigzag_helm(order.rudder, order.heading_change), heading
            self._zigzag = order, lambda now, angle: swing(now, angle - begun)
        return self._zigzag[1](time, heading)


def _tick(time: float, heading: float, rate: float, speed: float) -> Tick:
    state = NavState(time, wrap(heading), rate, speed, 0.0, 0.0, 0.0, True)
    command = RudderCommand(time, 0.0, True)
    return Tick(0, time, (), Order(), state, Reference(heading), 0.0, command, Mode.ENGAGED, ())
