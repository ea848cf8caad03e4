"""Every heading law there is, by name: one line each in MODULES (`docs/howto/add_a_law.md`).

`law_step` is what the tick calls: in plain Python it finds the step by the type of the gains, and `sitl.compiled`
puts the law's own step in its place.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

from autopilot.control.law import Law, LawInput

MODULES = (
    "backstepping",
    "pid",
    "sliding_heading",
    "sliding_roll",
    "trial",
)
"""Modules of this room with a constant LAW, in the order in which their laws are listed."""

LAWS: dict[str, Law] = {}

_STEPS: dict[type[Any], Callable[[Any, Any, LawInput], tuple[float, Any]]] = {}


def register(law: Law) -> None:
    """Add a law. ValueError where its name, or the type of its gains, is another's."""
    if law.name in LAWS or law.numbers in _STEPS:
        raise ValueError(f"law {law.name!r}: there is one of this name, or with gains of the type {law.numbers}")
    LAWS[law.name], _STEPS[law.numbers] = law, law.step


for _module in MODULES:
    register(import_module(f"autopilot.control.{_module}").LAW)


def law_step(gains: Any, memory: Any, given: LawInput) -> tuple[float, Any]:
    """Return the rudder demand [rad] and the new memory of the law whose gains these are."""
    return _STEPS[type(gains)](gains, memory, given)


def own_step(name: str) -> dict[Callable[..., Any], Callable[..., Any]]:
    """Return what `sitl.compiled` puts in the place of `law_step` where that law alone steers."""
    return {law_step: LAWS[name].step}


def filed_laws() -> tuple[str, ...]:
    """Return the names of the laws that a vessel file may hold gains for."""
    return tuple(name for name, law in LAWS.items() if law.section is not None)


def designed_laws() -> tuple[str, ...]:
    """Return the names of the laws whose gains can be worked out, and which campaigns sail."""
    return tuple(name for name, law in LAWS.items() if law.design is not None)
