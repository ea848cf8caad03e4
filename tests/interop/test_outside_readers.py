"""Programs that others wrote read what we say and carry our lines: gpsd, signalk-server, socat.

They run where NORRBIN_INTEROP is set. gpsd and socat are Debian packages. signalk-server comes from npm, and
NORRBIN_SIGNALK names its folder (`npm install --prefix FOLDER signalk-server@2.23.0`, Node.js 20 or newer).
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import shutil
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from outside_programs import HAS_SIGNALK, LOOPBACK, PATIENCE_S, SIGNALK, WANTED, program, until
from two_processes import free_port, patient_vessel, simulator

from autopilot.runtime.record import read_log
from autopilot.signals import Mode

GPSD = shutil.which("gpsd", path=f"{os.environ.get('PATH', '')}:/usr/sbin") if WANTED else None
SOCAT = shutil.which("socat") if WANTED else None
GOAL_DEG = 60.0
SPEEDUP = 2


@contextlib.contextmanager
def steered_boat(folder: Path, *repeated: str) -> Iterator[Path]:
    """A boat with a serial compass, steered to GOAL_DEG, repeating itself on the links `repeated`; yields the log."""
    line, log = folder / "compass", folder / "run.tlog"
    vessel = patient_vessel(folder)
    pilot = [sys.executable, "-m", "autopilot", "run", str(vessel), "--link", f"nmea:{line}:38400"]
    pilot += [option for url in repeated for option in ("--link", url)]
    pilot += ["--engage", str(GOAL_DEG), "--speedup", str(SPEEDUP), "--log", str(log)]
    with (
        simulator(SPEEDUP, "--nmea", f"{line}:38400", "--sentences", "HDG:10,ROT:10,RSA:5,VHW,RMC"),
        program(folder, *pilot) as steering,
    ):
        yield log
        assert steering.poll() is None, (folder / f"{Path(sys.executable).name}.txt").read_text()


@pytest.mark.skipif(GPSD is None, reason="set NORRBIN_INTEROP=1, and apt install gpsd")
def test_gpsd_reads_our_heading(tmp_path: Path) -> None:
    instruments, reports = free_port(), free_port(socket.SOCK_STREAM)
    repeated = f"nmea-udpout:127.0.0.1:{instruments}?steer=no&send=HDT:5,ROT:2,RSA:2,HTD:1,XDR:1&talker=II"
    command = [str(GPSD), "-N", "-n", "-S", str(reports), f"udp://127.0.0.1:{instruments}"]
    with program(tmp_path, *command), steered_boat(tmp_path, repeated) as log:

        def connected() -> socket.socket | None:
            try:
                return socket.create_connection(("127.0.0.1", reports), timeout=PATIENCE_S)
            except OSError:
                return None

        with until("gpsd", connected) as line:
            line.sendall(b'?WATCH={"enable":true,"json":true};\n')
            headings, classes = [], set()
            for text in line.makefile():
                report = json.loads(text)
                classes.add(report["class"])
                if report["class"] == "ATT":
                    headings.append(report["heading"])
                    if len(headings) > 20 and abs(headings[-1] - GOAL_DEG) < 1.0:
                        break
                assert len(headings) < 2000, (tmp_path / f"{Path(sys.executable).name}.txt").read_text()
    assert "ERROR" not in classes
    logged = [round(math.degrees(tick.state.heading) % 360.0, 1) for tick in read_log(log).ticks]
    assert all(min(abs(heading - known) for known in logged) < 0.11 for heading in headings)


def signalk_settings(port: int, tcp: int, udp: int) -> dict[str, Any]:
    def provider(name: str, **options: str) -> dict[str, Any]:
        element = {"logging": False, "type": "NMEA0183", "subOptions": {"validateChecksum": True, **options}}
        return {
            "id": name,
            "enabled": True,
            "pipeElements": [{"type": "providers/simple", "options": element}],
        }

    off = ("appstore", "applicationData", "playground", "nmea-tcp", "tcp", "mfd_webapp")
    return {
        "interfaces": dict.fromkeys(off, False),
        "mdns": False,
        "ssl": False,
        "port": port,
        "pipedProviders": [
            provider("norrbin-tcp", type="tcp", host="127.0.0.1", port=str(tcp)),
            provider("norrbin-udp", type="udp", port=str(udp)),
        ],
    }


@pytest.mark.skipif(not HAS_SIGNALK, reason="set NORRBIN_INTEROP=1 and NORRBIN_SIGNALK: see the head of this file")
def test_signalk_gives_our_heading_rate_and_rudder_back(tmp_path: Path) -> None:
    web, tcp, udp = free_port(socket.SOCK_STREAM), free_port(socket.SOCK_STREAM), free_port()
    (tmp_path / "settings.json").write_text(json.dumps(signalk_settings(web, tcp, udp)))
    (tmp_path / "loopback.cjs").write_text(LOOPBACK)
    command = ["node", "--require", str(tmp_path / "loopback.cjs"), str(SIGNALK)]
    repeated = (
        f"nmea-tcpin:127.0.0.1:{tcp}?steer=no&send=HDT:5,ROT:5,RSA:5",
        f"nmea-udpout:127.0.0.1:{udp}?steer=no&send=HDT:5,RSA:5&talker=II",
    )

    def asked(path: str) -> dict[str, Any]:
        """What the server knows, by source; {} while it knows nothing."""
        url = f"http://127.0.0.1:{web}/signalk/v1/api/vessels/self/{path}"
        try:
            with urllib.request.urlopen(url, timeout=5) as answer:
                document = json.load(answer)
        except OSError:
            return {}
        return document.get("values", {document["$source"]: document})

    def steady() -> dict[str, float] | None:
        found = {source: each["value"] for source, each in asked("navigation/headingTrue").items()}
        return (
            found if len(found) == 2 and all(abs(v - math.radians(GOAL_DEG)) < 0.02 for v in found.values()) else None
        )

    with program(tmp_path, *command, SIGNALK_NODE_CONFIG_DIR=str(tmp_path)), steered_boat(tmp_path, *repeated) as log:
        headings = until("both headings, on course", steady)
        rudders = {source: each["value"] for source, each in asked("steering/rudderAngle").items()}
        rates = {source: each["value"] for source, each in asked("navigation/rateOfTurn").items()}
    assert set(headings) == set(rudders) == {"norrbin-tcp.AG", "norrbin-udp.II"}
    assert set(rates) == {"norrbin-tcp.AG"}
    ticks = read_log(log).ticks[-200:]
    for source, value in rudders.items():
        assert min(abs(tick.state.rudder - value) for tick in ticks) < 0.01, source
    assert min(abs(tick.state.rate - rates["norrbin-tcp.AG"]) for tick in ticks) < 0.001


@pytest.mark.skipif(SOCAT is None, reason="set NORRBIN_INTEROP=1, and apt install socat")
@pytest.mark.parametrize("speaks", ["nmea", "mavlink"])
def test_a_boat_behind_a_pseudo_terminal_of_socat_is_steered(tmp_path: Path, speaks: str) -> None:
    port, line, log = free_port(socket.SOCK_STREAM), tmp_path / "line", tmp_path / "run.tlog"
    served, link = (
        (["--nmea", f"nmea-tcpin:127.0.0.1:{port}", "--sentences", "HDG:10,ROT:10,RSA:5,VHW"], f"nmea:{line}:38400")
        if speaks == "nmea"
        else (["--mavlink", f"tcpin:127.0.0.1:{port}"], f"serial:{line}:115200")
    )
    bridge = [str(SOCAT), f"pty,raw,echo=0,link={line}", f"tcp:127.0.0.1:{port}"]
    with simulator(SPEEDUP, *served), program(tmp_path, *bridge):
        until("the pseudo-terminal", line.exists)
        pilot = [sys.executable, "-m", "autopilot", "run", str(patient_vessel(tmp_path)), "--link", link, "--as-gcs"]
        pilot += ["--engage", str(GOAL_DEG), "--duration", "20", "--speedup", str(SPEEDUP), "--log", str(log)]
        done = subprocess.run(pilot, capture_output=True, text=True, timeout=90, check=False, stdin=subprocess.DEVNULL)
    assert (done.returncode, done.stderr) == (0, "")
    last = read_log(log).ticks[-1]
    assert last.mode is Mode.ENGAGED and abs(math.degrees(last.state.heading) - GOAL_DEG) < 2.0
