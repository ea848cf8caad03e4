"""`sitl serve` as its own process, met by pymavlink's own client and by a serial port; and its refusals."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import serial
from two_processes import free_port

from autopilot.links.base import LinkError
from sitl.cli import main
from sitl.lines import OURS, PtyTransport
from sitl.serve import LAG_MAX_S, Pace

os.environ.setdefault("MAVLINK20", "1")
from pymavlink import mavutil

PATIENCE_S = 60.0
Serve = Callable[..., subprocess.Popen[str]]


@pytest.fixture
def serve() -> Iterator[Serve]:
    """Start `sitl serve lanxin ...`; whatever is left running at the end is killed."""
    running: list[subprocess.Popen[str]] = []

    def start(*options: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "sitl", "serve", "lanxin", *options]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        running.append(process)
        return process

    yield start
    for process in running:
        process.kill()
        process.communicate()


def line_of(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def wait_for(client: Any, kind: str, accept: Callable[[Any], bool] = lambda message: True) -> Any:
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        message = client.recv_match(type=kind, blocking=True, timeout=1.0)
        if message is not None and accept(message):
            return message
    raise AssertionError(f"no such {kind} within {PATIENCE_S} s")


def test_pymavlinks_own_client_sees_a_rover_boat_and_steers_it(serve: Serve) -> None:
    port = free_port()
    process = serve("--mavlink", f"udpout:127.0.0.1:{port}", "--speedup", "5", "--disarmed")
    assert line_of(process) == f"ready mavlink udpout:127.0.0.1:{port}"
    client = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255, source_component=190)
    try:
        heartbeat = client.wait_heartbeat(timeout=PATIENCE_S)
        assert heartbeat.type == mavutil.mavlink.MAV_TYPE_SURFACE_BOAT
        assert client.flightmode == "MANUAL"
        assert not client.motors_armed()
        client.arducopter_arm()
        wait_for(client, "HEARTBEAT", lambda _: client.motors_armed())
        client.set_mode("HOLD")
        wait_for(client, "HEARTBEAT", lambda _: client.flightmode == "HOLD")
        client.set_mode("MANUAL")
        wait_for(client, "HEARTBEAT", lambda _: client.flightmode == "MANUAL")

        def named(_: Any) -> bool:  # asked for again: what a full buffer of ours has dropped is not sent twice
            client.param_fetch_one("RC_OVERRIDE_TIME")
            return "PARAM_VALUE" in client.messages

        wait_for(client, "HEARTBEAT", named)
        assert client.messages["PARAM_VALUE"].param_value == 3.0

        def steered(message: Any) -> bool:
            client.mav.rc_channels_override_send(1, 1, 1560, *[65535] * 7)
            return bool(message.servo1_raw == 1531)

        client.mav.command_long_send(1, 1, mavutil.mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, 36, 100000, 0, 0, 0, 0, 0)
        wait_for(client, "SERVO_OUTPUT_RAW", steered)
    finally:
        client.close()
    process.send_signal(signal.SIGTERM)
    assert process.wait(PATIENCE_S) == 0


def test_who_starts_again_from_another_port_is_heard(serve: Serve) -> None:
    port = free_port()
    serve("--mavlink", f"udpin:127.0.0.1:{port}", "--speedup", "10")
    for _ in range(2):  # neither says goodbye
        client = mavutil.mavlink_connection(f"udpout:127.0.0.1:{port}")
        deadline = time.monotonic() + PATIENCE_S
        while client.recv_match(type="HEARTBEAT", blocking=True, timeout=0.3) is None:
            assert time.monotonic() < deadline, "not heard"
            client.mav.heartbeat_send(6, 8, 0, 0, 4)
        client.close()


def test_sitl_serve_speaks_nmea_on_a_serial_port(serve: Serve, tmp_path: Path) -> None:
    path = tmp_path / "compass"
    process = serve("--nmea", f"{path}:38400", "--sentences", "HDG,ROT,RSA:10", "--speedup", "4")
    assert line_of(process) == f"ready nmea {path} (38400 baud)"
    with serial.Serial(str(path), 38400, timeout=1.0) as port:
        body = b"AGROR,15.00,A,,V,B"
        checksum = 0
        for byte in body:
            checksum ^= byte
        deadline = time.monotonic() + PATIENCE_S
        heard: set[bytes] = set()
        angle = 0.0
        while time.monotonic() < deadline and not (angle > 14.7 and len(heard) >= 3):
            port.write(b"$%s*%02X\r\n" % (body, checksum))
            sentence = port.readline()
            heard.add(sentence[3:6])
            if sentence[3:6] == b"RSA":
                angle = float(sentence.split(b",")[1])
        assert heard >= {b"HDG", b"ROT", b"RSA"}
        assert angle == pytest.approx(15.0, abs=0.5)
    process.send_signal(signal.SIGINT)
    assert process.wait(PATIENCE_S) == 0
    assert not os.path.lexists(path), "the link to the pseudo-terminal is taken away"


def test_both_at_once_for_a_given_time_with_the_truth_on_file(serve: Serve, tmp_path: Path) -> None:
    truth = tmp_path / "truth.csv"
    nmea = tmp_path / "nmea"
    process = serve(
        *("--mavlink", f"udpout:127.0.0.1:{free_port()}", "--mavlink", "tcpin:127.0.0.1:0"),
        *("--nmea", f"{nmea}:4800", "--duration", "10", "--speedup", "20", "--truth", str(truth)),
        *("--scenario", "jiang", "--seed", "3", "--speed-m-s", "3.5"),
    )
    assert process.wait(PATIENCE_S) == 0
    assert process.stdout is not None
    assert [line.split()[1] for line in process.stdout.read().splitlines()] == ["mavlink", "mavlink", "nmea"]
    rows = [line.split(",") for line in truth.read_text().splitlines()]
    assert rows[0][:2] == ["time_s", "north_m"]
    assert len(rows) == 102
    assert float(rows[-1][0]) == pytest.approx(10.0)
    assert float(rows[-1][1]) == pytest.approx(35.0, abs=0.5)


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["serve", "lanxn"], 2, "did you mean lanxin"),
        (["serve", "lanxin", "--scenario", "clam"], 2, "did you mean calm"),
        (["serve", "lanxin", "--mavlink", "udp:127.0.0.1:1"], 2, "udpout:"),
        (["serve", "lanxin", "--mavlink", "nmea:/dev/null:4800"], 2, "--nmea PATH:BAUD"),
        (["serve", "lanxin", "--nmea", "/tmp/x"], 2, "path and a baud rate"),
        (["serve", "lanxin", "--nmea", "/tmp/x:12"], 2, "from 300 to"),
        (["serve", "lanxin", "--nmea", "/no/such/folder/x:4800"], 3, "No such file"),
        (["serve", "lanxin", "--nmea", "/tmp/x:4800", "--sentences", "HDX"], 2, "allowed are HDG"),
        (["serve", "lanxin", "--truth", "/no/such/folder/t.csv"], 2, "cannot be written"),
    ],
)
def test_refusals_are_one_sentence(
    arguments: list[str], code: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = [(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM)]
    try:
        assert main(arguments) == code
    finally:
        for number, handler in kept:
            signal.signal(number, handler)
    error = capsys.readouterr().err
    assert words in error
    assert error.count("\n") == 1
    assert error.startswith("sitl: ")


@pytest.mark.parametrize("option", ["--speedup=0", "--speedup=nan", "--seed=-1", "--duration=x", "--mode=AUTO"])
def test_bad_options_end_with_2(option: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code: object = main(["serve", "lanxin", option])
    except SystemExit as ended:  # argparse's own
        code = ended.code
    assert code == 2
    assert option.split("=")[0] in capsys.readouterr().err


def test_a_port_in_use_is_said_and_ends_with_3(capsys: pytest.CaptureFixture[str]) -> None:
    kept = [(number, signal.getsignal(number)) for number in (signal.SIGINT, signal.SIGTERM)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        try:
            assert main(["serve", "lanxin", "--mavlink", f"udpin:127.0.0.1:{taken.getsockname()[1]}"]) == 3
        finally:
            for number, handler in kept:
                signal.signal(number, handler)
    assert "in use" in capsys.readouterr().err


def test_a_link_left_over_is_replaced_and_a_file_is_not(tmp_path: Path) -> None:
    stale = tmp_path / "stale"
    stale.symlink_to("/dev/pts/does-not-exist")
    line = PtyTransport(str(stale))
    assert stale.resolve() != Path("/dev/pts/does-not-exist")
    line.close()
    line.close()
    assert not stale.is_symlink()
    precious = tmp_path / "precious"
    precious.write_text("kept")
    with pytest.raises(LinkError, match="does not exist yet"):
        PtyTransport(str(precious))
    assert precious.read_text() == "kept"


def test_a_link_left_over_is_replaced_though_its_terminal_is_somebody_else_s_now(tmp_path: Path) -> None:
    path = tmp_path / "line"
    path.symlink_to("/dev/pts/does-not-exist")
    line = PtyTransport(str(path))
    ours = path.resolve()
    with pytest.raises(LinkError, match="does not exist yet"):
        PtyTransport(str(path))  # in use
    (tmp_path / "alias").symlink_to(tmp_path)
    for spelled in ("alias/line", f"../{tmp_path.name}/line"):
        with pytest.raises(LinkError, match="does not exist yet"):
            PtyTransport(str(tmp_path / spelled))  # the same link, by another way to its folder
    assert path.resolve() == ours
    line.close()
    descriptors = os.openpty()
    try:
        name = Path(os.ttyname(descriptors[1]))
        path.symlink_to(name)  # another program's, such as socat's
        with pytest.raises(LinkError, match="does not exist yet"):
            PtyTransport(str(path))
        path.unlink()
        path.symlink_to(OURS + name.name)  # ours, of a run that was killed
        line = PtyTransport(str(path))
        assert path.resolve() != name
        line.close()
        line = PtyTransport(str(tmp_path / "other"))
        path.symlink_to(OURS + (tmp_path / "other").resolve().name)  # the number is another simulator's line's now
        again = PtyTransport(str(path))
        again.close()
        line.close()
    finally:
        for descriptor in descriptors:
            os.close(descriptor)


def test_nobody_listening_on_the_pseudo_terminal_costs_bytes_and_nothing_else(tmp_path: Path) -> None:
    line = PtyTransport(str(tmp_path / "line"))
    try:
        for _ in range(200):
            line.send(b"x" * 1000)
        assert line.dropped > 0
        assert line.receive() == []
    finally:
        line.close()


def test_pace_speeds_up_and_gives_up_what_it_cannot_keep() -> None:
    wall = [100.0]
    pace = Pace(10.0, lambda: wall[0])
    assert pace.simulated(0.0) == 0.0
    wall[0] = 100.2
    assert pace.simulated(0.0) == pytest.approx(2.0)
    assert pace.wait_for(3.0) == pytest.approx(0.1)
    assert pace.lost == 0.0
    wall[0] = 110.0
    assert pace.simulated(2.0) == pytest.approx(2.0 + LAG_MAX_S * 10.0), "so much behind at most"
    assert pace.lost == pytest.approx(9.8 - LAG_MAX_S)
