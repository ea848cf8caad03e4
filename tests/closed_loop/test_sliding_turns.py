"""The whole pilot with the sliding mode law: turns on every boat, with models that are wrong too."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from boats import BOATS, Boat, vessel_of
from plant import Plant, sail

from autopilot.angles import wrap
from autopilot.control.sliding_heading import Sliding
from autopilot.errors import RefusedError
from autopilot.runtime.build import build_pilot, gear_of, model_of
from autopilot.runtime.tuning import designed
from autopilot.signals import Mode, Order, OrderKind


def overshoot_and_end_deg(boat: Boat, factor: float) -> tuple[float, float]:
    vessel = designed(vessel_of(boat))
    vessel = replace(vessel, control=replace(vessel.control, law="sliding"))
    model = model_of(vessel)
    box = Plant(model._replace(gain=model.gain * factor), gear_of(vessel))
    goal = math.radians(90.0)

    def order(time: float) -> Order:
        return Order(OrderKind.HEADING, 0.0 if time < 5.0 else goal, serial=1)

    ticks = sail(build_pilot(vessel), box, order, 60.0 + 10.0 * boat.T, 0.05)
    assert all(tick.mode is Mode.ENGAGED for tick in ticks[1:])
    errors = [math.degrees(wrap(tick.state.heading - goal)) for tick in ticks]
    return max(error for error in errors if abs(error) < 85.0), abs(errors[-1])


@pytest.mark.parametrize("name", BOATS)
def test_a_turn_ends_on_the_course_without_overshoot(name: str) -> None:
    overshoot, end = overshoot_and_end_deg(BOATS[name], 1.0)
    assert overshoot < 1.0
    assert end < 0.1


@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_a_wrong_gain_in_the_model_is_borne(factor: float) -> None:
    overshoot, end = overshoot_and_end_deg(BOATS["lanxin"], factor)
    assert overshoot < 3.0
    assert end < 0.3


def test_a_layer_too_thin_for_the_rudder_is_refused() -> None:
    vessel = vessel_of(BOATS["lanxin"])
    thin = replace(vessel.control, law="sliding", sliding=Sliding(2.0, 60.0, 0.05))
    with pytest.raises(RefusedError, match=r"unstable|limit-cycle"):
        build_pilot(replace(vessel, control=thin))


def test_a_vessel_without_gains_for_it_is_shown_where_to_get_them() -> None:
    with pytest.raises(RefusedError, match=r"control\.sliding"):
        build_pilot(vessel_of(BOATS["lanxin"]), "sliding")
