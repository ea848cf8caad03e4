"""A ground station behind the pilot sees the flight controller through us and reads its parameters while we steer.

Steering is judged in lockstep, with pymavlink's station on a socket of this process; the commands, started as a user
would, are asked for what they pass on alone.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from alarm_texts import words_of
from lockstep import Lockstep
from pymavlink import mavutil
from two_processes import free_port, patient_vessel, simulator

from autopilot.cli.main import main
from autopilot.signals import HeadingSample, Mode
from autopilot.vessel.file import load_vessel

KEY = bytes.fromhex("ab" * 32)


class Station:
    """A program with pymavlink's mavutil behind the pilot: `turn` says what falls due, and hears what has come."""

    def __init__(self, key: bytes = b"") -> None:
        self.port = free_port()
        url = f"udpout:127.0.0.1:{self.port}"
        self.link: Any = mavutil.mavlink_connection(url, source_system=250, source_component=190)
        if key:
            self.link.setup_signing(key, initial_timestamp=1)
        self.heard: list[Any] = []
        self._next = 0.0

    def turn(self, boat: Lockstep) -> None:
        """A hook of the lockstep."""
        if boat.now >= self._next:
            self._next = boat.now + 1.0
            self.link.mav.heartbeat_send(6, 8, 0, 0, 4)
            self.ask()
        while (message := self.link.recv_match(blocking=False)) is not None:
            self.heard.append(message)

    def ask(self) -> None:
        """Ask for what is wanted, once a second."""


class Reader(Station):
    """Reads every parameter of the flight controller."""

    def ask(self) -> None:
        values = self.values()
        if not values:
            self.link.mav.param_request_list_send(1, 1)
        for index in [index for index in range(self.count()) if index not in values][:20]:
            self.link.mav.param_request_read_send(1, 1, b"", index)

    def values(self) -> dict[int, str]:
        """Return the names that have come, by index."""
        answers = [message for message in self.heard if message.get_type() == "PARAM_VALUE"]
        return {message.param_index: message.param_id for message in answers if message.param_index < 65535}

    def count(self) -> int:
        """Return how many there are, 0 before one has come."""
        return max((message.param_count for message in self.heard if message.get_type() == "PARAM_VALUE"), default=0)

    def is_done(self) -> bool:
        """Return whether all have come, and both who may be seen were."""
        return 0 < self.count() == len(self.values()) and len({sender(message) for message in self.heard}) > 1


class Logger(Station):
    """Asks for a stream once a second, as a logger does."""

    def ask(self) -> None:
        self.link.mav.request_data_stream_send(1, 1, 0, 1, 1)


def sender(message: Any) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


@contextlib.contextmanager
def steered(station: Station, options: str = "", key: bytes = b"") -> Iterator[Lockstep]:
    """Sail a boat that is steered, with `station` behind the pilot."""
    boat = Lockstep(load_vessel("lanxin"), key=key, forward=f"udpin:127.0.0.1:{station.port}{options}")
    with contextlib.closing(station.link), contextlib.closing(boat.session):
        boat.run(2.0)
        boat.engage(60.0)
        assert boat.run(20.0, boat.engaged)
        boat.hooks.append(station.turn)
        yield boat


def assert_steered_to_the_end(boat: Lockstep) -> None:
    """Nothing takes the helm or stops the steering, once it has begun."""
    modes = [tick.mode for tick in boat.ticks]
    left = next((tick for tick in [*boat.ticks][modes.index(Mode.ENGAGED) :] if tick.mode is not Mode.ENGAGED), None)
    assert left is None, words_of(left)


@pytest.fixture(autouse=True)
def _mavlink_2(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MAVLINK20", "1")
    mavutil.set_dialect("ardupilotmega")


@pytest.mark.parametrize("key", [b"", KEY], ids=["plain", "signed"])
def test_mavutil_behind_us_reads_every_parameter_of_the_vehicle_while_we_steer(key: bytes) -> None:
    station = Reader(key)
    with steered(station, key=key) as boat:
        assert boat.run(40.0, lambda _: station.is_done())
        since = len(station.heard)
        boat.run(5.0)
    assert station.count() == len(boat.firmware.parameters) > 50
    assert {sender(message) for message in station.heard} == {(1, 1), (1, 191)}
    assert any(message.get_type() == "ATTITUDE" for message in station.heard[since:])
    assert_steered_to_the_end(boat)


def test_a_logger_behind_a_slow_radio_gets_two_headings_a_second_while_we_steer_by_all() -> None:
    station = Logger()
    with steered(station, "?rate=ATTITUDE:2,others:0") as boat:
        since = len(boat.ticks)
        boat.run(20.0)
    kinds = Counter(message.get_type() for message in station.heard if message.get_srcSystem() == 1)
    times = [message.time_boot_ms / 1000.0 for message in station.heard if message.get_type() == "ATTITUDE"]
    assert len(times) > 24
    assert (times[-1] - times[3]) / (len(times) - 4) == pytest.approx(0.5, rel=0.1), "by the time of the vehicle"
    assert kinds["HEARTBEAT"] > 10 and "VFR_HUD" not in kinds, "it stays seen, and no more"
    ticks = [*boat.ticks][since:]
    headings = {sample.time for tick in ticks for sample in tick.samples if isinstance(sample, HeadingSample)}
    assert len(headings) > 9.0 * 2.0 * (max(headings) - min(headings)), "we steer by all, not by what is passed on"
    assert_steered_to_the_end(boat)


PARAMETERS = """
import json, sys, time
from pymavlink import mavutil
link = mavutil.mavlink_connection(sys.argv[1], source_system=250, source_component=190)
link.setup_signing(bytes.fromhex(sys.argv[2]))
link.target_system = link.target_component = 1
senders, values, count, asked, beat, until = set(), {}, None, 0.0, 0.0, time.monotonic() + 150
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
print(json.dumps({"senders": sorted(senders), "count": count, "got": len(values)}))
"""


def test_run_passes_on_what_a_signed_station_behind_it_asks_the_vehicle(tmp_path: Path) -> None:
    port, behind, key = free_port(), free_port(), tmp_path / "signing.key"
    key.write_text(KEY.hex())
    key.chmod(0o600)
    ours = ["--signing-key", str(key)]
    command = [sys.executable, "-m", "autopilot", "run", str(patient_vessel(tmp_path)), "--as-gcs", *ours]
    command += ["--link", f"udpin:127.0.0.1:{port}", "--forward", f"udpin:127.0.0.1:{behind}"]
    station = [sys.executable, "-W", "ignore", "-c", PARAMETERS, f"udpout:127.0.0.1:{behind}", KEY.hex()]
    with (
        simulator(1, "--mavlink", f"udpout:127.0.0.1:{port}", *ours),
        subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        ) as pilot,
    ):
        done = subprocess.run(
            station, capture_output=True, text=True, timeout=200, check=False, env={**os.environ, "MAVLINK20": "1"}
        )
        pilot.terminate()
        _, err = pilot.communicate(timeout=60)
    assert done.returncode == 0, done.stderr
    assert (pilot.returncode, err) == (0, "")
    seen = json.loads(done.stdout.strip().splitlines()[-1])
    assert seen["count"] > 50 and seen["got"] == seen["count"]
    assert seen["senders"] == [[1, 1], [1, 191]]


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
