"""Whether the pilot still does what it did, bit for bit: ticks recorded with one checkout, made again with another.

    python benchmarks/same_ticks.py record FOLDER      # with the code as it was
    python benchmarks/same_ticks.py compare FOLDER     # with the code as it is: the same samples and orders
    python benchmarks/same_ticks.py sail FOLDER        # the same, and the boats, lines and links run again, too
    python benchmarks/same_ticks.py record FOLDER --only "lanxin|fault"

Every shipped vessel sails a course, turns, a zigzag and a held rudder, in calm water and in a seaway; the shipped boat
with each law that has gains, guided, and over a bad line; and the boat of the fault matrix meets every fault on a
course and in a turn or a trial, over MAVLink, over instruments and over both. Compared is every field of every tick,
and of what the pilot remembers all that PROBES names. Exit code 1 where anything differs; the first difference is
shown.
"""

from __future__ import annotations

import argparse
import dataclasses
import gzip
import hashlib
import math
import pickle
import re
import sys
from collections.abc import Callable, Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))

from fault_boat import FaultBoat, bring_into
from fault_cells import ROWS
from lockstep import BadLine, Lockstep, goes_guided

from autopilot.control.registry import filed_laws
from autopilot.errors import RefusedError
from autopilot.pilot import Pilot
from autopilot.runtime.build import build_pilot
from autopilot.signals import Order, OrderKind, Tick
from autopilot.vessel.file import load_vessel
from sitl.scenario import load_scenario

VESSELS = tuple(
    sorted(path.stem for path in (Path(__file__).parents[1] / "firmware_params" / "vessels").glob("*.yaml"))
)
BUSY_STATES = ("turn", "trial")
PROBES = (
    "estimate.fusion",
    "estimate.rudder",
    "rudder",
    "way",
    "control.law",
    "monitors.consistency.turns",
    "monitors.compass",
    "monitors.rudder.response",
    "monitors.rudder.runaway",
    "monitors.course",
    "findings",
    "supervisor",
    "panel",
)
"""What is compared of the pilot's state after each tick."""
NAMES = re.compile(r"[A-Za-z_]\w*(?=\()|[A-Za-z_]\w*=")


class Ride(NamedTuple):
    """One run: `sail` it, calling what it is given with the pilot after each tick; `pilot` makes one that has seen
    nothing; None: the run does things to its pilot that no samples tell."""

    name: str
    sail: Callable[[Callable[[Pilot, Tick], None]], None]
    pilot: Callable[[], Pilot] | None


class Recorded(NamedTuple):
    """A run's ticks, and of the state after each a digest of every probe."""

    ticks: list[Tick]
    states: list[tuple[str, ...]]


def probed(pilot: Pilot) -> tuple[str, ...]:
    """Return a digest of each probe; how records and their fields are called does not count."""
    texts = (NAMES.sub("", repr(attrgetter(path)(pilot.state))) for path in PROBES)
    return tuple(hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()[:12] for text in texts)


def rides() -> Iterator[Ride]:
    """Yield all runs."""
    for vessel in VESSELS:
        yield _voyage(f"{vessel} calm", vessel)
        yield _voyage(f"{vessel} sea", vessel, scenario=load_scenario("sea-state-5"))
    lanxin = load_vessel("lanxin")
    for law in filed_laws():
        if getattr(lanxin.control, law, None) is not None:
            yield _voyage(f"lanxin {law}", "lanxin", law=law, scenario=load_scenario("sea-state-5"))
    yield _voyage("lanxin guided", "lanxin", hooks=(goes_guided,), settings={"method": "guided", "as_gcs": False})
    yield _voyage("lanxin bad line", "lanxin", lines=(7, 8))
    for number, row in enumerate(ROWS):
        yield _fault(row, "heading")
        yield _fault(row, BUSY_STATES[number % len(BUSY_STATES)])


def _voyage(name: str, vessel: str, **how: Any) -> Ride:
    hooks, lines = how.pop("hooks", ()), how.pop("lines", ())

    def sail(seen: Callable[[Pilot, Tick], None]) -> None:
        bad = [BadLine(seed, loss=0.05, double=0.05, delay=0.3) for seed in lines]
        boat = Lockstep(load_vessel(vessel), lines=bad, **how)
        boat.hooks += hooks

        def sailed(seconds: float) -> None:
            boat.run(seconds, until=lambda tick: bool(seen(boat.pilot, tick)))

        def ordered(kind: OrderKind, heading: float, rudder: float, change: float = 0.0) -> None:
            angles = math.radians(heading), math.radians(rudder), math.radians(change)
            boat.order = Order(kind, *angles, serial=boat.order.serial + 1)

        sailed(3.0)
        ordered(OrderKind.HEADING, 40.0, 0.0)
        sailed(40.0)
        ordered(OrderKind.HEADING, 130.0, 0.0)
        sailed(25.0)
        ordered(OrderKind.HEADING, 100.0, 0.0)
        sailed(15.0)
        ordered(OrderKind.ZIGZAG, math.nan, 10.0, 10.0)
        sailed(20.0)
        ordered(OrderKind.RUDDER, 0.0, 5.0)
        sailed(5.0)
        ordered(OrderKind.STANDBY, 0.0, 0.0)
        sailed(3.0)

    return Ride(name, sail, lambda: build_pilot(load_vessel(vessel), how.get("law")))


def _fault(row: Any, state: str) -> Ride:
    def sail(seen: Callable[[Pilot, Tick], None]) -> None:
        boat = FaultBoat(row.method)
        step, pilot = boat.session._pilot.step, boat.session._pilot

        def watched(*given: Any) -> Tick:
            tick: Tick = step(*given)
            seen(pilot, tick)
            return tick

        pilot.step = watched
        bring_into(boat, state)
        row.inject(boat)
        boat.run(row.window_s)

    vessel = load_vessel("lanxin")
    alarms = dataclasses.replace(vessel.alarms, roll_deg=30.0, battery_percent=20.0)
    boat_of = dataclasses.replace(vessel, alarms=alarms)
    return Ride(f"fault {row.method} {state}: {row.name}", sail, lambda: build_pilot(boat_of))


def sailed(ride: Ride) -> Recorded:
    """Return what came of a run."""
    recorded = Recorded([], [])

    def seen(pilot: Pilot, tick: Tick) -> None:
        recorded.ticks.append(tick)
        recorded.states.append(probed(pilot))

    ride.sail(seen)
    return recorded


def replayed(pilot: Pilot, ticks: list[Tick]) -> Iterator[tuple[Tick, tuple[str, ...]]]:
    """Yield what a pilot makes of the samples and orders of `ticks`."""
    for tick in ticks:
        yield pilot.step(tick.now, tick.samples, tick.order), probed(pilot)


def difference(then: Recorded, now: Iterator[tuple[Tick, tuple[str, ...]]]) -> str:
    """Return where the first difference lies, '' for nowhere."""
    count = 0
    for number, (tick, states) in enumerate(now):
        count += 1
        if number >= len(then.ticks):
            return "more ticks than were"
        was = then.ticks[number]
        for field, old, new in zip(Tick._fields, was, tick, strict=True):
            if repr(old) != repr(new):
                return f"tick {number} at {was.now:.3f} s: {field}\n    was {old!r}\n    is  {new!r}"
        for path, old, new in zip(PROBES, then.states[number], states, strict=True):
            if old != new:
                return f"tick {number} at {was.now:.3f} s: {path} of the state"
    return "" if count == len(then.ticks) else f"{count} ticks, and {len(then.ticks)} were"


def file_of(folder: Path, ride: Ride) -> Path:
    """Return where a run is kept."""
    return folder / (re.sub(r"\W+", "_", ride.name) + ".pickle.gz")


def record(folder: Path, chosen: list[Ride]) -> None:
    """Sail, and write down; whether a run can be replayed is found out now."""
    folder.mkdir(parents=True, exist_ok=True)
    for ride in chosen:
        try:
            recorded = sailed(ride)
        except RefusedError as refused:
            print(f"   not sailed  {ride.name}: {refused}", flush=True)
            continue
        again = "" if ride.pilot is None else difference(recorded, replayed(ride.pilot(), recorded.ticks))
        with gzip.open(file_of(folder, ride), "wb", compresslevel=3) as out:
            pickle.dump((recorded, not again), out)
        print(
            f"{len(recorded.ticks):6} ticks  {ride.name}{'' if not again else ', which no samples tell whole'}",
            flush=True,
        )


def compare(folder: Path, chosen: list[Ride], *, sails: bool) -> int:
    """Make the recorded ticks again; return how many runs differ."""
    ticks = runs = wrong = 0
    for ride in chosen:
        if not file_of(folder, ride).exists():
            continue
        with gzip.open(file_of(folder, ride), "rb") as source:
            then, is_whole = pickle.load(source)
        if not sails and not is_whole:
            continue
        runs, ticks = runs + 1, ticks + len(then.ticks)
        if sails:
            recorded = sailed(ride)
            found = difference(then, zip(recorded.ticks, recorded.states, strict=True))
        else:
            assert ride.pilot is not None
            found = difference(then, replayed(ride.pilot(), then.ticks))
        if found:
            wrong += 1
            print(f"{ride.name}: {found}", flush=True)
    print(f"{runs} runs, {ticks} ticks, {wrong} runs differ")
    return wrong


def main() -> int:
    """Record or compare."""
    options = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    options.add_argument("what", choices=("record", "compare", "sail"))
    options.add_argument("folder", type=Path)
    options.add_argument("--only", default="", help="only runs whose name holds this regular expression")
    options.add_argument("--part", default="0/1", help="one part of so many, such as 1/2: the runs one, three, five ..")
    given = options.parse_args()
    first, parts = map(int, given.part.split("/"))
    chosen = [ride for ride in rides() if re.search(given.only, ride.name)][first::parts]
    if given.what == "record":
        record(given.folder, chosen)
        return 0
    return 1 if compare(given.folder, chosen, sails=given.what == "sail") else 0


if __name__ == "__main__":
    raise SystemExit(main())
