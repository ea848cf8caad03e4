"""The steering gear: what the rudder makes of an order. Angle, rate, lag and dead band; delay in `DelayLine`.

delta' = clip((order - delta)/lag, -to_port rate_max, to_starboard rate_max),  |delta| <= angle_max,
and no movement while |order - delta| < dead_band.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple


class SteeringGear(NamedTuple):
    """angle_max [rad], rate_max [rad/s] (inf: unlimited), lag [s], dead_band [rad] (half width), delay [s]; to_port,
    to_starboard: how many times rate_max it moves to that side. A hydraulic ram has less oil to fill on its rod's side.
    rate_max is that of the slower side, which planning goes by."""

    angle_max: float
    rate_max: float
    lag: float = 0.0
    dead_band: float = 0.0
    delay: float = 0.0
    to_port: float = 1.0
    to_starboard: float = 1.0


def sided(gear: SteeringGear, port: float, starboard: float) -> SteeringGear:
    """Return the gear with rates [rad/s] to port and to starboard."""
    slower = min(port, starboard)
    if math.isinf(slower):
        return gear._replace(rate_max=slower, to_port=1.0, to_starboard=1.0)
    return gear._replace(rate_max=slower, to_port=port / slower, to_starboard=starboard / slower)


def clip(value: float, low: float, high: float) -> float:
    """Return `value` held between `low` and `high`; nan stays nan."""
    if value < low:
        return low
    if value > high:
        return high
    return value


def gear_step(gear: SteeringGear, angle: float, order: float, dt: float) -> float:
    """Return the rudder angle [rad] `dt` [s] later, from `angle` [rad] under a held `order` [rad].

    The lag is solved exactly over the step, then held to the rate: stable for any dt >= 0.
    """
    share = -math.expm1(-dt / gear.lag) if gear.lag > 0.0 else 1.0
    return gear_step_by(gear, share, angle, order, dt)


def lag_share(gear: SteeringGear, dt: float) -> float:
    """Return the share of its way to an order that the rudder covers in `dt` [s] by its lag alone."""
    return -math.expm1(-dt / gear.lag) if gear.lag > 0.0 else 1.0


def gear_step_by(gear: SteeringGear, share: float, angle: float, order: float, dt: float) -> float:
    """Return the same as `gear_step`, its `lag_share` of `dt` [s] being known."""
    angle_max, rate_max, _, dead_band, _, to_port, to_starboard = gear
    error = (-angle_max if order < -angle_max else angle_max if order > angle_max else order) - angle
    if -dead_band <= error <= dead_band:
        return angle
    step, reach = share * error, rate_max * dt
    port, starboard = -reach * to_port, reach * to_starboard
    moved = angle + (port if step < port else starboard if step > starboard else step)
    return -angle_max if moved < -angle_max else angle_max if moved > angle_max else moved


class DelayLine:
    """Orders that take effect `delay` [s] after they were given. Memory: the orders still on their way."""

    def __init__(self, delay: float, initial: float = 0.0) -> None:
        if not 0.0 <= delay < math.inf:
            raise ValueError(f"delay must be finite and not negative, got {delay}")
        self._delay = delay
        self._initial = initial
        self._waiting: deque[tuple[float, float]] = deque()
        self._value = initial

    def reset(self) -> None:
        """Forget every order."""
        self._waiting.clear()
        self._value = self._initial

    @property
    def newest(self) -> float:
        """The order given last, in effect or on its way."""
        return self._waiting[-1][1] if self._waiting else self._value

    def give(self, now: float, order: float) -> None:
        """Take the `order` given at `now` [s]."""
        self._waiting.append((now + self._delay, order))

    def effective(self, now: float) -> float:
        """Return the order in effect at `now` [s]; times must not go backwards."""
        while self._waiting and self._waiting[0][0] <= now:
            self._value = self._waiting.popleft()[1]
        return self._value
