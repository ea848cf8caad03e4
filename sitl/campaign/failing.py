"""Failing instruments, tabled before a run begins: what their faults add, multiply and swallow, set by set.

Faults that keep an old value, and those of the boat itself, depend on how the run goes: the full simulator has them.
"""

from __future__ import annotations

import math

import numpy as np

from sitl.campaign.swift import NO_HEADING, NO_SPEED, Instruments
from sitl.fault_kinds import FaultKind
from sitl.faults import FaultBoard
from sitl.reading import Reading
from sitl.scenario import Scenario
from sitl.sensor_faults import SensorFaults
from sitl.world import STEP

TABLED: frozenset[FaultKind] = frozenset(
    {
        "silence",
        "heading_dropout",
        "heading_jump",
        "heading_drift",
        "heading_noise",
        "heading_spikes",
        "rate_bias",
        "rate_noise",
        "rate_reversed",
        "speed_lost",
        "speed_wrong",
    }
)
UNIT = Reading(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def can_be_tabled(scenario: Scenario) -> bool:
    """Return whether all faults of the scenario are known before it begins."""
    return all(fault.kind in TABLED for fault in scenario.faults)


def failing(instruments: Instruments, faults: FaultBoard, seed: np.random.SeedSequence) -> Instruments:
    """Return the instruments with these faults; `seed` is that of the sensors, from which their spoiler's comes."""
    spoiler, sets = SensorFaults(faults, seed.spawn(1)[0]), len(instruments.deviates)
    spoilt, missing = np.zeros((sets, 4)), np.zeros(sets, dtype=np.int64)
    lag = math.ceil(instruments.latency / STEP - 1.0e-7)
    for place in range(sets):
        step = place * instruments.every
        time, heard = step * STEP, (step + lag) * STEP
        # what is done to nothing, and to a speed of 1, is what is done to everything
        left = spoiler.spoil(time, UNIT)
        factor = -1.0 if faults.is_on("rate_reversed", time) else 1.0
        spoilt[place] = left.heading, factor, left.rate, left.water_speed
        is_silent = faults.is_on("silence", heard)
        if is_silent or faults.is_on("heading_dropout", heard):
            missing[place] |= NO_HEADING
        if is_silent or faults.is_on("speed_lost", heard):
            missing[place] |= NO_SPEED
    return instruments._replace(fails=True, spoilt=spoilt, missing=missing)
