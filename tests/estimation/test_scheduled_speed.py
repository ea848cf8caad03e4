"""The speed that gains follow: a log in full, the ground half the way, and what two that disagree come to."""

from __future__ import annotations

import math

import pytest

from autopilot.estimation.estimator import ScheduledSpeed
from autopilot.signals import SpeedSample

TRIAL = 4.0


def followed(*speeds: tuple[float, bool]) -> float | None:
    scheduled = ScheduledSpeed()
    for speed, over_ground in speeds:
        scheduled.on_sample(0.0, SpeedSample(0.0, speed, over_ground))
    return scheduled.followed(TRIAL)


def test_a_log_is_followed_in_full_and_without_any_speed_there_is_nothing_to_follow() -> None:
    assert followed((1.0, False)) == 1.0
    assert followed((-1.0, False)) == -1.0
    assert followed() is None


@pytest.mark.parametrize("ratio", [0.35, 0.5, 0.7, 1.0, 1.5])
@pytest.mark.parametrize("current", [-0.7, -0.3, 0.0, 0.3, 0.7])
def test_over_the_ground_no_plausible_current_makes_an_error_of_more_than_two(ratio: float, current: float) -> None:
    """Nor is a slow boat in a following stream steered by more than three times its speed."""
    speed = followed((abs(ratio + current) * TRIAL, True))
    assert speed is not None
    assert 0.5 <= speed / (ratio * TRIAL) <= (2.0 if ratio > 0.5 else 3.0)


def test_what_stands_over_the_ground_may_go_through_the_water() -> None:
    standing = followed((0.0, True))
    assert standing is not None
    assert standing == pytest.approx(TRIAL / math.sqrt(3.0))


def test_a_log_that_agrees_with_the_ground_counts_and_one_that_does_not_counts_half() -> None:
    assert followed((3.0, False), (4.0, True)) == 3.0
    assert followed((4.0, False), (1.0, True)) == pytest.approx(4.0 / math.sqrt(3.0))
    assert followed((1.0, False), (3.0, True)) == pytest.approx(math.sqrt(3.0))
    assert followed((-1.0, False), (3.0, True)) == -1.0
    assert followed((0.0, False), (3.0, True)) == 0.0, "at a standstill the ground says nothing about a log"
    assert followed((3.0, False), (-1.0, True)) == pytest.approx(math.sqrt(3.0))
    assert followed((2.0, False), (4.0, True)) == followed((2.0, False), (1.0, True)) == 2.0, "no more than twice"


@pytest.mark.parametrize("reference", [0.0, -1.0, math.nan])
def test_without_a_trial_s_speed_there_is_no_ratio(reference: float) -> None:
    with pytest.raises(ValueError, match="must be positive"):
        ScheduledSpeed().followed(reference)
    assert ScheduledSpeed().followed(0.1) is None


def test_a_speed_is_smoothed_over_two_seconds() -> None:
    scheduled, passed = ScheduledSpeed(), 1.0 - math.exp(-0.5)
    for now, speed, wanted in (
        (5.0, 2.0, 2.0),
        (6.0, 4.0, 2.0 + 2.0 * passed),
        (6.0, 9.0, 2.0 + 2.0 * passed),
        (5.5, 9.0, 2.0 + 2.0 * passed),
    ):
        scheduled.on_sample(now, SpeedSample(now, speed, False))
        assert scheduled.measured == pytest.approx(wanted)


def test_two_speeds_that_no_stream_explains_are_told_and_two_that_one_does_are_not() -> None:
    scheduled = ScheduledSpeed()
    scheduled.on_sample(0.0, SpeedSample(0.0, 0.4, False))
    scheduled.on_sample(0.0, SpeedSample(0.0, 4.0, True))
    assert scheduled.apart == pytest.approx(3.6)
    scheduled.on_sample(100.0, SpeedSample(100.0, 2.0, False))
    scheduled.on_sample(100.0, SpeedSample(100.0, 4.0, True))
    assert scheduled.apart == 0.0


def test_a_speed_that_nobody_confirms_is_forgotten_each_kind_by_itself() -> None:
    scheduled = ScheduledSpeed()
    scheduled.on_sample(0.0, SpeedSample(0.0, 3.0, False))
    scheduled.on_sample(5.0, SpeedSample(5.0, 4.0, True))
    scheduled.forget_stale(9.9)
    assert (scheduled.measured, scheduled.over_ground) == (3.0, False)
    scheduled.forget_stale(10.0)
    assert (scheduled.measured, scheduled.over_ground) == (4.0, True)
    scheduled.forget_stale(15.1)
    assert scheduled.measured is None


@pytest.mark.parametrize(
    ("water", "ground", "apart"), [(2.0, 4.4, 0.0), (2.0, 4.6, 2.6), (4.6, 2.0, 2.6), (3.0, 5.9, 0.0), (1.0, 3.5, 0.0)]
)
def test_five_knots_and_twice_the_speed_are_what_no_stream_explains(water: float, ground: float, apart: float) -> None:
    scheduled = ScheduledSpeed()
    scheduled.on_sample(0.0, SpeedSample(0.0, water, False))
    scheduled.on_sample(0.0, SpeedSample(0.0, ground, True))
    assert scheduled.apart == pytest.approx(apart)
