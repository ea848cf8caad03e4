"""The whole pilot as a fuzzer's target: bytes become ticks, and after every tick the command must be fit to leave."""

from __future__ import annotations

import math
import struct
import types
import typing
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from autopilot import signals
from autopilot.pilot import Pilot
from autopilot.runtime.build import build_pilot
from autopilot.signals import (
    AcknowledgeSample,
    AlarmEvent,
    HeadingSample,
    HelmCause,
    HelmSample,
    Mode,
    Order,
    OrderKind,
    SupervisorState,
    Tick,
)
from autopilot.steering import LONGEST_STEP
from autopilot.supervision.alarms import CATALOGUE
from autopilot.supervision.states import ENDED
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Roll, Vessel

LAWS = ("backstepping", "pid", "sliding", "trial")
SPECIAL = (math.nan, math.inf, -math.inf, 0.0, -0.0, 1e308, -1e308, 5e-324, math.pi, -math.pi, 1e16, 2.0**53)
WORDS = ("", "x", "battery_low", "disk_full", "deadline_missed", "heading_lost")
ALARMS = tuple(CATALOGUE)
SAMPLES: tuple[Any, ...] = typing.get_args(signals.Sample)
FIELDS = {sample: list(typing.get_type_hints(sample).items()) for sample in SAMPLES}
SLACK = 1.0e-9


def _failsafe(action: str) -> Callable[[Vessel], Vessel]:
    back = {"resume": True, "reengage_after_reboot": True}
    return lambda boat: replace(boat, failsafe=replace(boat.failsafe, action=action, **back))  # type: ignore[arg-type]


def _rolling(boat: Vessel) -> Vessel:
    alarms = replace(boat.alarms, roll_deg=30.0)
    return replace(boat, control=replace(boat.control, roll=Roll(0.2)), alarms=alarms)


BOATS: dict[str, tuple[str, Callable[[Vessel], Vessel]]] = {
    **{law: (law, lambda boat: boat) for law in LAWS},
    "windward": ("backstepping", _failsafe("windward")),
    "dead reckoning": ("backstepping", _failsafe("dead_reckoning")),
    "roll damping": ("backstepping", _rolling),
    "guided": ("backstepping", lambda boat: replace(boat, helm=replace(boat.helm, method="guided"))),
    "dead band": ("backstepping", lambda boat: replace(boat, rudder=replace(boat.rudder, dead_band_deg=2.0))),
    "no wave filter": ("pid", lambda boat: replace(boat, estimator=replace(boat.estimator, wave_filter="off"))),
}
"""What steers -> the law, and what is changed in the vessel file, so that every branch of the tick is reached."""


def pilot_seeds() -> list[bytes]:
    """Return sound inputs: quiet runs, of which the engines make wild ones."""
    quiet = bytes((0,)) + b"".join(struct.pack("<BBB", 0, 128 + step % 5, 255) for step in range(60))
    return [quiet, quiet[:90], bytes(range(256)), bytes(200)]


class Feed:
    """Gives the bytes of an input out, and zeros when they are used up."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._place = 0

    def __bool__(self) -> bool:
        return self._place < len(self._data)

    def byte(self) -> int:
        """Return the next byte."""
        self._place += 1
        return self._data[self._place - 1] if self._place <= len(self._data) else 0

    def number(self, low: float, high: float) -> float:
        """Return a number: mostly one that can be, at times any, at times one that is none."""
        kind = self.byte()
        if kind < 208:
            return low + (high - low) * (self.byte() + 256 * self.byte()) / 65535.0
        if kind < 224:
            return float(struct.unpack("<d", bytes(self.byte() for _ in range(8)))[0])
        return SPECIAL[self.byte() % len(SPECIAL)]


def sample_of(feed: Feed, now: float) -> Any:
    """Return a sample of any kind, each field of its type."""
    kind = SAMPLES[feed.byte() % len(SAMPLES)]
    values = [now if name == "time" and feed.byte() < 200 else _value(feed, hint) for name, hint in FIELDS[kind]]
    return kind(*values)


def _value(feed: Feed, hint: Any) -> Any:
    if hint == AlarmEvent | None:
        return None if feed.byte() < 64 else AlarmEvent(ALARMS[feed.byte() % len(ALARMS)], _value(feed, str))
    if typing.get_origin(hint) in (typing.Union, types.UnionType):
        return None if feed.byte() < 64 else _value(feed, float)
    if hint is bool:
        return bool(feed.byte() & 1)
    if hint is int:
        return feed.byte() - 128
    if hint is str:
        return WORDS[feed.byte() % len(WORDS)]
    if hint is HelmCause:
        return HelmCause(feed.byte() % len(HelmCause))
    return feed.number(-4.0, 4.0)


def order_of(feed: Feed, order: Order) -> Order:
    """Return the order before, or, for one byte in eight, another."""
    if feed.byte() >= 32:
        return order
    kind = OrderKind(feed.byte() % len(OrderKind))
    serial = order.serial + feed.byte() % 3
    is_led = feed.byte() >= 192
    return Order(kind, feed.number(-4.0, 4.0), feed.number(-1.0, 1.0), feed.number(-1.0, 1.0), serial, is_led)


class PilotTarget:
    """Runs the pilot of one of BOATS through the ticks that an input stands for. AssertionError where one is unfit.

    Attributes:
        steps: ticks run; engaged: those in which the pilot had the rudder; states: of the supervisor, that were seen.
    """

    def __init__(self, name: str) -> None:
        law, change = BOATS[name]
        vessel = change(load_vessel("lanxin"))
        self._pilot: Pilot = build_pilot(vessel, law)
        self._resumes = vessel.failsafe.resume or vessel.failsafe.reengage_after_reboot
        self._spent = 0
        limits = self._pilot.config.limits
        self._angle_max, self._rate_max = limits.angle_max, limits.rate_max
        self.steps = self.engaged = 0
        self.states: set[SupervisorState] = set()

    def __call__(self, data: bytes) -> None:
        """Run one input."""
        feed = Feed(data)
        pilot = self._pilot
        pilot.reset()
        # most inputs begin as a run does: standing by, with a heading, and an order to engage
        order = Order(OrderKind.HEADING, 0.5, serial=1) if feed.byte() < 200 else Order()
        now, heading = 10.0, 0.1
        before: Tick | None = None
        self._spent = 0
        while feed:
            step = feed.byte()
            dt = 0.05 if step < 200 else feed.number(-0.2, 0.7)
            if math.isfinite(now + dt) and abs(now + dt) < 1e9:
                now += dt
            samples = [sample_of(feed, now) for _ in range(step % 4)]
            if step & 4 == 0:
                heading = math.remainder(heading + 0.01 * (feed.byte() - 128) / 128.0, math.tau)
                samples.append(HeadingSample(now, heading, 0.0))
            order = order_of(feed, order)
            tick = pilot.step(now, tuple(samples), order)
            self.judge(tick, before)
            before = tick

    def judge(self, tick: Tick, before: Tick | None) -> None:
        """Raise AssertionError where the tick must not be, after the one before."""
        self._judge_command(tick, before)
        self._judge_state(tick, before)

    def _judge_command(self, tick: Tick, before: Tick | None) -> None:
        command, state = tick.command, tick.state
        self.steps += 1
        self.engaged += tick.mode is Mode.ENGAGED
        self.states.add(tick.supervisor)
        assert isinstance(tick.supervisor, SupervisorState)
        assert isinstance(tick.mode, Mode)
        assert math.isfinite(command.angle), f"{command}"
        assert abs(command.angle) <= self._angle_max + SLACK, f"{command}"
        assert command.engaged or command.angle == 0.0, f"{command}"
        assert tick.mode not in (Mode.STANDBY, Mode.OVERRIDE) or not command.engaged, f"{tick.mode!r} {command}"
        assert tick.mode is not Mode.ENGAGED or command.engaged, f"{tick.mode!r} {command}"
        assert math.isfinite(state.heading), f"{state}"
        assert math.isfinite(state.rate), f"{state}"
        assert math.isfinite(state.bias), f"{state}"
        if before is not None and before.command.engaged and command.engaged:
            allowed = self._rate_max * min(max(tick.now - before.now, 0.0), LONGEST_STEP)
            assert abs(command.angle - before.command.angle) <= allowed + SLACK, f"{before.command} {command}"

    def _judge_state(self, tick: Tick, before: Tick | None) -> None:
        """The state is one that the orders given, and who has the helm, allow."""
        state, order = tick.supervisor, tick.order
        if order.kind is OrderKind.STANDBY:
            assert state is SupervisorState.STANDBY, f"{order} {state!r}"
        was = SupervisorState.STANDBY if before is None else before.supervisor
        if tick.mode is Mode.ENGAGED:
            asked = _asked_by(order)
            assert state in (asked, SupervisorState.DEGRADED), f"{order} {state!r}"
            helms = {sample.source: sample.available for sample in tick.samples if isinstance(sample, HelmSample)}
            assert all(helms.values()), f"{state!r}, but {helms}"
            if was in ENDED and not self._resumes:
                assert order.serial != self._spent, f"{was!r} -> {state!r} by {order}"
        elif state in ENDED:
            # somebody who acknowledges what is past has read it
            is_read = any(isinstance(sample, AcknowledgeSample) for sample in tick.samples)
            is_read = is_read or (before is not None and state is was and not before.alarms)
            assert tick.alarms or (is_read and state is was), f"{state!r} without a word"
            if state is not was:
                self._spent = order.serial


def _asked_by(order: Order) -> SupervisorState:
    if order.kind is not OrderKind.HEADING:
        return SupervisorState.TRIAL
    return SupervisorState.TRACK if order.is_led else SupervisorState.HEADING
