"""Every heading law there is, by name: one line each in MODULES (`docs/howto/add_a_law.md`).

`law_step` is what the tick calls: in plain Python it finds the step by the type of the gains, and `sitl.compiled`
puts the law's own step in its place.

One law has no module: that of trials, which order rudder angles, and of boats that others steer. It leaves the rudder
where it is.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple

from autopilot.control.law import Law, LawBoat, LawInput, NoMemory

MODULES = (
    "backstepping",
    "pid",
    "sliding_heading",
    "sliding_roll",
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


TRIAL_LAW = "trial"
"""In place of a law's name: trials order rudder angles and need no gains."""


class NoGains(NamedTuple):
    """A law without gains."""


def _gains_of(section: object, boat: LawBoat) -> NoGains:
    return NoGains()


def _step(gains: NoGains, memory: NoMemory, given: LawInput) -> tuple[float, NoMemory]:
    """Return the last rudder [rad]."""
    return given.last_rudder, memory


register(
    Law(
        name=TRIAL_LAW,
        title="Trial",
        prefix="",
        section=None,
        numbers=NoGains,
        gains=_gains_of,
        step=_step,
        linear=None,
    )
)


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
