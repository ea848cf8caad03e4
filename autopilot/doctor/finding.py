"""One thing that was looked at: what was found, whether one can go to sea with it, why not, and the cure."""

from __future__ import annotations

from collections.abc import Iterable
from enum import IntEnum
from typing import NamedTuple


class Verdict(IntEnum):
    """Go; go, but better this were mended; no go."""

    GO = 0
    WARN = 1
    NO_GO = 2


class Finding(NamedTuple):
    """`found` is said in any case; `cure` says what to do where the verdict is not GO. figures: the same as numbers."""

    name: str
    verdict: Verdict
    found: str
    cure: str = ""
    figures: dict[str, float] = {}  # noqa: RUF012 - never changed


def worst(findings: Iterable[Finding]) -> Verdict:
    """Return the verdict on all of them."""
    return max((finding.verdict for finding in findings), default=Verdict.GO)


def share_below(values: list[float], share: float) -> float:
    """Return the value below which `share` of `values` lie; nan where there are none."""
    return sorted(values)[min(len(values) - 1, int(share * len(values)))] if values else float("nan")
