"""Files changed in place: what is to change changes, comments, order and everything else stay as they were.

Needs ruamel.yaml (the extra `edit`). Where a file is exactly what Norrbin writes, nothing would be lost, and it is
simply written anew.
"""

from __future__ import annotations

import importlib
import io
from collections import Counter
from collections.abc import Mapping
from typing import Any

from autopilot.errors import InputError
from autopilot.params.migration import FIRMWARE_STEPS, VESSEL_STEPS, migrated
from autopilot.params.strict_yaml import parse_document, plain
from autopilot.params.vessel import Vessel
from autopilot.params.vessel_file import dump_vessel, parse_vessel

NULL_TAG = "tag:yaml.org,2002:null"
EXTRA = "pip install '.[edit]'"


def updated_vessel_text(text: str, vessel: Vessel, file: str) -> str:
    """Return the vessel file `text` with the values of `vessel`; comments and order stay.

    A file whose only comments are those that Norrbin writes beside its values is written anew. Raises InputError where
    the text cannot be read, or where it has comments of its own and ruamel.yaml is not installed.
    """
    before = parse_vessel(text, file)
    if not _comments(text) - _comments(dump_vessel(before)):
        return dump_vessel(vessel)
    old, new = (plain(parse_document(dump_vessel(each))) for each in (before, vessel))
    return _checked(edited_text(text, old, new, file), vessel, file)


def _comments(text: str) -> Counter[str]:
    """Return what stands behind a # on each line: comments, and at worst some quoted text, which is kept as well."""
    return Counter(line.partition("#")[2].strip() for line in text.splitlines() if "#" in line)


def _checked(text: str, vessel: Vessel, file: str) -> str:
    if parse_vessel(text, file) != vessel:
        raise InputError(
            f"{file}: cannot be changed in place without losing something; give another name for the result."
        )
    return text


def migrated_text(text: str, file: str, *, is_vessel: bool) -> str:
    """Return a vessel or firmware file `text` as the newest schema version has it. Raises InputError."""
    root = parse_document(text, file)
    newer = migrated(root, VESSEL_STEPS if is_vessel else FIRMWARE_STEPS)
    return text if newer == root else edited_text(text, plain(root), plain(newer), file)


def edited_text(text: str, old: Mapping[str, Any], new: Mapping[str, Any], file: str) -> str:
    """Return `text` with every value changed that differs between `old` and `new`. Raises InputError."""
    if old == new:
        return text
    try:
        ruamel = importlib.import_module("ruamel.yaml")
    except ModuleNotFoundError:
        raise InputError(
            f"{file}: has comments of its own, and keeping them needs ruamel.yaml; install it with "
            f"{EXTRA}, or give another name for the result."
        ) from None
    yaml = ruamel.YAML()  # round trip
    yaml.preserve_quotes = True
    yaml.width = 10**6
    # a null that was written out is not left out
    yaml.representer.add_representer(type(None), lambda dumper, _: dumper.represent_scalar(NULL_TAG, "null"))
    document = yaml.load(text)
    _apply(document, old, new)
    result = io.StringIO()
    yaml.dump(document, result)
    return result.getvalue()


def _apply(document: Any, old: Mapping[str, Any], new: Mapping[str, Any]) -> None:
    for key, value in new.items():
        before = old.get(key)
        if isinstance(value, dict) and isinstance(before, dict) and key in document:
            _apply(document[key], before, value)
        elif key not in old or before != value:
            document[key] = value
    for key in old:
        if key not in new and key in document:
            del document[key]
