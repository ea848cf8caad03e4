"""The wind as a guide: bearing over the compass, the angle held, and what is no wind."""

from __future__ import annotations

import math

import pytest
from alarm_texts import words
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import shortest_turn, wrap
from autopilot.guidance.wind_vane import FRESH_S, WindGuide
from autopilot.signals import WindSample

ANGLES = st.floats(-math.pi, math.pi)


def blown(guide: WindGuide, bearing: float, heading: float, since: float, seconds: float) -> float:
    """Let a steady wind from `bearing` [rad] be heard twice a second; return the time [s] of the last."""
    now = since
    for step in range(round(2.0 * seconds) + 1):
        now = since + 0.5 * step
        guide.on_sample(WindSample(now, wrap(bearing - heading), 8.0), heading)
    return now


@given(ANGLES, ANGLES, ANGLES)
def test_no_bump_at_the_beginning_and_the_whole_shift_in_the_end(bearing: float, heading: float, shift: float) -> None:
    guide = WindGuide()
    now = blown(guide, bearing, heading, 0.0, 10.0)
    guide.follow()
    assert abs(shortest_turn(heading, guide.course(now, heading, 5.0))) < 1.0e-6
    if abs(shift) > 3.0:
        return  # two winds from opposite sides have no mean
    now = blown(guide, bearing + shift, heading, now + 0.5, 80.0)
    assert abs(shortest_turn(heading + shift, guide.course(now, heading, 5.0))) < 1.0e-4
    assert ("shifted" in words(guide.alarm)) == (abs(shift) > math.radians(30.0)) or abs(
        abs(shift) - math.radians(30.0)
    ) < 1e-3


def test_the_boats_own_yaw_does_not_move_the_heading_ordered() -> None:
    guide = WindGuide()
    now = blown(guide, 1.0, 0.2, 0.0, 5.0)
    guide.follow()
    assert guide.course(now, 0.2, 5.0) == pytest.approx(0.2)
    for step in range(40):
        now, heading = now + 0.25, 0.2 + 0.3 * math.sin(step)
        guide.on_sample(WindSample(now, wrap(1.0 - heading), 8.0), heading)
        assert guide.course(now, heading, 5.0) == pytest.approx(0.2)


def test_a_lost_wind_leads_nobody_again_until_that_is_ordered() -> None:
    guide = WindGuide()
    now = blown(guide, 1.0, 0.2, 0.0, 5.0)
    guide.follow()
    assert guide.course(now, 0.2, 5.0) == pytest.approx(0.2)
    assert guide.course(now + FRESH_S, 0.25, 5.0) == pytest.approx(0.2)
    assert guide.alarm is None
    assert guide.course(now + FRESH_S + 0.1, 0.25, 5.0) == pytest.approx(0.2)
    assert words(guide.alarm).startswith("wind lost: holding 011.5 deg")
    now = blown(guide, 2.0, 0.2, now + 10.0, 20.0)
    assert guide.course(now, 0.2, 5.0) == pytest.approx(0.2)
    assert "wind lost" in words(guide.alarm)
    guide.follow()
    assert guide.course(now, 0.3, 5.0) == pytest.approx(0.3)
    assert guide.alarm is None


@pytest.mark.parametrize(
    "sample",
    [
        WindSample(0.0, math.nan, 8.0),
        WindSample(0.0, 1.0, math.nan),
        WindSample(math.nan, 1.0, 8.0),
        WindSample(0.0, 1.0, 0.2),
        WindSample(0.0, math.inf, 8.0),
    ],
)
def test_a_calm_and_what_is_not_finite_are_no_wind(sample: WindSample) -> None:
    guide = WindGuide()
    guide.on_sample(sample, 0.0)
    assert not guide.is_known(0.0)
    guide.on_sample(WindSample(0.0, 1.0, 8.0), 0.0)
    assert guide.is_known(0.0)
    assert not guide.is_known(FRESH_S + 0.1)
