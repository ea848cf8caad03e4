"""Study files: boats, laws, seas, speeds, mistakes of the model, instruments, faults, and how often. Read strictly."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

from autopilot.errors import InputError
from autopilot.params import schema
from autopilot.params.schema import Bounds, nearest
from autopilot.params.strict_yaml import Node, parse_document, read_document
from sitl.fault_kinds import wrong_size, wrong_source
from sitl.scenario import FaultSection, HullSection, SensorsSection, WavesSection, WindSection

SCHEMA_VERSION = 1
MOST_RUNS = 10_000_000

LawName = Literal["backstepping", "pid", "sliding"]


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
    laws: tuple[LawName, ...] = ("backstepping",)
    gain_factors: tuple[Annotated[float, Bounds(0.01, 100.0, "factor on the loop's bandwidth")], ...] = (1.0,)
    speed_shares: tuple[Annotated[float, Bounds(0.05, 3.0, "share of the model's reference speed")], ...] = (1.0,)
    seas: dict[str, SeaSection] = field(default_factory=lambda: {"calm": SeaSection()})
    sides_deg: tuple[Annotated[float, Bounds(-360.0, 360.0, "off the bow")], ...] = (45.0,)
    mismatches: dict[str, MismatchSection] = field(default_factory=lambda: {"as modelled": MismatchSection()})
    instruments: dict[str, SensorsSection] = field(default_factory=lambda: {"as filed": SensorsSection()})
    faults: dict[str, tuple[FaultSection, ...]] = field(default_factory=lambda: {"none": ()})


def shipped_studies() -> list[str]:
    """Return the names of the studies that come with the product."""
    folder = resources.files("sitl") / "studies"
    return sorted(entry.name.removesuffix(".yaml") for entry in folder.iterdir() if entry.name.endswith(".yaml"))


def load_study(path_or_name: str) -> tuple[Study, str]:
    """Return the study of a YAML file, or the shipped one of that name, and the folder that its paths start at.

    Raises InputError.
    """
    path, shipped = Path(path_or_name), shipped_studies()
    if path.exists() or path.suffix or path.name != path_or_name:
        return study_from(read_document(path)), str(path.parent)
    if path_or_name not in shipped:
        near = nearest(path_or_name, shipped)
        hint = f"did you mean {near}?" if near else f"shipped are {', '.join(shipped)}."
        raise InputError(f"{path_or_name}: neither a file nor a shipped study; {hint}")
    text = (resources.files("sitl") / "studies" / f"{path_or_name}.yaml").read_text(encoding="utf-8")
    return study_from(parse_document(text, f"{path_or_name}.yaml (shipped)")), "."


def study_from(root: Node) -> Study:
    """Return the study that a document holds, checked across its fields. Raises InputError."""
    study = schema.read(root, Study)
    if study.schema_version != SCHEMA_VERSION:
        raise root.at("schema_version").fault(
            f"schema_version is {study.schema_version}, this version of Norrbin reads {SCHEMA_VERSION}."
        )
    for key in ("boats", "laws", "gain_factors", "speed_shares", "seas", "sides_deg", "mismatches"):
        if not getattr(study, key):
            raise root.at(key).fault(f"{key} is empty; give at least one, or leave the key out.")
    for key in ("instruments", "faults"):
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
        for index, fault in enumerate(faults):
            if fault.to_s is not None and fault.to_s <= fault.from_s:
                raise root.at("faults").fault(
                    f"faults.{name}[{index}] ends at to_s {fault.to_s:g}, it must end after from_s ({fault.from_s:g})."
                )
            if wrong := wrong_size(fault.kind, fault.size) or wrong_source(fault.kind, fault.source):
                raise root.at("faults").fault(f"faults.{name}[{index}]: {wrong}")
    return study
