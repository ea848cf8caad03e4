"""Norrbin: a MAVLink-connected autopilot bridge for boats."""

import sys

TYPE_CHECKING = False  # as type checkers take it: `typing` itself would be a tenth of the time of a help

if TYPE_CHECKING:
    from typing import Any

    from autopilot.api import *  # noqa: F403 - the public interface, which its own __all__ names

__version__ = "0.2.0"

if sys.version_info < (3, 11):  # noqa: UP036 - said before any newer syntax is met
    sys.exit(
        "Norrbin needs Python 3.11 or newer; this is {} of version {}.{}".format(sys.executable, *sys.version_info)
    )


def __getattr__(name: str) -> "Any":
    """Load the public interface when a name of it is asked for: `from autopilot import identify`."""
    if name.startswith("_"):
        raise AttributeError(f"module 'autopilot' has no attribute {name!r}")
    import importlib

    public = importlib.import_module("autopilot.api")
    if name not in public.__all__:
        raise AttributeError(
            f"module 'autopilot' has no attribute {name!r}; its public names: {', '.join(public.__all__)}"
        )
    return getattr(public, name)
