"""The law that leaves the rudder where it is: for trials, which order rudder angles, and where others steer."""

from __future__ import annotations

from typing import NamedTuple

from autopilot.control.law import Law, LawBoat, LawInput, NoMemory

TRIAL_LAW = "trial"
"""In place of a law's name: trials order rudder angles and need no gains."""


class NoGains(NamedTuple):
    """A law without gains."""


def gains_of(section: object, boat: LawBoat) -> NoGains:
    """Return no gains."""
    return NoGains()


def step(gains: NoGains, memory: NoMemory, given: LawInput) -> tuple[float, NoMemory]:
    """Return the last rudder [rad]."""
    return given.last_rudder, memory


LAW = Law(
    name=TRIAL_LAW,
    title="Trial",
    prefix="",
    section=None,
    numbers=NoGains,
    gains=gains_of,
    step=step,
    linear=None,
)
