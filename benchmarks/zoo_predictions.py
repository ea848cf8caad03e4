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
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from learning_seasons import CALM, KINDS, SAMPLES_PER_H, Kind, Sample, kind_of, sailed, weather_of

from autopilot.errors import InputError
from autopilot.identification.drive_effect import at_one_throttle, fit_drive, likely_drive
from autopilot.identification.identified import Question
from autopilot.identification.identify import identify
from autopilot.identification.likelihood_fit import LikelihoodFit
from autopilot.identification.prediction_bands import (
    AHEAD_S,
    BAND,
    MOST_STRETCHES,
    forecast,
    gear_of,
    headings_after,
    in_the_race,
    motions_of,
    stretches_of,
    widened,
)
from autopilot.identification.runs import Run, run_from_columns
from autopilot.models.drives import DRIVES, Mixing, mixed, moment, steering_for
from autopilot.models.steering_gear import SteeringGear
from autopilot.runtime.build import gear_of as steering_gear_of
from autopilot.vessel.file import load_vessel
from sitl.registry import PLANTS

Helm = Callable[[float, float, float], float]

MOMENTS, FIT_H, ZIGZAG_H = 5, 40.0, 30.0
FINER = 4.0
"""The helm sees the heading so many times as often as in the seasons: a late helm is no error of the model."""
SPACING_S = 0.05
"""Samples of boats that steer by thrust are no further apart: thrusters go over within 0.1 s."""
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


class Thrust(NamedTuple):
    """What a log of a boat that steers by thrust holds, beside a plant that is sailed by its steering: the throttle
    [share of full], nan of a rudder, and of two thrusters how they are mixed, with the angle of full steering
    [rad]; gear: the vessel file's, of a boat that steers by thrust."""

    throttle: float = math.nan
    mixing: Mixing | None = None
    full: float = 1.0
    gear: SteeringGear | None = None

    def steering(self, helm: Helm) -> Helm:
        """Return the helm that gives the plant the steering for what `helm` orders: of two thrusters a moment."""
        if (mixing := self.mixing) is None:
            return helm

        def steer(now: float, heading: float, rate: float) -> float:
            return self.full * steering_for(mixing, helm(now, heading, rate) / self.full, self.throttle)

        return steer

    def shown(self, samples: list[Sample]) -> list[Sample]:
        """Return the samples with the moment that the outputs of two thrusters make in place of their steering."""
        if self.mixing is None:
            return samples
        outputs = [mixed(self.mixing, sample.rudder / self.full, self.throttle) for sample in samples]
        return [
            sample._replace(rudder=self.full * moment(self.mixing, *pair))
            for sample, pair in zip(samples, outputs, strict=True)
        ]


def thrust_of(kind: Kind, name: str, speed: float) -> Thrust:
    """Return how the boat of a vessel file steers by thrust at a `speed` [m/s] of its throttle."""
    vessel = load_vessel(name)
    drive = vessel.drive
    usual = DRIVES[drive.kind]
    if usual.usual.is_rudder:
        return Thrust()
    throttle = PLANTS[name].motors.throttle_of(speed)
    mixing = Mixing(exponent=drive.thrust_exponent or math.nan) if usual.is_mixed else None
    return Thrust(throttle, mixing, kind.plant.gear.angle_max, steering_gear_of(vessel))


class Found(NamedTuple):
    """The fit that predicts, and the runs and the reference speed [m/s] that it is stated for; `like_the_runs` makes
    another run like them."""

    fit: LikelihoodFit
    runs: list[Run]
    speed: float
    like_the_runs: Callable[[Run], list[Run]]


def found_of(fitted: list[Run], name: str, speed: float) -> Found | None:
    """Return what `autopilot identify` finds of the runs of that vessel file's boat."""
    kind = DRIVES[load_vessel(name).drive.kind]
    if not kind.usual.is_rudder:
        driven = fit_drive(fitted, kind.usual, kind.needs)
        fit = likely_drive(fitted, driven)
        if fit is None:
            return None
        runs, law = at_one_throttle(fitted, driven.law), driven.law
        return Found(fit, runs, driven.model.reference_speed, lambda run: at_one_throttle([run], law))
    try:
        found = identify(fitted, Question(reference_speed=speed))
    except InputError:
        return None
    if found.predictor is None:
        return None
    runs, flow = in_the_race(found.around, fitted, speed)
    return Found(found.predictor, runs, flow, lambda run: in_the_race(found.around, [run], speed)[0])


def judged(kind: Kind, name: str, seed: int, held: dict[str, Held]) -> bool:
    """Sail, identify, predict and compare; return whether there was an answer."""
    random = np.random.default_rng([seed, 41])
    weather = CALM if random.random() < CALM_SHARE else weather_of(random, kind.h)
    by_rudder = DRIVES[load_vessel(name).drive.kind].usual.is_rudder
    finer = FINER if by_rudder else max(FINER, kind.h / SAMPLES_PER_H / SPACING_S)
    reference, often = kind.model.reference_speed, kind._replace(h=kind.h / finer)
    speed = reference * random.uniform(0.75, 1.1)
    angle = math.radians(random.uniform(12.0, 25.0))
    helms = [Zigzag(angle, 1), Zigzag(angle, -1), Zigzag(math.radians(10.0))]
    lasts = (FIT_H * kind.h, FIT_H * kind.h, ZIGZAG_H * kind.h + AHEAD_S)
    thrust = thrust_of(kind, name, speed)
    sailings = [
        thrust.shown(list(sailed(often, weather, thrust.steering(helm), length, speed, random)))
        for helm, length in zip(helms, lasts, strict=True)
    ]
    fitted = [run_of(samples, reference)._replace(throttle=thrust.throttle) for samples in sailings[:2]]
    found = found_of(fitted, name, speed)
    if found is None:
        return False
    helm, samples = helms[2], sailings[2]
    likely = widened(found.fit, found.runs, found.speed)
    expected = forecast(found.fit, found.runs, found.speed, thrust.gear or gear_of(fitted))
    for number, (band, value) in enumerate(
        zip(expected.overshoots[10.0], overshoots_of(samples, helm.turns), strict=False)
    ):
        note(held, f"overshoot {number + 1}", value, band)
    record = run_of([sample._replace(heading=sample.true) for sample in samples], reference)
    (last,) = found.like_the_runs(record._replace(throttle=thrust.throttle))
    parts = stretches_of(last.segments, motions_of(last.segments), AHEAD_S)[:: MOST_STRETCHES // MOMENTS]
    for each, drawn in zip(parts, headings_after(likely, parts, AHEAD_S, found.speed), strict=True):
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
        answers = sum(judged(kind_of(name), name, seed, held) for seed in range(first, first + given.seeds))
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
