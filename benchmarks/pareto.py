"""Heading error against rudder travel: the pilot with its wave filter beside a PID tuned for the same cost.

    python benchmarks/pareto.py [--candidates 60] [--seeds 2] [--json]

The peer is `autopilot.control.pid` on compass and gyro with filters of its own, one on the heading and one on the rate,
and an integrator with anti-windup. For every boat, sea and side its five numbers are drawn at random about a design by
the model (log-uniform) and judged on training seeds; those that no other one beats in both rms and travel form its
front, which is then sailed again on seeds that it has not seen. So is the pilot, at five response levels: all gains of
the law times a factor, nothing else touched. From both fronts follow travel at equal rms, rms at equal travel.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import statistics
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import NamedTuple

import numpy as np
from study_boats import CONTROL_HZ, SEAS, Figures, Helmsman, StudyBoat, StudySea, boats, figures, sail

from autopilot.angles import wrap
from autopilot.build import limits_of, model_of
from autopilot.control.pid import PidGains, PidMemory, pid_step
from autopilot.limits import limit
from autopilot.params.vessel import Backstepping
from autopilot.signals import HeadingSample, Reference, Sample

LEVELS = (0.35, 0.5, 0.7, 1.0, 1.4)
SIDES_DEG = (45.0, 135.0)
WEATHERS = {"breeze": StudySea(0.0, 1.0, 5.0, 0.7), "state 3": SEAS["state 3"], "state 5": SEAS["state 5"]}
"""In dead calm the best helmsman sleeps; so no weather is without wind."""
TRAINING, HELD_OUT = 100, 7000
SECONDS, SETTLED_S = 240.0, 90.0
LOST_DEG = 10.0
"""A boat that strays further than this, rms, is not held by the sea's measure; the case is shown and not counted."""


class Peer(NamedTuple):
    """The PID's numbers: gains, and the time constants [s] of its filters on heading and rate."""

    gains: PidGains
    heading_time: float
    rate_time: float


class Case(NamedTuple):
    """Boat, sea, and where it comes from [deg off the bow]."""

    boat: str
    sea: str
    side: float


Point = tuple[float, float]
"""Heading rms [deg], rudder travel [deg/s]."""


def peer_helmsman(boat: StudyBoat, peer: Peer) -> Helmsman:
    """Return the PID with its filters and memory."""
    dt, limits = 1.0 / CONTROL_HZ, limits_of(boat.vessel)
    memory, told = PidMemory(), 0.0
    heading = rate = last = 0.0

    def steer(now: float, samples: tuple[Sample, ...]) -> float:
        nonlocal memory, told, heading, rate, last
        for sample in samples:
            if isinstance(sample, HeadingSample):
                since, last = now - last, now
                heading += wrap(sample.heading - heading) * _share(since, peer.heading_time)
                rate += ((sample.rate or 0.0) - rate) * _share(since, peer.rate_time)
        demand, memory = pid_step(peer.gains, memory, Reference(0.0), heading, rate, told, dt)
        told = limit(limits, told, demand, dt)
        return told

    return steer


def _share(dt: float, time: float) -> float:
    return -math.expm1(-dt / time) if time > 0.0 else 1.0


def candidates(boat: StudyBoat, count: int) -> list[Peer]:
    """Return PIDs drawn about natural frequencies and dampings that suit the boat's model."""
    model, random = model_of(boat.vessel), np.random.default_rng(42)
    assert boat.vessel.control.pid is not None
    ratio, base = model.time_constant / model.gain, boat.vessel.control.pid
    quick = math.sqrt(base.kp / ratio)
    found = []
    for _ in range(count):
        natural, damping = quick * 10.0 ** random.uniform(-1.2, 0.1), random.uniform(0.5, 1.6)
        kd = max(ratio * (2.0 * damping * natural - model.n1 / model.time_constant), 0.0)
        kp = ratio * natural * natural
        ki = kp * natural * 10.0 ** random.uniform(-2.0, -0.7)
        times = (random.uniform(0.0, 0.5), 10.0 ** random.uniform(-1.5, 0.3)) / np.array(natural)
        found.append(Peer(PidGains(kp, ki, kd), float(times[0]), float(times[1])))
    return found


def at_level(boat: StudyBoat, level: float) -> StudyBoat:
    """Return the boat with all gains of its law times `level`."""
    gains = boat.vessel.control.backstepping
    assert gains is not None
    scaled = Backstepping(gains.k1_1_s * level, gains.k2_1_s * level, gains.gamma_1_s2 * level * level)
    control = dataclasses.replace(boat.vessel.control, backstepping=scaled)
    return boat._replace(vessel=dataclasses.replace(boat.vessel, control=control))


def sailed(case: Case, who: Peer | float, seeds: Sequence[int]) -> Point:
    """Return rms and travel, the means over the seeds, of a PID or of the pilot at a response level."""
    boat, sea = boats()[case.boat], WEATHERS[case.sea]
    found: list[Figures] = []
    for seed in seeds:
        if isinstance(who, Peer):
            record = sail(boat, sea, case.side, SECONDS, seed, helmsman=peer_helmsman(boat, who))
        else:
            record = sail(at_level(boat, who), sea, case.side, SECONDS, seed)
        found.append(figures(record, SETTLED_S))
    rms = math.sqrt(statistics.fmean(one.heading_deg**2 for one in found))
    return rms, statistics.fmean(one.travel_deg_s for one in found)


def front(points: Sequence[Point]) -> list[int]:
    """Return the places of the points that none beats in both, by rising travel."""
    order = sorted(range(len(points)), key=lambda place: (points[place][1], points[place][0]))
    kept: list[int] = []
    for place in order:
        if not kept or points[place][0] < points[kept[-1]][0]:
            kept.append(place)
    return kept


def at_travel(points: Sequence[Point], travel: float) -> float:
    """Return the rms of a front at `travel`, log-log between its points; nan left of it, its best right of it."""
    ordered = [points[place] for place in front(points)]
    if travel < ordered[0][1]:
        return math.nan
    values = np.log([[travel_, rms] for rms, travel_ in ordered])
    return float(np.exp(np.interp(math.log(travel), values[:, 0], values[:, 1])))


def at_rms(points: Sequence[Point], rms: float) -> float:
    """Return the travel a front needs for `rms`; nan where it cannot reach it."""
    ordered = [points[place] for place in reversed(front(points))]
    if rms < ordered[0][0]:
        return math.nan
    values = np.log([[rms_, travel] for rms_, travel in ordered])
    return float(np.exp(np.interp(math.log(rms), values[:, 0], values[:, 1])))


def study(job: tuple[Case, int, int]) -> tuple[list[Point], list[Point]]:
    """Return the held-out fronts of PID and pilot for one case."""
    case, count, seeds = job
    peers = candidates(boats()[case.boat], count)
    trained = [sailed(case, peer, [TRAINING]) for peer in peers]
    held_out = range(HELD_OUT, HELD_OUT + seeds)
    theirs = [sailed(case, peers[place], held_out) for place in front(trained)]
    ours = [sailed(case, level, held_out) for level in LEVELS]
    return theirs, ours


def row(theirs: list[Point], ours: list[Point]) -> tuple[float, float, float, float]:
    """Return the pilot's rms and travel as designed, and the medians over its front of rms ratio and travel ratio."""
    rms, travel = ours[LEVELS.index(1.0)]
    best = [ours[place] for place in front(ours)]
    rms_ratios = [one[0] / at_travel(theirs, one[1]) for one in best]
    travel_ratios = [one[1] / at_rms(theirs, one[0]) for one in best]
    middle = [
        statistics.median(kept) if (kept := [value for value in ratios if math.isfinite(value)]) else math.nan
        for ratios in (rms_ratios, travel_ratios)
    ]
    return rms, travel, middle[0], middle[1]


def main() -> None:
    """Study all cases on all cores and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--candidates", type=int, default=60)
    parser.add_argument("--seeds", type=int, default=2, help="seeds held out")
    parser.add_argument("--boats", default=",".join(boats()))
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    cases = [
        Case(name, sea, side)
        for name in asked.boats.split(",")
        for sea in WEATHERS
        for side in (SIDES_DEG if sea != "breeze" else SIDES_DEG[:1])
    ]
    jobs = [(case, asked.candidates, asked.seeds) for case in cases]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        results = []
        if not asked.json:
            print("boat     sea      from    pilot as designed          at equal travel  at equal rms")
            print("                 [deg]  rms [deg]  travel [deg/s]   rms, of PID's    travel, of PID's")
        for case, (theirs, ours) in zip(cases, pool.map(study, jobs), strict=True):
            rms, travel, rms_ratio, travel_ratio = row(theirs, ours)
            results.append((case, theirs, ours))
            if not asked.json:
                lost = "" if rms < LOST_DEG else "   not held"
                print(
                    f"{case.boat:8s} {case.sea:8s}{case.side:5.0f}  {rms:8.2f}  {travel:12.2f}  {rms_ratio:14.2f}"
                    f"  {travel_ratio:14.2f}{lost}",
                    flush=True,
                )
    if asked.json:
        print(json.dumps(results))
        return
    counted = [found for _, theirs, ours in results if (found := row(theirs, ours))[0] < LOST_DEG]
    for title, place in (("rms at equal travel", 2), ("travel at equal rms", 3)):
        ratios = [found[place] for found in counted if math.isfinite(found[place])]
        print(f"median {title} over {len(ratios)} cases held: {statistics.median(ratios):.2f} of the PID's")


if __name__ == "__main__":
    main()
