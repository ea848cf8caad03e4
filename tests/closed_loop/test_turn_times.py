"""Turns of 90 deg beside the quickest that the rudder allows, which is found here once more by direct collocation."""

from __future__ import annotations

import importlib.util
import math
import sys
from pathlib import Path
from types import ModuleType

import pytest

from autopilot.guidance.turn import VirtualBoat, paced, reference_of, turn_limits, watched
from autopilot.models.norrbin import rudder_for

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


def loaded(name: str) -> ModuleType:
    """Return a module of the benchmarks' folder, which is no package."""
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, BENCHMARKS / f"{name}.py")
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules[name] = module
        spec.loader.exec_module(module)
    return sys.modules[name]


time_optimal, turns = loaded("time_optimal"), loaded("turns")
SLOWEST = {"lanxin": 1.2, "esso": 1.2, "unstable": 1.5}
"""Settling over the quickest turn. The course-unstable boat keeps rudder for the case that it is weaker than known."""


@pytest.mark.parametrize("name", ["coaster"])
def test_shooting_and_collocation_agree_on_the_quickest_turn(name: str) -> None:
    boat = turns.BOATS[name]
    limits = math.radians(boat.angle_deg), math.radians(boat.rate_deg_s)
    shot = time_optimal.bang_bang(boat.model, *limits, math.radians(90.0))
    found = time_optimal.collocated(boat.model, *limits, math.radians(90.0), parts=24)
    assert found == pytest.approx(shot, rel=5.0e-3)


@pytest.mark.parametrize("name", SLOWEST)
def test_a_known_boat_turns_in_little_more_than_the_least_time(name: str) -> None:
    boat = turns.BOATS[name]
    least = turns.quickest(boat)
    found = turns.turned(boat, 1.0, 0.3, 2.0 * least)
    assert found.overshoot_deg < 1.0
    assert found.settling_s < SLOWEST[name] * least


@pytest.mark.parametrize(("name", "gain_factor"), [("lanxin", 0.7), ("lanxin", 1.3), ("esso", 0.7), ("unstable", 0.7)])
def test_a_rudder_other_than_the_models_by_a_third_leads_past_by_little(name: str, gain_factor: float) -> None:
    boat = turns.BOATS[name]
    found = turns.turned(boat, gain_factor, 0.3, 2.5 * turns.quickest(boat))
    assert found.overshoot_deg < 3.0
    assert found.settling_s < math.inf


def test_a_course_unstable_boat_is_led_as_she_has_shown_to_answer() -> None:
    model, rudder = turns.BOATS["unstable"].model, math.radians(15.0)
    careful = turn_limits(model, math.radians(30.0), math.radians(5.0), 0.7)

    def seen(factor: float) -> VirtualBoat:
        boat = VirtualBoat(0.0, 0.05, rudder)
        for _ in range(200):
            boat = watched(model, boat, factor * rudder, 0.05)
        return boat

    begun, known, weaker = (paced(model, careful, boat) for boat in (VirtualBoat(0.0), seen(1.0), seen(1.0 / 0.7)))
    assert begun.rate_max == pytest.approx(careful.rate_max)
    assert known.rate_max > 1.1 * careful.rate_max
    assert weaker.rate_max == pytest.approx(careful.rate_max)
    needed = [
        rudder_for(model, 0.05, reference_of(model, careful, seen(factor)).acceleration) / rudder
        for factor in (0.2, 1.0, 1.3, 4.0)
    ]
    assert needed[0] == pytest.approx(0.7)
    assert needed[1] == pytest.approx(1.0)
    assert 1.2 < needed[2] < 1.3
    assert needed[3] == pytest.approx(1.0 / 0.7)
