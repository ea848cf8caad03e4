"""Every identification method there is, by name: one line each module in MODULES."""

from __future__ import annotations

from importlib import import_module

from autopilot.errors import InputError
from autopilot.identification.methods import Method

MODULES = (
    "methods",
    "integral_method",
    "filter_methods",
)
"""Modules of this room with a tuple METHODS."""
METHODS: tuple[Method, ...] = tuple(
    method for module in MODULES for method in import_module(f"autopilot.identification.{module}").METHODS
)
"""The one to use unless another is named comes first."""

NAMES = tuple(method.name for method in METHODS)


def that_take(option: str) -> str:
    """Return the names of the methods that can be asked an `option` of `Method.takes`."""
    return " or ".join(method.name for method in METHODS if option in method.takes)


def method_named(name: str | None) -> Method:
    """Return the method called `name`, None: the first. Raises InputError."""
    method = next((each for each in METHODS if name in (None, each.name)), None)
    if method is None:
        raise InputError(f"{name!r} is no identification method; there are {', '.join(NAMES)}.")
    return method
