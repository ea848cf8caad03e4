"""Where the rudder is and was, and how quick it turns out to be.

Where it is: the steering-gear model under the orders given, set right by feedback.

    delta(t) = fed back(t_f) + gear(t) - gear(t_f)

so that feedback, which is late and sparse, corrects the level, and the model adds the motion since. Without feedback
the model stands alone. Memory: one value, and rings of the last ticks and orders. Scalar functions over them, which the
loop calls as they are and campaigns compile.

How quick it is: several steering gears side by side, and the turns that each makes. With the rudder delta_i(t) of a
gear that is so many times slower than the file's, an effectiveness q and a push b0,

    T r' + damping(r) = q K delta_i + b0.

Low-passed over a time t this needs no derivative of r: y = T (r_)' + (damping(r))_, u_i = (K delta_i)_. By the
Gaussian prior of q about 1 and b0 about 0 the posterior's exponent is

    2 J_i = [int (y - q u_i - b0)^2 dt + N ((q - 1)/SIGMA_Q)^2 + N (b0/SIGMA_B)^2]/N,   at its least over q and b0,

N the intensity of what no gear explains: NOISE of the rudder hard over, and what the best leaves. One gear is so much
more likely than another as their J differ; a gear is gone by where that is more than LIKELIER against the one in force.
A rudder that rests, or moves slowly, moves alike with any gear and tells nothing; what was seen before fades.

A course-unstable boat is not steered with another gear's plan: before the rate is known it turns away quicker than a
slow rudder comes, and the monitors end the steering.

Multiple-model estimation: Willsky and Jones 1976; the low-pass in place of a derivative is Young 1981's, as in
`autopilot.guidance.turn`. Scalar functions over NamedTuples, compiled as they are.
"""

from __future__ import annotations

import math
from typing import NamedTuple, Protocol

from autopilot.estimation.tuning import (
    FEEDBACK_FRESH,
    GEAR_EXPLAINS,
    GEAR_FADES,
    GEAR_LIKELIER,
    GEAR_NOISE,
    GEAR_PASSED,
    GEAR_PLAY,
    GEAR_SEA,
    GEAR_SIGMA_BIAS,
    GEAR_SIGMA_SHARE,
    GEAR_SURE,
    GUSTY,
    ORDERS_KEPT,
    TICKS_KEPT,
    WAVE_DEVIATION_FIRST,
)
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear, gear_step, lag_share


class Ring(Protocol):
    """A list here, an array where runs are compiled."""

    def __len__(self) -> int: ...

    def __getitem__(self, index: int, /) -> float: ...


class WritableRing(Ring, Protocol):
    """The same to write in."""

    def __setitem__(self, index: int, value: float, /) -> None: ...


RudderPast = tuple[Ring, Ring, int]
"""Times [s], and the rudder angles [rad] from these on, in rings: tick n, of so many ticks so far, is at n modulo their
length.

The length is a power of two, so that n & (length - 1) is that place, for which no division is needed. The rings begin
with zeros: before the first tick the rudder is amidships.
"""


def tick_at(past: RudderPast, time: float) -> int:
    """Return the newest tick at or before `time` [s], or the oldest that is known."""
    times, _, ticks = past
    tick, ring = ticks - 1, len(times) - 1
    oldest = tick - ring if tick > ring else 0
    while tick > oldest and times[tick & ring] > time:
        tick -= 1
    return tick


def angle_at(past: RudderPast, time: float) -> float:
    """Return the rudder's angle [rad] at `time` [s]; 0 where none is known."""
    return past[1][tick_at(past, time) & (len(past[1]) - 1)]


def angle_from(past: RudderPast, time: float) -> float:
    """Return the rudder's angle [rad] at the first tick at or after `time` [s]; the newest where none is."""
    times, angles, ticks = past
    tick, ring = tick_at(past, time), len(times) - 1
    if tick < ticks - 1 and times[tick & ring] < time:
        tick += 1
    return angles[tick & ring]


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
    _, angles, ticks = past
    return angles[(ticks - 1) & (len(angles) - 1)]


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
    modelled, ticks, given, passed, effective, fed_back_at, fed_back = observer
    orders = memory.orders
    place = given & (len(orders) - 1)
    if given - passed == len(orders):
        passed, effective = passed + 1, orders[place]
    memory.order_times[place], orders[place] = now, order
    return RudderObserver(modelled, ticks, given + 1, passed, effective, fed_back_at, fed_back)


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
            then = gears[tick_at((times, angles, ticks), fed_back_at) & ring]
        angle += fed_back - then
    place = ticks & ring
    times[place], gears[place], angles[place] = now, modelled, angle
    return RudderObserver(modelled, ticks + 1, given, passed, effective, fed_back_at, fed_back)


SLOWER = (1.0, 2.0, 4.0, 8.0)
"""The gears: so many times slower than the file's."""


Gear = tuple[float, float, float, float, float]
"""Where the rudder would be [rad]; u [rad/s]; the sums over time of u, u^2 and u y. No record: four of them are made
anew in each tick."""
Gears = tuple[Gear, Gear, Gear, Gear]
"""One for each of SLOWER."""
NO_GEAR: Gear = (0.0, 0.0, 0.0, 0.0, 0.0)
NO_GEARS: Gears = (NO_GEAR, NO_GEAR, NO_GEAR, NO_GEAR)


class RudderRate(NamedTuple):
    """The gears; r_ and (damping(r))_ [rad/s]; the sums over time of 1, y and y^2; slower: how many times slower than
    the file's the gear is that is gone by; is_sure: whether the file's is out of question."""

    gears: Gears = NO_GEARS
    rate: float = math.nan
    damping: float = 0.0
    sum_time: float = 0.0
    sum_found: float = 0.0
    sum_found_squared: float = 0.0
    slower: float = 1.0
    is_sure: bool = False


AS_FILED = RudderRate(NO_GEARS, math.nan, 0.0, 0.0, 0.0, 0.0, 1.0, False)


def begun_at(angle: float, slower: float = 1.0) -> RudderRate:
    """Return what is known of a rudder that stands at `angle` [rad], so many times `slower` than filed."""
    gear = (angle, 0.0, 0.0, 0.0, 0.0)
    return RudderRate((gear, gear, gear, gear), math.nan, 0.0, 0.0, 0.0, 0.0, slower, slower > 1.0)


def measured_at(angle: float, filed: float, rate: float) -> RudderRate:
    """Return what is known of a rudder at `angle` [rad] whose sensor shows a `rate` [rad/s] where more is `filed`; inf:
    it shows none that is much slower."""
    return begun_at(angle, filed / rate if rate < filed else 1.0)


def angle_of(state: RudderRate) -> float:
    """Return where the rudder [rad] of the gear that is gone by is."""
    return state.gears[SLOWER.index(state.slower)][0]


def gone_by(gear: SteeringGear, state: RudderRate) -> SteeringGear:
    """Return the steering gear that is gone by."""
    return gear if state.slower == 1.0 else gear._replace(rate_max=gear.rate_max / state.slower)


def rudder_rate_step(
    model: Norrbin,
    before: RudderRate,
    steered: tuple[float, float, bool],
    sea: tuple[float, float, float],
    filed: SteeringGear,
    dt: float,
) -> RudderRate:
    """Return what is known `dt` [s] later. steered: the boat's rate [rad/s] and the order [rad] in effect since, and
    whether it is on its course, where the rudder answers the sea. sea: the waves' deviation [rad], the density of the
    gusts and the most there may be [rad^2/s]. filed: the gear that slower ones are compared with; each has its lag.

    What pushes the boat about, such waves or a good share of those gusts, lasts longer than the mean of y, and what the
    boat does says as much less.
    """
    gears, last, damped, time, found, squared, slower, is_sure = before
    (rate, command, on_course), (waves, density, gusty) = steered, sea
    rate_max = filed.rate_max
    gain, time_constant, n3, n2, n1, n0, _ = model
    if not dt > 0.0 or not rate_max < math.inf or n1 <= 0.0:
        return before
    reach, comes = rate_max * dt, lag_share(filed, dt)
    if time == 0.0:
        rests = (
            _at_rest(gears[0], command, (reach / SLOWER[0], comes)),
            _at_rest(gears[1], command, (reach / SLOWER[1], comes)),
            _at_rest(gears[2], command, (reach / SLOWER[2], comes)),
            _at_rest(gears[3], command, (reach / SLOWER[3], comes)),
        )
        if abs(rests[0][0] - rests[3][0]) < GEAR_PLAY:
            return RudderRate(rests, math.nan, 0.0, 0.0, 0.0, 0.0, slower, is_sure)
    passed = GEAR_PASSED * time_constant
    share, kept = -math.expm1(-dt / passed), math.exp(-dt / (GEAR_FADES * time_constant))
    damping = ((n3 * rate + n2) * rate + n1) * rate + n0
    if last != last:
        # nothing has moved yet: each gear begins in balance with what the boat does
        last, damped = rate, damping
        gears = (
            _in_balance(gears[0], command, (reach / SLOWER[0], comes), gain),
            _in_balance(gears[1], command, (reach / SLOWER[1], comes), gain),
            _in_balance(gears[2], command, (reach / SLOWER[2], comes), gain),
            _in_balance(gears[3], command, (reach / SLOWER[3], comes), gain),
        )
    slow = last + share * (rate - last)
    damped += share * (damping - damped)
    y = time_constant * (slow - last) / dt + damped
    lasts = passed if passed > GEAR_SEA else GEAR_SEA
    longer = time_constant if time_constant > GEAR_SEA else GEAR_SEA
    is_swept = (waves >= WAVE_DEVIATION_FIRST or density >= GUSTY * gusty) and longer > lasts
    dt = dt * lasts / longer if is_swept else dt
    answers = is_swept and on_course
    time, found, squared = kept * time + dt, kept * found + dt * y, kept * squared + dt * y * y
    floor, push = GEAR_NOISE * gain * filed.angle_max, GEAR_SIGMA_BIAS * gain
    noise = passed * floor * floor
    weight = noise / (GEAR_SIGMA_SHARE * GEAR_SIGMA_SHARE)
    shared = (command, comes, gain, share, kept, dt, y, weight, time + noise / (push * push), found, squared)
    usual, cost = _summed(gears[0], reach / SLOWER[0], shared)
    half, cost_half = _summed(gears[1], reach / SLOWER[1], shared)
    quarter, cost_quarter = _summed(gears[2], reach / SLOWER[2], shared)
    eighth, cost_eighth = _summed(gears[3], reach / SLOWER[3], shared)
    costs, least, best, ours = (cost, cost_half, cost_quarter, cost_eighth), cost, SLOWER[0], cost
    for place in range(1, 4):
        if costs[place] < least:
            least, best = costs[place], SLOWER[place]
        # one that a sensor had measured lies between two of them
        ours = costs[place] if slower >= SLOWER[place] else ours
    noise += lasts * (least if least > 0.0 else 0.0) / (time + time_constant)
    # a push that changes is explained by no gear, and by a slow one a little better; back to the file's needs no more
    # than that it is likelier
    explains = (answers and best < slower) or least < GEAR_EXPLAINS * ours
    likelier = GEAR_SURE if answers and best > slower else GEAR_LIKELIER
    slower = best if explains and 0.5 * (ours - least) / noise > likelier else slower
    is_sure = slower > 1.0 and (is_sure or (least < GEAR_EXPLAINS * cost and 0.5 * (cost - least) / noise > GEAR_SURE))
    # a boat that is held by a wrong gear swings, and seems to prove it
    slower = slower if is_sure or not answers else SLOWER[0]
    return RudderRate((usual, half, quarter, eighth), slow, damped, time, found, squared, slower, is_sure)


def _moved(angle: float, command: float, goes: tuple[float, float]) -> float:
    """Return where a rudder goes [rad] by `command` that goes no further than the first [rad], by its lag such a share
    of the way."""
    reach, share = goes
    left = share * (command - angle)
    return angle + (-reach if left < -reach else reach if left > reach else left)


def _at_rest(gear: Gear, command: float, goes: tuple[float, float]) -> Gear:
    return _moved(gear[0], command, goes), 0.0, 0.0, 0.0, 0.0


def _in_balance(gear: Gear, command: float, goes: tuple[float, float], gain: float) -> Gear:
    return gear[0], gain * _moved(gear[0], command, goes), 0.0, 0.0, 0.0


def _summed(
    gear: Gear, reach: float, shared: tuple[float, float, float, float, float, float, float, float, float, float, float]
) -> tuple[Gear, float]:
    """Return the gear a step later, and the least of the module's integral and prior, 2 J N.

    reach [rad]: how far its rudder goes. shared: the order [rad], the share of its way that the lag leaves it, K, the
    low-pass's share, what is kept of the sums, the time [s] and y; the prior's weight of q, and the sums over time of
    1, the prior's weight of b0 with it, y and y^2.
    """
    angle, drive, sum_drive, sum_squared, sum_found = gear
    command, comes, gain, share, kept, dt, y, weight, c, left, squared = shared
    way_left = comes * (command - angle)
    angle += -reach if way_left < -reach else reach if way_left > reach else way_left
    drive += share * (gain * angle - drive)
    b, sum_squared = kept * sum_drive + dt * drive, kept * sum_squared + dt * drive * drive
    sum_found = kept * sum_found + dt * drive * y
    a, right = sum_squared + weight, sum_found + weight
    known = a * c - b * b
    q, bias = (right * c - left * b) / known, (left * a - right * b) / known
    return (angle, drive, b, sum_squared, sum_found), squared + weight - q * right - bias * left
