"""Every plant of the simulator, by name: one line for each module in MODULES (`docs/howto/add_a_plant.md`)."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Literal

from autopilot.errors import InputError
from sitl.boat import PlantKind

if TYPE_CHECKING:
    from sitl.scenario import Scenario

MODULES = (
    "boat",
    "mmg_tanker",
    "roll_ship",
    "small_craft",
    "twin_thruster",
    "outboard",
)  # fmt: skip
"""Modules of `sitl` with a constant PLANT; the one to take unless another is named comes first."""
PLANTS: dict[str, PlantKind] = {
    kind.name: kind for kind in (import_module(f"sitl.{module}").PLANT for module in MODULES)
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
