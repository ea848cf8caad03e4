"""Angles: wrapping, shortest turns, unwrapping."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.angles import compass_deg, compass_text, shortest_turn, wrap, wrap_positive

finite = st.floats(-1.0e6, 1.0e6)


@given(finite)
def test_wrap_lands_in_its_interval_and_keeps_the_direction(angle: float) -> None:
    wrapped = wrap(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0, abs=1e-9)


@given(st.floats(-math.pi, math.pi, exclude_min=True))
def test_wrap_leaves_what_is_inside_alone(angle: float) -> None:
    assert wrap(angle) == angle


@given(finite)
def test_wrap_positive_is_a_compass_card(angle: float) -> None:
    assert 0.0 <= wrap_positive(angle) < 2.0 * math.pi
    assert 0.0 <= compass_deg(angle) < 360.0


@pytest.mark.parametrize(
    ("degrees", "whole", "tenth"),
    [(359.97, "000", "000.0"), (359.4, "359", "359.4"), (-0.6, "359", "359.4"), (7.0, "007", "007.0")],
)
def test_nobody_reads_a_course_of_360(degrees: float, whole: str, tenth: str) -> None:
    assert (compass_text(math.radians(degrees)), compass_text(math.radians(degrees), 1)) == (whole, tenth)


@given(st.floats(-math.pi, math.pi), st.floats(-math.pi, math.pi))
def test_the_shortest_turn_leads_there(start: float, goal: float) -> None:
    turn = shortest_turn(start, goal)
    assert abs(turn) <= math.pi
    assert abs(wrap(start + turn - goal)) < 1e-9


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_not_finite_becomes_nan(bad: float) -> None:
    assert math.isnan(wrap(bad))
    assert math.isnan(wrap_positive(bad))
