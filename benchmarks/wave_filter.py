"""Heading error and rudder travel with and without the wave filter, printed as a table.

    python benchmarks/wave_filter.py [--seeds 3] [--seconds 360] [--json | --push]

Four boats on a straight course in calm water and in sea states 3 and 5 from four sides; the law, its gains, the
sensors' noise and the random sea are the same in both columns, only `estimator.wave_filter` differs. `--push` prints
what a push worth 31 deg of rudder leaves behind in calm water instead, one that lasts a minute and goes.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import os
import statistics
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from steady_wind import sailed, swings
from study_boats import CONTROL_HZ, SEAS, Figures, StudyBoat, boats, figures, lanxin_as_filed, sail

from autopilot.runtime.tuning import GainRequest, designed
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Estimator

SIDES_DEG = (45.0, 135.0)
"""Where the waves come from, off the bow; exactly ahead, abeam or astern a long-crested sea does not yaw a boat."""
SETTLED_S = 120.0
FIRST_SEED = 9000


def boat_of(name: str) -> StudyBoat:
    """Return one boat of the study; Lanxin with the gains of its file."""
    boat = boats()[name]
    return (
        lanxin_as_filed(boat, load_vessel(str(Path("firmware_params/vessels/lanxin.yaml"))))
        if name == "lanxin"
        else boat
    )


def that_spares(boat: StudyBoat, level: int) -> StudyBoat:
    """Return the boat with the gains of `autopilot gains --level`."""
    return boat._replace(vessel=designed(boat.vessel, GainRequest(level)))


def one(case: tuple[str, str, float, str, int, float]) -> Figures:
    """Return the figures of one run: boat, sea, side [deg], wave_filter, seed, seconds."""
    name, sea, side, wave_filter, seed, seconds = case
    boat = boat_of(name)
    estimator = Estimator(wave_filter="auto" if wave_filter == "auto" else "off")
    vessel = dataclasses.replace(boat.vessel, estimator=estimator)
    return figures(sail(boat._replace(vessel=vessel), SEAS[sea], side, seconds, seed), SETTLED_S)


PUSH, PUSHED_S = math.radians(31.0), (30.0, 90.0)


def after_push(name: str, wave_filter: str, seed: int) -> tuple[float, float]:
    """Return how far [deg] the boat leads past its course after the push, and when [s] it is within 1 deg for good."""
    estimator = Estimator(wave_filter="auto" if wave_filter == "auto" else "off")
    vessel = dataclasses.replace(boat_of(name).vessel, estimator=estimator)
    seconds = PUSHED_S[1] + 60.0 + 15.0 * vessel.model.T_s

    def push(now: float) -> float:
        return PUSH if PUSHED_S[0] < now < PUSHED_S[1] else 0.0

    errors = np.degrees(sailed(vessel, 1.0, push, seconds, np.random.default_rng(seed), True))
    after = errors[round(PUSHED_S[1] * CONTROL_HZ) :]
    late = np.flatnonzero(np.abs(after) > 1.0)
    return swings(after.tolist())[0], float(late[-1] + 1) / CONTROL_HZ if len(late) else 0.0


def print_pushes(seeds: range) -> None:
    """Print the medians over the seeds."""
    print("boat     past the course [deg]  back within 1 deg after [s]")
    print("            off     auto            off     auto")
    for name in ("lanxin", "coaster", "tanker"):
        found = {mode: np.median([after_push(name, mode, seed) for seed in seeds], axis=0) for mode in ("off", "auto")}
        (past, back), (past_auto, back_auto) = found["off"], found["auto"]
        print(f"{name:8s}{past:7.1f}{past_auto:9.1f}{back:15.0f}{back_auto:9.0f}", flush=True)


def median(parts: list[Figures]) -> Figures:
    """Return the median of each figure."""
    return Figures(*(statistics.median(column) for column in zip(*parts, strict=True)))


def main() -> None:
    """Run all cases on all cores and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=360.0)
    parser.add_argument("--boats", default=",".join(boats()))
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--push", action="store_true")
    asked = parser.parse_args()
    if asked.push:
        print_pushes(range(FIRST_SEED, FIRST_SEED + asked.seeds))
        return
    rows = [
        (name, sea, side)
        for name in asked.boats.split(",")
        for sea in SEAS
        for side in (SIDES_DEG if sea != "calm" else (0.0,))
    ]
    seeds = range(FIRST_SEED, FIRST_SEED + asked.seeds)
    cases = [(*row, mode, seed, asked.seconds) for row in rows for mode in ("off", "auto") for seed in seeds]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        found = dict(zip(cases, pool.map(one, cases, chunksize=1), strict=True))
    table = {
        row: tuple(median([found[(*row, mode, seed, asked.seconds)] for seed in seeds]) for mode in ("off", "auto"))
        for row in rows
    }
    if asked.json:
        print(json.dumps([[*row, *off, *auto] for row, (off, auto) in table.items()]))
        return
    print("boat     sea      from   heading rms [deg]  its slow part [deg]  rudder travel [deg/s]     ratios")
    print("                 [deg]     off     auto       off     auto         off     auto     rms   travel")
    for (name, sea, side), (off, auto) in table.items():
        from_deg = f"{side:5.0f}" if sea != "calm" else "    -"
        print(
            f"{name:8s} {sea:8s}{from_deg}  {off.heading_deg:7.2f}  {auto.heading_deg:7.2f}   {off.slow_deg:7.2f}  "
            f"{auto.slow_deg:7.2f}     {off.travel_deg_s:7.2f}  {auto.travel_deg_s:7.2f} "
            f"{auto.heading_deg / off.heading_deg:7.2f}  {auto.travel_deg_s / off.travel_deg_s:7.2f}"
        )
    held = [pair for pair in table.values() if pair[0].heading_deg < 10.0 or pair[1].heading_deg < 10.0]
    rms = statistics.median(auto.heading_deg / off.heading_deg for off, auto in held)
    travel = statistics.median(auto.travel_deg_s / off.travel_deg_s for off, auto in held)
    assert math.isfinite(rms)
    print(
        f"median ratio over {len(held)} cases that either holds within 10 deg rms: rms {rms:.2f}, travel {travel:.2f}"
    )


if __name__ == "__main__":
    main()
