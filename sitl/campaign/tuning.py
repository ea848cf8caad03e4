"""Gains tuned over a campaign, for a weight between heading error and rudder travel.

    cost = heading rms [deg] + weight x rudder travel [deg/s]

as the mean over the runs of a study. Differential evolution (Storn and Price 1997, by scipy) searches the logarithms of
the law's gains within a factor of SPAN of those it begins with; gains without margins are never sailed. What is found
is then sailed, beside the gains of the beginning, on seeds that the search has not seen.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import astuple, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import Bounds, differential_evolution

from autopilot.control.registry import LAWS
from autopilot.errors import InputError, RefusedError
from autopilot.runtime.build import law_of, verdict_of
from autopilot.vessel.schema import Vessel
from sitl.campaign.study import Job, number_of_runs
from sitl.campaign.work import REFUSED, announce, compiled_loop, do_runs, pool_of

SPAN = 6.0
REFUSED_COST = 1.0e6
HELD_OUT = 900_000
"""Added to the study's seed for the runs that judge."""
CANDIDATES = 18
"""In a generation."""


class Judged(NamedTuple):
    """Means over the runs of a study: cost, heading rms [deg], rudder travel [deg/s]."""

    cost: float
    heading_rms_deg: float
    travel_deg_s: float


class Tuned(NamedTuple):
    """The vessel with tuned gains, and what the seeds held out say of it and of the gains it came with."""

    vessel: Vessel
    candidates: int
    training: Judged
    tuned: Judged
    before: Judged


class Trial:
    """What a candidate costs; picklable, so that any process can try it."""

    def __init__(self, job: Job, vessel: Vessel, law: str, weight: float) -> None:
        self.job = job._replace(study=replace(job.study, laws=(law,), gain_factors=(1.0,)))
        self.vessel, self.law, self.weight = vessel, law, weight

    def __call__(self, logarithms: Any) -> float:
        """Return the cost of gains, given by their natural logarithms."""
        return self.judged(with_gains(self.vessel, self.law, np.exp(logarithms))).cost

    def judged(self, vessel: Vessel, seed: int = 0) -> Judged:
        """Return what a vessel's gains come to, on seeds that are later by `seed`."""
        try:
            if verdict_of(vessel, self.law).refusal:
                return Judged(REFUSED_COST, math.nan, math.nan)
        except ArithmeticError:
            return Judged(REFUSED_COST, math.nan, math.nan)
        job = self.job._replace(vessel=vessel, study=replace(self.job.study, seed=self.job.study.seed + seed))
        rows = do_runs(job, 0, number_of_runs(job))
        if any(row.done_by == REFUSED for row in rows):
            return Judged(REFUSED_COST, math.nan, math.nan)
        rms = float(np.mean([row.figures.heading_rms_deg for row in rows]))
        travel = float(np.mean([row.figures.travel_deg_s for row in rows]))
        return Judged(rms + self.weight * travel, rms, travel)


def with_gains(vessel: Vessel, law: str, gains: Iterable[float]) -> Vessel:
    """Return the vessel with these gains of `law`, in the order and units of its file."""
    kind = type(getattr(vessel.control, law))
    section = kind(*(float(f"{gain:.5g}") for gain in gains))
    return replace(vessel, control=replace(vessel.control, **{law: section}))


def begun(vessel: Vessel, law: str) -> Any:
    """Return the gains that a search begins with: the file's, or what the law makes of them."""
    design, section = LAWS[law].design, getattr(vessel.control, law)
    return design.begin(section) if design else section


class Search(NamedTuple):
    """What is searched for, and how long: gains of a law, for a `weight` of rudder travel [deg per deg/s]."""

    law: str
    weight: float
    generations: int


def tune(job: Job, vessel: Vessel, search: Search, workers: int, progress: Callable[[int, int], None]) -> Tuned:
    """Return the vessel with gains tuned in the study of `job`.

    Raises InputError where numba is missing or a gain is 0, RefusedError where the vessel has no gains for the law, or
    none is found with margins.
    """
    law, weight, generations = search
    law_of(vessel, law)
    if compiled_loop(law) is None:
        raise InputError("tuning needs numba, which makes it a matter of minutes: pip install '.[fast]'")
    announce(law)
    begin = np.array(astuple(begun(vessel, law)))
    if not np.all(begin > 0.0):
        raise InputError(f"vessel {vessel.name!r}: a gain in control.{law} is 0; tuning begins with positive ones")
    trial, middle, done = Trial(job, vessel, law, weight), np.log(begin), 0
    judged = verdict_of(with_gains(vessel, law, begin), law).refusal
    middle = middle if not judged else middle - math.log(2.0)

    def on_generation(*_: Any, **__: Any) -> None:
        nonlocal done
        done += 1
        progress(done, generations)

    with pool_of(workers) as pool:
        found = differential_evolution(
            trial,
            Bounds(middle - math.log(SPAN), middle + math.log(SPAN)),
            maxiter=generations,
            popsize=CANDIDATES // len(begin),
            rng=np.random.default_rng(job.study.seed),
            x0=middle,
            tol=0.0,
            polish=False,
            updating="deferred",
            workers=pool.map if workers > 1 else map,
            callback=on_generation,
        )
    if found.fun >= REFUSED_COST:
        raise RefusedError(f"vessel {vessel.name!r}: no gains of the law {law!r} with margins were found")
    better = with_gains(vessel, law, np.exp(found.x))
    return Tuned(
        better, int(found.nfev), trial.judged(better), trial.judged(better, HELD_OUT), trial.judged(vessel, HELD_OUT)
    )
