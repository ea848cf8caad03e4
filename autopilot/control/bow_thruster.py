"""A bow thruster beside a rudder that cannot turn the boat: its share of full thrust, by the tick.

It holds the heading where there is no way to steer by. The boat that lies still is taken to turn by

    r' = (R u |u| - r)/T,   R = R0 (1 - U/U1),

with u the thruster's share of full revolutions, -1 to 1, R0 the steady rate at full thrust, T the time to 63 % of it,
U the speed and U1 the speed at which the thruster does nothing any more. Heading error and rate are carried a dead time
d ahead, and the rate that is wanted is that from which half of the thrust still stops the boat in time,

    r_w = sgn(e) min(k x, sqrt(2 b (x - b/(2 k^2))), C R),   x = max(|e| - band, 0),   b = (R/T)/2,

linear near the course, so that the dead time is met (k = 1/(4 t), t = 2 d + 0.3 s). The motor starts where the rate is
off by more than its shortest run is worth, and in a turn by a share of what is wanted; it stops where the rate is
right. A proportional one runs at what takes the rate there within t. It runs for `least_on` at least and rests for
`least_off` between two runs, so it cannot chatter.

With way it takes what a rudder at its stop cannot. The law wants a yaw acceleration a, of which the rudder has A; what
is lacking, as a share l of the thruster's R/T, is learnt as the law goes on to ask for more, or for less,

    l' = (|a| - A)/R, held to -1/T..1/T,   0 <= l <= 1.

One that knows full and nothing starts at LACKS and stops at SUFFICES, so that a turn that is short of rudder for a
moment starts nothing; a proportional one runs at sqrt(l).

Heat is what a motor of short rated time allows: h' = |u|/run while it runs, h' = -1/rest while it rests, from 0. At 1
it rests until h is COOLED: over any time it runs at most `run` + (time at rest) run/rest at full. Where the boat does
not turn for it the thruster is dead, or the wind is as strong: it is stopped for T, in which a boat that it held falls
back. Where that does not happen the thruster is dead, and not asked again until the pilot is engaged anew. Pure.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.models.norrbin import Norrbin
from autopilot.signals import AlarmEvent, NavState, Reference, RudderCommand, Sample, ThrusterSample

COOLED = 0.5
"""Share of the heat at which a thruster that was too hot runs again."""
STOPPED_BY = 0.5
"""Share of the thrust that a turn is planned to be stopped with: the rest is for wind."""
FASTEST = 0.8
"""Share C of the steady rate at full thrust that is wanted at most."""
SETTLING_S = 0.3
"""What is added to twice the dead time for the rate to be right in."""
WORTH = 0.6
"""Share of the shortest run's rate by which the rate is off before the motor starts."""
COASTS = 0.3
"""Share of the wanted rate that a turn may lose before the motor starts again."""
LEAST_RATE = math.radians(0.3)
"""[rad/s]: a gyro's noise starts no motor."""
LEAST_EFFECT = 0.1
"""Share of its effect at rest below which a thruster is not asked."""
FALLEN = -math.expm1(-1.0)
"""Share of the rate at full thrust that is lost in T without it."""
WEAK = 0.25
"""Share of the change of rate that must have come."""
LACKS = 0.6
SUFFICES = 0.2
"""Shares of full thrust that the rudder lacks at which help begins and ends."""
JUDGED_S = 3.0
"""A push is judged behind the dead time and this, or T where that is longer."""
PROVEN_S = 60.0
"""A thruster that has held the boat is not doubted again for so long."""
MOST_OF_IT = 0.7
"""Share of the thrust that a push is judged by: with less a thruster may just hold the boat against the wind."""
THRUSTER_HEARD = 3.0
"""[s]: a link that has not said for so long that it commands the bow thruster does not."""


class BowThruster(NamedTuple):
    """What a thruster does to the boat that lies still, and what it may be asked.

    rate [rad/s]: R0; time [s]: T; useless_above [m/s]: U1; delay [s]: from order to thrust; proportional: else full or
    nothing; least: share below which it does not turn; run, rest [s]: as long it may run at full, cold, and as long it
    takes to cool; least_on, least_off [s]; dead_band [rad].
    """

    rate: float
    time: float
    useless_above: float
    delay: float = 0.3
    proportional: bool = False
    least: float = 0.2
    run: float = 60.0
    rest: float = 600.0
    least_on: float = 0.5
    least_off: float = 1.0
    dead_band: float = math.radians(3.0)


class BowState(NamedTuple):
    """share: the order, starboard positive; since [s]: for so long it runs, or rests; heat [-]; is_hot: it rests until
    it has cooled; is_weak: the boat does not turn for it; expected, coast [rad/s]: the rate of this run by the equation
    above, and without thrust; pushed [s]: for so long it has pushed with most of its thrust; lack [-]: the share of it
    that a rudder at its stop lacks; doubt [-]: the side of the push that it was stopped in to see what it does, else 0;
    doubted_rate [rad/s]: of then; proven [s]: for so long it is not doubted."""

    share: float = 0.0
    since: float = math.inf
    heat: float = 0.0
    is_hot: bool = False
    is_weak: bool = False
    expected: float = 0.0
    coast: float = 0.0
    pushed: float = 0.0
    lack: float = 0.0
    doubt: float = 0.0
    doubted_rate: float = 0.0
    proven: float = 0.0


AT_REST = BowState()


class BowLook(NamedTuple):
    """What the thruster is asked by: heading error (wanted less actual, wrapped) [rad], rate [rad/s], speed [m/s]; and
    where the rudder steers what the law wants of it and what it has at its stop [rad/s^2], nan: it does not."""

    error: float
    rate: float
    speed: float
    wanted: float = math.nan
    reach: float = 0.0

    @property
    def helps(self) -> bool:
        """Whether the rudder steers, and the thruster takes no more than what is lacking."""
        return not math.isnan(self.wanted)


def bow_step(thruster: BowThruster, state: BowState, look: BowLook | None, dt: float, engaged: bool = True) -> BowState:
    """Return the state `dt` [s] later, whose `share` is the order. look: None where the thruster must not run.

    engaged: whether the pilot has the boat; where it has not, a weak thruster is forgiven.
    """
    share, since, heat, is_hot, is_weak, expected, coast, pushed, lack, doubt, doubted_rate, proven = state
    dt = dt if dt > 0.0 else 0.0
    heat = min(heat + dt * abs(share) / thruster.run, 1.0) if share else max(heat - dt / thruster.rest, 0.0)
    is_hot = heat >= 1.0 or (is_hot and heat > COOLED)
    since, is_weak, proven = since + dt, is_weak and engaged, max(proven - dt, 0.0)
    effect = 0.0 if look is None else 1.0 - abs(look.speed) / thruster.useless_above
    if look is None or not math.isfinite(look.error + look.rate) or not effect > LEAST_EFFECT:
        return _off(BowState(share, since, heat, is_hot, is_weak, proven=proven))
    full, thrust = thruster.rate * effect, share * abs(share)
    lack = lacking(thruster, full, lack, look, dt) if look.helps else 0.0
    # beside a rudder at its stop it may just hold the boat
    if abs(thrust) < MOST_OF_IT or look.helps:
        expected, coast, pushed = look.rate, look.rate, 0.0
    else:
        pushed += dt
        if pushed > thruster.delay:
            kept = math.exp(-dt / thruster.time)
            expected, coast = thrust * full + (expected - thrust * full) * kept, coast * kept
        is_judged = not proven and pushed > thruster.delay + max(thruster.time, JUDGED_S)
        if is_judged and (look.rate - coast) * thrust < WEAK * (expected - coast) * thrust:
            doubt, doubted_rate = math.copysign(1.0, share), look.rate
    if doubt and not share and since > thruster.delay + thruster.time:
        is_weak = (doubted_rate - look.rate) * doubt < WEAK * FALLEN * full
        doubt, proven = 0.0, PROVEN_S
    now = BowState(share, since, heat, is_hot, is_weak, expected, coast, pushed, lack, doubt, doubted_rate, proven)
    if is_hot or is_weak or doubt:
        return _off(now)
    wanted = helping_share(thruster, share, lack) if look.helps else wanted_share(thruster, full, share, look)
    if share:
        is_over = wanted * share <= 0.0
        if is_over:
            return _off(now) if since >= thruster.least_on else now
        return now._replace(share=math.copysign(max(abs(wanted), thruster.least), share))
    if not wanted or since < thruster.least_off:
        return now
    return now._replace(share=wanted, since=0.0)


def lacking(thruster: BowThruster, full: float, lack: float, look: BowLook, dt: float) -> float:
    """Return the share of full thrust that the rudder lacks, `dt` [s] later; full [rad/s]: the rate at full thrust."""
    side = math.copysign(1.0, lack if lack else look.wanted)
    more = (side * look.wanted - look.reach) / full
    more = min(max(more, -1.0 / thruster.time), 1.0 / thruster.time)
    return side * min(max(abs(lack) + dt * more, 0.0), 1.0)


def helping_share(thruster: BowThruster, share: float, lack: float) -> float:
    """Return the share, -1 to 1, that takes what the rudder lacks. share: at which the thruster runs now."""
    size = abs(lack)
    if thruster.proportional:
        size = math.sqrt(size)
        return math.copysign(size, lack) if size >= thruster.least else 0.0
    return math.copysign(1.0, lack) if size > (SUFFICES if share * lack > 0.0 else LACKS) else 0.0


def wanted_share(thruster: BowThruster, full: float, share: float, look: BowLook) -> float:
    """Return the share, -1 to 1, that is wanted where the boat turns at `full` [rad/s] at full thrust; 0 where the rate
    is right. share: at which the thruster runs now."""
    settling = 2.0 * thruster.delay + SETTLING_S
    ahead = look.rate + thruster.delay * (share * abs(share) * full - look.rate) / thruster.time
    error = look.error - 0.5 * thruster.delay * (look.rate + ahead)
    steady = wanted_rate(thruster, full, error)
    off = steady - ahead
    if not share:
        shortest = thruster.least**2 if thruster.proportional else 1.0
        worth = WORTH * shortest * full * thruster.least_on / thruster.time
        if abs(off) <= max(worth, LEAST_RATE, COASTS * abs(steady) if steady * ahead > 0.0 else 0.0):
            return 0.0
    elif off * share <= 0.0:
        return 0.0
    if not thruster.proportional:
        return math.copysign(1.0, off)
    size = abs(off * thruster.time / settling + steady) / full
    return math.copysign(min(max(math.sqrt(size), thruster.least), 1.0), off)


def wanted_rate(thruster: BowThruster, full: float, error: float) -> float:
    """Return the rate [rad/s] towards a course that is `error` [rad] away."""
    slope = 0.25 / (2.0 * thruster.delay + SETTLING_S)
    braking = STOPPED_BY * full / thruster.time
    away = max(abs(error) - thruster.dead_band, 0.0)
    bend = braking / (slope * slope)
    rate = slope * away if away <= bend else math.sqrt(2.0 * braking * (away - 0.5 * bend))
    return math.copysign(min(rate, FASTEST * full), error)


def _off(state: BowState) -> BowState:
    return state._replace(share=0.0, since=0.0, lack=0.0) if state.share else state


class Bow(NamedTuple):
    """What the bow thruster is at; when [s] a link last said that it can command it; what does not follow; whether the
    boat lacks way, and needs it."""

    thruster: BowState = AT_REST
    available: float = -math.inf
    disobeyed: str = ""
    is_needed: bool = False


def turns_boat(thruster: BowThruster | None, bow: Bow) -> bool:
    """Return whether the thruster may turn the boat just now: what the boat does then tells nothing of its rudder."""
    return thruster is not None and (bow.thruster.share != 0.0 or bow.thruster.since < thruster.delay + thruster.time)


def with_bow_found(bow: Bow, found: Mapping[str, AlarmEvent]) -> Mapping[str, AlarmEvent]:
    """Return what is found, and what keeps the bow thruster from turning the boat."""
    thruster, disobeyed = bow.thruster, bow.disobeyed if bow.is_needed else ""
    if thruster.is_weak:
        found = {**found, "bow_thruster_weak": AlarmEvent("bow_thruster_weak")}
    if thruster.is_hot:
        found = {**found, "bow_thruster_hot": AlarmEvent("bow_thruster_hot")}
    if disobeyed:
        found = {**found, "bow_thruster_not_following": AlarmEvent("bow_thruster_not_following", disobeyed)}
    return found


def bow_look(
    reference: Reference, seen: NavState, ahead: float, steered: tuple[Norrbin, float, float] | None
) -> BowLook:
    """Return what the bow thruster is asked by: heading and rate with their waves, for which the filter takes what no
    rudder explains, and so the thruster's own pushes. ahead: the share of the speed that is way ahead; steered: the
    boat's model, the law's demand and the rudder's stop [rad], None where there is no way."""
    look = BowLook(wrap(reference.heading - seen.heading), seen.rate, ahead * seen.speed)
    if steered is None:
        return look
    model, demand, stop = steered
    effect = model.gain / model.time_constant
    return look._replace(wanted=effect * demand, reach=effect * stop)


def with_bow(
    thruster: BowThruster,
    bow: Bow,
    moved: tuple[float, NavState],
    samples: tuple[Sample, ...],
    look: BowLook | None,
    command: RudderCommand,
) -> tuple[Bow, RudderCommand]:
    """Return the bow thruster a tick later, and the command with its share. moved: the time since the last tick [s],
    and the boat now; look: None where no heading is held. It stands still where no link says that it commands it."""
    (gap, seen), (state, available, disobeyed, _) = moved, bow
    for sample in samples:
        if type(sample) is ThrusterSample:
            available, disobeyed = sample.time if sample.available else -math.inf, sample.disobeyed
    may = command.engaged and seen.time - available <= THRUSTER_HEARD
    state = bow_step(thruster, state, look if may else None, gap, command.engaged)
    is_needed = look is not None and command.engaged and not look.helps
    bow = Bow(state, available, disobeyed, is_needed)
    return bow, command._replace(thruster=state.share) if state.share else command
