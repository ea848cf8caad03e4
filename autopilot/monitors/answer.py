"""Whether the boat answers to her rudder, or to its opposite, from the rate of turn alone."""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from autopilot.models.norrbin import Norrbin, damping
from autopilot.monitors.watched import Watched

WINDOW_S = (2.0, 8.0)
"""A time constant, but no shorter and no longer than this."""
MOST_POINTS = 40
LONGEST_STEP_S = 0.5
LEAST_POINTS = 12
LEAST_SWING = math.radians(5.0)
"""A rudder that has moved by less within the window tells nothing."""
OPPOSITE = (-2.0, -0.5)
ANSWERS = (0.3, 2.0)
"""Shares of the answer in her model that a boat has whose rudder is wired the wrong way, and the right way."""
BETTER = 4.0
"""The opposite rudder must explain what is seen so many times better than a gust does."""
KINKS = 6
"""A gust is taken to set in at so many moments within the window."""
LASTS_S = 0.5
"""What is found must hold for so long [s]."""
NOISE = math.radians(0.15)
"""Rates are not read more finely than this [rad/s]."""


class _Point(NamedTuple):
    """At `time` [s]: the rudder [rad], the rate with what damping took of it put back [rad/s], and what the model's
    answers to the rudder and to a steady rudder of 1 rad have added up to [rad/s]."""

    time: float
    rudder: float
    rate: float
    answer: float
    push: float


class RudderAnswer:
    """Fits T r' + damping(r) = K (a delta + d), over the last seconds, for the answer a and a steady push d.

    Integrated once, so that no rate is differentiated:
    r - r0 + integral of damping/T = a K/T integral of delta + d K/T t.

    a = 1 is the model, 0 no rudder at all, -1 a rudder wired the wrong way. Slow boats say too little of themselves
    within the window; their turn is left to the watch for a runaway.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._points: deque[_Point] = deque()
        self._last: _Point | None = None
        self._lost = self._rate = 0.0
        self._since: float | None = None

    def is_opposite(self, model: Norrbin, watched: Watched) -> bool:
        """Return whether the boat has answered to the opposite of her rudder for long enough."""
        state = watched.state
        if not (watched.steers and watched.has_way and math.isfinite(state.rate) and math.isfinite(state.rudder)):
            self.reset()
            return False
        self._add(model, watched)
        against = state.rate * state.rudder < 0.0
        if not against or not self._swings() or not self._fits_opposite():
            self._since = None
            return False
        if self._since is None:
            self._since = watched.now
        return watched.now - self._since >= LASTS_S

    def _add(self, model: Norrbin, watched: Watched) -> None:
        state, points = watched.state, self._points
        last = self._last
        if last is None or not 0.0 <= watched.now - last.time <= LONGEST_STEP_S:
            points.clear()
            self._last = _Point(watched.now, state.rudder, state.rate, 0.0, 0.0)
            self._lost, self._rate = 0.0, state.rate
            return
        step = watched.now - last.time
        gain = model.gain / model.time_constant
        mean = 0.5 * (self._rate + state.rate)
        self._lost += damping(model, mean) / model.time_constant * step
        self._rate = state.rate
        answer = last.answer + gain * 0.5 * (last.rudder + state.rudder) * step
        self._last = _Point(watched.now, state.rudder, state.rate + self._lost, answer, last.push + gain * step)
        window = min(max(model.time_constant, WINDOW_S[0]), WINDOW_S[1])
        if not points or watched.now - points[-1].time >= window / MOST_POINTS:
            points.append(self._last)
        while watched.now - points[0].time > window:
            points.popleft()

    def _swings(self) -> bool:
        angles = [point.rudder for point in self._points]
        return len(angles) >= LEAST_POINTS and max(angles) - min(angles) >= LEAST_SWING

    def _fits_opposite(self) -> bool:
        """Return whether the opposite rudder and a steady push explain the rates far better than the right one does
        with a push that changes at any moment: a gust, which the rudder goes against at once."""
        points = list(self._points)
        rates = [point.rate for point in points]
        answers = [point.answer for point in points]
        steady: list[list[float]] = [[1.0] * len(points), [point.push for point in points]]
        floor = NOISE * NOISE * len(points)
        opposite = _left(rates, answers, steady, OPPOSITE) + floor
        for number in range(KINKS):
            kink = points[number * len(points) // KINKS].push
            gust = [max(point.push - kink, 0.0) for point in points]
            if _left(rates, answers, [*steady, gust], ANSWERS) + floor < BETTER * opposite:
                return False
        return True


def _left(seen: list[float], answer: list[float], others: list[list[float]], shares: tuple[float, float]) -> float:
    """Return the squares that `others` and a share of `answer` within `shares` leave of `seen`: least squares."""
    basis: list[list[float]] = []
    for other in others:
        rest = _without(other, basis)
        norm = math.sqrt(sum(x * x for x in rest))
        if norm > 1.0e-9:
            basis.append([x / norm for x in rest])
    seen, answer = _without(seen, basis), _without(answer, basis)
    own = sum(x * x for x in answer)
    both = sum(x * y for x, y in zip(seen, answer, strict=True))
    share = min(max(both / own if own > 0.0 else 0.0, shares[0]), shares[1])
    return sum((y - share * x) ** 2 for x, y in zip(answer, seen, strict=True))


def _without(vector: list[float], basis: list[list[float]]) -> list[float]:
    for unit in basis:
        along = sum(x * y for x, y in zip(vector, unit, strict=True))
        vector = [x - along * y for x, y in zip(vector, unit, strict=True)]
    return vector
