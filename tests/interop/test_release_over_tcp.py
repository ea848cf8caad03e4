"""`autopilot run` over TCP: on every way out the rudder is back at once, seen by a second line to the vehicle."""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import signal
import socket
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pymavlink import mavutil
from two_processes import free_port, patient_vessel, simulator, wait_until_engaged

OVERRIDE_TIME_S = 3.0
"""RC_OVERRIDE_TIME, after which the firmware lets go by itself."""
HELD_BACK_S = 1.0
"""Less than that by far, and more than reports and a busy machine need."""
CENTRED_US = 1500


class Witness:
    """A ground station on a line of its own that watches the steering input."""

    def __init__(self, port: int) -> None:
        self.line = mavutil.mavlink_connection(f"udpin:127.0.0.1:{port}", source_system=255)
        assert self.line.wait_heartbeat(timeout=60) is not None
        command = mavutil.mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        self.line.mav.command_long_send(
            1, 1, command, 0, mavutil.mavlink.MAVLINK_MSG_ID_RC_CHANNELS, 50_000, 0, 0, 0, 0, 0
        )

    def boot_time_when(self, steers: Callable[[int], bool]) -> float:
        """Return the vehicle's time [s] of the first report of a steering input of which that is so."""
        end = time.monotonic() + 60.0
        while time.monotonic() < end:
            report = self.line.recv_match(type="RC_CHANNELS", blocking=True, timeout=1)
            if report is not None and steers(report.chan1_raw):
                return float(report.time_boot_ms) * 1.0e-3
        raise AssertionError("never seen")

    def close(self) -> None:
        self.line.close()


def is_laid(pulse: int) -> bool:
    return abs(pulse - CENTRED_US) > 60


def is_free(pulse: int) -> bool:
    return abs(pulse - CENTRED_US) < 5


@contextlib.contextmanager
def engaged(folder: Path, duration: str = "60") -> Iterator[tuple[subprocess.Popen[str], int, Witness]]:
    """A pilot that holds the rudder over, by TCP; its terminal; the witness."""
    line, side = free_port(socket.SOCK_STREAM), free_port()
    addresses = ["--mavlink", f"tcpin:127.0.0.1:{line}", "--mavlink", f"udpout:127.0.0.1:{side}"]
    with simulator(1.0, *addresses):
        witness = Witness(side)
        keyboard, terminal = pty.openpty()
        command = [sys.executable, "-m", "autopilot", "run", str(patient_vessel(folder)), "--as-gcs"]
        command += ["--link", f"tcp:127.0.0.1:{line}", "--engage", "present", "--duration", duration]
        with subprocess.Popen(
            command, stdin=terminal, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            start_new_session=True, preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),
        ) as run:  # fmt: skip
            try:
                wait_until_engaged(run)
                os.write(keyboard, b"r 15\n")
                witness.boot_time_when(is_laid)
                yield run, keyboard, witness
            finally:
                run.kill()
                witness.close()
                os.close(keyboard)
                os.close(terminal)


@pytest.mark.parametrize("way", ["q", "SIGINT", "SIGTERM"])
def test_the_rudder_is_back_at_once(tmp_path: Path, way: str) -> None:
    with engaged(tmp_path) as (run, keyboard, witness):
        if way == "q":
            os.write(keyboard, b"q\n")
        else:
            run.send_signal(getattr(signal, way))
        ordered = witness.boot_time_when(lambda pulse: True)
        freed = witness.boot_time_when(is_free)
        out, err = run.communicate(timeout=60.0)
    assert freed - ordered < HELD_BACK_S
    assert (run.returncode, err) == (0, "")
    assert "rudder released, confirmed by RC_CHANNELS" in out.splitlines()[-1]
