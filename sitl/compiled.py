"""The very functions of the loop, compiled by numba: no second copy of an equation for the sake of speed.

`compiled(function)` compiles a function and everything it calls within `autopilot` and `sitl`, by its name or through
its module. The functions stay as they are, plain scalars over NamedTuples, for everybody else.
"""

from __future__ import annotations

import functools
import hashlib
import math
import os
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path
from types import CellType, FunctionType, MappingProxyType, ModuleType
from typing import Any

from autopilot.errors import InputError

OURS = ("autopilot.", "sitl.", "benchmarks.", "__main__", "test_", "liu2017", "naval_vessel", "front", "rails")


ARITHMETIC = {"arcp", "contract", "reassoc", "nsz"}
REORDERED = (
    "autopilot.models.",
    "autopilot.estimation.heading_ekf",
    "autopilot.estimation.disturbance",
    "sitl.boat",
    "sitl.sea.water_step",
    "sitl.sea._meet",
    "sitl.sea._phases",
    "sitl.sea.turned",
    "sitl.sea.summed",
    "autopilot.supervision.response_filter",
    "autopilot.supervision.rudder_response",
)
"""What the quick compilation may do to sums and quotients, another order, one rounding less, and where: in smooth
equations, which it moves by parts in 1e15, never where times are compared, which must fall on the same tick."""

ALLOCATING = {"wave_forces", "_spherical_bessel_1", "_meet"}
"""Functions of ours that make arrays, so that somebody must count who holds them; the others only read and write given
ones. A study's own functions may do either."""


Functions = Mapping[Callable[..., Any], Callable[..., Any]]
NOTHING_INSTEAD: Functions = MappingProxyType({})


def compiled(
    function: Callable[..., Any], *, quick: bool = False, instead: Functions = NOTHING_INSTEAD
) -> Callable[..., Any]:
    """Return `function` compiled, with those it calls. InputError where numba is not installed.

    `quick`: with freedom in the order of arithmetic, see ARITHMETIC, without Python's error for a division by zero, and
    kept on disk for the next time (in NUMBA_CACHE_DIR, or the user's cache folder, where there is one).
    `instead`: what is called in place of functions that choose by the type of what they are given, as `law_step` does.
    """
    try:
        import numba
    except ImportError as exc:
        raise InputError("compiled studies need numba: pip install '.[fast]'") from exc
    _teach_remainder()
    done = dict[Any, Any]()
    jit = partial(_jit, quick=quick, is_called_by_python=False)
    for choosing, chosen in instead.items():
        done[choosing] = _compile(chosen, jit, done)
    ready: Callable[..., Any] = _jit(_with_compiled(function, jit, done), quick=quick, is_called_by_python=True)
    done[function] = ready
    if not quick:
        return ready
    before = numba.config.CACHE_DIR
    try:
        numba.config.CACHE_DIR = str(_cache_folder(before) / _fingerprint(done))
        # the outermost function's code holds all the others'
        ready.enable_caching()  # type: ignore[attr-defined]
    except RuntimeError:
        pass  # there is no folder to keep it in
    finally:
        numba.config.CACHE_DIR = before
    return ready


def is_kept(ready: Callable[..., Any]) -> bool:
    """Return whether compiled code of `ready`, which `compiled` made with `quick`, is on disk."""
    folder = ready.stats.cache_path  # type: ignore[attr-defined]
    return folder is not None and any(Path(folder).glob("*.nbc"))


def _jit(function: FunctionType, *, quick: bool, is_called_by_python: bool) -> Any:
    import numba

    # to be called by Python too, a function would have to take records of some hundred numbers apart: most of the work
    options: dict[str, Any] = {} if is_called_by_python else {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    if quick:
        allocates = _allocates(function)
        # called functions would be handed some hundred numbers each, and every array that they do not keep be counted
        options |= {"fastmath": _freedom(function), "error_model": "numpy"}
        options |= {"forceinline": not allocates, "_nrt": allocates}
    return numba.njit(**options)(function)


def _allocates(function: FunctionType) -> bool:
    return function.__name__ in ALLOCATING or not function.__module__.startswith(("autopilot.", "sitl."))


def _freedom(function: FunctionType) -> Any:
    """Return what the compilation may do to the arithmetic of a function; numba wants False for nothing."""
    return ARITHMETIC if f"{function.__module__}.{function.__name__}".startswith(REORDERED) else False


def _cache_folder(asked: str) -> Path:
    if asked:
        return Path(asked)
    chosen = os.environ.get("XDG_CACHE_HOME")
    return (Path(chosen) if chosen else Path.home() / ".cache") / "norrbin" / "compiled"


def _fingerprint(functions: Iterable[FunctionType]) -> str:
    """Return what changes when any of the functions, or a number that they use, does: numba looks at one file only."""
    import numba

    parts = [numba.__version__]
    for function in functions:
        fast = sorted(_freedom(function) or ()), _allocates(function)
        code, scope = function.__code__, function.__globals__
        used = {name: scope[name] for name in code.co_names if name in scope}
        values = {name: _text(value) for name, value in used.items() if isinstance(value, _Plain)}
        fields = {name: getattr(value, "_fields", None) for name, value in used.items()}
        parts.append(repr((function.__qualname__, code.co_code, code.co_consts, code.co_names, values, fields, fast)))
    return hashlib.sha256("\n".join(sorted(parts)).encode()).hexdigest()[:24]


_Plain = float | int | str | tuple | dict  # type: ignore[type-arg]  # for isinstance


def _text(value: Any) -> str:
    """Return a number or a collection as text, functions by their names: where they lie in memory differs from process
    to process."""
    if isinstance(value, dict):
        return f"{{{', '.join(f'{_text(key)}: {_text(each)}' for key, each in value.items())}}}"
    if isinstance(value, tuple):
        return f"({', '.join(map(_text, value))})"
    return f"{value.__module__}.{value.__qualname__}" if callable(value) else repr(value)


def _compile(function: Any, jit: Any, done: dict[Any, Any]) -> Any:
    if function not in done:
        done[function] = jit(_with_compiled(function, jit, done))
    return done[function]


def _with_compiled(function: Any, jit: Any, done: dict[Any, Any]) -> FunctionType:
    """Return a copy of `function` that calls what of ours it calls compiled."""
    called = function.__code__.co_names
    scope = dict(function.__globals__)
    for name in called:
        value = scope.get(name)
        if isinstance(value, FunctionType) and value.__module__.startswith(OURS):
            scope[name] = _compile(value, jit, done)
        elif isinstance(value, ModuleType) and value.__name__.startswith(OURS):
            scope[name] = _module(value, called, jit, done)
    closure = function.__closure__ and tuple(_cell(cell, jit, done) for cell in function.__closure__)
    copy = FunctionType(function.__code__, scope, function.__name__, function.__defaults__, closure)
    copy.__qualname__, copy.__module__ = function.__qualname__, function.__module__
    return copy


def _cell(cell: CellType, jit: Any, done: dict[Any, Any]) -> CellType:
    """Return what a function was made with, compiled where it is a function of ours."""
    value = cell.cell_contents
    is_ours = isinstance(value, FunctionType) and value.__module__.startswith(OURS)
    return CellType(_compile(value, jit, done)) if is_ours else cell


def _module(module: ModuleType, called: tuple[str, ...], jit: Any, done: dict[Any, Any]) -> ModuleType:
    """Return a stand-in for one of our modules, with those of its functions compiled that are called."""
    stand_in = ModuleType(module.__name__)
    for name, value in vars(module).items():
        is_called = name in called and isinstance(value, FunctionType) and value.__module__.startswith(OURS)
        setattr(stand_in, name, _compile(value, jit, done) if is_called else value)
    return stand_in


@functools.cache
def _teach_remainder() -> None:
    """Give numba math.remainder, which it lacks: IEEE 754 remainder by the exact modulo, as CPython does it."""
    from numba.extending import overload

    def remainder(x: float, y: float) -> float:
        size, step = abs(x), abs(y)
        left = size % step
        rest = step - left
        if left < rest:
            result = left
        elif left > rest:
            result = -rest
        else:
            # half way: to the even multiple
            result = left - 2.0 * (0.5 * (size - left) % step)
        return math.copysign(1.0, x) * result

    def remainder_of(x: float, y: float) -> Callable[[float, float], float]:
        return remainder

    overload(math.remainder)(remainder_of)
