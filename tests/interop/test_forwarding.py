"""A ground station behind the pilot sees the flight controller through us and reads its parameters while we steer."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from alarm_texts import words_of
from two_processes import free_port, patient_vessel, simulator, wait_until_engaged

from autopilot.cli.main import main
from autopilot.runtime.record import read_log
from autopilot.signals import HeadingSample, Mode, Tick

SPEEDUP = 1
"""Not speeded up: a pilot that stands still for 3 s of the vehicle's time lets go, as one on a busy machine does."""
STATION = """
import json, sys, time
from pymavlink import mavutil
link = mavutil.mavlink_connection(sys.argv[1], source_system=250, source_component=190)
if len(sys.argv) > 2:
    link.setup_signing(bytes.fromhex(sys.argv[2]))
link.target_system = link.target_component = 1
senders, values, count, asked, beat, until = set(), {}, None, 0.0, 0.0, time.monotonic() + 40
while time.monotonic() < until and (count is None or len(values) < count or (1, 191) not in senders):
    now = time.monotonic()
    if now > beat:
        link.mav.heartbeat_send(6, 8, 0, 0, 4)
        beat = now + 1
    if now > asked and (1, 1) in senders:
        if count is None:
            link.mav.param_request_list_send(1, 1)
        else:
            for index in [i for i in range(count) if i not in values][:20]:
                link.mav.param_request_read_send(1, 1, b"", index)
        asked = now + 2
    message = link.recv_match(blocking=True, timeout=0.2)
    if message is None:
        continue
    senders.add((message.get_srcSystem(), message.get_srcComponent()))
    if message.get_type() == "PARAM_VALUE" and message.param_index < message.param_count:
        values[message.param_index] = message.param_id
        count = message.param_count
heading = link.recv_match(type="ATTITUDE", blocking=True, timeout=60)
print(json.dumps({"senders": sorted(senders), "count": count, "got": len(values), "heading": heading is not None}))
"""


LOGGER = """
import json, sys
from collections import Counter
from pymavlink import mavutil
link = mavutil.mavlink_connection(sys.argv[1], source_system=251, source_component=190)
counts, beaten, times = Counter(), 0, []
while len(times) < 24:
    if not beaten % 40:
        link.mav.heartbeat_send(6, 8, 0, 0, 4)
        link.mav.request_data_stream_send(1, 1, 0, 1, 1)
    beaten += 1
    message = link.recv_match(blocking=True, timeout=0.05)
    if message is None or message.get_srcSystem() != 1:
        continue
    counts[message.get_type()] += 1
    if message.get_type() == "ATTITUDE":
        times.append(message.time_boot_ms)
print(json.dumps({"counts": counts, "span": (times[-1] - times[3]) / 1000.0 / (len(times) - 4)}))
"""


def run_command(vessel: Path, port: int, forward: str, log: Path, *more: str) -> list[str]:
    command = [sys.executable, "-m", "autopilot", "run", str(vessel), "--link", f"udpin:127.0.0.1:{port}", "--as-gcs"]
    command += ["--forward", forward, "--engage", "60", "--speedup", str(SPEEDUP), "--log", str(log)]
    return [*command, *more]


def assert_steered_to_the_end(ticks: Sequence[Tick]) -> None:
    """Nothing takes the helm or stops the steering, once it has begun."""
    modes = [tick.mode for tick in ticks]
    left = next((tick for tick in ticks[modes.index(Mode.ENGAGED) :] if tick.mode is not Mode.ENGAGED), None)
    assert left is None, words_of(left)


@pytest.mark.parametrize("signed", [False, True])
def test_mavutil_behind_us_reads_every_parameter_of_the_vehicle_while_we_steer(tmp_path: Path, signed: bool) -> None:
    vessel, port, behind, log = patient_vessel(tmp_path), free_port(), free_port(), tmp_path / "run.tlog"
    key = tmp_path / "signing.key"
    key.write_text("ab" * 32)
    key.chmod(0o600)
    ours, theirs = (["--signing-key", str(key)], ["ab" * 32]) if signed else ([], [])
    command = run_command(vessel, port, f"udpin:127.0.0.1:{behind}", log, *ours)
    station = [sys.executable, "-W", "ignore", "-c", STATION, f"udpout:127.0.0.1:{behind}", *theirs]
    with (
        simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}", *ours),
        subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as pilot,
    ):
        assert pilot.stdout is not None
        assert any("ENGAGED" in line for line in pilot.stdout)
        done = subprocess.run(
            station, capture_output=True, text=True, timeout=80, check=False, env={**os.environ, "MAVLINK20": "1"}
        )
        pilot.terminate()
        _, err = pilot.communicate(timeout=60)
    assert (pilot.returncode, err) == (0, "")
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout.strip().splitlines()[-1])
    assert seen["count"] > 50 and seen["got"] == seen["count"]
    assert seen["senders"] == [[1, 1], [1, 191]] and seen["heading"]
    assert_steered_to_the_end(read_log(log).ticks)


def test_a_logger_behind_a_slow_radio_gets_two_headings_a_second_while_we_steer_by_all(tmp_path: Path) -> None:
    vessel, port, behind, log = patient_vessel(tmp_path), free_port(), free_port(), tmp_path / "run.tlog"
    url = f"udpin:127.0.0.1:{behind}?rate=ATTITUDE:2,others:0"
    logger = [sys.executable, "-W", "ignore", "-c", LOGGER, f"udpout:127.0.0.1:{behind}"]
    with (
        simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}"),
        subprocess.Popen(
            run_command(vessel, port, url, log), stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True
        ) as pilot,
    ):
        wait_until_engaged(pilot)
        done = subprocess.run(
            logger, capture_output=True, text=True, timeout=80, check=True, env={**os.environ, "MAVLINK20": "1"}
        )
        pilot.terminate()
        pilot.communicate(timeout=60)
    seen = json.loads(done.stdout)
    assert seen["span"] == pytest.approx(0.5, rel=0.1), "seconds of the vehicle between two headings"
    assert seen["counts"]["HEARTBEAT"] > 10 and "VFR_HUD" not in seen["counts"], "it stays seen, and no more"
    ticks = read_log(log).ticks
    headings = {sample.time for tick in ticks for sample in tick.samples if isinstance(sample, HeadingSample)}
    # of the twenty a second that come, on a machine that has little time for it too
    assert len(headings) > 5.0 * 2.0 * (max(headings) - min(headings)), "we steer by all, not by what is passed on"
    assert_steered_to_the_end(ticks)


@pytest.mark.parametrize(
    ("link", "forward", "sentence"),
    [
        ("nmea-udp:127.0.0.1:0", "udpout:127.0.0.1:14550", "--forward passes MAVLink on, and no --link brings any"),
        ("udpin:127.0.0.1:0", "nmea-udpout:127.0.0.1:10110", "--forward nmea-udpout:127.0.0.1:10110: ground stations"),
    ],
)
def test_what_cannot_be_forwarded_is_refused_in_a_sentence(
    capsys: pytest.CaptureFixture[str], link: str, forward: str, sentence: str
) -> None:
    assert main(["run", "lanxin", "--link", link, "--forward", forward]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"autopilot: {sentence}") and len(said.splitlines()) == 1
