"""How often the bands of `autopilot identify` hold what the simulator's plants do, whose equations are not the model's.

    python benchmarks/zoo_predictions.py [--seeds 20] [--first-seed 0 | --today] [--plant NAME]

Each seed draws speed, weather, and a pair of zigzags of 12 to 25 deg to either side, which are identified. Held out
are a 10/10 zigzag in the same weather: its first two overshoots, and the heading 30 s on from five of its moments,
from the rudder and the speed that it had. Prints in how many of 100 the 95 % bands hold them, and half their width.
"""

from __future__ import annotations

import argparse
import datetime
import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from learning_seasons import CALM, KINDS, Kind, Sample, kind_of, sailed, weather_of

from autopilot.errors import InputError
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.prediction_bands import (
    AHEAD_S,
    BAND,
    MOST_STRETCHES,
    fastest_rudder,
    forecast,
    headings_after,
    in_the_race,
    motions_of,
    stretches_of,
    widened,
)
from autopilot.identification.runs import Run, run_from_columns

MOMENTS, FIT_H, ZIGZAG_H = 5, 40.0, 30.0
FINER = 4.0
"""The helm sees the heading so many times as often as in the seasons: a late helm is no error of the model."""
NAMES = ("time_s", "rudder_rad", "speed_m_s", "heading_rad", "yaw_rate_rad_s")
CALM_SHARE = 1.0 / 3.0


class Held(NamedTuple):
    """Of a kind of prediction: how many were inside, of how many, and half the bands' widths [deg]."""

    inside: list[bool]
    width: list[float]
    error: list[float]


class Zigzag:
    """A zigzag with so much rudder and heading [rad], to `side` first; turns: when [s] the rudder was put over."""

    def __init__(self, angle: float, side: int = 1) -> None:
        self.angle, self.order, self.turns = angle, side * angle, list[float]()

    def __call__(self, now: float, heading: float, rate: float) -> float:
        if heading * math.copysign(1.0, self.order) >= self.angle:
            self.order = -self.order
            self.turns.append(now)
        return self.order


def run_of(samples: list[Sample], speed: float) -> Run:
    """Return what is recorded."""
    rows = np.array(samples).T[:5] * np.array([1.0, 1.0, speed, 1.0, 1.0])[:, None]
    return run_from_columns("zigzag", dict(zip(NAMES, rows, strict=True)))


def overshoots_of(samples: list[Sample], turns: list[float]) -> list[float]:
    """Return the first two overshoots [rad]: by how much the boat turned on after the rudder was put over."""
    found = []
    for begin, end in pairwise(turns[:3]):
        headings = np.array([sample.true for sample in samples if begin <= sample.time <= end])
        found.append(float(np.max(np.abs(headings - headings[-1])) - abs(headings[0] - headings[-1])))
    return found


def judged(kind: Kind, seed: int, held: dict[str, Held]) -> bool:
    """Sail, identify, predict and compare; return whether there was an answer."""
    random = np.random.default_rng([seed, 41])
    weather = CALM if random.random() < CALM_SHARE else weather_of(random, kind.h)
    reference, often = kind.model.reference_speed, kind._replace(h=kind.h / FINER)
    speed = reference * random.uniform(0.75, 1.1)
    angle = math.radians(random.uniform(12.0, 25.0))
    fitted = [
        run_of(list(sailed(often, weather, Zigzag(angle, side), FIT_H * kind.h, speed, random)), reference)
        for side in (1, -1)
    ]
    try:
        found = identify(fitted, Question(reference_speed=speed))
    except InputError:
        return False
    if found.predictor is None:
        return False
    helm = Zigzag(math.radians(10.0))
    samples = list(sailed(often, weather, helm, ZIGZAG_H * kind.h + AHEAD_S, speed, random))
    flows, flow = in_the_race(found.around, fitted, speed)
    likely = widened(found.predictor, flows, flow)
    expected = forecast(found.predictor, flows, flow, fastest_rudder(fitted))
    for number, (band, value) in enumerate(
        zip(expected.overshoots[10.0], overshoots_of(samples, helm.turns), strict=False)
    ):
        note(held, f"overshoot {number + 1}", value, band)
    record = run_of([sample._replace(heading=sample.true) for sample in samples], reference)
    (last,), _ = in_the_race(found.around, [record], speed)
    parts = stretches_of(last.segments, motions_of(last.segments), AHEAD_S)[:: MOST_STRETCHES // MOMENTS]
    for each, drawn in zip(parts, headings_after(likely, parts, AHEAD_S, flow), strict=True):
        note(held, "heading after 30 s", each.turned, tuple(np.quantile(drawn, BAND).tolist()))
    return True


def note(held: dict[str, Held], what: str, value: float, band: tuple[float, ...]) -> None:
    """Add a prediction."""
    low, middle, high = band
    into = held.setdefault(what, Held([], [], []))
    into.inside.append(low <= value <= high)
    into.width.append(math.degrees(0.5 * (high - low)))
    into.error.append(math.degrees(value - middle))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--today", action="store_true", help="seeds drawn from today's date")
    parser.add_argument("--plant", action="append", choices=KINDS, help="default: all")
    given = parser.parse_args()
    first = datetime.date.today().toordinal() * 1000 if given.today else given.first_seed
    print(f"Seeds {first} to {first + given.seeds - 1}; held in % (half the band, rms error, deg)\n")
    print("| plant | answers | overshoot 1 | overshoot 2 | heading after 30 s |\n|---|---|---|---|---|", flush=True)
    for name in given.plant or KINDS:
        held: dict[str, Held] = {}
        answers = sum(judged(kind_of(name), seed, held) for seed in range(first, first + given.seeds))
        cells = [
            cell(held[what]) if what in held else "-" for what in ("overshoot 1", "overshoot 2", "heading after 30 s")
        ]
        print(f"| {name} | {answers} of {given.seeds} | {' | '.join(cells)} |", flush=True)


def cell(held: Held) -> str:
    """Return what came of one kind of prediction."""
    size = math.sqrt(float(np.mean(np.square(held.error))))
    return f"{100.0 * float(np.mean(held.inside)):.0f} of {len(held.inside)} ({np.median(held.width):.1f}, {size:.1f})"


if __name__ == "__main__":
    main()
