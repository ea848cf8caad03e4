"""The last look at a command, against the law's own limits and on its own."""

from __future__ import annotations

import ast
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autopilot.control.limits import RudderLimits, limit
from autopilot.supervision.envelope import (
    NOT_FINITE,
    OLDEST,
    OUTSIDE,
    SLACK,
    WRONG_TIME,
    Envelope,
    Picture,
    fault,
)

MOST, RATE = 0.5, 0.35
ENVELOPE = Envelope(MOST, RATE, 1.0)
angle = st.floats(-MOST, MOST)
wild = st.one_of(st.floats(-10.0, 10.0), st.floats(allow_nan=True, allow_infinity=True))
step = st.floats(0.0, 0.5)
OK = ("", "")


class check:  # noqa: N801 - made at each use
    """The check with what it goes on from."""

    def __init__(self, envelope: Envelope = ENVELOPE) -> None:
        self.envelope = envelope
        self.wrong_since: float | None = None

    def fault(
        self, now: float, previous: float, demand: float, command: float, dt: float, seen: Picture | None = None
    ) -> tuple[str, str]:
        move = now, previous, demand, command, dt
        name, wrong, self.wrong_since = fault(self.envelope, self.wrong_since, move, seen)
        return name, wrong


@given(angle, wild, step)
def test_whatever_the_laws_limits_let_through_of_a_finite_demand_is_inside(
    previous: float, demand: float, dt: float
) -> None:
    command = limit(RudderLimits(MOST, RATE), previous, demand, dt)
    fault, _ = check().fault(0.0, previous, demand, command, dt)
    assert fault == ("" if math.isfinite(demand) else NOT_FINITE)


@given(angle, st.floats(-2.0, 2.0), step)
def test_what_the_laws_limits_would_have_cut_is_outside(previous: float, command: float, dt: float) -> None:
    cut = limit(RudderLimits(MOST, RATE), previous, command, dt)
    fault, wrong = check().fault(0.0, previous, command, command, dt)
    if abs(cut - command) > 1.0e-6:
        assert (fault, bool(wrong)) == (OUTSIDE, True)
    elif cut == command:
        assert fault == ""


@given(angle, angle)
def test_a_rudder_of_unlimited_rate_may_be_anywhere_inside_its_angle(previous: float, command: float) -> None:
    assert check(Envelope(MOST, math.inf)).fault(0.0, previous, command, command, 0.0) == OK


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_what_is_no_number_never_leaves(bad: float) -> None:
    assert check().fault(0.0, 0.0, bad, 0.0, 0.1) == (NOT_FINITE, "the law's demand")
    assert check().fault(0.0, 0.0, 0.0, bad, 0.1) == (NOT_FINITE, "the command")
    assert check().fault(0.0, bad, 0.0, 0.0, 0.1)[0] == OUTSIDE
    assert check().fault(0.0, 0.1, 0.0, 0.0, bad)[0] == ("" if bad == math.inf else OUTSIDE)


def picture(**changed: float) -> Picture:
    return Picture(0.0, 0.0, 0.0, 0.0, 0.0)._replace(**changed)


@pytest.mark.parametrize(
    ("seen", "wrong"),
    [
        (picture(time=OLDEST + 0.01), "worked out for"),
        (picture(time=-OLDEST - 0.01), "worked out for"),
        (picture(time=math.nan), "worked out for"),
        (picture(heading_age=1.01), "from a heading 1.0 s old"),
        (picture(heading_age=math.nan), "from a heading"),
    ],
)
def test_a_command_from_an_old_state_never_leaves(seen: Picture, wrong: str) -> None:
    fault, text = check().fault(0.0, 0.0, 0.0, 0.0, 0.1, seen)
    assert fault == OUTSIDE
    assert text.startswith(wrong)


def test_at_its_limits_a_command_may_leave() -> None:
    for time in (OLDEST, -OLDEST):
        assert check().fault(0.0, 0.0, 0.0, 0.0, 0.1, picture(time=time, heading_age=1.0)) == OK
    assert check().fault(0.0, MOST, MOST, MOST, 0.1) == OK
    assert check().fault(0.0, 0.0, RATE * 0.1, RATE * 0.1, 0.1) == OK


def away(rudder: float, seconds: float, **seen: float) -> tuple[str, str]:
    """Hold a rudder for so long in a picture, and return what is wrong in the end."""
    tested, fault = check(), OK
    for tick in range(round(seconds / 0.1) + 1):
        now = 0.1 * tick
        fault = tested.fault(now, rudder, rudder, rudder, 0.1, picture(time=now, **seen))
        if fault != OK:
            return fault
    return fault


WRONG = {"error": math.radians(40.0), "rate": -0.05}


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_rudder_that_turns_the_boat_away_for_seconds_is_wrong(side: float) -> None:
    seen = {"error": side * WRONG["error"], "rate": side * WRONG["rate"]}
    assert away(-side * 0.4, WRONG_TIME - 0.2, **seen) == OK
    assert away(-side * 0.4, WRONG_TIME + 0.1, **seen)[0] == OUTSIDE


@pytest.mark.parametrize(
    ("rudder", "seen"),
    [
        (0.4, WRONG),
        (-0.2, WRONG),
        (-0.4, {**WRONG, "rate": 0.05}),
        (-0.4, {**WRONG, "error": math.radians(10.0)}),
        (-0.4, {**WRONG, "error": math.radians(170.0)}),
        (-0.4, {**WRONG, "error": math.nan}),
        (-0.4, {**WRONG, "bias": 0.3}),
        (0.2, {**WRONG, "bias": -0.5}),
        (-0.2, {**WRONG, "bias": -0.5}),
    ],
    ids=[
        "the right side",
        "little rudder",
        "turning back",
        "nearly there",
        "either way round",
        "no course",
        "wind",
        "the right side, the bias at its clip",
        "little rudder, the bias at its clip",
    ],
)
def test_what_a_sound_law_does_is_no_fault(rudder: float, seen: dict[str, float]) -> None:
    assert away(rudder, 20.0, **seen) == OK


@given(st.floats(0.0, MOST), st.floats(-0.5, 0.5), st.floats(-math.pi, math.pi), st.floats(-1.0, 1.0))
def test_no_estimate_makes_a_rudder_on_the_right_side_wrong(
    rudder: float, bias: float, error: float, rate: float
) -> None:
    assert away(math.copysign(rudder, error), WRONG_TIME + 0.5, error=error, rate=rate, bias=bias) == OK


@pytest.mark.parametrize("bias", [0.0, -0.5, math.nan])
def test_no_estimate_but_one_to_the_other_side_excuses_a_wrong_rudder(bias: float) -> None:
    assert away(-0.4, WRONG_TIME + 0.1, **WRONG, bias=bias)[0] == OUTSIDE


def test_the_time_counts_from_the_last_moment_that_was_right() -> None:
    tested = check()
    for tick in range(200):
        now = 0.1 * tick
        rate = 0.05 if tick % 25 == 0 else -0.05
        seen = picture(time=now, error=WRONG["error"], rate=rate)
        assert tested.fault(now, -0.4, -0.4, -0.4, 0.1, seen) == OK


def test_it_shares_no_code_with_the_law_and_its_limits() -> None:
    source = Path(__file__).parents[2] / "autopilot" / "supervision" / "envelope.py"
    imported = {
        node.module for node in ast.walk(ast.parse(source.read_text("utf-8"))) if isinstance(node, ast.ImportFrom)
    }
    assert imported == {"__future__", "typing"}


@pytest.mark.parametrize("late", [-0.51, -0.49, 0.49, 0.51])
def test_a_command_of_another_half_second_never_leaves(late: float) -> None:
    fault, _ = check().fault(10.0 + late, 0.0, 0.0, 0.0, 0.1, picture(time=10.0))
    assert fault == (OUTSIDE if abs(late) > 0.5 else "")


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("error_deg", "share", "seconds", "is_wrong"),
    [
        (15.2, 0.6, 3.0, True),
        (14.8, 0.6, 9.0, False),
        (149.0, 0.6, 3.0, True),
        (151.0, 0.6, 9.0, False),
        (40.0, 0.51, 3.0, True),
        (40.0, 0.49, 9.0, False),
        (40.0, 0.6, 2.9, False),
    ],
)
def test_what_pushes_the_boat_away_in_numbers(
    side: float, error_deg: float, share: float, seconds: float, is_wrong: bool
) -> None:
    judged, rudder = check(), -side * share * MOST
    for tick in range(round(seconds / 0.1) + 1):
        now = 100.0 + 0.1 * tick
        seen = Picture(now, 0.0, side * math.radians(error_deg), 0.0, 0.0)
        found, _ = judged.fault(now, rudder, rudder, rudder, 0.1, seen)
    assert found == (OUTSIDE if is_wrong else "")


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize("beyond", [0.0, 1.0e-12, 1.0e-3])
def test_a_limit_itself_is_inside_with_room_for_rounding_and_no_more(side: float, beyond: float) -> None:
    wanted = OUTSIDE if beyond else ""
    angle, travel = side * (MOST + SLACK + beyond), side * (RATE * 0.1 + SLACK + beyond)
    assert pytest.approx(1.0e-9) == SLACK, "no rudder and no eye can tell"
    assert check(Envelope(MOST, math.inf)).fault(0.0, 0.0, angle, angle, 0.1)[0] == wanted
    assert check().fault(0.0, 0.0, travel, travel, 0.1)[0] == wanted


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("rate_deg_s", "is_wrong"), [(1.6, False), (2.4, True)])
def test_a_boat_that_its_plan_catches_up_with_has_its_rudder_over_for_a_reason(
    side: float, rate_deg_s: float, is_wrong: bool
) -> None:
    """Swept on by a sea 18 deg before its plan, which turns at 2 deg/s: the helm was given back in mid-turn."""
    seen = picture(
        error=side * math.radians(-18.0),
        rate=side * math.radians(rate_deg_s),
        reference_rate=side * math.radians(2.0),
    )
    rudder, since = side * math.radians(23.0), None
    for step in range(50):
        now = 0.1 * step
        move = (now, rudder, rudder, rudder, 0.1)
        name, _, since = fault(ENVELOPE, since, move, seen._replace(time=now))
        if name:
            break
    assert bool(name) is is_wrong
