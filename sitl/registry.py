"""Every plant and every fault of the simulator, by name: one line for each module of either (`docs/howto`)."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, get_args

from autopilot.errors import InputError
from sitl.boat import PlantKind
from sitl.fault_table import Kind

if TYPE_CHECKING:
    from sitl.scenario import Scenario

PLANT_MODULES = (
    "boat",
    "mmg_tanker",
    "roll_ship",
    "small_craft",
    "twin_thruster",
)  # fmt: skip
"""Modules of `sitl` with a tuple PLANTS; the one to take unless another is named comes first."""
PLANTS: dict[str, PlantKind] = {
    kind.name: kind for module in PLANT_MODULES for kind in import_module(f"sitl.{module}").PLANTS
}
USUAL = next(iter(PLANTS))
if TYPE_CHECKING:
    PlantName = str
else:
    PlantName = Literal[tuple(PLANTS)]


def kind_of(scenario: Scenario) -> PlantKind:
    """Return the kind of plant that a scenario sails. InputError for shallow water where the plant knows none."""
    kind = PLANTS[scenario.plant]
    if scenario.depth_draughts is not None and not kind.knows_depth:
        known = ", ".join(each.name for each in PLANTS.values() if each.knows_depth)
        raise InputError(
            f"plant {kind.name}: depth_draughts is {scenario.depth_draughts:g}, and shallow water does not change this "
            f"boat here, only {known}: leave it out."
        )
    return kind


FAULT_MODULES = (
    "fault_table",
)  # fmt: skip
"""Modules of `sitl` with a table KINDS. Where several faults act at one place, they do in this order."""
KINDS: dict[str, Kind] = {
    name: kind for module in FAULT_MODULES for name, kind in import_module(f"sitl.{module}").KINDS.items()
}
if TYPE_CHECKING:
    FaultKind = str
else:
    FaultKind = Literal[tuple(KINDS)]

Source = Literal["both", "first", "second"]
"""Which compass and rate gyro fail: the flight controller's is the first, that on the NMEA line the second."""
SOURCES: tuple[Source, ...] = get_args(Source)


@cache
def that_silence(what: str) -> tuple[FaultKind, ...]:
    """Return the faults that silence a message, a sentence or an instrument."""
    return tuple(name for name, kind in KINDS.items() if what in kind.silences)


@cache
def that_act_at(place: str) -> tuple[tuple[FaultKind, Callable[..., Any]], ...]:
    """Return the faults that act at a place, a field of `Kind`, and what each does there."""
    found = ((name, getattr(kind, place)) for name, kind in KINDS.items())
    return tuple((name, effect) for name, effect in found if effect is not None)


def wrong_source(kind: FaultKind, source: Source) -> str:
    """Return the sentence that says why only one source cannot have this fault, empty where it can."""
    if source == "both" or KINDS[kind].of_a_compass:
        return ""
    allowed = ", ".join(sorted(name for name, each in KINDS.items() if each.of_a_compass))
    return f"{kind} is no fault of one compass; leave source out, or choose {allowed}."


def wrong_size(kind: FaultKind, size: float | None) -> str:
    """Return the sentence that says why a size cannot be, empty where it can; None is the default size."""
    if size is None:
        return ""
    allowed = KINDS[kind]
    if not allowed.unit:
        return f"{kind} has no size; leave size out."
    if not allowed.low <= size <= allowed.high:
        return f"the size of {kind} is {size:g}, allowed is {allowed.low:g} to {allowed.high:g} ({allowed.unit})."
    return ""
