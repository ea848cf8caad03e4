"""A trial that MAVProxy recorded from behind the pilot: its .tlog is read, and the boat identified from it."""

from __future__ import annotations

import contextlib
import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from two_processes import free_port, patient_vessel, simulator

from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.logs.reading import LogOptions, bytes_of, format_of, load_run, read_recording
from autopilot.logs.series import HEADING, SHARE
from autopilot.logs.table import RudderSettings
from autopilot.logs.tlog import FORMAT as TLOG
from autopilot.runtime.build import gear_of
from autopilot.vessel.file import load_vessel

MAVPROXY = shutil.which("mavproxy.py")
SPEEDUP = 2
LANXIN = load_vessel("lanxin")


@contextlib.contextmanager
def recorder(folder: Path, port: int) -> Iterator[None]:
    """Run MAVProxy, which records what it hears in mav.tlog, while the block lasts."""
    command = [str(MAVPROXY), f"--master=udpin:127.0.0.1:{port}", "--source-system=250", "--default-modules=link,param"]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    ) as process:  # fmt: skip
        try:
            yield
        finally:
            process.terminate()


@pytest.mark.skipif(MAVPROXY is None, reason="MAVProxy is not installed: pip install '.[interop]'")
def test_the_boat_is_identified_from_what_mavproxy_recorded(tmp_path: Path) -> None:
    """The simulator runs at twice the speed: only the vehicle's own time, not the stamps, gives the right T."""
    port, behind, own = free_port(), free_port(), tmp_path / "own.tlog"
    trial = [sys.executable, "-m", "autopilot", "trial", "zigzag", str(patient_vessel(tmp_path)), "--as-gcs"]
    trial += ["--link", f"udpin:127.0.0.1:{port}", "--forward", f"udpout:127.0.0.1:{behind}", "--log", str(own)]
    trial += ["--speedup", str(SPEEDUP), "--duration", "30", "--approach", "4"]
    with simulator(SPEEDUP, "--mavlink", f"udpout:127.0.0.1:{port}"), recorder(tmp_path, behind):
        done = subprocess.run(trial, capture_output=True, text=True, timeout=90, check=False)
        assert (done.returncode, done.stderr) == (0, "")
        time.sleep(1.0)
    path = str(tmp_path / "mav.tlog")
    assert format_of(path, bytes_of(path)) is TLOG
    recording = read_recording(path)
    heading = recording.best(HEADING)
    assert heading is not None
    assert heading.time[-1] - heading.time[0] > 25.0, "seconds of the vehicle"
    assert recording.best(SHARE) is not None, "MAVProxy fetches the parameters, so the servo is known"
    settings = RudderSettings(at_full=math.radians(LANXIN.rudder.angle_max_deg), gear=gear_of(LANXIN))
    run = load_run(path, options=LogOptions(rudder=settings))
    found, ours = identify([run], Question("nomoto")), identify([load_run(str(own))], Question("nomoto"))
    assert found.model.gain == pytest.approx(ours.model.gain, rel=0.1)
    assert found.model.time_constant == pytest.approx(ours.model.time_constant, rel=0.2)
    assert found.predict(run).yaw_rate_r2 > 0.9
