"""A whole `autopilot run` process under attack at line rate: is anything obeyed, and how late does its loop get?

    python benchmarks/attacked_loop.py [--seconds 60] [--json]

A stand-in flight controller sends signed ATTITUDE at 50 Hz and times each until the RC_CHANNELS_OVERRIDE that answers
it. An attacker in a process of its own sends forged frames as fast as it can: unsigned, with a wrong key, recorded from
the true station and sent again, with an old timestamp, damaged, cut off, made of beginnings, from wrong ids; commands
to disarm, mode changes and parameter writes. It sends them to the vehicle's port, to that of a ground station that is
served over UDP, and, as the one client there may be, over TCP. In turn, two seconds of each:

- quiet: the attacker sleeps;
- elsewhere: it sends as fast to a program that throws all away, so that the machine is as busy;
- attacked: it sends to the pilot.

Attacker and program are of the lowest priority: on a boat they are other machines.
Lateness is the time from heading to order above its median in the quiet blocks. Linux only.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from importlib import resources
from pathlib import Path

from forged_frames import forgers, station
from latency import Vehicle, cpu_seconds, free_port, percentile
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.links.mavlink.signing import CountingTimestamps, LinkSigning, Signing, clock_timestamp

KEY = bytes(range(32))
RATE_HZ = 50
BLOCK_S = 2.0
CONDITIONS = ("quiet", "elsewhere", "attacked")
HEADING_DEG = 30.0
PATIENCE_S = 40.0
Process = subprocess.Popen[str]
ATTACKER = """
import os, random, socket, sys, time
os.nice(19)
pool = [bytes.fromhex(line) for line in open(sys.argv[1]).read().split()]
ports = dict(zip(("vehicle", "station", "tcp", "sink", "sink_tcp"), map(int, sys.argv[2:])))
udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
udp.setblocking(False)
def connected(port):
    line = socket.create_connection(("127.0.0.1", port))
    line.setblocking(False)
    return line
lines = {"attacked": connected(ports["tcp"]), "elsewhere": connected(ports["sink_tcp"])}
goals = {"attacked": (ports["vehicle"], ports["station"]), "elsewhere": (ports["sink"], ports["sink"])}
stream = b"".join(pool[:500])
print("ready", flush=True)
for order in sys.stdin:
    kind, seconds = order.split()
    until, sent = time.monotonic() + float(seconds), 0
    while kind != "quiet" and time.monotonic() < until:
        for frame in random.sample(pool, 100):
            for port in goals[kind]:
                try:
                    udp.sendto(frame, ("127.0.0.1", port))
                    sent += 1
                except (BlockingIOError, ConnectionRefusedError):
                    pass
        try:
            sent += lines[kind].send(stream) * 500 // len(stream)
        except BlockingIOError:
            pass
        except OSError:
            lines[kind] = connected(ports["tcp" if kind == "attacked" else "sink_tcp"])
    time.sleep(max(0.0, until - time.monotonic()))
    print(sent, flush=True)
"""
SINK = """
import os, select, socket
os.nice(19)
udp, tcp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM), socket.create_server(("127.0.0.1", 0))
udp.bind(("127.0.0.1", 0))
print(udp.getsockname()[1], tcp.getsockname()[1], flush=True)
lines = [udp, tcp]
while True:
    for line in select.select(lines, (), ())[0]:
        if line is tcp:
            lines.append(tcp.accept()[0])
        elif not line.recv(65536):
            raise SystemExit
"""


class SignedVehicle(Vehicle):
    """The stand-in of the latency study, with a key."""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self._codec = MavlinkCodec(1, 1, signing=Signing(KEY, CountingTimestamps(clock_timestamp())).link())

    def housekeeping_now(self) -> None:
        """Send heartbeat and pulse, ten times a second."""
        self.housekeeping(0)


def pool_of_forged(count: int) -> tuple[list[bytes], dict[str, int]]:
    """Return forged frames of every kind for which no key is needed, and how many kinds there are."""
    rng = random.Random(5)
    true = station(KEY, clock_timestamp() - 10**8)
    disarm = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_COMPONENT_ARM_DISARM, 0, 0, 0, 0, 0, 0, 0, 0)
    turn = dialect.MAVLink_command_long_message(1, 1, dialect.MAV_CMD_CONDITION_YAW, 0, 200, 0, 0, 0, 0, 0, 0)
    tune = dialect.MAVLink_param_set_message(1, 1, b"BS_K1", 0.9, 9)
    modes = [dialect.MAVLink_set_mode_message(1, 1, mode) for mode in (0, 15)]
    beat = dialect.MAVLink_heartbeat_message(11, 3, 1, 4, dialect.MAV_STATE_ACTIVE, 3)
    recorded = [true.encode(message) for message in [disarm, turn, tune, beat, *modes] * 20]
    makers = forgers(recorded, rng, [disarm, turn, tune, beat, *modes])
    makers.pop("right key, id not allowed")
    kinds = dict.fromkeys(makers, 0)
    frames = []
    for number in range(count):
        name = list(makers)[number % len(makers)]
        frames.append(makers[name]())
        kinds[name] += 1
    rng.shuffle(frames)
    return frames, kinds


class TrueStation:
    """A ground station with the key, over UDP: latched on to from the start, it looks at what the boat tells."""

    def __init__(self, port: int) -> None:
        self._line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._line.connect(("127.0.0.1", port))
        self._line.setblocking(False)
        signing = Signing(KEY, CountingTimestamps(clock_timestamp()))
        self._codec = MavlinkCodec(255, 190, signing=LinkSigning(signing, 0))
        self.received: dict[str, float] = {}

    def turn(self) -> None:
        """Say that we are here, ask for a number, and read what came."""
        for message in (
            dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 0, 3),
            dialect.MAVLink_param_request_read_message(1, 1, b"BS_K1", -1),
        ):
            try:
                self._line.send(self._codec.encode(message))
            except ConnectionRefusedError:
                return
        while True:
            try:
                data = self._line.recv(2048)
            except (BlockingIOError, ConnectionRefusedError):
                return
            for message in self._codec.decode(data):
                kind = message.get_type()
                if kind == "PARAM_VALUE":
                    self.received["BS_K1"] = message.param_value
                    self.received["answers"] = self.received.get("answers", 0) + 1
                elif kind == "NAV_CONTROLLER_OUTPUT":
                    self.received["target_deg"] = message.target_bearing
                elif kind == "HEARTBEAT":
                    self.received["mode"] = message.custom_mode


def vessel_file(folder: Path) -> Path:
    """Write the shipped boat with a loop of RATE_HZ, hearing system 255 alone on its ground links."""
    text = resources.files("firmware_params").joinpath("vessels/lanxin.yaml").read_text()
    text = re.sub(r"(?m)^(\s+rate_hz:) \S+", rf"\1 {RATE_HZ}.0", text, count=1)
    path = folder / "attacked.yaml"
    path.write_text(text + "\nsecurity:\n  allow_systems: [255]\n")
    return path


def exchange(
    vehicle: SignedVehicle,
    true: TrueStation,
    attacker: subprocess.Popen[str],
    pilot: subprocess.Popen[str],
    blocks: int,
) -> dict:
    """Engage, then go through the conditions `blocks` times; return times [us], unanswered and frames sent of each."""
    period, tick = 1.0 / RATE_HZ, 0
    times: dict[str, list[float]] = {name: [] for name in CONDITIONS}
    missed = dict.fromkeys(CONDITIONS, 0)
    frames = dict.fromkeys(CONDITIONS, 0)
    busy = dict.fromkeys(CONDITIONS, 0.0)

    def one(name: str | None) -> bool:
        nonlocal tick
        due = started + tick * period
        time.sleep(max(0.0, due - time.perf_counter()))
        vehicle.answers(time.perf_counter() + 1e-5)
        sent = time.perf_counter()
        vehicle.send(vehicle.attitude())
        arrived = vehicle.answers(max(due, sent) + 0.8 * period)
        if name is not None:
            if arrived:
                times[name].append((arrived[0] - sent) * 1e6)
            else:
                missed[name] += 1
        if tick % (RATE_HZ // 10) == 0:
            vehicle.housekeeping_now()
        if tick % RATE_HZ == 0:
            true.turn()
        tick += 1
        return bool(arrived)

    started = time.perf_counter()
    while sum(one(None) for _ in range(RATE_HZ)) < RATE_HZ // 2:
        if time.perf_counter() - started > PATIENCE_S:
            raise SystemExit("the pilot did not engage")
    assert attacker.stdin is not None and attacker.stdout is not None
    for _ in range(blocks):
        for name in CONDITIONS:
            attacker.stdin.write(f"{name} {BLOCK_S}\n")
            attacker.stdin.flush()
            started, tick, used = time.perf_counter(), 0, cpu_seconds(pilot)
            for _ in range(int(BLOCK_S * RATE_HZ)):
                one(name)
            busy[name] += (cpu_seconds(pilot) - used) / (time.perf_counter() - started) / blocks
            frames[name] += int(attacker.stdout.readline())
    return {"times": times, "missed": missed, "frames": frames, "busy": busy}


def run(seconds: float) -> tuple[dict, dict, str]:
    """Start all, measure, stop all; return the measurement, what the true station received, and the pilot's output."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        key = folder / "signing.key"
        key.write_text(KEY.hex() + "\n")
        key.chmod(0o600)
        frames, _ = pool_of_forged(20_000)
        (folder / "pool").write_text("\n".join(frame.hex() for frame in frames))
        ports = {what: free_port() for what in ("vehicle", "station", "tcp")}
        command = [sys.executable, "-m", "autopilot", "run", str(vessel_file(folder)), "--as-gcs"]
        command += ["--link", f"udpin:127.0.0.1:{ports['vehicle']}", "--engage", str(HEADING_DEG)]
        command += ["--serve", f"udpin:127.0.0.1:{ports['station']}", "--serve", f"tcpin:127.0.0.1:{ports['tcp']}"]
        command += ["--signing-key", str(key)]
        with (folder / "output").open("w+") as output:
            pilot = subprocess.Popen(command, stdout=output, stderr=output, stdin=subprocess.DEVNULL, text=True)
            sink = subprocess.Popen([sys.executable, "-c", SINK], stdout=subprocess.PIPE, text=True)
            others = [sink]
            try:
                vehicle, true = SignedVehicle(ports["vehicle"]), TrueStation(ports["station"])
                await_tcp(ports["tcp"])
                assert sink.stdout is not None
                goals = [str(port) for port in ports.values()] + sink.stdout.readline().split()
                attacker = subprocess.Popen(
                    [sys.executable, "-c", ATTACKER, str(folder / "pool"), *goals],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    text=True,
                )
                others.append(attacker)
                assert attacker.stdout is not None
                attacker.stdout.readline()
                measured = exchange(vehicle, true, attacker, pilot, max(1, round(seconds / BLOCK_S)))
            finally:
                for process in (*others, pilot):
                    process.terminate()
                    process.wait()
        return measured, true.received, (folder / "output").read_text()


def await_tcp(port: int) -> None:
    """Wait until the pilot listens."""
    until = time.monotonic() + PATIENCE_S
    while time.monotonic() < until:
        try:
            socket.create_connection(("127.0.0.1", port)).close()
        except ConnectionRefusedError:
            time.sleep(0.1)
        else:
            return
    raise SystemExit("the pilot does not listen")


def summary(measured: dict) -> dict[str, dict[str, float]]:
    """Return each condition's figures."""
    quiet = statistics.median(measured["times"]["quiet"])
    table = {}
    for name, times in measured["times"].items():
        late = [each - quiet for each in times]
        table[name] = {
            "headings": len(times) + measured["missed"][name],
            "unanswered": measured["missed"][name],
            "median_ms": statistics.median(times) / 1000.0,
            "late_p99_ms": percentile(late, 0.99) / 1000.0,
            "late_p999_ms": percentile(late, 0.999) / 1000.0,
            "cpu_percent": 100.0 * measured["busy"][name],
            "frames": measured["frames"][name],
            "frames_a_second": measured["frames"][name] / (len(times) + measured["missed"][name]) * RATE_HZ,
        }
    return table


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=60.0, help="time of each of the three conditions")
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")
    arguments = parser.parse_args()
    measured, received, output = run(arguments.seconds)
    table = summary(measured)
    refused = [line for line in output.splitlines() if "refused" in line or "let in" in line]
    if arguments.json:
        print(
            json.dumps({"table": table, "received": received, "refused": refused, "load": os.getloadavg()[0]}, indent=2)
        )
        return
    print(f"{RATE_HZ} Hz loop, {os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}")
    print(f"{'':18s}" + "".join(f"{name:>14s}" for name in table))
    for key in next(iter(table.values())):
        print(f"{key:18s}" + "".join(f"{figures[key]:14.2f}" for figures in table.values()))
    print(f"what the true station received at the end: {received}")
    print(*refused, sep="\n")


if __name__ == "__main__":
    main()
