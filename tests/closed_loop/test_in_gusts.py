"""Gusts in calm water: held sooner, taken for waves less, and forgotten when they are over."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import pytest
from boats import BOATS, vessel_of
from plant import Plant, sail

from autopilot.pilot import Pilot
from autopilot.runtime.build import gear_of, law_of, model_of, pilot_config
from autopilot.signals import Order, OrderKind, Tick
from autopilot.vessel.schema import Sensors

STEP, SECONDS = 0.05, 400.0
NORTH = Order(OrderKind.HEADING, 0.0, serial=1)


def gusts(deviation_deg: float, seed: int = 3, ends: float = math.inf) -> Callable[[float], float]:
    """Return wind as rudder [rad] that comes and goes in 10 s."""
    random, share, value, found = np.random.default_rng(seed), math.exp(-STEP / 10.0), 0.0, []
    for blow in random.standard_normal(round(SECONDS / STEP) + 2):
        value = share * value + math.radians(deviation_deg) * math.sqrt(1.0 - share * share) * blow
        found.append(value)
    return lambda time: found[int(time / STEP)] if time < ends else 0.0


def sailed(name: str, wind: Callable[[float], float], learns: bool = True) -> list[Tick]:
    vessel = dataclasses.replace(vessel_of(BOATS[name]), sensors=Sensors(heading_noise_deg=0.3, rate_noise_deg_s=0.2))
    config = pilot_config(vessel)
    if not learns:
        config = config._replace(noise=config.noise._replace(gusty_bias=config.noise.bias))
    pilot = Pilot(config, law_of(vessel))
    plant = Plant(model_of(vessel), gear_of(vessel), disturbance=wind, step_max=STEP)
    plant.heading_noise, plant.rate_noise = math.radians(0.3), None
    return sail(pilot, plant, NORTH, SECONDS, STEP, sense_every=2)


def rms_deg(ticks: list[Tick], since: float) -> float:
    errors = [tick.state.heading for tick in ticks if tick.now >= since]
    return math.degrees(math.sqrt(sum(error * error for error in errors) / len(errors)))


@pytest.mark.parametrize(("name", "share"), [("lanxin", 0.85), ("middle", 0.85), ("slow", 0.95)])
def test_gusts_are_held_better_by_who_has_learnt_them(name: str, share: float) -> None:
    wind = gusts(3.0)
    learnt, fixed = sailed(name, wind), sailed(name, wind, learns=False)
    assert rms_deg(learnt, 100.0) < share * rms_deg(fixed, 100.0)
    assert learnt[-1].state.wave_deviation < fixed[-1].state.wave_deviation, "they are taken for waves less"


def test_after_gusts_the_rudder_rests_as_before_them() -> None:
    def moved(wind: Callable[[float], float]) -> float:
        late = [tick.command.angle for tick in sailed("slow", wind) if tick.now > 350.0]
        return float(np.std(late))

    assert moved(gusts(3.0, ends=60.0)) < 1.5 * moved(lambda _: 0.0)
