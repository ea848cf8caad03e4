"""Manoeuvres: trials, which order rudder, and turn patterns, which order a heading that moves. Pure.

Trials: when the rudder goes over, when a turn has become steady, when it is enough. ITTC 7.5-04-02-01, Full Scale
Manoeuvring Trials. Zigzag: rudder to one side; when the heading has changed by psi_e from the base course, rudder to
the other side; and so on. Spiral: rudder angle after angle, each held until the yaw rate is steady. Pull-out: a steady
turn, then the rudder amidships until the rate is steady again.

What ends a trial before its time: an alarm, or speed, heading, distance and time outside what was set.

Patterns: the heading moves with the way made good through the water, or with the turn so far. A pattern says by how
much the heading should have changed from where it began, as a function of the distance gone s [m] and the angle turned
[rad, unwrapped]; side is +1 to starboard, -1 to port:

    U turn       side min(pi, turned + lead)
    circle       side s / R
    spiral       side theta, with s = R theta + G theta^2 / (4 pi): the radius changes by G each turn
    zigzag       side a on even legs of length L, -side a on odd ones
    square       side pi/2 after each leg of length L
    S            swings of side a to -side a and back, along arcs of radius R

A boat that cannot turn as sharply turns as sharply as it can: the order never leads its heading by more than `LEAD`,
so that the short way round stays the way of the pattern.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterator
from typing import NamedTuple

from autopilot.angles import shortest_turn, wrap
from autopilot.guidance.current import Place, offset
from autopilot.signals import AlarmEvent, Order, OrderKind, PositionSample, Tick
from autopilot.supervision.alarms import kind_of

STEADY_POINTS = 64
REGISTER_BITS = 9
TAPS = (9, 5)
"""x^9 + x^5 + 1 is primitive: the sequence repeats after 511 steps (Golomb, Shift Register Sequences, 1967)."""


def zigzag_side(side: int, base: float, heading: float, heading_change: float) -> int:
    """Return the side (+1 starboard, -1 port) the rudder belongs on; angles in rad, `heading_change` > 0."""
    swing = wrap(heading - base)
    if side * swing >= heading_change:
        return -side
    return side


class SteadyRate:
    """Tells when the yaw rate has become steady: the means over both halves of the last `window` [s] differ by less
    than `tolerance` [rad/s]. Memory: about STEADY_POINTS rates.
    """

    def __init__(self, window: float, tolerance: float) -> None:
        self._window = window
        self._tolerance = tolerance
        self._rates: deque[tuple[float, float]] = deque()

    def take(self, now: float, rate: float) -> bool:
        """Take the yaw `rate` [rad/s] at `now` [s]; return whether it is steady."""
        rates = self._rates
        if not rates or now - rates[-1][0] >= self._window / STEADY_POINTS:
            rates.append((now, rate))
        while len(rates) > 2 and now - rates[1][0] >= self._window:
            rates.popleft()
        if now - rates[0][0] < self._window:
            return False
        middle = now - 0.5 * self._window
        early = [one for time, one in rates if time < middle]
        late = [one for time, one in rates if time >= middle]
        if not early or not late:
            return False
        return abs(sum(late) / len(late) - sum(early) / len(early)) < self._tolerance


class Turned:
    """Counts how far [rad] the heading has turned since the first one taken, over as many circles as it takes."""

    def __init__(self) -> None:
        self.angle = 0.0
        self._last: float | None = None

    def take(self, heading: float) -> float:
        """Take a `heading` [rad] and return the angle turned so far, starboard positive."""
        if self._last is not None:
            self.angle += wrap(heading - self._last)
        self._last = heading
        return self.angle


def spiral_angles(largest: float, coarse: float, fine: float) -> list[float]:
    """Return the rudder angles [rad] of a spiral: from `largest` to starboard over amidships to port and back.

    Steps are `coarse` outside twice `coarse` and `fine` inside, where the loop of an unstable boat shows.
    """
    down = [largest]
    while down[-1] > 1.0e-9:
        step = coarse if down[-1] > 2.0 * coarse + 1.0e-9 else fine
        down.append(max(down[-1] - step, 0.0))
    half = [*down, *(-angle for angle in reversed(down[:-1]))]
    return [*half, *reversed(half[:-1])]


def binary_sequence(seed: int) -> Iterator[int]:
    """Yield +1 and -1 of a maximum-length sequence of 511, from the place that `seed` chooses; for ever."""
    register = seed % (2**REGISTER_BITS - 1) + 1
    while True:
        yield 1 if register & 1 else -1
        fed_back = (register >> (REGISTER_BITS - TAPS[0]) ^ register >> (REGISTER_BITS - TAPS[1])) & 1
        register = register >> 1 | fed_back << (REGISTER_BITS - 1)


class BinaryHelm:
    """The side of the rudder in a pseudo-random binary trial: a new one every `hold` [s], and the side that leads back
    while the heading is further than `corridor` [rad] off the base course, until it is within half of it.
    """

    def __init__(self, hold: float, corridor: float, seed: int) -> None:
        self._hold = hold
        self._corridor = corridor
        self._sides = binary_sequence(seed)
        self._until = -math.inf
        self._side = 1
        self._back = 0

    def side(self, now: float, swing: float) -> int:
        """Return +1 (starboard) or -1 at `now` [s], the heading being `swing` [rad] to starboard of the base course."""
        if now >= self._until:
            self._until = now + self._hold
            self._side = next(self._sides)
        if abs(swing) > self._corridor:
            self._back = -1 if swing > 0.0 else 1
        elif abs(swing) < 0.5 * self._corridor:
            self._back = 0
        return self._back or self._side


class TrialLimits(NamedTuple):
    """speed_low and speed_high [m/s], corridor [rad] either side of the course at the beginning, radius [m] around the
    place of the beginning, time [s] from the beginning; each infinite where there is none.
    """

    speed_low: float = -math.inf
    speed_high: float = math.inf
    corridor: float = math.inf
    radius: float = math.inf
    time: float = math.inf


class TrialWatch:
    """Watches one trial from its first tick on. Memory: where it began, and how far off it is."""

    def __init__(self, limits: TrialLimits) -> None:
        self._limits = limits
        self._begun: Tick | None = None
        self._now = 0.0
        self._origin: Place | None = None
        self._start = (0.0, 0.0)
        self._known: frozenset[str] = frozenset()
        self.north = 0.0
        self.east = 0.0

    @property
    def distance(self) -> float:
        """How far [m] the boat is from where the trial began."""
        return math.hypot(self.north, self.east)

    def reason(self, tick: Tick) -> AlarmEvent | str:
        """Return why the trial must end: a new alarm, or one sentence about a limit; '' while it need not."""
        if self._begun is None:
            self._begun, self._now = tick, tick.now
            self._known = frozenset(event.name for event in _ending(tick))
        self._carry(tick)
        for event in _ending(tick):
            if event.name not in self._known:
                return event._replace(is_escalated=False)
        limits, state = self._limits, tick.state
        swing = wrap(state.heading - self._begun.state.heading)
        if tick.now - self._begun.now > limits.time:
            return f"the time limit of {limits.time:g} s is over"
        if not limits.speed_low <= state.speed <= limits.speed_high:
            return (
                f"the speed of {state.speed:.2f} m/s is outside {limits.speed_low:g} to {limits.speed_high:g} m/s; "
                "set the throttle"
            )
        if abs(swing) > limits.corridor:
            return (
                f"the heading is {math.degrees(swing):+.0f} deg off the course at the beginning, beyond "
                f"{math.degrees(limits.corridor):.0f} deg"
            )
        if self.distance > limits.radius:
            return f"the boat is {self.distance:.0f} m from where the trial began, beyond {limits.radius:g} m"
        return ""

    def _carry(self, tick: Tick) -> None:
        dt, self._now = tick.now - self._now, tick.now
        self.north += dt * tick.state.speed * math.cos(tick.state.heading)
        self.east += dt * tick.state.speed * math.sin(tick.state.heading)
        for sample in tick.samples:
            if isinstance(sample, PositionSample) and math.isfinite(sample.latitude + sample.longitude):
                place = Place(sample.latitude, sample.longitude)
                if self._origin is None:
                    self._origin, self._start = place, (self.north, self.east)
                north, east = offset(self._origin, place)
                self.north, self.east = self._start[0] + north, self._start[1] + east


def _ending(tick: Tick) -> list[AlarmEvent]:
    """Return the alarms that end a trial where they were not there when it began."""
    return [event for event in tick.alarms if kind_of(event).ends_trials]


LEAD = math.radians(90.0)
DT_MOST = 2.0
LEAST_GROWTH = 0.01
"""A spiral that changes its radius by less [m] is a circle."""


class Progress(NamedTuple):
    """Since a pattern began: gone [m], turned [rad] to starboard."""

    gone: float
    turned: float


Pattern = Callable[[Progress], float]
"""The change of heading [rad] to starboard that is wanted."""


def u_turn(side: int, angle: float = math.pi) -> Pattern:
    """Return a turn by `angle` [rad] to one side, the long way round where it is more than half a circle."""
    return lambda progress: side * min(angle, side * progress.turned + LEAD)


def circle(side: int, radius: float) -> Pattern:
    """Return a circle of `radius` [m] that does not end."""
    return lambda progress: side * progress.gone / radius


def spiral(side: int, radius: float, growth: float) -> Pattern:
    """Return a circle whose radius changes by `growth` [m] each turn; it ends, straight, when no radius is left."""
    if abs(growth) < LEAST_GROWTH:
        return circle(side, radius)

    def wanted(progress: Progress) -> float:
        root = math.sqrt(max(radius * radius + growth * progress.gone / math.pi, 0.0))
        return side * (root - radius) * 2.0 * math.pi / growth

    return wanted


def zigzag(side: int, angle: float, leg: float) -> Pattern:
    """Return legs of `leg` [m], each at `angle` [rad] to one side or the other of where it began."""
    return lambda progress: side * angle * (1.0 if int(progress.gone / leg) % 2 == 0 else -1.0)


def square(side: int, leg: float) -> Pattern:
    """Return legs of `leg` [m] with a turn of 90 degrees after each."""
    return lambda progress: side * 0.5 * math.pi * int(progress.gone / leg)


def s_curve(side: int, angle: float, radius: float) -> Pattern:
    """Return swings of `angle` [rad] to both sides along arcs of `radius` [m]."""

    def wanted(progress: Progress) -> float:
        # a triangle of period 4 angle: up to the angle, down to its opposite, and back
        along = (progress.gone / radius + angle) % (4.0 * angle)
        return side * (min(along, 4.0 * angle - along) - angle)

    return wanted


def _straight(_: Progress) -> float:
    return 0.0


class PatternGuide:
    """Leads through a pattern. Memory: where it began, how far the boat has gone and turned.

    Attributes:
        following: whether it leads.
    """

    def __init__(self) -> None:
        self._pattern: Pattern = _straight
        self.leave()

    def follow(self, pattern: Pattern) -> None:
        """Begin a pattern at the heading that is."""
        self.leave()
        self._pattern, self.following = pattern, True

    def leave(self) -> None:
        """Lead no longer."""
        self.following = False
        self._pattern = _straight
        self._base: float | None = None
        self._heading = 0.0
        self._gone = self._turned = 0.0
        self._now = 0.0

    def course(self, now: float, heading: float, speed: float) -> float:
        """Return the heading [rad] to steer at `now` [s], with the boat on `heading` [rad] at `speed` [m/s]."""
        if self._base is None:
            self._base = self._heading = heading
            self._now = now
        self._gone += abs(speed) * min(max(now - self._now, 0.0), DT_MOST)
        self._turned += shortest_turn(self._heading, heading)
        self._heading, self._now = heading, now
        wanted = self._pattern(Progress(self._gone, self._turned))
        return wrap(self._base + min(max(wanted, self._turned - LEAD), self._turned + LEAD))


SWING = math.radians(40.0)
"""To each side of the course on one thruster."""
ASIDE = math.radians(10.0)
"""The boat makes good a course so much further to the side of the thruster that stands still."""
ASIDE_MOST = math.radians(45.0)
GONE_M = 10.0
"""The course made good is taken over so many metres."""


class OneThruster:
    """Drives a boat of which one of two thrusters stands still, by swings about the course that is ordered.

    The other one turns the boat whenever it pushes: no thrust of it both holds a course and drives. Ahead to one side
    and astern to the other, hard over each, it drives, because the boat turns quicker for it ahead, and is braked more
    by its turn. Memory: where the course made good began, and how far [rad] the swings lie to the side of the course.

    Attributes:
        following: whether it leads.
    """

    def __init__(self) -> None:
        self.leave()

    def follow(self, weak: str) -> None:
        """Begin; weak: the side of the thruster that stands still."""
        self.leave()
        self.following = True
        self._aside = -ASIDE if weak == "starboard" else ASIDE

    def leave(self) -> None:
        """Lead no longer."""
        self.following, self._aside = False, 0.0
        self._begun: tuple[float, Place] | None = None

    def order(self, course: float, rudder: float, place: Place | None) -> Order:
        """Return the swings about a `course` [rad] with as much `rudder` [rad] as there is; place: where the boat is,
        None where nobody knows."""
        if place is None or self._begun is None or self._begun[0] != course:
            self._begun = None if place is None else (course, place)
        else:
            north, east = offset(self._begun[1], place)
            if math.hypot(north, east) >= GONE_M:
                off = wrap(course - math.atan2(east, north))
                self._aside = min(max(self._aside + 0.5 * off, -ASIDE_MOST), ASIDE_MOST)
                self._begun = course, place
        return Order(OrderKind.ZIGZAG, wrap(course + self._aside), rudder, SWING)
