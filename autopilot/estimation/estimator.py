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
current of two thirds of the boat's speed, and more. Where log and ground differ by more than APART, one of them is
wrong or the current is strong, and the mean of both is taken in the same way. A speed that the boat's own turns have
proven wrong (`autopilot.supervision.monitors.answer`) is not gone by at all.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.estimation import heading_ekf as ekf
from autopilot.estimation import waves
from autopilot.estimation.fusion import (
    GATE_PATIENCE,
    PREDICT_LONGEST,
    Fusion,
    fuse_measured,
    mean_at,
    noises_of,
)
from autopilot.estimation.heading_ekf import FilterNoise, is_sound
from autopilot.estimation.rudder_observer import RudderTrack
from autopilot.models.norrbin import Norrbin, at_speed
from autopilot.models.steering_gear import SteeringGear, clip
from autopilot.signals import HeadingSample, NavState, RateSample, RudderSample, Sample, SpeedSample

SPEED_SMOOTHING = 2.0
SPEED_FRESH = 10.0
"""A speed is smoothed over the first time [s]; one that nobody confirms for the second is no reason to go on steering a
slow boat's gains."""
STREAM_LEAST = 1.0 / 3.0
APART = 2.0
STREAM_MOST = 2.5
"""No stream that is sailed in makes this difference [m/s, 5 kn] between log and ground: one of the two is wrong."""


class _Smoothed:
    """One kind of speed, smoothed. value [m/s]: None where there is no fresh one."""

    def __init__(self) -> None:
        self.value: float | None = None
        self._time = math.nan

    def on_sample(self, now: float, speed: float) -> None:
        if self.value is None:
            self.value = speed
        else:
            share = 1.0 - math.exp(-max(now - self._time, 0.0) / SPEED_SMOOTHING)
            self.value += share * (speed - self.value)
        self._time = now

    def forget_stale(self, now: float) -> None:
        if self.value is not None and now - self._time >= SPEED_FRESH:
            self.value = None


class ScheduledSpeed:
    """Speeds through the water and over the ground, and what is made of them."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._water, self._ground = _Smoothed(), _Smoothed()

    def on_sample(self, now: float, sample: SpeedSample) -> None:
        """Take a speed at `now` [s]."""
        (self._ground if sample.over_ground else self._water).on_sample(now, sample.speed)

    def forget_stale(self, now: float) -> None:
        """Forget what is too old at `now` [s]."""
        self._water.forget_stale(now)
        self._ground.forget_stale(now)

    @property
    def over_ground(self) -> bool:
        """Whether nothing but a speed over the ground is known."""
        return self._water.value is None and self._ground.value is not None

    @property
    def measured(self) -> float | None:
        """The speed [m/s] to be shown: through the water, else over the ground; None where there is none."""
        return self._water.value if self._water.value is not None else self._ground.value

    @property
    def apart(self) -> float:
        """How far log and ground lie apart [m/s] where no stream explains it; 0 where one does."""
        water, ground = self._water.value, self._ground.value
        if water is None or ground is None or not _are_apart(abs(water), abs(ground)):
            return 0.0
        difference = abs(abs(water) - abs(ground))
        return difference if difference > STREAM_MOST else 0.0

    def followed(self, reference_speed: float) -> float | None:
        """Return the speed [m/s] for model and gains, None where none is known; `reference_speed` [m/s]: the trial's.

        ValueError for a reference speed that is not positive.
        """
        if not reference_speed > 0.0:
            raise ValueError(f"the reference speed must be positive, got {reference_speed}")
        water, ground = self._water.value, self._ground.value
        if water is None:
            return None if ground is None else _half_way(ground, reference_speed)
        # astern and at a standstill the ground says nothing about a log
        if ground is None or water <= 0.0 or not _are_apart(water, abs(ground)):
            return water
        return _half_way(min(water, abs(ground)), max(water, abs(ground)))


def _are_apart(one: float, other: float) -> bool:
    return max(one, other) > APART * min(one, other)


def _half_way(low: float, high: float) -> float:
    return math.sqrt(max(abs(low), STREAM_LEAST * high) * high)


KEPT_SAMPLES = 24
BIAS_MOST = 0.5
"""Largest bias [rad] handed to the law."""
SPEED_MOST = 100.0
RATE_MOST = 10.0
RUDDER_MOST = 0.5 * math.pi
"""Faster [m/s], turning faster [rad/s], a rudder further over [rad]: these are broken instruments, not boats."""
SPEED_RATIO_MOST = 3.0
"""The model is not scaled beyond this many times the speed it was identified at."""


@dataclass
class Counters:
    """What became of the samples."""

    fused: int = 0
    late: int = 0
    too_late: int = 0
    repeated: int = 0
    spikes: int = 0
    implausible: int = 0


HEADINGS = (HeadingSample, RateSample)


class _Taken(NamedTuple):
    """A sample that was fused, or was a spike, and what the measurements before it had left."""

    before: Fusion
    sample: HeadingSample | RateSample


def is_rudder(angle: float) -> bool:
    """Return whether `angle` [rad] can be a rudder's."""
    return abs(angle) <= RUDDER_MOST


def without_rates(samples: list[HeadingSample | RateSample]) -> list[HeadingSample | RateSample]:
    """Return the headings alone."""
    return [sample._replace(rate=None) for sample in samples if isinstance(sample, HeadingSample)]


class Estimator:
    """Heading, rate, rudder and bias from irregular samples; see the module's docstring.

    Slower than `steerage` [m/s], and astern, the rudder tells nothing of the bias: it stays what it was. So it does
    while `holds_bias` is set, for turns that are planned. While `doubts_speed` is set the model is the trial's.
    Headings are explained by a boat that answers `liveliness` times as much as the model.
    """

    def __init__(self, model: Norrbin, gear: SteeringGear, noise: FilterNoise, steerage: float = 0.0) -> None:
        self._reference_model = model
        self._noises = noises_of(noise)
        self._steerage = steerage
        self.rudder = RudderTrack(gear)
        self.reset()

    def reset(self) -> None:
        """Forget every sample."""
        self.model = self._reference_model
        self.counters = Counters()
        self.rudder.reset()
        self._fusion: Fusion | None = None
        self._taken: deque[_Taken] = deque(maxlen=KEPT_SAMPLES)
        self._begun: HeadingSample | None = None
        self._heading_time = math.nan
        self._first_time = math.inf
        self._speeds = ScheduledSpeed()
        self._speed: float | None = None
        self.doubts_speed = False
        self.liveliness = 1.0
        self.holds_bias = False
        self._takes_rates, self._is_spoilt = True, False

    def reconfigure(self, model: Norrbin, gear: SteeringGear, noise: FilterNoise, steerage: float = 0.0) -> None:
        """Go on with another model, steering gear and noise; what is known of the boat stays known."""
        self._reference_model, self._noises, self._steerage = model, noises_of(noise), steerage
        self.rudder.reconfigure(gear)
        self._follow_speed()

    def update(self, now: float, samples: tuple[Sample, ...]) -> NavState:
        """Take the samples that have arrived by `now` [s] and return the state at `now`."""
        headings: list[HeadingSample | RateSample] = []
        for sample in samples:
            if isinstance(sample, HEADINGS):
                headings.append(sample)
            elif isinstance(sample, RudderSample):
                self._take_rudder(now, sample)
            elif isinstance(sample, SpeedSample):
                self._take_speed(now, sample)
        self._speeds.forget_stale(now)
        self._follow_speed()
        self.rudder.advance(now)
        if len(headings) > 1:
            headings.sort(key=lambda sample: sample.time)
        for heading in headings if self._takes_rates else without_rates(headings):
            self._take_heading(now, heading)
        return self._nav_state(now)

    @property
    def surprise(self) -> float:
        """How far measurements have lain to one side of what was expected of late [standard deviations]."""
        return self._fusion.surprise if self._fusion is not None else 0.0

    @property
    def push(self) -> float:
        """What wind, current and trim are worth [rad of rudder], more than is handed to the law where it is more.

        0 until the sea has been watched for its memory: before, waves count for wind.
        """
        if self._fusion is None:
            return 0.0
        state = self._fusion.state
        is_known = state.sea == waves.NO_SEA or state.time - self._first_time >= waves.MEMORY
        return state.bias if is_known else 0.0

    def take_rates(self, wanted: bool) -> None:
        """Go by headings and rates of turn, or by headings alone: by what rates had made of it before no more."""
        self._is_spoilt = self._is_spoilt or (self._takes_rates and not wanted)
        self._takes_rates = wanted

    def forget_bias(self) -> None:
        """Hold the bias for unknown: the rudder has been moved by somebody who did not tell us."""
        if self._fusion is not None:
            self._fusion = self._fusion._replace(state=ekf.without_bias(self._fusion.state))
            self._taken.clear()

    def forget_disturbances(self) -> None:
        """Hold bias and sea for unknown: they were learnt with a model that has been found to be wrong."""
        self.forget_bias()
        if self._fusion is not None:
            self._fusion = self._fusion._replace(state=ekf.without_sea(self._fusion.state))

    @property
    def _lively_model(self) -> Norrbin:
        return self.model if self.liveliness == 1.0 else self.model._replace(gain=self.liveliness * self.model.gain)

    def _take_rudder(self, now: float, sample: RudderSample) -> None:
        if not is_rudder(sample.angle) or not math.isfinite(sample.time):
            self.counters.implausible += 1
        elif not sample.ordered:
            self.rudder.feed_back(min(sample.time, now), sample.angle)

    def _take_speed(self, now: float, sample: SpeedSample) -> None:
        if abs(sample.speed) <= SPEED_MOST:
            self._speeds.on_sample(now, sample)
        else:
            self.counters.implausible += 1

    def _follow_speed(self) -> None:
        """Scale the model: by the speed, or not at all while the boat's own turns contradict it."""
        self._speed = self._speeds.measured
        reference = self._reference_model
        followed = None if self.doubts_speed else self._speeds.followed(reference.reference_speed)
        most = SPEED_RATIO_MOST * reference.reference_speed
        self.model = reference if followed is None else at_speed(reference, clip(followed, -most, most))

    @property
    def speed_over_ground(self) -> bool:
        """Whether nothing but a speed over the ground is known."""
        return self._speeds.over_ground

    @property
    def speeds_apart(self) -> float:
        """How far log and ground lie apart [m/s] where no stream explains it, else 0."""
        return self._speeds.apart

    def _take_heading(self, now: float, sample: HeadingSample | RateSample) -> None:
        heading = sample.heading if isinstance(sample, HeadingSample) else 0.0
        if not (math.isfinite(sample.time) and math.isfinite(heading) and abs(sample.rate or 0.0) <= RATE_MOST):
            self.counters.implausible += 1
            return
        # a clock that is a little ahead must not carry the filter into the future
        if sample.time > now:
            sample = sample._replace(time=now)
        if self._fusion is None or self._is_spoilt:
            if isinstance(sample, HeadingSample):
                self._begin(sample)
            return
        if sample == self._begun or self._has_taken(sample):
            self.counters.repeated += 1
            return
        if sample.time < self._fusion.state.time:
            self._fuse_late(sample)
        elif sample.time - self._fusion.state.time > PREDICT_LONGEST and isinstance(sample, HeadingSample):
            self._begin(sample)
        else:
            self._fuse(sample)

    def _has_taken(self, sample: HeadingSample | RateSample) -> bool:
        # the memory is in order of time: what is newer than its end cannot be in it
        if not self._taken or sample.time > self._taken[-1].sample.time:
            return False
        return any(entry.sample == sample for entry in self._taken)

    def _begin(self, sample: HeadingSample) -> None:
        before = self._fusion
        self._first_time = min(self._first_time, sample.time)
        state = ekf.initial(
            sample.time, wrap(sample.heading), sample.rate, self._noises.usual, before.state if before else None
        )
        self._fusion, self._is_spoilt = Fusion(state, before.surprise if before else 0.0), False
        self._begun = sample
        self._taken.clear()
        self._heading_time = sample.time
        self.counters.fused += 1

    def _fuse_late(self, sample: HeadingSample | RateSample) -> None:
        assert self._fusion is not None
        index = next((i for i, entry in enumerate(self._taken) if entry.sample.time > sample.time), len(self._taken))
        if index == len(self._taken) or self._taken[index].before.state.time > sample.time:
            self.counters.too_late += 1
            return
        self.counters.late += 1
        after = [entry.sample for entry in list(self._taken)[index:]]
        self._fusion = self._taken[index].before
        while len(self._taken) > index:
            self._taken.pop()
        self._fuse(sample)
        for later in after:
            self._fuse(later)

    def _fuse(self, sample: HeadingSample | RateSample) -> None:
        assert self._fusion is not None
        before = self._fusion
        heading = sample.heading if isinstance(sample, HeadingSample) else math.nan
        rate = math.nan if sample.rate is None else sample.rate
        self._taken.append(_Taken(before, sample))
        self._fusion, is_fused = fuse_measured(
            self._lively_model, self._noises, before, self.rudder.past, sample.time, heading, rate
        )
        if not is_fused:
            self.counters.spikes += 1
            if self._fusion.spikes > GATE_PATIENCE and isinstance(sample, HeadingSample):
                self._begin(sample)
            return
        if self.holds_bias or (self._speed is not None and self._speed < self._steerage):
            self._fusion = self._fusion._replace(state=ekf.with_bias_of(before.state, self._fusion.state))
        if isinstance(sample, HeadingSample):
            self._heading_time = max(self._heading_time, sample.time)
        self.counters.fused += 1

    def _nav_state(self, now: float) -> NavState:
        speed = self._reference_model.reference_speed if self._speed is None else self._speed
        fusion = self._fusion
        if fusion is None:
            return NavState(now, 0.0, 0.0, speed, self.rudder.angle, 0.0, math.inf, False)
        state = fusion.state
        if not is_sound(state):
            return NavState(now, math.nan, math.nan, speed, self.rudder.angle, 0.0, now - self._heading_time, False)
        heading, rate, wave, wave_rate = mean_at(self._lively_model, self._noises, fusion, self.rudder.past, now)
        return NavState(
            now,
            wrap(heading + wave),
            rate + wave_rate,
            speed,
            self.rudder.angle,
            clip(state.bias, -BIAS_MOST, BIAS_MOST),
            now - self._heading_time,
            True,
            wave,
            wave_rate,
            math.sqrt(state.sea.heading),
            waves.frequency(state.sea),
        )
