"""Faults of the lines to the boat; `sitl.serve` makes them as bad as these say."""

from __future__ import annotations

from sitl.fault_kind import Kind

_CHANCE = ("share of packets", 0.0, 1.0)


def _chance(what: str, size: float) -> Kind:
    unit, low, high = _CHANCE
    return Kind(what, unit, size, low, high)


KINDS = {
    "silence": Kind("the boat sends nothing at all", is_tabled=True),
    "link_deaf": Kind("nothing that is sent to the boat arrives"),
    "link_half_open": Kind("nothing arrives either way, without an error"),
    "link_loss": _chance("packets are lost", 0.3),
    "link_delay": Kind("packets come late", "s", 0.3, 0.0, 30.0),
    "link_jitter": Kind("packets come late by up to", "s", 0.3, 0.0, 30.0),
    "link_duplicate": _chance("packets come twice", 0.3),
    "link_reorder": _chance("packets are overtaken by the next ones", 0.3),
    "link_corrupt": _chance("packets have changed bytes", 0.3),
    "link_truncate": _chance("packets are cut short", 0.3),
    "link_flood": Kind("noise comes in between", "packets/s", 500.0, 0.0, 20000.0),
}
