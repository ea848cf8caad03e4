"""From samples to NavState: fuses in order of measurement time, whatever the order of arrival.

Late samples are taken in where they belong: the filter goes back to its state before them and fuses again
what came after, as far back as its short memory reaches. Repeated ones are dropped. The state handed out is
carried forward from the newest measurement to now, so that sensor latency does not reach the law.
"""

from __future__ import annotations

import math
from operator import attrgetter
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.estimation import heading_ekf as ekf
from autopilot.estimation.disturbance import NO_SEA, Noises
from autopilot.estimation.fusion import NOT_BEGUN, Fusion, are_truth, carried, fuse_measured, seen_at
from autopilot.estimation.heading_ekf import innovations, is_sound
from autopilot.estimation.instruments import (
    Speeds,
    measured_speed,
    model_at,
    scheduled_speed,
    share_ahead,
    while_fresh,
    with_course,
    with_speed,
)
from autopilot.estimation.path_delay import NOT_ECHOED, Motion, PathDelay, behind, lateness, path_step, rudder_step
from autopilot.estimation.rudder_observer import (
    RudderMemory,
    RudderObserver,
    advanced,
    all_effective,
    newest_angle,
    ordered,
    rudder_memory,
    with_feedback,
)
from autopilot.estimation.tuning import (
    GATE_SIGMAS,
    PATH_GRAIN,
    PATH_LASTS,
    PATH_MOVED,
    PREDICT_LONGEST,
    RATE_MOST,
    RUDDER_MOST,
    SAMPLES_KEPT,
    SPEED_FRESH,
    SPEED_MOST,
    WAVE_MEMORY,
)
from autopilot.models.drives import RUDDER_LAW, DriveLaw, quickness, way_of
from autopilot.models.norrbin import Norrbin
from autopilot.models.steering_gear import SteeringGear
from autopilot.signals import (
    CourseSample,
    HeadingSample,
    NavState,
    RateSample,
    RudderSample,
    Sample,
    SpeedSample,
    ThrustSample,
)

MEASURED_AT = attrgetter("time")


class Taken(NamedTuple):
    """A sample that was fused, or was a spike, and what the measurements before it had left."""

    before: Fusion
    sample: HeadingSample | RateSample


class EstimatorConfig(NamedTuple):
    """Model at the trial's speed, steering gear and noise. Slower than `steerage` [m/s], and astern, the rudder tells
    nothing of the bias: it stays what it was. law: how the model goes with speed and thrust. loop_delay [s]: so late an
    order comes to the gear by the file. shows_path: the rudder tells how late orders come; that of on/off valves rests
    in a zone about them, which looks like lateness."""

    model: Norrbin
    gear: SteeringGear
    noises: Noises
    steerage: float = 0.0
    law: DriveLaw = RUDDER_LAW
    loop_delay: float = 0.0
    shows_path: bool = True


class Beliefs(NamedTuple):
    """What monitors and guidance have to say about the samples.

    takes_rates: False: headings count alone, and by what rates had made of the state before no more. doubts_speed: the
    model is the trial's. liveliness: headings are explained by a boat that answers so many times as much as the model.
    holds_bias: the bias stays what it was, for turns that are planned.
    """

    takes_rates: bool = True
    doubts_speed: bool = False
    liveliness: float = 1.0
    holds_bias: bool = False


class EstimatorState(NamedTuple):
    """All that is remembered of the samples.

    model: at the scheduled speed, at which the loop is `quickness` times as quick as in the trial. speed [m/s]: nan
    where none is known; ahead: the share of it that is way ahead. fusion counts from the first heading on,
    has_begun. heading_time and first_time [s]: of the newest and the first heading. needs_reinit: the next heading
    begins anew. taken: the newest samples, in order of time, and begun, which the filter began with. path: how late our
    orders come to the steering gear.
    """

    model: Norrbin
    rudder: RudderObserver
    memory: RudderMemory
    speeds: Speeds = Speeds()
    speed: float = math.nan
    fusion: Fusion = NOT_BEGUN
    has_begun: bool = False
    heading_time: float = math.nan
    first_time: float = math.inf
    taken: tuple[Taken, ...] = ()
    begun: HeadingSample | None = None
    needs_reinit: bool = False
    beliefs: Beliefs = Beliefs()
    path: PathDelay = NOT_ECHOED
    quickness: float = 1.0
    ahead: float = 1.0

    @property
    def lively_model(self) -> Norrbin:
        """The model that explains the headings."""
        lively = self.beliefs.liveliness
        return self.model if lively == 1.0 else self.model._replace(gain=lively * self.model.gain)

    @property
    def push(self) -> float:
        """What wind, current and trim are worth [rad of rudder], more than is handed to the law where it is more.

        0 until the sea is known: before, waves count for wind.
        """
        return self.fusion.state.bias if self.knows_sea else 0.0

    @property
    def knows_sea(self) -> bool:
        """Whether there is none, or it has been watched for its memory."""
        state = self.fusion.state
        return state.time - self.first_time >= WAVE_MEMORY or state.sea == NO_SEA


def is_plausible(sample: SpeedSample | ThrustSample) -> bool:
    """Return whether a speed can be a boat's, or a throttle and a reach a drive's."""
    if isinstance(sample, SpeedSample):
        return abs(sample.speed) <= SPEED_MOST
    return abs(sample.throttle) <= 1.0 and sample.reach >= 0.0


def is_rudder(angle: float) -> bool:
    """Return whether `angle` [rad] can be a rudder's."""
    return abs(angle) <= RUDDER_MOST


def without_rates(samples: list[HeadingSample | RateSample]) -> list[HeadingSample | RateSample]:
    """Return the headings alone."""
    return [sample._replace(rate=None) for sample in samples if isinstance(sample, HeadingSample)]


def first_state(config: EstimatorConfig, path_delay: float = math.nan) -> EstimatorState:
    """Return the state before the first sample: nothing is known, but for the path's delay [s] of an earlier run."""
    path = NOT_ECHOED._replace(late=lateness(0.0, path_delay - config.loop_delay))
    return EstimatorState(config.model, RudderObserver(), rudder_memory(), path=path)


def reconfigured(before: EstimatorConfig, config: EstimatorConfig, state: EstimatorState) -> EstimatorState:
    """Return the state under another model, steering gear and noise; what is known of the boat stays known. A changed
    dead time of the gear forgets the orders that were still on their way, one of the path is compared with the next
    echo."""
    rudder, path = state.rudder, state.path
    if config.gear.delay != before.gear.delay:
        rudder = all_effective(rudder, state.memory)
    if config.loop_delay != before.loop_delay:
        path = path._replace(late=0.0)
    return _scheduled(config, state._replace(rudder=rudder, path=path))


def without_bias(state: EstimatorState) -> EstimatorState:
    """Return the state with a bias of which nothing is known: somebody who did not tell us has moved the rudder."""
    if not state.has_begun:
        return state
    alone = ekf.without_bias(state.fusion.state)
    return state._replace(fusion=state.fusion._replace(state=alone, unlearnt=0.0), taken=())


def with_bias(state: EstimatorState, bias: float) -> EstimatorState:
    """Return the state with a `bias` [rad of rudder] of before: what was learnt since was learnt of no boat."""
    return state._replace(fusion=state.fusion._replace(state=state.fusion.state._replace(bias=bias)))


def without_disturbances(state: EstimatorState) -> EstimatorState:
    """Return the state with unknown bias and sea: they were learnt with a model that has been found to be wrong."""
    if not state.has_begun:
        return state
    alone = ekf.without_sea(ekf.without_bias(state.fusion.state))
    return state._replace(fusion=state.fusion._replace(state=alone, unlearnt=0.0), taken=())


def by_other_compass(state: EstimatorState, turn: float) -> EstimatorState:
    """Return the state as a compass sees it whose headings are further by `turn` [rad], and so what is remembered: a
    late sample has the filter go back to it."""

    def seen(fusion: Fusion) -> Fusion:
        boat = fusion.state._replace(psi=wrap(fusion.state.psi + turn))
        gyro = fusion.gyro
        # nan before the first heading
        gyro = gyro._replace(heading=wrap(gyro.heading + turn)) if gyro.heading == gyro.heading else gyro
        return fusion._replace(state=boat, spike=wrap(fusion.spike + turn), gyro=gyro)

    def said(sample: HeadingSample | RateSample) -> HeadingSample | RateSample:
        return sample._replace(heading=wrap(sample.heading + turn)) if isinstance(sample, HeadingSample) else sample

    taken = tuple(Taken(seen(before), said(sample)) for before, sample in state.taken)
    # what the filter began with is there to know it again: nobody sends it a second time by the other compass
    return state._replace(fusion=seen(state.fusion), taken=taken, begun=None)


def checked_by(config: EstimatorConfig, state: EstimatorState, shown: HeadingSample) -> EstimatorState:
    """Return the state, or the one that begins anew with the next heading, without a bias, where it lies further than
    GATE_SIGMAS off what a compass has `shown` that takes over: it is what the failed one made of it then, and surer of
    itself than it may be."""
    past = state.memory.times, state.memory.angles, state.rudder.ticks
    expected = carried(state.lively_model, config.noises, state.fusion, past, shown.time)
    variances = config.noises.usual.heading, config.noises.usual.rate
    off, _, _ = innovations(expected, variances, shown.heading, math.nan)
    return without_bias(state)._replace(needs_reinit=True) if abs(off) > GATE_SIGMAS else state


def believing(config: EstimatorConfig, state: EstimatorState, beliefs: Beliefs) -> EstimatorState:
    """Return the state under other beliefs."""
    before = state.beliefs
    if beliefs == before:
        return state
    loses_rates = before.takes_rates and not beliefs.takes_rates
    state = state._replace(beliefs=beliefs, needs_reinit=state.needs_reinit or loses_rates)
    return state if beliefs.doubts_speed is before.doubts_speed else _scheduled(config, state)


def with_order(state: EstimatorState, now: float, angle: float) -> EstimatorState:
    """Return the state after the rudder `angle` [rad] was ordered of the steering gear at `now` [s]."""
    return EstimatorState(state.model, ordered(state.rudder, state.memory, now, angle), *state[2:])


def with_command(state: EstimatorState, now: float, angle: float, is_ordered: bool, steers: bool) -> EstimatorState:
    """Return the state after a tick at `now` [s] that commanded a rudder `angle` [rad] until the next: whether it was
    ordered of the steering gear, and whether we steer by it, or somebody else does."""
    commands, rudder = state.memory.commands, state.rudder
    commands[rudder.ticks & (len(commands) - 1)] = angle if steers else math.nan
    if not is_ordered:
        return state
    return EstimatorState(state.model, ordered(rudder, state.memory, now, angle), *state[2:])


def estimated(
    config: EstimatorConfig, state: EstimatorState, now: float, samples: tuple[Sample, ...]
) -> EstimatorState:
    """Return the state after the samples that have arrived by `now` [s]."""
    headings: list[HeadingSample | RateSample] = []
    rudder, speeds, path = state.rudder, state.speeds, state.path
    for sample in samples:
        if type(sample) is HeadingSample or type(sample) is RateSample:
            headings.append(sample)
        elif type(sample) is RudderSample:
            if -RUDDER_MOST <= sample.angle <= RUDDER_MOST and -math.inf < sample.time < math.inf:
                rudder, path = with_rudder_shown(config, state.memory, rudder, path, now, sample)
        elif (type(sample) is SpeedSample or type(sample) is ThrustSample) and is_plausible(sample):
            speeds = with_speed(speeds, now, sample)
        elif type(sample) is CourseSample and state.has_begun and math.isfinite(sample.course):
            speeds = with_course(speeds, now, sample.course - state.fusion.state.psi)
    gear, late = config.gear, path.late
    rudder = advanced(gear if late == 0.0 else behind(gear, late), rudder, state.memory, now)
    if speeds.oldest <= now - SPEED_FRESH:
        speeds = while_fresh(speeds, now)
    if path is not state.path:
        state = state._replace(path=path)
    if speeds is not state.speeds:
        state = _scheduled(config, state._replace(speeds=speeds))
    if not state.beliefs.takes_rates:
        headings = without_rates(headings)
    headings.sort(key=MEASURED_AT)
    for heading in headings:
        state = _with_heading(config, state, rudder, now, heading)
    return state if state.rudder is rudder else _with_rudder(state, rudder)


def with_rudder_shown(
    config: EstimatorConfig,
    memory: RudderMemory,
    rudder: RudderObserver,
    path: PathDelay,
    now: float,
    sample: RudderSample,
) -> tuple[RudderObserver, PathDelay]:
    """Return what is known of the rudder and of the path to it after a sample that was looked at."""
    (time, angle, is_order, _), ticks = sample, rudder.ticks
    if not config.shows_path:
        return (rudder if is_order else with_feedback(rudder, time if time < now else now, angle)), path
    orders = memory.times, memory.commands, ticks
    if is_order:
        # the steering gear shows which of our orders it is at
        if -PATH_MOVED < angle - path.echoed < PATH_MOVED:
            return rudder, path
        return rudder, path_step(path, orders, (time, angle), config.loop_delay)
    time = time if time < now else now
    before, lasted = rudder.fed_back, time - rudder.fed_back_at
    if 0.0 < lasted <= PATH_LASTS and math.isnan(path.echoed):
        # no order is echoed, but the rudder moves by them, or will
        order = memory.commands[ticks & (len(memory.commands) - 1)]
        if abs(angle - before) > PATH_GRAIN or abs(order - angle) > PATH_MOVED:
            path = rudder_step(path, orders, Motion(time, before, angle, lasted), config.gear, config.loop_delay)
    return with_feedback(rudder, time, angle), path


def _with_rudder(state: EstimatorState, rudder: RudderObserver) -> EstimatorState:
    return EstimatorState(state.model, rudder, *state[2:])


def _scheduled(config: EstimatorConfig, state: EstimatorState) -> EstimatorState:
    """Return the state with its model scaled by the speed, or not at all while the boat's own turns contradict it."""
    reference, speed = config.model, measured_speed(state.speeds)
    throttle = state.speeds.throttle.value
    expected = way_of(config.law, reference.reference_speed, throttle)
    followed = math.nan if state.beliefs.doubts_speed else scheduled_speed(state.speeds, expected)
    model = model_at(reference, followed, config.law, throttle)
    quick, ahead = quickness(config.law, reference, model), share_ahead(state.speeds)
    return state._replace(model=model, speed=speed, quickness=quick, ahead=ahead)


def _with_heading(
    config: EstimatorConfig,
    state: EstimatorState,
    rudder: RudderObserver,
    now: float,
    sample: HeadingSample | RateSample,
) -> EstimatorState:
    """Return the state after a heading or a rate, the `rudder` having been observed until `now` [s]."""
    heading = sample.heading if type(sample) is HeadingSample else 0.0
    time, rate, taken, newest = sample.time, sample.rate, state.taken, state.fusion.state.time
    is_bounded = rate is None or -RATE_MOST <= rate <= RATE_MOST
    # a sum is finite only where every part of it is
    if not (is_bounded and -math.inf < time + heading < math.inf):
        return state
    # a clock that is a little ahead must not carry the filter into the future
    if time > now:
        sample, time = sample._replace(time=now), now
    if not state.has_begun or state.needs_reinit:
        return _begun(config, state, sample) if isinstance(sample, HeadingSample) else state
    # the memory is in order of time: what is newer than its end cannot be in it
    is_news = bool(taken) and time > taken[-1].sample.time
    if not is_news and (sample == state.begun or any(entry.sample == sample for entry in taken)):
        return state
    if time < newest:
        return _with_late(config, _with_rudder(state, rudder), sample)
    if time - newest > PREDICT_LONGEST and isinstance(sample, HeadingSample):
        return _begun(config, state, sample)
    return _fused(config, state, rudder, sample)


def _begun(config: EstimatorConfig, state: EstimatorState, sample: HeadingSample) -> EstimatorState:
    before = state.fusion
    first = ekf.initial(
        sample.time,
        wrap(sample.heading),
        None if sample.rate is None else sample.rate - before.gyro.bias,
        config.noises.usual,
        before.state if state.has_begun else None,
    )
    gyro = before.gyro._replace(rated=-math.inf)  # a rate that is refused from now on is not held either
    return state._replace(
        fusion=Fusion(first, before.innovation_mean, gyro=gyro, headings=before.headings, rates=before.rates),
        has_begun=True,
        needs_reinit=False,
        first_time=min(state.first_time, sample.time),
        heading_time=sample.time,
        begun=sample,
        taken=(),
    )


def _with_late(config: EstimatorConfig, state: EstimatorState, sample: HeadingSample | RateSample) -> EstimatorState:
    """Return the state with a sample that others have overtaken: the filter goes back to before them."""
    taken = state.taken
    index = next((i for i, entry in enumerate(taken) if entry.sample.time > sample.time), len(taken))
    if index == len(taken) or taken[index].before.state.time > sample.time:
        return state
    state = state._replace(fusion=taken[index].before, taken=taken[:index])
    for each in (sample, *(entry.sample for entry in taken[index:])):
        state = _fused(config, state, state.rudder, each)
    return state


def _fused(
    config: EstimatorConfig, state: EstimatorState, rudder: RudderObserver, sample: HeadingSample | RateSample
) -> EstimatorState:
    before, beliefs, heading_time = state.fusion, state.beliefs, state.heading_time
    rate = math.nan if sample.rate is None else sample.rate
    heading = sample.heading if type(sample) is HeadingSample else math.nan
    measured = sample.time, heading, rate
    lively = state.model if beliefs.liveliness == 1.0 else state.lively_model
    past = state.memory.times, state.memory.angles, rudder.ticks
    fusion, is_fused = fuse_measured(lively, config.noises, before, past, measured)
    taken = (*state.taken[-SAMPLES_KEPT + 1 :], Taken(before, sample))
    if not is_fused:
        state = state._replace(rudder=rudder, fusion=fusion, taken=taken)
        if isinstance(sample, HeadingSample) and are_truth(fusion, sample.time - heading_time):
            return _begun(config, state, sample)
        return state
    if beliefs.holds_bias or state.speed < config.steerage:
        held = ekf.with_bias_of(lively, config.noises.usual, before.state, fusion.state)
        fusion = fusion._replace(state=held, unlearnt=before.unlearnt)
    if sample.time > heading_time and heading == heading:
        heading_time = sample.time
    return state._replace(rudder=rudder, fusion=fusion, heading_time=heading_time, taken=taken)


def nav_state(config: EstimatorConfig, state: EstimatorState, now: float) -> NavState:
    """Return what is known of the boat at `now` [s], carried forward from the newest measurement."""
    speed = state.speed if state.speed == state.speed else config.model.reference_speed
    past = state.memory.times, state.memory.angles, state.rudder.ticks
    if not state.has_begun:
        return NavState(now, 0.0, 0.0, speed, newest_angle(past), 0.0, math.inf, False)
    if not is_sound(state.fusion.state):
        return NavState(now, math.nan, math.nan, speed, newest_angle(past), 0.0, now - state.heading_time, False)
    lively = state.model if state.beliefs.liveliness == 1.0 else state.lively_model
    return seen_at(lively, config.noises, state.fusion, past, (now, speed, state.heading_time))
