"""What became of each parameter of an upload, and what an upload changes, for the journal and the way back."""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

from autopilot.params.value_coding import Number


class Verdict(StrEnum):
    """What became of a parameter."""

    UNCHANGED = "unchanged"
    SET = "set"
    WOULD_SET = "would set"
    DIFFERENT = "differs"
    CONSTRAINED = "constrained"
    REJECTED = "rejected"
    UNKNOWN = "unknown"
    UNCONFIRMED = "unconfirmed"


GOOD = frozenset({Verdict.UNCHANGED, Verdict.SET})


class Outcome(NamedTuple):
    """One parameter of the file after the upload. `old` and `now` are None where the vehicle gave no answer."""

    name: str
    old: Number | None
    wanted: Number
    now: Number | None
    verdict: Verdict
    reason: str = ""
    reboot: bool = False

    @property
    def is_good(self) -> bool:
        """Whether the vehicle holds what was wanted."""
        return self.verdict in GOOD


class Change(NamedTuple):
    """One parameter that an upload changes: its MAV_PARAM_TYPE, the value before and the value wanted."""

    name: str
    kind: int
    old: Number
    new: Number


ENABLING_ENDS = ("_ENABLE", "_ENABLED", "_EN", "_TYPE", "_MONITOR")
"""Ends of the names of ArduPilot parameters that bring the rest of their group into being (AP_PARAM_FLAG_ENABLE)."""


def enabled_group(name: str) -> str | None:
    """Return the beginning of the names in the group that parameter `name` switches: `GRP_` for `GRP_ENABLE`."""
    for end in ENABLING_ENDS:
        if name.endswith(end) and len(name) > len(end):
            return name.removesuffix(end) + "_"
    return None
