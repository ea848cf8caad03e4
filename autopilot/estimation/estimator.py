"""From samples to NavState: fuses in order of measurement time, whatever the order of arrival.

Late samples are taken in where they belong: the filter goes back to its state before them and fuses again
what came after, as far back as its short memory reaches. Repeated ones are dropped. The state handed out is
carried forward from the newest measurement to now, so that sensor latency does not reach the law.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from autopilot.angles import wrap
from autopilot.estimation import heading_filter as ekf
from autopilot.estimation import wave_motion
from autopilot.estimation.heading_filter import FilterNoise, FilterState
from autopilot.estimation.heading_update import (
    fuse_heading,
    fuse_rate,
    heading_variance,
    is_sound,
    learn_waves,
    surprise,
)
from autopilot.estimation.rudder_track import RudderTrack
from autopilot.models.norrbin import Norrbin, at_speed
from autopilot.models.steering_gear import SteeringGear, clip
from autopilot.signals import HeadingSample, NavState, RateSample, RudderSample, Sample, SpeedSample

KEPT_SAMPLES = 24
GATE_SIGMAS = 6.0
GATE_LEAST = math.radians(10.0)
GATE_PATIENCE = 5
"""A heading this far off is a spike; more than this many in a row that agree among themselves are the truth."""
SURPRISE_TIME = 3.0
SURPRISE_MOST = 5.0
SURPRISED = 1.5
"""White innovations average to less than this [standard deviations] over this time [s]; where they lie to one side for
longer, wind has changed or the model is wrong, and neither is a wave."""
PREDICT_LONGEST = 2.0
"""The boat is not carried forward further than this [s] from its newest measurement."""
LONGEST_SHARE = 0.5
"""A step of the filter is at most this share of the boat's time constant."""
GRAIN_SHARE = 0.1
"""Rudder movements inside this share of the time constant act on the boat as their mean."""
BIAS_MOST = 0.5
"""Largest bias [rad] handed to the law."""
SPEED_SMOOTHING = 2.0
SPEED_FRESH = 10.0
SPEED_MOST = 100.0
RATE_MOST = 10.0
RUDDER_MOST = 0.5 * math.pi
"""Faster [m/s], turning faster [rad/s], a rudder further over [rad]: these are broken instruments, not boats."""
SPEED_RATIO_MOST = 3.0
"""The model is not scaled beyond this many times the speed it was identified at."""


@dataclass(slots=True)
class Counters:
    """What became of the samples."""

    fused: int = 0
    late: int = 0
    too_late: int = 0
    repeated: int = 0
    spikes: int = 0
    implausible: int = 0


HEADINGS = (HeadingSample, RateSample)


class _Fused(NamedTuple):
    before: FilterState
    sample: HeadingSample | RateSample


def is_rudder(angle: float) -> bool:
    """Return whether `angle` [rad] can be a rudder's."""
    return abs(angle) <= RUDDER_MOST


def _pushed(noise: FilterNoise) -> FilterNoise:
    """Return the noise of a boat that something lasting pushes; without waves the bias is quick enough anyway."""
    return noise._replace(bias=noise.gust_bias) if noise.waves else noise


class Estimator:
    """Heading, rate, rudder and bias from irregular samples; see the module's docstring.

    Slower than `steerage` [m/s], and astern, the rudder tells nothing of the bias: it stays what it was.
    """

    def __init__(self, model: Norrbin, gear: SteeringGear, noise: FilterNoise, steerage: float = 0.0) -> None:
        self._reference_model = model
        self._noise, self._pushed = noise, _pushed(noise)
        self._steerage = steerage
        self.rudder = RudderTrack(gear)
        self.reset()

    def reset(self) -> None:
        """Forget every sample."""
        self.model = self._reference_model
        self.counters = Counters()
        self.rudder.reset()
        self._state: FilterState | None = None
        self._fused: deque[_Fused] = deque(maxlen=KEPT_SAMPLES)
        self._begun: HeadingSample | None = None
        self._spikes_in_row = 0
        self._spike = 0.0
        self._surprise = 0.0
        self._heading_time = -math.inf
        self._speed: float | None = None
        self._speed_time = -math.inf
        self.speed_over_ground = False

    def reconfigure(self, model: Norrbin, gear: SteeringGear, noise: FilterNoise, steerage: float = 0.0) -> None:
        """Go on with another model, steering gear and noise; what is known of the boat stays known."""
        self._reference_model, self._noise, self._steerage = model, noise, steerage
        self._pushed = _pushed(noise)
        self.rudder.reconfigure(gear)
        most = SPEED_RATIO_MOST * model.reference_speed
        self.model = model if self._speed is None else at_speed(model, clip(self._speed, -most, most))

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
        self._forget_stale_speed(now)
        self.rudder.advance(now)
        if len(headings) > 1:
            headings.sort(key=lambda sample: sample.time)
        for heading in headings:
            self._take_heading(now, heading)
        return self._nav_state(now)

    def forget_bias(self) -> None:
        """Hold the bias for unknown: the rudder has been moved by somebody who did not tell us."""
        if self._state is not None:
            self._state = ekf.without_bias(self._state)
            self._fused.clear()

    def _take_rudder(self, now: float, sample: RudderSample) -> None:
        if not is_rudder(sample.angle) or not math.isfinite(sample.time):
            self.counters.implausible += 1
        elif not sample.ordered:
            self.rudder.feed_back(min(sample.time, now), sample.angle)

    def _take_speed(self, now: float, sample: SpeedSample) -> None:
        if not abs(sample.speed) <= SPEED_MOST:
            self.counters.implausible += 1
            return
        if self._speed is None:
            self._speed = sample.speed
        else:
            share = 1.0 - math.exp(-max(now - self._speed_time, 0.0) / SPEED_SMOOTHING)
            self._speed += share * (sample.speed - self._speed)
        self._speed_time = now
        self.speed_over_ground = sample.over_ground
        most = SPEED_RATIO_MOST * self._reference_model.reference_speed
        self.model = at_speed(self._reference_model, clip(self._speed, -most, most))

    def _forget_stale_speed(self, now: float) -> None:
        """A speed that nobody confirms is no reason to go on steering a slow boat's gains."""
        if self._speed is not None and now - self._speed_time >= SPEED_FRESH:
            self._speed = None
            self.model = self._reference_model

    def _take_heading(self, now: float, sample: HeadingSample | RateSample) -> None:
        heading = sample.heading if isinstance(sample, HeadingSample) else 0.0
        if not (math.isfinite(sample.time) and math.isfinite(heading) and abs(sample.rate or 0.0) <= RATE_MOST):
            self.counters.implausible += 1
            return
        # a clock that is a little ahead must not carry the filter into the future
        if sample.time > now:
            sample = sample._replace(time=now)
        if self._state is None:
            if isinstance(sample, HeadingSample):
                self._begin(sample)
            return
        if sample == self._begun or self._has_fused(sample):
            self.counters.repeated += 1
            return
        if sample.time < self._state.time:
            self._fuse_late(sample)
        elif sample.time - self._state.time > PREDICT_LONGEST and isinstance(sample, HeadingSample):
            self._begin(sample)
        else:
            self._fuse(sample)

    def _has_fused(self, sample: HeadingSample | RateSample) -> bool:
        # the memory is in order of time: what is newer than its end cannot be in it
        if not self._fused or sample.time > self._fused[-1].sample.time:
            return False
        return any(entry.sample == sample for entry in self._fused)

    def _begin(self, sample: HeadingSample) -> None:
        self._state = ekf.initial(sample.time, wrap(sample.heading), sample.rate, self._noise, self._state)
        self._begun = sample
        self._fused.clear()
        self._spikes_in_row = 0
        self._heading_time = sample.time
        self.counters.fused += 1

    def _fuse_late(self, sample: HeadingSample | RateSample) -> None:
        index = next((i for i, entry in enumerate(self._fused) if entry.sample.time > sample.time), len(self._fused))
        if index == len(self._fused) or self._fused[index].before.time > sample.time:
            self.counters.too_late += 1
            return
        self.counters.late += 1
        after = [entry.sample for entry in list(self._fused)[index:]]
        self._state = self._fused[index].before
        while len(self._fused) > index:
            self._fused.pop()
        self._fuse(sample)
        for later in after:
            self._fuse(later)

    def _fuse(self, sample: HeadingSample | RateSample) -> None:
        assert self._state is not None
        before = self._state
        state = self._carried(before, sample.time)
        self._note_surprise(state, sample, sample.time - before.time)
        if isinstance(sample, RateSample):
            state = fuse_rate(state, sample.rate, self._noise.rate)
        else:
            if self._is_spike(state, sample.heading):
                if self._spikes_in_row > GATE_PATIENCE:
                    self._begin(sample)
                return
            state = fuse_heading(state, sample.heading, self._noise.heading)
            if sample.rate is not None:
                state = fuse_rate(state, sample.rate, self._noise.rate)
            self._heading_time = max(self._heading_time, sample.time)
        if self._noise.waves and abs(self._surprise) < SURPRISED:
            state = learn_waves(state, sample.time - before.time)
        if self._speed is not None and self._speed < self._steerage:
            state = ekf.with_bias_of(before, state)
        self._fused.append(_Fused(before, sample))
        self._state = state
        self.counters.fused += 1

    def _note_surprise(self, state: FilterState, sample: HeadingSample | RateSample, dt: float) -> None:
        """Average what lies between expectation and measurement, in standard deviations: only what lasts stays."""
        heading = sample.heading if isinstance(sample, HeadingSample) else None
        off = clip(surprise(state, heading, sample.rate, self._noise), -SURPRISE_MOST, SURPRISE_MOST)
        self._surprise += -math.expm1(-dt / SURPRISE_TIME) * (off - self._surprise)

    def _is_spike(self, state: FilterState, heading: float) -> bool:
        variance = heading_variance(state) + self._noise.heading
        gate = max(GATE_LEAST, GATE_SIGMAS * math.sqrt(variance))
        if abs(wrap(heading - state.psi - state.wave)) <= gate:
            self._spikes_in_row = 0
            return False
        agrees = self._spikes_in_row > 0 and abs(wrap(heading - self._spike)) <= gate
        self._spikes_in_row = self._spikes_in_row + 1 if agrees else 1
        self._spike = heading
        self.counters.spikes += 1
        return True

    def _carried(self, state: FilterState, to: float) -> FilterState:
        longest = LONGEST_SHARE * self.model.time_constant
        noise = self._noise if abs(self._surprise) < SURPRISED else self._pushed
        for until, angle in self._held(state.time, to):
            for left in range(math.ceil((until - state.time) / longest), 1, -1):
                state = ekf.predict(self.model, noise, state, angle, state.time + (until - state.time) / left)
            state = ekf.predict(self.model, noise, state, angle, until)
        return state if state.time == to else state._replace(time=to)

    def _held(self, start: float, end: float) -> list[tuple[float, float]]:
        return self.rudder.held(start, min(end, start + PREDICT_LONGEST), GRAIN_SHARE * self.model.time_constant)

    def _mean_at(self, state: FilterState, now: float) -> tuple[float, float, float, float]:
        """Return psi, r, h and s of the filter at `now` [s]; what is a moment away needs no covariance."""
        if now <= state.time:
            return state.psi, state.rate, state.wave, state.wave_rate
        held = self._held(state.time, now)
        if len(held) == 1 and held[0][0] - state.time <= LONGEST_SHARE * self.model.time_constant:
            return ekf.predict_mean(self.model, state, held[0][1], held[0][0])
        ahead = self._carried(state, now)
        return ahead.psi, ahead.rate, ahead.wave, ahead.wave_rate

    def _nav_state(self, now: float) -> NavState:
        speed = self._reference_model.reference_speed if self._speed is None else self._speed
        state = self._state
        if state is None:
            return NavState(now, 0.0, 0.0, speed, self.rudder.angle, 0.0, math.inf, False)
        if not is_sound(state):
            return NavState(now, math.nan, math.nan, speed, self.rudder.angle, 0.0, now - self._heading_time, False)
        heading, rate, wave, wave_rate = self._mean_at(state, now)
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
            wave_motion.frequency(state.sea),
        )
