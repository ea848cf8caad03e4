"""One tick of the pilot while it steers, over NamedTuples and arrays, so that numba compiles it.

Every equation is the product's own function: filter, guidance, law and limits. What stands here is only the order in
which `Pilot.step` calls them, with what a run without a helmsman needs; tests hold it to the pilot's own numbers.
Where the supervisor, a monitor or a restart of the filter would have a word, the run is handed to the full simulator.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autopilot.angles import shortest_turn, wrap
from autopilot.control import backstepping, sliding_heading
from autopilot.control.backstepping import (
    BacksteppingGains,
    backstepping_rudder,
    error_max_at,
    smoothed_rudder,
    smoothing_in,
)
from autopilot.control.limits import Rest, RudderLimits, limit, rested
from autopilot.control.met_waves import Corners, Met, Waves, met
from autopilot.control.pid import PidGains, PidMemory, feed_forward, pid_step
from autopilot.control.sliding_heading import SlidingGains, sliding_rudder
from autopilot.estimation import waves as wave_motion
from autopilot.estimation.estimator import BIAS_MOST, SPEED_RATIO_MOST, SPEED_SMOOTHING
from autopilot.estimation.fusion import GATE_PATIENCE, PREDICT_LONGEST, Fusion, Noises, fuse_measured, mean_at
from autopilot.estimation.heading_ekf import FilterState, with_bias_of
from autopilot.estimation.rudder_observer import RudderPast
from autopilot.guidance.turn import (
    NOTHING_SHOWN,
    TurnLimits,
    VirtualBoat,
    caught_up,
    in_company,
    is_turning,
    preset_rate,
    reference_of,
    replan_beyond,
    replanned,
    side_hard_over,
    turn_limits,
    turn_step,
    turning_time,
    within_reach,
    without_haste,
)
from autopilot.models.norrbin import Norrbin, at_speed
from autopilot.models.steering_gear import SteeringGear, clip, gear_step
from autopilot.pilot import LONGEST_STEP, SPEED_CHANGE
from autopilot.signals import Reference
from autopilot.supervision.envelope import WRONG_ERROR, WRONG_SHARE, WRONG_TIME
from autopilot.supervision.monitors import AT_THE_STOP, FROZEN_SAMPLES
from autopilot.supervision.monitors.compass import NO_TURNS, Turns, are_opposite, turns_told

Floats = NDArray[np.float64]

BACKSTEPPING, PID, SLIDING = 0, 1, 2
LAWS = ("backstepping", "pid", "sliding")


class Brain(NamedTuple):
    """What the pilot knows of the boat; see `PilotConfig`. law is a place in LAWS, gains_speed [m/s] where they hold,
    error_max [rad] the largest heading error that backstepping answers there.

    patience [s]: the rudder may be hard over for so long before a monitor would ask why; heading_jump and
    rate_disagrees [rad] are the monitors' too, see `autopilot.supervision.monitors`.
    """

    law: int
    backstepping: BacksteppingGains
    error_max: float
    pid: PidGains
    sliding: SlidingGains
    gains_speed: float
    model: Norrbin
    gear: SteeringGear
    noises: Noises
    limits: RudderLimits
    dead_band: float
    rudder_share: float
    turn_rate_max: float
    turn_curvature_max: float
    wave_corners: Corners
    steerage: float
    heading_timeout: float
    watches_frozen: bool
    patience: float
    heading_jump: float
    rate_disagrees: float


class Mind(NamedTuple):
    """What the pilot remembers from tick to tick, the rudder's past apart.

    same, heading, heard_time, turns: the compass, as its monitors see it; free_time [s]: when the rudder was last not
    at its stop; easy_time and right_time [s]: when it was last not hard over for the monitors, and last not pushing the
    boat away.
    gone: the run has come to where only the full simulator goes on.
    """

    now: float
    model: Norrbin
    speed: float
    speed_time: float
    fusion: Fusion
    heading_time: float
    boat: VirtualBoat
    turn: TurnLimits
    turn_speed: float
    target: float
    turning_until: float
    pid: PidMemory
    told: float
    rest: Rest
    undoing: float
    rudder: float
    ticks: int
    same: int
    heading: float
    heard_time: float
    turns: Turns
    free_time: float
    easy_time: float
    right_time: float
    gone: bool


class Heard(NamedTuple):
    """What the instruments said before this tick: heading [rad] and rate [rad/s] measured at `time` [s], nan where
    silent, and the speed [m/s], nan where none came."""

    time: float
    heading: float
    rate: float
    speed: float


class Past(NamedTuple):
    """Rings of the steering gear's model: ticks' times [s] and angles [rad], orders [rad] and when they were given.

    Their lengths are powers of two."""

    times: Floats
    angles: Floats
    order_times: Floats
    orders: Floats


def first_mind(brain: Brain, state: FilterState, now: float, heading: float, speed: float, past: Past) -> Mind:
    """Return the mind at `now` [s] after the first heading: engaged, the rudder amidships, no command given yet."""
    past.times[0], past.angles[0] = now, 0.0
    past.order_times[0], past.orders[0] = -math.inf, 0.0
    model = brain.model if math.isnan(speed) else _model_at(brain, speed)
    turn, fusion = _turn_limits(brain, model), Fusion(state, 0.0, 0, 0.0)
    seen = mean_at(model, brain.noises, fusion, RudderPast(past.times, past.angles, 1), now)
    steered, rate = _steered_by(seen, _met(brain, model, state, seen))
    return Mind(
        now=now,
        model=model,
        speed=speed,
        speed_time=now,
        fusion=fusion,
        heading_time=state.time,
        boat=VirtualBoat(steered, clip(rate, -turn.rate_max, turn.rate_max), 0.0, NOTHING_SHOWN),
        turn=turn,
        turn_speed=model.reference_speed,
        target=math.nan,
        turning_until=-math.inf,
        pid=PidMemory(0.0, math.nan),
        told=0.0,
        rest=Rest(0.0, 0.0, False),
        undoing=0.0,
        rudder=0.0,
        ticks=1,
        same=1,
        heading=heading,
        heard_time=state.time,
        turns=NO_TURNS,
        free_time=now,
        easy_time=now,
        right_time=now,
        gone=False,
    )


def tick(brain: Brain, mind: Mind, past: Past, now: float, heard: Heard, target: float) -> Mind:
    """Return the mind after the tick at `now` [s] on the way to the heading `target` [rad]; `told` is its command."""
    dt = clip(now - mind.now, 0.0, LONGEST_STEP)
    listened = _listen(brain, mind, past, now, heard) if dt > 0.0 else mind
    model = listened.model
    seen = mean_at(model, brain.noises, listened.fusion, RudderPast(past.times, past.angles, listened.ticks), now)
    waves = _met(brain, model, listened.fusion.state, seen)
    heading, rate = _steered_by(seen, waves)
    turn, turn_speed = listened.turn, listened.turn_speed
    if abs(model.reference_speed - turn_speed) > SPEED_CHANGE * turn_speed:
        turn, turn_speed = _turn_limits(brain, model), model.reference_speed
    turning_until = listened.turning_until
    if target != listened.target:
        turning_until = max(turning_until, now + turning_time(model, turn, shortest_turn(heading, target)))
    boat = listened.boat
    bias = clip(listened.fusion.state.bias, -BIAS_MOST, BIAS_MOST)
    is_late, by_bias = now >= turning_until, brain.law != PID
    hard_over = side_hard_over(mind.told, brain.limits.angle_max)
    free_time = now if hard_over == 0 else listened.free_time
    if abs(shortest_turn(boat.heading, heading)) > replan_beyond(model, turn, is_late, now - free_time):
        boat = replanned(model, turn, heading, rate, listened.rudder + bias)
    planned = without_haste(turn) if is_late else turn
    if is_late and by_bias:
        boat = caught_up(model, turn, boat, heading, target)
    if by_bias or not is_late:
        boat = within_reach(boat, heading, rate, hard_over)
    if turn.watches:
        boat = in_company(model, turn, boat, heading, rate, listened.rudder + bias, dt)
    boat = turn_step(model, planned, boat, target, dt)
    reference, own = reference_of(model, turn, boat), mind.rest.allowed - mind.undoing
    asked, pid = _demand(brain, model, reference, heading, rate, bias, listened.pid, own, dt)
    demand = asked + waves.rudder
    limited = limit(brain.limits, mind.told, demand, dt)
    rest = rested(brain.limits, brain.dead_band, mind.rest, demand, limited)
    told = rest.told
    place = listened.ticks & (len(past.orders) - 1)
    past.order_times[place], past.orders[place] = now, told
    easy_time = listened.easy_time if abs(mind.told) >= AT_THE_STOP * brain.limits.angle_max else now
    off = shortest_turn(heading, boat.heading)
    right_time = listened.right_time if _pushes_away(brain, off, told, bias, rate) else now
    # numba takes no condition inside the call below
    gone = listened.gone or _must_go(brain, listened, now, easy_time, right_time, heading + demand)
    return Mind(
        now=now,
        model=model,
        speed=listened.speed,
        speed_time=listened.speed_time,
        fusion=listened.fusion,
        heading_time=listened.heading_time,
        boat=boat,
        turn=turn,
        turn_speed=turn_speed,
        target=target,
        turning_until=turning_until,
        pid=pid,
        told=told,
        rest=rest,
        undoing=waves.rudder,
        rudder=listened.rudder,
        ticks=listened.ticks,
        same=listened.same,
        heading=listened.heading,
        heard_time=listened.heard_time,
        turns=listened.turns,
        free_time=free_time,
        easy_time=easy_time,
        right_time=right_time,
        gone=gone,
    )


def _pushes_away(brain: Brain, error: float, rudder: float, bias: float, rate: float) -> bool:
    """Return whether the envelope check would think so, see `autopilot.supervision.envelope`; half as much is enough
    here."""
    side = 1.0 if error > 0.0 else -1.0
    pushes = side * rudder + max(side * bias, 0.0) < -0.5 * WRONG_SHARE * brain.limits.angle_max
    return side * error > 0.5 * WRONG_ERROR and pushes and side * rate <= 0.0


def _must_go(
    brain: Brain, mind: Mind, now: float, easy_time: float, right_time: float, heading_and_demand: float
) -> bool:
    """Return whether the pilot would do more than steer: fail-safe, steerage, monitors."""
    return (
        not now - mind.heading_time <= brain.heading_timeout
        or not math.isfinite(heading_and_demand)
        or now - right_time >= WRONG_TIME
        or abs(mind.turns.apart) > brain.rate_disagrees
        or (are_opposite(mind.turns) and math.isfinite(brain.rate_disagrees))
        or (not math.isnan(mind.speed) and mind.speed < brain.steerage)
        or (brain.watches_frozen and mind.same >= FROZEN_SAMPLES)
        or now - easy_time >= brain.patience
    )


def _listen(brain: Brain, mind: Mind, past: Past, now: float, heard: Heard) -> Mind:
    """Return the mind with the samples of this tick taken in, in the estimator's order: speed, rudder, heading."""
    model, speed, speed_time = mind.model, mind.speed, mind.speed_time
    if not math.isnan(heard.speed):
        share = 1.0 - math.exp(-max(now - speed_time, 0.0) / SPEED_SMOOTHING)
        speed = heard.speed if math.isnan(speed) else speed + share * (heard.speed - speed)
        model, speed_time = _model_at(brain, speed), now
    rudder = gear_step(brain.gear, mind.rudder, _order_at(brain, mind, past, now), now - mind.now)
    place = mind.ticks & (len(past.times) - 1)
    past.times[place], past.angles[place] = now, rudder
    fusion, heading_time, gone = mind.fusion, mind.heading_time, mind.gone
    same, heading, heard_time, turns = mind.same, mind.heading, mind.heard_time, mind.turns
    if not math.isnan(heard.heading):
        since = heard.time - heard_time
        turned = shortest_turn(heading, heard.heading)
        turns = turns_told(turns, turned, heard.rate * since, since)
        # the monitor's own reckoning is a little closer; what is half its measure is left to it
        gone = gone or abs(turned - fusion.state.rate * since) > 0.5 * brain.heading_jump
        same = same + 1 if heard.heading == heading else 1
        heading, heard_time = heard.heading, heard.time
        gone = gone or heard.time - fusion.state.time > PREDICT_LONGEST
        # the gap that a restart of the filter ends is not carried over
        time = min(heard.time, fusion.state.time + PREDICT_LONGEST)
        before = fusion.state
        fusion, is_fused = fuse_measured(
            model, brain.noises, fusion, RudderPast(past.times, past.angles, mind.ticks + 1), time, heading, heard.rate
        )
        if is_fused and now < mind.turning_until and is_turning(mind.model, mind.turn, mind.boat):
            fusion = Fusion(with_bias_of(before, fusion.state), fusion.surprise, fusion.spikes, fusion.spike)
        heading_time = time if is_fused else heading_time
        gone = gone or fusion.spikes > GATE_PATIENCE
    return Mind(
        now=now,
        model=model,
        speed=speed,
        speed_time=speed_time,
        fusion=fusion,
        heading_time=heading_time,
        boat=mind.boat,
        turn=mind.turn,
        turn_speed=mind.turn_speed,
        target=mind.target,
        turning_until=mind.turning_until,
        pid=mind.pid,
        told=mind.told,
        rest=mind.rest,
        undoing=mind.undoing,
        rudder=rudder,
        ticks=mind.ticks + 1,
        same=same,
        heading=heading,
        heard_time=heard_time,
        turns=turns,
        free_time=mind.free_time,
        easy_time=mind.easy_time,
        right_time=mind.right_time,
        gone=gone,
    )


def _order_at(brain: Brain, mind: Mind, past: Past, now: float) -> float:
    """Return the order in effect at `now` [s]: the newest that was given the gear's delay ago."""
    ring = len(past.orders) - 1
    order = mind.ticks
    while order > 0 and order >= mind.ticks - ring and past.order_times[order & ring] + brain.gear.delay > now:
        order -= 1
    return float(past.orders[order & ring])


def _model_at(brain: Brain, speed: float) -> Norrbin:
    most = SPEED_RATIO_MOST * brain.model.reference_speed
    return at_speed(brain.model, clip(speed, -most, most))


def _turn_limits(brain: Brain, model: Norrbin) -> TurnLimits:
    preset = preset_rate(brain.turn_rate_max, brain.turn_curvature_max, model.reference_speed)
    return turn_limits(model, brain.limits.angle_max, brain.limits.rate_max, brain.rudder_share, preset)


def _met(brain: Brain, model: Norrbin, state: FilterState, seen: tuple[float, float, float, float]) -> Met:
    """Return how the waves are met."""
    waves = Waves(seen[2], seen[3], math.sqrt(state.sea.heading), wave_motion.frequency(state.sea))
    quickness = model.reference_speed / brain.model.reference_speed
    return met(model, brain.gear, brain.limits, brain.wave_corners, quickness, waves)


def _steered_by(seen: tuple[float, float, float, float], waves: Met) -> tuple[float, float]:
    """Return heading [rad] and rate [rad/s] with the waves taken out that are left alone."""
    psi, rate, wave, wave_rate = seen
    heading, rate = wrap(psi + wave), rate + wave_rate
    if waves.alone == 0.0:
        return heading, rate
    return wrap(heading - waves.alone * wave), rate - waves.alone * wave_rate


def _demand(
    brain: Brain,
    model: Norrbin,
    reference: Reference,
    heading: float,
    rate: float,
    bias: float,
    memory: PidMemory,
    told: float,
    dt: float,
) -> tuple[float, PidMemory]:
    """Return the law's demand [rad] and the PID's memory."""
    ratio = model.reference_speed / brain.gains_speed
    if brain.law == BACKSTEPPING:
        gains, most = backstepping.gains_at(brain.backstepping, ratio), error_max_at(brain.error_max, ratio)
        wanted = backstepping_rudder(model, gains, reference, heading, rate, bias, most, brain.limits.angle_max)
        return smoothed_rudder(smoothing_in(model, gains.smoothing, reference), wanted, told, dt), memory
    if brain.law == SLIDING:
        surface = sliding_heading.gains_at(brain.sliding, ratio)
        return sliding_rudder(model, surface, reference, heading, rate, bias, brain.limits.angle_max), memory
    return pid_step(brain.pid, memory, reference, heading, rate, told, dt, feed_forward(model, reference))
