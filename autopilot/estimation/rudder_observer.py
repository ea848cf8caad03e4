"""Where the rudder is and was: the steering-gear model under the orders given, set right by feedback.

    delta(t) = fed back(t_f) + gear(t) - gear(t_f)

so that feedback, which is late and sparse, corrects the level, and the model adds the motion since. Without feedback
the model stands alone. Memory: one value, and rings of the last ticks and orders. Scalar functions over them, which the
loop calls as they are and campaigns compile.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple, Protocol

from autopilot.estimation.tuning import FEEDBACK_FRESH, ORDERS_KEPT, TICKS_KEPT
from autopilot.models.steering_gear import SteeringGear, gear_step


class Ring(Protocol):
    """A list here, an array where runs are compiled."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> float: ...


class WritableRing(Ring, Protocol):
    """The same to write in."""

    def __setitem__(self, index: int, value: float, /) -> None: ...


class RudderPast(NamedTuple):
    """Rudder angles [rad] from their times [s] on, in rings: tick n, of `ticks` so far, is at n modulo their length.

    The length is a power of two, so that n & (length - 1) is that place, for which no division is needed. The rings
    begin with zeros: before the first tick the rudder is amidships.
    """

    times: Ring
    angles: Ring
    ticks: int


def held(past: RudderPast, start: float, end: float, grain: float) -> Iterator[tuple[float, float]]:
    """Yield (until [s], angle [rad]) from `start` to `end` [s], oldest first; see `stretch`."""
    at, tick = start, tick_at(past, start)
    while at < end:
        at, angle, tick = stretch(past, tick, at, end, grain)
        yield at, angle


def stretch(past: RudderPast, tick: int, begun: float, end: float, grain: float) -> tuple[float, float, int]:
    """Return until when [s], `end` at most, the rudder stood as at `begun` [s], its angle [rad] and that time's tick.

    tick: that of `begun`. Neighbours that together last no longer than `grain` [s] are one, with their mean angle.
    """
    times, angles, newest, ring = past.times, past.angles, past.ticks - 1, len(past.times) - 1
    if newest < 0 or begun >= times[newest & ring]:
        return end, angles[newest & ring], newest
    at, turned = begun, 0.0
    while at < end:
        until = times[(tick + 1) & ring] if tick < newest else end
        until = end if end < until else until
        if until > at:
            if until - begun > grain and at > begun:
                break
            turned += (until - at) * angles[tick & ring]
            at = until
        if at < end:
            tick += 1
    return at, turned / (at - begun), tick


def tick_at(past: RudderPast, time: float) -> int:
    """Return the newest tick at or before `time` [s], or the oldest that is known."""
    times, tick = past.times, past.ticks - 1
    ring = len(times) - 1
    oldest = tick - ring if tick > ring else 0
    while tick > oldest and times[tick & ring] > time:
        tick -= 1
    return tick


def angle_at(past: RudderPast, time: float) -> float:
    """Return the rudder's angle [rad] at `time` [s]; 0 where none is known."""
    return past.angles[tick_at(past, time) & (len(past.times) - 1)]


def angle_from(past: RudderPast, time: float) -> float:
    """Return the rudder's angle [rad] at the first tick at or after `time` [s]; the newest where none is."""
    tick, newest, ring = tick_at(past, time), past.ticks - 1, len(past.times) - 1
    if tick < newest and past.times[tick & ring] < time:
        tick += 1
    return past.angles[tick & ring]


class RudderMemory(NamedTuple):
    """Rings that the observer writes in: of every tick the time [s], the angle and that of the steering gear's model
    [rad], of every order its time [s] and angle [rad]; commands: of every tick the rudder [rad] that we had commanded
    until then, nan where somebody else steered. Their lengths are powers of two."""

    times: WritableRing
    angles: WritableRing
    gears: WritableRing
    order_times: WritableRing
    orders: WritableRing
    commands: WritableRing

    @property
    def copied(self) -> RudderMemory:
        """The same in rings of its own: what is kept of a moment that others go on writing from."""
        return RudderMemory(*([ring[place] for place in range(len(ring))] for ring in self))


class RudderObserver(NamedTuple):
    """The steering gear's model [rad], how many ticks and orders there were, how many orders have taken effect and the
    newest of these [rad], and the newest feedback [rad] with its time [s], -inf before any."""

    modelled: float = 0.0
    ticks: int = 0
    given: int = 0
    passed: int = 0
    effective: float = 0.0
    fed_back_at: float = -math.inf
    fed_back: float = 0.0


def rudder_memory() -> RudderMemory:
    """Return rings for the pilot: `TICKS_KEPT` ticks, and orders for the longest dead time of a vessel file."""
    times, angles, gears = ([0.0] * TICKS_KEPT for _ in range(3))
    return RudderMemory(times, angles, gears, [0.0] * ORDERS_KEPT, [0.0] * ORDERS_KEPT, [math.nan] * TICKS_KEPT)


def newest_angle(past: RudderPast) -> float:
    """Return the newest estimate [rad]."""
    return past.angles[(past.ticks - 1) & (len(past.angles) - 1)]


def is_fed_back(observer: RudderObserver, now: float) -> bool:
    """Return whether feedback at `now` [s] says where the rudder is, whoever moves it."""
    return now - observer.fed_back_at < FEEDBACK_FRESH


def with_feedback(observer: RudderObserver, time: float, angle: float) -> RudderObserver:
    """Return the observer after a measured `angle` [rad] of `time` [s]; older than the newest one is ignored."""
    if time < observer.fed_back_at:
        return observer
    return RudderObserver(
        observer.modelled, observer.ticks, observer.given, observer.passed, observer.effective, time, angle
    )


def ordered(observer: RudderObserver, memory: RudderMemory, now: float, order: float) -> RudderObserver:
    """Return the observer after the `order` [rad] that left for the steering gear at `now` [s]."""
    place = observer.given & (len(memory.orders) - 1)
    passed, effective = observer.passed, observer.effective
    if observer.given - passed == len(memory.orders):
        passed, effective = passed + 1, memory.orders[place]
    memory.order_times[place] = now
    memory.orders[place] = order
    return RudderObserver(
        observer.modelled,
        observer.ticks,
        observer.given + 1,
        passed,
        effective,
        observer.fed_back_at,
        observer.fed_back,
    )


def write_command(observer: RudderObserver, memory: RudderMemory, command: float) -> None:
    """Write down what is commanded [rad] until the next tick, nan where somebody else steers."""
    memory.commands[observer.ticks & (len(memory.commands) - 1)] = command


def all_effective(observer: RudderObserver, memory: RudderMemory) -> RudderObserver:
    """Return the observer with every order that was on its way in effect."""
    if observer.passed == observer.given:
        return observer
    newest = memory.orders[(observer.given - 1) & (len(memory.orders) - 1)]
    return observer._replace(passed=observer.given, effective=newest)


def advanced(gear: SteeringGear, observer: RudderObserver, memory: RudderMemory, now: float) -> RudderObserver:
    """Return the observer at `now` [s], the angle there written down; time does not go back."""
    times, angles, gears, order_times, orders, _ = memory
    ring, orders_ring = len(times) - 1, len(orders) - 1
    modelled, ticks, given, passed, effective, fed_back_at, fed_back = observer
    if ticks:
        dt = now - times[(ticks - 1) & ring]
        if dt <= 0.0:
            return observer
        while passed < given and order_times[passed & orders_ring] + gear.delay <= now:
            effective = orders[passed & orders_ring]
            passed += 1
        modelled = gear_step(gear, modelled, effective, dt)
    angle = modelled
    if now - fed_back_at < FEEDBACK_FRESH:
        then = modelled
        if ticks and fed_back_at < times[(ticks - 1) & ring]:
            then = gears[tick_at(RudderPast(times, angles, ticks), fed_back_at) & ring]
        angle += fed_back - then
    place = ticks & ring
    times[place], gears[place], angles[place] = now, modelled, angle
    return RudderObserver(modelled, ticks + 1, given, passed, effective, fed_back_at, fed_back)
