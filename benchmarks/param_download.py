"""Download of 1,000 parameters: ours and MAVProxy's, from the same responder, over links that lose packets.

    pip install MAVProxy
    python benchmarks/param_download.py [--rounds 3]

A responder on UDP stands in for a vehicle: it streams the list at 500 a second and answers reads by index and by
name. Each client is a process of its own and listens on a port of its own; packets are lost at random in both
directions, a tenth arrives twice. A download's time runs from the first PARAM_REQUEST_LIST that the responder
receives to the line in which the client says that it has written them all into its file. MAVProxy is set to use
the parameter protocol, not FTP, which the responder does not speak.
"""

from __future__ import annotations

import argparse
import os
import random
import select
import shutil
import socket
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

COUNT = 1000
LIST_RATE_HZ = 500.0
LOSSES = (0.0, 0.05, 0.3)
REPEATS = 0.1
GIVE_UP_S = 150.0


class Responder:
    """A vehicle's side of the parameter protocol, for one client."""

    def __init__(self, port: int, loss: float, seed: int) -> None:
        self.table = [(f"P{n:04d}", struct.unpack("<f", struct.pack("<f", n * 0.37 + 0.1))[0]) for n in range(COUNT)]
        self.indices = {name: index for index, (name, _) in enumerate(self.table)}
        self.line = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.address = ("127.0.0.1", port)
        self.mavlink = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        self.mavlink.robust_parsing = True
        self.random = random.Random(seed)
        self.loss = loss
        self.first_list: float | None = None
        self.packets = 0
        self.requests = 0
        self._list_at: float = 0.0
        self._listed = COUNT
        self._next_heartbeat = 0.0

    def send(self, message: object) -> None:
        packet = message.pack(self.mavlink)  # type: ignore[attr-defined]
        self.mavlink.seq = (self.mavlink.seq + 1) & 0xFF
        for _ in range(2 if self.random.random() < REPEATS else 1):
            if self.random.random() >= self.loss:
                self.line.sendto(packet, self.address)

    def send_value(self, index: int, index_sent: int) -> None:
        name, value = self.table[index]
        self.packets += 1
        self.send(dialect.MAVLink_param_value_message(name.encode(), value, 9, COUNT, index_sent))

    def turn(self) -> None:
        """Do what is due and wait a little for the client."""
        now = time.monotonic()
        if now >= self._next_heartbeat:
            self._next_heartbeat = now + 1.0
            self.send(dialect.MAVLink_heartbeat_message(11, 3, 81, 0, 4, 3))
        while self._listed < COUNT and self._list_at + self._listed / LIST_RATE_HZ <= now:
            self.send_value(self._listed, self._listed)
            self._listed += 1
        if select.select([self.line], [], [], 0.002)[0]:
            for message in self.mavlink.parse_buffer(self.line.recv(4096)) or []:
                if self.random.random() >= self.loss:
                    self.handle(message)

    def handle(self, message: object) -> None:
        kind = message.get_type()  # type: ignore[attr-defined]
        if kind == "PARAM_REQUEST_LIST":
            self._list_at = time.monotonic()
            self._listed = 0
            self.first_list = self.first_list or self._list_at
        elif kind == "PARAM_REQUEST_READ":
            self.requests += 1
            index = message.param_index  # type: ignore[attr-defined]
            if 0 <= index < COUNT:
                self.send_value(index, index)
            elif index < 0 and message.param_id in self.indices:  # type: ignore[attr-defined]
                self.send_value(self.indices[message.param_id], 65535)  # type: ignore[attr-defined]


def ours(port: int, folder: Path) -> tuple[list[str], str]:
    """Return the command and the text by which it says that it is done."""
    command = [sys.executable, "-u", "-m", "autopilot", "params", "download", str(folder / "all.parm")]
    return [*command, "--link", f"udpin:127.0.0.1:{port}"], f"{COUNT} parameters"


def mavproxy(port: int, folder: Path) -> tuple[list[str], str]:
    """The same for MAVProxy."""
    script = shutil.which("mavproxy.py", path=f"{Path(sys.executable).parent}:{os.environ['PATH']}")
    if script is None:
        raise SystemExit("MAVProxy is not installed: pip install MAVProxy")
    command = [sys.executable, "-u", script, f"--master=udpin:127.0.0.1:{port}", "--mav20", "--non-interactive"]
    command += ["--daemon", f"--state-basedir={folder}", "--default-modules=param", "--cmd=set param_ftp False"]
    return command, f"Saved {COUNT} parameters"


CLIENTS = {"Norrbin": ours, "MAVProxy": mavproxy}


def download(client: str, loss: float, seed: int) -> tuple[float | None, int]:
    """Return the seconds that one download took (None: given up) and how many values were sent for it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    responder = Responder(port, loss, seed)
    with tempfile.TemporaryDirectory() as folder:
        command, done = CLIENTS[client](port, Path(folder))
        output = Path(folder) / "output.txt"
        with output.open("w") as file:
            process = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT, cwd=folder)
        try:
            return wait_for(responder, output, done), responder.packets
        finally:
            process.kill()
            process.wait()
            responder.line.close()


def wait_for(responder: Responder, output: Path, done: str) -> float | None:
    """Serve until the client says that it is done; return its seconds, None where it takes too long."""
    next_look = 0.0
    while True:
        responder.turn()
        now = time.monotonic()
        if now < next_look:
            continue
        next_look = now + 0.01
        if responder.first_list is None:
            continue
        if done in output.read_text(errors="replace"):
            return now - responder.first_list
        if now - responder.first_list > GIVE_UP_S:
            return None


def row(loss: float, rounds: int) -> tuple[str, ...]:
    """Return one row of the table; the clients take turns, so that both meet the same machine."""
    times: dict[str, list[float | None]] = {name: [] for name in CLIENTS}
    values: dict[str, list[int]] = {name: [] for name in CLIENTS}
    for number in range(rounds):
        for name in CLIENTS:
            seconds, packets = download(name, loss, seed=number)
            times[name].append(seconds)
            values[name].append(packets)
    cells = [f"{loss:.0%}"]
    for name in CLIENTS:
        complete = [seconds for seconds in times[name] if seconds is not None]
        median = f"{statistics.median(complete):.2f} s" if complete else "-"
        cells += [median, f"{len(complete)}/{rounds}", f"{statistics.median(values[name]):.0f}"]
    pairs = [(a, b) for a, b in zip(*times.values(), strict=True) if a is not None and b is not None]
    cells.append(f"{statistics.median(a / b for a, b in pairs):.2f}" if pairs else "-")
    return tuple(cells)


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    rounds = parser.parse_args().rounds
    head = ["loss each way"]
    for name in CLIENTS:
        head += [f"{name}, median", "complete", "values sent"]
    print(f"| {' | '.join([*head, 'ratio of times'])} |")
    print("|---" * 8 + "|")
    for loss in LOSSES:
        print(f"| {' | '.join(row(loss, rounds))} |", flush=True)


if __name__ == "__main__":
    main()
