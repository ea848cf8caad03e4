"""A simulated boat on real links; `simulate` sails one in lockstep with a pilot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sitl.lockstep import simulate as simulate

__all__ = ["simulate"]


def __getattr__(name: str) -> Any:
    """Load the simulator when it is asked for."""
    if name != "simulate":
        raise AttributeError(f"module 'sitl' has no attribute {name!r}")
    from sitl.lockstep import simulate

    return simulate
