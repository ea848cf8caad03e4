"""Faults of the lines to the boat, on which packets are lost, late or changed."""

from __future__ import annotations

from collections.abc import Callable

from sitl.fault_kind import Acting, Damage, Kind


def still(fault: Acting, damage: Damage) -> Damage:
    """Return a line over which nothing passes."""
    return damage._replace(still=True)


def _bad(field: str) -> Callable[[Acting, Damage], Damage]:
    """Return what gives one field of the damage the fault's size."""
    return lambda fault, damage: Damage(**damage._asdict() | {field: fault.size})


def _chance(what: str, size: float, field: str) -> Kind:
    return Kind(what, "share of packets", size, 0.0, 1.0, line=_bad(field))


KINDS = {
    "link_deaf": Kind("nothing that is sent to the boat arrives", to_boat=still),
    "link_loss": _chance("packets are lost", 0.3, "loss"),
    "link_delay": Kind("packets come late", "s", 0.3, 0.0, 30.0, line=_bad("delay")),
    "link_jitter": Kind("packets come late by up to", "s", 0.3, 0.0, 30.0, line=_bad("jitter")),
    "link_duplicate": _chance("packets come twice", 0.3, "duplicate"),
    "link_reorder": _chance("packets are overtaken by the next ones", 0.3, "reorder"),
    "link_corrupt": _chance("packets have changed bytes", 0.3, "corrupt"),
    "link_truncate": _chance("packets are cut short", 0.3, "truncate"),
    "link_flood": Kind("noise comes in between", "packets/s", 500.0, 0.0, 20000.0, line=_bad("flood")),
    "link_half_open": Kind("nothing arrives either way, without an error", line=still),
}
