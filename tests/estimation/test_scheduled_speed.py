"""The speed that gains follow: a log in full, the ground half the way, and what two that disagree come to."""

from __future__ import annotations

import math

import pytest

from autopilot.estimation.instruments import (
    Speeds,
    measured_speed,
    scheduled_speed,
    share_ahead,
    speeds_apart,
    while_fresh,
    with_course,
    with_speed,
)
from autopilot.signals import SpeedSample

TRIAL = 4.0


def known(*speeds: tuple[float, bool], at: float = 0.0, before: Speeds | None = None) -> Speeds:
    now = before or Speeds()
    for speed, over_ground in speeds:
        now = with_speed(now, at, SpeedSample(at, speed, over_ground))
    return now


def followed(*speeds: tuple[float, bool]) -> float:
    return scheduled_speed(known(*speeds), TRIAL)


def test_a_log_is_followed_in_full_and_without_any_speed_there_is_nothing_to_follow() -> None:
    assert followed((1.0, False)) == 1.0
    assert followed((-1.0, False)) == -1.0
    assert math.isnan(followed())


@pytest.mark.parametrize("ratio", [0.35, 0.5, 0.7, 1.0, 1.5])
@pytest.mark.parametrize("current", [-0.7, -0.3, 0.0, 0.3, 0.7])
def test_over_the_ground_no_plausible_current_makes_an_error_of_more_than_two(ratio: float, current: float) -> None:
    """Nor is a slow boat in a following stream steered by more than three times its speed."""
    speed = followed((abs(ratio + current) * TRIAL, True))
    assert 0.5 <= speed / (ratio * TRIAL) <= (2.0 if ratio > 0.5 else 3.0)


def test_what_stands_over_the_ground_may_go_through_the_water() -> None:
    standing = followed((0.0, True))
    assert standing == pytest.approx(TRIAL / math.sqrt(3.0))


def test_of_a_speed_over_the_ground_what_is_across_is_no_way() -> None:
    speeds = with_course(known((2.0, True)), 0.0, math.radians(60.0))
    assert share_ahead(speeds) == pytest.approx(0.5)
    assert measured_speed(speeds) == 2.0, "the ground's speed is shown as it is"
    assert scheduled_speed(speeds, TRIAL) == scheduled_speed(with_course(known((4.0 / 3.0, True)), 0.0, 0.0), TRIAL)
    astern = with_course(known((2.0, True)), 0.0, math.pi)
    assert share_ahead(astern) == 0.0
    logged = with_course(known((2.0, True), (1.5, False)), 0.0, 1.0)
    assert share_ahead(logged) == 1.0, "a log knows its way"
    assert share_ahead(while_fresh(known((2.0, True), at=9.0, before=speeds), 10.0)) == 1.0, "an old course is none"


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
        scheduled_speed(Speeds(), reference)
    assert math.isnan(scheduled_speed(Speeds(), 0.1))


def test_a_speed_is_smoothed_over_two_seconds() -> None:
    speeds, passed = Speeds(), 1.0 - math.exp(-0.5)
    for now, speed, wanted in (
        (5.0, 2.0, 2.0),
        (6.0, 4.0, 2.0 + 2.0 * passed),
        (6.0, 9.0, 2.0 + 2.0 * passed),
        (5.5, 9.0, 2.0 + 2.0 * passed),
    ):
        speeds = known((speed, False), at=now, before=speeds)
        assert measured_speed(speeds) == pytest.approx(wanted)


def test_two_speeds_that_no_stream_explains_are_apart_and_two_that_one_does_are_not() -> None:
    speeds = known((0.4, False), (4.0, True))
    assert speeds_apart(speeds) == pytest.approx(3.6)
    assert speeds_apart(known((2.0, False), (4.0, True), at=100.0, before=speeds)) == 0.0


def test_a_speed_that_nobody_confirms_is_forgotten_each_kind_by_itself() -> None:
    speeds = known((4.0, True), at=5.0, before=known((3.0, False)))
    early = while_fresh(speeds, 9.9)
    assert (measured_speed(early), early.is_over_ground) == (3.0, False)
    late = while_fresh(speeds, 10.0)
    assert (measured_speed(late), late.is_over_ground) == (4.0, True)
    none = while_fresh(late, 15.1)
    assert math.isnan(measured_speed(none)) and not none.is_over_ground


@pytest.mark.parametrize(
    ("water", "ground", "apart"), [(2.0, 4.4, 0.0), (2.0, 4.6, 2.6), (4.6, 2.0, 2.6), (3.0, 5.9, 0.0), (1.0, 3.5, 0.0)]
)
def test_five_knots_and_twice_the_speed_are_what_no_stream_explains(water: float, ground: float, apart: float) -> None:
    assert speeds_apart(known((water, False), (ground, True))) == pytest.approx(apart)
