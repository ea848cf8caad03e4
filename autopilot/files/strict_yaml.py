"""YAML read strictly: plain values that know where they stand, and one sentence for everything else.

What ordinary YAML readers let pass is closed here: duplicate keys, `no` taken for false, `010` taken for 8,
`1e3` taken for text, tags that build objects, anchors that expand without bound. The scalars are those of
YAML 1.2's core schema without octal: null, true, false, decimal and hexadecimal integers, decimal floats.

Files of another schema version are refused with what to do. Version 2 of vessel files names the recordings of a model
apart from its source; version 2 of firmware files has `include`, `leave_out`, and ranges, units and types of
parameters.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from autopilot.errors import InputError
from autopilot.files.outside import alike, as_utf8, read_regular

SIZE_MAX_BYTES = 4_000_000
DEPTH_MAX = 20
VALUES_MAX = 200_000
NUMBER_LENGTH_MAX = 60

_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
"""The C parser where PyYAML was built with it: 8 times faster, the same events."""

_NULL = frozenset({"", "~", "null", "Null", "NULL"})
_BOOLEANS = {"true": True, "True": True, "TRUE": True, "false": False, "False": False, "FALSE": False}
_INTEGER = re.compile(r"[-+]?(0|[1-9][0-9]*)")
_HEXADECIMAL = re.compile(r"0x[0-9a-fA-F]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|(0|[1-9][0-9]*)(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_LEADING_ZERO = re.compile(r"[-+]?0[0-9]+(\.[0-9]*)?([eE][-+]?[0-9]+)?")
_INFINITE = re.compile(r"[-+]?\.(inf|Inf|INF)")
_NOT_A_NUMBER = frozenset({".nan", ".NaN", ".NAN"})

Scalar = None | bool | int | float | str


class Node(NamedTuple):
    """A value and its place: `path` of keys from the root ("" at the root), 1-based `line` and `column`.

    `value` is a scalar, a list of nodes, or a dict from key to node; the dict keeps the file's order.
    `key_line` and `key_column` are the place of the key that leads here (the value's own in a list).
    """

    value: Scalar | list[Node] | dict[str, Node]
    file: str
    path: str
    line: int
    column: int
    key_line: int
    key_column: int

    def fault(self, sentence: str) -> InputError:
        """Return the error `FILE, line L, column C: SENTENCE` that points at this value."""
        return _at_place(self.file, self.line, self.column, sentence)

    def key_fault(self, sentence: str) -> InputError:
        """Return the error that points at the key of this value."""
        return _at_place(self.file, self.key_line, self.key_column, sentence)

    def at(self, *keys: str) -> Node:
        """Return the node that `keys` lead to from this one, or the deepest existing one on the way."""
        node = self
        for key in keys:
            if not isinstance(node.value, dict) or key not in node.value:
                break
            node = node.value[key]
        return node


def read_document(path: str | Path) -> Node:
    """Return the root node of the YAML file at `path`; raises InputError with the one sentence that says why not."""
    return parse_document(text_of(path), str(path))


def text_of(path: str | Path) -> str:
    """Return the text in a file of parameters; raises InputError with the one sentence that says why not."""
    try:
        data = read_regular(path, SIZE_MAX_BYTES + 1)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file{alike(path) or '; check the name and the folder.'}") from None
    except IsADirectoryError:
        raise InputError(f"{path}: this is a folder, a file is needed.") from None
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise InputError(f"{path}: cannot be read ({reason}).") from None
    if len(data) > SIZE_MAX_BYTES:
        raise InputError(f"{path}: larger than {SIZE_MAX_BYTES} bytes, which no parameter file needs.")
    try:
        data = as_utf8(data)
        if b"\0" in data:
            raise InputError(f"{path}: is no text; a file of parameters (YAML) is needed.")
        return data.decode()
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise InputError(
            f"{path}, line {line}: byte {error.start} is not {error.encoding.upper()} text; save the file as UTF-8."
        ) from None


def parse_document(text: str, file: str = "<text>") -> Node:
    """Return the root node of the YAML `text`; `file` is the name used in messages. Raises InputError."""
    if len(text) > SIZE_MAX_BYTES:
        raise InputError(f"{file}: larger than {SIZE_MAX_BYTES} characters, which no parameter file needs.")
    try:
        root = _Reader(text, file).document()
    except yaml.MarkedYAMLError as error:
        raise InputError(_syntax_sentence(error, file, text)) from None
    except (yaml.YAMLError, UnicodeError) as error:
        reason = " ".join(str(error).split())
        raise InputError(f"{file}: holds characters that YAML does not allow ({reason}).") from None
    return root


def plain(node: Node) -> Any:
    """Return the node's value as plain dicts, lists and scalars, without places."""
    if isinstance(node.value, dict):
        return {key: plain(child) for key, child in node.value.items()}
    if isinstance(node.value, list):
        return [plain(child) for child in node.value]
    return node.value


def _syntax_sentence(error: yaml.MarkedYAMLError, file: str, text: str) -> str:
    mark = error.problem_mark or error.context_mark
    place = f"{file}, line {mark.line + 1}, column {mark.column + 1}" if mark else file
    lines = text.splitlines()
    if mark and mark.line < len(lines) and "\t" in lines[mark.line][: mark.column + 1]:
        return f"{place}: not valid YAML: there is a tab; indent with spaces."
    what = ", ".join(part for part in (error.context, error.problem) if part)
    return f"{place}: not valid YAML: {what}."


def _at_place(file: str, line: int, column: int, sentence: str) -> InputError:
    """One line, also where a key or value quoted in the sentence holds line breaks."""
    return InputError(f"{file}, line {line}, column {column}: {' '.join(sentence.split())}")


class _Reader:
    """Builds the nodes from the parser's events, refusing as it goes, so that nothing large is ever built."""

    def __init__(self, text: str, file: str) -> None:
        self._file = file
        self._events: Iterator[Any] = iter(yaml.parse(text, Loader=_Loader))
        self._values = 0

    def document(self) -> Node:
        next(self._events)  # stream start
        event = next(self._events)
        if isinstance(event, yaml.StreamEndEvent):
            raise InputError(f"{self._file}: empty; it must hold keys and values.")
        root = self._value(next(self._events), "", None, 0)
        next(self._events)  # document end
        event = next(self._events)
        if not isinstance(event, yaml.StreamEndEvent):
            raise self._fault(event.start_mark, "a second document begins; one file holds one document.")
        return root

    def _fault(self, mark: Any, sentence: str) -> InputError:
        return _at_place(self._file, mark.line + 1, mark.column + 1, sentence)

    def _value(self, event: Any, path: str, key_mark: Any, depth: int) -> Node:
        mark = event.start_mark
        self._refuse_indirection(event, path)
        self._values += 1
        if self._values > VALUES_MAX:
            raise self._fault(mark, f"more than {VALUES_MAX} values, which no parameter file needs.")
        if depth > DEPTH_MAX:
            raise self._fault(mark, f"nested deeper than {DEPTH_MAX} levels, which no parameter file needs.")
        if isinstance(event, yaml.MappingStartEvent):
            value: Any = self._mapping(path, depth)
        elif isinstance(event, yaml.SequenceStartEvent):
            value = self._sequence(path, depth)
        else:
            value = self._scalar(event, path)
        key_mark = key_mark or mark
        return Node(value, self._file, path, mark.line + 1, mark.column + 1, key_mark.line + 1, key_mark.column + 1)

    def _refuse_indirection(self, event: Any, path: str) -> None:
        where = f" at {path}" if path else ""
        if isinstance(event, yaml.AliasEvent) or event.anchor is not None:
            raise self._fault(
                event.start_mark, f"the anchor or alias '{event.anchor}'{where} is not allowed; write the value out."
            )
        if event.tag is not None and event.tag != "!":
            raise self._fault(
                event.start_mark, f"the tag '{event.tag}'{where} is not allowed; plain values need no tags."
            )

    def _mapping(self, path: str, depth: int) -> dict[str, Node]:
        mapping: dict[str, Node] = {}
        for event in self._events:
            if isinstance(event, yaml.MappingEndEvent):
                break
            key = self._key(event, path)
            key_path = f"{path}.{key}" if path else key
            if key in mapping:
                first = mapping[key].key_line
                raise self._fault(
                    event.start_mark, f"the key {key_path} is given twice, first on line {first}; keep one of them."
                )
            mapping[key] = self._value(next(self._events), key_path, event.start_mark, depth + 1)
        return mapping

    def _key(self, event: Any, path: str) -> str:
        where = f" in {path}" if path else ""
        self._refuse_indirection(event, path)
        if not isinstance(event, yaml.ScalarEvent):
            raise self._fault(event.start_mark, f"a list or mapping stands as a key{where}; a key is one word.")
        key = str(event.value)
        if key in ("", "<<"):
            raise self._fault(event.start_mark, f"'{key}' stands as a key{where}; a key is one word.")
        return key

    def _sequence(self, path: str, depth: int) -> list[Node]:
        items: list[Node] = []
        for event in self._events:
            if isinstance(event, yaml.SequenceEndEvent):
                break
            items.append(self._value(event, f"{path}[{len(items)}]", None, depth + 1))
        return items

    def _scalar(self, event: Any, path: str) -> Scalar:
        text = str(event.value)
        if not event.implicit[0]:  # quoted or block text is text, whatever it looks like
            return text
        try:
            return resolve_plain(text)
        except ValueError as error:
            raise self._fault(event.start_mark, f"{path or 'the document'}: {error}") from None


def resolve_plain(text: str) -> Scalar:
    """Return what the unquoted scalar `text` means; raises ValueError for numbers that mislead or overflow."""
    if text in _NULL:
        return None
    if text in _BOOLEANS:
        return _BOOLEANS[text]
    if _INFINITE.fullmatch(text):
        return -math.inf if text.startswith("-") else math.inf
    if text in _NOT_A_NUMBER:
        return math.nan
    if _LEADING_ZERO.fullmatch(text):
        decimal = text.lstrip("+-").lstrip("0") or "0"
        raise ValueError(
            f"{_shortened(text)} begins with a zero, which some readers take for octal; write "
            f"{_shortened(decimal)}, or put it in quotes if it is text."
        )
    return _number(text)


def _number(text: str) -> int | float | str:
    integer = _INTEGER.fullmatch(text) or _HEXADECIMAL.fullmatch(text)
    if not integer and not _FLOAT.fullmatch(text):
        return text
    if len(text) > NUMBER_LENGTH_MAX:
        raise ValueError(f"the number {_shortened(text)} has more than {NUMBER_LENGTH_MAX} characters; shorten it.")
    if integer:
        return int(text, 0)
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"the number {text} is too large for a computer; write a smaller one.")
    return number


def _shortened(text: str) -> str:
    return text if len(text) <= 40 else text[:37] + "..."


def check_version(root: Node, known: int, kind: str) -> None:
    """Raise InputError where a document is of another schema version than `known`, that of a `kind` of file; one that
    says none, or no whole number, is left to the schema, whose own sentence is the right one."""
    version = root.at("schema_version")
    if version is root or not isinstance(version.value, int) or isinstance(version.value, bool):
        return
    if version.value != known:
        advice = f"update Norrbin, or give a {kind}" if version.value > known else f"write {known}"
        raise version.fault(f"schema_version is {version.value}, a {kind} of this Norrbin has {known}; {advice}.")
