"""Heading in to rudder out through the whole `autopilot run` process, beside a bare UDP echo process.

    python benchmarks/latency.py [--seconds 20] [--json]

A stand-in for an ArduRover boat sends ATTITUDE at 100 Hz on loopback UDP and times each datagram until the
RC_CHANNELS_OVERRIDE that answers it. Later in the same period the same datagram goes to two Python processes:
one sends back what it gets, the other does the least that a steering bridge in Python can, pymavlink's own
decoding of the heading and its own packing of an override, with no autopilot in between. All meet the same
machine at the same moment. The ratios are the figures to trust; the microseconds are those of this machine on
this day. Linux only: CPU time is read from /proc.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from importlib import resources
from pathlib import Path
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec
from sitl.firmware_parameters import default_parameters

RATE_HZ = 100
ENGAGE_PATIENCE_S = 15.0
BLOCK = 200
OVERRIDE = dialect.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE
ECHO = """
import socket
line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
line.bind(("127.0.0.1", 0))
print(line.getsockname()[1], flush=True)
while True:
    data, sender = line.recvfrom(2048)
    line.sendto(data, sender)
"""


RELAY = """
import socket
from pymavlink.dialects.v20 import ardupilotmega as dialect
line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
line.bind(("127.0.0.1", 0))
print(line.getsockname()[1], flush=True)
codec = dialect.MAVLink(None, srcSystem=255, srcComponent=190)
while True:
    data, sender = line.recvfrom(2048)
    attitude = codec.decode(bytearray(data))
    pulse = 1500 + int(100.0 * attitude.yaw)
    override = dialect.MAVLink_rc_channels_override_message(1, 1, pulse, *[65535] * 7)
    line.sendto(override.pack(codec), sender)
"""


class Measured(NamedTuple):
    """Round trips [us] in order, datagrams without exactly one answer, and the pilot's share of a core."""

    pilot_us: list[float]
    echo_us: list[float]
    relay_us: list[float]
    unpaired: int
    cpu_percent: float


class Vehicle:
    """As much of an ArduRover boat as a companion needs before it steers."""

    def __init__(self, port: int) -> None:
        self.line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.line.connect(("127.0.0.1", port))
        self._codec = MavlinkCodec(1, 1)
        self._start = time.perf_counter()
        self._sent = 0
        self._parameters = {row.name: row.value for row in default_parameters()} | {"SYSID_MYGCS": 255.0}
        self.pulse = 0

    def attitude(self) -> bytes:
        """Return the next ATTITUDE: a boat that yaws a little about 30 deg."""
        self._sent += 1
        yaw = 0.52 + 0.01 * ((self._sent // 50) % 2)
        boot_ms = int((time.perf_counter() - self._start) * 1000.0)
        return self._codec.encode(dialect.MAVLink_attitude_message(boot_ms, 0.0, 0.0, yaw, 0.0, 0.0, 0.0))

    def send(self, packet: bytes) -> None:
        """Send a packet; while the pilot is still starting nobody takes it."""
        with contextlib.suppress(ConnectionRefusedError):
            self.line.send(packet)

    def housekeeping(self, tick: int) -> None:
        """Send the heartbeat once a second, and ten times the pulse as it was commanded."""
        if tick % RATE_HZ == 0:
            armed = dialect.MAV_MODE_FLAG_SAFETY_ARMED
            self._send(dialect.MAVLink_heartbeat_message(11, 3, armed | 1, 0, dialect.MAV_STATE_ACTIVE, 3))
        if tick % (RATE_HZ // 10) == 0:
            boot_ms = int((time.perf_counter() - self._start) * 1000.0)
            self._send(dialect.MAVLink_rc_channels_message(boot_ms, 8, self.pulse or 1500, *[1500] * 17, 255))

    def answers(self, until: float) -> list[float]:
        """Answer parameter requests until `until` [s]; return when each override arrived."""
        times: list[float] = []
        while (left := until - time.perf_counter()) > 0.0:
            self.line.settimeout(left)
            try:
                data = self.line.recv(2048)
            except (TimeoutError, ConnectionRefusedError):
                continue
            arrived = time.perf_counter()
            if data[7] == OVERRIDE and data[8:10] == b"\0\0":
                times.append(arrived)
            self._take(data)
        return times

    def _take(self, data: bytes) -> None:
        for message in self._codec.decode(data):
            if message.id == OVERRIDE and message.chan1_raw not in (0, 65535):
                self.pulse = message.chan1_raw
            elif message.id == dialect.MAVLINK_MSG_ID_PARAM_REQUEST_READ and message.param_id in self._parameters:
                name, count = message.param_id, len(self._parameters)
                self._send(dialect.MAVLink_param_value_message(name.encode(), self._parameters[name], 9, count, 0))

    def _send(self, message: object) -> None:
        self.send(self._codec.encode(message))


def cpu_seconds(process: subprocess.Popen[str]) -> float:
    """Return the user and system time [s] a process has used."""
    fields = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / float(os.sysconf("SC_CLK_TCK"))


def free_port() -> int:
    """Return a UDP port that is free now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as line:
        line.bind(("127.0.0.1", 0))
        return int(line.getsockname()[1])


def vessel_file(folder: Path) -> Path:
    """Write the shipped boat with a 100 Hz loop and return the file."""
    text = resources.files("firmware_params").joinpath("vessels/lanxin.yaml").read_text()
    faster, found = re.subn(r"(?m)^(\s+rate_hz:) \S+", rf"\1 {RATE_HZ}.0", text)
    if found != 1:
        raise SystemExit("lanxin.yaml: expected one rate_hz")
    path = folder / "lanxin_100hz.yaml"
    path.write_text(faster)
    return path


def measure(seconds: float, log: bool) -> Measured:
    """Start pilot and echo, engage, and time both for `seconds`."""
    with tempfile.TemporaryDirectory() as name:
        folder, port = Path(name), free_port()
        command = [sys.executable, "-m", "autopilot", "run", str(vessel_file(folder)), "--as-gcs"]
        command += ["--link", f"udpin:127.0.0.1:{port}", "--engage", "30"]
        command += ["--log", str(folder / "latency.tlog")] if log else []
        with (folder / "output").open("w+") as output:
            pilot = subprocess.Popen(command, stdout=output, stderr=output, stdin=subprocess.DEVNULL, text=True)
            peers = [
                subprocess.Popen([sys.executable, "-c", text], stdout=subprocess.PIPE, text=True)
                for text in (ECHO, RELAY)
            ]
            try:
                result = exchange(Vehicle(port), pilot, [line_to(peer) for peer in peers], seconds)
            except TimeoutError as error:
                raise SystemExit(f"{error}: {(folder / 'output').read_text()}") from None
            finally:
                for process in (pilot, *peers):
                    process.terminate()
                    process.communicate()
    return result


def line_to(peer: subprocess.Popen[str]) -> socket.socket:
    """Return a socket connected to the port that a peer prints first."""
    assert peer.stdout is not None
    line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    line.connect(("127.0.0.1", int(peer.stdout.readline())))
    line.settimeout(1.0)
    return line


def round_trip_us(line: socket.socket, datagram: bytes) -> float:
    """Return the time [us] a datagram takes to a peer and its answer back."""
    sent = time.perf_counter()
    line.send(datagram)
    line.recv(2048)
    return (time.perf_counter() - sent) * 1e6


def exchange(vehicle: Vehicle, pilot: subprocess.Popen[str], peers: list[socket.socket], seconds: float) -> Measured:
    """Engage the pilot, then send to it, to the echo and to the relay in turn, within one period."""
    echo, relay = peers
    period, started = 1.0 / RATE_HZ, time.perf_counter()
    pilot_us: list[float] = []
    echo_us: list[float] = []
    relay_us: list[float] = []
    unpaired = tick = engaged_ticks = 0
    cpu_before = measured_from = 0.0
    while len(pilot_us) + unpaired < seconds * RATE_HZ:
        due = started + tick * period
        time.sleep(max(0.0, due - time.perf_counter()))
        datagram = vehicle.attitude()
        stale = vehicle.answers(time.perf_counter() + 1e-5)
        sent = time.perf_counter()
        vehicle.send(datagram)
        arrived = vehicle.answers(due + 0.5 * period)
        engaged_ticks += bool(arrived)
        if engaged_ticks == 2 * RATE_HZ and not measured_from:
            measured_from, cpu_before = time.perf_counter(), cpu_seconds(pilot)
        if measured_from:
            paired = len(arrived) == 1 and not stale
            unpaired += not paired
            echoed = round_trip_us(echo, datagram)
            time.sleep(max(0.0, due + 0.75 * period - time.perf_counter()))
            relayed = round_trip_us(relay, datagram)
            if paired:
                echo_us.append(echoed)
                relay_us.append(relayed)
                pilot_us.append((arrived[0] - sent) * 1e6)
        elif time.perf_counter() - started > ENGAGE_PATIENCE_S:
            raise TimeoutError("the pilot did not engage")
        vehicle.housekeeping(tick)
        tick += 1
    used = cpu_seconds(pilot) - cpu_before
    for line in (echo, relay, vehicle.line):
        line.close()
    return Measured(pilot_us, echo_us, relay_us, unpaired, 100.0 * used / (time.perf_counter() - measured_from))


def percentile(values: list[float], share: float) -> float:
    """Return the value below which `share` of the values lie."""
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


def summary(measured: Measured) -> dict[str, float]:
    """Return the figures of one measurement; the best block is the least disturbed by other processes."""
    pilot, echo = measured.pilot_us, measured.echo_us
    blocks = [
        statistics.median(pilot[start : start + BLOCK]) / statistics.median(echo[start : start + BLOCK])
        for start in range(0, len(pilot) - BLOCK + 1, BLOCK)
    ]
    figures = {
        "pilot_p50_us": percentile(pilot, 0.5),
        "pilot_p99_us": percentile(pilot, 0.99),
        "echo_p50_us": percentile(echo, 0.5),
        "echo_p99_us": percentile(echo, 0.99),
        "relay_p50_us": percentile(measured.relay_us, 0.5),
        "relay_p99_us": percentile(measured.relay_us, 0.99),
    }
    figures["relay_ratio_p50"] = figures["relay_p50_us"] / figures["echo_p50_us"]
    figures["ratio_p50"] = figures["pilot_p50_us"] / figures["echo_p50_us"]
    figures["ratio_p99"] = figures["pilot_p99_us"] / figures["echo_p99_us"]
    figures["ratio_p50_block_min"] = min(blocks, default=figures["ratio_p50"])
    figures["ratio_p50_block_max"] = max(blocks, default=figures["ratio_p50"])
    return {
        **figures,
        "answered": len(pilot),
        "unpaired": measured.unpaired,
        "cpu_percent_of_a_core": measured.cpu_percent,
    }


def main() -> None:
    """Measure without and with a log, and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="time measured in each of the two runs")
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")
    arguments = parser.parse_args()
    table = {name: summary(measure(arguments.seconds, log)) for name, log in (("no log", False), ("--log", True))}
    if arguments.json:
        print(json.dumps({**table, "load_average": os.getloadavg()[0], "cores": os.cpu_count()}, indent=2))
        return
    print(f"{RATE_HZ} Hz loop, {os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}")
    print(f"{'':28s}" + "".join(f"{name:>10s}" for name in table))
    for key in next(iter(table.values())):
        print(f"{key:28s}" + "".join(f"{figures[key]:10.2f}" for figures in table.values()))


if __name__ == "__main__":
    main()
