"""From samples to NavState: fuses in order of measurement time, whatever the order of arrival.

Late samples are taken in where they belong: the filter goes back to its state before them and fuses again
what came after, as far back as its short memory reaches. Repeated ones are dropped. The state handed out is
carried forward from the newest measurement to now, so that sensor latency does not reach the law.

Which speed the model and the gains follow: that through the water, and over the ground only half the way.

K ~ U and T ~ 1/U, so a loop designed for the ratio s of the trial's speed has (U/s)^2 times the gain that it was
designed for where the boat goes at the ratio U. A loop bears an error of two either way; with a third of the true speed
it swings for ever. Speed over the ground is the speed through the water and a current that nobody knows. Of two claims,
that the boat goes as fast as the ground says, s, and that it goes as in the trial, 1, the geometric mean sqrt(s) is
wrong by sqrt(s) at most, whichever is true. s counts for no less than STREAM_LEAST, so that this is 1.7 against a
current of two thirds of the boat's speed, and more. Where log and ground differ by more than SPEEDS_APART, one of them
is wrong or the current is strong, and the mean of both is taken in the same way. A speed that the boat's own turns have
proven wrong (`autopilot.supervision.rudder_watch`) is not gone by at all.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.estimation import heading_ekf as ekf
from autopilot.estimation import waves
from autopilot.estimation.fusion import (
    NOT_BEGUN,
    Fusion,
    Measured,
    Moment,
    Noises,
    fuse_measured,
    seen_at,
)
from autopilot.estimation.heading_ekf import is_sound
from autopilot.estimation.rudder_observer import (
    RudderMemory,
    RudderObserver,
    advanced,
    all_effective,
    newest_angle,
    past_of,
    rudder_memory,
    with_feedback,
)
from autopilot.estimation.tuning import (
    GATE_PATIENCE,
    PREDICT_LONGEST,
    RATE_MOST,
    RUDDER_MOST,
    SAMPLES_KEPT,
    SPEED_FRESH,
    SPEED_MOST,
    SPEED_RATIO_MOST,
    SPEED_SMOOTHING,
    SPEEDS_APART,
    STREAM_LEAST,
    STREAM_MOST,
    WAVE_MEMORY,
)
from autopilot.models.norrbin import Norrbin, at_speed
from autopilot.models.steering_gear import SteeringGear, clip
from autopilot.signals import HeadingSample, NavState, RateSample, RudderSample, Sample, SpeedSample


class Smoothed(NamedTuple):
    """One kind of speed, smoothed [m/s], and the time [s] of its newest sample; nan where there is no fresh one."""

    value: float = math.nan
    time: float = math.nan


def smoothed(before: Smoothed, now: float, speed: float) -> Smoothed:
    """Return the smoothed speed after a `speed` [m/s] that came at `now` [s]."""
    if math.isnan(before.value):
        return Smoothed(speed, now)
    share = 1.0 - math.exp(-max(now - before.time, 0.0) / SPEED_SMOOTHING)
    return Smoothed(before.value + share * (speed - before.value), now)


NO_SPEED = Smoothed()


class Speeds(NamedTuple):
    """Speed through the water and over the ground."""

    water: Smoothed = NO_SPEED
    ground: Smoothed = NO_SPEED

    @property
    def is_over_ground(self) -> bool:
        """Whether nothing but a speed over the ground is known."""
        return math.isnan(self.water.value) and not math.isnan(self.ground.value)


def with_speed(speeds: Speeds, now: float, sample: SpeedSample) -> Speeds:
    """Return the speeds after a sample that came at `now` [s]."""
    if sample.over_ground:
        return Speeds(speeds.water, smoothed(speeds.ground, now, sample.speed))
    return Speeds(smoothed(speeds.water, now, sample.speed), speeds.ground)


def while_fresh(speeds: Speeds, now: float) -> Speeds:
    """Return the speeds at `now` [s] without what nobody has confirmed for long."""
    water, ground = speeds.water, speeds.ground
    if now - water.time >= SPEED_FRESH:
        water = NO_SPEED
    if now - ground.time >= SPEED_FRESH:
        ground = NO_SPEED
    return speeds if water is speeds.water and ground is speeds.ground else Speeds(water, ground)


def measured_speed(speeds: Speeds) -> float:
    """Return the speed [m/s] to be shown: through the water, else over the ground; nan where there is none."""
    return speeds.ground.value if math.isnan(speeds.water.value) else speeds.water.value


def speeds_apart(speeds: Speeds) -> float:
    """Return how far log and ground lie apart [m/s] where no stream explains it; 0 where one does."""
    water, ground = abs(speeds.water.value), abs(speeds.ground.value)
    if math.isnan(water) or math.isnan(ground) or not _are_apart(water, ground):
        return 0.0
    return abs(water - ground) if abs(water - ground) > STREAM_MOST else 0.0


def scheduled_speed(speeds: Speeds, reference_speed: float) -> float:
    """Return the speed [m/s] for model and gains, nan where none is known; `reference_speed` [m/s]: the trial's.

    ValueError for a reference speed that is not positive.
    """
    if not reference_speed > 0.0:
        raise ValueError("the reference speed must be positive")
    water, ground = speeds.water.value, speeds.ground.value
    if math.isnan(water):
        return ground if math.isnan(ground) else _half_way(ground, reference_speed)
    # astern and at a standstill the ground says nothing about a log
    if math.isnan(ground) or water <= 0.0 or not _are_apart(water, abs(ground)):
        return water
    return _half_way(min(water, abs(ground)), max(water, abs(ground)))


def _are_apart(one: float, other: float) -> bool:
    return max(one, other) > SPEEDS_APART * min(one, other)


def _half_way(low: float, high: float) -> float:
    return math.sqrt(max(abs(low), STREAM_LEAST * high) * high)


def model_at(reference: Norrbin, speed: float) -> Norrbin:
    """Return the model at the scheduled `speed` [m/s]; the trial's own where it is nan."""
    if math.isnan(speed):
        return reference
    most = SPEED_RATIO_MOST * reference.reference_speed
    return at_speed(reference, clip(speed, -most, most))


class Counters(NamedTuple):
    """What became of the samples."""

    fused: int = 0
    late: int = 0
    too_late: int = 0
    repeated: int = 0
    spikes: int = 0
    implausible: int = 0


HEADINGS = (HeadingSample, RateSample)


class Taken(NamedTuple):
    """A sample that was fused, or was a spike, and what the measurements before it had left."""

    before: Fusion
    sample: HeadingSample | RateSample


class EstimatorConfig(NamedTuple):
    """Model at the trial's speed, steering gear and noise. Slower than `steerage` [m/s], and astern, the rudder tells
    nothing of the bias: it stays what it was."""

    model: Norrbin
    gear: SteeringGear
    noises: Noises
    steerage: float = 0.0


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

    model: at the scheduled speed. speed [m/s]: nan where none is known. fusion counts from the first heading on,
    has_begun. heading_time and first_time [s]: of the newest and the first heading. needs_reinit: the next heading
    begins anew. taken: the newest samples, in order of time, and begun, which the filter began with.
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
    counters: Counters = Counters()

    @property
    def lively_model(self) -> Norrbin:
        """The model that explains the headings."""
        lively = self.beliefs.liveliness
        return self.model if lively == 1.0 else self.model._replace(gain=lively * self.model.gain)

    @property
    def push(self) -> float:
        """What wind, current and trim are worth [rad of rudder], more than is handed to the law where it is more.

        0 until the sea has been watched for its memory: before, waves count for wind.
        """
        state = self.fusion.state
        is_known = state.sea == waves.NO_SEA or state.time - self.first_time >= WAVE_MEMORY
        return state.bias if is_known else 0.0


def is_rudder(angle: float) -> bool:
    """Return whether `angle` [rad] can be a rudder's."""
    return abs(angle) <= RUDDER_MOST


def without_rates(samples: list[HeadingSample | RateSample]) -> list[HeadingSample | RateSample]:
    """Return the headings alone."""
    return [sample._replace(rate=None) for sample in samples if isinstance(sample, HeadingSample)]


def first_state(config: EstimatorConfig) -> EstimatorState:
    """Return the state before the first sample: nothing is known."""
    return EstimatorState(config.model, RudderObserver(), rudder_memory())


def reconfigured(before: EstimatorConfig, config: EstimatorConfig, state: EstimatorState) -> EstimatorState:
    """Return the state under another model, steering gear and noise; what is known of the boat stays known. A changed
    dead time of the gear forgets the orders that were still on their way."""
    rudder = state.rudder
    if config.gear.delay != before.gear.delay:
        rudder = all_effective(rudder, state.memory)
    return _scheduled(config, state._replace(rudder=rudder))


def without_bias(state: EstimatorState) -> EstimatorState:
    """Return the state with a bias of which nothing is known: somebody who did not tell us has moved the rudder."""
    if not state.has_begun:
        return state
    return state._replace(fusion=state.fusion._replace(state=ekf.without_bias(state.fusion.state)), taken=())


def without_disturbances(state: EstimatorState) -> EstimatorState:
    """Return the state with unknown bias and sea: they were learnt with a model that has been found to be wrong."""
    if not state.has_begun:
        return state
    alone = ekf.without_sea(ekf.without_bias(state.fusion.state))
    return state._replace(fusion=state.fusion._replace(state=alone), taken=())


def believing(config: EstimatorConfig, state: EstimatorState, beliefs: Beliefs) -> EstimatorState:
    """Return the state under other beliefs."""
    before = state.beliefs
    if beliefs == before:
        return state
    loses_rates = before.takes_rates and not beliefs.takes_rates
    state = state._replace(beliefs=beliefs, needs_reinit=state.needs_reinit or loses_rates)
    return state if beliefs.doubts_speed is before.doubts_speed else _scheduled(config, state)


def estimated(
    config: EstimatorConfig, state: EstimatorState, now: float, samples: tuple[Sample, ...]
) -> EstimatorState:
    """Return the state after the samples that have arrived by `now` [s]."""
    headings: list[HeadingSample | RateSample] = []
    rudder, speeds, implausible = state.rudder, state.speeds, 0
    for sample in samples:
        if isinstance(sample, HEADINGS):
            headings.append(sample)
        elif isinstance(sample, RudderSample):
            if not (is_rudder(sample.angle) and math.isfinite(sample.time)):
                implausible += 1
            elif not sample.ordered:
                rudder = with_feedback(rudder, min(sample.time, now), sample.angle)
        elif isinstance(sample, SpeedSample):
            if abs(sample.speed) <= SPEED_MOST:
                speeds = with_speed(speeds, now, sample)
            else:
                implausible += 1
    if implausible:
        state = _counted(state, implausible=implausible)
    rudder, speeds = advanced(config.gear, rudder, state.memory, now), while_fresh(speeds, now)
    if speeds is state.speeds:
        state = state._replace(rudder=rudder)
    else:
        state = _scheduled(config, state._replace(rudder=rudder, speeds=speeds))
    if len(headings) > 1:
        headings.sort(key=lambda sample: sample.time)
    for heading in headings if state.beliefs.takes_rates else without_rates(headings):
        state = _with_heading(config, state, now, heading)
    return state


def _scheduled(config: EstimatorConfig, state: EstimatorState) -> EstimatorState:
    """Return the state with its model scaled by the speed, or not at all while the boat's own turns contradict it."""
    reference, speed = config.model, measured_speed(state.speeds)
    followed = math.nan if state.beliefs.doubts_speed else scheduled_speed(state.speeds, reference.reference_speed)
    return state._replace(model=model_at(reference, followed), speed=speed)


def _counted(state: EstimatorState, **more: int) -> EstimatorState:
    counters = state.counters
    return state._replace(counters=counters._replace(**{name: getattr(counters, name) + more[name] for name in more}))


def _with_heading(
    config: EstimatorConfig, state: EstimatorState, now: float, sample: HeadingSample | RateSample
) -> EstimatorState:
    heading = sample.heading if isinstance(sample, HeadingSample) else 0.0
    if not (math.isfinite(sample.time) and math.isfinite(heading) and abs(sample.rate or 0.0) <= RATE_MOST):
        return _counted(state, implausible=1)
    # a clock that is a little ahead must not carry the filter into the future
    if sample.time > now:
        sample = sample._replace(time=now)
    if not state.has_begun or state.needs_reinit:
        return _begun(config, state, sample) if isinstance(sample, HeadingSample) else state
    if sample == state.begun or _has_taken(state, sample):
        return _counted(state, repeated=1)
    if sample.time < state.fusion.state.time:
        return _with_late(config, state, sample)
    if sample.time - state.fusion.state.time > PREDICT_LONGEST and isinstance(sample, HeadingSample):
        return _begun(config, state, sample)
    return _fused(config, state, sample)


def _has_taken(state: EstimatorState, sample: HeadingSample | RateSample) -> bool:
    # the memory is in order of time: what is newer than its end cannot be in it
    if not state.taken or sample.time > state.taken[-1].sample.time:
        return False
    return any(entry.sample == sample for entry in state.taken)


def _begun(config: EstimatorConfig, state: EstimatorState, sample: HeadingSample) -> EstimatorState:
    before = state.fusion
    first = ekf.initial(
        sample.time,
        wrap(sample.heading),
        sample.rate,
        config.noises.usual,
        before.state if state.has_begun else None,
    )
    return _counted(
        state._replace(
            fusion=Fusion(first, before.innovation_mean),
            has_begun=True,
            needs_reinit=False,
            first_time=min(state.first_time, sample.time),
            heading_time=sample.time,
            begun=sample,
            taken=(),
        ),
        fused=1,
    )


def _with_late(config: EstimatorConfig, state: EstimatorState, sample: HeadingSample | RateSample) -> EstimatorState:
    """Return the state with a sample that others have overtaken: the filter goes back to before them."""
    taken = state.taken
    index = next((i for i, entry in enumerate(taken) if entry.sample.time > sample.time), len(taken))
    if index == len(taken) or taken[index].before.state.time > sample.time:
        return _counted(state, too_late=1)
    state = _counted(state._replace(fusion=taken[index].before, taken=taken[:index]), late=1)
    for each in (sample, *(entry.sample for entry in taken[index:])):
        state = _fused(config, state, each)
    return state


def _fused(config: EstimatorConfig, state: EstimatorState, sample: HeadingSample | RateSample) -> EstimatorState:
    before, counters = state.fusion, state.counters
    is_heading = isinstance(sample, HeadingSample)
    measured = Measured(
        sample.time,
        sample.heading if isinstance(sample, HeadingSample) else math.nan,
        math.nan if sample.rate is None else sample.rate,
    )
    past = past_of(state.rudder, state.memory)
    fusion, is_fused = fuse_measured(state.lively_model, config.noises, before, past, measured)
    taken = (*state.taken[-SAMPLES_KEPT + 1 :], Taken(before, sample))
    if not is_fused:
        state = state._replace(fusion=fusion, taken=taken, counters=counters._replace(spikes=counters.spikes + 1))
        if fusion.spikes > GATE_PATIENCE and isinstance(sample, HeadingSample):
            return _begun(config, state, sample)
        return state
    if state.beliefs.holds_bias or state.speed < config.steerage:
        fusion = fusion._replace(state=ekf.with_bias_of(before.state, fusion.state))
    return state._replace(
        fusion=fusion,
        taken=taken,
        heading_time=max(state.heading_time, sample.time) if is_heading else state.heading_time,
        counters=counters._replace(fused=counters.fused + 1),
    )


def nav_state(config: EstimatorConfig, state: EstimatorState, now: float) -> NavState:
    """Return what is known of the boat at `now` [s], carried forward from the newest measurement."""
    speed = config.model.reference_speed if math.isnan(state.speed) else state.speed
    rudder = newest_angle(state.rudder, state.memory)
    if not state.has_begun:
        return NavState(now, 0.0, 0.0, speed, rudder, 0.0, math.inf, False)
    if not is_sound(state.fusion.state):
        return NavState(now, math.nan, math.nan, speed, rudder, 0.0, now - state.heading_time, False)
    past = past_of(state.rudder, state.memory)
    return seen_at(state.lively_model, config.noises, state.fusion, past, Moment(now, speed, state.heading_time))
