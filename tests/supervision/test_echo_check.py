"""An order that the flight controller shows is one of ours, late or not, or it is somebody else's."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from watches import RudderHistory

from autopilot.models.norrbin import Norrbin
from autopilot.signals import NavState, RudderSample
from autopilot.supervision.monitor_input import MonitorInput
from autopilot.supervision.rudder_watch import is_anothers
from autopilot.supervision.tuning import REMEMBERED_S, REPORT_FRESH_S, TOLERANCE

angles = st.floats(-0.6, 0.6)
BOAT = Norrbin(0.2, 2.0, reference_speed=4.0)
STATE = NavState(0.0, 0.0, 0.0, 4.0, 0.0, 0.0, 0.0, True)


class ShownOrder:
    """The orders of late, and the newest report."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self.history, self.report = RudderHistory(), None

    def on_sample(self, sample: RudderSample) -> None:
        self.report = sample

    def is_anothers(self, now: float, commanded: float) -> bool:
        seen = MonitorInput(now, BOAT, STATE, True, True, 0.0, commanded, 0.6, True)
        return is_anothers(self.history.until(seen), now, self.report)


def commanded(shown: ShownOrder, orders: list[float], step: float = 0.1) -> float:
    """Give the orders, one each step; return the time [s] of the last."""
    for number, order in enumerate(orders):
        shown.is_anothers(number * step, order)
    return (len(orders) - 1) * step


@given(st.lists(angles, min_size=1, max_size=15), st.integers(0, 14), st.floats(-0.9, 0.9))
def test_a_report_of_any_order_of_late_is_ours(orders: list[float], back: int, off: float) -> None:
    shown = ShownOrder()
    now = commanded(shown, orders)
    shown.on_sample(RudderSample(now, orders[-1 - back % len(orders)] + off * TOLERANCE, True))
    assert not shown.is_anothers(now, orders[-1])


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_another_hand_is_seen_and_forgotten(side: float) -> None:
    shown = ShownOrder()
    now = commanded(shown, [0.0] * 20)
    shown.on_sample(RudderSample(now, side * math.radians(9.0), True))
    assert shown.is_anothers(now, 0.0)
    assert not shown.is_anothers(now + REPORT_FRESH_S + 0.1, 0.0), "an old report proves nothing"
    shown.on_sample(RudderSample(now + 2.0, 0.0, True))
    assert not shown.is_anothers(now + 2.0, 0.0)


def test_an_order_of_long_ago_is_no_order_of_late() -> None:
    shown = ShownOrder()
    now = commanded(shown, [0.5] * 5 + [0.0] * (round(REMEMBERED_S / 0.1) + 2))
    shown.on_sample(RudderSample(now, 0.5, True))
    assert shown.is_anothers(now, 0.0)
    shown.reset()
    assert not shown.is_anothers(now, 0.0)


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("off_deg", "is_anothers"), [(2.99, False), (3.01, True)])
def test_a_report_three_degrees_off_every_order_is_another_s(side: float, off_deg: float, is_anothers: bool) -> None:
    shown = ShownOrder()
    shown.on_sample(RudderSample(0.0, side * math.radians(off_deg), True))
    assert shown.is_anothers(0.0, 0.0) is is_anothers


@pytest.mark.parametrize(("age", "is_anothers"), [(1.0, True), (1.01, False)])
def test_a_report_is_believed_for_a_second(age: float, is_anothers: bool) -> None:
    shown = ShownOrder()
    shown.on_sample(RudderSample(5.0, 0.5, True))
    assert shown.is_anothers(5.0 + age, 0.0) is is_anothers


@pytest.mark.parametrize(("back", "is_anothers"), [(1.5, False), (1.51, True)])
def test_an_order_is_one_of_late_for_a_second_and_a_half(back: float, is_anothers: bool) -> None:
    shown = ShownOrder()
    shown.is_anothers(5.0, 0.5)
    shown.on_sample(RudderSample(5.0 + back, 0.5, True))
    assert shown.is_anothers(5.0 + back, 0.0) is is_anothers
