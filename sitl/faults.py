"""Which of a scenario's faults are at work at a given time."""

from __future__ import annotations

from sitl.scenario import FaultKind, FaultSection


def is_at_work(faults: tuple[FaultSection, ...], kind: FaultKind, time: float) -> bool:
    """Return whether a fault of `kind` lasts at `time` [s] since the start: from_s <= time < to_s."""
    return any(fault.kind == kind and fault.from_s <= time < fault.to_s for fault in faults)
