"""How quickly and how well the integral method and the live filter learn while a boat sails; prints one table.

    python benchmarks/integral_live.py [--seeds 20] [--headings | --live]

Each boat sails a 15/15 zigzag with its rudder moving at 20 deg/s and then five minutes straight on, steered by what it
measures: heading and yaw rate ten times a second with 0.2 deg and 0.1 deg/s of white noise. Every variant begins with
K, T and n3 all twice or all half the true ones. The boat is integrated here on its own (Heun, 10 ms). The bound is the
least error that anything can have that knows neither K, T, n3 nor n0 before (Cramer and Rao).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np
from integral_recursion import Recursion, RecursionSettings, WindowRls, recursion_step

from autopilot.identification.identified import Question
from autopilot.identification.integral_fit import FitSettings, IntegralFit, window_length
from autopilot.identification.integral_window import IntegralWindow
from autopilot.identification.learning import learnt_model
from autopilot.identification.live_filter import LiveFilter
from autopilot.identification.registry import method_named
from autopilot.identification.runs import run_from_columns
from autopilot.identification.trial_design import InstrumentNoise, cramer_rao
from autopilot.models.norrbin import Norrbin

DEG = math.pi / 180.0
STEP_S, SAMPLE_S, STRAIGHT_S = 0.01, 0.1, 300.0
ANGLE, SLEWING = 15.0 * DEG, 20.0 * DEG
HEADING_NOISE, RATE_NOISE = 0.2 * DEG, 0.1 * DEG

BOATS = {
    "Lanxin (K 0.701, T 0.332, n3 3.28)": (Norrbin(0.701, 0.332, 3.2828), 20.0),
    "K 0.2, T 5, n3 20": (Norrbin(0.2, 5.0, 20.0), 80.0),
    "K 0.1, T 20, n3 100": (Norrbin(0.1, 20.0, 100.0), 300.0),
    "K 0.2, T 5, n3 200, n1 -1": (Norrbin(0.2, 5.0, 200.0, n1=-1.0), 100.0),
}
"""The boat, and how long it zigzags [s]."""

Sample = tuple[float, float, float, float]
Learner = Callable[[list[Sample]], list[tuple[float, Norrbin]]]


class Outcome(NamedTuple):
    """Relative errors of K and T at the end of the zigzag, and the largest ones while sailing straight."""

    zigzag: tuple[float, float]
    straight: tuple[float, float]


def sail(boat: Norrbin, zigzag: float, seed: int) -> list[Sample]:
    """Return time [s], rudder [rad], measured heading [rad] and rate [rad/s] at every sample."""
    random = np.random.default_rng(seed)
    rate = heading = rudder = 0.0
    order = ANGLE
    samples: list[Sample] = []

    def slope(r: float, d: float) -> float:
        return (boat.gain * d - boat.n1 * r - boat.n3 * r**3) / boat.time_constant

    for i in range(round((zigzag + STRAIGHT_S) / STEP_S)):
        time = i * STEP_S
        if i % round(SAMPLE_S / STEP_S) == 0:
            seen = heading + HEADING_NOISE * random.standard_normal(), rate + RATE_NOISE * random.standard_normal()
            samples.append((time, rudder, *seen))
        if time < zigzag:
            order = -order if heading * math.copysign(1.0, order) >= ANGLE else order
        else:
            order = min(max(-0.5 * seen[0] - 2.0 * boat.time_constant * seen[1], -ANGLE), ANGLE)
        moved = rudder + min(max(order - rudder, -SLEWING * STEP_S), SLEWING * STEP_S)
        first = slope(rate, rudder)
        second = slope(rate + STEP_S * first, moved)
        heading += STEP_S * (rate + 0.25 * STEP_S * (first + second))
        rate += 0.5 * STEP_S * (first + second)
        rudder = moved
    return samples


def recursion(first: Norrbin, *, nonlinear: bool) -> Learner:
    """The published recursion on windows fitted to the true T; the linear form knows no n3."""
    start = first if nonlinear else first._replace(n3=0.0)

    def learn(samples: list[Sample]) -> list[tuple[float, Norrbin]]:
        window, state, path = IntegralWindow(window_length(first.time_constant / 1.5)), Recursion(start), []
        for time, rudder, heading, rate in samples:
            found = window.update(time, rudder, 1.0, heading, rate)
            if found is not None and found.rudder_range > FitSettings().rudder_range:
                state = recursion_step(RecursionSettings(nonlinear=nonlinear), start, state, found)
            path.append((time, state.model))
        return path

    return learn


def least_squares(first: Norrbin) -> Learner:
    """Recursive least squares over the same windows."""

    def learn(samples: list[Sample]) -> list[tuple[float, Norrbin]]:
        window, rls, path = (
            IntegralWindow(window_length(first.time_constant / 1.5), from_mean=True),
            WindowRls(first),
            [],
        )
        for time, rudder, heading, rate in samples:
            found = window.update(time, rudder, 1.0, heading, rate)
            if found is not None and found.rudder_range > FitSettings().rudder_range:
                rls.update(found)
            path.append((time, rls.model))
        return path

    return learn


def fit(first: Norrbin, *, rates: bool = True) -> Learner:
    """All windows together, with instruments."""

    def learn(samples: list[Sample]) -> list[tuple[float, Norrbin]]:
        live, path = IntegralFit(first), []
        for time, rudder, heading, rate in samples:
            live.update(time, rudder, 1.0, heading, rate if rates else None)
            path.append((time, live.model))
        return path

    return learn


def filtered(first: Norrbin, *, rates: bool = True) -> Learner:
    """What learns while sailing."""

    def learn(samples: list[Sample]) -> list[tuple[float, Norrbin]]:
        live, path = LiveFilter(first), []
        for number, (time, rudder, heading, rate) in enumerate(samples):
            live.update(time, rudder, 1.0, heading, rate if rates else None)
            if number % LOOKS == 0:
                path.append((time, learnt_model(live, first)[0]))
        return path

    return learn


LOOKS = 5
"""Samples from one look at the filter to the next."""
HEADINGS = "the same from headings alone"
LIVE = "filter (what runs live)"
LIVE_HEADINGS = "filter, from headings alone"

VARIANTS: dict[str, Callable[[Norrbin], Learner]] = {
    "recursion as published, linear": lambda first: recursion(first, nonlinear=False),
    "recursion as published, with n3": lambda first: recursion(first, nonlinear=True),
    "least squares over the windows": least_squares,
    "with instruments": fit,
    HEADINGS: lambda first: fit(first, rates=False),
    LIVE: filtered,
    LIVE_HEADINGS: lambda first: filtered(first, rates=False),
}


def outcome(learn: Learner, boat: Norrbin, zigzag: float, samples: list[Sample]) -> Outcome:
    """Return how far K and T are off."""
    path = learn(samples)
    errors = [(t, m.gain / boat.gain - 1.0, m.time_constant / boat.time_constant - 1.0) for t, m in path]
    before = [e for e in errors if e[0] < zigzag][-1]
    # the last window of the zigzag may end a little after it
    after = [e for e in errors if e[0] >= zigzag]
    return Outcome((before[1], before[2]), (max(abs(e[1]) for e in after), max(abs(e[2]) for e in after)))


def over_all(boat: Norrbin, zigzag: float, seeds: Iterable[int]) -> str:
    """Return the line's cells for the extended Kalman filter over the whole zigzag at once, from headings alone."""
    errors = []
    for seed in seeds:
        table = np.array([sample[:3] for sample in sail(boat, zigzag, seed) if sample[0] <= zigzag]).T
        columns = dict(zip(("time_s", "rudder_rad", "heading_rad"), table, strict=True))
        run = run_from_columns("zigzag", {**columns, "speed_m_s": np.ones(table.shape[1])})
        found = method_named("ekf").identify([run], Question(reference_speed=1.0, course_unstable=boat.n1 < 0.0)).model
        errors.append((found.gain / boat.gain - 1.0, found.time_constant / boat.time_constant - 1.0))
    cells = [*np.sqrt(np.mean(np.square(errors), axis=0)), *np.max(np.abs(errors), axis=0)]
    return " | ".join(f"{100 * c:.1f} %" for c in cells)


def bound(boat: Norrbin, zigzag: float, *, rates: bool) -> str:
    """Return the line's cells for the least error of K and T [%] from the zigzag of one seed."""
    known = boat._replace(reference_speed=1.0)
    table = np.array([sample for sample in sail(boat, zigzag, 0) if sample[0] <= zigzag]).T
    columns = dict(zip(("time_s", "rudder_rad", "heading_rad", "yaw_rate_rad_s"), table, strict=True))
    run = run_from_columns("zigzag", {**columns, "speed_m_s": np.ones(table.shape[1])})
    noise = InstrumentNoise(RATE_NOISE if rates else math.inf, HEADING_NOISE)
    least = cramer_rao([run], known, ("gain", "time_constant", "n3", "n0"), noise)
    return f"{100 * least['gain'] / boat.gain:.1f} % | {100 * least['time_constant'] / boat.time_constant:.1f} %"


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--headings", action="store_true", help="the lines from headings alone")
    parser.add_argument("--live", action="store_true", help="the lines of what runs live")
    options = parser.parse_args()
    seeds = range(options.seeds)
    wanted = [HEADINGS] if options.headings else [LIVE, LIVE_HEADINGS] if options.live else list(VARIANTS)
    variants = {label: each for label, each in VARIANTS.items() if label in wanted}
    print("| boat | zigzag | variant | rms K | rms T | worst K | worst T | worst K, 5 min straight | worst T |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name, (boat, zigzag) in BOATS.items():
        records = [sail(boat, zigzag, seed) for seed in seeds]
        for label, variant in variants.items():
            found = []
            for factor in (2.0, 0.5):
                first = boat._replace(
                    gain=factor * boat.gain, time_constant=factor * boat.time_constant, n3=factor * boat.n3
                )
                found += [outcome(variant(first), boat, zigzag, record) for record in records]
            ends = np.array([each.zigzag for each in found])
            straight = np.max([each.straight for each in found], axis=0)
            cells = [*np.sqrt(np.mean(ends**2, axis=0)), *np.max(np.abs(ends), axis=0), *straight]
            print(f"| {name} | {zigzag:.0f} s | {label} | " + " | ".join(f"{100 * c:.1f} %" for c in cells) + " |")
        if options.live:
            continue
        print(f"| {name} | {zigzag:.0f} s | ekf over all of it, headings alone | {over_all(boat, zigzag, seeds)} | | |")
        for label, rates in (("bound", True), ("bound from headings alone", False)):
            print(f"| {name} | {zigzag:.0f} s | {label} | {bound(boat, zigzag, rates=rates)} | | | | |")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
