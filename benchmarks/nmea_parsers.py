"""Our NMEA 0183 reader beside pynmea2: which sentences they know, what they make of bad ones, what one costs.

    pip install pynmea2
    python benchmarks/nmea_parsers.py [--count 20000]

Every kind of sentence that the pilot needs is damaged in the same three ways for both: a byte of the line changed
(its checksum left as it was); a field replaced by something that cannot be, with a right checksum; the line cut.
Counted is what a pilot would take for a value: a number that differs from the one sent, or one that cannot be.
"""

from __future__ import annotations

import argparse
import math
import random
import sys
import time
from collections.abc import Callable
from functools import reduce
from operator import xor

import pynmea2

from autopilot.guidance.plotter import PlotterGuide, PlotterHeading, PlotterLeg, PlotterMessage
from autopilot.links.nmea.samples import NmeaReader
from autopilot.links.nmea.sentences import NmeaFramer
from autopilot.signals import HeadingSample, RateSample, RudderSample, Sample, SpeedSample

BODIES = {
    "HDG": "HCHDG,101.1,1.0,E,7.1,W",
    "HDM": "HCHDM,093.8,M",
    "HDT": "HEHDT,123.4,T",
    "THS": "HETHS,123.4,A",
    "ROT": "TIROT,-35.6,A",
    "RSA": "IIRSA,10.5,A,,V",
    "RMC": "GPRMC,081836,A,3751.65,S,14507.36,E,003.4,360.0,130998,011.3,E,A",
    "VTG": "GPVTG,054.7,T,034.4,M,005.5,N,010.2,K,A",
    "VHW": "VWVHW,054.7,T,034.4,M,005.5,N,010.2,K",
    "APB": "GPAPB,A,A,0.10,R,N,V,V,011,T,DEST,011,T,011,T,A",
    "RMB": "GPRMB,A,0.66,L,003,004,4917.24,N,12309.57,W,001.3,052.5,000.5,V,A",
    "XTE": "GPXTE,A,A,0.67,L,N,A",
    "HTC": "IIHTC,V,,,H,N,,,,,045.0,,,T",
    "HTD": "IIHTD,V,,,H,N,,,,,045.0,,,T,A,A,A,040.0",
}
VALUE = {"RMC": 7, "VTG": 5, "VHW": 5, "APB": 8, "RMB": 11, "XTE": 3, "HTC": 10, "HTD": 10}
"""The field that steers; 1 where none is named."""
ATTRIBUTE = {
    "HDG": "heading", "HDM": "heading", "HDT": "heading", "THS": "headT", "ROT": "rate_of_turn",
    "RSA": "rsa_starboard", "RMC": "spd_over_grnd", "VTG": "spd_over_grnd_kts", "VHW": "water_speed_knots",
    "APB": "bearing_to_dest", "RMB": "dest_true_bearing", "XTE": "cross_track_err_dist",
}  # fmt: skip
IMPOSSIBLE = ("nan", "inf", "1e9", "1_0", " 12.0", "99999.9", "-99999.0", "12.3.4", "0x10", "٣", "")
UNEXPECTED = "raised something else"


def line_of(body: str) -> str:
    """Return the body with `$` and a right checksum."""
    return f"${body}*{reduce(xor, body.encode('utf-8', 'replace'), 0):02X}"


class Ear(PlotterGuide):
    """Keeps what the reader tells the guide."""

    message: PlotterMessage | None = None

    def take(self, message: PlotterMessage) -> None:
        """Keep."""
        self.message = message


def ours(line: str) -> float | None:
    """Return the value [rad, m/s or m] that our reader takes from a line; None where it takes none."""
    guide = Ear()
    reader = NmeaReader(0.0, guide=guide)
    taken: Sample | PlotterMessage | None = None
    for sentence in NmeaFramer().feed(line.encode("utf-8", "replace") + b"\r\n"):
        if sentence.type == "XTE":
            # an error needs the leg that it belongs to
            (apb,) = NmeaFramer().feed(line_of(BODIES["APB"].replace("0.10,R", "0.67,L")).encode() + b"\r\n")
            reader.read(0.0, apb)
            guide.message = None
        taken = reader.read(0.0, sentence) or guide.message
    match taken:
        case HeadingSample() | PlotterHeading():
            return taken.heading
        case RateSample():
            return taken.rate
        case RudderSample():
            return taken.angle
        case SpeedSample():
            return taken.speed
        case PlotterLeg():
            return taken.track + taken.cross_track
    return None


def theirs(line: str) -> float | None:
    """Return the number that a pilot using pynmea2 as its documentation shows takes from a line."""
    message = pynmea2.parse(line + "\r\n", check=True)
    value = getattr(message, ATTRIBUTE[message.sentence_type])
    return None if value in (None, "") else float(value)


def take(parser: Callable[[str], float | None], line: str) -> float | str | None:
    """Return the value, None where it was refused, or how the parser failed."""
    try:
        return parser(line)
    except (pynmea2.ParseError, ValueError):
        return None
    except Exception as error:
        return f"{UNEXPECTED}: {type(error).__name__}"


def damaged(kind: str, rng: random.Random) -> tuple[str, str]:
    """Return which damage and the damaged line."""
    line = line_of(BODIES[kind])
    which = rng.choice(("byte changed", "impossible field", "cut"))
    if which == "cut":
        return which, line[: rng.randrange(1, len(line) - 1)]
    if which == "byte changed":
        place = rng.randrange(1, len(line))
        return which, line[:place] + chr(ord(line[place]) ^ rng.randrange(1, 128)) + line[place + 1 :]
    fields = BODIES[kind].split(",")
    # VTG and VHW hold the speed twice: without knots the one in km/h is right
    fields[VALUE.get(kind, 1)] = rng.choice(IMPOSSIBLE if kind not in ("VTG", "VHW") else IMPOSSIBLE[:-1])
    return which, line_of(",".join(fields))


def known_sentences(parsers: dict[str, Callable[[str], float | None]]) -> dict[str, dict[str, float | str | None]]:
    """Print which sentences each parser knows; return the value each takes from the sound sentence."""
    print("| sentence | ours | pynmea2 |\n|---|---|---|")
    right: dict[str, dict[str, float | str | None]] = {name: {} for name in parsers}
    for kind, body in BODIES.items():
        for name, parser in parsers.items():
            right[name][kind] = take(parser, line_of(body))
        known = ["yes" if isinstance(right[name][kind], float) else "no" for name in parsers]
        print(f"| {kind} | {' | '.join(known)} |")
    return right


def damage_table(
    name: str, parser: Callable[[str], float | None], right: dict[str, float | str | None], kinds: list[str], count: int
) -> None:
    """Print what a parser makes of damaged sentences of `kinds`."""
    rng = random.Random(1)
    table: dict[str, list[int]] = {}
    for _ in range(count):
        kind = rng.choice(kinds)
        which, line = damaged(kind, rng)
        value = take(parser, line)
        if value is None:
            column = 0
        elif isinstance(value, str):
            column = 3
        else:
            column = 1 if value == right[kind] and which != "impossible field" else 2
        table.setdefault(which, [0, 0, 0, 0])[column] += 1
    for which, row in sorted(table.items()):
        print(f"| {which} | {name} | {sum(row)} | {' | '.join(map(str, row))} |")


def cost(line: str) -> list[float]:
    """Return the microseconds that a sentence costs us and pynmea2: the best of seven rounds of a thousand."""
    raw = line.encode() + b"\r\n"
    framer, reader = NmeaFramer(), NmeaReader(0.0)
    best = [math.inf, math.inf]
    for _ in range(7):
        start = time.perf_counter()
        for _ in range(1000):
            for sentence in framer.feed(raw):
                reader.read(0.0, sentence)
        middle = time.perf_counter()
        for _ in range(1000):
            theirs(line)
        end = time.perf_counter()
        best = [min(best[0], (middle - start) * 1e3), min(best[1], (end - middle) * 1e3)]
    return best


def main() -> None:
    """Print the three tables."""
    options = argparse.ArgumentParser()
    options.add_argument("--count", type=int, default=20000, help="damaged lines for each parser")
    count = options.parse_args().count
    parsers: dict[str, Callable[[str], float | None]] = {"ours": ours, "pynmea2": theirs}
    right = known_sentences(parsers)
    both = [kind for kind in BODIES if isinstance(right["pynmea2"][kind], float)]
    print("\n| damage | parser | lines | refused | same value | wrong value taken | other exceptions |")
    print("|---|---|---|---|---|---|---|")
    for name, parser in parsers.items():
        damage_table(name, parser, right[name], both, count)
    print("\n| cost of a sentence, us | ours, framing and meaning | pynmea2, parse and one number |\n|---|---|---|")
    for kind in ("HDT", "HDG", "RMC"):
        print(f"| {kind} | {' | '.join(f'{value:.1f}' for value in cost(line_of(BODIES[kind])))} |")


if __name__ == "__main__":
    sys.exit(main())
