"""The JSON that commands print: null where a number is not finite, for JSON has no word for that."""

from __future__ import annotations

import json
import math
from typing import Any


def json_text(found: Any, indent: int | None = 2) -> str:
    """Return `found`, of dicts, sequences, texts, numbers and None, as JSON that every reader takes."""
    return json.dumps(_with_null(found), indent=indent, allow_nan=False)


def _with_null(value: Any) -> Any:
    if isinstance(value, dict):
        return {name: _with_null(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [_with_null(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
