"""The steering gear: what the rudder makes of an order. Angle, rate, lag, dead band, play; delay in `DelayLine`. Pure.

delta' = clip((u - delta)/lag, -to_port rate_max, to_starboard rate_max),  |delta| <= angle_max,
u = clip(delta, order - play, order + play), and no movement while |u - delta| < dead_band: with play the rudder is
dragged along at either end of it, and rests between.

A hydraulic gear may have on/off valves: where the rudder goes then, and when a valve is to open and to shut. A valve
that is open lets the pump drive the rudder at its full rate to one side, and nothing lies in between:

    opening: after the signal the rudder rests for a while        delta' = 0
    open:                                                         delta' = -rate_port or rate_starboard
    shut: oil and rudder run on                                   delta' = rate exp(-t/coasting)

Oil and rudder come up to their rate as gradually as they run on. A pulse of t moves the rudder by
rate (t - opening + coasting) in all, and opening is what is lost of that: more than the time until the rudder moves. So
the least pulse moves the rudder by m = rate (max(least - opening, 0) + coasting). A rudder that is wrong by
less than m/2 is better left alone: it would be further off, on the other side, afterwards. With the time between two
looks and what is not known of the angle that gives the dead zone

    zone = max(m)/2 + max(rate) turn/2 + unsure

in which a shut valve stays shut. An open one shuts where the rudder, running on, will rest at its order. From zone to
rest there is always more than half a least pulse either way, so a still order is reached by one pulse and no chatter.

In a sea the order swings about its mean, and a valve that follows wears itself out for a heading that is hardly better.
The zone grows with half the amplitude of that swing, which is sqrt(2) times its standard deviation:

    zone^2 = zone_still^2 + variance/2
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple


class SteeringGear(NamedTuple):
    """angle_max [rad], rate_max [rad/s] (inf: unlimited), lag [s], dead_band [rad] (half width), delay [s]; to_port,
    to_starboard: how many times rate_max it moves to that side. A hydraulic ram has less oil to fill on its rod's side.
    rate_max is that of the slower side, which planning goes by. play [rad]: backlash of the linkage, each way."""

    angle_max: float
    rate_max: float
    lag: float = 0.0
    dead_band: float = 0.0
    delay: float = 0.0
    to_port: float = 1.0
    to_starboard: float = 1.0
    play: float = 0.0


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
    angle_max, rate_max, _, dead_band, _, to_port, to_starboard, play = gear
    if play > 0.0:
        order = order - play if order - play > angle else order + play if order + play < angle else angle
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

    def give(self, now: float, order: float) -> None:
        """Take the `order` given at `now` [s]."""
        self._waiting.append((now + self._delay, order))

    def effective(self, now: float) -> float:
        """Return the order in effect at `now` [s]; times must not go backwards."""
        while self._waiting and self._waiting[0][0] <= now:
            self._value = self._waiting.popleft()[1]
        return self._value


KNOWN_RAD = math.radians(1.0)
"""A rudder is known within the usual error of a feedback."""


class RudderBounds:
    """Between which angles a rudder lies that nobody measures, since orders began to move it.

    A helm is taken over from somebody else with the rudder anywhere. Of two rudders under the same orders the one that
    is further to starboard stays so, but for the dead band: the step of a gear never falls with the angle it begins at.
    So every rudder lies between the two that began hard over to either side, and is known when these have met, to
    within dead band and play, which leave any rudder apart.
    """

    def __init__(self, gear: SteeringGear) -> None:
        self._gear, self._apart = gear, KNOWN_RAD + 2.0 * (gear.dead_band + gear.play)
        self.forget()

    def forget(self) -> None:
        """Somebody else moves it."""
        self._port, self._starboard = -self._gear.angle_max, self._gear.angle_max
        self._at = self._begun = math.nan
        self._line = DelayLine(self._gear.delay)

    def order(self, now: float, angle: float) -> None:
        """Take the order [rad] that stands from `now` [s] on."""
        if self.is_known:
            return
        self._begun = now if math.isnan(self._begun) else self._begun
        # what was on its way when the helm was taken was somebody else's
        if self._at - self._begun >= self._gear.delay:
            stood, dt = self._line.effective(self._at), max(now - self._at, 0.0)
            self._port = gear_step(self._gear, self._port, stood, dt)
            self._starboard = gear_step(self._gear, self._starboard, stood, dt)
        self._line.give(now, angle)
        self._at = now

    @property
    def is_known(self) -> bool:
        """Whether the orders tell where it is."""
        return self._starboard - self._port <= self._apart


RUNS_ON = 3.0
"""After so many coasting times the rudder rests: nothing is opened to the other side before."""
MEAN_S, VARIANCE_S = 10.0, 40.0
"""The order's mean, and the variance about it, are those of about so long [s]: several waves."""
CLIPPED = 10.0
"""More of a deviation than so many zones counts as this: a turn is no sea."""
LEARNT_S = 0.15
"""What a sensor shows is taken over in this time [s]: its noise, not its angle, is left out."""


class Valve(NamedTuple):
    """port, starboard [rad/s]: rates to each side; opening, coasting, least [s]: see above."""

    port: float
    starboard: float
    opening: float
    coasting: float
    least: float

    def rate(self, side: int) -> float:
        """Return the rate [rad/s] to a side, starboard positive."""
        return self.starboard if side > 0 else self.port

    def least_move(self, side: int) -> float:
        """Return how far [rad] the least pulse moves the rudder."""
        return self.rate(side) * (max(self.least - self.opening, 0.0) + self.coasting)

    def zone(self, turn: float, unsure: float) -> float:
        """Return the dead zone [rad], each way. turn [s]: time between two looks; unsure [rad]: of the angle."""
        return 0.5 * max(self.least_move(-1), self.least_move(1)) + 0.5 * max(self.port, self.starboard) * turn + unsure


class Gate(NamedTuple):
    """side: the valve that is open, starboard 1, port -1, none 0, since a time [s]; ran: the last that was open."""

    side: int = 0
    since: float = -math.inf
    ran: int = 0


class Reckoned(NamedTuple):
    """The rudder [rad] and its speed [rad/s] at a time [s], as the valves must have moved it."""

    angle: float = 0.0
    speed: float = 0.0
    time: float = math.nan


class Swing(NamedTuple):
    """The order's mean [rad] and variance [rad^2] about it."""

    mean: float = math.nan
    variance: float = 0.0


def swung(before: Swing, zone: float, order: float, dt: float) -> Swing:
    """Return the swing after an `order` [rad] that stood for `dt` [s]. zone [rad]: that of a still order."""
    if math.isnan(before.mean):
        return Swing(order, 0.0)
    mean = before.mean - math.expm1(-dt / MEAN_S) * (order - before.mean)
    most = CLIPPED * zone
    off = min(max(order - mean, -most), most)
    return Swing(mean, before.variance - math.expm1(-dt / VARIANCE_S) * (off * off - before.variance))


def zone_in(swing: Swing, zone: float) -> float:
    """Return the dead zone [rad] for an order that swings; `zone` [rad] is that of a still one."""
    return math.sqrt(zone * zone + 0.5 * swing.variance)


def reckoned(valve: Valve, stop: float, gate: Gate, before: Reckoned, now: float) -> Reckoned:
    """Return where the rudder is at `now` [s], the `gate` having stood as it does since `before`; within +-`stop`."""
    if math.isnan(before.time):
        return before._replace(time=now)
    dt = max(now - before.time, 0.0)
    if gate.side:
        moving = min(max(now - gate.since - valve.opening, 0.0), dt)
        speed = gate.side * valve.rate(gate.side) if moving > 0.0 else 0.0
        angle = before.angle + speed * moving
    else:
        left = math.exp(-dt / valve.coasting) if valve.coasting > 0.0 else 0.0
        angle = before.angle + before.speed * valve.coasting * (1.0 - left)
        speed = before.speed * left
    return Reckoned(min(max(angle, -stop), stop), speed, now)


def corrected(before: Reckoned, angle: float, dt: float) -> Reckoned:
    """Return the rudder after a sensor has shown `angle` [rad], `dt` [s] after it did last."""
    return before._replace(angle=before.angle - math.expm1(-dt / LEARNT_S) * (angle - before.angle))


LEAK_S = 30.0
"""What the rudder does behind shut valves is remembered over so much of the time [s] in which they were shut."""
LEAK_SHARE = 0.05
"""Of the slower valve's rate: against such a leak that valve alone would be open for a twentieth of the time."""


class Leak(NamedTuple):
    """How far a sensor has seen the rudder move behind valves that had been shut for long [rad], in how long [s]; since
    when they have been and the angle shown then, nan: not now."""

    moved: float = 0.0
    time: float = 0.0
    shown: tuple[float, float] = (math.nan, math.nan)

    @property
    def rate(self) -> float:
        """The rate [rad/s], starboard positive; 0.0 where too little has been seen."""
        return self.moved / self.time if self.time > LEAK_S / 3.0 else 0.0


def leaked(valve: Valve, before: Leak, gate: Gate, now: float, angle: float) -> Leak:
    """Return the leak after a sensor shows `angle` [rad] at `now` [s]."""
    if gate.side or now - gate.since < RUNS_ON * valve.coasting:
        return before._replace(shown=(math.nan, math.nan))
    dt = now - before.shown[0]
    if not 0.0 <= dt < LEAK_S:
        return before._replace(shown=(now, angle))
    kept = math.exp(-dt / LEAK_S)
    return Leak(kept * before.moved + angle - before.shown[1], kept * before.time + dt, (now, angle))


def switched(valve: Valve, zone: float, turn: float, gate: Gate, rudder: Reckoned, order: float) -> Gate:
    """Return which valve is open from `rudder.time` [s] on, for an `order` [rad]; the next look is `turn` [s] later.

    Never from one side to the other at once, and none opens against a rudder that still runs on.
    """
    now = rudder.time
    if gate.side:
        if now - gate.since < valve.least:
            return gate
        left = gate.side * (order - rudder.angle) - valve.rate(gate.side) * (valve.coasting + 0.5 * turn)
        return Gate(0, now, gate.side) if left <= 0.0 else gate
    error = order - rudder.angle - rudder.speed * valve.coasting
    if abs(error) <= zone:
        return gate
    side = 1 if error > 0.0 else -1
    if side != gate.ran and now - gate.since < RUNS_ON * valve.coasting:
        return gate
    return Gate(side, now, side)
