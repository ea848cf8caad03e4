"""From a YAML node to a frozen dataclass by its type hints, with one sentence for everything that does not fit.

Understood: bool, int, float, str, `Literal`, `X | None`, `Annotated[number, Bounds(...)]`, nested dataclasses,
`tuple[X, ...]`, `tuple[X, Y]` and `dict[str, X]`. Every key must be a field; every field without a default must
be there.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import types
import typing
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar, Union

from autopilot.errors import InputError, SeveralInputError
from autopilot.files.strict_yaml import Node, parse_document, read_document

if TYPE_CHECKING:
    from importlib.resources.abc import Traversable

T = TypeVar("T")


class Bounds(NamedTuple):
    """Closed range of a number (`None`: no bound) and what it means, in a few words; of a choice the meaning alone.

    usual: what real ones lie within, where that is less than what is allowed: beyond it a number is taken and doubted.
    """

    low: float | None
    high: float | None
    doc: str
    usual: tuple[float, float] | None = None


Positive = 1.0e-9
"""The least of a number that must be above 0."""


class Counts(Enum):
    """From when on a field that is changed while the pilot runs counts: the next tick, or the next start of the
    process, because links were opened or the loop was begun with it. A section counts as its fields do."""

    NOW = "now"
    RESTART = "restart"


NOW, RESTART = Counts.NOW, Counts.RESTART

UNIT_SUFFIXES = (
    *("_s2_rad2", "_s2_deg2", "_s_rad", "_s_deg", "_rad_s2", "_deg_s2", "_rad_s", "_deg_s", "_deg_min", "_rad", "_deg"),
    *("_m_s2", "_m_s", "_km_h", "_kmh", "_kn", "_kt", "_knots", "_mm", "_cm", "_km", "_nm", "_ft", "_m"),
    *(
        "_1_s2",
        "_1_s",
        "_s_m",
        "_ms",
        "_us",
        "_min",
        "_hz",
        "_khz",
        "_s",
        "_n",
        "_kn_m",
        "_kg",
        "_t",
        "_pwm",
        "_percent",
    ),
)
"""Ends of key names that say a unit, so that a wrong unit is distinguished from an unknown key."""


_HINTS: dict[type[Any], dict[str, Any]] = {}


def hints_of(section: type[Any]) -> dict[str, Any]:
    """Return the type hints of a dataclass's fields, by name, with what is annotated; evaluated once."""
    if section not in _HINTS:
        _HINTS[section] = typing.get_type_hints(section, include_extras=True)
    return _HINTS[section]


def read(node: Node, schema: type[T]) -> T:
    """Return the dataclass `schema` filled from `node`; raises InputError with one sentence."""
    return typing.cast(T, _convert(node, schema, None))


class _Mistakes:
    """Collects what is wrong in the parts of one whole, so that all of it can be said at once."""

    def __init__(self) -> None:
        self._found: list[InputError] = []

    def add(self, error: InputError) -> None:
        self._found += error.each()

    def convert(self, node: Node, hint: Any, bounds: Bounds | None) -> Any:
        try:
            return _convert(node, hint, bounds)
        except InputError as error:
            self.add(error)
            return None

    def raise_any(self) -> None:
        if self._found:
            raise self._found[0] if len(self._found) == 1 else SeveralInputError(self._found)


def _convert(node: Node, hint: Any, bounds: Bounds | None) -> Any:
    origin = typing.get_origin(hint)
    if origin is typing.Annotated:
        base, *extras = typing.get_args(hint)
        return _convert(node, base, next((extra for extra in extras if isinstance(extra, Bounds)), bounds))
    if origin in (Union, types.UnionType):
        return _convert_union(node, hint, bounds)
    if origin is Literal:
        return _convert_literal(node, typing.get_args(hint))
    if origin is tuple:
        return _convert_tuple(node, hint, bounds)
    if origin is dict:
        return _convert_dict(node, hint, bounds)
    if dataclasses.is_dataclass(hint) and isinstance(hint, type):
        return _convert_dataclass(node, hint)
    return _convert_scalar(node, hint, bounds)


def _convert_union(node: Node, hint: Any, bounds: Bounds | None) -> Any:
    members = typing.get_args(hint)
    if node.value is None and type(None) in members:
        return None
    others = [member for member in members if member is not type(None)]
    if len(others) == 1:
        if node.value is None or _fits_kind(node.value, others[0]):
            return _convert(node, others[0], bounds)
        raise _wrong(node, hint, bounds)
    for member in others:
        if _fits_kind(node.value, member):
            return _convert(node, member, bounds)
    raise _wrong(node, hint, bounds)


def _fits_kind(value: Any, hint: Any) -> bool:
    """Whether a union member is the one meant, from the kind of value alone (its range is checked afterwards)."""
    origin = typing.get_origin(hint)
    if origin is typing.Annotated:
        return _fits_kind(value, typing.get_args(hint)[0])
    if origin is Literal:
        return any(type(value) is type(allowed) and value == allowed for allowed in typing.get_args(hint))
    if origin is tuple:
        return isinstance(value, list)
    if origin is dict or dataclasses.is_dataclass(hint):
        return isinstance(value, dict)
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool)
    return type(value) is hint


def _convert_literal(node: Node, allowed: tuple[Any, ...]) -> Any:
    for value in allowed:
        if type(node.value) is type(value) and node.value == value:
            return node.value
    words = ", ".join(str(value) for value in allowed)
    hint = f"; did you mean {near}?" if (near := nearest(str(node.value), [str(value) for value in allowed])) else "."
    raise node.fault(f"{_name(node)} is {_show(node)}, allowed are {words}{hint}")


def _convert_tuple(node: Node, hint: Any, bounds: Bounds | None) -> tuple[Any, ...]:
    if not isinstance(node.value, list):
        raise _wrong(node, hint, bounds)
    members = typing.get_args(hint)
    if len(members) == 2 and members[1] is Ellipsis:
        mistakes = _Mistakes()
        items = tuple(mistakes.convert(item, members[0], bounds) for item in node.value)
        mistakes.raise_any()
        return items
    if len(node.value) != len(members):
        raise node.fault(f"{_name(node)} has {len(node.value)} entries, {len(members)} are needed.")
    return tuple(_convert(item, member, bounds) for item, member in zip(node.value, members, strict=True))


def _convert_dict(node: Node, hint: Any, bounds: Bounds | None) -> dict[str, Any]:
    if not isinstance(node.value, dict):
        raise _wrong(node, hint, bounds)
    member = typing.get_args(hint)[1]
    mistakes = _Mistakes()
    values = {key: mistakes.convert(child, member, bounds) for key, child in node.value.items()}
    mistakes.raise_any()
    return values


def _convert_dataclass(node: Node, schema: type[Any]) -> Any:
    if not isinstance(node.value, dict):
        raise _wrong(node, schema, None)
    hints = hints_of(schema)
    fields = {field.name: field for field in dataclasses.fields(schema) if field.init}
    mistakes = _Mistakes()
    for key, child in node.value.items():
        if key not in fields:
            sentence = unknown_key_sentence(key, list(fields), node.path, given=list(node.value))
            mistakes.add(child.key_fault(sentence))
    for name, field in fields.items():
        optional = field.default is not dataclasses.MISSING or field.default_factory is not dataclasses.MISSING
        if name not in node.value and not optional:
            path = f"{node.path}.{name}" if node.path else name
            mistakes.add(node.fault(f"the key {path} is missing; give {_describe(hints[name], None)}."))
    values = {key: mistakes.convert(child, hints[key], None) for key, child in node.value.items() if key in fields}
    mistakes.raise_any()
    try:
        return schema(**values)
    except ValueError as error:
        raise node.fault(str(error)) from None


def unknown_key_sentence(key: str, known: list[str], path: str = "", given: list[str] | None = None) -> str:
    """Return the sentence for a `key` that is not `known`: wrong unit, misspelling, or simply unknown.

    `given` are the keys that are there already: they are not proposed again.
    """
    where = f"{path}.{key}" if path else key
    free = [name for name in known if name not in (given or ())]
    stem = _stem(key)
    for name in free:
        if name != _stem(name) and _stem(name) == stem:
            return f"{where} is not a known key: the unit is in the key, use {name}."
    if near := nearest(key, known):
        return f"{where} is not a known key; did you mean {near}?"
    return f"{where} is not a known key; known here are {', '.join(known)}."


def nearest(word: str, known: list[str]) -> str | None:
    """Return the known word most like `word`, or None where none is alike."""
    folded = {name.casefold(): name for name in known}
    matches = difflib.get_close_matches(word.casefold(), list(folded), n=1, cutoff=0.6)
    return folded[matches[0]] if matches else None


class Shipped(NamedTuple):
    """The YAML files of one kind that come with the product: in a `folder` of a `package`, and what they are called."""

    package: str
    folder: str
    kind: str

    def names(self) -> list[str]:
        """Return their names, without the suffix."""
        names = (entry.name for entry in self._place().iterdir())
        return sorted(name.removesuffix(".yaml") for name in names if name.endswith(".yaml"))

    def document(self, path_or_name: str | Path, also: tuple[str, ...] = ()) -> Node:
        """Return the root node of a file, or of the shipped one of that name. Raises InputError.

        `also` are names that the sentences about what is not there know too.
        """
        path, name, shipped = Path(path_or_name), str(path_or_name), self.names()
        if is_path(path_or_name):
            if not path.exists() and path.name == name and path.stem in (*shipped, *also):
                raise InputError(
                    f"{path}: no such file here; the shipped file is named {path.stem}, without the suffix."
                )
            return read_document(path)
        if name not in shipped:
            begun = [each for each in (*shipped, *also) if each.startswith(name)]
            near = " or ".join(begun) or nearest(name, [*shipped, *also])
            hint = f"did you mean {near}?" if near else f"shipped are {', '.join([*shipped, *also])}."
            for folder in self._package().iterdir():
                if (folder / f"{name}.yaml").is_file():
                    raise InputError(f"{name}: a shipped file of another kind ({folder.name}); {hint}")
            raise InputError(f"{name}: neither a file nor {self.kind}; {hint}")
        text = (self._place() / f"{name}.yaml").read_text(encoding="utf-8")
        return parse_document(text, f"{name}.yaml (shipped)")

    def _place(self) -> Traversable:
        return self._package() / self.folder

    def _package(self) -> Traversable:
        from importlib import resources  # what runs a boat from a path does without

        return resources.files(self.package)


def is_path(path_or_name: str | Path) -> bool:
    """Return whether a file is meant, no shipped one's name: what has a folder or a suffix in it, and a file that is
    there; a folder of logs may well be called as the boat is."""
    path = Path(path_or_name)
    return (path.exists() and not path.is_dir()) or bool(path.suffix) or path.name != str(path_or_name)


def _stem(key: str) -> str:
    folded = key.casefold()
    for suffix in sorted(UNIT_SUFFIXES, key=len, reverse=True):
        if folded.endswith(suffix) and len(folded) > len(suffix):
            return folded.removesuffix(suffix)
    return folded


def _convert_scalar(node: Node, hint: Any, bounds: Bounds | None) -> Any:
    value = node.value
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        try:
            value = float(value)
        except OverflowError:
            raise _wrong(node, hint, bounds) from None
    if hint not in (bool, int, float, str):
        raise TypeError(f"the schema holds a type that cannot be read from YAML: {hint!r}")
    if type(value) is not hint:
        raise _wrong(node, hint, bounds)
    if isinstance(value, float) and not math.isfinite(value):
        raise _wrong(node, hint, bounds)
    if bounds and isinstance(value, int | float) and not _inside(value, bounds):
        raise _wrong(node, hint, bounds)
    return value


def _inside(value: float, bounds: Bounds) -> bool:
    return (bounds.low is None or value >= bounds.low) and (bounds.high is None or value <= bounds.high)


def _wrong(node: Node, hint: Any, bounds: Bounds | None) -> InputError:
    needed = _describe(hint, bounds)
    advice = ""
    if isinstance(node.value, str) and "number" in needed:
        advice = "; write the bare number, the unit is in the key" if node.value[:1].isdigit() else ""
    if isinstance(node.value, str) and "true or false" in needed:
        advice = "; yes, no, on and off are text in YAML 1.2"
    return node.fault(f"{_name(node)} is {_show(node)}, needed is {needed}{advice}.")


def _name(node: Node) -> str:
    return node.path or "the document"


def _show(node: Node) -> str:
    value = node.value
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return "a list"
    if value is None:
        return "null or empty"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"the text '{value if len(value) <= 60 else value[:57] + '...'}'"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _describe(hint: Any, bounds: Bounds | None) -> str:
    origin = typing.get_origin(hint)
    arguments = typing.get_args(hint)
    if origin is typing.Annotated:
        return _describe(arguments[0], next((extra for extra in arguments[1:] if isinstance(extra, Bounds)), bounds))
    if origin in (Union, types.UnionType):
        words = [_describe(member, bounds) for member in arguments if member is not type(None)]
        return ", or ".join([*words, "null"] if type(None) in arguments else words)
    if origin is Literal:
        return "one of " + ", ".join(str(value) for value in arguments)
    if origin is tuple:
        return "a list"
    if origin is dict or dataclasses.is_dataclass(hint):
        return "a mapping of keys and values"
    kinds = {bool: "true or false", int: "a whole number", float: "a finite number", str: "text"}
    kind = kinds.get(hint, str(hint))
    return kind + _range(bounds) if hint in (int, float) else kind


def _range(bounds: Bounds | None) -> str:
    if bounds is None:
        return ""
    if bounds.low is not None and bounds.high is not None:
        words = f" from {bounds.low:g} to {bounds.high:g}"
    elif bounds.low is not None:
        words = f" of at least {bounds.low:g}"
    elif bounds.high is not None:
        words = f" of at most {bounds.high:g}"
    else:
        words = ""
    return f"{words} ({bounds.doc})"
