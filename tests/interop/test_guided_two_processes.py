"""`autopilot run --steer guided` and `sitl serve` as two processes, and a ground station on a line of its own."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from alarm_texts import words_of
from pymavlink import mavutil
from two_processes import (
    PATIENCE_S,
    free_port,
    patient_vessel,
    provoke,
    sailed_for,
    simulator,
    wait_until_engaged,
)

from autopilot.angles import wrap
from autopilot.runtime.record import read_log
from autopilot.signals import Mode

SPEEDUP = 2
GAINS = {"ATC_STR_RAT_FF": 12.0, "ATC_STR_RAT_P": 1.0, "ATC_STR_RAT_I": 1.0, "ATC_STR_ANG_P": 1.0}


def pilot(*arguments: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "autopilot", "run", *arguments, "--speedup", str(SPEEDUP), "--steer", "guided"]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True
    )


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, err = process.communicate(timeout=60.0)
    assert "Traceback" not in err
    return process.returncode, err


class Station:
    """A ground station of pymavlink's own."""

    def __init__(self, port: int) -> None:
        self.line = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255)

    def tune(self) -> None:
        assert self.line.wait_heartbeat(timeout=60) is not None
        for name, value in GAINS.items():
            wanted, end = f"PARAM_VALUE.param_id=='{name}'", time.monotonic() + PATIENCE_S
            answer = None
            while answer is None:  # asked for again: what a full buffer of ours has dropped is not sent twice
                assert time.monotonic() < end, name
                self.line.param_set_send(name, value)
                answer = self.line.recv_match(type="PARAM_VALUE", condition=wanted, blocking=True, timeout=2)

    def set_mode(self, number: int) -> None:
        self.line.set_mode(number)

    def hand_over(self, run: subprocess.Popen[str]) -> None:
        """The boat makes way in MANUAL; as soon as the pilot waits for GUIDED, it gets it."""
        assert run.stdout is not None
        while "switch it to GUIDED" not in run.stdout.readline():
            assert run.poll() is None
        self.set_mode(15)


@pytest.fixture
def station() -> Iterator[tuple[Station, int]]:
    port = free_port()
    found = Station(port)
    yield found, port
    found.line.close()


def test_a_heading_is_changed_and_held_by_the_firmware(tmp_path: Path, station: tuple[Station, int]) -> None:
    port, log, truth = free_port(), tmp_path / "run.tlog", tmp_path / "truth.csv"
    with simulator(
        SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--mavlink",
        f"udpout:127.0.0.1:{station[1]}", "--truth", str(truth),
    ):  # fmt: skip
        station[0].tune()
        run = pilot(
            str(patient_vessel(tmp_path)), "--link", f"udpin:127.0.0.1:{port}", "--engage", "60", "--duration", "24",
            "--log", str(log),
        )  # fmt: skip
        station[0].hand_over(run)
        assert finish(run) == (0, "")
        last = sailed_for(truth, 6.0)
    ticks = read_log(log).ticks
    assert ticks[-1].mode is Mode.ENGAGED
    late = [abs(wrap(tick.state.heading - math.radians(60.0))) for tick in ticks if tick.now > ticks[-1].now - 2.0]
    assert math.degrees(max(late)) < 2.0
    command = [sys.executable, "-m", "autopilot", "replay", str(log)]
    replayed = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert "every command identical" in replayed.stdout
    assert abs(math.degrees(last["rudder_rad"])) < 1.0, "without targets the firmware stops steering"
    assert last["speed_m_s"] < 4.3, "and stops the boat"


def test_the_human_s_change_of_mode_takes_the_helm(tmp_path: Path, station: tuple[Station, int]) -> None:
    port, log = free_port(), tmp_path / "run.tlog"
    with simulator(
        SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--mavlink",
        f"udpout:127.0.0.1:{station[1]}",
    ):  # fmt: skip
        station[0].tune()
        run = pilot(
            str(patient_vessel(tmp_path)), "--link", f"udpin:127.0.0.1:{port}", "--engage", "60", "--duration", "15",
            "--log", str(log),
        )  # fmt: skip
        station[0].hand_over(run)
        wait_until_engaged(run)
        station[0].set_mode(0)
        assert finish(run) == (0, "")
    last = read_log(log).ticks[-1]
    assert last.mode is Mode.OVERRIDE
    assert "mode MANUAL" in words_of(last)[0]


def test_a_line_that_falls_silent_is_an_override_and_a_link_error(tmp_path: Path, station: tuple[Station, int]) -> None:
    port, control, log = free_port(), free_port(), tmp_path / "run.tlog"
    with simulator(
        SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--mavlink", f"udpout:127.0.0.1:{station[1]}",
        "--control", f"127.0.0.1:{control}"
    ):  # fmt: skip
        run = pilot(
            str(patient_vessel(tmp_path)), "--link", f"udpin:127.0.0.1:{port}", "--engage", "60", "--duration", "120",
            "--log", str(log),
        )  # fmt: skip
        assert station[0].line.wait_heartbeat(timeout=60) is not None
        station[0].hand_over(run)
        wait_until_engaged(run)
        provoke(control, "silence")
        code, err = finish(run)
    assert code == 3
    assert "no heading has come" in err
    ticks = read_log(log).ticks
    assert any(tick.mode is Mode.ENGAGED for tick in ticks)
    assert ticks[-1].mode is Mode.OVERRIDE


def test_the_firmware_s_controller_and_a_law_of_ours_exclude_each_other() -> None:
    code, err = finish(pilot("lanxin", "--link", f"udpin:127.0.0.1:{free_port()}", "--law", "pid"))
    assert code == 2
    assert "leave --law out" in err


def test_the_wrong_mode_is_refused_with_what_to_do(tmp_path: Path) -> None:
    port = free_port()
    with simulator(SPEEDUP * 2, "--mavlink", f"udpout:127.0.0.1:{port}"):
        run = pilot(
            str(patient_vessel(tmp_path)), "--link", f"udpin:127.0.0.1:{port}", "--engage", "90", "--duration", "9"
        )
        code, err = finish(run)
    assert code == 4
    assert "switch it to GUIDED" in err
