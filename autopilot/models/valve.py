"""On/off valves of a hydraulic steering gear: where the rudder goes, and when a valve is to open and to shut.

A valve that is open lets the pump drive the rudder at its full rate to one side, and nothing lies in between:

    opening: after the signal the rudder rests for a while        delta' = 0
    open:                                                         delta' = -rate_port or rate_starboard
    shut: oil and rudder run on                                   delta' = rate exp(-t/coasting)

so that the least pulse moves the rudder by m = rate (max(least - opening, 0) + coasting). A rudder that is wrong by
less than m/2 is better left alone: it would be further off, on the other side, afterwards. With the time between two
looks and what is not known of the angle that gives the dead zone

    zone = max(m)/2 + max(rate) turn/2 + unsure

in which a shut valve stays shut. An open one shuts where the rudder, running on, will rest at its order. From zone to
rest there is always more than half a least pulse either way, so a still order is reached by one pulse and no chatter.

In a sea the order swings about its mean, and a valve that follows wears itself out for a heading that is hardly better.
The zone grows with half the amplitude of that swing, which is sqrt(2) times its standard deviation:

    zone^2 = zone_still^2 + variance/2

Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

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
