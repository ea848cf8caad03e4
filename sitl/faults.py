"""Which faults are at work at a given time, how large they are, and since when."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from sitl.fault_kinds import KINDS, FaultKind, Source
from sitl.scenario import FaultSection

MOST_OCCURRENCES = 10000
"""Of one fault that comes and goes at random."""


class Fault(NamedTuple):
    """One fault from `begin` to before `end` [s since the start]; its size grows from 0 over `ramp` [s].

    source: which of two compasses has it.
    """

    kind: FaultKind
    begin: float
    end: float
    size: float
    ramp: float = 0.0
    source: Source = "both"

    def hits(self, source: Source) -> bool:
        """Return whether it is a fault of `source`."""
        return self.source in ("both", source)

    def size_at(self, time: float) -> float | None:
        """Return the size at `time` [s], None where the fault is not at work."""
        if not self.begin <= time < self.end:
            return None
        return self.size if self.ramp <= 0.0 else self.size * min((time - self.begin) / self.ramp, 1.0)


class FaultBoard:
    """The faults of one run: those of the scenario, and those that are added while it runs."""

    def __init__(self, sections: Iterable[FaultSection] = (), seed: np.random.SeedSequence | None = None) -> None:
        rng = np.random.default_rng(np.random.SeedSequence(0) if seed is None else seed)
        self._faults: dict[FaultKind, list[Fault]] = {}
        for section in sections:
            for fault in _occurrences(section, rng):
                self.add(fault)

    def __bool__(self) -> bool:
        return bool(self._faults)

    def add(self, fault: Fault) -> None:
        """Add a fault, now or later."""
        self._faults.setdefault(fault.kind, []).append(fault)

    def clear(self, time: float, kind: FaultKind | None = None) -> int:
        """End every fault of `kind`, or of any, that is at work or to come; return how many."""
        ended = 0
        for each in list(self._faults) if kind is None else [kind]:
            kept = []
            for fault in self._faults.get(each, ()):
                ended += fault.end > time
                if fault.begin < time:
                    kept.append(fault._replace(end=min(fault.end, time)))
            self._faults[each] = kept
        return ended

    def size(self, kind: FaultKind, time: float, source: Source = "first") -> float | None:
        """Return the size of the fault of `source` at `time` [s], of several the last added; None where it has none."""
        for fault in reversed(self._faults.get(kind, ())):
            size = fault.size_at(time) if fault.hits(source) else None
            if size is not None:
                return size
        return None

    def is_on(self, kind: FaultKind, time: float, source: Source = "first") -> bool:
        """Return whether a fault of `kind` is at work in `source` at `time` [s]."""
        return kind in self._faults and self.size(kind, time, source) is not None

    def lasted(self, kind: FaultKind, time: float, source: Source = "first") -> float:
        """Return how long [s] the fault has been at work in `source` at `time`; 0 where it is not."""
        faults = self._faults.get(kind, ())
        on = [fault for fault in faults if fault.hits(source) and fault.size_at(time) is not None]
        return time - on[-1].begin if on else 0.0

    def at_work(self, time: float) -> list[Fault]:
        """Return the faults at work at `time` [s], by the order of their kinds."""
        every = [fault for kind in KINDS for fault in self._faults.get(kind, ())]
        return [fault for fault in every if fault.size_at(time) is not None]


def fault_of(section: FaultSection) -> Fault:
    """Return the fault of a section that does not come and go."""
    size = KINDS[section.kind].size if section.size is None else section.size
    end = math.inf if section.to_s is None else section.to_s
    return Fault(section.kind, section.from_s, end, size, section.ramp_s, section.source)


def _occurrences(section: FaultSection, rng: np.random.Generator) -> list[Fault]:
    """The fault itself, or, where it comes and goes, its occurrences: a Poisson process of `every_s`."""
    whole = fault_of(section)
    if section.every_s is None:
        return [whole]
    found: list[Fault] = []
    time = whole.begin + rng.exponential(section.every_s)
    while time < whole.end and len(found) < MOST_OCCURRENCES:
        end = min(time + section.lasts_s, whole.end)
        found.append(whole._replace(begin=float(time), end=float(end)))
        time = end + rng.exponential(section.every_s)
    return found
