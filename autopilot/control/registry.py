"""Every heading law there is, by name: one line each.

`law_step` is what the tick calls: in plain Python it finds the step by the type of the gains, and `sitl.compiled`
puts the law's own step in its place.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from autopilot.control import backstepping, pid, sliding_heading, sliding_roll, trial
from autopilot.control.law import Law, LawInput

LAWS: dict[str, Law] = {}
"""In the order in which they are listed; the first is the one that is designed, and the others after it."""

_STEPS: dict[type[Any], Callable[[Any, Any, LawInput], tuple[float, Any]]] = {}


def register(law: Law) -> None:
    """Add a law. ValueError where its name, or the type of its gains, is another's."""
    if law.name in LAWS or law.numbers in _STEPS:
        raise ValueError(f"law {law.name!r}: there is one of this name, or with gains of the type {law.numbers}")
    LAWS[law.name], _STEPS[law.numbers] = law, law.step


register(backstepping.LAW)
register(pid.LAW)
register(sliding_heading.LAW)
register(sliding_roll.LAW)
register(trial.LAW)


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
