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
`autopilot.guidance.turn`. Scalar functions over NamedTuples, compiled as they are.
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
from autopilot.models.steering_gear import SteeringGear, clip

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
    if not dt > 0.0 or not math.isfinite(rate_max) or model.n1 <= 0.0:
        return before
    angles = (
        _moved(filed.angle, command, rate_max / SLOWER[0] * dt),
        _moved(half.angle, command, rate_max / SLOWER[1] * dt),
        _moved(quarter.angle, command, rate_max / SLOWER[2] * dt),
        _moved(eighth.angle, command, rate_max / SLOWER[3] * dt),
    )
    apart = abs(angles[0] - angles[3])
    if time == 0.0 and apart < GEAR_PLAY:
        return RudderRate(
            Gear(angles[0], 0.0, 0.0, 0.0, 0.0),
            Gear(angles[1], 0.0, 0.0, 0.0, 0.0),
            Gear(angles[2], 0.0, 0.0, 0.0, 0.0),
            Gear(angles[3], 0.0, 0.0, 0.0, 0.0),
            math.nan,
            0.0,
            0.0,
            0.0,
            0.0,
            slower,
            is_sure,
        )
    gain, time_constant, n3, n2, n1, n0, _ = model
    passed = GEAR_PASSED * time_constant
    share, kept = -math.expm1(-dt / passed), math.exp(-dt / (GEAR_FADES * time_constant))
    damping = ((n3 * rate + n2) * rate + n1) * rate + n0
    if math.isnan(last):
        # nothing has moved yet: each gear begins in balance with what the boat does
        last, damped = rate, damping
        filed, half, quarter, eighth = (
            _in_balance(gain, angles[0]),
            _in_balance(gain, angles[1]),
            _in_balance(gain, angles[2]),
            _in_balance(gain, angles[3]),
        )
    slow = last + share * (rate - last)
    damped += share * (damping - damped)
    y = time_constant * (slow - last) / dt + damped
    time, found, squared = kept * time + dt, kept * found + dt * y, kept * squared + dt * y * y
    filed = _summed(filed, angles[0], gain, share, kept, dt, y)
    half = _summed(half, angles[1], gain, share, kept, dt, y)
    quarter = _summed(quarter, angles[2], gain, share, kept, dt, y)
    eighth = _summed(eighth, angles[3], gain, share, kept, dt, y)
    floor = GEAR_NOISE * gain * angle_max
    push = GEAR_SIGMA_BIAS * gain
    noise = passed * floor * floor
    sums = time, found, squared
    costs = (
        _cost(filed, sums, noise, push),
        _cost(half, sums, noise, push),
        _cost(quarter, sums, noise, push),
        _cost(eighth, sums, noise, push),
    )
    least = min(costs[0], costs[1], costs[2], costs[3])
    noise += max(passed, GEAR_SEA) * max(least, 0.0) / (time + time_constant)
    best = 0 if costs[0] == least else 1 if costs[1] == least else 2 if costs[2] == least else 3
    ours = 0 if slower == SLOWER[0] else 1 if slower == SLOWER[1] else 2 if slower == SLOWER[2] else 3
    likelier = 0.5 * (costs[ours] - least) / noise
    slower = SLOWER[best] if likelier > GEAR_LIKELIER else slower
    is_sure = slower > 1.0 and (is_sure or 0.5 * (costs[0] - least) / noise > GEAR_SURE)
    return RudderRate(filed, half, quarter, eighth, slow, damped, time, found, squared, slower, is_sure)


def _moved(angle: float, command: float, reach: float) -> float:
    return angle + clip(command - angle, -reach, reach)


def _in_balance(gain: float, angle: float) -> Gear:
    return Gear(angle, gain * angle, 0.0, 0.0, 0.0)


def _summed(gear: Gear, angle: float, gain: float, share: float, kept: float, dt: float, y: float) -> Gear:
    drive = gear.drive + share * (gain * angle - gear.drive)
    return Gear(
        angle,
        drive,
        kept * gear.sum_drive + dt * drive,
        kept * gear.sum_squared + dt * drive * drive,
        kept * gear.sum_found + dt * drive * y,
    )


def _cost(gear: Gear, sums: tuple[float, float, float], noise: float, push: float) -> float:
    """Return the least of the module's integral and prior, 2 J N."""
    time, found, squared = sums
    weight, firm = noise / (GEAR_SIGMA_SHARE * GEAR_SIGMA_SHARE), noise / (push * push)
    a, b, c = gear.sum_squared + weight, gear.sum_drive, time + firm
    right, left = gear.sum_found + weight, found
    known = a * c - b * b
    q, bias = (right * c - left * b) / known, (left * a - right * b) / known
    return squared + weight - q * right - bias * left
