"""What faults do to rudder, engine and boat, between the orders and the physics."""

from __future__ import annotations

import math
from collections import deque

from autopilot.models.steering_gear import SteeringGear, clip
from sitl.boat import Disturbance
from sitl.faults import FaultBoard

TRAILING_S = 0.5
"""A rudder that nothing holds trails amidships with this time constant; assumed."""


class RudderFaults:
    """The steering gear with its faults. `order` comes before the gear, `reached` after it, once a step each."""

    def __init__(self, faults: FaultBoard, gear: SteeringGear) -> None:
        self._faults = faults
        self._gear = gear
        self._on_their_way: deque[tuple[float, float]] = deque()

    def order(self, time: float, order: float, rudder: float) -> float:
        """Return what the gear makes of the `order` [rad], the rudder being at `rudder` [rad]."""
        faults = self._faults
        if (late := faults.size("rudder_late", time)) is None:
            self._on_their_way.clear()
        else:
            order = delayed(self._on_their_way, time, order, late)
        if faults.is_on("rudder_reversed", time):
            order = -order
        if (offset := faults.size("rudder_offset", time)) is not None:
            order += math.radians(offset)
        if (side := faults.size("rudder_hard_over", time)) is not None:
            order = math.copysign(self._gear.angle_max, side)
        if (play := faults.size("rudder_play", time)) is not None:
            # the gear drags the rudder along at either end of the play
            half = math.radians(play)
            order = clip(rudder, order - half, order + half)
        return order

    def reached(self, time: float, before: float, after: float, dt: float) -> float:
        """Return where the rudder [rad] really is after a step of `dt` [s] from `before` to `after`."""
        faults = self._faults
        if faults.is_on("rudder_stuck", time):
            return before
        if faults.is_on("rudder_free", time):
            return before * math.exp(-dt / TRAILING_S)
        if (share := faults.size("rudder_slow", time)) is not None:
            rate = self._gear.rate_max if math.isfinite(self._gear.rate_max) else math.radians(20.0)
            after = clip(after, before - share * rate * dt, before + share * rate * dt)
        if (stop := faults.size("rudder_limited", time)) is not None:
            after = clip(after, -math.radians(stop), math.radians(stop))
        return after


def thrust_left(faults: FaultBoard, time: float, thrust_speed: float, cruise_speed: float) -> float:
    """Return the speed [m/s] that the engine would reach, with its faults."""
    if faults.is_on("engine_stopped", time):
        return 0.0
    astern = faults.size("engine_astern", time)
    return thrust_speed if astern is None else -astern * cruise_speed


class Pushes:
    """What acts on the boat from outside, with what is injected. Memory: where a stream sets to."""

    def __init__(self, faults: FaultBoard) -> None:
        self._faults = faults
        self._towards: float | None = None

    def on(self, time: float, heading: float, disturbance: Disturbance) -> Disturbance:
        """Return the `disturbance` of a boat that heads for `heading` [rad], and the pushes on top of it."""
        faults = self._faults
        if (push := faults.size("yaw_push", time)) is not None:
            disturbance = disturbance._replace(rudder=disturbance.rudder + math.radians(push))
        if (heel := faults.size("heel", time)) is not None:
            disturbance = disturbance._replace(roll_slope=disturbance.roll_slope + math.radians(heel))
        if (stream := faults.size("stream", time)) is None:
            self._towards = None
            return disturbance
        self._towards = towards = heading if self._towards is None else self._towards
        return disturbance._replace(
            current_north=disturbance.current_north + stream * math.cos(towards),
            current_east=disturbance.current_east + stream * math.sin(towards),
        )


def delayed(waiting: deque[tuple[float, float]], time: float, value: float, delay: float) -> float:
    """Return the value that was `delay` [s] ago, the first of all where `waiting` does not go back so far.

    `waiting` holds (time [s], value), the oldest first; `value` is added to it.
    """
    waiting.append((time, value))
    while len(waiting) > 1 and waiting[1][0] <= time - delay + 1.0e-9:
        waiting.popleft()
    return waiting[0][1]
