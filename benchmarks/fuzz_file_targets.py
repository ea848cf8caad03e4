"""Every reader of files and lines as a fuzzer's target: what it cannot use it refuses with an InputError, else nothing.

The sound inputs that the engines begin with are made here: files that are shipped, and recordings of a simulated boat.
"""

from __future__ import annotations

import functools
import math
import os
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from autopilot.links.signing_key import key_of
from autopilot.links.url import parse_url
from autopilot.loop.csv_log import load_column_map
from autopilot.loop.logs.dataflash_log import read_dataflash
from autopilot.loop.logs.nmea_text import read_nmea
from autopilot.loop.logs.reading import read_recording
from autopilot.loop.logs.series import Recording
from autopilot.loop.logs.tlog import read_tlog
from autopilot.loop.logs.ulog import read_ulog
from autopilot.loop.record import Recorder, read_log
from autopilot.params.firmware_file import firmware_from
from autopilot.params.foreign_files import parse_foreign
from autopilot.params.strict_yaml import parse_document
from autopilot.params.vessel import Vessel
from autopilot.params.vessel_file import dump_vessel, load_vessel, parse_vessel
from sitl.chaos import chaos_faults
from sitl.fault_desk import obey
from sitl.scenario import load_scenario, scenario_from
from sitl.world import World

ROOT = Path(__file__).parents[1]
SECONDS = 4.0
"""Length of the recordings that are damaged: short, so that damage reaches every part of them."""


class Target(NamedTuple):
    """Takes bytes; raises InputError for what it refuses, and nothing else. seeds: sound inputs."""

    take: Callable[[bytes], None]
    seeds: Sequence[bytes]


@functools.cache
def targets() -> dict[str, Target]:
    """Return every target by its name."""
    world = World(load_vessel("lanxin"), load_scenario("calm"))
    logs = _recordings()
    return {
        "vessel YAML": Target(_vessel, _shipped("firmware_params/vessels", "*.yaml")),
        "scenario YAML": Target(_scenario, [*_shipped("sitl/scenarios", "*.yaml"), SCENARIO]),
        "firmware YAML": Target(_firmware, _shipped("firmware_params/firmware", "*.yaml")),
        "parameter files": Target(_foreign, FOREIGN),
        "column map YAML": Target(_in_file(load_column_map), [b"time_s: t\nheading_deg: HDG\nspeed_kn: SOG\n"]),
        "CSV log": Target(_in_file(lambda path: _sound(read_recording(path))), logs["csv"]),
        "telemetry log": Target(lambda data: _sound(read_tlog("x.tlog", data)), logs["tlog"]),
        "own log": Target(_in_file(lambda path: read_log(Path(path))), logs["own"]),
        "DataFlash log": Target(lambda data: _sound(read_dataflash("x.bin", data)), logs["dataflash"]),
        "ULog": Target(lambda data: _sound(read_ulog("x.ulg", data)), logs["ulog"]),
        "NMEA log": Target(lambda data: _sound(read_nmea("x.txt", data, 0.1)), logs["nmea"]),
        "any log": Target(_in_file(lambda path: _sound(read_recording(path))), [log[0] for log in logs.values()]),
        "link URL": Target(lambda data: _text(data, parse_url), URLS),
        "signing key": Target(lambda data: _key(data), [b"0123456789abcdef" * 4, bytes(range(32))]),
        "faults and chaos": Target(lambda data: _faults(world, data), [b"loss=0.1,delay=2", b"yaw_push size=3 for=2"]),
    }


SCENARIO = b"""schema_version: 1
name: all
seed: 7
faults: [{kind: heading_jump, from_s: 1, to_s: 9, size: 20, ramp_s: 2}, {kind: silence, from_s: 3, every_s: 9}]
waves: {second_order: {frequency_rad_s: 1, damping: 0.1, sigma_deg: 5}}
route: [[0, 0], [500, 0]]
"""
FOREIGN = [
    b"# comment\nRC1_TRIM,1500\nSERVO1_FUNCTION,26\nATC_STR_RAT_P,0.2\n",
    b"RC1_TRIM 1500\nATC_STR_RAT_P 0.200000\n",
    b"# Onboard parameters\n#\n1\t1\tRC1_TRIM\t1500\t4\n1\t1\tATC_STR_RAT_P\t0.2\t9\n",
]
URLS = [b"udpin:127.0.0.1:14550", b"serial:/dev/ttyUSB0:115200", b"nmea:/dev/ttyUSB1:4800?send=HDG:10", b"tcp:h:5760"]


def _text(data: bytes, use: Callable[[str], object]) -> None:
    use(data.decode("utf-8", "replace"))


def _vessel(data: bytes) -> None:
    vessel = parse_vessel(data.decode("utf-8", "replace"), "x.yaml")
    assert isinstance(vessel, Vessel)
    # what is taken can be written and read again, and is the same
    assert parse_vessel(dump_vessel(vessel)) == vessel


def _scenario(data: bytes) -> None:
    scenario_from(parse_document(data.decode("utf-8", "replace"), "x.yaml"))


def _firmware(data: bytes) -> None:
    firmware_from(parse_document(data.decode("utf-8", "replace"), "x.yaml"))


def _foreign(data: bytes) -> None:
    found = parse_foreign(data.decode("utf-8", "replace"), "x.param")
    assert all(math.isfinite(each.value) for each in found.values)


def _key(data: bytes) -> None:
    assert len(key_of(data, Path("x.key"))) == 32


def _faults(world: World, data: bytes) -> None:
    text = data.decode("utf-8", "replace")
    world.faults.clear(0.0)
    assert obey(world, text).partition(" ")[0] in ("ok", "error")
    for fault in chaos_faults(text):
        assert math.isfinite(fault.size)


def _in_file(use: Callable[[str], object]) -> Callable[[bytes], None]:
    """Return a target for a reader that wants a path; the file is in memory where the system has such a folder."""
    folder = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    handle, path = tempfile.mkstemp(suffix=".log", dir=folder)
    Path(path).unlink()
    place = f"/proc/self/fd/{handle}"

    def take(data: bytes) -> None:
        os.ftruncate(handle, 0)
        os.pwrite(handle, data, 0)
        use(place)

    return take


def _sound(recording: Recording) -> None:
    """Times rise, and every value is a number."""
    for series in recording.series:
        assert series.time.shape == series.values.shape
        assert bool(np.all(np.isfinite(series.time))), series.quantity
        assert bool(np.all(np.diff(series.time) >= 0.0)), series.quantity
        assert bool(np.all(np.isfinite(series.values))), series.quantity


def _shipped(folder: str, pattern: str) -> list[bytes]:
    return [path.read_bytes() for path in sorted((ROOT / folder).glob(pattern))]


def _recordings() -> dict[str, list[bytes]]:
    """Return short sound logs of every kind."""
    sys.path[:0] = [str(ROOT / "tests"), str(ROOT / "tests" / "loop")]
    from boat_recordings import dataflash, tlog, tlog_events, zigzag_boat
    from test_px4_and_nmea_logs import ulog

    boat = zigzag_boat()
    short = type(boat)(*(column[: round(SECONDS / (boat.time[1] - boat.time[0]))] for column in boat))
    rows = [
        f"{t:.2f},{math.degrees(h):.2f},{v:.2f}" for t, h, v in zip(short.time, short.heading, short.speed, strict=True)
    ]
    return {
        "csv": ["\n".join(["time_s,heading_deg,speed_m_s", *rows[::10]]).encode()],
        "tlog": [tlog(tlog_events(short))],
        "own": [_own_log()],
        "dataflash": [dataflash(short)],
        "ulog": [ulog(short)],
        "nmea": [_nmea(short)],
    }


def _own_log() -> bytes:
    from autopilot.build import build_pilot
    from autopilot.signals import HeadingSample, Order, OrderKind

    vessel = load_vessel("lanxin")
    pilot = build_pilot(vessel)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "own.tlog"
        recorder = Recorder(path, {"vessel": dump_vessel(vessel), "law": None}, 0.0)
        for step in range(40):
            now = 0.05 * step
            order = Order(OrderKind.HEADING, 0.3, serial=1)
            recorder.record(pilot.step(now, (HeadingSample(now, 0.1, 0.0),), order), [])
        recorder.close()
        return path.read_bytes()


def _nmea(boat: object) -> bytes:
    from autopilot.links import nmea_encoders as encode

    lines = []
    for step in range(40):
        stamp = f"12:00:{step / 10:06.3f} ".encode()
        lines += [
            stamp + encode.encode_hdt(0.02 * step),
            stamp + encode.encode_rot(0.1),
            stamp + encode.encode_rsa(0.05),
        ]
    return b"".join(lines)
