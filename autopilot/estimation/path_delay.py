"""How late our orders come to the steering gear, learnt while steering from their echo, or from a rudder sensor.

The echo e, what the gear is at by the vehicle's own report, is at a time t the order u of d before. Over a grid of
delays d_i, from 0 to the most that a line may have,

    J_i = sum of w (e(t) - u(t - d_i))^2,   w fading with every echo that moved,

is least where d_i is the path's delay, and a parabola through the least and its neighbours gives d between them. Of the
noise s^2 = J/(W - 1), W the sum of w, and the curvature J'' the variance of d is 2 s^2/J''. Few echoes fit more than
one delay: d counts once all but its neighbours are a thousand times less likely. Only an echo that has moved tells
anything, and only then anything is computed. A line that becomes another is found by Page's test: of each delay the
logarithm of how much likelier it makes an echo than the best of J is summed, from zero up, and where one comes to a
thousand J begins anew. An order that a line or a computer holds up for a moment is no other line: one echo tells a
quarter of that at most, and four are the fewest that a delay is known by. Noise is no less than the echo's grain, and
where the best delay leaves much of what the orders did unexplained, as where somebody else moves the rudder too,
nothing is believed. A delay that changes from order to order leaves its mean.

A rudder whose sensor shows e has not come to its order yet: in place of u stands e_i(t), where the gear has brought it
from the e that was shown before, under u(. - d_i). Nothing but that short while is reckoned, and nothing but e need be
known at its beginning. The gear's rate is the rudder's own: how far it goes while every order of the grid is further
off than it can go, whatever the delay. So a slow rudder is not taken for a slow line.

An echo bears the time at which it was made by the clock of the headings, as a link maps it to ours. By that clock what
the headings are late on their way to us counts in d: it is the time from a heading to its order's effect, the way back
and the way there, which is what `control.loop_delay_s` says, and what the loop is late by. Nothing need be known of
either way alone. Headings of another clock, such as a compass of our own, are late by less: by the way back at most.

An order of now finds the boat as it will be when it comes. So far ahead the boat is reckoned under the orders that are
on their way, and steered by that (Smith's predictor, in state space: Manitius and Olbrot 1979): with d known, law and
guide are those of a path that is as filed.

What pushes the boat must count in this like the orders that are to meet it. One that stands still against a push b0
that is left out is reckoned to turn: by K b0 (1 - x) after d, x = exp(-d/T), and through K b0 (d - T (1 - x)). A law
that asks for the acceleration -S r - W e then lets the push have 1 + T (S (1 - x) + W (d - T (1 - x))) times the error
that it has without a delay, 4.3 times for an outboard behind 0.8 s. So what the filter corrects and has not learnt as
bias counts (`unlearnt_step`): it holds the push as without a delay.

Source: delay by least squares over a grid, Bjorklund 2003, A Survey and Comparison of Time-Delay Estimation Methods in
Linear Systems, section 4; the variance of a minimum by its curvature is least squares'; Page 1954, Continuous
Inspection Schemes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import PI, wrap
from autopilot.estimation.heading_ekf import carried_ahead
from autopilot.estimation.rudder_observer import Ring, RudderMemory, RudderObserver
from autopilot.estimation.tuning import (
    PATH_ECHOES,
    PATH_ERROR_MOST,
    PATH_EXPLAINS,
    PATH_FEW,
    PATH_FOLLOWS,
    PATH_GRAIN,
    PATH_GRID,
    PATH_LATER,
    PATH_LEAST,
    PATH_MEMORY,
    PATH_MOVED,
    PATH_PART,
    PATH_QUICKEST,
    PATH_REACH,
    PATH_RIVAL,
    PATH_SENSED,
    PATH_SLOWEST,
    PATH_STEP,
    PATH_TELLS,
    PATH_WENT,
    WAVE_STIFFENING,
)
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear, clip, gear_step, gear_step_by, lag_share
from autopilot.signals import NavState

RECKONED_STEP = 0.05
"""Steps [s] in which the boat is reckoned ahead: a tick of a usual loop."""


NO_COSTS = (0.0,) * PATH_GRID


class PathDelay(NamedTuple):
    """What is known of the path. costs [rad^2] and weight: J_i and W; against: of each delay how much likelier it is
    than the best of these, of the newest echoes, as a logarithm; echoed [rad]: the newest echo of orders that
    counted, nan before; went, could [rad]: how far a rudder went whose orders were far off, and how far the filed gear
    would have; delay [s]: d, nan while it is not known; late [s]: by how much it is longer than filed, where that is
    certain, which steering goes by."""

    costs: tuple[float, ...] = NO_COSTS
    weight: float = 0.0
    against: tuple[float, ...] = NO_COSTS
    echoed: float = math.nan
    ends: tuple[float, ...] = ()
    went: float = PATH_WENT
    could: float = PATH_WENT
    delay: float = math.nan
    late: float = 0.0


NOT_ECHOED = PathDelay()
"""Before the first echo."""


class Motion(NamedTuple):
    """What a rudder did: from an angle [rad] to another in so many seconds, to the time [s]."""

    time: float
    before: float
    after: float
    lasted: float


def path_step(before: PathDelay, orders: tuple[Ring, Ring, int], echo: tuple[float, float], filed: float) -> PathDelay:
    """Return what is known of the path after an echo of orders that has moved: its time [s] and angle [rad]; filed [s]:
    the delay of the file.

    orders: the ticks' times [s], the angles [rad] that were commanded until each, nan where we did not steer, and how
    many ticks there were; see `RudderMemory`.
    """
    time, angle = echo
    before, given = before._replace(echoed=angle), orders_before(orders, time)
    if given is None:
        return before
    squares = [(angle - order) * (angle - order) for order in given]
    return _compared(_doubted(before, squares), squares, filed, PATH_FEW)


def _doubted(before: PathDelay, squares: list[float]) -> PathDelay:
    """Return what is known of the path before an echo that was off by so much [rad^2] with each delay of the grid:
    nothing, where the newest echoes show that the line has become another."""
    least = min(before.costs)
    if math.isnan(before.delay) or not before.weight > 1.0 or least > PATH_EXPLAINS * max(before.costs):
        return before
    noise, place = least / (before.weight - 1.0) + PATH_GRAIN * PATH_GRAIN, before.costs.index(least)
    usual = min(squares[max(place - 1, 0) : place + 2])
    against = tuple(
        [
            max(more + clip(0.5 * (usual - square) / noise, -PATH_TELLS, PATH_TELLS), 0.0)
            for more, square in zip(before.against, squares, strict=True)
        ]
    )
    if max(against) < PATH_ECHOES * PATH_TELLS:
        return before._replace(against=against)
    return before._replace(costs=NO_COSTS, weight=0.0, against=NO_COSTS)


def rudder_step(
    before: PathDelay, orders: tuple[Ring, Ring, int], motion: Motion, gear: SteeringGear, filed: float
) -> PathDelay:
    """Return what is known of the path after a rudder's `motion`, as its sensor shows it; where orders rest, it tells
    nothing. gear: as filed. orders, filed: see `path_step`."""
    time, last, angle, lasted = motion
    parts = math.ceil(lasted / PATH_PART)
    h = lasted / parts
    given = orders_before(orders, time - gear.delay)
    if given is None:
        return before
    share, reach = lag_share(gear, lasted), gear.rate_max * lasted
    low, high = share * (min(given) - last), share * (max(given) - last)
    if low > reach or high < -reach:
        # under way at its rate, whatever the delay is
        before = before._replace(ends=()) if before.ends else before
        moved, kept = angle - last if low > 0.0 else last - angle, 1.0 - 1.0 / PATH_MEMORY
        return before._replace(went=kept * before.went + moved, could=kept * before.could + reach)
    if high - low < share * PATH_MOVED:
        return before if not before.ends else before._replace(ends=())
    slower = before.went / before.could
    gear = gear._replace(rate_max=gear.rate_max * min(max(slower, PATH_SLOWEST), PATH_QUICKEST))
    corrected, share = -math.expm1(-lasted / PATH_REACH), lag_share(gear, h)
    ends = [end + corrected * (last - end) for end in before.ends or (last,) * PATH_GRID]
    for part in range(1, parts + 1):
        given = orders_before(orders, time - gear.delay - (parts - part) * h)
        if given is None:
            return before
        ends = [gear_step_by(gear, share, end, order, h) for end, order in zip(ends, given, strict=True)]
    squares = [(angle - end) * (angle - end) for end in ends]
    return _compared(before._replace(ends=tuple(ends)), squares, filed, PATH_LEAST)


def orders_before(orders: tuple[Ring, Ring, int], time: float) -> list[float] | None:
    """Return the orders [rad] at the `time` [s] and of each delay of the grid before it; None where somebody else
    steered so long ago, or it is not remembered."""
    times, commands, tick = orders
    ring, oldest = len(times) - 1, max(tick - len(times) + 1, 0)
    given = []
    for step in range(PATH_GRID):
        then = time - PATH_STEP * step
        while tick > oldest and times[(tick - 1) & ring] > then:
            tick -= 1
        order = commands[tick & ring]
        if tick == oldest or math.isnan(order):
            return None
        given.append(order)
    return given


def _compared(before: PathDelay, squares: list[float], filed: float, least: float) -> PathDelay:
    """Return what is known after an echo that was off by so much [rad^2] with each delay of the grid; least: nothing is
    certain with less weight."""
    kept = 1.0 - 1.0 / PATH_MEMORY
    costs = tuple([kept * cost + square for cost, square in zip(before.costs, squares, strict=True)])
    weight = kept * before.weight + 1.0
    later = PATH_SENSED if least == PATH_LEAST else PATH_LATER
    delay, late = delay_of(costs, weight) if weight >= least else math.nan, before.late
    if math.isnan(delay):
        return before._replace(costs=costs, weight=weight)
    return before._replace(costs=costs, weight=weight, delay=delay, late=lateness(late, delay - filed, later))


def is_other_path(before: PathDelay, after: PathDelay) -> bool:
    """Return whether orders come so much later or sooner than `before` that what was made of the rudder is none."""
    return after.late != before.late and abs(after.late - before.late) > PATH_LATER


def lateness(late: float, more: float, later: float = PATH_LATER) -> float:
    """Return what is steered by [s] where orders turn out to come so much `more` [s] later than filed, and `late` was
    steered by."""
    if not abs(more - late) > (PATH_FOLLOWS if late else later):
        return late
    return more if more > later - PATH_FOLLOWS else 0.0


def delay_of(costs: tuple[float, ...], weight: float) -> float:
    """Return d [s] where it is certain, else nan."""
    least = min(costs)
    place = costs.index(least)
    if weight <= 1.0 or place == PATH_GRID - 1 or least > PATH_EXPLAINS * max(costs):
        return math.nan
    # d itself is fitted: one echo fits some delay of the grid whatever the line does
    noise = least / (weight - 1.0) + PATH_GRAIN * PATH_GRAIN
    rivals = costs[: max(place - 1, 0)] + costs[place + 2 :]
    if min(rivals) - least < PATH_RIVAL * noise:
        return math.nan
    # a delay can be no less than nothing: to the left of it J rises as to the right
    before, after = costs[place - 1] if place else costs[1], costs[place + 1]
    bend = before - 2.0 * least + after
    if not 2.0 * noise * PATH_STEP * PATH_STEP < PATH_ERROR_MOST * PATH_ERROR_MOST * bend:
        return math.nan
    return PATH_STEP * (place + 0.5 * (before - after) / bend)


def behind(gear: SteeringGear, late: float) -> SteeringGear:
    """Return the gear behind a path that is so much later [s] than filed."""
    return gear._replace(delay=gear.delay + late)


def when_heard(
    model: Norrbin,
    gear: SteeringGear,
    state: NavState,
    orders: tuple[RudderObserver, RudderMemory],
    ahead: tuple[float, float],
    unlearnt: float,
) -> NavState:
    """Return the boat as it will be under the orders that are on their way, and what pushes it: its bias, and what is
    `unlearnt` [rad of rudder] beside. Time and bias stay.

    ahead: by how much [s] orders come later than filed, and how long [s] after the `state`.
    """
    (observer, memory), (late, seconds) = orders, ahead
    modelled, effective, passed = observer.modelled, observer.effective, observer.passed
    times, given, ring = memory.order_times, memory.orders, len(memory.orders) - 1
    off, begun = state.rudder - modelled, state.time - gear.delay - late
    steps, bias = math.ceil(seconds / RECKONED_STEP), state.bias
    dt = seconds / steps
    state = pushed_by(state, bias + unlearnt)
    for step in range(steps):
        while passed < observer.given and times[passed & ring] <= begun + (step + 0.5) * dt:
            effective = given[passed & ring]
            passed += 1
        modelled = gear_step(gear, modelled, effective, dt)
        state = moved_on(model, state, modelled + off, dt)
    return pushed_by(state, bias)


def pushed_by(state: NavState, bias: float) -> NavState:
    """Return the state with another bias [rad]."""
    time, heading, rate, speed, rudder, _, age, valid, wave, wave_rate, deviation, frequency = state
    return NavState(time, heading, rate, speed, rudder, bias, age, valid, wave, wave_rate, deviation, frequency)


def swung(heading: float, rate: float, frequency: float, ahead: float) -> tuple[float, float]:
    """Return wave heading [rad] and rate [rad/s] `ahead` [s] later, as far as they swing on by themselves."""
    swing = frequency * math.sqrt(WAVE_STIFFENING)
    cosine, sine = math.cos(swing * ahead), math.sin(swing * ahead)
    return cosine * heading + sine / swing * rate, cosine * rate - swing * sine * heading


def moved_on(model: Norrbin, state: NavState, rudder: float, seconds: float) -> NavState:
    """Return the boat so many `seconds` after the `state`, its rudder having gone evenly to `rudder` [rad]: the boat
    moves by its model, the waves by theirs; its time stays."""
    time, heading, rate, speed, begin, bias, age, valid, wave, wave_rate, deviation, frequency = state
    heading, rate = carried_ahead(model, heading - wave, rate - wave_rate, (begin + bias, rudder + bias), seconds)
    if frequency > 0.0:
        wave, wave_rate = swung(wave, wave_rate, frequency, seconds)
    heading += wave
    heading = heading if -PI < heading <= PI else wrap(heading)
    return NavState(
        time, heading, rate + wave_rate, speed, rudder, bias, age, valid, wave, wave_rate, deviation, frequency
    )
