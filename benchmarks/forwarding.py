"""What passing a 50 Hz stream on to a ground station costs, beside MAVProxy passing on the same.

    python benchmarks/forwarding.py [--seconds 20] [--rounds 3] [--mavproxy COMMAND] [--json]

A stand-in for an ArduRover boat sends what a companion's line carries, 50 ATTITUDE a second among it, on loopback
UDP. Each program has it in turn, several rounds: the whole `autopilot run`, which steers by it at 50 Hz, without
`--forward`, with it, and with the headings thinned to two a second; MAVProxy with one `--out`, and without; and both
forwarding with the boat on a serial line, a pseudo-terminal that names 921600 baud. A sink counts what comes out.
Figures are processor time from /proc as a share of one core. MAVProxy is looked for on the PATH (`pip install
MAVProxy`); without it its rows are missing. Linux only.
"""

from __future__ import annotations

import argparse
import json
import os
import pty
import shlex
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import tty
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from latency import Vehicle, cpu_seconds, free_port
from pymavlink.dialects.v20 import ardupilotmega as dialect

from autopilot.links.mavlink.codec import MavlinkCodec
from autopilot.vessel.file import dump_vessel, load_vessel

RATE_HZ = 50
SETTLE_S = 8.0
"""Start, parameters and engaging are over by then."""
STREAM_HZ = {
    "ATTITUDE": 50,
    "SERVO_OUTPUT_RAW": 10,
    "VFR_HUD": 10,
    "RC_CHANNELS": 10,
    "GLOBAL_POSITION_INT": 5,
    "GPS_RAW_INT": 5,
    "SYS_STATUS": 2,
    "HEARTBEAT": 1,
}
"""Messages of the stand-in by their rates: 93 a second."""


class Case(NamedTuple):
    """A program under test: its command, the port where what it passes on comes out, 0 where nothing does, and the
    serial line to the boat as (our end, name), None: UDP."""

    command: list[str]
    sink: int
    line: tuple[int, str] | None = None


class Boat(Vehicle):
    """The stand-in with a whole companion's stream."""

    def __init__(self, port: int) -> None:
        super().__init__(port)
        self.sent: Counter[str] = Counter()
        self.overrides = 0

    def stream(self, tick: int) -> None:
        """Send what is due in the 50 Hz turn `tick`."""
        boot_ms = 20 * tick
        pulse = self.pulse or 1500
        sent = {
            "SERVO_OUTPUT_RAW": dialect.MAVLink_servo_output_raw_message(1000 * boot_ms, 0, pulse, 0, 1500, *[0] * 5),
            "VFR_HUD": dialect.MAVLink_vfr_hud_message(1.2, 1.2, 30, 40, 0.0, 0.0),
            "RC_CHANNELS": dialect.MAVLink_rc_channels_message(boot_ms, 8, pulse, *[1500] * 17, 255),
            "GLOBAL_POSITION_INT": dialect.MAVLink_global_position_int_message(
                boot_ms, 590000000, 180000000, 0, 0, 100, 60, 0, 3000
            ),
            "GPS_RAW_INT": dialect.MAVLink_gps_raw_int_message(
                1000 * boot_ms, 3, 590000000, 180000000, 0, 90, 90, 120, 3000, 12
            ),
            "SYS_STATUS": dialect.MAVLink_sys_status_message(1, 1, 1, 300, 12000, 100, 90, 0, 0, 0, 0, 0, 0),
            "HEARTBEAT": dialect.MAVLink_heartbeat_message(11, 3, 129, 0, dialect.MAV_STATE_ACTIVE, 3),
        }
        self.send(self.attitude())
        self.sent["ATTITUDE"] += 1
        for name, message in sent.items():
            if tick % (RATE_HZ // STREAM_HZ[name]) == 0:
                self._send(message)
                self.sent[name] += 1


def norrbin(port: int, folder: Path, options: str | None) -> Case:
    """Return the whole pilot, steering; `options` behind the URL of --forward, None: without one."""
    sink = free_port() if options is not None else 0
    forward = [] if options is None else ["--forward", f"udpout:127.0.0.1:{sink}{options}"]
    boat = load_vessel("lanxin")
    vessel = folder / "boat.yaml"
    vessel.write_text(dump_vessel(replace(boat, control=replace(boat.control, rate_hz=float(RATE_HZ)))))
    command = [sys.executable, "-m", "autopilot", "run", str(vessel), "--as-gcs", "--engage", "30"]
    command += ["--link", f"udpin:127.0.0.1:{port}", "--log", str(folder / "run.tlog"), *forward]
    return Case(command, sink)


def on_line(case: Case, port: int) -> Case:
    """Return the same with the boat on a serial line."""
    ours, theirs = pty.openpty()
    tty.setraw(theirs)
    os.set_blocking(ours, False)
    name = os.ttyname(theirs)
    named = {f"udpin:127.0.0.1:{port}": f"serial:{name}:921600", f"--master=udpin:127.0.0.1:{port}": f"--master={name}"}
    command = [named.get(each, each) for each in case.command]
    return Case([*command, "--baudrate=921600"] if "--daemon" in command else command, case.sink, (ours, name))


def carry(ours: int, relay: socket.socket, boat: int) -> None:
    """Carry what waits between our end of the serial line and the boat."""
    for data in datagrams(relay):
        os.write(ours, data)
    try:
        while data := os.read(ours, 4096):
            relay.sendto(data, ("127.0.0.1", boat))
    except BlockingIOError:
        return


def mavproxy(program: str, port: int, folder: Path, passes_on: bool) -> Case:
    """Return MAVProxy with its log, as it is started aboard: no console, streams left as they are."""
    sink = free_port() if passes_on else 0
    command = [*shlex.split(program), f"--master=udpin:127.0.0.1:{port}", "--daemon", "--non-interactive"]
    command += ["--streamrate=-1", "--default-modules=log", f"--logfile={folder / 'mav.tlog'}"]
    return Case([*command, f"--out=udpout:127.0.0.1:{sink}"] if passes_on else command, sink)


def measure(case: Case, port: int, folder: Path, seconds: float) -> dict[str, float]:
    """Run a program on the stream; return its share of a core, and what came out a second."""
    boat, counts, codec = Boat(port), Counter[str](), MavlinkCodec()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sink, (folder / "output").open("w+") as output:
        sink.bind(("127.0.0.1", case.sink))
        sink.setblocking(False)
        relay = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        relay.setblocking(False)
        if case.line is not None:
            relay.bind(("127.0.0.1", port))
        program = subprocess.Popen(
            case.command, stdout=output, stderr=output, stdin=subprocess.DEVNULL, text=True, cwd=folder
        )
        try:
            started, tick, before, measured_from, sent_before = time.perf_counter(), 0, 0.0, 0.0, Counter[str]()
            while not measured_from or time.perf_counter() - measured_from < seconds:
                boat.stream(tick)
                tick += 1
                if case.line is not None:
                    carry(case.line[0], relay, boat.line.getsockname()[1])
                boat.answers(started + tick / RATE_HZ)
                passed = datagrams(sink)
                if not measured_from and time.perf_counter() - started > SETTLE_S:
                    if program.poll() is not None:
                        raise SystemExit((folder / "output").read_text())
                    measured_from, before, sent_before = time.perf_counter(), cpu_seconds(program), boat.sent.copy()
                elif measured_from:
                    counts.update(message.get_type() for data in passed for message in codec.decode(data))
            used, span = cpu_seconds(program) - before, time.perf_counter() - measured_from
        finally:
            program.terminate()
            program.wait(10.0)
            boat.line.close()
            relay.close()
            if case.line is not None:
                os.close(case.line[0])
    sent = (boat.sent - sent_before)["ATTITUDE"]
    return {
        "cpu_percent": 100.0 * used / span,
        "headings_in_hz": sent / span,
        "headings_out_hz": counts["ATTITUDE"] / span,
        "messages_out_hz": counts.total() / span,
        "steers": float(boat.pulse != 0),
    }


def datagrams(sink: socket.socket) -> list[bytes]:
    """Return what waits at the sink."""
    found: list[bytes] = []
    while True:
        try:
            found.append(sink.recv(65536))
        except (BlockingIOError, ConnectionRefusedError):
            return found


def cases(program: str | None, port: int, folder: Path) -> dict[str, Case]:
    """Return what is measured, by name."""
    found: dict[str, Case] = {
        "norrbin, steers": norrbin(port, folder, None),
        "norrbin, steers and forwards": norrbin(port, folder, ""),
        "norrbin, thinned to 2 Hz": norrbin(port, folder, "?rate=ATTITUDE:2,others:1"),
    }
    found["norrbin, serial, steers and forwards"] = on_line(norrbin(port, folder, ""), port)
    if program is not None:
        found["MAVProxy, serial, forwards"] = on_line(mavproxy(program, port, folder, True), port)
        found["MAVProxy, no --out"] = mavproxy(program, port, folder, False)
        found["MAVProxy, forwards"] = mavproxy(program, port, folder, True)
    return found


def table(runs: dict[str, list[dict[str, float]]]) -> list[str]:
    """Return the medians as lines of text."""
    keys = list(next(iter(runs.values()))[0])
    lines = [f"{'':38s}" + "".join(f"{key:>17s}" for key in keys)]
    for name, each in runs.items():
        lines.append(f"{name:38s}" + "".join(f"{statistics.median(run[key] for run in each):17.2f}" for key in keys))
    return lines


def ratios(runs: dict[str, list[dict[str, float]]]) -> dict[str, list[float]]:
    """Return, round by round, the pilot's processor time over MAVProxy's: of all it does, and of the forwarding."""

    def cpu(name: str) -> list[float]:
        return [run["cpu_percent"] for run in runs[name]]

    steers, both, proxy = cpu("norrbin, steers"), cpu("norrbin, steers and forwards"), cpu("MAVProxy, forwards")
    return {
        "steers and forwards / MAVProxy": [a / b for a, b in zip(both, proxy, strict=True)],
        "forwarding alone / MAVProxy": [(a - s) / b for a, s, b in zip(both, steers, proxy, strict=True)],
    }


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure in turn, and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=20.0, help="time measured in each run")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--mavproxy", default=shutil.which("mavproxy.py"), help="its command")
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")
    given = parser.parse_args(arguments)
    runs: dict[str, list[dict[str, float]]] = {}
    for _ in range(given.rounds):
        with tempfile.TemporaryDirectory() as name:
            port = free_port()
            for title, case in cases(given.mavproxy, port, Path(name)).items():
                runs.setdefault(title, []).append(measure(case, port, Path(name), given.seconds))
    found = ratios(runs) if given.mavproxy is not None else {}
    if given.json:
        print(json.dumps({"runs": runs, "ratios": found, "load_average": os.getloadavg()[0]}, indent=2))
        return
    print(f"{os.cpu_count()} cores, load average {os.getloadavg()[0]:.1f}, medians of {given.rounds} rounds")
    print("\n".join(table(runs)))
    for name, each in found.items():
        print(f"{name:32s}{statistics.median(each):6.2f}  ({', '.join(f'{ratio:.2f}' for ratio in each)})")


if __name__ == "__main__":
    main()
