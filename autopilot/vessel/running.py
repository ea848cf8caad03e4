"""What runs and what is stored: two vessels, and what of a change counts at once and what waits for a restart. Pure.

Each field of the schema says in its declaration whether it counts from the next tick (NOW) or from the next start on
(RESTART), because links were opened or the loop was begun with it.
"""

from __future__ import annotations

import dataclasses
import typing
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple, TypeVar

from autopilot.files.typed import hints_of
from autopilot.vessel.schema import NOW, Counts, Vessel

Section = TypeVar("Section")


class Vessels(NamedTuple):
    """`running`: what pilot and links work with; `stored`: what the next start reads.

    They are alike in every field that counts NOW.
    """

    running: Vessel
    stored: Vessel

    def storing(self, stored: Vessel) -> Vessels:
        """Return both with `stored` for the next start; what of it counts at once runs."""
        return Vessels(_running(self.running, stored), stored)

    @property
    def waiting(self) -> tuple[str, ...]:
        """The keys (`control.rate_hz`) that are stored otherwise than they run: they wait for a restart."""
        return tuple(_differing(self.running, self.stored, ""))


def counts_of(section: type[Any]) -> Mapping[str, Counts | None]:
    """Return from when on a change of each field of a section counts; None: it is a section, whose own fields say."""
    hints = hints_of(section)
    return {field.name: _counts(hints[field.name]) for field in dataclasses.fields(section)}


def _counts(hint: Any) -> Counts | None:
    """Return the mark in a type hint, be it that of an optional value's."""
    members = typing.get_args(hint)
    return next((each for each in members if isinstance(each, Counts)), None) or next(
        (found for each in members if typing.get_origin(each) is typing.Annotated and (found := _counts(each))), None
    )


def _running(running: Section, stored: Section) -> Section:
    """Return `running` with what of `stored` counts at once; an optional section comes and goes at once."""
    if running == stored or running is None or stored is None:
        return stored
    values: dict[str, Any] = {}
    for name, counts in counts_of(type(running)).items():
        runs, is_stored = getattr(running, name), getattr(stored, name)
        if counts is None:
            values[name] = _running(runs, is_stored)
        else:
            values[name] = is_stored if counts is NOW else runs
    return dataclasses.replace(running, **values)  # type: ignore[type-var]


def _differing(running: Any, stored: Any, path: str) -> Iterator[str]:
    for name, counts in counts_of(type(running)).items():
        runs, is_stored = getattr(running, name), getattr(stored, name)
        if runs == is_stored:
            continue
        if counts is None and runs is not None and is_stored is not None:
            yield from _differing(runs, is_stored, f"{path}{name}.")
        else:
            yield f"{path}{name}"
