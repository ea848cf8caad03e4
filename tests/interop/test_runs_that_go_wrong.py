"""Runs of two processes that something happens to: silence, a frozen compass, full disks, torn logs, strange hands."""

from __future__ import annotations

import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest
from two_processes import free_port, patient_vessel, provoke, simulator, wait_until_engaged

from autopilot.cli.main import main
from autopilot.runtime.record import read_log
from autopilot.runtime.tick_codec import encode_tick
from autopilot.signals import Mode, Order, OrderKind
from autopilot.vessel.file import load_vessel
from sitl import simulate

SPEEDUP = 2


@pytest.fixture
def vessel(tmp_path: Path) -> str:
    return str(patient_vessel(tmp_path))


def autopilot(*arguments: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, "-m", "autopilot", *arguments],
        stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert "Traceback" not in done.stderr
    return done


def assert_one_sentence(done: subprocess.CompletedProcess[str], code: int, *parts: str) -> None:
    assert done.returncode == code, done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    for part in parts:
        assert part in lines[0]


@pytest.mark.parametrize(
    ("fault", "code", "last", "part"),
    [
        ("heading_dropout", 5, Mode.FAILSAFE, "ended in fail-safe"),
        ("silence", 3, Mode.OVERRIDE, "udpin:127.0.0.1"),
    ],
)
def test_a_heading_that_stays_away_is_no_good_end(
    tmp_path: Path, vessel: str, fault: str, code: int, last: Mode, part: str
) -> None:
    port, control, log = free_port(), free_port(), tmp_path / "run.tlog"
    command = [sys.executable, "-m", "autopilot", "run", vessel, "--link", f"udpin:127.0.0.1:{port}", "--as-gcs"]
    command += ["--speedup", str(SPEEDUP), "--engage", "90", "--duration", "26", "--log", str(log)]
    with (
        simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", "--control", f"127.0.0.1:{control}"),
        subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as run,
    ):
        wait_until_engaged(run)
        provoke(control, fault)
        out, err = run.communicate(timeout=100.0)
    done = subprocess.CompletedProcess(command, run.returncode, out, err)
    assert_one_sentence(done, code, "heading", part)
    ticks = read_log(log).ticks
    modes = [tick.mode for tick in ticks]
    assert Mode.ENGAGED in modes
    assert modes[-1] is last
    assert ticks[-1].command.angle == 0.0
    assert autopilot("replay", str(log)).returncode == 0


def test_a_trial_is_identified_even_from_half_of_its_log(tmp_path: Path) -> None:
    log, zigzag = tmp_path / "trial.tlog", Order(OrderKind.ZIGZAG, rudder=0.26, heading_change=0.26, serial=1)
    simulate(load_vessel("lanxin"), lambda now, tick: zigzag, 30.0, log=log)
    whole = read_log(log).ticks
    torn = tmp_path / "torn.tlog"
    torn.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    kept = read_log(torn).ticks
    # by their bytes: a heading of nan, the present one, equals no other
    assert [encode_tick(tick) for tick in kept] == [encode_tick(tick) for tick in whole[: len(kept)]]
    assert len(kept) > 0.4 * len(whole)
    assert main(["replay", str(torn)]) == 0
    assert main(["identify", str(torn), "--model", "nomoto", "--out", str(tmp_path / "found.yaml")]) == 0
    assert load_vessel(tmp_path / "found.yaml").model.K_1_s > 0.0


def test_a_full_disk_stops_the_log_and_not_the_boat(vessel: str) -> None:
    port = free_port()
    command = [sys.executable, "-m", "autopilot", "run", vessel, "--link", f"udpin:127.0.0.1:{port}", "--as-gcs"]
    command += ["--speedup", str(SPEEDUP), "--engage", "present", "--log", "/dev/full"]
    command += ["--duration", "120"]  # it ends by itself where that is never said
    with (
        simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}"),
        subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as run,
    ):
        assert run.stdout is not None
        left = {"ENGAGED", "log stopped"}
        while left:
            line = run.stdout.readline()
            left = {each for each in left if each not in line}
            assert run.poll() is None, left
        run.terminate()
        _, err = run.communicate(timeout=60.0)
    assert (run.returncode, err) == (0, "")


def test_other_tools_find_attitude_and_our_values_in_the_log(tmp_path: Path) -> None:
    log, course = tmp_path / "run.tlog", Order(OrderKind.HEADING, 0.8, serial=1)
    simulate(load_vessel("lanxin"), lambda now, tick: course, 10.0, log=log)
    reader = (
        "import sys; from pymavlink import mavutil\n"
        "log = mavutil.mavlink_connection(sys.argv[1])\n"
        "while (message := log.recv_match()) is not None:\n"
        "    kind = message.get_type()\n"
        "    print(kind, message.name if kind == 'NAMED_VALUE_FLOAT' else '')\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", reader, str(log)],
        env={"MAVLINK20": "1", "PATH": "/usr/bin:/bin"}, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    seen = Counter(done.stdout.splitlines())
    kinds = Counter(line.split(" ")[0] for line in done.stdout.splitlines())
    assert kinds["ATTITUDE"] > 50
    assert kinds["RC_CHANNELS_OVERRIDE"] > 20
    assert kinds["BAD_DATA"] == 0
    for name in ("psi_deg", "psi_d_deg", "rudcmd_deg", "rud_deg", "bias_deg", "mode"):
        assert seen[f"NAMED_VALUE_FLOAT {name}"] > 20
