"""Every vessel file that comes with the product can be used: checked, designed for, and sailed on its own plant."""

from __future__ import annotations

import dataclasses
import math

import pytest
from lockstep import Lockstep

from autopilot.angles import wrap
from autopilot.cli.main import main
from autopilot.signals import Mode
from autopilot.vessel.file import PUBLISHED, load_vessel, shipped_vessels
from sitl.registry import PLANTS
from sitl.scenario import load_scenario
from sitl.serve import afloat

PAPER = "lanxin_paper_gains"
"""A reproduction that is not meant to steer: `docs/papers.md`."""
STEERED = [name for name in shipped_vessels() if name != PAPER]
LEAST_S, TIME_CONSTANTS = 40.0, 6.0


@pytest.mark.parametrize("name", shipped_vessels())
def test_params_check_takes_the_file(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["params", "check", name]) == 0, capsys.readouterr()


@pytest.mark.parametrize("name", STEERED)
def test_gains_are_designed_for_the_file(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["gains", name]) == 0, capsys.readouterr()


@pytest.mark.parametrize("name", [name for name in STEERED if name not in PLANTS])
def test_the_boat_turns_to_a_course_and_keeps_it(name: str) -> None:
    vessel = load_vessel(name)
    scenario = afloat(name, load_scenario("calm"))
    if vessel.drive.kind == "two_thrusters":
        scenario = dataclasses.replace(scenario, plant="twin_thruster")  # the flight controller's outputs go with it
    boat = Lockstep(vessel, scenario=scenario, measured_every=4)
    boat.engage(10.0)
    assert boat.run(10.0, until=boat.engaged)
    boat.run(max(LEAST_S, TIME_CONSTANTS * vessel.model.T_s))
    assert boat.tick.mode is Mode.ENGAGED
    assert abs(wrap(math.radians(10.0) - boat.world.boat.state.heading)) < math.radians(2.0)


def test_ten_boats_are_real_or_published_and_say_where_they_are_from() -> None:
    assert len(PUBLISHED) >= 10
    for name in PUBLISHED:
        vessel = load_vessel(name)
        assert vessel.length_m, name
        assert vessel.model.source, name
        assert vessel.model.date, name
