"""A boat that turns against its rudder: pushed harder than that can hold, or run away.

By the push that the estimator learns beside the waves, and by the turns themselves. Pure.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.models.norrbin import Norrbin, steady_rudder
from autopilot.models.steering_gear import clip
from autopilot.supervision.monitor_input import MonitorInput, is_hard_over
from autopilot.supervision.tuning import (
    AGAINST_SHARE,
    AT_THE_STOP,
    FAR,
    HOLDS,
    LONGEST_GAP_S,
    PUSH_BEYOND,
    SETTLED,
    TAKES_HOLD,
    WAVES_REACH,
)

ZIGZAG_DIVERGED = math.radians(45.0)
"""A boat that handles well overshoots by less: IMO MSC.137(76) allows 40 deg for the second of 10/10, 25 deg for 20/20.
One that does not slows down all the same."""


class Overpowered(NamedTuple):
    """Wind, current and trim that are worth more than the rudder's limit, as the estimator learns them beside waves:
    the `time` [s] of the tick before, nan: they are not; beyond [s]: how far they were beyond it, in units of the
    limit, summed over the time in which the rudder was hard over against them; and how hard, '' where the rudder can
    hold it."""

    time: float = math.nan
    beyond: float = 0.0
    found: str = ""


def overpowered_step(before: Overpowered, seen: MonitorInput) -> Overpowered:
    """Judge a tick. A law that holds a course has put the rudder to its stop: as long as it has some left, what the
    estimator believes is a sea that it does not know.

    A push that sets in is overrated at first, by half for a few seconds, until the rudder has shown what it does
    against it. So the nearer it is to what the rudder holds, the longer it must last:
    beyond = int (|push|/limit - 1) dt.
    """
    push, most = seen.push, seen.angle_max
    if not (seen.steers and seen.has_way and (push > most or push < -most)):
        return NOT_OVERPOWERED
    time, beyond, found = before
    if seen.follows and not (is_hard_over(seen) and seen.rudder * push < 0.0):
        # a trial's rudder rests where the trial wants it
        return Overpowered(found=found)
    if time == time:  # what is not a number is not itself
        # what happened between two ticks far apart nobody saw
        beyond += (abs(push) / most - 1.0) * clip(seen.now - time, 0.0, LONGEST_GAP_S)
    if beyond >= PUSH_BEYOND and not found:
        side = "starboard" if push > 0.0 else "port"
        found = f"to {side}, as by {math.degrees(abs(push)):.0f} deg of rudder"
    return Overpowered(seen.now, beyond, found)


NOT_OVERPOWERED = Overpowered()


class Runaway(NamedTuple):
    """heading [rad] and time [s] of the tick before; mean_rate [rad/s]; the rudder's side, and how far [rad] the boat
    has turned against it since it came over; way [rad]: turned in all; hard_since [s]: the rudder is hard over;
    held_way and held_since: when it had taken hold; has_run; overpowered: to where, '' where neither."""

    heading: float = math.nan
    time: float = math.nan
    mean_rate: float = 0.0
    side: float = math.nan
    turned: float = math.nan
    way: float = 0.0
    hard_since: float = math.nan
    held_way: float = 0.0
    held_since: float = 0.0
    has_run: bool = False
    overpowered: str = ""


NO_RUNAWAY = Runaway()


def runaway_step(before: Runaway, seen: MonitorInput) -> Runaway:
    """Judge a tick: the rudder hard over, and the boat goes on to turn to the other side.

    It has run away where it turns nearly as for a rudder hard over there: one that is at its other stop, or a push of
    nearly twice what the rudder can do. Sea and gust turn it so for less than the time in which the rudder takes hold,
    or not so far; a wave turns it back again, so that the mean rate must be as quick as the present one. A zigzag
    orders its rudder without looking back: there it is enough that it goes on turning against it, far on the wrong
    side, and does not slow down.
    """
    if not seen.steers:
        return NO_RUNAWAY
    state, now, model, rudder = seen.state, seen.now, seen.model, seen.rudder
    last, time, mean_rate, side, turned, way, hard_since, held_way, held_since, _, overpowered = before
    heading = state.heading
    # by the heading: a rate may come from a gyro that is wrong, and is late where there is none
    step = heading - last
    step = step if -PI < step <= PI else wrap(step)
    step = step if step == step else 0.0
    elapsed = now - time
    if elapsed > 0.0:
        # a low pass leaves at most 2 deviations of heading / time constant of what waves add to the rate; that is to
        # be no more than what lies between K rudder_max and AGAINST_SHARE of it
        waves = WAVES_REACH * state.wave_deviation
        lasts = waves / ((1.0 - AGAINST_SHARE) * abs(model.gain) * seen.angle_max)
        lasts = lasts if lasts > model.time_constant else model.time_constant
        mean_rate -= math.expm1(-elapsed / lasts) * (step / elapsed - mean_rate)
    way += step
    to = math.copysign(1.0, rudder)
    # one that slows down is coming round yet: a course-unstable boat overshoots by as much
    has_run = seen.zigzag_divergence > ZIGZAG_DIVERGED and to * state.rate < min(AGAINST_SHARE * to * mean_rate, 0.0)
    turned = turned - to * step if to == side and turned > to * step else 0.0
    overpowered = overpowered if turned != 0.0 else ""
    stop = AT_THE_STOP * seen.angle_max
    if -stop < rudder < stop:
        return Runaway(heading, now, mean_rate, to, turned, way, math.nan, held_way, held_since, has_run, overpowered)
    hard_since = now if math.isnan(hard_since) else hard_since
    lasted = now - hard_since
    if lasted < HOLDS * model.time_constant:
        held_since, held_way = now, way
    if lasted >= TAKES_HOLD * model.time_constant and not turned < FAR + WAVES_REACH * state.wave_deviation:
        if lasted >= SETTLED * model.time_constant:
            # both: the mean remembers how the boat turned before the rudder came over, the other holds a wave's
            held = (way - held_way) / (now - held_since)
            has_run |= _turns_against(model, seen.rudder, held) and _turns_against(model, seen.rudder, mean_rate)
        overpowered = overpowered or f"to {'port' if seen.rudder > 0.0 else 'starboard'}"
    return Runaway(heading, now, mean_rate, to, turned, way, hard_since, held_way, held_since, has_run, overpowered)


def _turns_against(model: Norrbin, rudder: float, rate: float) -> bool:
    return -math.copysign(1.0, rudder) * steady_rudder(model, rate) >= AGAINST_SHARE * abs(rudder)
