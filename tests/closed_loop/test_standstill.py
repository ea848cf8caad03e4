"""A pilot that stood still, its process stopped or its computer suspended, for longer than the vehicle waits."""

from __future__ import annotations

import dataclasses
import math
import time
from pathlib import Path
from typing import Any

import pytest
from lockstep import STEP, Lockstep, stick_follows

from autopilot.control.registry import TRIAL_LAW
from autopilot.runtime.machine import MonotonicClock
from autopilot.runtime.record import replay
from autopilot.signals import Mode
from autopilot.vessel.file import load_vessel

METHODS = ["rc_override", "manual_control", "guided"]
GAINS = {"ATC_STR_RAT_FF": 12.0, "ATC_STR_RAT_P": 1.0, "ATC_STR_RAT_I": 1.0, "ATC_STR_ANG_P": 1.0}


def engaged(method: str, log: Path | None = None, override_time: float = 3.0) -> Lockstep:
    boat = load_vessel("lanxin")
    helm = dataclasses.replace(boat.helm, method=method)  # type: ignore[arg-type]
    guided = method == "guided"
    found = Lockstep(
        dataclasses.replace(boat, helm=helm),
        law=TRIAL_LAW if guided else None,
        vehicle={"mode": "GUIDED" if guided else "MANUAL"},
        parameters={**GAINS, "RC_OVERRIDE_TIME": override_time},
        log=log,
    )
    if guided:
        found.hooks.append(stick_follows)
    found.engage(40.0)
    assert found.run(9.0, until=found.engaged)
    found.run(6.0)
    assert found.tick.mode is Mode.ENGAGED
    return found


def stand_still(boat: Lockstep, seconds: float, is_suspended: bool = False, stick_us: int = 1700) -> None:
    """The vehicle goes on, with a hand on its stick; what it says waits on the line, or finds nobody there."""
    boat.firmware.sticks[0] = stick_us
    for _ in range(round(seconds / STEP)):
        boat.clock.time = round(boat.clock.time + STEP, 9)
        boat.carry(boat.now)
        if is_suspended:
            boat.near.receive()


def alarms_of(ticks: Any) -> set[str]:
    return {alarm.name for tick in ticks for alarm in tick.alarms}


@pytest.mark.parametrize("is_suspended", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_the_helm_is_not_taken_again_and_nobody_is_accused(method: str, is_suspended: bool, tmp_path: Path) -> None:
    boat = engaged(method, log=tmp_path / "a.tlog")
    boat.ticks.clear()
    stand_still(boat, 4.1, is_suspended)
    assert not boat.firmware.overrides.active(boat.now, 3.0)
    boat.run(4.0)
    assert {tick.mode for tick in boat.ticks} == {Mode.OVERRIDE}
    assert alarms_of(boat.ticks) == {"stood_still"}
    assert not boat.firmware.overrides.active(boat.now, 3.0)
    boat.firmware.sticks[0] = 1500
    boat.engage(60.0)
    assert boat.run(9.0, until=boat.engaged), "a new order engages"
    boat.session.close()
    assert replay(tmp_path / "a.tlog").identical


@pytest.mark.parametrize("method", METHODS)
def test_what_the_vehicle_bears_ends_nothing(method: str) -> None:
    boat = engaged(method)
    boat.ticks.clear()
    stand_still(boat, 2.7, stick_us=1500)
    boat.run(4.0)
    assert {tick.mode for tick in boat.ticks} == {Mode.ENGAGED}


def test_the_vehicles_own_time_counts() -> None:
    boat = engaged("rc_override", override_time=1.0)
    stand_still(boat, 1.5)
    boat.run(0.1)
    assert (boat.tick.mode, alarms_of([boat.tick])) == (Mode.OVERRIDE, {"stood_still"})


def test_a_vehicle_that_ran_for_less_than_the_standstill_has_not_rebooted() -> None:
    boat = engaged("rc_override")
    boat.ticks.clear()
    stand_still(boat, boat.now + 5.0)
    boat.run(4.0)
    assert alarms_of(boat.ticks) == {"stood_still"}
    assert not any("rebooted" in getattr(sample, "reason", "") for tick in boat.ticks for sample in tick.samples)


def test_the_clock_goes_on_while_the_machine_is_suspended(monkeypatch: pytest.MonkeyPatch) -> None:
    clock, real = MonotonicClock(2.0), time.clock_gettime
    slept = {time.CLOCK_BOOTTIME: 30.0}
    monkeypatch.setattr(time, "clock_gettime", lambda which: real(which) + slept.get(which, 0.0))
    assert math.floor(clock.now()) >= 60
