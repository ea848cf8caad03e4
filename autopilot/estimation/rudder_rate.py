"""How quick the rudder turns out to be: several steering gears side by side, and the turns that each makes.

With the rudder delta_i(t) of a gear that is so many times slower than the file's, an effectiveness q and a push b0,

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
`autopilot.guidance.effectiveness`. Scalar functions over NamedTuples, compiled as they are.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.estimation.tuning import (
    GEAR_FADES,
    GEAR_LIKELIER,
    GEAR_NOISE,
    GEAR_PASSED,
    GEAR_PLAY,
    GEAR_SEA,
    GEAR_SIGMA_BIAS,
    GEAR_SIGMA_SHARE,
    GEAR_SURE,
)
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear

SLOWER = (1.0, 2.0, 4.0, 8.0)
"""The gears: so many times slower than the file's."""


class Gear(NamedTuple):
    """angle [rad]: where the rudder would be; drive [rad/s]: u; the sums over time of u, u^2 and u y."""

    angle: float = 0.0
    drive: float = 0.0
    sum_drive: float = 0.0
    sum_squared: float = 0.0
    sum_found: float = 0.0


class RudderRate(NamedTuple):
    """The gears; r_ and (damping(r))_ [rad/s]; the sums over time of 1, y and y^2; slower: how many times slower than
    the file's the gear is that is gone by; is_sure: whether the file's is out of question."""

    filed: Gear = Gear()
    half: Gear = Gear()
    quarter: Gear = Gear()
    eighth: Gear = Gear()
    rate: float = math.nan
    damping: float = 0.0
    sum_time: float = 0.0
    sum_found: float = 0.0
    sum_found_squared: float = 0.0
    slower: float = 1.0
    is_sure: bool = False


NO_GEAR = Gear(0.0, 0.0, 0.0, 0.0, 0.0)
AS_FILED = RudderRate(NO_GEAR, NO_GEAR, NO_GEAR, NO_GEAR, math.nan, 0.0, 0.0, 0.0, 0.0, 1.0, False)


def begun_at(angle: float, slower: float = 1.0) -> RudderRate:
    """Return what is known of a rudder that stands at `angle` [rad], so many times `slower` than filed."""
    gear = Gear(angle, 0.0, 0.0, 0.0, 0.0)
    return RudderRate(gear, gear, gear, gear, math.nan, 0.0, 0.0, 0.0, 0.0, slower, slower > 1.0)


def angle_of(state: RudderRate) -> float:
    """Return where the rudder [rad] of the gear that is gone by is."""
    slower = state.slower
    if slower == SLOWER[0]:
        return state.filed.angle
    if slower == SLOWER[1]:
        return state.half.angle
    return state.quarter.angle if slower == SLOWER[2] else state.eighth.angle


def gone_by(gear: SteeringGear, state: RudderRate) -> SteeringGear:
    """Return the steering gear that is gone by."""
    return gear if state.slower == 1.0 else gear._replace(rate_max=gear.rate_max / state.slower)


def rudder_rate_step(
    model: Norrbin, before: RudderRate, steered: tuple[float, float], limits: tuple[float, float], dt: float
) -> RudderRate:
    """Return what is known `dt` [s] later. steered: the boat's rate [rad/s], and the rudder's command [rad] since;
    limits: the rudder's angle [rad] and filed rate [rad/s]."""
    filed, half, quarter, eighth, last, damped, time, found, squared, slower, is_sure = before
    (rate, command), (angle_max, rate_max) = steered, limits
    gain, time_constant, n3, n2, n1, n0, _ = model
    if not dt > 0.0 or not rate_max < math.inf or n1 <= 0.0:
        return before
    reach = rate_max * dt
    if time == 0.0:
        rests = (
            _at_rest(filed, command, reach / SLOWER[0]),
            _at_rest(half, command, reach / SLOWER[1]),
            _at_rest(quarter, command, reach / SLOWER[2]),
            _at_rest(eighth, command, reach / SLOWER[3]),
        )
        if abs(rests[0].angle - rests[3].angle) < GEAR_PLAY:
            return RudderRate(rests[0], rests[1], rests[2], rests[3], math.nan, 0.0, 0.0, 0.0, 0.0, slower, is_sure)
    passed = GEAR_PASSED * time_constant
    share, kept = -math.expm1(-dt / passed), math.exp(-dt / (GEAR_FADES * time_constant))
    damping = ((n3 * rate + n2) * rate + n1) * rate + n0
    if math.isnan(last):
        # nothing has moved yet: each gear begins in balance with what the boat does
        last, damped = rate, damping
        filed, half, quarter, eighth = (
            _in_balance(filed, command, reach / SLOWER[0], gain),
            _in_balance(half, command, reach / SLOWER[1], gain),
            _in_balance(quarter, command, reach / SLOWER[2], gain),
            _in_balance(eighth, command, reach / SLOWER[3], gain),
        )
    slow = last + share * (rate - last)
    damped += share * (damping - damped)
    y = time_constant * (slow - last) / dt + damped
    time, found, squared = kept * time + dt, kept * found + dt * y, kept * squared + dt * y * y
    floor, push = GEAR_NOISE * gain * angle_max, GEAR_SIGMA_BIAS * gain
    noise = passed * floor * floor
    weight = noise / (GEAR_SIGMA_SHARE * GEAR_SIGMA_SHARE)
    step, sums = (gain, share, kept, dt, y), (weight, time + noise / (push * push), found, squared)
    filed, cost = _summed(filed, (command, reach / SLOWER[0]), step, sums)
    half, cost_half = _summed(half, (command, reach / SLOWER[1]), step, sums)
    quarter, cost_quarter = _summed(quarter, (command, reach / SLOWER[2]), step, sums)
    eighth, cost_eighth = _summed(eighth, (command, reach / SLOWER[3]), step, sums)
    least, best = cost, SLOWER[0]
    if cost_half < least:
        least, best = cost_half, SLOWER[1]
    if cost_quarter < least:
        least, best = cost_quarter, SLOWER[2]
    if cost_eighth < least:
        least, best = cost_eighth, SLOWER[3]
    lasts = passed if passed > GEAR_SEA else GEAR_SEA
    noise += lasts * (least if least > 0.0 else 0.0) / (time + time_constant)
    ours = (
        cost
        if slower == SLOWER[0]
        else cost_half
        if slower == SLOWER[1]
        else cost_quarter
        if slower == SLOWER[2]
        else cost_eighth
    )
    slower = best if 0.5 * (ours - least) / noise > GEAR_LIKELIER else slower
    is_sure = slower > 1.0 and (is_sure or 0.5 * (cost - least) / noise > GEAR_SURE)
    return RudderRate(filed, half, quarter, eighth, slow, damped, time, found, squared, slower, is_sure)


def _moved(angle: float, command: float, reach: float) -> float:
    left = command - angle
    return angle + (-reach if left < -reach else reach if left > reach else left)


def _at_rest(gear: Gear, command: float, reach: float) -> Gear:
    return Gear(_moved(gear.angle, command, reach), 0.0, 0.0, 0.0, 0.0)


def _in_balance(gear: Gear, command: float, reach: float, gain: float) -> Gear:
    return Gear(gear.angle, gain * _moved(gear.angle, command, reach), 0.0, 0.0, 0.0)


def _summed(
    gear: Gear,
    way: tuple[float, float],
    step: tuple[float, float, float, float, float],
    sums: tuple[float, float, float, float],
) -> tuple[Gear, float]:
    """Return the gear a step later, and the least of the module's integral and prior, 2 J N.

    way: the command [rad], and how far [rad] its rudder goes. step: K, the low-pass's share, what is kept of the sums,
    the time [s] and y; sums: the prior's weight of q, and the sums over time of 1, the prior's weight of b0 with it, y
    and y^2.
    """
    angle, drive, sum_drive, sum_squared, sum_found = gear
    (command, reach), (gain, share, kept, dt, y), (weight, c, left, squared) = way, step, sums
    way_left = command - angle
    angle += -reach if way_left < -reach else reach if way_left > reach else way_left
    drive += share * (gain * angle - drive)
    b, sum_squared = kept * sum_drive + dt * drive, kept * sum_squared + dt * drive * drive
    sum_found = kept * sum_found + dt * drive * y
    a, right = sum_squared + weight, sum_found + weight
    known = a * c - b * b
    q, bias = (right * c - left * b) / known, (left * a - right * b) / known
    return Gear(angle, drive, b, sum_squared, sum_found), squared + weight - q * right - bias * left
