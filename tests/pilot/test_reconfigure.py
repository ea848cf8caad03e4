"""Numbers changed while the pilot steers: no bump, nothing forgotten, and what would harm is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autopilot.errors import InputError
from autopilot.pilot import Pilot
from autopilot.runtime.build import build_pilot, law_of, pilot_config
from autopilot.runtime.build_links import refuse_failsafe
from autopilot.runtime.vessel_store import VesselStore, tuned_file
from autopilot.signals import HeadingSample, Mode, Order, OrderKind, RudderCommand, RudderSample
from autopilot.vessel.file import load_vessel, parse_vessel
from autopilot.vessel.schema import Limits, Vessel

FILED = load_vessel("lanxin")
LANXIN = replace(FILED, alarms=replace(FILED.alarms, frozen_heading=False))
"""The boats of these tests lie still with the rudder over: nobody may take that for a frozen compass."""
RATE = math.radians(LANXIN.rudder.rate_max_deg_s or math.inf)


def steered(law: str, seconds: float, heading: float = 1.0) -> Pilot:
    """A pilot in a turn: the boat lies still, so that the rudder is well over."""
    pilot = build_pilot(LANXIN, law)
    for step in range(1, round(seconds / 0.05)):
        now = 0.05 * step
        pilot.step(now, (HeadingSample(now, 0.0, 0.0),), Order(OrderKind.HEADING, heading, serial=1))
    assert pilot.mode is Mode.ENGAGED
    return pilot


def after(pilot: Pilot, now: float, heading: float = 1.0) -> RudderCommand:
    return pilot.step(now, (HeadingSample(now, 0.0, 0.0),), Order(OrderKind.HEADING, heading, serial=1)).command


@pytest.mark.parametrize("law", ["backstepping", "pid"])
@settings(deadline=None, max_examples=25)
@given(st.floats(0.3, 3.0), st.floats(0.3, 2.0), st.floats(0.0, 3.0))
def test_a_change_moves_the_rudder_no_faster_than_its_limit(law: str, k1: float, share: float, seconds: float) -> None:
    pilot = steered(law, 0.3 + seconds)
    control = LANXIN.control
    assert control.backstepping is not None and control.pid is not None
    changed = replace(
        LANXIN,
        control=replace(
            control,
            backstepping=replace(control.backstepping, k1_1_s=k1),
            pid=replace(control.pid, kp=share * control.pid.kp),
        ),
    )
    before, now = pilot.last_command, 0.3 + seconds + 0.05
    pilot.reconfigure(pilot_config(changed), law_of(changed, law))
    assert pilot.last_command == before
    command = after(pilot, now)
    assert pilot.mode is Mode.ENGAGED
    assert abs(command.angle - before.angle) <= RATE * 0.5 + 1e-9


def test_the_pid_keeps_its_rudder_through_a_change_of_its_gain() -> None:
    pilot = steered("pid", 60.0, heading=0.02)
    before = after(pilot, 60.05, 0.02).angle
    control = LANXIN.control
    assert control.pid is not None and abs(before) > 0.01
    changed = replace(LANXIN, control=replace(control, pid=replace(control.pid, ki_1_s=0.5 * control.pid.ki_1_s)))
    pilot.reconfigure(pilot_config(changed), law_of(changed, "pid"))
    assert after(pilot, 60.10, 0.02).angle == pytest.approx(before, abs=0.02)


class Kept:
    def __init__(self) -> None:
        self.texts: list[str] = []

    def keep_vessel(self, text: str) -> None:
        self.texts.append(text)


def stored(pilot: Pilot, vessel: Vessel = LANXIN, law: str | None = None) -> tuple[VesselStore, list[tuple[Path, str]]]:
    saved: list[tuple[Path, str]] = []
    store = VesselStore(vessel, pilot, law, Path("x.tuned.yaml"), lambda path, text: saved.append((path, text)))
    store.log = Kept()
    return store, saved


def test_a_change_is_in_force_kept_and_logged() -> None:
    pilot = build_pilot(LANXIN)
    store, saved = stored(pilot)
    assert store.set("BS_K1", 1.5) == ""
    assert store.get("BS_K1") == 1.5 and pilot.law.gains.gains.k1 == 1.5
    assert len(saved) == 1 and "k1_1_s: 1.5" in saved[0][1]
    assert isinstance(store.log, Kept) and store.log.texts == [saved[0][1]]
    assert store.set("BS_K1", 1.5) == "", "said twice by a ground station that heard no answer"
    assert len(saved) == 1


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("BS_K1", -1.0, "BS_K1 not changed: BS_K1 is -1, allowed"),
        ("BS_K1", math.nan, "not changed"),
        ("BS_K1", 500.0, "BS_K1 not changed: "),
        ("FS_ACTION", 7.0, "not changed"),
        ("FS_ACTION", 0.5, "not changed"),
    ],
)
def test_what_is_not_allowed_or_would_make_the_loop_unstable_is_refused(name: str, value: float, words: str) -> None:
    pilot = build_pilot(LANXIN)
    store, saved = stored(pilot)
    law = pilot.law
    old = store.get(name)
    assert words in store.set(name, value)
    assert store.get(name) == old and pilot.law is law and not saved


def test_limits_do_not_close_on_a_rudder_that_is_over() -> None:
    pilot = steered("backstepping", 3.0)
    assert abs(pilot.last_command.angle) > math.radians(10.0)
    store, saved = stored(pilot, replace(LANXIN, limits=Limits(angle_max_deg=25.0)))
    assert "the rudder stands further over now" in store.set("LIM_ANGLE_MAX", 5.0)
    assert not saved
    with pytest.raises(ValueError, match="outside the new limits"):
        narrow = replace(LANXIN, rudder=replace(LANXIN.rudder, angle_max_deg=5.0))
        pilot.reconfigure(pilot_config(narrow), law_of(narrow))


def test_what_links_were_opened_with_counts_from_the_next_start() -> None:
    store, saved = stored(build_pilot(LANXIN))
    assert store.set("CTL_RATE", 10.0) == "CTL_RATE counts from the next start on"
    assert store.get("CTL_RATE") == 10.0 and len(saved) == 1
    assert isinstance(store.log, Kept) and not store.log.texts


def test_the_law_that_waits_for_the_next_start_is_not_switched_by_the_next_change() -> None:
    pilot = steered("backstepping", 3.0)
    store, saved = stored(pilot)
    assert store.set("CTL_LAW", 1.0) == "CTL_LAW counts from the next start on"
    assert store.set("GUI_RUDDER_SHARE", 0.5) == ""
    assert pilot.law.name == "backstepping" and pilot.config.rudder_share == 0.5
    assert store.running.control.law == "backstepping" and store.stored.control.law == "pid"
    assert "law: pid" in saved[-1][1]
    assert isinstance(store.log, Kept) and "law: backstepping" in store.log.texts[-1], "a replay goes by what ran"


def test_a_law_without_gains_is_refused_at_once_and_not_at_the_next_start() -> None:
    store, saved = stored(build_pilot(LANXIN))
    assert "CTL_LAW not changed: vessel 'Lanxin" in store.set("CTL_LAW", 3.0)
    assert "no gains for the law 'sliding_roll'" in store.set("CTL_LAW", 3.0)
    assert store.get("CTL_LAW") == 0.0 and not saved


def test_a_run_with_another_law_leaves_the_file_s_own_startable() -> None:
    store, saved = stored(build_pilot(LANXIN, "pid"), law="pid")
    assert "BS_K1 not changed" in store.set("BS_K1", 500.0)
    assert not saved


def test_what_no_link_can_do_is_refused_at_once_and_not_at_the_next_start() -> None:
    def refuse(vessel: Vessel) -> None:
        refuse_failsafe(vessel, ["udpin:127.0.0.1:14550"])

    store = VesselStore(LANXIN, build_pilot(LANXIN), None, Path("x.tuned.yaml"), lambda *_: None, refuse)
    assert "failsafe.action windward needs a wind vane" in store.set("FS_ACTION", 4.0)
    assert store.set("FS_ACTION", 0.0) == "FS_ACTION counts from the next start on"


def test_gains_that_are_adopted_leave_what_waits_for_the_next_start() -> None:
    pilot = build_pilot(LANXIN)
    store, saved = stored(pilot)
    store.set("CTL_RATE", 10.0)
    control = store.stored.control
    assert control.backstepping is not None
    gains = replace(control.backstepping, k1_1_s=1.25)
    assert store.put(replace(store.stored, control=replace(control, backstepping=gains))) == ""
    assert pilot.law.gains.gains.k1 == 1.25 and store.running.control.rate_hz == LANXIN.control.rate_hz
    again = parse_vessel(saved[-1][1])
    assert again.control.rate_hz == 10.0 and again.control.backstepping == gains


def test_who_moves_the_rudder_stays_as_the_links_were_opened() -> None:
    guided = replace(LANXIN, helm=replace(LANXIN.helm, method="guided"))
    pilot = build_pilot(guided, "trial")
    pilot.reconfigure(pilot_config(LANXIN), law_of(LANXIN, "trial"))
    pilot.step(0.1, (HeadingSample(0.1, 0.0, 0.0),), Order(OrderKind.HEADING, 1.0, serial=1))
    assert pilot.mode is Mode.ENGAGED
    over = RudderSample(0.15, 0.3, ordered=True, source="servo_output_raw")
    for step in range(60):
        now = 0.2 + 0.05 * step
        heard = (HeadingSample(now, 0.0, 0.0), over._replace(time=now))
        tick = pilot.step(now, heard, Order(OrderKind.HEADING, 1.0, serial=1))
    assert abs(tick.state.rudder - 0.3) < 0.02, "what the firmware says, not what we would have commanded"


def test_a_change_that_cannot_be_kept_is_said() -> None:
    def full(path: Path, text: str) -> None:
        raise InputError("x.tuned.yaml: cannot be written (No space left on device)")

    store = VesselStore(LANXIN, build_pilot(LANXIN), None, Path("x.tuned.yaml"), full)
    assert "changed, but not kept: x.tuned.yaml" in store.set("BS_K1", 1.5)
    assert store.get("BS_K1") == 1.5


def test_the_tuned_file_lies_beside_its_origin() -> None:
    assert tuned_file("/boats/my.yaml") == Path("/boats/my.tuned.yaml")
    assert tuned_file("lanxin") == Path("lanxin.tuned.yaml")
