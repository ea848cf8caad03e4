"""From a study to its cases and runs: what is steered, how, in which sea, and the seed of each run."""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from autopilot.errors import InputError
from autopilot.params.vessel import Vessel
from autopilot.params.vessel_file import load_vessel, shipped_vessels
from sitl.campaign.study import MOST_RUNS, SeaSection, Study
from sitl.scenario import Scenario, Start


class Case(NamedTuple):
    """One combination of a study's lists, by their names and numbers."""

    boat: str
    law: str
    gain_factor: float
    speed_share: float
    sea: str
    side_deg: float
    mismatch: str
    instruments: str
    faults: str


class Job(NamedTuple):
    """A study with the folder that its paths start at: all that a worker needs to do any of its runs.

    vessel: what the pilot of every boat believes, in place of the boat's own file.
    """

    study: Study
    folder: str
    vessel: Vessel | None = None

    def __hash__(self) -> int:
        # a study holds dictionaries; its name and folder tell jobs apart well enough, equality does the rest
        gains = None if self.vessel is None else self.vessel.control
        return hash((self.study.name, self.study.seed, self.folder, gains))


@functools.lru_cache(maxsize=8)
def cases_of(study: Job) -> tuple[Case, ...]:
    """Return all cases, in the order of the file; a sea without waves and wind has one side only."""
    asked = study.study
    found = []
    for boat, law, factor, share, sea in itertools.product(
        asked.boats, asked.laws, asked.gain_factors, asked.speed_shares, asked.seas
    ):
        sides = (0.0,) if _is_calm(asked.seas[sea]) else asked.sides_deg
        rests = itertools.product(sides, asked.mismatches, asked.instruments, asked.faults)
        found += [Case(boat, law, factor, share, sea, *rest) for rest in rests]
    if len(found) * asked.runs > MOST_RUNS:
        raise InputError(
            f"study {asked.name!r}: {len(found)} cases of {asked.runs} runs are {len(found) * asked.runs} runs, "
            f"allowed are {MOST_RUNS}; split the study or lower runs"
        )
    return tuple(found)


def _is_calm(sea: SeaSection) -> bool:
    waves, wind = sea.waves, sea.wind
    return waves.ittc is None and waves.second_order is None and wind.speed_m_s == 0.0 and wind.gust_m_s == 0.0


def number_of_runs(job: Job) -> int:
    """Return how many runs the study has; they are numbered from 0."""
    return len(cases_of(job)) * job.study.runs


def case_and_seed(job: Job, run: int) -> tuple[Case, int]:
    """Return the case and the seed of a run. Cases share their seeds, so that they are compared in the same sea."""
    return cases_of(job)[run // job.study.runs], job.study.seed + run % job.study.runs


@functools.lru_cache(maxsize=64)
def filed_vessel(name: str, folder: str) -> Vessel:
    """Return the vessel of a shipped name, or of a path that starts at `folder`. Raises InputError."""
    return load_vessel(name if name in shipped_vessels() else Path(folder) / name)


def vessel_of(job: Job, case: Case) -> Vessel:
    """Return the vessel as the pilot knows it, its loop quicker by the case's factor. Raises InputError."""
    vessel = job.vessel or filed_vessel(job.study.boats[case.boat].vessel, job.folder)
    return vessel if case.gain_factor == 1.0 else quickened(vessel, case.gain_factor)


def quickened(vessel: Vessel, factor: float) -> Vessel:
    """Return the vessel with the bandwidth of every law's loop times `factor`, the boat's own damping left aside."""
    control, square = vessel.control, factor * factor
    back, pid, sliding = control.backstepping, control.pid, control.sliding
    return replace(
        vessel,
        control=replace(
            control,
            backstepping=back
            and replace(
                back,
                k1_1_s=back.k1_1_s * factor,
                k2_1_s=back.k2_1_s * factor,
                gamma_1_s2=back.gamma_1_s2 * square,
                smoothing_s=back.smoothing_s / factor,
            ),
            pid=pid and replace(pid, kp=pid.kp * square, ki_1_s=pid.ki_1_s * square * factor, kd_s=pid.kd_s * factor),
            sliding=sliding
            and replace(
                sliding,
                slope_1_s=sliding.slope_1_s * factor,
                reach_deg_s2=sliding.reach_deg_s2 * square,
                boundary_deg_s=sliding.boundary_deg_s * factor,
            ),
        ),
    )


def real_boat(job: Job, case: Case) -> Vessel:
    """Return the vessel as it really is: its model with the case's mistakes made good."""
    vessel = filed_vessel(job.study.boats[case.boat].vessel, job.folder)
    off = job.study.mismatches[case.mismatch]
    model = vessel.model
    return replace(
        vessel,
        model=replace(model, K_1_s=model.K_1_s * off.K, T_s=model.T_s * off.T, n0_rad_s=model.n0_rad_s + off.n0_rad_s),
    )


def scenario_of(job: Job, case: Case) -> Scenario:
    """Return the scenario of a case; the boat starts towards north."""
    study, sea = job.study, job.study.seas[case.sea]
    boat = study.boats[case.boat]
    speed = filed_vessel(boat.vessel, job.folder).model.reference_speed_m_s * case.speed_share
    waves = sea.waves
    if waves.ittc is not None:
        waves = replace(waves, ittc=replace(waves.ittc, from_deg=case.side_deg))
    return Scenario(
        schema_version=1,
        name=study.name,
        start=Start(speed_m_s=speed),
        hull=boat.hull,
        waves=waves,
        wind=replace(sea.wind, from_deg=case.side_deg),
        sensors=study.instruments[case.instruments],
        faults=study.faults[case.faults],
    )


def steps_of(study: Study, step: float) -> int:
    """Return the number of steps of `step` [s] in a run."""
    return math.floor(study.seconds / step + 1.0e-6)
