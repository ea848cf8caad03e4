"""Every plant of the simulator, by name: one line for each module in MODULES (`docs/howto/add_a_plant.md`)."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Literal

from sitl.boat import PlantKind

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
