"""Orders that follow each other: each holds for its time, counted from the moment the pilot is engaged."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from autopilot.alarm_words import sentence_of, sentences_of
from autopilot.guidance.trial_limits import TrialLimits, TrialWatch
from autopilot.signals import Mode, Order, OrderKind, Tick

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
