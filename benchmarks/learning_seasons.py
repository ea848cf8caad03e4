"""Seasons of ordinary sailing with a skipper who adopts the first model that has proved itself; prints a table.

    python benchmarks/learning_seasons.py [--seasons 1000] [--first-seed 0 | --today] [--jobs 1] [--into FILE] \
        [--rough] [--lasts 300] [--off]

Each season is sailed by one of the simulator's plants (no plant's equation is the model's), in wind, gusts and waves
of its own, by a hand that leaves harbour and then changes course now and then: 300 lengths at service speed, or as
`--lasts` says. `--rough`: waves of 2 to 30 deg of rudder and gusts of 0.5 to 6, as small boats meet. The file's
model is the right one in a third of them; in the others K and T are off by 35 % (standard deviation of the
logarithm) and n3 by 50 %; with `--off` it is off by one of OFF, one after the other. The model adopted is tried on
another day, with other weather, on course changes, on a 20/20 zigzag in calm water, and on the same course changes in
calm water: from the rudder alone, stretch by stretch, as the learner predicts. It is worse where its root mean square
heading error is larger than that of the model before. In weather a rudder that answers it speaks for a model on which
the rudder does little, for what the rudder does is undone by what it answers: so the rudder of that day is tried once
more in calm water, where all that turns the boat is the rudder.
The chance is how often a model that is not better by as much as `learning.BETTER` says may be called proved at most
(`learning.CHANCE`); beside it stands what comes of taking the first model that is put forward. `--into FILE` writes
each season as it ends and goes on where it was left; `--seasons 0 --into FILE` prints what FILE holds.
"""

from __future__ import annotations

import argparse
import datetime
import itertools
import json
import math
import multiprocessing
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from autopilot.identification.learning import CHANCE, Learner, ahead_of
from autopilot.identification.live_filter import moved_on
from autopilot.models.norrbin import Norrbin
from autopilot.runtime.build import model_of
from autopilot.vessel.file import load_vessel
from sitl.boat import BoatState, Disturbance, step_of
from sitl.registry import PLANTS
from sitl.scenario import Scenario

PUT_FORWARD = 1.0
"""The chance of a skipper who takes the first model that is put forward, proved or not."""
KINDS = ("mmg_tanker", "roll_ship", "small_craft", "twin_thruster", "outboard")
HARBOUR_H, DAY_H = 60.0, 60.0
OFF = ((0.6, 1.0, 1.0), (1.7, 1.0, 1.0), (1.0, 0.5, 1.0), (1.0, 2.0, 1.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0))
"""What K, T and n3 of the file are times the right ones with `--off`; the last file is right."""
STEPS_PER_H, SAMPLES_PER_H, LONGEST_STEP_S = 40.0, 5.0, 0.1
COMPASS, GYRO = math.radians(0.3), math.radians(0.2)


class Kind(NamedTuple):
    """A plant, its function, its file's model, and the time h [s] in which it sails its length."""

    plant: Any
    step: Callable[..., BoatState]
    model: Norrbin
    h: float


class Sample(NamedTuple):
    """time [s], rudder [rad], speed ratio, heading [rad] and rate [rad/s] as measured, and the true heading."""

    time: float
    rudder: float
    ratio: float
    heading: float
    rate: float
    true: float


class Weather(NamedTuple):
    """Gusts and waves, rms, and a wind abeam, all in radians of rudder; the gusts' time and the waves' period [s];
    where the wind comes from [rad]."""

    gust: float
    gust_time: float
    wave: float
    wave_period: float
    wind: float
    wind_from: float


CALM = Weather(0.0, 5.0, 0.0, 3.0, 0.0, 0.0)


@cache
def kind_of(name: str) -> Kind:
    """Return a plant of the simulator."""
    vessel = load_vessel(name)
    assert vessel.length_m is not None
    scenario = Scenario(1, name, plant=name)
    return Kind(
        PLANTS[name].of(vessel, scenario),
        PLANTS[name].step,
        model_of(vessel),
        vessel.length_m / model_of(vessel).reference_speed,
    )


def weather_of(random: np.random.Generator, h: float) -> Weather:
    """Draw a day's weather: from next to nothing to 3 deg of rudder in gusts and 2 in waves."""
    gust, wave, wind = np.radians(np.exp(random.uniform(np.log([0.1, 0.05, 0.1]), np.log([3.0, 2.0, 4.0]))))
    return Weather(
        gust, random.uniform(1.0, 6.0) * h, wave, random.uniform(0.7, 3.0) * h, wind, random.uniform(-3.1, 3.1)
    )


def hand(random: np.random.Generator, h: float, lasts: float) -> Callable[[float, float, float], float]:
    """Return a hand at the helm, which steers courses: time [s], heading and rate as felt -> rudder [rad]."""
    legs, time, course = [], 0.0, 0.0
    while time < lasts:
        legs.append((time, course))
        time += random.uniform(5.0, 15.0) * h if time < HARBOUR_H * h else random.uniform(15.0, 60.0) * h
        course += math.radians(random.uniform(10.0, 60.0)) * random.choice([-1.0, 1.0])
    gain, rate_gain, most = (
        random.uniform(0.7, 1.5),
        random.uniform(0.8, 1.5) * h,
        math.radians(random.uniform(10.0, 25.0)),
    )

    def steer(now: float, heading: float, rate: float) -> float:
        wanted = next(angle for begin, angle in reversed(legs) if now >= begin)
        return min(max(gain * (wanted - heading) - rate_gain * rate, -most), most)

    return steer


def zigzag() -> Callable[[float, float, float], float]:
    """Return a 20/20 zigzag."""
    order = math.radians(20.0)

    def steer(now: float, heading: float, rate: float) -> float:
        nonlocal order
        order = -order if heading * math.copysign(1.0, order) >= abs(order) else order
        return order

    return steer


def sailed(
    kind: Kind,
    weather: Weather,
    steer: Callable[[float, float, float], float],
    lasts: float,
    speed: float,
    random: np.random.Generator,
) -> Iterator[Sample]:
    """Yield what is measured while the plant sails."""
    count = max(1, round(kind.h / SAMPLES_PER_H / min(kind.h / STEPS_PER_H, LONGEST_STEP_S)))
    dt = kind.h / SAMPLES_PER_H / count
    step, state = step_of(kind.plant, dt), BoatState(speed=speed)
    gust = wave = swing = 0.0
    keep, W = math.exp(-dt / weather.gust_time), 2.0 * math.pi / weather.wave_period
    push, kick = weather.gust * math.sqrt(1.0 - keep * keep), 2.0 * math.sqrt(0.1 * W**3 * dt) * weather.wave
    for number in range(round(lasts / (dt * count))):
        time = number * count * dt
        noise = random.standard_normal(2 + 2 * count).tolist()
        heading, rate = state.heading + COMPASS * noise[0], state.rate + GYRO * noise[1]
        yield Sample(time, state.rudder, state.speed / kind.model.reference_speed, heading, rate, state.heading)
        order = steer(time, heading, rate)
        for i in range(count):
            gust = keep * gust + push * noise[2 + 2 * i]
            swing += dt * (-0.2 * W * swing - W * W * wave) + kick * noise[3 + 2 * i]
            wave += dt * swing
            steady = weather.wind * math.sin(weather.wind_from - state.heading)
            state = kind.step(kind.plant, step, state, order, speed, Disturbance(rudder=gust + wave + steady))


def errors(kind: Kind, model: Norrbin, samples: list[Sample], ahead: float) -> list[float]:
    """Return the heading errors [rad] at the ends of stretches of `ahead` [s], less their mean."""
    found, begin, motion = [], samples[0], (0.0, 0.0)
    for before, now in itertools.pairwise(samples):
        motion = moved_on(model, before.ratio, motion, now.time - before.time, (before.rudder, now.rudder))
        if now.time - begin.time >= ahead:
            found.append(motion[1] - (now.true - begin.true))
            slope = (now.true - before.true) / (now.time - before.time)
            begin, motion = now, (slope, 0.0)
    return [error - float(np.mean(found)) for error in found]


class Verdict(NamedTuple):
    """Errors [deg] of the model before and the adopted one, on another day, and in calm water on a zigzag, on course
    changes and with the rudder of that day."""

    day: tuple[float, float]
    zigzag: tuple[float, float]
    courses: tuple[float, float]
    rudder: tuple[float, float]


def tried(kind: Kind, before: Norrbin, after: Norrbin, speed: float, random: np.random.Generator) -> Verdict:
    """Return how both models predict on another day."""
    ahead = ahead_of(before, after)
    lasts = DAY_H * kind.h
    day = list(sailed(kind, weather_of(random, kind.h), hand(random, kind.h, HARBOUR_H * kind.h), lasts, speed, random))
    calm = list(sailed(kind, CALM, zigzag(), lasts, speed, random))
    courses = list(sailed(kind, CALM, hand(random, kind.h, HARBOUR_H * kind.h), lasts, speed, random))
    times, rudders = [each.time for each in day], [each.rudder for each in day]

    def moved(now: float, heading: float, rate: float) -> float:
        return float(np.interp(now, times, rudders))

    alone = list(sailed(kind, CALM, moved, lasts, speed, random))
    size: list[tuple[float, float]] = []
    for samples in (day, calm, courses, alone):
        both = [
            np.degrees(np.sqrt(np.mean(np.square(errors(kind, model, samples, ahead))))) for model in (before, after)
        ]
        size.append((float(both[0]), float(both[1])))
    return Verdict(*size)


class Adoption(NamedTuple):
    """When [h] a model was put forward or had proved itself, and how both models predict then."""

    chance: float
    when: float
    verdict: Verdict


class Season(NamedTuple):
    """What came of it: the plant, whether the file's model was the right one, the first model put forward and the first
    that proved itself."""

    seed: int
    kind: str
    was_right: bool
    adoptions: tuple[Adoption, ...]


def season(seed: int, lasts_h: float = 300.0, rough: bool = False, is_off: bool = False) -> Season:
    """Sail the season of that seed."""
    random = np.random.default_rng([seed, 23])
    name = KINDS[seed % len(KINDS)]
    kind = kind_of(name)
    K, T, n3 = np.exp(random.standard_normal(3) * [0.35, 0.35, 0.5])
    was_right = bool(random.random() < 1.0 / 3.0)
    if is_off:
        K, T, n3 = OFF[seed // len(KINDS) % len(OFF)]
        was_right = (K, T, n3) == OFF[-1]
    right = kind.model._replace(n0=0.0)
    off = right._replace(gain=K * right.gain, time_constant=T * right.time_constant, n3=n3 * right.n3)
    present, lasts = right if was_right else off, lasts_h * kind.h
    speed = right.reference_speed * random.uniform(0.75, 1.1)
    has_gyro = random.random() < 0.5
    learner, adoptions = Learner(present), list[Adoption]()
    weather, steer = weather_of(random, kind.h), hand(random, kind.h, lasts)
    if rough:
        wave, gust = math.exp(random.uniform(math.log(2.0), math.log(30.0))), random.uniform(0.5, 6.0)
        weather = weather._replace(wave=math.radians(wave), gust=math.radians(gust))
    tried_of = dict[Norrbin, Verdict]()
    for sample in sailed(kind, weather, steer, lasts, speed, random):
        learner.update(sample.time, sample.rudder, sample.ratio, sample.heading, sample.rate if has_gyro else None)
        proposal = learner.proposal()
        if proposal is None:
            continue
        for chance in (PUT_FORWARD, CHANCE)[len(adoptions) :]:
            if chance == CHANCE and not proposal.is_proved:
                break
            if proposal.model not in tried_of:
                # another day is drawn by itself: what is tried must not change what is sailed
                other = np.random.default_rng([seed, 29, len(tried_of)])
                tried_of[proposal.model] = tried(kind, present, proposal.model, speed, other)
            adoptions.append(Adoption(chance, sample.time / kind.h, tried_of[proposal.model]))
        if len(adoptions) == 2:
            break
    return Season(seed, name, was_right, tuple(adoptions))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seasons", type=int, default=1000)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--today", action="store_true", help="seeds drawn from today's date")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--lasts", type=float, default=300.0, help="lengths that a season lasts")
    parser.add_argument("--rough", action="store_true", help="waves of 2 to 30 deg of rudder, gusts of 0.5 to 6")
    parser.add_argument("--off", action="store_true", help="files that are off by a factor of K, T or n3")
    parser.add_argument("--into", type=Path, help="a file of seasons, a line each, to go on with")
    given = parser.parse_args()
    first = datetime.date.today().toordinal() * 10000 if given.today else given.first_seed
    seasons = kept(given.into)
    begun = {each.seed for each in seasons}
    seeds = [seed for seed in range(first, first + given.seasons) if seed not in begun]
    sail = partial(season, lasts_h=given.lasts, rough=given.rough, is_off=given.off)
    with multiprocessing.Pool(given.jobs) as pool:
        for each in pool.imap_unordered(sail, seeds):
            seasons.append(each)
            if given.into:
                with given.into.open("a") as lines:
                    lines.write(json.dumps(each) + "\n")
    show(seasons)


def kept(path: Path | None) -> list[Season]:
    """Return the seasons that a file of `--into` holds."""
    if path is None or not path.exists():
        return []
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    return [
        Season(
            seed,
            name,
            was_right,
            tuple(Adoption(chance, when, Verdict(*map(tuple, pairs))) for chance, when, pairs in adoptions),
        )
        for seed, name, was_right, adoptions in rows
    ]


def show(seasons: list[Season]) -> None:
    """Print the tables of some seasons."""
    seeds = sorted(each.seed for each in seasons)
    print(f"Seeds {seeds[0]} to {seeds[-1]}; the product's chance is {CHANCE:g}\n")
    print(
        "| chance | seasons | adopted, file right | file off | worse on a day | on a zigzag | on both "
        "| on courses in a calm | with the day's rudder in a calm | day: before, after "
        "| its rudder in a calm: before, after |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for chance in (PUT_FORWARD, CHANCE):
        print(line(chance, seasons))
    print(
        f"\n| plant | seasons | adopted at {CHANCE:g} | after [h] | worse on a day | on a zigzag |"
        "\n|---|---|---|---|---|---|"
    )
    for name in KINDS:
        rows = [each for each in seasons if each.kind == name]
        known = [found for each in rows for found in each.adoptions if found.chance == CHANCE]
        middle = f"{np.median([found.when for found in known]):.0f}" if known else "-"
        day, calm = (
            sum(is_worse(pair) for pair in pairs)
            for pairs in ([f.verdict.day for f in known], [f.verdict.zigzag for f in known])
        )
        print(f"| {name} | {len(rows)} | {len(known)} | {middle} | {day} | {calm} |")
    for each in sorted(seasons):
        for found in each.adoptions:
            if found.chance == CHANCE and any(map(is_worse, found.verdict)):
                (a, b), (c, d), (e, f), (g, h) = found.verdict
                print(
                    f"worse: seed {each.seed}, {each.kind}, {found.when:.0f} h: day {a:.2f}, {b:.2f}, "
                    f"zigzag {c:.2f}, {d:.2f}, courses in a calm {e:.2f}, {f:.2f}, "
                    f"its rudder in a calm {g:.2f}, {h:.2f}"
                )


def is_worse(pair: tuple[float, float]) -> bool:
    """Return whether the adopted model's error is the larger one."""
    return pair[1] > pair[0]


def line(chance: float, seasons: list[Season]) -> str:
    """Return the line of the first adoptions at a chance."""
    known = [(each, found.verdict) for each in seasons for found in each.adoptions if found.chance == chance]
    verdicts = [verdict for _, verdict in known]
    right = sum(each.was_right for each, _ in known)
    worse = [sum(map(is_worse, pairs)) for pairs in zip(*verdicts, strict=True)] if verdicts else [0] * 4
    both = sum(is_worse(v.day) and is_worse(v.zigzag) for v in verdicts)
    a, b, c, d = np.median([(*v.day, *v.rudder) for v in verdicts], axis=0) if verdicts else (math.nan,) * 4
    counts = (len(seasons), right, len(known) - right, *worse[:2], both, *worse[2:])
    return f"| {chance:g} | {' | '.join(map(str, counts))} | {a:.1f}, {b:.1f} deg | {c:.1f}, {d:.1f} deg |"


if __name__ == "__main__":
    main()
