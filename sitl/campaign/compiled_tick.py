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
from autopilot.control.limits import Rest, limited
from autopilot.control.registry import law_step
from autopilot.estimation.disturbance import Noises, sliding
from autopilot.estimation.fusion import (
    NO_NOISE,
    NO_RATE_BIAS,
    Fusion,
    Measured,
    Moment,
    are_truth,
    fuse_measured,
    seen_at,
)
from autopilot.estimation.heading_ekf import FilterState, with_bias_of
from autopilot.estimation.instruments import Smoothed, model_at, smoothed
from autopilot.estimation.path_delay import when_heard
from autopilot.estimation.rudder_observer import (
    AS_FILED,
    RudderMemory,
    RudderObserver,
    RudderPast,
    RudderRate,
    advanced,
    angle_from,
    ordered,
    rudder_rate_step,
)
from autopilot.estimation.tuning import PREDICT_LONGEST
from autopilot.guidance.turn import NO_EVIDENCE, VirtualBoat, is_turning, reference_of
from autopilot.models.drives import quickness
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import clip
from autopilot.signals import NavState
from autopilot.steering import (
    LONGEST_STEP,
    NOT_TURNING,
    Guide,
    SteeringConfig,
    Turning,
    heading_ordered,
    leads_gear,
    referred,
    started,
    steered_by,
    turning_at,
)
from autopilot.supervision.envelope import WRONG_ERROR, WRONG_SHARE, WRONG_TIME
from autopilot.supervision.heading_and_rate import NO_TURNS, Turns, are_opposite, off_most, turning_most, turns_step
from autopilot.supervision.monitor_input import AlarmLimits, MonitorInput
from autopilot.supervision.rudder_answer import (
    FILED,
    NO_SEAWAY,
    NOTHING_KNOWN,
    PAST_S,
    Evidence,
    evidence_step,
    other_verdict,
    verdict_at,
)
from autopilot.supervision.tuning import AT_THE_STOP, FROZEN_SAMPLES, HELD_LAG, LATE_S, RATE_OFF

Floats = NDArray[np.float64]


SEA_BEGUN = NOTHING_KNOWN._replace(seaway=NO_SEAWAY._replace(begun=0.0))
"""The sea is estimated from the first heading on, before anybody steers."""


class CampaignConfig(NamedTuple):
    """What the pilot knows of the boat; see `PilotConfig`. gains are those of the law that steers, first is the memory
    with which it begins.

    alarms: the monitors' limits. The rudder may be hard over for as long as the boat may be off its course before a
    monitor would ask why.
    """

    config: SteeringConfig
    gains: Any
    first: Any
    heading_timeout: float
    alarms: AlarmLimits


class Compass(NamedTuple):
    """The compass as its monitors see it: the newest heading [rad], its time [s], how often it came the same, and what
    headings and rates turned of late."""

    heading: float
    time: float
    same: int
    turns: Turns


class State(NamedTuple):
    """What the pilot remembers from tick to tick, the rudder's rings apart.

    easy_time and right_time [s]: when the rudder was last not hard over for the monitors, and last not pushing the boat
    away. answer: what the rudder-response monitor goes by; rate: how quick the rudder turns out to be. gone: the run
    has come to where only the full simulator goes on.
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
    command: float
    rest: Rest
    compass: Compass
    answer: Evidence
    rate: RudderRate
    easy_time: float
    right_time: float
    gone: bool


class Measurement(NamedTuple):
    """What the instruments said before this tick: heading and rate, not numbers where silent, and the speed [m/s], nan
    where none came."""

    measured: Measured
    speed: float


def initial_state(
    campaign: CampaignConfig, state: FilterState, now: float, measurement: Measurement, memory: RudderMemory
) -> State:
    """Return the pilot's state at `now` [s] after the first heading: engaged, the rudder amidships, no command given
    yet."""
    config = campaign.config
    model = model_at(config.estimator.model, measurement.speed, config.estimator.law)
    speed = Smoothed(measurement.speed, now)
    fusion = Fusion(state, 0.0, 0, 0.0, 0.0, 0.0, NO_RATE_BIAS, NO_NOISE, NO_NOISE, 0.0)
    rudder = advanced(config.estimator.gear, RudderObserver(0.0, 0, 0, 0, 0.0, -math.inf, 0.0), memory, now)
    history, at = (memory.times, memory.angles, rudder.ticks), Moment(now, measurement.speed, state.time)
    seen = seen_at(model, config.estimator.noises, fusion, history, at)
    steered = steered_by(config, model, seen, quickness(config.estimator.law, config.estimator.model, model))
    turning = turning_at(config, NOT_TURNING, model)
    guide = started(
        Guide(math.nan, VirtualBoat(0.0, 0.0, 0.0, NO_EVIDENCE), 1, -math.inf, now, 0.0, 0.0), turning.limits, steered
    )
    return State(
        now=now,
        model=model,
        speed=speed,
        fusion=fusion,
        heading_time=state.time,
        rudder=rudder,
        turning=turning,
        guide=guide,
        law=campaign.first,
        command=0.0,
        rest=Rest(0.0, 0.0, False),
        compass=Compass(measurement.measured.heading, state.time, 1, NO_TURNS),
        answer=SEA_BEGUN,
        rate=AS_FILED,
        easy_time=now,
        right_time=now,
        gone=False,
    )


def tick(
    campaign: CampaignConfig,
    pilot_state: State,
    memory: RudderMemory,
    now: float,
    measurement: Measurement,
    target: float,
) -> State:
    """Return the pilot's state after the tick at `now` [s] on the way to the heading `target` [rad]; `command` is its
    command."""
    config, dt = campaign.config, clip(now - pilot_state.now, 0.0, LONGEST_STEP)
    noises = sliding(config.estimator.noises, pilot_state.guide.unknown)
    listened = _listen(campaign, pilot_state, memory, measurement, (now, noises)) if dt > 0.0 else pilot_state
    model, fusion = listened.model, listened.fusion
    history = memory.times, memory.angles, listened.rudder.ticks
    at = Moment(now, listened.speed.value, listened.heading_time)
    seen = seen_at(model, noises, fusion, history, at)
    answer, answers = listened.answer, True
    # at the first tick the helm is not ours yet
    if dt > 0.0 and campaign.alarms.rudder_response:
        answer = _answer(campaign, pilot_state, seen, model, history, measurement.measured)
        answers = verdict_at(answer, now, now >= pilot_state.guide.turning_until) == 0
        answers = answers and (seen.wave_deviation <= 0.0 or other_verdict(answer.response.others) == FILED)
    ratio = quickness(config.estimator.law, config.estimator.model, model)
    state = present = steered_by(config, model, seen, ratio)
    ahead = leads_gear(config, model) if now < listened.guide.turning_until else 0.0
    if ahead > 0.0:
        state = when_heard(model, config.estimator.gear, present, (listened.rudder, memory), (0.0, ahead), 0.0)
    turning = turning_at(config, listened.turning, model)
    guide = listened.guide
    if target != guide.heading:
        guide = heading_ordered(guide, model, turning.limits, state, target)
    guide = referred(config, guide, turning, model, state, (pilot_state.command, dt))
    reference, own = reference_of(model, turning.limits, guide.boat), pilot_state.rest.allowed
    given = LawInput(model, ratio, reference, state, NO_ROLL, own, config.limits.angle_max, dt, ahead > 0.0)
    demand, law = law_step(campaign.gains, listened.law, given)
    rest = limited(config.limits, config.dead_band, pilot_state.rest, (pilot_state.command, dt), demand)
    command = rest.command
    rudder = ordered(listened.rudder, memory, now, command)
    easy_time = listened.easy_time if abs(pilot_state.command) >= AT_THE_STOP * config.limits.angle_max else now
    off = shortest_turn(state.heading, guide.boat.heading)
    right_time = listened.right_time if _pushes_away(config, off, command, state) else now
    # numba takes no condition inside the call below
    gusty = config.estimator.noises.usual.gusty_bias
    sea = present.wave_deviation, listened.fusion.state.intensity.density, gusty
    steered = present.rate, listened.rudder.effective, now >= pilot_state.guide.turning_until
    rate = rudder_rate_step(model, pilot_state.rate, steered, sea, config.timed_gear, dt)
    gone = listened.gone or not answers or rate.slower > 1.0
    gone = gone or _must_go(campaign, listened, now, easy_time, right_time, state.heading + demand)
    return State(
        now=now,
        model=model,
        speed=listened.speed,
        fusion=fusion,
        heading_time=listened.heading_time,
        rudder=rudder,
        turning=turning,
        guide=guide,
        law=law,
        command=command,
        rest=rest,
        compass=listened.compass,
        answer=answer,
        rate=rate,
        easy_time=easy_time,
        right_time=right_time,
        gone=gone,
    )


def _answer(
    campaign: CampaignConfig, before: State, state: NavState, model: Norrbin, history: RudderPast, measured: Measured
) -> Evidence:
    """Return what the rudder-response monitor goes by after a tick of a course that is followed by heading alone."""
    now, evidence, most = state.time, before.answer, campaign.config.limits.angle_max
    seen = MonitorInput(
        now=now,
        model=model,
        state=state,
        steers=True,
        holds_course=now >= before.guide.turning_until,
        wanted=before.guide.heading,
        rudder=before.command,
        angle_max=most,
        has_way=True,
        innovation=0.0,
        waits=False,
        zigzag_divergence=0.0,
        push=0.0,
        is_late=now - before.now > campaign.alarms.late,
        follows=True,
        speeds_apart=0.0,
        trial_speed=campaign.config.estimator.model.reference_speed,
        rudder_is_measured=False,
        damps_roll=False,
        rudder_is_slow=False,
        rate_bias=0.0,
        weaker=1.0,
        sea_watched=math.inf,
        unknown=0.0,
    )
    since = now if math.isnan(evidence.since) else evidence.since
    middle = 0.5 * (evidence.response.time + measured.time)
    rudders = (
        angle_from(history, max(middle, since, now - PAST_S)),
        angle_from(history, max(middle - LATE_S, since, now - PAST_S)),
    )
    return evidence_step(evidence, campaign.alarms, seen, (measured.time, measured.heading), rudders)


def _pushes_away(config: SteeringConfig, error: float, rudder: float, state: NavState) -> bool:
    """Return whether the envelope check would think so, see `autopilot.supervision.envelope`; half as much is enough
    here."""
    side = 1.0 if error > 0.0 else -1.0
    pushes = side * rudder + max(side * state.bias, 0.0) < -0.5 * WRONG_SHARE * config.limits.angle_max
    return side * error > 0.5 * WRONG_ERROR and pushes and side * state.rate <= 0.0


def _must_go(
    campaign: CampaignConfig,
    pilot_state: State,
    now: float,
    easy_time: float,
    right_time: float,
    heading_and_demand: float,
) -> bool:
    """Return whether the pilot would do more than steer: fail-safe, steerage, monitors."""
    compass, alarms = pilot_state.compass, campaign.alarms
    return (
        not now - pilot_state.heading_time <= campaign.heading_timeout
        or not math.isfinite(heading_and_demand)
        or now - right_time >= WRONG_TIME
        or abs(compass.turns.apart) > alarms.rate_disagrees
        or (are_opposite(compass.turns) and math.isfinite(alarms.rate_disagrees))
        or abs(pilot_state.fusion.gyro.bias) > RATE_OFF
        or pilot_state.speed.value < campaign.config.estimator.steerage
        or (alarms.frozen_heading and compass.same >= FROZEN_SAMPLES)
        or now - easy_time >= alarms.off_course_time
    )


def _listen(
    campaign: CampaignConfig,
    pilot_state: State,
    memory: RudderMemory,
    measurement: Measurement,
    at: tuple[float, Noises],
) -> State:
    """Return the pilot's state with the samples of this tick taken in, in the estimator's order: speed, rudder,
    heading. at: the time [s], and the filter's noises then."""
    (now, noises), estimator = at, campaign.config.estimator
    model, speed = pilot_state.model, pilot_state.speed
    if not math.isnan(measurement.speed):
        speed = smoothed(speed, now, measurement.speed)
        model = model_at(estimator.model, speed.value, estimator.law)
    rudder = advanced(estimator.gear, pilot_state.rudder, memory, now)
    fusion, heading_time, gone, compass = (
        pilot_state.fusion,
        pilot_state.heading_time,
        pilot_state.gone,
        pilot_state.compass,
    )
    measured = measurement.measured
    if not math.isnan(measured.heading):
        compass, turned = _compass(compass, measured)
        # the monitor's own reckoning is a little closer; what is half its measure is left to it
        since, before, unlearnt = measured.time - pilot_state.compass.time, fusion.state, fusion.unlearnt
        gone = gone or abs(turned - before.rate * since) > 0.5 * campaign.alarms.heading_jump
        # what is usual only makes it wider
        turns, off = pilot_state.compass.turns, compass.turns.heading - compass.turns.rate
        turning = turning_most(turns, measured.rate)
        gone = gone or abs(turned - measured.rate * since) > off_most(turning, since + since, 0.0)
        gone = gone or abs(off) > off_most(turning, HELD_LAG + since, 0.0)
        gone = gone or measured.time - before.time > PREDICT_LONGEST
        # the gap that a restart of the filter ends is not carried over
        time = min(measured.time, before.time + PREDICT_LONGEST)
        history = memory.times, memory.angles, rudder.ticks
        taken = Measured(time, measured.heading, measured.rate)
        fusion, is_fused = fuse_measured(model, noises, fusion, history, taken)
        is_planned = now < pilot_state.guide.turning_until and is_turning(
            pilot_state.model, pilot_state.turning.limits, pilot_state.guide.boat
        )
        if is_fused and is_planned:
            state, mean, spikes, spike, lean, leans, gyro, headings, rates, _ = fusion
            state = with_bias_of(model, noises.usual, before, state)
            fusion = Fusion(state, mean, spikes, spike, lean, leans, gyro, headings, rates, unlearnt)
        gone = gone or (not is_fused and are_truth(fusion, time - heading_time))
        heading_time = time if is_fused else heading_time
    return State(
        now=now,
        model=model,
        speed=speed,
        fusion=fusion,
        heading_time=heading_time,
        rudder=rudder,
        turning=pilot_state.turning,
        guide=pilot_state.guide,
        law=pilot_state.law,
        command=pilot_state.command,
        rest=pilot_state.rest,
        compass=compass,
        answer=pilot_state.answer,
        rate=pilot_state.rate,
        easy_time=pilot_state.easy_time,
        right_time=pilot_state.right_time,
        gone=gone,
    )


def _compass(before: Compass, measured: Measured) -> tuple[Compass, float]:
    """Return the compass after another heading, and how far [rad] that turned."""
    since, turned = measured.time - before.time, shortest_turn(before.heading, measured.heading)
    turns = turns_step(before.turns, turned, measured.rate * since, since)
    same = before.same + 1 if measured.heading == before.heading else 1
    return Compass(measured.heading, measured.time, same, turns), turned
