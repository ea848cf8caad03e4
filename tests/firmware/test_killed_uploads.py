"""SIGKILL at random moments of an upload: after `restore` the vehicle holds exactly the old or the new set."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest
from served_vehicle import ServedVehicle
from two_processes import free_port

pytestmark = pytest.mark.real_time
PATIENCE_S = 60.0


class Zygote:
    """Starts `autopilot` commands by fork."""

    def __init__(self, folder: Path) -> None:
        environment = {**os.environ, "NORRBIN_STATE": str(folder / "state")}
        script = Path(__file__).parents[1] / "zygote.py"
        self.output = folder / "output.txt"
        self._process = subprocess.Popen(
            [sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment, text=True
        )

    def start(self, *words: str) -> int:
        assert self._process.stdin and self._process.stdout
        print(json.dumps([str(self.output), *words]), file=self._process.stdin, flush=True)
        return int(self._process.stdout.readline())

    def wait(self) -> int:
        assert self._process.stdout
        return int(self._process.stdout.readline())

    def run(self, *words: str) -> int:
        self.start(*words)
        return self.wait()

    def close(self) -> None:
        self._process.stdin.close()
        self._process.wait(60.0)
        self._process.stdout.close()


@pytest.fixture
def zygote(tmp_path: Path) -> Iterator[Zygote]:
    running = Zygote(tmp_path)
    yield running
    running.close()


@pytest.fixture
def served() -> Iterator[ServedVehicle]:
    vehicle = ServedVehicle(free_port())
    vehicle.start()
    yield vehicle
    vehicle.stop.set()
    vehicle.join()


def single(value: float) -> float:
    return float(struct.unpack("<f", struct.pack("<f", value))[0])


Table = dict[str, tuple[float, int]]

RNG = random.Random(50)
PLAIN: Table = {f"P{number:02d}": (single(RNG.uniform(-9.0, 9.0)), 9) for number in range(40)}
SHIFTED: Table = {name: (single(value + 1.5), kind) for name, (value, kind) in PLAIN.items()}
GROUP: Table = {"GRP_ENABLE": (0, 2), "GRP_GAIN": (1.0, 9)}
GROUP_ON: Table = {"GRP_ENABLE": (1, 2), "GRP_GAIN": (2.5, 9)}


@pytest.mark.parametrize(
    ("old", "new", "kills"),
    [(PLAIN, SHIFTED, 15), (PLAIN, SHIFTED, 50), (PLAIN | GROUP, SHIFTED | GROUP_ON, 2)],
    ids=["plain", "plain, often", "enabling"],
)
def test_after_a_kill_the_vehicle_is_wholly_old_or_wholly_new(
    old: Table, new: Table, kills: int, zygote: Zygote, served: ServedVehicle, tmp_path: Path
) -> None:
    file = tmp_path / "new.parm"
    file.write_text("".join(f"{name} {value!r}\n" for name, (value, _) in reversed(new.items())))
    link = ("--link", f"udpin:127.0.0.1:{served.address[1]}")
    hidden = {"GRP_GAIN": GROUP["GRP_GAIN"]} if "GRP_GAIN" in old else {}

    def start_afresh() -> None:
        served.vehicle.table = {name: list(entry) for name, entry in old.items() if name not in hidden}
        served.vehicle.enables = {"GRP_ENABLE": hidden}

    def held() -> Table:
        return hidden | {name: (value, kind) for name, (value, kind) in served.vehicle.table.items()}

    start_afresh()
    assert zygote.run("params", "upload", str(file), *link, "--no-backup") == 0
    assert held() == new
    ends = Counter[str]()
    for _ in range(kills):
        start_afresh()
        child = zygote.start("params", "upload", str(file), *link, "--no-backup")
        sets = RNG.randint(0, len(new))
        kill_after = served.vehicle.sets_received + sets
        # on a busy machine the kill comes late: until then the upload gets no further
        served.vehicle.deaf_after = kill_after
        deadline = time.monotonic() + PATIENCE_S
        while served.vehicle.sets_received < kill_after:
            assert time.monotonic() < deadline, "the upload got no further by itself"
            time.sleep(0.0005)
        if sets in (0, len(new)):  # before its first set, or while it settles and reads back
            time.sleep(RNG.uniform(0.0, 0.5))
        with contextlib.suppress(ProcessLookupError):  # it was done before
            os.kill(child, signal.SIGKILL)
        status = zygote.wait()
        served.vehicle.deaf_after = None
        assert status in (0, -signal.SIGKILL)
        ends["mixed after the kill"] += held() not in (old, new)
        assert zygote.run("params", "restore", *link) == 0, zygote.output.read_text()
        said = zygote.output.read_text()
        if "exactly the new values" in said or status == 0:
            assert held() == new
            ends["new"] += 1
        else:
            assert "exactly the old values" in said or "no upload was cut off" in said
            # killed between its last deed and its end, an upload is done: nothing was cut off
            is_done = "no upload was cut off" in said and held() == new
            assert is_done or held() == old
            ends["new" if is_done else "old"] += 1
    assert ends["mixed after the kill"] >= kills // 3, f"the kills came too early or too late: {ends}"
