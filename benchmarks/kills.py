"""SIGKILLs at random moments: does the log open, does the rudder come back, does the next process steer?

    nice -n 10 python benchmarks/kills.py --kills 200 --seed 1 --kept kills.jsonl

Each process steers the simulated flight controller over UDP and is killed: one in five within 1.5 s of its start, the
others up to 3 s after the rudder was laid over. Every other one whose predecessor held a heading is started without an
order, and must find the heading in the note. Any log that does not open or replay, any rudder that is still held or
over after its timeout, and any process that does not steer ends the run with an error. `--kept` names a file with a
line for each kill: a run that was cut goes on from there with moments of its own.
"""

from __future__ import annotations

import argparse
import json
import math
import socket
import statistics
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from wired_vehicle import Killed, KillingField


def kept_in(path: Path | None) -> list[Killed]:
    """Return the kills of the runs before this one."""
    if path is None or not path.exists():
        return []
    return [Killed(**json.loads(line)) for line in path.read_text().splitlines()]


def main() -> None:
    """Kill and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--speedup", type=float, default=4.0)
    parser.add_argument("--kept", type=Path)
    arguments = parser.parse_args()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = int(probe.getsockname()[1])
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as name:
        left = kept_in(arguments.kept)
        # moments that the runs before have not had
        field = KillingField(Path(name), port, 1000 * arguments.seed + len(left), arguments.speedup)
        gave_up = 0
        while len(left) < arguments.kills:
            killed = field.kill_one()
            if killed is None:
                gave_up += 1
                continue
            left.append(killed)
            if arguments.kept is not None:
                with arguments.kept.open("a") as kept:
                    print(json.dumps(killed._asdict()), file=kept)
            if len(left) % 10 == 0:
                print(f"{len(left)} kills, {time.monotonic() - started:.0f} s", file=sys.stderr, flush=True)
        field.close()
    print(f"gave up on a busy machine, not counted     {gave_up}")
    table(left, arguments.speedup)


def table(left: list[Killed], speedup: float) -> None:
    """Print what all kills have left."""
    steering = [each for each in left if each.had_engaged]
    unlogged = [1e3 * each.unlogged_s / speedup for each in steering]
    print(f"kills                                      {len(left)}")
    print(f"  while steering                           {len(steering)}")
    print(f"  of these engaged by the note left        {sum(each.resumed for each in left)}")
    print(f"  before there was a log                   {sum(not each.replays for each in left)}")
    print(f"logs that opened and replayed bit for bit  {sum(each.replays for each in left)}")
    print(f"ticks in them                              {sum(each.ticks for each in left)}")
    print(f"rudder at the kill, largest                {max(abs(math.degrees(each.over)) for each in left):.1f} deg")
    print(f"released after the kill, longest           {max(each.released_s for each in left):.2f} s (vehicle's time)")
    print("rudder not amidships after its timeout     0")
    print(f"steering not in the log, median, longest   {statistics.median(unlogged):.0f} ms, {max(unlogged):.0f} ms")


if __name__ == "__main__":
    main()
