"""What the doctor says of machines and links that are well, and of those that are not."""

from __future__ import annotations

import json
import math
import os
import random
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from lockstep import STEP, BadLine, Lockstep

from autopilot.cli.main import main
from autopilot.doctor import machine
from autopilot.doctor import machine as system
from autopilot.doctor.machine import Finding, Verdict, worst
from autopilot.doctor.vehicle import Received, examine, gyro_findings, judged
from autopilot.firmware.file import load_firmware, wanted_parameters
from autopilot.links.base import Link, LinkError
from autopilot.vessel.file import load_vessel

VESSEL = load_vessel("lanxin")


class Machine:
    """A clock whose sleeps last a little longer than asked."""

    def __init__(self, *late: float) -> None:
        self.time, self.late, self.slept = 0.0, late, 0

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        self.time += seconds + self.late[self.slept % len(self.late)]
        self.slept += 1


@pytest.mark.parametrize(
    ("late", "verdict", "found"),
    [
        ([0.0001], Verdict.GO, "99 % within 0.10 ms, worst 0.10 ms, of 50 ms"),
        ([0.0001] * 500 + [0.03], Verdict.WARN, "99 % within 0.10 ms, worst 30.00 ms, of 50 ms"),
        ([0.0001] * 40 + [0.03], Verdict.NO_GO, "99 % within 30.00 ms, worst 30.00 ms, of 50 ms"),
    ],
)
def test_late_wake_ups_are_measured(late: list[float], verdict: Verdict, found: str) -> None:
    slow = Machine(*late)
    finding = machine.wake_up(20.0, 60.0, slow.now, slow.sleep)
    assert (finding.verdict, finding.found) == (verdict, found)
    assert slow.slept == 1200


@pytest.mark.parametrize(
    ("said", "found"),
    [
        ("T: 0 ( 99) P: 0 I:1000 C: 1000 Min: 55 Act: 60 Avg: 62 Max: 4690\n", "mean 0.06 ms, worst 4.69 ms of 1 ms"),
        ("Unable to change scheduling policy!\n", "says: Unable to change scheduling policy!"),
        ("", "says: nothing"),
    ],
)
def test_cyclictest_is_read(said: str, found: str) -> None:
    assert machine._of_cyclictest(said).found == found


@pytest.mark.parametrize(
    ("word", "verdict", "found"),
    [
        ("throttled=0x0\n", Verdict.GO, "never undervoltage, never slowed down"),
        ("throttled=0x50005\n", Verdict.NO_GO, "undervoltage now"),
        ("0x4", Verdict.WARN, "the processor is slowed down now"),
        ("50000", Verdict.WARN, "undervoltage since the last boot"),
        ("0x80000", Verdict.WARN, "slowed down since the last boot"),
    ],
)
def test_the_supply_of_a_raspberry_pi(word: str, verdict: Verdict, found: str) -> None:
    finding = machine.supply(word)
    assert finding is not None
    assert (finding.verdict, finding.found) == (verdict, found)


def test_memory_clock_heat_and_watchdog(tmp_path: Path) -> None:
    assert machine.memory("MemTotal: 512000 kB\nMemAvailable:  300000 kB\n").verdict is Verdict.GO
    assert machine.memory("MemAvailable:   90000 kB\n").verdict is Verdict.NO_GO
    assert machine.memory("nonsense").verdict is Verdict.WARN
    assert machine.clock_kept(0).verdict is Verdict.GO
    assert machine.clock_kept(5).verdict is Verdict.WARN
    zone = tmp_path / "temp"
    assert machine.temperature(zone) is None
    zone.write_text("84500\n")
    assert machine.temperature(zone) == Finding(
        "temperature", Verdict.WARN, "84 C", "shade, air or a heat sink", {"celsius": 84.5}
    )
    assert machine.hardware_watchdog(zone).verdict is Verdict.GO
    assert machine.hardware_watchdog(tmp_path / "none").verdict is Verdict.WARN


def test_the_doctor_rates_disks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert system.disk(tmp_path / "none").verdict is Verdict.NO_GO
    assert list(tmp_path.iterdir()) == []
    monkeypatch.setattr(system, "_written", lambda _: (0.3, 2.0))
    assert "0.3 MB/s flushed, longest write 2000 ms" in system.disk(tmp_path).found
    assert system.disk(tmp_path).verdict is Verdict.WARN
    monkeypatch.setattr(system, "GOOD_FREE_MB", math.inf)
    monkeypatch.setattr(system, "LEAST_FREE_MB", math.inf)
    assert system.disk(tmp_path).verdict is Verdict.NO_GO


def test_the_doctor_rates_serial_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert system.serial_lines([]).found == "none plugged in"
    line = tmp_path / "ttyUSB0"
    line.touch()
    assert system.serial_lines([line]).verdict is Verdict.GO
    monkeypatch.setattr(os, "access", lambda *_: False)
    finding = system.serial_lines([line])
    assert finding.verdict is Verdict.WARN
    assert "usermod -aG dialout" in finding.cure


def test_old_and_missing_libraries(monkeypatch: pytest.MonkeyPatch) -> None:
    assert system.versions().verdict is Verdict.GO
    monkeypatch.setattr(system, "NEEDED", {"pymavlink": "999.0", "no-such-library": "1.0"})
    finding = system.versions()
    assert finding.verdict is Verdict.NO_GO
    assert finding.cure.startswith("pymavlink 999.0 or newer is needed; no-such-library is missing:")


class Listening:
    """The clock of `listen` in lockstep with the vehicle on the other end of the link."""

    def __init__(self, run: Lockstep) -> None:
        self._run = run

    def now(self) -> float:
        return self._run.now

    def wait(self, descriptors: Sequence[int], until: float) -> None:
        self._run.clock.time = round(self._run.now + STEP, 9)
        self._run.carry(self._run.now)


def listened(line: BadLine | None = None, seconds: float = 12.0) -> tuple[list[Finding], Lockstep]:
    run = Lockstep(VESSEL, lines=(BadLine(), line or BadLine()))
    return examine(lambda: [run.link], Listening(run), seconds, VESSEL.failsafe.heading_timeout_s), run


def test_a_vehicle_that_is_well() -> None:
    findings, run = listened()
    by_name = {finding.name.split()[0]: finding for finding in findings}
    assert by_name["heading"].figures["rate_hz"] == pytest.approx(20.0, rel=0.3)
    assert by_name["heading"].figures["longest_gap_ms"] < 300.0
    assert by_name["helm"].found.endswith("obeys us")
    assert worst(findings) is Verdict.WARN, "by the firmware's defaults"
    # looked at, never steered
    assert run.world.boat.state.rudder == pytest.approx(0.0, abs=1e-3)
    assert not run.firmware.overrides.active(run.now + 1.0, 3.0)


class DeafAtFirst(BadLine):
    """Nothing gets through in the first seconds, as before the vehicle's first heartbeat."""

    def put(self, now: float, data: bytes) -> None:
        if now > 1.5:
            super().put(now, data)


def test_headings_before_the_vehicle_was_asked_are_not_judged() -> None:
    run = Lockstep(VESSEL, parameters={"SR0_EXTRA1": 1.0}, lines=(DeafAtFirst(), BadLine()))
    findings = examine(lambda: [run.link], Listening(run), 8.0, VESSEL.failsafe.heading_timeout_s)
    (heading,) = [finding for finding in findings if finding.name.startswith("heading")]
    assert heading.verdict is Verdict.GO, heading
    assert heading.figures["longest_gap_ms"] < 300.0


def test_a_line_that_loses_nearly_all_is_no_go() -> None:
    findings, _ = listened(BadLine(seed=1, loss=0.985), 60.0)
    assert worst(findings) is Verdict.NO_GO


def test_a_silent_line_is_no_go() -> None:
    (finding,) = [each for each in listened(BadLine(loss=1.0), 5.0)[0] if each.name == "heading"]
    assert (finding.verdict, finding.found) == (Verdict.NO_GO, "none came in 5 s")


def test_a_helm_that_is_refused_is_no_go_with_its_reason() -> None:
    received = Received(
        {"a": [0.1 * n for n in range(50)]}, {"a": [0.01] * 50}, {"a": "the vehicle is not armed"}, {}, 5.0, {}, {}
    )
    helm = judged(received, 1.0)[1]
    assert (helm.verdict, helm.found) == (Verdict.NO_GO, "a: the vehicle is not armed")


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"vehicle": {"armed": False}}, "disarmed"),
        ({"vehicle": {"mode": "HOLD"}}, "in mode HOLD"),
        ({"settings": {"as_gcs": False}}, "--as-gcs"),
        ({"parameters": {"RC_OVERRIDE_TIME": 0.0}}, "RC_OVERRIDE_TIME"),
    ],
)
def test_a_vehicle_that_refuses_the_helm_is_no_go(wrong: dict[str, Any], reason: str) -> None:
    run = Lockstep(VESSEL, **wrong)
    findings = examine(lambda: [run.link], Listening(run), 12.0, VESSEL.failsafe.heading_timeout_s)
    (helm,) = [finding for finding in findings if finding.name == "helm"]
    assert helm.verdict is Verdict.NO_GO
    assert reason in helm.found


SHIPPED = {wanted.name: float(wanted.value) for wanted in wanted_parameters(load_firmware("ardurover-boat"))}


@pytest.mark.parametrize(
    ("parameters", "name", "verdict", "word"),
    [
        ({}, "arming", Verdict.WARN, "ARMING_RUDDER 2"),
        ({"ARMING_RUDDER": 1}, "arming", Verdict.GO, "arms a boat"),
        ({"ARMING_RUDDER": 0}, "arming", Verdict.GO, "neither"),
        ({"FS_GCS_ENABLE": 1}, "station fail-safe", Verdict.WARN, "5 s"),
        ({}, "station fail-safe", Verdict.GO, "off"),
        ({"FS_THR_ENABLE": 0}, "radio fail-safe", Verdict.WARN, "nobody notices"),
        ({"RC_OPTIONS": 4}, "radio fail-safe", Verdict.WARN, "bit 2"),
        ({}, "radio fail-safe", Verdict.GO, "910 us"),
        ({"FS_ACTION": 0}, "fail-safe action", Verdict.WARN, "FS_ACTION 0"),
        ({}, "taking over", Verdict.WARN, "steering stick does nothing"),
        ({"RC7_OPTION": 46}, "taking over", Verdict.GO, "channel 7"),
        ({"RC_OPTIONS": 1 << 14}, "taking over", Verdict.WARN, "only a reboot"),
        ({"RC_OPTIONS": 1 << 14, "RC7_OPTION": 46}, "taking over", Verdict.GO, "channel 7"),
        ({"RC_OPTIONS": 1}, "taking over", Verdict.WARN, "bit 0"),
        ({"RC_OPTIONS": 2}, "taking over", Verdict.NO_GO, "bit 1"),
        ({}, "stick", Verdict.GO, "PILOT_STEER_TYPE is 0"),
        ({"PILOT_STEER_TYPE": 1}, "stick", Verdict.NO_GO, "PILOT_STEER_TYPE is 1"),
        ({"PILOT_STEER_TYPE": 3}, "stick", Verdict.WARN, "PILOT_STEER_TYPE is 3"),
        ({"MANUAL_OPTIONS": 1}, "stick", Verdict.NO_GO, "MANUAL_OPTIONS bit 0"),
    ],
)
def test_parameters_of_the_firmware_that_fight_us_are_named(
    parameters: dict[str, float], name: str, verdict: Verdict, word: str
) -> None:
    run = Lockstep(VESSEL, parameters=parameters)
    findings = examine(lambda: [run.link], Listening(run), 12.0, VESSEL.failsafe.heading_timeout_s, VESSEL)
    (finding,) = [finding for finding in findings if finding.name == name]
    assert finding.verdict is verdict, finding
    assert word in finding.found
    assert finding.cure or verdict is Verdict.GO


@pytest.mark.parametrize(
    ("servo_us", "ends", "verdict", "word"),
    [
        ((1000.0, 1500.0, 2000.0), (1000, 1500, 2000), Verdict.GO, "30 and 30 deg"),
        ((1000.0, 1500.0, 2000.0), (1100, 1500, 1900), Verdict.NO_GO, "24 and 24 deg"),
        ((1000.0, 1500.0, 2000.0), (1000, 1500, 1900), Verdict.NO_GO, "30 and 24 deg"),
        ((1100.0, 1500.0, 1900.0), (1100, 1500, 1900), Verdict.GO, "30 and 30 deg"),
        (None, (1100, 1500, 1900), Verdict.GO, "taken for 30 deg"),
        (None, (1100, 1450, 1900), Verdict.WARN, "350 us to one side and 450"),
    ],
)
def test_the_servo_s_end_points_are_held_against_the_vessel_file(
    servo_us: tuple[float, float, float] | None, ends: tuple[int, int, int], verdict: Verdict, word: str
) -> None:
    vessel = replace(VESSEL, helm=replace(VESSEL.helm, servo_us=servo_us))
    names = ("SERVO1_MIN", "SERVO1_TRIM", "SERVO1_MAX")
    run = Lockstep(vessel, parameters=dict(zip(names, ends, strict=True)))
    findings = examine(lambda: [run.link], Listening(run), 12.0, 1.0, vessel)
    (servo,) = [finding for finding in findings if finding.name == "servo"]
    (helm,) = [finding for finding in findings if finding.name == "helm"]
    assert servo.verdict is verdict, servo
    assert word in servo.found
    assert (helm.verdict is Verdict.NO_GO) is (verdict is Verdict.NO_GO), helm


def test_with_the_shipped_parameters_only_the_way_to_take_over_is_left_to_choose() -> None:
    run = Lockstep(VESSEL, parameters=SHIPPED)
    findings = examine(lambda: [run.link], Listening(run), 12.0, VESSEL.failsafe.heading_timeout_s)
    assert [finding.name for finding in findings if finding.verdict is not Verdict.GO] == ["taking over"]


def test_uneven_headings_are_reported_by_their_gaps() -> None:
    chance = random.Random(7)
    times = [0.1 * n + chance.uniform(0.0, 0.02) for n in range(100)]
    even = judged(Received({"a": times}, {"a": [0.0] * 100}, {}, {}, 10.0, {}, {}), 1.0)[0]
    assert even.verdict is Verdict.GO
    assert 1.0 < even.figures["jitter_ms"] < 21.0
    assert judged(Received({"a": [*times, 10.7]}, {"a": [0.0]}, {}, {}, 10.0, {}, {}), 1.0)[0].verdict is Verdict.WARN
    assert judged(Received({"a": [*times, 11.2]}, {"a": [0.0]}, {}, {}, 10.0, {}, {}), 1.0)[0].verdict is Verdict.NO_GO
    slow = judged(Received({"a": [0.0, 0.4, 0.8]}, {"a": [0.0]}, {}, {}, 10.0, {}, {}), 1.0)[0]
    assert slow.verdict is Verdict.WARN


def test_a_gyro_is_there_as_the_gains_were_designed_for_it_or_a_warning_says_what_to_do() -> None:
    alone = replace(VESSEL, sensors=replace(VESSEL.sensors, gyro=False))
    compass = Received({"HCHDT": [0.0, 0.1]}, {"HCHDT": [0.0]}, {}, {}, 10.0, {}, {})
    turning = compass._replace(turning={"TIROT": True})
    assert gyro_findings(turning, VESSEL) == gyro_findings(compass, alone) == []
    (missing,), (unused,) = gyro_findings(compass, VESSEL), gyro_findings(turning, alone)
    assert (missing.verdict, unused.verdict) == (Verdict.WARN, Verdict.WARN)
    assert "sensors.gyro: false" in missing.cure
    assert "TIROT" in unused.found
    assert "sensors.gyro: true" in unused.cure


def test_the_rate_of_turn_of_a_vehicle_is_heard() -> None:
    run = Lockstep(VESSEL)
    findings = examine(lambda: [run.link], Listening(run), 12.0, 1.0, VESSEL)
    assert "gyro" not in {finding.name for finding in findings}
    alone = replace(VESSEL, sensors=replace(VESSEL.sensors, gyro=False))
    run = Lockstep(VESSEL)
    findings = examine(lambda: [run.link], Listening(run), 12.0, 1.0, alone)
    assert "gyro" in {finding.name for finding in findings}


def test_links_that_cannot_be_opened_or_are_lost_are_no_go_with_the_cure() -> None:
    def missing() -> list[Link]:
        raise LinkError("serial:/dev/x:1: there is no device /dev/x; plug it in, or list the ports")

    run = Lockstep(VESSEL)
    assert examine(missing, Listening(run), 1.0, 1.0) == [
        Finding("link", Verdict.NO_GO, "serial:/dev/x:1: there is no device /dev/x", "plug it in, or list the ports")
    ]
    run.near.close()
    assert examine(lambda: [run.link], Listening(run), 1.0, 1.0)[0].verdict is Verdict.NO_GO


def test_the_command_says_go_and_no_go_and_exits_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    well = Finding("wake-up", Verdict.GO, "fine")
    monkeypatch.setattr(machine, "wake_up", lambda _: well)
    monkeypatch.setattr(machine, "cyclictest", lambda: Finding("cyclictest", Verdict.GO, "not installed"))
    assert main(["doctor", "lanxin", "--log-dir", str(tmp_path)]) == 0
    assert capsys.readouterr().out.splitlines()[0].startswith("GO")
    monkeypatch.setattr(machine, "wake_up", lambda _: well._replace(verdict=Verdict.NO_GO, cure="a quicker machine"))
    assert main(["doctor", "--log-dir", str(tmp_path), "--json"]) == 4
    report = json.loads(capsys.readouterr().out)
    assert report["verdict"] == "no go"
    assert {
        "name": "wake-up",
        "verdict": "no go",
        "found": "fine",
        "cure": "a quicker machine",
        "figures": {},
    } in report["findings"]
    assert main(["doctor", "--link", "udpin:127.0.0.1:0"]) == 2
    assert main(["doctor", "--seconds", "nan"]) == 2
