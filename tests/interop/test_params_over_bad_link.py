"""`autopilot params` against `sitl serve` as its own process, over a UDP relay that loses, repeats and reorders."""

from __future__ import annotations

import random
import select
import socket
import struct
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from two_processes import free_port, simulator

from autopilot.cli.main import main
from autopilot.firmware import session
from autopilot.firmware.foreign_files import read_foreign
from sitl.firmware_parameters import default_parameters


class Relay(threading.Thread):
    """Passes datagrams between `vehicle_port` (where the vehicle sends) and `client_port`."""

    def __init__(self, loss: float) -> None:
        super().__init__(daemon=True)
        self.loss = loss
        self.random = random.Random(7)
        self.ears = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2)]
        for ear in self.ears:
            ear.bind(("127.0.0.1", 0))
        self.vehicle_port = int(self.ears[0].getsockname()[1])
        self.client_port = free_port()
        self.vehicle: tuple[str, int] | None = None
        self.stop = threading.Event()

    def run(self) -> None:
        under_way: list[tuple[float, int, int, bytes]] = []
        number = 0
        while not self.stop.is_set():
            for ear in select.select(self.ears, [], [], 0.002)[0]:
                data, sender = ear.recvfrom(4096)
                side = self.ears.index(ear)
                if side == 0:
                    self.vehicle = sender
                for _ in range(2 if self.random.random() < 0.1 else 1):
                    if self.random.random() >= self.loss:
                        number += 1
                        under_way.append((time.monotonic() + self.random.uniform(0.0, 0.03), number, side, data))
            now = time.monotonic()
            for _, _, side, data in sorted(each for each in under_way if each[0] <= now):
                if side == 0:
                    self.ears[1].sendto(data, ("127.0.0.1", self.client_port))
                elif self.vehicle is not None:
                    self.ears[0].sendto(data, self.vehicle)
            under_way = [each for each in under_way if each[0] > now]

    def close(self) -> None:
        self.stop.set()
        self.join()
        for ear in self.ears:
            ear.close()


@pytest.fixture
def relay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Relay]:
    monkeypatch.setenv("NORRBIN_STATE", str(tmp_path / "state"))
    monkeypatch.setattr(session, "OTHERS_WAIT_S", 0.1)
    monkeypatch.setattr("autopilot.firmware.upload.SETTLE_S", 0.05)
    monkeypatch.chdir(tmp_path)
    running = Relay(0.3)
    running.start()
    with simulator(5.0, "--disarmed", "--mavlink", f"udpout:127.0.0.1:{running.vehicle_port}"):
        yield running
    running.close()


def held_by(file: str) -> dict[str, bytes]:
    return {each.name: struct.pack("<f", each.value) for each in read_foreign(file).values}


def test_download_and_upload_are_complete_and_exact(relay: Relay, capsys: pytest.CaptureFixture[str]) -> None:
    link = ("--link", f"udpin:127.0.0.1:{relay.client_port}")
    assert main(["params", "download", "before.params", *link]) == 0
    before = held_by("before.params")
    assert before.keys() == {each.name for each in default_parameters()}
    new = dict.fromkeys(("CRUISE_SPEED", "TURN_RADIUS", "WP_RADIUS"), 3.25)
    new |= {f"RC{number}_OPTION": number for number in range(5, 15)}
    Path("new.parm").write_text("".join(f"{name} {value}\n" for name, value in new.items()))
    assert main(["params", "upload", "new.parm", *link]) == 0
    assert main(["params", "verify", "new.parm", *link]) == 0
    assert f"{len(new)} unchanged" in capsys.readouterr().out
    names = ",".join([*new, "SERVO1_FUNCTION", "RC1_OPTION"])
    assert main(["params", "download", "after.params", "--names", names, *link]) == 0
    after = held_by("after.params")
    assert after == {name: struct.pack("<f", new[name]) if name in new else before[name] for name in after}
    assert len(after) == len(new) + 2
