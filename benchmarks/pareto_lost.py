"""The lost cases of the Pareto study, each tuned by itself and beside what an LQG law would do; printed as a table.

    python benchmarks/pareto_lost.py --out out --candidates 600 --seeds 6 [--alone 300] [--on 5] [--boats lanxin15]

Goes by the points that `pareto.py` left in --out with as many candidates and seeds.
For each case that is lost over all seeds held out together:

- rms over the PID's at equal travel, travel over the PID's at equal rms, and on how many of the seeds it is lost;
- the same with both sides tuned in the case itself, on seeds of their own, and judged on the same held-out seeds: this
  tells a setting that was not found, or not to be had for all cases at once, from one that does not exist;
- at the middle of the travels that both reach: the PID's rms, the pilot's, and that of the LQG law of `lqg_sailed.py`,
  which knows the real boat, mean wind, gusts, noise and the spectrum of the waves, sailed in the very same runs.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from lqg_bound import Linear, Point, covariance_met, oscillators, settled
from lqg_sailed import sailed
from pareto import (
    EVERY_SEA,
    HELD_OUT,
    LOST_DEG,
    SEARCH_SEED,
    WEIGHTS,
    Case,
    Compared,
    compared_by,
    is_lost,
    study,
    together,
)
from pareto_front import LEAST, chosen, explore, front
from pareto_study import (
    BOATS,
    MISMATCHES,
    SEAS,
    Helmsman,
    Ours,
    Run,
    Theirs,
    compasses_in_turn,
    filed,
    job_of,
    runs_of,
)
from study_boats import StudyBoat, StudySea

from autopilot.cli.terminal import ProgressBar
from sitl.boat import Hull
from sitl.campaign.study import cases_of

Floats = npt.NDArray[np.float64]

CASE_TRAINING, CASE_SEEDS = 300, 16
"""First seed, and how many, on which a case is tuned by itself."""


class Beside(NamedTuple):
    """A travel [deg/s] and the rms [deg] there: the PID's, the pilot's, and that of the LQG law, sailed."""

    travel: float
    theirs: float
    ours: float
    lqg: float


def runs_in(case: Case, compass: str, seed: int, seeds: int) -> list[Run]:
    """Return the runs of one case with this compass, on `seeds` seeds from `seed` on."""
    job = job_of(case.boat, seed, seeds)
    cases, wanted = cases_of(job), (case.sea, case.side, case.mismatch, compass)

    def is_wanted(number: int) -> bool:
        one = cases[number // seeds]
        return (one.sea, one.side_deg, one.mismatch, one.instruments) == wanted

    return runs_of(job, is_wanted)


def tuned_in(case: Case, compass: str, seeds: int, count: int) -> Compared:
    """Return the case with both sides tuned in it alone, judged on the seeds held out."""
    training = runs_in(case, compass, CASE_TRAINING, CASE_SEEDS)
    held_out = runs_in(case, compass, HELD_OUT, seeds)

    def costs(points: Floats) -> Floats:
        rms, travel = np.minimum(points[:, 0], LOST_DEG).mean(), points[:, 1].mean()
        return np.asarray(rms + WEIGHTS * travel)

    def sailed(helmsman: Helmsman) -> Floats:
        starts, low, high = helmsman.starts, helmsman.low, helmsman.high
        found = explore(lambda n: helmsman.sailed(n, training), starts, low, high, costs, count, SEARCH_SEED)
        kept = chosen(found, costs, range(len(WEIGHTS)))
        return np.array([helmsman.sailed(numbers, held_out) for numbers in kept])

    return compared_by(case, sailed(Ours(case.boat)), sailed(Theirs(case.boat)))


def linear_in(case: Case, compass: str) -> tuple[Linear, list[Point]]:
    """Return the real boat in the case's sea, linear, for the law that knows everything to sail, and the bound."""
    vessel, off = filed(case.boat), MISMATCHES[case.mismatch]
    noise = float(compass.split()[0])
    real = dataclasses.replace(
        vessel,
        model=dataclasses.replace(vessel.model, K_1_s=vessel.model.K_1_s * off.K),
        sensors=dataclasses.replace(vessel.sensors, heading_noise_deg=noise),
    )
    boat, section = StudyBoat(real, Hull(*dataclasses.astuple(BOATS[case.boat].hull))), SEAS[case.sea]
    ittc = section.waves.ittc
    height, period = (ittc.significant_height_m, ittc.peak_period_s) if ittc is not None else (0.0, 1.0)
    sea = StudySea(height, period, section.wind.speed_m_s, section.wind.gust_m_s)
    waves = oscillators(covariance_met(boat, case.side, sea)) if ittc is not None else []
    return settled(boat, case.side, sea, waves, has_gyro=False)


def lqg_front(case: Case, compass: str, seeds: int, is_plain: bool = False) -> Floats:
    """Return what the LQG law, sailed in the runs held out, comes to."""
    runs = [(run.setting, run.workspace) for run in runs_in(case, compass, HELD_OUT, seeds)]
    return np.array(sailed(linear_in(case, compass)[0], runs, is_plain))


def beside_lqg(one: Compared, lqg: Floats) -> Beside:
    """Return what everybody comes to at the middle of the travels that pilot and PID both reach."""
    ours, theirs = (front(np.maximum(together(points), LEAST)) for points in (one.ours, one.theirs))
    low = max(ours[0, 1], theirs[0, 1])
    high = max(low, min(ours[-1, 1], theirs[-1, 1]))
    travel = math.sqrt(low * high)
    knowing = front(np.maximum(lqg, LEAST))
    return Beside(travel, *(_rms_at(points, travel) for points in (theirs, ours, knowing)))


def _rms_at(points: Floats, travel: float) -> float:
    return math.exp(float(np.interp(math.log(travel), np.log(points[:, 1]), np.log(points[:, 0]))))


def main() -> None:
    """Tune the lost cases by themselves and print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help="folder with every boat's points, as pareto.py left it")
    parser.add_argument("--candidates", type=int, default=150, help="settings that were tried for each boat")
    parser.add_argument("--alone", type=int, default=300, help="settings tried for each helmsman and case by itself")
    parser.add_argument("--seeds", type=int, default=6, help="seeds held out")
    parser.add_argument("--boats", default=",".join(BOATS))
    parser.add_argument("--on", type=int, default=1, help="only cases lost on at least so many of the seeds alone")
    asked = parser.parse_args()
    count, seeds = asked.candidates, asked.seeds
    found = [one for boat in asked.boats.split(",") for one in study(boat, count, seeds, _not_shown, out=asked.out)]
    lost = [one for one in found if one.is_held and is_lost(one.beside) and lost_on(one) >= asked.on]
    places = dict.fromkeys(one.case._replace(tuned="") for one in lost)
    alone: dict[Case, Compared] = {}
    with ProgressBar("cases") as bar:
        for case in places:
            alone[case] = tuned_in(case, compass_of(case), seeds, asked.alone)
            bar.update(len(alone), len(places))
    print(table(lost, alone, {case: lqg_front(case, compass_of(case), seeds) for case in places}))


def _not_shown() -> None:
    pass


def lost_on(one: Compared) -> int:
    """Return on how many of the seeds the case is lost."""
    return sum(is_lost(found) for found in one.by_seed)


def compass_of(case: Case) -> str:
    """Return the compass of the case's held-out runs."""
    return compasses_in_turn()[case.sea, case.side, case.mismatch]


def table(lost: Sequence[Compared], alone: dict[Case, Compared], lqg: dict[Case, Floats]) -> str:
    """Return a row for each lost case."""
    lines = [
        "                                           lost on       ratios   tuned in it        at       rms [deg] there",
        "tuned in  boat      sea      side  K         seeds   rms/travel    rms/travel     travel      PID"
        "    pilot      LQG",
    ]
    for one in lost:
        boat, sea, side, mismatch, tuned = one.case
        key = one.case._replace(tuned="")
        on = f"{lost_on(one):3d} of {len(one.by_seed)}"
        tuned = tuned if tuned == EVERY_SEA else "each sea"
        ratios = "".join(f"{found.rms:7.2f}/{found.travel:5.2f} " for found in (one.beside, alone[key].beside))
        at = beside_lqg(one, lqg[key])
        numbers = "".join(f"{value:9.2f}" for value in at[1:])
        text = f"{tuned:10s}{boat:10s}{sea:8s}{side:5.0f}  {mismatch:7s}"
        lines.append(f"{text}{on:>8s}{ratios}{at.travel:10.3f}{numbers}")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
