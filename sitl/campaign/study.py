"""Study files: boats, laws, seas, speeds, mistakes of the model, instruments, faults, and how often. Read strictly.

From a study to its cases and runs: what is steered, how, in which sea, and the seed of each run.
"""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

from autopilot.control.design import DESIGNED
from autopilot.control.registry import LAWS, designed_laws
from autopilot.errors import InputError
from autopilot.files import typed
from autopilot.files.strict_yaml import Node, check_version
from autopilot.files.typed import Bounds, Shipped, is_path
from autopilot.vessel.file import load_vessel, shipped_vessels
from autopilot.vessel.schema import Vessel
from sitl.scenario import (
    SCHEMA_VERSION,
    FaultSection,
    HullSection,
    Scenario,
    SensorsSection,
    Start,
    WavesSection,
    WindSection,
    check_faults,
)

STUDIES = Shipped("sitl", "studies", "a shipped study")
LISTS = ["boats", "laws", "gain_factors", "speed_shares", "seas", "sides_deg", "mismatches", "instruments", "faults"]
"""Keys of which each holds at least one entry."""
MOST_RUNS = 10_000_000

if TYPE_CHECKING:
    LawName = str
else:
    LawName = Literal[designed_laws()]


@dataclass(frozen=True)
class BoatSection:
    """A vessel file, or the name of a shipped one, and the hull around its model; a path starts at the study's."""

    vessel: str
    hull: HullSection = field(default_factory=HullSection)


@dataclass(frozen=True)
class SeaSection:
    """Waves and wind; where they come from is the study's `sides_deg`."""

    waves: WavesSection = field(default_factory=WavesSection)
    wind: WindSection = field(default_factory=WindSection)


@dataclass(frozen=True)
class MismatchSection:
    """The real boat beside the pilot's model: factors on its K and T, and what its trim is off."""

    K: Annotated[float, Bounds(0.1, 10.0, "real K over the model's")] = 1.0
    T: Annotated[float, Bounds(0.1, 10.0, "real T over the model's")] = 1.0
    n0_rad_s: Annotated[float, Bounds(-10.0, 10.0, "added to the model's n0")] = 0.0


@dataclass(frozen=True)
class TurnSection:
    """A change of the heading ordered."""

    degrees: Annotated[float, Bounds(-180.0, 180.0, "turn, positive to starboard; 0: none")] = 0.0
    at_s: Annotated[float, Bounds(0.0, 1.0e5, "when it is ordered")] = 30.0


@dataclass(frozen=True)
class Study:
    """Every combination of its lists is a case, and every case is run `runs` times, on seeds `seed`, `seed` + 1, ..."""

    schema_version: int
    name: str
    boats: dict[str, BoatSection]
    description: str = ""
    seed: Annotated[int, Bounds(0, 2**31, "seed of every case's first run")] = 1
    runs: Annotated[int, Bounds(1, 1_000_000, "runs of every case")] = 10
    seconds: Annotated[float, Bounds(1.0, 1.0e5, "simulated time of a run")] = 300.0
    measured_from_s: Annotated[float, Bounds(0.0, 1.0e5, "what is earlier does not count")] = 60.0
    heading_hz: Annotated[int, Bounds(1, 100, "readings and ticks a second, a divisor of 100")] = 10
    gyro: bool = True
    """False: the compass comes alone, without a rate of turn."""
    turn: TurnSection = field(default_factory=TurnSection)
    laws: tuple[LawName, ...] = (DESIGNED,)
    gain_factors: tuple[Annotated[float, Bounds(0.01, 100.0, "factor on the loop's bandwidth")], ...] = (1.0,)
    speed_shares: tuple[Annotated[float, Bounds(0.05, 3.0, "share of the model's reference speed")], ...] = (1.0,)
    seas: dict[str, SeaSection] = field(default_factory=lambda: {"calm": SeaSection()})
    sides_deg: tuple[Annotated[float, Bounds(-360.0, 360.0, "off the bow")], ...] = (45.0,)
    mismatches: dict[str, MismatchSection] = field(default_factory=lambda: {"as modelled": MismatchSection()})
    instruments: dict[str, SensorsSection] = field(default_factory=lambda: {"as filed": SensorsSection()})
    faults: dict[str, tuple[FaultSection, ...]] = field(default_factory=lambda: {"none": ()})


def load_study(path_or_name: str) -> tuple[Study, str]:
    """Return the study of a YAML file, or the shipped one of that name, and the folder that its paths start at.

    Raises InputError.
    """
    study = study_from(STUDIES.document(path_or_name))
    return study, str(Path(path_or_name).parent) if is_path(path_or_name) else "."


def study_from(root: Node) -> Study:
    """Return the study that a document holds, checked across its fields. Raises InputError."""
    check_version(root, SCHEMA_VERSION, "study")
    study = typed.read(root, Study)
    for key in LISTS:
        if not getattr(study, key):
            raise root.at(key).fault(f"{key} is empty; give at least one, or leave the key out.")
    if 100 % study.heading_hz:
        raise root.at("heading_hz").fault(
            f"heading_hz is {study.heading_hz}, allowed are the divisors of 100: 1, 2, 4, 5, 10, 20, 25, 50, 100."
        )
    if study.measured_from_s >= study.seconds:
        raise root.at("seconds").fault(
            f"seconds is {study.seconds:g}, it must be more than measured_from_s ({study.measured_from_s:g})."
        )
    for name, faults in study.faults.items():
        check_faults(root, f"faults.{name}", faults)
    return study


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
    quicker = {}
    for name, law in LAWS.items():
        section = getattr(vessel.control, name) if law.design else None
        if law.design and section is not None:
            quicker[name] = law.design.quicker(section, factor)
    return replace(vessel, control=replace(vessel.control, **quicker))


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
