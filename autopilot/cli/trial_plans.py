"""The manoeuvres of `autopilot trial` as steps, from its options."""

from __future__ import annotations

import argparse
import math

from autopilot.angles import wrap
from autopilot.cli.trial_script import Helm, Step, Until, turning, zigzag
from autopilot.errors import InputError
from autopilot.guidance.trials import BinaryHelm, SteadyRate, Turned, spiral_angles
from autopilot.models.norrbin import Norrbin
from autopilot.order_values import typed_number
from autopilot.signals import Order, OrderKind, Tick

LEAST_ANGLE_DEG, LEAST_STEP_DEG = 1.0, 0.5
LASTING = (1.0, 36000.0)
HOLDS = (0.2, 600.0)
SPEEDS = (0.01, 100.0)
STEADY_SHARE = 0.02
"""A rate is steady when it changes by less than this share of the linear model's steady rate, over a window."""
LEAST_WINDOW_S = 4.0


def steps_of(arguments: argparse.Namespace, angle_max_deg: float, model: Norrbin) -> list[Step]:
    """Return the steps of the trial `arguments.kind`. Raises InputError."""
    makers = {
        "zigzag": _zigzag,
        "turning": _turning,
        "turning-circle": _turning_circle,
        "spiral": _spiral,
        "pull-out": _pull_out,
        "prbs": _prbs,
    }
    steps = makers[arguments.kind](arguments, angle_max_deg, model)
    return [*_straight(arguments.approach), *steps]


def check(name: str, value: float, low: float, high: float) -> None:
    """Raise InputError unless `value` lies within."""
    if not low <= value <= high:
        raise InputError(f"{name} {value:g}: allowed is {low:g} to {high:g}")


def _straight(seconds: float) -> list[Step]:
    return [_held(0.0, seconds, "approach")] if seconds > 0.0 else []


def _held(angle: float, seconds: float, label: str, until: Until | None = None) -> Step:
    return turning(angle, seconds)._replace(label=label, until=until)


def _zigzag(arguments: argparse.Namespace, angle_max_deg: float, model: Norrbin) -> list[Step]:
    check("--rudder-deg", arguments.rudder_deg, LEAST_ANGLE_DEG, angle_max_deg)
    label = f"zigzag {arguments.rudder_deg:g}/{arguments.heading_deg:g}"
    rudder, change = math.radians(arguments.rudder_deg), math.radians(arguments.heading_deg)
    return [zigzag(rudder, change, arguments.duration)._replace(label=label)]


def _turning(arguments: argparse.Namespace, angle_max_deg: float, model: Norrbin) -> list[Step]:
    try:
        angles = [typed_number(part) for part in arguments.rudder_deg.split(",")]
    except InputError:
        raise InputError(f"--rudder-deg {arguments.rudder_deg!r}: write angles like 10,20,-10,-20") from None
    for angle in angles:
        check("--rudder-deg", angle, -angle_max_deg, angle_max_deg)
    return [_held(math.radians(angle), arguments.each, f"turn {angle:+g} deg") for angle in angles]


def _turning_circle(arguments: argparse.Namespace, angle_max_deg: float, model: Norrbin) -> list[Step]:
    degrees = angle_max_deg if arguments.rudder_deg is None else arguments.rudder_deg
    check("--rudder-deg", degrees, LEAST_ANGLE_DEG, angle_max_deg)
    steps: list[Step] = []
    for side in _sides(arguments.side):
        if steps:
            steps += [_settle(arguments, model), *_straight(arguments.approach)]
        label = f"turning circle {side * degrees:+g} deg"
        until = _turned(math.radians(arguments.turn_deg))
        steps.append(_held(side * math.radians(degrees), arguments.each, label, until))
    return steps


def _spiral(arguments: argparse.Namespace, angle_max_deg: float, model: Norrbin) -> list[Step]:
    check("--rudder-deg", arguments.rudder_deg, LEAST_ANGLE_DEG, angle_max_deg)
    check("--step-deg", arguments.step_deg, LEAST_STEP_DEG, arguments.rudder_deg)
    check("--fine-step-deg", arguments.fine_step_deg, LEAST_STEP_DEG, arguments.step_deg)
    steps_deg = (arguments.rudder_deg, arguments.step_deg, arguments.fine_step_deg)
    angles = spiral_angles(*(math.radians(degrees) for degrees in steps_deg))
    return [
        _held(angle, arguments.each, f"spiral {math.degrees(angle):+.1f} deg", _steady(model, arguments))
        for angle in angles
    ]


def _pull_out(arguments: argparse.Namespace, angle_max_deg: float, model: Norrbin) -> list[Step]:
    check("--rudder-deg", arguments.rudder_deg, LEAST_ANGLE_DEG, angle_max_deg)
    steps = []
    for side in _sides(arguments.side):
        degrees = side * arguments.rudder_deg
        steps.append(_held(math.radians(degrees), arguments.each, f"turn {degrees:+g} deg", _steady(model, arguments)))
        steps.append(_held(0.0, arguments.each, "pull-out, amidships", _steady(model, arguments)))
    return steps


def _prbs(arguments: argparse.Namespace, angle_max_deg: float, model: Norrbin) -> list[Step]:
    check("--rudder-deg", arguments.rudder_deg, LEAST_ANGLE_DEG, angle_max_deg)
    hold = arguments.hold if arguments.hold is not None else min(max(model.time_constant, 1.0), HOLDS[1])
    helm = _binary(math.radians(arguments.rudder_deg), hold, math.radians(arguments.swing_deg), arguments.seed)
    label = f"binary sequence, {arguments.rudder_deg:g} deg every {hold:g} s"
    return [Step(Order(OrderKind.RUDDER), arguments.duration, None, helm, label)]


def _sides(text: str) -> tuple[int, ...]:
    return {"starboard": (1,), "port": (-1,), "both": (1, -1)}[text]


def _settle(arguments: argparse.Namespace, model: Norrbin) -> Step:
    return _held(0.0, arguments.each, "amidships", _steady(model, None))


def _steady(model: Norrbin, arguments: argparse.Namespace | None) -> Until:
    """Return the end of a step whose yaw rate is to become steady; fresh at each step, so that it forgets the last."""
    window = max(LEAST_WINDOW_S, 3.0 * model.time_constant)
    rudder = math.radians(10.0 if arguments is None else arguments.rudder_deg)
    watch = SteadyRate(window, STEADY_SHARE * model.gain * rudder)
    return lambda now, tick: watch.take(now, tick.state.rate)


def _turned(angle: float) -> Until:
    count = Turned()
    return lambda now, tick: abs(count.take(tick.state.heading)) >= angle


def _binary(rudder: float, hold: float, swing: float, seed: int) -> Helm:
    binary = BinaryHelm(hold, swing, seed)
    base: list[float] = []

    def helm(since: float, tick: Tick) -> float:
        if not base:
            base.append(tick.state.heading)
        return rudder * binary.side(since, wrap(tick.state.heading - base[0]))

    return helm
