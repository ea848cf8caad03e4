"""What the helm page costs: bytes, first paint, the server's processor time, and the control loop's lateness.

    python benchmarks/web_page.py [--seconds 15] [--blocks 4] [--clients 5] [--json]

`autopilot run` steers a stand-in boat that sends ATTITUDE at 100 Hz and serves the page's link; `autopilot web` runs in
its own process. Blocks with the page's server and its browsers alternate with blocks in which both are stopped, so that
both kinds meet the same machine. Lateness is the time from a heading that arrives to the rudder order that answers it.
The browsers are plain readers of the event stream in one process; first paint is a real Chromium's, where there is one.
Linux only: processor time is read from /proc.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from latency import ENGAGE_PATIENCE_S, RATE_HZ, Vehicle, cpu_seconds, free_port, percentile, vessel_file

SETTLE_S = 3.0
PAINTS = 5
LATER = ("uplot", "icon-")
"""What is loaded later: the plots' library, and icons of an installed page."""
READERS = """
import selectors, socket, sys, time
port, count = int(sys.argv[1]), int(sys.argv[2])
waiting = selectors.DefaultSelector()
for _ in range(count):
    line = socket.create_connection(("127.0.0.1", port))
    line.sendall(b"GET /api/events HTTP/1.1\\r\\nHost: localhost\\r\\n\\r\\n")
    waiting.register(line, selectors.EVENT_READ)
print("ready", flush=True)
since, states, size = time.monotonic(), 0, 0
for command in sys.stdin:
    while waiting.select(0.0):  # what came before the block
        for key, _ in waiting.select(0.0):
            if not key.fileobj.recv(65536):
                sys.exit("the server hung up")
    until = time.monotonic() + float(command)
    states = size = 0
    while (left := until - time.monotonic()) > 0.0:
        for key, _ in waiting.select(left):
            data = key.fileobj.recv(65536)
            states += data.count(b"event: state")
            size += len(data)
    print(states, size, flush=True)
"""


class Block(NamedTuple):
    """One block: round trips [us], the server's share of a core [%], events of state a second and client, kB/s."""

    late_us: list[float]
    cpu_percent: float
    events_hz: float
    kb_s: float


class Stack(NamedTuple):
    """The processes measured."""

    vehicle: Vehicle
    pilot: subprocess.Popen[str]
    web: subprocess.Popen[str]
    readers: subprocess.Popen[str]
    port: int


@contextlib.contextmanager
def stack(clients: int) -> Iterator[Stack]:
    """Run pilot, page and readers while the block lasts."""
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as ends:
        folder, line, served, port = Path(name), free_port(), free_port(), free_port()

        def start(*command: str, **options: Any) -> subprocess.Popen[str]:
            process = subprocess.Popen([sys.executable, *command], text=True, stderr=subprocess.DEVNULL, **options)
            ends.callback(process.communicate)
            ends.callback(process.terminate)
            ends.callback(process.send_signal, signal.SIGCONT)
            return process

        quiet = {"stdout": subprocess.DEVNULL, "stdin": subprocess.DEVNULL}
        pilot = start(
            *("-m", "autopilot", "run", str(vessel_file(folder)), "--as-gcs", "--engage", "30"),
            *("--link", f"udpin:127.0.0.1:{line}", "--serve", f"udpout:127.0.0.1:{served}"),
            **quiet,
        )
        web = start(
            *("-m", "autopilot", "web", "--link", f"udpin:127.0.0.1:{served}", "--listen", f"127.0.0.1:{port}"),
            stdout=subprocess.PIPE,
        )
        assert web.stdout is not None
        web.stdout.readline()
        readers = start(
            "-c", READERS, str(port), str(clients), stdin=subprocess.PIPE, stdout=subprocess.PIPE, cwd=folder
        )
        vehicle = Vehicle(line)
        ends.callback(vehicle.line.close)
        yield Stack(vehicle, pilot, web, readers, port)


def exchange(vehicle: Vehicle, seconds: float, patience: float = 0.0) -> list[float]:
    """Send headings for `seconds`, or until one is answered; return how late [us] each answer was."""
    period, started = 1.0 / RATE_HZ, time.perf_counter()
    late: list[float] = []
    tick, unanswered = 0, 0.0
    while (time.perf_counter() - started) < max(seconds, patience if not late else seconds):
        due = started + tick * period
        time.sleep(max(0.0, due - time.perf_counter()))
        datagram = vehicle.attitude()
        # an answer that missed its period counts as well, for the heading that waited longest
        for arrived in vehicle.answers(time.perf_counter() + 1e-5)[:1]:
            late.extend([(arrived - unanswered) * 1e6] if unanswered else [])
            unanswered = 0.0
        sent = time.perf_counter()
        vehicle.send(datagram)
        answers = vehicle.answers(due + 0.8 * period)
        if answers:
            late.append((answers[0] - (unanswered or sent)) * 1e6)
            unanswered = 0.0
        else:
            unanswered = unanswered or sent
        vehicle.housekeeping(tick)
        tick += 1
    return late


def block(run: Stack, seconds: float, clients: int) -> Block:
    """Measure one block; with 0 clients the page's server and its readers are stopped."""
    others = (run.web, run.readers)
    for process in others:
        process.send_signal(signal.SIGCONT if clients else signal.SIGSTOP)
    exchange(run.vehicle, SETTLE_S)
    before = cpu_seconds(run.web)
    if clients:
        assert run.readers.stdin is not None and run.readers.stdout is not None
        run.readers.stdin.write(f"{seconds}\n")
        run.readers.stdin.flush()
    late = exchange(run.vehicle, seconds)
    used = 100.0 * (cpu_seconds(run.web) - before) / seconds
    if not clients:
        return Block(late, used, 0.0, 0.0)
    states, size = map(int, run.readers.stdout.readline().split())  # type: ignore[union-attr]
    return Block(late, used, states / seconds / clients, size / seconds / 1000.0)


def fetched_bytes(port: int, *, packed: bool) -> int:
    """Return the bytes of what a phone loads at first, without the plots: packed as browsers get it, or not."""
    base = f"http://127.0.0.1:{port}/"
    from autopilot.web import page_files

    total = 0
    for name in page_files():
        if name.startswith(LATER):
            continue
        request = urllib.request.Request(base + name, headers={"accept-encoding": "gzip" if packed else "identity"})
        total += len(urllib.request.urlopen(request).read())
    return total


def first_paints_ms(port: int) -> list[float]:
    """Return how long Chromium takes to the first contentful paint [ms], with an empty cache; [] without Chromium."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return []
    if program is None:
        return []
    paints = []
    options = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync", "--no-first-run"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=options)
        for _ in range(PAINTS):
            context = browser.new_context(viewport={"width": 390, "height": 844})
            page = context.new_page()
            page.goto(f"http://127.0.0.1:{port}/")
            page.wait_for_timeout(500)
            paints.append(page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime"))
            context.close()
        browser.close()
    return paints


def measure(seconds: float, blocks: int, clients: int) -> dict[str, float]:
    """Return all figures."""
    with stack(clients) as run:
        assert run.readers.stdout is not None
        if not exchange(run.vehicle, 2.0, ENGAGE_PATIENCE_S):
            raise SystemExit("the pilot did not engage")
        run.readers.stdout.readline()
        without: list[Block] = []
        with_clients: list[Block] = []
        for _ in range(blocks):
            without.append(block(run, seconds, 0))
            with_clients.append(block(run, seconds, clients))
        size, packed = (fetched_bytes(run.port, packed=packed) for packed in (False, True))
        memory = int(Path(f"/proc/{run.web.pid}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
        paints = first_paints_ms(run.port)
    figures: dict[str, float] = {
        "page_kb": size / 1000.0,
        "page_packed_kb": packed / 1000.0,
        "first_paint_ms": statistics.median(paints) if paints else float("nan"),
        "events_hz": statistics.mean(each.events_hz for each in with_clients),
        "events_kb_s": statistics.mean(each.kb_s for each in with_clients),
        "server_cpu_percent": statistics.mean(each.cpu_percent for each in with_clients),
        "server_memory_mb": memory / 1e6,
    }
    for name, kind in (("without", without), ("with", with_clients)):
        late = [value for each in kind for value in each.late_us]
        figures |= {f"late_{name}_p{label}_us": percentile(late, share) for label, share in PERCENTILES.items()}
        per_block = [percentile(each.late_us, 0.999) for each in kind]
        figures |= {f"late_{name}_p999_least_us": min(per_block), f"late_{name}_p999_most_us": max(per_block)}
        figures[f"late_{name}_count"] = len(late)
    return figures


PERCENTILES = {"50": 0.5, "99": 0.99, "999": 0.999}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=15.0, help="length of each block")
    parser.add_argument("--blocks", type=int, default=4, help="blocks of each kind")
    parser.add_argument("--clients", type=int, default=5, help="browsers")
    parser.add_argument("--json", action="store_true", help="print JSON instead of the table")
    arguments = parser.parse_args()
    load = os.getloadavg()[0]
    figures = measure(arguments.seconds, arguments.blocks, arguments.clients)
    if arguments.json:
        print(json.dumps({**figures, "load_average": load, "cores": os.cpu_count()}, indent=2))
        return
    print(f"{RATE_HZ} Hz loop, {arguments.clients} browsers, {os.cpu_count()} cores, load average {load:.1f} before")
    for name, value in figures.items():
        print(f"{name:28s}{value:10.1f}")


if __name__ == "__main__":
    socket.setdefaulttimeout(30.0)
    main()
