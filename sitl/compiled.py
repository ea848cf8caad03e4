"""The very functions of the loop, compiled by numba: no second copy of an equation for the sake of speed.

`compiled(function)` compiles a function and everything it calls by name within `autopilot` and `sitl`. The functions
stay as they are, plain scalars over NamedTuples, for everybody else.
"""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any

from autopilot.errors import InputError

OURS = ("autopilot.", "sitl.", "benchmarks.", "__main__", "test_", "liu2017")


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function` compiled, with those it calls. InputError where numba is not installed."""
    try:
        import numba
    except ImportError as exc:
        raise InputError("compiled studies need numba: pip install 'norrbin[fast]'") from exc
    ready: Callable[..., Any] = _compile(function, numba.njit, {})
    return ready


def _compile(function: Any, jit: Any, done: dict[Any, Any]) -> Any:
    if function in done:
        return done[function]
    names = {
        name: value
        for name, value in function.__globals__.items()
        if name in function.__code__.co_names and isinstance(value, FunctionType) and value.__module__.startswith(OURS)
    }
    scope = dict(function.__globals__)
    scope.update({name: _compile(value, jit, done) for name, value in names.items()})
    copy = FunctionType(function.__code__, scope, function.__name__, function.__defaults__, function.__closure__)
    done[function] = jit(copy)
    return done[function]
