"""The pilot while it steers, compiled: the stages of `autopilot.steering` one after the other.

What stands here is only what a run without a helmsman needs beside them: one heading at a time, and where the
supervisor, a monitor or a restart of the filter would have a word, for there the run is handed to the full simulator.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.angles import shortest_turn
from autopilot.control.law import NO_ROLL, LawInput
from autopilot.control.limits import Rest
from autopilot.control.registry import law_step
from autopilot.estimation.estimator import Smoothed, model_at, smoothed
from autopilot.estimation.fusion import (
    Fusion,
    Measured,
    Moment,
    fuse_measured,
    seen_at,
)
from autopilot.estimation.heading_ekf import FilterState, with_bias_of
from autopilot.estimation.rudder_observer import RudderMemory, RudderObserver, RudderPast, advanced, ordered
from autopilot.estimation.tuning import GATE_PATIENCE, PREDICT_LONGEST
from autopilot.guidance.reference import Guide, heading_ordered, started
from autopilot.guidance.turn import NOTHING_SHOWN, VirtualBoat, is_turning, reference_of
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import clip
from autopilot.signals import NavState
from autopilot.steering import (
    LONGEST_STEP,
    NOT_TURNING,
    Moved,
    SteeringConfig,
    Turning,
    limited,
    referred,
    steered_by,
    turning_at,
    wave_rudder,
)
from autopilot.supervision.compass_watch import NO_TURNS, Turns, are_opposite, turns_step
from autopilot.supervision.envelope import WRONG_ERROR, WRONG_SHARE, WRONG_TIME
from autopilot.supervision.tuning import AT_THE_STOP, FROZEN_SAMPLES

Floats = NDArray[np.float64]


class Brain(NamedTuple):
    """What the pilot knows of the boat; see `PilotConfig`. gains are those of the law that steers, first is the memory
    with which it begins.

    patience [s]: the rudder may be hard over for so long before a monitor would ask why; heading_jump and
    rate_disagrees [rad] are the monitors' too, see `autopilot.supervision.monitors`.
    """

    config: SteeringConfig
    gains: Any
    first: Any
    heading_timeout: float
    watches_frozen: bool
    patience: float
    heading_jump: float
    rate_disagrees: float


class Compass(NamedTuple):
    """The compass as its monitors see it: the newest heading [rad], its time [s], how often it came the same, and what
    headings and rates turned of late."""

    heading: float
    time: float
    same: int
    turns: Turns


class Mind(NamedTuple):
    """What the pilot remembers from tick to tick, the rudder's rings apart.

    easy_time and right_time [s]: when the rudder was last not hard over for the monitors, and last not pushing the boat
    away. gone: the run has come to where only the full simulator goes on.
    """

    now: float
    model: Norrbin
    speed: Smoothed
    fusion: Fusion
    heading_time: float
    rudder: RudderObserver
    turning: Turning
    guide: Guide
    law: Any
    told: float
    rest: Rest
    undoing: float
    compass: Compass
    easy_time: float
    right_time: float
    gone: bool


class Heard(NamedTuple):
    """What the instruments said before this tick: heading and rate, not numbers where silent, and the speed [m/s], nan
    where none came."""

    measured: Measured
    speed: float


def first_mind(brain: Brain, state: FilterState, now: float, heard: Heard, memory: RudderMemory) -> Mind:
    """Return the mind at `now` [s] after the first heading: engaged, the rudder amidships, no command given yet."""
    config = brain.config
    model = model_at(config.estimator.model, heard.speed)
    speed = Smoothed(heard.speed, now)
    fusion = Fusion(state, 0.0, 0, 0.0)
    rudder = advanced(config.estimator.gear, RudderObserver(0.0, 0, 0, 0, 0.0, -math.inf, 0.0), memory, now)
    past, at = RudderPast(memory.times, memory.angles, rudder.ticks), Moment(now, heard.speed, state.time)
    seen = seen_at(model, config.estimator.noises, fusion, past, at)
    steered = steered_by(seen, wave_rudder(config, model, seen).alone)
    turning = turning_at(config, NOT_TURNING, model)
    guide = started(
        Guide(math.nan, VirtualBoat(0.0, 0.0, 0.0, NOTHING_SHOWN), 1, -math.inf, now), turning.limits, steered
    )
    return Mind(
        now=now,
        model=model,
        speed=speed,
        fusion=fusion,
        heading_time=state.time,
        rudder=rudder,
        turning=turning,
        guide=guide,
        law=brain.first,
        told=0.0,
        rest=Rest(0.0, 0.0, False),
        undoing=0.0,
        compass=Compass(heard.measured.heading, state.time, 1, NO_TURNS),
        easy_time=now,
        right_time=now,
        gone=False,
    )


def tick(brain: Brain, mind: Mind, memory: RudderMemory, now: float, heard: Heard, target: float) -> Mind:
    """Return the mind after the tick at `now` [s] on the way to the heading `target` [rad]; `told` is its command."""
    config, dt = brain.config, clip(now - mind.now, 0.0, LONGEST_STEP)
    listened = _listen(brain, mind, memory, now, heard) if dt > 0.0 else mind
    model, fusion = listened.model, listened.fusion
    past = RudderPast(memory.times, memory.angles, listened.rudder.ticks)
    at = Moment(now, listened.speed.value, listened.heading_time)
    seen = seen_at(model, config.estimator.noises, fusion, past, at)
    waves = wave_rudder(config, model, seen)
    state = steered_by(seen, waves.alone)
    turning = turning_at(config, listened.turning, model)
    guide = listened.guide
    if target != guide.heading:
        guide = heading_ordered(guide, model, turning.limits, state, target)
    guide = referred(config, guide, turning, model, state, Moved(mind.told, dt))
    reference, own = reference_of(model, turning.limits, guide.boat), mind.rest.allowed - mind.undoing
    ratio = model.reference_speed / config.estimator.model.reference_speed
    given = LawInput(model, ratio, reference, state, NO_ROLL, own, config.limits.angle_max, dt)
    asked, law = law_step(brain.gains, listened.law, given)
    demand = asked + waves.rudder
    rest = limited(config, mind.rest, Moved(mind.told, dt), demand)
    told = rest.told
    rudder = ordered(listened.rudder, memory, now, told)
    easy_time = listened.easy_time if abs(mind.told) >= AT_THE_STOP * config.limits.angle_max else now
    off = shortest_turn(state.heading, guide.boat.heading)
    right_time = listened.right_time if _pushes_away(config, off, told, state) else now
    # numba takes no condition inside the call below
    gone = listened.gone or _must_go(brain, listened, now, easy_time, right_time, state.heading + demand)
    return Mind(
        now=now,
        model=model,
        speed=listened.speed,
        fusion=fusion,
        heading_time=listened.heading_time,
        rudder=rudder,
        turning=turning,
        guide=guide,
        law=law,
        told=told,
        rest=rest,
        undoing=waves.rudder,
        compass=listened.compass,
        easy_time=easy_time,
        right_time=right_time,
        gone=gone,
    )


def _pushes_away(config: SteeringConfig, error: float, rudder: float, state: NavState) -> bool:
    """Return whether the envelope check would think so, see `autopilot.supervision.envelope`; half as much is enough
    here."""
    side = 1.0 if error > 0.0 else -1.0
    pushes = side * rudder + max(side * state.bias, 0.0) < -0.5 * WRONG_SHARE * config.limits.angle_max
    return side * error > 0.5 * WRONG_ERROR and pushes and side * state.rate <= 0.0


def _must_go(
    brain: Brain, mind: Mind, now: float, easy_time: float, right_time: float, heading_and_demand: float
) -> bool:
    """Return whether the pilot would do more than steer: fail-safe, steerage, monitors."""
    compass = mind.compass
    return (
        not now - mind.heading_time <= brain.heading_timeout
        or not math.isfinite(heading_and_demand)
        or now - right_time >= WRONG_TIME
        or abs(compass.turns.apart) > brain.rate_disagrees
        or (are_opposite(compass.turns) and math.isfinite(brain.rate_disagrees))
        or mind.speed.value < brain.config.estimator.steerage
        or (brain.watches_frozen and compass.same >= FROZEN_SAMPLES)
        or now - easy_time >= brain.patience
    )


def _listen(brain: Brain, mind: Mind, memory: RudderMemory, now: float, heard: Heard) -> Mind:
    """Return the mind with the samples of this tick taken in, in the estimator's order: speed, rudder, heading."""
    estimator, model, speed = brain.config.estimator, mind.model, mind.speed
    if not math.isnan(heard.speed):
        speed = smoothed(speed, now, heard.speed)
        model = model_at(estimator.model, speed.value)
    rudder = advanced(estimator.gear, mind.rudder, memory, now)
    fusion, heading_time, gone, compass = mind.fusion, mind.heading_time, mind.gone, mind.compass
    measured = heard.measured
    if not math.isnan(measured.heading):
        compass, turned = _compass(compass, measured)
        # the monitor's own reckoning is a little closer; what is half its measure is left to it
        since, before = measured.time - mind.compass.time, fusion.state
        gone = gone or abs(turned - before.rate * since) > 0.5 * brain.heading_jump
        gone = gone or measured.time - before.time > PREDICT_LONGEST
        # the gap that a restart of the filter ends is not carried over
        time = min(measured.time, before.time + PREDICT_LONGEST)
        past = RudderPast(memory.times, memory.angles, rudder.ticks)
        taken = Measured(time, measured.heading, measured.rate)
        fusion, is_fused = fuse_measured(model, estimator.noises, fusion, past, taken)
        is_planned = now < mind.guide.turning_until and is_turning(mind.model, mind.turning.limits, mind.guide.boat)
        if is_fused and is_planned:
            fusion = Fusion(with_bias_of(before, fusion.state), fusion.surprise, fusion.spikes, fusion.spike)
        heading_time = time if is_fused else heading_time
        gone = gone or fusion.spikes > GATE_PATIENCE
    return Mind(
        now=now,
        model=model,
        speed=speed,
        fusion=fusion,
        heading_time=heading_time,
        rudder=rudder,
        turning=mind.turning,
        guide=mind.guide,
        law=mind.law,
        told=mind.told,
        rest=mind.rest,
        undoing=mind.undoing,
        compass=compass,
        easy_time=mind.easy_time,
        right_time=mind.right_time,
        gone=gone,
    )


def _compass(before: Compass, measured: Measured) -> tuple[Compass, float]:
    """Return the compass after another heading, and how far [rad] that turned."""
    since, turned = measured.time - before.time, shortest_turn(before.heading, measured.heading)
    turns = turns_step(before.turns, turned, measured.rate * since, since)
    same = before.same + 1 if measured.heading == before.heading else 1
    return Compass(measured.heading, measured.time, same, turns), turned
