"""Boats, seas, runs and the two helmsmen of the Pareto study; `pareto.py` searches and prints.

A setting is a row of numbers in the logarithms that a search works on. `Ours` and `Theirs` make a helmsman of it and
sail any run of the study with it, compiled where numba is installed.
"""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol

import numpy as np
import numpy.typing as npt
from pareto_peer import Peer, run_peer

from autopilot.control.backstepping import Backstepping, gains_of_loop
from autopilot.control.design import DESIGNED
from autopilot.control.pid import PidGains
from autopilot.errors import InputError
from autopilot.estimation.heading_ekf import initial
from autopilot.runtime.build import bias_time_of, model_of, verdict_of
from autopilot.vessel.file import load_vessel
from autopilot.vessel.schema import Vessel
from sitl.boat import step_of
from sitl.campaign.compiled_run import Setting, Workspace, figures, run_compiled
from sitl.campaign.setting import campaign_of, setting_of, workspace_of
from sitl.campaign.study import BoatSection, Case, Job, MismatchSection, SeaSection, Study, case_and_seed, cases_of
from sitl.campaign.work import compiled_loop
from sitl.compiled import compiled
from sitl.scenario import HullSection, IttcSection, SensorsSection, WavesSection, WindSection
from sitl.world import STEP

Floats = npt.NDArray[np.float64]

FOLDER = Path(__file__).resolve().parent / "pareto_boats"
WAVE_FILTERS: tuple[Literal["off"], Literal["auto"], Literal["meet"]] = ("off", "auto", "meet")
STEP_S, COMPASS_HZ = 0.05, 10
"""The boat moves in steps of this length here; see `stepped`."""
LOST = 1.0e3
"""What stands for rms [deg] and travel [deg/s] of gains without margins."""

SIDES_DEG = (25.0, 60.0, 100.0, 135.0, 160.0)
"""Neither ahead, abeam nor astern: a long-crested sea from there yaws no symmetric hull."""
SEAS = {
    # a light air: where nothing at all moves the boat, the best helmsman sleeps
    "calm": SeaSection(wind=WindSection(1.5, gust_m_s=0.3)),
    "breeze": SeaSection(wind=WindSection(7.0, gust_m_s=1.0)),
    # WMO-No. 306, code table 3700, middles of the ranges; peak periods and winds of the open ocean, Bales 1982
    "state 3": SeaSection(WavesSection(ittc=IttcSection(0.88, 7.5)), WindSection(7.0, gust_m_s=1.0)),
    "state 5": SeaSection(WavesSection(ittc=IttcSection(3.25, 9.7)), WindSection(12.0, gust_m_s=1.5)),
}
MISMATCHES = {"K": MismatchSection(), "0.7 K": MismatchSection(K=0.7), "1.4 K": MismatchSection(K=1.4)}
COMPASSES = {"0.2 deg": SensorsSection(heading_noise_deg=0.2), "0.5 deg": SensorsSection(heading_noise_deg=0.5)}


class BoatPlan(NamedTuple):
    """Hull, and how long [s] a run lasts and from when on it counts."""

    hull: HullSection
    seconds: float
    measured_from: float


BOATS = {
    "lanxin15": BoatPlan(HullSection(), 120.0, 40.0),
    "esso": BoatPlan(HullSection(325.0, 53.0, 21.7, 300.0, 0.3, 80.0, 60.0, 12.0), 400.0, 200.0),
    "coaster": BoatPlan(HullSection(50.0, 9.0, 3.0, 30.0, 0.3, 12.0, 8.0, 8.0), 240.0, 90.0),
    "unstable": BoatPlan(HullSection(200.0, 32.0, 11.0, 200.0, 0.3, 50.0, 40.0, 12.0), 360.0, 130.0),
}


class Run(NamedTuple):
    """What a run is about, and all that it depends on, the helmsman apart."""

    sea: str
    side: float
    mismatch: str
    compass: str
    setting: Setting
    workspace: Workspace


def job_of(boat: str, seed: int, runs: int) -> Job:
    """Return every combination of sea, side, mismatch and compass for a boat, on seeds from `seed` on."""
    plan = BOATS[boat]
    study = Study(
        1,
        f"pareto {boat}",
        {boat: BoatSection(str(FOLDER / f"{boat}.yaml"), plan.hull)},
        seed=seed,
        runs=runs,
        seconds=plan.seconds,
        measured_from_s=plan.measured_from,
        heading_hz=COMPASS_HZ,
        gyro=False,
        seas=SEAS,
        sides_deg=SIDES_DEG,
        mismatches=MISMATCHES,
        instruments=COMPASSES,
    )
    return Job(study, ".")


def runs_of(job: Job, wanted: Callable[[int], bool] = lambda _: True) -> list[Run]:
    """Return the runs of a job whose number is `wanted`."""
    found = []
    for number in range(len(cases_of(job)) * job.study.runs):
        if not wanted(number):
            continue
        case, _ = case_and_seed(job, number)
        setting = setting_of(job, number)
        assert setting is not None
        setting = stepped(setting)
        found.append(Run(case.sea, case.side_deg, case.mismatch, case.instruments, setting, workspace_of(setting)))
    return found


def stepped(setting: Setting) -> Setting:
    """Return the setting with steps of STEP_S, the length in which the sea is felt, and no monitor that ends the run.

    Both helmsmen sail it so; what an alarm would have said is left out, because the peer has none.
    """
    times = round(STEP_S / STEP)
    assert setting.water_every == times
    gear = setting.plant.gear
    # a delay of a step, without the rounding of times that could make it two
    plant = setting.plant._replace(gear=gear._replace(delay=gear.delay - 0.1 * STEP_S))
    return setting._replace(
        steps=setting.steps // times,
        dt=STEP_S,
        plant=plant,
        step=step_of(plant, STEP_S),
        water_every=1,
        instruments=setting.instruments._replace(every=setting.instruments.every // times),
        is_watched=False,
    )


class Helmsman(Protocol):
    """A kind of helmsman: bounds of his numbers, the settings (n, numbers) a search begins with, and how he does."""

    low: Floats
    high: Floats
    starts: Floats

    def sailed(self, numbers: Floats, runs: Sequence[Run]) -> Floats:
        """Return heading rms [deg] and rudder travel [deg/s] of each run, shape (runs, 2)."""


def filed(boat: str) -> Vessel:
    """Return the boat's vessel file."""
    return load_vessel(FOLDER / f"{boat}.yaml")


def natural_of(vessel: Vessel) -> float:
    """Return the natural frequency [rad/s] of the loop that the vessel file's gains make."""
    gains = vessel.control.backstepping
    assert gains is not None
    return math.sqrt(gains.gamma_1_s2 + gains.k1_1_s * gains.k2_1_s)


class Ours:
    """The pilot with what its user can set: bandwidth, damping, compass noise, dead band, wave filter off, auto or
    meet, the smoothing of its rudder, and the time in which wind and trim change, times the usual one."""

    def __init__(self, boat: str, plain: bool = False) -> None:
        self.vessel = filed(boat)
        self._natural = natural_of(self.vessel)
        self._run = run_compiled if plain else compiled_loop(DESIGNED) or run_compiled
        self.low = np.array([math.log(0.05), math.log(0.3), math.log(0.5), -4.6, 0.0, math.log(0.01), math.log(0.3)])
        self.high = np.array([math.log(3.0), math.log(4.0), math.log(40.0), 1.6, 1.0, math.log(1.5), math.log(100.0)])
        self.starts = _begun(
            (1.0, 0.9, 1.0, 0.02, 1.6, 0.01, 1.0),
            (0.9, 0.7, 2.5, 0.03, 2.7, 0.35, 1.0),
            (0.1, 1.1, 2.0, 0.02, 1.6, 0.35, 1.0),
            (0.5, 2.5, 1.0, 0.05, 1.0, 0.05, 1.0),
            (0.3, 1.0, 3.0, 0.5, 1.6, 0.35, 10.0),
            (0.6, 2.0, 30.0, 0.1, 1.6, 0.02, 10.0),
        )

    def vessel_of(self, numbers: Floats) -> Vessel:
        """Return the vessel file that these numbers make."""
        share, damping, noise, dead_band, _, smoothing, slowness = (float(number) for number in np.exp(numbers))
        natural = share * self._natural
        gains = Backstepping(*gains_of_loop(2.0 * damping * natural, natural * natural, smoothing / natural))
        vessel = self.vessel
        return replace(
            vessel,
            sensors=replace(vessel.sensors, heading_noise_deg=0.35 * noise),
            control=replace(vessel.control, backstepping=gains),
            limits=replace(vessel.limits, dead_band_deg=dead_band),
            estimator=replace(
                vessel.estimator,
                wave_filter=WAVE_FILTERS[min(int(3.0 * numbers[4]), 2)],
                bias_time_s=slowness * bias_time_of(vessel),
            ),
        )

    def sailed(self, numbers: Floats, runs: Sequence[Run]) -> Floats:
        """See `Helmsman`."""
        vessel = self.vessel_of(numbers)
        try:
            refused = bool(verdict_of(vessel, "backstepping").refusal)
        except ArithmeticError:
            refused = True
        campaign = None if refused else campaign_of(vessel, "backstepping")
        if campaign is None:
            return np.full((len(runs), 2), LOST)
        found = []
        for run in runs:
            setting = run.setting
            state = initial(0.0, setting.filtered.psi, None, campaign.config.estimator.noises.usual)
            score, _ = self._run(setting._replace(campaign=campaign, filtered=state), run.workspace)
            found.append(_point(score, setting))
        return np.array(found)


class Theirs:
    """The PID of `pareto_peer`: bandwidth, damping, integral, two filters, weather band and dead band."""

    def __init__(self, boat: str, plain: bool = False) -> None:
        vessel = filed(boat)
        self._natural, self._model = natural_of(vessel), model_of(vessel)
        self._run = run_peer if plain else _compiled_peer() or run_peer
        self.low = np.array([math.log(0.05), math.log(0.3), math.log(1e-3), math.log(0.01), math.log(0.02), -4.6, -4.6])
        self.high = np.array([math.log(3.0), math.log(4.0), 0.0, math.log(3.0), math.log(10.0), 1.1, 1.6])
        self.starts = _begun(
            (1.0, 0.9, 0.1, 0.02, 0.2, 0.02, 0.02),
            (0.5, 3.0, 0.004, 1.0, 0.1, 0.05, 2.0),
            (1.7, 0.67, 0.02, 0.01, 0.02, 0.01, 0.01),
            (0.3, 3.2, 0.02, 0.36, 0.6, 0.1, 0.25),
            (0.13, 3.4, 0.2, 0.05, 1.2, 0.1, 0.1),
            (0.3, 1.3, 0.1, 0.07, 6.0, 0.4, 1.9),
        )

    def peer_of(self, numbers: Floats) -> Peer:
        """Return the PID that these numbers make: the last two are logarithms of degrees."""
        share, damping, integral, heading, rate, weather, dead = (float(value) for value in np.exp(numbers))
        natural, model = share * self._natural, self._model
        ratio = model.time_constant / model.gain
        kp = ratio * natural * natural
        kd = max(ratio * 2.0 * damping * natural - model.n1 / model.gain, 0.0)
        gains = PidGains(kp, integral * natural * kp, kd)
        return Peer(gains, heading / natural, rate / natural, math.radians(weather), math.radians(dead))

    def sailed(self, numbers: Floats, runs: Sequence[Run]) -> Floats:
        """See `Helmsman`."""
        peer = self.peer_of(numbers)
        return np.array([_point(self._run(run.setting, run.workspace, peer), run.setting) for run in runs])


def _begun(*settings: tuple[float, ...]) -> Floats:
    """Return settings that did well on training seeds in trials, as a search takes them."""
    return np.log(np.array(settings))


def _point(score: Any, setting: Setting) -> tuple[float, float]:
    found = figures(score, setting.instruments.every * setting.dt, 1.0)
    point = found.heading_rms_deg, found.travel_deg_s
    return point if all(math.isfinite(value) for value in point) else (LOST, LOST)


@functools.cache
def _compiled_peer() -> Callable[..., Any] | None:
    try:
        return compiled(run_peer, quick=True)
    except InputError:
        return None


def training_runs(boat: str, seed: int) -> list[Run]:
    """Return a run for each sea, side and mismatch, each mismatch on a seed of its own."""
    job, offs = job_of(boat, seed, len(MISMATCHES)), list(MISMATCHES)
    cases, wanted = cases_of(job), compasses_in_turn()

    def is_wanted(number: int) -> bool:
        place, nth = divmod(number, len(offs))
        return cases[place].mismatch == offs[nth] and _is_in(cases[place], wanted)

    return runs_of(job, is_wanted)


def held_out_runs(boat: str, seed: int, seeds: int) -> list[Run]:
    """Return runs for each sea, side and mismatch."""
    job = job_of(boat, seed, seeds)
    cases, wanted = cases_of(job), compasses_in_turn()
    return runs_of(job, lambda run: _is_in(cases[run // seeds], wanted))


def compasses_in_turn() -> dict[tuple[str, float, str], str]:
    """Return for each sea, side and mismatch one of the two compasses, in turn."""
    turn = itertools.cycle(COMPASSES)
    return {key: next(turn) for key in itertools.product(SEAS, SIDES_DEG, MISMATCHES)}


def _is_in(case: Case, compasses: dict[tuple[str, float, str], str]) -> bool:
    return compasses[case.sea, case.side_deg, case.mismatch] == case.instruments
