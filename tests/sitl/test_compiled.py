"""Compiled by numba, the product's functions give the numbers of the plain ones."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from naval_vessel import InverseMass, inverse_mass, motion_step

from autopilot.angles import wrap
from autopilot.control.rudder_roll import (
    UNPROVEN,
    Motion,
    Proof,
    RollSchedule,
    ScheduleParts,
    begin_schedule,
    linear_step_of,
    proof_step,
    schedule_step,
)
from autopilot.control.sliding_roll import RollNumbers
from autopilot.errors import InputError
from autopilot.models.steering_gear import SteeringGear, gear_step
from autopilot.runtime.build import law_of
from autopilot.vessel.file import load_vessel
from sitl.compiled import compiled, is_kept
from sitl.roll_ship import NAVAL_HULL, NAVAL_RUDDERS, SERVICE_SPEED, Hull, Load, Rudders, rudder_load


def voyage(hull: Hull, inverse: InverseMass, rudders: Rudders, gear: SteeringGear, steps: int) -> Motion:
    """A weaving ship in a swell, through the functions of the models."""
    state, rudder = Motion(0.1, 0.0, 0.0, 0.05, 0.0), 0.0
    for index in range(steps):
        rudder = gear_step(gear, rudder, 0.4 * math.sin(0.02 * index) - state.psi, 0.05)
        push = rudder_load(rudders, SERVICE_SPEED, rudder)
        swell = Load(push.Y, push.K + 3.0e5 * math.sin(0.05 * index), push.N)
        state = motion_step(hull, inverse, SERVICE_SPEED, state, swell, 0.05)
    return state


def test_compiled_motion_gives_the_plain_numbers_to_a_billionth() -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    gear = SteeringGear(math.radians(40.0), math.radians(20.0), 0.1)
    given = (NAVAL_HULL, inverse_mass(NAVAL_HULL), NAVAL_RUDDERS, gear, 2000)
    plain, quick = voyage(*given), compiled(voyage)(*given)
    assert abs(plain.phi) > 1e-3
    np.testing.assert_allclose(quick, plain, rtol=1e-9, atol=1e-12)


def proved(proof: Proof, steps: int) -> Proof:
    """The roll law weighed, proved, and barred where it falls short, by a roll that does not lessen."""
    for index in range(steps):
        weight = 1.0 if index > steps // 3 else 0.0
        proof = proof_step(proof, weight, 0.1 * math.sin(0.4 * index), 0.5, 1.0, 10.0)
    return proof


def scheduled(parts: ScheduleParts, schedule: RollSchedule, steps: int) -> RollSchedule:
    """A ship that rolls by itself, and the schedule that weighs the roll law meanwhile."""
    for index in range(steps):
        rolling = Motion(0.0, 0.11 * math.cos(1.1 * 0.05 * index), 0.0, 0.1 * math.sin(1.1 * 0.05 * index), 0.0)
        schedule = schedule_step(parts, schedule, rolling, 0.0, 0.0, 0.05)
    return schedule


def test_the_compiled_roll_schedule_gives_the_plain_numbers() -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    _, numbers = law_of(load_vessel("naval_vessel"))
    assert isinstance(numbers, RollNumbers)
    gear = SteeringGear(math.radians(40.0), math.radians(20.0), 0.1)
    parts = ScheduleParts(
        numbers.settings, numbers.here.quiet, numbers.here.roll, gear, linear_step_of(numbers.here.model, 0.05)
    )
    plain, quick = (one(parts, begin_schedule(), 2400) for one in (scheduled, compiled(scheduled)))
    assert plain.weight > 0.0
    np.testing.assert_allclose(quick.roll.response, plain.roll.response, rtol=1e-9, atol=1e-12)
    assert quick.strength == pytest.approx(plain.strength) and quick.weight == pytest.approx(plain.weight)


def test_the_compiled_roll_proof_gives_the_plain_numbers() -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    plain, quick = proved(UNPROVEN, 3000), compiled(proved)(UNPROVEN, 3000)
    assert plain.failures > 0
    np.testing.assert_allclose(quick.under, plain.under, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(quick.without, plain.without, rtol=1e-9, atol=1e-12)
    assert quick[2:] == pytest.approx(plain[2:])


def twice(step: Callable[[float], float]) -> Callable[[float], float]:
    def both(angle: float) -> float:
        return step(step(angle))

    return both


def test_what_a_function_was_made_with_is_compiled_too() -> None:
    """A plant's step is made with its own forces."""
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    assert compiled(twice(wrap))(4.0) == pytest.approx(4.0 - math.tau, rel=1e-12)


def test_without_numba_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(InputError, match=r"'\.\[fast\]'"):
        compiled(voyage)


def test_another_process_finds_the_compiled_code_on_disk() -> None:
    pytest.importorskip("numba")
    program = "from sitl.campaign.work import compiled_loop; print(compiled_loop('backstepping').stats.cache_path)"
    folders = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for seed in ("1", "2", "3")
    }
    assert len(folders) == 1


def test_where_nobody_has_a_home_it_is_compiled_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("numba", reason="the extra `fast` is not installed")
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr(Path, "home", homeless)
    ready = compiled(wrap, quick=True)
    assert not is_kept(ready)
    assert ready(4.0) == pytest.approx(4.0 - math.tau, rel=1e-12)


def homeless() -> Path:
    """What Python does for a user without HOME and without a line in /etc/passwd, as in a container."""
    raise RuntimeError("Could not determine home directory.")
