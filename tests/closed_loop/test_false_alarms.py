"""What is no fault raises no alarm: waves that move a slow ship by themselves, and what an estimate overrates."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from boats import BOATS, Boat, vessel_of
from plant import Plant

from autopilot.angles import wrap
from autopilot.build import build_pilot
from autopilot.build_laws import gear_of, model_of
from autopilot.params.vessel import Vessel
from autopilot.signals import HeadingSample, Mode, Order, OrderKind

STEP = 0.1
SHIP = vessel_of(Boat(0.03, 100.0, 1.0e4, 1.0, 8.0, 2.5))
SLOW, QUICK = vessel_of(BOATS["slow"]), vessel_of(BOATS["middle"])
WAVES = ((0.55, 0.4), (0.7, 0.7), (0.9, 0.55))
"""Frequency of encounter [rad/s] and amplitude [deg]: 0.7 deg rms together."""


def yaw(time: float) -> tuple[float, float]:
    """Return what the waves alone move the hull by at `time` [s]: heading [rad] and rate [rad/s]."""
    heading = sum(math.radians(size) * math.sin(pace * time + pace) for pace, size in WAVES)
    return heading, sum(math.radians(size) * pace * math.cos(pace * time + pace) for pace, size in WAVES)


def sailed(
    vessel: Vessel, push: Callable[[float], float], seconds: float, course: Callable[[float], float] = lambda _: 0.0
) -> tuple[dict[str, float], float]:
    """Sail through the waves; return when each finding of the monitors first came [s], and the error then [deg]."""
    pilot = build_pilot(vessel)
    plant = Plant(model_of(vessel), gear_of(vessel), disturbance=push, step_max=0.5 * STEP)
    found: dict[str, float] = {}
    error = 0.0
    while plant.time < seconds and "overpowered" not in found:
        now, (moved, moves) = plant.time, yaw(plant.time)
        heading = HeadingSample(now, wrap(plant.heading + moved), plant.rate + moves, "compass")
        tick = pilot.step(now, (heading,), Order(OrderKind.HEADING, course(now), serial=1))
        assert tick.mode is Mode.ENGAGED, tick.alarms
        found = dict.fromkeys(pilot.monitors.findings, now) | found
        error = math.degrees(abs(wrap(plant.heading - course(now))))
        plant.step(tick.command.angle, STEP)
    return found, error


@pytest.mark.parametrize("vessel", [SLOW, SHIP], ids=["slow", "ship"])
def test_waves_that_move_a_slow_ship_are_no_push_on_her_rudder(vessel: Vessel) -> None:
    turns = (0.0, 0.5, 0.2, 1.0)
    found, _ = sailed(vessel, lambda _: 0.05, 1200.0, lambda now: turns[int(now / 300.0)])
    assert found == {}


@pytest.mark.parametrize(("vessel", "within"), [(QUICK, 15.0), (SLOW, 45.0), (SHIP, 100.0)])
@pytest.mark.parametrize("push_deg", [40.0, -60.0])
def test_a_push_heavier_than_the_rudder_is_told_in_waves(vessel: Vessel, within: float, push_deg: float) -> None:
    begins = 200.0
    found, off = sailed(vessel, lambda now: math.radians(push_deg) if now >= begins else 0.0, begins + within)
    assert begins <= found["overpowered"]
    assert off < 45.0


@pytest.mark.parametrize("vessel", [QUICK, SLOW, SHIP], ids=["quick", "slow", "ship"])
def test_a_gust_that_the_rudder_holds_is_none(vessel: Vessel) -> None:
    begins = 200.0
    found, _ = sailed(vessel, lambda now: math.radians(20.0) if now >= begins else 0.0, begins + 300.0)
    assert "overpowered" not in found
