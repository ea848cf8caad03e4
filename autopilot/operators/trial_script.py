"""Orders that follow each other: each holds for its time, counted from the moment the pilot is engaged.

The manoeuvres of `autopilot trial` as steps, from its options; and what is typed at the helm: headings, changes, turn
patterns.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.errors import InputError
from autopilot.files.outside import SHOWN, typed_number
from autopilot.files.printable import printable
from autopilot.guidance import manoeuvres
from autopilot.guidance.manoeuvres import (
    BinaryHelm,
    Pattern,
    SteadyRate,
    TrialLimits,
    TrialWatch,
    Turned,
    spiral_angles,
)
from autopilot.models.norrbin import Norrbin
from autopilot.signals import Mode, Order, OrderKind, Tick
from autopilot.supervision.panel import sentence_of, sentences_of

Until = Callable[[float, Tick], bool]
"""Whether a step has reached its end at a time [s], in view of the tick; called at every tick of the step."""
Helm = Callable[[float, Tick], float]
"""The rudder angle [rad] of a step at a time [s] since its beginning, in view of the tick."""


class Step(NamedTuple):
    """An order and how long [s] it holds at most: shorter where `until` says so. `helm` moves the rudder within it;
    `label` says what it is."""

    order: Order
    duration: float
    until: Until | None = None
    helm: Helm | None = None
    label: str = ""


def zigzag(rudder: float, heading_change: float, duration: float) -> Step:
    """Return a zigzag about the present heading; angles [rad]."""
    return Step(Order(OrderKind.ZIGZAG, math.nan, rudder, heading_change), duration)


def turning(rudder: float, duration: float) -> Step:
    """Return a turn at a held rudder [rad]."""
    return Step(Order(OrderKind.RUDDER, rudder=rudder), duration)


def heading(angle: float, duration: float) -> Step:
    """Return a course [rad], or the present one where `angle` is nan."""
    return Step(Order(OrderKind.HEADING, angle), duration)


class TrialScript:
    """The steps one after the other. Once the pilot has left ENGAGED the script is over: a human has the helm.

    All steps are one intended action and share a serial, so that nothing engages again by itself.
    """

    def __init__(self, steps: Sequence[Step], limits: TrialLimits | None = None) -> None:
        self._steps = tuple(steps)
        self._watch = None if limits is None else TrialWatch(limits)
        self.reason = ""
        """Why the script ended before its time, '' where it did not."""
        self._index = 0
        self._since: float | None = None
        self._now = 0.0
        self.is_over = False
        self.is_complete = False
        self.begun_at: list[float] = []

    @property
    def progress(self) -> float:
        """Share of the script that has been sailed, 0 to 1."""
        if self.is_over or self._since is None:
            return 1.0 if self.is_over else 0.0
        share = (self._now - self._since) / self._steps[self._index].duration
        return (self._index + min(share, 1.0)) / len(self._steps)

    def stop(self) -> None:
        """End the script where it is."""
        self.is_over = True

    @property
    def left(self) -> float:
        """Time [s] that is left at most."""
        if self._since is None or self.is_over:
            return 0.0 if self.is_over else sum(step.duration for step in self._steps)
        rest = sum(step.duration for step in self._steps[self._index + 1 :])
        return rest + max(self._steps[self._index].duration - (self._now - self._since), 0.0)

    def describe(self, tick: Tick) -> str:
        """Return where the script is, in a few words."""
        if self._since is None or self.is_over:
            return ""
        step = self._steps[self._index]
        count = f"{self._index + 1}/{len(self._steps)} " if len(self._steps) > 1 else ""
        off = f"  {self._watch.distance:.0f} m off" if self._watch is not None else ""
        return f"{count}{step.label or step.order.kind.name.lower()}  {self.left:.0f} s left{off}"

    def __call__(self, now: float, tick: Tick | None) -> Order:
        """Return the order at `now` [s]."""
        self._now = now
        if tick is not None and tick.state.valid and not self.is_over and (lost := _unlogged(tick)):
            self.is_over, self.reason = True, lost
        if tick is not None and tick.mode is Mode.ENGAGED:
            self._go_on(now, tick)
        elif self._since is not None and not self.is_over:
            self.is_over = True
            self.reason = _taken(tick)
        if self.is_over:
            return Order()
        step = self._steps[self._index]
        order = step.order
        if step.helm is not None and tick is not None and self._since is not None:
            order = order._replace(rudder=step.helm(now - self._since, tick))
        return order._replace(serial=1)

    def _go_on(self, now: float, tick: Tick) -> None:
        if self.is_over:
            return
        if self._watch is not None and (reason := self._watch.reason(tick)):
            self.is_over = True
            self.reason = reason if isinstance(reason, str) else f"alarm: {sentence_of(reason)}"
            return
        if self._since is None:
            self._begin(now)
            return
        step = self._steps[self._index]
        if now - self._since < step.duration and not (step.until is not None and step.until(now, tick)):
            return
        self._index += 1
        if self._index == len(self._steps):
            self.is_over = self.is_complete = True
        else:
            self._begin(now)

    def _begin(self, now: float) -> None:
        self._since = now
        self.begun_at.append(now)


def _unlogged(tick: Tick) -> str:
    """Return why what is sailed is not logged, '' where it is: without its log a trial is worth nothing, so that this
    ends one, or keeps it from beginning, though it was so before."""
    stopped = next((alarm for alarm in tick.alarms if alarm.name == "disk_full" and not alarm.is_past), None)
    return "" if stopped is None else f"alarm: {sentence_of(stopped)}"


def _taken(tick: Tick | None) -> str:
    if tick is None:
        return "the pilot gave no tick"
    why = f": {'; '.join(sentences_of(tick.alarms))}" if tick.alarms else ""
    return f"the pilot left the helm ({tick.mode.name.lower()}){why}"


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
    return [
        _held(math.radians(angle), arguments.each, f"rudder {angle:+g} deg" if angle else "amidships")
        for angle in angles
    ]


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


def heading_of(text: str) -> float:
    """Return a heading typed in degrees, 0 to 360, in rad. Raises InputError."""
    degrees = degrees_of(text)
    if not 0.0 <= degrees <= 360.0:
        raise InputError(f"heading {text}: allowed is 0 to 360 degrees")
    return wrap(math.radians(degrees))


def turn_of(text: str) -> float:
    """Return a change of heading typed in degrees, -360 to 360, in rad. Raises InputError."""
    degrees = degrees_of(text)
    if not -360.0 <= degrees <= 360.0:
        raise InputError(f"change of heading {text}: allowed is -360 to 360 degrees")
    return math.radians(degrees)


def degrees_of(text: str) -> float:
    """Return a number of degrees as it was typed. Raises InputError."""
    try:
        return typed_number(text)
    except InputError as error:
        raise InputError(f"{error} of degrees") from None


PATTERN_HELP = (
    "p u +: U turn to starboard (-: port)  p circle + M  p spiral + M M  p zigzag + DEG M  p square + M  p s + DEG M"
)


class Size(NamedTuple):
    """A number a pattern takes, in metres or degrees."""

    name: str
    unit: str
    low: float
    high: float


RADIUS = Size("radius", "m", 1.0, 10000.0)
GROWTH = Size("change of radius each turn", "m", -1000.0, 1000.0)
ANGLE = Size("angle", "deg", 1.0, 90.0)
LEG = Size("leg", "m", 1.0, 100000.0)
KINDS: dict[str, tuple[tuple[Size, ...], Callable[..., Pattern]]] = {
    "u": ((), manoeuvres.u_turn),
    "circle": ((RADIUS,), manoeuvres.circle),
    "spiral": ((RADIUS, GROWTH), manoeuvres.spiral),
    "zigzag": ((ANGLE, LEG), manoeuvres.zigzag),
    "square": ((LEG,), manoeuvres.square),
    "s": ((ANGLE, RADIUS), manoeuvres.s_curve),
}
"""In the order of their numbers over MAVLink, from 0; the one behind the last is `Skipper.swing`."""


def pattern_of(kind: str, side: float, sizes: Sequence[float]) -> Pattern:
    """Return a pattern to one side (1 starboard, -1 port) with its sizes in metres and degrees. Raises InputError."""
    if kind not in KINDS:
        raise InputError(f"pattern {printable(repr(kind), SHOWN)}: allowed are {', '.join(KINDS)}")
    if side not in (1.0, -1.0):
        raise InputError(f"pattern {kind}: the side is + (starboard) or - (port)")
    takes, make = KINDS[kind]
    if len(sizes) < len(takes):
        raise InputError(f"pattern {kind}: give {' and '.join(f'{size.name} [{size.unit}]' for size in takes)}")
    for size, value in zip(takes, sizes, strict=False):
        if not size.low <= value <= size.high:
            raise InputError(
                f"pattern {kind}: {size.name} {value:g}, allowed is {size.low:g} to {size.high:g} {size.unit}"
            )
    given = [math.radians(value) if size.unit == "deg" else value for size, value in zip(takes, sizes, strict=False)]
    return make(int(side), *given)


def pattern_typed(text: str) -> Pattern:
    """Return the pattern of a typed line, like `circle + 60`. Raises InputError."""
    kind, *rest = text.split() or [""]
    side = {"+": 1.0, "-": -1.0}.get(rest[0], 0.0) if rest else 0.0
    try:
        sizes = [typed_number(word) for word in rest[1:]]
    except InputError as error:
        raise InputError(f"pattern: {error}; {PATTERN_HELP}") from None
    if kind in KINDS and len(sizes) > len(KINDS[kind][0]):
        raise InputError(f"pattern {kind}: too many numbers; {PATTERN_HELP}")
    return pattern_of(kind, side, sizes)
