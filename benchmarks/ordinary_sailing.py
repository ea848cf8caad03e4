"""What ordinary steering tells of a boat, alone and with what other boats say; prints tables.

    python benchmarks/ordinary_sailing.py boats                       each published boat, expected from the others
    python benchmarks/ordinary_sailing.py left-out [--today]     published boats sailed, with what the others say
    python benchmarks/ordinary_sailing.py drawn [--boats 24] [--today]      boats drawn afresh
    python benchmarks/ordinary_sailing.py zoo [--seeds 3] [--today]         the simulator's plants

Nobody sails a trial. A hand (proportional and rate, 0.3 deg of compass noise) leaves a harbour by course changes of 12
to 30 deg, in gusts and waves of 1 deg of rudder each, so that its rudder answers the gusts. Times are in h = L/U, the
time in which a boat sails its own length. A model is useful from the record
on from which K/T stays within 30 %, which designed gains bear, and the heading over the first 15 h of a 20/20 zigzag,
which was not sailed, is predicted to 6 deg rms.
"""

from __future__ import annotations

import argparse
import datetime
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from learning_seasons import CALM, KINDS, Kind, Sample, hand, kind_of, weather_of
from learning_seasons import errors as stretch_errors
from learning_seasons import sailed as plant_sailed
from learning_seasons import zigzag as plant_zigzag
from numpy.typing import NDArray

from autopilot.errors import InputError
from autopilot.identification.boat_prior import WIDENED, BoatPrior, primes, prior_of
from autopilot.identification.identified import Identified, Question, Steps, silent
from autopilot.identification.identify import LEAST_EXPLAINED, check_excitation, identify, starting_point
from autopilot.identification.likelihood_model import answer_of, likeliest_fit
from autopilot.identification.runs import Run, run_from_columns
from autopilot.models.norrbin import Norrbin
from autopilot.vessel.file import PUBLISHED, boats_prior, published_boats

FloatArray = NDArray[np.float64]
LENGTHS_H = (3.0, 4.0, 5.0, 6.5, 8.0, 10.0, 12.5, 16.0, 20.0, 28.0, 40.0, 60.0)
"""Records end after so many h."""
SAMPLES_PER_H, STEPS = 8, 8
"""Samples of a record in h, steps of the simulation between two."""
LENGTH_M, SPEED_M_S = 10.0, 5.0
COMPASS, GYRO_H = math.radians(0.3), math.radians(2.0)
"""Noise of the compass [rad], and of the rate that the hand feels [rad per h]; no rate is recorded."""
GUST, WAVE, GUST_H, WAVE_H = math.radians(1.0), math.radians(1.0), 2.0, 2.5
STOP, SLEW_H = math.radians(25.0), math.radians(25.0)
"""The rudder's end [rad] and rate [rad per h]."""
HAND, HAND_RATE_H = 1.0, 1.0
LEGS = (
    (0, 0),
    (1, 12),
    (5, 0),
    (9, -15),
    (13, 5),
    (18, 20),
    (23, 10),
    (28, -15),
    (34, 0),
    (40, 30),
    (46, 10),
    (53, 40),
)
USEFUL_GAIN, USEFUL_RMS, AHEAD_H = 0.3, math.radians(6.0), 15.0


class Prime(NamedTuple):
    """A boat without dimensions: r' = a delta - b r - d r^3 - e, time in h."""

    a: float
    b: float
    d: float
    e: float


def course(time: float) -> float:
    """Return the course to steer [rad] at `time` [h]."""
    return math.radians([angle for begin, angle in LEGS if time >= begin][-1])


def sailed(boats: Sequence[Prime], seeds: Sequence[int], seconds_per_h: float) -> list[dict[str, FloatArray]]:
    """Return a record of the harbour's exit of each boat, side by side."""
    a, b, d, e = np.array(boats).T
    random = [np.random.default_rng([seed, 7]) for seed in seeds]
    count, total, dt = len(boats), round(LENGTHS_H[-1] * SAMPLES_PER_H) + 1, 1.0 / (SAMPLES_PER_H * STEPS)
    psi, r, rudder, gust, wave, swing = (np.zeros(count) for _ in range(6))
    rows = np.empty((total, count, 3))
    keep, W, z = math.exp(-dt / GUST_H), 2.0 * math.pi / WAVE_H, 0.1
    kicks = np.stack([each.standard_normal((total * STEPS, 2)) for each in random], axis=1)
    noise = np.stack([each.standard_normal((total, 2)) for each in random], axis=1)
    for sample in range(total):
        shown = psi + COMPASS * noise[sample, :, 0]
        felt = r + GYRO_H * noise[sample, :, 1]
        rows[sample] = np.stack([shown, felt, rudder], axis=1)
        order = np.clip(HAND * (course(sample / SAMPLES_PER_H) - shown) - HAND_RATE_H * felt, -STOP, STOP)
        for step in range(STEPS):
            first, second = kicks[sample * STEPS + step].T
            gust = keep * gust + GUST * math.sqrt(1.0 - keep * keep) * first
            swing = swing + dt * (-2.0 * z * W * swing - W * W * wave) + 2.0 * math.sqrt(z * W**3 * dt) * WAVE * second
            wave = wave + dt * swing
            rudder = rudder + np.clip(order - rudder, -SLEW_H * dt, SLEW_H * dt)
            push = rudder + gust + wave
            middle = r + 0.5 * dt * (a * push - b * r - d * r**3 - e)
            psi = psi + dt * middle
            r = r + dt * (a * push - b * middle - d * middle**3 - e)
    time = np.arange(total) / SAMPLES_PER_H * seconds_per_h
    return [
        {
            "time_s": time,
            "heading_rad": rows[:, i, 0],
            "rudder_rad": rows[:, i, 2],
            "speed_m_s": np.full(total, SPEED_M_S),
        }
        for i in range(count)
    ]


def zigzag(boat: Prime) -> tuple[FloatArray, FloatArray]:
    """Return heading and rudder [rad] of a 20/20 zigzag without a disturbance, in steps of the simulation."""
    dt, angle = 1.0 / (SAMPLES_PER_H * STEPS), math.radians(20.0)
    psi = r = rudder = 0.0
    order, headings, rudders = angle, [], []
    for _ in range(round(AHEAD_H / dt)):
        headings.append(psi)
        rudders.append(rudder)
        order = -order if psi * math.copysign(1.0, order) >= angle else order
        rudder += min(max(order - rudder, -SLEW_H * dt), SLEW_H * dt)
        psi, r = turned(boat, psi, r, rudder, dt)
    return np.array(headings), np.array(rudders)


def turned(boat: Prime, psi: float, r: float, rudder: float, dt: float) -> tuple[float, float]:
    """Return heading and rate a step later."""
    middle = r + 0.5 * dt * (boat.a * rudder - boat.b * r - boat.d * r**3 - boat.e)
    moved = r + dt * (boat.a * rudder - boat.b * middle - boat.d * middle**3 - boat.e)
    return psi + dt * middle, min(max(moved, -20.0), 20.0)


def is_useful(found: Prime | None, truth: Prime) -> bool:
    """Return whether the model is; see above."""
    if found is None or abs(found.a / truth.a - 1.0) > USEFUL_GAIN:
        return False
    headings, rudders = zigzag(truth)
    psi = r = off = 0.0
    for k in range(headings.size):
        off += (psi - headings[k]) ** 2
        if k + 1 < headings.size:
            psi, r = turned(found, psi, r, rudders[k + 1], 1.0 / (SAMPLES_PER_H * STEPS))
    return math.sqrt(off / headings.size) < USEFUL_RMS


class Answer(NamedTuple):
    """model and the errors of its a, b and d, without dimensions; leaning: what of it is other boats'."""

    model: Prime
    errors: tuple[float, float, float]
    leaning: float


def asked(run: Run, h: float, priors: Sequence[BoatPrior | None]) -> list[Answer | None]:
    """Return what `autopilot identify` makes of the run with each prior, None where it refuses or cannot tell."""
    try:
        check_excitation([run], SPEED_M_S)
    except InputError:
        return [None] * len(priors)
    start = starting_point([run], SPEED_M_S)
    linear = start.model if start.model.gain > 0.0 and start.explained > LEAST_EXPLAINED else None
    fit, reasons = likeliest_fit([run], SPEED_M_S, linear, (), Steps(silent, 1))
    return [None if fit is None else _answer(answer_of(fit, [run], SPEED_M_S, prior, reasons), h) for prior in priors]


def _answer(found: Identified | None, h: float) -> Answer | None:
    if found is None or found.ratios is None:
        return None
    units = (h * h, h, 1.0 / h, h * h)
    values = [value * unit for value, unit in zip(found.ratios.values, units, strict=True)]
    errors = [error * unit for error, unit in zip(found.ratios.errors, units, strict=True)]
    return Answer(Prime(*values), (errors[0], errors[1], errors[2]), max(found.leans.values(), default=0.0))


def shortened(table: dict[str, FloatArray], until: float) -> Run:
    """Return the run up to `until` [s]."""
    inside = table["time_s"] <= until
    return run_from_columns("harbour", {name: values[inside] for name, values in table.items()})


class Outcome(NamedTuple):
    """first: the record [h] from which on the model stays useful, inf where none does; holds: in how many of how many
    answers the 95 % intervals hold a, b, d."""

    first: float
    holds: NDArray[np.int_]
    asked: int


def judged(answers: Sequence[Answer | None], truth: Prime) -> Outcome:
    """Return what came of records of growing length."""
    first = math.inf
    for length, answer in reversed(list(zip(LENGTHS_H, answers, strict=True))):
        if not is_useful(None if answer is None else answer.model, truth):
            break
        first = length
    known = [answer for answer in answers if answer is not None]
    inside = [
        [abs(answer.model[i] - truth[j]) <= 1.96 * answer.errors[i] for i, j in ((0, 0), (1, 1), (2, 2))]
        for answer in known
    ]
    return Outcome(first, np.sum(inside, axis=0, dtype=int) if inside else np.zeros(3, int), len(known))


def left_out(seed: int) -> None:
    """Print how soon each published boat is known, with what the others say."""
    known = [boat for boat in published_boats() if math.isfinite(primes(boat)[2])]
    values = [primes(boat) for boat in known]
    truths = [Prime(math.exp(a), b, math.exp(d), 0.0) for a, b, d in values]
    h = LENGTH_M / SPEED_M_S
    priors = []
    for boat in known:
        prior = prior_of([other for other in published_boats() if other is not boat], boat.length)
        priors.append(prior._replace(length=LENGTH_M))  # all are sailed at one size, which their primes do not know
    records = sailed(truths, [seed + i for i in range(len(known))], h)
    table(truths, records, [h] * len(known), priors, [boat.name for boat in known])


def drawn(count: int, seed: int) -> None:
    """Print how soon boats drawn from the published ones' scatter are known."""
    random, h, prior = np.random.default_rng(seed), LENGTH_M / SPEED_M_S, boats_prior(LENGTH_M)
    truths = []
    for _ in range(count):
        y = prior.mean + prior.deviation / WIDENED * random.standard_normal(3)
        a = math.exp(y[0])
        truths.append(Prime(a, y[1], math.exp(y[2]), a * math.radians(1.0) * random.standard_normal()))
    records = sailed(truths, [seed + i for i in range(count)], h)
    table(truths, records, [h] * count, [prior] * count, [f"drawn {i}" for i in range(count)])


def table(
    truths: Sequence[Prime],
    records: Sequence[dict[str, FloatArray]],
    hours: Sequence[float],
    priors: Sequence[BoatPrior],
    names: Sequence[str],
) -> None:
    """Print a line a boat, and all together."""
    print("| boat | a' | b' | d' | useful from, alone [h] | with other boats [h] |\n|---|---|---|---|---|---|")
    both: list[tuple[Outcome, Outcome]] = []
    for truth, record, h, prior, name in zip(truths, records, hours, priors, names, strict=True):
        runs = [shortened(record, length * h) for length in LENGTHS_H]
        pairs = [asked(run, h, (None, prior)) for run in runs]
        alone, helped = (judged([pair[i] for pair in pairs], truth) for i in (0, 1))
        both.append((alone, helped))
        cells = f"{truth.a:.2f} | {truth.b:.2f} | {truth.d:.2f}"
        print(f"| {name} | {cells} | {alone.first:g} | {helped.first:g} |", flush=True)
    for title, outcomes in (("alone", [a for a, _ in both]), ("with other boats", [b for _, b in both])):
        asked_, held = sum(each.asked for each in outcomes), sum(each.holds for each in outcomes)
        firsts = np.array([each.first for each in outcomes])
        percent = 100.0 * held / max(asked_, 1)
        early, middle, late = np.quantile(firsts, (0.25, 0.5, 0.75), method="nearest")
        print(
            f"{title}: useful from {middle:g} h (median; quartiles {early:g} and {late:g}), never "
            f"{int(np.isinf(firsts).sum())} of {firsts.size}; answers {asked_} of {len(LENGTHS_H) * firsts.size}; "
            f"95 % intervals hold a, b, d in {percent[0]:.0f}, {percent[1]:.0f}, {percent[2]:.0f} %"
        )


def boats() -> None:
    """Print each published boat beside what the others let one expect of it."""
    print("| boat | K' | T' | n3' | ln a' off | b' off | ln d' off (deviations) |\n|---|---|---|---|---|---|---|")
    known, held = published_boats(), []
    for boat in known:
        prior = prior_of([other for other in known if other is not boat], boat.length)
        values = np.array(primes(boat))
        off = (values - prior.mean) / prior.deviation
        held += [abs(each) <= 1.96 for each in off if math.isfinite(each)]
        a, b, d = math.exp(values[0]), values[1], math.exp(values[2])
        T = 1.0 / abs(b)
        print(f"| {boat.name} | {a * T:.2f} | {T:.2f} | {d * T:.2f} | {off[0]:+.1f} | {off[1]:+.1f} | {off[2]:+.1f} |")
    print(f"held in 95 % intervals: {sum(held)} of {len(held)}")


ZOO_H, ZOO_AHEAD_H = (15.0, 30.0, 60.0), 10.0


def zoo(seeds: int, first: int) -> None:
    """Print how well what the plants' harbour exits tell predicts a 20/20 zigzag in calm water: the root mean square
    heading error after ZOO_AHEAD_H, beside that of the plant's file, which four zigzags made."""
    print(
        "| plant | seed | record [h] | file [deg] | alone [deg] | with other boats [deg] |\n|---|---|---|---|---|---|"
    )
    for name in KINDS:
        kind = kind_of(name)
        speed, lasts = kind.model.reference_speed, ZOO_H[-1] * kind.h
        shown = [each for each in PUBLISHED if each == name or (name, each) == ("roll_ship", "naval_vessel")]
        prior = boats_prior(speed * kind.h, shown)
        calm = list(plant_sailed(kind, CALM, plant_zigzag(), lasts, speed, np.random.default_rng(first)))
        for seed in range(first, first + seeds):
            random = np.random.default_rng([seed, 31])
            steer, weather = hand(random, kind.h, lasts), weather_of(random, kind.h)
            rows = np.array(list(plant_sailed(kind, weather, steer, lasts, speed, random)))
            names = ("time_s", "rudder_rad", "speed_m_s", "heading_rad", "yaw_rate_rad_s")
            record = dict(zip(names, rows.T[:5] * np.array([1.0, 1.0, speed, 1.0, 1.0])[:, None], strict=True))
            for length in ZOO_H:
                answers = zoo_asked(shortened(record, length * kind.h), speed, (None, prior))
                cells = [_error(kind, model, calm) for model in (kind.model, *answers)]
                print(f"| {name} | {seed} | {length:g} | {' | '.join(cells)} |", flush=True)


def zoo_asked(run: Run, speed: float, priors: Sequence[BoatPrior | None]) -> list[Norrbin | None]:
    """Return the models that `autopilot identify` makes of the run with each prior."""
    found = []
    for prior in priors:
        try:
            found.append(identify([run], Question(reference_speed=speed, prior=prior)).model)
        except InputError:
            found.append(None)
    return found


def _error(kind: Kind, model: Norrbin | None, samples: Sequence[Sample]) -> str:
    if model is None:
        return "refused"
    off = stretch_errors(kind, model, list(samples), ZOO_AHEAD_H * kind.h)
    return f"{math.degrees(math.sqrt(float(np.mean(np.square(off))))):.1f}"


def main() -> None:
    """Print the table asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("boats", "left-out", "drawn", "zoo"))
    parser.add_argument("--boats", type=int, default=24)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--today", action="store_true", help="seeds drawn from today's date")
    given = parser.parse_args()
    seed = datetime.date.today().toordinal() * 1000 + 77 if given.today else 1
    if given.what == "boats":
        boats()
    elif given.what == "left-out":
        left_out(seed)
    elif given.what == "drawn":
        drawn(given.boats, seed)
    else:
        zoo(given.seeds, seed)


if __name__ == "__main__":
    main()
