"""The estimator among broken, silent and mad instruments, and the rudder track's bookkeeping."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from estimating import Estimating, OutputFeedbackLoop
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import wrap
from autopilot.models.norrbin import rate_step
from autopilot.models.steering_gear import SteeringGear
from autopilot.runtime.build import gear_of, model_of, noise_of
from autopilot.signals import HeadingSample, NavState, RateSample, RudderSample, SpeedSample
from autopilot.vessel.file import load_vessel

GATE_PATIENCE = 5

VESSEL = load_vessel("lanxin")
MODEL = model_of(VESSEL)
DT = 0.05


def made() -> Estimating:
    return Estimating(MODEL, gear_of(VESSEL), noise_of(VESSEL))


def course(seconds: float, rudder: float = 0.1, with_rate: bool = True, every: int = 1) -> list[HeadingSample]:
    """What a perfect compass says of a boat turning under `rudder`, across 180 deg on its way."""
    heading, rate, samples = 3.0, 0.0, []
    for index in range(round(seconds / DT)):
        if index % every == 0:
            samples.append(HeadingSample(index * DT, wrap(heading), rate if with_rate else None, "compass"))
        before = rate
        rate = rate_step(MODEL, rate, rudder, DT)
        heading += 0.5 * DT * (before + rate)
    return samples


def feed(estimator: Estimating, samples: list[HeadingSample], rudder: float = 0.1) -> NavState:
    for sample in samples:
        samples_of_one = (sample, RudderSample(sample.time, rudder))
        state = estimator.update(sample.time, samples_of_one)
    return state


def test_a_good_sample_between_spikes_restarts_the_patience() -> None:
    estimator = made()
    state = feed(estimator, course(5.0, rudder=0.0), rudder=0.0)
    now, truth = state.time, state.heading
    for index in range(1, 40):
        at = now + index * DT
        off = 0.0 if index % GATE_PATIENCE == 0 else 1.5
        state = estimator.update(at, (HeadingSample(at, wrap(truth + off), None, "compass"),))
        assert abs(wrap(state.heading - truth)) < 0.05


def test_a_compass_gone_mad_is_never_believed_and_its_heading_goes_stale() -> None:
    estimator, random = made(), np.random.default_rng(5)
    state = feed(estimator, course(5.0, rudder=0.0), rudder=0.0)
    now, truth = state.time, state.heading
    for index in range(1, 25):
        at = now + index * DT
        wild = wrap(truth + math.pi + random.uniform(-2.5, 2.5))
        state = estimator.update(at, (HeadingSample(at, wild, None, "compass"),))
        assert abs(wrap(state.heading - truth)) < 0.05
    assert state.heading_age == pytest.approx(24 * DT)


def test_after_a_gap_it_starts_anew_from_the_first_heading() -> None:
    estimator = made()
    state = feed(estimator, course(5.0))
    later = estimator.update(state.time + 30.0, ())
    assert later.valid
    assert later.heading_age == pytest.approx(30.0)
    later = estimator.update(state.time + 31.0, (HeadingSample(state.time + 31.0, -2.0, None, "compass"),))
    assert later.heading == -2.0
    assert later.heading_age == 0.0


def test_the_heading_ages_even_while_rates_arrive() -> None:
    estimator = made()
    state = feed(estimator, course(2.0))
    for index in range(1, 61):
        at = state.time + index * DT
        aged = estimator.update(at, (RateSample(at, 0.05),))
    assert aged.heading_age == pytest.approx(3.0)


BROKEN = [math.nan, math.inf, -math.inf, 1.0e300, -1.0e300]


@pytest.mark.parametrize("bad", BROKEN)
def test_broken_instruments_change_nothing(bad: float) -> None:
    estimator = made()
    before = feed(estimator, course(2.0))
    estimator.update(before.time, ())
    known = estimator.known
    for _ in range(20):
        after = estimator.update(
            before.time,
            (
                RateSample(before.time, bad),
                HeadingSample(before.time, 0.1, bad),
                RudderSample(before.time, bad),
                SpeedSample(before.time, bad),
                HeadingSample(math.nan, 0.1),
            ),
        )
    assert after == before
    assert estimator.state.model == MODEL
    assert estimator.known == known


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_heading_that_is_no_number_never_reaches_the_state(bad: float) -> None:
    estimator = made()
    assert not estimator.update(0.0, (HeadingSample(0.0, bad),)).valid
    before = feed(estimator, course(2.0))
    assert estimator.update(before.time, (HeadingSample(before.time, bad, 0.0),)) == before


def test_a_clock_ahead_does_not_carry_the_filter_into_the_future() -> None:
    estimator = made()
    state = feed(estimator, course(2.0))
    ahead = estimator.update(state.time, (HeadingSample(state.time + 1000.0, state.heading, state.rate, "other"),))
    assert ahead.heading_age == 0.0
    at = state.time + DT
    assert estimator.update(at, (HeadingSample(at, state.heading, state.rate, "compass"),)).time == at
    assert estimator.state.taken[-1].sample.time == at


def test_the_model_goes_with_the_speed_and_forgets_it() -> None:
    estimator = made()
    estimator.update(0.0, (SpeedSample(0.0, 2.315),))
    assert estimator.state.model.gain == pytest.approx(0.5 * MODEL.gain)
    assert estimator.update(1.0, ()).speed == 2.315
    assert estimator.update(30.0, ()).speed == MODEL.reference_speed


def test_state_and_model_agree_on_the_speed_after_it_has_gone_stale() -> None:
    estimator = made()
    estimator.update(0.0, (SpeedSample(0.0, 2.315),))
    state = estimator.update(60.0, (HeadingSample(60.0, 0.0),))
    assert estimator.state.model.reference_speed == pytest.approx(state.speed)


def test_feedback_older_than_the_newest_is_ignored_and_goes_stale() -> None:
    track = OutputFeedbackLoop(SteeringGear(0.5, 0.2))
    track.advance(0.0)
    track.feed_back(5.0, 0.3)
    track.feed_back(4.0, -0.3)
    assert track.advance(5.0) == pytest.approx(0.3)
    assert track.is_known(6.9)
    assert not track.is_known(7.1)


@given(
    st.lists(st.floats(0.0, 0.4), min_size=1, max_size=300),
    st.floats(0.0, 1.0),
    st.floats(0.0, 1.0),
    st.sampled_from([0.0, 0.3, math.inf]),
)
def test_joining_short_holds_keeps_the_rudder_s_integral(steps: list[float], a: float, b: float, grain: float) -> None:
    track, now = OutputFeedbackLoop(SteeringGear(0.5, 0.2)), 0.0
    for step in steps:
        now += step
        track.order(now, 0.3 * math.sin(now))
        track.advance(now)
    start, end = sorted((a * now, b * now))

    def integral(grain: float) -> float:
        ends, angles = zip(*track.held(start, end, grain), strict=True)
        assert all(first < second for first, second in pairwise((start, *ends)))
        assert ends[-1] == end
        return sum(angle * (until - at) for angle, until, at in zip(angles, ends, (start, *ends), strict=False))

    if start < end:
        assert integral(grain) == pytest.approx(integral(0.0), abs=1e-9)
    else:
        assert track.held(start, end, grain) == []


def test_reset_forgets_everything() -> None:
    estimator, samples = made(), course(2.0)
    first = feed(estimator, samples)
    estimator.reset()
    assert feed(estimator, samples) == first


def test_noise_is_filtered() -> None:
    random, estimator, errors, raw = np.random.default_rng(3), made(), [], []
    for sample in course(40.0):
        assert sample.rate is not None
        noise = math.radians(0.3) * random.standard_normal()
        noisy = sample._replace(
            heading=wrap(sample.heading + noise),
            rate=sample.rate + math.radians(0.2) * random.standard_normal(),
        )
        state = estimator.update(sample.time, (noisy, RudderSample(sample.time, 0.1)))
        errors.append(wrap(state.heading - sample.heading))
        raw.append(noise)
    assert np.std(errors[200:]) < 0.5 * np.std(raw[200:])


def test_late_rudder_feedback_corrects_the_level_and_the_model_adds_the_motion() -> None:
    gear = SteeringGear(0.5, 0.2)
    track = OutputFeedbackLoop(gear)
    offset = 0.05
    for index in range(40):
        now = index * 0.1
        track.order(now, 0.4)
        angle = track.advance(now)
        # what the potentiometer saw 0.5 s ago: the model's rudder, and an offset the model does not know
        if now >= 0.5:
            track.feed_back(now - 0.5, min(0.2 * (now - 0.5), 0.4) + offset)
        if now > 1.0:
            assert angle == pytest.approx(min(0.2 * now, 0.4) + offset, abs=0.021)
