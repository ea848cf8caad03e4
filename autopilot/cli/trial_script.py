"""Orders that follow each other: each holds for its time, counted from the moment the pilot is engaged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from autopilot.signals import Mode, Order, OrderKind, Tick


class Step(NamedTuple):
    """An order and how long [s] it holds."""

    order: Order
    duration: float


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

    def __init__(self, steps: Sequence[Step]) -> None:
        self._steps = tuple(steps)
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

    def __call__(self, now: float, tick: Tick | None) -> Order:
        """Return the order at `now` [s]."""
        self._now = now
        if tick is not None and tick.mode is Mode.ENGAGED:
            if self._since is None:
                self._begin(now)
            elif now - self._since >= self._steps[self._index].duration:
                self._index += 1
                if self._index == len(self._steps):
                    self.is_over = self.is_complete = True
                else:
                    self._begin(now)
        elif self._since is not None:
            self.is_over = True
        if self.is_over:
            return Order()
        return self._steps[self._index].order._replace(serial=1)

    def _begin(self, now: float) -> None:
        self._since = now
        self.begun_at.append(now)
