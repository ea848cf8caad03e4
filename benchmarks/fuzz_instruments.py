"""A million inputs for every parser of instruments and drives: no exception, no growing memory, no impossible value.

    python benchmarks/fuzz_instruments.py [--inputs 1000000] [--seed 1] [--only NAME]

Each input is noise, or sound packets of that protocol cut, joined, doubled, shuffled, with bytes changed. Counted
are the values accepted, and those that nobody sent ("strangers"): a checksum of eight bits lets about one in 256 of
packets with several wrong bytes pass, where it has one at all. Exit code 1 at an exception, an impossible value, or
more than `HELD_MOST` bytes held between inputs.
"""

from __future__ import annotations

import argparse
import math
import random
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from autopilot.guidance.plotter import PlotterGuide
from autopilot.links.drives import Drive, DriveSettings
from autopilot.links.drives.jrk import HEALTH, MOTION, JrkG2
from autopilot.links.drives.maestro import Maestro
from autopilot.links.drives.pypilot_motor import FLAGS, RUDDER, PypilotMotor, packet
from autopilot.links.n2k.link import FORMS, framed
from autopilot.links.n2k.packets import Message, encoded
from autopilot.links.n2k.samples import INSTRUMENTS, Compass, sample_of
from autopilot.links.n2k.session import N2kSession, N2kSettings
from autopilot.links.nmea import sentences as encode
from autopilot.links.nmea.samples import NmeaReader
from autopilot.links.nmea.sentences import NmeaFramer, format_sentence
from autopilot.signals import HeadingSample
from autopilot.vessel.file import load_vessel
from sitl.scenario import load_scenario
from sitl.serve import DRIVES as TWINS
from sitl.world import World

HELD_MOST = 4096
"""Bytes that a reader may hold between inputs."""


class Result(NamedTuple):
    """What was accepted, what of it nobody sent, what no reader may hand on, and the most bytes held."""

    accepted: int = 0
    strangers: int = 0
    wrong: int = 0
    held: int = 0


Fuzzer = Callable[[random.Random, int], Result]
Round = Callable[[Fuzzer, random.Random, int], tuple[Result, tuple[str, ...], bool]]
"""Runs a fuzzer for so many inputs: its result, further cells of its row, and whether these are a failure."""


def plainly(fuzz: Fuzzer, rng: random.Random, count: int) -> tuple[Result, tuple[str, ...], bool]:
    """Run the fuzzer and measure nothing else."""
    return fuzz(rng, count), (), False


def print_table(
    fuzzers: Mapping[str, Fuzzer], heads: tuple[str, ...], each_round: Round = plainly, share: float = 1.0
) -> int:
    """Print one line for each fuzzer that the command line asks for; return 1 where one has failed.

    heads: of the columns but the last, the microseconds an input. A round feeds `share` times the inputs asked for.
    """
    options = argparse.ArgumentParser()
    options.add_argument("--inputs", type=int, default=1_000_000)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--only", choices=sorted(fuzzers))
    arguments = options.parse_args()
    failed = False
    print(f"| {' | '.join((*heads, 'us an input'))} |")
    print("|---" * (len(heads) + 1) + "|")
    for name, fuzz in fuzzers.items():
        if arguments.only not in (None, name):
            continue
        start = time.perf_counter()
        result, more, too_much = each_round(fuzz, random.Random(arguments.seed), arguments.inputs)
        each = (time.perf_counter() - start) / (share * arguments.inputs) * 1e6
        failed = failed or result.wrong > 0 or result.held > HELD_MOST or too_much
        cells = (name, arguments.inputs, *result, *more, f"{each:.0f}")
        print(f"| {' | '.join(map(str, cells))} |", flush=True)
    return int(failed)


FULL = 0.7
SETTINGS = DriveSettings(angle_at_full=FULL, stop=0.6)
HEADINGS = tuple(round(0.1 * step, 1) for step in range(0, 60, 7))
PLACES = tuple(range(32000, 33500, 100))


def inputs(rng: random.Random, sound: list[bytes], count: int) -> Iterator[bytes]:
    """Yield `count` chunks: noise, or `sound` packets damaged in one of five ways, or left whole."""
    for _ in range(count):
        if rng.random() < 0.2:
            yield rng.randbytes(rng.randrange(24))
            continue
        data = bytearray(b"".join(rng.choices(sound, k=rng.randrange(1, 4))))
        damage = rng.randrange(5)
        if damage == 0:
            del data[rng.randrange(len(data)) :]
        elif damage == 1:
            for _ in range(rng.randrange(1, 4)):
                data[rng.randrange(len(data))] = rng.randrange(256)
        elif damage == 2:
            place = rng.randrange(len(data))
            data[place:place] = rng.randbytes(rng.randrange(1, 6))
        elif damage == 3:
            place = rng.randrange(len(data))
            del data[place : place + rng.randrange(1, 5)]
        yield bytes(data)


def fuzz_nmea(rng: random.Random, count: int) -> Result:
    """Framer, reader and the guide that follows a plotter."""
    guide = PlotterGuide()
    guide.follow()
    framer, reader = NmeaFramer(), NmeaReader(0.0, guide=guide)
    sound = [encode.encode_hdt(heading) for heading in HEADINGS]
    sound += [encode.encode_rot(0.1), encode.encode_rsa(0.2), encode.encode_vtg(1.0, 3.0)]
    fields = ["A", "A", "0.10", "R", "N", "V", "V", "011", "T", "WP", "011", "T", "011", "T", "A"]
    sound += [format_sentence("GP", "APB", fields), format_sentence("GP", "XTE", ["A", "A", "0.1", "L", "N", "A"])]
    sent = {round(math.degrees(heading), 1) for heading in HEADINGS}
    accepted = strangers = impossible = held = 0
    for number, data in enumerate(inputs(rng, sound, count)):
        for sentence in framer.feed(data):
            sample = reader.read(number * 0.1, sentence)
            accepted += sample is not None
            if isinstance(sample, HeadingSample):
                strangers += round(math.degrees(sample.heading) % 360.0, 1) not in sent
                impossible += not -math.pi <= sample.heading <= math.pi
        course = guide.course(number * 0.1, 0.0, 4.0)
        impossible += not -math.pi <= course <= math.pi
        held = max(held, len(framer._line))
    return Result(accepted, strangers, impossible, held)


def fuzz_drive(make: Callable[[DriveSettings], Drive], sound: list[bytes]) -> Fuzzer:
    """Return the fuzzer of our side of a drive."""

    def fuzz(rng: random.Random, count: int) -> Result:
        drive: Any = make(SETTINGS)
        accepted = strangers = impossible = held = 0
        clean = make(SETTINGS)
        clean.order(0.0, 0.6)
        clean.order(0.0, -0.6)
        sent: set[float] = set()
        for packet_ in [*sound[:3], *sound]:
            clean.ask(0.0)
            sent |= {round(angle, 6) for angle in clean.feed(0.0, packet_)}
        for number, data in enumerate(inputs(rng, sound, count)):
            now = number * 0.05
            drive.order(now, 0.6 if number % 2 else -0.6)
            drive.ask(now)
            for angle in drive.feed(now, data):
                accepted += 1
                strangers += round(angle, 6) not in sent
                impossible += not abs(angle) <= 1.01 * FULL
            drive.fault(now)
            drive.warning(now)
            held = max(held, len(drive._buffer))
        return Result(accepted, strangers, impossible, held)

    return fuzz


def fuzz_twin(kind: str, sound: list[bytes]) -> Fuzzer:
    """Return the fuzzer of the simulator's side of a drive, without its line and world."""

    def fuzz(rng: random.Random, count: int) -> Result:
        twin: Any = TWINS[kind](World(load_vessel("lanxin"), load_scenario("calm")), 115200)
        accepted = impossible = 0
        for data in inputs(rng, sound, count):
            for byte in data:
                twin.take_byte(0.0, byte)
            order = twin.orders(0.0).rudder
            accepted += order is not None
            impossible += order is not None and not math.isfinite(order)
            # what it has answered goes nowhere here
            twin._to_host._waiting.clear()
        return Result(accepted, 0, impossible, 0)

    return fuzz


def fuzz_n2k(rng: random.Random, count: int) -> Result:
    """Decoded fields of every kind to samples."""
    values = (None, True, math.nan, math.inf, -1.0, 0.5, 1e300, "True", "Magnetic", b"x", [])
    accepted = impossible = 0
    for _ in range(count):
        names = ("heading", "reference", "variation", "deviation", "rate", "position")
        fields = {name: rng.choice(values) for name in names if rng.random() < 0.8}
        sample = sample_of(rng.choice(INSTRUMENTS), 0.0, fields, Compass(rng.choice((None, 0.1))), "x")
        accepted += sample is not None
        if isinstance(sample, HeadingSample):
            impossible += not -math.pi <= sample.heading <= math.pi
    return Result(accepted, 0, impossible, 0)


def fuzz_gateway(kind: str) -> Fuzzer:
    """Return the fuzzer of a gateway's form with the session behind it, its node and the guide of a plotter."""

    def fuzz(rng: random.Random, count: int) -> Result:
        guide = PlotterGuide()
        guide.follow()
        form: Any = FORMS[kind]()
        session = N2kSession("fuzz", N2kSettings(variation=0.1), guide=guide)
        sound = [_passed_on(kind, FORMS[kind]().encode(message)) for message in N2K_MESSAGES]
        sent = {round(heading, 4) for heading in HEADINGS}
        accepted = strangers = impossible = held = 0
        for number, data in enumerate(inputs(rng, sound, count)):
            now = 0.02 * number
            samples = session.receive(now, form.feed(now, data))
            session.poll(now)
            session.due(now)
            accepted += len(samples)
            for sample in samples:
                if isinstance(sample, HeadingSample):
                    strangers += round(sample.heading % math.tau, 4) not in sent
                    impossible += not -math.pi <= sample.heading <= math.pi
            course = guide.course(now, 0.0, 4.0)
            impossible += not -math.pi <= course <= math.pi
            held = max(held, len((form._packet if kind == "actisense" else form._rest) or b""))
        return Result(accepted, strangers, impossible, held)

    return fuzz


def _passed_on(kind: str, said: bytes) -> bytes:
    """Return what a gateway passes on of a message as it is sent to it."""
    if kind == "ydwg":
        return b"".join(b"12:00:00.123 R " + line + b"\r\n" for line in said.splitlines())
    if kind == "actisense":
        sent = said[3:-3].replace(b"\x10\x10", b"\x10")
        return framed(0x93, sent[1:6] + b"\x23\0\0\0\0" + sent[6:])
    return said


LEG = {
    "distanceToWaypoint": 500.0,
    "courseBearingReference": "True",
    "bearingOriginToDestinationWaypoint": 1.0,
    "bearingPositionToDestinationWaypoint": 1.01,
    "destinationWaypointNumber": 2,
}
N2K_MESSAGES = [
    *(Message(127250, encoded(127250, {"heading": each, "reference": "True"}), 35) for each in HEADINGS),
    Message(127251, encoded(127251, {"rate": 0.1}), 35),
    Message(127245, encoded(127245, {"instance": 0, "position": 0.2}), 12),
    Message(129284, encoded(129284, LEG), 3),
    Message(129283, encoded(129283, {"xteMode": "Autonomous", "navigationTerminated": "No", "xte": 5.0}), 3),
    Message(129026, encoded(129026, {"cogReference": "True", "cog": 1.0, "sog": 3.0}), 7),
    Message(60928, bytes(8), 204),
    Message(59904, (126996).to_bytes(3, "little"), 35, 204),
    Message(126208, b"\x01\x05\xf1\x01\xf8\x02\x05\x04\x07\x00", 35, 204),
]


def orders(make: Callable[[DriveSettings], Drive]) -> list[bytes]:
    """Return commands as our side sends them."""
    drive = make(SETTINGS)
    sound = [drive.order(0.0, 0.1 * step) for step in range(-5, 6)]
    return [*sound, drive.release(0.0), *(request for step in range(9) if (request := drive.ask(float(step))))]


REPORTS = {
    "pypilot": [*(packet(RUDDER, place) for place in PLACES), packet(FLAGS, 9), packet(0x1C, 250)],
    "jrk": [MOTION[1].pack(2048 + round(2047 * 0.6 / FULL), place, place, 0, 0, 0) for place in range(2000, 2100, 10)]
    + [HEALTH[1].pack(0, 0, 0, 12000, 500)],
    "maestro": [place.to_bytes(2, "little") for place in range(4400, 7601, 400)],
}
MAKERS: dict[str, Callable[[DriveSettings], Drive]] = {"pypilot": PypilotMotor, "jrk": JrkG2, "maestro": Maestro}
FUZZERS: dict[str, Fuzzer] = {
    "NMEA 0183": fuzz_nmea,
    **{f"{kind}, reports": fuzz_drive(make, REPORTS[kind]) for kind, make in MAKERS.items()},
    **{f"{kind}, commands (sitl)": fuzz_twin(kind, orders(make)) for kind, make in MAKERS.items()},
    "NMEA 2000 fields": fuzz_n2k,
    **{f"NMEA 2000, {kind}": fuzz_gateway(kind) for kind in FORMS},
}


def main() -> int:
    """Run the fuzzers and print one line for each; return 1 where one has failed."""
    return print_table(FUZZERS, ("parser", "inputs", "values accepted", "strangers", "impossible", "most bytes held"))


if __name__ == "__main__":
    sys.exit(main())
