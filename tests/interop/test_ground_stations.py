"""Ground stations that others wrote against the running pilot: MAVProxy, MAVSDK with its own server, our own tool."""

from __future__ import annotations

import contextlib
import importlib.util
import json
import lzma
import os
import re
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from two_processes import free_port, patient_vessel, simulator

from autopilot.runtime.record import read_log, replay
from autopilot.signals import Mode
from autopilot.vessel.file import load_vessel
from autopilot.vessel.parameters import parameters_of, value_of

MAVPROXY = shutil.which("mavproxy.py")
HAS_MAVSDK = importlib.util.find_spec("mavsdk") is not None
PATIENCE_S = 60.0
AGAIN_S = 2.0
CONNECTED = """\
async def first(stream):
    async for value in stream:
        return value

async def main():
    drone = System()
    await asyncio.wait_for(drone.connect(system_address=sys.argv[1]), 30)
    while not (await first(drone.core.connection_state())).is_connected:
        pass
"""
"""How a program of MAVSDK begins: connected, in the middle of its `main`."""
SDK = (
    """
import asyncio, json, sys
from mavsdk import System

"""
    + CONNECTED
    + """\
    heading_deg = (await first(drone.telemetry.heading())).heading_deg
    yaw_deg = (await first(drone.telemetry.attitude_euler())).yaw_deg
    listed = await asyncio.wait_for(drone.param.get_all_params(), 30)
    await drone.param.set_param_float("BS_K2", 1.75)
    k2 = await drone.param.get_param_float("BS_K2")
    await drone.action.arm()
    armed = await first(drone.telemetry.armed())
    await drone.action.disarm()
    metadata = drone.component_metadata
    asked = asyncio.ensure_future(first(each async for each in metadata.metadata_available() if each.compid == 1))
    await asyncio.sleep(0.5)
    await metadata.request_autopilot_component()
    update = await asyncio.wait_for(asked, 60)
    named = [update.type.name, update.json_metadata]
    values = {p.name: p.value for p in (*listed.float_params, *listed.int_params)}
    seen = {"heading_deg": heading_deg, "yaw_deg": yaw_deg, "values": values, "k2": k2, "armed": armed}
    print(json.dumps({**seen, "metadata": named}))

asyncio.run(main())
"""
)


SDK_MISSION = (
    """
import asyncio, gc, json, math, sys
from mavsdk import System
from mavsdk.mission import MissionItem, MissionPlan
from mavsdk.mission_raw import MissionRawError

NAN = math.nan

def waypoint(latitude, longitude):
    nothing, none = MissionItem.CameraAction.NONE, MissionItem.VehicleAction.NONE
    return MissionItem(latitude, longitude, 0.0, NAN, True, NAN, NAN, nothing, NAN, NAN, 20.0, NAN, NAN, none)

"""
    + CONNECTED
    + """\
    plan = MissionPlan([waypoint(57.69, 11.853), waypoint(57.693, 11.853), waypoint(57.693, 11.85)])
    await asyncio.wait_for(drone.mission.upload_mission(plan), 30)
    got = await asyncio.wait_for(drone.mission.download_mission(), 30)
    places = [(item.latitude_deg, item.longitude_deg, item.acceptance_radius_m) for item in got.mission_items]
    raw = await asyncio.wait_for(drone.mission_raw.download_mission(), 30)
    raw[1].command = 21
    try:
        await asyncio.wait_for(drone.mission_raw.upload_mission(raw), 30)
        refused = ""
    except MissionRawError as error:
        refused = str(error)
    print(json.dumps({"places": places, "refused": refused}))
    # the error's traceback would keep the system and its server alive
    del drone
    gc.collect()

asyncio.run(main())
"""
)


class Console:
    """MAVProxy at its prompt: a line typed in, and what it must print in answer."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self.said = ""
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self.said += line

    def expect(self, pattern: str, typed: str = "") -> str:
        """Type a line, again and again, until what has been said since holds `pattern`; return it."""
        assert self._process.stdin is not None
        since, until, again = len(self.said), time.monotonic() + PATIENCE_S, 0.0
        while not re.search(pattern, self.said[since:]):
            now = time.monotonic()
            assert now < until, f"{typed!r} was not answered by {pattern!r}:\n{self.said[since:]}"
            if typed and now >= again:
                print(typed, file=self._process.stdin, flush=True)
                again = now + AGAIN_S
            time.sleep(0.05)
        return self.said[since:]


@contextlib.contextmanager
def running_boat(folder: Path, *serve: str, more: tuple[str, ...] = ()) -> Iterator[Path]:
    """A boat with a serial compass, and the pilot that serves itself at `serve`; yields its vessel file."""
    vessel, line = patient_vessel(folder), folder / "compass"
    options = [option for url in serve for option in ("--serve", url)]
    boat = [sys.executable, "-m", "sitl", "serve", str(vessel), "--nmea", f"{line}:38400"]
    boat += ["--sentences", "HDG:10,ROT:10,RSA,VHW,RMC"]
    pilot = [sys.executable, "-m", "autopilot", "run", str(vessel), "--link", f"nmea:{line}:38400", *options, *more]
    with subprocess.Popen(boat, stdout=subprocess.PIPE, text=True) as simulated:
        assert simulated.stdout is not None
        assert simulated.stdout.readline().startswith("ready")
        with (folder / "pilot.txt").open("w") as output:
            steering = subprocess.Popen(
                [*pilot, "--log", str(folder / "run.tlog")], stdin=subprocess.DEVNULL, stdout=output, stderr=output
            )
            try:
                yield vessel
            finally:
                steering.terminate()
                code = steering.wait(60)
                simulated.terminate()
                simulated.communicate()
    text = (folder / "pilot.txt").read_text()
    assert code == 0 and "Traceback" not in text, text
    assert f"in force: {vessel}" in text


def expected_values(vessel: Path) -> dict[str, float]:
    boat = load_vessel(str(vessel))
    return {parameter.name: value_of(boat, parameter) for parameter in parameters_of(boat)}


@contextlib.contextmanager
def mavproxy(folder: Path, master: str, *more: str) -> Iterator[Console]:
    command = [
        str(MAVPROXY),
        f"--master={master}",
        *more,
        "--default-modules=mode,param,arm,misc,link,cmdlong,wp,signing,ftp",
    ]
    with subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        cwd=folder,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    ) as process:
        try:
            yield Console(process)
        finally:
            process.kill()


@pytest.mark.skipif(MAVPROXY is None, reason="MAVProxy is not installed: pip install '.[interop]'")
def test_mavproxy_reads_tunes_arms_and_steers(tmp_path: Path) -> None:
    port = free_port()
    with (
        mavproxy(tmp_path, f"udpin:127.0.0.1:{port}") as console,
        running_boat(tmp_path, f"udpout:127.0.0.1:{port}") as vessel,
    ):
        values = expected_values(vessel)
        console.expect(f"Received {len(values)} parameters")
        shown = console.expect(r"BS_K2 +2\.0", "param show BS_*")
        assert re.search(r"BS_K1 +2\.0", shown) and re.search(r"BS_GAMMA +1\.0", shown)
        console.expect(r"BS_K1 +0\.8999", "param set BS_K1 0.9\nparam show BS_K1")
        console.expect("BS_K1 not changed: BS_K1 is 1e.09, allowed", "param set BS_K1 1e9")
        console.expect("TEMPORARILY_REJECTED", "mode GUIDED")
        console.expect("COMPONENT_ARM_DISARM: ACCEPTED", "arm throttle")
        console.expect("Mode GUIDED", "mode GUIDED")
        console.expect("CONDITION_YAW: ACCEPTED", "setyaw 40 0 0")
        console.expect("target_bearing : 40", "status NAV_CONTROLLER_OUTPUT")
        console.expect(f"Received {len(values)} parameters", "param fetch")
        listed = re.search(
            r"parameters\.json\.xz\s+(\d+)", console.expect(r"parameters\.json\.xz\s+\d+\n", "ftp list /")
        )
        packed = tmp_path / "parameters.json.xz"
        console.expect("Wrote .*parameters.json.xz", f"ftp get /parameters.json.xz {packed}")
        until = time.monotonic() + PATIENCE_S
        while listed is None or packed.stat().st_size < int(listed[1]):  # it says so before it closes the file
            assert time.monotonic() < until
            time.sleep(0.1)
        described = {each["name"]: each for each in json.loads(lzma.decompress(packed.read_bytes()))["parameters"]}
        assert set(described) == set(values) and described["BS_K1"]["units"] == "1/s"
        time.sleep(6.0)
        console.expect("Mode MANUAL", "mode MANUAL")
        console.expect("DISARMED", "disarm")
    tuned = load_vessel(str(vessel.with_name("boat.tuned.yaml")))
    assert tuned.control.backstepping is not None and tuned.control.backstepping.k1_1_s == 0.9
    saved = dict(line.split()[:2] for line in (tmp_path / "mav.parm").read_text().splitlines())
    assert {name: float(text) for name, text in saved.items()} == pytest.approx({**values, "BS_K1": 0.9}, abs=1e-6)
    ticks = read_log(tmp_path / "run.tlog").ticks
    steered = [tick for tick in ticks if tick.mode is Mode.ENGAGED]
    assert steered and abs(steered[-1].state.heading - 0.698) < 0.05
    assert ticks[-1].mode is Mode.STANDBY
    assert replay(tmp_path / "run.tlog").identical, "with the gain that was changed on the way"


@pytest.mark.skipif(MAVPROXY is None, reason="MAVProxy is not installed: pip install '.[interop]'")
def test_mavproxy_with_its_own_signing_is_obeyed_and_without_it_is_not(tmp_path: Path) -> None:
    port, key = free_port(), tmp_path / "signing.key"
    key.write_text("correct-horse-battery-staple\n")
    key.chmod(0o600)
    with (
        mavproxy(tmp_path, f"udpin:127.0.0.1:{port}") as console,
        running_boat(tmp_path, f"udpout:127.0.0.1:{port}", more=("--signing-key", str(key))) as vessel,
    ):
        values = expected_values(vessel)
        console.expect("refused: messages that are not signed with our key")
        console.expect("Setup signing key", "arm throttle\nsigning key correct-horse-battery-staple")
        console.expect(f"Received {len(values)} parameters", "param fetch")
        assert "ARM_DISARM" not in console.said
        console.expect("COMPONENT_ARM_DISARM: ACCEPTED", "arm throttle")
    assert "refused: " in (tmp_path / "pilot.txt").read_text()
    assert b"correct-horse" not in (tmp_path / "run.tlog").read_bytes()


@pytest.mark.skipif(MAVPROXY is None, reason="MAVProxy is not installed: pip install '.[interop]'")
def test_mavproxy_behind_us_sees_the_flight_controller_and_its_parameters(tmp_path: Path) -> None:
    port, behind = free_port(), free_port()
    vessel = patient_vessel(tmp_path)
    pilot = [sys.executable, "-m", "autopilot", "run", str(vessel), "--link", f"udpin:127.0.0.1:{port}", "--as-gcs"]
    pilot += ["--forward", f"udpout:127.0.0.1:{behind}", "--engage", "present", "--log", str(tmp_path / "run.tlog")]
    with (
        simulator(1, "--mavlink", f"udpout:127.0.0.1:{port}"),
        mavproxy(tmp_path, f"udpin:127.0.0.1:{behind}", "--source-system=250") as console,
        subprocess.Popen(pilot, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True) as steering,
    ):
        console.expect(r"Received \d+ parameters")
        console.expect(r"SYSID_MYGCS +255", "param show SYSID_MYGCS")
        console.expect(r"RC_OVERRIDE_TIME +2\.5", "param set RC_OVERRIDE_TIME 2.5\nparam show RC_OVERRIDE_TIME")
        console.expect("yaw :", "status ATTITUDE")
        console.expect("Mode HOLD", "mode HOLD")
        steering.terminate()
        assert steering.wait(60) == 0
    modes = [tick.mode for tick in read_log(tmp_path / "run.tlog").ticks]
    assert Mode.ENGAGED in modes and modes[-1] is Mode.OVERRIDE, "and its change of mode takes the helm"


def tool(folder: Path, *arguments: str) -> dict[str, Any]:
    """Run `autopilot params ... --json` in a folder and return what it printed."""
    command = [sys.executable, "-m", "autopilot", "params", *arguments, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, cwd=folder)
    assert "Traceback" not in done.stderr, done.stderr
    document: dict[str, Any] = json.loads(done.stdout)
    return document


@pytest.mark.skipif(not HAS_MAVSDK or MAVPROXY is None, reason="pip install '.[interop]' for MAVSDK and MAVProxy")
def test_mavsdk_mavproxy_and_our_own_tool_read_the_same_values_from_one_pilot(tmp_path: Path) -> None:
    sdk_port, proxy_port, line = free_port(), free_port(), free_port()
    places = (f"udpout:127.0.0.1:{sdk_port}", f"udpout:127.0.0.1:{proxy_port}", f"tcpin:127.0.0.1:{line}")
    ours = ("--link", f"tcp:127.0.0.1:{line}")
    with mavproxy(tmp_path, f"udpin:127.0.0.1:{proxy_port}") as console, running_boat(tmp_path, *places) as vessel:
        values = expected_values(vessel)
        command = [sys.executable, "-W", "ignore", "-c", SDK, f"udpin://127.0.0.1:{sdk_port}"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=90, check=False)
        assert done.returncode == 0, done.stderr
        seen = json.loads(done.stdout.strip().splitlines()[-1])
        assert seen["values"] == values
        kind, described = seen["metadata"][0], json.loads(seen["metadata"][1])
        assert kind == "PARAMETER" and {each["name"] for each in described["parameters"]} == set(values)
        assert seen["k2"] == 1.75 and seen["armed"] is True
        assert abs(seen["yaw_deg"]) < 30.0
        assert abs((seen["heading_deg"] - seen["yaw_deg"] + 180.0) % 360.0 - 180.0) < 5.0
        # what one of them has set, the others read
        values["BS_K2"] = 1.75
        console.expect(r"BS_K2 +1\.75", "param fetch BS_K2\nparam show BS_K2")
        read = {row["name"]: row["now"] for row in tool(tmp_path, "verify", str(vessel), *ours)["parameters"]}
        assert read == values
        # from YAML as from a ground station
        changed = vessel.with_name("changed.yaml")
        changed.write_text(vessel.read_text().replace("k1_1_s: 2.0", "k1_1_s: 1.25"))
        rows = tool(tmp_path, "upload", str(changed), *ours)["parameters"]
        assert {row["name"] for row in rows if row["now"] != values[row["name"]]} == {"BS_K1", "BS_K2"}
        console.expect(r"BS_K1 +1\.25", "param fetch BS_K1\nparam show BS_K1")
    tuned = load_vessel(str(vessel.with_name("boat.tuned.yaml"))).control.backstepping
    assert tuned is not None and (tuned.k1_1_s, tuned.k2_1_s) == (1.25, 2.0)


WAYPOINTS = """QGC WPL 110
0\t1\t3\t16\t0\t0\t0\t0\t57.6900\t11.8530\t0\t1
1\t0\t3\t16\t0\t15\t0\t0\t57.6930\t11.8530\t0\t1
"""


@pytest.mark.skipif(MAVPROXY is None, reason="MAVProxy is not installed: pip install '.[interop]'")
def test_mavproxy_loads_a_route_and_has_it_followed(tmp_path: Path) -> None:
    port, way, bad = free_port(), tmp_path / "way.txt", tmp_path / "bad.txt"
    way.write_text(WAYPOINTS)
    bad.write_text(WAYPOINTS.replace("\t16\t0\t15", "\t21\t0\t15"))
    with (
        mavproxy(tmp_path, f"udpin:127.0.0.1:{port}") as console,
        running_boat(tmp_path, f"udpout:127.0.0.1:{port}") as vessel,
    ):
        console.expect("Received [0-9]+ parameters")
        console.expect("there is no route: upload one first", "arm throttle\nmode AUTO")
        console.expect("route of 2 waypoints taken", f"wp load {way}")
        console.expect(r"item 1 is NAV_LAND: only NAV_WAYPOINT", f"wp load {bad}")
        listed = console.expect("Saved 2 waypoints", "wp list")
        assert re.search(r"57\.693\d* 11\.853", listed), listed
        console.expect("Mode AUTO", "mode AUTO")
        console.expect("mission_state : 3", "status MISSION_CURRENT")
        console.expect("seq : 1", "wp set 1\nstatus MISSION_CURRENT")
        console.expect("target_bearing : [67][0-9], wp_dist : [6-9]", "status NAV_CONTROLLER_OUTPUT")
        console.expect("Mode GUIDED", "mode GUIDED")
        console.expect("mission_state : 4", "status MISSION_CURRENT")
        console.expect("USER_2: IN_PROGRESS", "long MAV_CMD_USER_2 5 3")
        console.expect("USER_2: ACCEPTED")
        console.expect("Mode MANUAL", "mode MANUAL")
    kept = vessel.with_name("boat.mission.waypoints").read_text().splitlines()
    assert len(kept) == 3 and "57.6930000" in kept[2]
    ticks = read_log(tmp_path / "run.tlog").ticks
    assert any(tick.mode is Mode.ENGAGED for tick in ticks)
    assert replay(tmp_path / "run.tlog").identical


@pytest.mark.skipif(not HAS_MAVSDK, reason="MAVSDK is not installed: pip install '.[interop]'")
def test_mavsdk_uploads_and_downloads_a_route(tmp_path: Path) -> None:
    port = free_port()
    with running_boat(tmp_path, f"udpout:127.0.0.1:{port}"):
        command = [sys.executable, "-W", "ignore", "-c", SDK_MISSION, f"udpin://127.0.0.1:{port}"]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0, done.stderr
        seen = json.loads(done.stdout.strip().splitlines()[-1])
    places = [(57.69, 11.853, 20.0), (57.693, 11.853, 20.0), (57.693, 11.85, 20.0)]
    assert [tuple(place) for place in seen["places"]] == [pytest.approx(place, abs=1e-6) for place in places]
    assert "unsupported" in seen["refused"].lower(), seen["refused"]
